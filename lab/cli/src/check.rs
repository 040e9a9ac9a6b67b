//! `check`.

use crate::arguments::Outputs;
use crate::desk::{Desk, wrong};
use crate::read_arguments::ReadArguments;
use hysteron::servo::check::{CheckResult, check_with};
use hysteron::servo::design::{SCHEMA, ServoDesign};
use hysteron::servo::named_scheme;
use hysteron::servo::track::TrackResult;
use hysteron::servo::work::{self, Work};
use hysteron::{Error, Result};
use hysteron_report::servo_words as words;
use hysteron_report::{Page, PageBlock, Section, nyquist, sensitivity, step_section};
use std::path::Path;

/// Reads a servo file.
pub fn read_design(desk: &Desk, path: &Path) -> Result<ServoDesign> {
    let text = desk.text(path, "a file written by `hysteron design`")?;
    ServoDesign::from_toml(&text, &path.display().to_string())
}

/// A servo and a model of two files in either order: what a file is stands in it.
pub fn servo_and_model<'a>(first: &'a Path, second: &'a Path) -> [&'a Path; 2] {
    let is_servo = |path: &Path| {
        let text = std::fs::read_to_string(path).unwrap_or_default();
        text.lines()
            .any(|line| line.starts_with("schema") && line.contains(SCHEMA))
    };
    if is_servo(second) && !is_servo(first) {
        [second, first]
    } else {
        [first, second]
    }
}

/// What is checked, and with what.
pub struct CheckRequest<'a> {
    /// The servo.
    pub servo: &'a Path,
    /// The model.
    pub model: &'a Path,
    /// The recording behind the model.
    pub data: Option<&'a Path>,
    /// Another scheme than that of the servo.
    pub scheme: Option<&'a str>,
}

/// `hysteron check SERVO --model MODEL [--data DATASET] [--scheme NAME]`: another scheme is designed for the
/// servo's model, as `track` does.
pub fn check(wanted: &CheckRequest, reading: &ReadArguments, outputs: &Outputs) -> Result<bool> {
    let CheckRequest {
        servo,
        model,
        data,
        scheme,
    } = *wanted;
    reading.require_recording(data)?;
    let desk = Desk::new(outputs.force);
    let mut design = read_design(&desk, servo)?;
    if let Some(name) = scheme {
        design = named_scheme::with_scheme(&design, name).map_err(|m| Error::new("--scheme", m))?;
    }
    let chain = desk.model(model)?;
    let recording = data.map(|path| desk.dataset(path, reading)).transpose()?;
    outputs.check(&desk)?;
    let found = check_with(&design, &chain, recording.as_ref()).map_err(|m| wrong(model, m))?;
    println!("{}: {}", found.scheme, found.verdict());
    if let Some(m) = &found.margins {
        for line in words::margins(m) {
            println!("  {line}");
        }
    }
    if let Some(on_plants) = &found.on_plants {
        println!("  {}", words::on_plants(on_plants));
    }
    if let Some(m_o) = found.continuous.m_o {
        println!(
            "  m_o = {m_o:.2} 1/s; the thesis' continuous conditions {}",
            if found.continuous.satisfied {
                "hold"
            } else {
                "fail"
            }
        );
    }
    for remark in &found.remarks {
        println!("  {remark}");
    }
    desk.write_json(outputs.json.as_deref(), &found)?;
    // A servo that does not fit the actuator has margins all the same, and no step.
    let step = outputs
        .report
        .as_ref()
        .and_then(|_| work::follow_step(&chain, &design, &Work::default()).ok());
    desk.write_page(outputs.report.as_deref(), || page(&found, step.as_ref()))?;
    Ok(found.stable)
}

fn page(found: &CheckResult, step: Option<&TrackResult>) -> Page {
    let mut words = found
        .margins
        .as_ref()
        .map(words::margins)
        .unwrap_or_default();
    words.extend(found.on_plants.as_ref().map(words::on_plants));
    let blocks = found
        .margins
        .as_ref()
        .map(|m| vec![PageBlock::Plot(sensitivity(m)), PageBlock::Plot(nyquist(m))]);
    Page {
        title: format!("Check of {}", found.scheme),
        lead_sentence: format!("{} on this actuator: {}.", found.scheme, found.verdict()),
        sections: std::iter::once(Section {
            heading: "The loop".into(),
            text: words
                .iter()
                .chain(&found.remarks)
                .cloned()
                .collect::<Vec<_>>()
                .join("\n\n"),
            blocks: blocks.unwrap_or_default(),
        })
        .chain(step_section(step))
        .collect(),
        ..Page::default()
    }
}
