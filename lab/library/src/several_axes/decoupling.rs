//! A servo for a stage with several axes: drives and sensors are transformed so that every channel sees
//! mostly one motion, and each channel has a controller of its own.
//!
//! * Static decoupling inverts the matrix of the gains at rest.
//! * Modal decoupling inverts the participations of the drives and sensors in the modes that move most.
//!
//! A channel has an integral controller with a notch at its mode. Its gain is the largest at which the
//! channel alone keeps its sensitivity below the limit. Then the loop is checked as a whole ([`loop_check`]),
//! for the gain of small and of large motions of each drive. If the whole needs less, all gains are lowered
//! together.
//!
//! [`loop_check`]: super::loop_check

use super::loop_check::{Aim, AxesLaw, CheckedStage, SENSITIVITY_MAX, frequencies, gain_sets};
use crate::error::{Error, Result};
use hysteron_sim::several_axes::ModalStage;
use nalgebra::{Complex, DMatrix};
use serde::Serialize;
use std::f64::consts::{PI, TAU};

/// How drives and sensors are combined.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Decoupling {
    /// By the gains at rest.
    Static,
    /// By the participations in the modes.
    Modal,
}

impl Decoupling {
    /// Its name.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Static => "static",
            Self::Modal => "modal",
        }
    }
}

/// An integral controller with a notch.
#[derive(Clone, Debug, Serialize)]
pub struct ChannelController {
    /// Gain of the integral, 1/s.
    pub integral_per_s: f64,
    /// Frequency of its notch, Hz.
    pub notch_hz: f64,
    /// Numerator and denominator of the notch, the powers of `1/z`.
    pub notch: [[f64; 3]; 2],
}

/// A decoupled servo.
#[derive(Clone, Debug, Serialize)]
pub struct AxesServo {
    /// How it decouples.
    pub decoupling: Decoupling,
    /// Sampling period, s.
    pub dt_s: f64,
    /// Drives by channels.
    pub to_drives: Vec<Vec<f64>>,
    /// Channels by sensors.
    pub from_sensors: Vec<Vec<f64>>,
    /// One for each channel.
    pub channels: Vec<ChannelController>,
}

/// Damping of the notch's poles: well damped, with less phase lag below it than 1.
const NOTCH_DAMPING: f64 = 0.7;
/// Factor between gains that are tried.
const GAIN_STEP: f64 = 0.9;
const GAIN_STEPS: usize = 160;

fn matrix(rows: &[Vec<f64>]) -> DMatrix<f64> {
    DMatrix::from_fn(rows.len(), rows.first().map_or(0, Vec::len), |i, j| {
        rows[i][j]
    })
}

fn rows(matrix: &DMatrix<f64>) -> Vec<Vec<f64>> {
    (0..matrix.nrows())
        .map(|i| matrix.row(i).iter().copied().collect())
        .collect()
}

/// Response of all sensors to all drives at a frequency, from sample to sample; `gains` has that of each
/// drive's hysteresis.
fn response(stage: &ModalStage, gains: &[f64], hz: f64, dt_s: f64) -> DMatrix<Complex<f64>> {
    let turn = TAU * hz;
    let half = 0.5 * turn * dt_s;
    let held = Complex::from_polar(half.sin() / half, -half);
    let later = |delay_s: f64| Complex::from_polar(1.0, -turn * delay_s);
    DMatrix::from_fn(stage.sensors.len(), stage.drives.len(), |i, j| {
        let of_modes: Complex<f64> = stage
            .modes
            .iter()
            .map(|mode| {
                let ratio = hz / mode.frequency_hz;
                held * Complex::new(mode.of_drives[j], ratio * mode.of_rate(j)) * mode.of_sensors[i]
                    / Complex::new(1.0 - ratio * ratio, 2.0 * mode.damping_ratio * ratio)
            })
            .sum();
        let at_once = later(dt_s) * stage.feedthrough[i][j];
        (of_modes + at_once) * later(stage.drives[j].delay_s) * gains[j]
            / Complex::new(1.0, turn * stage.sensors[i].lag_s)
    })
}

impl ChannelController {
    fn new(notch_hz: f64, damping: f64, dt_s: f64) -> Self {
        // The bilinear transform, exact at the notch.
        let k = (PI * notch_hz * dt_s).min(1.5).tan();
        let side = |damping: f64| {
            [
                1.0 + 2.0 * damping * k + k * k,
                2.0 * (k * k - 1.0),
                1.0 - 2.0 * damping * k + k * k,
            ]
        };
        let (zeros, poles) = (side(damping), side(NOTCH_DAMPING.max(damping)));
        let scaled = |side: [f64; 3]| side.map(|c| c / poles[0]);
        Self {
            integral_per_s: 0.0,
            notch_hz,
            notch: [scaled(zeros), scaled(poles)],
        }
    }

    /// Response with the gain as it is and the delay of one period.
    fn response(&self, hz: f64, dt_s: f64) -> Complex<f64> {
        let back = Complex::from_polar(1.0, -TAU * hz * dt_s);
        let side = |c: &[f64; 3]| Complex::from(c[0]) + back * c[1] + back * back * c[2];
        let integral = Complex::from(self.integral_per_s * dt_s) / (Complex::from(1.0) - back);
        integral * side(&self.notch[0]) / side(&self.notch[1]) * back
    }

    fn step(&self, state: &mut [f64], error: f64, dt_s: f64) -> f64 {
        state[0] += self.integral_per_s * dt_s * error;
        let [b, a] = &self.notch;
        let out = b[0] * state[0] + state[1];
        state[1] = b[1] * state[0] - a[1] * out + state[2];
        state[2] = b[2] * state[0] - a[2] * out;
        out
    }
}

/// The modes that move most, so many of them, in their order.
pub(super) fn largest_modes(stage: &ModalStage, count: usize) -> Vec<usize> {
    let largest = |shares: &[f64]| shares.iter().fold(0.0_f64, |m, share| m.max(share.abs()));
    let moves = |r: usize| largest(&stage.modes[r].of_drives) * largest(&stage.modes[r].of_sensors);
    let mut modes: Vec<usize> = (0..stage.modes.len()).collect();
    modes.sort_by(|a, b| moves(*b).total_cmp(&moves(*a)));
    modes.truncate(count);
    modes.sort_unstable();
    modes
}

/// States of a channel's controller.
const STATES: usize = 3;

impl AxesServo {
    /// Designs a servo for a stage.
    ///
    /// # Errors
    /// A stage that has fewer sensors or modes than drives, or whose channels cannot be decoupled.
    pub fn design(stage: &ModalStage, decoupling: Decoupling, dt_s: f64) -> Result<Self> {
        let (drives, sensors) = (stage.drives.len(), stage.sensors.len());
        let wrong = |what: String| {
            Err(Error::Servo(format!(
                "{} decoupling: {what}",
                decoupling.name()
            )))
        };
        if drives != sensors {
            return wrong(format!(
                "{drives} drives and {sensors} sensors; expected as many of both"
            ));
        }
        let modes = largest_modes(stage, drives);
        let (to_drives, from_sensors) = match decoupling {
            Decoupling::Static => (
                matrix(&stage.static_gain()).try_inverse(),
                Some(DMatrix::identity(sensors, sensors)),
            ),
            Decoupling::Modal => {
                if modes.len() < drives {
                    return wrong(format!(
                        "{} modes for {drives} drives; expected as many",
                        modes.len()
                    ));
                }
                let by_drive =
                    DMatrix::from_fn(drives, drives, |r, j| stage.modes[modes[r]].of_drives[j]);
                let by_sensor =
                    DMatrix::from_fn(sensors, drives, |i, r| stage.modes[modes[r]].of_sensors[i]);
                (by_drive.try_inverse(), by_sensor.try_inverse())
            }
        };
        let (Some(to_drives), Some(from_sensors)) = (to_drives, from_sensors) else {
            return wrong("two drives or two sensors do the same".into());
        };
        let mut servo = Self {
            decoupling,
            dt_s,
            to_drives: rows(&to_drives),
            from_sensors: rows(&from_sensors),
            channels: Vec::new(),
        };
        for channel in 0..drives {
            // The mode that this channel moves most.
            let in_channel = |r: &usize| -> f64 {
                let by_drives: f64 = (0..drives)
                    .map(|j| stage.modes[*r].of_drives[j] * to_drives[(j, channel)])
                    .sum();
                let by_sensors: f64 = (0..sensors)
                    .map(|i| from_sensors[(channel, i)] * stage.modes[*r].of_sensors[i])
                    .sum();
                (by_drives * by_sensors).abs()
            };
            let Some(mode) =
                (0..stage.modes.len()).max_by(|a, b| in_channel(a).total_cmp(&in_channel(b)))
            else {
                return wrong("no mode; expected at least one".into());
            };
            let mode = &stage.modes[mode];
            servo.channels.push(ChannelController::new(
                mode.frequency_hz,
                mode.damping_ratio,
                dt_s,
            ));
            servo.tune(stage, channel, mode.frequency_hz);
        }
        let checked = CheckedStage::new(stage, dt_s);
        for _ in 0..GAIN_STEPS {
            let check = checked.check(&servo);
            if check.spectral_radius < 1.0 && check.sensitivity_peak <= SENSITIVITY_MAX {
                return Ok(servo);
            }
            servo
                .channels
                .iter_mut()
                .for_each(|channel| channel.integral_per_s *= GAIN_STEP);
        }
        wrong("no gain keeps the loop stable as a whole".into())
    }

    /// The largest gain at which a channel alone keeps its sensitivity below the limit.
    fn tune(&mut self, stage: &ModalStage, channel: usize, mode_hz: f64) {
        let (to_drives, from_sensors) = (matrix(&self.to_drives), matrix(&self.from_sensors));
        let complex = |matrix: &DMatrix<f64>| matrix.map(Complex::from);
        let plant: Vec<(f64, Complex<f64>)> = gain_sets(stage)
            .iter()
            .flat_map(|gains| {
                frequencies(self.dt_s)
                    .map(|hz| {
                        let own = complex(&from_sensors.rows(channel, 1).into_owned())
                            * response(stage, gains, hz, self.dt_s)
                            * complex(&to_drives.columns(channel, 1).into_owned());
                        (hz, own[(0, 0)])
                    })
                    .collect::<Vec<_>>()
            })
            .collect();
        let controller = &mut self.channels[channel];
        controller.integral_per_s = TAU * mode_hz;
        for _ in 0..GAIN_STEPS {
            // The loop starts above -1 at low frequencies: below half a turn of phase a gain above one
            // encircles.
            let peak = plant
                .iter()
                .map(|(hz, plant)| {
                    1.0 / (Complex::from(1.0) + plant * controller.response(*hz, self.dt_s)).norm()
                })
                .fold(0.0_f64, f64::max);
            let beyond = plant.iter().any(|(hz, plant)| {
                let open = plant * controller.response(*hz, self.dt_s);
                open.norm() > 1.0 && open.re < 0.0 && open.im > 0.0
            });
            if peak <= SENSITIVITY_MAX && !beyond {
                return;
            }
            controller.integral_per_s *= GAIN_STEP;
        }
    }
}

impl AxesLaw for AxesServo {
    fn period_s(&self) -> f64 {
        self.dt_s
    }

    fn states(&self) -> usize {
        STATES * self.channels.len()
    }

    fn step(&self, state: &mut [f64], _acting: &[f64], readings: &[f64], aim: &Aim) -> Vec<f64> {
        let reference = |i: usize| aim.reference.get(i).copied().unwrap_or(0.0);
        let errors: Vec<f64> = (readings.iter().enumerate())
            .map(|(i, reading)| reference(i) - reading)
            .collect();
        let product = |row: &Vec<f64>, with: &[f64]| -> f64 {
            row.iter().zip(with).map(|(a, v)| a * v).sum()
        };
        let channels = self.channels.iter().zip(&self.from_sensors);
        let given: Vec<f64> = channels
            .zip(state.chunks_mut(STATES))
            .map(|((channel, row), state)| channel.step(state, product(row, &errors), self.dt_s))
            .collect();
        self.to_drives
            .iter()
            .map(|row| product(row, &given))
            .collect()
    }
}

/// The stage with every drive also moving the modes of the others, by a share of the largest participation.
#[must_use]
pub fn with_hidden_coupling(stage: &ModalStage, share: f64) -> ModalStage {
    let mut hidden = stage.clone();
    for mode in &mut hidden.modes {
        let largest = mode.of_drives.iter().fold(0.0_f64, |m, s| m.max(s.abs()));
        mode.of_drives.iter_mut().for_each(|of_drive| {
            *of_drive += if of_drive.abs() < largest {
                share * largest
            } else {
                0.0
            }
        });
    }
    hidden
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::several_axes::loop_check::{Sine, track};
    use hysteron_sim::several_axes::StageMode;

    fn stage() -> ModalStage {
        let mut stage = ModalStage::at_rest(3, 3);
        for (axis, hz) in [150.0, 210.0, 320.0].into_iter().enumerate() {
            let mut mode = StageMode::linear(hz, 0.02, 3, 3);
            (mode.of_drives[axis], mode.of_sensors[axis]) = (1.0, 0.1);
            mode.of_drives[(axis + 1) % 3] = 0.2;
            stage.modes.push(mode);
        }
        stage
    }

    #[test]
    fn eigenvalues_say_what_a_simulation_does() {
        let stage = stage();
        let dt_s = 1.0 / 6400.0;
        let mut servo = AxesServo::design(&stage, Decoupling::Modal, dt_s).unwrap();
        let checked = CheckedStage::new(&stage, dt_s);
        let sine = |axis, hz| Sine {
            axis,
            amplitude: 1.0,
            hz,
            turns: 5.0,
        };
        assert!(checked.spectral_radius(&servo) < 1.0);
        assert!(track(&servo, &stage, &sine(0, 2.0)).finite);
        // With thirty times the gain the loop runs away, and the eigenvalues show it.
        servo
            .channels
            .iter_mut()
            .for_each(|channel| channel.integral_per_s *= 30.0);
        assert!(checked.spectral_radius(&servo) > 1.0);
        assert!(!track(&servo, &stage, &sine(0, 2.0)).finite);
    }

    #[test]
    fn decoupling_takes_the_crosstalk_of_the_model_away() {
        let stage = stage();
        let dt_s = 1.0 / 6400.0;
        for decoupling in [Decoupling::Static, Decoupling::Modal] {
            let servo = AxesServo::design(&stage, decoupling, dt_s).unwrap();
            let sine = Sine {
                axis: 1,
                amplitude: 1.0,
                hz: 3.0,
                turns: 6.0,
            };
            let track = track(&servo, &stage, &sine);
            assert!(track.own < 0.2, "{decoupling:?}: {track:?}");
            assert!(track.crosstalk < 0.01, "{decoupling:?}: {track:?}");
        }
    }
}
