//! Is a sensor's zero off?
//!
//! Of a record that is specified to begin virgin no constant is estimated. Where the sensor stands a few
//! nanometres off, a search finds a drift that comes at once to its end; a constant is simpler and is tried
//! in its place.

use super::subject::{Moment, Subject};
use crate::dataset::issue::{Issue, IssueKind, Severity};
use crate::diagnosis::judgement::Judged;
use crate::diagnosis::selection::rejects;
use crate::diagnosis::study::Study;
use crate::identification::finer_hysteresis::with_the_structure_of;
use crate::identification::fit::rms;
use crate::parallel;
use crate::watch::WatchEvent;
use hysteron_sim::chain::Model;
use hysteron_sim::effect::thermal_drift;

/// What a constant of each record brings, as a logarithm, where a model that misses the noise comes to it
/// with them: where one ends just above the noise anything that is free brings it there.
const BROUGHT_BY_CONSTANTS: f64 = 0.1;
/// A quick fit that is behind by more does not come to it.
const MAY_COME_TO_IT: f64 = 0.5;

/// Tries a constant of each record, where the manifest specifies none, beside the model at the end: whether
/// it brings the effects to the noise, or does as well as a drift that was added. Loops that stand in for the
/// constant make place for those that the search started from.
pub(super) fn check(subject: &Subject) -> Vec<Issue> {
    match subject.moment {
        Moment::End(end) => compare(end.study, end.first, end.last, end.added).unwrap_or_default(),
        _ => Vec::new(),
    }
}

fn compare(study: &Study, begun: &Judged, found: &Judged, added: &[String]) -> Option<Vec<Issue>> {
    let specified: Vec<usize> = study
        .split
        .both()
        .into_iter()
        .filter(|i| !study.dataset.records[*i].offset_is_fitted)
        .collect();
    let explains =
        |judged: &Judged| judged.within(study.policy.explained, &study.floors_um, &study.split);
    let drifts = added.iter().any(|id| id == thermal_drift::ID);
    let misses = study.floor_um.is_some() && !explains(found);
    if specified.is_empty() || !(drifts || misses) || study.watch.stopped() {
        return None;
    }
    study
        .watch
        .event(&WatchEvent::Doing("asking whether a sensor's zero is off"));
    let mut free = study.dataset.clone();
    free.records
        .iter_mut()
        .for_each(|record| record.offset_is_fitted = true);
    let other = study.of(&free);
    let as_it_is = study.without(&found.model, thermal_drift::ID);
    let with_its_loops = with_the_structure_of(&as_it_is, &begun.model);
    let tried: Vec<Model> = std::iter::once(as_it_is).chain(with_its_loops).collect();
    let quick = parallel::map(&tried, |model| other.quickly(model))
        .into_iter()
        .min_by(|a, b| other.merit(a).total_cmp(&other.merit(b)))?;
    if other.merit(&quick) > study.merit(found) + MAY_COME_TO_IT {
        return None;
    }
    let without = other.judged(other.for_comparison(&quick.model).model);
    let brings_it_there =
        explains(&without) && other.merit(&without) < study.merit(found) - BROUGHT_BY_CONSTANTS;
    if rejects(study, &without, found) || (misses && !brings_it_there) {
        return None;
    }
    let as_specified = study.judged(without.model.clone());
    let issue = |i: &usize| {
        let kind = IssueKind::SensorOffset {
            specified_um: rms(&as_specified.residuals[*i]),
            fitted_um: rms(&without.residuals[*i]),
        };
        Issue::of(&study.dataset.records[*i].name, Severity::Notes, kind)
    };
    Some(specified.iter().map(issue).collect())
}
