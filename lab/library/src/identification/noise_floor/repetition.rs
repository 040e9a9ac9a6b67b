//! The noise between repetitions of one drive: periods inside a record, and records or parts of records with
//! the same drive.
//!
//! Both are found from the drive alone; a manifest may declare them as well. What differs between two
//! repetitions is noise, twice; in front of where it has settled it is also what the actuator remembers from
//! before, and that part is left out. Drift and lines are taken out of the difference as they are of a record
//! at rest.

use super::estimate::{FloorEstimate, FloorEvidence};
use super::random_part::random_part;
use crate::dataset::{Dataset, Periods, Record, Role};
use crate::identification::fit::{dot, rms};
use crate::spectrum::autocorrelation;
use crate::statistics::{mean, pattern_rms, peak_to_peak};
use std::ops::Range;

/// Least samples of a repetition that say something of the noise.
const SAMPLES_MIN: usize = 200;
/// A drive repeats itself where it differs from before by less than this share of its span: less than any
/// converter resolves.
const SAME_DRIVE: f64 = 2e-5;
/// A measured drive differs by its noise: by no more than this share of the actuator's span, RMS, ..
const READ_BACK: f64 = 5e-4;
/// .. without a pattern: no more than this share of the differences has one.
const PATTERN_MAX: f64 = 0.5;
/// Standard deviations of a read-back drive's noise within which it is the same.
const READ_BACK_Z: f64 = 6.0;
/// A drive that spans less than this share of the actuator's does not move it.
const MOVES: f64 = 0.01;
/// Parts of a difference by which it is seen where it has settled.
const PARTS: usize = 20;
/// A part belongs to the settled rest where its RMS is below this times the median of the later half.
const SETTLED: f64 = 1.5;
/// Pairs of neighbouring samples by which it is seen whether a difference is noise.
const PAIRS_SEEN: usize = 2000;
/// Lags that are looked at as periods.
const LAGS_MAX: usize = 12;
/// Neighbours of such a lag that are looked at where the drive was read back: each of them takes some time.
const NEIGHBOURS_READ_BACK: usize = 200;
/// A record may be of so many whole periods, and of nothing else.
const WHOLE_PERIODS_MAX: usize = 12;

/// What repetitions of a drive show.
pub(super) struct Repeated {
    /// Of the readings.
    pub(super) estimate: FloorEstimate,
    /// RMS noise in the column of the drive, V; zero where the same was commanded again.
    pub(super) drive_noise_v: f64,
}

/// What the periods of a record show: those that its manifest names, or those that its drive has.
pub(super) fn of_periods(record: &Record, span_v: f64) -> Option<Repeated> {
    // A signal of the user's own need not repeat with the drive, and what follows it is no noise.
    if !record.auxiliary.is_empty() {
        return None;
    }
    // What lies in front of the window shows the noise as well.
    let begins = [record.window.start, 0];
    let begins = if record.window.start == 0 {
        &begins[..1]
    } else {
        &begins
    };
    let found = || {
        begins
            .iter()
            .find_map(|begin| find_periods(record, *begin, span_v))
    };
    let periods = record.periods.filter(|p| p.count >= 2).or_else(found)?;
    let from = periods.from.max(1);
    let end = periods.from + (periods.count - 1) * periods.length;
    let both_count = |k: &usize| record.counts(*k) && record.counts(k + periods.length);
    let compared: Vec<usize> = (from..end).filter(both_count).collect();
    let earlier_and_later = |signal: &[f64]| -> Differing {
        Differing::of(
            compared
                .iter()
                .map(|k| (signal[*k], signal[k + periods.length])),
        )
    };
    let (drive, reading) = (
        earlier_and_later(&record.drive_v),
        earlier_and_later(&record.displacement_um),
    );
    let settled = settled_part(&reading.difference)?;
    // A measured force need not have the drive's period: what follows its difference is no noise either.
    let force_n: Option<Vec<f64>> = record.force_n.as_ref().map(|f| {
        compared
            .iter()
            .map(|k| f[k + periods.length] - f[*k])
            .collect()
    });
    let force = force_n.as_deref().map(|f| (f, settled.start));
    let drive_noise_v = drive.noise(settled.clone(), SAME_DRIVE * span_v);
    let random = reading.but_for_another_size(&drive, drive_noise_v, settled.clone());
    let rms_um = random_part(&random, record.sample_rate_hz, force) / std::f64::consts::SQRT_2;
    let estimate = FloorEstimate::new(
        FloorEvidence::Periods,
        vec![record.name.clone()],
        rms_um,
        settled.len(),
    );
    Some(Repeated {
        estimate,
        drive_noise_v,
    })
}

/// What pairs of records with the same drive show.
pub(super) fn of_pairs(dataset: &Dataset) -> Vec<Repeated> {
    let span_v = dataset.drive_max_v - dataset.drive_min_v;
    let driven: Vec<&Record> = dataset
        .records
        .iter()
        .filter(|r| r.role != Role::Noise)
        .collect();
    let mut out: Vec<Repeated> = Vec::new();
    for (i, first) in driven.iter().enumerate() {
        for second in &driven[i + 1..] {
            out.extend(of_pair(first, second, span_v));
        }
    }
    out
}

fn of_pair(first: &Record, second: &Record, span_v: f64) -> Option<Repeated> {
    let takes_part = |record: &Record| record.force_n.is_some() || !record.auxiliary.is_empty();
    if first.sample_rate_hz != second.sample_rate_hz || takes_part(first) || takes_part(second) {
        return None;
    }
    // The same from the end on backwards as far as it goes: what came before may differ.
    let declared = first.repeat_of.as_ref() == Some(&second.name)
        || second.repeat_of.as_ref() == Some(&first.name);
    let end = first.window.end.min(second.window.end);
    let start = if declared {
        first.window.start.max(second.window.start)
    } else {
        common_drive(first, second, end, span_v)?
    };
    if end < start + SAMPLES_MIN {
        return None;
    }
    let both_count = |k: &usize| first.counts(*k) && second.counts(*k);
    let compared: Vec<usize> = (start..end).filter(both_count).collect();
    let drive = Differing::of(
        compared
            .iter()
            .map(|k| (second.drive_v[*k], first.drive_v[*k])),
    );
    let reading = Differing::of(
        compared
            .iter()
            .map(|k| (second.displacement_um[*k], first.displacement_um[*k])),
    );
    let settled = settled_part(&reading.difference)?;
    let drive_noise_v = drive.noise(settled.clone(), SAME_DRIVE * span_v);
    let random = reading.but_for_another_size(&drive, drive_noise_v, settled.clone());
    let rms_um = random_part(&random, first.sample_rate_hz, None) / std::f64::consts::SQRT_2;
    // The same samples under two names are no repetition.
    (rms_um > 0.0).then(|| Repeated {
        estimate: FloorEstimate::new(
            FloorEvidence::Repeats,
            vec![first.name.clone(), second.name.clone()],
            rms_um,
            settled.len(),
        ),
        drive_noise_v,
    })
}

/// A signal under two repetitions of a drive.
struct Differing {
    /// The mean of both without its mean: what the signal looks like.
    shape: Vec<f64>,
    /// The later less the earlier.
    difference: Vec<f64>,
}

impl Differing {
    fn of(pairs: impl Iterator<Item = (f64, f64)>) -> Self {
        let (mut shape, difference): (Vec<f64>, Vec<f64>) =
            pairs.map(|(a, b)| (0.5 * (a + b), b - a)).unzip();
        let mean = mean(&shape);
        shape.iter_mut().for_each(|v| *v -= mean);
        Self { shape, difference }
    }

    /// RMS of the noise of one repetition, by the steps of the difference from sample to sample, which
    /// another size hardly has; zero below this.
    fn noise(&self, samples: Range<usize>, least: f64) -> f64 {
        let steps: Vec<f64> = self.difference[samples]
            .windows(2)
            .map(|w| w[1] - w[0])
            .collect();
        let noise = 0.5 * rms(&steps);
        if noise > least { noise } else { 0.0 }
    }

    /// The difference of readings without what comes of a drive that has another size the second time: an
    /// amplifier that warms up, seen below the noise with which the drive was read back.
    fn but_for_another_size(
        &self,
        drive: &Self,
        drive_noise_v: f64,
        samples: Range<usize>,
    ) -> Vec<f64> {
        let (shape, drive_shape) = (&self.shape[samples.clone()], &drive.shape[samples.clone()]);
        let power = dot(drive_shape, drive_shape);
        let larger = if power > 0.0 && drive_noise_v > 0.0 {
            dot(&drive.difference[samples.clone()], drive_shape) / power
        } else {
            0.0
        };
        self.difference[samples]
            .iter()
            .zip(shape)
            .map(|(difference, shape)| difference - larger * shape)
            .collect()
    }
}

/// First sample of both windows from which on two records have the same drive, up to `end`.
fn common_drive(first: &Record, second: &Record, end: usize, span_v: f64) -> Option<usize> {
    let begin = first.window.start.max(second.window.start);
    let drives_v = |k: usize| (first.drive_v[k], second.drive_v[k]);
    let exact = within(begin..end, SAME_DRIVE * span_v, drives_v);
    let count = if exact >= SAMPLES_MIN {
        exact
    } else {
        but_for_noise(begin..end, SAMPLES_MIN, span_v, drives_v)
    };
    let start = end - count;
    (count >= SAMPLES_MIN && moves(&first.drive_v[start..end], span_v)).then_some(start)
}

fn moves(drive_v: &[f64], span_v: f64) -> bool {
    peak_to_peak(drive_v) > MOVES * span_v
}

/// For how many samples, from the end on backwards, two drives differ by no more than this.
fn within(samples: Range<usize>, limit_v: f64, drives_v: impl Fn(usize) -> (f64, f64)) -> usize {
    let same = |k: &usize| {
        let (a, b) = drives_v(*k);
        (a - b).abs() <= limit_v
    };
    samples.rev().take_while(same).count()
}

/// The same but for the noise with which they were read back, which the last `seen` samples show.
fn but_for_noise(
    samples: Range<usize>,
    seen: usize,
    span_v: f64,
    drives_v: impl Fn(usize) -> (f64, f64),
) -> usize {
    if samples.len() < seen.max(SAMPLES_MIN) {
        return 0;
    }
    // A short stretch shows most drives to be others.
    let noise_v = [SAMPLES_MIN, seen]
        .into_iter()
        .map(|seen| read_back_noise_v(samples.end - seen..samples.end, span_v, &drives_v));
    let last = noise_v.reduce(|short, whole| short.and(whole)).flatten();
    last.map_or(0, |noise_v| {
        within(samples, READ_BACK_Z * noise_v, drives_v)
    })
}

/// RMS of the difference between two drives over these samples, where it is so small and so irregular that it
/// is the noise of reading them back.
fn read_back_noise_v(
    samples: Range<usize>,
    span_v: f64,
    drives_v: impl Fn(usize) -> (f64, f64),
) -> Option<f64> {
    let stride = samples.len().div_ceil(PAIRS_SEEN).max(1);
    let pairs: Vec<[(f64, f64); 2]> = samples
        .clone()
        .step_by(stride)
        .take_while(|k| k + 1 < samples.end)
        .map(|k| [drives_v(k), drives_v(k + 1)])
        .collect();
    let differences_v: Vec<f64> = pairs.iter().map(|[(a, b), _]| a - b).collect();
    let steps_v: Vec<f64> = pairs
        .iter()
        .map(|[(a, b), (next_a, next_b)]| (next_a - next_b) - (a - b))
        .collect();
    let noise_v = rms(&differences_v);
    (noise_v <= READ_BACK * span_v
        && pattern_rms(&differences_v, &steps_v) <= PATTERN_MAX * noise_v)
        .then_some(noise_v)
}

/// The later part of a difference over which it does not get smaller any more.
fn settled_part(difference: &[f64]) -> Option<Range<usize>> {
    let length = difference.len() / PARTS;
    if length < 2 {
        return None;
    }
    let of_parts: Vec<f64> = difference
        .chunks_exact(length)
        .map(|part| {
            let mean = part.iter().sum::<f64>() / part.len() as f64;
            rms(&part.iter().map(|v| v - mean).collect::<Vec<_>>())
        })
        .collect();
    let mut later: Vec<f64> = of_parts[of_parts.len() / 2..].to_vec();
    later.sort_by(f64::total_cmp);
    let limit = SETTLED * later[later.len() / 2];
    // What is remembered may go at once, when the drive first turns further out than before: the last such
    // part counts, not the first run.
    let unsettled = of_parts[..of_parts.len() / 2]
        .iter()
        .rposition(|r| *r > limit)
        .map_or(0, |last| last + 1);
    let settled = unsettled * length..difference.len();
    (settled.len() >= SAMPLES_MIN / 2).then_some(settled)
}

/// The periods that a drive ends with behind a sample, if it ends with two or more of the same.
fn find_periods(record: &Record, behind: usize, span_v: f64) -> Option<Periods> {
    let drive_v = &record.drive_v[behind..record.window.end];
    let n = drive_v.len();
    let likely = likely_periods(&drive_v[n / 2..]);
    let periods = |length: usize, same: usize| {
        let count = same / length + 1;
        let from = n.saturating_sub(count * length);
        let found =
            count >= 2 && same >= SAMPLES_MIN && moves(&drive_v[from..from + length], span_v);
        found.then_some(Periods {
            from: behind + from,
            length,
            count,
        })
    };
    // How far back the drive equals itself one period later.
    let exact = likely
        .iter()
        .copied()
        .flat_map(nearest_first)
        .filter(|length| (2..n).contains(length))
        .find_map(|length| {
            periods(
                length,
                within(0..n - length, SAME_DRIVE * span_v, |k| {
                    (drive_v[k], drive_v[k + length])
                }),
            )
        });
    exact.or_else(|| {
        // With same-sample timing the last row has gone.
        let whole = (2..=WHOLE_PERIODS_MAX)
            .rev()
            .map(|count| (count, n.div_ceil(count)))
            .filter(|(count, length)| count * length <= n + 1)
            .map(|(_, length)| length);
        let near = likely
            .iter()
            .flat_map(|lag| nearest_first(*lag).take(NEIGHBOURS_READ_BACK));
        near.chain(whole)
            .filter(|length| (2..n).contains(length))
            .find_map(|length| {
                periods(
                    length,
                    but_for_noise(0..n - length, length, span_v, |k| {
                        (drive_v[k], drive_v[k + length])
                    }),
                )
            })
    })
}

/// A lag and its neighbours: what a signal has beside whole periods moves the peaks of its autocorrelation a
/// little.
fn nearest_first(lag: usize) -> impl Iterator<Item = usize> {
    let reach = 2 + lag / 50;
    (0..=reach)
        .flat_map(move |by| [lag + by, lag.saturating_sub(by)])
        .skip(1)
}

/// Lags at which a signal resembles itself most, the shortest first.
fn likely_periods(signal: &[f64]) -> Vec<usize> {
    let like = autocorrelation(signal);
    let half = like.len() / 2;
    let mut peaks: Vec<usize> = (2..half.saturating_sub(1))
        .filter(|k| like[*k] > 0.5 && like[*k] >= like[k - 1] && like[*k] > like[k + 1])
        .collect();
    peaks.sort_by(|a, b| like[*b].total_cmp(&like[*a]));
    peaks.truncate(LAGS_MAX);
    peaks.sort_unstable();
    peaks
}

#[cfg(test)]
mod tests {
    use super::*;

    fn noisy(drive_v: &[f64], rms_um: f64, seed: u64) -> Vec<f64> {
        let mut noise = hysteron_sim::noise::WhiteNoise::new(rms_um, seed);
        drive_v.iter().map(|u| 0.1 * u + noise.next_um()).collect()
    }

    /// A sine that grows for a while and then stays: its equal periods are found without being named, and so
    /// is the noise.
    #[test]
    fn periods_are_found_from_the_drive() {
        let drive: Vec<f64> = (0..8000)
            .map(|k| {
                (k as f64 / 2000.0).min(1.0)
                    * 30.0
                    * (std::f64::consts::TAU * k as f64 / 500.0).sin()
            })
            .collect();
        let reading = noisy(&drive, 0.02, 3);
        let record = Record::new("r", 10_000.0, drive, reading);
        let periods = find_periods(&record, 0, 100.0).unwrap();
        assert_eq!((periods.length, periods.count), (500, 12));
        let found = of_periods(&record, 100.0).unwrap();
        assert!(
            (found.estimate.rms_um / 0.02 - 1.0).abs() < 0.05,
            "{}",
            found.estimate.rms_um
        );
    }

    /// Two records that begin from different states: what the first remembers dies away and is no noise.
    #[test]
    fn records_with_the_same_drive_are_repeats_once_they_have_settled() {
        let drive: Vec<f64> = (0..6000)
            .map(|k| 20.0 * (0.011 * k as f64).sin() + 10.0 * (0.0037 * k as f64).sin())
            .collect();
        let mut first = noisy(&drive, 0.003, 1);
        first
            .iter_mut()
            .enumerate()
            .for_each(|(k, y)| *y += 0.1 * (-(k as f64) / 200.0).exp());
        let second = noisy(&drive, 0.003, 2);
        let records = vec![
            Record::new("a", 10_000.0, drive.clone(), first),
            Record::new("b", 10_000.0, drive.clone(), second),
        ];
        let found = of_pairs(&Dataset::new("d", -40.0, 40.0, records).unwrap());
        assert_eq!(found.len(), 1);
        assert!(
            (found[0].estimate.rms_um / 0.003 - 1.0).abs() < 0.06,
            "{}",
            found[0].estimate.rms_um
        );
    }

    #[test]
    fn a_drive_that_never_comes_back_has_no_periods() {
        let drive: Vec<f64> = (0..4000)
            .map(|k| 20.0 * (1e-6 * (k * k) as f64).sin())
            .collect();
        let reading = noisy(&drive, 0.003, 1);
        assert!(find_periods(&Record::new("r", 1000.0, drive, reading), 0, 40.0).is_none());
    }

    /// Three whole periods of a multisine, as read with either timing.
    #[test]
    fn whole_periods_show_the_noise_with_either_timing() {
        let length = 2048;
        let sine = |k: usize, line: usize| {
            (std::f64::consts::TAU * (line * k) as f64 / length as f64 + (line * line) as f64).sin()
        };
        let drive: Vec<f64> = (0..3 * length)
            .map(|k| (1..200).map(|line| 0.05 * sine(k, line)).sum())
            .collect();
        let record = Record {
            window: length + length / 2..3 * length,
            ..Record::new("r", 6400.0, drive.clone(), noisy(&drive, 0.003, 9))
        };
        let dataset = Dataset::new("d", -5.0, 5.0, vec![record]).unwrap();
        for dataset in [dataset.in_own_rows(), dataset] {
            let found = of_periods(&dataset.records[0], 10.0).unwrap();
            assert!(
                (found.estimate.rms_um / 0.003 - 1.0).abs() < 0.06,
                "{}",
                found.estimate.rms_um
            );
        }
    }

    /// Two whole periods of a multisine that was read back with noise, the second of them held out: its
    /// window has one period, and both show the noise. A drive that is a little larger the second time is
    /// another one.
    #[test]
    fn periods_of_a_drive_that_was_read_back_show_the_noise() {
        let length = 2048;
        let sine = |k: usize, line: usize| {
            (std::f64::consts::TAU * (line * k) as f64 / length as f64 + (line * line) as f64).sin()
        };
        let commanded_v = |k: usize| (1..200).map(|line| 0.05 * sine(k, line)).sum::<f64>();
        let mut read_back = hysteron_sim::noise::WhiteNoise::new(2e-4, 8);
        let drive: Vec<f64> = (0..2 * length)
            .map(|k| commanded_v(k) + read_back.next_um())
            .collect();
        let reading = noisy(
            &(0..2 * length).map(commanded_v).collect::<Vec<_>>(),
            0.003,
            9,
        );
        let held_out = Record {
            window: length..2 * length,
            ..Record::new("r", 6400.0, drive.clone(), reading.clone())
        };
        let found = of_periods(&held_out, 4.0).unwrap();
        assert!(
            (found.estimate.rms_um / 0.003 - 1.0).abs() < 0.06,
            "{}",
            found.estimate.rms_um
        );
        let larger = drive
            .iter()
            .enumerate()
            .map(|(k, u)| if k < length { *u } else { 1.0005 * u })
            .collect();
        assert!(of_periods(&Record::new("r", 6400.0, larger, reading), 4.0).is_none());
    }
}
