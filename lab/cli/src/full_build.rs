//! What this program leaves to its full build.
//!
//! A first `explain` needs neither a serial port nor a page server, the thesis reproduced or the reader of
//! every format. They take longer to build than all the rest, so that they are features of the crate
//! (lab/cli/Cargo.toml).

use hysteron::{Error, Result};

/// How to get all of it.
pub const HOW: &str =
    "`cargo install --path lab/cli --locked --features full` in the project's folder installs it";

/// The message of a command that this build lacks.
#[cfg_attr(feature = "full", allow(dead_code))]
pub fn needed(command: &str) -> Result<bool> {
    Err(Error::new(
        command,
        format!("this command is part of the full build. {HOW}"),
    ))
}
