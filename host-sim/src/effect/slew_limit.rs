//! Slew limit of the amplifier: its current charges the piezo no faster than so many volts per second.

use super::{Against, Declaration, Effect, Overview, Parameter, Picture, Place, Setting, SimulatedStage, Stage};
use crate::chain::Model;

/// Limit of the slope of the piezo voltage.
pub struct SlewLimit;

struct SlewStage {
    step_max_v: f64,
    voltage_v: f64,
}

impl Stage for SlewStage {
    fn step(&mut self, _k: usize, input: f64) -> f64 {
        let away = input - self.voltage_v;
        let size = away.abs();
        let start = self.voltage_v;
        if size <= self.step_max_v {
            self.voltage_v = input;
            // Mean over the interval of a ramp that arrives after the fraction size / step_max.
            let ramp = if self.step_max_v > 0.0 { size / self.step_max_v } else { 1.0 };
            input - away * 0.5 * ramp
        } else {
            self.voltage_v += away.signum() * self.step_max_v;
            0.5 * (start + self.voltage_v)
        }
    }
    fn settle(&mut self, input: f64) -> f64 {
        self.voltage_v = input;
        input
    }
}

impl Effect for SlewLimit {
    fn declaration(&self) -> Declaration {
        Declaration {
            id: "slew_limit".into(),
            physics: "The amplifier's current limit clamps how fast the voltage on the piezo can change.".into(),
            reference: "Fleming and Leang (2014), Ch. 14".into(),
            place: Place::AmplifierSlew,
            modifies: None,
            experiment: "large sines of rising frequency: straight flanks above one slope".into(),
            candidate: true,
            one_sided: true,
        }
    }
    fn parameters(&self, overview: &Overview) -> Vec<Parameter> {
        vec![Parameter::logarithmic("slew_v_s", "V/s", 1.0, 20.0 * overview.slope_max_v_s.max(1.0))]
    }
    fn starts(&self, overview: &Overview) -> Vec<Vec<f64>> {
        [0.9, 0.7, 0.5, 0.35, 0.22, 0.12, 0.06, 0.03].iter().map(|share| vec![share * overview.slope_max_v_s.max(1.0)]).collect()
    }
    fn stage<'a>(&self, model: &Model, values: &[f64], setting: &Setting<'a>) -> Option<Box<dyn Stage + 'a>> {
        Some(Box::new(SlewStage { step_max_v: values[0] * setting.dt_s, voltage_v: model.drive_min_v }))
    }
    fn substeps(&self, _model: &Model, dt_s: f64) -> usize {
        super::substeps_inside_period(dt_s)
    }
    fn values_at(&self, strength: f64, _stage: &SimulatedStage, _random: &mut dyn FnMut() -> f64) -> Option<Vec<f64>> {
        Some(vec![8500.0 / strength.max(0.01)])
    }
    fn picture(&self) -> Picture {
        Picture { against: Against::Rate, caption: "An error that grows with the rate of the drive and changes sign with it." }
    }
}
