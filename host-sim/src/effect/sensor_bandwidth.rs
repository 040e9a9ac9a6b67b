//! Bandwidth of the sensor: its reading follows the displacement as a first-order lag.
//!
//! Where the model has inertia, the vibration stage takes the lag in: together they are one linear system,
//! exact for a held force. Without inertia the displacement itself steps or glides ([`super::arrival`]).

use super::arrival::{Arrival, Over};
use crate::block::{Block, Linear};
use crate::linear_system::ContinuousSystem;
use crate::physics::*;
use nalgebra::{DMatrix, DVector};

/// Identifier in files and on the command line.
pub const ID: &str = id::SENSOR_BANDWIDTH;

/// First-order lag behind everything mechanical.
pub struct SensorBandwidth;

/// One interval: what is left of the reading, and what start and end of the displacement add.
#[derive(Clone, Copy)]
struct Interval {
    left: f64,
    by_start: f64,
    by_end: f64,
}

impl Interval {
    fn from_bandwidth(bandwidth_hz: f64, arrival: Arrival, dt_s: f64) -> Self {
        let rate = std::f64::consts::TAU * bandwidth_hz;
        let one = |value: f64| DVector::from_element(1, value);
        let lag = ContinuousSystem {
            a: DMatrix::from_element(1, 1, -rate),
            b: one(rate),
            c: one(1.0),
            d: 0.0,
        };
        let Over { start, end, .. } = arrival.over(&lag, dt_s);
        Self {
            left: (-rate * dt_s).exp(),
            by_start: start[0],
            by_end: end[0],
        }
    }

    #[inline]
    fn step(&self, reading: f64, before: f64, input: f64) -> f64 {
        self.left * reading + (self.by_start * before + self.by_end * input)
    }
}

struct SensorLag {
    interval: Interval,
    before: f64,
    reading: f64,
}

impl Stage for SensorLag {
    fn step(&mut self, _k: usize, input: f64) -> f64 {
        self.reading = self.interval.step(self.reading, self.before, input);
        self.before = input;
        self.reading
    }
    fn blocks(&self) -> Result<Vec<Block>, &'static str> {
        let Interval {
            left,
            by_start,
            by_end,
        } = self.interval;
        Ok(vec![Block::Linear(Linear::reading_states(
            vec![vec![left]],
            vec![by_start],
            vec![by_end],
            &[1.0],
            0.0,
            vec![1.0],
        ))])
    }
    fn settle(&mut self, input: f64) -> f64 {
        (self.reading, self.before) = (input, input);
        input
    }
    fn linear_lanes(&self, lanes: usize) -> Option<Box<dyn LinearLanes>> {
        Some(Box::new(LagLanes {
            interval: self.interval,
            readings: vec![0.0; lanes],
            before: vec![0.0; lanes],
        }))
    }
}

struct LagLanes {
    interval: Interval,
    readings: Vec<f64>,
    before: Vec<f64>,
}

impl LinearLanes for LagLanes {
    fn settle(&mut self, row: &mut [f64]) {
        self.readings.copy_from_slice(row);
        self.before.copy_from_slice(row);
    }
    fn run(&mut self, block: &mut [f64]) {
        for row in block.chunks_exact_mut(self.readings.len()) {
            for ((value, reading), before) in
                row.iter_mut().zip(&mut self.readings).zip(&mut self.before)
            {
                *reading = self.interval.step(*reading, *before, *value);
                *before = *value;
                *value = *reading;
            }
        }
    }
}

impl Effect for SensorBandwidth {
    fn declaration(&self) -> Declaration {
        Declaration {
            id: ID.into(),
            physics: "The sensor's electronics filter what they read: fast motion appears smaller and later.".into(),
            reference: "Fleming, Sensors and Actuators A 190 (2013) 106-126".into(),
            modifies: Some(id::VIBRATION),
            experiment: "multisines up to a third of the sampling rate".into(),
            one_sided: true,
            picture: Picture {
                against: Against::Frequency,
                caption: "A dynamic effect: the residual stands where the signature has its power.",
            },
            equations: r"`y' = 2 pi bandwidth_hz (x - y)`. Behind `vibration` it is a further state of the modes; without it, it is exact for an input that arrives as *Arrival* says. At rest `y = x`.",
            ..Declaration::at(Place::SensorBandwidth)
        }
    }

    fn parameters(&self, overview: &Overview) -> Vec<Parameter> {
        lag_parameters(overview)
    }

    fn starts(&self, overview: &Overview) -> Vec<Vec<f64>> {
        let by_data_sheet = overview
            .sensor_bandwidth_hz
            .map(|bandwidth_hz| vec![bandwidth_hz]);
        by_data_sheet
            .into_iter()
            .chain(lag_starts(overview))
            .collect()
    }

    fn goes_by_ends(&self, model: &Model) -> bool {
        model.effect(id::VIBRATION).is_some()
    }

    fn stage<'a>(&self, from: &Build<'_, 'a>) -> Option<Box<dyn Stage + 'a>> {
        if from.model.effect(id::VIBRATION).is_some() {
            return None;
        }
        let interval = Interval::from_bandwidth(
            from.values[0],
            Arrival::from_model(from.model, from.setting),
            from.setting.dt_s,
        );
        Some(Box::new(SensorLag {
            interval,
            before: 0.0,
            reading: 0.0,
        }))
    }

    fn free_motions(&self, _model: &Model, values: &[f64]) -> Vec<FreeMotion> {
        vec![FreeMotion {
            decay_per_s: std::f64::consts::TAU * values[0],
            frequency_rad_s: 0.0,
        }]
    }

    fn values_at(&self, case: &mut PlantedCase) -> Option<Vec<f64>> {
        Some(vec![2500.0 / case.strength.max(0.01)])
    }
}

#[cfg(test)]
mod tests {
    use crate::chain::{Drive, InitialState};
    use crate::effect::{Overview, model_of};

    /// The reading after a step through mode and sensor, by Euler's method in a hundred-thousandth of the
    /// period.
    fn by_euler(
        natural_frequency_rad_s: f64,
        damping_ratio: f64,
        bandwidth_hz: f64,
        until_s: f64,
    ) -> f64 {
        let (w, steps) = (natural_frequency_rad_s, 400_000);
        let h = until_s / f64::from(steps);
        let (mut x, mut v, mut reading) = (0.0, 0.0, 0.0);
        for _ in 0..steps {
            let acceleration = w * w * (1.0 - x) - 2.0 * damping_ratio * w * v;
            reading += h * std::f64::consts::TAU * bandwidth_hz * (x - reading);
            x += h * v;
            v += h * acceleration;
        }
        reading
    }

    #[test]
    fn mode_and_sensor_are_exact_in_fast_and_slow_records() {
        let model = model_of(
            &Overview::without_data(0.0, 1.0),
            &[
                ("vibration", &[3000.0, 0.25]),
                ("sensor_bandwidth", &[800.0]),
            ],
        );
        for dt_s in [5e-5, 5e-4, 5e-3] {
            let drive = Drive::held(&[1.0; 4], dt_s, InitialState::Virgin);
            let reading = model.simulate(&drive);
            for k in 1..4 {
                let expected = by_euler(3000.0, 0.25, 800.0, k as f64 * dt_s);
                assert!(
                    (reading[k] - expected).abs() < 3e-4,
                    "{dt_s} {k}: {} {expected}",
                    reading[k]
                );
            }
        }
    }
}
