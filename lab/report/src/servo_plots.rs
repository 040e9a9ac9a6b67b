//! Pictures of a servo design.

use crate::page::{CurveRole, Plot, Series};
use hysteron::servo::learned_feedforward::{ConvergencePoint, LearningDesign};
use hysteron::servo::loop_margins::LoopMargins;
use hysteron::servo::predictor::{Assessment, least_expected};

/// Noise passed on against disturbance let through: the tunings that keep every margin and that no other one
/// beats in both.
#[must_use]
pub fn trade_off(assessments: &[Assessment]) -> Plot {
    let point = |a: &Assessment| (1e3 * a.noise_um, 1e3 * a.disturbance_um);
    let (x, y) = assessments.iter().map(point).unzip();
    let mut plot = Plot::new("Trade-off of the design")
        .x_axis("sensor noise passed on", "nm")
        .y_axis("hysteresis model error let through", "nm")
        .caption("Every point keeps all margins, and no other tuning beats it in both; the chosen one is nearest to the origin.")
        .with(Series::line("tunings", CurveRole::Model, x, y));
    if let Some(chosen) = least_expected(assessments) {
        let (x, y) = point(chosen);
        plot = plot.with(Series::points("chosen", CurveRole::Measured, vec![x], vec![y]));
    }
    plot
}

/// What is left of a disturbance, and what noise makes of the motion, over frequency.
#[must_use]
pub fn sensitivity(margins: &LoopMargins) -> Plot {
    let hz: Vec<f64> = margins.response.iter().map(|p| p.hz).collect();
    let decibel = |v: f64| 20.0 * v.max(1e-12).log10();
    let of = |value: &dyn Fn(&hysteron::servo::loop_margins::LoopPoint) -> f64| {
        margins.response.iter().map(|p| decibel(value(p))).collect::<Vec<f64>>()
    };
    Plot::new("Sensitivity")
        .x_axis("frequency", "Hz")
        .y_axis("magnitude", "dB")
        .log(true, false)
        .caption("On the actuator that was checked, at its mean gain. Above 0 dB the loop makes a disturbance larger.")
        .with(Series::line("sensitivity", CurveRole::Residual, hz.clone(), of(&|p| p.sensitivity)))
        .with(Series::line("complementary sensitivity", CurveRole::Model, hz, of(&|p| p.complementary)))
}

/// What an error of a periodic reference becomes from period to period, over frequency: below one the
/// correction converges.
#[must_use]
pub fn learning(design: &LearningDesign) -> Plot {
    let hz: Vec<f64> = design.convergence.iter().map(|p| p.hz).collect();
    let of = |value: fn(&ConvergencePoint) -> f64| design.convergence.iter().map(|p| value(p).min(2.0)).collect::<Vec<f64>>();
    Plot::new("Convergence of learning")
        .x_axis("frequency", "Hz")
        .y_axis("error over that of the period before", "1")
        .caption("At worst: over the set of plants, with any missing response that the recording does not exclude. Q closes where 1 - L T is not below one.")
        .with(Series::line("|Q (1 - L T)| at worst", CurveRole::Residual, hz.clone(), of(ConvergencePoint::contraction)))
        .with(Series::line("|1 - L T| at worst (cut off at 2)", CurveRole::Measured, hz.clone(), of(|p| p.worst)))
        .with(Series::line("Q", CurveRole::Model, hz, of(|p| p.robustness)))
}

/// The open loop in the complex plane, near the point -1.
#[must_use]
pub fn nyquist(margins: &LoopMargins) -> Plot {
    // Far from the critical point nothing is decided.
    let near = margins.response.iter().filter(|p| p.open[0].hypot(p.open[1]) < 4.0);
    let (x, y) = near.map(|p| (p.open[0], p.open[1])).unzip();
    Plot::new("Nyquist")
        .x_axis("real part of the open loop", "1")
        .y_axis("imaginary part", "1")
        .caption("From 0 Hz to half the sampling rate. The distance from the point -1 is one over the sensitivity.")
        .with(Series::line("open loop", CurveRole::Model, x, y))
        .with(Series::points("-1", CurveRole::Measured, vec![-1.0], vec![0.0]))
}
