//! The checks of a recording that the stages call, as issues.

use super::drive_timing::{self, OwnRow};
use super::feedback;
use super::initial_states;
use super::judgement::Judged;
use super::study::Study;
use super::unanswered;
use crate::dataset::Dataset;
use crate::dataset::reading_limits::reading_limits;
use crate::error::Result;
use crate::identification::noise_floor::NoiseFloor;
use crate::quality::{Issue, Kind, Severity, words};

/// Before anything is fitted.
#[must_use]
pub fn before(dataset: &Dataset) -> Vec<Issue> {
    let ends = reading_limits(dataset).into_iter().map(|limit| {
        let kind = Kind::RangeEnds { reading_um: limit.reading_um, highest: limit.highest, samples: 0, share: limit.share };
        Issue::of(limit.record, Severity::Notes, kind)
    });
    ends.collect()
}

fn timing(found: OwnRow) -> Issue {
    let kind = Kind::SameSampleTiming { not_needed: found.not_needed, assumed_um: found.as_said_um, same_sample_um: found.own_row_um };
    Issue { record: None, kind, severity: Severity::Corrects }
}

/// Of a prior model as it is.
#[must_use]
pub fn of_a_prior(study: &Study, base: &Judged) -> Vec<Issue> {
    drive_timing::of_a_model(study, base).map(timing).into_iter().collect()
}

/// Of the effects that a search begins with, fitted.
#[must_use]
pub fn of_the_start(study: &Study, fitted: &Judged) -> Vec<Issue> {
    let Some(found) = initial_states::compare(study, fitted) else { return Vec::new() };
    let kind = Kind::InitialState { specified_um: found.as_said_um, unknown_um: found.unknown_um };
    found.records.into_iter().map(|record| Issue::of(record, Severity::Blocks, kind.clone())).collect()
}

/// Of what a search came to.
///
/// # Errors
/// A candidate that gives something that is no number.
pub fn after(study: &Study, floor: &NoiseFloor, first: &Judged, last: &Judged, added: &[String]) -> Result<Vec<Issue>> {
    let mut out = Vec::new();
    let off = initial_states::off_zero(study, first, last, added);
    if let Some(off) = &off {
        let kind = Kind::SensorOffset { specified_um: off.as_said_um, fitted_um: off.fitted_um };
        out.extend(off.records.iter().map(|record| Issue::of(record.clone(), Severity::Notes, kind.clone())));
    } else {
        out.extend(of_the_start(study, last));
    }
    out.extend(drive_timing::compare(study, last, added)?.map(timing));
    for one in unanswered::records(study.dataset, last) {
        out.push(Issue::of(one.record, Severity::Blocks, Kind::NotAnswered { moves_um: one.moves_um, share: one.share }));
    }
    for one in feedback::followed(study.dataset, last, floor, study.policy.near_the_noise) {
        let kind = Kind::ClosedLoop { later_samples: one.later_samples, correlation: one.correlation, by_chance: one.by_chance };
        out.push(Issue::of(one.record, Severity::Notes, kind));
    }
    Ok(out)
}

/// Whether a search is to be repeated with the timing of the same row.
#[must_use]
pub fn asks_for_own_rows(issues: &[Issue]) -> bool {
    issues.iter().any(|i| matches!(i.kind, Kind::SameSampleTiming { .. }))
}

/// The data set with the timing of the same row, and a note that says so.
#[must_use]
pub fn in_own_rows(dataset: &Dataset, issues: &[Issue]) -> Dataset {
    let mut timed = dataset.in_own_rows();
    let of_timing = issues.iter().filter(|i| matches!(i.kind, Kind::SameSampleTiming { .. }));
    timed.notes.extend(of_timing.map(words::sentence));
    timed
}
