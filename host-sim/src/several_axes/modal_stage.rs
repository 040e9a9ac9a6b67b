//! The structure of a stage as numbers: what its drives give, what its modes are, what its sensors read.

use super::drive_path::{DrivePath, Held};
use super::modal_motion::StageMode;
use serde::{Deserialize, Serialize};

/// What a sensor does to the motion.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SensorPath {
    /// Time constant of its lag, s.
    pub lag_s: f64,
}

impl SensorPath {
    /// What it gives for a motion, a period after it gave `output` for `input`.
    #[must_use]
    pub fn after(&self, input: f64, output: f64, now: f64, dt_s: f64) -> f64 {
        Lag::from_path(self, dt_s).map_or(now, |lag| {
            Lag {
                input,
                output,
                ..lag
            }
            .step(now)
        })
    }
}

/// A stage of several drives and sensors.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ModalStage {
    /// One for each drive.
    pub drives: Vec<DrivePath>,
    /// One for each mode.
    #[serde(default)]
    pub modes: Vec<StageMode>,
    /// One for each sensor.
    pub sensors: Vec<SensorPath>,
    /// For each sensor what each drive moves at once.
    pub feedthrough: Vec<Vec<f64>>,
}

impl ModalStage {
    /// A stage in which nothing moves.
    #[must_use]
    pub fn at_rest(drives: usize, sensors: usize) -> Self {
        Self {
            drives: vec![DrivePath::default(); drives],
            modes: Vec::new(),
            sensors: vec![SensorPath::default(); sensors],
            feedthrough: vec![vec![0.0; drives]; sensors],
        }
    }

    /// What the drives give, for each drive sample by sample; `rests_at_mean` for a drive that has been
    /// repeated for long, whose creep has come to its mean.
    #[must_use]
    pub fn drive_signal(
        &self,
        drive: usize,
        u: &[f64],
        dt_s: f64,
        rests_at_mean: bool,
    ) -> Vec<Held> {
        self.drives[drive].run(u, dt_s, rests_at_mean)
    }

    /// Whether the force of an actuator depends on its extension, by which every mode moves every other.
    #[must_use]
    pub fn is_coupled(&self) -> bool {
        self.drives.iter().any(DrivePath::has_memory)
    }

    /// What a unit force of an actuator extends it by at rest.
    #[must_use]
    pub fn extension_by_force(&self, drive: usize) -> f64 {
        let of_mode = |mode: &StageMode| mode.compliance * mode.of_drives[drive].powi(2);
        self.modes.iter().map(of_mode).sum()
    }

    /// Largest stiffness that the softening of an actuator may take. Half of it counts against the modes: the
    /// trace of what all actuators take then stays below the stiffness of the structure.
    #[must_use]
    pub fn softening_most(&self, drive: usize) -> f64 {
        2.0 / (self.drives.len() as f64 * self.extension_by_force(drive)).max(f64::MIN_POSITIVE)
    }

    /// The readings of a sensor from the motions of all modes and the signals of all drives.
    #[must_use]
    pub fn reading(
        &self,
        sensor: usize,
        modes: &[&[f64]],
        drives: &[&[Held]],
        dt_s: f64,
    ) -> Vec<f64> {
        let samples = drives.first().map_or(0, |signal| signal.len());
        let mut out = vec![0.0; samples];
        for (mode, signal) in self.modes.iter().zip(modes) {
            let share = mode.of_sensors[sensor];
            if share != 0.0 {
                out.iter_mut()
                    .zip(*signal)
                    .for_each(|(y, q)| *y += share * q);
            }
        }
        for (share, signal) in self.feedthrough[sensor].iter().zip(drives) {
            if *share != 0.0 {
                // At a sample the drive of the period before it still acts.
                let acting = signal.iter().take(1).chain(signal.iter());
                out.iter_mut()
                    .zip(acting)
                    .for_each(|(y, held)| *y += share * held.late);
            }
        }
        if let Some(mut lag) = Lag::from_path(&self.sensors[sensor], dt_s) {
            lag.settle(out.first().copied().unwrap_or(0.0));
            out.iter_mut().for_each(|y| *y = lag.step(*y));
        }
        out
    }

    /// What each drive moves each sensor by at rest, without hysteresis, creep and memory of actuators:
    /// sensors by drives.
    #[must_use]
    pub fn static_gain(&self) -> Vec<Vec<f64>> {
        let gain = |i: usize, j: usize| {
            let of_modes: f64 = self
                .modes
                .iter()
                .map(|mode| mode.of_sensors[i] * mode.of_drives[j])
                .sum();
            of_modes + self.feedthrough[i][j]
        };
        (0..self.sensors.len())
            .map(|i| (0..self.drives.len()).map(|j| gain(i, j)).collect())
            .collect()
    }

    /// For each drive the share of a period after which it changes.
    pub(super) fn switching(&self, dt_s: f64) -> Vec<f64> {
        self.drives
            .iter()
            .map(|path| path.switches_at(dt_s))
            .collect()
    }
}

/// First-order lag, exact for an input that runs straight between samples.
#[derive(Clone, Copy, Debug)]
pub(super) struct Lag {
    decay: f64,
    from_before: f64,
    from_now: f64,
    input: f64,
    output: f64,
}

impl Lag {
    pub(super) fn from_path(path: &SensorPath, dt_s: f64) -> Option<Self> {
        if path.lag_s <= 0.0 {
            return None;
        }
        let decay = (-dt_s / path.lag_s).exp();
        let mean = -(-dt_s / path.lag_s).exp_m1() * path.lag_s / dt_s;
        Some(Self {
            decay,
            from_before: mean - decay,
            from_now: 1.0 - mean,
            input: 0.0,
            output: 0.0,
        })
    }
    pub(super) fn settle(&mut self, input: f64) {
        (self.input, self.output) = (input, input);
    }
    pub(super) fn step(&mut self, input: f64) -> f64 {
        self.output =
            self.decay * self.output + self.from_before * self.input + self.from_now * input;
        self.input = input;
        self.output
    }
}
