//! Piezoelectric coefficient that follows the polarisation: the gain depends on where the stage has been.
//!
//! Strain is a product of polarisation and field. Around a bias the displacement is linear in the drive with
//! a coefficient that is proportional to the polarisation, which follows the bias slowly.

use crate::block::Block;
use crate::physics::*;

/// Identifier in files and on the command line.
pub const ID: &str = "bias_dependent_gain";

/// Gain that grows with the mean of the displacement over some time.
pub struct BiasDependentGain;

struct BiasStage {
    per_um: f64,
    decay: f64,
    mean_um: f64,
}

impl Stage for BiasStage {
    fn step(&mut self, _k: usize, input: f64) -> f64 {
        self.mean_um = input + self.decay * (self.mean_um - input);
        input * (1.0 + self.per_um * self.mean_um)
    }
    fn settle(&mut self, input: f64) -> f64 {
        self.mean_um = input;
        input * (1.0 + self.per_um * input)
    }
    fn blocks(&self) -> Result<Vec<Block>, &'static str> {
        Ok(vec![Block::BiasedGain {
            per_um: self.per_um,
            decay: self.decay,
        }])
    }
    fn linear_lanes(&self, _lanes: usize) -> Option<Box<dyn LinearLanes>> {
        Some(Box::new(PassedOn))
    }
}

impl Effect for BiasDependentGain {
    fn declaration(&self) -> Declaration {
        Declaration {
            id: ID.into(),
            physics: "Strain is polarisation times field: the gain changes with the polarisation, which follows the mean of the motion.".into(),
            reference: "Smith, Smart Material Systems (2005), Ch. 2; Damjanovic, Rep. Prog. Phys. 61 (1998) 1267-1324".into(),
            experiment: "the same small loop at several levels, some seconds after each change of level".into(),
            picture: Picture {
                against: Against::Drive,
                caption: "Loops that are as high as others but tilted, by the level about which they lie.",
            },
            equations: r"`m[k] = x[k] + exp(-T / time_constant_s) (m[k-1] - x[k])`, `y = x (1 + per_um m)`. At rest `m = x`.",
            ..Declaration::on_request(Place::PiezoelectricCoefficient)
        }
    }

    fn parameters(&self, overview: &Overview) -> Vec<Parameter> {
        let range = overview.range_um.max(1e-6);
        vec![
            Parameter::linear("per_um", "1/um", -0.3 / range, 0.3 / range, 1e-3 / range),
            Parameter::logarithmic(
                "time_constant_s",
                "s",
                10.0 / overview.sample_rate_max_hz,
                overview.duration_s.max(100.0 / overview.sample_rate_max_hz),
            ),
        ]
    }

    fn starts(&self, overview: &Overview) -> Vec<Vec<f64>> {
        let range = overview.range_um.max(1e-6);
        // A tenth of a record, so that both motion and rest show it, and ten times faster.
        [0.1, 0.01]
            .map(|share| vec![0.01 / range, share * overview.duration_s.max(1e-3)])
            .to_vec()
    }

    fn stage<'a>(&self, from: &Build<'_, 'a>) -> Option<Box<dyn Stage + 'a>> {
        Some(Box::new(BiasStage {
            per_um: from.values[0],
            decay: (-from.setting.dt_s / from.values[1].max(1e-9)).exp(),
            mean_um: 0.0,
        }))
    }

    fn values_at(&self, case: &mut PlantedCase) -> Option<Vec<f64>> {
        Some(vec![0.0016 * case.strength, 0.05])
    }
}
