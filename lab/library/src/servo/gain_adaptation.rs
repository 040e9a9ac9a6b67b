//! Bounds within which a predictor corrects the gain of its model while it runs (core:
//! [`hysteron_core::gain_adaptation`]).
//!
//! # Why it stays stable
//! What counts for the loop is the actuator's gain over the believed one. With the actuator within
//! [`FARTHEST`] of its model and the belief within the same bounds it is between 0.8 / 1.2 and 1.2 / 0.8,
//! wherever the belief stands; every design holds with the gain from half to one and a half. A belief moves
//! by at most half a per cent in a tenth of a second, which is slow against every eigenvalue of a loop that
//! is worth having.

use super::quantise::{QuantisationError, number};
use hysteron_core::gain_adaptation::{AdaptationParameters, GAIN_FRACTION_BITS};
use hysteron_core::signal::MICROMETRE_FRACTION_BITS;
use serde::{Deserialize, Serialize};

/// Farthest that the gain is taken from the model's, as a share of it.
pub const FARTHEST: f64 = 0.2;
/// Largest step of a window that a target takes, as a share of the gain.
pub const LARGEST_STEP: f64 = 1.0 / 32.0;
/// Largest step of a window of 0.1 s.
const MOST_STEP: f64 = 0.005;
/// Errors beyond this share of the travel say more of a loop in trouble than of a gain.
const ERROR_SHARE: f64 = 0.05;
/// Feedforward that changes by less than this share of the travel (RMS, from one mean over 0.8 ms to the
/// next) shows no gain: a sine of a hundredth of the travel above some 85 Hz does, one of a quarter of it
/// above 3.5 Hz.
const LEAST_MOTION_SHARE: f64 = 0.003;

/// Bounds of the adaptation.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AdaptationDesign {
    /// Farthest that the gain is taken from the model's, as a share of it.
    pub farthest: f64,
    /// Largest step of a window of 0.1 s, as a share of the gain.
    pub most_step: f64,
    /// Nothing is learned from errors beyond this, um.
    pub error_limit_um: f64,
    /// Least RMS change of the feedforward from one mean over 0.8 ms to the next, um.
    pub least_motion_um: f64,
}

impl AdaptationDesign {
    /// For an actuator of this travel.
    #[must_use]
    pub fn new(travel_um: f64) -> Self {
        Self {
            farthest: FARTHEST,
            most_step: MOST_STEP,
            error_limit_um: ERROR_SHARE * travel_um,
            least_motion_um: LEAST_MOTION_SHARE * travel_um,
        }
    }

    /// The gain over the believed one, least and largest, where an actuator's is `ratio` times the model's.
    #[must_use]
    pub fn over_beliefs(&self, ratio: f64) -> [f64; 2] {
        [ratio / (1.0 + self.farthest), ratio / (1.0 - self.farthest)]
    }

    /// The adaptation in words.
    #[must_use]
    pub fn in_words(&self) -> String {
        format!(
            "The gain of the model is corrected while it runs, by at most {:.0} %, {:.1} % in a tenth of a second, from references that move; with the actuator's gain as far off to either side the loop holds wherever the correction stands.",
            100.0 * self.farthest,
            100.0 * self.most_step
        )
    }

    /// As the tick takes them.
    ///
    /// # Errors
    /// If a bound does not fit its format.
    pub fn quantised(&self) -> Result<AdaptationParameters, QuantisationError> {
        let (gain_bits, um_bits) = (GAIN_FRACTION_BITS as i32, MICROMETRE_FRACTION_BITS as i32);
        let parameters = AdaptationParameters {
            most: number("bound of the adapted gain", self.farthest, gain_bits)?
                .min(hysteron_core::gain_adaptation::MOST),
            most_step: number("step of the adapted gain", self.most_step, gain_bits)?,
            error_limit: number(
                "largest error that a gain is learned from",
                self.error_limit_um,
                um_bits,
            )?,
            least_motion: number(
                "least motion that a gain is learned from",
                self.least_motion_um,
                um_bits,
            )?,
        };
        let wrong = QuantisationError {
            what: "bounds of the adapted gain: farthest".into(),
            value: self.farthest,
            limit: FARTHEST,
        };
        // A share beyond the bound is refused, one that only rounding took beyond it is not.
        if parameters.accepted() && self.farthest <= FARTHEST {
            Ok(parameters)
        } else {
            Err(wrong)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bounds_are_what_the_target_accepts_or_an_error() {
        let design = AdaptationDesign::new(10.0);
        assert!(design.quantised().unwrap().accepted());
        for broken in [
            AdaptationDesign {
                farthest: 0.25,
                ..design
            },
            AdaptationDesign {
                farthest: 0.0,
                ..design
            },
            AdaptationDesign {
                most_step: 0.3,
                ..design
            },
            AdaptationDesign {
                error_limit_um: 0.0,
                ..design
            },
            AdaptationDesign {
                least_motion_um: f64::NAN,
                ..design
            },
            AdaptationDesign {
                least_motion_um: 0.0,
                ..design
            },
        ] {
            assert!(broken.quantised().is_err(), "{broken:?}");
        }
        // Wherever the belief stands, an actuator within the same bounds is within what every design holds
        // for.
        let [least, _] = design.over_beliefs(1.0 - FARTHEST);
        let [_, most] = design.over_beliefs(1.0 + FARTHEST);
        assert!(least > 0.5 && most <= 1.5 + 1e-12, "{least} {most}");
    }
}
