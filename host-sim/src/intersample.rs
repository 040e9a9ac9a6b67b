//! What a drive does between its samples, as identification tools call it.
//!
//! A converter holds its output. A signal that was measured is not held: it runs on between samples, straight
//! as far as they are close together, or as the one signal without power above half the sampling rate that
//! passes through all of them. Inside a chain both run straight from the end of one interval to the end of
//! the next ([`crate::effect::Setting::runs_straight`]); a band-limited one is put on sub-intervals first.

use std::f64::consts::PI;

/// The way of a drive from one sample to the next.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Intersample {
    /// It keeps its value.
    #[default]
    Hold,
    /// It runs straight.
    Linear,
    /// It has no power above half the sampling rate.
    BandLimited,
}

/// Sub-intervals of a period over which a band-limited drive runs straight. The Silverbox, driven up to a
/// third of its sampling rate, is left with 0.301 mV in four of them, 0.293 mV in eight and in sixteen.
pub const SUBSTEPS_BAND_LIMITED: usize = 4;
/// Samples to either side from which a value between two is made, and the shape of the Kaiser window over
/// them: of a sine of three quarters of half the sampling rate less than 2e-4 is lost.
const REACH: usize = 16;
const KAISER_BETA: f64 = 8.0;

impl Intersample {
    /// All of them with the names that files use.
    pub const NAMES: [(&'static str, Self); 3] = [
        ("hold", Self::Hold),
        ("linear", Self::Linear),
        ("band_limited", Self::BandLimited),
    ];

    /// The name that files use.
    #[must_use]
    pub fn name(self) -> &'static str {
        Self::NAMES
            .iter()
            .find(|(_, one)| *one == self)
            .map_or("hold", |(name, _)| name)
    }

    /// Sub-intervals of a sampling period that it needs.
    #[must_use]
    pub fn substeps(self) -> usize {
        if self == Self::BandLimited {
            SUBSTEPS_BAND_LIMITED
        } else {
            1
        }
    }

    /// Where a drive that is not held stands at the end of each of the sub-intervals of its sampling periods;
    /// behind its last sample it stays.
    #[must_use]
    pub fn at_ends(self, drive_v: &[f64], substeps: usize) -> Vec<f64> {
        let last = drive_v.len().saturating_sub(1);
        let value = |k: isize| drive_v[k.clamp(0, last as isize) as usize];
        let between = self.between(substeps);
        let mut out = Vec::with_capacity(drive_v.len() * substeps);
        for k in 0..drive_v.len() {
            let first = k as isize + 1 - (between.first().map_or(0, Vec::len) / 2) as isize;
            for weights in &between {
                let inside = first >= 0 && first as usize + weights.len() <= drive_v.len();
                out.push(if inside {
                    weights
                        .iter()
                        .zip(&drive_v[first as usize..])
                        .map(|(w, u)| w * u)
                        .sum()
                } else {
                    weights
                        .iter()
                        .enumerate()
                        .map(|(i, w)| w * value(first + i as isize))
                        .sum()
                });
            }
            out.push(value(k as isize + 1));
        }
        out
    }

    /// Weights of the samples around each instant between two, where a period has so many sub-intervals; the
    /// sample before the instant is the last of the first half.
    #[must_use]
    pub fn between(self, substeps: usize) -> Vec<Vec<f64>> {
        (1..substeps)
            .map(|part| self.weights(part as f64 / substeps as f64))
            .collect()
    }

    /// Weights of the samples around an instant at this share of a period: as many before it as behind it.
    fn weights(self, share: f64) -> Vec<f64> {
        if self != Self::BandLimited {
            return vec![1.0 - share, share];
        }
        let reach = REACH as f64;
        let of = |i: usize| {
            let away = share - (i as f64 - (reach - 1.0));
            let window = bessel_i0(KAISER_BETA * (1.0 - (away / reach).powi(2)).max(0.0).sqrt());
            (PI * away).sin() / (PI * away) * window
        };
        let weights: Vec<f64> = (0..2 * REACH).map(of).collect();
        let sum: f64 = weights.iter().sum();
        weights.into_iter().map(|w| w / sum).collect()
    }
}

/// Modified Bessel function of the first kind of order zero, by its series.
fn bessel_i0(x: f64) -> f64 {
    let quarter = 0.25 * x * x;
    (1..40)
        .scan(1.0, |term, k| {
            *term *= quarter / f64::from(k * k);
            Some(*term)
        })
        .sum::<f64>()
        + 1.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sine_runs_on_between_its_samples() {
        let sine = |t: f64| (0.75 * PI * t).sin();
        let drive: Vec<f64> = (0..200).map(|k| sine(f64::from(k))).collect();
        let ends = Intersample::BandLimited.at_ends(&drive, 4);
        assert_eq!(ends.len(), 800);
        for (k, end) in ends.iter().enumerate().take(700).skip(100) {
            assert!(
                (end - sine(0.25 * (k as f64 + 1.0))).abs() < 2e-4,
                "{k}: {end}"
            );
        }
        let straight = Intersample::Linear.at_ends(&[0.0, 4.0, 2.0], 2);
        assert_eq!(straight, [2.0, 4.0, 3.0, 2.0, 2.0, 2.0]);
        assert_eq!(
            Intersample::Linear.at_ends(&[0.0, 4.0, 2.0], 1),
            [4.0, 2.0, 2.0]
        );
    }
}
