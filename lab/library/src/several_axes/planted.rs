//! Simulated stages of three drives and three sensors with one effect planted in one channel, and the score
//! of the search on them.
//!
//! The plant is no copy of what is fitted: its hysteresis has 40 play operators with thresholds of their own
//! where a model has 25 by seven numbers, its creep 7 terms at other times, its actuators 12 Maxwell-slip
//! elements where a model has 11 by six numbers, and its readings have noise.

use super::finder::{AxesFound, AxesPolicy, AxisFinding, find};
use super::recordings::{AxesData, AxesRecord};
use super::structure::{AxisEffect, Described};
use crate::dataset::Role;
use crate::error::{Error, Result, nearest};
use crate::watch::Watch;
use hysteron_sim::noise::WhiteNoise;
use hysteron_sim::several_axes::{ModalStage, ModeFriction, StageMode};
use hysteron_sim::waveform::multisine;
use rand::{Rng, SeedableRng};
use rand_pcg::Pcg64Mcg;

/// What is planted in a stage.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AxisPlant {
    /// A drive also moves the mode of another axis.
    Coupling,
    /// A mode that only one drive moves.
    ModeOfOneDrive,
    /// Friction on one axis.
    Friction,
    /// A drive acts later than the others.
    Delay,
    /// One drive creeps.
    Creep,
    /// The stiffness of one axis depends on its motion.
    NonlinearStiffness,
    /// One sensor is slow.
    SensorBandwidth,
    /// One sensor sees the mode of another axis.
    SensorCoupling,
    /// The force of an actuator, which moves two modes, remembers its extension.
    ActuatorHysteresis,
}

impl AxisPlant {
    /// All of them.
    pub const ALL: [Self; 9] = [
        Self::Coupling,
        Self::ModeOfOneDrive,
        Self::Friction,
        Self::Delay,
        Self::Creep,
        Self::NonlinearStiffness,
        Self::SensorBandwidth,
        Self::SensorCoupling,
        Self::ActuatorHysteresis,
    ];

    /// Its name on the command line and in tables.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Coupling => "coupling",
            Self::ModeOfOneDrive => "mode_of_one_drive",
            Self::Friction => "friction",
            Self::Delay => "delay",
            Self::Creep => "creep",
            Self::NonlinearStiffness => "nonlinear_stiffness",
            Self::SensorBandwidth => "sensor_bandwidth",
            Self::SensorCoupling => "sensor_coupling",
            Self::ActuatorHysteresis => "actuator_hysteresis",
        }
    }

    /// By its name.
    ///
    /// # Errors
    /// An unknown name, with the nearest known one.
    pub fn named(name: &str) -> Result<Self> {
        let known: Vec<String> = Self::ALL
            .iter()
            .map(|plant| plant.name().to_owned())
            .collect();
        Self::ALL
            .into_iter()
            .find(|plant| plant.name() == name)
            .ok_or_else(|| {
                Error::new(
                    name,
                    format!(
                        "is nothing that can be planted{}; expected one of {}",
                        nearest(name, &known),
                        known.join(", ")
                    ),
                )
            })
    }
}

/// A simulated stage.
#[derive(Clone, Debug)]
pub struct PlantedStage {
    /// What was planted.
    pub plant: AxisPlant,
    /// In words.
    pub truth: String,
    /// The stage itself.
    pub stage: ModalStage,
    /// The channel: drive, mode, sensor, as far as they matter.
    channel: Channel,
    /// Its recordings.
    pub data: AxesData,
}

#[derive(Clone, Copy, Debug)]
struct Channel {
    drive: usize,
    mode: usize,
    sensor: usize,
}

const AXES: usize = 3;
const RATE_HZ: f64 = 6400.0;
const PERIOD: usize = 2048;
/// Periods of a record; the first is left out.
const PERIODS: usize = 5;
/// Highest frequency of the drives, Hz: above the modes of the axes and that of one drive.
const BAND_HZ: f64 = 1200.0;
/// Greatest drive, V.
const REACH_V: f64 = 50.0;
/// Maxwell-slip elements of an actuator, and the smallest of their thresholds, of the greatest drive.
const SLIPS: usize = 12;
const SLIP_LEAST: f64 = 0.02;
/// Noise of a sensor, of the RMS of its reading.
const NOISE: f64 = 0.01;
/// Shares of the greatest drive at which the stage is recorded, and which of the records judge.
const LEVELS: [(f64, Role); 4] = [
    (0.35, Role::Identify),
    (0.65, Role::Identify),
    (1.0, Role::Identify),
    (0.85, Role::Validate),
];

/// A stage from a seed.
#[must_use]
pub fn planted_stage(plant: AxisPlant, seed: u64) -> PlantedStage {
    let mut random = Pcg64Mcg::seed_from_u64(0x00a5_1e55 ^ (seed << 8) ^ plant as u64);
    let mut stage = ModalStage::at_rest(AXES, AXES);
    let first_hz = random.random_range(130.0..200.0);
    let mut frequency_hz = first_hz;
    for axis in 0..AXES {
        let mut mode = StageMode::linear(frequency_hz, random.random_range(0.01..0.04), AXES, AXES);
        mode.of_drives[axis] = 1.0;
        mode.of_sensors[axis] = random.random_range(0.05..0.15);
        stage.modes.push(mode);
        frequency_hz *= random.random_range(1.15..1.5);
    }
    for drive in &mut stage.drives {
        let (total, falls) = (random.random_range(0.1..0.3), random.random_range(1.0..4.0));
        let threshold = |k: usize| REACH_V * (k as f64 + 0.5) / 40.0;
        let weight = |k: usize| (-falls * (k as f64 + 0.5) / 40.0_f64).exp();
        let sum: f64 = (0..40).map(weight).sum();
        drive.plays = (0..40)
            .map(|k| [threshold(k), total * weight(k) / sum])
            .collect();
    }
    let drive = random.random_range(0..AXES);
    let other = (drive + random.random_range(1..AXES)) % AXES;
    let mut channel = Channel {
        drive,
        mode: drive,
        sensor: drive,
    };
    let truth = match plant {
        AxisPlant::Coupling => {
            channel.mode = other;
            stage.modes[other].of_drives[drive] = random.random_range(0.05..0.3);
            format!(
                "drive {} moves the mode at {:.0} Hz",
                drive + 1,
                stage.modes[other].frequency_hz
            )
        }
        AxisPlant::ModeOfOneDrive => {
            let mut mode = StageMode::linear(
                random.random_range(550.0..950.0),
                random.random_range(0.01..0.03),
                AXES,
                AXES,
            );
            mode.of_drives[drive] = 1.0;
            for sensor in [drive, other] {
                mode.of_sensors[sensor] =
                    stage.modes[sensor].of_sensors[sensor] * random.random_range(0.03..0.2);
            }
            channel.mode = AXES;
            stage.modes.push(mode);
            format!(
                "a mode at {:.0} Hz that only drive {} moves",
                stage.modes[AXES].frequency_hz,
                drive + 1
            )
        }
        AxisPlant::Friction => {
            let (force, bend) = (
                random.random_range(0.02..0.08),
                random.random_range(0.02..0.1),
            );
            stage.modes[drive].friction = Some(ModeFriction {
                force: force * REACH_V,
                bend: bend * REACH_V,
            });
            format!(
                "friction on the mode at {:.0} Hz",
                stage.modes[drive].frequency_hz
            )
        }
        AxisPlant::Delay => {
            stage.drives[drive].delay_s = random.random_range(0.4..2.5) / RATE_HZ;
            format!(
                "drive {} acts {:.2} ms later",
                drive + 1,
                1e3 * stage.drives[drive].delay_s
            )
        }
        AxisPlant::Creep => {
            let share = random.random_range(0.01..0.03);
            stage.drives[drive].creep = (0..7).map(|k| [share, 0.006 * 2.3_f64.powi(k)]).collect();
            format!("drive {} creeps", drive + 1)
        }
        AxisPlant::NonlinearStiffness => {
            stage.modes[drive].cubic = random.random_range(0.03..0.15) / (REACH_V * REACH_V);
            format!(
                "the mode at {:.0} Hz stiffens",
                stage.modes[drive].frequency_hz
            )
        }
        AxisPlant::SensorBandwidth => {
            stage.sensors[drive].lag_s = random.random_range(0.3..2.0) / RATE_HZ;
            format!(
                "sensor {} lags by {:.2} ms",
                drive + 1,
                1e3 * stage.sensors[drive].lag_s
            )
        }
        AxisPlant::SensorCoupling => {
            channel = Channel {
                drive: other,
                mode: other,
                sensor: drive,
            };
            stage.modes[other].of_sensors[drive] =
                stage.modes[other].of_sensors[other] * random.random_range(0.03..0.2);
            format!(
                "sensor {} sees the mode at {:.0} Hz",
                drive + 1,
                stage.modes[other].frequency_hz
            )
        }
        AxisPlant::ActuatorHysteresis => {
            stage.modes[other].of_drives[drive] = random.random_range(0.3..0.6);
            stage.modes[other].compliance = random.random_range(0.5..2.0);
            let (total, falls) = (
                random.random_range(0.05..0.15),
                random.random_range(1.0..4.0),
            );
            let share = |k: usize| k as f64 / (SLIPS - 1) as f64;
            let weight = |k: usize| (-falls * share(k)).exp();
            let sum: f64 = (0..SLIPS).map(weight).sum();
            let threshold = |k: usize| REACH_V * SLIP_LEAST.powf(1.0 - share(k));
            stage.drives[drive].slips = (0..SLIPS)
                .map(|k| [threshold(k), total * weight(k) / sum])
                .collect();
            format!(
                "the force of drive {} has memory of its extension",
                drive + 1
            )
        }
    };
    let data = recorded(&stage, seed);
    PlantedStage {
        plant,
        truth,
        stage,
        channel,
        data,
    }
}

fn recorded(stage: &ModalStage, seed: u64) -> AxesData {
    let averaged = |record: AxesRecord| {
        record
            .averaged(PERIOD, PERIOD)
            .expect("five periods are enough")
    };
    let records = periods(stage, seed).into_iter().map(averaged).collect();
    AxesData::new("simulated stage of three axes", records)
        .expect("its records have the same channels")
}

/// Recordings of a stage under a multisine of every drive, at every level with phases of its own.
fn periods(stage: &ModalStage, seed: u64) -> Vec<AxesRecord> {
    let lines: Vec<usize> = (1..=(BAND_HZ / RATE_HZ * PERIOD as f64) as usize).collect();
    let record = |(n, (level, role)): (usize, &(f64, Role))| -> AxesRecord {
        let drives: Vec<Vec<f64>> = (0..stage.drives.len())
            .map(|j| {
                multisine(
                    PERIOD,
                    &lines,
                    level * REACH_V,
                    0.0,
                    PERIODS,
                    seed * 1000 + (10 * n + j) as u64,
                )
            })
            .collect();
        let mut readings = stage.simulate(&drives, 1.0 / RATE_HZ, true);
        for (i, reading) in readings.iter_mut().enumerate() {
            let rms = (reading.iter().map(|y| y * y).sum::<f64>() / reading.len() as f64).sqrt();
            let mut noise = WhiteNoise::new(NOISE * rms, seed * 7919 + (100 * n + i) as u64);
            reading.iter_mut().for_each(|y| *y += noise.next_um());
        }
        AxesRecord::new(
            &format!("{:.0} % of {REACH_V:.0} V", 100.0 * level),
            RATE_HZ,
            *role,
            drives,
            readings,
        )
    };
    LEVELS.iter().enumerate().map(record).collect()
}

/// What a search made of a planted stage.
#[derive(Clone, Debug)]
pub struct JudgedStage {
    /// What was planted, in words.
    pub truth: String,
    /// It is among what was found.
    pub named: bool,
    /// With an "or".
    pub with_or: bool,
    /// What was found and is not there.
    pub wrong: Vec<String>,
    /// Everything that was found, in words.
    pub found: Vec<String>,
    /// Held-out error, in times the noise.
    pub times_noise: f64,
    /// Numbers of the model.
    pub parameters: usize,
}

impl JudgedStage {
    /// Heads of the columns of a table of scores.
    pub const COLUMNS: &'static str =
        "planted,seed,truth,named,with_or,wrong,times_noise,parameters,seconds,found";

    /// Its row in such a table.
    #[must_use]
    pub fn row(&self, plant: AxisPlant, seed: u64, seconds: f64) -> String {
        let quoted = |items: &[String]| format!("\"{}\"", items.join("; "));
        format!(
            "{},{seed},{},{},{},{},{:.3},{},{seconds:.1},{}",
            plant.name(),
            self.truth,
            self.named,
            self.with_or,
            quoted(&self.wrong),
            self.times_noise,
            self.parameters,
            quoted(&self.found)
        )
    }
}

/// A mode that was found is one that is there if their frequencies differ by less, relatively.
const SAME_MODE: f64 = 0.05;

impl PlantedStage {
    /// Its recordings with all their periods, as a logger writes them.
    #[must_use]
    pub fn periods(&self, seed: u64) -> Vec<AxesRecord> {
        periods(&self.stage, seed)
    }

    /// Searches for everything from a stage in which nothing moves, and compares.
    #[must_use]
    pub fn search(&self, policy: &AxesPolicy, watch: &dyn Watch) -> JudgedStage {
        self.judge(&find(
            &self.data,
            &Described::empty(&self.data),
            policy,
            watch,
        ))
    }

    /// The mode of the stage that a found mode is.
    fn true_mode(&self, found: &Described, mode: usize) -> Option<usize> {
        let hz = found.stage.modes.get(mode)?.frequency_hz;
        let apart = |r: &usize| (self.stage.modes[*r].frequency_hz / hz - 1.0).abs();
        (0..self.stage.modes.len())
            .min_by(|a, b| apart(a).total_cmp(&apart(b)))
            .filter(|r| apart(r) < SAME_MODE)
    }

    /// Whether an effect of a model is there.
    fn is_there(&self, found: &Described, effect: AxisEffect) -> bool {
        let mode_has = |mode: usize, has: &dyn Fn(&StageMode) -> bool| {
            self.true_mode(found, mode)
                .is_some_and(|r| has(&self.stage.modes[r]))
        };
        match effect {
            AxisEffect::Vibration {
                mode,
                drive,
                sensor,
            } => mode_has(mode, &|m| {
                m.of_drives[drive] != 0.0 && m.of_sensors[sensor] != 0.0
            }),
            AxisEffect::DriveCoupling { drive, mode } => {
                mode_has(mode, &|m| m.of_drives[drive] != 0.0)
            }
            AxisEffect::SensorCoupling { mode, sensor } => {
                mode_has(mode, &|m| m.of_sensors[sensor] != 0.0)
            }
            AxisEffect::Feedthrough { drive, sensor } => {
                self.stage.feedthrough[sensor][drive] != 0.0
            }
            AxisEffect::Hysteresis { drive } => !self.stage.drives[drive].plays.is_empty(),
            AxisEffect::Creep { drive } => !self.stage.drives[drive].creep.is_empty(),
            AxisEffect::Delay { drive } => self.stage.drives[drive].delay_s > 0.0,
            AxisEffect::ActuatorHysteresis { drive } => !self.stage.drives[drive].slips.is_empty(),
            AxisEffect::ActuatorSoftening { drive } => self.stage.drives[drive].softening.is_some(),
            AxisEffect::Friction { mode } => mode_has(mode, &|m| m.friction.is_some()),
            AxisEffect::NonlinearStiffness { mode } => mode_has(mode, &|m| m.cubic != 0.0),
            AxisEffect::ComplexMode { mode } => mode_has(mode, &|m| !m.of_rates.is_empty()),
            AxisEffect::SensorBandwidth { sensor } => self.stage.sensors[sensor].lag_s > 0.0,
        }
    }

    /// Whether an effect of a model is what was planted. Which drive or sensor of a mode joined first does
    /// not matter: a mode that two drives move is the same whichever was found with it.
    fn is_planted(&self, found: &Described, effect: AxisEffect) -> bool {
        let Channel {
            drive,
            mode,
            sensor,
        } = self.channel;
        let of_mode = |m: usize| self.true_mode(found, m) == Some(mode);
        match (self.plant, effect) {
            (
                AxisPlant::Coupling,
                AxisEffect::DriveCoupling { mode: m, .. } | AxisEffect::Vibration { mode: m, .. },
            ) => of_mode(m) && found.stage.modes[m].of_drives[drive] != 0.0,
            (AxisPlant::ModeOfOneDrive, AxisEffect::Vibration { mode: m, .. }) => {
                let moves = |j: usize| found.stage.modes[m].of_drives[j] != 0.0;
                of_mode(m) && (0..AXES).all(|j| moves(j) == (j == drive))
            }
            (
                AxisPlant::SensorCoupling,
                AxisEffect::SensorCoupling { mode: m, .. } | AxisEffect::Vibration { mode: m, .. },
            ) => of_mode(m) && found.stage.modes[m].of_sensors[sensor] != 0.0,
            (AxisPlant::Friction, AxisEffect::Friction { mode: m })
            | (AxisPlant::NonlinearStiffness, AxisEffect::NonlinearStiffness { mode: m }) => {
                of_mode(m)
            }
            (AxisPlant::Delay, AxisEffect::Delay { drive: j })
            | (AxisPlant::Creep, AxisEffect::Creep { drive: j })
            | (AxisPlant::ActuatorHysteresis, AxisEffect::ActuatorHysteresis { drive: j }) => {
                j == drive
            }
            (AxisPlant::SensorBandwidth, AxisEffect::SensorBandwidth { sensor: i }) => i == sensor,
            _ => false,
        }
    }

    /// Compares what was found with what is there. An effect with an "or" is right if any of them is there.
    #[must_use]
    pub fn judge(&self, found: &AxesFound) -> JudgedStage {
        let of_finding = |finding: &AxisFinding, is: &dyn Fn(AxisEffect) -> bool| {
            is(finding.effect) || finding.or.iter().any(|(other, _)| is(*other))
        };
        let planted = |effect: AxisEffect| self.is_planted(&found.model, effect);
        let hits: Vec<&AxisFinding> = found
            .findings
            .iter()
            .filter(|finding| of_finding(finding, &planted))
            .collect();
        let wrong = |finding: &&AxisFinding| {
            !of_finding(finding, &|effect| self.is_there(&found.model, effect))
        };
        let words = |finding: &AxisFinding| {
            let others = finding.or.iter().map(|(_, named)| named.clone());
            std::iter::once(finding.named.clone())
                .chain(others)
                .collect::<Vec<_>>()
                .join(" or ")
        };
        JudgedStage {
            truth: self.truth.clone(),
            named: !hits.is_empty(),
            with_or: !hits.is_empty() && hits.iter().all(|finding| !finding.or.is_empty()),
            wrong: found.findings.iter().filter(wrong).map(words).collect(),
            found: found.findings.iter().map(words).collect(),
            times_noise: found.error,
            parameters: found.model.parameters(),
        }
    }
}
