//! Pictures of a servo design.

use crate::page::{CurveRole, Plot, Series, Style};
use hysteron::servo::assessment::Assessment;
use hysteron::servo::candidate::{USUAL_GAIN_MARGIN_DB, USUAL_PEAK, USUAL_PHASE_MARGIN_DEG};
use hysteron::servo::design::ServoDesign;
use hysteron::servo::learned_feedforward::{ConvergencePoint, LearningDesign};
use hysteron::servo::loop_margins::LoopMargins;
use hysteron::servo::sampled_loop::decibels;
use std::f64::consts::TAU;

/// Noise passed on against error let through: the tunings that no other one beats in both, of those that hold
/// and of those among them with the usual margins; and the one that was taken.
#[must_use]
pub fn trade_off(design: &ServoDesign) -> Plot {
    let point = |a: &Assessment| (1e3 * a.noise_um, 1e3 * a.disturbance_um);
    let line = |label: String, role: CurveRole, of: &[Assessment]| {
        let (x, y) = of.iter().map(point).unzip();
        Series::line(label, role, x, y)
    };
    let mut plot = Plot::new("Trade-off of the design")
        .x_axis("sensor noise passed on", "nm")
        .y_axis("hysteresis model error let through", "nm")
        .height_px(400)
        .caption("Every tuning holds for all plants, and no other one of its line beats it in both. The one that was taken has the least error expected of both together and at a tenth of the highest frequency.")
        .with(line("all that hold".into(), CurveRole::Other1, &design.trade_off));
    if !design.trade_off_usual.is_empty() {
        let label = format!(
            "sensitivity {USUAL_PEAK}, {USUAL_GAIN_MARGIN_DB:.0} dB, {USUAL_PHASE_MARGIN_DEG:.0} degrees"
        );
        plot = plot.with(line(label, CurveRole::Other2, &design.trade_off_usual));
    }
    if let Some(chosen) = &design.chosen {
        let (x, y) = point(chosen);
        plot = plot.with(Series::points("taken", CurveRole::Model, vec![x], vec![y]));
    }
    plot
}

/// What is left of a disturbance, and what noise makes of the motion, over frequency.
#[must_use]
pub fn sensitivity(margins: &LoopMargins) -> Plot {
    let hz: Vec<f64> = margins.response.iter().map(|p| p.hz).collect();
    let of = |value: &dyn Fn(&hysteron::servo::loop_margins::LoopPoint) -> f64| {
        margins
            .response
            .iter()
            .map(|p| decibels(value(p).max(1e-12)))
            .collect::<Vec<f64>>()
    };
    Plot::new("Sensitivity")
        .x_axis("frequency", "Hz")
        .y_axis("magnitude", "dB")
        .log(true, false)
        .height_px(400)
        .caption("On the actuator that was checked, at its mean gain. Above 0 dB the loop makes a disturbance larger.")
        .with(Series::line("sensitivity", CurveRole::Other1, hz.clone(), of(&|p| p.sensitivity)))
        .with(Series::line("complementary sensitivity", CurveRole::Other2, hz, of(&|p| p.complementary)))
        .level(&format!("{USUAL_PEAK}, {:.1} dB", decibels(USUAL_PEAK)), decibels(USUAL_PEAK))
}

/// What an error of a periodic reference becomes from period to period, over frequency: below one the
/// correction converges.
#[must_use]
pub fn learning(design: &LearningDesign) -> Plot {
    let hz: Vec<f64> = design.convergence.iter().map(|p| p.hz).collect();
    let of = |value: fn(&ConvergencePoint) -> f64| {
        design
            .convergence
            .iter()
            .map(|p| value(p).min(2.0))
            .collect::<Vec<f64>>()
    };
    Plot::new("Convergence of learning")
        .x_axis("frequency", "Hz")
        .y_axis("error over that of the period before", "1")
        .height_px(400)
        .caption("At worst: over the set of plants, with any missing response that the recording does not exclude. Q closes where 1 - L T is not below one.")
        .with(Series::line("|Q (1 - L T)| at worst", CurveRole::Other1, hz.clone(), of(ConvergencePoint::contraction)))
        .with(Series::line("|1 - L T| at worst (cut off at 2)", CurveRole::Other4, hz.clone(), of(|p| p.worst)))
        .with(Series::line("Q", CurveRole::Other2, hz, of(|p| p.robustness)))
}

/// Distance from the origin up to which the open loop is drawn: beyond it nothing is decided.
const NEAR: f64 = 2.5;

fn circle(label: impl Into<String>, role: CurveRole, centre: f64, radius: f64) -> Series {
    let angles = || (0..=180).map(|i| TAU * f64::from(i) / 180.0);
    let (x, y) = angles()
        .map(|a| (centre + radius * a.cos(), radius * a.sin()))
        .unzip();
    Series::line(label, role, x, y).style(Style::Dashed)
}

/// The open loop in the complex plane near the point -1, with the unit circle, the margins, and the circle
/// that a loop of the usual sensitivity does not enter.
#[must_use]
pub fn nyquist(margins: &LoopMargins) -> Plot {
    let near = |p: [f64; 2]| {
        if p[0].hypot(p[1]) < NEAR {
            (p[0], p[1])
        } else {
            (f64::NAN, f64::NAN)
        }
    };
    let (x, y) = margins.response.iter().map(|p| near(p.open)).unzip();
    let mut plot = Plot::new("Nyquist")
        .x_axis("real part of the open loop", "")
        .y_axis("imaginary part", "")
        .equal()
        .height_px(400)
        .caption("From 0 Hz to half the sampling rate. The distance from the point -1 is one over the sensitivity; inside the circle about it the sensitivity is above 1.8.")
        .with(circle("unit circle", CurveRole::Other3, 0.0, 1.0))
        .with(circle(format!("sensitivity {USUAL_PEAK}"), CurveRole::Other1, -1.0, 1.0 / USUAL_PEAK))
        .with(Series::line("open loop", CurveRole::Model, x, y))
        .with(Series::points("-1", CurveRole::Residual, vec![-1.0], vec![0.0]));
    let pairs = || margins.response.windows(2).map(|w| (w[0].open, w[1].open));
    // Between two points of the response, where a value goes through zero.
    let at = |(a, b): ([f64; 2], [f64; 2]), share: f64| {
        [a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1])]
    };
    let real = pairs()
        .filter(|(a, b)| (a[1] < 0.0) != (b[1] < 0.0))
        .map(|pair| at(pair, pair.0[1] / (pair.0[1] - pair.1[1])));
    if let Some(crossing) = real
        .filter(|p| p[0] < 0.0 && p[0] > -1.0)
        .min_by(|a, b| a[0].total_cmp(&b[0]))
    {
        let label = format!("gain margin {:.1} dB", -decibels(-crossing[0]));
        plot = plot.with(Series::points(
            label,
            CurveRole::Other2,
            vec![crossing[0]],
            vec![0.0],
        ));
    }
    let size = |p: [f64; 2]| p[0].hypot(p[1]);
    let of_one =
        pairs().filter(|(a, b)| (size(*a) - 1.0) * (size(*b) - 1.0) <= 0.0 && size(*a) != size(*b));
    let of_one = of_one.map(|pair| at(pair, (1.0 - size(pair.0)) / (size(pair.1) - size(pair.0))));
    let margin_deg = |p: &[f64; 2]| 180.0 - p[1].atan2(p[0]).abs().to_degrees();
    if let Some(crossing) = of_one.min_by(|a, b| margin_deg(a).total_cmp(&margin_deg(b))) {
        let label = format!("phase margin {:.0} degrees", margin_deg(&crossing));
        plot = plot.with(Series::points(
            label,
            CurveRole::Other4,
            vec![crossing[0]],
            vec![crossing[1]],
        ));
    }
    plot
}
