//! Does the displacement lead the drive? One that was read before the drive acted follows the drive of the row
//! before.

use crate::dataset::data_set::Dataset;
use crate::dataset::issue::{Issue, IssueKind, Severity};
use crate::dataset::record::{Record, Role};
use hysteron_sim::intersample::Intersample;

/// A reading that leaves this share of the squared error against the drive of its own instant has not waited
/// for the drive to act.
const LEADING_SHARE: f64 = 0.3;

/// The displacement responds to the drive of the same row much better than that of the row before.
pub(super) fn leads(record: &Record) -> bool {
    let from = record.window.start.max(1);
    let left_by = |delay: usize| {
        left_by_straight_line(
            (from..record.window.end)
                .map(|k| (record.drive_v[k - delay], record.displacement_um[k])),
        )
    };
    left_by(0) < LEADING_SHARE * left_by(1)
}

/// A straight line shows the timing of the same row, and another one was specified.
pub(super) fn check(dataset: &Dataset) -> Vec<Issue> {
    let driven = dataset
        .records
        .iter()
        .filter(|r| r.role != Role::Noise && r.intersample == Intersample::Hold && leads(r));
    driven
        .map(|r| Issue::of(&r.name, Severity::Notes, IssueKind::LeadsTheDrive {}))
        .collect()
}

/// Sum of squares about the regression line.
fn left_by_straight_line(pairs: impl ExactSizeIterator<Item = (f64, f64)> + Clone) -> f64 {
    let n = pairs.len().max(1) as f64;
    let (mean_x, mean_y) = pairs
        .clone()
        .fold((0.0, 0.0), |(x, y), p| (x + p.0 / n, y + p.1 / n));
    let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
    for (x, y) in pairs.map(|p| (p.0 - mean_x, p.1 - mean_y)) {
        xx += x * x;
        xy += x * y;
        yy += y * y;
    }
    if xx > 0.0 { yy - xy * xy / xx } else { yy }
}
