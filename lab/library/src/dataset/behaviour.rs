//! What a column is, from how it behaves: time rises evenly, a drive was commanded and leads, a response
//! follows and is noisy.
use crate::statistics::peak_to_peak;

/// Share of steps that must rise for a column to be time.
const RISING_MIN: f64 = 0.98;
/// Share of steps that must be about as long as the usual one.
const EVEN_MIN: f64 = 0.8;
/// Area of the loop of two signals, as a share of the largest that they could make, beyond which it says
/// which leads.
const LOOP_MIN: f64 = 0.003;
/// Noise of one signal over that of the other, each by its range, beyond which it says which was measured.
const NOISE_RATIO_MIN: f64 = 3.0;

/// Whether values rise evenly throughout, as time does.
#[must_use]
pub fn rises_evenly(values: &[f64]) -> bool {
    if values.len() < 3 {
        return false;
    }
    let steps: Vec<f64> = values.windows(2).map(|w| w[1] - w[0]).collect();
    let rising: Vec<f64> = steps.iter().copied().filter(|s| *s > 0.0).collect();
    // Stamps written with few digits stand still from time to time, but never fall.
    let falls = steps.iter().filter(|s| **s < 0.0).count();
    if falls as f64 > (1.0 - RISING_MIN) * steps.len() as f64 || rising.is_empty() {
        return false;
    }
    let mean = (values[values.len() - 1] - values[0]) / steps.len() as f64;
    let about = |s: &&f64| **s >= 0.0 && **s < 2.5 * mean;
    let still = steps.len() - rising.len() - falls;
    // Longest run without a rise: a ramp that holds is no time.
    steps.iter().filter(about).count() as f64 >= EVEN_MIN * steps.len() as f64
        && still as f64 <= 0.9 * steps.len() as f64
        && evenly_spread(values, mean)
}

/// Whether the middle of the values is where even steps put it, throughout.
fn evenly_spread(values: &[f64], mean: f64) -> bool {
    let n = values.len();
    let span = mean * (n - 1) as f64;
    (1..8).all(|i| {
        let at = i * (n - 1) / 8;
        (values[at] - values[0] - mean * at as f64).abs() < 0.1 * span
    })
}

/// Whether values count samples: whole numbers that rise by one.
#[must_use]
pub fn counts_samples(values: &[f64]) -> bool {
    values.len() > 2 && values.windows(2).all(|w| w[1] - w[0] == 1.0) && values[0].fract() == 0.0
}

/// Whether values never change.
#[must_use]
pub fn is_constant(values: &[f64]) -> bool {
    values.iter().all(|v| *v == values[0])
}

/// Changes at least, for the rows between them to say anything.
const CHANGES_MIN: usize = 50;
/// A step is a change, and a bend of a line between rows one too, where it is larger than this share of the
/// range.
const IS_A_CHANGE: f64 = 1e-6;

/// Every how many rows values say something new: they stand still between, or lie on a line between two that
/// do; nothing where that is every row, or where too few change.
#[must_use]
pub fn rows_between_news(values: &[f64]) -> Option<usize> {
    let least = IS_A_CHANGE * peak_to_peak(values);
    let steps: Vec<f64> = values.windows(2).map(|w| w[1] - w[0]).collect();
    let bends: Vec<f64> = steps.windows(2).map(|w| w[1] - w[0]).collect();
    [steps, bends].into_iter().find_map(|changes| {
        let at: Vec<usize> = (0..changes.len())
            .filter(|k| changes[*k].abs() > least)
            .collect();
        let apart = at
            .windows(2)
            .map(|w| w[1] - w[0])
            .fold(0, greatest_common_divisor);
        (at.len() >= CHANGES_MIN && apart > 1).then_some(apart)
    })
}

fn greatest_common_divisor(a: usize, b: usize) -> usize {
    if b == 0 {
        a
    } else {
        greatest_common_divisor(b, a % b)
    }
}

/// Coefficient of correlation, 0 where one of them is constant.
#[must_use]
pub fn correlation(a: &[f64], b: &[f64]) -> f64 {
    let n = a.len().min(b.len()).max(1) as f64;
    let (mean_a, mean_b) = a
        .iter()
        .zip(b)
        .fold((0.0, 0.0), |(sa, sb), (x, y)| (sa + x / n, sb + y / n));
    let (mut aa, mut bb, mut ab) = (0.0, 0.0, 0.0);
    for (x, y) in a.iter().zip(b) {
        let (x, y) = (x - mean_a, y - mean_b);
        aa += x * x;
        bb += y * y;
        ab += x * y;
    }
    if aa > 0.0 && bb > 0.0 {
        ab / (aa * bb).sqrt()
    } else {
        0.0
    }
}

/// White noise on a signal as a share of its range, from third differences: motion that is slow beside the
/// sampling does not count.
#[must_use]
pub fn noise_share(values: &[f64]) -> f64 {
    let mut thirds: Vec<f64> = values
        .windows(4)
        .map(|w| (w[3] - 3.0 * w[2] + 3.0 * w[1] - w[0]).abs())
        .collect();
    let range = peak_to_peak(values);
    if thirds.is_empty() || range == 0.0 {
        return 0.0;
    }
    let middle = thirds.len() / 2;
    let median = *thirds.select_nth_unstable_by(middle, f64::total_cmp).1;
    // The median of the absolute value of a normal variable is 0.6745 standard deviations; 1, 3, 3, 1 add up
    // to 20 variances.
    median / 0.6745 / 20_f64.sqrt() / range
}

/// By how much `a` leads `b`: the signed area of their loop as a share of what they could enclose; negative
/// where `b` leads.
///
/// A response that lags runs round its drive counter-clockwise, hysteresis, creep, delay and low-pass alike;
/// with a negative gain clockwise, which the sign of the correlation undoes.
#[must_use]
pub fn lead(a: &[f64], b: &[f64]) -> f64 {
    let (mut area, mut path_a, mut path_b) = (0.0, 0.0, 0.0);
    let (a0, b0) = (
        a.first().copied().unwrap_or(0.0),
        b.first().copied().unwrap_or(0.0),
    );
    for (x, y) in a.windows(2).zip(b.windows(2)) {
        area += 0.5 * ((x[0] - a0) * (y[1] - b0) - (x[1] - a0) * (y[0] - b0));
        path_a += (x[1] - x[0]).abs();
        path_b += (y[1] - y[0]).abs();
    }
    let most = (path_a * peak_to_peak(b)).min(path_b * peak_to_peak(a));
    if most > 0.0 {
        area / most * correlation(a, b).signum()
    } else {
        0.0
    }
}

/// Which of two signals is the drive.
#[derive(Clone, Debug, PartialEq)]
pub struct ColumnJudgement {
    /// The first is the drive, the second the response.
    pub first_is_drive: bool,
    /// Why, or why it is not sure.
    pub why: String,
    /// Lead and noise agree, or one of them is clear and the other says nothing.
    pub is_sure: bool,
}

/// Judges which of two signals was commanded: the one that leads and is smooth.
#[must_use]
pub fn drive_among(a: &[f64], b: &[f64]) -> ColumnJudgement {
    let lead = lead(a, b);
    let (noise_a, noise_b) = (noise_share(a), noise_share(b));
    let by_lead = (lead.abs() >= LOOP_MIN).then_some(lead > 0.0);
    let least = 1e-9;
    let ratio = (noise_b + least) / (noise_a + least);
    let by_noise =
        (!(1.0 / NOISE_RATIO_MIN..=NOISE_RATIO_MIN).contains(&ratio)).then_some(ratio > 1.0);
    let leads = format!("it leads by a loop of {:.1} %", 100.0 * lead.abs());
    let smooth = format!(
        "it is smoother ({:.1e} against {:.1e} of the range)",
        noise_a.min(noise_b),
        noise_a.max(noise_b)
    );
    let (first_is_drive, why, is_sure) = match (by_lead, by_noise) {
        (Some(first), Some(same)) if first == same => {
            (first, format!("{leads} and {smooth}"), true)
        }
        (Some(first), Some(_)) => (
            first,
            format!("{leads}, though the other is smoother"),
            false,
        ),
        (Some(first), None) => (first, leads, true),
        (None, Some(first)) => (first, smooth, true),
        (None, None) => (
            true,
            "neither leads nor is smoother: taken in their order".into(),
            false,
        ),
    };
    ColumnJudgement {
        first_is_drive,
        why,
        is_sure,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn noise(n: usize, seed: u64) -> Vec<f64> {
        let mut noise = hysteron_sim::noise::WhiteNoise::new(1.0, seed);
        (0..n).map(|_| noise.next_um()).collect()
    }

    #[test]
    fn a_sensor_that_is_read_at_every_tenth_row_says_so_held_or_on_lines() {
        let rows = 4000;
        let values: Vec<f64> = noise(rows, 3)
            .iter()
            .enumerate()
            .map(|(k, e)| (0.01 * k as f64).sin() + 1e-3 * e)
            .collect();
        let held: Vec<f64> = (0..rows).map(|k| values[k - k % 10]).collect();
        let next = |k: usize| values[(k - k % 10 + 10).min(rows - 1)];
        let lines: Vec<f64> = (0..rows)
            .map(|k| held[k] + (k % 10) as f64 / 10.0 * (next(k) - held[k]))
            .collect();
        let coarse: Vec<f64> = values.iter().map(|v| (v * 100.0).round() / 100.0).collect();
        assert_eq!(
            [&held[..], &lines[..rows - 10]].map(rows_between_news),
            [Some(10); 2]
        );
        assert_eq!([&values, &coarse].map(|v| rows_between_news(v)), [None; 2]);
        // Two values of a switch, which change seldom.
        assert_eq!(
            rows_between_news(&(0..rows).map(|k| (k / 500 % 2) as f64).collect::<Vec<_>>()),
            None
        );
    }

    /// A lag of one radian in thirty, and noise of a thousandth.
    fn pair(gain: f64) -> (Vec<f64>, Vec<f64>) {
        let n = 4000;
        let u = |k: f64| (k * 0.01).sin() * (1.0 + k * 1e-4);
        let drive = (0..n).map(|k| u(f64::from(k))).collect();
        let response = noise(n as usize, 3)
            .iter()
            .enumerate()
            .map(|(k, e)| gain * u(k as f64 - 3.0) + 0.001 * e)
            .collect();
        (drive, response)
    }

    #[test]
    fn the_drive_leads_and_is_smooth_whatever_the_order_and_sign() {
        for gain in [0.2, -3.0] {
            let (u, y) = pair(gain);
            let judged = drive_among(&u, &y);
            assert!(judged.first_is_drive && judged.is_sure, "{judged:?}");
            let judged = drive_among(&y, &u);
            assert!(!judged.first_is_drive && judged.is_sure, "{judged:?}");
        }
    }

    #[test]
    fn a_copy_says_nothing() {
        let (u, _) = pair(1.0);
        assert!(!drive_among(&u, &u).is_sure);
    }

    #[test]
    fn time_rises_evenly_and_a_ramp_that_turns_does_not() {
        let time: Vec<f64> = (0..500).map(|k| 0.1 * f64::from(k)).collect();
        assert!(rises_evenly(&time));
        let rounded: Vec<f64> = (0..500)
            .map(|k| (0.005 * f64::from(k) * 100.0).round() / 100.0)
            .collect();
        assert!(rises_evenly(&rounded));
        let ramp: Vec<f64> = (0..500)
            .map(|k| 1.0 - (f64::from(k) * 0.004 - 1.0).abs())
            .collect();
        assert!(!rises_evenly(&ramp));
        let held: Vec<f64> = (0..500).map(|k| f64::from(k).min(300.0)).collect();
        assert!(!rises_evenly(&held));
        assert!(counts_samples(&[0.0, 1.0, 2.0, 3.0]) && !counts_samples(&time));
    }

    #[test]
    fn noise_is_measured_beside_motion() {
        let moving: Vec<f64> = noise(20_000, 5)
            .iter()
            .enumerate()
            .map(|(k, e)| (k as f64 * 1e-3).sin() * 10.0 + 0.02 * e)
            .collect();
        assert!(
            (noise_share(&moving) / (0.02 / 20.0) - 1.0).abs() < 0.05,
            "{}",
            noise_share(&moving)
        );
    }
}
