//! One mode: exact for what the drives give, with forces that depend on its own motion beside it.

use super::Held;
use crate::elastoplastic_friction::Dahl;
use serde::{Deserialize, Serialize};

/// Friction on a mode, by Dahl's law.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ModeFriction {
    /// Force in steady sliding, as the drive that balances it.
    pub force: f64,
    /// Motion within which it builds up, in the unit of the modal coordinate.
    pub bend: f64,
}

/// One mode.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StageMode {
    /// Natural frequency, Hz.
    pub frequency_hz: f64,
    /// Damping ratio, below 1.
    pub damping_ratio: f64,
    /// Participation of every drive.
    pub of_drives: Vec<f64>,
    /// Participation of every sensor, reading by drive.
    pub of_sensors: Vec<f64>,
    /// Friction, if there is any.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub friction: Option<ModeFriction>,
    /// Quadratic part of the stiffness, by the linear one and the coordinate.
    #[serde(default)]
    pub quadratic: f64,
    /// Cubic part of the stiffness, by the linear one and the square of the coordinate.
    #[serde(default)]
    pub cubic: f64,
}

impl StageMode {
    /// A linear mode in which no drive and no sensor takes part.
    #[must_use]
    pub fn linear(frequency_hz: f64, damping_ratio: f64, drives: usize, sensors: usize) -> Self {
        Self {
            frequency_hz,
            damping_ratio,
            of_drives: vec![0.0; drives],
            of_sensors: vec![0.0; sensors],
            friction: None,
            quadratic: 0.0,
            cubic: 0.0,
        }
    }

    /// Whether forces depend on its motion.
    #[must_use]
    pub fn is_nonlinear(&self) -> bool {
        self.friction.is_some() || self.quadratic != 0.0 || self.cubic != 0.0
    }
}

/// Largest turn of a nonlinear mode inside a step, rad: the trapezoidal rule for its own forces then errs
/// by a thousandth of them.
const TURN_MAX_RAD: f64 = 0.3;
/// Most steps in a period.
const STEPS_MAX: usize = 16;
/// Corrections of a step's end: each takes the error of the force down by the square of the turn.
const CORRECTIONS: usize = 2;

/// What a unit step, held from the start of a time, has moved at its end: position and velocity.
fn after_step(frequency_rad_s: f64, damping: f64, time_s: f64) -> [f64; 2] {
    let damped_rad_s = frequency_rad_s * (1.0 - damping * damping).sqrt();
    let (sin, cos) = (damped_rad_s * time_s).sin_cos();
    let decay = (-damping * frequency_rad_s * time_s).exp();
    let rate = damping * frequency_rad_s / damped_rad_s;
    [
        1.0 - decay * (cos + rate * sin),
        decay * frequency_rad_s * frequency_rad_s / damped_rad_s * sin,
    ]
}

/// A mode that is stepped.
#[derive(Clone, Debug)]
pub struct ModalMotion {
    mode: StageMode,
    steps: usize,
    transition: [[f64; 2]; 2],
    /// For each drive: the step inside the period in which it changes, and what early and late part give
    /// there.
    changes: Vec<(usize, [f64; 2], [f64; 2])>,
    held: [f64; 2],
    ramp: [f64; 2],
    friction: Option<(ModeFriction, Dahl)>,
    nonlinear: bool,
    state: [f64; 2],
    bend: f64,
    force: f64,
}

impl ModalMotion {
    /// At rest; `switching` has the share of a period after which each drive changes.
    #[must_use]
    pub fn new(mode: &StageMode, switching: &[f64], dt_s: f64) -> Self {
        let frequency = std::f64::consts::TAU * mode.frequency_hz;
        let damping = mode.damping_ratio.clamp(0.0, 0.99);
        let stiffer = mode
            .friction
            .map_or(1.0, |f| 1.0 + f.force.abs() / f.bend.max(1e-12));
        let nonlinear = mode.is_nonlinear();
        let steps = if nonlinear {
            let needed = (frequency * stiffer.sqrt() * dt_s / TURN_MAX_RAD)
                .ceil()
                .max(1.0) as usize;
            needed.next_power_of_two().min(STEPS_MAX)
        } else {
            1
        };
        let h = dt_s / steps as f64;
        let held = after_step(frequency, damping, h);
        let damped = frequency * (1.0 - damping * damping).sqrt();
        let (sin, cos) = (damped * h).sin_cos();
        let decay = (-damping * frequency * h).exp();
        let rate = damping * frequency / damped;
        let transition = [
            [decay * (cos + rate * sin), decay * sin / damped],
            [
                -decay * frequency * frequency / damped * sin,
                decay * (cos - rate * sin),
            ],
        ];
        // A unit ramp that reaches 1 at the end.
        let two_damping = 2.0 * damping / frequency;
        let position = h - two_damping
            + decay * (two_damping * cos + (2.0 * damping * damping - 1.0) / damped * sin);
        let ramp = [position / h, held[0] / h];
        let change = |share: &f64| {
            let inside = share * steps as f64;
            let at = (inside.floor() as usize).min(steps - 1);
            let late = after_step(
                frequency,
                damping,
                (1.0 - (inside - at as f64)).max(0.0) * h,
            );
            (at, [held[0] - late[0], held[1] - late[1]], late)
        };
        Self {
            mode: mode.clone(),
            steps,
            transition,
            changes: switching.iter().map(change).collect(),
            held,
            ramp,
            friction: mode
                .friction
                .map(|friction| (friction, Dahl::with_sliding_bend(friction.bend))),
            nonlinear,
            state: [0.0; 2],
            bend: 0.0,
            force: 0.0,
        }
    }

    /// Its coordinate now.
    #[must_use]
    pub fn position(&self) -> f64 {
        self.state[0]
    }

    /// Its coordinate and velocity now.
    #[must_use]
    pub fn state(&self) -> [f64; 2] {
        self.state
    }

    /// Puts it somewhere, with its friction unloaded.
    pub fn put(&mut self, state: [f64; 2]) {
        (self.state, self.bend) = (state, 0.0);
        self.force = self.force_at(state[0], 0.0);
    }

    /// Comes to rest under what the drives give now; friction is unloaded there.
    pub fn settle(&mut self, drives: &[Held]) {
        let given: f64 = self
            .mode
            .of_drives
            .iter()
            .zip(drives)
            .map(|(share, held)| share * held.early)
            .sum();
        // Where the stiffness balances what is given: Newton's rule from the linear answer.
        let mut q = given;
        for _ in 0..20 {
            let (quadratic, cubic) = (self.mode.quadratic, self.mode.cubic);
            let slope = 1.0 + 2.0 * quadratic * q + 3.0 * cubic * q * q;
            q -= (q + quadratic * q * q + cubic * q * q * q - given) / slope.max(0.1);
        }
        (self.state, self.bend) = ([q, 0.0], 0.0);
        self.force = self.force_at(q, 0.0);
    }

    fn force_at(&self, q: f64, bend: f64) -> f64 {
        let of_friction = self.friction.map_or(0.0, |(friction, _)| {
            friction.force * bend / friction.bend.max(1e-12)
        });
        -(of_friction + q * q * (self.mode.quadratic + q * self.mode.cubic))
    }

    /// Goes on by a period.
    pub fn step(&mut self, drives: &[Held]) {
        for step in 0..self.steps {
            let [q, v] = self.state;
            let mut next = [
                self.transition[0][0] * q + self.transition[0][1] * v,
                self.transition[1][0] * q + self.transition[1][1] * v,
            ];
            for ((share, held), (at, early, late)) in
                self.mode.of_drives.iter().zip(drives).zip(&self.changes)
            {
                if *share == 0.0 {
                    continue;
                }
                let given = |i: usize| match step.cmp(at) {
                    std::cmp::Ordering::Less => held.early * self.held[i],
                    std::cmp::Ordering::Equal => held.early * early[i] + held.late * late[i],
                    std::cmp::Ordering::Greater => held.late * self.held[i],
                };
                next[0] += share * given(0);
                next[1] += share * given(1);
            }
            if self.nonlinear {
                let with = |force: f64| {
                    next[0] + self.force * self.held[0] + (force - self.force) * self.ramp[0]
                };
                let bend_at = |q_end: f64| {
                    self.friction
                        .map_or(0.0, |(_, dahl)| dahl.bend_after(self.bend, q_end - q))
                };
                let mut force = self.force;
                for _ in 0..CORRECTIONS {
                    let q_end = with(force);
                    force = self.force_at(q_end, bend_at(q_end));
                }
                let q_end = with(force);
                next[1] += self.force * self.held[1] + (force - self.force) * self.ramp[1];
                next[0] = q_end;
                self.bend = bend_at(q_end);
                self.force = self.force_at(q_end, self.bend);
            }
            self.state = next;
        }
    }
}
