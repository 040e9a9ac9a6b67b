//! Filter of the sensor's electronics: its reading follows the displacement through a second-order low-pass.
//!
//! Most capacitive and strain-gauge electronics end in one, as a rule of Butterworth's form (damping ratio
//! 0.71). It is as a mode by its equation, and told from one by its damping alone: filters are designed flat,
//! mechanical resonances are not.
//!
//! Where a mode moves freely, the vibration stage takes the filter in: together they are one linear system,
//! exact for a held force, in slow records too. Behind a mass that friction holds it reads in sub-intervals.
//! Without inertia the displacement itself steps or glides ([`super::arrival`]).

use super::arrival::{Arrival, Over};
use super::mode::free_motions_of;
use crate::block::{Block, Linear};
use crate::linear_system::ContinuousSystem;
use crate::physics::*;
use nalgebra::{DMatrix, DVector};
use std::f64::consts::{FRAC_1_SQRT_2, TAU};

/// Identifier in files and on the command line.
pub const ID: &str = "sensor_filter";

/// Second-order low-pass behind everything mechanical.
pub struct SensorFilter;

/// Natural frequency, Hz, and damping ratio of the filter of a model whose modes take it in: all of them move
/// freely.
pub(super) fn taken_in_by_modes(model: &Model) -> Option<[f64; 2]> {
    model.effect(id::VIBRATION)?;
    let values = model.values(ID)?;
    super::friction::Bristle::from_model(model)
        .is_none()
        .then(|| [values[0], values[1]])
}

/// A filter with that damping ratio or less would ring for several periods: nobody builds it.
const DESIGNED_DAMPING_MIN: f64 = 0.3;

/// The filter over one interval; states: reading, and its rate over the natural frequency.
#[derive(Clone, Copy)]
struct Interval {
    phi: [f64; 4],
    at_start: [f64; 2],
    at_end: [f64; 2],
}

impl Interval {
    /// `arrival`: how its input goes inside the interval; where it is that of a mass, straight.
    fn new(
        natural_frequency_hz: f64,
        damping_ratio: f64,
        dt_s: f64,
        arrival: Option<Arrival>,
    ) -> Self {
        let w = TAU * natural_frequency_hz;
        let system = ContinuousSystem {
            a: DMatrix::from_row_slice(2, 2, &[0.0, w, -w, -2.0 * damping_ratio * w]),
            b: DVector::from_row_slice(&[0.0, w]),
            c: DVector::from_row_slice(&[1.0, 0.0]),
            d: 0.0,
        };
        let straight = || {
            let (phi, held, slope) = system.straight_matrices(dt_s);
            Over {
                phi,
                start: held - &slope,
                end: slope,
            }
        };
        let Over { phi, start, end } =
            arrival.map_or_else(straight, |arrival| arrival.over(&system, dt_s));
        Self {
            phi: [phi[(0, 0)], phi[(0, 1)], phi[(1, 0)], phi[(1, 1)]],
            at_start: [start[0], start[1]],
            at_end: [end[0], end[1]],
        }
    }

    #[inline]
    fn step(&self, [reading, rate]: [f64; 2], before: f64, input: f64) -> [f64; 2] {
        let Self {
            phi,
            at_start,
            at_end,
        } = self;
        [
            phi[0] * reading + phi[1] * rate + (at_start[0] * before + at_end[0] * input),
            phi[2] * reading + phi[3] * rate + (at_start[1] * before + at_end[1] * input),
        ]
    }
}

/// Whether what the filter reads is the motion of a mass.
fn has_inertia(model: &Model) -> bool {
    model
        .effects
        .iter()
        .any(|e| e.effect.declaration().place == Place::Vibration)
}

struct FilterStage {
    interval: Interval,
    state: [f64; 2],
    before: f64,
}

impl Stage for FilterStage {
    fn step(&mut self, _k: usize, input: f64) -> f64 {
        self.state = self.interval.step(self.state, self.before, input);
        self.before = input;
        self.state[0]
    }
    fn blocks(&self) -> Result<Vec<Block>, &'static str> {
        let Interval {
            phi,
            at_start,
            at_end,
        } = self.interval;
        let phi = vec![phi[..2].to_vec(), phi[2..].to_vec()];
        Ok(vec![Block::Linear(Linear::reading_states(
            phi,
            at_start.to_vec(),
            at_end.to_vec(),
            &[1.0, 0.0],
            0.0,
            vec![1.0, 0.0],
        ))])
    }
    fn settle(&mut self, input: f64) -> f64 {
        (self.state, self.before) = ([input, 0.0], input);
        input
    }
    fn linear_lanes(&self, lanes: usize) -> Option<Box<dyn LinearLanes>> {
        Some(Box::new(FilterLanes {
            interval: self.interval,
            states: vec![[0.0; 2]; lanes],
            before: vec![0.0; lanes],
        }))
    }
}

struct FilterLanes {
    interval: Interval,
    states: Vec<[f64; 2]>,
    before: Vec<f64>,
}

impl LinearLanes for FilterLanes {
    fn settle(&mut self, row: &mut [f64]) {
        self.states
            .iter_mut()
            .zip(&*row)
            .for_each(|(state, input)| *state = [*input, 0.0]);
        self.before.copy_from_slice(row);
    }
    fn run(&mut self, block: &mut [f64]) {
        for row in block.chunks_exact_mut(self.before.len()) {
            for ((value, state), before) in
                row.iter_mut().zip(&mut self.states).zip(&mut self.before)
            {
                *state = self.interval.step(*state, *before, *value);
                *before = *value;
                *value = state[0];
            }
        }
    }
}

impl Effect for SensorFilter {
    fn declaration(&self) -> Declaration {
        Declaration {
            id: ID.into(),
            physics: "A second-order low-pass in the sensor's electronics: fast motion appears later and, beyond its frequency, smaller."
            .into(),
            reference: "Fleming, Sensors and Actuators A 190 (2013) 106-126; Butterworth, Wireless Engineer 7 (1930) 536-541".into(),
            modifies: Some(id::VIBRATION),
            experiment: "multisines up to a third of the sampling rate".into(),
            one_sided: true,
            follows_motion: true,
            picture: Picture {
                against: Against::Frequency,
                caption: "A dynamic effect: the residual stands where the signature has its power.",
            },
            equations: r"`y'' + 2 damping_ratio w y' + w^2 y = w^2 x`, `w = 2 pi natural_frequency_hz`. Behind `vibration` without friction it is two further states of the modes, behind `sensor_bandwidth` where there is one; otherwise it is a stage of its own,
exact for an input that arrives as *Arrival* says, or, behind a mass that friction holds, that runs straight. At rest `y = x`.",
            ..Declaration::at(Place::SensorBandwidth)
        }
    }

    fn parameters(&self, overview: &Overview) -> Vec<Parameter> {
        let highest_hz = 0.5 * overview.sample_rate_max_hz;
        vec![
            Parameter::logarithmic(
                "natural_frequency_hz",
                "Hz",
                1e-4 * overview.sample_rate_max_hz,
                highest_hz,
            ),
            // With less it would be a mode, which nobody builds into a sensor; with more its two poles part,
            // and the slower one alone is a bandwidth of the sensor.
            Parameter::logarithmic("damping_ratio", "1", DESIGNED_DAMPING_MIN, 1.0),
        ]
    }

    fn starts(&self, overview: &Overview) -> Vec<Vec<f64>> {
        let by_data_sheet = overview.sensor_bandwidth_hz;
        let elsewhere = [0.25, 0.12, 0.06].map(|share| share * overview.sample_rate_max_hz);
        by_data_sheet
            .into_iter()
            .chain(elsewhere)
            .map(|frequency_hz| vec![frequency_hz, FRAC_1_SQRT_2])
            .collect()
    }

    fn stage<'a>(&self, from: &Build<'_, 'a>) -> Option<Box<dyn Stage + 'a>> {
        if taken_in_by_modes(from.model).is_some() {
            return None;
        }
        let arrival =
            (!has_inertia(from.model)).then(|| Arrival::from_model(from.model, from.setting));
        let interval = Interval::new(from.values[0], from.values[1], from.setting.dt_s, arrival);
        Some(Box::new(FilterStage {
            interval,
            state: [0.0; 2],
            before: 0.0,
        }))
    }

    fn substeps(&self, model: &Model, dt_s: f64) -> usize {
        if !has_inertia(model) || taken_in_by_modes(model).is_some() {
            return 1;
        }
        // What is read between two instants is taken as straight: finer than others need where records are
        // neither fast nor at rest at every sample.
        let straight = ((dt_s / 31.25e-6).ceil() as usize).min(40);
        substeps_inside_period(dt_s).max(straight)
    }

    fn goes_by_ends(&self, model: &Model) -> bool {
        taken_in_by_modes(model).is_some()
    }

    fn free_motions(&self, _model: &Model, values: &[f64]) -> Vec<FreeMotion> {
        free_motions_of(TAU * values[0], values[1])
    }

    fn values_at(&self, case: &mut PlantedCase) -> Option<Vec<f64>> {
        Some(vec![
            3000.0 / case.strength.max(0.01),
            0.5 + 0.5 * (case.random)(),
        ])
    }
}

#[cfg(test)]
mod tests {
    use crate::chain::{Drive, InitialState, Model};
    use crate::effect::{Overview, Parameter, by_id, model_of};
    use std::f64::consts::TAU;

    fn model(chain: &[(&str, &[f64])], frequency_hz: f64, damping_ratio: f64) -> Model {
        let filter: &[f64] = &[frequency_hz, damping_ratio];
        let effects = [chain, &[("sensor_filter", filter)]].concat();
        model_of(&Overview::without_data(0.0, 1.0), &effects)
    }

    /// Its law is that of a mode, and its frequency the same quantity in another unit.
    #[test]
    fn its_quantities_are_those_of_a_mode() {
        let overview = Overview::without_data(0.0, 1.0);
        let [filter, mode] = ["sensor_filter", "vibration"].map(|id| {
            let effect = by_id(id).unwrap();
            let parameters = effect.parameters(&overview);
            let of = |p: &Parameter| (p.quantity().0.to_owned(), p.quantity().1);
            parameters.iter().map(of).collect::<Vec<_>>()
        });
        let names =
            |of: &[(String, f64)]| of.iter().map(|(name, _)| name.clone()).collect::<Vec<_>>();
        assert_eq!(names(&filter), ["natural_frequency", "damping_ratio"]);
        assert_eq!(names(&filter), names(&mode));
        assert!((filter[0].1 / mode[0].1 - TAU).abs() < 1e-12);
        assert_eq!([filter[1].1, mode[1].1], [1.0; 2]);
    }

    /// Without inertia a step of the drive is a step of the displacement: the reading is the textbook's step
    /// response, exactly.
    #[test]
    fn a_step_is_answered_as_by_the_closed_form() {
        let (frequency_hz, xi, dt_s) = (900.0, 0.6, 1e-4);
        let drive = Drive::held(&[1.0; 40], dt_s, InitialState::Virgin);
        let reading = model(&[("gain", &[1.0])], frequency_hz, xi).simulate(&drive);
        let w = TAU * frequency_hz;
        let damped = (1.0 - xi * xi).sqrt();
        for (k, y) in reading.iter().enumerate() {
            let t = k as f64 * dt_s;
            let expected = 1.0
                - (-xi * w * t).exp()
                    * ((w * damped * t).cos() + xi / damped * (w * damped * t).sin());
            assert!((y - expected).abs() < 1e-9, "{k}: {y} {expected}");
        }
    }

    /// Behind a mode, in fast and slow records: as Euler's method in a hundred-thousandth of the time.
    #[test]
    fn behind_a_mode_it_follows_the_motion_inside_a_period() {
        let (frequency_hz, xi, w) = (1500.0, 0.7, 3000.0);
        let filtered = model(
            &[("gain", &[1.0]), ("vibration", &[w, 0.25])],
            frequency_hz,
            xi,
        );
        let by_euler = |until_s: f64| {
            let (wf, steps) = (TAU * frequency_hz, 400_000);
            let h = until_s / f64::from(steps);
            let (mut x, mut v, mut y, mut rate) = (0.0, 0.0, 0.0, 0.0);
            for _ in 0..steps {
                let (force, drag) = (
                    w * w * (1.0 - x) - 0.5 * w * v,
                    wf * wf * (x - y) - 2.0 * xi * wf * rate,
                );
                x += h * v;
                v += h * force;
                y += h * rate;
                rate += h * drag;
            }
            y
        };
        for dt_s in [5e-5, 5e-4, 5e-3] {
            let drive = Drive::held(&[1.0; 4], dt_s, InitialState::Virgin);
            let reading = filtered.simulate(&drive);
            for k in 1..4 {
                let expected = by_euler(k as f64 * dt_s);
                assert!(
                    (reading[k] - expected).abs() < 3e-4,
                    "{dt_s} {k}: {} {expected}",
                    reading[k]
                );
            }
        }
    }

    /// What is held reads alike at the instants that a slow and a fast record share, behind a mode that
    /// rings, a second one and a lag: the model says nothing of the rate at which it is looked at. In
    /// straight pieces of 125 us the first differs by a hundredth.
    #[test]
    fn a_held_drive_reads_alike_in_slow_and_fast_records() {
        let mode: (&str, &[f64]) = ("vibration", &[2387.6, 0.02]);
        let beside: [&[(&str, &[f64])]; 3] = [
            &[],
            &[("second_mode", &[0.1, 5600.0, 0.02])],
            &[("sensor_bandwidth", &[700.0])],
        ];
        for more in beside {
            let model = model(&[&[("gain", &[1.0][..]), mode], more].concat(), 1500.0, 0.7);
            let slow: Vec<f64> = (0..40)
                .map(|k| f64::from(u8::from(k > 3)) - 0.5 * f64::from(u8::from(k > 20)))
                .collect();
            let fast: Vec<f64> = slow.iter().flat_map(|v| [*v; 100]).collect();
            let read = |drive_v: &[f64], dt_s: f64| {
                model.simulate(&Drive::held(drive_v, dt_s, InitialState::Virgin))
            };
            let (slowly, quickly) = (read(&slow, 5e-3), read(&fast, 5e-5));
            for (k, y) in slowly.iter().enumerate() {
                assert!(
                    (y - quickly[100 * k]).abs() < 1e-9,
                    "{more:?} {k}: {y} {}",
                    quickly[100 * k]
                );
            }
        }
    }
}
