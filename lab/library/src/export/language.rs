//! The languages in which a model is written.

use crate::error::{Error, Result};

/// What a model is exported as.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Language {
    /// A function for MATLAB and Octave.
    Matlab,
    /// A module that needs NumPy alone.
    Python,
    /// C99 with fixed memory.
    C,
    /// The linear part as JSON.
    StateSpace,
}

impl Language {
    /// All by the names that files and command line use, each with the extension of its files.
    pub const ALL: [(&'static str, &'static str, Self); 4] = [
        ("matlab", "m", Self::Matlab),
        ("python", "py", Self::Python),
        ("c", "c", Self::C),
        ("state-space", "json", Self::StateSpace),
    ];

    /// By its name.
    ///
    /// # Errors
    /// With all names.
    pub fn named(place: &str, name: &str) -> Result<Self> {
        let known = || {
            Self::ALL
                .iter()
                .map(|(name, ..)| *name)
                .collect::<Vec<_>>()
                .join(", ")
        };
        Self::ALL
            .iter()
            .find(|(known, ..)| *known == name)
            .map(|(.., language)| *language)
            .ok_or_else(|| Error::new(place, format!("`{name}`; expected one of {}", known())))
    }

    /// The extension of its files.
    #[must_use]
    pub fn extension(self) -> &'static str {
        Self::ALL
            .iter()
            .find(|(.., language)| *language == self)
            .map_or("txt", |(_, extension, _)| extension)
    }
}
