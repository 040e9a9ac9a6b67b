//! By which rule an effect is admitted or refused. Every admission in the program goes through [`decide`] or says another rule by name.

use super::judgement::{Improvement, Judged, improvement};
use super::study::Study;
use crate::identification::fit::dot;
use serde::Serialize;

/// The rule that decided on an effect.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(rename_all = "snake_case", tag = "rule")]
pub enum Decision {
    /// Admitted: with it the held-out error falls by more than chance.
    HeldOutErrorFalls {
        /// Fall in standard errors.
        z: f64,
        /// Relative fall.
        relative: f64,
    },
    /// Admitted: all records show it beyond doubt, and the held-out ones, which may not excite it, get no worse.
    SeenBeyondDoubt {
        /// Fall of the error of all records in standard errors.
        z: f64,
        /// Share of the squares above the noise that it takes; of all squares where the noise is not known.
        share: f64,
    },
    /// Admitted: it takes a model from clearly above the noise down to it, held-out records included.
    ReachesTheFloor,
    /// Admitted where no record is held out: the error falls by more than chance.
    FittedErrorFalls {
        /// Fall in standard errors.
        z: f64,
        /// Largest relative fall of a record.
        relative: f64,
    },
    /// Admitted: the readings themselves show it, whatever the model.
    ReadingsShowIt,
    /// Admitted: with all values held as they were identified elsewhere, it alone explains most of the error.
    ExplainsAlone {
        /// Share of what a new fit of everything could remove.
        share: f64,
    },
    /// No name, but part of the model: far above the noise it lowers the errors.
    LowersErrors {
        /// Fall of the mean logarithm of fitted and held-out error.
        by: f64,
    },
    /// No name, but part of the model: it lowers the errors, and its own physics rules out that it is this effect.
    RuledOut,
    /// Refused: its signature is not in the residual beside what the model can do by itself.
    NotInTheResidual {
        /// p-value after control of false discoveries.
        p: f64,
    },
    /// Refused: held-out records do not get better with it.
    HeldOutErrorDoesNotFall {
        /// Fall in standard errors.
        z: f64,
        /// Relative fall.
        relative: f64,
    },
    /// Refused: no record improves by as much as matters.
    TooSmall {
        /// Largest relative fall of a record.
        relative: f64,
    },
    /// Refused: another effect in its place leaves less.
    AnotherLeavesLess,
    /// Admitted as an alternative: this data cannot tell it from the one that was taken.
    NotToldApart,
    /// Refused: others that explain as much are more like what is left, and were fitted.
    NotTried,
}

impl Decision {
    /// Whether the effect stays, or is named beside the one that does.
    #[must_use]
    pub fn admits(&self) -> bool {
        matches!(
            self,
            Self::HeldOutErrorFalls { .. }
                | Self::SeenBeyondDoubt { .. }
                | Self::ReachesTheFloor
                | Self::FittedErrorFalls { .. }
                | Self::ReadingsShowIt
                | Self::ExplainsAlone { .. }
                | Self::NotToldApart
        )
    }
}

/// Share of the sum of squares above the floor, over all judged records, that is gone. Where few events hold most of an error, it says more
/// than the scatter between blocks.
fn share_of_excess(before: &Judged, after: &Judged, floor_um: Option<f64>) -> f64 {
    let square = |judged: &Judged| judged.residuals.iter().map(|r| dot(r, r)).sum::<f64>();
    let samples: usize = before.residuals.iter().map(Vec::len).sum();
    let excess = square(before) - floor_um.map_or(0.0, |f| samples as f64 * f * f);
    if excess > 0.0 { (square(before) - square(after)) / excess } else { 0.0 }
}

/// Decides on an effect from the model without it and the one with it; `p` is the p-value of its signature beside the model without it, where
/// that has been weighed.
#[must_use]
pub fn decide(study: &Study, without: &Judged, with: &Judged, p: Option<f64>) -> Decision {
    let policy = &study.policy;
    let by: Improvement = improvement(without, with, &study.split);
    let reaches_floor = !study.met(without) && study.met(with);
    // Of a few events, as of a ring behind each of some steps, signs say nothing; errors that fall to less than half do.
    let plainly = by.identify_relative > policy.beyond_chance && by.validate_relative > policy.beyond_chance;
    if let Some(p) = p.filter(|p| *p > policy.false_discovery_rate && !reaches_floor && !plainly) {
        return Decision::NotInTheResidual { p };
    }
    if reaches_floor && by.record_relative > policy.matters {
        return Decision::ReachesTheFloor;
    }
    let matters = if study.floor_um.is_some() { policy.matters } else { policy.matters_without_floor };
    if study.split.validate.is_empty() {
        // Nothing judges: chance must be excluded the more clearly.
        let enough = by.total_z > 2.0 * policy.held_out_z && by.record_relative > matters;
        return if enough {
            Decision::FittedErrorFalls { z: by.total_z, relative: by.record_relative }
        } else {
            Decision::TooSmall { relative: by.record_relative }
        };
    }
    if by.record_relative <= matters {
        return Decision::TooSmall { relative: by.record_relative };
    }
    let least_relative = if study.floor_um.is_some() { 0.0 } else { policy.matters_without_floor };
    if by.validate_z > policy.held_out_z && by.validate_relative > least_relative {
        return Decision::HeldOutErrorFalls { z: by.validate_z, relative: by.validate_relative };
    }
    let share = share_of_excess(without, with, study.floor_um);
    let no_worse = by.validate_z > -1.0 || by.validate_relative > -0.2 * matters;
    let beyond_doubt = by.total_z > policy.beyond_doubt_z || share > policy.takes_most;
    if beyond_doubt && no_worse && by.record_relative > 2.0 * matters {
        return Decision::SeenBeyondDoubt { z: by.total_z, share };
    }
    Decision::HeldOutErrorDoesNotFall { z: by.validate_z, relative: by.validate_relative }
}
