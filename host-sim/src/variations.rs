//! One walk of a chain along a record, and of many variations of it beside: the readings from which
//! derivatives and signatures are made.
//!
//! # How it works
//! The record is simulated in chunks that stay in the processor's cache. The chain itself goes through all
//! its stages; a variation (a moved value, one effect more) has stages of its own from the first one that
//! differs, and takes what the chain brings there, also from a costly part of that stage which is the same in
//! both. What each plain coefficient of the hysteresis adds comes from one walk of all coefficients side by
//! side, which then pass the stages behind as a batch ([`crate::effect::LinearLanes`]); a stage that does not
//! say how it passes small changes on is tried with one coefficient after the other.
//!
//! Nothing is kept but the chunk: the caller takes what it needs of it, every sample or a few.

use crate::chain::{Drive, InitialState, Model, ends};
use crate::physics::{ByCoefficient, LinearLanes, SharedPart, Stage};

/// Samples in a chunk.
const CHUNK: usize = 2048;
/// A small change of what comes into a stage that has to be tried, in units of a coefficient.
const TRIAL_STEP: f64 = 1e-4;

/// A model beside the one that is simulated.
#[derive(Clone, Debug)]
pub struct Variation {
    /// The other model.
    pub model: Model,
    /// The effect in it that differs, by its identifier.
    pub differs: String,
}

impl Variation {
    /// Whether the effect that differs is an expression of the user's own.
    #[must_use]
    pub fn is_defined_by_user(&self) -> bool {
        self.model.effects.iter().any(|instance| {
            instance.id == self.differs && instance.effect.declaration().definition.is_some()
        })
    }
}

/// What a walk has reached: samples `from..from + reading_um.len()`.
pub struct Chunk<'a> {
    /// The first sample.
    pub from: usize,
    /// What the sensor would read, um.
    pub reading_um: &'a [f64],
    /// What the sensor reads with each variation.
    pub variations_um: &'a [Vec<f64>],
    /// What one unit of each coefficient adds to the reading, a row for every sample; empty where none was
    /// asked for.
    pub by_coefficient: &'a [f64],
}

/// A signal behind a stage, in intervals of samples or of parts of them.
struct Stretch {
    values: Vec<f64>,
    fine: bool,
}

struct OwnStage<'a> {
    effect: usize,
    id: String,
    fine: bool,
    stage: Box<dyn Stage + 'a>,
}

/// Reading of the sensor from what the last stage gives: the value at the end of the interval before each
/// sample.
struct Sampled {
    last: f64,
}

impl Sampled {
    fn take(&mut self, ends: &Stretch, substeps: usize, out: &mut Vec<f64>) {
        out.clear();
        let step = if ends.fine { substeps } else { 1 };
        for value in ends.values.iter().skip(step - 1).step_by(step) {
            out.push(std::mem::replace(&mut self.last, *value));
        }
    }
}

/// What all coefficients add, behind the stage that has them.
struct CoefficientLanes<'a> {
    stage: usize,
    lanes: usize,
    walker: Box<dyn ByCoefficient>,
    behind: Vec<(bool, Passing<'a>)>,
    walker_is_fine: bool,
    last: Vec<f64>,
}

enum Passing<'a> {
    Linear(Box<dyn LinearLanes>),
    /// One stage for each coefficient, beside the chain's own.
    Tried(Vec<Box<dyn Stage + 'a>>),
}

fn stages_of<'a>(model: &Model, substeps: usize, drive: &Drive<'a>) -> Vec<OwnStage<'a>> {
    let mut out = Vec::new();
    for (effect, fine) in model.order_with_fineness(drive) {
        let instance = &model.effects[effect];
        let setting = model.setting(drive, if fine { substeps } else { 1 });
        if let Some(stage) = instance.stage(model, &setting) {
            out.push(OwnStage {
                effect,
                id: instance.id.clone(),
                fine,
                stage,
            });
        }
    }
    out
}

/// A variation with the stages that it does not share.
struct Beside<'a> {
    from: usize,
    /// A costly part of its first stage is the same as in the chain.
    shares: bool,
    stages: Vec<OwnStage<'a>>,
    sampled: Sampled,
}

/// The coefficients that [`walk`] perturbs, in the order of its results: effect and place among its
/// parameters.
#[must_use]
pub fn coefficients(model: &Model) -> Vec<(String, usize)> {
    let drive = Drive::held(&[], 1.0, InitialState::Unknown);
    let setting = model.setting(&drive, 1);
    let walker = model
        .effects
        .iter()
        .find_map(|e| e.by_coefficient(model, &setting));
    walker.map_or_else(Vec::new, |w| {
        w.coefficients()
            .into_iter()
            .map(|(id, parameter)| (id.to_owned(), parameter))
            .collect()
    })
}

/// How a walk is done.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Manner {
    /// What each coefficient adds is given too.
    pub with_coefficients: bool,
    /// Variations that move inside a sampling period go in the intervals of the model itself: where their
    /// shape is enough.
    pub as_coarse_as_the_model: bool,
}

/// Walks a model and its variations along a record; `see` is shown every chunk.
pub fn walk(
    model: &Model,
    drive: &Drive,
    variations: &[Variation],
    manner: Manner,
    see: &mut dyn FnMut(&Chunk),
) {
    let substeps = model.substeps_for(drive);
    let mut stages = stages_of(model, substeps, drive);
    let resting = model.resting_drive_v(drive);
    // Variations that need another resolution walk alone.
    let as_fine =
        |v: &Variation| manner.as_coarse_as_the_model || v.model.substeps_for(drive) == substeps;
    let shares = |v: &Variation| as_fine(v) && v.model.resting_drive_v(drive) == resting;
    let alone: Vec<Option<Vec<f64>>> = variations
        .iter()
        .map(|v| (!shares(v)).then(|| v.model.simulate(drive)))
        .collect();
    let mut beside: Vec<Option<Beside>> = variations
        .iter()
        .zip(&alone)
        .map(|(v, alone)| {
            alone
                .is_none()
                .then(|| beside_of(v, &mut stages, substeps, drive))
        })
        .collect();
    for b in beside.iter().flatten().filter(|b| b.shares) {
        if let Some(part) = stages[b.from].stage.shared() {
            part.keep();
        }
    }

    // At rest before the first interval.
    let mut at_rest = vec![resting];
    for own in &mut stages {
        let before = at_rest[at_rest.len() - 1];
        at_rest.push(own.stage.settle(before));
    }
    for b in beside.iter_mut().flatten() {
        let mut value = at_rest[b.from];
        for own in &mut b.stages {
            value = own.stage.settle(value);
        }
        b.sampled.last = value;
    }
    let mut lanes = if manner.with_coefficients {
        lanes_of(model, substeps, drive, &stages, &at_rest)
    } else {
        None
    };
    let mut sampled = Sampled {
        last: at_rest[at_rest.len() - 1],
    };

    let (mut reading, mut block) = (Vec::new(), Vec::new());
    let mut outputs: Vec<Vec<f64>> = vec![Vec::new(); variations.len()];
    let wanted_at: Vec<bool> = (0..=stages.len())
        .map(|i| beside.iter().flatten().any(|b| b.from == i))
        .collect();
    let n = drive.drive_v.len();
    let (input, fine) = drive.over_intervals(substeps);
    let parts = if fine { substeps } else { 1 };
    for from in (0..n).step_by(CHUNK) {
        let to = (from + CHUNK).min(n);
        let mut signal = Stretch {
            values: input[from * parts..to * parts].to_vec(),
            fine,
        };
        let mut kept: Vec<Option<Stretch>> = Vec::with_capacity(stages.len() + 1);
        let lane_stage = lanes.as_ref().map(|l| l.stage);
        let tried_behind = lanes
            .as_ref()
            .is_some_and(|l| l.behind.iter().any(|(_, p)| matches!(p, Passing::Tried(_))));
        for i in 0..=stages.len() {
            let needed =
                wanted_at[i] || lane_stage.is_some_and(|at| i == at || (tried_behind && i > at));
            kept.push(needed.then(|| Stretch {
                values: signal.values.clone(),
                fine: signal.fine,
            }));
            if let Some(own) = stages.get_mut(i) {
                pass(own, &mut signal, substeps, from);
            }
        }
        sampled.take(&signal, substeps, &mut reading);
        for ((b, alone), out) in beside.iter_mut().zip(&alone).zip(&mut outputs) {
            match (b, alone) {
                (Some(b), _) => {
                    let Some(input) = &kept[b.from] else { continue };
                    let mut signal = Stretch {
                        values: input.values.clone(),
                        fine: input.fine,
                    };
                    let shared = if b.shares {
                        stages[b.from].stage.shared()
                    } else {
                        None
                    };
                    for (i, own) in b.stages.iter_mut().enumerate() {
                        let shared = shared.as_deref().filter(|_| i == 0).map(SharedPart::kept);
                        pass_sharing(own, &mut signal, substeps, from, shared);
                    }
                    b.sampled.take(&signal, substeps, out);
                }
                (None, Some(whole)) => {
                    out.clear();
                    out.extend_from_slice(&whole[from..to]);
                }
                (None, None) => {}
            }
        }
        if let Some(lanes) = &mut lanes {
            lanes.run(&kept, substeps, from, &mut block);
        }
        see(&Chunk {
            from,
            reading_um: &reading,
            variations_um: &outputs,
            by_coefficient: &block,
        });
    }
}

fn pass(own: &mut OwnStage, signal: &mut Stretch, substeps: usize, from: usize) {
    pass_sharing(own, signal, substeps, from, None);
}

fn pass_sharing(
    own: &mut OwnStage,
    signal: &mut Stretch,
    substeps: usize,
    from: usize,
    shared: Option<&[f64]>,
) {
    if own.fine && !signal.fine {
        signal.values = signal
            .values
            .iter()
            .flat_map(|value| std::iter::repeat_n(*value, substeps))
            .collect();
        signal.fine = true;
    } else if !own.fine && signal.fine {
        signal.values = ends(&signal.values, substeps);
        signal.fine = false;
    }
    let from = if signal.fine { from * substeps } else { from };
    match (shared, own.stage.shared()) {
        (Some(given), Some(part)) => part.run_with(&mut signal.values, given),
        _ => own.stage.run(from, &mut signal.values),
    }
}

/// The stages that a variation has of its own: from the first that may differ.
fn beside_of<'a>(
    variation: &Variation,
    stages: &mut [OwnStage],
    substeps: usize,
    drive: &Drive<'a>,
) -> Beside<'a> {
    let model = &variation.model;
    let mut own = stages_of(model, substeps, drive);
    let declaration = model
        .effect(&variation.differs)
        .map(|e| e.effect.declaration());
    let taken_in_by = declaration.as_ref().and_then(|d| d.modifies);
    let acts_in =
        |s: &OwnStage| s.id == variation.differs || taken_in_by.is_some_and(|id| s.id == id);
    let behind = |s: &OwnStage| {
        declaration
            .as_ref()
            .is_some_and(|d| model.effects[s.effect].effect.declaration().place >= d.place)
    };
    let differs = own
        .iter()
        .position(acts_in)
        .or_else(|| own.iter().position(behind))
        .unwrap_or(own.len());
    let alike = own
        .iter()
        .zip(stages.iter())
        .take_while(|(a, b)| a.id == b.id && a.fine == b.fine)
        .count();
    let from = differs.min(alike);
    own.drain(..from);
    let made_by = |of: Option<&mut OwnStage>| of?.stage.shared().map(|part| part.made_by());
    let values = made_by(own.first_mut());
    let shares = values.is_some() && values == made_by(stages.get_mut(from));
    Beside {
        from,
        shares,
        stages: own,
        sampled: Sampled { last: 0.0 },
    }
}

fn lanes_of<'a>(
    model: &Model,
    substeps: usize,
    drive: &Drive<'a>,
    stages: &[OwnStage<'a>],
    at_rest: &[f64],
) -> Option<CoefficientLanes<'a>> {
    let without_signals = Drive {
        drive_v: &[],
        force_n: None,
        auxiliary: &[],
        ..*drive
    };
    let walker_of = |own: &OwnStage| {
        let setting = model.setting(&without_signals, if own.fine { substeps } else { 1 });
        model.effects[own.effect].by_coefficient(model, &setting)
    };
    let (stage, mut walker) = stages
        .iter()
        .enumerate()
        .find_map(|(i, own)| Some((i, walker_of(own)?)))?;
    let lanes = walker.coefficients().len();
    let mut row = vec![0.0; lanes];
    walker.settle(at_rest[stage], &mut row);
    let mut behind = Vec::new();
    for (i, own) in stages.iter().enumerate().skip(stage + 1) {
        let passing = match own.stage.linear_lanes(lanes) {
            Some(mut linear) => {
                linear.settle(&mut row);
                Passing::Linear(linear)
            }
            None => {
                let instance = &model.effects[own.effect];
                let setting = model.setting(drive, if own.fine { substeps } else { 1 });
                let mut tried = Vec::new();
                for value in &mut row {
                    let mut one = instance.stage(model, &setting)?;
                    *value = (one.settle(at_rest[i] + TRIAL_STEP * *value) - at_rest[i + 1])
                        / TRIAL_STEP;
                    tried.push(one);
                }
                Passing::Tried(tried)
            }
        };
        behind.push((own.fine, passing));
    }
    Some(CoefficientLanes {
        stage,
        lanes,
        walker,
        behind,
        walker_is_fine: stages[stage].fine,
        last: row,
    })
}

impl CoefficientLanes<'_> {
    /// Fills the block of a chunk, a row for every sample.
    fn run(&mut self, kept: &[Option<Stretch>], substeps: usize, from: usize, out: &mut Vec<f64>) {
        out.clear();
        let (lanes, Some(input)) = (self.lanes, &kept[self.stage]) else {
            return;
        };
        let mut inputs = input.values.clone();
        if self.walker_is_fine && !input.fine {
            inputs = inputs
                .iter()
                .flat_map(|value| std::iter::repeat_n(*value, substeps))
                .collect();
        }
        let mut fine = self.walker_is_fine;
        let mut block = vec![0.0; inputs.len() * lanes];
        self.walker.run(&inputs, &mut block);
        for (k, (is_fine, passing)) in self.behind.iter_mut().enumerate() {
            if *is_fine && !fine {
                block = block
                    .chunks_exact(lanes)
                    .flat_map(|row| std::iter::repeat_n(row, substeps))
                    .flatten()
                    .copied()
                    .collect();
                fine = true;
            } else if !*is_fine && fine {
                block = block
                    .chunks_exact(lanes)
                    .skip(substeps - 1)
                    .step_by(substeps)
                    .flatten()
                    .copied()
                    .collect();
                fine = false;
            }
            match passing {
                Passing::Linear(linear) => linear.run(&mut block),
                Passing::Tried(stages) => {
                    let at = self.stage + 1 + k;
                    if let (Some(before), Some(behind)) = (&kept[at], &kept[at + 1]) {
                        try_each(
                            stages,
                            before,
                            behind,
                            if fine { from * substeps } else { from },
                            if fine { substeps } else { 1 },
                            &mut block,
                        );
                    }
                }
            }
        }
        let step = if fine { substeps } else { 1 };
        for row in block.chunks_exact(lanes).skip(step - 1).step_by(step) {
            out.extend_from_slice(&self.last);
            self.last.copy_from_slice(row);
        }
    }
}

/// Passes every signal through a stage of its own, on top of what comes into the chain's.
fn try_each(
    stages: &mut [Box<dyn Stage + '_>],
    before: &Stretch,
    behind: &Stretch,
    from: usize,
    parts: usize,
    block: &mut [f64],
) {
    let lanes = stages.len();
    let rows = block.len() / lanes.max(1);
    // What was kept in front may be coarser than the stage, or finer.
    let input = |k: usize| match before.values.len() / rows.max(1) {
        0 => before.values[k / parts],
        finer => before.values[k * finer + finer - 1],
    };
    for (lane, stage) in stages.iter_mut().enumerate() {
        for k in 0..rows {
            let value = &mut block[k * lanes + lane];
            *value = (stage.step(from + k, input(k) + TRIAL_STEP * *value) - behind.values[k])
                / TRIAL_STEP;
        }
    }
}
