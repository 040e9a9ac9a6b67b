//! A second structural mode that takes a share of the motion.

use super::{Declaration, Effect, Overview, Parameter, Place, Setting, Stage, vibration};
use crate::chain::Model;

/// A mode beside the first one; the vibration stage takes it in.
pub struct SecondMode;

impl Effect for SecondMode {
    fn declaration(&self) -> Declaration {
        Declaration {
            id: "second_mode".into(),
            physics: "Part of the motion goes through another resonance of the structure, usually higher and lightly damped.".into(),
            reference: "Preumont, Vibration Control of Active Structures (2011), modal sum".into(),
            place: Place::Vibration,
            modifies: Some("vibration"),
            experiment: "a multisine with lines close together up to a third of the sampling rate".into(),
            candidate: true,
            one_sided: false,
        }
    }
    fn parameters(&self, overview: &Overview) -> Vec<Parameter> {
        let highest = std::f64::consts::PI * overview.sample_rate_max_hz;
        vec![
            Parameter::linear("share", "1", -0.9, 0.9, 0.01),
            Parameter::logarithmic("natural_frequency_rad_s", "rad/s", 10.0, highest),
            Parameter::logarithmic("damping_ratio", "1", 5e-4, 2.0),
        ]
    }
    fn starts(&self, overview: &Overview) -> Vec<Vec<f64>> {
        let highest = std::f64::consts::PI * overview.sample_rate_max_hz;
        let mut out = Vec::new();
        let count = 36;
        for i in 0..count {
            // Steps of 7 %, a little wider than the width of a mode with the damping ratio that goes with them.
            let frequency = 0.9 * highest * 0.93_f64.powi(i);
            out.push(vec![0.02, frequency, 0.03]);
        }
        out
    }
    fn stage<'a>(&self, model: &Model, _values: &[f64], setting: &Setting<'a>) -> Option<Box<dyn Stage + 'a>> {
        match model.effect("vibration") {
            Some(_) => None,
            None => Some(Box::new(vibration::VibrationStage::of(model, setting.dt_s))),
        }
    }
}
