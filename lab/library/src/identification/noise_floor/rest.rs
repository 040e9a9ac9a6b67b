//! The noise that rest shows: in records of their own, and where a drive holds still inside a record.

use super::estimate::{FloorEstimate, FloorEvidence};
use super::one_over_f::OneOverFNoise;
use super::random_part::{Beside, lines_hz, random, random_part_beside_lines};
use crate::dataset::holds::{holds, read_noise_v};
use crate::dataset::reading_grid::{noise_at_rest_um, rounding_noise};
use crate::dataset::{Record, Role};
use std::ops::Range;

/// Noise below this share of a step leaves the reading where it is most of the time, and with it the error of
/// rounding.
const HIDDEN_BY_STEP: f64 = 0.5;
/// Least samples of a hold that say something of the noise.
const HOLD_SAMPLES_MIN: usize = 400;
/// Share of a hold that a ring and the first of the creep are given to die.
const SETTLING: f64 = 0.4;
/// Parts of a hold that are looked at by themselves: creep is no polynomial over a decade of time, but it is
/// over a short part.
const PARTS: usize = 4;

/// What a drive that stands still lets see of the readings.
pub(super) struct AtRest {
    pub estimate: FloorEstimate,
    /// The 1/f noise, where it shows.
    pub one_over_f: Option<OneOverFNoise>,
    /// Lines beside the noise, Hz.
    pub lines_hz: Vec<f64>,
    /// Samples in which they were looked for.
    pub samples: usize,
    pub sample_rate_hz: f64,
}

/// What a record at rest shows. Noise that hardly ever leaves a step of the reading is judged by how often it
/// does.
pub(super) fn of_record(record: &Record, step_um: Option<f64>) -> AtRest {
    let readings_um: Vec<f64> = record
        .counted()
        .map(|k| record.displacement_um[k])
        .collect();
    let force_n: Option<Vec<f64>> = record
        .force_n
        .as_ref()
        .map(|f| record.counted().map(|k| f[k]).collect());
    let Beside {
        residual: residual_um,
        rms: random_um,
        lines_hz,
    } = random(
        &readings_um,
        record.sample_rate_hz,
        force_n.as_deref().map(|f| (f, 0)),
    );
    let rms_um = with_hidden_steps(random_um, &readings_um, step_um);
    let estimate = FloorEstimate::new(
        FloorEvidence::RestRecord,
        vec![record.name.clone()],
        rms_um,
        readings_um.len(),
    );
    // Rounding hides what a spectrum would show of noise below it.
    let shown = step_um.is_none_or(|step_um| random_um >= HIDDEN_BY_STEP * step_um);
    AtRest {
        estimate,
        one_over_f: OneOverFNoise::of_rest(&residual_um, record.sample_rate_hz).filter(|_| shown),
        lines_hz,
        samples: readings_um.len(),
        sample_rate_hz: record.sample_rate_hz,
    }
}

/// How much a drive that stands still scatters, because it was read back and not commanded, V.
pub(super) fn drive_noise_v(record: &Record) -> f64 {
    let still = match record.role {
        Role::Noise => Some(record.window.clone()),
        _ => holds(&record.drive_v, &record.displacement_um, HOLD_SAMPLES_MIN)
            .into_iter()
            .max_by_key(Range::len),
    };
    still.map_or(0.0, |range| read_noise_v(&record.drive_v[range]))
}

fn with_hidden_steps(random_um: f64, readings_um: &[f64], step_um: Option<f64>) -> f64 {
    match step_um.filter(|step_um| random_um < HIDDEN_BY_STEP * step_um) {
        Some(step_um) => noise_at_rest_um(readings_um, step_um)
            .unwrap_or_else(|| random_um.hypot(rounding_noise(step_um))),
        None => random_um,
    }
}

/// What the longest hold inside a driven record shows, in front of its window or behind its end too.
pub(super) fn of_hold(record: &Record, step_um: Option<f64>) -> Option<AtRest> {
    let says_something = |hold: &Range<usize>| {
        record
            .left_out
            .iter()
            .all(|range| range.start >= hold.end || hold.start >= range.end)
    };
    let holds = holds(&record.drive_v, &record.displacement_um, HOLD_SAMPLES_MIN);
    let hold = holds
        .into_iter()
        .filter(says_something)
        .max_by_key(Range::len)?;
    if record
        .force_n
        .as_ref()
        .is_some_and(|f| f[hold.clone()].iter().any(|v| *v != f[hold.start]))
    {
        return None;
    }
    let settled = hold.start + (SETTLING * hold.len() as f64) as usize..hold.end;
    if settled.len() < HOLD_SAMPLES_MIN / 2 {
        return None;
    }
    let length = settled.len() / PARTS.min(settled.len() / (HOLD_SAMPLES_MIN / 2)).max(1);
    let readings_um = &record.displacement_um[settled];
    // Of hum a part may hold a period or two, which look like drift there.
    let lines_hz = lines_hz(readings_um, record.sample_rate_hz);
    let mut of_parts: Vec<f64> = readings_um
        .chunks_exact(length)
        .map(|part| {
            with_hidden_steps(
                random_part_beside_lines(part, record.sample_rate_hz, &lines_hz),
                part,
                step_um,
            )
        })
        .collect();
    of_parts.sort_by(f64::total_cmp);
    let rms_um = *of_parts.get(of_parts.len() / 2)?;
    (rms_um > 0.0).then(|| AtRest {
        estimate: FloorEstimate::new(
            FloorEvidence::Hold,
            vec![record.name.clone()],
            rms_um,
            readings_um.len(),
        ),
        one_over_f: None,
        lines_hz,
        samples: readings_um.len(),
        sample_rate_hz: record.sample_rate_hz,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Hum whose period is as long as most of a part, in holds that are no whole number of periods: it is no
    /// noise.
    #[test]
    fn hum_in_a_short_hold_is_no_noise() {
        let rate_hz = 20_000.0;
        for (hold, hum_hz) in [
            (4000, 50.0),
            (4700, 50.0),
            (5100, 60.0),
            (3700, 100.0),
            (12_000, 50.0),
        ] {
            let mut noise = hysteron_sim::noise::WhiteNoise::new(0.002, 4 + hold as u64);
            let drive: Vec<f64> = (0..hold + 6000)
                .map(|k| {
                    if k < hold {
                        10.0
                    } else {
                        10.0 + 5.0 * (0.01 * (k - hold) as f64).sin()
                    }
                })
                .collect();
            let hum =
                |k: usize| 0.06 * (std::f64::consts::TAU * hum_hz * k as f64 / rate_hz + 1.0).sin();
            let reading = drive
                .iter()
                .enumerate()
                .map(|(k, u)| 0.1 * u + hum(k) + noise.next_um())
                .collect();
            let found = of_hold(&Record::new("r", rate_hz, drive, reading), None)
                .unwrap()
                .estimate;
            assert!(
                (found.rms_um / 0.002 - 1.0).abs() < 0.1,
                "{hold} samples, {hum_hz} Hz: {}",
                found.rms_um
            );
        }
    }

    /// A step that rings and creeps, then a sine: the noise is what the hold has beside both.
    #[test]
    fn a_hold_inside_a_record_shows_the_noise() {
        let (n, rate_hz) = (12_000, 10_000.0);
        let mut noise = hysteron_sim::noise::WhiteNoise::new(0.002, 4);
        let drive: Vec<f64> = (0..n)
            .map(|k| {
                if k < 8000 {
                    10.0
                } else {
                    10.0 + 5.0 * (0.01 * k as f64).sin()
                }
            })
            .collect();
        let reading = drive.iter().enumerate().map(|(k, u)| {
            let t_s = k as f64 / rate_hz;
            u + (-60.0 * t_s).exp() * (4600.0 * t_s).cos()
                + 0.2 * (1.0 + 10.0 * t_s).ln()
                + noise.next_um()
        });
        let reading = reading.collect();
        let found = of_hold(&Record::new("r", rate_hz, drive, reading), None)
            .unwrap()
            .estimate;
        assert!(
            (found.rms_um / 0.002 - 1.0).abs() < 0.06,
            "{}",
            found.rms_um
        );
    }
}
