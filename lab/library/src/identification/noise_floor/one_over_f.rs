//! Noise that is the stronger the slower it is. The electronics of most sensors have it below some ten hertz:
//! a white part and one whose power density falls with the frequency (1/f, flicker noise). A longer record
//! holds more of it than a short rest, and a floor that is taken from the rest alone would call the
//! difference a missing effect.
//!
//! What a rest has left without drift and lines is fitted by `s (1 + c/f)` (Whittle's likelihood, Arkiv Mat.
//! 2 (1953) 423-434), and the fitted density is summed over the frequencies that a record of another length
//! can hold.

use super::random_part::periodogram;
use crate::dataset::Record;
use serde::Serialize;

/// The first lines of the transform are what the removed drift left of them, and what it left of itself where
/// it was no polynomial.
const FIRST_LINE: usize = 10;
/// Least twice the logarithm of the likelihood ratio by which the noise is no longer taken for white: chance
/// reaches it once in a million rests.
const BEYOND_CHANCE: f64 = 25.0;
/// Corner frequencies that are tried between the first line and half the sampling rate, and how often the
/// best one is halved in.
const CORNERS: usize = 40;
const REFINEMENTS: usize = 20;
/// How far beside the best corner, in its logarithm, the curvature of the likelihood is taken.
const ASIDE: f64 = 0.2;
/// `ln(2 pi) + Euler's constant - 1`: a record without its mean holds so much more of 1/f noise than the
/// logarithm of its lines says, since what is slower than the record leaks into them.
const SLOWER_THAN_THE_RECORD: f64 = 1.415;
/// Sum of `1/k^2` over all lines: the scatter of the power of 1/f noise.
const SCATTER_OF_LINES: f64 = 1.645;

/// Noise with a white part and one that falls with the frequency.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct OneOverFNoise {
    /// RMS of the white part, sample by sample, um.
    pub white_um: f64,
    /// Amplitude density of the other part at 1 Hz, um per root of a hertz; it falls with the root of the
    /// frequency.
    pub at_1_hz_um: f64,
    /// Standard deviation of the power of that part as a share of it: a short rest has few slow lines.
    pub power_relative_std: f64,
    /// Up to where it was seen, Hz.
    pub up_to_hz: f64,
}

impl OneOverFNoise {
    /// The noise of a rest, from what is left of it without drift and lines; nothing where it is white as far
    /// as the rest shows.
    pub(super) fn of_rest(residual_um: &[f64], sample_rate_hz: f64) -> Option<Self> {
        let n = residual_um.len();
        let power: Vec<(f64, f64)> = periodogram(residual_um)
            .into_iter()
            .enumerate()
            .take(n.div_ceil(2))
            .skip(FIRST_LINE)
            .map(|(line, power)| (line as f64 * sample_rate_hz / n as f64, power))
            .collect();
        let (first_hz, last_hz) = (power.first()?.0, power.last()?.0);
        // The white part that fits beside a corner, and twice the negative logarithm of the likelihood.
        let fitted = |corner_hz: f64| -> (f64, f64) {
            let white = power
                .iter()
                .map(|(f, p)| p / (1.0 + corner_hz / f))
                .sum::<f64>()
                / power.len() as f64;
            let shape: f64 = power.iter().map(|(f, _)| (1.0 + corner_hz / f).ln()).sum();
            (white, 2.0 * (power.len() as f64 * white.ln() + shape))
        };
        let ratio = (last_hz / first_hz).powf(1.0 / (CORNERS - 1) as f64);
        let corners = (0..CORNERS).map(|i| first_hz * ratio.powi(i as i32));
        let mut corner_hz = corners.min_by(|a, b| fitted(*a).1.total_cmp(&fitted(*b).1))?;
        let mut width = ratio.sqrt();
        for _ in 0..REFINEMENTS {
            corner_hz = [corner_hz / width, corner_hz, corner_hz * width]
                .into_iter()
                .min_by(|a, b| fitted(*a).1.total_cmp(&fitted(*b).1))?;
            width = width.sqrt();
        }
        let (white, deviance) = fitted(corner_hz);
        // How sharply the likelihood falls beside its summit.
        let beside =
            fitted(corner_hz * ASIDE.exp()).1 + fitted(corner_hz / ASIDE.exp()).1 - 2.0 * deviance;
        (fitted(0.0).1 - deviance > BEYOND_CHANCE && beside > 0.0).then(|| Self {
            power_relative_std: (2.0 * ASIDE * ASIDE / beside).sqrt(),
            white_um: white.sqrt(),
            at_1_hz_um: (2.0 * white * corner_hz / sample_rate_hz).sqrt(),
            up_to_hz: 0.5 * sample_rate_hz,
        })
    }

    /// Power of the falling part in a record of this length without its mean, um^2.
    fn falling_um2(&self, seconds: f64) -> f64 {
        self.at_1_hz_um.powi(2) * ((self.up_to_hz * seconds).max(1.0).ln() + SLOWER_THAN_THE_RECORD)
    }

    /// RMS of the noise in a record, um: the same sensor, read for longer.
    #[must_use]
    pub fn in_record_um(&self, record: &Record) -> f64 {
        (self.white_um.powi(2) + self.falling_um2(record.window.len() as f64 * record.dt_s()))
            .sqrt()
    }

    /// Standard deviation of that RMS as a share of it: of its estimate, and from one record to another,
    /// since few slow lines hold much of the power.
    #[must_use]
    pub fn relative_std(&self, record: &Record) -> f64 {
        let falling_um2 = self.falling_um2(record.window.len() as f64 * record.dt_s());
        let between_records_um2 = self.at_1_hz_um.powi(2) * SCATTER_OF_LINES.sqrt();
        0.5 * between_records_um2.hypot(self.power_relative_std * falling_um2)
            / self.in_record_um(record).powi(2)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::statistics::{mean, rms};
    use hysteron_sim::noise::{FlickerNoise, WhiteNoise};

    const RATE_HZ: f64 = 2000.0;

    fn noise(at_1_hz_um: f64, white_um: f64, samples: usize, seed: u64) -> Vec<f64> {
        let (mut slow, mut white) = (
            FlickerNoise::new(at_1_hz_um, RATE_HZ, seed),
            WhiteNoise::new(white_um, 1000 + seed),
        );
        let mut values: Vec<f64> = (0..samples)
            .map(|_| slow.next_um() + white.next_um())
            .collect();
        let mean = mean(&values);
        values.iter_mut().for_each(|v| *v -= mean);
        values
    }

    #[test]
    fn white_noise_is_white() {
        for seed in 0..40 {
            assert_eq!(
                OneOverFNoise::of_rest(&noise(0.0, 0.004, 4000, seed), RATE_HZ),
                None,
                "{seed}"
            );
        }
    }

    /// A stage that warms up is no noise, however far it goes.
    #[test]
    fn drift_is_no_noise() {
        for seed in 0..20 {
            let tau_samples = 4000.0 * [0.3, 1.0, 3.0][seed as usize % 3];
            let white = noise(0.0, 0.004, 4000, seed);
            let drifting: Vec<f64> = (white.iter().enumerate())
                .map(|(k, v)| v + 0.5 * (-(k as f64) / tau_samples).exp())
                .collect();
            let residual = super::super::random_part::random(&drifting, RATE_HZ, None).residual;
            assert_eq!(OneOverFNoise::of_rest(&residual, RATE_HZ), None, "{seed}");
        }
    }

    /// Both parts of it, and what it comes to in records ten times as long.
    #[test]
    fn what_a_rest_shows_holds_in_longer_records() {
        let (mut densities, mut ratios) = (Vec::new(), Vec::new());
        for seed in 0..20 {
            let found = OneOverFNoise::of_rest(&noise(0.001, 0.004, 4000, seed), RATE_HZ)
                .expect("it has 1/f noise");
            densities.push(found.at_1_hz_um);
            let long = noise(0.001, 0.004, 40_000, 500 + seed);
            let rms_um = rms(&long);
            ratios.push(
                found.in_record_um(&Record::new("long", RATE_HZ, vec![0.0; 40_000], long)) / rms_um,
            );
        }
        assert!(
            (mean(&densities) / 0.001 - 1.0).abs() < 0.1,
            "{}",
            mean(&densities)
        );
        assert!((mean(&ratios) - 1.0).abs() < 0.04, "{}", mean(&ratios));
        // As far apart as reported: of twenty, two may be beyond two standard deviations, none beyond three
        // and a half.
        let of_one = |seed: u64| {
            let found = OneOverFNoise::of_rest(&noise(0.001, 0.004, 4000, seed), RATE_HZ)
                .expect("it has 1/f noise");
            found.relative_std(&Record::new(
                "long",
                RATE_HZ,
                vec![0.0; 40_000],
                vec![0.0; 40_000],
            ))
        };
        let z: Vec<f64> = ratios
            .iter()
            .zip(0..)
            .map(|(ratio, seed)| (ratio - 1.0) / of_one(seed))
            .collect();
        assert!(
            z.iter().filter(|z| z.abs() > 2.0).count() <= 2 && z.iter().all(|z| z.abs() < 3.5),
            "{z:?}"
        );
    }
}
