//! Where one more mode would follow the residual: a scan over frequency and damping, on spectra.
//!
//! It gives first guesses only. A record without a period leaks between its lines, which a guess bears.

use super::fit::{Problem, Signals};
use crate::dataset::Role;
use crate::spectrum::lines;
use nalgebra::{Complex, DMatrix, DVector};
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
    pub(super) fn of(problem: &Problem, signals: &Signals, residual: &DVector<f64>) -> Self {
        let mut planner = RealFftPlanner::new();
        let sensors = problem.data.sensors.len();
        let mut at = 0;
        let mut records = Vec::new();
        for (n, record) in problem.data.of_role(Role::Identify) {
            let samples = record.counted_to - record.counted_from;
            let drives = (0..record.drives.len()).map(|j| lines(problem.counted_drive(signals, n, j), &mut planner)).collect();
            let of_sensor = |i: usize| residual.rows(at + i * samples, samples).iter().copied().collect::<Vec<f64>>();
            let residual = (0..sensors).map(|i| lines(of_sensor(i), &mut planner)).collect();
            at += sensors * samples;
            let weights = (0..sensors).map(|i| problem.weight(n, i)).collect();
            records.push(OfRecord { sample_rate_hz: record.sample_rate_hz, samples, drives, residual, weights });
        }
        Self { records, sensors }
    }

    /// What each sensor's residual has of a mode that one drive moves: its squares are what the mode lowers.
    pub(super) fn shares_of_mode(&self, drive: usize, frequency_hz: f64, damping: f64) -> Vec<f64> {
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
        across.iter().zip(&own).map(|(across, own)| if *own > 0.0 { across / own.sqrt() } else { 0.0 }).collect()
    }

    /// The participations of all drives with which one mode follows all sensors best, the largest of them 1,
    /// and by how much it lowers the squares.
    pub(super) fn of_all_drives(&self, frequency_hz: f64, damping: f64) -> (Vec<f64>, f64) {
        let drives = self.records.first().map_or(0, |record| record.drives.len());
        let shares: Vec<Vec<f64>> = (0..drives).map(|drive| self.shares_of_mode(drive, frequency_hz, damping)).collect();
        let shares = DMatrix::from_fn(self.sensors, drives, |i, j| shares[j][i]);
        let Some(svd) = shares.try_svd(false, true, f64::EPSILON, 0) else { return (vec![0.0; drives], 0.0) };
        let strongest = svd.singular_values.imax();
        let Some(right) = &svd.v_t else { return (vec![0.0; drives], 0.0) };
        let by_power: Vec<f64> = (0..drives).map(|j| right[(strongest, j)] / self.power(j).sqrt().max(f64::MIN_POSITIVE)).collect();
        let largest = by_power.iter().copied().fold(0.0_f64, |m, b| if b.abs() > m.abs() { b } else { m });
        let participations = by_power.iter().map(|b| if largest == 0.0 { 0.0 } else { b / largest }).collect();
        (participations, svd.singular_values[strongest].powi(2))
    }

    fn power(&self, drive: usize) -> f64 {
        self.records.iter().flat_map(|record| &record.drives[drive]).map(Complex::norm_sqr).sum()
    }

    /// The frequency and damping near a guess at which a mode follows a sensor best.
    pub(super) fn refined(&self, drive: usize, sensor: usize, guess: [f64; 2], apart: f64) -> [f64; 2] {
        best_near(guess, apart, |at| self.shares_of_mode(drive, at[0], at[1])[sensor].powi(2))
    }

    /// The same for all drives and sensors.
    pub(super) fn refined_of_all(&self, guess: [f64; 2], apart: f64) -> [f64; 2] {
        best_near(guess, apart, |at| self.of_all_drives(at[0], at[1]).1)
    }
}

/// The frequency and damping near a guess at which a mode lowers the squares most.
fn best_near(guess: [f64; 2], apart: f64, fall: impl Fn([f64; 2]) -> f64) -> [f64; 2] {
    let (mut best, mut best_fall) = (guess, fall(guess));
    let (mut of_frequency, mut of_damping) = (apart, 1.0_f64);
    for _ in 0..REFINEMENTS {
        let around = [[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]];
        let tried = around.map(|[f, d]| {
            let damping = (best[1] * (d * of_damping).exp()).clamp(DAMPING_RANGE[0], DAMPING_RANGE[1]);
            [best[0] * (f * of_frequency).exp(), damping]
        });
        let falls = tried.map(&fall);
        match (0..tried.len()).filter(|n| falls[*n] > best_fall).max_by(|a, b| falls[*a].total_cmp(&falls[*b])) {
            Some(n) => (best, best_fall) = (tried[n], falls[n]),
            None => (of_frequency, of_damping) = (0.5 * of_frequency, 0.5 * of_damping),
        }
    }
    best
}

/// Steps of a search by halving: eight halvings end at a hundredth of a scan's spacing.
const REFINEMENTS: usize = 24;
const DAMPING_RANGE: [f64; 2] = [1e-3, 0.9];

#[cfg(test)]
mod tests {
    use super::*;
    use crate::several_axes::recordings::{AxesData, AxesRecord};
    use crate::several_axes::structure::Described;
    use hysteron_sim::several_axes::{ModalStage, StageMode};
    use hysteron_sim::waveform::multisine;

    #[test]
    fn a_mode_shows_how_much_each_drive_moves_it() {
        let mut stage = ModalStage::at_rest(2, 2);
        stage.modes.push(StageMode { of_drives: vec![-0.4, 1.0], of_sensors: vec![0.3, 0.1], ..StageMode::linear(210.0, 0.02, 2, 2) });
        let lines: Vec<usize> = (1..600).collect();
        let drives: Vec<Vec<f64>> = (0..2).map(|j| multisine(2048, &lines, 1.0, 0.0, 3, 7 + j)).collect();
        let readings = stage.simulate(&drives, 1.0 / 6400.0, true);
        let record = AxesRecord::new("r", 6400.0, Role::Identify, drives, readings).averaged(2048, 2048).unwrap();
        let judging = AxesRecord { role: Role::Validate, ..record.clone() };
        let data = AxesData::new("two drives", vec![record, judging]).unwrap();
        let problem = Problem::new(&data);
        let signals = problem.simulate(&Described::empty(&data).stage);
        let spectra = ResidualSpectra::of(&problem, &signals, &problem.residual(&signals, Role::Identify));
        let found = spectra.refined_of_all([200.0, 0.05], 0.03);
        let (of_drives, _) = spectra.of_all_drives(found[0], found[1]);
        // Lines of 2048 samples are 3.1 Hz apart. The few at the mode share its motion among the drives.
        assert!((found[0] - 210.0).abs() < 6400.0 / 2048.0, "{found:?}");
        assert!((-0.8..-0.2).contains(&of_drives[0]) && (of_drives[1] - 1.0).abs() < 1e-12, "{of_drives:?}");
    }
}
