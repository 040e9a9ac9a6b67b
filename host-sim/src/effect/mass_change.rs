//! An added mass lowers the frequency and the damping ratio of the modes.

use crate::physics::*;

/// Identifier in files and on the command line.
pub const ID: &str = "mass_change";

/// Mass added to the moving part, as a ratio to it; the vibration stage takes it in.
pub struct MassChange;

/// Factor on natural frequency and damping ratio in `model`.
#[must_use]
pub fn frequency_factor(model: &Model) -> f64 {
    model
        .values(ID)
        .and_then(|v| v.first().copied())
        .map_or(1.0, |ratio| 1.0 / (1.0 + ratio).max(0.01).sqrt())
}

impl Effect for MassChange {
    fn declaration(&self) -> Declaration {
        Declaration {
            id: ID.into(),
            physics: "A load on the stage adds mass: every mode becomes slower and, with the same damper, less damped.".into(),
            reference: "thesis Ch. 7, loaded case".into(),
            modifies: Some(id::VIBRATION),
            experiment: "the same multisine with and without the load".into(),
            picture: Picture {
                against: Against::Frequency,
                caption: "A dynamic effect: the residual stands where the signature has its power.",
            },
            equations: r"Natural frequency and damping ratio of every mode are multiplied by `1 / sqrt(max(1 + mass_ratio, 0.01))`.",
            ..Declaration::on_request(Place::Vibration)
        }
    }

    fn parameters(&self, _overview: &Overview) -> Vec<Parameter> {
        vec![Parameter::linear("mass_ratio", "1", -0.9, 50.0, 0.01)]
    }

    fn starts(&self, _overview: &Overview) -> Vec<Vec<f64>> {
        vec![vec![0.0]]
    }

    fn values_at(&self, case: &mut PlantedCase) -> Option<Vec<f64>> {
        Some(vec![0.1 * case.strength])
    }
}
