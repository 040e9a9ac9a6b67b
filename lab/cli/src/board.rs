//! `board`: hands its words to the program `hysteron-board` beside this one, which needs another compiler and is built apart.

use std::ffi::OsString;
use std::path::Path;
use std::process::{Command, ExitCode};

/// Runs it and ends as it ends.
pub fn run(words: &[OsString]) -> ExitCode {
    let name = format!("hysteron-board{}", std::env::consts::EXE_SUFFIX);
    let program = std::env::current_exe().map_or_else(|_| Path::new(&name).to_path_buf(), |this| this.with_file_name(&name));
    match Command::new(&program).args(words).status() {
        Ok(status) => ExitCode::from(status.code().and_then(|code| u8::try_from(code).ok()).unwrap_or(1)),
        Err(error) => {
            eprintln!("error: {}: {error}; `cargo xtask firmware` and `cargo xtask board` build it", program.display());
            ExitCode::from(2)
        }
    }
}
