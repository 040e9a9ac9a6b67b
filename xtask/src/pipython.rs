//! A stranger's program in front of the emulated board: PIPython as PyPI has it, in a virtual environment of
//! its own.

use std::path::Path;

use crate::board;
use crate::emulated_board::{EmulatedBoard, words_of_board};
use crate::virtual_environment;
use crate::workspace::{command, root};

/// The release that is installed.
const PIPYTHON: &str = "pipython==2.11.0.6";

/// Runs the conversation of `board/emulator/tests/pipython_client.py`.
pub fn run() -> Result<(), String> {
    converse(&[], &root().join("board/emulator/tests/pipython_client.py"))
}

/// Runs the program of the guide to stick-slip drives, as it stands there.
pub fn run_stick_slip() -> Result<(), String> {
    let problem = |error: std::io::Error| format!("docs/guides/stick_slip.md: {error}");
    let guide = std::fs::read_to_string(root().join("docs/guides/stick_slip.md"));
    let guide = guide.map_err(problem)?;
    let program = guide
        .split("```")
        .find_map(|part| part.strip_prefix("python\n"))
        .ok_or("docs/guides/stick_slip.md: no program")?;
    let script = root().join("target/stick_slip_guide.py");
    std::fs::write(&script, program).map_err(problem)?;
    let rig = root().join("board/emulator/tests/rig.toml");
    converse(&["--stick-slip", &rig.to_string_lossy()], &script)
}

/// Runs a program in front of the board that is emulated with these words.
fn converse(words: &[&str], script: &Path) -> Result<(), String> {
    let python = virtual_environment::kept("pipython", &[PIPYTHON])?;
    let board = EmulatedBoard::start(&board::program(), &words_of_board(words))?;
    command(
        &python,
        &[&script.to_string_lossy(), &board.port],
        &root(),
        &[],
    )
}
