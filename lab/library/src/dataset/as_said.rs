//! What is said of a drive, held against the drive: that its periods are equal, that two records have the same, that a record is at rest. The noise is read
//! from what is said so, and a wrong word makes noise of motion.

use super::{Dataset, Record, Role};
use crate::error::{Error, Result};
use crate::statistics::{mean, pattern_rms, peak_to_peak, rms};

/// Two drives are not the same where they differ, beside what is irregular from sample to sample, by more than this share of what they move.
const DIFFERS: f64 = 0.02;
/// A drive at rest moves by less than this share of the actuator's range; an idle amplifier drifts.
const RESTS: f64 = 0.02;
/// Parts of a record whose means say whether it rests: noise with which a drive was read back is not in them.
const PARTS: usize = 64;

/// Checks every record against its own drive and that of the one which it repeats.
///
/// # Errors
/// The record, what was said, and what its drive does.
pub(super) fn check(dataset: &Dataset) -> Result<()> {
    for record in &dataset.records {
        check_rest(record, dataset.drive_max_v - dataset.drive_min_v)?;
        check_periods(record)?;
        if let Some(other) = dataset.records.iter().find(|other| record.repeat_of.as_ref() == Some(&other.name)) {
            check_repeat(record, other)?;
        }
    }
    Ok(())
}

/// Records that hold the same readings as one before them.
pub(super) fn given_twice(records: &[Record]) -> Vec<String> {
    let driven: Vec<&Record> = records.iter().filter(|r| r.role != Role::Noise).collect();
    // One file may be several records, each with a window of its own.
    let same = |a: &Record, b: &Record| {
        let both = a.window.start.max(b.window.start)..a.window.end.min(b.window.end);
        !both.is_empty() && a.sample_rate_hz == b.sample_rate_hz && a.displacement_um[both.clone()] == b.displacement_um[both]
    };
    let before =
        |(i, record): (usize, &&Record)| driven[..i].iter().find(|earlier| same(earlier, record)).map(|earlier| note(record, earlier));
    driven.iter().enumerate().filter_map(before).collect()
}

fn note(record: &Record, earlier: &Record) -> String {
    format!(
        "{} holds the same readings as {}, sample by sample: one recording that is given twice shows no noise, and judges nothing that was fitted to \
         it; leave one out",
        record.name, earlier.name
    )
}

fn check_rest(record: &Record, span_v: f64) -> Result<()> {
    if record.role != Role::Noise {
        return Ok(());
    }
    let drive_v = &record.drive_v[record.window.clone()];
    let means_v: Vec<f64> = drive_v.chunks(drive_v.len().div_ceil(PARTS)).map(mean).collect();
    let moves_v = peak_to_peak(&means_v);
    if moves_v <= RESTS * span_v {
        return Ok(());
    }
    Err(Error::new(&record.source, format!("role = \"noise\" expects a record at rest, but the drive moves by {moves_v:.3} V")))
}

fn check_periods(record: &Record) -> Result<()> {
    let Some(p) = record.periods.filter(|p| p.count >= 2) else { return Ok(()) };
    let whole = p.from..p.from + p.count * p.length;
    let pairs = (p.from..whole.end - p.length).map(|k| (record.drive_v[k], record.drive_v[k + p.length]));
    same(pairs, &record.drive_v[whole]).map_err(|differs| {
        let period_s = p.length as f64 * record.dt_s();
        Error::new(&record.source, format!("period_s = {period_s} expects equal periods, but {differs} from one to the next"))
    })
}

fn check_repeat(record: &Record, other: &Record) -> Result<()> {
    let both = record.window.start.max(other.window.start)..record.window.end.min(other.window.end);
    let pairs = both.clone().map(|k| (record.drive_v[k], other.drive_v[k]));
    same(pairs, &record.drive_v[both.clone()]).map_err(|differs| {
        Error::new(&record.source, format!("repeat_of = \"{}\" expects the same drive, but {differs} between them", other.name))
    })
}

/// By how much two drives differ, if that is more than noise.
fn same(pairs: impl Iterator<Item = (f64, f64)>, drive_v: &[f64]) -> std::result::Result<(), String> {
    let differences_v: Vec<f64> = pairs.map(|(a, b)| b - a).collect();
    let steps_v: Vec<f64> = differences_v.windows(2).map(|w| w[1] - w[0]).collect();
    let middle_v = mean(drive_v);
    let moves_v = rms(&drive_v.iter().map(|u| u - middle_v).collect::<Vec<_>>());
    let pattern_v = pattern_rms(&differences_v, &steps_v);
    if pattern_v <= DIFFERS * moves_v {
        return Ok(());
    }
    Err(format!("the drive, which moves by {moves_v:.3} V RMS, differs by {pattern_v:.3} V RMS"))
}

#[cfg(test)]
mod tests {
    use super::super::Periods;
    use super::*;

    const LENGTH: usize = 500;

    fn wave(k: usize) -> f64 {
        50.0 + 20.0 * (std::f64::consts::TAU * k as f64 / LENGTH as f64).sin()
    }

    fn record(name: &str, drive: impl Fn(usize) -> f64) -> Record {
        let mut noise = hysteron_sim::noise::WhiteNoise::new(0.02, 3);
        let drive_v: Vec<f64> = (0..6 * LENGTH).map(|k| drive(k) + noise.next_um()).collect();
        let displacement_um = drive_v.iter().map(|u| 0.1 * u).collect();
        Record::new(name, 1000.0, drive_v, displacement_um)
    }

    fn dataset(records: Vec<Record>) -> Result<Dataset> {
        Dataset::new("d", 0.0, 100.0, records)
    }

    #[test]
    fn what_is_said_of_a_drive_must_be_so() {
        let periodic = |length| Record { periods: Some(Periods { from: 0, length, count: 3 }), ..record("one", wave) };
        assert!(dataset(vec![periodic(LENGTH)]).is_ok());
        let refused = dataset(vec![periodic(LENGTH - 50)]).unwrap_err().to_string();
        assert!(refused.contains("period_s") && refused.contains("expects equal periods"), "{refused}");
        let repeat = |drive: fn(usize) -> f64| Record { repeat_of: Some("one".into()), ..record("two", drive) };
        assert!(dataset(vec![record("one", wave), repeat(wave)]).is_ok());
        let refused = dataset(vec![record("one", wave), repeat(|k| wave(k + 30))]).unwrap_err().to_string();
        assert!(refused.contains("repeat_of") && refused.contains("expects the same drive"), "{refused}");
        let rest = |drive: fn(usize) -> f64| record("rest", drive).with_role(Role::Noise);
        assert!(dataset(vec![record("one", wave), rest(|_| 3.0)]).is_ok());
        let refused = dataset(vec![record("one", wave), rest(wave)]).unwrap_err().to_string();
        assert!(refused.contains("expects a record at rest"), "{refused}");
    }

    #[test]
    fn one_recording_given_twice_is_said() {
        let twice = Record { name: "two".into(), ..record("one", wave) };
        let notes = dataset(vec![record("one", wave), twice]).unwrap().notes;
        assert!(notes.iter().any(|n| n.contains("two holds the same readings as one")), "{notes:?}");
        let half = |name: &str, window| Record { name: name.into(), window, ..record("one", wave) };
        let notes = dataset(vec![half("one", 0..3 * LENGTH), half("two", 3 * LENGTH..6 * LENGTH)]).unwrap().notes;
        assert!(notes.iter().all(|n| !n.contains("holds the same readings")), "{notes:?}");
    }
}
