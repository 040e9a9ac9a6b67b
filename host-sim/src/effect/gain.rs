//! Proportional response: the least that a model can be.

use crate::block::Block;
use crate::physics::*;

/// Identifier in files and on the command line.
pub const ID: &str = id::GAIN;

/// Displacement proportional to the drive above its lower limit.
pub struct Gain;

#[derive(Clone)]
struct GainStage {
    gain_um_v: f64,
    lower_limit_v: f64,
}

impl Stage for GainStage {
    fn step(&mut self, _k: usize, input: f64) -> f64 {
        self.gain_um_v * (input - self.lower_limit_v)
    }
    fn blocks(&self) -> Result<Vec<Block>, &'static str> {
        Ok(vec![Block::Proportional {
            gain: self.gain_um_v,
            offset: self.lower_limit_v,
        }])
    }
}

impl Loops for GainStage {}

impl Effect for Gain {
    fn declaration(&self) -> Declaration {
        Declaration {
            id: ID.into(),
            physics: "The displacement is proportional to the drive voltage.".into(),
            reference: "thesis Ch. 6, Eq. 3".into(),
            experiment: "any slow drive over the range".into(),
            fitting_rank: 0,
            equations: r"`y = gain_um_v (x - drive_min_v)`. At rest the same.",
            ..Declaration::on_request(Place::Hysteresis)
        }
    }

    fn parameters(&self, overview: &Overview) -> Vec<Parameter> {
        vec![Parameter::linear(
            "gain_um_v",
            "um/V",
            -1e3,
            1e3,
            0.01 * overview.gain_um_v.abs().max(1e-6),
        )]
    }

    fn starts(&self, overview: &Overview) -> Vec<Vec<f64>> {
        vec![vec![overview.gain_um_v]]
    }

    fn loops(&self, from: &Build) -> Option<Box<dyn Loops>> {
        Some(Box::new(GainStage {
            gain_um_v: from.values[0],
            lower_limit_v: from.model.drive_min_v,
        }))
    }
}
