//! The quality of a recording: what is wrong with how it was made, as a search or a model shows it. What a data
//! set shows by itself, it has found when it was made ([`crate::dataset::issue`]).
//!
//! Every check is one file with one signature ([`Check`]). It gives [`Issue`]s: a kind with its figures, the
//! record, and what follows from it ([`Severity`](crate::dataset::issue::Severity)).
//!
//! The same list of checks runs at every [`Moment`]: before a search, at its first fits, and once after it.
//! Each check answers where it can. What a check at the end corrects goes through one more search
//! ([`corrected`]).

mod answer;
mod between_samples;
mod closed_loop;
mod initial_state;
mod remembered_history;
mod sensor_jump;
mod sensor_offset;
mod subject;
mod timing;

pub use subject::{End, Moment, Subject};

use crate::dataset::Dataset;
use crate::dataset::checks::apply;
use crate::dataset::issue::{Issue, Severity};

/// A check of the quality.
pub type Check = fn(&Subject) -> Vec<Issue>;

/// All checks: of two that explain the same error the simpler one stands first.
const CHECKS: [Check; 8] = [
    answer::check,
    sensor_jump::check,
    between_samples::check,
    timing::check,
    sensor_offset::check,
    initial_state::check,
    closed_loop::check,
    remembered_history::check,
];

/// All issues at a moment; up to the first that asks for another search, after which all checks run again.
#[must_use]
pub fn issues(dataset: &Dataset, moment: Moment) -> Vec<Issue> {
    let mut out: Vec<Issue> = Vec::new();
    for check in CHECKS {
        out.extend(check(&Subject { dataset, moment }));
        if out.iter().any(Issue::asks_for_another_search) {
            break;
        }
    }
    out
}

/// The data set with the issues of a finished search corrected: what one more search is for. None where
/// nothing can be.
#[must_use]
pub fn corrected(dataset: &Dataset, issues: &[Issue]) -> Option<Dataset> {
    let mut out = dataset.clone();
    for issue in issues
        .iter()
        .filter(|issue| issue.asks_for_another_search())
    {
        apply(&mut out, issue);
        out.issues.push(Issue {
            severity: Severity::Corrects,
            ..issue.clone()
        });
    }
    (out.issues.len() > dataset.issues.len()).then_some(out)
}
