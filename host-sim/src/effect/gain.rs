//! Proportional response: the least that a model can be.

use super::{
    Declaration, Estimation, Loops, Overview, Parameter, Physics, Place, Presentation, SearchHints,
    Setting, Stage, SyntheticCases,
};
use crate::block::Block;
use crate::chain::Model;

/// Identifier in files and on the command line.
pub const ID: &str = "gain";

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
    fn blocks(&self) -> Option<Vec<Block>> {
        Some(vec![Block::Proportional {
            gain: self.gain_um_v,
            offset: self.lower_limit_v,
        }])
    }
    fn settle(&mut self, input: f64) -> f64 {
        self.step(0, input)
    }
}

impl Loops for GainStage {
    fn boxed(&self) -> Box<dyn Loops> {
        Box::new(self.clone())
    }
}

impl Physics for Gain {
    fn declaration(&self) -> Declaration {
        Declaration {
            id: ID.into(),
            physics: "The displacement is proportional to the drive voltage.".into(),
            reference: "thesis Ch. 6, Eq. 3".into(),
            place: Place::Hysteresis,
            modifies: None,
            experiment: "any slow drive over the range".into(),
            candidate: false,
            one_sided: false,
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

    fn stage<'a>(
        &self,
        model: &Model,
        values: &[f64],
        _setting: &Setting<'a>,
    ) -> Option<Box<dyn Stage + 'a>> {
        Some(Box::new(GainStage {
            gain_um_v: values[0],
            lower_limit_v: model.drive_min_v,
        }))
    }

    fn loops(&self, model: &Model, values: &[f64], _setting: &Setting) -> Option<Box<dyn Loops>> {
        Some(Box::new(GainStage {
            gain_um_v: values[0],
            lower_limit_v: model.drive_min_v,
        }))
    }
}

impl Estimation for Gain {
    fn fitting_rank(&self) -> usize {
        0
    }

    fn may_leave(&self) -> bool {
        false // nothing would be left to drive the chain
    }
}

impl SearchHints for Gain {
    fn starts(&self, overview: &Overview) -> Vec<Vec<f64>> {
        vec![vec![overview.gain_um_v]]
    }
}

impl Presentation for Gain {
    fn equations(&self) -> &'static str {
        r"`y = gain_um_v (x - drive_min_v)`. At rest the same."
    }
}

impl SyntheticCases for Gain {}
