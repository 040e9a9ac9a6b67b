//! Do the readings answer a jump of the drive in the row of the jump?

use super::leading::leads;
use crate::dataset::issue::{Issue, IssueKind, Severity};
use crate::dataset::record::Record;

/// Rows in front of a jump of the drive that show where the reading was going, and behind it that show how
/// far it goes.
const ROWS_BEFORE: usize = 8;
const ROWS_BEHIND: usize = 40;
/// Share of the drive's range in the record from which on it jumps, and of the jump that the rows in front of
/// it may move by.
const LEAST_JUMP: f64 = 0.03;
const QUIET_BEFORE: f64 = 0.03;
/// A reading has answered where it is off its way by so many of its own standard deviations there, and by
/// this share of where it goes.
const ANSWERED_Z: f64 = 8.0;
const ANSWERED_SHARE: f64 = 0.01;
/// A mode goes a quarter as far in one row as in two. Of rows that were put on even times a reading holds a
/// tenth or so of the next one, which knows of the jump.
const ANSWERED_OF_NEXT: f64 = 0.2;
/// Share of all jumps that are answered in their row.
const MOST_JUMPS: f64 = 0.8;

/// How many jumps of the drive the displacement answers in the same row, where it does so with nearly all: a
/// reading that was taken before the drive acts knows nothing of it, however fast the stage is. Loops, which
/// hide the timing of a drive that moves smoothly, hide none of that.
fn answered_in_their_row(record: &Record) -> Option<usize> {
    let (u, y) = (&record.drive_v, &record.displacement_um);
    let range_v = crate::statistics::peak_to_peak(u);
    let jumps_at = |k: &usize| {
        let jump_v = (u[*k] - u[*k - 1]).abs();
        let steps_v = u[*k - ROWS_BEFORE..*k]
            .windows(2)
            .map(|pair| (pair[1] - pair[0]).abs());
        jump_v > LEAST_JUMP * range_v && steps_v.fold(0.0, f64::max) < QUIET_BEFORE * jump_v
    };
    let jumps: Vec<usize> = (ROWS_BEFORE..u.len().saturating_sub(ROWS_BEHIND))
        .filter(jumps_at)
        .collect();
    let answers = |k: &&usize| {
        let before = &y[**k - ROWS_BEFORE..**k];
        let (expected_um, std_um) = continued(before);
        let goes_um = y[**k..**k + ROWS_BEHIND]
            .iter()
            .map(|y| y - expected_um)
            .fold(
                0.0,
                |far: f64, um| if um.abs() > far.abs() { um } else { far },
            );
        let off_um = [y[**k], y[**k + 1]].map(|y| (y - expected_um) * goes_um.signum());
        off_um[0] > ANSWERED_Z * std_um
            && off_um[0] > ANSWERED_SHARE * goes_um.abs()
            && off_um[0] > ANSWERED_OF_NEXT * off_um[1]
    };
    let answered = jumps.iter().filter(answers).count();
    (answered > 0 && answered as f64 >= MOST_JUMPS * jumps.len() as f64).then_some(answered)
}

/// Where readings that went straight would stand one row later, and how well they tell that.
fn continued(readings_um: &[f64]) -> (f64, f64) {
    let n = readings_um.len() as f64;
    let (middle, mean_um) = ((n - 1.0) / 2.0, readings_um.iter().sum::<f64>() / n);
    let along = |of: &dyn Fn(f64, f64) -> f64| {
        readings_um
            .iter()
            .enumerate()
            .map(|(i, y)| of(i as f64 - middle, *y))
            .sum::<f64>()
    };
    let squares = along(&|x, _| x * x);
    let slope_um = along(&|x, y| x * y) / squares;
    let left = along(&|x, y| (y - mean_um - slope_um * x).powi(2));
    let ahead = n - middle;
    (
        mean_um + slope_um * ahead,
        (left / (n - 2.0) * (1.0 + 1.0 / n + ahead * ahead / squares)).sqrt(),
    )
}

/// A record that shows by itself that its readings respond to the drive of their row.
pub(crate) fn shown_by_readings(record: &Record) -> Option<Issue> {
    let jumps = if leads(record) {
        None
    } else {
        Some(answered_in_their_row(record)?)
    };
    Some(Issue::of(
        &record.name,
        Severity::Corrects,
        IssueKind::TimingInReadings { jumps },
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A staircase on a mode with loops, read before (0) or after (1) the drive of its row acts; and noise
    /// alone.
    #[test]
    fn a_reading_that_moves_in_the_row_of_a_jump_was_taken_behind_it() {
        let noise =
            |k: usize| 0.002 * (k as f64 * 78.233).sin() + 0.002 * (k as f64 * 12.9898).cos();
        let drive = |k: usize| 10.0 * ((k / 200) * 7 % 10) as f64;
        let read = |after: usize| {
            let (mut um, mut velocity, mut play, w) =
                (0.0, 0.0, 0.0_f64, std::f64::consts::TAU * 300.0);
            let mut readings = Vec::new();
            for k in 0..4000 {
                if after == 0 {
                    readings.push(um + noise(k));
                }
                play = play.clamp(drive(k) - 10.0, drive(k) + 10.0);
                for _ in 0..50 {
                    velocity +=
                        4e-6 * (w * w * (0.07 * drive(k) + 0.03 * play - um) - 0.3 * w * velocity);
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
            let of_next = (0..y.len())
                .map(|k| y[k] + share * (y[(k + 1).min(y.len() - 1)] - y[k]))
                .collect();
            answered_in_their_row(&Record::new(
                "even",
                5000.0,
                (0..4000).map(drive).collect(),
                of_next,
            ))
        };
        assert_eq!([0.05, 0.2, 0.4].map(smeared), [None; 3]);
        let unanswered = Record::new(
            "noise",
            5000.0,
            (0..4000).map(drive).collect(),
            (0..4000).map(noise).collect(),
        );
        assert_eq!(answered_in_their_row(&unanswered), None);
        assert_eq!(
            shown_by_readings(&read(1)).unwrap().kind,
            IssueKind::TimingInReadings { jumps: Some(19) }
        );
    }
}
