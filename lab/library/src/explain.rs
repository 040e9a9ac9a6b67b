//! The main job: identify, compare, diagnose, add, until the floor; and everything that files show of it.

use crate::dataset::Dataset;
use crate::dataset::reading_limits::reading_limits;
use crate::diagnosis::drive_timing::{self, OwnRow};
use crate::diagnosis::elsewhere::{self, Elsewhere, Hypothesis};
use crate::diagnosis::feedback;
use crate::diagnosis::initial_states::{self, OtherStates};
use crate::diagnosis::judgement::{Judged, Split, require_finite, require_signals};
use crate::diagnosis::loop_structures;
use crate::diagnosis::next_experiment::{Limits, Proposal, propose};
use crate::diagnosis::overdamped_mode;
use crate::diagnosis::path::{self, Change, Step};
use crate::diagnosis::policy::Policy;
use crate::diagnosis::reduction::{Reduced, Supported, reduce};
use crate::diagnosis::screening::Screening;
use crate::diagnosis::search::Search;
use crate::diagnosis::searched_data::for_evidence;
use crate::diagnosis::study::Study;
use crate::diagnosis::unanswered;
use crate::diagnosis::verdict::{self, Diagnosis, Found, Verdict};
use crate::diagnosis::words;
use crate::error::Result;
use crate::identification::fit::{Effort, counted_residual, fit_rows, rms};
use crate::identification::identifiability::{CannotIdentify, identifiability};
use crate::identification::linearisation::Rows;
use crate::identification::noise_floor::{NoiseFloor, noise_floor};
use crate::identification::{finer_creep, finer_hysteresis};
use crate::identify::require_chain;
use crate::parallel;
use crate::statistics::largest;
use crate::watch::{Event, Watch};
use hysteron_sim::chain::{EffectInstance, Model};
use hysteron_sim::effect::{Effect, Overview, gain, registry};
use serde::Serialize;
use std::sync::Arc;

/// How one record is met.
#[derive(Clone, Debug, Serialize)]
pub struct RecordFigures {
    /// The record.
    pub file: String,
    /// Its role.
    pub role: &'static str,
    /// Residual, um.
    pub rms_um: f64,
    /// Largest residual, um.
    pub max_um: f64,
    /// Residual in % of the measured range.
    pub rms_pct_range: f64,
}

/// One value of a model.
#[derive(Clone, Debug, Serialize)]
pub struct ParameterFigures {
    /// The effect.
    pub effect: String,
    /// The parameter.
    pub name: String,
    /// Its value.
    pub value: f64,
    /// Its standard deviation.
    pub std: Option<f64>,
    /// Its unit.
    pub unit: String,
}

/// One step of the way to a model.
#[derive(Clone, Debug, Serialize)]
pub struct StepFigures {
    /// What was added.
    pub added: Option<String>,
    /// What was taken back.
    pub removed: Vec<String>,
    /// Why.
    pub why: String,
    /// Fitted error.
    pub identify_rms_um: f64,
    /// Held-out error.
    pub validate_rms_um: Option<f64>,
}

/// What `identify`, `add`, `explain` and `compare` write (`hysteron.fit/1`).
#[derive(Clone, Debug, Serialize)]
pub struct FitFigures {
    /// `hysteron.fit/1`.
    pub schema: &'static str,
    /// Effects in the order of the chain.
    pub effects: Vec<String>,
    /// Every record.
    pub records: Vec<RecordFigures>,
    /// Floor.
    pub noise_floor_um: Option<f64>,
    /// What it rests on.
    pub floor_basis: String,
    /// All values.
    pub parameters: Vec<ParameterFigures>,
    /// The way to it.
    pub steps: Vec<StepFigures>,
    /// What the data cannot tell, in words.
    pub cannot_identify: Vec<String>,
    /// Remarks on data and floor.
    pub warnings: Vec<String>,
    /// It was stopped: this is the best so far.
    pub stopped: bool,
    /// Wall-clock time.
    pub seconds: f64,
    /// The diagnosis, with `explain` and `diagnose`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub diagnosis: Option<Diagnosis>,
}

/// Everything that one run of the main job found.
pub struct Explanation {
    /// The final model with standard deviations.
    pub model: Model,
    /// The way to it; the first step is the start, the last the final model.
    pub steps: Vec<Step>,
    /// What was added and stays, with its evidence.
    pub supported: Vec<Supported>,
    /// The comparison with a model from elsewhere.
    pub elsewhere: Option<Elsewhere>,
    /// Candidates on what the model at the end leaves, where nothing was added.
    pub beside_start: Option<Screening>,
    /// The floor.
    pub floor: NoiseFloor,
    /// The verdict on the starting model.
    pub diagnosis: Diagnosis,
    /// What the data cannot tell.
    pub cannot_identify: Vec<CannotIdentify>,
    /// Records that are fitted and judge.
    pub split: Split,
    /// The drive that would tell the first two of an ambiguous set apart.
    pub next_experiment: Option<NextExperiment>,
    /// The readings follow the drive of their own row, where nobody said which they follow.
    pub own_row: Option<OwnRow>,
    /// The caller wanted the best so far.
    pub stopped: bool,
}

/// A drive to run next.
pub struct NextExperiment {
    /// The effects that it tells apart.
    pub between: [String; 2],
    /// The drive.
    pub proposal: Proposal,
    /// What it decides and how well.
    pub sentence: String,
}

/// All built-in candidates and the user's own.
#[must_use]
pub fn candidates(own: &[Arc<dyn Effect>]) -> Vec<Arc<dyn Effect>> {
    let mut all: Vec<Arc<dyn Effect>> = registry().into_iter().filter(|e| e.declaration().candidate || e.in_exchange()).collect();
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

/// What a growth came to, however it began.
#[derive(Default)]
struct Grown {
    steps: Vec<Step>,
    supported: Vec<Supported>,
    taken_back: Vec<(String, crate::diagnosis::decision::Decision)>,
    elsewhere: Option<Elsewhere>,
    beside_start: Option<Screening>,
    loops_alike: Vec<String>,
    other_states: Option<OtherStates>,
    own_row: Option<OwnRow>,
    stopped: bool,
    out_of_time: bool,
}

/// Runs the main job.
///
/// # Errors
/// Where the effects to start from make no chain ([`require_chain`]); where a model or a candidate gives something that is no number: with effect,
/// record and sample.
pub fn explain(dataset: &Dataset, start: Start, options: &Options, watch: &dyn Watch) -> Result<Explanation> {
    if let Start::Effects(effects) = &start {
        require_chain(effects, dataset)?;
    }
    require_signals(&options.own, dataset)?;
    match for_evidence(dataset, options.policy.weighed_samples) {
        Some(beginnings) => to_the_whole(dataset, &beginnings, decided(&beginnings, start, options, watch)?, watch),
        None => decided(dataset, start, options, watch),
    }
}

/// Runs the main job, and once more where the readings turn out to follow the drive of their own row and nobody said which they follow. What it found is of the
/// data set that comes with it, where that is another than the one that was given.
///
/// # Errors
/// As [`explain`].
pub fn explain_as_timed(dataset: &Dataset, start: Start, options: &Options, watch: &dyn Watch) -> Result<(Explanation, Option<Dataset>)> {
    let found = explain(dataset, start.clone(), options, watch)?;
    let Some(own_row) = found.own_row.as_ref().filter(|_| !found.stopped && !watch.searched_enough()) else { return Ok((found, None)) };
    watch.event(&Event::Doing("once more, with readings that follow the drive of their own row"));
    let mut timed = dataset.in_own_rows();
    timed.notes.push(words::taken_in_own_rows(own_row));
    Ok((explain(&timed, start, options, watch)?, Some(timed)))
}

/// What was decided on the beginnings of long records, with the model fitted to the whole of them.
fn to_the_whole(dataset: &Dataset, beginnings: &Dataset, mut found: Explanation, watch: &dyn Watch) -> Result<Explanation> {
    let samples = |data: &Dataset| -> usize { found.split.both().iter().map(|i| data.records[*i].window.len()).sum() };
    found.floor.warnings.push(format!(
        "long records: decided on the first {:.1} % of each, {} of {} samples; the last model is fitted to the whole, and its errors by record are of that",
        100.0 * samples(beginnings) as f64 / samples(dataset) as f64,
        samples(beginnings),
        samples(dataset)
    ));
    if !found.stopped {
        watch.event(&Event::Doing("fitting the whole of long records"));
        let rows = Rows::thinned(dataset, &found.split.identify, WHOLE_SAMPLES);
        let fitted = fit_rows(&found.model, dataset, &rows, WHOLE).model;
        require_finite(&fitted, dataset, &found.split.both())?;
        found.model = fitted;
    }
    Ok(found)
}

/// Rows of the fit to the whole of long records, and how far it goes: it begins where their beginnings end.
const WHOLE_SAMPLES: usize = 100_000;
const WHOLE: Effort = Effort { iterations: 4, tolerance: 0.2, relative: 1e-3, looks_again: false };

/// Everything that is decided on a data set.
fn decided(dataset: &Dataset, start: Start, options: &Options, watch: &dyn Watch) -> Result<Explanation> {
    let mut floor = noise_floor(dataset);
    let mut study = study_of(dataset, options, &floor, watch);
    let mut grown = grown_from(&start, &study)?;
    for _ in 1..FLOORS_MAX {
        let Some(beside) = floor_of(&grown, &floor, dataset, &options.policy).filter(|_| !grown.stopped && !grown.out_of_time) else {
            break;
        };
        let another = differ(floor.rms_um, beside.rms_um);
        floor = beside;
        study = study_of(dataset, options, &floor, watch);
        if !another {
            break;
        }
        watch.event(&Event::Doing("searching again beside what the drive's own noise makes"));
        grown = grown_from(&start, &study)?;
    }
    let Grown { mut steps, supported, taken_back, elsewhere, beside_start, loops_alike, other_states, own_row, stopped, out_of_time } =
        grown;
    if out_of_time {
        floor.warnings.push("the search ended where it was when its time was over: with more it may find more".to_owned());
    }
    let quantised = quantise(&mut steps, &floor, &study.overview);
    let (first, last) = (&steps[0].judged, &steps[steps.len() - 1].judged);
    let added: Vec<String> = supported.iter().map(|s| s.id.clone()).collect();
    let off_zero = initial_states::off_zero(&study, first, last, &added);
    let other_states = other_states.or_else(|| off_zero.is_none().then(|| initial_states::compare(&study, last)).flatten());
    let own_row = match own_row {
        Some(known) => Some(known),
        None => drive_timing::compare(&study, last, &added)?,
    };
    let unanswered = unanswered::records(dataset, last);
    let (feedback, reading_limits) = (feedback::followed(dataset, last, &floor, options.policy.near_the_noise), reading_limits(dataset));
    let found = Found {
        first,
        last,
        supported: &supported,
        taken_back: &taken_back,
        elsewhere: elsewhere.as_ref(),
        beside_start: beside_start.as_ref(),
        quantised: quantised.as_deref(),
        loops_alike: &loops_alike,
        reading_limits: &reading_limits,
        off_zero: off_zero.as_ref(),
        own_row: own_row.as_ref(),
        unanswered: &unanswered,
        other_states: other_states.as_ref(),
        feedback: &feedback,
        stopped,
        out_of_time,
    };
    let mut diagnosis = verdict::diagnose(&found, &floor, dataset, &study.split, &study.policy);
    let mut model = last.model.clone();
    watch.event(&Event::Doing("estimating standard deviations"));
    let cannot_identify = identifiability(&mut model, dataset, &study.split.identify);
    require_finite(&model, dataset, &study.split.both())?;
    if diagnosis.verdict == Verdict::Unexplained && last.model.effect(gain::ID).is_none() {
        floor.warnings.extend(initial_states::remembered(dataset, &study.split));
    }
    let best_drive = next_experiment(&supported, &diagnosis, last, dataset, floor.rms_um);
    let (next_experiment, in_vain) =
        best_drive.map_or((None, None), |best| if best.proposal.decides(floor.rms_um) { (Some(best), None) } else { (None, Some(best)) });
    if let Some(best) = in_vain {
        diagnosis.decided_by_no_drive(&best.between, best.proposal.separation_um);
    }
    let split = study.split.clone();
    drop(study);
    Ok(Explanation {
        model,
        steps,
        supported,
        elsewhere,
        beside_start,
        floor,
        diagnosis,
        cannot_identify,
        split,
        next_experiment,
        own_row,
        stopped,
    })
}

/// How often a search is begun with another floor: the noise of a drive's column makes something else of every model, and the next to nothing of it changes
/// from the second to the third.
const FLOORS_MAX: usize = 3;
/// Floors that differ by more than this share let a search end elsewhere.
const ANOTHER_FLOOR: f64 = 0.1;

fn differ(one_um: Option<f64>, other_um: Option<f64>) -> bool {
    one_um.zip(other_um).is_none_or(|(one_um, other_um)| (one_um - other_um).abs() > ANOTHER_FLOOR * one_um.min(other_um))
}

/// The floor beside the first model on the way that leaves no more than it, or else beside the last: a model that smooths more passes less of the noise in
/// the drive's column on, and is not better for that.
fn floor_of(grown: &Grown, floor: &NoiseFloor, dataset: &Dataset, policy: &Policy) -> Option<NoiseFloor> {
    floor.read_back?;
    let split = Split::of(dataset);
    let beside = |judged: &Judged| judged.floor_beside(floor, policy.explained, dataset);
    let as_the_noise = policy.at_floor + policy.floor_z * floor.relative_std();
    let leaves_nothing = |judged: &Judged| beside(judged).filter(|beside| judged.within(as_the_noise, &beside.of_records_um, &split));
    let (last, before) = grown.steps.split_last()?;
    before.iter().find_map(|step| leaves_nothing(&step.judged)).or_else(|| beside(&last.judged))
}

fn study_of<'a>(dataset: &'a Dataset, options: &Options, floor: &NoiseFloor, watch: &'a dyn Watch) -> Study<'a> {
    Study::new(dataset, candidates(&options.own), floor, options.policy.clone(), watch)
}

fn grown_from(start: &Start, study: &Study) -> Result<Grown> {
    match start {
        Start::Effects(effects) => {
            let base = study.build(effects)?;
            require_finite(&base.model, study.dataset, &study.split.both())?;
            begun_as_said(study, &base).map_or_else(|| grow(study, &base), Ok)
        }
        Start::Model(model) => {
            require_finite(model, study.dataset, &study.split.both())?;
            grow_from_elsewhere(study, model.clone())
        }
    }
}

/// Where records do not begin in the state that was said, nothing is searched: what was found would stand in for it.
fn begun_as_said(study: &Study, fitted: &Judged) -> Option<Grown> {
    let other_states = initial_states::compare(study, fitted)?;
    let steps = vec![Step { change: Change::Start, judged: fitted.clone() }];
    Some(Grown { steps, other_states: Some(other_states), ..Grown::default() })
}

/// From a fitted model to the best that the data support.
fn grow(study: &Study, base: &Judged) -> Result<Grown> {
    let mut search = Search::from(study, &base.model);
    let settled = study.nothing_left(base);
    let mut beside_start = None;
    let mut quiet = false;
    if settled && !study.watch.stopped() {
        // Nothing is left above the noise: only a signature that is there beyond chance is worth a search.
        let screening = study.weigh(&base.model, &study.candidates_for(&base.model), 1000)?;
        let significant = |e: &crate::diagnosis::screening::Evidence| e.p_adjusted <= study.policy.false_discovery_rate;
        quiet = !screening.scores.iter().any(|s| s.evidence.as_ref().is_some_and(significant));
        beside_start = Some(screening);
    }
    if !quiet {
        search.run()?;
    }
    let best = search.best().clone();
    let described = |model: &Model| (finer_hysteresis::description(model), finer_creep::description(model));
    let finer = described(&best.judged.model) != described(&base.model);
    if best.added.is_empty() && !finer {
        let stopped = search.stopped;
        if beside_start.is_none() && !stopped {
            beside_start = Some(study.weigh(&base.model, &study.candidates_for(&base.model), 1000)?);
        }
        let steps = vec![Step { change: Change::Start, judged: base.clone() }];
        return Ok(Grown { steps, beside_start, stopped, out_of_time: search.out_of_time, ..Grown::default() });
    }
    let mut candidate = best.judged.clone();
    let has_time = !search.out_of_time || study.near_the_noise(&candidate);
    if !study.met(&candidate) && has_time && !study.watch.stopped() {
        study.watch.event(&Event::Doing("beginning values again"));
        candidate = study.begun_again(&candidate)?;
    }
    if search.stopped || study.watch.stopped() {
        let judged = study.judged(candidate.model);
        let change = if best.added.is_empty() { Change::FittedAgain } else { Change::AddedUnweighed(best.added.clone()) };
        let steps = vec![Step { change: Change::Start, judged: base.clone() }, Step { change, judged }];
        return Ok(Grown { steps, beside_start, stopped: true, ..Grown::default() });
    }
    if study.searched_beginnings() {
        candidate = with_creep_of_the_whole(study, &candidate);
    }
    let (candidate, added) = overdamped_mode::as_a_lag(study, candidate, best.added);
    let reduced = reduce(study, &candidate, &added)?;
    let loops_alike = loop_structures::doing_as_well(study, &base.model, &reduced.judged);
    study.watch.event(&Event::Doing("fitting to the end"));
    let thorough = study.thoroughly(&reduced.judged.model);
    let end = if thorough.identify_rms_um <= reduced.judged.identify_rms_um { thorough } else { reduced.judged };
    let added: Vec<String> = reduced.supported.iter().map(|s| s.id.clone()).collect();
    let steps = path::from(study, base, &added, &end)?;
    let Reduced { supported, taken_back, .. } = reduced;
    let out_of_time = search.out_of_time;
    Ok(Grown { steps, supported, taken_back, beside_start, loops_alike, out_of_time, ..Grown::default() })
}

/// The model with its creep as fine as whole records ask for: what was searched on their beginnings did not see the slow terms.
fn with_creep_of_the_whole(study: &Study, found: &Judged) -> Judged {
    let mut best = study.judged(found.model.clone());
    while !study.met(&best) && !study.watch.stopped() {
        let finer = parallel::map(&study.finer_creep(&best.model), |begin| study.thoroughly(begin));
        let least = study.merit(&best) - study.policy.least_gain;
        let Some(better) =
            finer.into_iter().filter(|one| study.merit(one) < least).min_by(|a, b| study.merit(a).total_cmp(&study.merit(b)))
        else {
            break;
        };
        best = better;
    }
    best
}

/// From a model that was handed in.
fn grow_from_elsewhere(study: &Study, model: Model) -> Result<Grown> {
    let base = study.judged(model);
    if let Some(own_row) = drive_timing::of_a_model(study, &base) {
        let steps = vec![Step { change: Change::Start, judged: base }];
        return Ok(Grown { steps, own_row: Some(own_row), ..Grown::default() });
    }
    let compared = elsewhere::compare(study, base)?;
    if let Some(found) = begun_as_said(study, &compared.refitted) {
        return Ok(found);
    }
    if compared.at_home || study.watch.stopped() {
        let base = if compared.refitted.identify_rms_um < compared.base.identify_rms_um { &compared.base } else { &compared.refitted };
        let mut grown = grow(study, base)?;
        grown.elsewhere = Some(compared);
        return Ok(grown);
    }
    let mut steps = vec![Step { change: Change::Start, judged: compared.base.clone() }];
    let mut told = compared.refitted.clone();
    for tried in &compared.story {
        let id = tried.hypothesis.effect(&compared.base.model);
        let change = match &tried.hypothesis {
            Hypothesis::Missing(_) => Change::Added(id),
            Hypothesis::Changed(_) | Hypothesis::Scaled => Change::Changed(id),
        };
        told = study.judged(tried.judged.model.clone());
        steps.push(Step { change, judged: told.clone() });
    }
    // Values that this recording does not fix are better where they were identified than where its noise would bring them.
    let mut refitted = study.thoroughly(&told.model);
    if study.far_above_the_noise(&refitted) {
        // Begun where all others were held, what came may lie far from where it belongs beside others that are free: a mode beside one that has moved as well.
        refitted = begun_beside_free_values(study, &compared, refitted)?;
    }
    let refitted = if study.merit(&refitted) <= study.merit(&told) { refitted } else { told };
    steps.push(Step { change: Change::FittedAgain, judged: refitted.clone() });
    let mut grown = Grown { steps, stopped: study.watch.stopped(), ..Grown::default() };
    // Far above the noise, or where nobody knows it, the model left as much at home, and the question was what the new recording has.
    let near_the_noise = study.near_the_noise(&refitted);
    if (near_the_noise || compared.story.is_empty()) && study.floor_um.is_some() && !grown.stopped {
        let more = grow(study, &refitted)?;
        grown.steps.extend(more.steps.into_iter().skip(1));
        (grown.supported, grown.taken_back, grown.beside_start) = (more.supported, more.taken_back, more.beside_start);
        grown.loops_alike = more.loops_alike;
        (grown.stopped, grown.out_of_time) = (more.stopped, more.out_of_time);
    }
    grown.elsewhere = Some(compared);
    Ok(grown)
}

/// The effects of a model from elsewhere, fitted to this recording, and each that is missing there begun beside them, where that leaves less.
fn begun_beside_free_values(study: &Study, compared: &Elsewhere, refitted: Judged) -> Result<Judged> {
    let mut model = compared.refitted.model.clone();
    for tried in &compared.story {
        let Hypothesis::Missing(_) = &tried.hypothesis else { continue };
        let id = tried.hypothesis.effect(&compared.base.model);
        let Some(effect) = tried.judged.model.effect(&id).map(|e| e.effect.clone()) else { continue };
        model = study.seated(&study.without(&model, &id), &effect, 3, f64::INFINITY)?.model;
    }
    let begun = study.thoroughly(&model);
    Ok(if study.merit(&begun) < study.merit(&refitted) { begun } else { refitted })
}

/// Adds the converter that the readings themselves show. It explains part of the noise, not of the error: everything else is the same
/// without it. Its identifier, where it was added.
fn quantise(steps: &mut Vec<Step>, floor: &NoiseFloor, overview: &Overview) -> Option<String> {
    let (step_um, last) = (floor.reading_step_um?, steps.last()?);
    let (effect, values) = registry().into_iter().find_map(|e| e.values_in_readings(step_um).map(|values| (e, values)))?;
    let id = effect.declaration().id;
    if last.judged.model.effect(&id).is_some() {
        return None;
    }
    let mut judged = last.judged.clone();
    judged.model.add(EffectInstance::new(effect, overview, &values));
    steps.push(Step { change: Change::Added(id.clone()), judged });
    Some(id)
}

/// Where two explanations tie, the drive on which they differ most.
fn next_experiment(
    supported: &[Supported],
    diagnosis: &Diagnosis,
    last: &Judged,
    dataset: &Dataset,
    floor_um: Option<f64>,
) -> Option<NextExperiment> {
    if diagnosis.verdict != Verdict::Ambiguous {
        return None;
    }
    let undecided = supported.iter().find(|s| s.names().len() > 1)?;
    let rival = undecided.rivals.iter().find(|r| r.decision == crate::diagnosis::decision::Decision::NotToldApart)?;
    let proposal = propose(&last.model, &rival.judged.model, &Limits::of(&dataset.overview()))?;
    let sentence = proposal.sentence(&words::spoken(&undecided.id), &words::spoken(&rival.id), floor_um);
    Some(NextExperiment { between: [undecided.id.clone(), rival.id.clone()], proposal, sentence })
}

fn record_figures(model: &Model, dataset: &Dataset) -> Vec<RecordFigures> {
    dataset
        .records
        .iter()
        .map(|record| {
            let r = counted_residual(model, record);
            let rms_um = rms(&r);
            let range = record.range_um();
            RecordFigures {
                file: record.name.clone(),
                role: record.role.name(),
                rms_um,
                max_um: largest(&r),
                rms_pct_range: if range > 0.0 { 100.0 * rms_um / range } else { 0.0 },
            }
        })
        .collect()
}

/// All values of a model.
#[must_use]
pub fn parameter_figures(model: &Model) -> Vec<ParameterFigures> {
    let of = |e: &EffectInstance| -> Vec<ParameterFigures> {
        let figures = e.parameters.iter().map(|p| ParameterFigures {
            effect: e.id.clone(),
            name: p.parameter.name.clone(),
            value: p.value,
            std: p.std,
            unit: p.parameter.unit.clone(),
        });
        figures.collect()
    };
    model.effects.iter().flat_map(of).collect()
}

/// Figures of a model on a data set.
#[must_use]
pub fn fit_figures(
    model: &Model,
    dataset: &Dataset,
    floor: &NoiseFloor,
    steps: Vec<StepFigures>,
    cannot_identify: &[CannotIdentify],
    seconds: f64,
) -> FitFigures {
    FitFigures {
        schema: "hysteron.fit/1",
        effects: model.effect_ids(),
        records: record_figures(model, dataset),
        noise_floor_um: floor.rms_um,
        floor_basis: floor.basis.clone(),
        parameters: parameter_figures(model),
        steps,
        cannot_identify: cannot_identify.iter().map(words::cannot_identify).collect(),
        warnings: dataset.notes.iter().chain(&floor.warnings).cloned().collect(),
        stopped: false,
        seconds,
        diagnosis: None,
    }
}

/// Figures of the steps to a model.
#[must_use]
pub fn step_figures(steps: &[Step]) -> Vec<StepFigures> {
    let before = std::iter::once(None).chain(steps.iter().map(|s| Some(&s.judged)));
    steps
        .iter()
        .zip(before)
        .map(|(step, before)| StepFigures {
            added: step.change.added(),
            removed: Vec::new(),
            why: words::why_step(&step.change, before, &step.judged),
            identify_rms_um: step.judged.identify_rms_um,
            validate_rms_um: step.judged.validate_rms_um,
        })
        .collect()
}

impl Explanation {
    /// Figures for files.
    #[must_use]
    pub fn figures(&self, dataset: &Dataset, seconds: f64) -> FitFigures {
        let mut out = fit_figures(&self.model, dataset, &self.floor, step_figures(&self.steps), &self.cannot_identify, seconds);
        out.stopped = self.stopped;
        out.diagnosis = Some(self.diagnosis.clone());
        out
    }

    /// The model at the end, with its errors.
    #[must_use]
    pub fn last(&self) -> &Judged {
        &self.steps[self.steps.len() - 1].judged
    }
}
