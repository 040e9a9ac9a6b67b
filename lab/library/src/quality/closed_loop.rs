//! Was a loop closed while a record was taken?
//!
//! A drive that is commanded knows nothing of the noise in the readings; one that a controller makes answers
//! it. Noise that went round the loop is in the drive, and a fit takes some of it for motion: what is
//! identified then is biased towards the controller's inverse (Ljung, System Identification, 2nd ed., chapter
//! 13.4).
//!
//! The innovation of a residual (what its own past does not predict) is new noise; the innovation of a drive
//! is what its source put in there. Where the drive's follows the residual's by a few samples with the
//! opposite sign, by far more than chance makes of samples that lie far apart, a loop was closed.
//!
//! Two things look alike and are excluded: a residual that follows the drive, which is a missing effect (a
//! smooth drive is known before it comes), and a residual that consists of the noise of a measured drive.

use super::subject::{Moment, Subject};
use crate::dataset::issue::{Issue, IssueKind, Severity};
use crate::dataset::{Dataset, Record};
use crate::diagnosis::judgement::Judged;
use crate::identification::fit::{dot, rms};
use crate::identification::noise_floor::NoiseFloor;
use crate::parallel;
use crate::statistics::{largest, mean};
use nalgebra::{DMatrix, DVector};

/// Samples before one that predict it.
const PREDICTED_FROM: usize = 20;
/// A loop answers within so many samples.
const ANSWERS_WITHIN: usize = 8;
/// Samples apart at which only chance is left.
const CHANCE: std::ops::Range<usize> = 40..240;
/// By how many times the largest correlation by chance the answer must be larger.
const BEYOND_CHANCE: f64 = 2.0;
/// The answer is at least this: what is new in the drive of a loop is mostly noise that went round it, while
/// coarse readings of a commanded drive, and what a model leaves of it, follow it by up to 0.08.
const LEAST: f64 = 0.2;
/// What is further than so many median sizes away is a corner of the drive or a disturbance, and counts as
/// that much.
const LIMITED_AT: f64 = 5.0;
/// By how many times it must be larger than what of the residual follows the drive.
const BEYOND_WHAT_FOLLOWS: f64 = 1.5;
/// A residual of which the noise of the measured drive makes this share shows no loop.
const MADE_BY_THE_COLUMN: f64 = 0.3;
/// Fewer samples say nothing.
const SAMPLES_MIN: usize = 2000;
/// Samples of a record that are looked at.
const SAMPLES_MAX: usize = 100_000;

/// Examines the drives beside what the model at the end leaves. Where that is so many times the noise
/// (`near_the_noise` of the policy) something else remains, as a ring that the model does not have, or what
/// uneven time stamps make of a drive and its readings alike.
pub(super) fn check(subject: &Subject) -> Vec<Issue> {
    match subject.moment {
        Moment::End(end) => followed(
            subject.dataset,
            end.last,
            end.noise,
            end.study.policy.near_the_noise,
        ),
        _ => Vec::new(),
    }
}

fn followed(
    dataset: &Dataset,
    judged: &Judged,
    floor: &NoiseFloor,
    near_the_noise: f64,
) -> Vec<Issue> {
    let of_the_noise = |record: &Record, left: &[f64]| {
        !floor.read_back.is_some_and(|r| {
            rms(&r.response_um(&judged.model, record)) > MADE_BY_THE_COLUMN * rms(left)
        })
    };
    let each = dataset
        .records
        .iter()
        .zip(&judged.residuals)
        .zip(&floor.of_records_um);
    let is_noise = |left: &[f64], floor_um: &Option<f64>| {
        floor_um.is_none_or(|floor_um| rms(left) < near_the_noise * floor_um)
    };
    let near: Vec<(&Record, &Vec<f64>)> = each
        .filter(|((_, left), floor_um)| !left.is_empty() && is_noise(left, floor_um))
        .map(|(both, _)| both)
        .collect();
    let issue = |(record, left): &(&Record, &Vec<f64>)| {
        let kind = of_record(record, left).filter(|_| of_the_noise(record, left))?;
        Some(Issue::of(&record.name, Severity::Notes, kind))
    };
    parallel::map(&near, issue).into_iter().flatten().collect()
}

fn of_record(record: &Record, left: &[f64]) -> Option<IssueKind> {
    let from = record.window.start;
    let to = record.window.end.min(from + SAMPLES_MAX);
    // What is left out says nothing of the noise: no residual stands there.
    let mut residual = vec![0.0; to - from];
    record
        .counted()
        .zip(left)
        .take_while(|(k, _)| *k < to)
        .for_each(|(k, value)| residual[k - from] = *value);
    if residual.len() < SAMPLES_MIN {
        return None;
    }
    let (noise, drive) = (
        limited(innovations(&residual)?)?,
        limited(innovations(&record.drive_v[from..to])?)?,
    );
    let power = (dot(&noise, &noise) * dot(&drive, &drive)).sqrt();
    let correlation = |later: usize| dot(&noise[..noise.len() - later], &drive[later..]) / power;
    let by_chance = CHANCE
        .map(|later| correlation(later).abs())
        .fold(0.0, f64::max);
    let answers = (0..=ANSWERS_WITHIN).map(|later| (later, correlation(later)));
    let (later_samples, correlation) = answers.min_by(|a, b| a.1.total_cmp(&b.1))?;
    let follows = |later: usize| dot(&drive[..drive.len() - later], &noise[later..]).abs() / power;
    let missing = (1..=ANSWERS_WITHIN).map(follows).fold(0.0, f64::max);
    let answered = -correlation
        > LEAST
            .max(BEYOND_CHANCE * by_chance)
            .max(BEYOND_WHAT_FOLLOWS * missing);
    answered.then_some(IssueKind::ClosedLoop {
        later_samples,
        correlation,
        by_chance,
    })
}

/// What the samples before each one do not predict of it, by least squares; nothing where a signal is
/// constant.
fn innovations(signal: &[f64]) -> Option<Vec<f64>> {
    let mean = mean(signal);
    let mut x: Vec<f64> = signal.iter().map(|v| v - mean).collect();
    let size = largest(&x);
    if size <= 0.0 {
        return None;
    }
    x.iter_mut().for_each(|v| *v /= size);
    let n = x.len();
    let product =
        |i: usize, j: usize| dot(&x[PREDICTED_FROM - i..n - i], &x[PREDICTED_FROM - j..n - j]);
    let mut normal = DMatrix::from_fn(PREDICTED_FROM, PREDICTED_FROM, |i, j| {
        if j < i { 0.0 } else { product(i + 1, j + 1) }
    });
    normal.fill_lower_triangle_with_upper_triangle();
    // A sine is predicted by two samples: the rest of the matrix is then rounding, which this keeps from
    // deciding anything.
    let held = 1e-12 * normal.trace();
    (0..PREDICTED_FROM).for_each(|i| normal[(i, i)] += held);
    let along = DVector::from_fn(PREDICTED_FROM, |i, _| product(0, i + 1));
    let weights = normal.cholesky()?.solve(&along);
    let predicted = |k: usize| {
        (0..PREDICTED_FROM)
            .map(|i| weights[i] * x[k - 1 - i])
            .sum::<f64>()
    };
    Some((PREDICTED_FROM..n).map(|k| x[k] - predicted(k)).collect())
}

/// The signal with nothing further from zero than some median sizes; nothing where most of it is zero.
fn limited(mut signal: Vec<f64>) -> Option<Vec<f64>> {
    let mut sizes: Vec<f64> = signal.iter().map(|v| v.abs()).collect();
    let middle = sizes.len() / 2;
    let median = *sizes.select_nth_unstable_by(middle, f64::total_cmp).1;
    if median <= 0.0 {
        return None;
    }
    signal
        .iter_mut()
        .for_each(|v| *v = v.clamp(-LIMITED_AT * median, LIMITED_AT * median));
    Some(signal)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::Role;
    use crate::identification::noise_floor::noise_floor;
    use hysteron_sim::chain::Model;
    use hysteron_sim::noise::WhiteNoise;

    const SAMPLES: usize = 20_000;
    const NEAR_THE_NOISE: f64 = 4.0;

    /// Beside this floor, or none.
    fn followed(dataset: &Dataset, judged: &Judged, floor_um: Option<f64>) -> Vec<Issue> {
        let floor = NoiseFloor {
            of_records_um: vec![floor_um],
            read_back: None,
            ..noise_floor(dataset)
        };
        super::followed(dataset, judged, &floor, NEAR_THE_NOISE)
    }

    /// What a model leaves that is right but for the noise.
    fn left(readings_noise: &[f64]) -> Judged {
        Judged {
            model: Model::new(0.0, 10.0),
            residuals: vec![readings_noise.to_vec()],
            identify_rms_um: 1.0,
            validate_rms_um: None,
        }
    }

    fn dataset(drive_v: Vec<f64>, noise: &[f64]) -> Dataset {
        let readings = drive_v
            .iter()
            .zip(noise)
            .map(|(u, n)| 0.1 * u + n)
            .collect();
        Dataset::new(
            "t",
            0.0,
            10.0,
            vec![Record::new("one", 10e3, drive_v, readings).with_role(Role::Identify)],
        )
        .unwrap()
    }

    fn wave(k: usize) -> f64 {
        5.0 - 4.0 * (k as f64 * 0.011).cos()
    }

    fn noise(seed: u64, std: f64) -> Vec<f64> {
        let mut noise = WhiteNoise::new(std, seed);
        (0..SAMPLES).map(|_| noise.next_um()).collect()
    }

    /// An integrating controller that follows a wave, one sample late, on a stage of 0.1 um/V without
    /// dynamics.
    fn closed_loop(gain: f64, noise: &[f64]) -> Vec<f64> {
        let mut drive_v = vec![wave(0)];
        for k in 1..SAMPLES {
            let before = drive_v[k - 1];
            let reading_um = 0.1 * before + noise[k - 1];
            drive_v.push(before + gain * (0.1 * wave(k) - reading_um));
        }
        drive_v
    }

    #[test]
    fn a_controller_that_answers_noise_is_told_with_its_delay() {
        let noise = noise(1, 0.002);
        for gain in [0.3, 2.0] {
            let found = followed(
                &dataset(closed_loop(gain, &noise), &noise),
                &left(&noise),
                None,
            );
            assert_eq!(found.len(), 1, "{gain}");
            let IssueKind::ClosedLoop {
                later_samples,
                correlation,
                by_chance,
            } = found[0].kind
            else {
                panic!("{found:?}")
            };
            assert!(
                later_samples == 1 && correlation < -0.5 && by_chance < 0.1,
                "{found:?}"
            );
            // With a noise of 0.1 nm something else than noise is what is left.
            assert_eq!(
                followed(
                    &dataset(closed_loop(gain, &noise), &noise),
                    &left(&noise),
                    Some(1e-4)
                ),
                []
            );
        }
    }

    #[test]
    fn a_commanded_drive_follows_nothing() {
        for seed in 0..20 {
            let readings_noise = noise(100 + seed, 0.002);
            let triangles: Vec<f64> = (0..SAMPLES)
                .map(|k| 10.0 * ((k % 300) as f64 / 150.0 - 1.0).abs())
                .collect();
            let coarse: Vec<f64> = (0..SAMPLES)
                .map(|k| (wave(k) * 200.0).round() / 200.0)
                .collect();
            let monitored: Vec<f64> = (0..SAMPLES)
                .map(wave)
                .zip(noise(500 + seed, 0.01))
                .map(|(u, n)| u + n)
                .collect();
            for drive_v in [
                (0..SAMPLES).map(wave).collect(),
                triangles,
                coarse,
                monitored,
            ] {
                assert_eq!(
                    followed(
                        &dataset(drive_v, &readings_noise),
                        &left(&readings_noise),
                        None
                    ),
                    []
                );
            }
        }
    }

    /// A residual that follows the drive, which acts from its sample on, is a missing effect, not a loop.
    #[test]
    fn what_follows_the_drive_is_no_answer() {
        let drive_v: Vec<f64> = (0..SAMPLES)
            .map(wave)
            .zip(noise(3, 0.5))
            .map(|(u, n)| (u + n).clamp(0.0, 10.0))
            .collect();
        let late: Vec<f64> = (0..SAMPLES)
            .map(|k| 0.01 * (drive_v[k.saturating_sub(3)] - drive_v[k.saturating_sub(1)]))
            .collect();
        assert_eq!(
            followed(&dataset(drive_v, &late), &left(&late), None).len(),
            0
        );
    }
}
