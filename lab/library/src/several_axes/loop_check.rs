//! The loop of a law around a stage, as a whole: eigenvalues, sensitivity, what is let through, and a track
//! on the stage with all its effects.

use hysteron_sim::several_axes::{Held, ModalMotion, ModalStage, StageMode, StageRun};
use nalgebra::{Complex, DMatrix};
use serde::Serialize;
use std::f64::consts::TAU;

/// What a law is to follow, at an instant.
#[derive(Clone, Debug, Default)]
pub struct Aim {
    /// Reference of every sensor now.
    pub reference: Vec<f64>,
    /// States of the law's model one period later, where it has a model.
    pub states: Vec<f64>,
    /// Drives of the model then.
    pub drives: Vec<f64>,
}

/// States and drives of a model under a sine, as phasors.
pub type Harmonic = (Vec<Complex<f64>>, Vec<Complex<f64>>);

/// A sampled law of all axes together.
pub trait AxesLaw {
    /// Its sampling period, s.
    fn period_s(&self) -> f64;

    /// How many states it has beside the drives that act.
    fn states(&self) -> usize;

    /// Goes on by a period: the drives that act from the next sample on.
    fn step(&self, state: &mut [f64], acting: &[f64], readings: &[f64], aim: &Aim) -> Vec<f64>;

    /// States and drives of its model under a harmonic reference; none for a law without a model.
    fn harmonic(&self, _reference: &[f64], _hz: f64) -> Option<Harmonic> {
        None
    }
}

/// Check of a loop as a whole.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct WholeCheck {
    /// Largest magnitude of an eigenvalue of the closed sampled system.
    pub spectral_radius: f64,
    /// Largest singular value over frequency of the sensitivity at the drives.
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
/// Frequencies at which a sensitivity is sampled, and lowest of them by the sampling rate.
const FREQUENCIES: usize = 400;
const LOWEST: f64 = 1e-5;
/// Steps between frequencies that are looked at one after the other; it shares no factor with their number.
const SPREAD: usize = 37;

/// Frequencies of a check, Hz.
pub(super) fn frequencies(dt_s: f64) -> impl Iterator<Item = f64> {
    (0..FREQUENCIES)
        .map(move |n| LOWEST.powf(1.0 - n as f64 / (FREQUENCIES - 1) as f64) * 0.4999 / dt_s)
}

/// Gain of every drive's hysteresis for small and for large motions.
#[must_use]
pub fn gain_sets(stage: &ModalStage) -> [Vec<f64>; 2] {
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

/// A sampled linear system, `x+ = f x + g u` and `y = c x`; `u` acts from the sample on.
#[derive(Clone, Debug)]
pub struct LinearSystem {
    /// From states to states.
    pub f: DMatrix<f64>,
    /// From inputs to states.
    pub g: DMatrix<f64>,
    /// From states to outputs.
    pub c: DMatrix<f64>,
}

impl LinearSystem {
    /// The linear part of a stage with these gains of its drives. Friction and nonlinear stiffness are left
    /// out, and so are states that nothing depends on.
    #[must_use]
    pub fn from_stage(stage: &ModalStage, gains: &[f64], dt_s: f64) -> Self {
        let stepper = StageStepper::new(stage, gains, dt_s);
        let (states, drives) = (stepper.states, stage.drives.len());
        let unit = |n: usize, count: usize| {
            let mut unit = vec![0.0; count];
            unit.get_mut(n).into_iter().for_each(|x| *x = 1.0);
            unit
        };
        let rest = vec![0.0; drives];
        let of_states: Vec<_> = (0..states)
            .map(|n| stepper.step(&unit(n, states), &rest))
            .collect();
        let of_drives = (0..drives).map(|j| stepper.step(&vec![0.0; states], &unit(j, drives)).0);
        let columns = |columns: Vec<Vec<f64>>, rows: usize| {
            DMatrix::from_fn(rows, columns.len(), |i, j| columns[j][i])
        };
        let mut system = Self {
            g: columns(of_drives.collect(), states),
            c: columns(
                of_states.iter().map(|step| step.1.clone()).collect(),
                stage.sensors.len(),
            ),
            f: columns(of_states.into_iter().map(|step| step.0).collect(), states),
        };
        // Velocities by natural frequencies: eigenvalues of a matrix with rows of like size are found soon.
        for (r, mode) in stage.modes.iter().enumerate() {
            let (n, omega) = (2 * r + 1, TAU * mode.frequency_hz);
            system.f.row_mut(n).scale_mut(1.0 / omega);
            system.g.row_mut(n).scale_mut(1.0 / omega);
            system.f.column_mut(n).scale_mut(omega);
        }
        let unused = |system: &Self| {
            (0..system.f.nrows()).rfind(|n| {
                let is_zero = |matrix: &DMatrix<f64>| matrix.column(*n).iter().all(|x| *x == 0.0);
                is_zero(&system.f) && is_zero(&system.c)
            })
        };
        while let Some(n) = unused(&system) {
            system.f = system.f.remove_row(n).remove_column(n);
            (system.g, system.c) = (system.g.remove_row(n), system.c.remove_column(n));
        }
        system
    }

    /// A law as a system from readings to drives, without a reference.
    #[must_use]
    pub fn from_law(law: &dyn AxesLaw, drives: usize, sensors: usize) -> Self {
        let states = law.states() + drives;
        let column = |n: usize| {
            let mut unit = vec![0.0; states + sensors];
            unit[n] = 1.0;
            let (mut state, rest) = (unit[..law.states()].to_vec(), &unit[law.states()..]);
            let next = law.step(
                &mut state,
                &rest[..drives],
                &rest[drives..],
                &Aim::default(),
            );
            state.into_iter().chain(next).collect::<Vec<f64>>()
        };
        let columns: Vec<Vec<f64>> = (0..states + sensors).map(column).collect();
        let both = DMatrix::from_fn(states, states + sensors, |i, j| columns[j][i]);
        Self {
            f: both.columns(0, states).into_owned(),
            g: both.columns(states, sensors).into_owned(),
            c: DMatrix::from_fn(drives, states, |j, n| f64::from(n == law.states() + j)),
        }
    }

    /// Response at a frequency.
    #[must_use]
    pub fn response(&self, hz: f64, dt_s: f64) -> DMatrix<Complex<f64>> {
        let mut back = -self.f.map(Complex::from);
        let z = Complex::from_polar(1.0, TAU * hz * dt_s);
        (0..back.nrows()).for_each(|n| back[(n, n)] += z);
        let states = back.lu().solve(&self.g.map(Complex::from));
        let singular =
            || DMatrix::from_element(self.f.nrows(), self.g.ncols(), Complex::from(1e12));
        self.c.map(Complex::from) * states.unwrap_or_else(singular)
    }

    /// The matrix of the closed loop with a law from this system's outputs to its inputs.
    #[must_use]
    pub fn closed(&self, law: &Self) -> DMatrix<f64> {
        let (n, m) = (self.f.nrows(), law.f.nrows());
        let mut closed = DMatrix::zeros(n + m, n + m);
        closed.view_mut((0, 0), (n, n)).copy_from(&self.f);
        closed
            .view_mut((0, n), (n, m))
            .copy_from(&(&self.g * &law.c));
        closed
            .view_mut((n, 0), (m, n))
            .copy_from(&(&law.g * &self.c));
        closed.view_mut((n, n), (m, m)).copy_from(&law.f);
        closed
    }
}

/// Squarings after which a norm shows the spectral radius to 1e-6 (Gelfand's formula).
const SQUARINGS: i32 = 25;

/// Covariance of the states of a stable system `x+ = A x + w`, with that of `w`.
fn noise_covariance(a: &DMatrix<f64>, w: &DMatrix<f64>) -> DMatrix<f64> {
    let (mut power, mut p) = (a.clone(), w.clone());
    for _ in 0..SQUARINGS {
        p += &power * &p * power.transpose();
        power = &power * &power;
    }
    p
}

/// Largest magnitude of an eigenvalue. Loops here have several equal ones, at which iterations for eigenvalues
/// stall; powers of the matrix do not.
#[must_use]
pub fn spectral_radius(matrix: &DMatrix<f64>) -> f64 {
    let (mut power, mut logarithm) = (matrix.clone(), 0.0);
    for squaring in 0..SQUARINGS {
        let norm = power.norm();
        if norm == 0.0 || !norm.is_finite() {
            return norm;
        }
        power /= norm;
        logarithm += norm.ln() * 0.5_f64.powi(squaring);
        power = &power * &power;
    }
    logarithm.exp()
}

/// A stage for small and for large motions, with its responses: what many laws are checked on.
#[derive(Clone, Debug)]
pub struct CheckedStage {
    systems: [LinearSystem; 2],
    responses: Vec<(f64, [DMatrix<Complex<f64>>; 2])>,
    dt_s: f64,
}

impl CheckedStage {
    /// For laws with this period.
    #[must_use]
    pub fn new(stage: &ModalStage, dt_s: f64) -> Self {
        let systems = gain_sets(stage).map(|gains| LinearSystem::from_stage(stage, &gains, dt_s));
        let at = |hz: f64| (hz, [0, 1].map(|n| systems[n].response(hz, dt_s)));
        Self {
            responses: frequencies(dt_s).map(at).collect(),
            systems,
            dt_s,
        }
    }

    fn law(&self, law: &dyn AxesLaw) -> LinearSystem {
        let stage = &self.systems[0];
        LinearSystem::from_law(law, stage.g.ncols(), stage.c.nrows())
    }

    /// Largest magnitude of an eigenvalue of the loop, for the worse of small and large motions.
    #[must_use]
    pub fn spectral_radius(&self, law: &dyn AxesLaw) -> f64 {
        let law = self.law(law);
        let radius = |stage: &LinearSystem| spectral_radius(&stage.closed(&law));
        self.systems.iter().map(radius).fold(0.0, f64::max)
    }

    /// Checks a law; the worse of small and large motions.
    #[must_use]
    pub fn check(&self, law: &dyn AxesLaw) -> WholeCheck {
        let system = self.law(law);
        let peaks = (0..FREQUENCIES).map(|n| self.sensitivity(&system, n));
        WholeCheck {
            spectral_radius: self.spectral_radius(law),
            sensitivity_peak: peaks.fold(0.0, f64::max),
        }
    }

    /// Whether the sensitivity stays below a limit. Few frequencies find most laws that do not keep it: the
    /// order is spread over all of them.
    #[must_use]
    pub fn keeps(&self, law: &dyn AxesLaw, sensitivity: f64) -> bool {
        let system = self.law(law);
        let spread = (0..FREQUENCIES).map(|n| n * SPREAD % FREQUENCIES);
        spread
            .into_iter()
            .all(|n| self.sensitivity(&system, n) <= sensitivity)
    }

    /// Largest singular value of the sensitivity at a frequency, for small and for large motions.
    fn sensitivity(&self, law: &LinearSystem, n: usize) -> f64 {
        let (hz, stages) = &self.responses[n];
        let law = law.response(*hz, self.dt_s);
        let at = |stage: &DMatrix<Complex<f64>>| {
            let back = DMatrix::identity(law.nrows(), law.nrows()) - &law * stage;
            1.0 / back.singular_values().min().max(1e-12)
        };
        stages.iter().map(at).fold(0.0, f64::max)
    }

    /// Largest motion at the sensors that an unknown input of one at the drives makes at a frequency, for the
    /// worse of small and large motions.
    #[must_use]
    pub fn lets_through(&self, law: &dyn AxesLaw, hz: f64) -> f64 {
        let law = self.law(law).response(hz, self.dt_s);
        let through = |stage: &LinearSystem| {
            let stage = stage.response(hz, self.dt_s);
            let back = DMatrix::identity(stage.nrows(), stage.nrows()) - &stage * &law;
            back.lu()
                .solve(&stage)
                .map_or(f64::INFINITY, |motion| motion.singular_values().max())
        };
        self.systems.iter().map(through).fold(0.0, f64::max)
    }

    /// RMS motion of the worst axis by noise of one in every sensor, for small motions.
    #[must_use]
    pub fn noise_gain(&self, law: &dyn AxesLaw) -> f64 {
        let (stage, law) = (&self.systems[0], self.law(law));
        let (n, m) = (stage.f.nrows(), law.f.nrows());
        let mut noise = DMatrix::zeros(n + m, n + m);
        noise
            .view_mut((n, n), (m, m))
            .copy_from(&(&law.g * law.g.transpose()));
        let all = noise_covariance(&stage.closed(&law), &noise);
        let positions = &stage.c * all.view((0, 0), (n, n)) * stage.c.transpose();
        positions.diagonal().max().max(0.0).sqrt()
    }
}

/// A stage that is stepped from given states: its linear part.
struct StageStepper<'a> {
    stage: &'a ModalStage,
    gains: &'a [f64],
    dt_s: f64,
    motions: Vec<ModalMotion>,
    /// How many earlier values of each drive matter.
    history: Vec<usize>,
    states: usize,
}

impl<'a> StageStepper<'a> {
    fn new(stage: &'a ModalStage, gains: &'a [f64], dt_s: f64) -> Self {
        let switching: Vec<f64> = stage
            .drives
            .iter()
            .map(|drive| drive.switches_at(dt_s))
            .collect();
        let linear = |mode: &StageMode| StageMode {
            friction: None,
            quadratic: 0.0,
            cubic: 0.0,
            ..mode.clone()
        };
        let motion = |mode| ModalMotion::new(&linear(mode), &switching, dt_s);
        let periods = |delay_s: f64| (delay_s / dt_s).max(0.0).floor() as usize;
        let history: Vec<usize> = (stage.drives.iter())
            .map(|drive| periods(drive.delay_s) + 1)
            .collect();
        Self {
            motions: stage.modes.iter().map(motion).collect(),
            states: 2 * stage.modes.len() + history.iter().sum::<usize>() + 2 * stage.sensors.len(),
            history,
            stage,
            gains,
            dt_s,
        }
    }

    /// The states one period later, and the readings now.
    fn step(&self, x: &[f64], drives: &[f64]) -> (Vec<f64>, Vec<f64>) {
        let (stage, modes) = (self.stage, self.motions.len());
        let mut next = vec![0.0; self.states];
        let mut at = 2 * modes;
        let (mut acting, mut before) = (Vec::new(), Vec::new());
        for (j, length) in self.history.iter().enumerate() {
            let values: Vec<f64> = std::iter::once(drives[j])
                .chain(x[at..at + length].iter().copied())
                .map(|value| self.gains[j] * value)
                .collect();
            acting.push(Held {
                early: values[*length],
                late: values[length - 1],
            });
            before.push(values[*length]);
            next[at] = drives[j];
            next[at + 1..at + length].copy_from_slice(&x[at..at + length - 1]);
            at += length;
        }
        let mut readings = Vec::new();
        for (i, sensor) in stage.sensors.iter().enumerate() {
            let of_modes = (0..modes).map(|r| stage.modes[r].of_sensors[i] * x[2 * r]);
            let at_once = stage.feedthrough[i].iter().zip(&before).map(|(s, w)| s * w);
            let now = of_modes.chain(at_once).sum();
            let [input, output] = [x[at + 2 * i], x[at + 2 * i + 1]];
            let reading = sensor.after(input, output, now, self.dt_s);
            readings.push(reading);
            if sensor.lag_s > 0.0 {
                (next[at + 2 * i], next[at + 2 * i + 1]) = (now, reading);
            }
        }
        for (r, motion) in self.motions.iter().enumerate() {
            let mut motion = motion.clone();
            motion.put([x[2 * r], x[2 * r + 1]]);
            motion.step(&acting);
            next[2 * r..2 * r + 2].copy_from_slice(&motion.state());
        }
        (next, readings)
    }
}

/// A sine on one axis.
#[derive(Clone, Copy, Debug)]
pub struct Sine {
    /// Axis that moves.
    pub axis: usize,
    /// Amplitude in the unit of the sensors.
    pub amplitude: f64,
    /// Frequency, Hz.
    pub hz: f64,
    /// Turns of which the second half counts.
    pub turns: f64,
}

/// Moves one axis by a sine, on a stage with all its effects.
#[must_use]
pub fn track(law: &dyn AxesLaw, stage: &ModalStage, sine: &Sine) -> AxesTrack {
    let (sensors, dt_s) = (stage.sensors.len(), law.period_s());
    let mut run = StageRun::new(stage, dt_s);
    let mut state = vec![0.0; law.states()];
    let mut drives = vec![0.0; stage.drives.len()];
    let samples = (sine.turns / (sine.hz * dt_s)) as usize;
    let mut unit = vec![0.0; sensors];
    unit[sine.axis] = sine.amplitude;
    let (of_states, of_drives) = law.harmonic(&unit, sine.hz).unwrap_or_default();
    let mut squares = vec![0.0; sensors];
    let mut of_reference = 0.0;
    for k in 0..samples {
        let turn = |k: usize| Complex::from_polar(1.0, TAU * sine.hz * k as f64 * dt_s);
        let later = |all: &[Complex<f64>]| all.iter().map(|x| (x * turn(k + 1)).im).collect();
        let aim = Aim {
            reference: unit.iter().map(|r| r * turn(k).im).collect(),
            states: later(&of_states),
            drives: later(&of_drives),
        };
        let readings = run.readings();
        if k >= samples / 2 {
            for (i, sum) in squares.iter_mut().enumerate() {
                *sum += (aim.reference[i] - readings[i]).powi(2);
            }
            of_reference += aim.reference[sine.axis].powi(2);
        }
        // What goes without bound has neither error nor crosstalk.
        if drives
            .iter()
            .chain(&readings)
            .any(|value| !value.is_finite())
        {
            return AxesTrack {
                own: f64::INFINITY,
                crosstalk: f64::INFINITY,
                finite: false,
            };
        }
        // What was computed a period ago acts now.
        run.step(&drives);
        drives = law.step(&mut state, &drives, &readings, &aim);
    }
    let share = |i: usize| (squares[i] / of_reference.max(f64::MIN_POSITIVE)).sqrt();
    let others = (0..sensors).filter(|i| *i != sine.axis);
    let (own, crosstalk) = (share(sine.axis), others.map(share).fold(0.0_f64, f64::max));
    AxesTrack {
        own,
        crosstalk,
        finite: own.is_finite() && crosstalk.is_finite() && own < 1e3,
    }
}
