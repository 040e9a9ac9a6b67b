//! The one kind of error that a user sees: where it is, what is wrong, what was expected.

use std::fmt;
use std::path::Path;

/// Bad input, told in one message. The program exits with status 2.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Problem {
    /// File, row, field: where to look.
    pub place: String,
    /// What is wrong, and what was expected.
    pub message: String,
}

impl Problem {
    /// A problem at a place.
    pub fn new(place: impl fmt::Display, message: impl fmt::Display) -> Self {
        Self { place: place.to_string(), message: message.to_string() }
    }

    /// A problem with a file.
    pub fn file(path: &Path, message: impl fmt::Display) -> Self {
        Self::new(path.display(), message)
    }
}

impl fmt::Display for Problem {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.place.is_empty() { write!(f, "{}", self.message) } else { write!(f, "{}: {}", self.place, self.message) }
    }
}

impl std::error::Error for Problem {}

/// Shorthand of the whole crate.
pub type Result<T> = std::result::Result<T, Problem>;

/// " (did you mean `x`?)" for the nearest known name, or nothing.
#[must_use]
pub fn nearest(unknown: &str, known: &[String]) -> String {
    known
        .iter()
        .map(|k| (strsim::jaro_winkler(&unknown.to_lowercase(), &k.to_lowercase()), k))
        .max_by(|a, b| a.0.total_cmp(&b.0))
        .filter(|(similarity, _)| *similarity > 0.6)
        .map_or_else(String::new, |(_, k)| format!(" (did you mean `{k}`?)"))
}

/// Writes a file whole or not at all.
///
/// # Errors
/// When the folder cannot be written to.
pub fn write_whole(path: &Path, bytes: &[u8]) -> Result<()> {
    crate::report::write_whole(path, bytes).map_err(|e| Problem::file(path, format!("cannot be written: {e}")))
}
