//! Where in the drive a residual lives: its RMS by drive level, branch, rate of the drive, time since the
//! last turn, and its own frequency.
//!
//! The same columns for every record, so that records can be compared: an error that follows the rate of the
//! drive, or only stands on the first rise, shows as a column before any effect has been named.

use crate::spectrum::amplitude_density;
use serde::{Deserialize, Serialize};

/// One column of the map.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct DriveFeature {
    /// What the column belongs to, with its unit, such as `drive level, V`.
    pub group: String,
    /// The column itself, such as `14 to 28`.
    pub label: String,
}

/// The residual in one record under one feature.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct FeatureCell {
    /// RMS of the residual, in its own unit.
    pub rms: f64,
    /// Samples behind it (for a frequency band: all of the record's).
    pub samples: usize,
}

const LEVELS: usize = 5;
/// Decades of the drive's rate, V/s.
const RATES_V_PER_S: [f64; 4] = [1e2, 1e3, 1e4, 1e5];
/// Decades of the time since the last turn, s.
const AGES_S: [f64; 4] = [1e-3, 1e-2, 1e-1, 1.0];
/// Decades of the residual's frequency, Hz.
const BANDS_HZ: [f64; 4] = [1.0, 10.0, 100.0, 1000.0];
/// Fewer samples than this say nothing about an RMS.
const FEWEST_SAMPLES: usize = 8;

/// The columns, for an actuator driven between `drive_min_v` and `drive_max_v`.
pub fn drive_features(drive_min_v: f64, drive_max_v: f64) -> Vec<DriveFeature> {
    let column = |group: &str, label: String| DriveFeature {
        group: group.to_owned(),
        label,
    };
    let step_v = (drive_max_v - drive_min_v) / LEVELS as f64;
    let mut features: Vec<_> = (0..LEVELS)
        .map(|i| {
            let from_v = drive_min_v + step_v * i as f64;
            // Zero has no sign: a limit a little below it would be printed as "-0".
            let [from, to] = [from_v, from_v + step_v].map(|volts| volts.round() + 0.0);
            let label = format!("{from} to {to}");
            column("drive level, V", label)
        })
        .collect();
    for label in ["first rise", "rising again", "falling", "held"] {
        features.push(column("branch", label.to_owned()));
    }
    for label in ["< 100", "to 1 k", "to 10 k", "to 100 k", "> 100 k"] {
        features.push(column("drive rate, V/s", label.to_owned()));
    }
    for label in ["< 1 ms", "to 10 ms", "to 0.1 s", "to 1 s", "> 1 s"] {
        features.push(column("time since the last turn", label.to_owned()));
    }
    for label in ["< 1", "to 10", "to 100", "to 1 k", "> 1 k"] {
        features.push(column("frequency of the residual, Hz", label.to_owned()));
    }
    features
}

/// What the drive does at a sample.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Branch {
    /// Above everything before: on the initial ascending curve.
    FirstRise,
    /// Rising below an earlier maximum.
    Rising,
    /// Falling.
    Falling,
    /// At rest.
    Held,
}

/// Branch and time since the last turn, s, for every sample of a drive; endless before the first motion.
pub fn branches(u_v: &[f64], sample_rate_hz: f64, range_v: f64) -> Vec<(Branch, f64)> {
    let still_v = 1e-6 * range_v;
    let turn_v = 1e-3 * range_v;
    let still_samples = ((2e-3 * sample_rate_hz) as usize).max(4);
    let mut rising = true;
    let mut extreme_v = u_v.first().copied().unwrap_or(0.0);
    let mut maximum_v = extreme_v;
    let mut unmoved = 0;
    let (mut last, mut since) = (Branch::Held, 0);
    let mut out = Vec::with_capacity(u_v.len());
    for (k, &u) in u_v.iter().enumerate() {
        let moved = k > 0 && (u - u_v[k - 1]).abs() > still_v;
        unmoved = if moved { 0 } else { unmoved + 1 };
        if rising {
            extreme_v = extreme_v.max(u);
            if u < extreme_v - turn_v {
                (rising, extreme_v) = (false, u);
            }
        } else {
            extreme_v = extreme_v.min(u);
            if u > extreme_v + turn_v {
                (rising, extreme_v) = (true, u);
            }
        }
        let branch = if unmoved >= still_samples || k + 1 == unmoved {
            Branch::Held
        } else if !rising {
            Branch::Falling
        } else if u >= maximum_v - turn_v {
            Branch::FirstRise
        } else {
            Branch::Rising
        };
        maximum_v = maximum_v.max(u);
        let moving_up = |b| matches!(b, Branch::FirstRise | Branch::Rising);
        if branch != last && !(moving_up(branch) && moving_up(last)) {
            // Rest is recognised late, but begins with the last motion.
            since = if branch == Branch::Held {
                k - unmoved.min(k)
            } else {
                k
            };
        }
        last = branch;
        let age_s = if k == unmoved.saturating_sub(1) {
            f64::INFINITY
        } else {
            (k - since) as f64 / sample_rate_hz
        };
        out.push((branch, age_s));
    }
    out
}

/// RMS of `residual` under each of [`drive_features`], over the samples `from..to`; None where there is too
/// little data. Entries that are not finite are left out. `u_v` and `residual` have the same length and start
/// with the record, since turns and maxima before the window count.
pub fn residual_by_feature(
    u_v: &[f64],
    residual: &[f64],
    sample_rate_hz: f64,
    window: std::ops::Range<usize>,
    drive_range_v: (f64, f64),
) -> Vec<Option<FeatureCell>> {
    let (low_v, high_v) = drive_range_v;
    let range_v = (high_v - low_v).max(f64::MIN_POSITIVE);
    let to = window.end.min(u_v.len()).min(residual.len());
    let from = window.start.min(to);
    let columns = drive_features(low_v, high_v).len();
    let time_columns = columns - (BANDS_HZ.len() + 1);
    let mut sums = vec![(0.0, 0usize); time_columns];
    let decade = |bounds: &[f64], value: f64| bounds.iter().filter(|&&b| value >= b).count();
    let branches = branches(u_v, sample_rate_hz, range_v);
    for k in from..to {
        let r = residual[k];
        if !r.is_finite() || !u_v[k].is_finite() {
            continue;
        }
        let level = ((u_v[k] - low_v) / range_v * LEVELS as f64) as usize;
        let rate_v_per_s = if k > 0 {
            (u_v[k] - u_v[k - 1]).abs() * sample_rate_hz
        } else {
            0.0
        };
        let (branch, age_s) = branches[k];
        let branch = match branch {
            Branch::FirstRise => 0,
            Branch::Rising => 1,
            Branch::Falling => 2,
            Branch::Held => 3,
        };
        let after_branch = LEVELS + 4;
        let after_rate = after_branch + RATES_V_PER_S.len() + 1;
        for column in [
            level.min(LEVELS - 1),
            LEVELS + branch,
            after_branch + decade(&RATES_V_PER_S, rate_v_per_s),
            after_rate + decade(&AGES_S, age_s),
        ] {
            sums[column].0 += r * r;
            sums[column].1 += 1;
        }
    }
    let mut cells: Vec<_> = sums
        .into_iter()
        .map(|(sum, samples)| {
            (samples >= FEWEST_SAMPLES).then(|| FeatureCell {
                rms: (sum / samples as f64).sqrt(),
                samples,
            })
        })
        .collect();
    let windowed: Vec<f64> = residual[from..to]
        .iter()
        .map(|r| if r.is_finite() { *r } else { 0.0 })
        .collect();
    let spectrum = amplitude_density(&windowed, sample_rate_hz);
    let mut bands = vec![(0.0, false); BANDS_HZ.len() + 1];
    let mut below_hz = 0.0;
    for (i, (&frequency_hz, &density)) in spectrum
        .frequency_hz
        .iter()
        .zip(&spectrum.density)
        .enumerate()
    {
        let above_hz = match spectrum.frequency_hz.get(i + 1) {
            Some(next_hz) => (frequency_hz + next_hz) / 2.0,
            None => frequency_hz,
        };
        let band = &mut bands[decade(&BANDS_HZ, frequency_hz)];
        *band = (band.0 + density * density * (above_hz - below_hz), true);
        below_hz = above_hz;
    }
    cells.extend(bands.into_iter().map(|(power, any)| {
        any.then(|| FeatureCell {
            rms: power.sqrt(),
            samples: windowed.len(),
        })
    }));
    cells
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::TAU;

    #[test]
    fn levels_are_told_in_whole_volts_without_a_signed_zero() {
        let labels: Vec<String> = drive_features(-0.3, 79.7)
            .into_iter()
            .take(LEVELS)
            .map(|feature| feature.label)
            .collect();
        assert_eq!(
            labels,
            ["0 to 16", "16 to 32", "32 to 48", "48 to 64", "64 to 80"]
        );
    }

    /// A triangle 0-50-0-30-0 V at 200 V/s, then a hold.
    fn drive() -> Vec<f64> {
        let mut u = vec![0.0; 50];
        for (from, to) in [(0.0, 50.0), (50.0, 0.0), (0.0, 30.0), (30.0, 0.0)] {
            let samples = f64::abs(to - from) as usize * 10;
            u.extend((1..=samples).map(|i| from + (to - from) * i as f64 / samples as f64));
        }
        u.extend([0.0; 400]);
        u
    }

    #[test]
    fn an_error_on_the_first_rise_shows_there_and_nowhere_else() {
        let u = drive();
        let residual: Vec<f64> = (0..u.len())
            .map(|k| if (50..=550).contains(&k) { 1.0 } else { 0.0 })
            .collect();
        let features = drive_features(0.0, 50.0);
        let cells = residual_by_feature(&u, &residual, 2000.0, 0..u.len(), (0.0, 50.0));
        assert_eq!(cells.len(), features.len());
        let of = |label: &str| {
            let i = features.iter().position(|f| f.label == label).unwrap();
            cells[i].map(|c| c.rms)
        };
        assert!(of("first rise").unwrap() > 0.99);
        assert!(of("rising again").unwrap() < 0.01);
        assert!(of("falling").unwrap() < 0.1);
        assert!(of("held").unwrap() < 0.3);
        assert_eq!(of("> 100 k"), None);
    }

    #[test]
    fn the_bands_share_out_the_power() {
        let residual: Vec<f64> = (0..40_000)
            .map(|k| (TAU * 50.0 * f64::from(k) / 20_000.0).sin())
            .collect();
        let u = vec![1.0; residual.len()];
        let cells = residual_by_feature(&u, &residual, 2e4, 0..residual.len(), (0.0, 2.0));
        let band = cells[cells.len() - 3].unwrap().rms;
        assert!((band * 2f64.sqrt() - 1.0).abs() < 0.05, "{band}");
    }
}
