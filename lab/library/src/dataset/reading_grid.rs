//! The grid that a converter leaves in the readings: whole multiples of one step.
//!
//! A coarse converter is seen in the readings themselves, without any model: their distinct values are evenly
//! spaced. What it costs is noise of the step over the root of twelve, evenly distributed and, where the
//! noise of the sensor is smaller than the step, invisible at rest. (Widrow and Kollar, Quantization Noise,
//! 2008, Ch. 4 and 5.)

use super::data_set::Dataset;

/// Distinct values that a column must have before their spacing says anything.
pub(crate) const LEVELS_MIN: usize = 8;
/// Least number of values per distinct one where values come again.
const SAMPLES_PER_LEVEL: usize = 2;
/// Largest deviation of a reading from the grid, in steps.
const OFF_GRID_MAX: f64 = 0.1;
/// Records must agree on the step within this share.
const AGREEMENT: f64 = 0.02;

/// Most likely that readings which know no steps lie on a grid by chance.
#[must_use]
pub fn grid_by_chance() -> f64 {
    (2.0 * OFF_GRID_MAX).powi(LEVELS_MIN as i32 - 2)
}

/// RMS of the error of rounding to whole steps, in their unit.
#[must_use]
pub fn rounding_noise(step: f64) -> f64 {
    step / 12f64.sqrt()
}

/// Noise and rounding together, from what rest shows of noise that seldom leaves a step: how often the
/// reading is above and below its usual value says how far away the edges of the step are, in standard
/// deviations. `None` where nothing ever leaves it.
#[must_use]
pub fn noise_at_rest_um(readings_um: &[f64], step_um: f64) -> Option<f64> {
    let mut sorted = readings_um.to_vec();
    sorted.sort_by(f64::total_cmp);
    let usual = *sorted.get(sorted.len() / 2)?;
    let share = |outside: &dyn Fn(f64) -> bool| {
        readings_um.iter().filter(|v| outside(**v)).count() as f64 / readings_um.len() as f64
    };
    let (above, below) = (
        share(&|v| v > usual + 0.5 * step_um),
        share(&|v| v < usual - 0.5 * step_um),
    );
    if above + below == 0.0 {
        return None;
    }
    let least = 0.5 / readings_um.len() as f64;
    let edges = normal_quantile_above(above.max(least)) + normal_quantile_above(below.max(least));
    (edges > 0.0).then(|| (step_um / edges).hypot(rounding_noise(step_um)))
}

/// Noise and rounding together, from the RMS deviation of repeats of one motion, which all round alike as far
/// as noise does not part them: the mean reading follows a staircase that noise of `sigma` has smoothed,
/// harmonic by harmonic (Widrow and Kollar, Ch. 6).
#[must_use]
pub fn noise_between_repeats_um(deviation_um: f64, step_um: f64) -> f64 {
    let common_um2 = |sigma_um: f64| -> f64 {
        let harmonic = |k: i32| {
            let k = f64::from(k) * std::f64::consts::PI;
            (step_um / k).powi(2) / 2.0 * (-4.0 * (k * sigma_um / step_um).powi(2)).exp()
        };
        (1..=30).map(harmonic).sum()
    };
    let deviation_um2 = |sigma_um: f64| {
        sigma_um * sigma_um + rounding_noise(step_um).powi(2) - common_um2(sigma_um)
    };
    let (mut low, mut high) = (0.0, deviation_um + step_um);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if deviation_um2(middle) < deviation_um * deviation_um {
            low = middle
        } else {
            high = middle
        }
    }
    low.hypot(rounding_noise(step_um))
}

/// What rounding to whole steps adds to a reading on average, where noise of `sigma_um` smooths the staircase
/// (Widrow and Kollar, Ch. 6).
#[must_use]
pub fn mean_rounding_um(reading_um: f64, step_um: f64, sigma_um: f64) -> f64 {
    let harmonic = |k: i32| {
        let (sign, k) = (
            if k % 2 == 0 { 1.0 } else { -1.0 },
            f64::from(k) * std::f64::consts::PI,
        );
        sign * step_um / k
            * (-2.0 * (k * sigma_um / step_um).powi(2)).exp()
            * (2.0 * k * reading_um / step_um).sin()
    };
    (1..=30).map(harmonic).sum()
}

/// The value that a standard normal variable exceeds with this probability.
fn normal_quantile_above(probability: f64) -> f64 {
    let (mut low, mut high) = (-8.0, 8.0);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if 0.5 * libm::erfc(middle / std::f64::consts::SQRT_2) > probability {
            low = middle
        } else {
            high = middle
        }
    }
    low
}

/// The step of the readings in um, if all driven records lie on one grid that is coarse enough to be seen.
#[must_use]
pub fn reading_step_um(dataset: &Dataset) -> Option<f64> {
    let driven = dataset
        .records
        .iter()
        .filter(|r| r.role != super::Role::Noise);
    let steps_um: Vec<f64> = driven
        .map(|record| step_between(&levels(&record.displacement_um)))
        .collect::<Option<_>>()?;
    let (least, most) = steps_um
        .iter()
        .fold((f64::INFINITY, 0.0_f64), |(a, b), s| (a.min(*s), b.max(*s)));
    (most > 0.0 && most - least <= AGREEMENT * most)
        .then(|| steps_um.iter().sum::<f64>() / steps_um.len() as f64)
}

/// The step of a converter whose values these are, in their unit, if they lie on a grid so coarse that values
/// come again.
#[must_use]
pub fn step_of(values: &[f64]) -> Option<f64> {
    let levels = levels(values);
    if levels.len() * SAMPLES_PER_LEVEL > values.len() {
        None
    } else {
        step_between(&levels)
    }
}

/// The distinct values, ascending; those that differ by 1/10^9 of their range are the same.
pub(crate) fn levels(values: &[f64]) -> Vec<f64> {
    let mut levels = values.to_vec();
    levels.sort_by(f64::total_cmp);
    let equal =
        1e-9 * (levels.last().copied().unwrap_or(0.0) - levels.first().copied().unwrap_or(0.0));
    levels.dedup_by(|later, earlier| *later - *earlier <= equal);
    levels
}

/// The step between values, ascending, if all lie on one grid. A record that moves fast over many steps comes
/// to few of them twice, and each stands on the grid all the same.
fn step_between(levels: &[f64]) -> Option<f64> {
    if levels.len() < LEVELS_MIN {
        return None;
    }
    let mut gaps: Vec<f64> = levels.windows(2).map(|w| w[1] - w[0]).collect();
    gaps.sort_by(f64::total_cmp);
    // A record that moves fast leaves levels out: the short gaps are those of one step.
    let guess = gaps[gaps.len() / 50];
    // The number of each level, counted from gap to gap, then the step by a straight line through all of
    // them.
    let mut number = 0.0;
    let numbers: Vec<f64> = std::iter::once(0.0)
        .chain(levels.windows(2).map(|w| {
            number += ((w[1] - w[0]) / guess).round();
            number
        }))
        .collect();
    let n = levels.len() as f64;
    let (mean_number, mean_level) = (
        numbers.iter().sum::<f64>() / n,
        levels.iter().sum::<f64>() / n,
    );
    let (mut along, mut power) = (0.0, 0.0);
    for (number, level) in numbers.iter().zip(levels) {
        along += (number - mean_number) * (level - mean_level);
        power += (number - mean_number) * (number - mean_number);
    }
    let step = along / power;
    let off_grid = |(number, level): (&f64, &f64)| {
        ((level - mean_level) / step - (number - mean_number)).abs()
    };
    let on_grid = numbers
        .iter()
        .zip(levels)
        .all(|pair| off_grid(pair) < OFF_GRID_MAX);
    let every_gap_counts = levels
        .windows(2)
        .all(|w| (w[1] - w[0]) / step > 1.0 - OFF_GRID_MAX);
    (step > 0.0 && on_grid && every_gap_counts).then_some(step)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn motion_um(k: usize) -> f64 {
        5.0 + 4.0 * (0.01 * k as f64).sin() + 0.003 * ((k * 7919) % 1000) as f64 / 1000.0
    }

    #[test]
    fn a_converter_shows_whatever_its_offset_and_however_the_file_was_rounded() {
        for step_um in [0.0047, 0.02, 0.31] {
            let reading = |k: usize| {
                let read_um = ((motion_um(k) - 0.123) / step_um).round() * step_um + 0.123;
                (read_um * 1e5).round() * 1e-5
            };
            let found = step_of(&(0..20_000).map(reading).collect::<Vec<_>>()).unwrap();
            assert!((found / step_um - 1.0).abs() < 1e-3, "{step_um} {found}");
        }
    }

    /// A sweep over ten thousand steps in as many samples comes to few of them twice.
    #[test]
    fn a_fast_record_shows_the_converter_though_hardly_a_reading_comes_again() {
        let reading =
            |k: usize| ((motion_um(k) + 2.0 * (0.037 * k as f64).cos()) / 0.0012).round() * 0.0012;
        let read: Vec<f64> = (0..10_000).map(reading).collect();
        assert!(step_of(&read).is_none());
        assert!((step_between(&levels(&read)).unwrap() / 0.0012 - 1.0).abs() < 1e-3);
        assert!(step_between(&levels(&noise(10_000))).is_none());
    }

    fn noise(n: usize) -> Vec<f64> {
        let mut noise = hysteron_sim::noise::WhiteNoise::new(1.0, 7);
        (0..n).map(|_| noise.next_um()).collect()
    }

    #[test]
    fn rest_and_repeats_say_what_moving_readings_scatter() {
        for (sigma_um, rest_um) in [(0.004, 0.0), (0.006, 0.004), (0.009, -0.003)] {
            let step_um = 0.02;
            let round = |v: f64| (v / step_um).round() * step_um;
            let moving = |k: usize| 1e-4 * k as f64 + 0.3 * (0.001 * k as f64).sin();
            let errors: Vec<f64> = noise(60_000)
                .iter()
                .enumerate()
                .map(|(k, e)| round(moving(k) + sigma_um * e) - moving(k))
                .collect();
            let truth_um = crate::identification::fit::rms(&errors);
            let rest: Vec<f64> = noise(12_000)
                .iter()
                .map(|e| round(rest_um + sigma_um * e))
                .collect();
            let at_rest_um = noise_at_rest_um(&rest, step_um).unwrap();
            assert!(
                (at_rest_um / truth_um - 1.0).abs() < 0.05,
                "rest, {sigma_um}: {at_rest_um} {truth_um}"
            );
            let both = noise(120_000);
            let differences: Vec<f64> = (0..60_000)
                .map(|k| {
                    (round(moving(k) + sigma_um * both[k])
                        - round(moving(k) + sigma_um * both[k + 60_000]))
                        / 2f64.sqrt()
                })
                .collect();
            let between_um =
                noise_between_repeats_um(crate::identification::fit::rms(&differences), step_um);
            assert!(
                (between_um / truth_um - 1.0).abs() < 0.05,
                "repeats, {sigma_um}: {between_um} {truth_um}"
            );
        }
        assert_eq!(noise_at_rest_um(&[0.0; 100], 0.02), None);
    }

    #[test]
    fn noise_smooths_the_staircase() {
        let (step_um, sigma_um) = (0.02, 0.005);
        for reading_um in [0.003, 0.009, 0.012, 0.027] {
            let read =
                |e: &f64| ((reading_um + sigma_um * e) / step_um).round() * step_um - reading_um;
            let mean_um = noise(200_000).iter().map(read).sum::<f64>() / 200_000.0;
            let expected_um = mean_rounding_um(reading_um, step_um, sigma_um);
            assert!(
                (mean_um - expected_um).abs() < 1e-4,
                "{reading_um}: {mean_um} {expected_um}"
            );
        }
    }

    #[test]
    fn what_is_only_written_with_few_digits_is_no_converter() {
        let written = |k: usize| (motion_um(k) * 1e5).round() * 1e-5;
        assert_eq!(step_of(&(0..3000).map(written).collect::<Vec<_>>()), None);
        let held = |k: usize| if k.is_multiple_of(2) { 1.0 } else { 2.0 };
        assert_eq!(step_of(&(0..3000).map(held).collect::<Vec<_>>()), None);
        let uneven = |k: usize| [0.0, 0.1, 0.25, 0.3, 0.47, 0.5, 0.66, 0.7, 0.91, 1.0][k % 10];
        assert_eq!(step_of(&(0..3000).map(uneven).collect::<Vec<_>>()), None);
    }
}
