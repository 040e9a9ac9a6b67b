//! Prandtl-Ishlinskii hysteresis: a weighted sum of play operators, and its modified form with dead zones
//! behind.

use super::play_operators::PlayOperators;
use crate::block::{Block, Play};
use crate::physics::*;

/// Number of play operators.
const PLAYS: usize = 10;
/// Number of one-sided dead zones of the modified model.
const DEAD_ZONES: usize = 4;

/// Sum of play operators, optionally followed by one-sided dead zones (Kuhnen's modified model).
pub struct PrandtlIshlinskii {
    /// The modified model: dead zones make the loops asymmetric.
    pub one_sided_dead_zones: bool,
}

/// Plays over the drive, with dead zones behind their sum.
#[derive(Clone)]
pub(super) struct PlayStage {
    operators: PlayOperators,
    /// Each with its threshold, um, and its weight.
    dead_zones: Vec<(f64, f64)>,
    range: DriveRange,
}

impl PlayStage {
    pub(super) fn of_plays(model: &Model, operators: PlayOperators) -> Self {
        Self {
            operators,
            dead_zones: Vec::new(),
            range: model.drive_range(),
        }
    }

    fn new(model: &Model, values: &[f64]) -> Self {
        let (weights, rest) = values.split_at(PLAYS.min(values.len()));
        let (span_um, zones) = rest.split_last().unwrap_or((&0.0, &[]));
        let threshold = |i: usize| span_um * (i + 1) as f64 / (DEAD_ZONES + 1) as f64;
        Self {
            dead_zones: (0..).map(threshold).zip(zones.iter().copied()).collect(),
            ..Self::of_plays(model, PlayOperators::evenly(weights))
        }
    }
}

impl Stage for PlayStage {
    fn step(&mut self, _k: usize, input: f64) -> f64 {
        let sum = self.operators.step(self.range.share(input));
        let zone = |(threshold, weight): &(f64, f64)| weight * (sum - threshold).max(0.0);
        self.dead_zones
            .iter()
            .fold(sum, |output, each| output + zone(each))
    }
    fn blocks(&self) -> Result<Vec<Block>, &'static str> {
        let zone = |&(threshold, weight): &(f64, f64)| Play { threshold, weight };
        Ok(vec![Block::Plays {
            plays: self.operators.plays(),
            zones: self.dead_zones.iter().map(zone).collect(),
            lower: self.range.lower_v,
            span: self.range.span_v,
        }])
    }
}

impl Loops for PlayStage {
    fn bends_v(&self, rising: bool) -> Vec<f64> {
        // Where a dead zone ends the search finds by itself.
        self.operators
            .bends(rising)
            .map(|x| self.range.at(x))
            .collect()
    }
}

impl Effect for PrandtlIshlinskii {
    fn declaration(&self) -> Declaration {
        let (id, reference) = if self.one_sided_dead_zones {
            (
                "modified_prandtl_ishlinskii",
                "Kuhnen, European Journal of Control 9 (2003) 407-418",
            )
        } else {
            (
                "prandtl_ishlinskii",
                "Brokate and Sprekels, Hysteresis and Phase Transitions (1996)",
            )
        };
        Declaration {
            id: id.into(),
            physics: "Many small backlash elements in parallel: loops that depend only on how far the drive came back.".into(),
            reference: reference.into(),
            experiment: "slow triangles of several heights".into(),
            equations: r"With `X = (x - drive_min_v) / (drive_max_v - drive_min_v)`: `s = sum_i weight_i_um p_i`, `i = 0..9`, each `p_i = min(max(p_i, X - r_i), X + r_i)` from 0 on, `r_i = 0.05 i`. `y = s`; for the modified model `y = s + sum_j dead_zone_j max(s - d_j, 0)`, `d_j = span_um (j + 1) / 5`, `j = 0..3`. At rest the plays follow `X` once from 0.",
            ..Declaration::of_loops()
        }
    }

    fn parameters(&self, overview: &Overview) -> Vec<Parameter> {
        let range = overview.range_um.max(1e-6);
        let mut out: Vec<_> = (0..PLAYS)
            .map(|i| Parameter::linear(format!("weight_{i}_um"), "um", -1e6, 1e6, 0.01 * range))
            .collect();
        if self.one_sided_dead_zones {
            out.extend(
                (0..DEAD_ZONES)
                    .map(|i| Parameter::linear(format!("dead_zone_{i}"), "1", -10.0, 10.0, 0.01)),
            );
            out.push(Parameter::linear("span_um", "um", 0.0, 1e6, 0.01 * range).fixed());
        }
        out
    }

    fn starts(&self, overview: &Overview) -> Vec<Vec<f64>> {
        let scale = overview.gain_um_v * overview.drive_range_v();
        let mut values: Vec<_> = (0..PLAYS)
            .map(|i| {
                if i == 0 {
                    0.8 * scale
                } else {
                    0.2 * scale / (PLAYS - 1) as f64
                }
            })
            .collect();
        if self.one_sided_dead_zones {
            values.extend([0.0; DEAD_ZONES]);
            values.push(scale);
        }
        vec![values]
    }

    fn loops(&self, from: &Build) -> Option<Box<dyn Loops>> {
        Some(Box::new(PlayStage::new(from.model, from.values)))
    }
}
