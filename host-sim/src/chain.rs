//! A model: a list of effects with values. It builds the chain of stages for one record and runs it.
//!
//! The order of the list does not matter; effects stand in the chain where they declare ([`crate::effect::Place`]). A model without any
//! effect at the place of the hysteresis follows its drive one to one, which no real model does: `gain` is the least.
//!
//! Effects that follow the drive inside a sampling period (amplifier bandwidth, slew limit) make the chain run on sub-intervals; the
//! drive is then held over all the sub-intervals of a sample.

use crate::effect::{Effect, Overview, Parameter, Place, Scale, Setting, Stage};
use std::sync::Arc;

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
        f.debug_struct("EffectInstance").field("id", &self.id).field("parameters", &self.parameters).finish()
    }
}

impl EffectInstance {
    /// An effect with the given values (short lists are filled with the first start).
    #[must_use]
    pub fn new(effect: Arc<dyn Effect>, overview: &Overview, values: &[f64]) -> Self {
        let declared = effect.parameters(overview);
        let start = effect.starts(overview).into_iter().next().unwrap_or_default();
        let parameters = declared
            .into_iter()
            .enumerate()
            .map(|(i, parameter)| {
                let value = values.get(i).or(start.get(i)).copied().unwrap_or(0.0);
                ParameterValue { value: value.clamp(parameter.lower, parameter.upper), parameter, std: None }
            })
            .collect();
        Self { id: effect.declaration().id, effect, parameters }
    }

    /// The values of all parameters.
    #[must_use]
    pub fn values(&self) -> Vec<f64> {
        self.parameters.iter().map(|p| p.value).collect()
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
}

/// The state of the actuator at the first sample of a record.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum InitialState {
    /// Never driven: all states zero at the lower limit of the drive.
    Virgin,
    /// At rest at the first drive value.
    Settled,
    /// Anything; slow states are estimated.
    Unknown,
}

/// The drive of one record, as the chain sees it.
#[derive(Clone, Copy, Debug)]
pub struct Drive<'a> {
    /// Drive voltage, held from each sample to the next.
    pub drive_v: &'a [f64],
    /// External force, if measured.
    pub force_n: Option<&'a [f64]>,
    /// Sampling period, s.
    pub dt_s: f64,
    /// State at the first sample.
    pub initial_state: InitialState,
}

impl Model {
    /// A model without effects.
    #[must_use]
    pub fn new(drive_min_v: f64, drive_max_v: f64) -> Self {
        Self { drive_min_v, drive_max_v, effects: Vec::new() }
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

    /// Adds an effect, in place of one with the same identifier; a hysteresis replaces the gain or the hysteresis that was there.
    pub fn add(&mut self, instance: EffectInstance) {
        let declaration = instance.effect.declaration();
        let takes_over = declaration.place == Place::Hysteresis && declaration.modifies.is_none();
        self.effects.retain(|e| {
            let other = e.effect.declaration();
            e.id != instance.id && !(takes_over && other.place == Place::Hysteresis && other.modifies.is_none())
        });
        self.effects.push(instance);
        self.effects.sort_by_key(|e| e.effect.declaration().place);
    }

    /// Identifiers of the effects in the order of the chain.
    #[must_use]
    pub fn effect_ids(&self) -> Vec<String> {
        self.effects.iter().map(|e| e.id.clone()).collect()
    }

    /// Sub-intervals per sample.
    #[must_use]
    pub fn substeps(&self, dt_s: f64) -> usize {
        self.effects.iter().map(|e| e.effect.substeps(dt_s)).max().unwrap_or(1).max(1)
    }

    /// Builds the stages in the order of the chain, each with the index of its effect.
    #[must_use]
    pub fn stages<'a>(&self, setting: &Setting<'a>) -> Vec<(usize, Box<dyn Stage + 'a>)> {
        let mut order: Vec<usize> = (0..self.effects.len()).collect();
        order.sort_by_key(|&i| self.effects[i].effect.declaration().place);
        order
            .into_iter()
            .filter_map(|i| {
                let instance = &self.effects[i];
                instance.effect.stage(self, &instance.values(), setting).map(|stage| (i, stage))
            })
            .collect()
    }

    /// What the sensor would read at every sample of a record, in um.
    #[must_use]
    pub fn simulate(&self, drive: &Drive) -> Vec<f64> {
        let substeps = self.substeps(drive.dt_s);
        let force = drive.force_n.map(|f| spread_force(f, substeps));
        let setting = self.setting(drive.dt_s, substeps, force.as_deref());
        let mut signal = spread_drive(drive.drive_v, substeps);
        let mut at_rest = initial_drive(self, drive);
        for (_, mut stage) in self.stages(&setting) {
            at_rest = stage.settle(at_rest);
            stage.run(&mut signal);
        }
        sample(&signal, at_rest, substeps, drive.drive_v.len())
    }
}

/// One run of a chain with the signal in front of every stage, so that a change of one stage need not run those before it again.
#[derive(Clone, Debug)]
pub struct ChainRun {
    substeps: usize,
    samples: usize,
    force_n: Option<Vec<f64>>,
    /// Index of the effect of each stage.
    pub stage_effects: Vec<usize>,
    inputs: Vec<Vec<f64>>,
    rests: Vec<f64>,
    /// What the sensor would read, um.
    pub reading_um: Vec<f64>,
}

impl Model {
    /// Runs over a record and keeps what stands in front of every stage.
    #[must_use]
    pub fn run(&self, drive: &Drive) -> ChainRun {
        let substeps = self.substeps(drive.dt_s);
        let mut run = ChainRun {
            substeps,
            samples: drive.drive_v.len(),
            force_n: drive.force_n.map(|f| spread_force(f, substeps)),
            stage_effects: Vec::new(),
            inputs: Vec::new(),
            rests: Vec::new(),
            reading_um: Vec::new(),
        };
        let force = run.force_n.take();
        let setting = self.setting(drive.dt_s, substeps, force.as_deref());
        let mut signal = spread_drive(drive.drive_v, substeps);
        let mut at_rest = initial_drive(self, drive);
        for (effect, mut stage) in self.stages(&setting) {
            run.stage_effects.push(effect);
            run.inputs.push(signal.clone());
            run.rests.push(at_rest);
            at_rest = stage.settle(at_rest);
            stage.run(&mut signal);
        }
        run.reading_um = sample(&signal, at_rest, substeps, drive.drive_v.len());
        run.force_n = force;
        run
    }

    /// The reading with this model, which differs from the one that made `run` only from stage `from` on.
    #[must_use]
    pub fn resume(&self, run: &ChainRun, from: usize, dt_s: f64) -> Vec<f64> {
        let setting = self.setting(dt_s, run.substeps, run.force_n.as_deref());
        let Some(input) = run.inputs.get(from) else { return run.reading_um.clone() };
        let mut signal = input.clone();
        let mut at_rest = run.rests[from];
        for (_, mut stage) in self.stages(&setting).into_iter().skip(from) {
            at_rest = stage.settle(at_rest);
            stage.run(&mut signal);
        }
        sample(&signal, at_rest, run.substeps, run.samples)
    }

    fn setting<'a>(&self, dt_s: f64, substeps: usize, force_n: Option<&'a [f64]>) -> Setting<'a> {
        Setting { dt_s: dt_s / substeps as f64, force_n, drive_min_v: self.drive_min_v, drive_max_v: self.drive_max_v }
    }

    /// The stage that a parameter of effect `effect` acts in.
    #[must_use]
    pub fn stage_of(&self, run: &ChainRun, effect: usize) -> usize {
        if let Some(stage) = run.stage_effects.iter().position(|e| *e == effect) {
            return stage;
        }
        let place = self.effects[effect].effect.declaration().place;
        run.stage_effects.iter().position(|e| self.effects[*e].effect.declaration().place >= place).unwrap_or(0)
    }
}

/// The drive at which the actuator rests before the first sample.
#[must_use]
pub fn initial_drive(model: &Model, drive: &Drive) -> f64 {
    match drive.initial_state {
        InitialState::Virgin => model.drive_min_v,
        InitialState::Settled | InitialState::Unknown => drive.drive_v.first().copied().unwrap_or(model.drive_min_v),
    }
}

/// The drive held over the sub-intervals of each sample.
#[must_use]
pub fn spread_drive(drive_v: &[f64], substeps: usize) -> Vec<f64> {
    if substeps == 1 {
        return drive_v.to_vec();
    }
    drive_v.iter().flat_map(|u| std::iter::repeat_n(*u, substeps)).collect()
}

/// A force held over the sub-intervals of each sample, like the drive.
#[must_use]
pub fn spread_force(force_n: &[f64], substeps: usize) -> Vec<f64> {
    spread_drive(force_n, substeps)
}

/// What is measured at every sample: the value at the end of the interval before it.
#[must_use]
pub fn sample(signal: &[f64], at_rest: f64, substeps: usize, samples: usize) -> Vec<f64> {
    let mut out = Vec::with_capacity(samples);
    out.push(at_rest);
    out.extend(signal.iter().skip(substeps - 1).step_by(substeps).take(samples.saturating_sub(1)));
    out.truncate(samples);
    out
}
