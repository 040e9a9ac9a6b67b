//! What lies between the voltage of a drive and the force that it gives: delay, hysteresis, creep.

use serde::{Deserialize, Serialize};

/// Delay, play operators and creep of one drive.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct DrivePath {
    /// Time by which the drive acts later, s.
    pub delay_s: f64,
    /// Play operators beside the drive itself: threshold in the unit of the drive, weight.
    pub plays: Vec<[f64; 2]>,
    /// First-order terms beside the motion itself: share, time constant in s.
    pub creep: Vec<[f64; 2]>,
    /// Maxwell-slip elements of the actuator over its extension: threshold in the unit of the extension,
    /// stiffness in drive by extension, not negative.
    pub slips: Vec<[f64; 2]>,
    /// How the actuator softens while it moves.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub softening: Option<ActuatorSoftening>,
}

/// An actuator whose stiffness falls with how much it has moved lately: slow dynamics, as ceramics have them
/// (R. A. Guyer and P. A. Johnson, Physics Today 52(4), 30-36, 1999).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ActuatorSoftening {
    /// Stiffness that motion takes away, in drive by extension; not negative.
    pub stiffness: f64,
    /// RMS extension at which half of it is gone: there the modes have their frequencies.
    pub half_at: f64,
}

/// What a drive gives in a period: it changes once inside it, where its delay ends.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Held {
    /// Before the change.
    pub early: f64,
    /// After it.
    pub late: f64,
}

impl DrivePath {
    /// Whether the force of the actuator depends on its extension.
    #[must_use]
    pub fn has_memory(&self) -> bool {
        !self.slips.is_empty() || self.softening.is_some()
    }

    /// Share of a period after which the drive changes.
    #[must_use]
    pub fn switches_at(&self, dt_s: f64) -> f64 {
        let periods = (self.delay_s / dt_s).max(0.0);
        periods - periods.floor()
    }

    /// A whole drive at once; with `rests_at_mean` creep begins where a repeated drive has brought it.
    pub(super) fn run(&self, u: &[f64], dt_s: f64, rests_at_mean: bool) -> Vec<Held> {
        let mut run = DriveRun::new(self, dt_s);
        let mut after_hysteresis: Vec<f64> = u.iter().map(|u| run.hysteresis(*u)).collect();
        let first = after_hysteresis.first().copied().unwrap_or(0.0);
        let level = if rests_at_mean {
            after_hysteresis.iter().sum::<f64>() / after_hysteresis.len().max(1) as f64
        } else {
            first
        };
        run.rest_at(level, first);
        after_hysteresis.iter_mut().for_each(|x| *x = run.creep(*x));
        let before = after_hysteresis.first().copied().unwrap_or(0.0);
        run.history.fill(before);
        after_hysteresis.into_iter().map(|x| run.delay(x)).collect()
    }
}

/// A drive that is stepped.
#[derive(Clone, Debug)]
pub struct DriveRun {
    plays: Vec<(f64, f64, f64)>,
    creep: Vec<(f64, f64, f64)>,
    history: Vec<f64>,
    newest: usize,
}

impl DriveRun {
    /// At rest without a drive.
    #[must_use]
    pub fn new(path: &DrivePath, dt_s: f64) -> Self {
        let periods = (path.delay_s / dt_s).max(0.0).floor() as usize;
        Self {
            plays: path
                .plays
                .iter()
                .map(|[threshold, weight]| (*threshold, *weight, 0.0))
                .collect(),
            creep: path
                .creep
                .iter()
                .map(|[share, tau_s]| (*share, (-dt_s / tau_s.max(1e-9)).exp(), 0.0))
                .collect(),
            history: vec![0.0; periods + 2],
            newest: 0,
        }
    }

    /// Follows the drive by a period.
    pub fn step(&mut self, u: f64) -> Held {
        let x = self.hysteresis(u);
        let x = self.creep(x);
        self.delay(x)
    }

    fn rest_at(&mut self, level: f64, now: f64) {
        self.creep
            .iter_mut()
            .for_each(|(_, _, state)| *state = level);
        self.history.fill(now);
    }

    fn hysteresis(&mut self, u: f64) -> f64 {
        let mut sum = u;
        for (threshold, weight, state) in &mut self.plays {
            *state = state.clamp(u - *threshold, u + *threshold);
            sum += *weight * *state;
        }
        sum
    }

    fn creep(&mut self, x: f64) -> f64 {
        let mut sum = x;
        for (share, decay, state) in &mut self.creep {
            // The middle of the period stands for it.
            let after = *decay * *state + (1.0 - *decay) * x;
            sum += *share * 0.5 * (*state + after);
            *state = after;
        }
        sum
    }

    fn delay(&mut self, x: f64) -> Held {
        let length = self.history.len();
        self.newest = (self.newest + 1) % length;
        self.history[self.newest] = x;
        // Of `periods + 2` places the oldest is the value before the one that the whole periods have brought.
        Held {
            early: self.history[(self.newest + 1) % length],
            late: self.history[(self.newest + 2) % length],
        }
    }
}
