//! Findings of a servo in sentences, the same on screens, in pages and in the lab.

use super::loop_margins::{FirstUnstable, LoopMargins, differ, unstable_from};

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

/// Margins, one sentence a line.
#[must_use]
pub fn margins(m: &LoopMargins) -> Vec<String> {
    let value = |value: Option<f64>, scale: f64, digits: usize, unit: &str| {
        value.map_or_else(|| "none found".to_owned(), |v| format!("{:.digits$}{unit}", scale * v))
    };
    // First unstable values, rounded away from what is stable.
    let from = |value: Option<f64>, scale: f64, digits: usize, upwards: bool, unit: &str| {
        value.map_or_else(|| "none found".to_owned(), |v| format!("{}{unit}", unstable_from(scale * v, digits, upwards)))
    };
    let first = &m.first_unstable;
    let [least, mean, most] = m.gain_ratio;
    let mut lines = vec![
        format!("worst case: {}", m.worst_case),
        format!(
            "the actuator's gain over the one that the law inverts: {least:.2} to {most:.2}, {mean:.2} over the range; largest eigenvalue there {:.4}, {:.4}, {:.4}",
            m.spectral_radius[0], m.spectral_radius[2], m.spectral_radius[1]
        ),
    ];
    if m.spectral_radius[1] < 1.0 {
        lines.push(format!(
            "gain margin {}, phase margin {}, bandwidth {}, references to {}, peak sensitivity {:.2} at {:.0} Hz, {:.2} of the sensor's noise becomes motion",
            value(m.gain_margin, 1.0, 2, ""),
            value(m.phase_margin_deg, 1.0, 0, " degrees"),
            value(m.bandwidth_hz, 1.0, 0, " Hz"),
            value(m.reference_bandwidth_hz, 1.0, 0, " Hz"),
            m.sensitivity_peak,
            m.sensitivity_peak_hz,
            m.noise_transmission
        ));
        let mode = first.mode.map_or_else(
            || "none found".to_owned(),
            |u| format!("{} % at {:.0} Hz (damping {})", unstable_from(100.0 * u.share, 2, true), u.frequency_hz, u.damping_ratio),
        );
        lines.push(format!(
            "first unstable: gain {} and {}; mass {} and {}; delay {}; unknown mode {mode}",
            from(first.gain_down, 1.0, 3, false, ""),
            from(first.gain_up, 1.0, 3, true, ""),
            from(first.mass_down, 1.0, 3, false, ""),
            from(first.mass_up, 1.0, 3, true, ""),
            from(first.delay_s, 1e6, 1, true, " us")
        ));
        let sooner = |limited: Option<f64>, free: Option<f64>| match (limited, free) {
            (Some(limited), Some(free)) => differ(limited, free),
            // A free drive is tried with longer delays.
            (limited, free) => limited.is_some() && free.is_none(),
        };
        // Of first values those that come before the ones of a free drive.
        let before = |these: &FirstUnstable| -> Option<String> {
            let pairs = [
                (these.gain_down, first.gain_down, "gain", 3, 1.0, false, ""),
                (these.gain_up, first.gain_up, "gain", 3, 1.0, true, ""),
                (these.mass_down, first.mass_down, "mass", 3, 1.0, false, ""),
                (these.mass_up, first.mass_up, "mass", 3, 1.0, true, ""),
                (these.delay_s, first.delay_s, "delay", 1, 1e6, true, " us"),
            ];
            let differing = pairs
                .into_iter()
                .filter(|(limited, free, ..)| sooner(*limited, *free))
                .map(|(limited, _, name, digits, scale, upwards, unit)| format!("{name} {}", from(limited, scale, digits, upwards, unit)));
            let differing: Vec<String> = differing.collect();
            (!differing.is_empty()).then(|| differing.join(", "))
        };
        if let Some(values) = m.first_from_rest.as_ref().and_then(before) {
            lines.push(format!(
                "beginning at the lower limit of its drive it swings, as run on this model with the sensor's noise, from: {values}"
            ));
        }
        if let Some(values) = before(&m.first_swinging) {
            lines.push(format!("once the drive was at a limit, by whatever, it may go on swinging between its limits from: {values}"));
        }
    }
    lines
}
