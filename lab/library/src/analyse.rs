//! The main job, the only orchestration: quality, noise, search, closure, ablation, selection, post-checks,
//! outcome.
//! Every front end calls [`analyse`].

mod growth;
mod growth_of_a_prior_model;

use crate::dataset::Dataset;
use crate::dataset::issue::{Issue, Severity};
use crate::diagnosis::findings::Weighed;
use crate::diagnosis::judgement::{Judged, Split, require_finite, require_signals};
use crate::diagnosis::next_experiment::{Limits, Proposal, propose};
use crate::diagnosis::path::{ModelChange, PathStep};
use crate::diagnosis::policy::Policy;
use crate::diagnosis::pool::Pool;
use crate::diagnosis::reporting::{self, Found};
use crate::diagnosis::searched_data::for_evidence;
use crate::diagnosis::selection::least_difference_um;
use crate::diagnosis::study::Study;
use crate::diagnosis::words;
use crate::error::Result;
use crate::figures::{FitFigures, fit_figures, step_figures};
use crate::identification::budget::SEARCH_ENDS_AT;
use crate::identification::finer_hysteresis::structure_beside_a_gain;
use crate::identification::fit::{Effort, fit_rows};
use crate::identification::identifiability::{CannotIdentify, identifiability};
use crate::identification::linearisation::Rows;
use crate::identification::noise_floor::{NoiseFloor, noise_floor};
use crate::identification::work::Work;
use crate::identify::require_chain;
use crate::origin::{note_origin, read_as_recorded};
use crate::outcome::{Diagnosis, Verdict};
use crate::phrases;
use crate::quality::{self, End, Moment};
use crate::watch::{Watch, WatchEvent};
use growth::{Grown, at, grow};
use growth_of_a_prior_model::grow_from_prior;
use hysteron_sim::chain::{EffectInstance, Model};
use hysteron_sim::effect::quantisation::{self, Quantisation};
use hysteron_sim::effect::{Effect, Overview, registry};
use std::sync::Arc;

/// Everything that one run of the main job found.
pub struct Outcome {
    /// The final model with standard deviations.
    pub model: Model,
    /// The way to it; the first step is the start, the last the final model.
    pub steps: Vec<PathStep>,
    /// What the simplest models that the data cannot reject have beside the start, with its evidence.
    pub weighed: Vec<Weighed>,
    /// The noise.
    pub floor: NoiseFloor,
    /// The verdict on the starting model.
    pub diagnosis: Diagnosis,
    /// What the data cannot tell.
    pub cannot_identify: Vec<CannotIdentify>,
    /// Records that are fitted and judge.
    pub split: Split,
    /// The drive that would distinguish the first two of an ambiguous set.
    pub next_experiment: Option<NextExperiment>,
    /// The data set that all of this is of, where a quality check corrected the one that was given.
    pub corrected: Option<Dataset>,
    /// The caller wanted the best so far.
    pub stopped: bool,
    /// What was simulated.
    pub work: Work,
}

/// A drive to run next.
pub struct NextExperiment {
    /// The effects that it distinguishes.
    pub between: [String; 2],
    /// The drive.
    pub proposal: Proposal,
    /// What it decides and how well.
    pub sentence: String,
}

/// All built-in candidates and the user's own.
#[must_use]
pub fn candidates(own: &[Arc<dyn Effect>]) -> Vec<Arc<dyn Effect>> {
    let mut all: Vec<Arc<dyn Effect>> = registry()
        .into_iter()
        .filter(|e| e.declaration().candidate)
        .collect();
    all.extend(own.iter().cloned());
    all
}

/// Where a run starts.
#[derive(Clone)]
pub enum Start<'a> {
    /// From these effects, fitted first.
    Effects(&'a [Arc<dyn Effect>]),
    /// From a model as it is.
    Model(Model),
}

/// What is asked of a run beside the data.
#[derive(Clone, Default)]
pub struct Options {
    /// Effects of the user's own that take part.
    pub own: Vec<Arc<dyn Effect>>,
    /// Thresholds.
    pub policy: Policy,
}

/// A search that begins again has this share of the steps at least, whatever the one before took.
const LEFT_AT_LEAST: f64 = 0.5;

impl Options {
    /// For one more search, behind others that took so many steps.
    fn with_what_is_left(&self, steps: u64) -> Self {
        let mut out = self.clone();
        let most = self.policy.most_steps;
        out.policy.most_steps = (most - steps as f64).max(LEFT_AT_LEAST * most);
        out
    }
}

/// Runs the main job; once more on a corrected data set where a quality check asks for that.
///
/// # Errors
/// Where the effects to start from make no chain ([`require_chain`]); where a model or a candidate gives
/// something that is no number: with effect, record and sample.
pub fn analyse(
    dataset: &Dataset,
    start: Start,
    options: &Options,
    watch: &dyn Watch,
) -> Result<Outcome> {
    if let Start::Effects(effects) = &start {
        require_chain(effects, dataset)?;
    }
    require_signals(&options.own, dataset)?;
    let as_recorded = match &start {
        Start::Model(model) => read_as_recorded(model, dataset),
        Start::Effects(_) => None,
    };
    let dataset = as_recorded.as_ref().unwrap_or(dataset);
    let found = once(dataset, start.clone(), options, watch)?;
    let Some(corrected) = found
        .retry
        .filter(|_| !found.outcome.stopped && watch.time_used() < SEARCH_ENDS_AT)
    else {
        return Ok(Outcome {
            corrected: as_recorded,
            ..found.outcome
        });
    };
    watch.event(&WatchEvent::Doing("once more, on the corrected data set"));
    let spent = found.outcome.work;
    let options = options.with_what_is_left(spent.steps());
    let again = once(&corrected, start, &options, watch)?.outcome;
    again.work.take_in(&spent);
    Ok(Outcome {
        corrected: Some(corrected),
        ..again
    })
}

/// One run, and the data set on which to run again.
struct Once {
    outcome: Outcome,
    retry: Option<Dataset>,
}

fn once(dataset: &Dataset, start: Start, options: &Options, watch: &dyn Watch) -> Result<Once> {
    match for_evidence(dataset, options.policy.weighed_samples) {
        Some(beginnings) => to_the_whole(
            dataset,
            &beginnings,
            decided(&beginnings, start, options, watch)?,
            watch,
        ),
        None => decided(dataset, start, options, watch),
    }
}

/// What was decided on the beginnings of long records, with the model fitted to the whole of them.
fn to_the_whole(
    dataset: &Dataset,
    beginnings: &Dataset,
    mut found: Once,
    watch: &dyn Watch,
) -> Result<Once> {
    let outcome = &mut found.outcome;
    let samples = |data: &Dataset| -> usize {
        outcome
            .split
            .both()
            .iter()
            .map(|i| data.records[*i].window.len())
            .sum()
    };
    outcome.floor.warnings.push(format!(
        "long records: decided on the first {:.1} % of each, {} of {} samples; the last model is fitted to the whole, and its errors by record are of that",
        100.0 * samples(beginnings) as f64 / samples(dataset) as f64,
        samples(beginnings),
        samples(dataset)
    ));
    if !outcome.stopped {
        watch.event(&WatchEvent::Doing("fitting the whole of long records"));
        let rows = Rows::thinned(dataset, &outcome.split.identify, WHOLE_SAMPLES);
        let fitted = fit_rows(&outcome.model, dataset, &rows, WHOLE).model;
        require_finite(&fitted, dataset, &outcome.split.both())?;
        outcome.model = fitted;
        note_origin(&mut outcome.model, dataset, &outcome.split.identify);
    }
    found.retry = found
        .retry
        .and_then(|_| quality::corrected(dataset, &found.outcome.diagnosis.issues));
    Ok(found)
}

/// Rows of the fit to the whole of long records, and how far it goes: it begins where their beginnings end.
const WHOLE_SAMPLES: usize = 100_000;
const WHOLE: Effort = Effort {
    iterations: 4,
    tolerance: 0.2,
    relative: 1e-3,
    looks_again: false,
};

/// Everything that is decided on a data set.
fn decided(dataset: &Dataset, start: Start, options: &Options, watch: &dyn Watch) -> Result<Once> {
    let mut issues = dataset.issues.clone();
    issues.extend(quality::issues(dataset, Moment::BeforeSearch));
    let blocked = issues
        .iter()
        .any(|issue| issue.severity == Severity::Blocks);
    let BesideItsNoise {
        mut grown,
        mut floor,
        study,
        spent,
    } = if blocked {
        let floor = noise_floor(dataset);
        let study = study_of(dataset, options, &floor, watch);
        BesideItsNoise {
            grown: unfitted(&start, &study),
            floor,
            study,
            spent: Work::default(),
        }
    } else {
        grown_beside_its_noise(dataset, &start, options, watch)?
    };
    grown.stopped |= watch.stopped();
    if grown.ended_early {
        floor.warnings.push(format!(
            "the search ended before it found nothing more. {}",
            words::to_go_on(&study.budget)
        ));
    }
    let quantised = quantise(&mut grown.steps, &floor, &study.overview);
    let mut retry = None;
    if !blocked && !grown.stopped {
        let after = issues_at_the_end(&mut grown, &floor, &study);
        retry = quality::corrected(dataset, &after);
        issues.extend(after);
        issues.sort_by_key(|issue| issue.severity != Severity::Blocks);
    }
    let last = grown.steps[grown.steps.len() - 1].judged.clone();
    let mut model = last.model.clone();
    let mut cannot_identify = Vec::new();
    if !blocked {
        watch.event(&WatchEvent::Doing("estimating standard deviations"));
        cannot_identify = identifiability(&mut model, dataset, &study.split.identify);
        require_finite(&model, dataset, &study.split.both())?;
        let unseen = words::unseen(&model, dataset, last.error_um());
        floor.warnings.splice(0..0, unseen);
    }
    let (unfixed, names): (Vec<Weighed>, Vec<Weighed>) =
        grown.weighed.into_iter().partition(|weighed| {
            weighed.has_open_values(&cannot_identify) || weighed.is_ruled_out_in(&last.model)
        });
    let values_open = grown.open.is_empty();
    grown.weighed = names;
    grown.named_less(&unfixed, &last, &study);
    grown.open.extend(unfixed);
    let next = next_experiment(&grown, dataset, floor.rms_um);
    let left_um = grown.simplest.first().map_or(0.0, |e| e.judged.error_um());
    let least_um = least_difference_um(&study, left_um);
    let decides = |best: &NextExperiment| best.proposal.decides(floor.rms_um, least_um);
    let found = Found {
        first: &grown.steps[0].judged,
        last: &last,
        named: grown.named.as_ref().unwrap_or(&last),
        weighed: &grown.weighed,
        open: &grown.open,
        values_open,
        models: &grown.models,
        simplest: &grown.simplest,
        changed: &grown.changed,
        tried: &grown.tried,
        beside_start: grown.beside_start.as_ref(),
        quantised: quantised.as_deref(),
        loops: &grown.loops,
        issues,
        stopped: grown.stopped,
        out_of_time: grown.out_of_time,
        in_vain: next
            .as_ref()
            .filter(|best| !decides(best))
            .map(|best| (&best.between, best.proposal.separation_um)),
    };
    let diagnosis = reporting::diagnosis(found, &floor, &study);
    let asks = diagnosis.verdict == Verdict::Ambiguous || !grown.open.is_empty();
    let next_experiment = next.filter(|best| asks && decides(best));
    let (split, work) = (study.split.clone(), study.budget.work.clone());
    drop(study);
    work.take_in(&spent);
    let Grown {
        steps: path,
        weighed,
        stopped,
        ..
    } = grown;
    let outcome = Outcome {
        model,
        steps: path,
        weighed,
        floor,
        diagnosis,
        cannot_identify,
        split,
        next_experiment,
        corrected: None,
        stopped,
        work,
    };
    Ok(Once { outcome, retry })
}

/// What a search came to, with the noise and the study that it is of, and what the searches before took.
struct BesideItsNoise<'a> {
    grown: Grown,
    floor: NoiseFloor,
    study: Study<'a>,
    spent: Work,
}

/// A search, and again where the noise beside its model is another than the one that it looked for.
fn grown_beside_its_noise<'a>(
    dataset: &'a Dataset,
    start: &Start,
    options: &Options,
    watch: &'a dyn Watch,
) -> Result<BesideItsNoise<'a>> {
    let (mut floor, spent) = (noise_floor(dataset), Work::default());
    let mut study = study_of(dataset, options, &floor, watch);
    let mut grown = grown_from(start, &study)?;
    for _ in 1..FLOORS_MAX {
        let beside = floor_of(&grown, &floor, &study);
        let Some(beside) = beside.filter(|_| !grown.stopped && !grown.ended_early) else {
            break;
        };
        let another = differ(floor.rms_um, beside.rms_um) && is_near(&grown, &study, &beside);
        floor = beside;
        spent.take_in(&study.budget.work);
        study = study_of(
            dataset,
            &options.with_what_is_left(spent.steps()),
            &floor,
            watch,
        );
        if !another {
            break;
        }
        watch.event(&WatchEvent::Doing(
            "searching again beside what the drive's own noise makes",
        ));
        grown = grown_from(start, &study)?;
    }
    Ok(BesideItsNoise {
        grown,
        floor,
        study,
        spent,
    })
}

/// What the quality checks say of the model at the end, or said where a search did not begin.
fn issues_at_the_end(grown: &mut Grown, floor: &NoiseFloor, study: &Study) -> Vec<Issue> {
    if !grown.issues.is_empty() {
        return std::mem::take(&mut grown.issues);
    }
    let first = &grown.steps[0].judged;
    let last = &grown.steps[grown.steps.len() - 1].judged;
    let mut added = last.model.effect_ids();
    added.retain(|id| first.model.effect(id).is_none());
    let end = End {
        study,
        noise: floor,
        first,
        last,
        added: &added,
    };
    quality::issues(study.dataset, Moment::End(&end))
}

/// How often a search is begun with another floor: the noise of a drive's column makes something else of
/// every model, and the next to nothing of it changes from the second to the third.
const FLOORS_MAX: usize = 3;
/// Floors that differ by more than this share let a search end elsewhere.
const ANOTHER_FLOOR: f64 = 0.1;

/// A model of the search comes near one of two floors: far above both they are the same to it.
fn is_near(grown: &Grown, study: &Study, beside: &NoiseFloor) -> bool {
    let last = &grown.steps[grown.steps.len() - 1].judged;
    let near = |floors_um: &[Option<f64>]| {
        last.within(study.policy.near_the_noise, floors_um, &study.split)
    };
    near(&study.floors_um) || near(&beside.of_records_um)
}

fn differ(one_um: Option<f64>, other_um: Option<f64>) -> bool {
    one_um.zip(other_um).is_none_or(|(one_um, other_um)| {
        (one_um - other_um).abs() > ANOTHER_FLOOR * one_um.min(other_um)
    })
}

/// The noise beside the first model on the way that leaves no more than it, or else beside the last: a model
/// that smooths more passes less of the noise in the drive's column on, and is not better for that.
fn floor_of(grown: &Grown, floor: &NoiseFloor, study: &Study) -> Option<NoiseFloor> {
    floor.read_back?;
    let beside =
        |judged: &Judged| judged.floor_beside(floor, study.policy.explained, study.dataset);
    let leaves_nothing = |judged: &Judged| {
        beside(judged).filter(|beside| {
            judged.within(study.as_the_noise(), &beside.of_records_um, &study.split)
        })
    };
    let (last, before) = grown.steps.split_last()?;
    before
        .iter()
        .find_map(|step| leaves_nothing(&step.judged))
        .or_else(|| beside(&last.judged))
}

fn study_of<'a>(
    dataset: &'a Dataset,
    options: &Options,
    floor: &NoiseFloor,
    watch: &'a dyn Watch,
) -> Study<'a> {
    Study::new(
        dataset,
        candidates(&options.own),
        floor,
        options.policy.clone(),
        watch,
    )
}

/// The start as it is: nothing is fitted to what a quality check blocks.
fn unfitted(start: &Start, study: &Study) -> Grown {
    let model = match start {
        Start::Model(model) => model.clone(),
        Start::Effects(effects) => {
            let mut model = Model::new(study.dataset.drive_min_v, study.dataset.drive_max_v);
            effects.iter().for_each(|effect| {
                model.add(EffectInstance::new(effect.clone(), &study.overview, &[]))
            });
            note_origin(&mut model, study.dataset, &study.split.identify);
            model
        }
    };
    at(study.judged(model))
}

/// What a search comes to from a start.
///
/// # Errors
/// A candidate, or the start, that gives something that is no number.
fn grown_from(start: &Start, study: &Study) -> Result<Grown> {
    match start {
        Start::Effects(effects) => {
            let base = study.build(effects)?;
            require_finite(&base.model, study.dataset, &study.split.both())?;
            match quality::issues(study.dataset, Moment::FirstFit(study, &base)) {
                issues if issues.is_empty() => {
                    let pool = Pool::of(study, &base.model);
                    grow(study, pool, &base, &structure_beside_a_gain(&base.model))
                }
                issues => Ok(Grown { issues, ..at(base) }),
            }
        }
        Start::Model(model) => {
            require_finite(model, study.dataset, &study.split.both())?;
            grow_from_prior(study, model.clone())
        }
    }
}

/// Adds the converter that the readings themselves show. It explains part of the noise, not of the error:
/// everything else is the same without it. Its identifier, where it was added.
fn quantise(steps: &mut Vec<PathStep>, floor: &NoiseFloor, overview: &Overview) -> Option<String> {
    let (step_um, last) = (floor.reading_step_um?, steps.last()?);
    let id = quantisation::ID.to_string();
    if last.judged.model.effect(&id).is_some() {
        return None;
    }
    let mut judged = last.judged.clone();
    judged.model.add(EffectInstance::new(
        Arc::new(Quantisation),
        overview,
        &[step_um],
    ));
    steps.push(PathStep {
        change: ModelChange::Added(id.clone()),
        judged,
    });
    Some(id)
}

/// Where the simplest models differ, the drive on which the first two differ most.
fn next_experiment(
    grown: &Grown,
    dataset: &Dataset,
    floor_um: Option<f64>,
) -> Option<NextExperiment> {
    let slot = grown
        .open
        .iter()
        .chain(&grown.weighed)
        .map(|w| w.slot.effects())
        .find(|effects| effects.len() > 1)?;
    let has = |id: &String| {
        grown
            .simplest
            .iter()
            .find(|e| e.added().contains(id))
            .map(|e| &e.judged.model)
    };
    let proposal = propose(
        has(&slot[0])?,
        has(&slot[1])?,
        &Limits::of(&dataset.overview()),
    )?;
    let sentence = proposal.sentence(
        &phrases::spoken(&slot[0]),
        &phrases::spoken(&slot[1]),
        floor_um,
    );
    Some(NextExperiment {
        between: [slot[0].clone(), slot[1].clone()],
        proposal,
        sentence,
    })
}

impl Outcome {
    /// Figures for files.
    #[must_use]
    pub fn figures(&self, dataset: &Dataset, seconds: f64) -> FitFigures {
        let dataset = self.dataset(dataset);
        let mut out = fit_figures(
            &self.model,
            dataset,
            &self.floor,
            step_figures(&self.steps),
            &self.cannot_identify,
            seconds,
        );
        out.stopped = self.stopped;
        out.diagnosis = Some(self.diagnosis.clone());
        out
    }

    /// The data set that the outcome is of: the given one, or what a quality check made of it.
    #[must_use]
    pub fn dataset<'d>(&'d self, given: &'d Dataset) -> &'d Dataset {
        self.corrected.as_ref().unwrap_or(given)
    }

    /// The model at the end, with its errors.
    #[must_use]
    pub fn last(&self) -> &Judged {
        &self.steps[self.steps.len() - 1].judged
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn another_search_has_what_is_left_and_half_at_least() {
        let options = Options::default();
        let most = options.policy.most_steps;
        let left = |steps: f64| options.with_what_is_left(steps as u64).policy.most_steps;
        assert_eq!([0.2, 0.9].map(|used| left(used * most) / most), [0.8, 0.5]);
    }
}
