//! Thermal drift: the mechanics warm up after switching on and move without any cause in the drive.

use super::{
    Against, Declaration, Effect, LinearLanes, Overview, Parameter, PassedOn, Picture, Place, Planted, Setting, SimulatedStage, Stage,
};
use crate::chain::Model;

/// Exponential approach to a new position, from the start of every record.
pub struct ThermalDrift;

struct DriftStage {
    amplitude_um: f64,
    per_interval: f64,
}

impl Stage for DriftStage {
    fn step(&mut self, k: usize, input: f64) -> f64 {
        input - self.amplitude_um * (-(k as f64 + 1.0) * self.per_interval).exp_m1()
    }
    fn settle(&mut self, input: f64) -> f64 {
        input
    }
    fn linear_lanes(&self, _lanes: usize) -> Option<Box<dyn LinearLanes>> {
        Some(Box::new(PassedOn))
    }
}

impl Effect for ThermalDrift {
    fn declaration(&self) -> Declaration {
        Declaration {
            id: "thermal_drift".into(),
            physics: "Warming of stage or sensor moves the reading slowly, whatever the drive does.".into(),
            reference: "Fleming and Leang (2014), Ch. 1".into(),
            place: Place::Drift,
            modifies: None,
            experiment: "rest at constant drive for as long as the longest measurement".into(),
            candidate: true,
            one_sided: false,
        }
    }
    fn parameters(&self, overview: &Overview) -> Vec<Parameter> {
        vec![
            Parameter::linear(
                "amplitude_um",
                "um",
                -10.0 * overview.range_um,
                10.0 * overview.range_um,
                1e-3 * overview.range_um.max(1e-6),
            ),
            Parameter::logarithmic("time_constant_s", "s", 0.02 * overview.duration_s, 50.0 * overview.duration_s),
        ]
    }
    fn starts(&self, overview: &Overview) -> Vec<Vec<f64>> {
        [0.1, 0.4, 1.5].iter().map(|share| vec![0.002 * overview.range_um, share * overview.duration_s]).collect()
    }
    fn planted(&self) -> Planted {
        Planted::InPairs
    }
    fn stage<'a>(&self, _model: &Model, values: &[f64], setting: &Setting<'a>) -> Option<Box<dyn Stage + 'a>> {
        Some(Box::new(DriftStage { amplitude_um: values[0], per_interval: setting.dt_s / values[1] }))
    }
    fn values_at(&self, strength: f64, _stage: &SimulatedStage, random: &mut dyn FnMut() -> f64) -> Option<Vec<f64>> {
        Some(vec![-0.03 * strength, 20.0 * (0.8 + 0.4 * random())])
    }
    fn picture(&self) -> Picture {
        Picture { against: Against::Time, caption: "An error that goes its own way in time, whatever the drive does." }
    }
}
