//! Readings that a disturbance made: a bit that flipped on the way, a spike on a line. One of them weighs in a sum of squares as much as thousands of
//! others, and no effect of a stage makes it: whatever has a mass or a filter moves the readings beside it too.
//!
//! A reading is compared with the median of the two before and the two after it. That difference is noise where readings follow a smooth or a
//! monotone course, however steep (a median leaves edges as they are); a reading stands alone where it is many times what the difference
//! usually is around it, and the differences beside it are small. After a jump of the drive nothing is taken for an outlier: the
//! first overshoot of a fast mode is as narrow.

use super::Record;
use super::reading_grid::levels;
use crate::statistics::{mean, peak_to_peak};
use std::ops::Range;

/// A reading stands out where it is so many times as far from its neighbours as readings usually are.
const STANDS_OUT: f64 = 15.0;
/// Samples on each side that say what is usual.
const AROUND: usize = 64;
/// Samples on each side in which nothing else may stand out.
const ALONE_WITHIN: usize = 8;
/// Share of the difference that those beside it may have.
const ALONE_SHARE: f64 = 0.2;
/// A drive jumps where it changes by so many times what it changes by on average around.
const JUMP: f64 = 8.0;
/// Samples on each side that a reading is compared with.
const MEDIAN_REACHES: usize = 2;
/// Samples at the beginning of a record in which a jump of the drive counts for those before it too.
const AT_AN_END: usize = 4;
/// A corner of the drive makes a corner of the readings: what stands out by less than so many times what a straight stage would read there is none.
const AS_THE_DRIVE: f64 = 3.0;
/// Steps of a converter by which rounding and a noise below one step put a reading beside the mean of two others.
const ROUNDED_BY: f64 = 2.1;
/// More than this share of all readings are no disturbances.
const SHARE_MAX: f64 = 0.02;

/// Readings that stand out, by their samples in order.
#[derive(Debug, Default, PartialEq)]
struct Outliers {
    /// Those that stand alone.
    single: Vec<usize>,
    /// Those beside others.
    beside_others: Vec<usize>,
}

/// Puts what its neighbours say in the place of each reading inside the window that stands alone, so that spectra find even steps, and gives a
/// note of it with the samples, which are to count in nothing; `ends_um` are the readings at which the sensor's range ends.
pub(super) fn replaced(record: &mut Record, ends_um: &[f64]) -> Option<(String, Vec<usize>)> {
    // Of one recording that is cut into several records each has its part.
    let single: Vec<usize> = outliers(record, ends_um).single.into_iter().filter(|k| record.window.contains(k)).collect();
    match too_many(record, single.len(), *single.first()?) {
        Some(note) => Some((note, Vec::new())),
        None => Some((singles_replaced(record, &single)?, single)),
    }
}

/// Leaves samples out of what counts, beside those that are left out already.
pub(super) fn leave_out(record: &mut Record, samples: impl IntoIterator<Item = usize>) {
    let further: Vec<Range<usize>> = samples.into_iter().filter(|k| record.counts(*k)).map(|k| k..k + 1).collect();
    record.left_out.extend(further);
    record.left_out.sort_by_key(|range| range.start);
}

/// Leaves readings that stand out beside one another out of what counts, with those between them, and gives a note of it.
pub(super) fn several_left_out(record: &mut Record, ends_um: &[f64]) -> Option<String> {
    let beside_others: Vec<usize> = outliers(record, ends_um).beside_others.into_iter().filter(|k| record.counts(*k)).collect();
    let around = |group: &[usize]| group[0].max(record.window.start)..(group[group.len() - 1] + 1).min(record.window.end);
    let together = beside_others.chunk_by(|a, b| b - a <= ALONE_WITHIN).map(around);
    let groups: Vec<Range<usize>> = together.filter(|group| !group.is_empty()).collect();
    let first = groups.first()?.clone();
    let readings: usize = groups.iter().map(Range::len).sum();
    if let Some(note) = too_many(record, readings, first.start) {
        return Some(note);
    }
    leave_out(record, groups.iter().cloned().flatten());
    let more = match groups.len() - 1 {
        0 => String::new(),
        1 => ", and in one more place".into(),
        n => format!(", and in {n} more places"),
    };
    let samples = if first.len() == 1 { format!("sample {}", first.end) } else { format!("samples {} to {}", first.start + 1, first.end) };
    Some(format!(
        "{}: readings stand out together, {samples}{more}: no stage does that, and the {readings} there are left out of every fit and figure",
        record.name
    ))
}

/// Said, where so many readings stand out that they are no disturbances.
fn too_many(record: &Record, readings: usize, first: usize) -> Option<String> {
    (readings as f64 > SHARE_MAX * record.window.len() as f64).then(|| {
        format!(
            "{}: {readings} readings stand out (the first is sample {}), too many for disturbances; they are left as they are",
            record.name,
            first + 1
        )
    })
}

fn singles_replaced(record: &mut Record, outliers: &[usize]) -> Option<String> {
    let first = outliers.first()?;
    let y = &mut record.displacement_um;
    let mut farthest_um = 0.0_f64;
    for &k in outliers {
        let beside_um = if (1..y.len() - 1).contains(&k) { 0.5 * (y[k - 1] + y[k + 1]) } else { expected(y, k) };
        farthest_um = farthest_um.max((y[k] - beside_um).abs());
        y[k] = beside_um;
    }
    let (readings, replaced, sample) = match outliers.len() {
        1 => ("1 reading stands alone".into(), "it is replaced by what its neighbours say, and counts in no figure", "sample"),
        n => (
            format!("{n} readings stand alone"),
            "they are replaced by what their neighbours say, and count in no figure",
            "the first is sample",
        ),
    };
    Some(format!(
        "{}: {readings}, up to {:.3} um beside what comes before and after ({sample} {}): no stage does that; {replaced}",
        record.name,
        farthest_um,
        first + 1
    ))
}

/// The least difference between two values that are not the same: one step, where they are those of a converter.
fn least_gap(values: &[f64]) -> f64 {
    levels(values).windows(2).map(|w| w[1] - w[0]).reduce(f64::min).unwrap_or(0.0)
}

/// What the values beside a sample say of it.
fn expected(values: &[f64], k: usize) -> f64 {
    let n = values.len();
    let at_an_end = |y: [f64; 3]| {
        // The straight lines through any two of the next three, so that one of these may be disturbed itself.
        let mut three = [2.0 * y[0] - y[1], y[0] + 0.5 * (y[0] - y[2]), 3.0 * y[1] - 2.0 * y[2]];
        three.sort_by(f64::total_cmp);
        three[1]
    };
    match k {
        0 | 1 => at_an_end([values[k + 1], values[k + 2], values[k + 3]]),
        k if k + 2 >= n => at_an_end([values[k - 1], values[k - 2], values[k - 3]]),
        k => {
            let mut four = [values[k - 2], values[k - 1], values[k + 1], values[k + 2]];
            four.sort_by(f64::total_cmp);
            0.5 * (four[1] + four[2])
        }
    }
}

/// The readings that stand out.
fn outliers(record: &Record, ends_um: &[f64]) -> Outliers {
    let (readings_um, drive_v) = (&record.displacement_um, &record.drive_v);
    let n = readings_um.len();
    if n < 4 * AROUND {
        return Outliers::default();
    }
    let apart: Vec<f64> = (0..n).map(|k| (readings_um[k] - expected(readings_um, k)).abs()).collect();
    let usual_everywhere = mean(&apart);
    let stands_out = |k: usize| {
        if apart[k] <= STANDS_OUT * usual_everywhere {
            return false;
        }
        let around = &apart[k.saturating_sub(AROUND)..(k + AROUND + 1).min(n)];
        let usual = (around.iter().sum::<f64>() - apart[k]) / (around.len() - 1) as f64;
        apart[k] > STANDS_OUT * usual
    };
    let alone = |k: usize| {
        let beside = (k.saturating_sub(ALONE_WITHIN)..(k + ALONE_WITHIN + 1).min(n)).filter(|j| *j != k);
        beside.map(|j| apart[j]).fold(0.0, f64::max) < ALONE_SHARE * apart[k]
    };
    // Where readings run into their own end, the last one before it is no outlier: the bend there is as sharp.
    let at_its_end = |a: usize, b: usize| readings_um[a] == readings_um[b] && ends_um.contains(&readings_um[a]);
    let beside_an_end = |k: usize| (k >= 2 && at_its_end(k - 2, k - 1)) || (k + 2 < n && at_its_end(k + 1, k + 2));
    // What the drive itself has of it, a straight stage would read: the corner of a triangle.
    let gain_um_per_v = peak_to_peak(readings_um) / peak_to_peak(drive_v).max(f64::MIN_POSITIVE);
    let of_the_drive = |k: usize| {
        let reach = k.saturating_sub(MEDIAN_REACHES)..(k + MEDIAN_REACHES + 1).min(n);
        let corner_v = reach.clone().map(|j| (drive_v[j] - expected(drive_v, j)).abs()).fold(0.0, f64::max);
        // In front of the first sample the drive may have stood still.
        let at_an_end = k < AT_AN_END || k + AT_AN_END >= n;
        let change_v = reach.filter(|j| at_an_end && j + 1 < n).map(|j| (drive_v[j + 1] - drive_v[j]).abs()).fold(0.0, f64::max);
        corner_v.max(change_v) * gain_um_per_v
    };
    let mut found: Vec<usize> = (0..n)
        .filter(|k| stands_out(*k) && apart[*k] > AS_THE_DRIVE * of_the_drive(*k) && !beside_an_end(*k) && !near_a_jump(drive_v, *k))
        .collect();
    if !found.is_empty() {
        // One step of a converter more or less is what rounding does, however seldom a rest inside one code shows it.
        let rounding_um = ROUNDED_BY * least_gap(readings_um);
        found.retain(|k| apart[*k] > rounding_um);
    }
    let (single, beside_others) = found.into_iter().partition(|k| alone(*k));
    Outliers { single, beside_others }
}

/// Whether the drive jumped shortly before a sample or between those it is compared with, or at the beginning of a record whose first samples are asked for.
fn near_a_jump(drive_v: &[f64], k: usize) -> bool {
    let change = |j: usize| (drive_v[j + 1] - drive_v[j]).abs();
    let (from, to) = (k.saturating_sub(AROUND), (k + AROUND).min(drive_v.len() - 1));
    let usual = (from..to).map(change).sum::<f64>() / (to - from).max(1) as f64;
    let until = (k + MEDIAN_REACHES + 1).max(AT_AN_END).min(to);
    (from..until).map(change).fold(0.0, f64::max) > JUMP * usual
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::Role;
    use hysteron_sim::noise::WhiteNoise;

    /// A stage with a mode of 0.3 damping at a fifth of the sampling rate, driven by a staircase and then by a sine.
    fn record() -> Record {
        let drive = |k: usize| if k < 3000 { 5.0 * (k / 300 % 7) as f64 } else { 20.0 + 15.0 * (0.02 * k as f64).sin() };
        let drive_v: Vec<f64> = (0..8000).map(drive).collect();
        let mut noise = WhiteNoise::new(0.002, 5);
        let (mut x, mut v) = (0.0, 0.0);
        let omega = 2.0 * std::f64::consts::PI / 5.0;
        let displacement_um = drive_v.iter().map(|u| {
            for _ in 0..50 {
                v += (omega * omega * (0.2 * u - x) - 0.6 * omega * v) / 50.0;
                x += v / 50.0;
            }
            x + noise.next_um()
        });
        let displacement_um = displacement_um.collect();
        Record::new("r", 1000.0, drive_v, displacement_um)
    }

    #[test]
    fn the_readings_that_were_disturbed_are_found_and_no_other() {
        let clean = record();
        assert_eq!(outliers(&clean, &[]), Outliers::default());
        let disturbed = [0, 777, 2260, 3800, 4411, 4500, 7990, 7999];
        let mut record = clean.clone();
        for (i, k) in disturbed.iter().enumerate() {
            record.displacement_um[*k] += [0.7, -0.5, 1.5][i % 3];
        }
        assert_eq!(outliers(&record, &[]), Outliers { single: disturbed.to_vec(), beside_others: Vec::new() });
        let (notes, samples) = replaced(&mut record, &[]).unwrap();
        assert_eq!(samples, disturbed);
        assert!(notes.contains("8 readings stand alone") && notes.contains("the first is sample 1)"), "{notes}");
        for k in disturbed {
            assert!((record.displacement_um[k] - clean.displacement_um[k]).abs() < 0.03, "{k}");
        }
        assert_eq!((replaced(&mut record, &[]), several_left_out(&mut record, &[])), (None, None));
    }

    /// A triangle met by a stage without dynamics, hardly any noise: its corners are as sharp as the drive's.
    #[test]
    fn corners_of_the_drive_are_no_outliers() {
        for noise_um in [0.0, 1e-4, 1e-3] {
            let drive = |k: i32| 80.0 * (1.0 - (f64::from(k.rem_euclid(400)) / 200.0 - 1.0).abs());
            let mut noise = WhiteNoise::new(noise_um, 8);
            let drive_v: Vec<f64> = (0..4000).map(drive).collect();
            let displacement_um: Vec<f64> = (0..4000).map(|k| 0.1 * drive(k - 1) + noise.next_um()).collect();
            let mut record = Record::new("r", 1000.0, drive_v, displacement_um);
            assert_eq!(outliers(&record, &[]), Outliers::default(), "{noise_um}");
            record.displacement_um[1234] += 1.5;
            assert_eq!(outliers(&record, &[]).single, [1234], "{noise_um}");
        }
    }

    #[test]
    fn many_are_said_and_left_alone() {
        let mut record = record();
        (3100..7900).step_by(20).for_each(|k| record.displacement_um[k] += 2.0);
        let before = record.displacement_um.clone();
        let (note, samples) = replaced(&mut record, &[]).unwrap();
        assert!(note.contains("too many") && samples.is_empty(), "{note}");
        assert_eq!(record.displacement_um, before);
    }

    #[test]
    fn several_together_are_left_out_whatever_they_read() {
        // Noise on three, the same value six times, and one at the very end of another record's window.
        let mut record = record();
        (4000..4003).for_each(|k| record.displacement_um[k] += 2.0 + 0.3 * k as f64 % 0.7);
        (6000..6006).for_each(|k| record.displacement_um[k] = 9.99);
        let before = record.displacement_um.clone();
        assert_eq!(replaced(&mut record, &[]), None);
        let note = several_left_out(&mut record, &[]).unwrap();
        assert!(note.contains("and in one more place"), "{note}");
        assert_eq!(record.displacement_um, before);
        assert!((4000..4003).chain(6000..6006).all(|k| !record.counts(k)), "{:?}", record.left_out);
        assert!(record.counted().count() > 8000 - 25);
    }

    #[test]
    fn what_lies_outside_the_window_is_of_another_record() {
        let mut record = record();
        [2000, 4411].iter().for_each(|k| record.displacement_um[*k] += 2.0);
        record.window = 3500..8000;
        let (note, _) = replaced(&mut record, &[]).unwrap();
        assert!(note.contains("1 reading stands alone") && note.contains("sample 4412"), "{note}");
    }

    #[test]
    fn where_readings_run_into_their_end_is_no_outlier() {
        let drive_v: Vec<f64> = (0..6000).map(|k| 50.0 - 50.0 * (0.003 * f64::from(k)).cos()).collect();
        let displacement_um = drive_v.iter().map(|u| (0.1 * u + if *u > 90.0 { 0.2 } else { 0.0 }).min(9.1)).collect();
        let mut record = Record::new("r", 1000.0, drive_v, displacement_um);
        assert_eq!((replaced(&mut record, &[9.1]), several_left_out(&mut record, &[9.1])), (None, None));
    }

    #[test]
    fn coarse_readings_have_no_outliers() {
        let mut record = record();
        record.displacement_um.iter_mut().for_each(|y| *y = (*y / 0.05).round() * 0.05);
        assert_eq!((replaced(&mut record, &[]), several_left_out(&mut record, &[])), (None, None));
    }

    /// Noise of an eighth of a step, which seldom leaves its code: the codes beside it are readings as others are.
    #[test]
    fn a_code_beside_the_usual_one_is_no_disturbance() {
        let mut noise = WhiteNoise::new(0.3, 9);
        let readings_um = (0..12_000).map(|_| 0.0024 * ((0.45 + noise.next_um()) / 2.4).round()).collect();
        let mut record = Record::new("rest", 20_000.0, vec![0.0; 12_000], readings_um).with_role(Role::Noise);
        let before = record.displacement_um.clone();
        assert!(before.iter().any(|um| *um != 0.0) && before.iter().filter(|um| **um != 0.0).count() < 600);
        assert!(replaced(&mut record, &[]).is_none() && several_left_out(&mut record, &[]).is_none());
        assert_eq!(record.displacement_um, before);
    }
}
