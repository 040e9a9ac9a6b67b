//! Saturation of the amplifier: the voltage on the piezo stops at a limit that the drive exceeds.

use super::{
    Against, Declaration, Estimation, Overview, Parameter, Physics, Picture, Place, Planted,
    Presentation, SearchHints, Setting, SimulatedStage, Stage, SyntheticCases,
};
use crate::block::Block;
use crate::chain::Model;

/// Identifier in files and on the command line.
pub const ID: &str = "saturation";

/// Upper and lower limit of the piezo voltage.
pub struct Saturation;

struct SaturationStage {
    upper_v: f64,
    lower_v: f64,
}

impl Stage for SaturationStage {
    fn step(&mut self, _k: usize, input: f64) -> f64 {
        input.min(self.upper_v).max(self.lower_v)
    }
    fn blocks(&self) -> Option<Vec<Block>> {
        Some(vec![Block::Clamp {
            lower: self.lower_v,
            upper: self.upper_v,
        }])
    }
    fn settle(&mut self, input: f64) -> f64 {
        self.step(0, input)
    }
}

impl Physics for Saturation {
    fn declaration(&self) -> Declaration {
        Declaration {
            id: ID.into(),
            physics: "The amplifier cannot give more than its supply: above a voltage the piezo sees a constant.".into(),
            reference: "Fleming and Leang (2014), Ch. 14".into(),
            place: Place::AmplifierSaturation,
            modifies: None,
            experiment: "slow triangles up to the highest drive".into(),
            candidate: true,
            one_sided: true,
        }
    }

    fn parameters(&self, overview: &Overview) -> Vec<Parameter> {
        let range = overview.drive_range_v();
        vec![
            Parameter::linear(
                "upper_v",
                "V",
                overview.drive_min_v + 0.05 * range,
                overview.drive_max_v + range,
                0.002 * range,
            ),
            Parameter::linear(
                "lower_v",
                "V",
                overview.drive_min_v - range,
                overview.drive_max_v,
                0.002 * range,
            )
            .fixed(),
        ]
    }

    fn stage<'a>(
        &self,
        _model: &Model,
        values: &[f64],
        _setting: &Setting<'a>,
    ) -> Option<Box<dyn Stage + 'a>> {
        Some(Box::new(SaturationStage {
            upper_v: values[0],
            lower_v: values[1],
        }))
    }
}

impl Estimation for Saturation {}

impl SearchHints for Saturation {
    fn starts(&self, overview: &Overview) -> Vec<Vec<f64>> {
        let span = overview.drive_peak_v - overview.drive_min_v;
        [0.97, 0.92, 0.85, 0.77, 0.68, 0.58]
            .iter()
            .map(|share| {
                vec![
                    overview.drive_min_v + share * span,
                    overview.drive_min_v - overview.drive_range_v(),
                ]
            })
            .collect()
    }
}

impl Presentation for Saturation {
    fn equations(&self) -> &'static str {
        r"`y = max(min(x, upper_v), lower_v)`. At rest the same."
    }

    fn picture(&self) -> Picture {
        Picture {
            against: Against::Drive,
            caption: "Saturation is one-sided: nothing below a voltage, then ever more.",
        }
    }
}

impl SyntheticCases for Saturation {
    fn planted(&self) -> Planted {
        Planted::InPairs
    }

    fn values_at(
        &self,
        strength: f64,
        stage: &SimulatedStage,
        _random: &mut dyn FnMut() -> f64,
    ) -> Option<Vec<f64>> {
        Some(vec![
            stage.overview.drive_max_v - 6.5 * strength,
            -stage.overview.drive_max_v,
        ])
    }
}
