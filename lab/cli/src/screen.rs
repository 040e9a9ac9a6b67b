//! Lines on the screen. Whoever reads them may have seen enough (`hysteron explain .. | head`): the work goes
//! on, and its files are written.

use hysteron::dataset::units::SignalUnits;
use std::fmt::Arguments;
use std::io::{ErrorKind, Write, stdout};
use std::path::Path;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicBool, Ordering};

/// Something could not be written for another reason, such as a full disk.
static FAILED: AtomicBool = AtomicBool::new(false);

/// Nothing is printed but errors and what `--json -` asks for.
static HUSHED: AtomicBool = AtomicBool::new(false);

/// From here on nothing is printed.
pub fn hush() {
    HUSHED.store(true, Ordering::Relaxed);
}

/// The units of the data set that this run is about, where they are not V and um.
static UNITS: OnceLock<SignalUnits> = OnceLock::new();

/// From here on lines are in these units.
pub fn speak_in(units: &SignalUnits) {
    // The first data set decides: a run has one.
    let _ = UNITS.set(units.clone());
}

/// A text in the units of the data set.
pub fn in_units(text: &str) -> String {
    UNITS
        .get()
        .map_or_else(|| text.to_owned(), |units| units.in_words(text))
}

/// Whether figures are in units of their own.
pub fn has_own_units() -> bool {
    UNITS
        .get()
        .is_some_and(|units| *units != SignalUnits::default())
}

/// Writes one line.
pub fn say(line: Arguments) {
    if HUSHED.load(Ordering::Relaxed) {
        return;
    }
    let written = if has_own_units() {
        writeln!(stdout(), "{}", in_units(&line.to_string()))
    } else {
        writeln!(stdout(), "{line}")
    };
    note(written);
}

/// Writes a text whatever is hushed: it was asked for here.
pub fn give(text: &str) {
    note(stdout().write_all(text.as_bytes()));
}

/// The output has arrived, or nobody wanted it any more.
pub fn has_arrived() -> bool {
    note(stdout().flush());
    !FAILED.load(Ordering::Relaxed)
}

fn note(written: std::io::Result<()>) {
    if written.is_err_and(|error| error.kind() != ErrorKind::BrokenPipe) {
        FAILED.store(true, Ordering::Relaxed);
    }
}

/// A path as it is typed in a suggested command: in quotes where it has spaces.
pub fn as_argument(path: &Path) -> String {
    let text = path.display().to_string();
    if text.contains(char::is_whitespace) {
        format!("\"{text}\"")
    } else {
        text
    }
}
