//! Drive and reference waveforms, sampled: each function returns one value per sample, volts for a drive,
//! micrometres for a reference.
//!
//! Waveforms are joined by concatenating vectors; [`concatenate`] does that. Where a waveform is made of
//! random phases the seed is an argument, and the same seed gives the same samples on every machine. Counts
//! of samples are rounded to the nearest sample, so that a joint never leaves a gap.
//!
//! ```
//! use hysteron_sim::waveform::*;
//!
//! let hz = 10_000.0;
//! assert_eq!(samples_in(hz, 0.25), 2500);
//! // A drive for a recording: at rest, loops inside loops, a staircase.
//! let drive_v = concatenate(&[
//!     hold(hz, 0.0, 0.5),
//!     triangles(hz, 200.0, &[0.0, 60.0, 20.0, 40.0, 0.0]),
//!     half_cosines(hz, 0.05, &[0.0, 60.0, 10.0, 0.0]),
//!     steps(hz, &[(20.0, 0.1), (50.0, 0.1), (0.0, 0.1)]),
//! ]);
//! assert!(drive_v.iter().all(|v| (0.0..=60.0).contains(v)));
//! // For the dynamics: periods of lines at 10, 30 and 70 Hz, a sweep, and bursts.
//! let dynamics_v = concatenate(&[
//!     multisine(1000, &[1, 3, 7], 5.0, 30.0, 4, 1),
//!     chirp(hz, 1.0, 200.0, 5.0, 30.0, 0.0, 1.0),
//!     sine_burst(hz, 100.0, 5.0, 30.0, 0.2),
//! ]);
//! assert!(dynamics_v.iter().all(|v| (v - 30.0).abs() <= 5.0 + 1e-9));
//! // References for a servo, and the saw-tooth of a stick-slip drive.
//! let mut reference_um = sine(hz, 50.0, 2.0, 0.0, 0.0, 1.0);
//! grow_from_zero(&mut reference_um, hz);
//! assert!(reference_um[..100].iter().all(|um| um.abs() < 0.001 * GROWN_WITHIN_S));
//! assert_eq!(raised_cosine(hz, 50.0, 1.0, 5.0, 2).last(), Some(&1.0));
//! assert!(rounded_triangle(hz, 400.0, 8.0, 0.1).iter().all(|um| *um <= 8.0));
//! assert_eq!(saw_tooth(hz, 100.0, 60.0, 1.0, 3).len(), 300);
//! ```

use rand::{Rng, SeedableRng};
use rand_pcg::Pcg64Mcg;
use std::f64::consts::{PI, TAU};

/// Number of samples in a duration.
#[must_use]
pub fn samples_in(sample_rate_hz: f64, duration_s: f64) -> usize {
    (sample_rate_hz * duration_s).round().max(0.0) as usize
}

/// Joins waveforms.
#[must_use]
pub fn concatenate(parts: &[Vec<f64>]) -> Vec<f64> {
    parts.concat()
}

/// A constant level for a duration.
#[must_use]
pub fn hold(sample_rate_hz: f64, level: f64, duration_s: f64) -> Vec<f64> {
    vec![level; samples_in(sample_rate_hz, duration_s)]
}

/// Steps: each `(level, duration_s)` held in turn.
#[must_use]
pub fn steps(sample_rate_hz: f64, levels: &[(f64, f64)]) -> Vec<f64> {
    levels
        .iter()
        .flat_map(|(level, duration_s)| hold(sample_rate_hz, *level, *duration_s))
        .collect()
}

/// Straight lines of slope `+-slope_per_s` from vertex to vertex: triangles of any height with nested
/// reversals (thesis Ch. 4, Fig. 7).
///
/// Every vertex is reached exactly, on a sample; the slope of a section differs from the nominal one by at
/// most one sample's worth.
#[must_use]
pub fn triangles(sample_rate_hz: f64, slope_per_s: f64, vertices: &[f64]) -> Vec<f64> {
    let mut out: Vec<f64> = vertices.first().copied().into_iter().collect();
    for pair in vertices.windows(2) {
        let span = pair[1] - pair[0];
        let count = samples_in(sample_rate_hz, (span / slope_per_s).abs()).max(1);
        out.extend((1..=count).map(|k| pair[0] + span * k as f64 / count as f64));
    }
    out
}

/// Straight up and straight down as a saw-tooth: a slow rise to `height` over `rise_share` of the period,
/// then back to zero.
///
/// With `rise_share` = 1 the fall is a jump within one sample, as for the stick-slip actuator (thesis Ch. 3,
/// Fig. 1).
#[must_use]
pub fn saw_tooth(
    sample_rate_hz: f64,
    frequency_hz: f64,
    height: f64,
    rise_share: f64,
    cycles: usize,
) -> Vec<f64> {
    let count = samples_in(sample_rate_hz, cycles as f64 / frequency_hz);
    let rise = rise_share.clamp(1e-6, 1.0);
    (0..count)
        .map(|k| {
            let phase = (k as f64 * frequency_hz / sample_rate_hz).fract();
            if phase < rise {
                height * phase / rise
            } else {
                height * (1.0 - phase) / (1.0 - rise)
            }
        })
        .collect()
}

/// Smooth vertices: half a cosine period from each vertex to the next, each lasting `half_period_s` (thesis
/// Ch. 4 Fig. 10, Ch. 5 Fig. 8: sines of varying magnitude).
#[must_use]
pub fn half_cosines(sample_rate_hz: f64, half_period_s: f64, vertices: &[f64]) -> Vec<f64> {
    let mut out: Vec<f64> = vertices.first().copied().into_iter().collect();
    for (section, pair) in vertices.windows(2).enumerate() {
        let (from, to) = (
            samples_in(sample_rate_hz, section as f64 * half_period_s),
            samples_in(sample_rate_hz, (section + 1) as f64 * half_period_s),
        );
        out.extend((from + 1..=to).map(|k| {
            let phase =
                (k as f64 / sample_rate_hz / half_period_s - section as f64).clamp(0.0, 1.0);
            pair[0] + (pair[1] - pair[0]) * 0.5 * (1.0 - (PI * phase).cos())
        }));
    }
    out
}

/// One period of the rounded triangle of thesis Ch. 4, Fig. 9: slopes `+-slope_per_s` between zero and
/// `height`, whose turn at the top is a portion of a sine.
///
/// The sine has the magnitude `rounding_share * height`; it takes over where its slope equals the nominal
/// one, so that the voltage and its slope are continuous there. The top of the sine is `height`. A sine of
/// magnitude `a` that passes through its steepest point at `height - a` with the slope `slope_per_s` has the
/// angular frequency `slope_per_s / a`.
#[must_use]
pub fn rounded_triangle(
    sample_rate_hz: f64,
    slope_per_s: f64,
    height: f64,
    rounding_share: f64,
) -> Vec<f64> {
    let magnitude = (rounding_share.clamp(1e-9, 1.0)) * height;
    let straight_s = (height - magnitude) / slope_per_s;
    let half_turn_s = PI * magnitude / slope_per_s;
    let duration_s = 2.0 * straight_s + half_turn_s;
    let count = samples_in(sample_rate_hz, duration_s).max(2);
    (0..=count)
        .map(|k| {
            let t = k as f64 / sample_rate_hz;
            if t < straight_s {
                slope_per_s * t
            } else if t <= straight_s + half_turn_s {
                height - magnitude + magnitude * ((t - straight_s) * slope_per_s / magnitude).sin()
            } else {
                (height - magnitude - slope_per_s * (t - straight_s - half_turn_s)).max(0.0)
            }
        })
        .collect()
}

/// A sine `offset + amplitude sin(2 pi f t + phase)`.
#[must_use]
pub fn sine(
    sample_rate_hz: f64,
    frequency_hz: f64,
    amplitude: f64,
    offset: f64,
    phase_rad: f64,
    duration_s: f64,
) -> Vec<f64> {
    (0..samples_in(sample_rate_hz, duration_s))
        .map(|k| {
            offset + amplitude * (TAU * frequency_hz * k as f64 / sample_rate_hz + phase_rad).sin()
        })
        .collect()
}

/// Bursts: `cycles` raised cosines between `low` and `high`, beginning and ending at `low` (thesis Ch. 5, Eq.
/// 14 with `low` = 0).
#[must_use]
pub fn raised_cosine(
    sample_rate_hz: f64,
    frequency_hz: f64,
    low: f64,
    high: f64,
    cycles: usize,
) -> Vec<f64> {
    (0..=samples_in(sample_rate_hz, cycles as f64 / frequency_hz))
        .map(|k| {
            low + (high - low)
                * 0.5
                * (1.0 - (TAU * frequency_hz * k as f64 / sample_rate_hz).cos())
        })
        .collect()
}

/// A burst of a sine around `offset`, its amplitude raised and lowered by a half-cosine window over the whole
/// duration.
#[must_use]
pub fn sine_burst(
    sample_rate_hz: f64,
    frequency_hz: f64,
    amplitude: f64,
    offset: f64,
    duration_s: f64,
) -> Vec<f64> {
    let count = samples_in(sample_rate_hz, duration_s);
    (0..count)
        .map(|k| {
            let window = (PI * k as f64 / count.max(1) as f64).sin().powi(2);
            offset + amplitude * window * (TAU * frequency_hz * k as f64 / sample_rate_hz).sin()
        })
        .collect()
}

/// Periods of a multisine: equal amplitudes on the given lines (multiples of `sample_rate_hz /
/// period_samples`), random phases.
///
/// Scaled so that it stays within `offset +- peak`. Four sets of phases are drawn and the one with the lowest
/// crest factor is taken.
#[must_use]
pub fn multisine(
    period_samples: usize,
    lines: &[usize],
    peak: f64,
    offset: f64,
    periods: usize,
    seed: u64,
) -> Vec<f64> {
    let mut generator = Pcg64Mcg::seed_from_u64(seed);
    let mut best: Vec<f64> = vec![0.0; period_samples];
    let mut best_peak = f64::INFINITY;
    for _ in 0..4 {
        let mut period = vec![0.0; period_samples];
        for line in lines {
            let phase = generator.random_range(0.0..TAU);
            // Reduced by whole turns first: exact for any line and length.
            for (k, value) in period.iter_mut().enumerate() {
                let turns = (line * k) % period_samples.max(1);
                *value += (TAU * turns as f64 / period_samples as f64 + phase).cos();
            }
        }
        let highest = period.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
        if highest < best_peak {
            best_peak = highest;
            best = period;
        }
    }
    let scale = if best_peak > 0.0 && best_peak.is_finite() {
        peak / best_peak
    } else {
        0.0
    };
    let period: Vec<f64> = best.iter().map(|v| offset + scale * v).collect();
    period.repeat(periods)
}

/// A chirp `offset + amplitude sin(phase)` whose frequency runs linearly from `from_hz` to `to_hz`, beginning
/// at phase `phase_rad`.
#[must_use]
pub fn chirp(
    sample_rate_hz: f64,
    from_hz: f64,
    to_hz: f64,
    amplitude: f64,
    offset: f64,
    phase_rad: f64,
    duration_s: f64,
) -> Vec<f64> {
    (0..samples_in(sample_rate_hz, duration_s))
        .map(|k| {
            let t = k as f64 / sample_rate_hz;
            let phase = TAU * (from_hz * t + 0.5 * (to_hz - from_hz) * t * t / duration_s);
            offset + amplitude * (phase + phase_rad).sin()
        })
        .collect()
}

/// Time in which a reference grows to its full amplitude, s.
pub const GROWN_WITHIN_S: f64 = 0.3;

/// Lets a signal grow from zero within [`GROWN_WITHIN_S`], smooth to its second derivative: it never asks for
/// what a one-sided actuator cannot give.
pub fn grow_from_zero(signal: &mut [f64], sample_rate_hz: f64) {
    for (k, value) in signal.iter_mut().enumerate() {
        let s = (k as f64 / sample_rate_hz / GROWN_WITHIN_S).min(1.0);
        *value *= s.powi(3) * (10.0 - 15.0 * s + 6.0 * s * s);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FS: f64 = 20_000.0;

    fn highest(signal: &[f64]) -> f64 {
        signal.iter().copied().fold(f64::NEG_INFINITY, f64::max)
    }

    #[test]
    fn triangles_reach_every_vertex_at_the_nominal_slope() {
        let signal = triangles(FS, 200.0, &[0.0, 70.0, 20.0, 45.0, 0.0]);
        assert_eq!(signal.len(), 1 + 7000 + 5000 + 2500 + 4500);
        for (index, level) in [
            (0, 0.0),
            (7000, 70.0),
            (12000, 20.0),
            (14500, 45.0),
            (19000, 0.0),
        ] {
            assert!((signal[index] - level).abs() < 1e-9);
        }
        for pair in signal.windows(2) {
            assert!(((pair[1] - pair[0]).abs() * FS - 200.0).abs() < 1e-6);
        }
    }

    #[test]
    fn rounded_triangle_is_smooth_at_the_top() {
        let signal = rounded_triangle(1e6, 10_000.0, 70.0, 0.5);
        assert!((highest(&signal) - 70.0).abs() < 1e-3);
        let slopes: Vec<f64> = signal.windows(2).map(|p| (p[1] - p[0]) * 1e6).collect();
        assert!(slopes.iter().all(|s| s.abs() < 10_001.0));
        // No corner but at the two ends: the slope changes by no more than the curvature of the sine allows.
        let curvature = 10_000.0_f64.powi(2) / 35.0;
        assert!(
            slopes
                .windows(2)
                .take(slopes.len() - 3)
                .all(|p| (p[1] - p[0]).abs() < 1.01 * curvature * 1e-6)
        );
    }

    #[test]
    fn multisine_has_energy_only_on_its_lines_and_is_repeatable() {
        let lines = [3usize, 7, 20];
        let signal = multisine(512, &lines, 10.0, 40.0, 2, 5);
        assert_eq!(signal, multisine(512, &lines, 10.0, 40.0, 2, 5));
        assert_ne!(signal, multisine(512, &lines, 10.0, 40.0, 2, 6));
        assert!((highest(&signal) - 40.0).abs() <= 10.0 + 1e-12);
        for line in 1..256usize {
            let (mut re, mut im) = (0.0, 0.0);
            for (k, value) in signal[..512].iter().enumerate() {
                let angle = TAU * ((line * k) % 512) as f64 / 512.0;
                re += value * angle.cos();
                im += value * angle.sin();
            }
            let amplitude = 2.0 * (re * re + im * im).sqrt() / 512.0;
            assert_eq!(
                amplitude > 1e-9,
                lines.contains(&line),
                "line {line}: {amplitude}"
            );
        }
    }

    #[test]
    fn half_cosines_and_raised_cosines_meet_their_vertices() {
        let signal = half_cosines(FS, 1.0 / 600.0, &[0.0, 70.0, 20.0, 50.0]);
        assert!((signal[100] - 50.0).abs() < 1e-9);
        assert_eq!(signal.len(), 101);
        let burst = raised_cosine(FS, 100.0, 0.0, 70.0, 3);
        assert_eq!(burst.len(), 601);
        assert!(
            (burst[100] - 70.0).abs() < 1e-9 && burst[200].abs() < 1e-9 && burst[600].abs() < 1e-9
        );
    }

    #[test]
    fn saw_tooth_falls_within_a_sample() {
        let signal = saw_tooth(FS, 50.0, 30.0, 1.0, 2);
        assert_eq!(signal.len(), 800);
        assert!((signal[399] - 30.0 * 399.0 / 400.0).abs() < 1e-9);
        assert!(signal[400].abs() < 1e-6);
    }
}
