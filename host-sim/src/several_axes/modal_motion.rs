//! One mode: exact for what the drives give, with forces that depend on its own motion beside it.

use super::drive_path::Held;
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
    /// Participation of the rate of every drive, by the natural frequency: where damping is not proportional
    /// the shape of a mode is complex. Empty where it is.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub of_rates: Vec<f64>,
    /// Participation of every sensor, reading by drive.
    pub of_sensors: Vec<f64>,
    /// How far its coordinate extends an actuator, by the participation of the drive; not negative. Only an
    /// actuator that remembers its extension feels it.
    #[serde(default = "unit_compliance")]
    pub compliance: f64,
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

fn unit_compliance() -> f64 {
    1.0
}

impl StageMode {
    /// A linear mode in which no drive and no sensor takes part.
    #[must_use]
    pub fn linear(frequency_hz: f64, damping_ratio: f64, drives: usize, sensors: usize) -> Self {
        Self {
            frequency_hz,
            damping_ratio,
            of_drives: vec![0.0; drives],
            of_rates: Vec::new(),
            of_sensors: vec![0.0; sensors],
            compliance: unit_compliance(),
            friction: None,
            quadratic: 0.0,
            cubic: 0.0,
        }
    }

    /// Participation of the rate of a drive.
    #[must_use]
    pub fn of_rate(&self, drive: usize) -> f64 {
        self.of_rates.get(drive).copied().unwrap_or(0.0)
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
pub(super) const CORRECTIONS: usize = 2;

/// Steps in a period that the forces of a mode need.
pub(super) fn steps_needed(mode: &StageMode, dt_s: f64) -> usize {
    if !mode.is_nonlinear() {
        return 1;
    }
    let stiffer = mode
        .friction
        .map_or(1.0, |f| 1.0 + f.force.abs() / f.bend.max(1e-12));
    let turn = std::f64::consts::TAU * mode.frequency_hz * stiffer.sqrt() * dt_s;
    let needed = (turn / TURN_MAX_RAD).ceil().max(1.0) as usize;
    needed.next_power_of_two().min(STEPS_MAX)
}

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
    /// For each step and drive: what its early and late value give position and velocity.
    gains: Vec<[[f64; 2]; 2]>,
    held: [f64; 2],
    ramp: [f64; 2],
    friction: Option<(ModeFriction, Dahl)>,
    nonlinear: bool,
    state: [f64; 2],
    bend: f64,
    force: f64,
    /// Where the drives alone take it in a step, and its position and force at the end.
    driven: [f64; 2],
    end_position: f64,
    end_force: f64,
}

impl ModalMotion {
    /// At rest; `switching` has the share of a period after which each drive changes.
    #[must_use]
    pub fn new(mode: &StageMode, switching: &[f64], dt_s: f64) -> Self {
        Self::with_steps(mode, switching, dt_s, steps_needed(mode, dt_s))
    }

    /// At rest, with so many steps in a period.
    pub(super) fn with_steps(mode: &StageMode, switching: &[f64], dt_s: f64, steps: usize) -> Self {
        let frequency = std::f64::consts::TAU * mode.frequency_hz;
        let damping = mode.damping_ratio.clamp(0.0, 0.99);
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
        // What a unit jump of a drive moves through its rate: it starts with the natural frequency.
        let after_jump = |time_s: f64| {
            let (sin, cos) = (damped * time_s).sin_cos();
            let decay = frequency * (-damping * frequency * time_s).exp();
            [decay * sin / damped, decay * (cos - rate * sin)]
        };
        // A unit ramp that reaches 1 at the end.
        let two_damping = 2.0 * damping / frequency;
        let position = h - two_damping
            + decay * (two_damping * cos + (2.0 * damping * damping - 1.0) / damped * sin);
        let ramp = [position / h, held[0] / h];
        // A drive changes inside one of the steps; before it the early value acts, behind it the late one.
        let gain = |step: usize, share: f64, drive: usize| {
            let inside = share * steps as f64 - step as f64;
            let left_s = (1.0 - inside.clamp(0.0, 1.0)) * h;
            let (late, of_drive) = (
                after_step(frequency, damping, left_s),
                mode.of_drives[drive],
            );
            let jumps = (0.0..1.0).contains(&inside);
            let of_jump = if jumps { mode.of_rate(drive) } else { 0.0 };
            let jump = after_jump(left_s);
            [0, 1].map(|i| {
                [
                    of_drive * (held[i] - late[i]) - of_jump * jump[i],
                    of_drive * late[i] + of_jump * jump[i],
                ]
            })
        };
        let gains = |step: usize| {
            let drives = switching.iter().enumerate();
            drives.map(move |(drive, share)| gain(step, *share, drive))
        };
        Self {
            mode: mode.clone(),
            steps,
            transition,
            gains: (0..steps).flat_map(gains).collect(),
            held,
            ramp,
            friction: mode
                .friction
                .map(|friction| (friction, Dahl::with_sliding_bend(friction.bend))),
            nonlinear: mode.is_nonlinear(),
            state: [0.0; 2],
            bend: 0.0,
            force: 0.0,
            driven: [0.0; 2],
            end_position: 0.0,
            end_force: 0.0,
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

    pub(super) fn steps(&self) -> usize {
        self.steps
    }

    /// Where a step ends, as far as it is corrected.
    pub(super) fn end_position(&self) -> f64 {
        self.end_position
    }

    /// Begins a step of a period: where the drives alone take it.
    pub(super) fn begin(&mut self, step: usize, drives: &[Held]) {
        let [q, v] = self.state;
        let mut next = [
            self.transition[0][0] * q + self.transition[0][1] * v,
            self.transition[1][0] * q + self.transition[1][1] * v,
        ];
        let of_step = &self.gains[step * drives.len()..];
        for (gain, held) in of_step.iter().zip(drives) {
            next[0] += gain[0][0] * held.early + gain[0][1] * held.late;
            next[1] += gain[1][0] * held.early + gain[1][1] * held.late;
        }
        (self.driven, self.end_force) = (next, self.force);
    }

    /// Where a step ends if its force runs straight to what it is at the end.
    fn end(&self) -> [f64; 2] {
        let change = self.end_force - self.force;
        let given = |i: usize| self.driven[i] + self.force * self.held[i] + change * self.ramp[i];
        [given(0), given(1)]
    }

    fn bend_at(&self, q_end: f64) -> f64 {
        self.friction.map_or(0.0, |(_, dahl)| {
            dahl.bend_after(self.bend, q_end - self.state[0])
        })
    }

    /// Corrects the end of a step by the force of its own that it has there.
    pub(super) fn correct(&mut self) {
        self.end_position = self.end()[0];
        self.end_force = if self.nonlinear {
            self.force_at(self.end_position, self.bend_at(self.end_position))
        } else {
            0.0
        };
    }

    /// Adds a force to that at the end of a step.
    pub(super) fn correct_by(&mut self, force: f64) {
        self.end_force += force;
    }

    /// Ends a step, with the force of its own.
    pub(super) fn finish(&mut self) {
        let end = self.end();
        if self.nonlinear {
            self.bend = self.bend_at(end[0]);
            self.force = self.force_at(end[0], self.bend);
        } else {
            self.force = 0.0;
        }
        self.state = end;
    }

    /// Adds a force to that with which the next step begins.
    pub(super) fn load_by(&mut self, force: f64) {
        self.force += force;
    }

    /// Goes on by a period.
    pub fn step(&mut self, drives: &[Held]) {
        for step in 0..self.steps {
            self.begin(step, drives);
            if self.nonlinear {
                (0..CORRECTIONS).for_each(|_| self.correct());
            }
            self.finish();
        }
    }
}
