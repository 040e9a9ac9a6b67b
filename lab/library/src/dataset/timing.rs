//! When the drive of a row acts. Here `u[k]` acts from `t[k]` to `t[k+1]`, after the sample `y[k]`; a logger
//! that writes its drive, waits and then reads has `u[k]` act up to `t[k]`. Taken for the former, such a
//! recording has the displacement a sample ahead of its cause, which no effect explains, and modes are found
//! that are none.

use crate::error::{Error, Result};
use hysteron_sim::intersample::Intersample;
use serde::Deserialize;

/// When samples are taken and drives act.
#[derive(Clone, Copy, Debug, Default, Deserialize, PartialEq, Eq)]
#[serde(rename_all = "snake_case")]
pub enum Timing {
    /// `y[k]` is sampled at `t[k]`; `u[k]` acts from `t[k]` to `t[k+1]`.
    #[default]
    HoldAfterSample,
    /// `u[k]` acts from `t[k-1]` to `t[k]`; `y[k]` is sampled at `t[k]`.
    HoldBeforeSample,
}

impl Timing {
    /// The name that files use.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::HoldAfterSample => "hold_after_sample",
            Self::HoldBeforeSample => "hold_before_sample",
        }
    }

    /// The timing by its name in files; `place` is where somebody said it.
    ///
    /// # Errors
    /// With both names.
    pub fn named(place: &str, name: &str) -> Result<Self> {
        match name {
            "hold_after_sample" => Ok(Self::HoldAfterSample),
            "hold_before_sample" => Ok(Self::HoldBeforeSample),
            _ => Err(Error::new(
                place,
                format!("`{name}`; expected hold_after_sample or hold_before_sample"),
            )),
        }
    }
}

/// What a drive does between samples, by its name in files; `place` is where somebody specified it.
///
/// # Errors
/// With all names.
pub fn intersample_named(place: &str, name: &str) -> Result<Intersample> {
    let found = Intersample::NAMES
        .into_iter()
        .find(|(known, _)| *known == name)
        .map(|(_, one)| one);
    found.ok_or_else(|| {
        Error::new(
            place,
            format!("`{name}`; expected hold, linear or band_limited"),
        )
    })
}
