//! Readings that a disturbance made: a bit that flipped on the way, a spike on a line. One of them weighs in
//! a sum of squares as much as thousands of others, and no effect of a stage makes it: whatever has a mass or
//! a filter moves the readings beside it too.
//!
//! A reading is compared with the median of the two before and the two after it. That difference is noise
//! where readings follow a smooth or a monotone course, however steep (a median leaves edges as they are); a
//! reading stands alone where it is many times what the difference usually is around it, and the differences
//! beside it are small. After a jump of the drive nothing is taken for an outlier: the first overshoot of a
//! fast mode is as narrow.

use super::range;
use crate::dataset::data_set::Dataset;
use crate::dataset::issue::{Issue, IssueKind, Severity};
use crate::dataset::reading_grid::levels;
use crate::dataset::record::Record;
use crate::statistics::{extremes, mean, peak_to_peak};
use hysteron_sim::chain::InitialState;
use std::ops::Range;

/// A reading stands out where it is so many times as far from its neighbours as readings usually are.
const STANDS_OUT: f64 = 15.0;
/// Samples on each side that say what is usual.
const AROUND: usize = 64;
/// Samples on each side in which nothing else may stand out.
pub(crate) const ALONE_WITHIN: usize = 8;
/// Share of the difference that those beside it may have.
pub(crate) const ALONE_SHARE: f64 = 0.2;
/// A drive jumps where it changes by so many times what it changes by on average around.
const JUMP: f64 = 8.0;
/// Samples on each side that a reading is compared with.
const MEDIAN_REACHES: usize = 2;
/// Samples at the beginning of a record in which a jump of the drive counts for those before it too.
const AT_AN_END: usize = 4;
/// A corner of the drive makes a corner of the readings: a reading is no outlier if it stands out by less
/// than so many times what a straight stage would read there.
const AS_THE_DRIVE: f64 = 3.0;
/// Steps of a converter by which rounding and a noise below one step put a reading beside the mean of two
/// others.
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

/// Readings that stand alone: spectra find even steps where they are interpolated, and they count in nothing.
pub(super) fn single(dataset: &Dataset) -> Vec<Issue> {
    of_all(dataset, |record, ends_um| {
        // What lies in front of a window shows noise too, unless it is another record's of the same tape.
        let of_the_tape = dataset
            .records
            .iter()
            .filter(|other| other.name != record.name && other.source == record.source);
        let of_others: Vec<&Range<usize>> = of_the_tape.map(|other| &other.window).collect();
        let mine = |k: &usize| {
            record.counts(*k)
                && (record.window.contains(k) || !of_others.iter().any(|window| window.contains(k)))
        };
        let single: Vec<usize> = outliers(record, ends_um)
            .single
            .into_iter()
            .filter(mine)
            .collect();
        let first_sample = single.first()? + 1;
        if let Some(kept) = too_many(record, single.len(), first_sample) {
            return Some(kept);
        }
        let samples: Vec<Range<usize>> = single.iter().map(|k| *k..k + 1).collect();
        let mut mended = record.clone();
        interpolate(&mut mended, &samples);
        let apart_um = |k: &usize| (record.displacement_um[*k] - mended.displacement_um[*k]).abs();
        let farthest_um = single.iter().map(apart_um).fold(0.0, f64::max);
        let kind = IssueKind::OutliersReplaced {
            samples: single.len(),
            first_sample,
            farthest_um,
        };
        Some(Issue::of(&record.name, Severity::Corrects, kind).with_samples(samples))
    })
}

/// Readings that stand out beside one another, with those between them.
pub(super) fn together(dataset: &Dataset) -> Vec<Issue> {
    of_all(dataset, |record, ends_um| {
        let beside_others: Vec<usize> = outliers(record, ends_um)
            .beside_others
            .into_iter()
            .filter(|k| record.counts(*k))
            .collect();
        let around = |group: &[usize]| {
            group[0].max(record.window.start)..(group[group.len() - 1] + 1).min(record.window.end)
        };
        let groups = beside_others
            .chunk_by(|a, b| b - a <= ALONE_WITHIN)
            .map(around);
        let groups: Vec<Range<usize>> = groups.filter(|group| !group.is_empty()).collect();
        let first = groups.first()?.clone();
        let samples: usize = groups.iter().map(Range::len).sum();
        if let Some(kept) = too_many(record, samples, first.start + 1) {
            return Some(kept);
        }
        let kind = IssueKind::OutliersLeftOut {
            samples,
            places: groups.len(),
            first_sample: first.start + 1,
            last_sample: first.end,
        };
        Some(Issue::of(&record.name, Severity::Corrects, kind).with_samples(groups))
    })
}

fn of_all(dataset: &Dataset, of_record: impl Fn(&Record, &[f64]) -> Option<Issue>) -> Vec<Issue> {
    let records = &dataset.records;
    let ends_um = range::ends_um(records);
    records
        .iter()
        .filter_map(|record| of_record(record, &ends_um))
        .collect()
}

/// So many readings stand out that they are no disturbances.
fn too_many(record: &Record, samples: usize, first_sample: usize) -> Option<Issue> {
    let is_so = samples as f64 > SHARE_MAX * record.window.len() as f64;
    is_so.then(|| {
        Issue::of(
            &record.name,
            Severity::Notes,
            IssueKind::OutliersKept {
                samples,
                first_sample,
            },
        )
    })
}

/// Puts what its neighbours say in the place of each of these readings.
pub(super) fn interpolate(record: &mut Record, samples: &[Range<usize>]) {
    let y = &mut record.displacement_um;
    for k in samples.iter().cloned().flatten() {
        y[k] = if (1..y.len() - 1).contains(&k) {
            0.5 * (y[k - 1] + y[k + 1])
        } else {
            expected(y, k)
        };
    }
}

/// The least difference between two values that are not the same: one step, where they are those of a
/// converter.
fn least_gap(values: &[f64]) -> f64 {
    levels(values)
        .windows(2)
        .map(|w| w[1] - w[0])
        .reduce(f64::min)
        .unwrap_or(0.0)
}

/// What the values beside a sample say of it.
fn expected(values: &[f64], k: usize) -> f64 {
    let n = values.len();
    let at_an_end = |y: [f64; 3]| {
        // The straight lines through any two of the next three, so that one of these may be disturbed itself.
        let mut three = [
            2.0 * y[0] - y[1],
            y[0] + 0.5 * (y[0] - y[2]),
            3.0 * y[1] - 2.0 * y[2],
        ];
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

/// What sizes around one usually are.
fn usual_around(sizes: &[f64], k: usize) -> f64 {
    let around = &sizes[k.saturating_sub(AROUND)..(k + AROUND + 1).min(sizes.len())];
    (around.iter().sum::<f64>() - sizes[k]) / (around.len() - 1) as f64
}

/// A size is many times what sizes are everywhere, and around it.
pub(crate) fn stands_out(sizes: &[f64], usual_everywhere: f64, k: usize) -> bool {
    sizes[k] > STANDS_OUT * usual_everywhere && sizes[k] > STANDS_OUT * usual_around(sizes, k)
}

/// Those beside a size are small.
pub(crate) fn is_alone(sizes: &[f64], k: usize) -> bool {
    let (from, to) = (k.saturating_sub(ALONE_WITHIN), k + ALONE_WITHIN + 1);
    let beside = (from..to.min(sizes.len())).filter(|j| *j != k);
    beside.map(|j| sizes[j]).fold(0.0, f64::max) < ALONE_SHARE * sizes[k]
}

/// The readings that stand out.
fn outliers(record: &Record, ends_um: &[f64]) -> Outliers {
    let (readings_um, drive_v) = (&record.displacement_um, &record.drive_v);
    let n = readings_um.len();
    if n < 4 * AROUND {
        return Outliers::default();
    }
    let apart: Vec<f64> = (0..n)
        .map(|k| (readings_um[k] - expected(readings_um, k)).abs())
        .collect();
    let usual_everywhere = mean(&apart);
    let usual = |k: usize| usual_everywhere.max(usual_around(&apart, k));
    // Where readings run into their own end, the last one before it is no outlier: the bend there is as
    // sharp.
    let at_its_end =
        |a: usize, b: usize| readings_um[a] == readings_um[b] && ends_um.contains(&readings_um[a]);
    let beside_an_end =
        |k: usize| (k >= 2 && at_its_end(k - 2, k - 1)) || (k + 2 < n && at_its_end(k + 1, k + 2));
    // Where the straight lines before and behind cross, readings turn or a ramp ends.
    let is_corner = |k: usize| {
        (3..n - 3).contains(&k) && {
            let [before, behind] = [[k - 1, k - 2, k - 3], [k + 1, k + 2, k + 3]]
                .map(|side| side.map(|j| readings_um[j]));
            let on = |[near, next, _]: [f64; 3], steps: f64| near + steps * (near - next);
            let bent = |[near, next, far]: [f64; 3]| (near - 2.0 * next + far).abs();
            let cross = (before[0] - on(behind, 2.0)) * (on(before, 2.0) - behind[0]) <= 0.0;
            let (a, b) = (on(before, 1.0), on(behind, 1.0));
            let beyond_um = (a.min(b) - readings_um[k]).max(readings_um[k] - a.max(b));
            cross && beyond_um.max(bent(before)).max(bent(behind)) <= STANDS_OUT * usual(k)
        }
    };
    // What the drive itself has of it, a straight stage would read: the corner of a triangle.
    let drive_span_v = peak_to_peak(drive_v);
    let gain_um_per_v = if drive_span_v > 0.0 {
        peak_to_peak(readings_um) / drive_span_v
    } else {
        0.0
    };
    let of_the_drive = |k: usize| {
        let reach = k.saturating_sub(MEDIAN_REACHES)..(k + MEDIAN_REACHES + 1).min(n);
        let corner_v = reach
            .clone()
            .map(|j| (drive_v[j] - expected(drive_v, j)).abs())
            .fold(0.0, f64::max);
        // In front of the first sample the drive may have stood still, of a virgin record at the lower end.
        let at_an_end = k < AT_AN_END || k + AT_AN_END >= n;
        let is_virgin = k < AT_AN_END && record.initial_state == InitialState::Virgin;
        let begins_v = if is_virgin {
            drive_v[0] - extremes(drive_v).0
        } else {
            0.0
        };
        let change_v = reach
            .filter(|j| at_an_end && j + 1 < n)
            .map(|j| (drive_v[j + 1] - drive_v[j]).abs())
            .fold(0.0, f64::max);
        corner_v.max(change_v).max(begins_v) * gain_um_per_v
    };
    let mut found: Vec<usize> = (0..n)
        .filter(|k| {
            stands_out(&apart, usual_everywhere, *k)
                && apart[*k] > AS_THE_DRIVE * of_the_drive(*k)
                && !is_corner(*k)
                && !beside_an_end(*k)
                && !near_a_jump(drive_v, *k)
        })
        .collect();
    if !found.is_empty() {
        // One step of a converter more or less is what rounding does, however seldom a rest inside one code
        // shows it.
        let rounding_um = ROUNDED_BY * least_gap(readings_um);
        found.retain(|k| apart[*k] > rounding_um);
    }
    let (single, beside_others) = found.into_iter().partition(|k| is_alone(&apart, *k));
    Outliers {
        single,
        beside_others,
    }
}

/// Whether the drive jumped shortly before a sample or between those it is compared with, or at the beginning
/// of a record whose first samples are asked for.
pub(crate) fn near_a_jump(drive_v: &[f64], k: usize) -> bool {
    let change = |j: usize| (drive_v[j + 1] - drive_v[j]).abs();
    let (from, to) = (
        k.saturating_sub(AROUND),
        (k + AROUND).min(drive_v.len() - 1),
    );
    let usual = (from..to).map(change).sum::<f64>() / (to - from).max(1) as f64;
    let until = (k + MEDIAN_REACHES + 1).max(AT_AN_END).min(to);
    (from..until).map(change).fold(0.0, f64::max) > JUMP * usual
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::record::Role;
    use hysteron_sim::noise::WhiteNoise;

    /// What the check finds in a record whose readings end there, corrected.
    fn checked(check: fn(&Dataset) -> Vec<Issue>, record: &mut Record) -> Option<IssueKind> {
        let mut dataset = Dataset::unchecked("d", 0.0, 100.0, vec![record.clone()]);
        let issue = check(&dataset).into_iter().next()?;
        crate::dataset::checks::apply(&mut dataset, &issue);
        *record = dataset.records.remove(0);
        Some(issue.kind)
    }

    /// A stage with a mode of 0.3 damping at a fifth of the sampling rate, driven by a staircase and then by
    /// a sine.
    fn record() -> Record {
        let drive = |k: usize| {
            if k < 3000 {
                5.0 * (k / 300 % 7) as f64
            } else {
                20.0 + 15.0 * (0.02 * k as f64).sin()
            }
        };
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
        assert_eq!(
            outliers(&record, &[]),
            Outliers {
                single: disturbed.to_vec(),
                beside_others: Vec::new()
            }
        );
        let found = checked(single, &mut record).unwrap();
        assert!(
            matches!(
                found,
                IssueKind::OutliersReplaced {
                    samples: 8,
                    first_sample: 1,
                    ..
                }
            ),
            "{found:?}"
        );
        for k in disturbed {
            assert!(!record.counts(k));
            assert!(
                (record.displacement_um[k] - clean.displacement_um[k]).abs() < 0.03,
                "{k}"
            );
        }
        assert_eq!(
            (checked(single, &mut record), checked(together, &mut record)),
            (None, None)
        );
    }

    /// A triangle met by a stage without dynamics, hardly any noise: its corners are as sharp as the drive's.
    #[test]
    fn corners_of_the_drive_are_no_outliers() {
        for noise_um in [0.0, 1e-4, 1e-3] {
            let drive = |k: i32| 80.0 * (1.0 - (f64::from(k.rem_euclid(400)) / 200.0 - 1.0).abs());
            let mut noise = WhiteNoise::new(noise_um, 8);
            let drive_v: Vec<f64> = (0..4000).map(drive).collect();
            let displacement_um: Vec<f64> = (0..4000)
                .map(|k| 0.1 * drive(k - 1) + noise.next_um())
                .collect();
            let mut record = Record::new("r", 1000.0, drive_v, displacement_um);
            assert_eq!(outliers(&record, &[]), Outliers::default(), "{noise_um}");
            record.displacement_um[1234] += 1.5;
            assert_eq!(outliers(&record, &[]).single, [1234], "{noise_um}");
        }
    }

    #[test]
    fn corners_of_the_readings_are_no_outliers() {
        let mut record = record();
        // A sine faster than the amplifier: triangles behind a smooth drive.
        let mut noise = WhiteNoise::new(0.0002, 5);
        let mut at_um = 0.0_f64;
        for k in 4000..4300 {
            let wanted_um = 0.2 * (20.0 + 15.0 * (0.3 * k as f64).sin());
            record.drive_v[k] = 5.0 * wanted_um;
            at_um += (wanted_um - at_um).clamp(-0.05, 0.05);
            record.displacement_um[k] = at_um + noise.next_um();
        }
        let among = |of: &Outliers| {
            let all = of.single.iter().chain(&of.beside_others);
            all.filter(|k| (4050..4250).contains(*k)).count()
        };
        assert_eq!(among(&outliers(&record, &[])), 0);
        record.displacement_um[4100] += 3.0;
        assert!(among(&outliers(&record, &[])) > 0);
    }

    /// An amplifier of limited slew arrives at a step: the ramp of the readings ends within a sample.
    #[test]
    fn the_end_of_a_ramp_is_no_outlier() {
        let mut noise = WhiteNoise::new(0.001, 5);
        let wanted_um = |k: u32| if k % 500 < 250 { 0.0 } else { 8.03 };
        let mut at_um = 0.0_f64;
        let arriving = (0..8000).map(|k| {
            at_um += (wanted_um(k) - at_um).clamp(-0.08, 0.08);
            at_um + noise.next_um()
        });
        let displacement_um = arriving.collect();
        let drive_v = (0..8000).map(|k| 10.0 * wanted_um(k)).collect();
        let mut record = Record::new("r", 1000.0, drive_v, displacement_um);
        assert_eq!(outliers(&record, &[]), Outliers::default());
        record.displacement_um[4200] += 0.3;
        assert_eq!(outliers(&record, &[]).single, [4200]);
    }

    /// The first reading stands before the drive of its row acts: of a virgin record it is zero, wherever the
    /// drive begins.
    #[test]
    fn the_first_reading_of_a_virgin_record_is_no_outlier() {
        let mut record = record();
        record.drive_v.iter_mut().for_each(|u| *u = 35.0 - *u);
        record
            .displacement_um
            .iter_mut()
            .for_each(|y| *y = 7.0 - *y);
        record.displacement_um[0] = 0.0;
        record.initial_state = InitialState::Virgin;
        assert_eq!(outliers(&record, &[]), Outliers::default());
        record.initial_state = InitialState::Unknown;
        assert_eq!(outliers(&record, &[]).single, [0]);
    }

    #[test]
    fn many_are_said_and_left_alone() {
        let mut record = record();
        (3100..7900)
            .step_by(20)
            .for_each(|k| record.displacement_um[k] += 2.0);
        let before = record.displacement_um.clone();
        assert_eq!(
            checked(single, &mut record),
            Some(IssueKind::OutliersKept {
                samples: 240,
                first_sample: 3101
            })
        );
        assert_eq!(record.displacement_um, before);
    }

    #[test]
    fn several_together_are_left_out_whatever_they_read() {
        // Noise on three, the same value six times, and one at the very end of another record's window.
        let mut record = record();
        (4000..4003).for_each(|k| record.displacement_um[k] += 2.0 + 0.3 * k as f64 % 0.7);
        (6000..6006).for_each(|k| record.displacement_um[k] = 9.99);
        let before = record.displacement_um.clone();
        assert_eq!(checked(single, &mut record), None);
        let found = checked(together, &mut record).unwrap();
        assert!(
            matches!(found, IssueKind::OutliersLeftOut { places: 2, .. }),
            "{found:?}"
        );
        assert_eq!(record.displacement_um, before);
        assert!(
            (4000..4003).chain(6000..6006).all(|k| !record.counts(k)),
            "{:?}",
            record.left_out
        );
        assert!(record.counted().count() > 8000 - 25);
    }

    /// What no other record of the tape has, in front of a window, shows noise, and is mended too.
    #[test]
    fn what_another_record_of_the_tape_has_is_mended_there() {
        let mut whole = record();
        [1000, 2260, 4411]
            .iter()
            .for_each(|k| whole.displacement_um[*k] += 2.0);
        let part = |name: &str, window| Record {
            name: name.into(),
            window,
            ..whole.clone()
        };
        let found = |records: Vec<Record>| {
            let dataset = Dataset::unchecked("d", 0.0, 100.0, records);
            let issues = single(&dataset);
            issues
                .into_iter()
                .map(|issue| (issue.record.unwrap(), issue.samples))
                .collect::<Vec<_>>()
        };
        let single_at = |samples: &[usize]| samples.iter().map(|k| *k..k + 1).collect::<Vec<_>>();
        let both = found(vec![part("one", 1500..3500), part("two", 3500..8000)]);
        assert_eq!(
            both,
            [
                ("one".into(), single_at(&[1000, 2260])),
                ("two".into(), single_at(&[1000, 4411]))
            ]
        );
        assert_eq!(
            found(vec![part("two", 3500..8000)]),
            [("two".into(), single_at(&[1000, 2260, 4411]))]
        );
    }

    #[test]
    fn where_readings_run_into_their_end_is_no_outlier() {
        let drive_v: Vec<f64> = (0..6000)
            .map(|k| 50.0 - 50.0 * (0.003 * f64::from(k)).cos())
            .collect();
        let displacement_um = drive_v
            .iter()
            .map(|u| (0.1 * u + if *u > 90.0 { 0.2 } else { 0.0 }).min(9.1))
            .collect();
        let mut record = Record::new("r", 1000.0, drive_v, displacement_um);
        assert_eq!(
            (checked(single, &mut record), checked(together, &mut record)),
            (None, None)
        );
    }

    #[test]
    fn coarse_readings_have_no_outliers() {
        let mut record = record();
        record
            .displacement_um
            .iter_mut()
            .for_each(|y| *y = (*y / 0.05).round() * 0.05);
        assert_eq!(
            (checked(single, &mut record), checked(together, &mut record)),
            (None, None)
        );
    }

    /// Noise of an eighth of a step, which seldom leaves its code: the codes beside it are readings as others
    /// are.
    #[test]
    fn a_code_beside_the_usual_one_is_no_disturbance() {
        let mut noise = WhiteNoise::new(0.3, 9);
        let readings_um = (0..12_000)
            .map(|_| 0.0024 * ((0.45 + noise.next_um()) / 2.4).round())
            .collect();
        let mut record =
            Record::new("rest", 20_000.0, vec![0.0; 12_000], readings_um).with_role(Role::Noise);
        let before = record.displacement_um.clone();
        assert!(
            before.iter().any(|um| *um != 0.0)
                && before.iter().filter(|um| **um != 0.0).count() < 600
        );
        assert_eq!(
            (checked(single, &mut record), checked(together, &mut record)),
            (None, None)
        );
        assert_eq!(record.displacement_um, before);
    }
}
