//! Nonlinear sensor: its reading is a bent function of the displacement, the same on every branch.
//!
//! Its error is that against the straight line through the ends of the scale, as end-point nonlinearity is
//! stated. A bend about any other point is the same bend with another sensitivity, which belongs to the gain.

use super::{
    Against, Declaration, Estimation, LinearLanes, Overview, Parameter, PassedOn, Physics, Picture, Place, Planted, Presentation,
    SearchHints, Setting, SimulatedStage, Stage, SyntheticCases,
};
use crate::block::Block;
use crate::chain::Model;

/// Quadratic and cubic error of the sensor.
pub struct SensorNonlinearity;

struct PolynomialStage {
    quadratic: f64,
    cubic: f64,
    full_scale: f64,
}

impl Stage for PolynomialStage {
    fn step(&mut self, _k: usize, input: f64) -> f64 {
        input + input * (input - self.full_scale) * (self.quadratic + self.cubic * (input - 0.5 * self.full_scale))
    }
    fn blocks(&self) -> Option<Vec<Block>> {
        Some(vec![Block::Bend { quadratic: self.quadratic, cubic: self.cubic, full_scale: self.full_scale }])
    }
    fn settle(&mut self, input: f64) -> f64 {
        self.step(0, input)
    }
    fn linear_lanes(&self, _lanes: usize) -> Option<Box<dyn LinearLanes>> {
        Some(Box::new(PassedOn))
    }
}

impl Physics for SensorNonlinearity {
    fn declaration(&self) -> Declaration {
        Declaration {
            id: "sensor_nonlinearity".into(),
            physics: "The sensor's characteristic is bent: the error depends on the displacement alone, on both branches alike.".into(),
            reference: "Fleming, Sensors and Actuators A 190 (2013) 106-126".into(),
            place: Place::SensorNonlinearity,
            modifies: None,
            experiment: "the same displacements reached on rising and falling branches and at different speeds".into(),
            candidate: true,
            one_sided: false,
        }
    }

    fn parameters(&self, overview: &Overview) -> Vec<Parameter> {
        let range = overview.range_um.max(1e-6);
        vec![
            Parameter::linear("quadratic_per_um", "1/um", -0.3 / range, 0.3 / range, 1e-3 / range),
            Parameter::linear("cubic_per_um2", "1/um^2", -0.3 / (range * range), 0.3 / (range * range), 1e-3 / (range * range)),
            Parameter::linear("full_scale_um", "um", 0.0, 1e9, 0.01 * range).fixed(),
        ]
    }

    fn goes_by_ends(&self, _model: &Model) -> bool {
        true
    }

    fn stage<'a>(&self, _model: &Model, values: &[f64], _setting: &Setting<'a>) -> Option<Box<dyn Stage + 'a>> {
        Some(Box::new(PolynomialStage { quadratic: values[0], cubic: values[1], full_scale: values[2] }))
    }
}

impl Estimation for SensorNonlinearity {}

impl SearchHints for SensorNonlinearity {
    fn starts(&self, overview: &Overview) -> Vec<Vec<f64>> {
        let range = overview.range_um.max(1e-6);
        vec![vec![0.003 / range, 0.0, range], vec![0.0, 0.003 / (range * range), range]]
    }

    fn starts_combine(&self) -> bool {
        true
    }
}

impl Presentation for SensorNonlinearity {
    fn equations(&self) -> &'static str {
        r"`y = x + x (x - L) (quadratic_per_um + cubic_per_um2 (x - L / 2))`, with `L = full_scale_um`: no error at the ends of the scale. At rest the same."
    }

    fn picture(&self) -> Picture {
        Picture {
            against: Against::Displacement,
            caption: "A function of the displacement alone: rising and falling branches fall on one curve.",
        }
    }
}

impl SyntheticCases for SensorNonlinearity {
    fn planted(&self) -> Planted {
        Planted::InPairs
    }

    fn values_at(&self, strength: f64, stage: &SimulatedStage, _random: &mut dyn FnMut() -> f64) -> Option<Vec<f64>> {
        Some(vec![0.0016 * strength, 0.000_24 * strength, stage.overview.range_um])
    }
}
