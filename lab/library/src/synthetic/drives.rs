//! Drives that show what there is to see: those of every simulated data set, and those that are recommended
//! for a recording.

use crate::servo::data_of_stage::RECOMMENDED_MULTISINE_HZ;
use crate::servo::model::SAMPLING_PERIOD_S;
use hysteron_sim::waveform;

/// Seed of the phases of the recommended multisines.
const SEED: u64 = 1;
/// Sampling rate of the servo, Hz.
const SERVO_RATE_HZ: f64 = 1.0 / SAMPLING_PERIOD_S;
/// Samples in a period of the multisine that a servo is designed from.
const WIDEBAND_PERIOD: usize = 4000;

/// The drive of one record, and what the record is for.
#[derive(Clone, Debug)]
pub struct DriveOfRecord {
    /// Name of its file.
    pub name: &'static str,
    /// `identify`, `validate` or `noise`.
    pub role: &'static str,
    /// Sampling rate, Hz.
    pub rate_hz: f64,
    /// Drive, V.
    pub drive_v: Vec<f64>,
    /// Length of a steady-state period, and the time from which there are some, s.
    pub period_s: Option<(f64, f64)>,
    /// State at the first sample, as manifests call it.
    pub initial_state: &'static str,
    /// Where what counts begins, s.
    pub from_s: Option<f64>,
}

impl DriveOfRecord {
    /// Of an actuator that was never driven, without periods.
    fn virgin(name: &'static str, role: &'static str, rate_hz: f64, drive_v: Vec<f64>) -> Self {
        Self {
            name,
            role,
            rate_hz,
            drive_v,
            period_s: None,
            initial_state: "virgin",
            from_s: None,
        }
    }
}

/// One cycle over the range and a rest, so that the loops that follow are settled.
fn conditioned(rate_hz: f64, peak_v: f64, seconds: f64, then: Vec<f64>) -> Vec<f64> {
    let mut out = waveform::raised_cosine(rate_hz, 1.0 / seconds, 0.0, peak_v, 1);
    out.extend(waveform::hold(rate_hz, 0.0, 0.6 * seconds));
    out.extend(then);
    out
}

/// Drives from 0 V to a peak that show every effect of the library, with held-out ones of other shapes:
/// nested triangles (loops and the first rise), sine bursts of rising frequency and a multisine in repeated
/// periods (dynamics), holds (creep and drift), rest (noise).
#[must_use]
pub fn drives(peak_v: f64, seed: u64) -> Vec<DriveOfRecord> {
    let begun = |drive: DriveOfRecord| {
        let seconds = match drive.name {
            "sines" | "multisine" | "validation" => 0.1,
            "hold" | "hold2" => 1.0,
            _ => return drive,
        };
        DriveOfRecord {
            drive_v: conditioned(drive.rate_hz, peak_v, seconds, drive.drive_v),
            ..drive
        }
    };
    bare_drives(peak_v, seed).into_iter().map(begun).collect()
}

/// The shapes, without what prepares the actuator for them.
fn bare_drives(peak_v: f64, seed: u64) -> Vec<DriveOfRecord> {
    let stair = |tops: &[f64]| {
        let mut vertices = vec![0.0];
        vertices.extend(tops.iter().map(|t| t * peak_v / 70.0));
        waveform::triangles(2000.0, 200.0, &vertices)
    };
    let bursts = {
        let mut out = Vec::new();
        for hz in [5.0_f64, 20.0, 50.0, 100.0, 200.0, 400.0] {
            let amplitude = peak_v * if hz < 60.0 { 0.42 } else { 0.17 };
            let seconds = (3.0 / hz).clamp(0.03, 0.25);
            out.extend(waveform::sine_burst(
                20_000.0,
                hz,
                amplitude,
                0.45 * peak_v,
                seconds,
            ));
        }
        out
    };
    let period = 3800;
    let lines: Vec<usize> = (1..=285).step_by(3).collect();
    let multisine = waveform::multisine(period, &lines, 0.09 * peak_v, 0.43 * peak_v, 6, seed);
    let several: Vec<f64> = (0..11_000)
        .map(|k| {
            let t = f64::from(k) / 20_000.0;
            let ramp = (t / 0.03).min(1.0);
            let tau = std::f64::consts::TAU;
            ramp * peak_v
                * (0.46
                    + 0.21 * (tau * 13.0 * t).sin()
                    + 0.12 * (tau * 47.0 * t + 1.0).sin()
                    + 0.06 * (tau * 131.0 * t).sin())
        })
        .collect();
    vec![
        DriveOfRecord::virgin(
            "stair",
            "identify",
            2000.0,
            stair(&[
                20.0, 5.0, 35.0, 10.0, 50.0, 20.0, 45.0, 25.0, 60.0, 0.0, 70.0, 0.0, 65.0, 10.0,
                55.0, 20.0, 45.0, 30.0, 40.0, 0.0,
            ]),
        ),
        DriveOfRecord::virgin(
            "stair2",
            "validate",
            2000.0,
            stair(&[
                15.0, 3.0, 42.0, 18.0, 55.0, 8.0, 38.0, 14.0, 66.0, 30.0, 58.0, 22.0, 47.0, 0.0,
            ]),
        ),
        DriveOfRecord::virgin("sines", "identify", 20_000.0, bursts),
        DriveOfRecord {
            period_s: Some((0.19, 0.35)),
            ..DriveOfRecord::virgin("multisine", "identify", 20_000.0, multisine)
        },
        DriveOfRecord::virgin(
            "hold",
            "identify",
            200.0,
            waveform::steps(
                200.0,
                &[
                    (0.43 * peak_v, 12.0),
                    (0.79 * peak_v, 12.0),
                    (0.21 * peak_v, 12.0),
                ],
            ),
        ),
        DriveOfRecord::virgin(
            "hold2",
            "validate",
            200.0,
            waveform::steps(
                200.0,
                &[
                    (0.64 * peak_v, 9.0),
                    (0.29 * peak_v, 9.0),
                    (0.86 * peak_v, 9.0),
                ],
            ),
        ),
        DriveOfRecord::virgin("rest", "noise", 20_000.0, vec![0.0; 12_000]),
        DriveOfRecord::virgin("validation", "validate", 20_000.0, several),
    ]
}

/// Length of the smooth way to where a drive begins and back to rest from where it ends, s.
const WAY_S: f64 = 0.05;

/// What a drive is in a session: after whatever came before, a cycle over the range wipes out the memory of
/// the loops, a rest follows, and the drive begins and ends smoothly at the lower limit. What counts begins
/// after the rest, from a state that nobody knows.
fn in_a_session(drive: DriveOfRecord, range_v: f64) -> DriveOfRecord {
    let rate_hz = drive.rate_hz;
    let seconds = if rate_hz > 1000.0 { 0.2 } else { 2.0 };
    // Without its last sample, which is the first of what follows.
    let way = |from: f64, to: f64| {
        let mut way = waveform::half_cosines(rate_hz, WAY_S, &[from, to]);
        way.pop();
        way
    };
    let mut drive_v = conditioned(rate_hz, range_v, seconds, Vec::new());
    let from_s = drive_v.len() as f64 / rate_hz;
    let (first, last) = (drive.drive_v[0], drive.drive_v[drive.drive_v.len() - 1]);
    drive_v.extend(way(0.0, first));
    let begins_s = drive_v.len() as f64 / rate_hz;
    drive_v.extend(&drive.drive_v);
    drive_v.extend(way(last, 0.0));
    drive_v.push(0.0);
    // The first period still carries what came before it.
    let period_s = drive
        .period_s
        .map(|(period_s, _)| (period_s, begins_s + period_s));
    DriveOfRecord {
        drive_v,
        period_s,
        initial_state: "unknown",
        from_s: Some(from_s),
        ..drive
    }
}

/// Drives for a recording between two limits, in the order in which they are played: first nested triangles
/// from a state in which nothing was driven yet, then the others, each as in [`in_a_session`], and the drive
/// that a servo is designed from: a small multisine that goes nearly to half its sampling rate.
#[must_use]
pub fn recommended_drives(low_v: f64, high_v: f64) -> Vec<DriveOfRecord> {
    let range_v = high_v - low_v;
    let last = (RECOMMENDED_MULTISINE_HZ * SAMPLING_PERIOD_S * WIDEBAND_PERIOD as f64) as usize;
    let lines: Vec<usize> = (1..=last).step_by(3).collect();
    let wideband = DriveOfRecord {
        name: "wideband",
        role: "identify",
        rate_hz: SERVO_RATE_HZ,
        drive_v: waveform::multisine(
            WIDEBAND_PERIOD,
            &lines,
            0.05 * range_v,
            0.5 * range_v,
            10,
            SEED,
        ),
        period_s: Some((WIDEBAND_PERIOD as f64 * SAMPLING_PERIOD_S, 0.0)),
        initial_state: "unknown",
        from_s: None,
    };
    let prepared = |drive: DriveOfRecord| match drive.name {
        "stair" => drive,
        "rest" => DriveOfRecord {
            initial_state: "unknown",
            ..drive
        },
        _ => in_a_session(drive, range_v),
    };
    let mut out: Vec<DriveOfRecord> = bare_drives(range_v, SEED)
        .into_iter()
        .chain([wideband])
        .map(prepared)
        .collect();
    for drive in &mut out {
        // The last bit of a product must not lead beyond the limit.
        drive
            .drive_v
            .iter_mut()
            .for_each(|u| *u = (*u + low_v).clamp(low_v, high_v));
    }
    out
}

/// Steps of the drives that a board plays slowly, ticks of its servo.
const SLOW_TICKS: f64 = 10.0;
/// The same of those that are between slow and fast.
const MIDDLE_TICKS: f64 = 4.0;
/// The same of holds.
const HOLD_TICKS: f64 = 200.0;

/// Length of the smooth way from one level of these drives to the next, s.
const BOARD_WAY_S: f64 = 0.1;

/// Drives that a board plays and records by itself: none has more points than its wave table, 4096, or more
/// samples than its recorder, 16383. In the order in which they are played: after a conditioning, nested
/// triangles, then the others; each begins and ends at the lower limit, where nobody knows how much of the
/// creep before it is left. The multisine is that of [`recommended_drives`] and repeats from its first
/// sample.
#[must_use]
pub fn board_drives(low_v: f64, high_v: f64) -> Vec<DriveOfRecord> {
    let range_v = high_v - low_v;
    let slow_hz = SERVO_RATE_HZ / SLOW_TICKS;
    let middle_hz = SERVO_RATE_HZ / MIDDLE_TICKS;
    let hold_hz = SERVO_RATE_HZ / HOLD_TICKS;
    let stair = |tops: &[f64]| {
        let vertices: Vec<f64> = std::iter::once(&0.0)
            .chain(tops)
            .map(|top| top * range_v)
            .collect();
        waveform::triangles(slow_hz, 5.5 * range_v, &vertices)
    };
    let bursts: Vec<f64> = [
        (20.0, 0.42),
        (50.0, 0.3),
        (100.0, 0.17),
        (200.0, 0.17),
        (400.0, 0.17),
    ]
    .into_iter()
    .flat_map(|(hz, share): (f64, f64)| {
        waveform::sine_burst(
            middle_hz,
            hz,
            share * range_v,
            0.45 * range_v,
            (3.0 / hz).max(0.05),
        )
    })
    .collect();
    let several: Vec<f64> = (0..4000)
        .map(|k| {
            let (t, end_s) = (f64::from(k) / middle_hz, 4000.0 / middle_hz);
            let ramp = (t.min(end_s - t) / 0.03).min(1.0);
            let sine = |hz: f64, phase: f64| (std::f64::consts::TAU * hz * t + phase).sin();
            ramp * range_v
                * (0.46 + 0.21 * sine(13.0, 0.0) + 0.12 * sine(47.0, 1.0) + 0.06 * sine(131.0, 0.0))
        })
        .collect();
    let last = (RECOMMENDED_MULTISINE_HZ * SAMPLING_PERIOD_S * WIDEBAND_PERIOD as f64) as usize;
    let lines: Vec<usize> = (1..=last).step_by(3).collect();
    let wideband = waveform::multisine(
        WIDEBAND_PERIOD,
        &lines,
        0.05 * range_v,
        0.5 * range_v,
        4,
        SEED,
    );
    let period_s = WIDEBAND_PERIOD as f64 * SAMPLING_PERIOD_S;
    // No point may be further from the one before than the slew limit of a slow amplifier leads in a few
    // ticks.
    let way = |rate_hz: f64, from_v: f64, to_v: f64| {
        let mut way = waveform::half_cosines(rate_hz, BOARD_WAY_S, &[from_v, to_v]);
        way.pop();
        way
    };
    let holds = {
        let mut out = Vec::new();
        for pair in [0.0, 0.43, 0.79, 0.21, 0.0]
            .map(|share| share * range_v)
            .windows(2)
        {
            let [before_v, level_v] = [pair[0], pair[1]];
            out.extend(way(hold_hz, before_v, level_v));
            out.extend(waveform::hold(
                hold_hz,
                level_v,
                if level_v > 0.0 { 0.9 } else { 0.05 },
            ));
        }
        out
    };
    let bursts = {
        let (first_v, last_v) = (bursts[0], bursts[bursts.len() - 1]);
        let mut out = way(middle_hz, 0.0, first_v);
        out.extend(bursts);
        out.extend(way(middle_hz, last_v, 0.0));
        out.push(0.0);
        out
    };
    let drive = |name, role, rate_hz, drive_v| DriveOfRecord {
        initial_state: "unknown",
        ..DriveOfRecord::virgin(name, role, rate_hz, drive_v)
    };
    let first = [
        0.29, 0.07, 0.5, 0.14, 0.71, 0.29, 0.64, 0.36, 0.86, 0.0, 1.0, 0.0, 0.93, 0.14, 0.79, 0.29,
        0.64, 0.43, 0.57, 0.0,
    ];
    let second = [
        0.21, 0.04, 0.6, 0.26, 0.79, 0.11, 0.54, 0.2, 0.94, 0.43, 0.83, 0.31, 0.67, 0.0,
    ];
    let mut out = vec![
        DriveOfRecord {
            initial_state: "settled",
            ..drive("rest", "noise", SERVO_RATE_HZ, vec![0.0; 4000])
        },
        DriveOfRecord {
            initial_state: "settled",
            ..drive("stair", "identify", slow_hz, stair(&first))
        },
        drive("stair2", "validate", slow_hz, stair(&second)),
        drive("sines", "identify", middle_hz, bursts),
        drive("validation", "validate", middle_hz, several),
        DriveOfRecord {
            period_s: Some((period_s, period_s)),
            ..drive("wideband", "identify", SERVO_RATE_HZ, wideband)
        },
        drive("hold", "identify", hold_hz, holds),
    ];
    for drive in &mut out {
        // The last bit of a product must not lead beyond the limit.
        drive
            .drive_v
            .iter_mut()
            .for_each(|u| *u = (*u + low_v).clamp(low_v, high_v));
    }
    out
}

/// The manifest for recordings that have the names of their drives.
#[must_use]
pub fn manifest(name: &str, low_v: f64, high_v: f64, drives: &[DriveOfRecord]) -> String {
    let mut text = format!(
        "name = \"{name}\"\ndrive_min_v = {low_v:?}\ndrive_max_v = {high_v:?}\ntiming = \"hold_after_sample\"\n"
    );
    for drive in drives {
        text.push_str(&format!(
            "\n[[record]]\nfile = \"{}.csv\"\nsample_rate_hz = {:?}\nrole = \"{}\"\ninitial_state = \"{}\"\n",
            drive.name, drive.rate_hz, drive.role, drive.initial_state
        ));
        if let Some(from_s) = drive.from_s {
            text.push_str(&format!("from_s = {from_s:?}\n"));
        }
        if let Some((period_s, from_s)) = drive.period_s {
            text.push_str(&format!(
                "period_s = {period_s:?}\nperiodic_from_s = {from_s:?}\n"
            ));
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_board_has_room_for_the_drives_that_it_plays() {
        for (low, high) in [(0.0, 70.0), (-20.0, 130.0)] {
            for drive in board_drives(low, high) {
                let points = drive.period_s.map_or(drive.drive_v.len(), |(period_s, _)| {
                    (period_s * drive.rate_hz).round() as usize
                });
                assert!(
                    points <= 4096 && drive.drive_v.len() <= 16_383,
                    "{}: {points} of {}",
                    drive.name,
                    drive.drive_v.len()
                );
                assert!(
                    drive.drive_v.iter().all(|u| (low..=high).contains(u)),
                    "{}",
                    drive.name
                );
                let jump = drive
                    .drive_v
                    .windows(2)
                    .map(|w| (w[1] - w[0]).abs())
                    .fold((drive.drive_v[0] - low).abs(), f64::max);
                assert!(
                    drive.period_s.is_some() || jump < 0.1 * (high - low),
                    "{} jumps by {jump} V",
                    drive.name
                );
                assert!(
                    (SERVO_RATE_HZ / drive.rate_hz).fract() == 0.0,
                    "{}: whole ticks",
                    drive.name
                );
                assert!(
                    drive
                        .drive_v
                        .iter()
                        .zip(drive.drive_v.iter().skip(points))
                        .all(|(a, b)| a == b),
                    "{} repeats",
                    drive.name
                );
            }
        }
    }

    #[test]
    fn the_recommended_drives_stay_within_their_limits_and_repeat_as_they_say() {
        for (low, high) in [(0.0, 70.0), (-20.0, 130.0)] {
            let all = recommended_drives(low, high);
            for drive in &all {
                assert!(
                    drive.drive_v.iter().all(|u| (low..=high).contains(u)),
                    "{} within {low}..{high}",
                    drive.name
                );
                let last = drive.drive_v[drive.drive_v.len() - 1];
                assert!(
                    drive.drive_v[0] == low && last == low,
                    "{} begins and ends at rest",
                    drive.name
                );
                let jump = drive
                    .drive_v
                    .windows(2)
                    .map(|w| (w[1] - w[0]).abs())
                    .fold(0.0, f64::max);
                // Holds are steps, and bursts of 400 Hz are fast.
                assert!(
                    drive.name.starts_with("hold") || jump < 0.1 * (high - low),
                    "{} jumps by {jump} V",
                    drive.name
                );
                if let Some((period_s, from_s)) = drive.period_s {
                    let (period, from) = (
                        (period_s * drive.rate_hz).round() as usize,
                        (from_s * drive.rate_hz).round() as usize,
                    );
                    // The rest of a period at the end, the way back to rest, does not count.
                    let whole = (drive.drive_v.len() - from) / period * period;
                    let repeats = (from..from + whole - period)
                        .all(|k| (drive.drive_v[k] - drive.drive_v[k + period]).abs() < 1e-9);
                    assert!(
                        repeats && whole > 3 * period,
                        "{}: {whole} samples of whole periods",
                        drive.name
                    );
                }
            }
            let widest = all
                .iter()
                .map(|d| d.drive_v.iter().fold(low, |m, u| m.max(*u)))
                .fold(low, f64::max);
            assert!(
                widest > low + 0.99 * (high - low),
                "the loops go over the whole range"
            );
        }
    }
}
