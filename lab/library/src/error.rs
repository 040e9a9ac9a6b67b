//! The one error of the library: where it is, what is wrong, what was expected.

use std::fmt;

/// Why something could not be done. Shown, it is one message for a person.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum Error {
    /// What was handed in is not what it should be: a file, a row, a field, an argument.
    Input {
        /// File, row, field: where to look; may be empty.
        place: String,
        /// What is wrong, and what was expected.
        message: String,
    },
    /// An effect cannot be fitted to this data.
    NotIdentifiable {
        /// The effect.
        effect: String,
        /// Why not, and what would show it.
        why: String,
    },
    /// A model gives something that is no number.
    NotFinite {
        /// The effect behind which it first appears; empty where the chain as a whole is meant.
        effect: String,
        /// The record.
        record: String,
        /// The sample, counted from 1.
        sample: usize,
    },
    /// No servo can be made, or the one there is does not fit.
    Servo(
        /// What stands against it.
        String,
    ),
    /// The caller asked to stop.
    Stopped,
}

impl Error {
    /// Wrong input at a place. What a library of a format says in several lines becomes one.
    pub fn new(place: impl fmt::Display, message: impl fmt::Display) -> Self {
        let message = message.to_string();
        Self::Input {
            place: place.to_string(),
            message: message.split_whitespace().collect::<Vec<_>>().join(" "),
        }
    }
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Input { place, message } if place.is_empty() => write!(f, "{message}"),
            Self::Input { place, message } => write!(f, "{place}: {message}"),
            Self::NotIdentifiable { effect, why } => write!(f, "cannot identify {effect}: {why}"),
            Self::NotFinite {
                effect,
                record,
                sample,
            } if effect.is_empty() => {
                write!(
                    f,
                    "{record}, sample {sample}: the model gives no finite number"
                )
            }
            Self::NotFinite {
                effect,
                record,
                sample,
            } => {
                write!(
                    f,
                    "{record}, sample {sample}: {effect} gives no finite number; check its values and its expression"
                )
            }
            Self::Servo(message) => write!(f, "{message}"),
            Self::Stopped => write!(f, "stopped"),
        }
    }
}

impl std::error::Error for Error {}

/// Shorthand of the whole crate.
pub type Result<T> = std::result::Result<T, Error>;

/// Similarity of Jaro and Winkler from which a known name may have been meant: "creap" and "creep" have 0.9,
/// words that share some letters 0.6 to 0.7.
const MAY_BE_MEANT: f64 = 0.75;

/// " (did you mean `x`?)" for the nearest known name, or nothing.
#[must_use]
pub fn nearest(unknown: &str, known: &[String]) -> String {
    known
        .iter()
        .map(|k| {
            (
                strsim::jaro_winkler(&unknown.to_lowercase(), &k.to_lowercase()),
                k,
            )
        })
        .max_by(|a, b| a.0.total_cmp(&b.0))
        .filter(|(similarity, _)| *similarity > MAY_BE_MEANT)
        .map_or_else(String::new, |(_, k)| format!(" (did you mean `{k}`?)"))
}

/// Line of a text, counted from 1, in which a byte stands: for messages of the TOML reader.
#[must_use]
pub fn line_of(text: &str, span: Option<std::ops::Range<usize>>) -> usize {
    span.map_or(0, |span| {
        text.get(..span.start.min(text.len()))
            .map_or(0, |before| before.lines().count().max(1))
    })
}
