//! External force on the actuator, taken from the measured force channel.

use crate::block::Block;
use crate::physics::*;

/// Displacement by a measured force through the compliance of the actuator.
pub struct LoadForce;

struct LoadStage<'a> {
    compliance_um_n: f64,
    setting: Setting<'a>,
}

impl Stage for LoadStage<'_> {
    fn step(&mut self, k: usize, input: f64) -> f64 {
        let force_n = self
            .setting
            .signals
            .force_n
            .map_or(0.0, |force_n| self.setting.held(force_n, k));
        input + self.compliance_um_n * force_n
    }
    fn blocks(&self) -> Result<Vec<Block>, &'static str> {
        Ok(vec![Block::Force {
            compliance: self.compliance_um_n,
        }])
    }
    fn linear_lanes(&self, _lanes: usize) -> Option<Box<dyn LinearLanes>> {
        Some(Box::new(PassedOn))
    }
}

impl Effect for LoadForce {
    fn declaration(&self) -> Declaration {
        Declaration {
            id: "load_force".into(),
            physics: "An external force compresses the actuator by its compliance.".into(),
            reference:
                "thesis Ch. 2, Eq. 11; Goldfarb and Celanovic, IEEE Control Systems 17 (1997)"
                    .into(),
            experiment: "constant drive while the force changes and is recorded".into(),
            needs_force: true,
            picture: Picture {
                against: Against::Force,
                caption: "An error that follows the measured force, whatever the drive does.",
            },
            planted: Planted::InPairs,
            equations: r"`y = x + compliance_um_n F`, with the measured force of the sample at which the interval begins.",
            ..Declaration::at(Place::LoadForce)
        }
    }

    fn parameters(&self, overview: &Overview) -> Vec<Parameter> {
        vec![Parameter::linear(
            "compliance_um_n",
            "um/N",
            -1e3,
            1e3,
            0.001 * overview.range_um.max(1e-6),
        )]
    }

    fn starts(&self, overview: &Overview) -> Vec<Vec<f64>> {
        if overview.has_force {
            vec![vec![0.001 * overview.range_um.max(1e-6)]]
        } else {
            Vec::new()
        }
    }

    fn stage<'a>(&self, from: &Build<'_, 'a>) -> Option<Box<dyn Stage + 'a>> {
        Some(Box::new(LoadStage {
            compliance_um_n: from.values[0],
            setting: *from.setting,
        }))
    }

    fn values_at(&self, case: &mut PlantedCase) -> Option<Vec<f64>> {
        Some(vec![0.02 * case.strength])
    }
}
