//! `board send` and `board attach`: lines as a person types them.

use super::connection::{LineArguments, as_ours};
use hysteron::{Error, Result};
use std::io::{BufRead, Write};
use std::sync::mpsc::{TryRecvError, channel};

/// Whether the board answers a line: a query, or a byte.
fn is_answered(command: &str) -> bool {
    command
        .split_ascii_whitespace()
        .next()
        .is_some_and(|mnemonic| mnemonic.ends_with('?'))
}

/// Sends commands one after the other, prints answers, and ends with 2 at the first that is refused.
pub fn send(commands: &[String], line: &LineArguments) -> Result<bool> {
    let mut board = line.connect()?;
    for command in commands {
        if is_answered(command) {
            print!("{}", board.ask(command).map_err(as_ours)?);
        } else {
            board.tell(command).map_err(as_ours)?;
        }
    }
    Ok(true)
}

/// Passes lines on until what is typed ends.
pub fn attach(line: &LineArguments) -> Result<bool> {
    let mut board = line.connect()?;
    println!(
        "{}; HLP? lists the commands, STP brings the drive to rest, the end of input ends",
        board.identification
    );
    let (typed, lines) = channel();
    std::thread::spawn(move || {
        for line in std::io::stdin()
            .lock()
            .lines()
            .map_while(std::io::Result::ok)
        {
            if typed.send(line).is_err() {
                break;
            }
        }
    });
    loop {
        let came = board.receive().map_err(as_ours)?;
        let mut out = std::io::stdout().lock();
        out.write_all(&came)
            .and_then(|()| out.flush())
            .map_err(|problem| Error::new("screen", problem))?;
        match lines.try_recv() {
            Ok(line) => board
                .send(format!("{line}\n").as_bytes())
                .map_err(as_ours)?,
            Err(TryRecvError::Empty) => {}
            // What was asked last may still be on its way.
            Err(TryRecvError::Disconnected) if came.is_empty() => return Ok(true),
            Err(TryRecvError::Disconnected) => {}
        }
    }
}
