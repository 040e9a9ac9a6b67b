//! `check`.

use crate::arguments::Outputs;
use crate::desk::{Desk, wrong};
use hysteron::servo::commands::{self, CheckResult};
use hysteron::servo::design::{SCHEMA, ServoDesign};
use hysteron::servo::words;
use hysteron::toml_file::with_schema;
use hysteron::{Error, Result};
use hysteron_report::{Page, PageBlock, Section, nyquist, sensitivity};
use std::path::Path;

/// Reads a servo file.
pub fn read_design(desk: &Desk, path: &Path) -> Result<ServoDesign> {
    let text = desk.text(path, "a file written by `hysteron design`")?;
    let design: ServoDesign = with_schema(&text, &path.display().to_string(), SCHEMA)?;
    design.impossible_value().map_or(Ok(design), |impossible| Err(wrong(path, impossible)))
}

/// `hysteron check SERVO --model MODEL [--scheme NAME]`: another scheme is designed for the servo's model, as
/// `track` does.
pub fn check(servo: &Path, model: &Path, scheme: Option<&str>, outputs: &Outputs) -> Result<bool> {
    let desk = Desk::new(outputs.force);
    let mut design = read_design(&desk, servo)?;
    if let Some(name) = scheme {
        design = commands::with_scheme(&design, name).map_err(|m| Error::new("--scheme", m))?;
    }
    let chain = desk.model(model)?;
    outputs.check(&desk)?;
    let found = commands::check(&design, &chain).map_err(|m| wrong(model, m))?;
    println!("{}: {}", found.scheme, found.verdict());
    if let Some(m) = &found.margins {
        for line in words::margins(m) {
            println!("  {line}");
        }
    }
    if let Some(m_o) = found.continuous.m_o {
        println!("  m_o = {m_o:.2} 1/s; the thesis' continuous conditions {}", if found.continuous.satisfied { "hold" } else { "fail" });
    }
    for remark in &found.remarks {
        println!("  {remark}");
    }
    desk.write_json(outputs.json.as_deref(), &found)?;
    desk.write_page(outputs.report.as_deref(), || page(&found))?;
    Ok(found.stable)
}

fn page(found: &CheckResult) -> Page {
    let words = found.margins.as_ref().map(words::margins).unwrap_or_default();
    let blocks = found.margins.as_ref().map(|m| vec![PageBlock::Plot(sensitivity(m)), PageBlock::Plot(nyquist(m))]);
    Page {
        title: format!("Check of {}", found.scheme),
        lead_sentence: format!("{} on this actuator: {}.", found.scheme, found.verdict()),
        sections: vec![Section {
            heading: "The loop".into(),
            text: words.iter().chain(&found.remarks).cloned().collect::<Vec<_>>().join("\n\n"),
            blocks: blocks.unwrap_or_default(),
        }],
        ..Page::default()
    }
}
