//! Records that hold the same readings as one before them.

use crate::dataset::data_set::Dataset;
use crate::dataset::issue::{Issue, IssueKind, Severity};
use crate::dataset::record::{Record, Role};

/// Compares every driven record with those before it.
pub(super) fn check(dataset: &Dataset) -> Vec<Issue> {
    let driven: Vec<&Record> = dataset
        .records
        .iter()
        .filter(|r| r.role != Role::Noise)
        .collect();
    // One file may be several records, each with a window of its own.
    let same = |a: &Record, b: &Record| {
        let both = a.window.start.max(b.window.start)..a.window.end.min(b.window.end);
        let mut counted = both.filter(|k| a.counts(*k) && b.counts(*k)).peekable();
        counted.peek().is_some()
            && a.sample_rate_hz == b.sample_rate_hz
            && counted.all(|k| a.displacement_um[k] == b.displacement_um[k])
    };
    let before = |(i, record): (usize, &&Record)| {
        let earlier = driven[..i].iter().find(|earlier| same(earlier, record))?;
        Some(Issue::of(
            &record.name,
            Severity::Notes,
            IssueKind::GivenTwice {
                same_as: earlier.name.clone(),
            },
        ))
    };
    driven.iter().enumerate().filter_map(before).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_recording_given_twice_is_noted() {
        let record = |name: &str, window| {
            let drive_v: Vec<f64> = (0..3000)
                .map(|k| 50.0 + 20.0 * (0.0126 * f64::from(k)).sin())
                .collect();
            let displacement_um = drive_v.iter().map(|u| 0.1 * u).collect();
            Record {
                window,
                ..Record::new(name, 1000.0, drive_v, displacement_um)
            }
        };
        let issues = |windows: [std::ops::Range<usize>; 2]| {
            let [one, two] = windows;
            let dataset = Dataset::unchecked(
                "d",
                0.0,
                100.0,
                vec![record("one", one), record("two", two)],
            );
            check(&dataset)
        };
        assert_eq!(
            issues([0..3000, 0..3000]),
            [Issue::of(
                "two",
                Severity::Notes,
                IssueKind::GivenTwice {
                    same_as: "one".into()
                }
            )]
        );
        assert_eq!(issues([0..1500, 1500..3000]), []);
    }
}
