//! What fits and scores simulate, counted in steps of a stage of a chain. A budget in steps ends a search at
//! the same place on every machine, whatever else runs there.

use crate::dataset::Record;
use hysteron_sim::chain::{EffectInstance, Model};
use hysteron_sim::effect::force_balance::pieces_followed;
use hysteron_sim::effect::{Effect, Place};
use hysteron_sim::variations::Variation;
use std::fmt::Write as _;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};

/// What a diagnosis is at.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stage {
    /// Fits the start and checks the recording by it.
    Start,
    /// Extends models.
    Search,
    /// Begins values again.
    BeginningAgain,
    /// Tries single moves around the simplest models.
    Closure,
    /// Searches once more without each effect that would be named.
    Ablation,
    /// Evidence, the last fit, the path and the checks behind it.
    Report,
}

impl Stage {
    /// All, in the order in which they come.
    pub const ALL: [Self; 6] = [
        Self::Start,
        Self::Search,
        Self::BeginningAgain,
        Self::Closure,
        Self::Ablation,
        Self::Report,
    ];

    /// Its name in tables.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Start => "start",
            Self::Search => "search",
            Self::BeginningAgain => "beginning again",
            Self::Closure => "closure",
            Self::Ablation => "ablation",
            Self::Report => "report",
        }
    }
}

/// What is simulated for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Purpose {
    /// Fits and errors on the samples of a search.
    #[default]
    Fit,
    /// Scores of candidates.
    Score,
    /// Fits and errors on all samples.
    Whole,
}

/// All, with their names in tables.
pub const PURPOSES: [(Purpose, &str); 3] = [
    (Purpose::Fit, "fits"),
    (Purpose::Score, "scores"),
    (Purpose::Whole, "whole"),
];

#[derive(Debug, Default)]
struct Counts {
    stage: AtomicUsize,
    steps: [[AtomicU64; PURPOSES.len()]; Stage::ALL.len()],
}

/// The steps of a diagnosis; clones count together.
#[derive(Clone, Debug, Default)]
pub struct Work {
    counts: Arc<Counts>,
    purpose: Purpose,
}

impl Work {
    /// The same count, of what is simulated for something else.
    #[must_use]
    pub fn of(&self, purpose: Purpose) -> Self {
        Self {
            purpose,
            ..self.clone()
        }
    }

    /// From now on steps are of this stage.
    pub fn enter(&self, stage: Stage) {
        self.counts.stage.store(stage as usize, Ordering::Relaxed);
    }

    /// The stage that it is at.
    #[must_use]
    pub fn stage(&self) -> Stage {
        Stage::ALL[self.counts.stage.load(Ordering::Relaxed)]
    }

    fn add(&self, steps: u64) {
        self.counts.steps[self.stage() as usize][self.purpose as usize]
            .fetch_add(steps, Ordering::Relaxed);
    }

    /// A simulation of a model along records.
    pub fn simulated<'r>(&self, model: &Model, records: impl IntoIterator<Item = &'r Record>) {
        let steps = |record: &Record| weight_from(model, None) * samples(model, record);
        self.add(records.into_iter().map(steps).sum());
    }

    /// Variations of a model along a record, each from the first stage that differs.
    pub fn varied(&self, variations: &[Variation], record: &Record) {
        let steps = variations.iter().map(|v| {
            let place = v.model.effect(&v.differs).map(|e| acts_at(&v.model, e));
            weight_from(&v.model, place) * samples(&v.model, record)
        });
        self.add(steps.sum());
    }

    /// What each of so many coefficients adds to the reading of a model along a record.
    pub fn by_coefficient(&self, model: &Model, record: &Record, coefficients: usize) {
        self.add(coefficients as u64 * samples(model, record));
    }

    /// Adds what was counted elsewhere, stage by stage.
    pub fn take_in(&self, other: &Self) {
        for (own, others) in self.counts.steps.iter().zip(&other.counts.steps) {
            for (own, others) in own.iter().zip(others) {
                own.fetch_add(others.load(Ordering::Relaxed), Ordering::Relaxed);
            }
        }
    }

    /// Simulates, and counts the pieces in which forces on the mass were followed.
    pub fn counting_forces<R>(&self, simulate: impl FnOnce() -> R) -> R {
        let before = pieces_followed();
        let out = simulate();
        self.add(STEPS_OF_A_PIECE * pieces_followed().wrapping_sub(before));
        out
    }

    /// Steps so far.
    #[must_use]
    pub fn steps(&self) -> u64 {
        Stage::ALL
            .iter()
            .map(|stage| self.of_stage(*stage).iter().sum::<u64>())
            .sum()
    }

    /// Steps of a stage so far: for fits, for scores, and on all samples.
    #[must_use]
    pub fn of_stage(&self, stage: Stage) -> [u64; PURPOSES.len()] {
        let steps = &self.counts.steps[stage as usize];
        std::array::from_fn(|i| steps[i].load(Ordering::Relaxed))
    }

    /// The steps by stage and purpose, in millions, as a table.
    #[must_use]
    pub fn table(&self) -> String {
        let mut out = format!("{:<16}", "million steps");
        for (_, name) in PURPOSES {
            let _ = write!(out, "{name:>10}");
        }
        for stage in Stage::ALL {
            let _ = write!(out, "\n{:<16}", stage.name());
            for steps in self.of_stage(stage) {
                let _ = write!(out, "{:>10.1}", steps as f64 * 1e-6);
            }
        }
        out
    }
}

/// Steps of a record's length in the intervals of a model.
fn samples(model: &Model, record: &Record) -> u64 {
    let drive = record.drive();
    (model.substeps_for(&drive) * drive.drive_v.len()) as u64
}

fn place_of(effect: &dyn Effect) -> Place {
    effect.declaration().place
}

/// Where an effect acts in a model: another stage may take it in.
fn acts_at(model: &Model, effect: &EffectInstance) -> Place {
    let taken_in_by = effect.effect.declaration().modifies;
    let stage = taken_in_by.and_then(|id| model.effect(id));
    place_of(&*stage.unwrap_or(effect).effect)
}

/// Friction that holds the mass back is balanced in several trials of each interval, which take so many times
/// as long as a step of another stage (`perf report` of `hysteron explain examples/hidden_effect`).
const BALANCED: u64 = 5;
/// A piece in which other forces on the mass are followed takes 58 to 147 ns, and a step 5
/// (`benchmarks/results/speed.csv`).
const STEPS_OF_A_PIECE: u64 = 16;
/// Parameters that a stage takes in a step: a stage of many is one of many plays, terms or coefficients.
const PARAMETERS_IN_A_STEP: u64 = 4;

/// What a step of the stages from a place on weighs; without a place, of all.
fn weight_from(model: &Model, place: Option<Place>) -> u64 {
    let weight = |e: &EffectInstance| match (place_of(&*e.effect), place) {
        // The stage of the mode takes it in.
        (Place::Friction, Some(from)) if from > Place::Vibration => 0,
        (at, Some(from)) if at < from && at != Place::Friction => 0,
        (at, _) => {
            let by_place = || match at {
                Place::Friction => BALANCED,
                _ => (e.parameters.len() as u64).div_ceil(PARAMETERS_IN_A_STEP),
            };
            e.effect.declaration().lasts_steps.unwrap_or_else(by_place)
        }
    };
    model.effects.iter().map(weight).sum::<u64>().max(1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model_file::effects_named;
    use hysteron_sim::effect::Overview;

    #[test]
    fn a_variation_counts_from_where_it_differs() {
        let mut model = Model::new(0.0, 1.0);
        let overview = Overview::without_data(0.0, 1.0);
        for effect in effects_named("gain,vibration,sensor_bandwidth").unwrap() {
            model.add(EffectInstance::new(effect, &overview, &[]));
        }
        let record = Record::new("r", 1e5, vec![0.0; 100], vec![0.0; 100]);
        let steps = |differs: Option<&str>| {
            let work = Work::default();
            match differs {
                None => work.simulated(&model, [&record]),
                Some(id) => work.varied(
                    &[Variation {
                        model: model.clone(),
                        differs: id.to_owned(),
                    }],
                    &record,
                ),
            }
            work.steps()
        };
        let [whole, mode, sensor] = [None, Some("vibration"), Some("sensor_bandwidth")].map(steps);
        assert_eq!(steps(Some("gain")), whole);
        // The mode takes the sensor's lag in.
        assert_eq!([3 * mode, 3 * sensor], [2 * whole, 2 * whole]);
    }
}
