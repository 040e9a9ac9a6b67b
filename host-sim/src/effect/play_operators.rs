//! Play operators beside the polynomial surfaces of the hysteresis: loops with kinks, which polynomials only
//! approach slowly.
//!
//! Their part of `G(x, z)` depends on `x - z` alone and is straight between kinks; the surfaces have the
//! smooth rest. The hysteresis stage adds them. They are no candidate: a structure of loops that was
//! described too coarsely is not a missing effect.
//!
//! Their thresholds stay where they are put, evenly at first: their weights enter linearly. Loops of few
//! elements are met by no grid, whose nearest thresholds leave a step at every turn; for those thresholds are
//! set free (`finer_plays` of the library).

use crate::block::Play;
use crate::physics::*;
use std::sync::Arc;

/// Identifier in files and on the command line.
pub const ID: &str = id::PLAY_OPERATORS;

/// Elements that are carried side by side, and as many sums: one alone would wait for itself at every
/// element.
const SIDE_BY_SIDE: usize = 4;

/// Some elements; those that fill it up weigh nothing.
#[derive(Clone, Copy, Debug, Default)]
struct Elements {
    thresholds: [f64; SIDE_BY_SIDE],
    weights: [f64; SIDE_BY_SIDE],
    plays: [f64; SIDE_BY_SIDE],
}

/// A weighted sum of play operators (backlash elements), each with its threshold in units of the drive range.
#[derive(Clone, Debug)]
pub(crate) struct PlayOperators {
    elements: Vec<Elements>,
    count: usize,
}

impl PlayOperators {
    /// Virgin operators.
    pub(crate) fn new(thresholds_and_weights: &[(f64, f64)]) -> Self {
        let some = |given: &[(f64, f64)]| {
            let mut out = Elements::default();
            given
                .iter()
                .enumerate()
                .for_each(|(i, (threshold, weight))| {
                    (out.thresholds[i], out.weights[i]) = (*threshold, *weight)
                });
            out
        };
        Self {
            elements: thresholds_and_weights
                .chunks(SIDE_BY_SIDE)
                .map(some)
                .collect(),
            count: thresholds_and_weights.len(),
        }
    }

    /// Virgin operators of these weights, with thresholds evenly from zero towards half the range.
    pub(super) fn evenly(weights: &[f64]) -> Self {
        let threshold = |i: usize| 0.5 * i as f64 / weights.len() as f64;
        let each = (0..).map(threshold).zip(weights.iter().copied());
        Self::new(&each.collect::<Vec<_>>())
    }

    /// The operators that `model` has beside its surfaces.
    pub(super) fn from_model(model: &Model) -> Option<Self> {
        let values = model.values(ID)?;
        Some(Self::new(
            &values
                .chunks_exact(2)
                .map(|pair| (pair[1], pair[0]))
                .collect::<Vec<_>>(),
        ))
    }

    /// Follows an input and returns the weighted sum.
    #[inline]
    pub(crate) fn step(&mut self, x: f64) -> f64 {
        let mut sums = [0.0; SIDE_BY_SIDE];
        for Elements {
            thresholds,
            weights,
            plays,
        } in &mut self.elements
        {
            for i in 0..SIDE_BY_SIDE {
                // Plain comparisons: of two numbers each is one instruction, for several elements at once.
                let (lower, upper) = (x - thresholds[i], x + thresholds[i]);
                let play = if plays[i] < lower { lower } else { plays[i] };
                plays[i] = if play > upper { upper } else { play };
                sums[i] += weights[i] * plays[i];
            }
        }
        (sums[0] + sums[2]) + (sums[1] + sums[3])
    }

    /// Follows inputs and adds the weighted sum at each.
    pub(super) fn add_to(&mut self, outputs: &mut [f64], inputs: &[f64]) {
        outputs
            .iter_mut()
            .zip(inputs)
            .for_each(|(out, x)| *out += self.step(*x));
    }

    /// Of each element what `of` takes of its threshold, its weight and where it stands.
    fn each(&self, of: impl Fn(f64, f64, f64) -> f64) -> impl Iterator<Item = f64> {
        let all = self.elements.iter().flat_map(|e| {
            std::array::from_fn::<_, SIDE_BY_SIDE, _>(|i| {
                (e.thresholds[i], e.weights[i], e.plays[i])
            })
        });
        all.take(self.count)
            .map(move |(threshold, weight, play)| of(threshold, weight, play))
    }

    /// The elements.
    pub(super) fn plays(&self) -> Vec<Play> {
        let play = |e: &Elements| -> [Play; SIDE_BY_SIDE] {
            std::array::from_fn(|i| Play {
                threshold: e.thresholds[i],
                weight: e.weights[i],
            })
        };
        self.elements
            .iter()
            .flat_map(play)
            .take(self.count)
            .collect()
    }

    /// Where each element stands: what a unit of its weight gives.
    pub(super) fn positions(&self) -> impl Iterator<Item = f64> {
        self.each(|_, _, play| play)
    }

    /// Inputs at which an element begins to move, on the way up or down.
    pub(super) fn bends(&self, rising: bool) -> impl Iterator<Item = f64> {
        self.each(move |threshold, _, play| {
            if rising {
                play + threshold
            } else {
                play - threshold
            }
        })
    }

    /// What the first rise to `x` gives.
    pub(super) fn initial_ascending_curve(&self, x: f64) -> f64 {
        self.each(|threshold, weight, _| weight * rise(x, threshold))
            .sum()
    }

    /// [`Self::initial_ascending_curve`] for a unit weight of each element.
    pub(super) fn initial_ascending_curves(&self, x: f64) -> impl Iterator<Item = f64> {
        self.each(move |threshold, _, _| rise(x, threshold))
    }
}

/// Where an element stands once the input has come from rest to `x`.
fn rise(x: f64, threshold: f64) -> f64 {
    (x - threshold).max(0.0)
}

/// Half of the width of the loop at which element `i` of so many begins to move, in units of the drive range:
/// a threshold of zero would be a plain gain, and one of half the range never closes a loop.
fn threshold(i: usize, elements: usize) -> f64 {
    0.5 * (i + 1) as f64 / (elements + 1) as f64
}

/// Play operators in parallel with the surfaces.
pub struct PlayOperatorsBeside {
    /// How many.
    pub elements: usize,
}

impl Default for PlayOperatorsBeside {
    fn default() -> Self {
        Self { elements: 19 }
    }
}

impl Effect for PlayOperatorsBeside {
    fn declaration(&self) -> Declaration {
        Declaration {
            id: ID.into(),
            physics: "Backlash elements beside the smooth loops: kinks that depend only on how far the drive came back.".into(),
            reference: "Brokate and Sprekels, Hysteresis and Phase Transitions (1996)".into(),
            modifies: Some(id::HYSTERESIS),
            experiment: "slow triangles of several heights".into(),
            fitting_rank: 2,
            equations: r"Beside `hysteresis`, with its `X`: `y = y + sum weight_i_um p_i`, where each play follows `p_i = min(max(p_i, X - threshold_i), X + threshold_i)` from 0 on. In the `F(M_1)` of `rate_dependence` each
counts `weight_i_um max(M_1 - threshold_i, 0)`.",
            ..Declaration::on_request(Place::Hysteresis)
        }
    }

    fn parameters(&self, overview: &Overview) -> Vec<Parameter> {
        let step = 0.01 * overview.range_um.max(1e-6);
        let element = |i: usize| {
            [
                Parameter::linear(format!("weight_{}_um", i + 1), "um", -1e6, 1e6, step),
                Parameter::linear(format!("threshold_{}", i + 1), "1", 0.0, 1.0, 1e-3).fixed(),
            ]
        };
        (0..self.elements).flat_map(element).collect()
    }

    fn starts(&self, _overview: &Overview) -> Vec<Vec<f64>> {
        vec![
            (0..self.elements)
                .flat_map(|i| [0.0, threshold(i, self.elements)])
                .collect(),
        ]
    }

    fn with_parameters(&self, count: usize) -> Option<Arc<dyn Effect>> {
        (count > 0 && count.is_multiple_of(2)).then(|| {
            Arc::new(Self {
                elements: count / 2,
            }) as Arc<dyn Effect>
        })
    }
}
