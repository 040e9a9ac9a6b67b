//! Maxwell slip hysteresis: elastic-plastic elements in parallel hold back an otherwise linear piezo.

use crate::block::{Block, Play};
use crate::physics::*;

/// Number of elasto-slide elements.
const ELEMENTS: usize = 8;

/// Linear spring less a sum of elasto-slide elements.
pub struct MaxwellSlip;

/// Stretch at which element `i` slips, in units of the drive range.
fn limit(i: usize) -> f64 {
    0.5 * (i + 1) as f64 / ELEMENTS as f64
}

#[derive(Clone)]
struct SlipStage {
    gain_um: f64,
    stiffness_um: Vec<f64>,
    stretch: Vec<f64>,
    last: f64,
    lower_limit_v: f64,
    range_v: f64,
}

impl SlipStage {
    fn new(model: &Model, values: &[f64]) -> Self {
        Self {
            gain_um: values[0],
            stiffness_um: values[1..].to_vec(),
            stretch: vec![0.0; values.len() - 1],
            last: 0.0,
            lower_limit_v: model.drive_min_v,
            range_v: model.drive_max_v - model.drive_min_v,
        }
    }
}

impl Stage for SlipStage {
    fn step(&mut self, _k: usize, input: f64) -> f64 {
        let x = (input - self.lower_limit_v) / self.range_v;
        let mut held = 0.0;
        for (i, (stiffness, stretch)) in self.stiffness_um.iter().zip(&mut self.stretch).enumerate()
        {
            *stretch = (*stretch + x - self.last).clamp(-limit(i), limit(i));
            held += stiffness * *stretch;
        }
        self.last = x;
        self.gain_um * x - held
    }
    fn blocks(&self) -> Option<Vec<Block>> {
        let element = |(i, weight): (usize, &f64)| Play {
            threshold: 0.5 * (i + 1) as f64 / ELEMENTS as f64,
            weight: *weight,
        };
        let elements = self.stiffness_um.iter().enumerate().map(element).collect();
        Some(vec![Block::Slip {
            gain: self.gain_um,
            elements,
            lower: self.lower_limit_v,
            span: self.range_v,
        }])
    }
}

impl Loops for SlipStage {
    fn bends_v(&self, rising: bool) -> Vec<f64> {
        // Where an element begins to slip.
        let left = |(i, stretch): (usize, &f64)| {
            if rising {
                limit(i) - stretch
            } else {
                -limit(i) - stretch
            }
        };
        self.stretch
            .iter()
            .enumerate()
            .map(|element| self.lower_limit_v + self.range_v * (self.last + left(element)))
            .collect()
    }
}

impl Effect for MaxwellSlip {
    fn declaration(&self) -> Declaration {
        Declaration {
            id: "maxwell_slip".into(),
            physics: "Elements that stretch and then slip hold part of the charge back: rate-independent loops.".into(),
            reference: "thesis Ch. 2, Eq. 3; Goldfarb and Celanovic, IEEE Control Systems 17 (1997) 69-79".into(),
            experiment: "slow triangles of several heights".into(),
            equations: r"With `X = (x - drive_min_v) / (drive_max_v - drive_min_v)`: `y = gain_um X - sum_i stiffness_i_um e_i`, `i = 0..7`, each `e_i = min(max(e_i + X[k] - X[k-1], -l_i), l_i)` from 0 on, `l_i = (i + 1) / 16`.
At rest the elements follow `X` once from 0.",
            ..Declaration::of_loops()
        }
    }

    fn parameters(&self, overview: &Overview) -> Vec<Parameter> {
        let step = 0.01 * overview.range_um.max(1e-6);
        let mut out = vec![Parameter::linear("gain_um", "um", -1e6, 1e6, step)];
        out.extend(
            (0..ELEMENTS)
                .map(|i| Parameter::linear(format!("stiffness_{i}_um"), "um", -1e6, 1e6, step)),
        );
        out
    }

    fn starts(&self, overview: &Overview) -> Vec<Vec<f64>> {
        let scale = overview.gain_um_v * overview.drive_range_v();
        let mut values = vec![1.1 * scale];
        values.extend([0.02 * scale; ELEMENTS]);
        vec![values]
    }

    fn loops(&self, model: &Model, values: &[f64], _setting: &Setting) -> Option<Box<dyn Loops>> {
        Some(Box::new(SlipStage::new(model, values)))
    }
}
