//! Time stamps as they come, and the even ones that the program works with.
//!
//! Stamps may be written with few digits, jitter, be missing or stand twice. What can be mended is mended and
//! said; what runs backwards or leaves a long gap is an error with its row.

use crate::error::{Error, Result};
use std::ops::Range;

/// Share of a period by which a time stamp may be early or late and still count as even.
const UNEVEN: f64 = 0.01;
/// Longest gap that is bridged by a straight line, in missing samples.
const GAP_MAX: f64 = 10.0;
/// Periods between recorded samples from which one is missing.
const GAP_MIN: f64 = 1.5;
/// Product of the distances in periods to the recorded samples on both sides, to which the error of a straight
/// line is proportional: its largest value where none is missing.
const WITHIN_A_PERIOD: f64 = 0.25;
/// Largest share of missing samples that is bridged.
const MISSING_MAX: f64 = 0.1;
/// Largest share of stamps that may stand twice.
const TWICE_MAX: f64 = 0.2;
/// Largest jitter of most stamps, in periods.
const JITTER_MAX: f64 = 0.4;
/// Share of steps that are uneven where stamps are only written with few digits.
const ROUNDED_MIN: f64 = 0.02;
/// Samples per second beyond which the unit of the stamps is another one: no displacement is read so fast.
const FASTEST_HZ: f64 = 5e6;
/// Share of stamps that may jitter more.
const IRREGULAR_MAX: f64 = 0.02;

/// How even samples are made of those that were recorded.
#[derive(Clone, Debug)]
enum Plan {
    /// They are even.
    AsTheyAre,
    /// Some are left out.
    Kept(Vec<usize>),
    /// Between these two samples, at this share of the way.
    Between(Vec<(usize, usize, f64)>),
}

/// Even time, and how signals come to it.
#[derive(Clone, Debug)]
pub struct TimeAxis {
    /// Sampling rate.
    pub sample_rate_hz: f64,
    /// Time of the first sample, s.
    pub start_s: f64,
    /// What was mended.
    pub note: Option<String>,
    /// Even samples whose readings or drives nobody recorded: the straight lines over missing samples.
    pub bridged: Vec<Range<usize>>,
    plan: Plan,
}

/// What is known beside the stamps.
pub struct StampContext<'a> {
    /// The file, for messages.
    pub place: &'a str,
    /// Line of a row.
    pub line_of: &'a dyn Fn(usize) -> usize,
    /// Sampling rate, if it was specified.
    pub sample_rate_hz: Option<f64>,
    /// Whether uneven stamps may be mended: whatever the gaps, never, or as far as is safe.
    pub resample: Option<bool>,
}

impl TimeAxis {
    /// Samples without stamps.
    #[must_use]
    pub fn without_stamps(sample_rate_hz: f64) -> Self {
        Self {
            sample_rate_hz,
            start_s: 0.0,
            note: None,
            bridged: Vec::new(),
            plan: Plan::AsTheyAre,
        }
    }

    /// From time stamps in seconds.
    ///
    /// # Errors
    /// The row in which time runs backwards, stands still or jumps too far; a sampling rate that is not that
    /// of the stamps.
    pub fn from_stamps(t_s: &[f64], known: &StampContext) -> Result<Self> {
        let [start_s, .., end_s] = *t_s else {
            return Err(Error::new(known.place, "has one row; expected more"));
        };
        for (k, pair) in t_s.windows(2).enumerate() {
            if pair[1] < pair[0] {
                return known.wrong(
                    k + 1,
                    format!(
                        "time {} s does not increase (row before: {} s)",
                        pair[1], pair[0]
                    ),
                );
            }
        }
        if end_s <= start_s {
            return known.wrong(1, format!("time {start_s} s does not increase"));
        }
        let even = |period_s: f64, note, plan| Self {
            sample_rate_hz: without_rounding(1.0 / period_s),
            start_s,
            note,
            bridged: Vec::new(),
            plan,
        };
        let mean_s = (end_s - start_s) / (t_s.len() - 1) as f64;
        if mean_s * FASTEST_HZ < 1.0 {
            let often = format!(
                "time stamps are {mean_s:.1e} s apart, {:.1e} samples per second",
                mean_s.recip()
            );
            return known.wrong(
                1,
                format!("{often}; expected at most {FASTEST_HZ:.0e}: is their unit another one? --units t=s, or unit = {{ t = \"s\" }}"),
            );
        }
        if let Some(period_s) = even_period(t_s, known)? {
            return Ok(even(period_s, None, Plan::AsTheyAre));
        }
        if let Some(digit_s) =
            written_with_few_digits(t_s, known.sample_rate_hz.map_or(mean_s, f64::recip))
        {
            let period_s = known.sample_rate_hz.map_or(mean_s, f64::recip);
            let note = format!(
                "time stamps are written in steps of {digit_s:.0e} s: samples are taken as even, {:.6} Hz",
                1.0 / period_s
            );
            return Ok(even(period_s, Some(note), Plan::AsTheyAre));
        }
        if known.resample == Some(false) {
            return Err(first_uneven(t_s, known));
        }
        let (kept, twice) = once(t_s, known)?;
        let kept_s: Vec<f64> = kept.iter().map(|&k| t_s[k]).collect();
        let said = |notes: Vec<String>| Some(notes.join("; ")).filter(|text| !text.is_empty());
        let mut notes: Vec<String> = twice.into_iter().collect();
        let by_kept = |row: usize| (known.line_of)(kept[row]);
        let known = StampContext {
            line_of: &by_kept,
            ..*known
        };
        if let Some(period_s) = even_period(&kept_s, &known)? {
            return Ok(even(period_s, said(notes), Plan::Kept(kept)));
        }
        let (period_s, mended) = irregularities(&kept_s, &known)?;
        notes.push(mended);
        let samples = ((end_s - start_s) / period_s + 1e-6).floor() as usize + 1;
        let mut after = 1;
        let mut bridged: Vec<Range<usize>> = Vec::new();
        let between = (0..samples).map(|k| {
            let at_s = start_s + k as f64 * period_s;
            while after + 1 < kept_s.len() && kept_s[after] < at_s {
                after += 1;
            }
            let share =
                ((at_s - kept_s[after - 1]) / (kept_s[after] - kept_s[after - 1])).clamp(0.0, 1.0);
            let periods = (kept_s[after] - kept_s[after - 1]) / period_s;
            if periods > GAP_MIN && share * (1.0 - share) * periods.powi(2) > WITHIN_A_PERIOD {
                // The reading behind a gap answers the drive of its last row.
                match bridged.last_mut().filter(|last| last.end > k) {
                    Some(last) => last.end = k + 2,
                    None => bridged.push(k..k + 2),
                }
            }
            (kept[after - 1], kept[after], share)
        });
        let plan = Plan::Between(between.collect());
        if let Some(last) = bridged.last_mut() {
            last.end = last.end.min(samples);
        }
        let left_out: usize = bridged.iter().map(Range::len).sum();
        if left_out > 0 {
            notes.push(format!(
                "{left_out} samples there and right behind drive the model, and are left out of fits and errors"
            ));
        }
        Ok(Self {
            bridged,
            ..even(period_s, said(notes), plan)
        })
    }

    /// A signal at the even times.
    #[must_use]
    pub fn apply(&self, signal: Vec<f64>) -> Vec<f64> {
        match &self.plan {
            Plan::AsTheyAre => signal,
            Plan::Kept(rows) => rows.iter().map(|&k| signal[k]).collect(),
            Plan::Between(pairs) => pairs
                .iter()
                .map(|&(first, second, share)| {
                    signal[first] + share * (signal[second] - signal[first])
                })
                .collect(),
        }
    }
}

impl StampContext<'_> {
    fn wrong<T>(&self, row: usize, what: String) -> Result<T> {
        Err(Error::new(
            self.place,
            format!("row {}: {what}", (self.line_of)(row)),
        ))
    }
}

/// The period of stamps that are even as they are.
///
/// # Errors
/// Where they are even at another rate than the specified one.
fn even_period(t_s: &[f64], known: &StampContext) -> Result<Option<f64>> {
    let mean_s = (t_s[t_s.len() - 1] - t_s[0]) / (t_s.len() - 1).max(1) as f64;
    let is_even = |period_s: f64| {
        t_s.windows(2)
            .all(|w| (w[1] - w[0] - period_s).abs() <= UNEVEN * period_s + 1e-9)
    };
    let said_s = known.sample_rate_hz.map(f64::recip);
    match said_s {
        Some(said_s) if is_even(said_s) => Ok(Some(said_s)),
        None if is_even(mean_s) => Ok(Some(mean_s)),
        Some(said_s) if is_even(mean_s) => {
            let ratio = mean_s / said_s;
            let hint = if (ratio / 1e3 - 1.0).abs() < UNEVEN {
                "; are they in ms? Then say unit = { t = \"ms\" }, or --units t=ms"
            } else {
                ""
            };
            known.wrong(1, format!("time stamps are {mean_s:.6e} s apart, but sample_rate_hz says {said_s:.6e} s{hint}"))
        }
        _ => Ok(None),
    }
}

/// A rate to twelve digits: differences of time stamps make 49999.99999999999 Hz of 50 kHz.
fn without_rounding(hz: f64) -> f64 {
    format!("{hz:.11e}").parse().unwrap_or(hz)
}

/// The step in which stamps are written, if that alone makes them uneven.
fn written_with_few_digits(t_s: &[f64], period_s: f64) -> Option<f64> {
    let on_grid = |digit_s: f64| {
        t_s.iter()
            .all(|t| (t / digit_s - (t / digit_s).round()).abs() < 1e-3)
    };
    let digit_s = (0..10)
        .map(|digits| 10_f64.powi(-digits))
        .find(|digit_s| on_grid(*digit_s))?;
    let as_late = |k: usize| t_s[k] - t_s[0] - k as f64 * period_s;
    let deviations = || (0..t_s.len()).map(as_late);
    let (least, most) = deviations().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, m), d| {
        (l.min(d), m.max(d))
    });
    let steps = || t_s.windows(2).map(|w| (w[1] - w[0] - period_s).abs());
    // What was rounded is uneven again and again, and by less than a digit; a row too many or too few is so
    // once.
    let uneven = steps().filter(|d| *d > UNEVEN * period_s).count();
    let again_and_again =
        uneven as f64 > ROUNDED_MIN * t_s.len() as f64 && steps().all(|d| d < 1.01 * digit_s);
    // Rounding moves each stamp by at most half a digit; the mean period is off by what it did to the ends.
    (again_and_again && most - least <= 2.01 * digit_s).then_some(digit_s)
}

/// The error for uneven stamps that are not to be mended.
fn first_uneven(t_s: &[f64], known: &StampContext) -> Error {
    let period_s = known
        .sample_rate_hz
        .map_or_else(|| median_step(t_s), f64::recip);
    let uneven = |w: &[f64]| (w[1] - w[0] - period_s).abs() > UNEVEN * period_s + 1e-9;
    let row = t_s.windows(2).position(uneven).unwrap_or(0);
    let step_s = t_s[row + 1] - t_s[row];
    let line = (known.line_of)(row + 1);
    Error::new(
        known.place,
        format!(
            "row {line}: time jumps by {step_s:.6e} s; expected {period_s:.6e} s within 1 % (resample = false)"
        ),
    )
}

fn median_step(t_s: &[f64]) -> f64 {
    let mut steps: Vec<f64> = t_s
        .windows(2)
        .map(|w| w[1] - w[0])
        .filter(|s| *s > 0.0)
        .collect();
    if steps.is_empty() {
        return 0.0;
    }
    let middle = steps.len() / 2;
    *steps.select_nth_unstable_by(middle, f64::total_cmp).1
}

/// The row after which stamps come at another rate, with the periods before and after it. Stamps at two rates
/// are two straight lines, and are farthest from the line between their ends where these meet.
fn another_rate(t_s: &[f64]) -> Option<(usize, [f64; 2])> {
    let mean_s = (t_s[t_s.len() - 1] - t_s[0]) / (t_s.len() - 1) as f64;
    let off = |k: &usize| (t_s[*k] - t_s[0] - *k as f64 * mean_s).abs();
    let row = (0..t_s.len()).max_by(|a, b| off(a).total_cmp(&off(b)))?;
    let parts = [&t_s[..=row], &t_s[row..]];
    let periods_s = parts.map(median_step);
    let change_s = (periods_s[1] - periods_s[0]).abs();
    // Jitter and a drifting clock spread the steps of a part by as much as the parts differ.
    let is_even = |(part, period_s): (&[f64], f64)| {
        let steps = part.windows(2).map(|w| w[1] - w[0]);
        let even = steps.filter(|s| (s - period_s).abs() < 0.25 * change_s);
        even.count() as f64 > (1.0 - MISSING_MAX) * (part.len() - 1) as f64
    };
    let changes = change_s > UNEVEN * mean_s && parts.into_iter().zip(periods_s).all(is_even);
    changes.then_some((row, periods_s))
}

/// Rows without those whose stamp stands in the row before.
fn once(t_s: &[f64], known: &StampContext) -> Result<(Vec<usize>, Option<String>)> {
    let kept: Vec<usize> = (0..t_s.len())
        .filter(|&k| k == 0 || t_s[k] > t_s[k - 1])
        .collect();
    let twice = t_s.len() - kept.len();
    if twice == 0 {
        return Ok((kept, None));
    }
    let first = (1..t_s.len()).find(|&k| t_s[k] == t_s[k - 1]).unwrap_or(0);
    let line = (known.line_of)(first);
    if twice as f64 > TWICE_MAX * t_s.len() as f64 {
        let message = format!(
            "time {} s stands twice, as {twice} of {} stamps do; expected finer time stamps, or sample_rate_hz alone",
            t_s[first],
            t_s.len()
        );
        return known.wrong(first, message);
    }
    let note = match twice {
        1 => format!("row {line} has the time stamp of the row before and is left out"),
        _ => format!(
            "{twice} rows have the time stamp of the row before and are left out, the first in row {line}"
        ),
    };
    Ok((kept, Some(note)))
}

/// The period of stamps that jitter or miss samples, and the note on it.
fn irregularities(t_s: &[f64], known: &StampContext) -> Result<(f64, String)> {
    let force = known.resample == Some(true);
    let usual_s = known
        .sample_rate_hz
        .map_or_else(|| median_step(t_s), f64::recip);
    let elapsed = |w: &[f64]| ((w[1] - w[0]) / usual_s).round().max(1.0);
    let periods: f64 = t_s.windows(2).map(elapsed).sum();
    let period_s = known
        .sample_rate_hz
        .map_or((t_s[t_s.len() - 1] - t_s[0]) / periods, f64::recip);
    let advice =
        "expected even samples; cut the record there, or say resample = true in dataset.toml";
    if let Some((row, [before_s, after_s])) = another_rate(t_s).filter(|_| !force) {
        return known.wrong(
            row + 1,
            format!(
                "samples come {after_s:.6e} s apart from here on, {before_s:.6e} s before; {advice}"
            ),
        );
    }
    let longest = t_s
        .windows(2)
        .enumerate()
        .max_by(|a, b| elapsed(a.1).total_cmp(&elapsed(b.1)));
    if let Some((row, w)) = longest.filter(|(_, w)| !force && elapsed(w) > GAP_MAX + 1.0) {
        return known.wrong(
            row + 1,
            format!(
                "time jumps by {:.6e} s, {:.0} periods of {usual_s:.6e} s; {advice}",
                w[1] - w[0],
                elapsed(w)
            ),
        );
    }
    let missing = periods - (t_s.len() - 1) as f64;
    if !force && missing > MISSING_MAX * periods {
        return known.wrong(
            1,
            format!(
                "{missing:.0} of {:.0} samples are missing; {advice}",
                periods + 1.0
            ),
        );
    }
    let jitter = |w: &[f64]| ((w[1] - w[0]) / period_s - elapsed(w)).abs();
    let irregular = t_s.windows(2).filter(|w| jitter(w) > JITTER_MAX).count();
    if !force && irregular as f64 > IRREGULAR_MAX * t_s.len() as f64 {
        let row = t_s
            .windows(2)
            .position(|w| jitter(w) > JITTER_MAX)
            .unwrap_or(0);
        return known.wrong(
            row + 1,
            format!(
                "time steps are irregular, here {:.6e} s; {advice}",
                t_s[row + 1] - t_s[row]
            ),
        );
    }
    let first_gap = t_s.windows(2).position(|w| elapsed(w) > 1.0);
    let largest = t_s.windows(2).map(jitter).fold(0.0, f64::max);
    let mut what = Vec::new();
    if largest > UNEVEN {
        what.push(format!(
            "time stamps jitter by up to {:.0} % of a period",
            100.0 * largest
        ));
    }
    if let Some(row) = first_gap {
        let row = (known.line_of)(row + 1);
        what.push(match missing.round() as usize {
            1 => format!("one sample is missing, before row {row}"),
            missing => format!("{missing} samples are missing, the first before row {row}"),
        });
    }
    if what.is_empty() {
        what.push("time stamps drift".into());
    }
    Ok((
        period_s,
        format!(
            "{}: resampled evenly at {:.6} Hz by straight lines between neighbours",
            what.join(", "),
            1.0 / period_s
        ),
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn axis(t_s: &[f64], sample_rate_hz: Option<f64>, resample: Option<bool>) -> Result<TimeAxis> {
        TimeAxis::from_stamps(
            t_s,
            &StampContext {
                place: "a.csv",
                line_of: &|row| row + 1,
                sample_rate_hz,
                resample,
            },
        )
    }

    fn even(n: usize) -> Vec<f64> {
        (0..n).map(|k| 0.25 + k as f64 * 1e-3).collect()
    }

    #[test]
    fn stamps_of_another_unit_than_was_said_are_refused() {
        let in_us: Vec<f64> = (0..500).map(|k| 1e-6 * 1e-4 * f64::from(k)).collect();
        let message = axis(&in_us, None, None).unwrap_err().to_string();
        assert!(
            message.contains("1.0e10 samples per second") && message.contains("--units t=s"),
            "{message}"
        );
    }

    #[test]
    fn a_round_rate_is_found_as_it_is() {
        let at_50_khz: Vec<f64> = (0..127_501).map(|k| k as f64 / 50_000.0).collect();
        let shifted: Vec<f64> = at_50_khz.iter().map(|t| t + 0.1).collect();
        for t_s in [at_50_khz, shifted] {
            assert_eq!(axis(&t_s, None, None).unwrap().sample_rate_hz, 50_000.0);
        }
    }

    #[test]
    fn even_stamps_are_left_alone() {
        let found = axis(&even(500), None, None).unwrap();
        assert!(
            (found.sample_rate_hz - 1000.0).abs() < 1e-6
                && found.note.is_none()
                && found.start_s == 0.25
        );
        assert_eq!(found.apply(vec![3.0; 500]).len(), 500);
    }

    #[test]
    fn stamps_with_few_digits_are_even() {
        // 20 kHz written with four digits: every second stamp stands twice.
        let stamps: Vec<f64> = (0..5000)
            .map(|k| (f64::from(k) * 0.5).round() * 1e-4)
            .collect();
        let found = axis(&stamps, None, None).unwrap();
        assert!(
            (found.sample_rate_hz / 20_000.0 - 1.0).abs() < 1e-3,
            "{}",
            found.sample_rate_hz
        );
        assert!(found.note.as_ref().unwrap().contains("1e-4"));
        assert_eq!(found.apply(stamps.clone()).len(), 5000);
        assert_eq!(
            axis(&stamps, Some(20_000.0), None).unwrap().sample_rate_hz,
            20_000.0
        );
    }

    #[test]
    fn jitter_gaps_and_repeats_are_mended_and_said() {
        // Stamps early and late by a fifth of a period, three samples missing, one row twice.
        let late = |k: usize| 2e-4 * (((k * 7919) % 1000) as f64 / 500.0 - 1.0);
        let mut rows: Vec<usize> = (0..2000)
            .filter(|k| ![300, 301, 1200].contains(k))
            .collect();
        rows.insert(700, rows[699]);
        let stamps: Vec<f64> = rows.iter().map(|&k| k as f64 * 1e-3 + late(k)).collect();
        let found = axis(&stamps, None, None).unwrap();
        let note = found.note.clone().unwrap();
        assert!(
            note.contains("row 701 has the time stamp of the row before")
                && note.contains("3 samples are missing"),
            "{note}"
        );
        assert!((found.sample_rate_hz / 1000.0 - 1.0).abs() < 1e-3);
        let signal: Vec<f64> = stamps.iter().map(|t| (t * 6.0).sin()).collect();
        let mended = found.apply(signal);
        for (k, value) in mended.iter().enumerate() {
            let at_s = found.start_s + k as f64 / found.sample_rate_hz;
            assert!((value - (at_s * 6.0).sin()).abs() < 1e-4, "{k}");
        }
        assert!((mended.len() as i64 - 2000).abs() <= 1);
        // The reading behind a gap answers a drive that nobody recorded.
        assert_eq!(found.bridged, [300..304, 1200..1203], "{note}");
        assert!(note.contains("7 samples there and right behind"), "{note}");
        let refused = axis(&stamps, None, Some(false)).unwrap_err().to_string();
        assert!(
            refused.contains("jumps") && refused.contains("resample"),
            "{refused}"
        );
    }

    #[test]
    fn another_rate_within_a_file_is_an_error_with_its_row() {
        let halved: Vec<f64> = (0..900_u32)
            .map(|k| 1e-3 * f64::from(k) + 1e-3 * f64::from(k.saturating_sub(600)))
            .collect();
        let message = axis(&halved, None, None).unwrap_err().to_string();
        let expected =
            "row 602: samples come 2.000000e-3 s apart from here on, 1.000000e-3 s before";
        assert!(message.contains(expected), "{message}");
        assert!(axis(&halved, None, Some(true)).is_ok());
        // A clock that drifts by as much has no such row.
        let drifting: Vec<f64> = (0..900)
            .map(|k| 1e-3 * f64::from(k) * (1.0 + 5e-5 * f64::from(k)))
            .collect();
        assert!(another_rate(&drifting).is_none());
    }

    #[test]
    fn what_cannot_be_mended_is_an_error_with_its_row() {
        let mut back = even(100);
        back[40] = 0.1;
        assert!(
            axis(&back, None, None)
                .unwrap_err()
                .to_string()
                .contains("row 41: time 0.1 s does not increase")
        );
        let gap: Vec<f64> = even(100)
            .iter()
            .enumerate()
            .map(|(k, t)| if k < 60 { *t } else { t + 5.0 })
            .collect();
        let refused = axis(&gap, None, None).unwrap_err().to_string();
        assert!(refused.contains("row 61: time jumps by"), "{refused}");
        assert!(axis(&gap, None, Some(true)).is_ok());
        assert!(
            axis(&[1.0; 50], None, None)
                .unwrap_err()
                .to_string()
                .contains("does not increase")
        );
        assert!(axis(&[1.0], None, None).is_err());
        let refused = axis(&even(100), Some(1e6), None).unwrap_err().to_string();
        assert!(refused.contains("ms"), "{refused}");
    }
}
