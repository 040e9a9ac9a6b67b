//! Readings that stand still at their highest or lowest value while the drive moves on: the range of the
//! sensor or of its converter ends there.
//!
//! An amplifier that cannot give more holds the stage, and the sensor's noise goes on; a converter at its end
//! reads the same value, digit by digit. What it reads there says only that the displacement is beyond: such
//! samples are left out of fits, noise and figures.

use crate::dataset::data_set::Dataset;
use crate::dataset::issue::{Issue, IssueKind, Severity};
use crate::dataset::record::{Record, Role};
use crate::statistics::{extremes, peak_to_peak};
use std::ops::Range;

/// Readings in a row that stand still at least.
const RUN_MIN: usize = 8;
/// Readings that stand still at a limit are at least so many times as many in a row as anywhere else.
const LONGER_THAN_ELSEWHERE: usize = 4;
/// Share of its range by which the drive moves meanwhile, at least.
const DRIVE_MOVES: f64 = 0.01;

/// A limit at which readings stand still.
#[derive(Clone, Debug, PartialEq)]
struct ReadingLimit {
    record: String,
    reading_um: f64,
    /// It is the highest; the lowest otherwise.
    highest: bool,
    samples: usize,
    share: f64,
}

/// The limits of all driven records: those that a record shows by itself, and the same values in the others,
/// which the same sensor read. Where another record reads further and does not end, it was not the sensor
/// that ended.
pub(super) fn check(dataset: &Dataset) -> Vec<Issue> {
    let records = &dataset.records;
    let issue = |limit: ReadingLimit| {
        let ReadingLimit {
            record: name,
            reading_um,
            highest,
            samples,
            share,
        } = limit;
        // A filter or an interpolation mixes what stands at the limit into the readings beside it.
        let with_neighbours = |run: Range<usize>, of: &Range<usize>| {
            run.start.saturating_sub(1).max(of.start)..(run.end + 1).min(of.end)
        };
        let there = |record: &Record| {
            runs_of_equals(record)
                .filter(|run| record.displacement_um[run.start] == reading_um)
                .map(|run| with_neighbours(run, &record.window))
                .collect()
        };
        let left_out = records
            .iter()
            .find(|r| r.name == name)
            .map_or_else(Vec::new, there);
        Issue::of(
            name,
            Severity::Corrects,
            IssueKind::RangeEnds {
                reading_um,
                highest,
                samples,
                share,
            },
        )
        .with_samples(left_out)
    };
    limits_of_all(records).into_iter().map(issue).collect()
}

/// The readings at which the sensor's range ends, in any record.
pub(super) fn ends_um(records: &[Record]) -> Vec<f64> {
    limits_of_all(records)
        .iter()
        .map(|limit| limit.reading_um)
        .collect()
}

fn limits_of_all(records: &[Record]) -> Vec<ReadingLimit> {
    let driven: Vec<&Record> = records
        .iter()
        .filter(|record| record.role != Role::Noise)
        .collect();
    let own: Vec<Vec<ReadingLimit>> = driven.iter().map(|record| limits_of(record)).collect();
    let ends = |i: usize, highest: bool| own[i].iter().any(|limit| limit.highest == highest);
    let range_um: Vec<(f64, f64)> = driven
        .iter()
        .map(|r| extremes(&r.displacement_um[r.window.clone()]))
        .collect();
    let read_further = |limit: &ReadingLimit| {
        (0..driven.len()).any(|i| {
            let (lowest, highest) = range_um[i];
            let further = if limit.highest {
                highest > limit.reading_um
            } else {
                lowest < limit.reading_um
            };
            further && !ends(i, limit.highest)
        })
    };
    let true_ends: Vec<&ReadingLimit> = own
        .iter()
        .flatten()
        .filter(|limit| !read_further(limit))
        .collect();
    let in_record = |record: &Record, (lowest, highest): (f64, f64)| -> Vec<ReadingLimit> {
        let at = |is_highest: bool, reading_um: f64| {
            let known = true_ends
                .iter()
                .any(|limit| limit.highest == is_highest && limit.reading_um == reading_um);
            known.then(|| limit_at(record, reading_um, is_highest))
        };
        [at(false, lowest), at(true, highest)]
            .into_iter()
            .flatten()
            .collect()
    };
    driven
        .iter()
        .zip(&range_um)
        .flat_map(|(record, range)| in_record(record, *range))
        .collect()
}

/// A record's readings at a value where they end.
fn limit_at(record: &Record, reading_um: f64, highest: bool) -> ReadingLimit {
    let samples = record
        .window
        .clone()
        .filter(|k| record.displacement_um[*k] == reading_um)
        .count();
    let share = samples as f64 / record.window.len() as f64;
    ReadingLimit {
        record: record.name.clone(),
        reading_um,
        highest,
        samples,
        share,
    }
}

/// The limits that a record shows by itself.
fn limits_of(record: &Record) -> Vec<ReadingLimit> {
    let readings_um = &record.displacement_um;
    let (lowest, highest) = extremes(&readings_um[record.window.clone()]);
    let at = |reading_um: f64| move |run: &Range<usize>| readings_um[run.start] == reading_um;
    // A drive that rests says nothing of where readings end, and a coarse converter reads one code meanwhile.
    let while_moving = |run: &Range<usize>| {
        record.drive_v[run.clone()]
            .windows(2)
            .filter(|u| u[0] != u[1])
            .count()
    };
    let long = || runs_of_equals(record).filter(|run| while_moving(run) >= RUN_MIN);
    let elsewhere = long()
        .filter(|run| !at(lowest)(run) && !at(highest)(run))
        .map(|run| while_moving(&run))
        .max()
        .unwrap_or(0);
    let moves_v = DRIVE_MOVES * peak_to_peak(&record.drive_v[record.window.clone()]);
    let stands_still = |run: Range<usize>| {
        while_moving(&run) >= LONGER_THAN_ELSEWHERE * elsewhere
            && peak_to_peak(&record.drive_v[run]) > moves_v
    };
    let limit = |reading_um: f64| {
        long()
            .filter(at(reading_um))
            .any(stands_still)
            .then(|| limit_at(record, reading_um, reading_um == highest))
    };
    [lowest, highest].into_iter().filter_map(limit).collect()
}

/// Where readings inside the window are the same as the one before, digit by digit, one run after the other.
fn runs_of_equals(record: &Record) -> impl Iterator<Item = Range<usize>> + '_ {
    let (mut from, end) = (record.window.start, record.window.end);
    std::iter::from_fn(move || {
        let first = record.displacement_um[from..end].first()?;
        let run = from..from
            + record.displacement_um[from..end]
                .iter()
                .take_while(|y| *y == first)
                .count();
        from = run.end;
        Some(run)
    })
}
#[cfg(test)]
mod tests {
    use super::*;
    use hysteron_sim::noise::WhiteNoise;

    /// What making a data set finds.
    fn reading_limits(dataset: &Dataset) -> Vec<ReadingLimit> {
        let limit = |issue: &Issue| match (&issue.kind, &issue.record) {
            (
                IssueKind::RangeEnds {
                    reading_um,
                    highest,
                    samples,
                    share,
                },
                Some(record),
            ) => Some(ReadingLimit {
                record: record.clone(),
                reading_um: *reading_um,
                highest: *highest,
                samples: *samples,
                share: *share,
            }),
            _ => None,
        };
        dataset.issues.iter().filter_map(limit).collect()
    }

    fn dataset(reading: impl Fn(f64, f64) -> f64) -> Dataset {
        let mut noise = WhiteNoise::new(0.003, 3);
        let drive_v: Vec<f64> = (0..6000)
            .map(|k| 50.0 - 50.0 * (0.01 * f64::from(k)).cos())
            .collect();
        let displacement_um = drive_v
            .iter()
            .map(|u| reading(*u, noise.next_um()))
            .collect();
        Dataset::new(
            "d",
            0.0,
            100.0,
            vec![Record::new("r", 1000.0, drive_v, displacement_um)],
        )
        .unwrap()
    }

    #[test]
    fn a_sensor_that_ends_is_told_from_an_amplifier_that_does() {
        let found = reading_limits(&dataset(|u, noise| (0.1 * u + noise).min(9.5)));
        assert_eq!(found.len(), 1);
        assert!(
            found[0].highest && found[0].reading_um == 9.5 && (0.1..0.2).contains(&found[0].share),
            "{found:?}"
        );
        assert!(reading_limits(&dataset(|u, noise| 0.1 * u.min(95.0) + noise)).is_empty());
        let both = reading_limits(&dataset(|u, noise| (0.1 * u + noise).clamp(0.4, 9.0)));
        assert_eq!(
            both.iter().map(|limit| limit.highest).collect::<Vec<_>>(),
            [false, true]
        );
    }

    /// A drive that rests for long before it moves, and readings in steps of half a per cent of the range.
    #[test]
    fn a_rest_on_one_code_is_no_end_of_the_readings() {
        let drive_v = |k: u32| {
            if k < 3000 {
                0.0
            } else {
                50.0 - 50.0 * (0.01 * f64::from(k - 3000)).cos()
            }
        };
        let record = |most_um: f64| {
            let read = |k: u32| {
                (0.1 * drive_v(k) / 0.05)
                    .round()
                    .mul_add(0.05, 0.0)
                    .min(most_um)
            };
            let record = Record::new(
                "r",
                1000.0,
                (0..6000).map(drive_v).collect(),
                (0..6000).map(read).collect(),
            );
            reading_limits(&Dataset::new("d", 0.0, 100.0, vec![record]).unwrap())
        };
        assert_eq!(record(20.0), []);
        assert_eq!(
            record(9.0)
                .iter()
                .map(|limit| limit.reading_um)
                .collect::<Vec<_>>(),
            [9.0]
        );
    }

    #[test]
    fn an_end_that_one_record_shows_is_that_of_the_others_unless_they_read_further() {
        let slow: Vec<f64> = (0..6000)
            .map(|k| 50.0 - 50.0 * (0.01 * f64::from(k)).cos())
            .collect();
        let fast: Vec<f64> = (0..6000)
            .map(|k| 50.0 - 50.0 * (0.8 * f64::from(k)).cos())
            .collect();
        let record = |name: &str, drive_v: &[f64], most_um: f64| {
            Record::new(
                name,
                1000.0,
                drive_v.to_vec(),
                drive_v.iter().map(|u| (0.1 * u).min(most_um)).collect(),
            )
        };
        let found = |records| reading_limits(&Dataset::new("d", 0.0, 100.0, records).unwrap());
        // The fast record stays at the end for a few samples at a time.
        assert!(found(vec![record("fast", &fast, 9.5)]).is_empty());
        let both = found(vec![record("fast", &fast, 9.5), record("slow", &slow, 9.5)]);
        assert_eq!(
            both.iter()
                .map(|limit| (limit.record.as_str(), limit.reading_um))
                .collect::<Vec<_>>(),
            [("fast", 9.5), ("slow", 9.5)]
        );
        assert!(both[0].samples > 500, "{both:?}");
        assert!(
            found(vec![
                record("slow", &slow, 9.5),
                record("whole", &fast, 20.0)
            ])
            .is_empty()
        );
        assert_eq!(
            found(vec![
                record("slow", &slow, 9.5),
                record("another range", &slow, 9.0)
            ])
            .len(),
            2
        );
    }

    #[test]
    fn coarse_readings_stand_still_everywhere() {
        assert!(
            reading_limits(&dataset(|u, noise| ((0.1 * u + noise) / 0.2).round() * 0.2)).is_empty()
        );
        assert!(reading_limits(&dataset(|u, noise| 0.1 * u + noise)).is_empty());
    }
}
