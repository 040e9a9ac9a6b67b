//! The main job, the only orchestration: quality, noise, search, closure, ablation, selection, post-checks,
//! outcome.
//! Every front end calls [`analyse`].

use crate::dataset::Dataset;
use crate::dataset::issue::{Issue, Severity};
use crate::diagnosis::budget::SEARCH_ENDS_AT;
use crate::diagnosis::closure::close;
use crate::diagnosis::findings::{Fits, Weighed, names_and_open, test_slots, weigh};
use crate::diagnosis::judgement::{Judged, Split, require_finite, require_signals};
use crate::diagnosis::next_experiment::{Limits, Proposal, propose};
use crate::diagnosis::path::{self, ModelChange, PathStep};
use crate::diagnosis::policy::Policy;
use crate::diagnosis::pool::{Entry, Move, Pool};
use crate::diagnosis::prior;
use crate::diagnosis::reporting::{self, Found};
use crate::diagnosis::screening::{Screening, ScreeningEvidence};
use crate::diagnosis::search::{Search, structure, structure_beside_a_gain};
use crate::diagnosis::searched_data::for_evidence;
use crate::diagnosis::selection::{self, least_difference_um};
use crate::diagnosis::study::Study;
use crate::diagnosis::words;
use crate::error::Result;
use crate::figures::{FitFigures, fit_figures, step_figures};
use crate::identification::fit::{Effort, fit_rows};
use crate::identification::identifiability::{CannotIdentify, identifiability};
use crate::identification::linearisation::Rows;
use crate::identification::noise_floor::{NoiseFloor, noise_floor};
use crate::identification::work::{Stage, Work};
use crate::identification::{finer_creep, finer_hysteresis};
use crate::identify::require_chain;
use crate::origin::{note_origin, read_as_recorded};
use crate::outcome::{ChangedValue, Diagnosis, KeptModel, Residuals, Verdict};
use crate::parallel;
use crate::phrases;
use crate::quality::{self, End, Moment};
use crate::watch::{Watch, WatchEvent};
use hysteron_sim::chain::{EffectInstance, Model};
use hysteron_sim::effect::quantisation::{self, Quantisation};
use hysteron_sim::effect::{Effect, Overview, registry};
use std::collections::BTreeSet;
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
    let options = options.with_what_is_left(found.steps);
    let again = once(&corrected, start, &options, watch)?.outcome;
    Ok(Outcome {
        corrected: Some(corrected),
        ..again
    })
}

/// One run, and the data set on which to run again.
struct Once {
    outcome: Outcome,
    retry: Option<Dataset>,
    /// What it cost.
    steps: u64,
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

/// What a search came to, however it began.
#[derive(Default)]
struct Grown {
    steps: Vec<PathStep>,
    weighed: Vec<Weighed>,
    /// What survives its test and is no name ([`names_and_open`]).
    open: Vec<Weighed>,
    models: Vec<KeptModel>,
    /// The simplest kept models.
    simplest: Vec<Entry>,
    /// The model with the named effects alone, where it is another than the last.
    named: Option<Judged>,
    changed: Vec<ChangedValue>,
    tried: Vec<Entry>,
    beside_start: Option<Screening>,
    loops: Vec<String>,
    issues: Vec<Issue>,
    stopped: bool,
    /// The budget did not reach to find and test what would be named.
    out_of_time: bool,
    /// The search ended before it found nothing more.
    ended_early: bool,
}

/// Everything that is decided on a data set.
fn decided(dataset: &Dataset, start: Start, options: &Options, watch: &dyn Watch) -> Result<Once> {
    let mut issues = dataset.issues.clone();
    issues.extend(quality::issues(dataset, Moment::BeforeSearch));
    let mut floor = noise_floor(dataset);
    let mut steps = 0;
    let mut study = study_of(dataset, options, &floor, watch);
    let blocked = issues
        .iter()
        .any(|issue| issue.severity == Severity::Blocks);
    let mut grown = if blocked {
        unfitted(&start, &study)
    } else {
        grown_from(&start, &study)?
    };
    for _ in 1..FLOORS_MAX {
        let Some(beside) = floor_of(&grown, &floor, &study)
            .filter(|_| !blocked && !grown.stopped && !grown.ended_early)
        else {
            break;
        };
        let another = differ(floor.rms_um, beside.rms_um) && is_near(&grown, &study, &beside);
        floor = beside;
        steps += study.budget.work.steps();
        let options = options.with_what_is_left(steps);
        study = study_of(dataset, &options, &floor, watch);
        if !another {
            break;
        }
        watch.event(&WatchEvent::Doing(
            "searching again beside what the drive's own noise makes",
        ));
        grown = grown_from(&start, &study)?;
    }
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
        let (first, last) = (
            &grown.steps[0].judged,
            &grown.steps[grown.steps.len() - 1].judged,
        );
        let added: Vec<String> = last
            .model
            .effect_ids()
            .into_iter()
            .filter(|id| first.model.effect(id).is_none())
            .collect();
        let end = End {
            study: &study,
            noise: &floor,
            first,
            last,
            added: &added,
        };
        let after = if grown.issues.is_empty() {
            quality::issues(dataset, Moment::End(&end))
        } else {
            std::mem::take(&mut grown.issues)
        };
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
    let (unfixed, names): (Vec<Weighed>, Vec<Weighed>) = grown
        .weighed
        .into_iter()
        .partition(|weighed| weighed.has_open_values(&cannot_identify));
    let values_open = grown.open.is_empty();
    grown.weighed = names;
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
    steps += work.steps();
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
    Ok(Once {
        outcome,
        retry,
        steps,
    })
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
    Grown {
        steps: vec![PathStep {
            change: ModelChange::Start,
            judged: study.judged(model),
        }],
        ..Grown::default()
    }
}

fn grown_from(start: &Start, study: &Study) -> Result<Grown> {
    match start {
        Start::Effects(effects) => {
            let base = study.build(effects)?;
            require_finite(&base.model, study.dataset, &study.split.both())?;
            match quality::issues(study.dataset, Moment::FirstFit(study, &base)) {
                issues if issues.is_empty() => grow(
                    study,
                    Pool::of(study, &base.model),
                    &base,
                    &structure_beside_a_gain(&base.model),
                ),
                issues => Ok(Grown { issues, ..at(base) }),
            }
        }
        Start::Model(model) => {
            require_finite(model, study.dataset, &study.split.both())?;
            grow_from_prior(study, model.clone())
        }
    }
}

/// A start at which everything ends.
fn at(judged: Judged) -> Grown {
    Grown {
        steps: vec![PathStep {
            change: ModelChange::Start,
            judged,
        }],
        ..Grown::default()
    }
}

/// From where a pool begins to the best that the data support. `loops` is the structure of the loops that
/// were there before.
fn grow(study: &Study, pool: Pool, base: &Judged, loops: &Option<String>) -> Result<Grown> {
    let mut beside_start = None;
    let mut search = Search::over(pool);
    if study.nothing_left(base) && !study.watch.stopped() {
        // Nothing is left above the noise: only a signature that is there beyond chance is worth a search.
        let screening = study.weigh(
            &base.model,
            &study.candidates_for(&base.model),
            study.policy.seed,
        )?;
        let significant = |e: &ScreeningEvidence| e.p_adjusted <= study.policy.family_wise;
        let quiet = !screening
            .scores
            .iter()
            .any(|s| s.evidence.as_ref().is_some_and(significant));
        beside_start = Some(screening);
        if quiet {
            return Ok(Grown {
                beside_start,
                ..at(base.clone())
            });
        }
    }
    let (mut closed, mut ablated) = (BTreeSet::new(), BTreeSet::new());
    let mut minimal;
    let budget = &study.budget;
    loop {
        budget.work.enter(Stage::Search);
        search.run()?;
        if search.stopped {
            return Ok(Grown {
                stopped: true,
                beside_start,
                ..best_so_far(study, &search.pool, base)
            });
        }
        budget.work.enter(Stage::BeginningAgain);
        begin_again(&mut search.pool)?;
        let before = search.pool.rank(search.pool.best());
        minimal = ablate(&mut search, &mut closed, &mut ablated)?;
        // What came out of single moves around the simplest models, or of a search without one of their
        // effects, may lead further.
        let gained = before - search.pool.rank(search.pool.best()) > study.policy.least_gain;
        if !gained
            || search.out_of_time
            || study.met(&search.pool.best().judged)
            || closed.len() >= study.policy.closures_max
        {
            break;
        }
    }
    if study.watch.stopped() {
        return Ok(Grown {
            stopped: true,
            beside_start,
            ..best_so_far(study, &search.pool, base)
        });
    }
    let (ended_early, untested, mut pool) = (search.out_of_time, search.untested, search.pool);
    budget.work.enter(Stage::Report);
    study
        .watch
        .event(&WatchEvent::Doing("weighing the evidence for each effect"));
    let weighed = weigh(&mut pool, &mut minimal)?;
    let [weighed, open] = names_and_open(weighed, Some(&ablated), &study.policy);
    let simplest: Vec<Entry> = minimal.iter().map(|k| pool.entries[k].clone()).collect();
    study.watch.event(&WatchEvent::Doing("fitting to the end"));
    let end = selection::end(&mut pool, &minimal);
    let mut end_judged = study.judged(end.judged.model.clone());
    if study.searched_beginnings() {
        end_judged = with_creep_of_the_whole(study, end_judged);
    }
    let origin: Vec<Move> = pool.origin.clone();
    let added: Vec<String> = end
        .added()
        .into_iter()
        .filter(|id| !origin.contains(&Move::Added(id.clone())))
        .collect();
    let finer = |m: &Model| {
        (
            finer_hysteresis::description(m),
            finer_creep::description(m),
        )
    };
    let steps = if added.is_empty() && finer(&base.model) == finer(&end_judged.model) {
        vec![PathStep {
            change: ModelChange::Start,
            judged: base.clone(),
        }]
    } else {
        path::from(study, base, &added, &end_judged)?
    };
    if beside_start.is_none() && simplest.first().is_none_or(|e| e.moves == origin) {
        beside_start = Some(study.weigh(
            &base.model,
            &study.candidates_for(&base.model),
            study.policy.seed,
        )?);
    }
    let loops = other_loops(&simplest, &end_judged.model, loops);
    let named = with_the_named_alone(study, &simplest, &weighed, &end, &end_judged);
    Ok(Grown {
        steps,
        named,
        models: kept_models(&simplest),
        simplest,
        beside_start,
        loops,
        // Without a name nobody knows what a longer search would have found.
        out_of_time: (untested || ended_early) && weighed.is_empty(),
        ended_early: ended_early || untested,
        weighed,
        open,
        ..Grown::default()
    })
}

/// Closes the pool around the simplest kept models and searches once more without each effect that they would
/// name, until neither changes them: the keys of these models.
fn ablate(
    search: &mut Search,
    closed: &mut BTreeSet<String>,
    ablated: &mut BTreeSet<Vec<String>>,
) -> Result<Vec<String>> {
    let work = &search.study.budget.work;
    loop {
        work.enter(Stage::Closure);
        let minimal = close(&mut search.pool, closed)?;
        let open = test_slots(&mut search.pool, &minimal, Fits::ForComparison)
            .into_iter()
            .map(|case| case.slot.effects())
            .find(|ids| !ids.is_empty() && !ablated.contains(ids));
        let Some(ids) = open.filter(|_| !search.stopped && !search.untested) else {
            return Ok(minimal);
        };
        work.enter(Stage::Ablation);
        search
            .study
            .watch
            .event(&WatchEvent::Doing("searching without what would be named"));
        let from = search.pool.entries[&minimal[0]].clone();
        if search.run_without(&ids, &from)? {
            ablated.insert(ids);
        } else {
            search.untested = true;
        }
    }
}

/// The model with the named effects and no others, fitted to its end; none where that is the model at the end.
fn with_the_named_alone(
    study: &Study,
    simplest: &[Entry],
    weighed: &[Weighed],
    end: &Entry,
    end_judged: &Judged,
) -> Option<Judged> {
    let simplest = simplest.first()?;
    let is_named = |id: &String| weighed.iter().any(|w| w.slot.effects().contains(id));
    let denied: Vec<String> = simplest
        .added()
        .into_iter()
        .filter(|id| !is_named(id))
        .collect();
    if denied.is_empty() && simplest.moves == end.moves {
        return Some(end_judged.clone());
    }
    let less = |model: Model, id: &String| study.without(&model, id);
    let model = denied.iter().fold(simplest.judged.model.clone(), less);
    Some(study.thoroughly(&model))
}

/// The best model of a pool with each effect that has several initial guesses begun again beside the others.
fn begin_again(pool: &mut Pool) -> Result<()> {
    let (study, best) = (pool.study, pool.best().clone());
    if best.moves == pool.origin
        || study.met(&best.judged)
        || study.watch.stopped()
        || study.budget.is_over()
    {
        return Ok(());
    }
    study
        .watch
        .event(&WatchEvent::Doing("beginning values again"));
    let again = study.begun_again(&best.judged)?;
    pool.keep(Entry::new(study, best.moves, again, true));
    Ok(())
}

/// The simplest models as they are written: of those with the same moves the best.
fn kept_models(simplest: &[Entry]) -> Vec<KeptModel> {
    let mut out: Vec<KeptModel> = Vec::new();
    for entry in simplest {
        let effects: Vec<String> = entry.moves.iter().map(|m| m.effect().to_owned()).collect();
        if out.iter().all(|m| m.effects != effects) {
            out.push(KeptModel {
                effects,
                rms_um: Residuals::of(&entry.judged),
            });
        }
    }
    out
}

/// How the loops at the end are described and those of other simplest models, where they are not of the
/// structure that was there before. In the place of a gain loops are an effect that was added, and named as
/// one.
fn other_loops(simplest: &[Entry], end: &Model, before: &Option<String>) -> Vec<String> {
    let Some(before) = before else {
        return Vec::new();
    };
    if structure(end).as_ref() == Some(before) {
        return Vec::new();
    }
    let mut out = vec![finer_hysteresis::description(end)];
    for other in simplest
        .iter()
        .filter(|e| structure(&e.judged.model) != structure(end))
    {
        let description = finer_hysteresis::description(&other.judged.model);
        if !out.contains(&description) {
            out.push(description);
        }
    }
    out
}

/// Where the caller wanted the best so far.
fn best_so_far(study: &Study, pool: &Pool, base: &Judged) -> Grown {
    let best = pool.best();
    let judged = study.judged(best.judged.model.clone());
    let change = if best.added().is_empty() {
        ModelChange::FittedAgain
    } else {
        ModelChange::AddedUnweighed(best.added())
    };
    Grown {
        steps: vec![
            PathStep {
                change: ModelChange::Start,
                judged: base.clone(),
            },
            PathStep { change, judged },
        ],
        ..Grown::default()
    }
}

/// The model with its creep as fine as whole records ask for: what was searched on their beginnings did not
/// see the slow terms.
fn with_creep_of_the_whole(study: &Study, found: Judged) -> Judged {
    let mut best = found;
    while !study.met(&best) && !study.watch.stopped() {
        let finer = parallel::map(&study.finer_creep(&best.model), |begin| {
            study.thoroughly(begin)
        });
        let least = study.merit(&best) - study.policy.least_gain;
        let better = finer.into_iter().filter(|one| study.merit(one) < least);
        let Some(better) = better.min_by(|a, b| study.merit(a).total_cmp(&study.merit(b))) else {
            break;
        };
        best = better;
    }
    best
}

/// From a prior model.
fn grow_from_prior(study: &Study, model: Model) -> Result<Grown> {
    let base = study.judged(model);
    let of_the_model = quality::issues(study.dataset, Moment::PriorModel(study, &base));
    if !of_the_model.is_empty() {
        return Ok(Grown {
            issues: of_the_model,
            ..at(base)
        });
    }
    let compared = prior::compare(study, base)?;
    let issues = quality::issues(study.dataset, Moment::FirstFit(study, &compared.refitted));
    if !issues.is_empty() {
        return Ok(Grown {
            issues,
            ..at(compared.refitted)
        });
    }
    let loops = structure_beside_a_gain(&compared.base.model);
    if compared.at_home || study.watch.stopped() {
        return grow(
            study,
            Pool::of(study, &compared.base.model),
            &compared.base,
            &loops,
        );
    }
    let prior::Compared {
        base,
        refitted,
        mut pool,
        mut minimal,
        ..
    } = compared;
    let simplest = minimal
        .first()
        .map(|k| pool.entries[k].clone())
        .filter(|e| e.held);
    let mut steps = vec![PathStep {
        change: ModelChange::Start,
        judged: base.clone(),
    }];
    let (moves, fitted) = match &simplest {
        Some(entry) => {
            let told = study.judged(prior::all_free(&entry.judged.model, &base.model));
            let changed = entry.moves.iter().map(|m| match m {
                Move::Added(id) => ModelChange::Added(id.clone()),
                Move::Freed(id) => ModelChange::Changed(id.clone()),
            });
            steps.extend(changed.map(|change| PathStep {
                change,
                judged: told.clone(),
            }));
            let again = study.thoroughly(&told.model);
            // Values that this recording does not fix are better where they were identified than where its
            // noise would bring them: the held-out records decide.
            let met_better = study.merit(&again) <= study.merit(&told)
                && again.validate_rms_um <= told.validate_rms_um;
            (entry.moves.clone(), if met_better { again } else { told })
        }
        None => (Vec::new(), refitted),
    };
    steps.push(PathStep {
        change: ModelChange::FittedAgain,
        judged: fitted.clone(),
    });
    let all_freed = base.model.effects.iter().map(|e| Move::Freed(e.id.clone()));
    let mut origin: Vec<Move> = moves
        .iter()
        .filter(|m| matches!(m, Move::Added(_)))
        .cloned()
        .chain(all_freed)
        .collect();
    origin.sort();
    // Far above the noise, or where nobody knows it, the prior model left as much at home, and the question
    // was what the new recording has.
    let goes_on = study.floor_um.is_some()
        && !study.met(&fitted)
        && (study.near_the_noise(&fitted) || simplest.is_none());
    let mut grown = Grown {
        stopped: study.watch.stopped(),
        ..Grown::default()
    };
    if goes_on && !grown.stopped {
        pool.keep(Entry {
            extended: false,
            ..Entry::new(
                study,
                origin.clone(),
                study.judged_quickly(fitted.model.clone()),
                true,
            )
        });
        if let Some(start) = pool.entries.values_mut().find(|e| e.moves == origin) {
            start.extended = false;
        }
        pool.origin = origin;
        let tried: Vec<Entry> = pool
            .entries
            .values()
            .filter(|e| e.held && e.moves.len() == 1)
            .cloned()
            .collect();
        grown = grow(study, pool, &fitted, &loops)?;
        steps.extend(grown.steps.drain(..).skip(1));
        grown.tried = tried;
    } else {
        let weighed = weigh(&mut pool, &mut minimal)?;
        [grown.weighed, grown.open] = names_and_open(weighed, None, &study.policy);
        grown.simplest = minimal.iter().map(|k| pool.entries[k].clone()).collect();
        grown.models = kept_models(&grown.simplest);
        grown.tried = pool
            .entries
            .values()
            .filter(|e| e.held && e.moves.len() == 1)
            .cloned()
            .collect();
    }
    // A new fit of everything is no value that has changed.
    let told = grown.simplest.first().filter(|e| e.held);
    grown.changed = told.map_or_else(Vec::new, |entry| {
        let moved = grown.weighed.iter().filter_map(|w| w.slot.moves.first());
        let freed = moved.filter_map(|m| {
            if let Move::Freed(id) = m {
                Some(id)
            } else {
                None
            }
        });
        freed
            .flat_map(|id| prior::changes(study, id, &base.model, &entry.judged.model))
            .collect()
    });
    if told.is_none() {
        grown
            .weighed
            .retain(|w| w.slot.moves.iter().any(|m| matches!(m, Move::Added(_))));
    }
    grown.steps = steps;
    Ok(grown)
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
