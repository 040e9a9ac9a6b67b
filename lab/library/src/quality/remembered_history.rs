//! How long the loops of a record remember what was before it.
//!
//! An unknown state leaves creep and modes free, but not what loops remember: that is known once the drive
//! has been through its range.

use super::subject::{Moment, Subject};
use crate::dataset::issue::{Issue, IssueKind, Severity};
use crate::dataset::{Record, Role};
use crate::statistics::extremes;
use hysteron_sim::chain::InitialState;

/// Share of a range at whose end a drive that is so near counts as being there.
const AT_AN_END: f64 = 0.02;
/// Share of a window in which loops still remember what was before the record that is worth a word.
const REMEMBERED: f64 = 0.1;

/// When the drive of a record has first been through its whole range, in s from its first sample, and how
/// long the record goes on then, where it begins inside that range in a state that nobody knows and much of
/// its window comes before: until then its loops remember what no sample shows (wiping out, thesis Ch. 4).
fn remembers_until_s(record: &Record) -> Option<[f64; 2]> {
    let (low, high) = extremes(&record.drive_v);
    let near = AT_AN_END * (high - low);
    let (bottom, top) = (low + near, high - near);
    if record.initial_state != InitialState::Unknown
        || record.drive_v[0] <= bottom
        || record.drive_v[0] >= top
    {
        return None;
    }
    let first = |there: &dyn Fn(f64) -> bool| record.drive_v.iter().position(|v| there(*v));
    let swept = first(&|v| v <= bottom)?.max(first(&|v| v >= top)?);
    let remembered = swept.saturating_sub(record.window.start) as f64;
    (remembered > REMEMBERED * record.window.len() as f64).then(|| {
        [swept, record.window.end.saturating_sub(swept)]
            .map(|samples| samples as f64 * record.dt_s())
    })
}

/// Examines every record that is fitted or judges, whatever model came out: where loops are missing, creep may
/// stand for them because of such a beginning.
pub(super) fn check(subject: &Subject) -> Vec<Issue> {
    if !matches!(subject.moment, Moment::BeforeSearch) {
        return Vec::new();
    }
    let judges = |r: &&Record| matches!(r.role, Role::Identify | Role::Validate);
    let issue = |record: &Record| {
        let [until_s, left_s] = remembers_until_s(record)?;
        Some(Issue::of(
            &record.name,
            Severity::Notes,
            IssueKind::RememberedHistory { until_s, left_s },
        ))
    };
    subject
        .dataset
        .records
        .iter()
        .filter(judges)
        .filter_map(issue)
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn loops_remember_what_was_before_until_the_range_has_been_swept() {
        let record = |corners: &[f64], state| {
            let line = |w: &[f64]| {
                let (from, to) = (w[0], w[1]);
                (0..100).map(move |k| from + (to - from) * f64::from(k) / 100.0)
            };
            let drive: Vec<f64> = corners.windows(2).flat_map(line).collect();
            let mut record = Record::new("r", 1000.0, drive.clone(), drive);
            record.initial_state = state;
            record
        };
        let (unknown, virgin) = (InitialState::Unknown, InitialState::Virgin);
        let growing = [5.0, 6.0, 4.0, 8.0, 2.0, 10.0, 0.0, 5.0];
        let [until_s, left_s] = remembers_until_s(&record(&growing, unknown)).unwrap();
        assert!(
            (0.59..0.6).contains(&until_s) && (until_s + left_s - 0.7).abs() < 1e-9,
            "{until_s} {left_s}"
        );
        // From an end, from a state that is known, behind a sweep.
        assert_eq!(
            remembers_until_s(&record(&[0.0, 6.0, 4.0, 8.0, 2.0, 10.0], unknown)),
            None
        );
        assert_eq!(remembers_until_s(&record(&growing, virgin)), None);
        let mut swept_before = record(&growing, unknown);
        swept_before.window.start = 600;
        assert_eq!(remembers_until_s(&swept_before), None);
        // Nothing needs to be found first.
        let records = vec![record(&growing, unknown)];
        let dataset = crate::Dataset::new("t", 0.0, 10.0, records).unwrap();
        let subject = Subject {
            dataset: &dataset,
            moment: Moment::BeforeSearch,
        };
        assert_eq!(check(&subject).len(), 1);
    }
}
