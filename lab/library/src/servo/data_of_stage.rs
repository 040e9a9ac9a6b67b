//! Whether data are of the stage that a model describes, and what is in the way where they do not confirm it:
//! too little drive, or the model itself.
//!
//! What hides a response in a recording is all that the model leaves of the readings: noise, and what the
//! model does not describe. What noise alone would hide is known too ([`ServoRecording::noise_hides_at`]).
//! Where that is little, more drive would not help: the model is of another stage, or lacks something that
//! this stage has.

use super::model::{LinearModel, ModeModel, SAMPLING_PERIOD_S};
use super::recording::ServoRecording;
use super::robust::most_reckoned_with;
use super::sampled_loop::frequency_response;
use crate::dataset::{Dataset, Role};
use crate::identification::fit::counted_residual;
use hysteron_sim::chain::Model;
use std::f64::consts::TAU;

/// The first mode is a fact where the recording could not hide this share of its peak.
const FIRST_SHOWN: f64 = 0.2;
/// Above this damping ratio a mode is so broad that an octave to either side shows it.
const BROAD: f64 = 0.1;
/// Data of which a model leaves more than this share (RMS over RMS) are not of its stage.
const OTHER_STAGE: f64 = 0.2;
/// A residual of this many times the noise is large.
pub(super) const LARGE_RESIDUAL: f64 = 2.0;
/// A response that is off by this share of the model's own is another one.
const WRONG: f64 = 0.5;
/// The model and not the noise hides a response where noise alone would hide less than this share of it.
const BY_NOISE: f64 = 0.5;

/// Highest line of the multisine that is recommended, Hz: a mode between it and half the sampling rate, which
/// nothing would show, has to be stood by every servo.
pub const RECOMMENDED_MULTISINE_HZ: f64 = 0.499 / SAMPLING_PERIOD_S;

/// The drive that would show a frequency so many times better: more of the one that a record has there, or
/// one that nothing has yet.
fn missing_drive(recording: Option<&ServoRecording>, hz: f64, times: f64) -> String {
    let there = recording
        .filter(|_| times.is_finite() && times > 1.0)
        .and_then(|r| Some((r, r.driven_by_at(hz)?)));
    if let Some((recording, name)) = there {
        let [level, by_noise] = [recording.level_at(hz), recording.noise_hides_at(hz)]
            .map(|v| v.unwrap_or(f64::INFINITY));
        if by_noise >= BY_NOISE * level {
            return format!(
                "your record `{name}` is below the noise at {hz:.0} Hz: raise its amplitude {times:.1} times, or record it {:.0} times as long",
                (times * times).ceil()
            );
        }
        return format!(
            "your record `{name}` shows more there than the model has: identify with another effect, such as second_mode"
        );
    }
    if hz > RECOMMENDED_MULTISINE_HZ {
        return format!(
            "record a multisine to beyond {hz:.0} Hz, sampled fast enough for it, 2 s, beside the other records"
        );
    }
    format!(
        "record a multisine to {RECOMMENDED_MULTISINE_HZ:.0} Hz at {:.0} Hz, 2 s, beside the other records (`hysteron drives` writes it)",
        1.0 / SAMPLING_PERIOD_S
    )
}

/// What the user can do about data that are not those of the model.
const OTHER_DATA: &str =
    "name the recording that the model was identified from, or identify on this one";

/// That a model does not describe its data, with the figures, if it leaves far more than the noise.
fn not_described(recording: &ServoRecording) -> Option<String> {
    let noise_um = recording
        .noise_um
        .filter(|noise_um| recording.residual_um > LARGE_RESIDUAL * noise_um)?;
    Some(format!(
        "the model does not describe --data, which is of another stage or shows more than the model has: it leaves {:.1} nm RMS where the sensor's noise is {:.1} nm",
        1e3 * recording.residual_um,
        1e3 * noise_um
    ))
}

/// What lets a recording exclude a missing response at a frequency, Hz, that is so many times as large as can
/// be stood: more drive, or a model that describes it.
pub(super) fn how_to_exclude(recording: Option<&ServoRecording>, hz: f64, times: f64) -> String {
    let by_model = recording.filter(|r| {
        let level = r.level_at(hz).unwrap_or(f64::INFINITY);
        level.is_finite()
            && r.noise_hides_at(hz)
                .is_some_and(|by_noise| by_noise < BY_NOISE * level)
    });
    match by_model.and_then(not_described) {
        Some(not_described) => format!("{not_described}, and that hides it; {OTHER_DATA}"),
        None => missing_drive(recording, hz, times),
    }
}

/// Whether the recording shows the first mode.
///
/// # Errors
/// Why not.
pub(super) fn first_mode_shown(recording: &ServoRecording, mode: &ModeModel) -> Result<(), String> {
    let hz = mode.natural_frequency_rad_s / TAU;
    let around: Vec<f64> = if mode.damping_ratio > BROAD {
        (-10..=10)
            .map(|i| hz * 2f64.powf(f64::from(i) / 10.0))
            .collect()
    } else {
        vec![
            hz * (1.0 - mode.damping_ratio),
            hz,
            hz * (1.0 + mode.damping_ratio),
        ]
    };
    let least = |of: &dyn Fn(f64) -> Option<f64>| {
        around
            .iter()
            .filter_map(|hz| of(*hz))
            .fold(f64::INFINITY, f64::min)
    };
    let hidden = least(&|hz| recording.blind_at(hz));
    let peak = 1.0_f64.max(0.5 / mode.damping_ratio);
    if hidden <= FIRST_SHOWN * peak {
        return Ok(());
    }
    let by_noise = least(&|hz| recording.noise_hides_at(hz));
    if let Some(not_described) = not_described(recording).filter(|_| by_noise <= FIRST_SHOWN * peak)
    {
        return Err(format!(
            "{not_described}. That could hide a response of {hidden:.2} um/um at {hz:.0} Hz, where the model's first mode has {peak:.2} um/um, while noise alone would hide {by_noise:.2}; {OTHER_DATA}"
        ));
    }
    let times = hidden / (FIRST_SHOWN * peak);
    let hidden = if hidden.is_finite() {
        format!("could hide a response of {hidden:.2} um/um there")
    } else {
        "is too slow for it".into()
    };
    Err(format!(
        "the model's first mode at {hz:.0} Hz is no fact: the recording {hidden}, where the mode has {peak:.2} um/um; {}",
        missing_drive(Some(recording), hz, times)
    ))
}

/// Whether the data show no larger missing response than a servo is held against, where that is no small part
/// of the model's own.
///
/// # Errors
/// Where they do, with the figures.
pub(super) fn require_described(
    recording: &ServoRecording,
    linear: &LinearModel,
) -> Result<(), String> {
    let first_hz = linear.first_mode.natural_frequency_rad_s / TAU;
    let sampled = linear.sampled();
    let (hz, missing, has) = recording
        .frequency_hz
        .iter()
        .zip(&recording.missing)
        .map(|(hz, missing)| (*hz, *missing, frequency_response(&sampled, TAU * hz).norm()))
        .filter(|(hz, missing, has)| {
            *missing > most_reckoned_with(first_hz, *hz) && *missing > WRONG * has
        })
        .max_by(|a, b| a.1.total_cmp(&b.1))
        .unwrap_or_default();
    match not_described(recording) {
        Some(not_described) if missing > 0.0 => Err(format!(
            "{not_described}. At {hz:.0} Hz, where the model (first mode at {first_hz:.0} Hz) has a response of {has:.2} um/um, the data show another one that is {missing:.2} um/um off, more than a servo is held against; {OTHER_DATA}"
        )),
        _ => Ok(()),
    }
}

/// Whether the data are of the stage that the model describes: what the model leaves of the readings that it
/// should give, over how far they move.
///
/// # Errors
/// That they are not, with the figures.
pub(super) fn require_same_stage(chain: &Model, dataset: &Dataset) -> Result<(), String> {
    let (mut sum_yy, mut sum_ys, mut sum_ss, mut count) = (0.0, 0.0, 0.0, 0);
    for record in dataset
        .records
        .iter()
        .filter(|r| !matches!(r.role, Role::Noise | Role::Test))
    {
        let missed = counted_residual(chain, record);
        let read: Vec<f64> = record
            .counted()
            .map(|k| record.displacement_um[k])
            .collect();
        let mean =
            |signal: &mut dyn Iterator<Item = f64>| signal.sum::<f64>() / read.len().max(1) as f64;
        let of_read = mean(&mut read.iter().copied());
        let of_model = mean(&mut read.iter().zip(&missed).map(|(y, e)| y - e));
        for (y, e) in read.iter().zip(&missed) {
            let (y, s) = (y - of_read, y - e - of_model);
            (sum_yy, sum_ys, sum_ss) = (sum_yy + y * y, sum_ys + y * s, sum_ss + s * s);
        }
        count += read.len();
    }
    let rms_um = |sum: f64| (sum.max(0.0) / count.max(1) as f64).sqrt();
    let (moves_um, left_um) = (rms_um(sum_yy), rms_um(sum_yy - 2.0 * sum_ys + sum_ss));
    if !(moves_um > 0.0 && left_um > OTHER_STAGE * moves_um) {
        return Ok(());
    }
    let factor = sum_ys / sum_ss;
    let scaled_um = rms_um(sum_yy - factor * sum_ys);
    Err(format!(
        "--data is not of the stage that this model describes: of readings that move by {moves_um:.3} um RMS the model leaves {left_um:.3} um ({:.0} %); with {factor:.2} times its displacement it would leave {scaled_um:.3} um; {OTHER_DATA}",
        100.0 * left_um / moves_um
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Lines of 9.77 Hz to half the loop's rate, with one value of everything.
    fn recording(level: f64, by_noise: f64, driven_by: Option<&str>) -> ServoRecording {
        let frequency_hz: Vec<f64> = (2..1024)
            .map(|i| f64::from(i) * 10_000.0 / 1024.0)
            .collect();
        let all = |value: f64| vec![value; frequency_hz.len()];
        ServoRecording {
            level: all(level),
            blind: all(level),
            by_noise: all(by_noise),
            missing: all(0.0),
            driven_by: vec![driven_by.map(str::to_owned); frequency_hz.len()],
            frequency_hz,
            noise_um: Some(0.003),
            residual_um: 0.003,
        }
    }

    #[test]
    fn a_record_below_the_noise_is_to_be_raised_and_not_asked_for() {
        let said = |level, by_noise, driven_by| {
            how_to_exclude(Some(&recording(level, by_noise, driven_by)), 5250.0, 2.08)
        };
        let raised = said(0.4, 0.38, Some("wideband"));
        assert_eq!(
            raised,
            "your record `wideband` is below the noise at 5250 Hz: raise its amplitude 2.1 times, or record it 5 times as long"
        );
        assert!(said(0.4, 0.38, None).starts_with("record a multisine"));
        assert!(said(f64::INFINITY, f64::INFINITY, None).starts_with("record a multisine"));
        assert!(said(0.4, 0.01, Some("wideband")).contains("shows more there than the model has"));
    }
}
