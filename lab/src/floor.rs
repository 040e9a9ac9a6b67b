//! The noise floor: what remains random, and on which evidence.
//!
//! Three kinds of evidence, each for what a data set has: a record at rest, repeated periods, repeated records. Lines, slow drift and what
//! follows a measured force are removed first: they are effects, not noise. Without any evidence there is no floor, and none is made up.
//! A coarse converter makes noise that neither rest nor repeats show; its step is read from the readings ([`crate::dataset::reading_grid`]).

use crate::dataset::reading_grid::{noise_at_rest_um, noise_between_repeats_um, reading_step_um, rounding_noise_um};
use crate::dataset::{Dataset, Record, Role};
use crate::fit::{dot, orthonormalise, project_out, rms};
use realfft::RealFftPlanner;
use serde::Serialize;

/// One estimate of the floor.
#[derive(Clone, Debug, Serialize)]
pub struct FloorEstimate {
    /// What it rests on.
    pub basis: String,
    /// RMS, um.
    pub rms_um: f64,
}

/// The floor that verdicts use, with all the estimates there are.
#[derive(Clone, Debug, Serialize)]
pub struct NoiseFloor {
    /// RMS, um; `None` where the data cannot tell.
    pub rms_um: Option<f64>,
    /// What it rests on, or `undecidable`.
    pub basis: String,
    /// All estimates, the one used first.
    pub estimates: Vec<FloorEstimate>,
    /// Step of a converter that is coarse enough to matter beside the rest of the noise, um.
    pub reading_step_um: Option<f64>,
    /// Where estimates disagree.
    pub warnings: Vec<String>,
}

/// Rounding matters where it makes this share of the noise's power.
const ROUNDING_MATTERS: f64 = 0.05;
/// A declared step may differ by this share from the one that the readings show.
const DECLARED_STEP_TOLERANCE: f64 = 0.05;
/// Noise below this share of a step leaves the reading where it is most of the time, and with it the error of rounding.
const HIDDEN_BY_STEP: f64 = 0.5;

/// Taps of the force response that are removed from a record at rest, at most this many seconds.
const FORCE_MEMORY_S: f64 = 0.004;

/// Estimates the floor of a data set.
#[must_use]
pub fn noise_floor(dataset: &Dataset) -> NoiseFloor {
    let mut estimates = Vec::new();
    let step_um = reading_step_um(dataset);
    let between_repeats = |rms_um: f64| step_um.map_or(rms_um, |step_um| noise_between_repeats_um(rms_um, step_um));
    for record in dataset.records.iter().filter(|r| r.role == Role::Noise) {
        let rms_um = at_rest(record, step_um);
        estimates.push(FloorEstimate { basis: format!("rest record {}", record.name), rms_um });
    }
    for record in dataset.records.iter().filter(|r| r.role != Role::Noise) {
        if let Some(rms_um) = between_periods(record) {
            estimates.push(FloorEstimate { basis: format!("repeated periods of {}", record.name), rms_um: between_repeats(rms_um) });
        }
    }
    for record in &dataset.records {
        let original = record.repeat_of.as_ref().and_then(|name| dataset.records.iter().find(|r| r.name == *name));
        if let Some(original) = original {
            estimates.push(FloorEstimate {
                basis: format!("repeated records {} and {}", original.name, record.name),
                rms_um: between_repeats(between_records(original, record)),
            });
        }
    }
    let Some(first) = estimates.first() else {
        return NoiseFloor { rms_um: None, basis: "undecidable".into(), estimates, reading_step_um: None, warnings: Vec::new() };
    };
    let (rms_um, basis) = (first.rms_um, first.basis.clone());
    let mut warnings: Vec<String> = estimates[1..]
        .iter()
        .filter(|e| e.rms_um > 1.15 * rms_um || e.rms_um < rms_um / 1.15)
        .map(|e| format!("the floor from {} is {:.2} nm, from {} {:.2} nm: they disagree", basis, 1e3 * rms_um, e.basis, 1e3 * e.rms_um))
        .collect();
    if let (Some(step_um), Some(declared_um)) = (step_um, dataset.sensor_lsb_um)
        && (step_um / declared_um - 1.0).abs() > DECLARED_STEP_TOLERANCE
    {
        warnings.push(format!(
            "the readings are whole steps of {:.3} nm, but the data set declares sensor_lsb_um = {declared_um}, {:.3} nm",
            1e3 * step_um,
            1e3 * declared_um
        ));
    }
    let matters = |step: &f64| rounding_noise_um(*step).powi(2) > ROUNDING_MATTERS * rms_um * rms_um;
    NoiseFloor { rms_um: Some(rms_um), basis, estimates, reading_step_um: step_um.filter(matters), warnings }
}

/// What rest shows. Noise that hardly ever leaves a step of the reading is judged by how often it does.
fn at_rest(record: &Record, step_um: Option<f64>) -> f64 {
    let random_um = random_part(record);
    match step_um.filter(|step_um| random_um < HIDDEN_BY_STEP * step_um) {
        Some(step_um) => {
            let readings_um = &record.displacement_um[record.window.clone()];
            noise_at_rest_um(readings_um, step_um).unwrap_or_else(|| random_um.hypot(rounding_noise_um(step_um)))
        }
        None => random_um,
    }
}

fn drift_columns(samples: usize) -> Vec<Vec<f64>> {
    let x = |k: usize| 2.0 * k as f64 / samples.max(2) as f64 - 1.0;
    (0..4).map(|power| (0..samples).map(|k| x(k).powi(power)).collect()).collect()
}

/// RMS of a record at rest without drift, lines and what follows the force.
fn random_part(record: &Record) -> f64 {
    let y = &record.displacement_um[record.window.clone()];
    let n = y.len();
    let mut columns = drift_columns(n);
    if let Some(force_n) = record.force_n.as_ref().filter(|f| f.iter().any(|v| *v != f[0])) {
        let taps = ((FORCE_MEMORY_S * record.sample_rate_hz) as usize).clamp(2, 80).min(n / 20 + 1);
        for lag in 0..taps {
            columns.push(record.window.clone().map(|k| force_n[k.saturating_sub(lag + 1)]).collect());
        }
    }
    let basis = orthonormalise(columns);
    let mut residual = y.to_vec();
    project_out(&basis, &mut residual);
    let mut removed = basis.len();
    // Lines one after the other: each where the periodogram stands out of what noise can do.
    for _ in 0..6 {
        let Some(frequency_hz) = strongest_line(&residual, record.sample_rate_hz) else { break };
        let phase = |k: usize| std::f64::consts::TAU * frequency_hz * k as f64 / record.sample_rate_hz;
        let line = orthonormalise(vec![(0..n).map(|k| phase(k).sin()).collect(), (0..n).map(|k| phase(k).cos()).collect()]);
        project_out(&line, &mut residual);
        removed += 2;
    }
    rms(&residual) * (n as f64 / n.saturating_sub(removed).max(1) as f64).sqrt()
}

/// Frequency of a line that noise would show less than once in 10^4 records.
fn strongest_line(values: &[f64], sample_rate_hz: f64) -> Option<f64> {
    let n = values.len();
    let power = periodogram(values);
    let mut sorted: Vec<f64> = power[1..].to_vec();
    sorted.sort_by(f64::total_cmp);
    let median = sorted.get(sorted.len() / 2).copied().filter(|m| *m > 0.0)?;
    // Exponentially distributed ordinates: the mean is the median over ln 2.
    let limit = median / std::f64::consts::LN_2 * (power.len() as f64 * 1e4).ln();
    let (bin, peak) = power.iter().enumerate().skip(1).max_by(|a, b| a.1.total_cmp(b.1))?;
    if *peak < limit {
        return None;
    }
    // Refine between bins by the strongest projection.
    let resolution = sample_rate_hz / n as f64;
    let strength = |f: f64| {
        let (mut s, mut c) = (0.0, 0.0);
        for (k, v) in values.iter().enumerate() {
            let (sin, cos) = (std::f64::consts::TAU * f * k as f64 / sample_rate_hz).sin_cos();
            s += v * sin;
            c += v * cos;
        }
        s * s + c * c
    };
    let mut best = bin as f64 * resolution;
    let mut width = 0.5 * resolution;
    for _ in 0..12 {
        best = [best - width, best, best + width].into_iter().max_by(|a, b| strength(*a).total_cmp(&strength(*b)))?;
        width *= 0.6;
    }
    Some(best)
}

/// Power at the bins of a discrete Fourier transform.
#[must_use]
pub fn periodogram(values: &[f64]) -> Vec<f64> {
    let mut planner = RealFftPlanner::<f64>::new();
    let transform = planner.plan_fft_forward(values.len());
    let mut input = values.to_vec();
    let mut output = transform.make_output_vec();
    if transform.process(&mut input, &mut output).is_err() {
        return Vec::new();
    }
    output.iter().map(|c| c.norm_sqr() / values.len() as f64).collect()
}

/// Deviation of periods from their mean; the slow part of each period counts as drift.
fn between_periods(record: &Record) -> Option<f64> {
    let periods = record.periods.filter(|p| p.count >= 2)?;
    let p = periods.length;
    let mut rows: Vec<Vec<f64>> =
        (0..periods.count).map(|i| record.displacement_um[periods.from + i * p..periods.from + (i + 1) * p].to_vec()).collect();
    let drift = orthonormalise(drift_columns(p)[..2].to_vec());
    let mean: Vec<f64> = (0..p).map(|k| rows.iter().map(|r| r[k]).sum::<f64>() / rows.len() as f64).collect();
    let mut sum = 0.0;
    for row in &mut rows {
        row.iter_mut().zip(&mean).for_each(|(v, m)| *v -= m);
        project_out(&drift, row);
        sum += dot(row, row);
    }
    let freedom = (periods.count - 1) * p.saturating_sub(drift.len());
    Some((sum / freedom.max(1) as f64).sqrt())
}

fn between_records(first: &Record, second: &Record) -> f64 {
    let range = first.window.start.max(second.window.start)..first.window.end.min(second.window.end);
    let mut difference: Vec<f64> = range.clone().map(|k| first.displacement_um[k] - second.displacement_um[k]).collect();
    let drift = orthonormalise(drift_columns(difference.len())[..2].to_vec());
    project_out(&drift, &mut difference);
    rms(&difference) / std::f64::consts::SQRT_2
}

#[cfg(test)]
mod tests {
    use super::*;
    use hysteron_sim::chain::InitialState;

    fn record(displacement_um: Vec<f64>) -> Record {
        let n = displacement_um.len();
        Record {
            name: "r".into(),
            path: "r".into(),
            sample_rate_hz: 1000.0,
            role: Role::Noise,
            initial_state: InitialState::Virgin,
            window: 0..n,
            periods: None,
            repeat_of: None,
            offset_is_fitted: false,
            drive_v: vec![0.0; n],
            displacement_um,
            force_n: None,
        }
    }

    /// Deterministic pseudo-noise of unit variance.
    fn noise(n: usize, seed: u64) -> Vec<f64> {
        let mut state = seed;
        (0..n)
            .map(|_| {
                let mut sum = 0.0;
                for _ in 0..12 {
                    state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                    sum += (state >> 11) as f64 / (1u64 << 53) as f64;
                }
                sum - 6.0
            })
            .collect()
    }

    #[test]
    fn hum_and_drift_are_not_noise() {
        let y: Vec<f64> =
            noise(5000, 7).iter().enumerate().map(|(k, e)| 0.01 * e + 0.05 * (k as f64 * 0.3143).sin() + 1e-5 * k as f64).collect();
        assert!((random_part(&record(y)) / 0.01 - 1.0).abs() < 0.03);
    }

    #[test]
    fn periods_tell_the_noise_under_drive() {
        let y: Vec<f64> =
            noise(4000, 3).iter().enumerate().map(|(k, e)| 0.02 * e + (std::f64::consts::TAU * k as f64 / 500.0).sin()).collect();
        let mut with_periods = record(y);
        with_periods.periods = Some(crate::dataset::Periods { from: 0, length: 500, count: 8 });
        assert!((between_periods(&with_periods).unwrap() / 0.02 - 1.0).abs() < 0.05);
    }
}
