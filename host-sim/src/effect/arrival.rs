//! How a signal goes, inside an interval of the chain, from where it ended the one before to where it ends
//! this one.
//!
//! Stages hand on where their signal stands at the ends of intervals. Between two ends a held drive steps,
//! late where it is delayed; behind an amplifier of first order it glides, `exp(-t / tau)` of the way being
//! left. A drive that is not held between samples ([`crate::intersample::Intersample`]) runs straight. Within
//! one interval both go one way only, so hysteresis passes either on as it comes, as far as its path is
//! straight there. What takes time, a mode or a sensor, is exact for either: sub-intervals are needed for the
//! bend of the loops alone, and two are as good as four were in which the mean of the voltage was held.

use super::delay;
use crate::linear_system::ContinuousSystem;
use crate::physics::*;
use nalgebra::{DMatrix, DVector};

/// The way of a signal inside an interval.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Arrival {
    /// It steps, late by this share of the interval.
    Late(f64),
    /// It steps in time and follows with this time constant, s.
    Gliding(f64),
    /// It runs straight.
    Straight,
}

/// How a linear system goes over an interval: what its states make of themselves, and what is added for one
/// unit of its input's start and end.
pub(super) struct Over {
    pub(super) phi: DMatrix<f64>,
    pub(super) start: DVector<f64>,
    pub(super) end: DVector<f64>,
}

impl Arrival {
    /// The way of what stands behind the hysteresis of a model, over the intervals of a record.
    pub(super) fn from_model(model: &Model, setting: &Setting) -> Self {
        if setting.runs_straight {
            return Self::Straight;
        }
        match (delay::taken_in_s(model), gliding_s(model)) {
            (Some(delay_s), _) => Self::Late((delay_s / setting.dt_s).fract()),
            (None, Some(time_constant_s)) => Self::Gliding(time_constant_s),
            (None, None) => Self::Late(0.0),
        }
    }

    /// What is left of the way to where a glide would come, behind so much time; nothing of a step, and a
    /// straight way comes to no end.
    pub(super) fn left_after(self, time_s: f64) -> f64 {
        match self {
            Self::Late(_) => 0.0,
            Self::Straight => 1.0,
            Self::Gliding(time_constant_s) => (-time_s / time_constant_s).exp(),
        }
    }

    /// How a system goes over an interval in which its input arrives so.
    pub(super) fn over(self, system: &ContinuousSystem, dt_s: f64) -> Over {
        let (phi, held) = system.held_matrices(dt_s);
        match self {
            Self::Late(share) => {
                let end = if share > 0.0 {
                    system.held_matrices(dt_s * (1.0 - share)).1
                } else {
                    held.clone()
                };
                Over {
                    phi,
                    start: held - &end,
                    end,
                }
            }
            Self::Gliding(time_constant_s) => {
                let left = self.left_after(dt_s);
                // From one at the start to zero at the end: what decays, less what is left of it.
                let start = (decaying(system, time_constant_s, dt_s) - left * &held) / (1.0 - left);
                Over {
                    phi,
                    end: held - &start,
                    start,
                }
            }
            Self::Straight => {
                let (phi, held, slope) = system.straight_matrices(dt_s);
                Over {
                    phi,
                    start: held - &slope,
                    end: slope,
                }
            }
        }
    }

    /// For those who compare.
    pub(super) fn values(self) -> [f64; 2] {
        match self {
            Self::Late(share) => [share, 0.0],
            Self::Gliding(time_constant_s) => [0.0, time_constant_s],
            Self::Straight => [0.0, f64::INFINITY],
        }
    }
}

/// Time constant of the amplifier whose voltage glides from one end of an interval to the next; where its
/// slope is limited too, sub-intervals show the shape.
pub(super) fn gliding_s(model: &Model) -> Option<f64> {
    let bandwidth_hz = model.values(id::AMPLIFIER_BANDWIDTH)?[0];
    model
        .effect(id::SLEW_LIMIT)
        .is_none()
        .then(|| 1.0 / (std::f64::consts::TAU * bandwidth_hz))
}

/// What an input that begins at one and decays adds to the states of a system.
fn decaying(system: &ContinuousSystem, time_constant_s: f64, dt_s: f64) -> DVector<f64> {
    let n = system.a.nrows();
    // The input is one state more.
    let mut with_input = DMatrix::zeros(n + 1, n + 1);
    with_input
        .view_mut((0, 0), (n, n))
        .copy_from(&(&system.a * dt_s));
    with_input
        .view_mut((0, n), (n, 1))
        .copy_from(&(&system.b * dt_s));
    with_input[(n, n)] = -dt_s / time_constant_s;
    with_input.exp().view((0, n), (n, 1)).column(0).into_owned()
}

#[cfg(test)]
mod tests {
    use crate::chain::{Drive, EffectInstance, InitialState, Model};
    use crate::effect::sensor_filter::SensorFilter;
    use crate::effect::{Effect, Overview, by_id};
    use std::f64::consts::TAU;
    use std::sync::Arc;

    const AMPLIFIER_HZ: f64 = 700.0;
    const SENSOR_HZ: f64 = 900.0;
    const MODE: [f64; 2] = [3000.0, 0.25];
    const FILTER: [f64; 2] = [800.0, 0.6];

    /// The answer to a step through the amplifier, then a mode, a sensor's lag or a sensor's filter, where
    /// asked for, by Euler's method in steps that are a thousand times shorter than any of their times.
    fn by_euler(mode: bool, sensor: &str, until_s: f64) -> f64 {
        let steps = 400_000;
        let h = until_s / f64::from(steps);
        let (mut voltage, mut x, mut v, mut reading, mut rate) = (0.0, 0.0, 0.0, 0.0, 0.0);
        let filter_rad_s = TAU * FILTER[0];
        for _ in 0..steps {
            let place = if mode { x } else { voltage };
            match sensor {
                "lag" => reading += h * TAU * SENSOR_HZ * (place - reading),
                "filter" => {
                    reading += h * rate;
                    rate += h
                        * (filter_rad_s.powi(2) * (place - reading)
                            - 2.0 * FILTER[1] * filter_rad_s * rate);
                }
                _ => reading = place,
            }
            x += h * v;
            v += h * (MODE[0].powi(2) * (voltage - x) - 2.0 * MODE[1] * MODE[0] * v);
            voltage += h * TAU * AMPLIFIER_HZ * (1.0 - voltage);
        }
        reading
    }

    #[test]
    fn what_stands_behind_an_amplifier_is_exact_in_fast_and_slow_records() {
        let overview = Overview::without_data(0.0, 1.0);
        for (mode, sensor) in [
            (true, ""),
            (true, "lag"),
            (false, "lag"),
            (false, "filter"),
            (true, "filter"),
            (false, ""),
        ] {
            let mut model = Model::new(0.0, 1.0);
            let mut add = |effect: Arc<dyn Effect>, values: &[f64]| {
                model.add(EffectInstance::new(effect, &overview, values))
            };
            add(by_id("amplifier_bandwidth").unwrap(), &[AMPLIFIER_HZ]);
            if mode {
                add(by_id("vibration").unwrap(), &MODE);
            }
            match sensor {
                "lag" => add(by_id("sensor_bandwidth").unwrap(), &[SENSOR_HZ]),
                "filter" => add(Arc::new(SensorFilter), &FILTER),
                _ => {}
            }
            for dt_s in [5e-5, 5e-4, 5e-3] {
                let drive = Drive::held(&[1.0; 4], dt_s, InitialState::Virgin);
                let reading = model.simulate(&drive);
                for k in 1..4 {
                    let expected = by_euler(mode, sensor, k as f64 * dt_s);
                    assert!(
                        (reading[k] - expected).abs() < 3e-4,
                        "{mode} {sensor} {dt_s} {k}: {} {expected}",
                        reading[k]
                    );
                }
            }
        }
    }
}
