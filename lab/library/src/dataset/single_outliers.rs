//! Readings that stand alone: a bit that flipped on the way, a spike on a line. One of them weighs in a sum of squares as much as thousands of
//! others, and no effect of a stage makes it: whatever has a mass or a filter moves the readings beside it too.
//!
//! A reading is compared with the median of the two before and the two after it. That difference is noise where readings follow a smooth or a
//! monotone course, however steep (a median leaves edges as they are); a reading stands alone where it is many times what the difference
//! usually is around it, and the differences beside it are small. After a jump of the drive nothing is taken for an outlier: the
//! first overshoot of a fast mode is as narrow.

use super::Record;
use crate::statistics::mean;

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
/// More than this share of all readings are no single ones.
const SHARE_MAX: f64 = 0.002;

/// Puts the mean of its two neighbours in the place of each reading that stands alone, and gives a note of it.
pub(super) fn replaced(record: &mut Record) -> Option<String> {
    let outliers = single_outliers(&record.displacement_um, &record.drive_v);
    let first = outliers.first()?;
    if outliers.len() as f64 > SHARE_MAX * record.displacement_um.len() as f64 {
        return Some(format!(
            "{}: {} readings stand alone, too many for single disturbances; they are left as they are",
            record.name,
            outliers.len()
        ));
    }
    let y = &mut record.displacement_um;
    let mut farthest_um = 0.0_f64;
    for &k in &outliers {
        let beside_um = 0.5 * (y[k - 1] + y[k + 1]);
        farthest_um = farthest_um.max((y[k] - beside_um).abs());
        y[k] = beside_um;
    }
    let (readings, they, sample) = match outliers.len() {
        1 => ("1 reading stands alone".into(), "it is", "sample"),
        n => (format!("{n} readings stand alone"), "they are", "the first is sample"),
    };
    Some(format!(
        "{}: {readings}, up to {:.3} um beside what comes before and after ({sample} {}): no stage does that, and {they} replaced by the mean of \
         both neighbours",
        record.name,
        farthest_um,
        first + 1
    ))
}

/// The samples whose readings stand alone, in order.
fn single_outliers(readings_um: &[f64], drive_v: &[f64]) -> Vec<usize> {
    let n = readings_um.len();
    if n < 4 * AROUND {
        return Vec::new();
    }
    let beside = |k: usize| {
        let mut four = [readings_um[k - 2], readings_um[k - 1], readings_um[k + 1], readings_um[k + 2]];
        four.sort_by(f64::total_cmp);
        0.5 * (four[1] + four[2])
    };
    let apart: Vec<f64> = (0..n).map(|k| if k < 2 || k + 2 >= n { 0.0 } else { (readings_um[k] - beside(k)).abs() }).collect();
    let usual_everywhere = mean(&apart);
    let stands_out = |k: usize| {
        if apart[k] <= STANDS_OUT * usual_everywhere {
            return false;
        }
        let around = &apart[k.saturating_sub(AROUND)..(k + AROUND + 1).min(n)];
        let usual = (around.iter().sum::<f64>() - apart[k]) / (around.len() - 1) as f64;
        let beside = (k.saturating_sub(ALONE_WITHIN)..(k + ALONE_WITHIN + 1).min(n)).filter(|j| *j != k);
        apart[k] > STANDS_OUT * usual && beside.map(|j| apart[j]).fold(0.0, f64::max) < ALONE_SHARE * apart[k]
    };
    (2..n - 2).filter(|k| stands_out(*k) && !after_a_jump(drive_v, *k)).collect()
}

/// Whether the drive jumped shortly before a sample.
fn after_a_jump(drive_v: &[f64], k: usize) -> bool {
    let change = |j: usize| (drive_v[j + 1] - drive_v[j]).abs();
    let (from, to) = (k.saturating_sub(AROUND), (k + AROUND).min(drive_v.len() - 1));
    let usual = (from..to).map(change).sum::<f64>() / (to - from).max(1) as f64;
    (from..k).map(change).fold(0.0, f64::max) > JUMP * usual
}

#[cfg(test)]
mod tests {
    use super::*;
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
        assert_eq!(single_outliers(&clean.displacement_um, &clean.drive_v), Vec::<usize>::new());
        let disturbed = [777, 2260, 3800, 4411, 4500, 7990];
        let mut record = clean.clone();
        for (i, k) in disturbed.iter().enumerate() {
            record.displacement_um[*k] += [0.7, -0.5, 1.5][i % 3];
        }
        assert_eq!(single_outliers(&record.displacement_um, &record.drive_v), disturbed);
        let note = replaced(&mut record).unwrap();
        assert!(note.contains("6 readings stand alone") && note.contains("the first is sample 778"), "{note}");
        for k in disturbed {
            assert!((record.displacement_um[k] - clean.displacement_um[k]).abs() < 0.03, "{k}");
        }
        assert_eq!(replaced(&mut record), None);
    }

    #[test]
    fn many_are_said_and_left_alone() {
        let mut record = record();
        (3100..7900).step_by(100).for_each(|k| record.displacement_um[k] += 2.0);
        let before = record.displacement_um.clone();
        assert!(replaced(&mut record).unwrap().contains("too many"));
        assert_eq!(record.displacement_um, before);
    }

    #[test]
    fn coarse_readings_have_no_outliers() {
        let mut record = record();
        record.displacement_um.iter_mut().for_each(|y| *y = (*y / 0.05).round() * 0.05);
        assert_eq!(replaced(&mut record), None);
    }
}
