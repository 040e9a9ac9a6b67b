//! The physical effects of a piezoelectric positioning system, one file each, and their registry.
//!
//! An effect declares itself ([`Declaration`], [`Parameter`]), says where it may start when it is looked for
//! ([`SearchHints::starts`]) and builds a [`Stage`] that walks along a signal. Fitting, diagnosis, reports
//! and the command line work from that alone. To add an effect: one file here, one line in [`registry`].
//!
//! A *modifier* ([`Declaration::modifies`]) has no stage of its own where the effect that it modifies is in
//! the model: the initial ascending curve and the rate dependence are properties of the hysteresis stage, a
//! second mode of the vibration stage.

pub mod activated_switching;
pub mod amplifier_bandwidth;
mod arrival;
pub mod backlash;
pub mod bias_dependent_gain;
pub mod bipolar;
pub mod bouc_wen;
pub mod charge_leakage;
pub mod creep;
pub mod creep_operators;
pub mod creep_pole_pair;
pub mod delay;
pub mod duhem;
pub mod expression;
pub mod force_balance;
mod formula;
pub mod friction;
pub mod gain;
mod held_mass;
pub mod hum_harmonics;
pub mod hysteresis;
pub mod hysteretic_stiffness;
pub mod initial_curve;
pub mod inverse_preisach;
pub mod load_force;
pub mod logarithmic_creep;
mod loops;
pub mod mains_hum;
pub mod mass_change;
pub mod maxwell_slip;
pub mod nonlinear_damping;
pub mod nonlinear_stiffness;
pub mod play_operators;
pub mod polynomial_loop;
pub mod prandtl_ishlinskii;
pub mod quantisation;
pub mod rate_dependence;
pub mod rate_dependent_prandtl_ishlinskii;
pub mod rate_dependent_surfaces;
pub mod saturation;
pub mod second_mode;
pub mod sensor_bandwidth;
pub mod sensor_filter;
pub mod sensor_nonlinearity;
pub mod slew_limit;
pub mod thermal_drift;
pub mod two_sided;
pub mod vibration;

use crate::block::Block;
use crate::chain::Model;
use force_balance::RestoringForce;
use std::sync::Arc;

/// Where an effect stands in the chain from drive to measurement, in this order.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Place {
    /// Transport delay of the drive.
    Delay,
    /// Bandwidth of the amplifier.
    AmplifierBandwidth,
    /// Slew limit of the amplifier.
    AmplifierSlew,
    /// Output limits of the amplifier.
    AmplifierSaturation,
    /// Charge that leaks from the piezo.
    Charge,
    /// Drive to force-equivalent displacement.
    Hysteresis,
    /// Force-equivalent displacement by the state of polarisation.
    PiezoelectricCoefficient,
    /// External force.
    LoadForce,
    /// Friction of the guide.
    Friction,
    /// Structural modes.
    Vibration,
    /// Slow following of the displacement.
    Creep,
    /// Motion that has no cause in the drive.
    Drift,
    /// Characteristic of the sensor.
    SensorNonlinearity,
    /// Bandwidth of the sensor.
    SensorBandwidth,
    /// Lines in the sensor signal.
    Hum,
    /// Resolution of the converter.
    Quantisation,
}

impl Place {
    /// All places with the names that files use, in the order of the chain.
    pub const NAMES: [(&'static str, Place); 16] = [
        ("delay", Place::Delay),
        ("amplifier_bandwidth", Place::AmplifierBandwidth),
        ("amplifier_slew", Place::AmplifierSlew),
        ("amplifier_saturation", Place::AmplifierSaturation),
        ("charge", Place::Charge),
        ("hysteresis", Place::Hysteresis),
        ("piezoelectric_coefficient", Place::PiezoelectricCoefficient),
        ("load_force", Place::LoadForce),
        ("friction", Place::Friction),
        ("vibration", Place::Vibration),
        ("creep", Place::Creep),
        ("drift", Place::Drift),
        ("sensor_nonlinearity", Place::SensorNonlinearity),
        ("sensor_bandwidth", Place::SensorBandwidth),
        ("hum", Place::Hum),
        ("quantisation", Place::Quantisation),
    ];
}

/// How a parameter is varied when it is estimated.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Scale {
    /// Steps of this size matter.
    Linear(f64),
    /// Positive; relative steps matter.
    Logarithmic,
}

/// One parameter of an effect.
#[derive(Clone, Debug, PartialEq)]
pub struct Parameter {
    /// Name, with its unit as a suffix.
    pub name: String,
    /// Unit as printed.
    pub unit: String,
    /// Least value.
    pub lower: f64,
    /// Greatest value.
    pub upper: f64,
    /// How it is varied.
    pub scale: Scale,
    /// Not estimated unless asked for.
    pub fixed: bool,
    /// What it is expected to lie within without any data: the standard deviation of a prior around zero, in
    /// its unit.
    pub expected: Option<f64>,
    /// Its value was chosen before any data, as one of a grid: what another choice could do is no evidence of
    /// a missing effect.
    pub of_a_grid: bool,
}

impl Parameter {
    /// A parameter for which steps of `step` matter.
    #[must_use]
    pub fn linear(name: impl Into<String>, unit: &str, lower: f64, upper: f64, step: f64) -> Self {
        Self::varied(name.into(), unit, (lower, upper), Scale::Linear(step))
    }

    /// A positive parameter that is varied by ratios. Data that reach no further than `lower` leave it there.
    #[must_use]
    pub fn logarithmic(name: impl Into<String>, unit: &str, lower: f64, upper: f64) -> Self {
        Self::varied(name.into(), unit, (lower, upper), Scale::Logarithmic)
    }

    /// Data may reach no further than a limit; bounds never cross.
    fn varied(name: String, unit: &str, (lower, upper): (f64, f64), scale: Scale) -> Self {
        Self {
            name,
            unit: unit.into(),
            lower,
            upper: upper.max(lower),
            scale,
            fixed: false,
            expected: None,
            of_a_grid: false,
        }
    }

    /// The same parameter, expected within so much of zero where data do not say it.
    #[must_use]
    pub fn expected_within(mut self, std: f64) -> Self {
        self.expected = Some(std);
        self
    }

    /// The same parameter, kept at its value.
    #[must_use]
    pub fn fixed(mut self) -> Self {
        self.fixed = true;
        self
    }

    /// The same parameter, kept at its value on a grid that was chosen before any data.
    #[must_use]
    pub fn on_a_grid(mut self) -> Self {
        (self.fixed, self.of_a_grid) = (true, true);
        self
    }
}

/// What an effect says about itself.
#[derive(Clone, Debug, PartialEq)]
pub struct Declaration {
    /// Identifier on the command line and in files.
    pub id: String,
    /// One sentence of physics.
    pub physics: String,
    /// Where it is described.
    pub reference: String,
    /// Place in the chain.
    pub place: Place,
    /// The effect whose stage takes this one in, if any.
    pub modifies: Option<&'static str>,
    /// The experiment that shows it best.
    pub experiment: String,
    /// Whether it may be looked for in a residual.
    pub candidate: bool,
    /// The effect can only act in the direction of its start values (a delay cannot be negative).
    pub one_sided: bool,
}

/// What is known about the data before anything is fitted; prior guesses come from it.
#[derive(Clone, Debug, PartialEq)]
pub struct Overview {
    /// Limits of the drive, V.
    pub drive_min_v: f64,
    /// Limits of the drive, V.
    pub drive_max_v: f64,
    /// Largest drive that occurs, V.
    pub drive_peak_v: f64,
    /// Fastest sampling, Hz.
    pub sample_rate_max_hz: f64,
    /// Slowest sampling, Hz.
    pub sample_rate_min_hz: f64,
    /// Longest record, s.
    pub duration_s: f64,
    /// Largest span of the measured displacement, um.
    pub range_um: f64,
    /// Largest slope of the drive, V/s.
    pub slope_max_v_s: f64,
    /// A force was measured.
    pub has_force: bool,
    /// Static gain of a straight line through the data, um/V.
    pub gain_um_v: f64,
    /// Bandwidth of the sensor after its data sheet, Hz, if that is known.
    pub sensor_bandwidth_hz: Option<f64>,
    /// The drives move at more than one speed.
    pub several_speeds: bool,
}

impl Overview {
    /// What may be assumed of a drive between these limits where no data are at hand: one second at 20 kHz,
    /// with a force, one micrometre for the whole range.
    #[must_use]
    pub fn without_data(drive_min_v: f64, drive_max_v: f64) -> Self {
        Self {
            drive_min_v,
            drive_max_v,
            drive_peak_v: drive_max_v,
            sample_rate_max_hz: 20_000.0,
            sample_rate_min_hz: 20_000.0,
            duration_s: 1.0,
            range_um: 1.0,
            slope_max_v_s: 1e4,
            has_force: true,
            gain_um_v: 1.0,
            sensor_bandwidth_hz: None,
            several_speeds: true,
        }
    }

    /// Span of the drive, V.
    #[must_use]
    pub fn drive_range_v(&self) -> f64 {
        self.drive_max_v - self.drive_min_v
    }
}

/// A resonance that a residual shows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Resonance {
    /// Natural frequency, rad/s.
    pub natural_frequency_rad_s: f64,
    /// Damping ratio, from its width.
    pub damping_ratio: f64,
}

/// The stage that a simulated data set is of, as far as effects are planted in proportion to it.
#[derive(Clone, Debug, PartialEq)]
pub struct SimulatedStage {
    /// What is known of its data beforehand.
    pub overview: Overview,
    /// Natural frequency of its first mode, rad/s.
    pub natural_frequency_rad_s: f64,
    /// Damping ratio of its first mode.
    pub damping_ratio: f64,
    /// Coefficients of the remnant of its first rise, um.
    pub remnant_um: Vec<f64>,
}

/// In which sets of synthetic cases an effect is hidden.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Planted {
    /// In none.
    Never,
    /// Alone.
    Alone,
    /// Alone, and beside every other of these.
    InPairs,
}

/// What readings show beside their noise while the drive stands still.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LinesAtRest {
    /// Frequencies of lines, Hz, of every rest and hold by itself.
    pub lines_hz: Vec<f64>,
    /// Samples of the longest of them that is read fast enough for lines of the mains: zero without one.
    pub samples: usize,
}

/// The picture in which an effect is seen at a glance.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Picture {
    /// What a residual is drawn against.
    pub against: Against,
    /// What to see there, in a sentence.
    pub caption: &'static str,
}

/// What a residual is drawn against.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Against {
    /// Logarithm of the time since the last turn, while the drive stands still.
    TimeHeld,
    /// Logarithm of the time since the last turn.
    TimeSinceTurn,
    /// Drive, by branch.
    Drive,
    /// Displacement, by branch.
    Displacement,
    /// Where the modelled reading lies within a step of the converter.
    WithinStep,
    /// Signed rate of the drive.
    Rate,
    /// Measured external force.
    Force,
    /// Plain time.
    Time,
    /// Frequency.
    Frequency,
}

/// A signal that was recorded beside drive and displacement, as a temperature, for effects of the user's own.
#[derive(Clone, Debug, PartialEq)]
pub struct AuxiliarySignal {
    /// The name that expressions call it by.
    pub name: String,
    /// A value for every sample.
    pub values: Vec<f64>,
}

impl AuxiliarySignal {
    /// The same signal with other values in the place of these.
    #[must_use]
    pub fn with(&self, values: impl FnOnce(&[f64]) -> Vec<f64>) -> Self {
        Self {
            name: self.name.clone(),
            values: values(&self.values),
        }
    }
}

/// What was recorded beside the displacement, at every sample.
#[derive(Clone, Copy, Debug, Default)]
pub struct Signals<'a> {
    /// Drive, V; empty where none is known beforehand, as in a closed loop.
    pub drive_v: &'a [f64],
    /// External force, N, if it was measured.
    pub force_n: Option<&'a [f64]>,
    /// Further ones.
    pub auxiliary: &'a [AuxiliarySignal],
}

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

/// A first-order lag over one interval: what remains of its state, and the mean of that remainder.
#[must_use]
pub fn lag_weights(bandwidth_hz: f64, dt_s: f64) -> (f64, f64) {
    let tau_s = 1.0 / (std::f64::consts::TAU * bandwidth_hz);
    (
        (-dt_s / tau_s).exp(),
        -(-dt_s / tau_s).exp_m1() * tau_s / dt_s,
    )
}

/// Whether something behind the amplifier takes in what its voltage does over an interval: inertia or a lag
/// in the sensor. Without either the sensor reads the voltage at the end of the interval through what follows
/// at once.
fn takes_the_mean_in(model: &Model) -> bool {
    model.effects.iter().any(|e| {
        matches!(
            e.effect.declaration().place,
            Place::Vibration | Place::SensorBandwidth
        )
    })
}

/// Bandwidths at which a first-order lag is looked for, Hz.
fn lag_starts(overview: &Overview) -> Vec<Vec<f64>> {
    [0.25, 0.06, 0.015]
        .iter()
        .map(|share| vec![share * overview.sample_rate_max_hz])
        .collect()
}

/// The bandwidth of a first-order lag, within what the fastest record can show: a lag of much less than its
/// sampling period cannot be distinguished from how precisely the instants of sampling and of writing the
/// drive are known.
fn lag_parameters(overview: &Overview) -> Vec<Parameter> {
    vec![Parameter::logarithmic(
        "bandwidth_hz",
        "Hz",
        1e-4 * overview.sample_rate_max_hz,
        0.5 * overview.sample_rate_max_hz,
    )]
}

/// Sub-intervals of a sampling period for an effect that moves inside it: 12.5 us where the sampling is fast
/// enough to show what happens there, up to 125 us in slow records, which see little more than the end of it.
#[must_use]
pub fn substeps_inside_period(dt_s: f64) -> usize {
    let fast = ((dt_s / 12.5e-6).ceil() as usize).clamp(1, 4);
    let slow = ((dt_s / 125e-6).ceil() as usize).min(40);
    fast.max(slow)
}

/// One physical effect walking along a signal.
pub trait Stage: Send {
    /// Carries the stage over interval `k`: where its input stands at the end of it in, where its output
    /// stands then out. How they go there is the same for all that stand behind the amplifier (`arrival.rs`).
    fn step(&mut self, k: usize, input: f64) -> f64;

    /// Puts the stage at rest for a constant input and returns the output.
    fn settle(&mut self, input: f64) -> f64;

    /// Runs over a part of a signal in place; its first element belongs to interval `from`.
    fn run(&mut self, from: usize, signal: &mut [f64]) {
        for (k, value) in signal.iter_mut().enumerate() {
            *value = self.step(from + k, *value);
        }
    }

    /// What it computes, as numbers, for exports; `None` where no block does that.
    fn blocks(&self) -> Option<Vec<Block>> {
        None
    }

    /// What makes a costly part of the stage that another may share with it: two with the same values here
    /// make the same of the same input.
    fn shared_part(&self) -> Option<Vec<f64>> {
        None
    }

    /// Told before anything else that others will take what that part gives.
    fn keep_shared_part(&mut self) {}

    /// What that part gave over the last signal, in a form that the stage knows.
    fn by_shared_part(&self) -> &[f64] {
        &[]
    }

    /// As `run`, with what the shared part gives taken from another stage.
    fn run_sharing(&mut self, from: usize, signal: &mut [f64], _part: &[f64]) {
        self.run(from, signal);
    }

    /// How the stage passes many small changes of its input on, where it does so linearly (a small bend may
    /// be left out); `None` where that is not known and must be tried. For derivatives only.
    fn linear_lanes(&self, _lanes: usize) -> Option<Box<dyn LinearLanes>> {
        None
    }
}

/// Loops of a structure that can be tried: a stage from drive, V, to force-equivalent displacement, um, whose
/// copy answers what a drive would give. For [`crate::loop_inverse`].
pub trait Loops: Stage {
    /// The same loops with the same memory.
    fn boxed(&self) -> Box<dyn Loops>;

    /// Drives at which the output bends on the way up, or down, from where the drive stands, V, in any order;
    /// those behind it may be among them. None where it is smooth.
    fn bends_v(&self, _rising: bool) -> Vec<f64> {
        Vec::new()
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

/// What one unit of each coefficient of a stage adds to its output, along an input; a row for every interval.
pub trait CoefficientWalker: Send {
    /// The coefficients: effect and place among its parameters.
    fn coefficients(&self) -> Vec<(&'static str, usize)>;

    /// Puts the stage at rest for a constant input and fills the row.
    fn settle(&mut self, input: f64, row: &mut [f64]);

    /// Runs over inputs and fills a row for each.
    fn run(&mut self, inputs: &[f64], block: &mut [f64]);
}

/// How a free motion dies out: `exp(-decay t)`, with an oscillation where the frequency is above zero.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FreeMotion {
    /// Rate of decay, 1/s.
    pub decay_per_s: f64,
    /// Angular frequency, rad/s.
    pub frequency_rad_s: f64,
}

/// What an effect is: its parameters and the stage that computes it.
pub trait Physics: Send + Sync {
    /// What the effect says about itself.
    fn declaration(&self) -> Declaration;

    /// Its parameters for a data set (number of terms, bounds).
    fn parameters(&self, overview: &Overview) -> Vec<Parameter>;

    /// The same effect with another number of parameters, for one whose number of terms is free.
    fn with_parameters(&self, _count: usize) -> Option<Arc<dyn Effect>> {
        None
    }

    /// Names of the signals, beside drive and force, that have to be recorded for it.
    fn auxiliary(&self) -> &[String] {
        &[]
    }

    /// Whether it takes part of what was recorded, so that it cannot be simulated where the drive is not
    /// known beforehand.
    fn follows_record(&self) -> bool {
        false
    }

    /// Builds the stage from the values in `model`, or `None` where another effect's stage takes it in.
    ///
    /// `values` are this effect's values in `model`.
    fn stage<'a>(
        &self,
        model: &Model,
        values: &[f64],
        setting: &Setting<'a>,
    ) -> Option<Box<dyn Stage + 'a>>;

    /// The loops of a structure that has an inverse.
    fn loops(&self, _model: &Model, _values: &[f64], _setting: &Setting) -> Option<Box<dyn Loops>> {
        None
    }

    /// What the effect adds to the force balance of the moving mass, which the vibration stage takes in.
    fn restoring_force(
        &self,
        _model: &Model,
        _values: &[f64],
        _setting: &Setting,
    ) -> Option<Box<dyn RestoringForce>> {
        None
    }

    /// What each plain coefficient of the stage adds to its output, for a stage that is linear in them.
    fn coefficient_walker(
        &self,
        _model: &Model,
        _setting: &Setting,
    ) -> Option<Box<dyn CoefficientWalker>> {
        None
    }

    /// Into how many sub-intervals a sampling period must be divided for this effect in `model`.
    fn substeps(&self, _model: &Model, _dt_s: f64) -> usize {
        1
    }

    /// Whether it reads what moves inside a sampling period, and must see that motion: the modes in front of
    /// it then go in sub-intervals too.
    fn follows_motion(&self) -> bool {
        false
    }

    /// Whether what it makes of a motion in `model` is known from where that stands at the ends of sampling
    /// periods: behind what moves inside them it then goes in whole periods, if all that stand behind it do.
    fn goes_by_ends(&self, _model: &Model) -> bool {
        false
    }

    /// The text that defines an effect which is not built in.
    fn definition(&self) -> Option<&str> {
        None
    }

    /// Free motions of the states of this effect in `model`, whose initial values are unknown in a record
    /// that starts after an unknown history.
    fn free_motions(&self, _model: &Model, _values: &[f64]) -> Vec<FreeMotion> {
        Vec::new()
    }

    /// Frequencies in Hz of lines whose phase is arbitrary in every record.
    ///
    /// Sine and cosine of each, in this order, are its last values; the others of an effect in `model` may
    /// set the frequencies.
    fn line_frequencies_hz(&self, _model: &Model, _values: &[f64]) -> Vec<f64> {
        Vec::new()
    }
}

/// How the values of an effect are estimated.
pub trait Estimation: Physics {
    /// Place in the order in which a list of effects is fitted one after the other: those on which others
    /// build come first.
    fn fitting_rank(&self) -> usize {
        9
    }

    /// Whether a model can do without it once it has it.
    fn may_leave(&self) -> bool {
        true
    }

    /// Which of its parameters, by place, make it answer the drive, for an effect that has slow states
    /// beside: with all of them zero only the free motions of the states are left.
    fn answers_drive_by(&self) -> Vec<usize> {
        Vec::new()
    }
}

/// When an effect is looked for in a residual, and from which values on.
pub trait SearchHints: Physics {
    /// Values, one list per start, at which the effect is small but visible; each is a direction in which it
    /// may be found.
    fn starts(&self, overview: &Overview) -> Vec<Vec<f64>>;

    /// True where the starts are coefficients of one linear form, which is looked for as a whole.
    fn starts_combine(&self) -> bool {
        false
    }

    /// Further starts at resonances that a residual shows.
    fn resonant_starts(&self, _resonances: &[Resonance]) -> Vec<Vec<f64>> {
        Vec::new()
    }

    /// Whether the effect makes sense beside what a model has, on data that look like this.
    fn may_join(&self, _model: &Model, _overview: &Overview) -> bool {
        true
    }

    /// Whether a walk of it takes much longer than of any other effect: a search leaves it out where the
    /// signatures of others hardly change.
    fn costly(&self) -> bool {
        false
    }

    /// Whether nothing of it can be seen without a measured force.
    fn needs_force(&self) -> bool {
        false
    }

    /// Its values where the readings are whole steps of this size, um, for an effect that is seen in them
    /// whatever the model.
    fn values_in_readings(&self, _step_um: f64) -> Option<Vec<f64>> {
        None
    }

    /// What a user of the literature might object to in values that were found: a reading of the same data by
    /// another effect is then likelier.
    fn unlikely_because(&self, _model: &Model, _values: &[f64]) -> Option<String> {
        None
    }

    /// Why values that were found are none of this effect, whatever they bring: it is then part of a model,
    /// and no name.
    fn ruled_out_because(&self, _model: &Model, _values: &[f64]) -> Option<String> {
        None
    }

    /// Whether its loops are tried in the place of another structure's: one without memory, or that only adds
    /// parameters to another, is not.
    fn is_tried_for_loops(&self) -> bool {
        self.declaration().is_main()
    }

    /// Whether what is read while the drive stands still lets it be looked for beside a model.
    fn speaks_for_it(&self, _model: &Model, _at_rest: &LinesAtRest) -> bool {
        true
    }
}

/// How an effect is shown to a person.
pub trait Presentation {
    /// What it computes, so that a reader can compute the same: symbols by the names of its parameters, and
    /// how it is discretised, in Markdown. `docs/reference/effects.md` explains the notation.
    fn equations(&self) -> &'static str {
        ""
    }

    /// The picture that shows the effect in a residual.
    fn picture(&self) -> Picture {
        Picture {
            against: Against::Drive,
            caption: "Averaged over the drive, by branch.",
        }
    }
}

/// How an effect is hidden in simulated data sets.
pub trait SyntheticCases: Physics {
    /// Values that make the effect a few times as large as the noise at strength 1, for a simulated data set;
    /// `None` where it has no strength.
    fn values_at(
        &self,
        _strength: f64,
        _stage: &SimulatedStage,
        _random: &mut dyn FnMut() -> f64,
    ) -> Option<Vec<f64>> {
        None
    }

    /// In which sets of synthetic cases it is hidden.
    fn planted(&self) -> Planted {
        if self.declaration().candidate {
            Planted::Alone
        } else {
            Planted::Never
        }
    }

    /// Effects that an actuator which has this one has with it.
    fn comes_with(&self) -> &'static [&'static str] {
        &[]
    }
}

/// A physical effect: all that is asked of it, by who asks.
pub trait Effect: Physics + Estimation + SearchHints + Presentation + SyntheticCases {}

impl<T: Physics + Estimation + SearchHints + Presentation + SyntheticCases> Effect for T {}

impl Declaration {
    /// It stands for the hysteresis of the chain, or in place of it: a chain has one of these.
    #[must_use]
    pub fn is_main(&self) -> bool {
        self.place == Place::Hysteresis && self.modifies.is_none()
    }
}

/// Every built-in effect, in the order of the chain.
#[must_use]
pub fn registry() -> Vec<Arc<dyn Effect>> {
    vec![
        Arc::new(delay::Delay),
        Arc::new(amplifier_bandwidth::AmplifierBandwidth),
        Arc::new(slew_limit::SlewLimit),
        Arc::new(saturation::Saturation),
        Arc::new(charge_leakage::ChargeLeakage),
        Arc::new(gain::Gain),
        Arc::new(hysteresis::Hysteresis::default()),
        Arc::new(initial_curve::InitialCurve::default()),
        Arc::new(play_operators::PlayOperatorsBeside::default()),
        Arc::new(rate_dependence::RateDependence),
        Arc::new(rate_dependent_surfaces::RateDependentSurfaces::default()),
        Arc::new(bipolar::Bipolar),
        Arc::new(two_sided::TwoSided),
        Arc::new(prandtl_ishlinskii::PrandtlIshlinskii {
            one_sided_dead_zones: false,
        }),
        Arc::new(prandtl_ishlinskii::PrandtlIshlinskii {
            one_sided_dead_zones: true,
        }),
        Arc::new(rate_dependent_prandtl_ishlinskii::RateDependentPrandtlIshlinskii),
        Arc::new(maxwell_slip::MaxwellSlip),
        Arc::new(bouc_wen::BoucWen),
        Arc::new(duhem::Duhem),
        Arc::new(polynomial_loop::PolynomialLoop),
        Arc::new(inverse_preisach::InversePreisach),
        Arc::new(activated_switching::ActivatedSwitching),
        Arc::new(bias_dependent_gain::BiasDependentGain),
        Arc::new(load_force::LoadForce),
        Arc::new(backlash::Backlash),
        Arc::new(friction::Friction),
        Arc::new(nonlinear_stiffness::NonlinearStiffness),
        Arc::new(nonlinear_damping::NonlinearDamping),
        Arc::new(hysteretic_stiffness::HystereticStiffness),
        Arc::new(vibration::Vibration),
        Arc::new(second_mode::SecondMode),
        Arc::new(mass_change::MassChange),
        Arc::new(creep::Creep::default()),
        Arc::new(creep_pole_pair::CreepPolePair),
        Arc::new(logarithmic_creep::LogarithmicCreep),
        Arc::new(creep_operators::CreepOperators::default()),
        Arc::new(thermal_drift::ThermalDrift),
        Arc::new(sensor_nonlinearity::SensorNonlinearity),
        Arc::new(sensor_bandwidth::SensorBandwidth),
        Arc::new(sensor_filter::SensorFilter),
        Arc::new(mains_hum::MainsHum),
        Arc::new(hum_harmonics::HumHarmonics),
        Arc::new(quantisation::Quantisation),
    ]
}

/// Finds a built-in effect by its identifier; hyphens and underscores are the same.
#[must_use]
pub fn by_id(id: &str) -> Option<Arc<dyn Effect>> {
    let wanted = id.trim().replace('-', "_");
    registry()
        .into_iter()
        .find(|e| e.declaration().id == wanted)
}
