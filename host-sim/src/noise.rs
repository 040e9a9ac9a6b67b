//! Noise of a sensor from a seed, normally distributed: white, or the stronger the slower it is (1/f).

use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64Mcg;

/// Independent normal values; the same seed gives the same ones.
#[derive(Clone, Debug)]
pub struct WhiteNoise {
    std_um: f64,
    random: Pcg64Mcg,
}

impl WhiteNoise {
    /// Noise of this standard deviation, um.
    #[must_use]
    pub fn new(std_um: f64, seed: u64) -> Self {
        Self {
            std_um,
            random: Pcg64Mcg::seed_from_u64(seed),
        }
    }

    /// The next value, um.
    pub fn next_um(&mut self) -> f64 {
        let unit: f64 = StandardNormal.sample(&mut self.random);
        self.std_um * unit
    }
}

/// Lowest frequency down to which flicker noise goes on rising, Hz: a thousand seconds.
const FLICKER_FROM_HZ: f64 = 1e-3;
/// Lags for each decade of frequency: the density is 0.96 to 1.00 of the straight fall that was asked for,
/// three decades from either end.
const LAGS_PER_DECADE: f64 = 2.0;

/// Noise whose power density falls with the frequency (1/f): a sum of first-order lags of white noise whose
/// corner frequencies are spread evenly over the logarithm of the frequency, each with the same power
/// (Keshner, Proc. IEEE 70 (1982) 212-218). It begins anywhere, as a sensor that has long been on.
#[derive(Clone, Debug)]
pub struct FlickerNoise {
    /// Decay from sample to sample and what is added, um, of each lag.
    lags: Vec<(f64, f64)>,
    states_um: Vec<f64>,
    random: Pcg64Mcg,
}

impl FlickerNoise {
    /// Noise of this amplitude density at 1 Hz, um per root of a hertz (one-sided), at a sampling rate; the
    /// same seed gives the same noise.
    #[must_use]
    pub fn new(at_1_hz_um: f64, sample_rate_hz: f64, seed: u64) -> Self {
        let mut random = Pcg64Mcg::seed_from_u64(seed);
        let decades = (0.5 * sample_rate_hz / FLICKER_FROM_HZ).log10();
        let count = (LAGS_PER_DECADE * decades).ceil().max(1.0) as usize;
        // A decade of 1/f holds ln(10) times its power at 1 Hz.
        let rms_um = at_1_hz_um * (decades / count as f64 * std::f64::consts::LN_10).sqrt();
        let corner_hz =
            |i: usize| FLICKER_FROM_HZ * 10f64.powf((i as f64 + 0.5) * decades / count as f64);
        let decay = |i: usize| (-std::f64::consts::TAU * corner_hz(i) / sample_rate_hz).exp();
        let lags: Vec<(f64, f64)> = (0..count)
            .map(|i| (decay(i), rms_um * (1.0 - decay(i).powi(2)).sqrt()))
            .collect();
        let mut normal = || -> f64 { StandardNormal.sample(&mut random) };
        let states_um = (0..count).map(|_| rms_um * normal()).collect();
        Self {
            lags,
            states_um,
            random,
        }
    }

    /// The next value, um.
    pub fn next_um(&mut self) -> f64 {
        for (state, (decay, added)) in self.states_um.iter_mut().zip(&self.lags) {
            let unit: f64 = StandardNormal.sample(&mut self.random);
            *state = decay * *state + added * unit;
        }
        self.states_um.iter().sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The mean square of differences over a time grows with its logarithm: `2 ln` of the ratio of times,
    /// times the square of the density at 1 Hz.
    #[test]
    fn flicker_noise_has_the_density_that_was_asked_for() {
        let (mut grows, seeds) = (0.0, 40);
        for seed in 0..seeds {
            let mut noise = FlickerNoise::new(0.002, 1000.0, seed);
            let values: Vec<f64> = (0..20_000).map(|_| noise.next_um()).collect();
            let structure = |lag: usize| {
                values
                    .windows(lag + 1)
                    .map(|w| (w[lag] - w[0]).powi(2))
                    .sum::<f64>()
                    / (values.len() - lag) as f64
            };
            grows += (structure(1000) - structure(10)) / f64::from(seeds as u32);
        }
        let expected = 2.0 * 0.002f64.powi(2) * 100f64.ln();
        assert!((grows / expected - 1.0).abs() < 0.1, "{}", grows / expected);
        let mut again = [
            FlickerNoise::new(1.0, 1e3, 9),
            FlickerNoise::new(1.0, 1e3, 9),
        ];
        assert_eq!(again[0].next_um(), again[1].next_um());
    }

    #[test]
    fn mean_and_spread_are_those_asked_for() {
        let mut noise = WhiteNoise::new(0.003, 4);
        let values: Vec<f64> = (0..40_000).map(|_| noise.next_um()).collect();
        let mean = values.iter().sum::<f64>() / 40_000.0;
        let std = (values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / 40_000.0).sqrt();
        // Standard errors: 0.5 % of the spread for the mean, 0.35 % for the spread.
        assert!(
            mean.abs() < 5.0 * 0.005 * 0.003 && (std / 0.003 - 1.0).abs() < 0.02,
            "{mean} {std}"
        );
        assert_eq!(
            WhiteNoise::new(1.0, 9).next_um(),
            WhiteNoise::new(1.0, 9).next_um()
        );
    }
}
