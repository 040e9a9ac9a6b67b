//! Rate-dependent Prandtl-Ishlinskii hysteresis: play operators whose weights change with the speed of the
//! drive.

use super::play_operators::PlayOperators;
use crate::block::Block;
use crate::physics::*;

/// Identifier in files and on the command line.
pub const ID: &str = "rate_dependent_prandtl_ishlinskii";

/// Number of play operators.
const PLAYS: usize = 10;
/// Rate in which the change of a weight is expressed, V/s.
const UNIT_RATE_V_S: f64 = 1e4;

/// Sum of play operators whose weights are straight lines over the rate of the drive.
pub struct RateDependentPrandtlIshlinskii;

#[derive(Clone)]
struct RatePlayStage {
    /// Elements with the weights at rest, and their change by the rate.
    operators: PlayOperators,
    by_rate: Vec<f64>,
    range: DriveRange,
    last_v: f64,
    /// Time over which a step of the drive is its rate, s.
    period_s: f64,
}

impl Stage for RatePlayStage {
    fn step(&mut self, _k: usize, input: f64) -> f64 {
        let rate = (input - self.last_v).abs() / self.period_s / UNIT_RATE_V_S;
        self.last_v = input;
        let slow = self.operators.step(self.range.share(input));
        slow + rate
            * self
                .operators
                .positions()
                .zip(&self.by_rate)
                .map(|(play, weight)| play * weight)
                .sum::<f64>()
    }
    fn settle(&mut self, input: f64) -> f64 {
        self.last_v = input;
        self.step(0, input)
    }
    fn blocks(&self) -> Result<Vec<Block>, &'static str> {
        Ok(vec![Block::RatedPlays {
            plays: self.operators.plays(),
            by_rate: self.by_rate.clone(),
            period_s: self.period_s,
            lower: self.range.lower_v,
            span: self.range.span_v,
        }])
    }
}

impl Loops for RatePlayStage {
    fn bends_v(&self, rising: bool) -> Vec<f64> {
        self.operators
            .bends(rising)
            .map(|x| self.range.at(x))
            .collect()
    }
}

impl RatePlayStage {
    fn new(model: &Model, values: &[f64], setting: &Setting) -> Self {
        let (weights, by_rate) = values.split_at(PLAYS.min(values.len()));
        Self {
            operators: PlayOperators::evenly(weights),
            by_rate: by_rate.to_vec(),
            range: model.drive_range(),
            last_v: model.drive_min_v,
            period_s: setting.dt_s * setting.substeps as f64,
        }
    }
}

impl Effect for RateDependentPrandtlIshlinskii {
    fn declaration(&self) -> Declaration {
        Declaration {
            id: ID.into(),
            physics: "Many small backlash elements in parallel that give more or less the faster the drive moves.".into(),
            reference: "thesis Ch. 2, 3.1.3; Ang, Khosla and Riviere, IEEE/ASME Trans. Mechatronics 12 (2007) 134-142".into(),
            experiment: "the same triangles at slopes from 100 to 35000 V/s".into(),
            tried_for_loops: LoopsTried::Never,
            equations: r"With `X = (x - drive_min_v) / (drive_max_v - drive_min_v)` and `v = |x[k] - x[k-1]| / T / (10^4 V/s)`, `T` that of whole periods: `y = sum_i (weight_i_um + rate_weight_i_um v) p_i`, `i = 0..9`, each `p_i = min(max(p_i, X - r_i), X + r_i)` from 0 on, `r_i = 0.05 i`. At rest the plays follow `X` once from 0, with `v = 0`.",
            ..Declaration::of_loops()
        }
    }

    fn parameters(&self, overview: &Overview) -> Vec<Parameter> {
        let step = 0.01 * overview.range_um.max(1e-6);
        let weight =
            (0..PLAYS).map(|i| Parameter::linear(format!("weight_{i}_um"), "um", -1e6, 1e6, step));
        let by_rate = (0..PLAYS).map(|i| {
            Parameter::linear(
                format!("rate_weight_{i}_um"),
                "um/(10^4 V/s)",
                -1e6,
                1e6,
                step,
            )
        });
        weight.chain(by_rate).collect()
    }

    fn starts(&self, overview: &Overview) -> Vec<Vec<f64>> {
        let scale = overview.gain_um_v * overview.drive_range_v();
        let weight = |i: usize| {
            if i == 0 {
                0.8 * scale
            } else {
                0.2 * scale / (PLAYS - 1) as f64
            }
        };
        vec![(0..PLAYS).map(weight).chain([0.0; PLAYS]).collect()]
    }

    fn loops(&self, from: &Build) -> Option<Box<dyn Loops>> {
        Some(Box::new(RatePlayStage::new(
            from.model,
            from.values,
            from.setting,
        )))
    }
}
