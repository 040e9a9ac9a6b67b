//! Findings of a servo in sentences, for screens, pages and the lab.

use hysteron::servo::check::below_one;
use hysteron::servo::explanation::mass_in_words;
use hysteron::servo::known::OnPlants;
use hysteron::servo::loop_margins::{FirstUnstable, LoopMargins, differ, unstable_from};
use hysteron::servo::members::{OnMember, PlantBand};
use hysteron::servo::sampled_loop::decibels;
use hysteron::servo::track::{SETTLED, StepFigures};
use hysteron::statistics::extremes;

fn in_nm(um: f64) -> String {
    format!("{:.2} nm", 1e3 * um)
}

/// What a step became.
#[must_use]
pub fn step(step: &StepFigures) -> String {
    let settled = match step.settling_s {
        Some(s) => format!("settles to {:.0} % in {:.2} ms", 100.0 * SETTLED, 1e3 * s),
        None => format!(
            "does not settle to {:.0} %, {}",
            100.0 * SETTLED,
            in_nm(SETTLED * step.by_um.abs())
        ),
    };
    let rise = step
        .rise_s
        .map_or_else(String::new, |s| format!(", rises in {:.2} ms", 1e3 * s));
    format!(
        "{settled}{rise}, overshoots by {:.1} %",
        100.0 * step.overshoot
    )
}

/// What the servo does on other plants: each line with its word in front.
#[must_use]
pub fn band(band: &PlantBand) -> Vec<[String; 2]> {
    let range = |[least, most]: [f64; 2]| format!("{:.2} to {}", 1e3 * least, in_nm(most));
    let (rms, max, plants) = (
        range(band.rms_um()),
        range(band.max_um()),
        band.members.len(),
    );
    let mut said = vec![[
        "band".into(),
        format!("true RMS {rms}, max {max}, over {plants} plants"),
    ]];
    if let Some(worst) = band.worst() {
        said.push([
            "worst".into(),
            format!(
                "{}: RMS {}, max {}",
                worst.plant,
                in_nm(worst.truth.rms_um),
                in_nm(worst.truth.max_um)
            ),
        ]);
    }
    let settling: Vec<f64> = band.members.iter().filter_map(|m| m.settling_s).collect();
    let (low, high) = extremes(&settling);
    if low < high {
        let unsettled = band.members.len() - settling.len();
        let rest = if unsettled > 0 {
            format!("; {unsettled} plants do not settle")
        } else {
            String::new()
        };
        said.push([
            "settling".into(),
            format!(
                "time over them {:.2} to {:.2} ms{rest}",
                1e3 * low,
                1e3 * high
            ),
        ]);
    }
    if !band.with_covariance {
        said.push(["note".into(), "the model file has no covariance of its values: gain, modes and loops are varied alone".into()]);
    }
    said.extend(troubles(&band.members));
    said
}

/// The troubles of all plants but the model itself: each sentence once, behind the plants that it is of.
fn troubles(members: &[OnMember]) -> Vec<[String; 2]> {
    let mut said: Vec<(String, Vec<&str>)> = Vec::new();
    for member in members.iter().skip(1) {
        let Some(trouble) = &member.trouble else {
            continue;
        };
        match said.iter_mut().find(|(known, _)| known == trouble) {
            Some((_, plants)) => plants.push(&member.plant),
            None => said.push((trouble.clone(), vec![&member.plant])),
        }
    }
    let line = |(trouble, plants): (String, Vec<&str>)| match plants.as_slice() {
        [plant] => [(*plant).to_owned(), trouble],
        [first, rest @ ..] => [format!("{first} and {} more plants", rest.len()), trouble],
        [] => [String::new(), trouble],
    };
    said.into_iter().map(line).collect()
}

/// What a lag of the sensor does to the reported errors: the lag that the servo undoes and the one that the
/// actuator's sensor has, s.
#[must_use]
pub fn sensor_lag(undone_s: Option<f64>, of_sensor_s: Option<f64>) -> Option<String> {
    let us = |lag_s: f64| format!("{:.1} us", 1e6 * lag_s);
    Some(match (undone_s, of_sensor_s) {
        (None, None) => return None,
        (Some(undone_s), Some(lag_s)) => format!(
            "the model's sensor reads {} late and the servo undoes {}: the true error counts, the sensor's holds that lag",
            us(lag_s),
            us(undone_s)
        ),
        (Some(undone_s), None) => format!(
            "the servo undoes {} of a sensor's lag, and the model's sensor has none: the true position follows so much late",
            us(undone_s)
        ),
        (None, Some(lag_s)) => format!(
            "the model's sensor reads {} late, and the servo does not undo it: the true position is so much early, which no reading shows",
            us(lag_s)
        ),
    })
}

/// A first unstable factor of the gain, rounded away from what is stable, and in decibels.
fn gain_factor(value: f64, upwards: bool) -> String {
    format!(
        "x {} ({:.1} dB)",
        unstable_from(value, 2, upwards),
        decibels(value)
    )
}

/// First unstable values as factors and amounts: `gain x 1.83 (5.2 dB), mass x 0.38 or x 2.05`.
fn first_values(
    gain: [Option<f64>; 2],
    mass: [Option<f64>; 2],
    delay_s: Option<f64>,
) -> Vec<String> {
    let factors = |name: &str, values: [Option<f64>; 2], shown: &dyn Fn(f64, bool) -> String| {
        let shown: Vec<String> = values
            .iter()
            .zip([false, true])
            .filter_map(|(v, upwards)| v.map(|v| shown(v, upwards)))
            .collect();
        (!shown.is_empty()).then(|| format!("{name} {}", shown.join(" or ")))
    };
    let mass_factor = |value: f64, upwards: bool| format!("x {}", unstable_from(value, 2, upwards));
    let delay = delay_s.map(|s| format!("{} us more of delay", unstable_from(1e6 * s, 1, true)));
    [
        factors("gain", gain, &gain_factor),
        factors("mass", mass, &mass_factor),
        delay,
    ]
    .into_iter()
    .flatten()
    .collect()
}

/// Margins, one sentence a line.
#[must_use]
pub fn margins(m: &LoopMargins) -> Vec<String> {
    let value = |value: Option<f64>, scale: f64, digits: usize, unit: &str| {
        value.map_or_else(
            || "none found".to_owned(),
            |v| format!("{:.digits$}{unit}", scale * v),
        )
    };
    // A slow loop has a bandwidth of less than one.
    let hertz = |hz: Option<f64>| match hz {
        Some(slow) if slow < 9.5 => value(hz, 1.0, if slow < 0.1 { 4 } else { 2 }, " Hz"),
        _ => value(hz, 1.0, 0, " Hz"),
    };
    let first = &m.first_unstable;
    let [least, mean, most] = m.gain_ratio;
    let mut lines = vec![
        format!("worst case: {}", m.worst_case),
        format!(
            "the actuator's gain over the one that the law inverts: {least:.2} to {most:.2}, {mean:.2} over the range; largest eigenvalue there {}, {}, {}",
            below_one(m.spectral_radius[0]),
            below_one(m.spectral_radius[2]),
            below_one(m.spectral_radius[1])
        ),
    ];
    if m.spectral_radius[1] < 1.0 {
        lines.push(format!(
            "gain margin {}, phase margin {}, bandwidth {}, references to {}, peak sensitivity {:.2} at {:.0} Hz, {:.2} of the sensor's noise becomes motion",
            m.gain_margin.map_or_else(|| "none found".to_owned(), |g| format!("{:.1} dB (x {g:.2})", decibels(g))),
            value(m.phase_margin_deg, 1.0, 0, " degrees"),
            hertz(m.bandwidth_hz),
            hertz(m.reference_bandwidth_hz),
            m.sensitivity_peak,
            m.sensitivity_peak_hz,
            m.noise_transmission
        ));
        let mut beyond = first_values(
            [first.gain_down, first.gain_up],
            [first.mass_down, first.mass_up],
            first.delay_s,
        );
        beyond.extend(first.mode.map(|u| {
            format!(
                "an unknown mode with {} % of the motion at {:.0} Hz (damping {})",
                unstable_from(100.0 * u.share, 2, true),
                u.frequency_hz,
                u.damping_ratio
            )
        }));
        if !beyond.is_empty() {
            lines.push(format!("unstable beyond {}", beyond.join(", ")));
        }
        if first.mode.is_none() {
            let whichever = if m.with_recording {
                "that the recording leaves possible"
            } else {
                "that was tried"
            };
            lines.push(format!("no unknown mode {whichever} makes it unstable"));
        }
        let sooner = |limited: Option<f64>, free: Option<f64>| match (limited, free) {
            (Some(limited), Some(free)) => differ(limited, free),
            // A free drive is tried with longer delays.
            (limited, free) => limited.is_some() && free.is_none(),
        };
        // Of first values those that come before the ones of a free drive.
        let before = |these: &FirstUnstable| -> Option<String> {
            let kept =
                |these: Option<f64>, free: Option<f64>| these.filter(|_| sooner(these, free));
            let differing = first_values(
                [
                    kept(these.gain_down, first.gain_down),
                    kept(these.gain_up, first.gain_up),
                ],
                [
                    kept(these.mass_down, first.mass_down),
                    kept(these.mass_up, first.mass_up),
                ],
                kept(these.delay_s, first.delay_s),
            );
            (!differing.is_empty()).then(|| differing.join(", "))
        };
        if let Some(values) = m.first_from_rest.as_ref().and_then(before) {
            lines.push(format!(
                "beginning at the lower limit of its drive it swings, as run on this model with the sensor's noise, from {values}"
            ));
        }
        if let Some(values) = before(&m.first_swinging) {
            lines.push(format!("once the drive was at a limit, by whatever, it may go on swinging between its limits from {values}"));
        }
    }
    lines
}

/// Whether a servo holds for the plants that a design for this actuator has to hold for.
#[must_use]
pub fn on_plants(found: &OnPlants) -> String {
    let of = format!(
        "the {} plants of a design (up to {} times the mass) and every missing response that is left possible",
        found.plants,
        mass_in_words(found.mass_to)
    );
    match &found.broken {
        Some(broken) => format!("does not hold for {of}: {broken}"),
        None => {
            let (share, hz) = found.missing_response;
            format!(
                "holds for {of}; nearest to its limit with one at {hz:.0} Hz ({:.0} % of what it can stand)",
                100.0 * share
            )
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use hysteron::servo::track::TrackingFigures;

    #[test]
    fn a_trouble_of_several_plants_is_one_line() {
        let figures = TrackingFigures {
            rms_um: 0.0,
            max_um: 0.0,
        };
        let member = |plant: &str, trouble: Option<&str>| OnMember {
            plant: plant.into(),
            truth: figures,
            as_read: figures,
            settling_s: None,
            trouble: trouble.map(str::to_owned),
        };
        let members = [
            member("the model", Some("lost")),
            member("a", Some("lost")),
            member("b", None),
            member("c", Some("lost")),
            member("d", Some("slow")),
        ];
        let said: Vec<String> = (troubles(&members).iter())
            .map(|line| line.join(": "))
            .collect();
        assert_eq!(said, ["a and 1 more plants: lost", "d: slow"]);
    }

    #[test]
    fn first_unstable_values_are_factors_and_decibels() {
        let said = first_values(
            [None, Some(1.8291)],
            [Some(0.3889), Some(2.045)],
            Some(70.73e-6),
        )
        .join(", ");
        assert_eq!(
            said,
            "gain x 1.83 (5.2 dB), mass x 0.38 or x 2.05, 70.8 us more of delay"
        );
        assert_eq!(
            first_values([Some(0.25), Some(4.0)], [None, None], None),
            ["gain x 0.25 (-12.0 dB) or x 4.00 (12.0 dB)"]
        );
    }
}
