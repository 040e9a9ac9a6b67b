//! The major loop as two polynomials, one for a rising and one for a falling drive: no memory, so no minor
//! loops.

use crate::block::Block;
use crate::physics::*;

/// Identifier in files and on the command line.
pub const ID: &str = "polynomial_loop";

/// Terms of the middle of the loop, and of half its opening.
const MIDDLE: usize = 3;
const OPENING: usize = 2;

/// Two branches over the whole range.
pub struct PolynomialLoop;

#[derive(Clone)]
struct PolynomialStage {
    middle_um: [f64; MIDDLE],
    opening_um: [f64; OPENING],
    range: DriveRange,
    last_v: f64,
    rising: bool,
}

impl PolynomialStage {
    fn new(model: &Model, values: &[f64]) -> Self {
        let value = |i: usize| values.get(i).copied().unwrap_or(0.0);
        Self {
            middle_um: std::array::from_fn(value),
            opening_um: std::array::from_fn(|i| value(MIDDLE + i)),
            range: model.drive_range(),
            last_v: model.drive_min_v,
            rising: true,
        }
    }
}

impl Stage for PolynomialStage {
    fn step(&mut self, _k: usize, input: f64) -> f64 {
        if input != self.last_v {
            self.rising = input > self.last_v;
            self.last_v = input;
        }
        let x = self.range.share(input);
        let polynomial = |c: &[f64]| c.iter().rev().fold(0.0, |sum, c| sum * x + c);
        // Half of the opening vanishes at both ends, where the branches meet.
        let half = x * (1.0 - x) * polynomial(&self.opening_um);
        x * polynomial(&self.middle_um) + if self.rising { -half } else { half }
    }
    fn blocks(&self) -> Result<Vec<Block>, &'static str> {
        Ok(vec![Block::Branches {
            middle: self.middle_um.to_vec(),
            opening: self.opening_um.to_vec(),
            lower: self.range.lower_v,
            span: self.range.span_v,
        }])
    }
}

impl Loops for PolynomialStage {
    fn bends_v(&self, rising: bool) -> Vec<f64> {
        // A turn jumps to the other branch.
        let ahead = if rising { f64::EPSILON } else { -f64::EPSILON };
        if rising == self.rising {
            Vec::new()
        } else {
            vec![self.last_v + ahead * self.range.span_v]
        }
    }
}

impl Effect for PolynomialLoop {
    fn declaration(&self) -> Declaration {
        Declaration {
            id: ID.into(),
            physics:
                "One curve for a rising drive and one for a falling one: the major loop alone."
                    .into(),
            reference: "thesis Ch. 2, 3.1.1".into(),
            experiment: "slow triangles over the whole range".into(),
            tried_for_loops: LoopsTried::Never,
            equations: r"With `X = (x - drive_min_v) / (drive_max_v - drive_min_v)`: `y = X (middle_0_um + middle_1_um X + middle_2_um X^2) - s X (1 - X) (opening_0_um + opening_1_um X)`, `s = 1` after a rise and `-1` after a fall of `x`. At first `s = 1`.",
            ..Declaration::of_loops()
        }
    }

    fn parameters(&self, overview: &Overview) -> Vec<Parameter> {
        let step = 0.01 * overview.range_um.max(1e-6);
        let of = |name: &str, i: usize| {
            Parameter::linear(format!("{name}_{i}_um"), "um", -1e6, 1e6, step)
        };
        (0..MIDDLE)
            .map(|i| of("middle", i))
            .chain((0..OPENING).map(|i| of("opening", i)))
            .collect()
    }

    fn starts(&self, overview: &Overview) -> Vec<Vec<f64>> {
        let scale = overview.gain_um_v * overview.drive_range_v();
        vec![vec![scale, 0.0, 0.0, 0.2 * scale, 0.0]]
    }

    fn loops(&self, from: &Build) -> Option<Box<dyn Loops>> {
        Some(Box::new(PolynomialStage::new(from.model, from.values)))
    }
}
