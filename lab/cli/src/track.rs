//! `track`.

use crate::arguments::Outputs;
use crate::check::read_design;
use crate::desk::{Desk, wrong};
use hysteron::dataset::readers::{self, Hints};
use hysteron::servo::commands::{self, Work};
use hysteron::servo::disturbance::Disturbance;
use hysteron::servo::reference::Reference;
use hysteron::servo::words;
use hysteron::{Error, Result};
use hysteron_report::{CurveRole, Page, PageBlock, Plot, Section, Series};
use std::path::Path;

fn nm(um: f64) -> String {
    format!("{:.2} nm", 1e3 * um)
}

/// What is followed, and with what.
pub struct TrackRequest<'a> {
    /// The reference.
    pub reference: &'a str,
    /// Another scheme than that of the file.
    pub scheme: Option<&'a str>,
    /// Noise of the sensor, um.
    pub sensor_noise_um: Option<f64>,
    /// Force from outside.
    pub disturbance: Option<&'a str>,
    /// Mass added, as a ratio.
    pub added_mass: f64,
}

/// The reference that was named: a shape, or a file of points.
fn reference_of(desk: &Desk, text: &str) -> Result<Reference> {
    let path = Path::new(text);
    let file_is_meant = path.is_file() || path.extension().is_some_and(|e| e.eq_ignore_ascii_case("csv"));
    if !file_is_meant {
        return Reference::named(text).map_err(|m| Error::new("", m));
    }
    let table = readers::read(text, &desk.bytes(path, "a reference")?, Hints::default())?;
    let [time_s, reference_um] = table.columns.as_slice() else {
        return Err(wrong(path, format!("{} columns; expected two, time in s and the reference in um", table.columns.len())));
    };
    for (column, expected) in [(time_s, "s"), (reference_um, "um")] {
        if let Some(unit) = column.unit.as_ref().filter(|unit| *unit != expected) {
            return Err(wrong(path, format!("column {} is in {unit}; expected {expected}", column.called())));
        }
    }
    Reference::through(&time_s.values, &reference_um.values).map_err(|m| wrong(path, m))
}

/// `hysteron track MODEL SERVO --reference R [--scheme NAME] [--sensor-noise-um N]
/// [--disturbance D] [--added-mass RATIO]`.
pub fn track(model: &Path, servo: &Path, wanted: &TrackRequest, outputs: &Outputs) -> Result<bool> {
    let TrackRequest { reference, scheme, sensor_noise_um, disturbance, added_mass } = *wanted;
    let desk = Desk::new(outputs.force);
    let design = read_design(&desk, servo)?;
    let chain = desk.model(model)?;
    outputs.check(&desk)?;
    let followed = reference_of(&desk, reference)?;
    let disturbance_said = disturbance.map(Disturbance::parse).transpose().map_err(|m| Error::new("", m))?;
    let work = Work { scheme, sensor_noise_um, disturbance: disturbance_said, added_mass };
    let result = commands::follow(&chain, &design, &followed, reference, &work).map_err(|m| Error::new("", m))?;
    let pushed = disturbance.map_or_else(String::new, |d| format!(", disturbed by {d}"));
    let loaded = if added_mass > 0.0 { format!(", {} times the moving mass", 1.0 + added_mass) } else { String::new() };
    let at_work = format!("{} on {reference}{pushed}{loaded}", result.scheme);
    println!("{at_work}");
    println!("  plant: {}", result.plant);
    println!("  true    RMS {}, max {}", nm(result.truth.rms_um), nm(result.truth.max_um));
    println!("  sensor  RMS {}, max {}", nm(result.sensor.rms_um), nm(result.sensor.max_um));
    if let Some(beside) = &result.beside {
        println!("  {} on the same run, true RMS {}, max {}", beside.scheme, nm(beside.truth.rms_um), nm(beside.truth.max_um));
    }
    println!(
        "  mean error {}, {} saturated ticks, noise of the sensor {}",
        nm(result.steady_state_um),
        result.saturated_ticks,
        nm(result.noise_um)
    );
    if let Some(sentence) = words::sensor_lag(result.sensor_lag_s, result.model_sensor_lag_s) {
        println!("  {sentence}");
    }
    if let Some(gain) = result.adapted_gain {
        println!("  the gain was corrected to {gain:.3} times the model's");
    }
    desk.write_json(outputs.json.as_deref(), &result)?;
    let error_nm = result.sensor_um.iter().zip(&result.reference_um).map(|(y, r)| 1e3 * (y - r)).collect();
    let page = Page {
        title: at_work,
        lead_sentence: format!(
            "The true position's error is {} RMS, {} at most; the sensor reads {} RMS.",
            nm(result.truth.rms_um),
            nm(result.truth.max_um),
            nm(result.sensor.rms_um)
        ),
        sections: vec![Section {
            heading: "Tracking".into(),
            text: format!("Integer servo, {} of sensor noise. Plant: {}.", nm(result.noise_um), result.plant),
            blocks: vec![
                PageBlock::Plot(
                    Plot::new("Displacement")
                        .x_axis("time", "s")
                        .y_axis("displacement", "um")
                        .link("time")
                        .with(Series::line("reference", CurveRole::Drive, result.time_s.clone(), result.reference_um.clone()))
                        .with(Series::line("sensor", CurveRole::Measured, result.time_s.clone(), result.sensor_um.clone())),
                ),
                PageBlock::Plot(Plot::new("Error").x_axis("time", "s").y_axis("error", "nm").link("time").with(Series::line(
                    "sensor minus reference",
                    CurveRole::Residual,
                    result.time_s.clone(),
                    error_nm,
                ))),
                PageBlock::Plot(Plot::new("Drive").x_axis("time", "s").y_axis("drive", "V").link("time").with(Series::line(
                    "drive",
                    CurveRole::Drive,
                    result.time_s.clone(),
                    result.drive_v.clone(),
                ))),
            ],
        }],
        ..Page::default()
    };
    desk.write_page(outputs.report.as_deref(), || page)?;
    let trouble = result.trouble();
    if let Some(trouble) = &trouble {
        eprintln!("WARNING: {trouble}");
    }
    Ok(trouble.is_none())
}
