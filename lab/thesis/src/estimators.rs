//! Estimators of the velocity that the thesis argues against (Ch. 7, Sec. I), beside its PIDSMO: high-gain
//! observer, super-twisting differentiator, extended Kalman filter, alpha-beta filter; and the test by which
//! an unknown-input observer refuses the actuator.
//!
//! # How it works
//! Each estimator has one number that makes it faster and noisier. That number is chosen by the least RMS
//! error of the velocity on one record of the bench; phase lag, noise gain and error are then judged on other
//! records. The true velocity is the difference of the noise-free readings. The continuous estimators are
//! integrated by the classical Runge-Kutta rule, with the drive held and the reading running straight between
//! samples.

use crate::bench_runs::{equation_35_v, row_um};
use crate::chapter::ChapterRow;
use hysteron::servo::model::{NominalModel, SAMPLING_PERIOD_S};
use hysteron::servo::thesis_schemes::ObserverGains;
use hysteron::statistics::rms;
use hysteron_sim::bench::{Bench, BenchRecord, Start, Variant};
use hysteron_sim::noise::WhiteNoise;
use hysteron_sim::waveform;
use nalgebra::{Complex, DMatrix, SMatrix, SVector};
use rayon::prelude::*;
use std::f64::consts::{FRAC_1_SQRT_2, TAU};

/// Steps of an estimator in a period: a pole of 20 000 rad/s moves by a tenth in one.
const STEPS: usize = 10;
/// Samples before anything counts.
const SETTLING: usize = 400;
/// Frequency at which the lag is given, Hz.
const LAG_HZ: f64 = 100.0;

/// Ranks of `C B` and `B` of the nominal model: an unknown input can be decoupled from the state estimate
/// only where they are equal (the observer matching condition, Ch. 7, II.B).
#[must_use]
pub fn matching_ranks(model: &NominalModel) -> (usize, usize) {
    // In multiples of the natural frequency, so that no number is large because of its unit.
    let b = DMatrix::from_row_slice(
        2,
        1,
        &[0.0, model.b2() / model.natural_frequency_rad_s.powi(2)],
    );
    let c = DMatrix::from_row_slice(1, 2, &[1.0, 0.0]);
    let rank = |m: &DMatrix<f64>| m.rank(1e-12);
    (rank(&(&c * &b)), rank(&b))
}

/// An unknown-input observer for the nominal model, or why none exists.
///
/// # Errors
/// If the matching condition is not met.
pub fn unknown_input_observer(model: &NominalModel) -> Result<(), String> {
    match matching_ranks(model) {
        (cb, b) if cb == b => Ok(()),
        (cb, b) => Err(format!(
            "no unknown-input observer: rank(C B) = {cb} and rank(B) = {b}; the unknown input reaches the reading only through two integrations, so that no combination of the readings is free of it"
        )),
    }
}

/// An estimator with the number that makes it faster.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Kind {
    Printed,
    Pidsmo(f64),
    AlphaBeta(f64),
    HighGain(f64),
    SuperTwisting(f64),
    Kalman(f64),
}

/// Velocity, um/s, at every sample of a record of readings and drives: a drive acts from its sample on.
fn velocity_um_s(kind: Kind, reading_um: &[f64], drive_v: &[f64]) -> Vec<f64> {
    let model = NominalModel::THESIS;
    let (a21, a22, b2) = (model.a21(), model.a22(), model.b2());
    let pidsmo = |g: ObserverGains| {
        move |x: [f64; 3], y: f64, slope: f64, u: f64| {
            let e = x[0] - y;
            [
                x[1],
                a21 * y + a22 * x[1] + b2 * (u - g.p * e - g.d * (x[1] - slope) - x[2]),
                g.i * e,
            ]
        }
    };
    match kind {
        Kind::Printed => integrated(
            reading_um,
            drive_v,
            pidsmo(ObserverGains::THESIS_ESTIMATION),
        ),
        // Three poles at one place; the mode's own damping is there without `D_o`.
        Kind::Pidsmo(w) => {
            let gains = ObserverGains {
                p: 3.0 * w * w / b2,
                i: w.powi(3) / b2,
                d: ((3.0 * w + a22) / b2).max(0.0),
            };
            integrated(reading_um, drive_v, pidsmo(gains))
        }
        Kind::AlphaBeta(w) => integrated(reading_um, drive_v, |x, y, _, _| {
            [
                x[1],
                w * w * (y - x[0]) - 2.0 * FRAC_1_SQRT_2 * w * x[1],
                0.0,
            ]
        }),
        Kind::HighGain(w) => integrated(reading_um, drive_v, |x, y, _, u| {
            let e = y - x[0];
            [
                x[1] + 2.0 * w * e,
                a21 * x[0] + a22 * x[1] + b2 * u + w * w * e,
                0.0,
            ]
        }),
        // Levant's gains for a bound L of the acceleration.
        Kind::SuperTwisting(bound) => integrated(reading_um, drive_v, |x, y, _, _| {
            let e = x[0] - y;
            [
                x[1] - 1.5 * (bound * e.abs()).sqrt() * e.signum(),
                -1.1 * bound * e.signum(),
                0.0,
            ]
        }),
        Kind::Kalman(change_v) => kalman(&model, change_v, reading_um, drive_v),
    }
}

/// The second state of `x' = f(x, y, y', u)` at every sample.
fn integrated(
    reading_um: &[f64],
    drive_v: &[f64],
    f: impl Fn([f64; 3], f64, f64, f64) -> [f64; 3],
) -> Vec<f64> {
    let h = SAMPLING_PERIOD_S / STEPS as f64;
    let mut x = [reading_um.first().copied().unwrap_or(0.0), 0.0, 0.0];
    let mut out = vec![0.0];
    for (k, pair) in reading_um.windows(2).enumerate() {
        let (u, slope) = (
            drive_v.get(k).copied().unwrap_or(0.0),
            (pair[1] - pair[0]) / SAMPLING_PERIOD_S,
        );
        for step in 0..STEPS {
            let y = |share: f64| pair[0] + slope * h * (step as f64 + share);
            let moved =
                |k: [f64; 3], by: f64| [x[0] + by * k[0], x[1] + by * k[1], x[2] + by * k[2]];
            let k1 = f(x, y(0.0), slope, u);
            let k2 = f(moved(k1, 0.5 * h), y(0.5), slope, u);
            let k3 = f(moved(k2, 0.5 * h), y(0.5), slope, u);
            let k4 = f(moved(k3, h), y(1.0), slope, u);
            for i in 0..3 {
                x[i] += h / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i]);
            }
        }
        out.push(x[1]);
    }
    out
}

/// Extended Kalman filter: position, velocity, unknown input and gain; the product of the last with the drive
/// is what is linearised.
fn kalman(model: &NominalModel, change_v: f64, reading_um: &[f64], drive_v: &[f64]) -> Vec<f64> {
    const SENSOR_NOISE_UM: f64 = 1e-3;
    let unit = NominalModel {
        gain_um_v: 1.0,
        ..*model
    };
    let (phi, gamma) = unit.sampled(SAMPLING_PERIOD_S);
    let mut x = SVector::<f64, 4>::new(
        reading_um.first().copied().unwrap_or(0.0),
        0.0,
        0.0,
        model.gain_um_v,
    );
    let mut p = SMatrix::<f64, 4, 4>::from_diagonal(&SVector::<f64, 4>::new(
        1e-2,
        1e2,
        1e2,
        (0.05 * model.gain_um_v).powi(2),
    ));
    // The gain is known to a few per cent and hardly moves.
    let q = SVector::<f64, 4>::new(0.0, 0.0, change_v.powi(2), (1e-6 * model.gain_um_v).powi(2));
    let h = SVector::<f64, 4>::new(1.0, 0.0, 0.0, 0.0);
    let mut out = vec![0.0];
    for k in 1..reading_um.len() {
        let u = drive_v.get(k - 1).copied().unwrap_or(0.0) + x[2];
        let gain = x[3];
        let mut f = SMatrix::<f64, 4, 4>::identity();
        for i in 0..2 {
            (f[(i, 0)], f[(i, 1)], f[(i, 2)], f[(i, 3)]) =
                (phi[(i, 0)], phi[(i, 1)], gamma[i] * gain, gamma[i] * u);
        }
        let moved = [0, 1].map(|i| phi[(i, 0)] * x[0] + phi[(i, 1)] * x[1] + gamma[i] * gain * u);
        (x[0], x[1]) = (moved[0], moved[1]);
        p = f * p * f.transpose() + SMatrix::from_diagonal(&q);
        let ph = p * h;
        let l = ph / (h.dot(&ph) + SENSOR_NOISE_UM.powi(2));
        x += l * (reading_um[k] - x[0]);
        p -= l * ph.transpose();
        p = (p + p.transpose()) * 0.5;
        out.push(x[1]);
    }
    out
}

/// The true velocity of a record, um/s, zero at its ends.
fn true_velocity(record: &BenchRecord) -> Vec<f64> {
    let y = &record.noise_free_um;
    let between = y
        .windows(3)
        .map(|w| 0.5 * (w[2] - w[0]) / SAMPLING_PERIOD_S);
    std::iter::once(0.0)
        .chain(between)
        .chain([0.0])
        .take(y.len())
        .collect()
}

fn error_um_s(kind: Kind, record: &BenchRecord) -> f64 {
    let (found, truth) = (
        velocity_um_s(kind, &record.reading_um, &record.drive_v),
        true_velocity(record),
    );
    let inside = SETTLING..found.len().saturating_sub(1);
    rms(&inside.map(|k| found[k] - truth[k]).collect::<Vec<_>>())
}

/// The first harmonic of a signal at [`LAG_HZ`] over its last whole periods.
fn harmonic(signal: &[f64]) -> Complex<f64> {
    let period = (1.0 / (LAG_HZ * SAMPLING_PERIOD_S)).round() as usize;
    let end = signal.len().saturating_sub(1);
    let from = end - (end / 2) / period * period;
    (from..end)
        .map(|k| Complex::from_polar(signal[k], -TAU * LAG_HZ * k as f64 * SAMPLING_PERIOD_S))
        .sum()
}

/// Velocity estimates of every estimator on a bench: error, phase lag and noise gain.
#[must_use]
pub fn rows(bench: &Bench) -> Vec<ChapterRow> {
    let fs = bench.converters.sample_rate_hz;
    // The sensor of a plain bench is not late, so that what it reads is the position.
    let play =
        |drive: &[f64], seed: u64| bench.record(Variant::PLAIN, Start::Conditioned, drive, seed);
    let chosen_on = play(
        &waveform::multisine(
            8000,
            &(1..=60).step_by(3).collect::<Vec<_>>(),
            20.0,
            40.0,
            1,
            13,
        ),
        131,
    );
    let judged_on = play(&equation_35_v(fs, 0.5), 31);
    let for_lag = play(&waveform::sine(fs, LAG_HZ, 30.0, 40.0, 0.0, 0.3), 33);
    let mut noise = WhiteNoise::new(bench.converters.sensor_noise_um, 35);
    let pure_noise: Vec<f64> = (0..20_000).map(|_| noise.next_um()).collect();
    let rates =
        |low: f64, high: f64| (0..25).map(move |i| low * (high / low).powf(f64::from(i) / 24.0));
    let families: Vec<(&str, Vec<Kind>)> = vec![
        ("pidsmo_thesis", vec![Kind::Printed]),
        ("pidsmo", rates(1e3, 2e4).map(Kind::Pidsmo).collect()),
        ("alpha_beta", rates(1e3, 2e4).map(Kind::AlphaBeta).collect()),
        ("high_gain", rates(1e3, 2e4).map(Kind::HighGain).collect()),
        (
            "super_twisting",
            rates(1e4, 1e9).map(Kind::SuperTwisting).collect(),
        ),
        ("ekf", rates(1e-4, 3.0).map(Kind::Kalman).collect()),
    ];
    let rows = families.par_iter().flat_map_iter(|(id, kinds)| {
        let errors = kinds
            .iter()
            .map(|kind| (error_um_s(*kind, &chosen_on), *kind));
        let (_, kind) = errors
            .min_by(|a, b| a.0.total_cmp(&b.0))
            .unwrap_or((f64::NAN, Kind::Printed));
        let error = error_um_s(kind, &judged_on);
        let lag = harmonic(&velocity_um_s(kind, &for_lag.reading_um, &for_lag.drive_v))
            / harmonic(&true_velocity(&for_lag));
        let of_noise = velocity_um_s(kind, &pure_noise, &vec![0.0; pure_noise.len()]);
        let gain = rms(&of_noise[SETTLING..]) / rms(&pure_noise[SETTLING..]);
        let note = format!("{kind:?}, plain bench, chosen on another record");
        let id = format!("ch7.estimator.{id}");
        [
            ChapterRow::new(format!("{id}.velocity.rms"), error, "um/s", &note).on("Eq. (35)", 31),
            ChapterRow::new(
                format!("{id}.lag"),
                -lag.arg().to_degrees(),
                "deg",
                format!("{note}; of the velocity at {LAG_HZ} Hz"),
            ),
            ChapterRow::new(
                format!("{id}.noise_gain"),
                gain,
                "1/s",
                format!("{note}; RMS velocity per RMS noise of the reading"),
            ),
        ]
    });
    let mut rows: Vec<ChapterRow> = rows.collect();
    let refusal = unknown_input_observer(&NominalModel::THESIS).err();
    rows.push(row_um(
        "ch7.estimator.unknown_input_observer.refused",
        f64::from(u8::from(refusal.is_some())),
        refusal.unwrap_or_default(),
    ));
    rows
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A plant that measures velocity would meet the condition; the thesis' does not.
    #[test]
    fn the_matching_condition_refuses_the_actuator() {
        assert_eq!(matching_ranks(&NominalModel::THESIS), (0, 1));
        assert!(
            unknown_input_observer(&NominalModel::THESIS)
                .unwrap_err()
                .contains("rank(C B) = 0")
        );
    }

    /// On the nominal plant without noise and unknown input the observers find the velocity itself.
    #[test]
    fn every_observer_finds_the_velocity_of_its_own_model() {
        let model = NominalModel::THESIS;
        let (a, b) = model.sampled(SAMPLING_PERIOD_S);
        let (mut y, mut v) = (0.0, 0.0);
        let (mut readings, mut drives, mut truth) = (Vec::new(), Vec::new(), Vec::new());
        for k in 0..6000 {
            let u = 20.0 * (TAU * 60.0 * f64::from(k) * SAMPLING_PERIOD_S).sin();
            readings.push(y);
            truth.push(v);
            drives.push(u);
            (y, v) = (
                a[(0, 0)] * y + a[(0, 1)] * v + b[0] * u,
                a[(1, 0)] * y + a[(1, 1)] * v + b[1] * u,
            );
        }
        let largest = truth.iter().map(|v| v.abs()).fold(0.0, f64::max);
        for (kind, most) in [
            (Kind::Printed, 0.01),
            (Kind::Pidsmo(5000.0), 0.01),
            (Kind::HighGain(5000.0), 0.01),
            (Kind::Kalman(0.01), 0.01),
            (Kind::SuperTwisting(1e7), 0.05),
        ] {
            let found = velocity_um_s(kind, &readings, &drives);
            let error = found
                .iter()
                .zip(&truth)
                .skip(3000)
                .map(|(a, b)| (a - b).abs())
                .fold(0.0, f64::max);
            assert!(error < most * largest, "{kind:?}: {error} of {largest}");
        }
        // A filter without a model lags.
        let lagging = velocity_um_s(Kind::AlphaBeta(5000.0), &readings, &drives);
        assert!(
            lagging
                .iter()
                .zip(&truth)
                .skip(3000)
                .any(|(a, b)| (a - b).abs() > 0.05 * largest)
        );
    }
}
