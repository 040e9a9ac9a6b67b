//! Quantisation of the reading by the converter.

use super::{
    Against, Declaration, Estimation, LinearLanes, Overview, Parameter, PassedOn, Physics, Picture,
    Place, Planted, Presentation, SearchHints, Setting, SimulatedStage, Stage, SyntheticCases,
};
use crate::chain::Model;

/// Rounds the reading to the nearest code.
pub struct Quantisation;

struct RoundStage {
    lsb_um: f64,
}

impl Stage for RoundStage {
    fn step(&mut self, _k: usize, input: f64) -> f64 {
        if self.lsb_um > 0.0 {
            (input / self.lsb_um).round() * self.lsb_um
        } else {
            input
        }
    }
    fn settle(&mut self, input: f64) -> f64 {
        self.step(0, input)
    }
    fn linear_lanes(&self, _lanes: usize) -> Option<Box<dyn LinearLanes>> {
        Some(Box::new(PassedOn))
    }
}

impl Physics for Quantisation {
    fn declaration(&self) -> Declaration {
        Declaration {
            id: "quantisation".into(),
            physics: "The converter knows only whole codes: the reading moves in steps of one least significant bit.".into(),
            reference: "Widrow and Kollar, Quantization Noise (2008)".into(),
            place: Place::Quantisation,
            modifies: None,
            experiment: "rest at constant drive: count the distinct readings".into(),
            // Its evidence is in the readings themselves, not in what a model leaves of them.
            candidate: false,
            one_sided: true,
        }
    }

    fn parameters(&self, overview: &Overview) -> Vec<Parameter> {
        vec![
            Parameter::linear(
                "lsb_um",
                "um",
                0.0,
                overview.range_um,
                1e-5 * overview.range_um.max(1e-6),
            )
            .fixed(),
        ]
    }

    fn goes_by_ends(&self, _model: &Model) -> bool {
        true
    }

    fn stage<'a>(
        &self,
        _model: &Model,
        values: &[f64],
        _setting: &Setting<'a>,
    ) -> Option<Box<dyn Stage + 'a>> {
        Some(Box::new(RoundStage { lsb_um: values[0] }))
    }
}

impl Estimation for Quantisation {}

impl SearchHints for Quantisation {
    fn starts(&self, overview: &Overview) -> Vec<Vec<f64>> {
        vec![vec![overview.range_um / 65536.0]]
    }

    fn values_in_readings(&self, step_um: f64) -> Option<Vec<f64>> {
        Some(vec![step_um])
    }
}

impl Presentation for Quantisation {
    fn equations(&self) -> &'static str {
        r"`y = lsb_um round(x / lsb_um)`, halves away from zero; `y = x` where `lsb_um = 0`."
    }

    fn picture(&self) -> Picture {
        Picture {
            against: Against::WithinStep,
            caption: "A converter takes the reading to the nearest whole step: an error that falls from one edge of a step to the other.",
        }
    }
}

impl SyntheticCases for Quantisation {
    fn planted(&self) -> Planted {
        Planted::Alone
    }

    fn values_at(
        &self,
        strength: f64,
        _stage: &SimulatedStage,
        _random: &mut dyn FnMut() -> f64,
    ) -> Option<Vec<f64>> {
        Some(vec![0.005 * strength])
    }
}
