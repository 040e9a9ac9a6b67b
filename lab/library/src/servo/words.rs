//! Findings of a servo in sentences, the same on screens, in pages and in the lab.

use super::loop_margins::LoopMargins;

/// Margins, one sentence a line.
#[must_use]
pub fn margins(m: &LoopMargins) -> Vec<String> {
    let value = |value: Option<f64>, scale: f64, digits: usize, unit: &str| {
        value.map_or_else(|| "none found".to_owned(), |v| format!("{:.digits$}{unit}", scale * v))
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
            "gain margin {}, phase margin {}, bandwidth {}, peak sensitivity {:.2} at {:.0} Hz, {:.2} of the sensor's noise becomes motion",
            value(m.gain_margin, 1.0, 2, ""),
            value(m.phase_margin_deg, 1.0, 0, " degrees"),
            value(m.bandwidth_hz, 1.0, 0, " Hz"),
            m.sensitivity_peak,
            m.sensitivity_peak_hz,
            m.noise_transmission
        ));
        let mode = first.mode.map_or_else(
            || "none found".to_owned(),
            |u| format!("{:.2} % at {:.0} Hz (damping {})", 100.0 * u.share, u.frequency_hz, u.damping_ratio),
        );
        lines.push(format!(
            "first unstable: gain {} and {}; mass {} and {}; delay {}; unknown mode {mode}",
            value(first.gain_down, 1.0, 3, ""),
            value(first.gain_up, 1.0, 3, ""),
            value(first.mass_down, 1.0, 3, ""),
            value(first.mass_up, 1.0, 3, ""),
            value(first.delay_s, 1e6, 1, " us")
        ));
    }
    lines
}
