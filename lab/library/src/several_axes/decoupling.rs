//! A servo for a stage with several axes: drives and sensors are transformed so that every channel sees
//! mostly one motion, and each channel has a controller of its own.
//!
//! * Static decoupling inverts the matrix of the gains at rest.
//! * Modal decoupling inverts the participations of the drives and sensors in the modes that move most.
//!
//! A channel has an integral controller with a notch at its mode. Its gain is the largest at which the
//! channel alone keeps its sensitivity below the limit. Then the loop is checked as a whole: eigenvalues of
//! the closed sampled system with the delay of one period, and the largest singular value of its
//! sensitivity over frequency, for the gain of small and of large motions of each drive. If the whole needs
//! less, all gains are lowered together.

use crate::error::{Error, Result};
use hysteron_sim::several_axes::{Held, ModalMotion, ModalStage, StageRun};
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

/// Check of a loop as a whole.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct WholeCheck {
    /// Largest magnitude of an eigenvalue of the closed sampled system.
    pub spectral_radius: f64,
    /// Largest singular value of the sensitivity over frequency.
    pub sensitivity_peak: f64,
}

/// What a servo makes of a reference.
#[derive(Clone, Debug, Serialize)]
pub struct AxesTrack {
    /// RMS error of the axis that moves, of the RMS of its reference.
    pub own: f64,
    /// Largest RMS motion of another axis, of the RMS of the reference.
    pub crosstalk: f64,
    /// The drives stay within a range.
    pub finite: bool,
}

/// Largest sensitivity of a channel alone and of the whole: a phase margin of 29 degrees and a gain margin
/// of 2.
pub const SENSITIVITY_MAX: f64 = 2.0;
/// Damping of the notch's poles: well damped, with less phase lag below it than 1.
const NOTCH_DAMPING: f64 = 0.7;
/// Frequencies at which a sensitivity is sampled, and lowest of them by the sampling rate.
const FREQUENCIES: usize = 400;
const LOWEST: f64 = 1e-5;
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

/// Gain of every drive's hysteresis for small and for large motions.
fn gain_sets(stage: &ModalStage) -> [Vec<f64>; 2] {
    let large = |plays: &[[f64; 2]]| 1.0 + plays.iter().map(|play| play[1]).sum::<f64>();
    [
        vec![1.0; stage.drives.len()],
        stage
            .drives
            .iter()
            .map(|drive| large(&drive.plays))
            .collect(),
    ]
}

fn frequencies(dt_s: f64) -> impl Iterator<Item = f64> {
    (0..FREQUENCIES)
        .map(move |n| LOWEST.powf(1.0 - n as f64 / (FREQUENCIES - 1) as f64) * 0.4999 / dt_s)
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
        let largest = |shares: &[f64]| shares.iter().fold(0.0_f64, |m, share| m.max(share.abs()));
        let moves =
            |r: usize| largest(&stage.modes[r].of_drives) * largest(&stage.modes[r].of_sensors);
        let mut modes: Vec<usize> = (0..stage.modes.len()).collect();
        modes.sort_by(|a, b| moves(*b).total_cmp(&moves(*a)));
        modes.truncate(drives);
        modes.sort_unstable();
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
        for _ in 0..GAIN_STEPS {
            let check = servo.check(stage);
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

    /// Checks the loop around a stage as a whole; the worse of small and large motions.
    #[must_use]
    pub fn check(&self, stage: &ModalStage) -> WholeCheck {
        let (to_drives, from_sensors) = (
            matrix(&self.to_drives).map(Complex::from),
            matrix(&self.from_sensors).map(Complex::from),
        );
        let mut worst = WholeCheck {
            spectral_radius: 0.0,
            sensitivity_peak: 0.0,
        };
        for gains in gain_sets(stage) {
            let closed = self.closed_matrix(stage, &gains);
            let radius = closed
                .complex_eigenvalues()
                .iter()
                .fold(0.0_f64, |m, z| m.max(z.norm()));
            worst.spectral_radius = worst.spectral_radius.max(radius);
            for hz in frequencies(self.dt_s) {
                let channels = DMatrix::from_diagonal(&nalgebra::DVector::from_iterator(
                    self.channels.len(),
                    self.channels
                        .iter()
                        .map(|channel| channel.response(hz, self.dt_s)),
                ));
                let open =
                    &from_sensors * response(stage, &gains, hz, self.dt_s) * &to_drives * channels;
                let back = DMatrix::identity(open.nrows(), open.ncols()) + open;
                let smallest = back.singular_values().min();
                worst.sensitivity_peak = worst.sensitivity_peak.max(1.0 / smallest.max(1e-12));
            }
        }
        worst
    }

    /// One period of the closed linear loop without a reference, from states to states: each column is what a
    /// unit of one state becomes.
    fn closed_matrix(&self, stage: &ModalStage, gains: &[f64]) -> DMatrix<f64> {
        let (modes, sensors) = (stage.modes.len(), stage.sensors.len());
        let whole_periods =
            |j: usize| (stage.drives[j].delay_s / self.dt_s).max(0.0).floor() as usize;
        // A drive's values: as many as its delay has periods, and two.
        let history: Vec<usize> = (0..stage.drives.len())
            .map(|j| whole_periods(j) + 2)
            .collect();
        let of_history: usize = history.iter().sum();
        let states = 2 * modes + of_history + 2 * sensors + STATES * self.channels.len();
        let switching: Vec<f64> = stage
            .drives
            .iter()
            .map(|drive| drive.switches_at(self.dt_s))
            .collect();
        let linear =
            |mode: &hysteron_sim::several_axes::StageMode| hysteron_sim::several_axes::StageMode {
                friction: None,
                quadratic: 0.0,
                cubic: 0.0,
                ..mode.clone()
            };
        let motions: Vec<ModalMotion> = stage
            .modes
            .iter()
            .map(|mode| ModalMotion::new(&linear(mode), &switching, self.dt_s))
            .collect();
        let step = |x: &[f64]| -> Vec<f64> {
            let mut next = vec![0.0; states];
            let mut at = 2 * modes;
            let mut acting = Vec::new();
            let mut before = Vec::new();
            for (j, length) in history.iter().enumerate() {
                let values = &x[at..at + length];
                acting.push(Held {
                    early: gains[j] * values[length - 1],
                    late: gains[j] * values[length - 2],
                });
                before.push(gains[j] * values[length - 1]);
                next[at + 1..at + length].copy_from_slice(&values[..length - 1]);
                at += length;
            }
            let mut readings = vec![0.0; sensors];
            for i in 0..sensors {
                let of_modes: f64 = (0..modes)
                    .map(|r| stage.modes[r].of_sensors[i] * x[2 * r])
                    .sum();
                let now = of_modes
                    + stage.feedthrough[i]
                        .iter()
                        .zip(&before)
                        .map(|(share, w)| share * w)
                        .sum::<f64>();
                let [input, output] = [x[at + 2 * i], x[at + 2 * i + 1]];
                readings[i] = stage.sensors[i].after(input, output, now, self.dt_s);
                (next[at + 2 * i], next[at + 2 * i + 1]) = (now, readings[i]);
            }
            at += 2 * sensors;
            let mut given = Vec::new();
            for (channel, row) in self.channels.iter().zip(&self.from_sensors) {
                let mut state = x[at..at + STATES].to_vec();
                let error: f64 = -row.iter().zip(&readings).map(|(a, y)| a * y).sum::<f64>();
                given.push(channel.step(&mut state, error, self.dt_s));
                next[at..at + STATES].copy_from_slice(&state);
                at += STATES;
            }
            let mut at = 2 * modes;
            for (row, length) in self.to_drives.iter().zip(&history) {
                next[at] = row.iter().zip(&given).map(|(a, v)| a * v).sum();
                at += length;
            }
            for (r, motion) in motions.iter().enumerate() {
                let mut motion = motion.clone();
                motion.put([x[2 * r], x[2 * r + 1]]);
                motion.step(&acting);
                next[2 * r..2 * r + 2].copy_from_slice(&motion.state());
            }
            next
        };
        let columns: Vec<f64> = (0..states)
            .flat_map(|n| {
                let mut unit = vec![0.0; states];
                unit[n] = 1.0;
                step(&unit)
            })
            .collect();
        DMatrix::from_vec(states, states, columns)
    }

    /// Moves one axis by a sine of so many turns after as many of waiting, on a stage with all its effects.
    #[must_use]
    pub fn track(
        &self,
        stage: &ModalStage,
        axis: usize,
        amplitude: f64,
        hz: f64,
        turns: f64,
    ) -> AxesTrack {
        let sensors = stage.sensors.len();
        let mut run = StageRun::new(stage, self.dt_s);
        let mut states = vec![vec![0.0; STATES]; self.channels.len()];
        let mut drives = vec![0.0; stage.drives.len()];
        let samples = (2.0 * turns / (hz * self.dt_s)) as usize;
        let mut squares = vec![0.0; sensors];
        let mut of_reference = 0.0;
        for k in 0..samples {
            let readings = run.readings();
            let reference = amplitude * (TAU * hz * k as f64 * self.dt_s).sin();
            let errors: Vec<f64> = (0..sensors)
                .map(|i| if i == axis { reference } else { 0.0 } - readings[i])
                .collect();
            if k >= samples / 2 {
                squares
                    .iter_mut()
                    .zip(&errors)
                    .for_each(|(sum, e)| *sum += e * e);
                of_reference += reference * reference;
            }
            // What was computed a period ago acts now.
            run.step(&drives);
            let given: Vec<f64> = self
                .channels
                .iter()
                .zip(&self.from_sensors)
                .zip(&mut states)
                .map(|((channel, row), state)| {
                    channel.step(
                        state,
                        row.iter().zip(&errors).map(|(a, e)| a * e).sum(),
                        self.dt_s,
                    )
                })
                .collect();
            drives = self
                .to_drives
                .iter()
                .map(|row| row.iter().zip(&given).map(|(a, v)| a * v).sum())
                .collect();
        }
        let share = |i: usize| (squares[i] / of_reference.max(f64::MIN_POSITIVE)).sqrt();
        let crosstalk = (0..sensors)
            .filter(|i| *i != axis)
            .map(share)
            .fold(0.0_f64, f64::max);
        AxesTrack {
            own: share(axis),
            crosstalk,
            finite: share(axis).is_finite() && crosstalk.is_finite() && share(axis) < 1e3,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
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
        assert!(servo.check(&stage).spectral_radius < 1.0);
        assert!(servo.track(&stage, 0, 1.0, 2.0, 2.0).finite);
        // With thirty times the gain the loop runs away, and the eigenvalues show it.
        servo
            .channels
            .iter_mut()
            .for_each(|channel| channel.integral_per_s *= 30.0);
        assert!(servo.check(&stage).spectral_radius > 1.0);
        assert!(!servo.track(&stage, 0, 1.0, 2.0, 2.0).finite);
    }

    #[test]
    fn decoupling_takes_the_crosstalk_of_the_model_away() {
        let stage = stage();
        let dt_s = 1.0 / 6400.0;
        for decoupling in [Decoupling::Static, Decoupling::Modal] {
            let servo = AxesServo::design(&stage, decoupling, dt_s).unwrap();
            let track = servo.track(&stage, 1, 1.0, 3.0, 3.0);
            assert!(track.own < 0.2, "{decoupling:?}: {track:?}");
            assert!(track.crosstalk < 0.01, "{decoupling:?}: {track:?}");
        }
    }
}
