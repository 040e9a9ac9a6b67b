//! A stranger's program in front of the emulated board: PIPython as PyPI has it, in a virtual environment of its own.

use std::io::{BufRead, BufReader};
use std::process::{Child, Command, Stdio};

use crate::steps::{command, root};
use crate::{board, virtual_environment};

/// The release that is installed.
const PIPYTHON: &str = "pipython==2.11.0.6";

/// A process that ends with the check.
struct Running(Child);

impl Drop for Running {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// Runs the conversation of `board/tests/pipython_client.py`.
pub fn run() -> Result<(), String> {
    let python = virtual_environment::kept("pipython", &[PIPYTHON])?;
    let mut child = Command::new(board::program())
        .args(["emulate", "--tcp", "127.0.0.1:0"])
        .stdout(Stdio::piped())
        .spawn()
        .map_err(|error| format!("{}: {error}", board::program().display()))?;
    let output = child.stdout.take();
    let _board = Running(child);
    let mut lines = BufReader::new(output.ok_or("the board has no output")?).lines();
    let first = lines.next().and_then(Result::ok).unwrap_or_default();
    let port =
        first.rsplit(':').next().filter(|_| first.starts_with("the serial port is")).ok_or_else(|| format!("the board says `{first}`"))?;
    // The log goes on; nobody may hold it up.
    std::thread::spawn(move || lines.map_while(Result::ok).for_each(|line| println!("   board: {line}")));
    let script = root().join("board/tests/pipython_client.py");
    command(&python, &[&script.to_string_lossy(), port], &root(), &[])
}
