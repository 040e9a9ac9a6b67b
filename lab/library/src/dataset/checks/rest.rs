//! Rests in which all readings are one value: of a converter with steps they show that the noise is below a
//! step, otherwise nothing.

use crate::dataset::data_set::{Dataset, SAMPLES_MIN};
use crate::dataset::issue::{Issue, IssueKind, Severity};
use crate::dataset::reading_grid;
use crate::dataset::record::{Record, Role};

/// Finds them; one that shows nothing is to be left out.
pub(super) fn check(dataset: &Dataset) -> Vec<Issue> {
    let moves = |r: &Record| {
        r.displacement_um[r.window.clone()]
            .windows(2)
            .any(|y| y[0] != y[1])
    };
    // What is too short for a record is refused, and shows nothing.
    let silent = |r: &&Record| r.role == Role::Noise && r.window.len() >= SAMPLES_MIN && !moves(r);
    let silent: Vec<&Record> = dataset.records.iter().filter(silent).collect();
    if silent.is_empty() {
        return Vec::new();
    }
    let in_steps = reading_grid::reading_step_um(dataset).is_some();
    let severity = if in_steps {
        Severity::Notes
    } else {
        Severity::Corrects
    };
    silent
        .into_iter()
        .map(|r| Issue::of(&r.name, severity, IssueKind::RestWithoutNoise { in_steps }))
        .collect()
}
