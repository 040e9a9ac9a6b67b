//! The filters by which the correction of a periodic reference is learned (core:
//! [`hysteron_core::learned_feedforward`]), and the proof that learning converges.
//!
//! # How it works
//! A correction that is added to the reference reaches the motion through `T = 1 + S (P F - 1)`: `P` the
//! sampled actuator, `F` the law's feedforward, `S` the sensitivity. From period to period an error
//! becomes `Q (1 - L T)` times itself, so learning converges where that is below one at every frequency,
//! and a long period makes it neither better nor worse. `T` is computed for every plant of a set (gain,
//! modes and their damping moved) and bounded for any missing response that the recording does not
//! exclude: `|dT| <= W |F + K| |S|^2 / (1 - W |K S|)`, `W` as in [`super::robust`].
//!
//! * `F`: the feedforward of a law that learns, least squares of `S (P F - 1)` over the set. What cannot be
//!   learned is at least fed forward.
//! * `L`: least squares of `1 - L T` over the set, with the bound as a weight on `L`, on taps that look as
//!   far ahead as back. Where the set's responses disagree `L` becomes small by itself.
//! * `Q`: as near 1 as its taps allow, and below where the worst `|1 - L T|` of the set is not well below
//!   one. What is not learned must not grow either: `(1 - Q) / (1 - Q |1 - L T|)`, how much of the error is
//!   left for good, stays below [`MOST_LEFT`].
//!
//! All are rounded to the tick's integers here, and what is shown is the convergence of the rounded ones.

use super::law::PredictorDesign;
use super::model::{LinearModel, ModeModel, is_usual_period, usual_period_s};
use super::plant_set::PlantVariation;
use super::quantise::{QuantisationError, number, row_um};
use super::robust::{LEAST_DAMPING_SPREAD, ModeSpread, Task};
use super::sampled_loop::{FrequencyGrid, frequency_response, law_response, reference_response};
use hysteron_core::learned_feedforward::{
    LEARNING_FRACTION_BITS, LEARNING_TAPS, LearningParameters, POINT_FRACTION_BITS,
    ROBUSTNESS_FRACTION_BITS, ROBUSTNESS_TAPS,
};
use hysteron_core::predictor_law::OUTPUT_ROW_FRACTION_BITS;
use hysteron_core::reference_window::{PREVIEW_TICKS, WINDOW};
use nalgebra::{Complex, DMatrix, DVector};
use serde::{Deserialize, Serialize};
use std::f64::consts::{PI, TAU};

/// Learning must stand modes that are this share off, however well they are believed to be known.
pub const LEAST_FREQUENCY_SPREAD: f64 = 0.055;
/// Most positions of a mode to either side of its own.
const MOST_STEPS: f64 = 6.0;
/// The gain of the actuator may be off by this share.
pub const GAIN_SPREAD: f64 = 0.1;
/// Largest sensitivity of a loop that learns: what a loop answers more sharply leaves less of the band to be
/// learned in, and passes more noise on.
pub const SENSITIVITY_PEAK: f64 = 2.0;
/// At a frequency of which nothing is learned the error may become this many times as large.
pub const MOST_LEFT: f64 = 1.25;
/// `|Q (1 - L T)|` is kept below this.
const CONTRACTION: f64 = 0.9;
/// Share of the travel beyond which an error is not learned from.
const ERROR_LIMIT: f64 = 0.05;
/// Share of the travel that a correction may take.
const CORRECTION_LIMIT: f64 = 0.05;
/// Largest correction that the points hold, um.
const LARGEST_POINT_UM: f64 = 0.99;
/// Two periods are learned wholly, two by half, two by a quarter ...
const PERIODS_PER_HALVING: u8 = 2;
/// ... and then by an eighth: noise is averaged over some fifteen periods.
const MOST_HALVINGS: u8 = 3;
/// Weight on the taps of `L`, over the mean power of what they filter: without it they grow where the loop
/// hardly answers, and with a third of it an error can grow slowly. Three times as much, and again, where the
/// taps are too large.
const TAP_WEIGHT: f64 = 3e-3;
/// Largest sum of the magnitudes of `L`'s taps: the tick's format ends at 128.
const LARGEST_SUM: f64 = 100.0;
/// Below this, Hz, a reference is reckoned with as with this: power per frequency falls with its square,
/// between that of steps and that of corners.
const REFERENCE_HZ: f64 = 100.0;
/// Standard deviations in the bound on what may be missing.
const DEVIATIONS_OF_MISSING: f64 = 3.0;
/// Weight of rest in the feedforward, over that of all frequencies.
const AT_REST: f64 = 1e6;
/// Weight on the taps of the feedforward, over the mean power of what they filter; three times as much, and
/// again, where the taps are too large.
const LEAST_RIDGE: f64 = 1e-9;
/// Rounds in which weights are moved until `Q` is within what is allowed.
const MOST_ROUNDS: usize = 400;
/// Points of the grid on which `Q` is shaped.
const POINTS: usize = 500;

/// Convergence at one frequency.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ConvergencePoint {
    /// Frequency, Hz.
    pub hz: f64,
    /// `Q`.
    pub robustness: f64,
    /// `|1 - L T|` on the model.
    pub nominal: f64,
    /// The largest over the set, with what the recording does not exclude.
    pub worst: f64,
}

impl ConvergencePoint {
    /// What an error becomes in a period, at worst.
    #[must_use]
    pub fn contraction(&self) -> f64 {
        self.robustness.abs() * self.worst
    }
}

/// The filters in f64, rounded to the tick's integers, and their convergence.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LearningDesign {
    /// `L` from the error 31 samples before a point to the one 32 samples after it, um/um.
    pub learning: Vec<f64>,
    /// `Q` from 32 samples before (zero) to 31 after.
    pub robustness: Vec<f64>,
    /// Feedforward over the reference window, um/um, in the place of the law's own, which ends at some 900
    /// Hz; empty: the law's own.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub feedforward: Vec<f64>,
    /// Nothing is learned from errors beyond this, um.
    pub error_limit_um: f64,
    /// Largest correction, um.
    pub correction_limit_um: f64,
    /// Periods after which the learned share is halved.
    pub periods_per_halving: u8,
    /// How often it is.
    pub most_halvings: u8,
    /// Number of plants of the set.
    pub plants: usize,
    /// Sampling period of the loop, s.
    #[serde(default = "usual_period_s", skip_serializing_if = "is_usual_period")]
    pub period_s: f64,
    /// The proof.
    pub convergence: Vec<ConvergencePoint>,
}

/// What learning meets at a frequency.
struct Met {
    hz: f64,
    /// `T` on the model.
    nominal: Complex<f64>,
    /// `T` over the set.
    set: Vec<Complex<f64>>,
    /// Bound on what may be missing of it.
    missing: f64,
}

/// `sum c_i e^(j w T (i - before))`.
fn response(taps: &[f64], before: usize, period_s: f64, hz: f64) -> Complex<f64> {
    let step = TAU * hz * period_s;
    taps.iter()
        .enumerate()
        .map(|(i, c)| Complex::from_polar(*c, step * (i as f64 - before as f64)))
        .sum()
}

/// Samples before the point that the first tap of `L` weighs.
const LEARNING_BEFORE: usize = LEARNING_TAPS / 2 - 1;
/// Samples before the point that the first tap of `Q` weighs.
const ROBUSTNESS_BEFORE: usize = ROBUSTNESS_TAPS / 2;

/// The answer of the motion to a correction of the reference, `T`, on an actuator with this response.
#[must_use]
pub fn from_correction(law: &PredictorDesign, plant: Complex<f64>, hz: f64) -> Complex<f64> {
    reference_response(plant, law.feedforward_response(hz), law_response(law, hz))
}

/// A law with another feedforward, if there is one.
fn with_feedforward(law: &PredictorDesign, feedforward: &[f64]) -> PredictorDesign {
    let mut out = law.clone();
    if !feedforward.is_empty() {
        out.feedforward = feedforward.to_vec();
    }
    out
}

/// Where a mode may stand, from its lowest frequency to its highest: so close together that its peak is not
/// between two of them.
fn positions(mode: ModeModel, spread: ModeSpread) -> Vec<ModeModel> {
    let widest = spread.frequency.max(LEAST_FREQUENCY_SPREAD);
    let damping_ratio = mode.damping_ratio * (1.0 - spread.damping);
    let steps = (widest / (2.0 * damping_ratio))
        .ceil()
        .clamp(1.0, MOST_STEPS) as i32;
    (-steps..=steps)
        .map(|i| ModeModel {
            natural_frequency_rad_s: mode.natural_frequency_rad_s
                * (1.0 + widest * f64::from(i) / f64::from(steps)),
            damping_ratio: if i == 0 {
                mode.damping_ratio
            } else {
                damping_ratio
            },
        })
        .collect()
}

/// The plants of the set: every combination of gain and moved modes.
fn plants(task: &Task<'_>) -> Vec<(f64, LinearModel)> {
    let second: Vec<_> = match (task.linear.second_mode, task.second) {
        (Some((share, mode)), Some(spread)) => positions(mode, spread)
            .into_iter()
            .map(|mode| Some((share, mode)))
            .collect(),
        (second, _) => vec![second],
    };
    let mut out = Vec::new();
    for gain in [1.0 - GAIN_SPREAD, 1.0, 1.0 + GAIN_SPREAD] {
        for first_mode in positions(task.linear.first_mode, task.first) {
            out.extend(second.iter().map(|second_mode| {
                (
                    gain,
                    LinearModel {
                        first_mode,
                        second_mode: *second_mode,
                        ..task.linear
                    },
                )
            }));
        }
    }
    out
}

/// Frequencies at which learning is looked at, Hz: those of the loop, and the peaks of all plants.
fn grid_hz(task: &Task<'_>, plants: &[(f64, LinearModel)]) -> Vec<f64> {
    let mut grid = FrequencyGrid::about_modes(&task.linear).hz;
    let highest_hz = grid.last().copied().unwrap_or(0.0);
    for (_, linear) in plants {
        for mode in
            std::iter::once(linear.first_mode).chain(linear.second_mode.map(|(_, mode)| mode))
        {
            let around = (-2..=2).map(|i| {
                mode.natural_frequency_rad_s / TAU
                    * (1.0 + mode.damping_ratio.min(0.1) * f64::from(i))
            });
            grid.extend(around.filter(|hz| *hz < highest_hz));
        }
    }
    grid.sort_by(f64::total_cmp);
    // Plants share their modes.
    grid.dedup_by(|a, b| *a - *b < 1e-4 * *b);
    grid
}

fn met(law: &PredictorDesign, task: &Task<'_>, plants: &[(f64, LinearModel)]) -> Vec<Met> {
    let sampled = |gain: f64, linear: &LinearModel| {
        PlantVariation {
            gain,
            delay_s: task.delay_s,
            ..PlantVariation::NONE
        }
        .sampled(linear)
    };
    let nominal = sampled(1.0, &task.linear);
    let set: Vec<_> = plants
        .iter()
        .map(|(gain, linear)| sampled(*gain, linear))
        .collect();
    let one = Complex::new(1.0, 0.0);
    crate::parallel::map(&grid_hz(task, plants), |hz| {
        let hz = *hz;
        let p = frequency_response(&nominal, TAU * hz);
        let k = law_response(law, hz);
        let s = one / (one + p * k);
        let feedforward = law.feedforward_response(hz);
        let unknown = task.unknown_at(hz);
        let reserve = (1.0 - unknown * (k * s).norm()).max(0.05);
        Met {
            hz,
            nominal: from_correction(law, p, hz),
            set: set
                .iter()
                .map(|plant| from_correction(law, frequency_response(plant, TAU * hz), hz))
                .collect(),
            missing: unknown * (feedforward + k).norm() * s.norm_sqr() / reserve,
        }
    })
}

/// `L`: least squares over the set, with as much weight on its taps as it takes to bring their sum below
/// [`LARGEST_SUM`]: noise near half the sampling rate is what they would otherwise be spent on.
fn learning_taps(met: &[Met], period_s: f64) -> Option<Vec<f64>> {
    let (a, b) = normal_equations(met, period_s);
    let mean = a.trace() / LEARNING_TAPS as f64;
    (0..12).find_map(|nth| {
        let weight = mean * TAP_WEIGHT * 3f64.powi(nth);
        let taps = (&a + DMatrix::identity(LEARNING_TAPS, LEARNING_TAPS) * weight)
            .cholesky()?
            .solve(&b);
        (taps.lp_norm(1) < LARGEST_SUM).then(|| taps.as_slice().to_vec())
    })
}

/// Power of a reference at a frequency, over that at [`REFERENCE_HZ`] and below.
fn of_references(hz: f64) -> f64 {
    (REFERENCE_HZ / hz.max(REFERENCE_HZ)).powi(2)
}

/// The feedforward: taps over the reference window with the least `|S (P F - 1)|^2` over the set, weighted as
/// a reference falls. The law's own is the model's inverse up to 900 Hz and fades from there, and what lies
/// above and is not learned is then not followed at all. What may be missing counts with its standard
/// deviation, so that `F` is small by itself where nothing is known. Gains that are off to either side do not
/// take part: they would make it smaller everywhere; nor do modes that are further off than a model has to be
/// reckoned with anyway. Empty where no such taps fit the tick, or where on the model itself they would leave
/// more of such a reference than the law's own.
fn wide_feedforward(law: &PredictorDesign, task: &Task<'_>) -> Vec<f64> {
    let one = Complex::new(1.0, 0.0);
    let near = |spread: ModeSpread| ModeSpread {
        frequency: LEAST_FREQUENCY_SPREAD,
        damping: spread.damping.min(LEAST_DAMPING_SPREAD),
    };
    let near = Task {
        first: near(task.first),
        second: task.second.map(near),
        ..*task
    };
    let plants: Vec<_> = plants(&near)
        .into_iter()
        .filter(|(gain, _)| *gain == 1.0)
        .collect();
    let sampled = |linear: &LinearModel| PlantVariation::with_delay_s(task.delay_s).sampled(linear);
    let set: Vec<_> = plants.iter().map(|(_, linear)| sampled(linear)).collect();
    let nominal = sampled(&task.linear);
    let before = (WINDOW - PREVIEW_TICKS) as f64;
    let grid = grid_hz(&near, &plants);
    let rows: Vec<(f64, f64, Complex<f64>, f64)> = crate::parallel::map(&grid, |hz| {
        let k = law_response(law, *hz);
        let (mut mean, mut power, mut sensitive) = (Complex::new(0.0, 0.0), 0.0, 0.0);
        for plant in &set {
            let p = frequency_response(plant, TAU * hz);
            let s = (one / (one + p * k)).norm_sqr();
            mean += p.conj() * s;
            power += p.norm_sqr() * s;
            sensitive += s;
        }
        let n = set.len().max(1) as f64;
        let missing = task.unknown_at(*hz) / DEVIATIONS_OF_MISSING;
        (
            *hz,
            power / n + missing.powi(2) * sensitive / n,
            mean / n,
            of_references(*hz),
        )
    });
    let mut a = DMatrix::<f64>::zeros(WINDOW, WINDOW);
    let mut b = DVector::<f64>::zeros(WINDOW);
    let mut add = |hz: f64, power: f64, target: Complex<f64>, weight: f64| {
        let step = TAU * hz * law.period_s;
        for i in 0..WINDOW {
            // |P F - 1|: the real part of conj(P e_i).
            b[i] += weight * (Complex::from_polar(1.0, -step * (i as f64 - before)) * target).re;
            for j in 0..WINDOW {
                a[(i, j)] += weight * power * (step * (i as f64 - j as f64)).cos();
            }
        }
    };
    let (mut last_hz, mut total) = (0.0, 0.0);
    for (hz, power, target, weight) in &rows {
        add(*hz, *power, *target, weight * (hz - last_hz));
        total += power * weight * (hz - last_hz);
        last_hz = *hz;
    }
    // What stands still must be met to the last digit.
    add(0.0, 1.0, one, AT_REST * total.max(f64::MIN_POSITIVE));
    let found = (0..20).find_map(|nth| {
        let ridge = total * LEAST_RIDGE * 3f64.powi(nth);
        let taps = (&a + DMatrix::identity(WINDOW, WINDOW) * ridge)
            .cholesky()?
            .solve(&b);
        (taps.lp_norm(1) < LARGEST_SUM).then(|| taps.as_slice().to_vec())
    });
    // What is left of a reference on the model itself.
    let left = |law: &PredictorDesign| {
        let (mut sum, mut last_hz) = (0.0, 0.0);
        for hz in &grid {
            let t = from_correction(law, frequency_response(&nominal, TAU * hz), *hz);
            sum += (one - t).norm_sqr() * of_references(*hz) * (hz - last_hz);
            last_hz = *hz;
        }
        sum
    };
    found
        .filter(|taps| left(&with_feedforward(law, taps)) < left(law))
        .unwrap_or_default()
}

fn normal_equations(met: &[Met], period_s: f64) -> (DMatrix<f64>, DVector<f64>) {
    let mut a = DMatrix::<f64>::zeros(LEARNING_TAPS, LEARNING_TAPS);
    let mut b = DVector::<f64>::zeros(LEARNING_TAPS);
    let mut last_hz = 0.0;
    for here in met {
        let count = here.set.len().max(1) as f64;
        let mean: Complex<f64> = here.set.iter().sum::<Complex<f64>>() / count;
        let power =
            here.set.iter().map(|t| t.norm_sqr()).sum::<f64>() / count + here.missing.powi(2);
        // What cannot be learned anyway must not spoil what can.
        let weight = (mean.norm() / here.missing.max(1e-12)).min(1.0) * (here.hz - last_hz);
        last_hz = here.hz;
        let step = TAU * here.hz * period_s;
        let cosines: Vec<f64> = (0..LEARNING_TAPS)
            .map(|lag| weight * power * (step * lag as f64).cos())
            .collect();
        for i in 0..LEARNING_TAPS {
            let turned =
                Complex::from_polar(1.0, step * (i as f64 - LEARNING_BEFORE as f64)) * mean;
            b[i] += weight * turned.re;
            for k in 0..LEARNING_TAPS {
                a[(i, k)] += cosines[i.abs_diff(k)];
            }
        }
    }
    (a, b)
}

/// The least and the largest `Q` where `|1 - L T|` is at most `worst`: with them an error that is not learned
/// becomes at most [`MOST_LEFT`] times itself, and others fall from period to period.
fn allowed(worst: f64) -> (f64, f64) {
    let converging = (CONTRACTION / worst.max(1e-9)).min(1.0);
    // (1 - Q) / (1 - |Q| worst) <= MOST_LEFT, for either sign of Q.
    let largest = if worst > 1.0 {
        (MOST_LEFT - 1.0) / (MOST_LEFT * worst - 1.0)
    } else {
        1.0
    };
    let least = (MOST_LEFT - 1.0) / (1.0 + MOST_LEFT * worst);
    (-least.min(converging), largest.min(converging))
}

/// `Q`: symmetric taps with the least that is left for good, over the set and over references with corners,
/// within what is allowed. Least squares in which every frequency that is not within its limits gets a larger
/// weight on the nearer limit until all are.
fn robustness_taps(judged: &[Judged], period_s: f64) -> Vec<f64> {
    let half = ROBUSTNESS_TAPS / 2;
    let step_hz = 0.5 / period_s / POINTS as f64;
    /// A frequency: `Q` there from the taps, what is allowed, the weight on one, and the weight on the nearer
    /// limit.
    struct Point {
        cosines: Vec<f64>,
        limits: (f64, f64),
        weight: f64,
        held: f64,
    }
    let at = |cosines: &[f64], taps: &[f64]| -> f64 {
        cosines.iter().zip(taps).map(|(c, t)| c * t).sum()
    };
    let mut points: Vec<Point> = (0..POINTS)
        .map(|i| {
            let hz = (i as f64 + 0.5) * step_hz;
            let near = || {
                judged
                    .iter()
                    .filter(|here| (here.hz - hz).abs() <= 1.5 * step_hz)
            };
            let limits = near()
                .map(|here| allowed(here.worst))
                .fold((-1.0_f64, 1.0_f64), |(least, largest), (a, b)| {
                    (least.max(a), largest.min(b))
                });
            let missed = near().map(|here| here.missed).sum::<f64>() / near().count().max(1) as f64;
            let cosines = (0..half)
                .map(|k| {
                    if k == 0 {
                        1.0
                    } else {
                        2.0 * (PI * (i as f64 + 0.5) * k as f64 / POINTS as f64).cos()
                    }
                })
                .collect();
            Point {
                cosines,
                limits,
                weight: (missed + 1e-4) * of_references(hz),
                held: 0.0,
            }
        })
        .collect();
    let largest_weight = points.iter().map(|p| p.weight).fold(0.0, f64::max);
    points
        .iter_mut()
        .for_each(|p| p.weight = p.weight / largest_weight + 1e-6);
    let mut taps = vec![0.0; half];
    for _ in 0..MOST_ROUNDS {
        let mut a = DMatrix::<f64>::identity(half, half) * 1e-9;
        let mut b = DVector::<f64>::zeros(half);
        let mut add = |cosines: &[f64], target: f64, weight: f64| {
            for i in 0..half {
                b[i] += weight * target * cosines[i];
                for k in 0..=i {
                    a[(i, k)] += weight * cosines[i] * cosines[k];
                }
            }
        };
        for p in &points {
            add(&p.cosines, 1.0, p.weight);
            if p.held > 0.0 {
                let q = at(&p.cosines, &taps);
                // A little inside.
                let target = if q > 0.5 * (p.limits.0 + p.limits.1) {
                    p.limits.1
                } else {
                    p.limits.0
                };
                add(&p.cosines, 0.98 * target, p.held);
            }
        }
        for i in 0..half {
            for k in 0..i {
                a[(k, i)] = a[(i, k)];
            }
        }
        let Some(solved) = a.cholesky() else { break };
        taps = solved.solve(&b).as_slice().to_vec();
        let mut all_within = true;
        for p in &mut points {
            let q = at(&p.cosines, &taps);
            let (least, largest) = p.limits;
            let beyond = (q - largest).max(least - q);
            if beyond > 0.01 * largest.min(-least) {
                all_within = false;
                p.held = (p.held * 1.5).max(1e-4);
            } else if p.held > 0.0 && beyond < -0.05 {
                p.held *= 0.7;
            }
        }
        if all_within {
            break;
        }
    }
    let mut out = vec![0.0; ROBUSTNESS_TAPS];
    for (k, tap) in taps.iter().enumerate() {
        out[ROBUSTNESS_BEFORE + k] = *tap;
        out[ROBUSTNESS_BEFORE - k] = *tap;
    }
    out
}

/// Convergence without `Q` at a frequency.
struct Judged {
    hz: f64,
    /// `|1 - L T|` on the model.
    nominal: f64,
    /// The largest over the set and what may be missing.
    worst: f64,
    /// Mean power over the set of what a reference leaves without a correction, `|1 - T|^2`.
    missed: f64,
}

/// Rounded as the integers are.
fn rounded(taps: &[f64], fraction_bits: u32) -> Vec<f64> {
    let scale = 2f64.powi(fraction_bits as i32);
    taps.iter()
        .map(|tap| (tap * scale).round() / scale)
        .collect()
}

impl LearningDesign {
    /// For a law and all plants that a task leaves possible. `travel_um`: the motion over the whole drive,
    /// which limits errors and corrections.
    ///
    /// # Errors
    /// A message that says why nothing can be learned.
    pub fn new(law: &PredictorDesign, task: &Task<'_>, travel_um: f64) -> Result<Self, String> {
        let period_s = task.linear.period_s;
        let plants = plants(task);
        let feedforward = rounded(&wide_feedforward(law, task), OUTPUT_ROW_FRACTION_BITS);
        let law = &with_feedforward(law, &feedforward);
        let met = met(law, task, &plants);
        let taps = learning_taps(&met, period_s)
            .ok_or("no learning filter: the loop answers a correction too little, or its response is no number")?;
        let learning = rounded(&taps, LEARNING_FRACTION_BITS);
        let one = Complex::new(1.0, 0.0);
        let judged: Vec<Judged> = met
            .iter()
            .map(|here| {
                let l = response(&learning, LEARNING_BEFORE, period_s, here.hz);
                let left = |t: &Complex<f64>| (one - l * t).norm();
                let worst = here.set.iter().map(left).fold(0.0, f64::max) + l.norm() * here.missing;
                let missed = here.set.iter().map(|t| (one - t).norm_sqr()).sum::<f64>()
                    / here.set.len().max(1) as f64;
                Judged {
                    hz: here.hz,
                    nominal: left(&here.nominal),
                    worst,
                    missed,
                }
            })
            .collect();
        let robustness = rounded(
            &robustness_taps(&judged, period_s),
            ROBUSTNESS_FRACTION_BITS,
        );
        let convergence: Vec<ConvergencePoint> = judged
            .iter()
            .map(|here| ConvergencePoint {
                hz: here.hz,
                robustness: response(&robustness, ROBUSTNESS_BEFORE, period_s, here.hz).re,
                nominal: here.nominal,
                worst: here.worst,
            })
            .collect();
        let out = Self {
            learning,
            robustness,
            feedforward,
            error_limit_um: ERROR_LIMIT * travel_um,
            correction_limit_um: (CORRECTION_LIMIT * travel_um).min(LARGEST_POINT_UM),
            periods_per_halving: PERIODS_PER_HALVING,
            most_halvings: MOST_HALVINGS,
            plants: plants.len(),
            period_s,
            convergence,
        };
        let (contraction, hz) = out.worst_contraction();
        if contraction.is_nan() || contraction >= 1.0 {
            return Err(format!(
                "learning would not converge: |Q (1 - L T)| is {contraction:.2} at {hz:.0} Hz"
            ));
        }
        if out.learns_to_hz() <= 0.0 {
            return Err(format!("nothing can be learned: {}", out.what_closes()));
        }
        Ok(out)
    }

    /// A law with the feedforward that its corrections are learned with.
    #[must_use]
    pub fn fed_forward(&self, law: &PredictorDesign) -> PredictorDesign {
        with_feedforward(law, &self.feedforward)
    }

    /// Largest `|Q (1 - L T)|` of the set, and where, Hz.
    #[must_use]
    pub fn worst_contraction(&self) -> (f64, f64) {
        let worst = self.convergence.iter().map(|p| (p.contraction(), p.hz));
        worst
            .max_by(|a, b| a.0.total_cmp(&b.0))
            .unwrap_or((f64::NAN, 0.0))
    }

    /// The frequency up to which more than half is learned, Hz.
    #[must_use]
    pub fn learns_to_hz(&self) -> f64 {
        self.convergence
            .iter()
            .take_while(|p| p.robustness > 0.5)
            .last()
            .map_or(0.0, |p| p.hz)
    }

    /// Largest `|Q (1 - L T)|` on an actuator, its gain multiplied, and where, Hz.
    #[must_use]
    pub fn contraction_on(
        &self,
        law: &PredictorDesign,
        linear: &LinearModel,
        gain: f64,
        delay_s: f64,
    ) -> (f64, f64) {
        let plant = PlantVariation {
            gain,
            delay_s,
            ..PlantVariation::NONE
        }
        .sampled(linear);
        let law = &self.fed_forward(law);
        let at = |hz: f64| {
            let t = from_correction(law, frequency_response(&plant, TAU * hz), hz);
            let left = Complex::new(1.0, 0.0)
                - response(&self.learning, LEARNING_BEFORE, self.period_s, hz) * t;
            (left * response(&self.robustness, ROBUSTNESS_BEFORE, self.period_s, hz)).norm()
        };
        let grid = FrequencyGrid::about_modes(linear);
        let all = grid.hz.into_iter().map(|hz| (at(hz), hz));
        all.max_by(|a, b| a.0.total_cmp(&b.0))
            .unwrap_or((f64::NAN, 0.0))
    }

    /// Why nothing is learned beyond [`Self::learns_to_hz`]: the first frequency at which a correction could
    /// make an error worse.
    #[must_use]
    pub fn what_closes(&self) -> String {
        let apart_hz = 1.0 / (ROBUSTNESS_TAPS as f64 * self.period_s);
        self.convergence.iter().find(|p| p.worst >= 1.0).map_or_else(
            || "the filter that decides what is learned is closed".to_owned(),
            |p| {
                format!(
                    "at {:.0} Hz a correction may leave {:.2} times the error that it is to remove, on a plant of the set or with a response that nothing excludes, and {ROBUSTNESS_TAPS} taps do not tell that from what is up to {apart_hz:.0} Hz away",
                    p.hz, p.worst
                )
            },
        )
    }

    /// What a reader should know.
    #[must_use]
    pub fn in_words(&self) -> String {
        if self.learns_to_hz() <= 0.0 {
            return format!(
                "Nothing of a periodic reference is learned: {}.",
                self.what_closes()
            );
        }
        let (contraction, hz) = self.worst_contraction();
        format!(
            "The correction of a periodic reference is learned up to {:.0} Hz: from period to period an error becomes at most {contraction:.2} times itself (at {hz:.0} Hz) on each of {} plants with any missing response that is not excluded. Nothing is learned while the drive is at a limit or the error beyond {:.2} um; a correction is at most {:.2} um.",
            self.learns_to_hz(),
            self.plants,
            self.error_limit_um,
            self.correction_limit_um
        )
    }

    /// The integers of the tick.
    ///
    /// # Errors
    /// If a tap does not fit.
    pub fn quantised(&self) -> Result<LearningParameters, QuantisationError> {
        let point_bits = POINT_FRACTION_BITS as i32;
        let limit = number("largest correction", self.correction_limit_um, point_bits)?;
        Ok(LearningParameters {
            learning: row_um("learning filter", &self.learning)?,
            robustness: row_um("robustness filter", &self.robustness)?,
            error_limit: number(
                "largest error that is learned from",
                self.error_limit_um,
                24,
            )?,
            point_limit: i16::try_from(limit).map_err(|_| QuantisationError {
                what: "largest correction".into(),
                value: self.correction_limit_um,
                limit: f64::from(i16::MAX) / 2f64.powi(point_bits),
            })?,
            periods_per_halving: self.periods_per_halving,
            most_halvings: self.most_halvings,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::super::model::{SAMPLING_PERIOD_S, SampledModel};
    use super::super::recording::ServoRecording;
    use super::super::tuning::{Demands, PredictorTuning};
    use super::*;

    fn linear() -> LinearModel {
        LinearModel {
            first_mode: ModeModel {
                natural_frequency_rad_s: 5300.0,
                damping_ratio: 0.6,
            },
            second_mode: Some((
                0.03,
                ModeModel {
                    natural_frequency_rad_s: 25_000.0,
                    damping_ratio: 0.02,
                },
            )),
            amplifier_bandwidth_hz: None,
            sensor_bandwidth_hz: None,
            period_s: 5e-5,
        }
    }

    fn law() -> PredictorDesign {
        PredictorDesign::new(
            &linear(),
            &PredictorTuning {
                effort_weight: 0.3,
                ..PredictorTuning::START
            },
        )
    }

    fn task() -> Task<'static> {
        let spread = ModeSpread {
            frequency: 0.02,
            damping: 0.2,
        };
        Task {
            linear: linear(),
            first: spread,
            second: Some(spread),
            left_out: None,
            delay_s: 0.0,
            recording: None,
            mode_moves: 0.0,
            mass_to: 2.0,
            demands: Demands::default(),
        }
    }

    /// Motion of the loop, sample by sample, when one sample of the reference is corrected by 1 um and
    /// nothing else is asked.
    fn after_one_corrected_sample(
        law: &PredictorDesign,
        plant: &SampledModel,
        at: usize,
        samples: usize,
    ) -> Vec<f64> {
        let correction = |k: i64| f64::from(u8::from(k == at as i64));
        let (mut x, mut z) = (DVector::zeros(plant.b.len()), DVector::zeros(law.b.len()));
        let mut feedforward = 0.0;
        let mut motion = Vec::new();
        for k in 0..samples as i64 {
            let y = plant.c.dot(&x);
            motion.push(y);
            let drive = feedforward - law.k.dot(&z);
            let innovation = y - correction(k) - law.c.dot(&z);
            z = &law.a * &z + &law.l * innovation - &law.b * law.k.dot(&z);
            x = &plant.a * &x + &plant.b * drive;
            feedforward = (0..WINDOW as i64)
                .map(|i| law.feedforward[i as usize] * correction(k + i - 7))
                .sum();
        }
        motion
    }

    #[test]
    fn the_answer_to_a_correction_is_that_of_the_loop_in_time() {
        let law = law();
        for gain in [1.0, 0.85] {
            let plant = PlantVariation::with_gain(gain).sampled(&linear());
            let motion = after_one_corrected_sample(&law, &plant, 40, 6000);
            for hz in [3.0, 100.0, 700.0, 2500.0, 3979.0, 8000.0] {
                let step = TAU * hz * SAMPLING_PERIOD_S;
                let seen: Complex<f64> = motion
                    .iter()
                    .enumerate()
                    .map(|(k, y)| Complex::from_polar(*y, -step * (k as f64 - 40.0)))
                    .sum();
                let computed = from_correction(&law, frequency_response(&plant, TAU * hz), hz);
                assert!(
                    (seen - computed).norm() < 1e-5 * (1.0 + seen.norm()),
                    "{hz} Hz: {seen} {computed}"
                );
            }
        }
    }

    #[test]
    fn corners_are_fed_forward_beyond_the_band_of_the_laws_own() {
        let (law, spread) = (
            law(),
            ModeSpread {
                frequency: 0.02,
                damping: 0.2,
            },
        );
        let known = Task {
            linear: LinearModel {
                second_mode: None,
                ..linear()
            },
            first: spread,
            second: None,
            ..task()
        };
        let plain = PredictorDesign::new(
            &known.linear,
            &PredictorTuning {
                effort_weight: 0.3,
                ..PredictorTuning::START
            },
        );
        // A recording that excludes whatever is larger than a thousandth.
        let lines: Vec<f64> = (2..1024).map(|i| f64::from(i) * 9.765_625).collect();
        let level = vec![1e-3; lines.len()];
        let recording = ServoRecording {
            blind: level.clone(),
            by_noise: level.clone(),
            missing: vec![0.0; level.len()],
            level,
            frequency_hz: lines,
            ..ServoRecording::default()
        };
        let design = LearningDesign::new(
            &plain,
            &Task {
                recording: Some(&recording),
                ..known
            },
            12.0,
        )
        .unwrap();
        let wide = design.fed_forward(&plain);
        let plant = PlantVariation::NONE.sampled(&LinearModel {
            second_mode: None,
            ..linear()
        });
        let missed = |law: &PredictorDesign, hz: f64| {
            (frequency_response(&plant, TAU * hz) * law.feedforward_response(hz)
                - Complex::new(1.0, 0.0))
            .norm()
        };
        assert!(
            missed(&wide, 0.01) < 1e-5,
            "at rest: {}",
            missed(&wide, 0.01)
        );
        for hz in [3000.0, 4000.0] {
            assert!(
                missed(&wide, hz) < 0.5 * missed(&plain, hz),
                "{hz} Hz: {} {}",
                missed(&wide, hz),
                missed(&plain, hz)
            );
        }
        assert!(wide.quantised().is_ok());
        // A design file without it feeds forward as the law does.
        assert_eq!(
            LearningDesign {
                feedforward: Vec::new(),
                ..design
            }
            .fed_forward(&law)
            .feedforward,
            law.feedforward
        );
    }

    #[test]
    fn what_must_not_be_learned_costs_little_of_what_may() {
        let narrow = |hz: f64| Judged {
            hz,
            nominal: 0.1,
            worst: if (1900.0..2100.0).contains(&hz) {
                2.0
            } else {
                0.2
            },
            missed: 1.0,
        };
        let judged: Vec<Judged> = (0..1000)
            .map(|i| narrow(10.0 * f64::from(i) + 5.0))
            .collect();
        let taps = robustness_taps(&judged, SAMPLING_PERIOD_S);
        assert!(
            taps[0] == 0.0
                && (1..ROBUSTNESS_TAPS)
                    .all(|i| taps[i].to_bits() == taps[ROBUSTNESS_TAPS - i].to_bits()),
            "symmetric"
        );
        let q = |hz: f64| response(&taps, ROBUSTNESS_BEFORE, SAMPLING_PERIOD_S, hz).re;
        for here in &judged {
            let (least, largest) = allowed(here.worst);
            assert!(
                q(here.hz) < 1.02 * largest && q(here.hz) > 1.02 * least,
                "{} Hz: {} of {largest}",
                here.hz,
                q(here.hz)
            );
        }
        // Where 64 smoothed taps would have lost half, 400 Hz from what must not be learned.
        assert!(
            q(1500.0) > 0.85 && q(2500.0) > 0.85 && q(300.0) > 0.95,
            "{} {} {}",
            q(1500.0),
            q(2500.0),
            q(300.0)
        );
    }

    #[test]
    fn learning_converges_and_ends_below_the_first_mode_where_nothing_is_known() {
        let design = LearningDesign::new(&law(), &task(), 12.0).unwrap();
        assert!(design.convergence.iter().all(|p| p.contraction() < 1.0));
        // Without a recording a mode may stand anywhere from the first one on, and little is learned there.
        assert!(
            design.learns_to_hz() > 100.0 && design.learns_to_hz() < 900.0,
            "{}",
            design.learns_to_hz()
        );
        let quantised = design.quantised().unwrap();
        assert!(quantised.accepted());
        // One that learns nothing says why, and not "up to 0 Hz".
        let closed = |p: &ConvergencePoint| ConvergencePoint {
            robustness: 0.1 * p.robustness,
            ..*p
        };
        let closed = LearningDesign {
            convergence: design.convergence.iter().map(closed).collect(),
            ..design.clone()
        };
        let said = closed.in_words();
        assert!(
            said.starts_with("Nothing of a periodic reference is learned: at ")
                && !said.contains("up to 0 Hz"),
            "{said}"
        );
        // On plants of the set it converges, and on one with its first mode elsewhere that is seen.
        let (on_model, _) = design.contraction_on(&law(), &linear(), 1.0, 0.0);
        let (on_other, _) = design.contraction_on(&law(), &linear(), 1.1, 0.0);
        assert!(on_model < 1.0 && on_other < 1.0, "{on_model} {on_other}");
        let slower = ModeModel {
            natural_frequency_rad_s: 2000.0,
            damping_ratio: 0.6,
        };
        let (far, _) = design.contraction_on(
            &law(),
            &LinearModel {
                first_mode: slower,
                ..linear()
            },
            1.0,
            0.0,
        );
        assert!(far > 1.0, "{far}");
    }

    /// The bound on what may be missing against plants that have it: another mode of 5 % at a damping ratio
    /// of 0.015, wherever it stands.
    #[test]
    fn a_mode_that_nobody_knows_of_neither_diverges_nor_makes_an_error_much_larger() {
        let design = LearningDesign::new(&law(), &task(), 12.0).unwrap();
        let law = design.fed_forward(&law());
        let one = Complex::new(1.0, 0.0);
        let (mut most_kept, mut most_left) = (0.0_f64, 0.0_f64);
        for mode_hz in [
            950.0, 1300.0, 1900.0, 2700.0, 3500.0, 4500.0, 6000.0, 7700.0, 9300.0,
        ] {
            let mode = ModeModel {
                natural_frequency_rad_s: TAU * mode_hz,
                damping_ratio: 0.015,
            };
            let plant = PlantVariation {
                mode: Some((0.05, mode)),
                ..PlantVariation::NONE
            }
            .sampled(&linear());
            // Others than those at which the filters were made, and close together about the mode.
            let about = (-20..=20).map(|i| mode_hz * (1.0 + 0.003 * f64::from(i)));
            for hz in (0..660).map(|i| 3.7 + 15.1 * f64::from(i)).chain(about) {
                let t = from_correction(&law, frequency_response(&plant, TAU * hz), hz);
                let q = response(&design.robustness, ROBUSTNESS_BEFORE, SAMPLING_PERIOD_S, hz);
                let kept = q
                    * (one
                        - response(&design.learning, LEARNING_BEFORE, SAMPLING_PERIOD_S, hz) * t);
                most_kept = most_kept.max(kept.norm());
                most_left = most_left.max(((one - q) / (one - kept)).norm());
            }
        }
        assert!(most_kept < 1.0, "from period to period: {most_kept}");
        assert!(most_left < 1.01 * MOST_LEFT, "in the end: {most_left}");
    }
}
