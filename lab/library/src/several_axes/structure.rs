//! What a model of several axes consists of: effects, each in its channel or mode, and their parameters.

use super::recordings::AxesData;
use hysteron_sim::several_axes::{ActuatorSoftening, ModalStage, ModeFriction, StageMode};
use serde::{Deserialize, Serialize};

/// An effect in its channel or mode. Drives, sensors and modes are counted from 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", tag = "effect")]
pub enum AxisEffect {
    /// A mode that one drive moves and one sensor sees.
    Vibration {
        /// Its number.
        mode: usize,
        /// The drive.
        drive: usize,
        /// The sensor.
        sensor: usize,
    },
    /// One more drive moves a mode.
    DriveCoupling {
        /// The drive.
        drive: usize,
        /// The mode.
        mode: usize,
    },
    /// One more sensor sees a mode.
    SensorCoupling {
        /// The mode.
        mode: usize,
        /// The sensor.
        sensor: usize,
    },
    /// A drive moves a sensor at once.
    Feedthrough {
        /// The drive.
        drive: usize,
        /// The sensor.
        sensor: usize,
    },
    /// Damping that is not proportional: drives move a mode by their rate too.
    ComplexMode {
        /// The mode.
        mode: usize,
    },
    /// Hysteresis of a drive.
    Hysteresis {
        /// The drive.
        drive: usize,
    },
    /// Creep of a drive.
    Creep {
        /// The drive.
        drive: usize,
    },
    /// Delay of a drive.
    Delay {
        /// The drive.
        drive: usize,
    },
    /// The force of an actuator remembers its own extension.
    ActuatorHysteresis {
        /// The drive of the actuator.
        drive: usize,
    },
    /// An actuator softens and loses more while it moves.
    ActuatorSoftening {
        /// The drive of the actuator.
        drive: usize,
    },
    /// Friction on a mode.
    Friction {
        /// The mode.
        mode: usize,
    },
    /// A stiffness of a mode that depends on its motion.
    NonlinearStiffness {
        /// The mode.
        mode: usize,
    },
    /// Lag of a sensor.
    SensorBandwidth {
        /// The sensor.
        sensor: usize,
    },
}

impl AxisEffect {
    /// Its identifier, as of effects of a single axis where there is one.
    #[must_use]
    pub fn id(&self) -> &'static str {
        match self {
            Self::Vibration { .. } => "vibration",
            Self::DriveCoupling { .. } => "drive_coupling",
            Self::SensorCoupling { .. } => "sensor_coupling",
            Self::Feedthrough { .. } => "feedthrough",
            Self::ComplexMode { .. } => "complex_mode",
            Self::Hysteresis { .. } => "hysteresis",
            Self::Creep { .. } => "creep",
            Self::Delay { .. } => "delay",
            Self::ActuatorHysteresis { .. } => "actuator_hysteresis",
            Self::ActuatorSoftening { .. } => "actuator_softening",
            Self::Friction { .. } => "friction",
            Self::NonlinearStiffness { .. } => "nonlinear_stiffness",
            Self::SensorBandwidth { .. } => "sensor_bandwidth",
        }
    }

    /// Where it is, in words: which drive, mode or sensor.
    #[must_use]
    pub fn place(&self, stage: &ModalStage, data: &AxesData) -> String {
        let mode_at = |mode: usize| {
            stage.modes.get(mode).map_or_else(
                || "a mode".to_owned(),
                |m| format!("the mode at {:.0} Hz", m.frequency_hz),
            )
        };
        match *self {
            Self::Vibration {
                mode,
                drive,
                sensor,
            } => {
                format!(
                    "{}, from {} to {}",
                    mode_at(mode),
                    data.drives[drive],
                    data.sensors[sensor]
                )
            }
            Self::DriveCoupling { drive, mode } => {
                format!("{} moves {}", data.drives[drive], mode_at(mode))
            }
            Self::SensorCoupling { mode, sensor } => {
                format!("{} sees {}", data.sensors[sensor], mode_at(mode))
            }
            Self::Feedthrough { drive, sensor } => {
                format!("{} to {}", data.drives[drive], data.sensors[sensor])
            }
            Self::Hysteresis { drive } | Self::Creep { drive } | Self::Delay { drive } => {
                data.drives[drive].clone()
            }
            Self::ActuatorHysteresis { drive } => {
                format!(
                    "the force of {} has memory of its extension",
                    data.drives[drive]
                )
            }
            Self::ActuatorSoftening { drive } => {
                format!(
                    "the actuator of {} softens while it moves",
                    data.drives[drive]
                )
            }
            Self::Friction { mode }
            | Self::NonlinearStiffness { mode }
            | Self::ComplexMode { mode } => mode_at(mode),
            Self::SensorBandwidth { sensor } => data.sensors[sensor].clone(),
        }
    }

    /// Effect and place.
    #[must_use]
    pub fn named(&self, stage: &ModalStage, data: &AxesData) -> String {
        format!("{}: {}", self.id(), self.place(stage, data))
    }

    /// The mode without which it means nothing.
    fn needs_mode(&self) -> Option<usize> {
        match *self {
            Self::DriveCoupling { mode, .. }
            | Self::SensorCoupling { mode, .. }
            | Self::Friction { mode }
            | Self::ComplexMode { mode }
            | Self::NonlinearStiffness { mode } => Some(mode),
            _ => None,
        }
    }
}

/// One number that is estimated.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Free {
    LogFrequency(usize),
    LogDamping(usize),
    OfDrive(usize, usize),
    OfRate(usize, usize),
    OfSensor(usize, usize),
    FrictionForce(usize),
    LogFrictionBend(usize),
    Quadratic(usize),
    Cubic(usize),
    Delay(usize),
    Slip(usize, usize),
    Softening(usize),
    LogHalfAt(usize),
    Compliance(usize),
    Play(usize, usize),
    Creep(usize, usize),
    Lag(usize),
    Feedthrough(usize, usize),
}

/// What has to be simulated again when a number changes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Part {
    Drive(usize),
    Mode(usize),
    Actuators,
    Sensor(usize),
}

impl Free {
    pub(super) fn part(self) -> Part {
        match self {
            Self::LogFrequency(r)
            | Self::LogDamping(r)
            | Self::OfDrive(r, _)
            | Self::OfRate(r, _)
            | Self::FrictionForce(r)
            | Self::LogFrictionBend(r)
            | Self::Quadratic(r)
            | Self::Cubic(r) => Part::Mode(r),
            Self::OfSensor(_, i) | Self::Lag(i) | Self::Feedthrough(i, _) => Part::Sensor(i),
            Self::Delay(j) | Self::Play(j, _) | Self::Creep(j, _) => Part::Drive(j),
            Self::Slip(..) | Self::Softening(_) | Self::LogHalfAt(_) | Self::Compliance(_) => {
                Part::Actuators
            }
        }
    }

    pub(super) fn get(self, stage: &ModalStage) -> f64 {
        match self {
            Self::LogFrequency(r) => stage.modes[r].frequency_hz.ln(),
            Self::LogDamping(r) => stage.modes[r].damping_ratio.ln(),
            Self::OfDrive(r, j) => stage.modes[r].of_drives[j],
            Self::OfRate(r, j) => stage.modes[r].of_rate(j),
            Self::OfSensor(r, i) => stage.modes[r].of_sensors[i],
            Self::FrictionForce(r) => stage.modes[r].friction.map_or(0.0, |f| f.force),
            Self::LogFrictionBend(r) => stage.modes[r].friction.map_or(0.0, |f| f.bend.ln()),
            Self::Quadratic(r) => stage.modes[r].quadratic,
            Self::Cubic(r) => stage.modes[r].cubic,
            Self::Delay(j) => stage.drives[j].delay_s,
            Self::Slip(j, knot) => stage.drives[j].slips[knot * SLIPS_BY_KNOT][1],
            Self::Softening(j) => stage.drives[j].softening.map_or(0.0, |s| s.stiffness),
            Self::LogHalfAt(j) => stage.drives[j].softening.map_or(0.0, |s| s.half_at.ln()),
            Self::Compliance(r) => stage.modes[r].compliance,
            Self::Play(j, knot) => stage.drives[j].plays[knot * PLAYS_BY_KNOT][1],
            Self::Creep(j, k) => stage.drives[j].creep[k][0],
            Self::Lag(i) => stage.sensors[i].lag_s,
            Self::Feedthrough(i, j) => stage.feedthrough[i][j],
        }
    }

    /// Puts a value in, within its physical bounds.
    pub(super) fn set(self, stage: &mut ModalStage, value: f64) {
        match self {
            Self::LogFrequency(r) => stage.modes[r].frequency_hz = value.clamp(-20.0, 20.0).exp(),
            Self::LogDamping(r) => stage.modes[r].damping_ratio = value.exp().clamp(1e-5, 0.95),
            Self::OfDrive(r, j) => stage.modes[r].of_drives[j] = value,
            Self::OfRate(r, j) => stage.modes[r].of_rates[j] = value,
            Self::OfSensor(r, i) => stage.modes[r].of_sensors[i] = value,
            Self::FrictionForce(r) => {
                if let Some(friction) = &mut stage.modes[r].friction {
                    friction.force = value.max(0.0);
                }
            }
            Self::LogFrictionBend(r) => {
                if let Some(friction) = &mut stage.modes[r].friction {
                    friction.bend = value.clamp(-30.0, 30.0).exp();
                }
            }
            Self::Quadratic(r) => stage.modes[r].quadratic = value,
            Self::Cubic(r) => stage.modes[r].cubic = value,
            Self::Delay(j) => stage.drives[j].delay_s = value.max(0.0),
            Self::Slip(j, knot) => {
                let at = knot * SLIPS_BY_KNOT;
                let by = value.max(0.0) - stage.drives[j].slips[at][1];
                add_around(&mut stage.drives[j].slips, at, SLIPS_BY_KNOT, by);
            }
            Self::Softening(j) => {
                let most = stage.softening_most(j);
                if let Some(softening) = &mut stage.drives[j].softening {
                    softening.stiffness = value.clamp(0.0, most);
                }
            }
            Self::LogHalfAt(j) => {
                if let Some(softening) = &mut stage.drives[j].softening {
                    softening.half_at = value.clamp(-30.0, 30.0).exp();
                }
            }
            Self::Compliance(r) => stage.modes[r].compliance = value.max(0.0),
            Self::Play(j, knot) => {
                let at = knot * PLAYS_BY_KNOT;
                let by = value - stage.drives[j].plays[at][1];
                add_around(&mut stage.drives[j].plays, at, PLAYS_BY_KNOT, by);
            }
            Self::Creep(j, k) => stage.drives[j].creep[k][0] = value,
            Self::Lag(i) => stage.sensors[i].lag_s = value.max(0.0),
            Self::Feedthrough(i, j) => stage.feedthrough[i][j] = value,
        }
    }
}

/// Adds to the weight of an element, less to those beside it, nothing from the next knots on.
fn add_around(elements: &mut [[f64; 2]], at: usize, to_next_knot: usize, by: f64) {
    for (k, element) in elements.iter_mut().enumerate() {
        element[1] += by * (1.0 - k.abs_diff(at) as f64 / to_next_knot as f64).max(0.0);
    }
}

/// Sizes that scale first guesses: they come from the records, not from a user.
#[derive(Clone, Debug)]
pub(super) struct Scales {
    /// Greatest deviation of each drive from rest.
    pub(super) drive_reach: Vec<f64>,
    /// RMS of each sensor about its mean.
    pub(super) reading_rms: Vec<f64>,
    /// Sampling period, s.
    pub(super) dt_s: f64,
    /// Longest record, s.
    pub(super) duration_s: f64,
}

impl Scales {
    pub(super) fn from_data(data: &AxesData) -> Self {
        let first = &data.records[0];
        let reach = |j: usize| {
            data.records
                .iter()
                .flat_map(|r| &r.drives[j])
                .fold(0.0_f64, |m, u| m.max(u.abs()))
                .max(1e-9)
        };
        let rms = |i: usize| {
            let counted: Vec<f64> = data
                .records
                .iter()
                .flat_map(|r| r.readings[i][r.counted_from..r.counted_to].iter().copied())
                .collect();
            let mean = counted.iter().sum::<f64>() / counted.len() as f64;
            (counted.iter().map(|y| (y - mean).powi(2)).sum::<f64>() / counted.len() as f64)
                .sqrt()
                .max(1e-12)
        };
        Self {
            drive_reach: (0..first.drives.len()).map(reach).collect(),
            reading_rms: (0..first.readings.len()).map(rms).collect(),
            dt_s: first.dt_s(),
            duration_s: data
                .records
                .iter()
                .map(|r| r.drives[0].len() as f64 * r.dt_s())
                .fold(0.0, f64::max),
        }
    }

    /// Change of a number over which its effect is straight.
    pub(super) fn step(&self, free: Free) -> f64 {
        match free {
            Free::LogFrequency(_) => 1e-5,
            Free::LogDamping(_) | Free::LogFrictionBend(_) | Free::LogHalfAt(_) => 1e-4,
            Free::Softening(_) => 1e-6,
            Free::OfDrive(..)
            | Free::OfRate(..)
            | Free::Play(..)
            | Free::Creep(..)
            | Free::Slip(..)
            | Free::Compliance(_) => 1e-4,
            Free::OfSensor(_, i) => 1e-4 * self.reading_rms[i] / self.reach(),
            Free::FrictionForce(_) => 1e-4 * self.reach(),
            Free::Quadratic(_) => 1e-4 / self.reach(),
            Free::Cubic(_) => 1e-4 / self.reach().powi(2),
            Free::Delay(_) | Free::Lag(_) => 1e-3 * self.dt_s,
            Free::Feedthrough(i, j) => 1e-4 * self.reading_rms[i] / self.drive_reach[j],
        }
    }

    pub(super) fn reach(&self) -> f64 {
        self.drive_reach.iter().fold(0.0_f64, |m, u| m.max(*u))
    }
}

/// Knots between which the weights of the play operators of a drive run straight: the loops of a ceramic are
/// smooth, and so few numbers are seen by any record.
const KNOTS: usize = 7;
/// Play operators from one knot to the next: loops are straight between thresholds, to `1 / 25^2` of their
/// width.
const PLAYS_BY_KNOT: usize = 4;
/// Play operators of a drive.
const PLAYS: usize = (KNOTS - 1) * PLAYS_BY_KNOT + 1;
/// Knots of the Maxwell-slip elements of an actuator, two elements from one to the next: their thresholds are
/// spread evenly over the logarithm, between these shares of its greatest extension.
const SLIP_KNOTS: usize = 6;
const SLIPS_BY_KNOT: usize = 2;
const SLIPS: usize = (SLIP_KNOTS - 1) * SLIPS_BY_KNOT + 1;
const SLIP_SHARES: [f64; 2] = [0.01, 0.6];
/// The greatest extension of a record of many levels, by the RMS of the middle one.
const CREST: f64 = 5.0;
/// Terms of creep of a drive, spread evenly over the logarithm of time.
const CREEP_TERMS: usize = 4;
/// Fastest term of creep, in sampling periods: below it creep and a lag are one.
const FASTEST_CREEP: f64 = 30.0;

/// A model: the stage with its values, and the effects that it has.
#[derive(Clone, Debug)]
pub struct Described {
    /// The values.
    pub stage: ModalStage,
    /// The effects, in the order in which they joined.
    pub effects: Vec<AxisEffect>,
}

impl Described {
    /// A stage in which nothing moves.
    #[must_use]
    pub fn empty(data: &AxesData) -> Self {
        Self {
            stage: ModalStage::at_rest(data.drives.len(), data.sensors.len()),
            effects: Vec::new(),
        }
    }

    /// With one more effect that does nothing yet; `guess` has a mode's frequency in Hz and damping, the
    /// motion within which friction builds up, or the greatest extension of an actuator and how far it softens,
    /// of what it may.
    pub(super) fn with(&self, effect: AxisEffect, guess: [f64; 2], scales: &Scales) -> Self {
        let mut out = self.clone();
        let stage = &mut out.stage;
        match effect {
            AxisEffect::Vibration { drive, mode, .. } => {
                debug_assert_eq!(mode, stage.modes.len());
                let mut mode =
                    StageMode::linear(guess[0], guess[1], stage.drives.len(), stage.sensors.len());
                mode.of_drives[drive] = 1.0;
                if stage.is_coupled() {
                    mode.compliance = 0.0;
                }
                stage.modes.push(mode);
            }
            AxisEffect::Hysteresis { drive } => {
                let threshold =
                    |k: usize| scales.drive_reach[drive] * (k as f64 + 0.5) / PLAYS as f64;
                stage.drives[drive].plays = (0..PLAYS).map(|k| [threshold(k), 0.0]).collect();
            }
            AxisEffect::Creep { drive } => {
                let (from_s, to_s) = (
                    FASTEST_CREEP * scales.dt_s,
                    scales.duration_s.max(2.0 * FASTEST_CREEP * scales.dt_s),
                );
                let tau_s =
                    |k: usize| from_s * (to_s / from_s).powf(k as f64 / (CREEP_TERMS - 1) as f64);
                stage.drives[drive].creep = (0..CREEP_TERMS).map(|k| [0.0, tau_s(k)]).collect();
            }
            AxisEffect::ActuatorSoftening { drive } => {
                stage.drives[drive].softening = Some(ActuatorSoftening {
                    stiffness: guess[1] * stage.softening_most(drive),
                    half_at: guess[0] / CREST,
                });
            }
            AxisEffect::ActuatorHysteresis { drive } => {
                let [least, most] = SLIP_SHARES;
                let share = |k: usize| least * (most / least).powf(k as f64 / (SLIPS - 1) as f64);
                stage.drives[drive].slips =
                    (0..SLIPS).map(|k| [share(k) * guess[0], 0.0]).collect();
            }
            AxisEffect::Friction { mode } => {
                stage.modes[mode].friction = Some(ModeFriction {
                    force: 0.0,
                    bend: guess[0],
                })
            }
            _ => {}
        }
        out.effects.push(effect);
        out
    }

    /// Without an effect, and without those that mean nothing without it.
    pub(super) fn without(&self, effect: AxisEffect) -> Self {
        let mut out = self.clone();
        out.take_out(effect);
        out
    }

    fn take_out(&mut self, effect: AxisEffect) {
        self.effects.retain(|other| *other != effect);
        let stage = &mut self.stage;
        match effect {
            AxisEffect::Vibration { mode, .. } => {
                self.effects
                    .retain(|other| other.needs_mode() != Some(mode));
                stage.modes.remove(mode);
                let lower = |r: &mut usize| *r -= usize::from(*r > mode);
                for other in &mut self.effects {
                    match other {
                        AxisEffect::Vibration { mode, .. }
                        | AxisEffect::DriveCoupling { mode, .. }
                        | AxisEffect::SensorCoupling { mode, .. }
                        | AxisEffect::Friction { mode }
                        | AxisEffect::ComplexMode { mode }
                        | AxisEffect::NonlinearStiffness { mode } => lower(mode),
                        _ => {}
                    }
                }
            }
            AxisEffect::DriveCoupling { drive, mode } => stage.modes[mode].of_drives[drive] = 0.0,
            AxisEffect::SensorCoupling { mode, sensor } => {
                stage.modes[mode].of_sensors[sensor] = 0.0
            }
            AxisEffect::Feedthrough { drive, sensor } => stage.feedthrough[sensor][drive] = 0.0,
            AxisEffect::Hysteresis { drive } => stage.drives[drive].plays.clear(),
            AxisEffect::Creep { drive } => stage.drives[drive].creep.clear(),
            AxisEffect::Delay { drive } => stage.drives[drive].delay_s = 0.0,
            AxisEffect::ActuatorHysteresis { drive } => stage.drives[drive].slips.clear(),
            AxisEffect::ActuatorSoftening { drive } => stage.drives[drive].softening = None,
            AxisEffect::Friction { mode } => stage.modes[mode].friction = None,
            AxisEffect::NonlinearStiffness { mode } => {
                (stage.modes[mode].quadratic, stage.modes[mode].cubic) = (0.0, 0.0)
            }
            AxisEffect::ComplexMode { mode } => stage.modes[mode].of_rates.clear(),
            AxisEffect::SensorBandwidth { sensor } => stage.sensors[sensor].lag_s = 0.0,
        }
    }

    /// The numbers of an effect.
    pub(super) fn free_of(&self, effect: AxisEffect) -> Vec<Free> {
        match effect {
            AxisEffect::Vibration { mode, sensor, .. } => {
                vec![
                    Free::LogFrequency(mode),
                    Free::LogDamping(mode),
                    Free::OfSensor(mode, sensor),
                ]
            }
            AxisEffect::DriveCoupling { drive, mode } => vec![Free::OfDrive(mode, drive)],
            AxisEffect::SensorCoupling { mode, sensor } => vec![Free::OfSensor(mode, sensor)],
            AxisEffect::Feedthrough { drive, sensor } => vec![Free::Feedthrough(sensor, drive)],
            AxisEffect::Hysteresis { drive } => {
                (0..KNOTS).map(|knot| Free::Play(drive, knot)).collect()
            }
            AxisEffect::Creep { drive } => (0..self.stage.drives[drive].creep.len())
                .map(|k| Free::Creep(drive, k))
                .collect(),
            AxisEffect::Delay { drive } => vec![Free::Delay(drive)],
            AxisEffect::ActuatorSoftening { drive } => {
                vec![Free::Softening(drive), Free::LogHalfAt(drive)]
            }
            AxisEffect::ActuatorHysteresis { drive } => (0..SLIP_KNOTS)
                .map(|knot| Free::Slip(drive, knot))
                .collect(),
            AxisEffect::Friction { mode } => {
                vec![Free::FrictionForce(mode), Free::LogFrictionBend(mode)]
            }
            AxisEffect::NonlinearStiffness { mode } => {
                vec![Free::Quadratic(mode), Free::Cubic(mode)]
            }
            AxisEffect::ComplexMode { mode } => (0..self.stage.modes[mode].of_rates.len())
                .map(|drive| Free::OfRate(mode, drive))
                .collect(),
            AxisEffect::SensorBandwidth { sensor } => vec![Free::Lag(sensor)],
        }
    }

    /// All numbers that are estimated.
    pub(super) fn free(&self) -> Vec<Free> {
        let of_effects = self.effects.iter().flat_map(|effect| self.free_of(*effect));
        of_effects.chain(self.compliances()).collect()
    }

    /// Compliances that the actuators with memory feel: of all modes that one moves but the first, which
    /// gives its extension a unit.
    fn compliances(&self) -> Vec<Free> {
        let mut felt = Vec::new();
        for (j, _) in self
            .stage
            .drives
            .iter()
            .enumerate()
            .filter(|(_, d)| d.has_memory())
        {
            let moved =
                (0..self.stage.modes.len()).filter(|r| self.stage.modes[*r].of_drives[j] != 0.0);
            felt.extend(moved.skip(1));
        }
        felt.sort_unstable();
        felt.dedup();
        felt.into_iter().map(Free::Compliance).collect()
    }

    /// How many numbers are estimated.
    #[must_use]
    pub fn parameters(&self) -> usize {
        self.free().len()
    }
}
