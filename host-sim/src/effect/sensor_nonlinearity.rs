//! Nonlinear sensor: its reading is a bent function of the displacement, the same on every branch.

use crate::block::Block;
use crate::physics::*;

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
    fn blocks(&self) -> Result<Vec<Block>, &'static str> {
        Ok(vec![Block::Bend {
            quadratic: self.quadratic,
            cubic: self.cubic,
        }])
    }
    fn linear_lanes(&self, _lanes: usize) -> Option<Box<dyn LinearLanes>> {
        Some(Box::new(PassedOn))
    }
}

impl Effect for SensorNonlinearity {
    fn declaration(&self) -> Declaration {
        Declaration {
            id: "sensor_nonlinearity".into(),
            physics: "The sensor's characteristic is bent: the error depends on the displacement alone, on both branches alike.".into(),
            reference: "Fleming, Sensors and Actuators A 190 (2013) 106-126".into(),
            experiment: "the same displacements reached on rising and falling branches and at different speeds".into(),
            starts_combine: true,
            picture: Picture {
                against: Against::Displacement,
                caption: "A function of the displacement alone: rising and falling branches fall on one curve.",
            },
            planted: Planted::InPairs,
            equations: r"`y = x + quadratic_per_um x^2 + cubic_per_um2 x^3`. At rest the same.",
            goes_by_ends: true,
            ..Declaration::at(Place::SensorNonlinearity)
        }
    }

    fn parameters(&self, overview: &Overview) -> Vec<Parameter> {
        let range = overview.range_um.max(1e-6);
        // At the end of the range each term is as large as the reading, at most.
        vec![
            Parameter::linear(
                "quadratic_per_um",
                "1/um",
                -1.0 / range,
                1.0 / range,
                1e-3 / range,
            ),
            Parameter::linear(
                "cubic_per_um2",
                "1/um^2",
                -1.0 / (range * range),
                1.0 / (range * range),
                1e-3 / (range * range),
            ),
        ]
    }

    fn starts(&self, overview: &Overview) -> Vec<Vec<f64>> {
        let range = overview.range_um.max(1e-6);
        vec![vec![0.003 / range, 0.0], vec![0.0, 0.003 / (range * range)]]
    }

    fn stage<'a>(&self, from: &Build<'_, 'a>) -> Option<Box<dyn Stage + 'a>> {
        Some(Box::new(PolynomialStage {
            quadratic: from.values[0],
            cubic: from.values[1],
        }))
    }

    fn values_at(&self, case: &mut PlantedCase) -> Option<Vec<f64>> {
        Some(vec![0.0016 * case.strength, 0.000_24 * case.strength])
    }
}
