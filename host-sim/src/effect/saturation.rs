//! Saturation of the amplifier: the voltage on the piezo stops at a limit that the drive exceeds.

use crate::block::Block;
use crate::physics::*;

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
    fn blocks(&self) -> Result<Vec<Block>, &'static str> {
        Ok(vec![Block::Clamp {
            lower: self.lower_v,
            upper: self.upper_v,
        }])
    }
}

impl Effect for Saturation {
    fn declaration(&self) -> Declaration {
        Declaration {
            id: ID.into(),
            physics: "The amplifier cannot give more than its supply: above a voltage the piezo sees a constant.".into(),
            reference: "Fleming and Leang (2014), Ch. 14".into(),
            experiment: "slow triangles up to the highest drive".into(),
            one_sided: true,
            picture: Picture {
                against: Against::Drive,
                caption: "Saturation is one-sided: nothing below a voltage, then ever more.",
            },
            planted: Planted::InPairs,
            equations: r"`y = max(min(x, upper_v), lower_v)`. At rest the same.",
            ..Declaration::at(Place::AmplifierSaturation)
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

    fn stage<'a>(&self, from: &Build<'_, 'a>) -> Option<Box<dyn Stage + 'a>> {
        Some(Box::new(SaturationStage {
            upper_v: from.values[0],
            lower_v: from.values[1],
        }))
    }

    fn values_at(&self, case: &mut PlantedCase) -> Option<Vec<f64>> {
        Some(vec![
            case.stage.overview.drive_max_v - 6.5 * case.strength,
            -case.stage.overview.drive_max_v,
        ])
    }
}
