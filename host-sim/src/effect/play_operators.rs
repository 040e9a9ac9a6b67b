//! Play operators beside the polynomial surfaces of the hysteresis: loops with kinks, which polynomials only approach slowly.
//!
//! Their part of `G(x, z)` depends on `x - z` alone and is straight between kinks; the surfaces have the smooth rest. The hysteresis
//! stage adds them. They are no candidate: a structure of loops that was described too coarsely is not a missing effect.

use super::{Declaration, Effect, Overview, Parameter, Place, Setting, Stage};
use crate::chain::Model;

/// Identifier in files and on the command line.
pub const ID: &str = "play_operators";

/// Thresholds in the range of the drive.
const THRESHOLDS: usize = 20;

/// A weighted sum of play operators (backlash elements), each with its threshold in units of the drive range.
#[derive(Clone, Debug)]
pub(super) struct PlayOperators {
    thresholds: Vec<f64>,
    weights: Vec<f64>,
    plays: Vec<f64>,
}

/// Sums that run side by side: one alone would wait for itself at every element.
const SUMS: usize = 4;

impl PlayOperators {
    /// Virgin operators.
    pub(super) fn new(thresholds_and_weights: Vec<(f64, f64)>) -> Self {
        let (thresholds, weights): (Vec<f64>, Vec<f64>) = thresholds_and_weights.into_iter().unzip();
        Self { plays: vec![0.0; thresholds.len()], thresholds, weights }
    }

    /// The operators that `model` has beside its surfaces.
    pub(super) fn of(model: &Model) -> Option<Self> {
        let weights = model.values(ID)?;
        Some(Self::new(weights.iter().enumerate().map(|(i, w)| (threshold(i), *w)).collect()))
    }

    /// Follows an input and returns the weighted sum.
    pub(super) fn step(&mut self, x: f64) -> f64 {
        // Plain comparisons: of two numbers each is one instruction, for several elements at once.
        let followed = |play: f64, threshold: f64| {
            let (lower, upper) = (x - threshold, x + threshold);
            let play = if play < lower { lower } else { play };
            if play > upper { upper } else { play }
        };
        let mut sums = [0.0; SUMS];
        let mut plays = self.plays.chunks_exact_mut(SUMS);
        let (mut thresholds, mut weights) = (self.thresholds.chunks_exact(SUMS), self.weights.chunks_exact(SUMS));
        for ((plays, thresholds), weights) in (&mut plays).zip(&mut thresholds).zip(&mut weights) {
            for i in 0..SUMS {
                plays[i] = followed(plays[i], thresholds[i]);
                sums[i] += weights[i] * plays[i];
            }
        }
        let rest = plays.into_remainder().iter_mut().zip(thresholds.remainder()).zip(weights.remainder());
        for (((play, threshold), weight), sum) in rest.zip(&mut sums) {
            *play = followed(*play, *threshold);
            *sum += weight * *play;
        }
        (sums[0] + sums[2]) + (sums[1] + sums[3])
    }

    /// Where each element stands: what a unit of its weight gives.
    pub(super) fn positions(&self) -> &[f64] {
        &self.plays
    }

    /// What the first rise to `x` gives.
    pub(super) fn initial_ascending_curve(&self, x: f64) -> f64 {
        self.initial_ascending_curves(x).zip(&self.weights).map(|(rise, weight)| weight * rise).sum()
    }

    /// The same for a unit weight of each element.
    pub(super) fn initial_ascending_curves(&self, x: f64) -> impl Iterator<Item = f64> {
        self.thresholds.iter().map(move |threshold| (x - threshold).max(0.0))
    }
}

/// Half of the width of the loop at which element `i` begins to move: a threshold of zero would be a plain gain, and one of half the range never closes a loop.
fn threshold(i: usize) -> f64 {
    0.5 * (i + 1) as f64 / THRESHOLDS as f64
}

/// Play operators in parallel with the surfaces.
pub struct PlayOperatorsBeside;

impl Effect for PlayOperatorsBeside {
    fn declaration(&self) -> Declaration {
        Declaration {
            id: ID.into(),
            physics: "Backlash elements beside the smooth loops: kinks that depend only on how far the drive came back.".into(),
            reference: "Brokate and Sprekels, Hysteresis and Phase Transitions (1996)".into(),
            place: Place::Hysteresis,
            modifies: Some(super::hysteresis::ID),
            experiment: "slow triangles of several heights".into(),
            candidate: false,
            one_sided: false,
        }
    }
    fn parameters(&self, overview: &Overview) -> Vec<Parameter> {
        let step = 0.01 * overview.range_um.max(1e-6);
        (1..THRESHOLDS).map(|i| Parameter::linear(format!("weight_{i}_um"), "um", -1e6, 1e6, step)).collect()
    }
    fn starts(&self, _overview: &Overview) -> Vec<Vec<f64>> {
        vec![vec![0.0; THRESHOLDS - 1]]
    }
    fn stage<'a>(&self, _model: &Model, _values: &[f64], _setting: &Setting<'a>) -> Option<Box<dyn Stage + 'a>> {
        None
    }
    fn fitting_rank(&self) -> usize {
        2
    }
}
