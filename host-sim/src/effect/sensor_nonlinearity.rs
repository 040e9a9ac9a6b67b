//! Nonlinear sensor: its reading is a bent function of the displacement, the same on every branch.

use super::{
    Against, Declaration, Estimation, LinearLanes, Overview, Parameter, PassedOn, Physics, Picture,
    Place, Planted, Presentation, SearchHints, Setting, SimulatedStage, Stage, SyntheticCases,
};
use crate::block::Block;
use crate::chain::Model;

/// Quadratic and cubic error of the sensor.
pub struct SensorNonlinearity;

struct PolynomialStage {
    quadratic: f64,
    cubic: f64,
}

impl Stage for PolynomialStage {
    fn step(&mut self, _k: usize, input: f64) -> f64 {
        input * (1.0 + input * (self.quadratic + input * self.cubic))
    }
    fn blocks(&self) -> Option<Vec<Block>> {
        Some(vec![Block::Bend {
            quadratic: self.quadratic,
            cubic: self.cubic,
        }])
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
            Parameter::linear(
                "quadratic_per_um",
                "1/um",
                -0.3 / range,
                0.3 / range,
                1e-3 / range,
            ),
            Parameter::linear(
                "cubic_per_um2",
                "1/um^2",
                -0.3 / (range * range),
                0.3 / (range * range),
                1e-3 / (range * range),
            ),
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
        Some(Box::new(PolynomialStage {
            quadratic: values[0],
            cubic: values[1],
        }))
    }
}

impl Estimation for SensorNonlinearity {}

impl SearchHints for SensorNonlinearity {
    fn starts(&self, overview: &Overview) -> Vec<Vec<f64>> {
        let range = overview.range_um.max(1e-6);
        vec![vec![0.003 / range, 0.0], vec![0.0, 0.003 / (range * range)]]
    }

    fn starts_combine(&self) -> bool {
        true
    }
}

impl Presentation for SensorNonlinearity {
    fn equations(&self) -> &'static str {
        r"`y = x + quadratic_per_um x^2 + cubic_per_um2 x^3`. At rest the same."
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

    fn values_at(
        &self,
        strength: f64,
        _stage: &SimulatedStage,
        _random: &mut dyn FnMut() -> f64,
    ) -> Option<Vec<f64>> {
        Some(vec![0.0016 * strength, 0.000_24 * strength])
    }
}
