//! White noise of a sensor: normally distributed, from a seed.

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
        Self { std_um, random: Pcg64Mcg::seed_from_u64(seed) }
    }

    /// The next value, um.
    pub fn next_um(&mut self) -> f64 {
        let unit: f64 = StandardNormal.sample(&mut self.random);
        self.std_um * unit
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn mean_and_spread_are_those_asked_for() {
        let mut noise = WhiteNoise::new(0.003, 4);
        let values: Vec<f64> = (0..40_000).map(|_| noise.next_um()).collect();
        let mean = values.iter().sum::<f64>() / 40_000.0;
        let std = (values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / 40_000.0).sqrt();
        // Standard errors: 0.5 % of the spread for the mean, 0.35 % for the spread.
        assert!(mean.abs() < 5.0 * 0.005 * 0.003 && (std / 0.003 - 1.0).abs() < 0.02, "{mean} {std}");
        assert_eq!(WhiteNoise::new(1.0, 9).next_um(), WhiteNoise::new(1.0, 9).next_um());
    }
}
