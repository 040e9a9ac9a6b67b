//! Quantisation of the reading by the converter.

use crate::physics::*;

/// Identifier in files and on the command line.
pub const ID: &str = "quantisation";

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
    fn linear_lanes(&self, _lanes: usize) -> Option<Box<dyn LinearLanes>> {
        Some(Box::new(PassedOn))
    }
}

impl Effect for Quantisation {
    fn declaration(&self) -> Declaration {
        Declaration {
            id: ID.into(),
            physics: "The converter knows only whole codes: the reading moves in steps of one least significant bit.".into(),
            reference: "Widrow and Kollar, Quantization Noise (2008)".into(),
            experiment: "rest at constant drive: count the distinct readings".into(),
            // Its evidence is in the readings themselves, not in what a model leaves of them.
            one_sided: true,
            picture: Picture {
                against: Against::WithinStep,
                caption: "A converter takes the reading to the nearest whole step: an error that falls from one edge of a step to the other.",
            },
            planted: Planted::Alone,
            equations: r"`y = lsb_um round(x / lsb_um)`, halves away from zero; `y = x` where `lsb_um = 0`.",
            goes_by_ends: true,
            ..Declaration::on_request(Place::Quantisation)
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

    fn starts(&self, overview: &Overview) -> Vec<Vec<f64>> {
        vec![vec![overview.range_um / 65536.0]]
    }

    fn stage<'a>(&self, from: &Build<'_, 'a>) -> Option<Box<dyn Stage + 'a>> {
        Some(Box::new(RoundStage {
            lsb_um: from.values[0],
        }))
    }

    fn values_at(&self, case: &mut PlantedCase) -> Option<Vec<f64>> {
        Some(vec![0.005 * case.strength])
    }
}
