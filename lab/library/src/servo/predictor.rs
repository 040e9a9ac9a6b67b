//! The observer-controller for the one-period delay (core: [`hysteron_core::predictor_law`]): gains, margins,
//! trade-off.
//!
//! # How it works
//! The states are those of the identified linear dynamics, sampled exactly, and the unknown input as an
//! integrator (with its slope, if wanted). The observer is the stationary Kalman predictor for given sizes of
//! the unknown input's change, of the noise of the sensor and of a white force; the surface to which the
//! state is driven comes from the linear-quadratic problem `sum y^2 + rho v^2`. So four physical numbers, not
//! sixteen gains, are tuned; [`tune`] scans them. A candidate is accepted when the sampled closed loop stays
//! stable with the gain changed by +-50 %, with more mass, with half a period of additional delay and with a
//! second mode that it does not know; of the accepted ones that with the least expected error is taken:
//! sensor noise that it passes on, and the part of a model error in the hysteresis that it lets through.

use super::model::{LinearModel, ModeModel, SampledModel};
use super::quantise::{OF_OUTPUT_ROW_MOST, OF_STATE_ROW_MOST, QuantisationError, number, row_um};
use super::window_fit;
use crate::parallel;
use hysteron_core::predictor_law::{self, PredictorParameters, STATE_ROW_FRACTION_BITS};
use hysteron_core::reference_window::{PREVIEW_TICKS, WINDOW};
use nalgebra::{Complex, DMatrix, DVector, Schur};
use serde::{Deserialize, Serialize};

/// States of the linear dynamics, the slope of the unknown input, and the unknown input.
pub(super) const STATES: usize = predictor_law::STATES + 2;

/// What the predictor is tuned by.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PredictorTuning {
    /// Weight of the effort, `rho`.
    pub effort_weight: f64,
    /// RMS change of the unknown input in one period, um.
    pub unknown_change_um: f64,
    /// RMS change of the slope of the unknown input in one period, um per period; zero for no slope.
    pub unknown_slope_change_um: f64,
    /// White force, um RMS.
    pub force_noise_um: f64,
    /// Noise of the sensor, um RMS.
    pub sensor_noise_um: f64,
    /// Noise of the reading about half the sampling rate that the observer reckons with beside the white one,
    /// um RMS: the more, the less the law answers there. Zero for none; it takes one of the law's states, and
    /// where none is free it is left out.
    #[serde(default)]
    pub fast_noise_um: f64,
}

/// Pole of the noise about half the sampling rate: some 1.1 kHz wide.
const FAST_NOISE_POLE: f64 = -0.7;

impl PredictorTuning {
    /// Where the scan begins.
    pub const START: Self = Self {
        effort_weight: 1.0,
        unknown_change_um: 0.002,
        unknown_slope_change_um: 0.0,
        force_noise_um: 0.003,
        sensor_noise_um: 0.001,
        fast_noise_um: 0.0,
    };
}

/// The law in f64: what is quantised, and what the eigenvalues are taken of.
#[derive(Clone, Debug)]
pub struct PredictorDesign {
    /// Transition matrix of all states, the unknown input last.
    pub a: DMatrix<f64>,
    /// Input vector.
    pub b: DVector<f64>,
    /// Reading row.
    pub c: DVector<f64>,
    /// Observer gain (predictor form).
    pub l: DVector<f64>,
    /// Gain row, one for the unknown input.
    pub k: DVector<f64>,
    /// Feedforward over the reference window.
    pub feedforward: Vec<f64>,
    /// Sampling period, s.
    pub period_s: f64,
}

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

/// Frequency response of a sampled model.
#[must_use]
pub fn frequency_response(model: &SampledModel, omega_rad_s: f64) -> Complex<f64> {
    let n = model.a.nrows();
    let z = Complex::from_polar(1.0, omega_rad_s * model.period_s);
    let matrix = DMatrix::from_fn(
        n,
        n,
        |i, j| if i == j { z } else { Complex::new(0.0, 0.0) } - Complex::new(model.a[(i, j)], 0.0),
    );
    let b = model.b.map(|v| Complex::new(v, 0.0));
    match matrix.lu().solve(&b) {
        Some(x) => x.iter().zip(model.c.iter()).map(|(x, c)| x * *c).sum(),
        None => Complex::new(f64::NAN, f64::NAN),
    }
}

/// What a reference becomes on an actuator: motion over reference, from the responses of the actuator, of the
/// feedforward and of the law's drive to the reading, all at one frequency.
#[must_use]
pub fn reference_response(
    plant: Complex<f64>,
    feedforward: Complex<f64>,
    law: Complex<f64>,
) -> Complex<f64> {
    let one = Complex::new(1.0, 0.0);
    one + (plant * feedforward - one) / (one + plant * law)
}

/// Taps whose magnitudes sum to less have a place in the tick, with room for a gain that is corrected.
const LARGEST_TAPS: f64 = 0.8 * OF_OUTPUT_ROW_MOST;
/// Where the band in which a feedforward is the model's inverse may end, Hz, where it cannot be that up to
/// [`window_fit::BAND_HZ`].
const NARROWER_BANDS_HZ: [f64; 7] = [800.0, 700.0, 600.0, 500.0, 400.0, 300.0, 200.0];
/// A reference is reckoned with as evenly up to here, Hz, and from here on as one of steps.
const EVENLY_TO_HZ: f64 = 100.0;

/// Feedforward over the reference window for the period that begins one tick after now: the inverse of a
/// sampled model.
///
/// Where two modes share the motion nothing moves between them at one frequency, and no inverse of a few taps
/// follows there: one that was fitted to that frequency would be thousands of times too large and wrong
/// everywhere. The band then ends in front of it: of the narrower ones whose taps the tick has room for, the
/// one that leaves least of a reference is taken. A mode so slow that none fits is followed as far as the
/// taps go.
#[must_use]
pub fn feedforward(model: &SampledModel) -> Vec<f64> {
    let inverse =
        |w: f64| Complex::from_polar(1.0, w * model.period_s) / frequency_response(model, w);
    let fits = |taps: &Vec<f64>| taps.iter().map(|tap| tap.abs()).sum::<f64>() < LARGEST_TAPS;
    let whole = window_fit::fit(model.period_s, inverse);
    if fits(&whole) {
        return whole;
    }
    let left = |taps: &Vec<f64>| -> f64 {
        let of_band = (1..=90).map(|i| 0.1 * window_fit::BAND_HZ / 9.0 * f64::from(i));
        of_band
            .map(|hz| {
                (missed_of_reference(model, taps, hz) * EVENLY_TO_HZ / hz.max(EVENLY_TO_HZ)).powi(2)
            })
            .sum()
    };
    let narrower = |weight: f64| {
        let fitted = NARROWER_BANDS_HZ
            .iter()
            .map(|band_hz| window_fit::fit_in(model.period_s, *band_hz, weight, inverse));
        fitted
            .filter(fits)
            .min_by(|a, b| left(a).total_cmp(&left(b)))
    };
    // The more weight, the smaller the taps: the last come down to the constant alone.
    let found =
        (0..12).find_map(|nth| narrower(if nth == 0 { 0.0 } else { 1e-3 * 4f64.powi(nth) }));
    found.unwrap_or(whole)
}

/// Share of a reference at a frequency, Hz, that a feedforward alone misses on the model that it was made
/// for.
#[must_use]
pub fn missed_of_reference(model: &SampledModel, taps: &[f64], hz: f64) -> f64 {
    let omega = std::f64::consts::TAU * hz;
    (frequency_response(model, omega) * feedforward_response(taps, model.period_s, hz) - 1.0).norm()
}

/// Response of taps over the reference window at a frequency, Hz: what acts, over the reference of the same
/// instant.
fn feedforward_response(taps: &[f64], period_s: f64, hz: f64) -> Complex<f64> {
    // Computed at a tick, it acts one period later.
    let before = (WINDOW - PREVIEW_TICKS) as f64;
    let step = std::f64::consts::TAU * hz * period_s;
    taps.iter()
        .enumerate()
        .map(|(i, c)| Complex::from_polar(*c, step * (i as f64 - before)))
        .sum()
}

impl PredictorDesign {
    /// For a linear model and a tuning.
    #[must_use]
    pub fn new(linear: &LinearModel, tuning: &PredictorTuning) -> Self {
        Self {
            feedforward: feedforward(&linear.sampled()),
            ..Self::of_loop(linear, tuning)
        }
    }

    /// What closes the loop, without a feedforward: that depends on the model alone, and many tunings are
    /// judged on one.
    pub(super) fn of_loop(linear: &LinearModel, tuning: &PredictorTuning) -> Self {
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

    /// Response of the feedforward at a frequency: what acts, over the reference of the same instant.
    #[must_use]
    pub fn feedforward_response(&self, hz: f64) -> Complex<f64> {
        feedforward_response(&self.feedforward, self.period_s, hz)
    }

    /// Rows of the tick, in units of the states in which they fit: as the model has them where they do, else
    /// multiplied by powers of two.
    ///
    /// A mode that is slow beside the sampling moves by little of its velocity over its frequency in one
    /// period: an observer that is as fast as the sampling then has large gains, and a control small ones.
    /// Counted in smaller pieces of velocity neither is.
    ///
    /// # Errors
    /// If a coefficient does not fit.
    pub fn quantised(&self) -> Result<PredictorParameters, QuantisationError> {
        self.as_it_stands().or_else(|_| {
            self.with_states_multiplied(&self.multipliers())
                .as_it_stands()
        })
    }

    /// The same law with each of the states of the linear dynamics in another unit.
    fn with_states_multiplied(&self, by: &[f64; predictor_law::STATES]) -> Self {
        let at = |i: usize| by.get(i).copied().unwrap_or(1.0);
        Self {
            a: DMatrix::from_fn(STATES, STATES, |i, j| self.a[(i, j)] * at(i) / at(j)),
            b: DVector::from_fn(STATES, |i, _| self.b[i] * at(i)),
            c: DVector::from_fn(STATES, |i, _| self.c[i] / at(i)),
            l: DVector::from_fn(STATES, |i, _| self.l[i] * at(i)),
            k: DVector::from_fn(STATES, |i, _| self.k[i] / at(i)),
            feedforward: self.feedforward.clone(),
            period_s: self.period_s,
        }
    }

    /// Powers of two, at most one so that no state leaves its range, with which the rows take least of their
    /// formats: from one on, the states' exponents one at a time, as long as that helps.
    fn multipliers(&self) -> [f64; predictor_law::STATES] {
        const LINEAR: usize = predictor_law::STATES;
        let taken = |exponents: &[i32; LINEAR]| -> f64 {
            let law = self.with_states_multiplied(&exponents.map(|e| 2f64.powi(e)));
            let row = |i: usize| {
                law.a
                    .row(i)
                    .iter()
                    .take(LINEAR)
                    .map(|c| c.abs())
                    .sum::<f64>()
                    + law.l[i].abs()
                    + law.b[i].abs()
            };
            let rows = (0..LINEAR).map(|i| row(i) / OF_STATE_ROW_MOST);
            let outputs = [
                law.c.lp_norm(1) / OF_STATE_ROW_MOST,
                law.k.rows(0, LINEAR).lp_norm(1) / OF_OUTPUT_ROW_MOST,
            ];
            // A high power: the fullest row counts, and of two that are full both.
            rows.chain(outputs).map(|share| share.powi(8)).sum()
        };
        let mut here = [0; LINEAR];
        let mut least = taken(&here);
        for _ in 0..LINEAR * MOST_HALVINGS as usize {
            let lower = (0..LINEAR).filter(|i| here[*i] > -MOST_HALVINGS).map(|i| {
                let mut near = here;
                near[i] -= 1;
                (taken(&near), near)
            });
            match lower.min_by(|a, b| a.0.total_cmp(&b.0)) {
                Some((less, near)) if less < least => (least, here) = (less, near),
                _ => break,
            }
        }
        here.map(|e| 2f64.powi(e))
    }

    fn as_it_stands(&self) -> Result<PredictorParameters, QuantisationError> {
        const LINEAR: usize = predictor_law::STATES;
        let (slope, unknown) = (LINEAR, LINEAR + 1);
        let mut state_rows = [hysteron_core::integer_row::Row::default(); LINEAR];
        for (i, row) in state_rows.iter_mut().enumerate() {
            // The unknown input acts as the drive does: its column is `b`.
            let mut coefficients: Vec<f64> = self.a.row(i).iter().take(LINEAR).copied().collect();
            coefficients.extend([self.l[i], self.b[i]]);
            *row = row_um(&format!("observer row {i}"), &coefficients)?;
        }
        let bits = STATE_ROW_FRACTION_BITS as i32;
        Ok(PredictorParameters {
            state_rows,
            unknown_gain: number("observer gain of the unknown input", self.l[unknown], bits)?,
            slope_gain: number("observer gain of its slope", self.l[slope], bits)?,
            reading_row: row_um("reading row", self.c.as_slice())?,
            // The last two entries of `K` belong to the unknown input and its slope, which the tick adds
            // itself.
            gain_row: row_um("control gain", self.k.as_slice())?,
            feedforward: row_um("feedforward", &self.feedforward)?,
        })
    }

    /// Closed loop with an actuator of linear dynamics `plant`, its input multiplied by `gain`: states of the
    /// plant, then of the law. `extra_delay` (0 or 1) periods are added.
    #[must_use]
    pub fn closed_loop(&self, plant: &SampledModel, gain: f64, extra_delay: usize) -> DMatrix<f64> {
        let n = plant.a.nrows();
        let size = n + STATES + extra_delay;
        let mut m = DMatrix::zeros(size, size);
        m.view_mut((0, 0), (n, n)).copy_from(&plant.a);
        // The law believes that what it commanded acts: v = -K z.
        let input = -&self.k.transpose();
        let law = &self.a - &self.l * self.c.transpose() + &self.b * &input;
        m.view_mut((n, n), (STATES, STATES)).copy_from(&law);
        m.view_mut((n, 0), (STATES, n))
            .copy_from(&(&self.l * plant.c.transpose()));
        if extra_delay == 0 {
            m.view_mut((0, n), (n, STATES))
                .copy_from(&(&plant.b * &input * gain));
        } else {
            m.view_mut((0, n + STATES), (n, 1))
                .copy_from(&(&plant.b * gain));
            m.view_mut((n + STATES, n), (1, STATES)).copy_from(&input);
        }
        m
    }

    /// Sampled eigenvalues with the plant it was designed for: of the regulator and of the observer.
    #[must_use]
    pub fn eigenvalues(&self, plant: &SampledModel) -> Vec<Complex<f64>> {
        used_eigenvalues(&self.closed_loop(plant, 1.0, 0))
    }

    /// Largest eigenvalue magnitude with a plant, gain and delay.
    #[must_use]
    pub fn spectral_radius(&self, plant: &SampledModel, gain: f64, extra_delay: usize) -> f64 {
        let closed = self.closed_loop(plant, gain, extra_delay);
        // The iteration for eigenvalues need not come to an end on a matrix that is nearly defective, as a
        // loop with a small share is.
        let schur = Schur::try_new(closed.clone(), f64::EPSILON, MOST_ITERATIONS);
        schur.map_or_else(
            || growth(closed),
            |schur| {
                schur
                    .complex_eigenvalues()
                    .iter()
                    .map(|z| z.norm())
                    .fold(0.0, f64::max)
            },
        )
    }

    /// The law while its drive stands at a limit for part of every cycle: only a share of what it commands
    /// acts, which it knows, as it sees what really acts (the first harmonic of a saturation, Gelb and Vander
    /// Velde, Multiple-Input Describing Functions, 1968). A loop of which every share is stable has no
    /// oscillation that a limit could keep up; one of which some is not may be thrown into it, although it is
    /// stable within its limits.
    #[must_use]
    pub fn at_a_limit(&self, share: f64) -> Self {
        Self {
            k: &self.k * share,
            ..self.clone()
        }
    }

    /// Frequency responses of the closed loop at `omega`: from the unknown input to the true reading, and
    /// from sensor noise to it.
    #[must_use]
    pub fn sensitivities(
        &self,
        plant: &SampledModel,
        omega_rad_s: f64,
    ) -> (Complex<f64>, Complex<f64>) {
        let closed = self.closed_loop(plant, 1.0, 0);
        let n = plant.a.nrows();
        let size = closed.nrows();
        let mut c = DVector::zeros(size);
        c.view_mut((0, 0), (n, 1)).copy_from(&plant.c);
        let mut from_input = DVector::zeros(size);
        from_input.view_mut((0, 0), (n, 1)).copy_from(&plant.b);
        let mut from_noise = DVector::zeros(size);
        from_noise.view_mut((n, 0), (STATES, 1)).copy_from(&self.l);
        let response = |b: DVector<f64>| {
            frequency_response(
                &SampledModel {
                    a: closed.clone(),
                    b,
                    c: c.clone(),
                    period_s: plant.period_s,
                },
                omega_rad_s,
            )
        };
        (response(from_input), response(from_noise))
    }
}

/// By how many halvings a state's unit may be larger: of 24 fraction bits, 16 are left.
const MOST_HALVINGS: i32 = 8;

/// Iterations for eigenvalues; a loop of 60 states takes some hundred.
const MOST_ITERATIONS: usize = 10_000;

/// Growth of a system per step by Gelfand's formula, `|M^n|^(1/n)` with `n = 2^40`: the spectral radius
/// without eigenvalues.
fn growth(mut matrix: DMatrix<f64>) -> f64 {
    let (mut logarithm, mut weight) = (0.0, 1.0);
    for _ in 0..40 {
        let norm = matrix.norm();
        if norm == 0.0 || !norm.is_finite() {
            return norm;
        }
        logarithm += weight * norm.ln();
        matrix /= norm;
        matrix = &matrix * &matrix;
        weight *= 0.5;
    }
    logarithm.exp()
}

/// Eigenvalues without those of states that are not used (exactly zero rows).
fn used_eigenvalues(matrix: &DMatrix<f64>) -> Vec<Complex<f64>> {
    matrix
        .complex_eigenvalues()
        .iter()
        .copied()
        .filter(|z| z.norm() > 1e-9)
        .collect()
}

/// Margins that a design keeps: largest eigenvalue magnitudes of the sampled closed loop in each case. Below
/// one is stable.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Margins {
    /// Nominal.
    pub nominal: f64,
    /// Gain 50 % lower.
    pub gain_half: f64,
    /// Gain 50 % higher.
    pub gain_plus_half: f64,
    /// One more period of delay.
    pub delay: f64,
    /// Twice the moving mass.
    pub mass_double: f64,
    /// Two percent of the motion in a second mode at 6 times the first one's frequency, damping ratio 0.02,
    /// that the design does not know (only where the model has no second mode); otherwise the known second
    /// mode 10 % lower.
    pub second_mode: f64,
    /// Largest magnitude of the sensitivity over all frequencies.
    pub sensitivity_peak: f64,
}

/// What a tuning is worth.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Assessment {
    /// The tuning.
    pub tuning: PredictorTuning,
    /// Sensor noise that appears as motion, um RMS.
    pub noise_um: f64,
    /// Hysteresis model error that is let through, um RMS.
    pub disturbance_um: f64,
    /// Margins.
    pub margins: Margins,
    /// Stable in every case.
    pub accepted: bool,
}

impl Assessment {
    /// Expected error, um RMS.
    #[must_use]
    pub fn expected_um(&self) -> f64 {
        self.noise_um.hypot(self.disturbance_um)
    }
}

/// What the scan designs for.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Demands {
    /// Highest frequency of references, Hz.
    pub reference_hz: f64,
    /// Error of the hysteresis model at the reference's frequency, um RMS; a third of it at three times the
    /// frequency.
    pub model_error_um: f64,
    /// Noise of the sensor, um RMS.
    pub sensor_noise_um: f64,
    /// Largest sensitivity that is accepted.
    pub sensitivity_peak: f64,
    /// The usual margins are kept where that costs less than a third of the error ([`super::robust`]; the
    /// plain scan of [`tune`] has no such preference).
    #[serde(default)]
    pub usual_margins: bool,
}

impl Default for Demands {
    fn default() -> Self {
        Self {
            reference_hz: 150.0,
            model_error_um: 0.02,
            sensor_noise_um: 0.001,
            sensitivity_peak: 2.5,
            usual_margins: true,
        }
    }
}

/// What any law of the predictor's form is worth on a model.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TuningJudgement {
    /// Sensor noise that appears as motion, um RMS.
    pub noise_um: f64,
    /// Hysteresis model error that is let through, um RMS.
    pub disturbance_um: f64,
    /// Margins.
    pub margins: Margins,
    /// Stable in every case, and the sensitivity's peak as demanded.
    pub accepted: bool,
}

impl TuningJudgement {
    /// Expected error, um RMS.
    #[must_use]
    pub fn expected_um(&self) -> f64 {
        self.noise_um.hypot(self.disturbance_um)
    }
}

/// Of candidate gains the one with the smallest expected error among those that keep the margins: noise
/// passed on, and model error let through at the references' highest frequency and at a tenth of it, so that
/// a slow integral is not taken for a good one.
#[must_use]
pub fn best_of<G: Copy + Send + Sync>(
    candidates: Vec<G>,
    law: impl Fn(&G) -> PredictorDesign + Sync,
    linear: &LinearModel,
    demands: &Demands,
) -> Option<(G, TuningJudgement)> {
    let slow = Demands {
        reference_hz: 0.1 * demands.reference_hz,
        ..*demands
    };
    let judged = parallel::map_indices(candidates.len(), |i| {
        let design = law(&candidates[i]);
        let judgement = judge(&design, linear, demands);
        let expected = judgement
            .expected_um()
            .hypot(judge(&design, linear, &slow).disturbance_um);
        judgement
            .accepted
            .then_some((expected, candidates[i], judgement))
    });
    judged
        .into_iter()
        .flatten()
        .min_by(|x, y| x.0.total_cmp(&y.0))
        .map(|(_, gains, judgement)| (gains, judgement))
}

/// Assesses one tuning.
#[must_use]
pub fn assess(linear: &LinearModel, tuning: &PredictorTuning, demands: &Demands) -> Assessment {
    let TuningJudgement {
        noise_um,
        disturbance_um,
        margins,
        accepted,
    } = judge(&PredictorDesign::new(linear, tuning), linear, demands);
    Assessment {
        tuning: *tuning,
        noise_um,
        disturbance_um,
        margins,
        accepted,
    }
}

/// Judges a law on the model that it was designed for: what it lets through, and its margins.
#[must_use]
pub fn judge(design: &PredictorDesign, linear: &LinearModel, demands: &Demands) -> TuningJudgement {
    let plant = linear.sampled();
    let radius = |model: &LinearModel, gain: f64, delay: usize| {
        design.spectral_radius(&model.sampled(), gain, delay)
    };
    let other_mode = match linear.second_mode {
        Some((share, mode)) => {
            let lower = ModeModel {
                natural_frequency_rad_s: 0.9 * mode.natural_frequency_rad_s,
                ..mode
            };
            LinearModel {
                second_mode: Some((share, lower)),
                ..*linear
            }
        }
        None => LinearModel {
            second_mode: Some((
                0.02,
                ModeModel {
                    natural_frequency_rad_s: 6.0 * linear.first_mode.natural_frequency_rad_s,
                    damping_ratio: 0.02,
                },
            )),
            ..*linear
        },
    };
    let mut noise_power = 0.0;
    let mut sensitivity_peak = 0.0f64;
    let points = 200;
    for i in 0..points {
        let omega = std::f64::consts::PI / linear.period_s * (i as f64 + 0.5) / points as f64;
        let (_, noise) = design.sensitivities(&plant, omega);
        noise_power += noise.norm_sqr() / points as f64;
        sensitivity_peak = sensitivity_peak.max((noise + 1.0).norm());
    }
    let mut disturbance_power = 0.0;
    for (harmonic, share) in [(1.0, 1.0), (2.0, 0.5), (3.0, 0.33), (5.0, 0.2)] {
        let (unknown, _) = design.sensitivities(
            &plant,
            std::f64::consts::TAU * demands.reference_hz * harmonic,
        );
        disturbance_power += (unknown.norm() * share * demands.model_error_um).powi(2);
    }
    let margins = Margins {
        nominal: design.spectral_radius(&plant, 1.0, 0),
        gain_half: design.spectral_radius(&plant, 0.5, 0),
        gain_plus_half: design.spectral_radius(&plant, 1.5, 0),
        delay: radius(linear, 1.0, 1),
        mass_double: radius(&linear.with_mass_ratio(2.0), 1.0, 0),
        second_mode: radius(&other_mode, 1.0, 0),
        sensitivity_peak,
    };
    let worst = [
        margins.nominal,
        margins.gain_half,
        margins.gain_plus_half,
        margins.delay,
        margins.mass_double,
        margins.second_mode,
    ]
    .into_iter()
    .fold(0.0, f64::max);
    TuningJudgement {
        noise_um: noise_power.sqrt() * demands.sensor_noise_um,
        disturbance_um: disturbance_power.sqrt(),
        margins,
        accepted: worst < 1.0 && sensitivity_peak <= demands.sensitivity_peak,
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
    let mut out: Vec<Assessment> =
        parallel::map(&candidates, |tuning| assess(linear, tuning, demands));
    out.sort_by(|x, y| {
        y.accepted
            .cmp(&x.accepted)
            .then(x.expected_um().total_cmp(&y.expected_um()))
    });
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A light stage whose mode is slow beside the sampling, read with little noise: what is asked of the
    /// observer in units of the mode has no place in the tick, and in other units of its states has; it is
    /// the same law.
    #[test]
    fn a_law_that_does_not_fit_in_one_unit_of_its_states_fits_in_another() {
        let linear = LinearModel {
            first_mode: ModeModel {
                natural_frequency_rad_s: 2387.6,
                damping_ratio: 0.02,
            },
            second_mode: None,
            amplifier_bandwidth_hz: None,
            sensor_bandwidth_hz: None,
            period_s: 5e-5,
        };
        let tuning = PredictorTuning {
            unknown_change_um: 0.05,
            force_noise_um: 5.0,
            sensor_noise_um: 0.0005,
            ..PredictorTuning::START
        };
        let law = PredictorDesign::new(&linear, &tuning);
        assert!(law.as_it_stands().is_err(), "{}", law.l);
        let integers = law.quantised().unwrap();
        // From the integers back: the answer of the drive to the reading is the same.
        let rows = integers
            .state_rows
            .map(|row| row.coefficients.map(|c| f64::from(c) / 2f64.powi(27)));
        let mut again = law.clone();
        for (i, row) in rows.iter().enumerate() {
            (0..predictor_law::STATES).for_each(|j| again.a[(i, j)] = row[j]);
            (again.l[i], again.b[i]) = (row[6], row[7]);
            again.a[(i, STATES - 1)] = row[7];
            again.c[i] = f64::from(integers.reading_row.coefficients[i]) / 2f64.powi(27);
            again.k[i] = f64::from(integers.gain_row.coefficients[i]) / 2f64.powi(24);
        }
        for hz in [10.0, 150.0, 380.0, 2000.0, 9000.0] {
            let [a, b] = [&law, &again].map(|law| crate::servo::robust::law_response(law, hz));
            assert!((a - b).norm() < 1e-4 * a.norm(), "{hz} Hz: {a} {b}");
        }
        let multiplied = law.multipliers();
        assert!(
            multiplied.iter().all(|m| *m <= 1.0) && multiplied.iter().any(|m| *m < 1.0),
            "{multiplied:?}"
        );
    }

    /// Two light modes: nothing moves between them at 745 Hz, and the feedforward follows slower references
    /// all the same.
    #[test]
    fn a_feedforward_fits_where_nothing_moves_between_two_modes_and_where_the_mode_is_slow() {
        let of = |second: bool, first_hz: f64| LinearModel {
            first_mode: ModeModel {
                natural_frequency_rad_s: std::f64::consts::TAU * first_hz,
                damping_ratio: 0.02,
            },
            second_mode: second.then_some((
                0.1,
                ModeModel {
                    natural_frequency_rad_s: 5654.9,
                    damping_ratio: 0.02,
                },
            )),
            amplifier_bandwidth_hz: None,
            sensor_bandwidth_hz: None,
            period_s: 5e-5,
        };
        for (linear, hz, most) in [
            (of(true, 380.0), 20.0, 1e-3),
            (of(true, 380.0), 150.0, 0.01),
            (of(false, 150.0), 20.0, 5e-3),
        ] {
            let model = linear.sampled();
            let taps = feedforward(&model);
            assert!(taps.iter().map(|t| t.abs()).sum::<f64>() < LARGEST_TAPS);
            let missed = missed_of_reference(&model, &taps, hz);
            assert!(missed < most, "{linear:?} {hz} Hz: {missed}");
        }
    }

    /// Closed forms: a Jordan block, where eigenvalues need not be found, and a turn with a radius of its
    /// own.
    #[test]
    fn growth_is_the_largest_eigenvalue_without_eigenvalues() {
        let defective = DMatrix::from_fn(4, 4, |i, j| {
            f64::from(u8::from(j == i + 1)) + if i == j { 0.99 } else { 0.0 }
        });
        assert!((growth(defective) - 0.99).abs() < 1e-8);
        let (sin, cos) = 0.7f64.sin_cos();
        let turning = DMatrix::from_row_slice(
            3,
            3,
            &[
                1.01 * cos,
                -1.01 * sin,
                5.0,
                1.01 * sin,
                1.01 * cos,
                0.0,
                0.0,
                0.0,
                0.5,
            ],
        );
        assert!((growth(turning) - 1.01).abs() < 1e-8);
        assert!(growth(DMatrix::zeros(2, 2)) < 1e-300);
    }
}
