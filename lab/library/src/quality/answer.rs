//! Do the readings answer the drive at all?
//!
//! A sensor that is not connected, a column of something else, an amplifier that is switched off: the
//! readings hold nothing of the drive. A search finds nothing there, and "nothing is missing" would be wrong;
//! one such record of several spoils what is fitted to all.
//!
//! The readings and the drive are cut into segments, and the coherence of both over the segments says whether
//! they go together. It holds for any linear stage, however late it follows. Readings that know nothing of
//! the drive reach a coherence of `c` in a bin with the probability `(1 - c)^(n - 1)` of `n` segments,
//! whatever the drive and whatever the spectrum of the readings (Carter, Knapp, Nuttall, IEEE Trans. Audio
//! Electroacoust. 21, 1973): a random walk is judged as white noise is. No model is needed, and nothing is
//! fitted. Samples that do not count are left out of both signals: what one of them does alone is no answer.
//!
//! Shorter records are judged by the model at the end: where it takes nothing of the readings, drive and
//! displacement have nothing in common.
//!
//! A drive that runs straight in most segments, as a slow triangle does, asks too little: readings that
//! follow it look like a drift. Such segments decide nothing.

use super::subject::{End, Moment, Subject};
use crate::dataset::issue::{Issue, IssueKind, Severity};
use crate::dataset::{Dataset, Record, Role};
use crate::parallel;
use crate::statistics::{rms, rms_about_mean};
use realfft::RealFftPlanner;
use realfft::num_complex::Complex;
use std::f64::consts::TAU;

/// Numbers of segments: few show slow drives, many weak answers.
const SEGMENTS: [usize; 5] = [4, 8, 16, 32, 64];
/// Shortest segment whose spectrum says something.
const SEGMENT_MIN: usize = 16;
/// Probability of an answer by chance below which readings answer: one disconnected sensor in so many passes,
/// while readings of which a twentieth of the square goes with a sine are taken for an answer in 5000 samples
/// (the tests below).
const BY_CHANCE: f64 = 1e-4;
/// Bins in which a signal has less than this share of its strongest bin say nothing.
const MOVES_THERE: f64 = 1e-4;
/// Segments that must share the motion of the drive beside straight lines, as many as would hold all of it in
/// equal parts: what moves in one or two goes with anything that moves there too. Without it triangles of one
/// and two periods, and a ramp, are blocked (the tests below).
const SHARED_BY: f64 = 3.0;
/// With fewer samples even a clear answer may be missed.
const SAMPLES_MIN: usize = 2000;

/// A model that takes less than this share of the squares of every record says nothing about the drive: a gain
/// takes that much of a hundred samples of noise by chance.
const TAKES: f64 = 0.01;

/// Examines every record that is fitted or judges, and what a model takes of those that are too short for it.
pub(super) fn check(subject: &Subject) -> Vec<Issue> {
    let judges = |r: &&Record| matches!(r.role, Role::Identify | Role::Validate);
    let records: Vec<&Record> = subject.dataset.records.iter().filter(judges).collect();
    let long_enough = |r: &Record| r.counted().count() >= SAMPLES_MIN;
    match subject.moment {
        Moment::BeforeSearch => {
            let long: Vec<&Record> = records.into_iter().filter(|r| long_enough(r)).collect();
            parallel::map(&long, |record| of_record(record))
                .into_iter()
                .flatten()
                .collect()
        }
        Moment::End(end) if !records.into_iter().any(long_enough) => {
            nothing_taken(subject.dataset, end).into_iter().collect()
        }
        _ => Vec::new(),
    }
}

/// That the model at the end takes nothing of any record.
fn nothing_taken(dataset: &Dataset, end: &End) -> Option<Issue> {
    let left = |i: &usize| {
        let record = &dataset.records[*i];
        let readings: Vec<f64> = record
            .counted()
            .map(|k| record.displacement_um[k])
            .collect();
        let moves = rms_about_mean(&readings);
        (moves > 0.0).then(|| (rms(&end.last.residuals[*i]) / moves).powi(2))
    };
    let least = end
        .study
        .split
        .both()
        .iter()
        .filter_map(left)
        .reduce(f64::min)?;
    let share = (1.0 - least).max(0.0);
    (share < TAKES).then(|| Issue::of_all(Severity::Blocks, IssueKind::NothingInCommon { share }))
}

fn of_record(record: &Record) -> Option<Issue> {
    let counted: Vec<usize> = record.counted().collect();
    let of_counted = |signal: &[f64]| -> Vec<f64> { counted.iter().map(|k| signal[*k]).collect() };
    let readings = of_counted(&record.displacement_um);
    let further = record
        .force_n
        .iter()
        .chain(record.auxiliary.iter().map(|signal| &signal.values));
    let inputs: Vec<Vec<f64>> = std::iter::once(&record.drive_v)
        .chain(further)
        .map(|signal| of_counted(signal))
        .collect();
    let tests = SEGMENTS.len() * inputs.len();
    let mut clearest: Option<(f64, f64, f64)> = None;
    for segments in SEGMENTS
        .into_iter()
        .filter(|n| readings.len() / n >= SEGMENT_MIN)
    {
        for input in &inputs {
            let Some((coherence, bins)) = largest_coherence(input, &readings, segments) else {
                continue;
            };
            let trials = (tests * bins) as f64;
            let chance = trials * (1.0 - coherence).powi(segments as i32 - 1);
            let by_chance = 1.0 - (BY_CHANCE / trials).powf(1.0 / (segments - 1) as f64);
            if clearest.is_none_or(|(least, ..)| chance < least) {
                clearest = Some((chance, coherence, by_chance));
            }
        }
    }
    let (chance, coherence, by_chance) = clearest?;
    let kind = IssueKind::NotAnswered {
        moves_um: rms(&without_line(&readings)),
        coherence,
        by_chance,
    };
    (chance > BY_CHANCE).then(|| Issue::of(&record.name, Severity::Blocks, kind))
}

/// What a straight line does not meet of a signal.
fn without_line(signal: &[f64]) -> Vec<f64> {
    let n = signal.len() as f64;
    let (middle, mean) = (0.5 * (n - 1.0), signal.iter().sum::<f64>() / n);
    let along: f64 = signal
        .iter()
        .enumerate()
        .map(|(k, v)| (k as f64 - middle) * (v - mean))
        .sum();
    let slope = along / (n * (n * n - 1.0) / 12.0);
    signal
        .iter()
        .enumerate()
        .map(|(k, v)| v - mean - slope * (k as f64 - middle))
        .collect()
}

/// Whether an input moves beside straight lines, and in enough segments.
fn asks(input: &[f64], segments: usize) -> bool {
    let square = |signal: &[f64]| rms(signal).powi(2);
    let mean = input.iter().sum::<f64>() / input.len().max(1) as f64;
    let about_mean: Vec<f64> = input.iter().map(|v| v - mean).collect();
    let of_segment = |segment: &[f64]| square(&without_line(segment));
    let squares: Vec<f64> = input
        .chunks_exact(input.len() / segments)
        .take(segments)
        .map(of_segment)
        .collect();
    let sum: f64 = squares.iter().sum();
    let shared_by = sum * sum
        / squares
            .iter()
            .map(|s| s * s)
            .sum::<f64>()
            .max(f64::MIN_POSITIVE);
    sum >= MOVES_THERE * segments as f64 * square(&about_mean) && shared_by >= SHARED_BY
}

/// The largest coherence over the bins in which the input moves, and how many these are; nothing where it
/// does not move.
fn largest_coherence(input: &[f64], readings: &[f64], segments: usize) -> Option<(f64, usize)> {
    if !asks(input, segments) {
        return None;
    }
    let length = readings.len() / segments;
    let window: Vec<f64> = (0..length)
        .map(|i| 0.5 - 0.5 * (TAU * (i as f64 + 0.5) / length as f64).cos())
        .collect();
    let transform = RealFftPlanner::<f64>::new().plan_fft_forward(length);
    let spectrum = |signal: &[f64]| -> Option<Vec<Complex<f64>>> {
        let mut windowed: Vec<f64> = without_line(signal)
            .iter()
            .zip(&window)
            .map(|(v, w)| v * w)
            .collect();
        let mut bins = transform.make_output_vec();
        // The lengths are those of the transform.
        transform.process(&mut windowed, &mut bins).ok()?;
        Some(bins)
    };
    let bins = length / 2 + 1;
    let (mut of_input, mut of_readings, mut of_both) = (
        vec![0.0; bins],
        vec![0.0; bins],
        vec![Complex::new(0.0, 0.0); bins],
    );
    for segment in 0..segments {
        let range = segment * length..(segment + 1) * length;
        let (x, y) = (
            spectrum(&input[range.clone()])?,
            spectrum(&readings[range])?,
        );
        for k in 0..bins {
            of_input[k] += x[k].norm_sqr();
            of_readings[k] += y[k].norm_sqr();
            of_both[k] += x[k].conj() * y[k];
        }
    }
    let most = of_input[1..].iter().copied().fold(0.0, f64::max);
    // At half the sampling rate a spectrum is real, and reaches a high coherence more often.
    let moves: Vec<usize> = (1..length.div_ceil(2))
        .filter(|k| most > 0.0 && of_input[*k] >= MOVES_THERE * most)
        .collect();
    let coherence = |k: &usize| {
        if of_readings[*k] > 0.0 {
            of_both[*k].norm_sqr() / (of_input[*k] * of_readings[*k])
        } else {
            0.0
        }
    };
    let largest = moves.iter().map(coherence).reduce(f64::max)?;
    Some((largest.min(1.0), moves.len()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::Dataset;
    use hysteron_sim::noise::WhiteNoise;

    const SAMPLES: usize = 5000;

    fn wave(k: usize) -> f64 {
        5.0 - 4.0 * (0.011 * k as f64).cos()
    }

    /// What is found in readings in noise of 0.5 um, which are these beside it.
    fn found(
        seed: u64,
        drive_v: fn(usize) -> f64,
        mut readings_um: impl FnMut(usize, f64) -> f64,
    ) -> Vec<Issue> {
        let mut noise = WhiteNoise::new(0.5, seed);
        let readings = (0..SAMPLES)
            .map(|k| readings_um(k, noise.next_um()))
            .collect();
        let record = Record::new("one", 10e3, (0..SAMPLES).map(drive_v).collect(), readings)
            .with_role(Role::Identify);
        let dataset = Dataset::new("t", 0.0, 10.0, vec![record]).unwrap();
        check(&Subject {
            dataset: &dataset,
            moment: Moment::BeforeSearch,
        })
    }

    fn stairs(k: usize) -> f64 {
        ((k / 700) * 3 % 10) as f64
    }

    /// Noise, a drift, and a random walk, under a sine and under stairs: a disconnected sensor is blocked
    /// with figures.
    #[test]
    fn readings_without_an_answer_block() {
        for seed in 0..20 {
            for drive_v in [wave, stairs] {
                let mut walk = 0.0;
                let each = [
                    found(seed, drive_v, |_, noise| 3.0 + noise),
                    found(seed, drive_v, |k, noise| 2e-4 * k as f64 + noise),
                    found(seed, drive_v, |_, noise| {
                        walk += noise;
                        walk
                    }),
                ];
                for issues in each {
                    assert!(
                        issues.len() == 1 && issues[0].severity == Severity::Blocks,
                        "{seed} {issues:?}"
                    );
                    let IssueKind::NotAnswered {
                        coherence,
                        by_chance,
                        ..
                    } = issues[0].kind
                    else {
                        panic!("{issues:?}")
                    };
                    assert!(coherence < by_chance, "{issues:?}");
                }
            }
        }
    }

    /// Triangles of a few periods whose corners fall between segments, or lie in one or two of them, and a
    /// ramp: nothing is blocked.
    #[test]
    fn drives_that_run_straight_block_nothing() {
        for period in [SAMPLES / 2, SAMPLES, SAMPLES + SAMPLES / 2, 2 * SAMPLES] {
            let drive = |k: usize| {
                40.0 - 40.0 * (4.0 * ((k as f64 / period as f64).fract() - 0.5).abs() - 1.0)
            };
            let mut noise = WhiteNoise::new(0.01, 3);
            let readings = (0..SAMPLES)
                .map(|k| 0.1 * drive(k) + noise.next_um())
                .collect();
            let record = Record::new("slow", 1e3, (0..SAMPLES).map(drive).collect(), readings)
                .with_role(Role::Identify);
            let dataset = Dataset::new("t", 0.0, 80.0, vec![record]).unwrap();
            assert_eq!(
                check(&Subject {
                    dataset: &dataset,
                    moment: Moment::BeforeSearch
                }),
                [],
                "{period}"
            );
        }
    }

    /// Two pieces of one record, held-out ones as a file that is cut has them: what lies between them does not
    /// count.
    #[test]
    fn pieces_of_a_record_answer() {
        // 50 Hz of growing height.
        let drive = |k: usize| (18.0 + 6e-3 * k as f64) * (0.0314 * k as f64).sin();
        let mut noise = WhiteNoise::new(0.3, 3);
        let samples = 3 * SAMPLES / 2;
        let readings = (0..samples)
            .map(|k| 0.18 * drive(k) + noise.next_um())
            .collect();
        let mut record = Record::new("pieces", 10e3, (0..samples).map(drive).collect(), readings)
            .with_role(Role::Identify);
        record.leave_out(std::iter::once(samples / 3..2 * samples / 3));
        let dataset = Dataset::new("t", -80.0, 80.0, vec![record]).unwrap();
        assert_eq!(
            check(&Subject {
                dataset: &dataset,
                moment: Moment::BeforeSearch
            }),
            []
        );
    }

    /// A sixth of a micrometre in half a micrometre of noise, a stage that follows a quarter of a period
    /// late, and stairs with a slow stage.
    #[test]
    fn what_follows_the_drive_answers_however_late_and_small() {
        for seed in 0..20 {
            assert_eq!(found(seed, wave, |k, noise| 0.04 * wave(k) + noise), []);
            assert_eq!(
                found(seed, wave, |k, noise| (0.011 * k as f64).sin() + noise),
                []
            );
            let mut slow_um = 0.0;
            let slow = |k: usize, noise: f64| {
                slow_um += 0.01 * (0.1 * stairs(k) - slow_um);
                slow_um + 0.1 * noise
            };
            assert_eq!(found(seed, stairs, slow), []);
        }
    }
}
