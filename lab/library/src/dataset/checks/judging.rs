//! Records that are not fitted beside those that are: another unit or sign, or a drive that goes further, is no
//! fault of a model.

use crate::dataset::circumstances::ALIKE;
use crate::dataset::data_set::{Dataset, FOLLOWS, straight_line};
use crate::dataset::issue::{Issue, IssueKind, Severity};
use crate::dataset::record::{Record, Role};
use std::ops::RangeInclusive;

/// A gain that differs by more is another unit or sign, where readings follow the drive in a straight line.
const GAIN_TIMES: RangeInclusive<f64> = 0.2..=5.0;

/// Compares every record that is not fitted with those that are.
pub(super) fn check(dataset: &Dataset) -> Vec<Issue> {
    let (fitted, others): (Vec<&Record>, Vec<&Record>) = dataset
        .records
        .iter()
        .filter(|record| record.role != Role::Noise)
        .partition(|record| record.role == Role::Identify);
    if fitted.is_empty() {
        return Vec::new();
    }
    let line = straight_line(&fitted);
    let range_v = range_v(&fitted);
    let gain = |record: &Record| {
        let of_record = straight_line(&[record]);
        let follow = line.share.min(of_record.share) > FOLLOWS;
        let times = of_record.gain_um_v / line.gain_um_v;
        (follow && !GAIN_TIMES.contains(&times)).then_some(IssueKind::GainDiffers {
            gain_um_v: of_record.gain_um_v,
            fitted_um_v: line.gain_um_v,
        })
    };
    let beyond = |record: &Record| {
        let free_v = ALIKE * (range_v[1] - range_v[0]);
        let drives = || record.counted().map(|k| record.drive_v[k]);
        let outside = drives().filter(|u| *u < range_v[0] - free_v || *u > range_v[1] + free_v);
        let share = outside.count() as f64 / drives().count().max(1) as f64;
        (share > ALIKE).then_some(IssueKind::BeyondFitted {
            fitted_v: range_v,
            share,
        })
    };
    let noted = |record: &&Record| {
        let judges = record.role == Role::Validate;
        let kinds = gain(record)
            .into_iter()
            .chain(judges.then(|| beyond(record)).flatten());
        let issues = kinds.map(|kind| Issue::of(&record.name, Severity::Notes, kind));
        issues.collect::<Vec<_>>()
    };
    others.iter().flat_map(noted).collect()
}

/// The lowest and the highest counted drive, V.
fn range_v(records: &[&Record]) -> [f64; 2] {
    let drives = records
        .iter()
        .flat_map(|record| record.counted().map(|k| record.drive_v[k]));
    drives.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], u| {
        [low.min(u), high.max(u)]
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn record(name: &str, role: Role, high_v: f64, gain: f64) -> Record {
        let drive_v: Vec<f64> = (0..3000)
            .map(|k| 0.5 * high_v * (1.0 - (0.0126 * f64::from(k)).cos()))
            .collect();
        let displacement_um = drive_v.iter().map(|u| gain * u).collect();
        Record {
            role,
            ..Record::new(name, 1000.0, drive_v, displacement_um)
        }
    }

    fn kinds(judging: Record) -> Vec<IssueKind> {
        let fitted = record("one", Role::Identify, 80.0, 0.1);
        let dataset = Dataset::unchecked("d", 0.0, 100.0, vec![fitted, judging]);
        check(&dataset).into_iter().map(|i| i.kind).collect()
    }

    #[test]
    fn another_unit_and_another_sign_are_noted() {
        for gain in [-0.1, 0.0001, 100.0] {
            let found = kinds(record("two", Role::Validate, 80.0, gain));
            assert!(
                matches!(found[..], [IssueKind::GainDiffers { .. }]),
                "{found:?}"
            );
        }
        assert_eq!(kinds(record("two", Role::Validate, 80.0, 0.14)), []);
    }

    #[test]
    fn a_drive_beyond_what_was_fitted_is_noted_with_its_share() {
        let found = kinds(record("two", Role::Validate, 100.0, 0.1));
        let [IssueKind::BeyondFitted { fitted_v, share }] = found[..] else {
            panic!("{found:?}")
        };
        assert!((fitted_v[1] - 80.0).abs() < 0.1 && (0.2..0.35).contains(&share));
        assert_eq!(kinds(record("two", Role::Validate, 82.0, 0.1)), []);
    }
}
