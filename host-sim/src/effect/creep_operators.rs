//! Creep operators: creep whose equilibrium has hysteresis.
//!
//! Each elementary operator follows the displacement `x` with its time constant as long as `x` is farther
//! from it than its threshold: `tau z' = x - z - r` above, `x - z + r` below, and stands still between. Its
//! equilibrium is the play operator of the same threshold, and a sum over thresholds and time constants is
//! the nonlinear creep of log(t) type. A threshold of zero gives the linear terms of [`super::creep`].

use crate::block::{Block, CreepingPlay};
use crate::physics::*;
use std::sync::Arc;

/// Identifier in files and on the command line.
pub const ID: &str = "creep_operators";

/// Thresholds, as shares of the range.
const THRESHOLDS: [f64; 3] = [0.02, 0.1, 0.25];
/// Time constants of each threshold.
const TIME_CONSTANTS: usize = 4;

/// Sum of elementary creep operators behind the vibration.
pub struct CreepOperators {
    /// How many operators.
    pub operators: usize,
}

impl Default for CreepOperators {
    fn default() -> Self {
        Self {
            operators: THRESHOLDS.len() * TIME_CONSTANTS,
        }
    }
}

#[derive(Clone, Copy)]
struct Operator {
    share: f64,
    threshold_um: f64,
    decay: f64,
    from_start: f64,
    from_end: f64,
    state_um: f64,
}

impl Operator {
    fn new(values: &[f64], dt_s: f64) -> Self {
        let (share, threshold_um, tau_s) = (values[0], values[1].max(0.0), values[2].max(1e-9));
        let decay = (-dt_s / tau_s).exp();
        let mean = -(-dt_s / tau_s).exp_m1() * tau_s / dt_s;
        Self {
            share,
            threshold_um,
            decay,
            from_start: mean - decay,
            from_end: 1.0 - mean,
            state_um: 0.0,
        }
    }

    /// One interval in which the displacement runs straight: exact where it stays on one side of the
    /// threshold.
    #[inline]
    fn step(&mut self, start_um: f64, end_um: f64) -> f64 {
        let offset_um = match 0.5 * (start_um + end_um) - self.state_um {
            far if far > self.threshold_um => self.threshold_um,
            far if far < -self.threshold_um => -self.threshold_um,
            _ => return self.share * self.state_um,
        };
        let followed_um =
            self.from_start * (start_um - offset_um) + self.from_end * (end_um - offset_um);
        self.state_um = self.decay * self.state_um + followed_um;
        self.share * self.state_um
    }
}

struct OperatorStage {
    operators: Vec<Operator>,
    input_um: f64,
}

impl Stage for OperatorStage {
    fn step(&mut self, _k: usize, input: f64) -> f64 {
        let before_um = std::mem::replace(&mut self.input_um, input);
        input
            + self
                .operators
                .iter_mut()
                .map(|operator| operator.step(before_um, input))
                .sum::<f64>()
    }
    fn blocks(&self) -> Result<Vec<Block>, &'static str> {
        let play = |of: &Operator| CreepingPlay {
            share: of.share,
            threshold: of.threshold_um,
            decay: of.decay,
            adds: [of.from_start, of.from_end],
        };
        let plays = self.operators.iter().map(play).collect();
        Ok(vec![Block::CreepingPlays(plays)])
    }
    fn settle(&mut self, input: f64) -> f64 {
        self.input_um = input;
        let mut output = input;
        for operator in &mut self.operators {
            operator.state_um = operator
                .state_um
                .clamp(input - operator.threshold_um, input + operator.threshold_um);
            output += operator.share * operator.state_um;
        }
        output
    }
}

impl Effect for CreepOperators {
    fn declaration(&self) -> Declaration {
        Declaration {
            id: ID.into(),
            physics: "Creep that ends elsewhere on the way up than on the way down: domains creep only where they are pushed hard enough."
            .into(),
            reference: "thesis Ch. 2, 3.2.1; Krejci and Kuhnen, IEE Proc. Control Theory Appl. 148 (2001) 185-192".into(),
            experiment: "steps up and down to the same displacement, each held for ten seconds or more".into(),
            fitting_rank: 4,
            equations: r"`y = x + sum share_i z_i`. With `r = threshold_i_um`: `time_constant_i_s z_i' = x - z_i - r` while `x - z_i > r`, `time_constant_i_s z_i' = x - z_i + r` while `x - z_i < -r`, and `z_i' = 0` between.

With `a = exp(-T / tau)`, `m = (1 - a) tau / T` and the middle `(x[k-1] + x[k]) / 2` of an interval, which decides on the side: `z[k] = a z[k-1] + (m - a) (x[k-1] - o) + (1 - m) (x[k] - o)`, `o = r` above, `o = -r` below; `z[k] = z[k-1]` between. At rest each `z_i = min(max(z_i, x - r), x + r)` from 0.
Behind modes it goes once a period, by the values at the ends of periods.",
            goes_by_ends: true,
            ..Declaration::on_request(Place::Creep)
        }
    }

    fn parameters(&self, overview: &Overview) -> Vec<Parameter> {
        let range_um = overview.range_um.max(1e-6);
        let longest_s = overview.duration_s.max(1e-3);
        (1..=self.operators)
            .flat_map(|i| {
                [
                    Parameter::linear(format!("share_{i}"), "1", 0.0, 0.9, 0.01),
                    Parameter::linear(
                        format!("threshold_{i}_um"),
                        "um",
                        0.0,
                        10.0 * range_um,
                        0.01 * range_um,
                    )
                    .on_a_grid(),
                    Parameter::logarithmic(
                        format!("time_constant_{i}_s"),
                        "s",
                        1e-6 * longest_s,
                        100.0 * longest_s,
                    )
                    .on_a_grid(),
                ]
            })
            .collect()
    }

    fn starts(&self, overview: &Overview) -> Vec<Vec<f64>> {
        let longest_s = (overview.duration_s / 2.0).max(1e-3);
        let grid = (0..self.operators).flat_map(|i| {
            let threshold_um =
                THRESHOLDS[i / TIME_CONSTANTS % THRESHOLDS.len()] * overview.range_um.max(1e-6);
            [
                0.002,
                threshold_um,
                longest_s * 10f64.powi((i % TIME_CONSTANTS) as i32 + 1 - TIME_CONSTANTS as i32),
            ]
        });
        vec![grid.collect()]
    }

    fn with_parameters(&self, count: usize) -> Option<Arc<dyn Effect>> {
        (count > 0 && count.is_multiple_of(3)).then(|| {
            Arc::new(Self {
                operators: count / 3,
            }) as Arc<dyn Effect>
        })
    }

    fn stage<'a>(&self, from: &Build<'_, 'a>) -> Option<Box<dyn Stage + 'a>> {
        let operators = from
            .values
            .chunks_exact(3)
            .map(|v| Operator::new(v, from.setting.dt_s))
            .collect();
        Some(Box::new(OperatorStage {
            operators,
            input_um: 0.0,
        }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// Oracle: held long enough at each of some displacements, the state is the play operator of the same
        /// threshold.
        #[test]
        fn its_equilibrium_is_a_play_operator(levels in proptest::collection::vec(-5.0f64..5.0, 1..20), threshold in 0.0f64..2.0) {
            let mut stage = OperatorStage { operators: vec![Operator::new(&[1.0, threshold, 0.01], 0.001)], input_um: 0.0 };
            let mut play = 0.0f64;
            for level in levels {
                (0..1000).for_each(|k| { stage.step(k, level); });
                play = play.max(level - threshold).min(level + threshold);
                prop_assert!((stage.operators[0].state_um - play).abs() < 1e-9, "{} {play}", stage.operators[0].state_um);
            }
        }

        /// Oracle: small steps of Euler's rule.
        #[test]
        fn on_the_way_it_follows_its_equation(levels in proptest::collection::vec(-5.0f64..5.0, 1..10), threshold in 0.0f64..1.0) {
            let (dt_s, tau_s) = (1e-3, 0.05);
            let mut stage = OperatorStage { operators: vec![Operator::new(&[1.0, threshold, tau_s], dt_s)], input_um: 0.0 };
            let (mut z, mut x) = (0.0f64, 0.0f64);
            for level in levels {
                for k in 0..40 {
                    let next = x + (level - x) * 0.1;
                    for j in 0..200 {
                        let now = x + (next - x) * (f64::from(j) + 0.5) / 200.0;
                        let far = now - z;
                        z += dt_s / 200.0 / tau_s * far.signum() * (far.abs() - threshold).max(0.0);
                    }
                    x = next;
                    let reached = stage.step(k, x) - x;
                    prop_assert!((reached - z).abs() < 4e-3, "{reached} {z}");
                }
            }
        }
    }
}
