//! Frequency response, measured and modelled, and the correlations of the residual: what a control engineer
//! looks at first.

use crate::explain_report::{ExplainReport, RecordReport};
use crate::page::{CurveRole, PageBlock, Plot, Section, Series, Width};
use hysteron::response::{Correlations, Response, correlations, frequency_response};

/// The section of the record that shows most of the dynamics; none without a driven record of some hundred
/// samples.
pub(crate) fn dynamics(report: &ExplainReport) -> Option<Section> {
    let record = report
        .records
        .iter()
        .filter(|r| r.role != "noise")
        .max_by(|a, b| shows(a).total_cmp(&shows(b)))?;
    let part = longest_part(record)?;
    let (u, y) = (&record.u_v[part.clone()], &record.y_um[part.clone()]);
    let left = &record.residual_um.last()?[part];
    let modelled: Vec<f64> = y.iter().zip(left).map(|(y, left)| y - left).collect();
    let (measured, model) = (
        frequency_response(u, y, record.sample_rate_hz),
        frequency_response(u, &modelled, record.sample_rate_hz),
    );
    let lags = correlations(left, u, record.sample_rate_hz);
    if measured.frequency_hz.is_empty() || lags.lag_s.is_empty() {
        return None;
    }
    Some(Section {
        heading: "Frequency response and correlation of the residual".to_owned(),
        text: format!(
            "Record {}. The response is the best linear approximation for this drive; loops and noise lower its coherence. The residual of a complete model is white and has nothing of the drive: both \
             correlations stay within the lines that 99 % of such residuals do not cross.",
            record.name
        ),
        blocks: [
            bode(&measured, &model).to_vec(),
            correlation_plots(&lags).to_vec(),
        ]
        .concat()
        .into_iter()
        .map(PageBlock::Plot)
        .collect(),
    })
}

/// How much of the dynamics a record shows: its samples by its rate.
fn shows(record: &RecordReport) -> f64 {
    record.sample_rate_hz * (record.y_um.len() as f64).sqrt()
}

/// The longest part without a gap in its residual.
fn longest_part(record: &RecordReport) -> Option<std::ops::Range<usize>> {
    let left = record.residual_um.last()?;
    let mut parts = Vec::new();
    let mut from = 0;
    for k in 0..=left.len() {
        if k == left.len() || !left[k].is_finite() {
            parts.push(from..k);
            from = k + 1;
        }
    }
    parts
        .into_iter()
        .max_by_key(std::ops::Range::len)
        .filter(|part| !part.is_empty())
}

fn bode(measured: &Response, model: &Response) -> [Plot; 3] {
    let plot = |title: &str,
                axis: &str,
                unit: &str,
                log: bool,
                of: fn(&Response) -> &Vec<f64>,
                both: bool| {
        let line = |label: &str, role: CurveRole, response: &Response| {
            Series::line(
                label,
                role,
                response.frequency_hz.clone(),
                of(response).clone(),
            )
        };
        let plot = Plot::new(title)
            .x_axis("frequency", "Hz")
            .y_axis(axis, unit)
            .log(true, log)
            .width(Width::Third)
            .link("frequency")
            .with(line("measured", CurveRole::Measured, measured));
        if both {
            plot.with(line("modelled", CurveRole::Model, model))
        } else {
            plot
        }
    };
    [
        plot(
            "Gain from drive to reading",
            "gain",
            "um/V",
            true,
            |r| &r.gain,
            true,
        ),
        plot("Phase", "phase", "deg", false, |r| &r.phase_deg, true),
        plot(
            "Coherence of the measured response",
            "coherence",
            "",
            false,
            |r| &r.coherence,
            false,
        ),
    ]
}

fn correlation_plots(lags: &Correlations) -> [Plot; 2] {
    let milliseconds: Vec<f64> = lags.lag_s.iter().map(|s| 1e3 * s).collect();
    let plot = |title: &str, values: &[f64], from: usize, bound: f64| {
        Plot::new(title)
            .x_axis("lag", "ms")
            .y_axis("correlation", "")
            .with(Series::line(
                "residual",
                CurveRole::Residual,
                milliseconds[from..].to_vec(),
                values[from..].to_vec(),
            ))
            .level("99 %", bound)
            .level("99 %", -bound)
    };
    [
        plot("Residual with itself", &lags.auto, 1, lags.auto_bound),
        plot(
            "Residual with the drive that came before",
            &lags.cross,
            0,
            lags.cross_bound,
        ),
    ]
}
