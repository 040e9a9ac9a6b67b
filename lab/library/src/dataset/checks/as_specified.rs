//! What the manifest specifies, held against the drive: that its periods are equal, that two records have the
//! same, that a record is at rest. The noise is estimated from that, and a wrong specification takes motion
//! for noise.

use crate::dataset::data_set::Dataset;
use crate::dataset::issue::{Issue, IssueKind, Severity};
use crate::dataset::record::{Record, Role};
use crate::statistics::{mean, pattern_rms, peak_to_peak, rms};

/// Two drives are not the same where they differ, beside what is irregular from sample to sample, by more
/// than this share of what they move.
const DIFFERS: f64 = 0.02;
/// A drive at rest moves by less than this share of the actuator's range; an idle amplifier drifts.
const RESTS: f64 = 0.02;
/// Parts of a record whose means say whether it rests: noise with which a drive was read back is not in them.
const PARTS: usize = 64;

/// Checks every record against its own drive and that of the one which it repeats.
pub(super) fn check(dataset: &Dataset) -> Vec<Issue> {
    let span_v = dataset.drive_max_v - dataset.drive_min_v;
    let of_record = |record: &Record| {
        let repeated = dataset
            .records
            .iter()
            .find(|other| record.repeat_of.as_ref() == Some(&other.name));
        let found = [
            rest(record, span_v),
            periods(record),
            repeated.and_then(|other| repeat(record, other)),
        ];
        found
            .into_iter()
            .flatten()
            .map(|kind| Issue::of(&record.name, Severity::Blocks, kind))
            .collect::<Vec<_>>()
    };
    let judges = dataset.records.iter().any(|r| r.role == Role::Identify);
    let nothing_judges =
        (!judges).then(|| Issue::of_all(Severity::Notes, IssueKind::NothingJudges {}));
    dataset
        .records
        .iter()
        .flat_map(of_record)
        .chain(nothing_judges)
        .collect()
}

fn rest(record: &Record, span_v: f64) -> Option<IssueKind> {
    if record.role != Role::Noise {
        return None;
    }
    let drive_v = &record.drive_v[record.window.clone()];
    let means_v: Vec<f64> = drive_v
        .chunks(drive_v.len().div_ceil(PARTS))
        .map(mean)
        .collect();
    let moves_v = peak_to_peak(&means_v);
    (moves_v > RESTS * span_v).then_some(IssueKind::NotAtRest { moves_v })
}

fn periods(record: &Record) -> Option<IssueKind> {
    let p = record.periods.filter(|p| p.count >= 2)?;
    let whole = p.from..p.from + p.count * p.length;
    let pairs =
        (p.from..whole.end - p.length).map(|k| (record.drive_v[k], record.drive_v[k + p.length]));
    let (drive_v, differs_v) = differing(pairs, &record.drive_v[whole])?;
    Some(IssueKind::PeriodsDiffer {
        period_s: p.length as f64 * record.dt_s(),
        drive_v,
        differs_v,
    })
}

fn repeat(record: &Record, other: &Record) -> Option<IssueKind> {
    let both = record.window.start.max(other.window.start)..record.window.end.min(other.window.end);
    let pairs = both.clone().map(|k| (record.drive_v[k], other.drive_v[k]));
    let (drive_v, differs_v) = differing(pairs, &record.drive_v[both.clone()])?;
    Some(IssueKind::RepeatDiffers {
        repeat_of: other.name.clone(),
        drive_v,
        differs_v,
    })
}

/// How much a drive moves and by how much it differs, V RMS, if that is more than noise.
fn differing(pairs: impl Iterator<Item = (f64, f64)>, drive_v: &[f64]) -> Option<(f64, f64)> {
    let differences_v: Vec<f64> = pairs.map(|(a, b)| b - a).collect();
    let steps_v: Vec<f64> = differences_v.windows(2).map(|w| w[1] - w[0]).collect();
    let middle_v = mean(drive_v);
    let moves_v = rms(&drive_v.iter().map(|u| u - middle_v).collect::<Vec<_>>());
    let pattern_v = pattern_rms(&differences_v, &steps_v);
    (pattern_v > DIFFERS * moves_v).then_some((moves_v, pattern_v))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::record::Periods;
    use crate::error::Result;

    const LENGTH: usize = 500;

    fn wave(k: usize) -> f64 {
        50.0 + 20.0 * (std::f64::consts::TAU * k as f64 / LENGTH as f64).sin()
    }

    fn record(name: &str, drive: impl Fn(usize) -> f64) -> Record {
        let mut noise = hysteron_sim::noise::WhiteNoise::new(0.02, 3);
        let drive_v: Vec<f64> = (0..6 * LENGTH)
            .map(|k| drive(k) + noise.next_um())
            .collect();
        let displacement_um = drive_v.iter().map(|u| 0.1 * u).collect();
        Record::new(name, 1000.0, drive_v, displacement_um)
    }

    fn dataset(records: Vec<Record>) -> Result<Dataset> {
        Dataset::new("d", 0.0, 100.0, records)
    }

    #[test]
    fn what_is_said_of_a_drive_must_be_so() {
        let periodic = |length| Record {
            periods: Some(Periods {
                from: 0,
                length,
                count: 3,
            }),
            ..record("one", wave)
        };
        assert!(dataset(vec![periodic(LENGTH)]).is_ok());
        let refused = dataset(vec![periodic(LENGTH - 50)])
            .unwrap_err()
            .to_string();
        assert!(
            refused.contains("period_s") && refused.contains("expects equal periods"),
            "{refused}"
        );
        let repeat = |drive: fn(usize) -> f64| Record {
            repeat_of: Some("one".into()),
            ..record("two", drive)
        };
        assert!(dataset(vec![record("one", wave), repeat(wave)]).is_ok());
        let refused = dataset(vec![record("one", wave), repeat(|k| wave(k + 30))])
            .unwrap_err()
            .to_string();
        assert!(
            refused.contains("repeat_of") && refused.contains("expects the same drive"),
            "{refused}"
        );
        let rest = |drive: fn(usize) -> f64| record("rest", drive).with_role(Role::Noise);
        assert!(dataset(vec![record("one", wave), rest(|_| 3.0)]).is_ok());
        let refused = dataset(vec![record("one", wave), rest(wave)])
            .unwrap_err()
            .to_string();
        assert!(refused.contains("expects a record at rest"), "{refused}");
    }
}
