//! Inverse of any loop structure: which drive makes its output come to a desired displacement, from the state
//! that all drives so far have left.
//!
//! # How it works
//! A structure says where its output bends on the way up or down from where it stands ([`Loops::bends_v`]):
//! the extrema that a Preisach-type memory remembers, the thresholds of play and slip elements. The output is
//! monotone, so bisection over the bends finds the piece that holds the desired output, and a guarded secant
//! search the drive inside it. A straight piece, as of the Prandtl-Ishlinskii family and Maxwell's elements,
//! is met by the first secant to rounding: for these the inverse is exact. Bouc-Wen's and Duhem's equations
//! and rate-dependent surfaces are met to [`TOLERANCE`] of the drive's range.
//!
//! The model itself takes the answer, so model and inverse cannot part, and what no drive reaches saturates
//! and is reported.

use crate::chain::Model;
use crate::effect::{Loops, Setting};
pub use crate::hysteresis_inverse::InverseDrive;

/// Accuracy of the drive, as a share of its range.
pub const TOLERANCE: f64 = 1e-15;
/// Most secants in a piece; each other one is a bisection where they converge slowly, so that 53 halvings are
/// among them.
const SEARCH_STEPS: usize = 110;

/// The inverse with the memory of the loops.
pub struct LoopInverse {
    loops: Box<dyn Loops>,
    limits_v: [f64; 2],
    drive_v: f64,
}

impl LoopInverse {
    /// The inverse of the loops of a model, virgin at the lower limit of the drive, for samples of this
    /// period; none where its structure has none.
    #[must_use]
    pub fn from_model(model: &Model, dt_s: f64) -> Option<Self> {
        let main = model
            .effects
            .iter()
            .find(|e| e.effect.declaration().is_main())?;
        let setting = Setting::of_held_drive(model.drive_min_v, model.drive_max_v, dt_s);
        let mut loops = main.loops(model, &setting)?;
        let drive_v = model.virgin_drive_v();
        loops.step(0, drive_v);
        Some(Self {
            loops,
            limits_v: [model.drive_min_v, model.drive_max_v],
            drive_v,
        })
    }

    /// What the loops would give at a drive.
    fn at(&self, drive_v: f64) -> f64 {
        self.loops.boxed().step(0, drive_v)
    }

    /// The drive that takes the output to `desired_um`, and the memory with it.
    pub fn step(&mut self, desired_um: f64) -> InverseDrive {
        let held_um = self.at(self.drive_v);
        let (drive_v, saturated) = if desired_um == held_um {
            (self.drive_v, false)
        } else {
            self.towards(desired_um, held_um)
        };
        self.drive_v = drive_v;
        InverseDrive {
            drive_v,
            output_um: self.loops.step(0, drive_v),
            saturated,
        }
    }

    fn towards(&self, desired_um: f64, held_um: f64) -> (f64, bool) {
        let rising = desired_um > held_um;
        let end_v = self.limits_v[usize::from(rising)];
        let between = |v: &f64| {
            if rising {
                *v > self.drive_v && *v < end_v
            } else {
                *v < self.drive_v && *v > end_v
            }
        };
        let mut bends_v: Vec<f64> = self
            .loops
            .bends_v(rising)
            .into_iter()
            .filter(between)
            .collect();
        bends_v.push(end_v);
        bends_v.sort_by(|a, b| {
            if rising {
                a.total_cmp(b)
            } else {
                b.total_cmp(a)
            }
        });
        let reached = |v: f64| {
            if rising {
                self.at(v) >= desired_um
            } else {
                self.at(v) <= desired_um
            }
        };
        let first = bends_v.partition_point(|v| !reached(*v));
        let Some(beyond_v) = bends_v.get(first) else {
            return (end_v, true);
        };
        let before_v = first.checked_sub(1).map_or(self.drive_v, |i| bends_v[i]);
        (self.solve(desired_um, before_v, *beyond_v), false)
    }

    /// Where the output takes the desired value between two drives that bracket it.
    fn solve(&self, desired_um: f64, before_v: f64, beyond_v: f64) -> f64 {
        let miss = |v: f64| self.at(v) - desired_um;
        let (mut a, mut b) = ((before_v, miss(before_v)), (beyond_v, miss(beyond_v)));
        let tolerance_v = TOLERANCE * (self.limits_v[1] - self.limits_v[0]);
        for step in 0..SEARCH_STEPS {
            if b.1 == 0.0 || (b.0 - a.0).abs() <= tolerance_v {
                break;
            }
            let secant_v = a.0 - a.1 * (b.0 - a.0) / (b.1 - a.1);
            // After a few secants that leave one end where it was, every other step halves the bracket.
            let inside = (secant_v - a.0) * (secant_v - b.0) < 0.0;
            let next_v = if inside && (step < 6 || step % 2 == 0) {
                secant_v
            } else {
                0.5 * (a.0 + b.0)
            };
            let next = (next_v, miss(next_v));
            if (next.1 > 0.0) == (b.1 > 0.0) {
                if next.1.abs() >= b.1.abs() {
                    break;
                }
                b = next;
            } else {
                a = next;
            }
        }
        if a.1.abs() < b.1.abs() { a.0 } else { b.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effect::{Overview, model_of};
    use proptest::prelude::*;

    fn loops_of(id: &str, values: &[f64]) -> Model {
        let overview = Overview {
            range_um: 10.0,
            gain_um_v: 0.125,
            ..Overview::without_data(0.0, 80.0)
        };
        model_of(&overview, &[(id, values)])
    }

    /// The model simulated apart: what it gives for the drives of the inverse, um.
    fn forward(model: &Model, drive_v: &[f64], dt_s: f64) -> Vec<f64> {
        let main = &model.effects[0];
        let setting = Setting::of_held_drive(0.0, 80.0, dt_s);
        let mut stage = main.stage(model, &setting).unwrap();
        stage.settle(0.0);
        drive_v
            .iter()
            .enumerate()
            .map(|(k, v)| stage.step(k, *v))
            .collect()
    }

    fn largest_miss_um(model: &Model, desired_um: &[f64]) -> f64 {
        let dt_s = 1e-3;
        let mut inverse = LoopInverse::from_model(model, dt_s).unwrap();
        let answers: Vec<InverseDrive> = desired_um.iter().map(|y| inverse.step(*y)).collect();
        let drive_v: Vec<f64> = answers.iter().map(|a| a.drive_v).collect();
        let reached = forward(model, &drive_v, dt_s);
        let reachable = desired_um
            .iter()
            .zip(&reached)
            .zip(&answers)
            .filter(|(_, answer)| !answer.saturated);
        assert!(answers.iter().all(|a| (0.0..=80.0).contains(&a.drive_v)));
        // Where it saturates the drive stands at a limit.
        assert!(
            answers
                .iter()
                .all(|a| !a.saturated || a.drive_v == 0.0 || a.drive_v == 80.0)
        );
        reachable
            .map(|((wanted, got), _)| (wanted - got).abs())
            .fold(0.0, f64::max)
    }

    fn weights(first: f64, rest: &[f64]) -> Vec<f64> {
        std::iter::once(first).chain(rest.iter().copied()).collect()
    }

    /// The analytic inverse of the Prandtl-Ishlinskii operator (Krejci and Kuhnen 2001): again one, with
    /// thresholds and weights of its own.
    fn analytic_inverse(weights: &[f64], thresholds: &[f64], desired: &[f64]) -> Vec<f64> {
        let sums: Vec<f64> = weights
            .iter()
            .scan(0.0, |sum, w| {
                *sum += w;
                Some(*sum)
            })
            .collect();
        let inverse_weight = |i: usize| {
            if i == 0 {
                1.0 / weights[0]
            } else {
                -weights[i] / (sums[i] * sums[i - 1])
            }
        };
        let inverse_threshold = |i: usize| {
            (0..=i)
                .map(|j| weights[j] * (thresholds[i] - thresholds[j]))
                .sum::<f64>()
        };
        let mut plays = vec![0.0f64; weights.len()];
        let step = |y: &f64| {
            (0..weights.len())
                .map(|i| {
                    let r = inverse_threshold(i);
                    plays[i] = plays[i].max(y - r).min(y + r);
                    inverse_weight(i) * plays[i]
                })
                .sum()
        };
        desired.iter().map(step).collect()
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(48))]
        /// Two oracles: the model simulated apart, and the analytic inverse.
        #[test]
        fn the_prandtl_ishlinskii_inverse_is_exact(
            rest in proptest::collection::vec(0.0f64..0.4, 9),
            desired in proptest::collection::vec(0.0f64..6.0, 1..60),
        ) {
            let weights = weights(7.0, &rest);
            let model = loops_of("prandtl_ishlinskii", &weights);
            prop_assert!(largest_miss_um(&model, &desired) < 1e-12 * 10.0);
            let thresholds: Vec<f64> = (0..10).map(|i| 0.05 * f64::from(i)).collect();
            let mut inverse = LoopInverse::from_model(&model, 1e-3).unwrap();
            for (y, x) in desired.iter().zip(analytic_inverse(&weights, &thresholds, &desired)) {
                let answer = inverse.step(*y);
                if answer.saturated || !(0.0..=1.0).contains(&x) {
                    break;
                }
                prop_assert!((answer.drive_v - 80.0 * x).abs() < 1e-11 * 80.0, "{} {}", answer.drive_v, 80.0 * x);
            }
        }

        #[test]
        fn the_modified_one_is_exact(
            rest in proptest::collection::vec(0.0f64..0.4, 9),
            zones in proptest::collection::vec(-0.2f64..0.2, 4),
            desired in proptest::collection::vec(0.0f64..8.0, 1..60),
        ) {
            let values: Vec<f64> = weights(7.0, &rest).into_iter().chain(zones).chain([9.0]).collect();
            prop_assert!(largest_miss_um(&loops_of("modified_prandtl_ishlinskii", &values), &desired) < 1e-12 * 10.0);
        }

        #[test]
        fn the_rate_dependent_one_is_exact(
            rest in proptest::collection::vec(0.0f64..0.4, 9),
            by_rate in proptest::collection::vec(0.0f64..0.03, 10),
            desired in proptest::collection::vec(0.5f64..6.0, 1..60),
        ) {
            let values: Vec<f64> = weights(7.0, &rest).into_iter().chain(by_rate).collect();
            // Slow enough that the rate does not bend the output back.
            let desired: Vec<f64> = desired.windows(2).flat_map(|w| (0..40).map(move |k| w[0] + (w[1] - w[0]) * f64::from(k) / 40.0)).collect();
            prop_assert!(largest_miss_um(&loops_of("rate_dependent_prandtl_ishlinskii", &values), &desired) < 1e-12 * 10.0);
        }

        #[test]
        fn the_maxwell_slip_inverse_is_exact(
            stiffness in proptest::collection::vec(0.0f64..0.5, 8),
            desired in proptest::collection::vec(0.0f64..8.0, 1..60),
        ) {
            prop_assert!(largest_miss_um(&loops_of("maxwell_slip", &weights(12.0, &stiffness)), &desired) < 1e-12 * 10.0);
        }

        #[test]
        fn bouc_wen_and_duhem_are_met_numerically(desired in proptest::collection::vec(0.0f64..7.0, 1..40)) {
            // A branch of Bouc-Wen's equation is stepped in whole pieces: its output has steps of the rule's
            // own error.
            prop_assert!(largest_miss_um(&loops_of("bouc_wen", &[11.0, 4.0, 2.0, 0.5]), &desired) < 1e-5 * 10.0);
            prop_assert!(largest_miss_um(&loops_of("duhem", &[3.0, 10.0, 7.0]), &desired) < 1e-12 * 10.0);
        }

        #[test]
        fn the_polynomial_loop_is_met(desired in proptest::collection::vec(0.5f64..7.0, 1..40)) {
            prop_assert!(largest_miss_um(&loops_of("polynomial_loop", &[8.0, 1.0, 0.5, 1.5, -0.3]), &desired) < 1e-11 * 10.0);
        }
    }
}
