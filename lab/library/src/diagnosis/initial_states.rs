//! Does a record begin in the state that was said?
//!
//! A record that is said to begin virgin or settled is simulated from there: no constant, no slow motion of its own is estimated. Where it was
//! driven before, what is left of that looks like creep, drift or a missing initial curve to a search, which would name one. The simpler story is
//! asked first: the very same effects, with the states of all records unknown, meet the noise, and no single effect does as well from the states that were
//! said.

use super::judgement::Judged;
use super::study::Study;
use crate::dataset::Dataset;
use crate::identification::fit::rms;
use crate::parallel;
use crate::watch::Event;
use hysteron_sim::chain::InitialState;

/// States are suspected where the error without them is below this share of that with them.
const SUSPECTED: f64 = 0.8;

/// Effects that are tried in the place of other states, and how much worse one may be: some per cent of the error.
const ONES_TRIED: usize = 3;
const AS_WELL: f64 = 0.1;

/// Records that do not begin in the state that was said.
#[derive(Clone, Debug, PartialEq)]
pub struct OtherStates {
    /// Their names.
    pub records: Vec<String>,
    /// The largest error of these records as they are said to begin, um.
    pub as_said_um: f64,
    /// The largest error of them with states unknown and the same effects, um.
    pub unknown_um: f64,
}

/// Asks the states of all records, given a fitted model; nothing where it meets the noise as it is, where no noise is known or where other states do not
/// bring the same effects down to it.
#[must_use]
pub fn compare(study: &Study, fitted: &Judged) -> Option<OtherStates> {
    let explains = |judged: &Judged| judged.within(study.policy.explained, &study.floors_um, &study.split);
    let both = study.split.both();
    let said = |i: &usize| study.dataset.records[*i].initial_state != InitialState::Unknown;
    if study.floor_um.is_none() || explains(fitted) || !both.iter().any(said) || study.watch.stopped() {
        return None;
    }
    study.watch.event(&Event::Doing("asking the states in which records begin"));
    let unsaid = unknown_states(study.dataset);
    let other = study.of(&unsaid);
    let lower = |before: &Judged, after: &Judged| other.merit(after) < study.merit(before) + SUSPECTED.ln();
    let quick = other.quickly(&fitted.model);
    if !lower(fitted, &quick) {
        return None;
    }
    let without = other.judged(other.for_comparison(&quick.model).model);
    if !explains(&without) || !lower(fitted, &without) || one_effect_does_as_well(study, fitted, other.merit(&without)) {
        return None;
    }
    // Those that the model so found does not meet from where they are said to begin.
    let as_said = study.judged(without.model.clone());
    let misses = |i: &&usize| rms(&as_said.residuals[**i]) > study.policy.explained * rms(&without.residuals[**i]);
    let missed: Vec<usize> = both.iter().filter(|i| said(i)).filter(misses).copied().collect();
    let largest = |judged: &Judged| missed.iter().map(|i| rms(&judged.residuals[*i])).fold(0.0, f64::max);
    (!missed.is_empty()).then(|| OtherStates {
        records: missed.iter().map(|i| study.dataset.records[*i].name.clone()).collect(),
        as_said_um: largest(&as_said),
        unknown_um: largest(&without),
    })
}

/// Whether one effect more, from the states that were said, comes as near to the noise as unknown states of all records do, which are many more values: a
/// drift is met by them too.
fn one_effect_does_as_well(study: &Study, fitted: &Judged, unknown: f64) -> bool {
    let Ok(screening) = study.score(&fitted.model) else { return false };
    let tried = parallel::map(&screening.scores[..screening.scores.len().min(ONES_TRIED)], |score| {
        let begin = study.with(&fitted.model, &[(score.effect.clone(), score.starts[0].clone())]);
        study.merit(&study.for_comparison(&study.quickly(&begin).model))
    });
    tried.into_iter().any(|merit| merit < unknown + AS_WELL)
}

/// The same data, nothing known of how its records begin.
fn unknown_states(dataset: &Dataset) -> Dataset {
    let mut out = dataset.clone();
    for record in &mut out.records {
        record.initial_state = InitialState::Unknown;
        record.offset_is_fitted = true;
    }
    out
}
