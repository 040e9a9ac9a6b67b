//! Brings records to the one timing of the program.

#[cfg(feature = "readers")]
use super::checks::shown_by_readings;
use super::data_set::Dataset;
#[cfg(feature = "readers")]
use super::issue::Issue;
use super::record::Record;
use super::timing::Timing;
use hysteron_sim::chain::InitialState;
use hysteron_sim::intersample::Intersample;

/// Brings the records of one data set to the one timing. What is not specified is taken from the records: one
/// that leads shows that the logger reads after it writes, and so do the others, which may be too slow to
/// show it. Gives an issue where the records showed it themselves.
#[cfg(feature = "readers")]
pub(super) fn bring_to_one_timing(records: &mut [Record], said: Option<Timing>) -> Option<Issue> {
    let issue = match said {
        Some(Timing::HoldAfterSample) => return None,
        Some(Timing::HoldBeforeSample) => None,
        None => Some(records.iter().find_map(shown_by_readings)?),
    };
    records.iter_mut().for_each(moved_up);
    issue
}

impl Dataset {
    /// The same readings with a drive that does this between its samples.
    #[must_use]
    pub fn running_on(&self, intersample: Intersample) -> Self {
        let mut out = self.clone();
        out.records
            .iter_mut()
            .for_each(|record| record.intersample = intersample);
        (out.timing_is_assumed, out.intersample_is_assumed) = (false, false);
        out
    }

    /// The same readings, with same-sample timing (`hold_before_sample`).
    #[must_use]
    pub fn in_own_rows(&self) -> Self {
        let mut out = self.clone();
        out.records.iter_mut().for_each(moved_up);
        (out.timing, out.timing_is_assumed) = (Timing::HoldBeforeSample, false);
        out
    }
}

/// Each drive stands in the row from which on it acts; the last row, whose drive is not known, goes.
fn moved_up(record: &mut Record) {
    let samples = record.drive_v.len() - 1;
    record.drive_v.remove(0);
    // The first reading answers a drive that is gone with its row, unless the stage has never been driven.
    if record.initial_state != InitialState::Virgin {
        record.window.start = record.window.start.max(1);
    }
    record.displacement_um.truncate(samples);
    record
        .force_n
        .iter_mut()
        .for_each(|force_n| force_n.truncate(samples));
    record.auxiliary = record
        .auxiliary
        .iter()
        .map(|signal| signal.with(|values| values[..samples].to_vec()))
        .collect();
    record.window.end = record.window.end.min(samples);
    record
        .left_out
        .iter_mut()
        .for_each(|range| range.end = range.end.min(samples));
    record.left_out.retain(|range| !range.is_empty());
    record.periods = record.periods.take().and_then(|mut p| {
        p.count = p.count.min((samples - p.from.min(samples)) / p.length);
        (p.count > 0).then_some(p)
    });
}

#[cfg(all(test, feature = "readers"))]
mod tests {
    use super::*;
    use crate::dataset::issue::IssueKind;

    /// A stage that answers within a sample, read after (1) or before (0) the drive of the row acts.
    fn record(name: &str, rad_per_sample: f64, read_after: usize) -> Record {
        let u = |k: usize| 5.0 - 5.0 * (rad_per_sample * k as f64).cos();
        let noise = |k: usize| 0.01 * (k as f64 * 78.233).sin();
        let y = (0..500).map(|k| 0.1 * u((k + read_after).saturating_sub(1)) + noise(k));
        Record::new(name, 1000.0, (0..500).map(u).collect(), y.collect())
    }

    #[test]
    fn one_record_that_leads_speaks_for_the_slow_ones() {
        let mut records = [record("slow", 1e-3, 1), record("fast", 0.3, 1)];
        let issue = bring_to_one_timing(&mut records, None).unwrap();
        assert_eq!(
            (issue.record.as_deref(), &issue.kind),
            (Some("fast"), &IssueKind::TimingInReadings { jumps: None })
        );
        for record in &records {
            assert_eq!(
                (
                    record.drive_v.len(),
                    record.displacement_um.len(),
                    record.window.end
                ),
                (499, 499, 499)
            );
        }
        let fast = &records[1];
        assert!(
            (1..499).all(|k| (fast.displacement_um[k] - 0.1 * fast.drive_v[k - 1]).abs() < 0.011)
        );
        assert_eq!(shown_by_readings(fast), None);
    }

    #[test]
    fn what_follows_its_drive_is_left_alone_and_what_was_said_holds() {
        let mut records = [record("right", 0.3, 0)];
        assert_eq!(bring_to_one_timing(&mut records, None), None);
        assert_eq!(records[0].drive_v.len(), 500);
        let mut leading = [record("leads", 0.3, 1)];
        assert_eq!(
            bring_to_one_timing(&mut leading, Some(Timing::HoldAfterSample)),
            None
        );
        assert_eq!(leading[0].drive_v.len(), 500);
        assert_eq!(
            bring_to_one_timing(&mut records, Some(Timing::HoldBeforeSample)),
            None
        );
        assert_eq!(records[0].drive_v.len(), 499);
    }
}
