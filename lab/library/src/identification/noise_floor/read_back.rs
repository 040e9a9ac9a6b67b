//! A measured drive: noise in its column, which the stage never saw and every model passes on.
//!
//! What no model can meet is not that noise times the gain. A light mode amplifies white noise, a slow stage
//! smooths it, and the model that is compared does the same: how much is found by giving it the recorded
//! drive with as much noise once more. So the floor depends on the model, and is taken anew from what a
//! search ends with (`NoiseFloor::beside`).
//!
//! Rest, holds and repeats of the drive show its noise. Where there are none, what the drive has above
//! everything smooth may be noise, or may have been commanded, and steps of its column may be those of a
//! converter that read it or of one that made it: then the readings decide. A model that leaves what the
//! noise would make had no better drive to follow.

use super::random_part::periodogram;
use super::{high_band, rest};
use crate::dataset::reading_grid::{LEVELS_MIN, rounding_noise, step_of};
use crate::dataset::{Dataset, Record, Role};
use hysteron_sim::chain::Model;
use hysteron_sim::noise::WhiteNoise;

/// How the noise of a drive's column is known.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum DriveNoiseEvidence {
    /// Rest, holds or repeats of the drive show it.
    Seen,
    /// The drive has it above everything smooth: it may have been commanded.
    InItsBand,
    /// The column has steps: a converter read them, or made them.
    Steps {
        /// One step, V.
        step_v: f64,
    },
}

/// Noise in the column of the drive.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ReadBack {
    /// RMS, V.
    pub noise_v: f64,
    /// How it is known.
    pub known: DriveNoiseEvidence,
}

/// Samples of a record that are simulated to see what the noise makes: light modes forget within a fraction
/// of them.
const SAMPLES_WALKED: usize = 20_000;
/// Of the noise that is given once more.
const SEED: u64 = 71;
/// Share of moves of one size, one in every sample, by which a drive was commanded along straight lines.
const ALIKE: f64 = 0.9;
/// Noise of a drive's band is less than this share of what the actuator may be driven by; more of it was
/// commanded.
const NOISE_SHARE_MAX: f64 = 2e-3;

impl ReadBack {
    /// What the columns of a data set show; nothing where the drive was commanded as it stands there.
    pub(super) fn of(dataset: &Dataset, between_repeats_v: f64) -> Option<Self> {
        let taking_part = || dataset.records.iter().filter(|r| r.role != Role::Test);
        let span_v = dataset.drive_max_v - dataset.drive_min_v;
        let at_rest_v = taking_part().map(rest::drive_noise_v).fold(0.0, f64::max);
        let seen_v = if at_rest_v > 0.0 {
            at_rest_v
        } else {
            between_repeats_v
        };
        if seen_v > 0.0 {
            return Some(Self {
                noise_v: seen_v,
                known: DriveNoiseEvidence::Seen,
            });
        }
        let driven: Vec<&Record> = taking_part().filter(|r| r.role != Role::Noise).collect();
        // One that only stands at a few levels says nothing of its steps.
        let moving = driven.iter().filter(|r| has_levels(&r.drive_v, LEVELS_MIN));
        let steps_v: Option<Vec<f64>> = moving.map(|r| step_v(&r.drive_v)).collect();
        if let Some(step_v) = steps_v.and_then(|steps| steps.into_iter().reduce(f64::max)) {
            return Some(Self {
                noise_v: rounding_noise(step_v),
                known: DriveNoiseEvidence::Steps { step_v },
            });
        }
        // A converter that reads one record with noise reads all of them so.
        let in_band_v = driven
            .iter()
            .map(|r| high_band::drive_noise_v(r).unwrap_or(0.0))
            .fold(f64::INFINITY, f64::min);
        (in_band_v > 0.0 && in_band_v < NOISE_SHARE_MAX * span_v).then_some(Self {
            noise_v: in_band_v,
            known: DriveNoiseEvidence::InItsBand,
        })
    }

    /// What to say of it where it makes so much of the readings, um.
    pub(super) fn words(&self, made_um: f64) -> String {
        let made_nm = 1e3 * made_um;
        match self.known {
            DriveNoiseEvidence::Seen => format!(
                "the drive was read back with {:.2} mV of noise, which is {made_nm:.2} nm that no model can meet: record what was commanded where you can",
                1e3 * self.noise_v
            ),
            DriveNoiseEvidence::InItsBand => format!(
                "the drive was read back, it seems, with {:.2} mV of noise: that makes {made_nm:.2} nm, which is what is left, and no model can meet it; record what was \
                 commanded where you can",
                1e3 * self.noise_v
            ),
            DriveNoiseEvidence::Steps { step_v } => format!(
                "the drive was read back, it seems, in steps of {:.2} mV: rounding makes {made_nm:.2} nm, which is what is left, and no model can meet it; if the drive was \
                 commanded in these steps, something of that size is missing",
                1e3 * step_v
            ),
        }
    }

    /// What the noise makes in the readings of a model, um: at the first samples of the window.
    #[must_use]
    pub fn response_um(&self, model: &Model, record: &Record) -> Vec<f64> {
        let end = record.window.end.min(record.window.start + SAMPLES_WALKED);
        let mut noise = WhiteNoise::new(self.noise_v, SEED);
        let read_v: Vec<f64> = record.drive_v[..end].to_vec();
        let again_v: Vec<f64> = read_v.iter().map(|u| u + noise.next_um()).collect();
        let simulate = |drive_v: &[f64]| {
            let mut drive = record.drive();
            drive.drive_v = drive_v;
            drive.force_n = record.force_n.as_deref().map(|f| &f[..end]);
            let auxiliary: Vec<_> = record
                .auxiliary
                .iter()
                .map(|signal| signal.with(|values| values[..end].to_vec()))
                .collect();
            drive.auxiliary = &auxiliary;
            model.simulate(&drive)
        };
        let (read, again) = (simulate(&read_v), simulate(&again_v));
        (record.window.start..end)
            .map(|k| again[k] - read[k])
            .collect()
    }
}

/// What is left may have so many times the power of noise in each of the bands that hold a quarter of it. Noise
/// has once; what is slower or faster than the noise has four times in the first band or the last one.
const OF_A_QUARTER: f64 = 2.0;

/// Whether what is left of records could be noise that was made in their readings beside white noise of the
/// readings themselves, um RMS: not only as large, but at the same frequencies.
pub(super) fn has_spectrum_of(
    made_um: &[Vec<f64>],
    left_um: &[Vec<f64>],
    readings_um: f64,
) -> bool {
    let (mut left, mut noise) = ([0.0; 4], [0.0; 4]);
    for (made, left_um) in made_um.iter().zip(left_um) {
        let samples = made.len().min(left_um.len());
        if samples == 0 {
            continue;
        }
        let [made, of_left] = [made, left_um].map(|values| periodogram(&values[..samples]));
        let whole: f64 = made.iter().sum();
        let white = readings_um * readings_um;
        let mut so_far = 0.0;
        for (of_made, of_left) in made.iter().zip(of_left) {
            let quarter = ((4.0 * so_far / whole) as usize).min(3);
            so_far += of_made;
            noise[quarter] += of_made + white;
            left[quarter] += of_left;
        }
    }
    left.iter()
        .zip(noise)
        .all(|(left, noise)| *left < OF_A_QUARTER * noise)
}

/// What to say of steps of which nobody knows whether a converter read or made them.
pub(super) fn words_of_steps(step_v: f64, made_um: f64) -> String {
    format!(
        "the drive's column has steps of {:.2} mV: if it was read back so, rounding makes up to {:.2} nm of what is left, and no model can meet it; record \
         what was commanded where you can",
        1e3 * step_v,
        1e3 * made_um
    )
}

/// The step of a converter that read a drive, or made it, V. A triangle that is commanded sample by sample
/// has steps of its own, all of the same size.
fn step_v(drive_v: &[f64]) -> Option<f64> {
    let step_v = step_of(drive_v)?;
    let moves: Vec<i64> = drive_v
        .windows(2)
        .map(|w| ((w[1] - w[0]) / step_v).round().abs() as i64)
        .filter(|steps| *steps > 0)
        .collect();
    let first = moves.first()?;
    let alike = moves.iter().filter(|steps| *steps == first).count() as f64;
    let straight = alike > ALIKE * moves.len() as f64 && alike > ALIKE * drive_v.len() as f64;
    (!straight).then_some(step_v)
}

fn has_levels(signal: &[f64], least: usize) -> bool {
    let mut levels: Vec<f64> = Vec::new();
    signal.iter().any(|value| {
        if !levels.contains(value) {
            levels.push(*value);
        }
        levels.len() >= least
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Noise behind a slow stage; a slow motion of the same power is not that.
    #[test]
    fn noise_is_known_by_its_frequencies() {
        let filtered = |seed: u64| {
            let mut noise = WhiteNoise::new(0.01, seed);
            let mut last = 0.0;
            let values = (0..20_000).map(|_| {
                last += 0.1 * (noise.next_um() - last);
                last
            });
            values.collect::<Vec<f64>>()
        };
        let (made, again) = (filtered(1), filtered(2));
        let power: f64 = made.iter().map(|v| v * v).sum::<f64>() / made.len() as f64;
        let slow = (0..20_000).map(|k| (2.0 * power).sqrt() * (1e-3 * f64::from(k)).sin());
        assert!(has_spectrum_of(std::slice::from_ref(&made), &[again], 1e-4));
        assert!(!has_spectrum_of(&[made], &[slow.collect()], 1e-4));
    }
}
