//! Where a drive stands still.
//!
//! A drive that was commanded stands still to the digit. One that was read back through a converter never
//! does: its noise is what is left of it after two differences, and a rest is where the means of neighbouring
//! stretches differ by no more than this noise explains. What the stage answers there was commanded, however
//! small and random it looks.

use crate::identification::fit::dot;
use crate::statistics::{mean, peak_to_peak};
use std::ops::Range;

/// Noise read from second differences of a drive that moves: most of its samples lie within so many standard
/// deviations of a straight line.
const STRETCH_RMS_MAX: f64 = 1.5;
/// Means of two stretches are the same where they differ by less than so many of their standard deviations.
const SAME_MEAN: f64 = 5.0;

/// Noise of a measured drive is below this share of its range; a multisine to nearly half the sampling rate
/// looks like noise too, and is the motion.
const NOISE_SHARE_MAX: f64 = 0.02;

/// A stage answers within so many samples.
const ANSWERS_WITHIN: usize = 16;
/// Standard deviations of a correlation by chance beyond which a reading answers a drive.
const ANSWERED: f64 = 6.0;

/// Ranges of at least so many samples in which the drive stands still, as far as its own noise lets it be
/// seen, and the reading, um, does not answer what it does there.
#[must_use]
pub fn holds(drive_v: &[f64], reading_um: &[f64], shortest: usize) -> Vec<Range<usize>> {
    let still = still(drive_v, shortest);
    still
        .into_iter()
        .filter(|range| !answers(&drive_v[range.clone()], &reading_um[range.clone()]))
        .collect()
}

/// Whether a reading moves with the changes of a drive from sample to sample, at any lag. Changes, because
/// slow noise of both is alike by chance.
fn answers(drive_v: &[f64], reading_um: &[f64]) -> bool {
    let changes = |signal: &[f64]| -> Vec<f64> { signal.windows(2).map(|w| w[1] - w[0]).collect() };
    let (drive, reading) = (changes(drive_v), changes(reading_um));
    (0..ANSWERS_WITHIN.min(drive.len())).any(|lag| {
        let (drive, reading) = (&drive[..drive.len() - lag], &reading[lag..]);
        let of_both = dot(drive, drive) * dot(reading, reading);
        of_both > 0.0
            && dot(drive, reading).powi(2) * drive.len() as f64 > ANSWERED * ANSWERED * of_both
    })
}

fn still(drive_v: &[f64], shortest: usize) -> Vec<Range<usize>> {
    let exact = exact_holds(drive_v, shortest);
    let noise_v = read_noise_v(drive_v);
    let was_read_back = noise_v > 0.0 && noise_v < NOISE_SHARE_MAX * peak_to_peak(drive_v);
    if exact.is_empty() && was_read_back {
        holds_in_noise(drive_v, shortest.max(2), noise_v)
    } else {
        exact
    }
}

/// Standard deviation of what a drive has beside a motion that is straight over three samples, V. Zero for a
/// drive that mostly moves along straight lines or rests.
#[must_use]
pub fn read_noise_v(drive_v: &[f64]) -> f64 {
    let mut bends: Vec<f64> = drive_v
        .windows(3)
        .map(|w| (w[0] - 2.0 * w[1] + w[2]).abs())
        .collect();
    let middle = bends.len() / 2;
    if bends.is_empty() {
        return 0.0;
    }
    // The median of the magnitude of a normal value is 0.6745 of its standard deviation; a second difference
    // has the sum of 1, 4 and 1 variances.
    *bends.select_nth_unstable_by(middle, f64::total_cmp).1 / (0.6745 * 6f64.sqrt())
}

fn exact_holds(drive_v: &[f64], shortest: usize) -> Vec<Range<usize>> {
    let mut found = Vec::new();
    let mut start = 0;
    for k in 1..=drive_v.len() {
        if k == drive_v.len() || drive_v[k] != drive_v[start] {
            if k - start >= shortest {
                found.push(start..k);
            }
            start = k;
        }
    }
    found
}

/// Stretches of half the shortest hold that neither move inside nor differ from the one before, put together.
fn holds_in_noise(drive_v: &[f64], shortest: usize, noise_v: f64) -> Vec<Range<usize>> {
    let stretch = shortest.div_ceil(2);
    let same = SAME_MEAN * noise_v * (2.0 / stretch as f64).sqrt();
    let mut found: Vec<(Range<usize>, f64)> = Vec::new();
    for start in (0..(drive_v.len() + 1).saturating_sub(stretch)).step_by(stretch) {
        let values = &drive_v[start..start + stretch];
        let (middle, level_v) = (stretch / 2, mean(values));
        let rms_v =
            (values.iter().map(|v| (v - level_v).powi(2)).sum::<f64>() / stretch as f64).sqrt();
        // The halves have fewer samples, and differ by more.
        let drifts = (mean(&values[..middle]) - mean(&values[middle..])).abs()
            > same * std::f64::consts::SQRT_2;
        if rms_v > STRETCH_RMS_MAX * noise_v || drifts {
            continue;
        }
        match found
            .last_mut()
            .filter(|(range, first_v)| range.end == start && (level_v - *first_v).abs() < same)
        {
            Some((range, _)) => range.end = start + stretch,
            None => found.push((start..start + stretch, level_v)),
        }
    }
    found
        .into_iter()
        .map(|(range, _)| range)
        .filter(|range| range.len() >= shortest)
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use hysteron_sim::noise::WhiteNoise;

    /// Half a second of rest, a triangle, half a second of rest up there, a slow sine.
    fn commanded() -> Vec<f64> {
        let rest = std::iter::repeat_n(0.0, 3650);
        let triangle = (0..4000).map(|k| {
            if k < 2500 {
                0.02 * f64::from(k)
            } else {
                50.0 - 0.02 * f64::from(k - 2500)
            }
        });
        let up = std::iter::repeat_n(20.0, 3650);
        let sine = (0..9000).map(|k| 20.0 + 15.0 * (0.002 * f64::from(k)).sin());
        rest.chain(triangle).chain(up).chain(sine).collect()
    }

    #[test]
    fn a_drive_that_was_read_back_rests_where_the_commanded_one_does() {
        let exact = still(&commanded(), 400);
        assert_eq!(exact, [0..3651, 7650..11_301]);
        for (noise_v, step_v) in [
            (1e-3, 0.0),
            (0.02, 0.0),
            (1e-3, 100.0 / 65_536.0),
            (0.1, 0.0),
        ] {
            for seed in 0..5 {
                let mut noise = WhiteNoise::new(noise_v, seed);
                let round = |v: f64| {
                    if step_v > 0.0 {
                        (v / step_v).round() * step_v
                    } else {
                        v
                    }
                };
                let read: Vec<f64> = commanded()
                    .into_iter()
                    .map(|v| round(v + noise.next_um()))
                    .collect();
                let found = still(&read, 400);
                assert_eq!(found.len(), 2, "{noise_v} {step_v} {seed}: {found:?}");
                for (found, exact) in found.iter().zip(&exact) {
                    // Nothing of the motion but what the noise hides, and most of the rest.
                    assert!(
                        found.start + 10 >= exact.start && found.end <= exact.end + 10,
                        "{noise_v}: {found:?} {exact:?}"
                    );
                    assert!(
                        found.len() * 10 > exact.len() * 8,
                        "{noise_v}: {found:?} {exact:?}"
                    );
                }
            }
        }
    }

    #[test]
    fn what_moves_slowly_does_not_rest() {
        let mut noise = WhiteNoise::new(0.01, 3);
        let slow: Vec<f64> = (0..20_000)
            .map(|k| 1e-4 * f64::from(k) + noise.next_um())
            .collect();
        assert!(still(&slow, 400).is_empty(), "{:?}", still(&slow, 400));
        let lines: Vec<usize> = (1..=1920).step_by(3).collect();
        let fast = hysteron_sim::waveform::multisine(4000, &lines, 8.0, 36.0, 5, 1);
        assert!(
            still(&fast, 400).is_empty(),
            "a multisine to 9.6 kHz: {:?}",
            still(&fast, 400)
        );
        let sine: Vec<f64> = (0..20_000).map(|k| (0.001 * f64::from(k)).sin()).collect();
        assert!(still(&sine, 400).is_empty());
    }

    #[test]
    fn a_small_multisine_at_a_hold_is_a_drive_and_noise_of_its_reading_is_not() {
        let lines: Vec<usize> = (1..=1990).collect();
        let multisine_v = hysteron_sim::waveform::multisine(4000, &lines, 0.2, 0.0, 3, 1);
        let ramp = (0..4000).map(|k| 0.01 * f64::from(k));
        let mut noise = WhiteNoise::new(0.003, 8);
        let small: Vec<f64> = ramp
            .clone()
            .chain(multisine_v.iter().map(|v| 40.0 + v))
            .collect();
        let answer: Vec<f64> = small.iter().map(|v| 0.1 * v + noise.next_um()).collect();
        let as_far_as_the_drive_tells = still(&small, 400);
        assert!(!as_far_as_the_drive_tells.is_empty());
        assert!(
            holds(&small, &answer, 400).is_empty(),
            "{as_far_as_the_drive_tells:?}"
        );
        // The same drive where the stage follows what was commanded, and the rest is noise of reading it
        // back.
        let commanded: Vec<f64> = ramp
            .chain(std::iter::repeat_n(40.0, multisine_v.len()))
            .collect();
        let answer: Vec<f64> = commanded
            .iter()
            .map(|v| 0.1 * v + noise.next_um())
            .collect();
        assert_eq!(holds(&small, &answer, 400), as_far_as_the_drive_tells);
    }
}
