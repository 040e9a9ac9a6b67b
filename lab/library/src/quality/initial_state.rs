//! Does a record begin in the specified state?
//!
//! A record that is specified to begin virgin or settled is simulated from there: no constant, no slow motion
//! of its own is estimated. Where it was driven before, what remains of that looks like creep, drift or a
//! missing initial curve to a search. The simpler explanation is tried first: the same effects, with the
//! states of all records unknown, reach the noise, and no single effect does as well from the specified
//! states.

use super::subject::{Moment, Subject};
use crate::dataset::Dataset;
use crate::dataset::issue::{Issue, IssueKind, Severity};
use crate::diagnosis::judgement::Judged;
use crate::diagnosis::study::Study;
use crate::identification::fit::rms;
use crate::parallel;
use crate::watch::WatchEvent;
use hysteron_sim::chain::InitialState;

/// States are suspected where the error without them is below this share of that with them.
const SUSPECTED: f64 = 0.8;
/// Effects that are tried in the place of other states, and how much worse one may be: some per cent of the
/// error.
const ONES_TRIED: usize = 3;
const AS_WELL: f64 = 0.1;

/// Frees the states of all records beside a fitted model. No issue where it reaches the noise as it is, where
/// no noise is known, or where other states do not bring the same effects down to it.
pub(super) fn check(subject: &Subject) -> Vec<Issue> {
    match subject.moment {
        Moment::FirstFit(study, fitted) => compare(study, fitted).unwrap_or_default(),
        Moment::End(end) => compare(end.study, end.last).unwrap_or_default(),
        _ => Vec::new(),
    }
}

fn compare(study: &Study, fitted: &Judged) -> Option<Vec<Issue>> {
    let explains =
        |judged: &Judged| judged.within(study.policy.explained, &study.floors_um, &study.split);
    let both = study.split.both();
    let specified = |i: &&usize| study.dataset.records[**i].initial_state != InitialState::Unknown;
    if study.floor_um.is_none()
        || explains(fitted)
        || !both.iter().any(|i| specified(&i))
        || study.watch.stopped()
    {
        return None;
    }
    study.watch.event(&WatchEvent::Doing(
        "asking the states in which records begin",
    ));
    let unknown = unknown_states(study.dataset);
    let other = study.of(&unknown);
    let lower =
        |before: &Judged, after: &Judged| other.merit(after) < study.merit(before) + SUSPECTED.ln();
    let quick = other.quickly(&fitted.model);
    if !lower(fitted, &quick) {
        return None;
    }
    let without = other.judged(other.for_comparison(&quick.model).model);
    if !explains(&without)
        || !lower(fitted, &without)
        || one_effect_does_as_well(study, fitted, other.merit(&without))
    {
        return None;
    }
    // Those that the model so found does not meet from the states that were specified.
    let as_specified = study.judged(without.model.clone());
    let issue = |i: &usize| {
        let (specified_um, unknown_um) = (
            rms(&as_specified.residuals[*i]),
            rms(&without.residuals[*i]),
        );
        let kind = IssueKind::InitialState {
            specified_um,
            unknown_um,
        };
        let record = &study.dataset.records[*i];
        // A state that nobody specified is estimated instead, by another search.
        let severity = if record.state_is_assumed {
            Severity::Notes
        } else {
            Severity::Blocks
        };
        (specified_um > study.policy.explained * unknown_um)
            .then(|| Issue::of(&record.name, severity, kind))
    };
    Some(
        both.iter()
            .filter(|i| specified(i))
            .filter_map(issue)
            .collect(),
    )
}

/// Whether one effect more, from the specified states, comes as near to the noise as unknown states of all
/// records do, which are many more values: they explain a drift as well.
fn one_effect_does_as_well(study: &Study, fitted: &Judged, unknown: f64) -> bool {
    let Ok(screening) = study.score(&fitted.model) else {
        return false;
    };
    let tried = parallel::map(
        &screening.scores[..screening.scores.len().min(ONES_TRIED)],
        |score| {
            let begin = study.with(
                &fitted.model,
                &[(score.effect.clone(), score.starts[0].clone())],
            );
            study.merit(&study.for_comparison(&study.quickly(&begin).model))
        },
    );
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
