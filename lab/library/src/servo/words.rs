//! Findings of a servo in sentences, the same on screens, in pages and in the lab.

use super::loop_margins::{LoopMargins, NO_DIFFERENCE, unstable_from};

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
        let swinging = &m.first_swinging;
        let sooner = |limited: Option<f64>, free: Option<f64>| match (limited, free) {
            (Some(limited), Some(free)) => (limited / free).ln().abs() > NO_DIFFERENCE,
            // A free drive is tried with longer delays.
            (limited, free) => limited.is_some() && free.is_none(),
        };
        let pairs = [
            (swinging.gain_down, first.gain_down, "gain", 3, 1.0, ""),
            (swinging.gain_up, first.gain_up, "gain", 3, 1.0, ""),
            (swinging.mass_down, first.mass_down, "mass", 3, 1.0, ""),
            (swinging.mass_up, first.mass_up, "mass", 3, 1.0, ""),
            (swinging.delay_s, first.delay_s, "delay", 1, 1e6, " us"),
        ];
        let differing: Vec<String> = pairs
            .into_iter()
            .filter(|(limited, free, ..)| sooner(*limited, *free))
            .map(|(limited, _, name, digits, scale, unit)| format!("{name} {}", value(limited, scale, digits, unit)))
            .collect();
        if !differing.is_empty() {
            lines.push(format!("once the drive was at a limit it may go on swinging between its limits from: {}", differing.join(", ")));
        }
    }
    lines
}
