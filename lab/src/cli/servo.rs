//! `design`, `check`, `track`: a servo from an identified model.

use super::Outputs;
use super::output::{check_writable, write_json};
use crate::amplifier_block::{FrontEnd, write_block};
use crate::model_file;
use crate::problem::{Problem, Result, write_whole};
use crate::report::{Block, Page, Plot, Role, Section, Series};
use crate::servo::commands;
use crate::servo::design::{SCHEMA, ServoDesign};
use crate::servo::figures::trade_off;
use crate::servo::predictor::{Assessment, Demands};
use serde::Serialize;
use std::path::Path;

/// What `design --json` carries.
#[derive(Serialize)]
struct DesignFigures<'a> {
    schema: &'static str,
    design: &'a ServoDesign,
}

fn nm(um: f64) -> String {
    format!("{:.2} nm", 1e3 * um)
}

/// Reads a servo file.
fn read_design(path: &Path) -> Result<ServoDesign> {
    let text = std::fs::read_to_string(path)
        .map_err(|e| Problem::file(path, format!("cannot be read: {e}; expected a file written by `hysteron design`")))?;
    let design: ServoDesign = toml::from_str(&text).map_err(|e| {
        let line = e.span().map_or(0, |span| text.get(..span.start).map_or(0, |before| before.lines().count().max(1)));
        Problem::new(format!("{}: line {line}", path.display()), e.message())
    })?;
    if design.schema != SCHEMA {
        return Err(Problem::file(path, format!("schema = \"{}\"; expected \"{SCHEMA}\"", design.schema)));
    }
    Ok(design)
}

fn write_page(path: Option<&Path>, page: &Page) -> Result<()> {
    let Some(path) = path else { return Ok(()) };
    page.write_html(path).map_err(|e| Problem::file(path, format!("cannot be written: {e}")))
}

/// `hysteron design MODEL --out servo.toml [--block servo.block [--front-end front_end.toml]]`.
pub fn design(
    model: &Path,
    out: &Path,
    demands: &Demands,
    block: Option<&Path>,
    front_end: Option<&Path>,
    outputs: &Outputs,
) -> Result<bool> {
    check_writable(Some(out))?;
    check_writable(block)?;
    let front_end = front_end.map_or_else(|| Ok(FrontEnd::default()), FrontEnd::read)?;
    check_writable(outputs.json.as_deref())?;
    check_writable(outputs.report.as_deref())?;
    let chain = model_file::read(model)?;
    let design = commands::design(&chain, demands).map_err(|m| Problem::file(model, m))?;
    let text = toml::to_string_pretty(&design).map_err(|e| Problem::file(out, e))?;
    if let Some(json) = &outputs.json {
        write_json(json, &DesignFigures { schema: "hysteron.design/1", design: &design })?;
    }
    let page = Page {
        title: "Servo design".into(),
        lead_sentence: design.explanation.first().cloned().unwrap_or_default(),
        sections: vec![Section {
            heading: "Why this one".into(),
            text: design.explanation.join("\n\n"),
            blocks: vec![Block::Plot(trade_off(&design.trade_off))],
        }],
        ..Page::default()
    };
    write_page(outputs.report.as_deref(), &page)?;
    if let Some(block) = block {
        write_block(&design, &front_end, block)?;
    }
    write_whole(out, text.as_bytes())?;
    for line in &design.explanation {
        println!("  {line}");
    }
    // Ends and middle of the curve: the whole of it is in the page and in the figures.
    let curve = &design.trade_off;
    if let [first, .., last] = curve.as_slice() {
        let point = |a: &Assessment| format!("{:.2} and {:.2}", 1e3 * a.noise_um, 1e3 * a.disturbance_um);
        let middle = curve.get(curve.len() / 2).map(point).unwrap_or_default();
        println!("  Trade-off, noise passed on and error let through in nm: {}; {middle}; {}.", point(first), point(last));
    }
    if let Some(block) = block {
        println!("wrote {0}; its lines for a running target are in {0}.commands", block.display());
    }
    println!("wrote {}; next: hysteron track {} {} --reference sine:50:5", out.display(), model.display(), out.display());
    Ok(true)
}

/// `hysteron check SERVO --model MODEL [--scheme NAME]`; a scheme is checked with the target's period of delay.
pub fn check(servo: &Path, model: &Path, scheme: Option<&str>, outputs: &Outputs) -> Result<bool> {
    check_writable(outputs.json.as_deref())?;
    let mut design = read_design(servo)?;
    if let Some(name) = scheme {
        design = commands::with_scheme(&design, name).map_err(|m| Problem::new("--scheme", m))?;
        design.delayed = true;
    }
    let chain = model_file::read(model)?;
    let found = commands::check(&design, &chain).map_err(|m| Problem::file(model, m))?;
    let largest = found.sampled_poles.iter().map(|p| p[0].hypot(p[1])).fold(0.0, f64::max);
    match (found.sampled_poles.is_empty(), found.stable) {
        (true, _) => println!("{}: not judged", found.scheme),
        (false, true) => println!("{}: stable, largest sampled eigenvalue {largest:.4}", found.scheme),
        (false, false) => println!("{}: UNSTABLE, largest sampled eigenvalue {largest:.4}", found.scheme),
    }
    if let Some(m) = &found.margins {
        println!(
            "  gain -50 % {:.3}, +50 % {:.3}; a period more of delay {:.3}; twice the mass {:.3}; second mode {:.3}; peak sensitivity {:.2}",
            m.gain_half, m.gain_plus_half, m.delay, m.mass_double, m.second_mode, m.sensitivity_peak
        );
    }
    if let Some(m_o) = found.continuous.m_o {
        println!("  m_o = {m_o:.2} 1/s; the thesis' continuous conditions {}", if found.continuous.satisfied { "hold" } else { "fail" });
    }
    for remark in &found.remarks {
        println!("  {remark}");
    }
    if let Some(json) = &outputs.json {
        write_json(json, &found)?;
    }
    Ok(found.stable)
}

/// `hysteron track MODEL SERVO --reference R [--scheme NAME]`.
pub fn track(model: &Path, servo: &Path, reference: &str, scheme: Option<&str>, outputs: &Outputs) -> Result<bool> {
    check_writable(outputs.json.as_deref())?;
    check_writable(outputs.report.as_deref())?;
    let design = read_design(servo)?;
    let chain = model_file::read(model)?;
    let result = commands::follow(&chain, &design, reference, scheme).map_err(|m| Problem::new("", m))?;
    println!("{} on {reference}", result.scheme);
    println!("  sensor  RMS {}, max {}", nm(result.sensor.rms_um), nm(result.sensor.max_um));
    println!("  true    RMS {}, max {}", nm(result.truth.rms_um), nm(result.truth.max_um));
    println!("  mean error {}, {} saturated ticks", nm(result.steady_state_um), result.saturated_ticks);
    if let Some(json) = &outputs.json {
        write_json(json, &result)?;
    }
    let error_nm = result.sensor_um.iter().zip(&result.reference_um).map(|(y, r)| 1e3 * (y - r)).collect();
    let page = Page {
        title: format!("{} on {reference}", result.scheme),
        lead_sentence: format!("The sensor's error is {} RMS, {} at most.", nm(result.sensor.rms_um), nm(result.sensor.max_um)),
        sections: vec![Section {
            heading: "Tracking".into(),
            text: "Integer servo on the identified model, 1 nm of sensor noise.".into(),
            blocks: vec![
                Block::Plot(
                    Plot::new("Displacement")
                        .x_axis("time", "s")
                        .y_axis("displacement", "um")
                        .link("time")
                        .with(Series::line("reference", Role::Drive, result.time_s.clone(), result.reference_um.clone()))
                        .with(Series::line("sensor", Role::Measured, result.time_s.clone(), result.sensor_um.clone())),
                ),
                Block::Plot(Plot::new("Error").x_axis("time", "s").y_axis("error", "nm").link("time").with(Series::line(
                    "sensor minus reference",
                    Role::Residual,
                    result.time_s.clone(),
                    error_nm,
                ))),
                Block::Plot(Plot::new("Drive").x_axis("time", "s").y_axis("drive", "V").link("time").with(Series::line(
                    "drive",
                    Role::Drive,
                    result.time_s.clone(),
                    result.drive_v.clone(),
                ))),
            ],
        }],
        ..Page::default()
    };
    write_page(outputs.report.as_deref(), &page)?;
    Ok(true)
}
