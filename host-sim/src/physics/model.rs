//! Effects and models: what an effect has to give, and a list of effects with values.

use super::declaration::{Declaration, Parameter, Place, Scale};
use super::origin::Identified;
use super::recording::{LinesAtRest, Overview, Resonance, SimulatedStage};
use super::stage::{ByCoefficient, DriveRange, FreeMotion, Loops, RestoringForce, Setting, Stage};
use std::borrow::Cow;
use std::sync::Arc;

/// A physical effect: what it is, where it may start when it is looked for, and the stage that computes it.
pub trait Effect: Send + Sync {
    /// What the effect says about itself.
    fn declaration(&self) -> Declaration;

    /// Its parameters for a data set (number of terms, bounds).
    fn parameters(&self, overview: &Overview) -> Vec<Parameter>;

    /// Values, one list per start, at which the effect is small but visible; each is a direction in which it
    /// may be found.
    fn starts(&self, overview: &Overview) -> Vec<Vec<f64>>;

    /// Builds the stage, or `None` where another effect's stage takes it in. A structure of loops gives those.
    fn stage<'a>(&self, from: &Build<'_, 'a>) -> Option<Box<dyn Stage + 'a>> {
        let loops = self.loops(from)?;
        Some(loops)
    }

    /// The loops of a structure that has an inverse.
    fn loops(&self, _from: &Build) -> Option<Box<dyn Loops>> {
        None
    }

    /// What each of its coefficients contributes, where its output is linear in most of its parameters: the
    /// derivatives by all of them then come of one simulation.
    fn by_coefficient(&self, _from: &Build) -> Option<Box<dyn ByCoefficient>> {
        None
    }

    /// What the effect adds to the force balance of the moving mass, which the vibration stage takes in.
    fn restoring_force(&self, _from: &Build) -> Option<Box<dyn RestoringForce>> {
        None
    }

    /// This effect with another number of parameters, for one whose number of terms is free.
    fn with_parameters(&self, _count: usize) -> Option<Arc<dyn Effect>> {
        None
    }

    /// Into how many sub-intervals a sampling period must be divided for this effect in `model`.
    fn substeps(&self, _model: &Model, _dt_s: f64) -> usize {
        1
    }

    /// Whether what it makes of a motion in `model` is known from where that stands at the ends of sampling
    /// periods: behind what moves inside them it then goes in whole periods, if all that stand behind it do.
    fn goes_by_ends(&self, _model: &Model) -> bool {
        self.declaration().goes_by_ends
    }

    /// Free motions of the states of this effect in `model`, whose initial values are unknown in a record
    /// that starts after an unknown history.
    fn free_motions(&self, _model: &Model, _values: &[f64]) -> Vec<FreeMotion> {
        Vec::new()
    }

    /// How far a free motion can be away from rest at a first sample, as a share of the range of the motion.
    fn free_share(&self, _values: &[f64]) -> f64 {
        1.0
    }

    /// Frequencies in Hz of lines whose phase is arbitrary in every record.
    ///
    /// Sine and cosine of each, in this order, are its last values; the others of an effect in `model` may
    /// set the frequencies.
    fn line_frequencies_hz(&self, _model: &Model, _values: &[f64]) -> Vec<f64> {
        Vec::new()
    }

    /// Further starts at resonances that a residual shows.
    fn resonant_starts(&self, _resonances: &[Resonance]) -> Vec<Vec<f64>> {
        Vec::new()
    }

    /// Whether the effect makes sense beside what a model has, on data that look like this.
    fn may_join(&self, model: &Model, overview: &Overview) -> bool {
        let declaration = self.declaration();
        declaration
            .beside
            .is_none_or(|id| model.effect(id).is_some())
            && (overview.several_speeds || !declaration.needs_several_speeds)
    }

    /// Whether what is read while the drive stands still lets it be looked for beside a model.
    fn speaks_for_it(&self, _model: &Model, _at_rest: &LinesAtRest) -> bool {
        true
    }

    /// What speaks against values that were found, beside loops that do not open ([`Declaration::opening`]).
    fn doubt(&self, _model: &Model, _values: &[f64]) -> Option<Doubt> {
        None
    }

    /// Values that make the effect a few times as large as the noise at strength 1, for a simulated data set;
    /// `None` where it has no strength.
    fn values_at(&self, _case: &mut PlantedCase) -> Option<Vec<f64>> {
        None
    }
}

/// What an effect in a model builds its stage from.
pub struct Build<'m, 'a> {
    /// The model.
    pub model: &'m Model,
    /// The values of the effect in it.
    pub values: &'m [f64],
    /// The record on which the stage runs.
    pub setting: &'m Setting<'a>,
}

/// A simulated data set in which an effect is hidden.
pub struct PlantedCase<'a> {
    /// How large the effect is.
    pub strength: f64,
    /// What it is hidden in.
    pub stage: &'a SimulatedStage,
    /// Random numbers from 0 to 1.
    pub random: &'a mut dyn FnMut() -> f64,
}

impl PlantedCase<'_> {
    /// A value within a fifth of this one.
    pub fn about(&mut self, value: f64) -> f64 {
        value * (0.8 + 0.4 * (self.random)())
    }
}

/// Why values that were found are doubtful.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Doubt {
    /// They are none of this effect, whatever they bring: it is then part of a model, and no name.
    RuledOut(String),
    /// A reading of the same data by another effect is likelier.
    Unlikely(String),
}

/// One parameter with its value.
#[derive(Clone, Debug, PartialEq)]
pub struct ParameterValue {
    /// What the parameter is.
    pub parameter: Parameter,
    /// Its value, in its unit.
    pub value: f64,
    /// Standard deviation of the value, if it was estimated.
    pub std: Option<f64>,
}

impl ParameterValue {
    /// The coordinate in which the parameter is varied.
    #[must_use]
    pub fn coordinate(&self) -> f64 {
        match self.parameter.scale {
            Scale::Linear(step) => self.value / step,
            Scale::Logarithmic => self.value.max(f64::MIN_POSITIVE).ln(),
        }
    }

    /// Sets the value from a coordinate, within the bounds of the parameter.
    pub fn set_coordinate(&mut self, coordinate: f64) {
        let value = match self.parameter.scale {
            Scale::Linear(step) => coordinate * step,
            Scale::Logarithmic => coordinate.clamp(-700.0, 700.0).exp(),
        };
        self.value = value.clamp(self.parameter.lower, self.parameter.upper);
    }

    /// Change of the value for a unit change of the coordinate, for standard deviations.
    #[must_use]
    pub fn value_per_coordinate(&self) -> f64 {
        match self.parameter.scale {
            Scale::Linear(step) => step,
            Scale::Logarithmic => self.value,
        }
    }
}

/// An effect in a model.
#[derive(Clone)]
pub struct EffectInstance {
    /// Identifier, the same as in the declaration.
    pub id: String,
    /// The effect.
    pub effect: Arc<dyn Effect>,
    /// Its parameters with values.
    pub parameters: Vec<ParameterValue>,
}

impl std::fmt::Debug for EffectInstance {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("EffectInstance")
            .field("id", &self.id)
            .field("parameters", &self.parameters)
            .finish()
    }
}

impl EffectInstance {
    /// An effect with the given values (short lists are filled with the first start).
    #[must_use]
    pub fn new(effect: Arc<dyn Effect>, overview: &Overview, values: &[f64]) -> Self {
        let declared = effect.parameters(overview);
        let start = effect
            .starts(overview)
            .into_iter()
            .next()
            .unwrap_or_default();
        let parameters = declared
            .into_iter()
            .enumerate()
            .map(|(i, parameter)| {
                let value = values.get(i).or(start.get(i)).copied().unwrap_or(0.0);
                ParameterValue {
                    value: value.clamp(parameter.lower, parameter.upper),
                    parameter,
                    std: None,
                }
            })
            .collect();
        Self {
            id: effect.declaration().id,
            effect,
            parameters,
        }
    }

    /// The values of all parameters.
    #[must_use]
    pub fn values(&self) -> Vec<f64> {
        self.parameters.iter().map(|p| p.value).collect()
    }

    /// Its stage in `model`; `None` where another effect's stage takes it in.
    #[must_use]
    pub fn stage<'a>(&self, model: &Model, setting: &Setting<'a>) -> Option<Box<dyn Stage + 'a>> {
        self.effect.stage(&Build {
            model,
            values: &self.values(),
            setting,
        })
    }

    /// Its loops in `model`, if it is a structure that has an inverse.
    #[must_use]
    pub fn loops(&self, model: &Model, setting: &Setting) -> Option<Box<dyn Loops>> {
        self.effect.loops(&Build {
            model,
            values: &self.values(),
            setting,
        })
    }

    /// What each of its coefficients contributes in `model`.
    #[must_use]
    pub fn by_coefficient(
        &self,
        model: &Model,
        setting: &Setting,
    ) -> Option<Box<dyn ByCoefficient>> {
        self.effect.by_coefficient(&Build {
            model,
            values: &self.values(),
            setting,
        })
    }

    /// What it adds to the force balance of the moving mass in `model`.
    #[must_use]
    pub fn restoring_force(
        &self,
        model: &Model,
        setting: &Setting,
    ) -> Option<Box<dyn RestoringForce>> {
        self.effect.restoring_force(&Build {
            model,
            values: &self.values(),
            setting,
        })
    }
}

/// A chain of effects with values: drive voltage in, sensor reading out.
#[derive(Clone, Debug)]
pub struct Model {
    /// Lower limit of the drive, V: where the one-sided hysteresis counts from.
    pub drive_min_v: f64,
    /// Upper limit of the drive, V.
    pub drive_max_v: f64,
    /// The effects, in any order.
    pub effects: Vec<EffectInstance>,
    /// What it was identified from; none for a model that was written or changed by hand.
    pub identified: Option<Arc<Identified>>,
}

impl Model {
    /// A model without effects.
    #[must_use]
    pub fn new(drive_min_v: f64, drive_max_v: f64) -> Self {
        // Zero has no sign: "-0 V" is no limit.
        Self {
            drive_min_v: drive_min_v + 0.0,
            drive_max_v: drive_max_v + 0.0,
            effects: Vec::new(),
            identified: None,
        }
    }

    /// The drive in units of its range.
    #[must_use]
    pub fn drive_range(&self) -> DriveRange {
        DriveRange::between(self.drive_min_v, self.drive_max_v)
    }

    /// The effect with this identifier.
    #[must_use]
    pub fn effect(&self, id: &str) -> Option<&EffectInstance> {
        self.effects.iter().find(|e| e.id == id)
    }

    /// Values of the effect with this identifier.
    #[must_use]
    pub fn values(&self, id: &str) -> Option<Vec<f64>> {
        self.effect(id).map(EffectInstance::values)
    }

    /// The chain in front of the converter's rounding: what can be compared with readings, of which rounding
    /// is part of the noise.
    #[must_use]
    pub fn before_rounding(&self) -> Cow<'_, Self> {
        let rounds = |e: &EffectInstance| e.effect.declaration().place == Place::Quantisation;
        if !self.effects.iter().any(rounds) {
            return Cow::Borrowed(self);
        }
        let effects = self
            .effects
            .iter()
            .filter(|e| !rounds(e))
            .cloned()
            .collect();
        Cow::Owned(Self {
            effects,
            identified: None,
            ..*self
        })
    }

    /// Adds an effect, in place of one with the same identifier; a hysteresis replaces the gain or the
    /// hysteresis that was there.
    pub fn add(&mut self, instance: EffectInstance) {
        let declaration = instance.effect.declaration();
        let takes_over = declaration.place == Place::Hysteresis && declaration.modifies.is_none();
        self.effects.retain(|e| {
            let other = e.effect.declaration();
            e.id != instance.id
                && !(takes_over && other.place == Place::Hysteresis && other.modifies.is_none())
        });
        self.effects.push(instance);
        self.effects.sort_by_key(|e| e.effect.declaration().place);
    }

    /// Identifiers of the effects in the order of the chain.
    #[must_use]
    pub fn effect_ids(&self) -> Vec<String> {
        self.effects.iter().map(|e| e.id.clone()).collect()
    }

    /// Where the force-equivalent displacement stands without drive, um, on the first way there: what a
    /// spring is deflected from.
    pub(crate) fn neutral_um(&self, setting: &Setting) -> f64 {
        let undriven_v = 0.0_f64.clamp(self.drive_min_v, self.drive_max_v);
        let in_front = |i: &usize| self.effects[*i].effect.declaration().place <= Place::Hysteresis;
        let stages = self
            .order()
            .into_iter()
            .filter(in_front)
            .filter_map(|i| self.effects[i].stage(self, setting));
        stages.fold(undriven_v, |value, mut stage| stage.settle(value))
    }

    /// Builds the stages in the order of the chain, each with the index of its effect.
    #[must_use]
    pub fn stages<'a>(&self, setting: &Setting<'a>) -> Vec<(usize, Box<dyn Stage + 'a>)> {
        let order = self.order();
        order
            .into_iter()
            .filter_map(|i| self.effects[i].stage(self, setting).map(|stage| (i, stage)))
            .collect()
    }

    /// The effects in the order of the chain, by position in the list.
    pub(crate) fn order(&self) -> Vec<usize> {
        let mut order: Vec<usize> = (0..self.effects.len()).collect();
        order.sort_by_key(|&i| self.effects[i].effect.declaration().place);
        order
    }

    /// The drive at which an actuator that was never driven rests, V: the lower limit, or zero where its
    /// hysteresis counts from there to both sides.
    #[must_use]
    pub fn virgin_drive_v(&self) -> f64 {
        let at_zero = |e: &EffectInstance| e.effect.declaration().virgin_at_zero;
        if self.effects.iter().any(at_zero) {
            0.0
        } else {
            self.drive_min_v
        }
    }
}

/// Whether something behind the amplifier takes in what its voltage does over an interval: inertia or a lag
/// in the sensor. Without either the sensor reads the voltage at the end of the interval through what follows
/// at once.
pub(crate) fn takes_the_mean_in(model: &Model) -> bool {
    model.effects.iter().any(|e| {
        matches!(
            e.effect.declaration().place,
            Place::Vibration | Place::SensorBandwidth
        )
    })
}

/// Bandwidths at which a first-order lag is looked for, Hz.
pub(crate) fn lag_starts(overview: &Overview) -> Vec<Vec<f64>> {
    [0.25, 0.06, 0.015]
        .iter()
        .map(|share| vec![share * overview.sample_rate_max_hz])
        .collect()
}

/// The bandwidth of a first-order lag, within what the fastest record can show: a lag of much less than its
/// sampling period cannot be distinguished from how precisely the instants of sampling and of writing the
/// drive are known.
pub(crate) fn lag_parameters(overview: &Overview) -> Vec<Parameter> {
    vec![Parameter::logarithmic(
        "bandwidth_hz",
        "Hz",
        1e-4 * overview.sample_rate_max_hz,
        0.5 * overview.sample_rate_max_hz,
    )]
}
