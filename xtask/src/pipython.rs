//! A stranger's program in front of the emulated board: PIPython as PyPI has it, in a virtual environment of
//! its own.

use crate::board;
use crate::emulated_board::{EmulatedBoard, words_of_board};
use crate::virtual_environment;
use crate::workspace::{command, root};

/// The release that is installed.
const PIPYTHON: &str = "pipython==2.11.0.6";

/// Runs the conversation of `board/emulator/tests/pipython_client.py`.
pub fn run() -> Result<(), String> {
    let python = virtual_environment::kept("pipython", &[PIPYTHON])?;
    let board = EmulatedBoard::start(&board::program(), &words_of_board(&[]))?;
    let script = root().join("board/emulator/tests/pipython_client.py");
    command(
        &python,
        &[&script.to_string_lossy(), &board.port],
        &root(),
        &[],
    )
}
