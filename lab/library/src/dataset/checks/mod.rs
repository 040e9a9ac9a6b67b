//! What a data set shows about its own records while it is made: no model, no fit. Checks that need a model are
//! those of [`crate::quality`].

#[cfg(feature = "readers")]
mod answered_jumps;
mod as_specified;
mod given_twice;
mod judging;
mod leading;
mod not_followed;
mod outliers;
mod range;
mod rest;
mod units;

#[cfg(feature = "readers")]
pub(crate) use answered_jumps::shown_by_readings;
pub(crate) use outliers::{ALONE_SHARE, ALONE_WITHIN, is_alone, near_a_jump, stands_out};

use super::data_set::Dataset;
use super::issue::{Issue, IssueKind, Severity};
use super::issue_words::of_kind;
use super::timing::intersample_named;
use crate::error::{Error, Result};
use hysteron_sim::chain::InitialState;

/// A check of a data set that is being made.
type Check = fn(&Dataset) -> Vec<Issue>;

/// All of them, in the order in which they correct.
const CHECKS: [Check; 10] = [
    rest::check,
    outliers::single,
    range::check,
    not_followed::check,
    outliers::together,
    units::check,
    judging::check,
    given_twice::check,
    as_specified::check,
    leading::check,
];

/// Checks a data set that is being made: what can be corrected is, check after check.
///
/// # Errors
/// What the manifest specifies and the drive contradicts.
pub(crate) fn check_made(mut dataset: Dataset) -> Result<Dataset> {
    for check in CHECKS {
        for issue in check(&dataset) {
            if issue.severity == Severity::Blocks {
                let source = dataset
                    .records
                    .iter()
                    .find(|r| Some(&r.name) == issue.record.as_ref())
                    .map_or(&dataset.source, |r| &r.source);
                return Err(Error::new(source, of_kind(&issue.kind)));
            }
            apply(&mut dataset, &issue);
            dataset.issues.push(issue);
        }
    }
    Ok(dataset)
}

/// Changes a data set as an issue asks for.
pub(crate) fn apply(dataset: &mut Dataset, issue: &Issue) {
    let Dataset { records, .. } = dataset;
    let of_the_issue = records
        .iter_mut()
        .find(|r| Some(&r.name) == issue.record.as_ref());
    match (&issue.kind, of_the_issue) {
        (IssueKind::RestWithoutNoise { in_steps: false }, _) => {
            records.retain(|r| Some(&r.name) != issue.record.as_ref())
        }
        (IssueKind::OutliersReplaced { .. }, Some(record)) => {
            outliers::interpolate(record, &issue.samples);
            record.leave_out(issue.samples.iter().cloned());
        }
        (
            IssueKind::RangeEnds { .. }
            | IssueKind::OutliersLeftOut { .. }
            | IssueKind::NotFollowed { .. },
            Some(record),
        ) => record.leave_out(issue.samples.iter().cloned()),
        (IssueKind::SensorJump { sample, by_um, .. }, Some(record)) => {
            let source = record.source.clone();
            // What the model at hand says of its height; a fit adds the rest.
            for tape in records.iter_mut().filter(|r| r.source == source) {
                let behind = tape.displacement_um.iter_mut().skip(*sample);
                behind.for_each(|reading_um| *reading_um -= by_um);
                tape.steps_at.push(*sample);
            }
        }
        (IssueKind::SensorOffset { .. }, Some(record)) => record.offset_is_fitted = true,
        // All records of the tape begin in the same state.
        (IssueKind::InitialState { .. }, Some(record)) => {
            let source = record.source.clone();
            let of_the_tape = records
                .iter_mut()
                .filter(|r| r.state_is_assumed && r.source == source);
            of_the_tape.for_each(|r| r.initial_state = InitialState::Unknown);
        }
        (IssueKind::SameSampleTiming { .. }, _) => *dataset = dataset.in_own_rows(),
        (IssueKind::RunsOnBetweenSamples { intersample, .. }, _) => {
            if let Ok(way) = intersample_named(&dataset.source, intersample) {
                *dataset = dataset.running_on(way);
            }
        }
        _ => {}
    }
}
