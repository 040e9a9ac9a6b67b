//! The error falling, as a picture that moves: the residual of one record and the error of every step of a
//! model's growth, in one SVG that needs no script and plays wherever pictures do.

use crate::explain_report::{ExplainReport, RecordReport, StepReport};
use crate::html::escape;
use crate::text::{effect_words, figure};
use hysteron::identification::fit::rms;
use std::fmt::Write;

const WIDTH: f64 = 880.0;
const HEIGHT: f64 = 330.0;
/// The plot of the residual: left, top, width, height.
const PLOT: [f64; 4] = [64.0, 64.0, 796.0, 170.0];
/// The bar below it: top and height.
const BAR: [f64; 2] = [262.0, 16.0];
/// Columns of pixels in which the least and greatest residual are drawn.
const COLUMNS: usize = 260;
/// How long a step is shown, s, and the share of it that goes over to the next.
const STEP_S: f64 = 2.4;
const MOVING: f64 = 0.35;

/// The picture; `None` without a record that was judged or without steps.
#[must_use]
pub fn falling_error_svg(report: &ExplainReport) -> Option<String> {
    let finite = |residual: &Vec<f64>| {
        residual
            .iter()
            .copied()
            .filter(|e| e.is_finite())
            .collect::<Vec<f64>>()
    };
    let largest =
        |record: &&RecordReport| record.residual_um.first().map_or(0.0, |r| rms(&finite(r)));
    let of_role = |role: &'static str| report.records.iter().filter(move |r| r.role == role);
    let judged = of_role("validate").max_by(|a, b| largest(a).total_cmp(&largest(b)));
    let record =
        judged.or_else(|| of_role("identify").max_by(|a, b| largest(a).total_cmp(&largest(b))))?;
    let steps = &report.steps;
    if steps.is_empty() || record.residual_um.len() < steps.len() {
        return None;
    }
    let peak_nm = record.residual_um[0]
        .iter()
        .fold(0.0_f64, |m, e| m.max(1e3 * e.abs()))
        .max(1e-6);
    let traces: Vec<String> = record.residual_um[..steps.len()]
        .iter()
        .map(|residual| envelope(residual, peak_nm))
        .collect();
    let error_nm = |step: &StepReport| 1e3 * step.validate_rms_um.unwrap_or(step.identify_rms_um);
    let most_nm = steps.iter().map(error_nm).fold(1e-9, f64::max);
    let full = PLOT[2] - 150.0;
    let widths: Vec<String> = steps
        .iter()
        .map(|step| format!("{:.1}", full * error_nm(step) / most_nm))
        .collect();
    let times = Times::of(steps.len());
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {WIDTH} {HEIGHT}\" font-family=\"system-ui, sans-serif\" font-size=\"14\">\
         <title>{}</title><style>text{{fill:#1c1f24}}.q{{fill:#5f6670;font-size:12px}}</style>\
         <rect width=\"{WIDTH}\" height=\"{HEIGHT}\" rx=\"8\" fill=\"#fff\" stroke=\"#d9dce1\"/>\
         <text x=\"20\" y=\"52\" class=\"q\">Residual of {}, nm</text>",
        escape(&report.sentence),
        escape(&record.name)
    );
    let middle = PLOT[1] + PLOT[3] / 2.0;
    for (share, y) in [(1.0, PLOT[1]), (0.0, middle), (-1.0, PLOT[1] + PLOT[3])] {
        let _ = write!(
            svg,
            "<line x1=\"{}\" x2=\"{}\" y1=\"{y}\" y2=\"{y}\" stroke=\"#d9dce1\"/><text x=\"{}\" y=\"{}\" class=\"q\" text-anchor=\"end\">{:.0}</text>",
            PLOT[0],
            PLOT[0] + PLOT[2],
            PLOT[0] - 6.0,
            y + 4.0,
            share * peak_nm
        );
    }
    let _ = write!(
        svg,
        "<polygon points=\"{}\" fill=\"#0072b2\" stroke=\"#0072b2\" stroke-width=\"0.8\">{}</polygon>\
         <rect x=\"{}\" y=\"{}\" width=\"{}\" height=\"{}\" rx=\"4\" fill=\"#d55e00\">{}</rect>",
        traces[traces.len() - 1],
        times.moving("points", &traces),
        PLOT[0],
        BAR[0],
        widths[widths.len() - 1],
        BAR[1],
        times.moving("width", &widths)
    );
    if let Some(floor) = &report.noise_floor {
        let x = PLOT[0] + full * (1e3 * floor.rms_um / most_nm).min(1.0);
        let (top, bottom) = (BAR[0] - 5.0, BAR[0] + BAR[1] + 5.0);
        let _ = write!(
            svg,
            "<line x1=\"{x:.1}\" x2=\"{x:.1}\" y1=\"{top}\" y2=\"{bottom}\" stroke=\"#008060\" stroke-width=\"3\"/>\
             <text x=\"{x:.1}\" y=\"{}\" class=\"q\">noise {:.2} nm</text>",
            bottom + 14.0,
            1e3 * floor.rms_um
        );
    }
    let mut title = String::from("start");
    for (i, step) in steps.iter().enumerate() {
        if i > 0 {
            title = step.added.as_ref().map_or_else(
                || "fitted again".into(),
                |added| format!("+ {}", effect_words(added)),
            );
        }
        let said = format!("{title}: {} nm", figure(error_nm(step)));
        // Where nothing moves, the last one is seen.
        let seen = if i + 1 == steps.len() { 1 } else { 0 };
        let _ = write!(
            svg,
            "<text x=\"20\" y=\"30\" font-size=\"18\" font-weight=\"600\" opacity=\"{seen}\">{}{}</text>",
            escape(&said),
            times.shown(i)
        );
    }
    svg.push_str("</svg>\n");
    Some(svg)
}

/// Points of the polygon between the least and greatest residual of every column.
fn envelope(residual_um: &[f64], peak_nm: f64) -> String {
    let columns = COLUMNS.min(residual_um.len()).max(1);
    let middle = PLOT[1] + PLOT[3] / 2.0;
    let y = |um: f64| middle - PLOT[3] / 2.0 * (1e3 * um / peak_nm).clamp(-1.0, 1.0);
    let column = |i: usize| {
        &residual_um[i * residual_um.len() / columns
            ..((i + 1) * residual_um.len() / columns).max(i * residual_um.len() / columns + 1)]
    };
    let x = |i: usize| PLOT[0] + PLOT[2] * i as f64 / (columns - 1).max(1) as f64;
    // Where a column has nothing but gaps, it is drawn as nothing left.
    let or_nothing = |um: f64| if um.is_finite() { um } else { 0.0 };
    let least = |i: usize| or_nothing(column(i).iter().copied().fold(f64::INFINITY, f64::min));
    let most = |i: usize| or_nothing(column(i).iter().copied().fold(f64::NEG_INFINITY, f64::max));
    let upper = (0..columns).map(|i| format!("{:.1},{:.1}", x(i), y(most(i))));
    let lower = (0..columns)
        .rev()
        .map(|i| format!("{:.1},{:.1}", x(i), y(least(i))));
    upper.chain(lower).collect::<Vec<_>>().join(" ")
}

/// When each step is reached and left, as shares of the whole.
struct Times {
    steps: usize,
}

impl Times {
    fn of(steps: usize) -> Self {
        Self { steps }
    }

    /// The last step is shown twice as long.
    fn duration_s(&self) -> f64 {
        STEP_S * (self.steps + 1) as f64
    }

    fn share(&self, seconds: f64) -> f64 {
        seconds / self.duration_s()
    }

    /// An attribute that goes from value to value.
    fn moving(&self, attribute: &str, values: &[String]) -> String {
        if values.len() < 2 {
            return String::new();
        }
        let (mut all, mut times) = (vec![values[0].as_str()], vec![0.0]);
        for (i, value) in values.iter().enumerate().skip(1) {
            all.extend([values[i - 1].as_str(), value]);
            times.extend([
                self.share(STEP_S * i as f64),
                self.share(STEP_S * (i as f64 + MOVING)),
            ]);
        }
        all.push(&values[values.len() - 1]);
        times.push(1.0);
        let times: Vec<String> = times.iter().map(|t| format!("{t:.4}")).collect();
        format!(
            "<animate attributeName=\"{attribute}\" dur=\"{:.1}s\" repeatCount=\"indefinite\" keyTimes=\"{}\" values=\"{}\"/>",
            self.duration_s(),
            times.join(";"),
            all.join(";")
        )
    }

    /// Visible while a step is shown.
    fn shown(&self, step: usize) -> String {
        if self.steps < 2 {
            return String::new();
        }
        let (from, to) = (
            self.share(STEP_S * step as f64),
            self.share(STEP_S * (step + 1) as f64),
        );
        let (times, values) = match step {
            0 => (format!("0;{to:.4}"), "1;0"),
            _ if step + 1 == self.steps => (format!("0;{from:.4}"), "0;1"),
            _ => (format!("0;{from:.4};{to:.4}"), "0;1;0"),
        };
        format!(
            "<animate attributeName=\"opacity\" calcMode=\"discrete\" dur=\"{:.1}s\" repeatCount=\"indefinite\" keyTimes=\"{times}\" values=\"{values}\"/>",
            self.duration_s()
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::explain_report::NoiseFloorReport;

    #[test]
    fn every_step_has_its_frame_and_the_bar_falls() {
        let step = |added: Option<&str>, um: f64| StepReport {
            added: added.map(Into::into),
            identify_rms_um: um,
            validate_rms_um: Some(um),
            ..StepReport::default()
        };
        let record = RecordReport {
            name: "a<b".into(),
            role: "validate".into(),
            residual_um: vec![vec![0.05, -0.1, 0.08], vec![0.001, -0.002, 0.001]],
            ..RecordReport::default()
        };
        let report = ExplainReport {
            records: vec![record],
            steps: vec![step(None, 0.08), step(Some("creep"), 0.0015)],
            noise_floor: Some(NoiseFloorReport {
                rms_um: 0.0014,
                ..NoiseFloorReport::default()
            }),
            ..ExplainReport::default()
        };
        let svg = falling_error_svg(&report).unwrap();
        assert!(
            svg.contains("start: 80.0 nm")
                && svg.contains("+ creep: 1.50 nm")
                && svg.contains("a&lt;b")
                && svg.contains("noise 1.40 nm")
        );
        let widths: Vec<f64> = svg
            .split("attributeName=\"width\"")
            .nth(1)
            .unwrap()
            .split("values=\"")
            .nth(1)
            .unwrap()
            .split('"')
            .next()
            .unwrap()
            .split(';')
            .map(|v| v.parse().unwrap())
            .collect();
        assert_eq!(widths.len(), 4);
        assert!(widths[0] > 600.0 && (widths[3] - widths[0] * 1.5 / 80.0).abs() < 0.1);
        assert!(falling_error_svg(&ExplainReport::default()).is_none());
    }
}
