//! When the drive of a row acts. Here `u[k]` acts from `t[k]` to `t[k+1]`, after the sample `y[k]`; a logger that writes its drive, waits and then
//! reads has `u[k]` act up to `t[k]`. Taken for the former, such a recording has the displacement a sample ahead of its cause, which no effect
//! explains, and modes are found that are none.

use super::{Dataset, Record};
use crate::error::{Error, Result};
use serde::Deserialize;

/// When samples are taken and drives act.
#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Eq)]
#[serde(rename_all = "snake_case")]
pub enum Timing {
    /// `y[k]` is sampled at `t[k]`; `u[k]` acts from `t[k]` to `t[k+1]`.
    HoldAfterSample,
    /// `u[k]` acts from `t[k-1]` to `t[k]`; `y[k]` is sampled at `t[k]`.
    HoldBeforeSample,
}

impl Timing {
    /// The timing by its name in files; `place` is where somebody said it.
    ///
    /// # Errors
    /// With both names.
    pub fn named(place: &str, name: &str) -> Result<Self> {
        match name {
            "hold_after_sample" => Ok(Self::HoldAfterSample),
            "hold_before_sample" => Ok(Self::HoldBeforeSample),
            _ => Err(Error::new(place, format!("`{name}`; expected hold_after_sample or hold_before_sample"))),
        }
    }
}

/// A reading that leaves this share of the squared error against the drive of its own instant has not waited for the drive to act.
const LEADING_SHARE: f64 = 0.3;

/// The displacement follows the drive of its own row much better than that of the row before.
#[must_use]
pub fn leads(record: &Record) -> bool {
    let from = record.window.start.max(1);
    let left_by =
        |delay: usize| left_by_straight_line((from..record.window.end).map(|k| (record.drive_v[k - delay], record.displacement_um[k])));
    left_by(0) < LEADING_SHARE * left_by(1)
}

/// Rows in front of a jump of the drive that show where the reading was going, and behind it that show how far it goes.
const ROWS_BEFORE: usize = 8;
const ROWS_BEHIND: usize = 40;
/// Share of the drive's range in the record from which on it jumps, and of the jump that the rows in front of it may move by.
const LEAST_JUMP: f64 = 0.03;
const QUIET_BEFORE: f64 = 0.03;
/// A reading has answered where it is off its way by so many of its own standard deviations there, and by this share of where it goes.
const ANSWERED_Z: f64 = 8.0;
const ANSWERED_SHARE: f64 = 0.01;
/// A mode goes a quarter as far in one row as in two. Of rows that were put on even times a reading holds a tenth or so of the next one, which knows of the jump.
const ANSWERED_OF_NEXT: f64 = 0.2;
/// Share of all jumps that are answered in their row.
const MOST_JUMPS: f64 = 0.8;

/// How many jumps of the drive the displacement answers in their own row, where it does so with nearly all: a reading that was taken before the drive acts knows
/// nothing of it, however fast the stage is. Loops, which hide the timing of a drive that moves smoothly, hide none of that.
#[cfg(feature = "readers")]
fn answered_in_their_row(record: &Record) -> Option<usize> {
    let (u, y) = (&record.drive_v, &record.displacement_um);
    let range_v = crate::statistics::peak_to_peak(u);
    let jumps_at = |k: &usize| {
        let jump_v = (u[*k] - u[*k - 1]).abs();
        let steps_v = u[*k - ROWS_BEFORE..*k].windows(2).map(|pair| (pair[1] - pair[0]).abs());
        jump_v > LEAST_JUMP * range_v && steps_v.fold(0.0, f64::max) < QUIET_BEFORE * jump_v
    };
    let jumps: Vec<usize> = (ROWS_BEFORE..u.len().saturating_sub(ROWS_BEHIND)).filter(jumps_at).collect();
    let answers = |k: &&usize| {
        let before = &y[**k - ROWS_BEFORE..**k];
        let (expected_um, std_um) = continued(before);
        let goes_um =
            y[**k..**k + ROWS_BEHIND].iter().map(|y| y - expected_um).fold(0.0, |far: f64, um| if um.abs() > far.abs() { um } else { far });
        let off_um = [y[**k], y[**k + 1]].map(|y| (y - expected_um) * goes_um.signum());
        off_um[0] > ANSWERED_Z * std_um && off_um[0] > ANSWERED_SHARE * goes_um.abs() && off_um[0] > ANSWERED_OF_NEXT * off_um[1]
    };
    let answered = jumps.iter().filter(answers).count();
    (answered > 0 && answered as f64 >= MOST_JUMPS * jumps.len() as f64).then_some(answered)
}

/// Where readings that went straight would stand one row later, and how well they tell that.
#[cfg(feature = "readers")]
fn continued(readings_um: &[f64]) -> (f64, f64) {
    let n = readings_um.len() as f64;
    let (middle, mean_um) = ((n - 1.0) / 2.0, readings_um.iter().sum::<f64>() / n);
    let along = |of: &dyn Fn(f64, f64) -> f64| readings_um.iter().enumerate().map(|(i, y)| of(i as f64 - middle, *y)).sum::<f64>();
    let squares = along(&|x, _| x * x);
    let slope_um = along(&|x, y| x * y) / squares;
    let left = along(&|x, y| (y - mean_um - slope_um * x).powi(2));
    let ahead = n - middle;
    (mean_um + slope_um * ahead, (left / (n - 2.0) * (1.0 + 1.0 / n + ahead * ahead / squares)).sqrt())
}

/// Brings the records of one data set to the one timing. What is not said is taken from the records: one that leads shows that the logger reads
/// after it writes, and so do the others, which may be too slow to show it. Gives a note where the records said so themselves.
#[cfg(feature = "readers")]
pub(super) fn bring_to_one_timing(records: &mut [Record], said: Option<Timing>) -> Option<String> {
    let shown_by = |record: &Record| {
        let how = if leads(record) {
            "y[k] follows u[k] much better than u[k-1]".to_owned()
        } else {
            let jumps = answered_in_their_row(record)?;
            format!("y[k] moves in the row in which u[k] jumps ({jumps} of them)")
        };
        Some(format!("{}: {how}", record.name))
    };
    let note = match said {
        Some(Timing::HoldAfterSample) => return None,
        Some(Timing::HoldBeforeSample) => None,
        None => Some(format!(
            "{}: a drive is taken to act before the sample of its row (otherwise: timing = \"hold_after_sample\", --timing hold_after_sample)",
            records.iter().find_map(shown_by)?
        )),
    };
    records.iter_mut().for_each(moved_up);
    note
}

impl Dataset {
    /// The same readings, taken to follow the drive of their own row.
    #[must_use]
    pub fn in_own_rows(&self) -> Self {
        let mut out = self.clone();
        out.records.iter_mut().for_each(moved_up);
        out.timing_is_assumed = false;
        out
    }
}

/// Each drive stands in the row from which on it acts; the last row, whose drive is not known, goes.
fn moved_up(record: &mut Record) {
    let samples = record.drive_v.len() - 1;
    record.drive_v.remove(0);
    record.displacement_um.truncate(samples);
    record.force_n.iter_mut().for_each(|force_n| force_n.truncate(samples));
    record.auxiliary = record.auxiliary.iter().map(|signal| signal.with(|values| values[..samples].to_vec())).collect();
    record.window.end = record.window.end.min(samples);
    record.left_out.iter_mut().for_each(|range| range.end = range.end.min(samples));
    record.left_out.retain(|range| !range.is_empty());
    record.periods = record.periods.take().and_then(|mut p| {
        p.count = p.count.min((samples - p.from.min(samples)) / p.length);
        (p.count > 0).then_some(p)
    });
}

/// Sum of squares about the regression line.
fn left_by_straight_line(pairs: impl ExactSizeIterator<Item = (f64, f64)> + Clone) -> f64 {
    let n = pairs.len().max(1) as f64;
    let (mean_x, mean_y) = pairs.clone().fold((0.0, 0.0), |(x, y), p| (x + p.0 / n, y + p.1 / n));
    let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
    for (x, y) in pairs.map(|p| (p.0 - mean_x, p.1 - mean_y)) {
        xx += x * x;
        xy += x * y;
        yy += y * y;
    }
    if xx > 0.0 { yy - xy * xy / xx } else { yy }
}

#[cfg(all(test, feature = "readers"))]
mod tests {
    use super::*;

    /// A staircase on a mode with loops, read before (0) or after (1) the drive of its row acts; and noise alone.
    #[test]
    fn a_reading_that_moves_in_the_row_of_a_jump_was_taken_behind_it() {
        let noise = |k: usize| 0.002 * (k as f64 * 78.233).sin() + 0.002 * (k as f64 * 12.9898).cos();
        let drive = |k: usize| 10.0 * ((k / 200) * 7 % 10) as f64;
        let read = |after: usize| {
            let (mut um, mut velocity, mut play, w) = (0.0, 0.0, 0.0_f64, std::f64::consts::TAU * 300.0);
            let mut readings = Vec::new();
            for k in 0..4000 {
                if after == 0 {
                    readings.push(um + noise(k));
                }
                play = play.clamp(drive(k) - 10.0, drive(k) + 10.0);
                for _ in 0..50 {
                    velocity += 4e-6 * (w * w * (0.07 * drive(k) + 0.03 * play - um) - 0.3 * w * velocity);
                    um += 4e-6 * velocity;
                }
                if after == 1 {
                    readings.push(um + noise(k));
                }
            }
            Record::new("steps", 5000.0, (0..4000).map(drive).collect(), readings)
        };
        assert!(!leads(&read(1)), "the loops hide it from a straight line");
        assert_eq!(answered_in_their_row(&read(1)), Some(19));
        assert_eq!(answered_in_their_row(&read(0)), None);
        // Rows on even times that hold some of the next one.
        let smeared = |share: f64| {
            let y = read(0).displacement_um;
            let of_next = (0..y.len()).map(|k| y[k] + share * (y[(k + 1).min(y.len() - 1)] - y[k])).collect();
            answered_in_their_row(&Record::new("even", 5000.0, (0..4000).map(drive).collect(), of_next))
        };
        assert_eq!([0.05, 0.2, 0.4].map(smeared), [None; 3]);
        let unanswered = Record::new("noise", 5000.0, (0..4000).map(drive).collect(), (0..4000).map(noise).collect());
        assert_eq!(answered_in_their_row(&unanswered), None);
        let note = bring_to_one_timing(&mut [read(1)], None).unwrap();
        assert!(note.contains("moves in the row in which u[k] jumps (19 of them)"), "{note}");
    }

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
        let note = bring_to_one_timing(&mut records, None).unwrap();
        assert!(note.contains("fast"), "{note}");
        for record in &records {
            assert_eq!((record.drive_v.len(), record.displacement_um.len(), record.window.end), (499, 499, 499));
        }
        let fast = &records[1];
        assert!((1..499).all(|k| (fast.displacement_um[k] - 0.1 * fast.drive_v[k - 1]).abs() < 0.011));
        assert!(!leads(fast));
    }

    #[test]
    fn what_follows_its_drive_is_left_alone_and_what_was_said_holds() {
        let mut records = [record("right", 0.3, 0)];
        assert_eq!(bring_to_one_timing(&mut records, None), None);
        assert_eq!(records[0].drive_v.len(), 500);
        let mut leading = [record("leads", 0.3, 1)];
        assert_eq!(bring_to_one_timing(&mut leading, Some(Timing::HoldAfterSample)), None);
        assert_eq!(leading[0].drive_v.len(), 500);
        assert_eq!(bring_to_one_timing(&mut records, Some(Timing::HoldBeforeSample)), None);
        assert_eq!(records[0].drive_v.len(), 499);
    }
}
