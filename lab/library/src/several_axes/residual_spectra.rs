//! Where one more mode would follow the residual: a scan over frequency and damping, on spectra.
//!
//! It gives first guesses only. A record without a period leaks between its lines, which a guess bears.

use super::fit::{Problem, Signals};
use crate::dataset::Role;
use crate::spectrum::lines;
use nalgebra::{Complex, DVector};
use realfft::RealFftPlanner;
use std::f64::consts::PI;

/// Spectra of what counts in the records that are fitted.
pub(super) struct ResidualSpectra {
    records: Vec<OfRecord>,
    sensors: usize,
}

struct OfRecord {
    sample_rate_hz: f64,
    samples: usize,
    drives: Vec<Vec<Complex<f64>>>,
    residual: Vec<Vec<Complex<f64>>>,
    weights: Vec<f64>,
}

impl ResidualSpectra {
    pub(super) fn from_residual(
        problem: &Problem,
        signals: &Signals,
        residual: &DVector<f64>,
    ) -> Self {
        let mut planner = RealFftPlanner::new();
        let sensors = problem.data.sensors.len();
        let mut at = 0;
        let mut records = Vec::new();
        for (n, record) in problem.data.of_role(Role::Identify) {
            let samples = record.counted_to - record.counted_from;
            let drives = (0..record.drives.len())
                .map(|j| lines(problem.counted_drive(signals, n, j), &mut planner))
                .collect();
            let of_sensor = |i: usize| {
                residual
                    .rows(at + i * samples, samples)
                    .iter()
                    .copied()
                    .collect::<Vec<f64>>()
            };
            let residual = (0..sensors)
                .map(|i| lines(of_sensor(i), &mut planner))
                .collect();
            at += sensors * samples;
            let weights = (0..sensors).map(|i| problem.weight(n, i)).collect();
            records.push(OfRecord {
                sample_rate_hz: record.sample_rate_hz,
                samples,
                drives,
                residual,
                weights,
            });
        }
        Self { records, sensors }
    }

    /// By how much a mode that one drive moves lowers the squares of each sensor.
    pub(super) fn falls_by_mode(&self, drive: usize, frequency_hz: f64, damping: f64) -> Vec<f64> {
        let mut across = vec![0.0; self.sensors];
        let mut own = vec![0.0; self.sensors];
        for record in &self.records {
            let per_line = record.sample_rate_hz / record.samples as f64;
            let mut squares = 0.0;
            let mut products = vec![0.0; self.sensors];
            for (line, drive) in record.drives[drive].iter().enumerate().skip(1) {
                let ratio = line as f64 * per_line / frequency_hz;
                // A drive that is held lags by half a period.
                let lag = Complex::from_polar(1.0, -PI * line as f64 / record.samples as f64);
                let motion = drive * lag / Complex::new(1.0 - ratio * ratio, 2.0 * damping * ratio);
                squares += motion.norm_sqr();
                for (product, residual) in products.iter_mut().zip(&record.residual) {
                    *product += motion.re * residual[line].re + motion.im * residual[line].im;
                }
            }
            for i in 0..self.sensors {
                across[i] += record.weights[i] * products[i] / record.samples as f64;
                own[i] += record.weights[i].powi(2) * squares / record.samples as f64;
            }
        }
        across
            .iter()
            .zip(&own)
            .map(|(across, own)| {
                if *own > 0.0 {
                    across * across / own
                } else {
                    0.0
                }
            })
            .collect()
    }

    /// The frequency and damping near a guess at which a mode follows a sensor best.
    pub(super) fn refined(
        &self,
        drive: usize,
        sensor: usize,
        guess: [f64; 2],
        apart: f64,
    ) -> [f64; 2] {
        let fall = |at: [f64; 2]| self.falls_by_mode(drive, at[0], at[1])[sensor];
        let (mut best, mut best_fall) = (guess, fall(guess));
        let (mut of_frequency, mut of_damping) = (apart, 1.0_f64);
        for _ in 0..REFINEMENTS {
            let around = [[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]];
            let tried = around.map(|[f, d]| {
                let damping =
                    (best[1] * (d * of_damping).exp()).clamp(DAMPING_RANGE[0], DAMPING_RANGE[1]);
                [best[0] * (f * of_frequency).exp(), damping]
            });
            let falls = tried.map(fall);
            match (0..tried.len())
                .filter(|n| falls[*n] > best_fall)
                .max_by(|a, b| falls[*a].total_cmp(&falls[*b]))
            {
                Some(n) => (best, best_fall) = (tried[n], falls[n]),
                None => (of_frequency, of_damping) = (0.5 * of_frequency, 0.5 * of_damping),
            }
        }
        best
    }
}

/// Steps of a search by halving: eight halvings end at a hundredth of a scan's spacing.
const REFINEMENTS: usize = 24;
const DAMPING_RANGE: [f64; 2] = [1e-3, 0.9];
