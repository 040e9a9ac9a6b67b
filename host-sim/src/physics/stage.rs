//! What walks along a signal.

use super::recording::Signals;
use crate::balance_law::ForceLines;
use crate::block::Block;

/// What a stage knows of the record on which it runs.
#[derive(Clone, Copy, Debug)]
pub struct Setting<'a> {
    /// Length of one interval of the chain, s.
    pub dt_s: f64,
    /// Intervals in one sampling period.
    pub substeps: usize,
    /// What was recorded beside the displacement, at every sample.
    pub signals: Signals<'a>,
    /// Limits of the drive, V.
    pub drive_min_v: f64,
    /// Limits of the drive, V.
    pub drive_max_v: f64,
    /// Signals run straight from the end of one interval to the end of the next: the drive is not held
    /// between samples.
    pub runs_straight: bool,
}

impl Setting<'_> {
    /// Of a drive between these limits, held over each period, with nothing recorded beside it.
    #[must_use]
    pub fn of_held_drive(drive_min_v: f64, drive_max_v: f64, dt_s: f64) -> Self {
        Self {
            dt_s,
            substeps: 1,
            signals: Signals::default(),
            drive_min_v,
            drive_max_v,
            runs_straight: false,
        }
    }

    /// Value of a signal of the record on an interval of the chain: held from each sample to the next, 0
    /// without such a signal.
    #[must_use]
    pub fn held(&self, signal: &[f64], interval: usize) -> f64 {
        signal.get(interval / self.substeps).copied().unwrap_or(0.0)
    }
}

/// One physical effect walking along a signal.
pub trait Stage: Send {
    /// Carries the stage over interval `k`: where its input stands at the end of it in, where its output
    /// stands then out. How they go there is the same for all that stand behind the amplifier (`arrival.rs`).
    fn step(&mut self, k: usize, input: f64) -> f64;

    /// Puts the stage at rest for a constant input and returns the output. One step does where the output does
    /// not depend on time.
    fn settle(&mut self, input: f64) -> f64 {
        self.step(0, input)
    }

    /// Runs over a part of a signal in place; its first element belongs to interval `from`.
    fn run(&mut self, from: usize, signal: &mut [f64]) {
        for (k, value) in signal.iter_mut().enumerate() {
            *value = self.step(from + k, *value);
        }
    }

    /// What it computes, as numbers, for exports.
    ///
    /// # Errors
    /// Why no block does that.
    fn blocks(&self) -> Result<Vec<Block>, &'static str> {
        Err("no block of an export computes it")
    }

    /// The costly part of the stage, where another may share it.
    fn shared(&mut self) -> Option<&mut dyn SharedPart> {
        None
    }

    /// How the stage passes many small changes of its input on, where it does so linearly (a small bend may
    /// be left out); `None` where that is not known and must be tried. For derivatives only.
    fn linear_lanes(&self, _lanes: usize) -> Option<Box<dyn LinearLanes>> {
        None
    }
}

/// A costly part of a stage that another stage may take from it.
pub trait SharedPart {
    /// Two stages with the same values here make the same of the same input.
    fn made_by(&self) -> Vec<f64>;

    /// Called before anything else where others will take what the part gives.
    fn keep(&mut self);

    /// What the part gave over the last signal, in a form that the stage knows.
    fn kept(&self) -> &[f64];

    /// Runs over a signal in place, with what the part gives taken from another stage.
    fn run_with(&mut self, signal: &mut [f64], part: &[f64]);
}

/// What each plain coefficient of a structure of loops contributes to its output, along an input.
pub trait ByCoefficient: Send {
    /// The coefficients: effect and place among its parameters.
    fn coefficients(&self) -> Vec<(&'static str, usize)>;

    /// Puts the stage at rest for a constant input and fills a row, one value for each coefficient.
    fn settle(&mut self, input: f64, row: &mut [f64]);

    /// Runs over inputs and fills a row for each.
    fn run(&mut self, inputs: &[f64], block: &mut [f64]);
}

/// Loops of a structure that can be tried: a stage from drive, V, to force-equivalent displacement, um, whose
/// copy answers what a drive would give. For [`crate::loop_inverse`].
pub trait Loops: Stage + BoxedCopy {
    /// Drives at which the output bends on the way up, or down, from where the drive stands, V, in any order;
    /// those behind it may be among them. None where it is smooth.
    fn bends_v(&self, _rising: bool) -> Vec<f64> {
        Vec::new()
    }
}

/// A copy behind a pointer, for loops with their memory.
pub trait BoxedCopy {
    /// These loops with their memory.
    fn boxed(&self) -> Box<dyn Loops>;
}

impl<T: Loops + Clone + 'static> BoxedCopy for T {
    fn boxed(&self) -> Box<dyn Loops> {
        Box::new(self.clone())
    }
}

/// Many signals that pass a linear stage side by side. A block holds a row for every interval, with one value
/// for each signal.
pub trait LinearLanes: Send {
    /// Puts all signals at rest for constant inputs, one for each, and leaves the outputs in their place.
    fn settle(&mut self, row: &mut [f64]);

    /// Runs over a block in place.
    fn run(&mut self, block: &mut [f64]);
}

/// A stage that passes changes of its input on as they are.
pub struct PassedOn;

impl LinearLanes for PassedOn {
    fn settle(&mut self, _row: &mut [f64]) {}
    fn run(&mut self, _block: &mut [f64]) {}
}

/// How a free motion dies out: `exp(-decay t)`, with an oscillation where the frequency is above zero.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FreeMotion {
    /// Rate of decay, 1/s.
    pub decay_per_s: f64,
    /// Angular frequency, rad/s.
    pub frequency_rad_s: f64,
}

/// A first-order lag over one interval: what remains of its state, and the mean of that remainder.
#[must_use]
pub fn lag_weights(bandwidth_hz: f64, dt_s: f64) -> (f64, f64) {
    let tau_s = 1.0 / (std::f64::consts::TAU * bandwidth_hz);
    (
        (-dt_s / tau_s).exp(),
        -(-dt_s / tau_s).exp_m1() * tau_s / dt_s,
    )
}

/// Sub-intervals of a sampling period for an effect that moves inside it: 12.5 us where the sampling is fast
/// enough to show what happens there, up to 125 us in slow records, which see little more than the end of it.
#[must_use]
pub fn substeps_inside_period(dt_s: f64) -> usize {
    let fast = ((dt_s / 12.5e-6).ceil() as usize).clamp(1, 4);
    let slow = ((dt_s / 125e-6).ceil() as usize).min(40);
    fast.max(slow)
}

/// Where a mass comes from, where it is and how fast.
#[derive(Clone, Copy, Debug)]
pub struct Travel {
    /// Where the memory of the force was made, um.
    pub from_um: f64,
    /// Where the mass is, um.
    pub to_um: f64,
    /// Its velocity there over the natural frequency, um.
    pub speed_um: f64,
}

/// A force that the moving mass works against.
pub trait RestoringForce: Send {
    /// The force at the end of a way, as the displacement that it makes at rest, um, and what it remembers
    /// there; a way is short, and goes one way.
    fn held(&self, memory: f64, way: Travel) -> (f64, f64);

    /// Force and memory of a mass that has come to rest there, nobody knows how: by one way from where nothing is
    /// held.
    fn at_rest(&self, at_um: f64) -> (f64, f64) {
        self.held(
            0.0,
            Travel {
                from_um: 0.0,
                to_um: at_um,
                speed_um: 0.0,
            },
        )
    }

    /// By how much it stiffens the spring at most where the mass swings to either side of its rest by so
    /// much, in units of the spring's own stiffness.
    fn stiffening(&self, memory: f64, swing_um: f64) -> f64;

    /// What it does, for exports.
    fn lines(&self) -> ForceLines;
}

/// The drive of a model in units of its range, from its lower limit on.
#[derive(Clone, Copy, Debug)]
pub struct DriveRange {
    /// Lower limit, V.
    pub lower_v: f64,
    /// From there to the upper limit, V.
    pub span_v: f64,
}

impl DriveRange {
    /// Of a drive between these limits.
    #[must_use]
    pub fn between(lower_v: f64, upper_v: f64) -> Self {
        Self {
            lower_v,
            span_v: upper_v - lower_v,
        }
    }

    /// Where a drive stands in the range: 0 at its lower limit, 1 at its upper one.
    #[must_use]
    pub fn share(&self, drive_v: f64) -> f64 {
        (drive_v - self.lower_v) / self.span_v
    }

    /// The drive there, V.
    #[must_use]
    pub fn at(&self, share: f64) -> f64 {
        self.lower_v + self.span_v * share
    }
}
