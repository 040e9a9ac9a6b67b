//! Disturbance observer: the scheme that most papers on piezo stages compare with (Ohnishi's form; thesis Ch.
//! 2, 2.6).
//!
//! # How it works
//! The inverse of a nominal second-order model, made proper by the low-pass filter `Q = wq^2 / (s + wq)^2`,
//! tells which input the motion must have had; less what was applied, through the same `Q`, that is the
//! unknown input, which is subtracted from the next command. A proportional gain on the error stands beside.
//! The reference is fed forward as for the predictor.
//!
//! All of it is linear, so it runs in the tick as a law of the predictor's form
//! ([`hysteron_core::predictor_law`]) whose rows are filled differently, and its margins are judged as the
//! predictor's are. States: two of `Q / P_n` over the error, its output with the proportional gain, two of
//! `Q` over the input and its output of the tick before. The law's own unknown input keeps what it is given
//! at a take-over: to the disturbance observer that is one more constant disturbance, and the analysis here
//! leaves it out.

use super::assessment::{Assessment, best_of};
use super::feedforward::feedforward;
use super::law::{PredictorDesign, STATES};
use super::model::LinearModel;
use super::tuning::Demands;
use hysteron_sim::linear_system::ContinuousSystem;
use nalgebra::{DMatrix, DVector};
use serde::{Deserialize, Serialize};

/// Gains of the disturbance observer.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DisturbanceObserverGains {
    /// Cut-off `wq` of `Q`, rad/s.
    pub cutoff_rad_s: f64,
    /// Proportional gain on the error, um of force-equivalent displacement per um.
    pub proportional: f64,
}

/// The law in f64, designed for the first mode of a model.
#[must_use]
pub fn law(linear: &LinearModel, gains: &DisturbanceObserverGains) -> PredictorDesign {
    let (w, xi) = (
        linear.first_mode.natural_frequency_rad_s,
        linear.first_mode.damping_ratio,
    );
    let wq = gains.cutoff_rad_s;
    let mut a = DMatrix::zeros(STATES, STATES);
    let (mut b, mut l, mut k) = (
        DVector::zeros(STATES),
        DVector::zeros(STATES),
        DVector::zeros(STATES),
    );
    // Q / P_n by Tustin's rule: b0 + b1 / z + b2 / z^2 over (1 - p / z)^2, written as two lags of unit gain.
    let c = 2.0 / linear.period_s;
    let leading = (c + wq).powi(2) / (wq / w).powi(2);
    let [b0, b1, b2] = [
        c * c + 2.0 * xi * w * c + w * w,
        2.0 * (w * w - c * c),
        c * c - 2.0 * xi * w * c + w * w,
    ]
    .map(|v| v / leading);
    let p = (c - wq) / (c + wq);
    let first = (b1 + 2.0 * p * b0) / (1.0 - p);
    let second = (b2 - p * p * b0 + p * first * (1.0 - p)) / (1.0 - p).powi(2);
    a[(0, 0)] = p;
    l[0] = 1.0 - p;
    a[(1, 0)] = 1.0 - p;
    a[(1, 1)] = p;
    a[(2, 0)] = first;
    a[(2, 1)] = second;
    l[2] = b0 + gains.proportional;
    // Q over the input, exact for an input that is held.
    let q = ContinuousSystem {
        a: DMatrix::from_row_slice(2, 2, &[-wq, 0.0, wq, -wq]),
        b: DVector::from_row_slice(&[wq, 0.0]),
        c: DVector::from_row_slice(&[0.0, 1.0]),
        d: 0.0,
    };
    let (phi, gamma) = q.held_matrices(linear.period_s);
    a.view_mut((3, 3), (2, 2)).copy_from(&phi);
    b.view_mut((3, 0), (2, 1)).copy_from(&gamma);
    // What was applied up to the reading, not what acts from now on.
    a[(5, 4)] = 1.0;
    k[2] = 1.0;
    k[5] = -1.0;
    PredictorDesign {
        a,
        b,
        c: DVector::zeros(STATES),
        l,
        k,
        feedforward: feedforward(&linear.sampled()),
        period_s: linear.period_s,
    }
}

/// The gains with the smallest expected error of those that keep the same margins as a predictor, with what
/// they are worth.
#[must_use]
pub fn tune(
    linear: &LinearModel,
    demands: &Demands,
) -> Option<Assessment<DisturbanceObserverGains>> {
    let mut candidates = Vec::new();
    for i in 0..16 {
        for proportional in [0.0, 0.1, 0.2, 0.4, 0.8, 1.2, 1.6] {
            candidates.push(DisturbanceObserverGains {
                cutoff_rad_s: 300.0 * 1.25_f64.powi(i),
                proportional,
            });
        }
    }
    best_of(&candidates, |gains| law(linear, gains), linear, demands)
}

#[cfg(test)]
mod tests {
    use super::super::model::ModeModel;
    use super::super::sampled_loop::SampledLoop;
    use super::*;

    fn plant() -> LinearModel {
        LinearModel {
            first_mode: ModeModel {
                natural_frequency_rad_s: 5300.0,
                damping_ratio: 0.78,
            },
            second_mode: None,
            amplifier_bandwidth_hz: None,
            sensor_bandwidth_hz: None,
            period_s: 5e-5,
        }
    }

    /// A constant unknown input is estimated to the last digit: the motion does not answer to it at rest.
    #[test]
    fn a_constant_unknown_input_leaves_no_error() {
        let design = law(
            &plant(),
            &DisturbanceObserverGains {
                cutoff_rad_s: 1000.0,
                proportional: 0.2,
            },
        );
        let sampled = plant().sampled();
        let closed = SampledLoop::new(&design, &sampled);
        assert!(closed.is_stable());
        let unknown = closed.disturbance_response(1e-3);
        assert!(unknown.norm() < 1e-5, "{unknown}");
        let unknown = closed.disturbance_response(3000.0);
        assert!(unknown.norm() > 0.1);
    }

    #[test]
    fn a_tuned_one_keeps_its_margins_and_fits_the_tick() {
        let found = tune(&plant(), &Demands::default()).unwrap();
        assert!(found.accepted && found.margins.gain_plus_half < 1.0 && found.margins.delay < 1.0);
        law(&plant(), &found.tuning).quantised().unwrap();
    }
}
