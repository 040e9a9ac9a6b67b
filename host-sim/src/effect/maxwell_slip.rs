//! Maxwell slip hysteresis: elastic-plastic elements in parallel hold back an otherwise linear piezo.

use super::{Declaration, Effect, Overview, Parameter, Place, Setting, Stage};
use crate::chain::Model;

/// Number of elasto-slide elements.
const ELEMENTS: usize = 8;

/// Linear spring less a sum of elasto-slide elements.
pub struct MaxwellSlip;

struct SlipStage {
    gain_um: f64,
    stiffness_um: Vec<f64>,
    stretch: Vec<f64>,
    last: f64,
    lower_limit_v: f64,
    range_v: f64,
}

impl Stage for SlipStage {
    fn step(&mut self, _k: usize, input: f64) -> f64 {
        let x = (input - self.lower_limit_v) / self.range_v;
        let mut held = 0.0;
        for (i, (stiffness, stretch)) in self.stiffness_um.iter().zip(&mut self.stretch).enumerate() {
            let limit = 0.5 * (i + 1) as f64 / ELEMENTS as f64;
            *stretch = (*stretch + x - self.last).clamp(-limit, limit);
            held += stiffness * *stretch;
        }
        self.last = x;
        self.gain_um * x - held
    }
    fn settle(&mut self, input: f64) -> f64 {
        self.step(0, input)
    }
}

impl Effect for MaxwellSlip {
    fn declaration(&self) -> Declaration {
        Declaration {
            id: "maxwell_slip".into(),
            physics: "Elements that stretch and then slip hold part of the charge back: rate-independent loops.".into(),
            reference: "Goldfarb and Celanovic, IEEE Control Systems 17 (1997) 69-79".into(),
            place: Place::Hysteresis,
            modifies: None,
            experiment: "slow triangles of several heights".into(),
            candidate: false,
            one_sided: false,
        }
    }
    fn parameters(&self, overview: &Overview) -> Vec<Parameter> {
        let step = 0.01 * overview.range_um.max(1e-6);
        let mut out = vec![Parameter::linear("gain_um", "um", -1e6, 1e6, step)];
        out.extend((0..ELEMENTS).map(|i| Parameter::linear(format!("stiffness_{i}_um"), "um", -1e6, 1e6, step)));
        out
    }
    fn starts(&self, overview: &Overview) -> Vec<Vec<f64>> {
        let scale = overview.gain_um_v * overview.drive_range_v();
        let mut values = vec![1.1 * scale];
        values.extend([0.02 * scale; ELEMENTS]);
        vec![values]
    }
    fn ruled_out_because(&self, model: &Model, _values: &[f64]) -> Option<String> {
        super::loops::closed_because(model)
    }
    fn stage<'a>(&self, model: &Model, values: &[f64], _setting: &Setting<'a>) -> Option<Box<dyn Stage + 'a>> {
        Some(Box::new(SlipStage {
            gain_um: values[0],
            stiffness_um: values[1..].to_vec(),
            stretch: vec![0.0; values.len() - 1],
            last: 0.0,
            lower_limit_v: model.drive_min_v,
            range_v: model.drive_max_v - model.drive_min_v,
        }))
    }
    fn fitting_rank(&self) -> usize {
        1
    }
    fn may_leave(&self) -> bool {
        false // nothing would be left to drive the chain
    }
}
