//! A stage with several drives and sensors: drives act on modes, sensors read them.
//!
//! Every mode has a natural frequency, a damping ratio and a participation of every drive and every sensor,
//! so that its residue has rank one (Gawronski, Advanced Structural Dynamics and Active Control of
//! Structures (2004), chapter 2). Each drive has its own delay, hysteresis and creep, each mode its own
//! friction and nonlinear stiffness, each sensor its own lag, and an actuator can remember its extension,
//! which couples the modes (`stage_motion`):
//!
//! ```text
//! w_j = creep_j(hysteresis_j(u_j(t - delay_j))) - memory_j(sum_r compliance_r of_drives_rj q_r)
//! q_r'' / w0_r^2 + 2 zeta_r q_r' / w0_r + q_r = sum_j of_drives_rj w_j - friction_r - quadratic_r q_r^2 -
//! cubic_r q_r^3 y_i = lag_i(sum_r of_sensors_ir q_r + sum_j feedthrough_ij w_j)
//! ```
//!
//! Drives and modal coordinates have the unit of the drive, readings that of the sensor.
//!
//! # Time
//! As everywhere: `y[k]` is sampled at `t[k]`, `u[k]` acts from `t[k]` to `t[k+1]`. A delay moves the instant
//! inside the period at which the drive changes; linear modes are exact for that.

mod drive_path;
mod modal_motion;
mod modal_stage;
mod stage_motion;

pub use drive_path::{ActuatorSoftening, DrivePath, DriveRun, Held};
pub use modal_motion::{ModalMotion, ModeFriction, StageMode};
pub use modal_stage::{ModalStage, SensorPath};

use modal_stage::Lag;
use stage_motion::StageMotion;

/// How a stage moves.
impl ModalStage {
    /// The motions at the samples of the modes that are wanted, under the signals of all drives; where
    /// actuators couple the modes, of all.
    #[must_use]
    pub fn mode_signals(
        &self,
        wanted: impl Fn(usize) -> bool,
        drives: &[&[Held]],
        dt_s: f64,
    ) -> Vec<Option<Vec<f64>>> {
        let mut out = vec![None; self.modes.len()];
        let coupled = self.is_coupled();
        let numbers: Vec<usize> = (0..out.len()).filter(|r| coupled || wanted(*r)).collect();
        if numbers.is_empty() {
            return out;
        }
        let samples = drives.first().map_or(0, |signal| signal.len());
        let mut motion = StageMotion::new(self, &numbers, dt_s);
        let mut held: Vec<Held> = drives
            .iter()
            .map(|signal| signal.first().copied().unwrap_or_default())
            .collect();
        motion.settle(&held);
        let mut signals = vec![Vec::with_capacity(samples); numbers.len()];
        for k in 0..samples {
            signals
                .iter_mut()
                .zip(motion.positions())
                .for_each(|(signal, q)| signal.push(q));
            held.iter_mut()
                .zip(drives)
                .for_each(|(now, signal)| *now = signal[k]);
            motion.step(&held);
        }
        for (r, signal) in numbers.into_iter().zip(signals) {
            out[r] = Some(signal);
        }
        out
    }

    /// The motions of all modes at the samples, under the signals of all drives.
    #[must_use]
    pub fn all_mode_signals(&self, drives: &[&[Held]], dt_s: f64) -> Vec<Vec<f64>> {
        let signals = self.mode_signals(|_| true, drives, dt_s);
        signals.into_iter().flatten().collect()
    }

    /// All readings under drives, sensor by sensor.
    #[must_use]
    pub fn simulate(&self, u: &[Vec<f64>], dt_s: f64, rests_at_mean: bool) -> Vec<Vec<f64>> {
        let drives: Vec<Vec<Held>> = u
            .iter()
            .enumerate()
            .map(|(j, u)| self.drive_signal(j, u, dt_s, rests_at_mean))
            .collect();
        let drives: Vec<&[Held]> = drives.iter().map(Vec::as_slice).collect();
        let modes = self.all_mode_signals(&drives, dt_s);
        let modes: Vec<&[f64]> = modes.iter().map(Vec::as_slice).collect();
        (0..self.sensors.len())
            .map(|i| self.reading(i, &modes, &drives, dt_s))
            .collect()
    }
}

/// A stage that is stepped, as in a closed loop; it begins at rest.
#[derive(Clone, Debug)]
pub struct StageRun<'a> {
    stage: &'a ModalStage,
    drives: Vec<DriveRun>,
    motion: StageMotion,
    lags: Vec<Option<Lag>>,
    acting: Vec<Held>,
}

impl<'a> StageRun<'a> {
    /// At rest without a drive.
    #[must_use]
    pub fn new(stage: &'a ModalStage, dt_s: f64) -> Self {
        let numbers: Vec<usize> = (0..stage.modes.len()).collect();
        Self {
            stage,
            drives: stage
                .drives
                .iter()
                .map(|path| DriveRun::new(path, dt_s))
                .collect(),
            motion: StageMotion::new(stage, &numbers, dt_s),
            lags: stage
                .sensors
                .iter()
                .map(|path| Lag::from_path(path, dt_s))
                .collect(),
            acting: vec![Held::default(); stage.drives.len()],
        }
    }

    /// The readings now.
    pub fn readings(&mut self) -> Vec<f64> {
        let stage = self.stage;
        let reading = |(i, lag): (usize, &mut Option<Lag>)| {
            let of_modes: f64 = stage
                .modes
                .iter()
                .zip(self.motion.positions())
                .map(|(mode, position)| mode.of_sensors[i] * position)
                .sum();
            let at_once: f64 = stage.feedthrough[i]
                .iter()
                .zip(&self.acting)
                .map(|(share, held)| share * held.late)
                .sum();
            lag.as_mut()
                .map_or(of_modes + at_once, |lag| lag.step(of_modes + at_once))
        };
        self.lags.iter_mut().enumerate().map(reading).collect()
    }

    /// Goes on by a period under these drives.
    pub fn step(&mut self, u: &[f64]) {
        self.acting = self
            .drives
            .iter_mut()
            .zip(u)
            .map(|(drive, u)| drive.step(*u))
            .collect();
        self.motion.step(&self.acting);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn stage() -> ModalStage {
        let mut stage = ModalStage::at_rest(2, 2);
        stage.modes.push(StageMode {
            of_drives: vec![1.0, 0.3],
            of_sensors: vec![0.1, 0.02],
            ..StageMode::linear(210.0, 0.03, 2, 2)
        });
        stage.modes.push(StageMode {
            of_drives: vec![0.0, 1.0],
            of_sensors: vec![0.0, 0.2],
            ..StageMode::linear(330.0, 0.02, 2, 2)
        });
        stage
    }

    #[test]
    fn steps_and_signals_are_the_same_motion() {
        let mut stage = stage();
        stage.drives[0] = DrivePath {
            delay_s: 3.3e-4,
            plays: vec![[0.5, 0.2]],
            creep: vec![[0.02, 0.05]],
            slips: vec![[0.1, 0.2], [0.7, 0.1]],
            softening: None,
        };
        stage.modes[1].friction = Some(ModeFriction {
            force: 0.3,
            bend: 0.2,
        });
        stage.sensors[1].lag_s = 2e-4;
        let dt_s = 1.0 / 6400.0;
        let u: Vec<Vec<f64>> = (1..3)
            .map(|j| {
                std::iter::once(0.0)
                    .chain((1..400).map(|k| 3.0 * (0.01 * f64::from(j * k * (1 + k % 7))).sin()))
                    .collect()
            })
            .collect();
        let whole = stage.simulate(&u, dt_s, false);
        let mut run = StageRun::new(&stage, dt_s);
        for k in 0..400 {
            let now = run.readings();
            (0..2).for_each(|i| {
                assert!(
                    (now[i] - whole[i][k]).abs() < 1e-12,
                    "{k} {i}: {} {}",
                    now[i],
                    whole[i][k]
                )
            });
            run.step(&[u[0][k], u[1][k]]);
        }
    }

    #[test]
    fn a_held_drive_ends_at_the_static_gain() {
        let stage = stage();
        let mut u = vec![vec![0.0; 6400], vec![2.0; 6400]];
        u[1][0] = 0.0;
        let y = stage.simulate(&u, 1.0 / 6400.0, false);
        for i in 0..2 {
            assert!((y[i][6399] - 2.0 * stage.static_gain()[i][1]).abs() < 1e-6);
        }
    }

    #[test]
    fn an_actuator_that_does_not_slip_is_a_spring() {
        let mut stage = stage();
        stage.modes[1].compliance = 0.5;
        stage.drives[1].slips = vec![[1e9, 0.6]];
        let mut u = vec![vec![0.0; 6400], vec![2.0; 6400]];
        u[1][0] = 0.0;
        let y = stage.simulate(&u, 1.0 / 6400.0, false);
        // Reciprocity: both modes extend it as far as it moves them.
        let extension_by_force = 0.3_f64.powi(2) + 0.5;
        let force = 2.0 / (1.0 + 0.6 * extension_by_force);
        for i in 0..2 {
            let expected = force * stage.static_gain()[i][1];
            assert!(
                (y[i][6399] - expected).abs() < 1e-6,
                "{} {expected}",
                y[i][6399]
            );
        }
    }

    #[test]
    fn a_stiff_actuator_that_slips_only_loses_energy() {
        let mut stage = stage();
        stage.drives[1].slips = vec![[0.02, 3.0], [0.3, 3.0]];
        let mut u = vec![vec![0.0; 3200], vec![0.0; 3200]];
        u[1][1..40].fill(5.0);
        let ringing = |stage: &ModalStage, samples: std::ops::Range<usize>| -> f64 {
            let y = stage.simulate(&u, 1.0 / 6400.0, false);
            let mean = y[1][samples.clone()].iter().sum::<f64>() / samples.len() as f64;
            samples.fold(0.0_f64, |m, k| m.max((y[1][k] - mean).abs()))
        };
        let early = ringing(&stage, 60..120);
        let late = ringing(&stage, 600..800);
        stage.drives[1].slips.clear();
        assert!(late < 0.5 * ringing(&stage, 600..800) && late < early);
    }

    #[test]
    fn a_complex_mode_answers_the_rate_of_its_drive() {
        let mut stage = ModalStage::at_rest(1, 1);
        stage.drives[0].delay_s = 0.3 / 6400.0;
        stage.modes.push(StageMode {
            of_rates: vec![1.0],
            of_sensors: vec![1.0],
            ..StageMode::linear(200.0, 0.05, 1, 1)
        });
        let mut u = vec![vec![2.0; 200]];
        u[0][0] = 0.0;
        let y = stage.simulate(&u, 1.0 / 6400.0, false);
        let natural = std::f64::consts::TAU * 200.0;
        let damped = natural * (1.0 - 0.05_f64.powi(2)).sqrt();
        for (k, reading) in y[0].iter().enumerate().skip(2) {
            let since_s = (k as f64 - 1.3) / 6400.0;
            let expected = 2.0 * natural / damped
                * (-0.05 * natural * since_s).exp()
                * (damped * since_s).sin();
            assert!(
                (reading - expected).abs() < 1e-9,
                "{k}: {reading} {expected}"
            );
        }
    }

    #[test]
    fn an_actuator_that_moves_softens_within_the_stiffness_of_the_stage() {
        let mut stage = stage();
        stage.drives[1].softening = Some(ActuatorSoftening {
            stiffness: stage.softening_most(1),
            half_at: 1.0,
        });
        // Far below the modes: the amplitude is that of the stiffness.
        let by_drive = |reach: f64| -> f64 {
            let sine = |k: i32| reach * (0.02 * f64::from(k)).sin();
            let u = vec![vec![0.0; 12800], (0..12800).map(sine).collect()];
            let y = stage.simulate(&u, 1.0 / 6400.0, false);
            y[1][9600..].iter().fold(0.0_f64, |m, y| m.max(y.abs())) / reach
        };
        assert!(by_drive(20.0) > 1.2 * by_drive(0.1));
        assert!(by_drive(1e4) < 3.0 * by_drive(0.1));
    }
}
