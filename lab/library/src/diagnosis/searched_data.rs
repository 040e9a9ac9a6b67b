//! The part of the data on which a search runs.
//!
//! Every set of effects walks the fitted records some thirty times, from their first sample on. A record that
//! begins at rest in a state that nobody knows may as well begin just before its window: what the rest left
//! in creep or in a ring is estimated in either case. Records that are very long are searched on their
//! beginnings; the models at the end are fitted and judged on everything. Where even that is more than the
//! evidence needs ([`Policy::weighed_samples`](super::policy::Policy)), everything is decided on beginnings,
//! and the last model alone is fitted to the whole.

use crate::dataset::{Dataset, Record, Role};
use hysteron_sim::chain::InitialState;

/// Samples at rest that are kept in front of a window.
const KEPT_AT_REST: usize = 100;

/// The data without samples that decide nothing while searching; fitted records walk about `walked_samples`
/// at most.
#[must_use]
pub(super) fn for_search(dataset: &Dataset, walked_samples: usize) -> Dataset {
    let mut out = dataset.clone();
    let judging = |r: &&mut Record| matches!(r.role, Role::Identify | Role::Validate);
    out.records
        .iter_mut()
        .filter(judging)
        .for_each(without_rest_before);
    let fitted = if dataset.with_role(Role::Identify).is_empty() {
        Role::Validate
    } else {
        Role::Identify
    };
    let walked: usize = out
        .records
        .iter()
        .filter(|r| r.role == fitted)
        .map(|r| r.window.end)
        .sum();
    if walked > walked_samples {
        let share = walked_samples as f64 / walked as f64;
        out.records
            .iter_mut()
            .filter(judging)
            .for_each(|record| shorten(record, share));
    }
    out
}

/// The beginnings of all records that are fitted or judge, where there is more than the evidence needs: of
/// every record the same share.
pub fn for_evidence(dataset: &Dataset, weighed_samples: usize) -> Option<Dataset> {
    let takes_part = |r: &Record| matches!(r.role, Role::Identify | Role::Validate);
    let samples: usize = dataset
        .records
        .iter()
        .filter(|r| takes_part(r))
        .map(|r| r.window.len())
        .sum();
    let share = weighed_samples as f64 / samples.max(1) as f64;
    (share < 1.0).then(|| {
        let mut out = dataset.clone();
        out.records
            .iter_mut()
            .filter(|r| takes_part(r))
            .for_each(|record| shorten(record, share));
        out
    })
}

fn without_rest_before(record: &mut Record) {
    if record.initial_state != InitialState::Unknown
        || record.force_n.is_some()
        || !record.auxiliary.is_empty()
    {
        return;
    }
    let first = record.drive_v[0];
    let at_rest = record.drive_v.iter().take_while(|u| **u == first).count();
    let cut = at_rest
        .min(record.window.start)
        .saturating_sub(KEPT_AT_REST);
    record.drive_v.drain(..cut);
    record.displacement_um.drain(..cut);
    record.window = record.window.start - cut..record.window.end - cut;
    record
        .left_out
        .iter_mut()
        .for_each(|range| *range = range.start.saturating_sub(cut)..range.end.saturating_sub(cut));
    record.left_out.retain(|range| !range.is_empty());
    record.periods = None;
}

fn shorten(record: &mut Record, share: f64) {
    let beginning = |part: &std::ops::Range<usize>| {
        part.start
            ..part.start
                + ((part.len() as f64 * share) as usize)
                    .max(1000)
                    .min(part.len())
    };
    let parts = parts_of(record);
    let kept: Vec<_> = parts.iter().map(beginning).collect();
    let end = kept.last().map_or(record.window.end, |last| last.end);
    // Of each part the beginning, so that every kind of motion stays.
    let not_kept: Vec<_> = kept
        .iter()
        .zip(kept.iter().skip(1))
        .map(|(before, after)| before.end..after.start)
        .collect();
    record.leave_out(not_kept);
    record.drive_v.truncate(end);
    record.displacement_um.truncate(end);
    if let Some(force) = &mut record.force_n {
        force.truncate(end);
    }
    record
        .auxiliary
        .iter_mut()
        .for_each(|signal| signal.values.truncate(end));
    record.window.end = end;
    record.left_out.retain(|range| range.start < end);
    record
        .left_out
        .iter_mut()
        .for_each(|range| range.end = range.end.min(end));
    record.periods = None;
}

/// Samples that are left out together between two parts of a tape, at least; fewer are a sensor's limit or a
/// disturbance.
const BETWEEN_PARTS: f64 = 0.02;

/// The parts of a tape that count: what is between long stretches that do not.
fn parts_of(record: &Record) -> Vec<std::ops::Range<usize>> {
    let long = |range: &std::ops::Range<usize>| {
        range.len() as f64 > BETWEEN_PARTS * record.window.len() as f64
    };
    let gaps: Vec<_> = record.left_out_in_window().filter(long).collect();
    let starts = std::iter::once(record.window.start).chain(gaps.iter().map(|gap| gap.end));
    let ends = gaps.iter().map(|gap| gap.start).chain([record.window.end]);
    starts
        .zip(ends)
        .map(|(start, end)| start..end)
        .filter(|part| !part.is_empty())
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::identification::linearisation::fill_left_out;

    fn record(initial_state: InitialState) -> Record {
        let drive: Vec<f64> = (0..5000_usize)
            .map(|k| k.saturating_sub(2000) as f64 * 1e-3)
            .collect();
        let mut record = Record::new("a", 1000.0, drive.clone(), drive);
        record.initial_state = initial_state;
        record.window = 1900..5000;
        record
    }

    #[test]
    fn only_rest_in_front_of_a_window_is_left_out_and_only_where_the_state_is_unknown() {
        let mut data = Dataset::new("d", 0.0, 5.0, vec![record(InitialState::Unknown)]).unwrap();
        let cut = for_search(&data, usize::MAX);
        assert_eq!(cut.records[0].window, KEPT_AT_REST..KEPT_AT_REST + 3100);
        assert_eq!(
            cut.records[0].displacement_um[cut.records[0].window.start],
            data.records[0].displacement_um[1900]
        );
        data.records[0].initial_state = InitialState::Virgin;
        assert_eq!(for_search(&data, usize::MAX).records[0].window, 1900..5000);
    }

    /// A spike long before the window, another one at its beginning.
    #[test]
    fn spikes_in_front_of_a_window_go_with_the_rest_there() {
        let mut spoilt = record(InitialState::Unknown);
        spoilt.leave_out([100..101, 1895..1902]);
        let data = Dataset::new("d", 0.0, 5.0, vec![spoilt]).unwrap();
        let cut = &for_search(&data, usize::MAX).records[0];
        let start = cut.window.start;
        assert_eq!(cut.left_out, vec![start - 5..start + 2]);
        assert_eq!(parts_of(cut), vec![cut.window.clone()]);
        let mut values = vec![1.0; cut.window.len()];
        fill_left_out(cut, &mut values, 0.0);
        assert_eq!(values.iter().filter(|v| **v == 0.0).count(), 2);
    }

    #[test]
    fn long_records_are_searched_on_their_beginnings() {
        let data = Dataset::new("d", 0.0, 5.0, vec![record(InitialState::Virgin)]).unwrap();
        let cut = for_search(&data, 2500);
        assert_eq!(cut.records[0].window.start, 1900);
        assert_eq!(cut.records[0].drive_v.len(), cut.records[0].window.end);
        assert!(cut.records[0].window.len() < 1700);
    }
}
