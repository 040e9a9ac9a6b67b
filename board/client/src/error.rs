//! What can go wrong in a conversation, in words.

use std::fmt;

/// What went wrong: which port or which command, and what was expected.
#[derive(Debug)]
pub struct Error {
    place: String,
    message: String,
}

/// A result with [`Error`].
pub type Result<T> = std::result::Result<T, Error>;

impl Error {
    /// At a place, with a message.
    pub fn new(place: impl fmt::Display, message: impl fmt::Display) -> Self {
        Self {
            place: place.to_string(),
            message: message.to_string(),
        }
    }

    /// The port or the command.
    #[must_use]
    pub fn place(&self) -> &str {
        &self.place
    }

    /// What was wrong with it.
    #[must_use]
    pub fn message(&self) -> &str {
        &self.message
    }
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.place, self.message)
    }
}

impl std::error::Error for Error {}

/// What an error of the controller means to an operator; the numbers are those of the General Command Set.
#[must_use]
pub fn meaning(code: u32) -> String {
    let words = match code {
        1 | 17 | 24 | 26 => "the board does not take these values",
        2 => "the board does not know this command: its image is older than this program",
        5 => {
            "only with the servo on, which wants a conditioning since the start or the last fault (ATZ 1)"
        }
        7 | 302 | 405 => "beyond the limits of the block in use",
        10 => "stopped",
        76 => "too many commands wait",
        79 => "only with the servo off",
        93 => "only at rest",
        201 => "the board has no valid parameter block",
        311 => "the board does not take this block or image",
        333 => "a fault is latched",
        4001 => "the amplifier is not armed: `ARM 1 1` at rest, behind every start and every fault",
        4002 => "this board cannot be updated over the line",
        4003 => "bytes were lost on the line, and with them a command: give it again",
        4004 => "a larger step than is allowed without `FAR` behind it",
        4005 => {
            "the loop of the block has no margin for this filter of the sensor: a higher frequency, a narrower notch, or a slower design"
        }
        4006 => "nothing has tried the stage since the start or the last fault: `ARM 1 1`",
        504 => "a fault is latched: the tracking error was too large",
        _ => "the board refused it",
    };
    format!("{words} (error {code})")
}
