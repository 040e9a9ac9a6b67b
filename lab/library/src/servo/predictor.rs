//! The observer-controller for the one-period delay (core: [`hysteron_core::predictor_law`]): gains from four
//! physical numbers.
//!
//! # How it works
//! The states are those of the identified linear dynamics, sampled exactly, and the unknown input as an
//! integrator (with its slope, if wanted). The observer is the stationary Kalman predictor for given sizes of
//! the unknown input's change, of the noise of the sensor and of a white force; the surface to which the
//! state is driven comes from the linear-quadratic problem `sum y^2 + rho v^2`. So four physical numbers, not
//! sixteen gains, are tuned: by [`tune`] on a fixed list of cases, by [`Task`](super::robust::Task) over
//! everything that a recording leaves possible.

use super::assessment::{Assessment, assess};
use super::candidate::Family;
use super::feedforward::feedforward;
use super::law::{PredictorDesign, STATES};
use super::model::{LinearModel, SampledModel};
use super::tuning::{Demands, PredictorTuning};
use crate::parallel;
use hysteron_core::predictor_law;
use nalgebra::{DMatrix, DVector};

/// Pole of the noise about half the sampling rate: some 1.1 kHz wide.
const FAST_NOISE_POLE: f64 = -0.7;

/// Stationary solution of `P = A P A' - A P c' (c P c' + r)^-1 c P A' + Q` by the doubling algorithm
/// (Anderson 1978: each step stands for twice as many of the recursion as the one before); returns the
/// predictor's gain `A P c / (c' P c + r)`.
fn kalman_predictor(a: &DMatrix<f64>, c: &DVector<f64>, q: &DMatrix<f64>, r: f64) -> DVector<f64> {
    let n = a.nrows();
    let identity = DMatrix::<f64>::identity(n, n);
    let (mut alpha, mut beta, mut p) = (a.transpose(), c * c.transpose() / r, q.clone());
    for _ in 0..40 {
        let Some(inverse) = (&identity + &beta * &p).try_inverse() else {
            break;
        };
        let step = alpha.transpose() * &p * &inverse * &alpha;
        let next_beta = &beta + &alpha * &inverse * &beta * alpha.transpose();
        alpha = &alpha * &inverse * &alpha;
        beta = (&next_beta + next_beta.transpose()) * 0.5;
        let change = step.norm();
        p += (&step + step.transpose()) * 0.5;
        if change <= 1e-15 * p.norm() {
            break;
        }
    }
    let pc = &p * c;
    a * &pc / (c.dot(&pc) + r)
}

/// Gain of the linear-quadratic problem `sum y^2 + rho v^2`: the dual of the predictor.
fn quadratic_regulator(model: &SampledModel, rho: f64) -> DVector<f64> {
    kalman_predictor(
        &model.a.transpose(),
        &model.b,
        &(&model.c * model.c.transpose()),
        rho,
    )
}

impl PredictorDesign {
    /// For a linear model and a tuning.
    #[must_use]
    pub fn new(linear: &LinearModel, tuning: &PredictorTuning) -> Self {
        Self {
            feedforward: feedforward(&linear.sampled()),
            ..Self::without_feedforward(linear, tuning)
        }
    }

    /// What closes the loop, without a feedforward: that depends on the model alone, and many tunings are
    /// judged on one.
    pub(super) fn without_feedforward(linear: &LinearModel, tuning: &PredictorTuning) -> Self {
        let model = linear.sampled();
        let n = model.a.nrows();
        let (slope, unknown) = (STATES - 2, STATES - 1);
        let mut a = DMatrix::zeros(STATES, STATES);
        a.view_mut((0, 0), (n, n)).copy_from(&model.a);
        a.view_mut((0, unknown), (n, 1)).copy_from(&model.b);
        a[(unknown, unknown)] = 1.0;
        let with_slope = tuning.unknown_slope_change_um > 0.0;
        if with_slope {
            a[(slope, slope)] = 1.0;
            a[(unknown, slope)] = 1.0;
        }
        let mut b = DVector::zeros(STATES);
        b.view_mut((0, 0), (n, 1)).copy_from(&model.b);
        let mut c = DVector::zeros(STATES);
        c.view_mut((0, 0), (n, 1)).copy_from(&model.c);
        let mut q = &b * b.transpose() * tuning.force_noise_um.powi(2);
        q[(unknown, unknown)] += tuning.unknown_change_um.powi(2);
        q[(slope, slope)] += tuning.unknown_slope_change_um.powi(2);
        let mut used = n;
        if tuning.fast_noise_um > 0.0 && n < predictor_law::STATES {
            // Its state is the noise itself, read beside the position.
            a[(n, n)] = FAST_NOISE_POLE;
            c[n] = 1.0;
            q[(n, n)] = tuning.fast_noise_um.powi(2) * (1.0 - FAST_NOISE_POLE.powi(2));
            used += 1;
        }
        let mut l = kalman_predictor(&a, &c, &q, tuning.sensor_noise_um.powi(2));
        for i in used..STATES {
            if i < slope || (i == slope && !with_slope) {
                l[i] = 0.0;
            }
        }
        let mut k = DVector::zeros(STATES);
        k.view_mut((0, 0), (n, 1))
            .copy_from(&quadratic_regulator(&model, tuning.effort_weight));
        k[unknown] = 1.0;
        Self {
            a,
            b,
            c,
            l,
            k,
            feedforward: Vec::new(),
            period_s: linear.period_s,
        }
    }
}

/// The predictors of a model.
pub(super) struct Predictors<'a>(pub &'a LinearModel);

impl Family for Predictors<'_> {
    type Tuning = PredictorTuning;

    fn law(&self, tuning: &PredictorTuning) -> Option<PredictorDesign> {
        Some(PredictorDesign::without_feedforward(self.0, tuning))
    }

    fn fits(&self, _tuning: &PredictorTuning, law: &PredictorDesign) -> bool {
        law.quantised().is_ok()
    }

    fn grid(&self, demands: &Demands) -> Vec<PredictorTuning> {
        let noise_um = demands.sensor_noise_um;
        let mut tunings = Vec::new();
        for effort_weight in [0.03, 0.1, 0.3, 1.0, 3.0, 10.0, 100.0, 1e4] {
            for change in [0.001, 0.003, 0.01, 0.03, 0.1, 0.3, 1.0, 2.0, 4.0, 8.0] {
                for force in [0.1, 1.0, 10.0] {
                    for slope in [0.0, 0.05, 0.2] {
                        tunings.push(PredictorTuning {
                            effort_weight,
                            unknown_change_um: change * noise_um,
                            unknown_slope_change_um: slope * change * noise_um,
                            force_noise_um: force * noise_um,
                            sensor_noise_um: noise_um,
                            fast_noise_um: 0.0,
                        });
                    }
                }
            }
        }
        tunings
    }

    fn numbers(&self) -> usize {
        5
    }

    fn stepped(&self, tuning: &PredictorTuning, number: usize, by: f64) -> PredictorTuning {
        let mut out = *tuning;
        match number {
            0 => out.effort_weight *= by,
            1 => {
                out.unknown_change_um *= by;
                out.unknown_slope_change_um *= by;
            }
            2 => out.unknown_slope_change_um *= by,
            3 => out.force_noise_um *= by,
            _ if out.fast_noise_um > 0.0 => out.fast_noise_um *= by,
            // A noise about half the sampling rate that is not there yet begins at the sensor's.
            _ => out.fast_noise_um = by * out.sensor_noise_um,
        }
        out
    }
}

/// The scan: all assessments, best accepted first, then the others.
#[must_use]
pub fn tune(linear: &LinearModel, demands: &Demands) -> Vec<Assessment> {
    let mut candidates = Vec::new();
    for effort_weight in [0.03, 0.1, 0.3, 1.0, 3.0, 10.0, 100.0] {
        for unknown_change_um in [0.0003, 0.001, 0.002, 0.004, 0.008] {
            for force_noise_um in [0.001, 0.01] {
                for slope in [0.0, 0.05, 0.2] {
                    candidates.push(PredictorTuning {
                        effort_weight,
                        unknown_change_um,
                        unknown_slope_change_um: slope * unknown_change_um,
                        force_noise_um,
                        sensor_noise_um: demands.sensor_noise_um.max(1e-4),
                        fast_noise_um: 0.0,
                    });
                }
            }
        }
    }
    let mut out: Vec<Assessment> = parallel::map(&candidates, |tuning: &PredictorTuning| {
        let law = PredictorDesign::without_feedforward(linear, tuning);
        assess(*tuning, &law, linear, demands)
    });
    out.sort_by(|x, y| {
        y.accepted
            .cmp(&x.accepted)
            .then(x.expected_um().total_cmp(&y.expected_um()))
    });
    out
}
