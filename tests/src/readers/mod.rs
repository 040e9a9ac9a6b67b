//! Every reader of files, blocks and lines: inputs that it accepts, and a function that reads one and uses what
//! is accepted. None may end in a panic, whatever the input.

mod board;
mod files;
mod shared;

pub use shared::{Target, Whole, loops_and_mode};

/// Every reader with inputs that it accepts.
///
/// # Panics
/// Where the project's own files cannot be read.
#[must_use]
pub fn targets() -> Vec<Target> {
    let mut targets = files::targets();
    targets.extend(board::targets());
    targets
}
