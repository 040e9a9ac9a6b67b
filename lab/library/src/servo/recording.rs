//! What the recording behind a model says about dynamics that the model does not have.
//!
//! # How it works
//! A linear part that a model misses (a mode, a wrong damping) leaves a residual that follows the force. With
//! `V` the spectrum of the model's force-equivalent displacement and `E` that of the residual, over
//! half-overlapping Hann windows of all records of one rate,
//!
//! * `|sum E V*| / sum |V|^2` is the missing response itself, um/um;
//! * `3 sqrt(mean |E|^2 / sum |V|^2)` is what noise and everything else in the residual could hide of it
//!   (three standard deviations).
//!
//! Their sum (the least of all rates) is the *level*: a larger missing response is excluded by the recording
//! at that frequency, whatever a fit believed of its standard deviations (Ljung, System Identification 1999,
//! 6.4 and 16.6: model error modelling). Where the drive has no power the level is large, and nothing is
//! excluded. A resonance that is narrower than the window's resolution is seen too small; the level is raised
//! for the least damping ratio that is reckoned with.

use crate::dataset::{Dataset, Role};
use crate::identification::fit::{residual, rms};
use crate::identification::linearisation::{counted_of, fill_left_out};
use crate::identification::noise_floor::noise_floor;
use hysteron_sim::chain::Model;
use hysteron_sim::effect::Place;
use nalgebra::Complex;
use realfft::RealFftPlanner;
use std::f64::consts::TAU;

/// Distance of the lines, Hz: windows of 102 ms.
const LINE_HZ: f64 = 10_000.0 / 1024.0;
/// Slowest record that says anything of modes, Hz.
const LEAST_RATE_HZ: f64 = 2000.0;
/// Share of a record's rate up to which it is believed.
const BELIEVED: f64 = 0.45;
/// Noise bandwidth of a Hann window, in lines.
const HANN_LINES: f64 = 1.5;
/// Least damping ratio that is reckoned with.
pub const LEAST_DAMPING: f64 = 0.01;
/// Lines over which the residual's power is averaged to either side.
const NEIGHBOURS: usize = 6;

/// A line is driven if its share of the force's power is not below this one of the strongest: weaker ones are
/// by-products of the hysteresis.
const DRIVEN: f64 = 1e-5;
/// A missing response is shown where noise alone would hide less than this share of it.
const SHOWN: f64 = 0.2;

/// What a recording knows beside the values of a model.
#[derive(Clone, Debug, Default)]
pub struct ServoRecording {
    /// Frequencies, Hz, evenly spaced from the second line to half the loop's rate.
    pub frequency_hz: Vec<f64>,
    /// Missing response that is not excluded, um/um.
    pub level: Vec<f64>,
    /// The part of it that is there for lack of drive: three standard deviations.
    pub blind: Vec<f64>,
    /// The part of that which the sensor's white noise alone would leave (infinite where it is not known).
    pub by_noise: Vec<f64>,
    /// The missing response that the data show, um/um; zero where they are not driven enough to show one.
    pub missing: Vec<f64>,
    /// The record that drives a frequency most, where one does: at least with this share of its own strongest
    /// line.
    pub driven_by: Vec<Option<String>>,
    /// Noise of the sensor, um RMS, where the data show it.
    pub noise_um: Option<f64>,
    /// Residual over the records that judge the model, or else over those that were fitted, um RMS.
    pub residual_um: f64,
}

/// Sums of spectra over the windows of one rate.
struct Sums {
    transform: std::sync::Arc<dyn realfft::RealToComplex<f64>>,
    hann: Vec<f64>,
    cross: Vec<Complex<f64>>,
    force_power: Vec<f64>,
    residual_power: Vec<f64>,
    windows: f64,
}

impl Sums {
    fn new(rate_hz: f64) -> Self {
        let length = (rate_hz / LINE_HZ).round().max(2.0) as usize;
        let lines = length / 2 + 1;
        Self {
            transform: RealFftPlanner::<f64>::new().plan_fft_forward(length),
            hann: (0..length)
                .map(|i| 0.5 - 0.5 * (TAU * i as f64 / length as f64).cos())
                .collect(),
            cross: vec![Complex::new(0.0, 0.0); lines],
            force_power: vec![0.0; lines],
            residual_power: vec![0.0; lines],
            windows: 0.0,
        }
    }

    fn spectrum(&self, signal: &[f64]) -> Vec<Complex<f64>> {
        let (mut input, mut output) = (
            self.transform.make_input_vec(),
            self.transform.make_output_vec(),
        );
        let mean = signal.iter().sum::<f64>() / signal.len().max(1) as f64;
        input
            .iter_mut()
            .zip(signal.iter().zip(&self.hann))
            .for_each(|(to, (v, w))| *to = (v - mean) * w);
        // The buffers come from the transform itself, so their lengths fit.
        self.transform
            .process(&mut input, &mut output)
            .map(|()| output)
            .unwrap_or_default()
    }

    fn add(&mut self, force: &[f64], missed: &[f64]) {
        let length = self.hann.len();
        for start in (0..(missed.len() + 1).saturating_sub(length)).step_by((length / 2).max(1)) {
            let (v, e) = (
                self.spectrum(&force[start..start + length]),
                self.spectrum(&missed[start..start + length]),
            );
            for (i, (v, e)) in v.iter().zip(&e).enumerate() {
                self.cross[i] += e * v.conj();
                self.force_power[i] += v.norm_sqr();
                self.residual_power[i] += e.norm_sqr();
            }
            self.windows += 1.0;
        }
    }

    /// What white noise of this RMS, um, would hide at a line.
    fn hidden_by(&self, noise_um: f64, line: usize) -> Option<f64> {
        let power = *self.force_power.get(line).filter(|power| **power > 0.0)?;
        let of_window = noise_um.powi(2) * self.hann.iter().map(|w| w * w).sum::<f64>();
        Some(3.0 * (of_window / power).sqrt())
    }

    /// Missing response at a line, and what noise could hide of it.
    fn at(&self, line: usize) -> Option<(f64, f64)> {
        let power = *self.force_power.get(line).filter(|power| **power > 0.0)?;
        let (from, to) = (
            line.saturating_sub(NEIGHBOURS).max(2),
            (line + NEIGHBOURS + 1).min(self.cross.len()),
        );
        let around =
            self.residual_power[from..to].iter().sum::<f64>() / ((to - from) as f64 * self.windows);
        let noise = around.max(self.residual_power[line] / self.windows);
        Some((
            self.cross[line].norm() / power,
            3.0 * (noise / power).sqrt(),
        ))
    }
}

impl ServoRecording {
    /// Of a chain on a data set, for a loop with this sampling period, s.
    #[must_use]
    pub fn seen_with(chain: &Model, dataset: &Dataset, period_s: f64) -> Self {
        let force_chain = {
            let mut to_force = chain.clone();
            to_force
                .effects
                .retain(|e| e.effect.declaration().place <= Place::Hysteresis);
            to_force
        };
        let lines = (0.5 / (period_s * LINE_HZ)) as usize + 1;
        let mut out = Self {
            frequency_hz: (2..lines).map(|i| i as f64 * LINE_HZ).collect(),
            level: vec![f64::INFINITY; lines.saturating_sub(2)],
            blind: vec![f64::INFINITY; lines.saturating_sub(2)],
            by_noise: vec![f64::INFINITY; lines.saturating_sub(2)],
            missing: vec![0.0; lines.saturating_sub(2)],
            driven_by: vec![None; lines.saturating_sub(2)],
            noise_um: noise_floor(dataset).readings_rms_um(dataset),
            residual_um: 0.0,
        };
        // Values that were fitted to a record leave too little of it.
        let judging = [Role::Validate, Role::Identify]
            .into_iter()
            .find(|role| !dataset.with_role(*role).is_empty());
        let mut squares = Vec::new();
        let mut rates_hz: Vec<f64> = Vec::new();
        let mut seen: Vec<(f64, &str, Vec<f64>, Vec<f64>)> = Vec::new();
        for record in &dataset.records {
            if matches!(record.role, Role::Noise | Role::Test) {
                continue;
            }
            let mut missed = residual(chain, record);
            if Some(record.role) == judging {
                squares.extend(counted_of(record, &missed));
            }
            fill_left_out(record, &mut missed, 0.0);
            let mut force = force_chain.simulate(&record.drive())[record.window.clone()].to_vec();
            // What counts of the residual and what made it are gated alike.
            fill_left_out(record, &mut force, 0.0);
            let rate_hz = record.sample_rate_hz;
            if rate_hz >= LEAST_RATE_HZ && !rates_hz.contains(&rate_hz) {
                rates_hz.push(rate_hz);
            }
            seen.push((rate_hz, &record.name, force, missed));
        }
        out.residual_um = rms(&squares);
        for rate_hz in rates_hz {
            let mut sums = Sums::new(rate_hz);
            let mut driven = vec![(0.0, ""); sums.force_power.len()];
            for (_, name, force, missed) in seen.iter().filter(|(rate, ..)| *rate == rate_hz) {
                let before = sums.force_power.clone();
                sums.add(force, missed);
                let of_record: Vec<f64> = sums
                    .force_power
                    .iter()
                    .zip(&before)
                    .map(|(after, before)| after - before)
                    .collect();
                let strongest = of_record.iter().skip(2).copied().fold(0.0, f64::max);
                for (most, power) in driven.iter_mut().zip(of_record) {
                    if power > DRIVEN * strongest && power > most.0 {
                        *most = (power, *name);
                    }
                }
            }
            let strongest = sums.force_power.iter().skip(2).copied().fold(0.0, f64::max);
            for (i, hz) in out
                .frequency_hz
                .iter()
                .enumerate()
                .filter(|(_, hz)| **hz < BELIEVED * rate_hz || rate_hz >= 0.99 / period_s)
            {
                if let Some((missing, hidden)) = sums.at(i + 2) {
                    if driven[i + 2].0 > 0.0 {
                        out.driven_by[i] = Some(driven[i + 2].1.to_owned());
                    }
                    let narrow = 1.0 + HANN_LINES * LINE_HZ / (2.0 * LEAST_DAMPING * hz);
                    out.blind[i] = out.blind[i].min(narrow * hidden);
                    out.level[i] = out.level[i].min(narrow * (missing + hidden));
                    let by_noise = out
                        .noise_um
                        .and_then(|noise_um| sums.hidden_by(noise_um, i + 2));
                    out.by_noise[i] = out.by_noise[i]
                        .min(by_noise.map_or(f64::INFINITY, |by_noise| narrow * by_noise));
                    if sums.force_power[i + 2] > DRIVEN * strongest
                        && by_noise.is_some_and(|by_noise| by_noise < SHOWN * missing)
                    {
                        out.missing[i] = out.missing[i].max(missing);
                    }
                }
            }
        }
        out
    }

    fn at(&self, values: &[f64], hz: f64) -> Option<f64> {
        let (first, last) = (*self.frequency_hz.first()?, *self.frequency_hz.last()?);
        let step = (last - first) / (self.frequency_hz.len().max(2) - 1) as f64;
        let index = ((hz - first) / step).max(0.0);
        let below = (index as usize).min(values.len() - 1);
        let above = (below + 1).min(values.len() - 1);
        // The larger neighbour: between two lines nothing better is known.
        Some(values[below].max(values[above]))
    }

    /// Missing response that is not excluded at a frequency, um/um (infinite where no record is fast enough).
    #[must_use]
    pub fn level_at(&self, hz: f64) -> Option<f64> {
        self.at(&self.level, hz)
    }

    /// The part of it that is there for lack of drive, or for a model that does not describe the data.
    #[must_use]
    pub fn blind_at(&self, hz: f64) -> Option<f64> {
        self.at(&self.blind, hz)
    }

    /// The record that drives a frequency most, if one does.
    #[must_use]
    pub fn driven_by_at(&self, hz: f64) -> Option<&str> {
        let nearest = self
            .frequency_hz
            .iter()
            .zip(&self.driven_by)
            .min_by(|a, b| (a.0 - hz).abs().total_cmp(&(b.0 - hz).abs()))?;
        nearest.1.as_deref()
    }

    /// What is there for lack of drive, whatever the model.
    #[must_use]
    pub fn noise_hides_at(&self, hz: f64) -> Option<f64> {
        self.at(&self.by_noise, hz)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::Record;
    use hysteron_sim::chain::EffectInstance;
    use hysteron_sim::effect::{Overview, by_id};

    #[test]
    fn the_residual_is_that_of_the_records_that_judge() {
        let drive_v: Vec<f64> = (0..4000).map(|k| f64::from(k % 400) / 4.0).collect();
        let record = |name: &str, off_um: f64| {
            let off = |k: usize| if k.is_multiple_of(2) { off_um } else { -off_um };
            let reads = |k: usize| 0.1 * drive_v[k.saturating_sub(1)] + off(k);
            let displacement_um = (0..drive_v.len()).map(reads).collect();
            Record::new(name, 20_000.0, drive_v.clone(), displacement_um)
        };
        let records = vec![
            record("fitted", 0.002),
            record("held_out", 0.05).with_role(Role::Validate),
        ];
        let mut chain = Model::new(0.0, 100.0);
        let overview = Overview::without_data(0.0, 100.0);
        chain.add(EffectInstance::new(
            by_id("gain").unwrap(),
            &overview,
            &[0.1],
        ));
        let dataset = Dataset::unchecked("d", 0.0, 100.0, records);
        let seen = ServoRecording::seen_with(&chain, &dataset, 5e-5);
        assert!(
            (seen.residual_um - 0.05).abs() < 1e-3,
            "{}",
            seen.residual_um
        );
    }
}
