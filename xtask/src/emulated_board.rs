//! The emulated board as a process beside a step, with its serial port on a free port of 127.0.0.1.

use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Child, Command, Stdio};

/// A process that ends with the step.
pub struct EmulatedBoard {
    child: Child,
    /// Port on 127.0.0.1.
    pub port: String,
}

/// The words for `hysteron-board` that emulates at a free port, with these further ones.
pub fn words_of_board<'a>(further: &[&'a str]) -> Vec<&'a str> {
    [&["emulate", "--tcp", "127.0.0.1:0"], further].concat()
}

impl Drop for EmulatedBoard {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

impl EmulatedBoard {
    /// Starts a program that says first where its serial port is.
    pub fn start(program: &Path, words: &[&str]) -> Result<Self, String> {
        let mut child = Command::new(program)
            .args(words)
            .stdout(Stdio::piped())
            .spawn()
            .map_err(|error| format!("{}: {error}", program.display()))?;
        let output = child.stdout.take();
        let mut this = Self {
            child,
            port: String::new(),
        };
        let mut lines = BufReader::new(output.ok_or("the board has no output")?).lines();
        let first = lines.next().and_then(Result::ok).unwrap_or_default();
        let port = first
            .rsplit(':')
            .next()
            .filter(|_| first.starts_with("the serial port is"));
        this.port = port
            .ok_or_else(|| format!("the board says `{first}`"))?
            .to_string();
        // The log goes on; nobody may hold it up.
        std::thread::spawn(move || {
            lines
                .map_while(Result::ok)
                .for_each(|line| println!("   board: {line}"))
        });
        Ok(this)
    }
}
