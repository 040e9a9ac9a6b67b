//! Bipolar drive: the hysteresis counts from a lower limit below the drive's nominal one.

use crate::physics::*;

/// Identifier in files and on the command line.
pub const ID: &str = id::BIPOLAR;

/// Moves the lower limit from which the one-sided hysteresis counts.
pub struct Bipolar;

/// Lower limit of the hysteresis in `model`, V.
#[must_use]
pub fn lower_limit_v(model: &Model) -> f64 {
    model
        .values(ID)
        .and_then(|v| v.first().copied())
        .unwrap_or(model.drive_min_v)
}

impl Effect for Bipolar {
    fn declaration(&self) -> Declaration {
        Declaration {
            id: ID.into(),
            physics: "The drive goes below zero: the one-sided memory then counts from the lowest drive, not from zero.".into(),
            reference: "thesis Ch. 8, future work 2".into(),
            modifies: Some(id::HYSTERESIS),
            experiment: "triangles of growing height that begin at the lowest drive".into(),
            equations: r"`low = lower_limit_v` in the `X` of `hysteresis`.",
            ..Declaration::on_request(Place::Hysteresis)
        }
    }

    fn parameters(&self, overview: &Overview) -> Vec<Parameter> {
        let range = overview.drive_range_v();
        vec![
            Parameter::linear(
                "lower_limit_v",
                "V",
                overview.drive_min_v - 2.0 * range,
                overview.drive_min_v,
                0.01 * range,
            )
            .fixed(),
        ]
    }

    fn starts(&self, overview: &Overview) -> Vec<Vec<f64>> {
        vec![vec![overview.drive_min_v]]
    }
}
