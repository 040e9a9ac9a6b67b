//! Lines on the screen. Whoever reads them may have seen enough (`hysteron explain .. | head`): the work goes on, and its files are written.

use std::fmt::Arguments;
use std::io::{ErrorKind, Write, stdout};
use std::sync::atomic::{AtomicBool, Ordering};

/// Something could not be written for another reason, such as a full disk.
static FAILED: AtomicBool = AtomicBool::new(false);

/// Writes one line.
pub fn say(line: Arguments) {
    note(writeln!(stdout(), "{line}"));
}

/// What was said has arrived, or nobody wanted it any more.
pub fn has_arrived() -> bool {
    note(stdout().flush());
    !FAILED.load(Ordering::Relaxed)
}

fn note(written: std::io::Result<()>) {
    if written.is_err_and(|error| error.kind() != ErrorKind::BrokenPipe) {
        FAILED.store(true, Ordering::Relaxed);
    }
}
