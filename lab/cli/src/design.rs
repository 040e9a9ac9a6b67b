//! `design`.

use crate::arguments::Outputs;
use crate::desk::{Desk, wrong};
use crate::read_arguments::ReadArguments;
use crate::screen::as_argument;
use hysteron::servo::amplifier_block::{self, FrontEnd, amplifier_parameters, upload_lines};
use hysteron::servo::assessment::Assessment;
use hysteron::servo::commands::design_with_expected_errors;
use hysteron::servo::design::ServoDesign;
use hysteron::servo::order::DesignOrder;
use hysteron::servo::scheme_choice::SchemeChoice;
use hysteron::servo::schemes::AtWork;
use hysteron::{Error, Result};
use hysteron_report::{Page, PageBlock, Section, learning as convergence, trade_off};
use serde::Serialize;
use std::path::{Path, PathBuf};

/// What `design --json` carries.
#[derive(Serialize)]
struct DesignFigures<'a> {
    schema: &'static str,
    design: &'a ServoDesign,
    /// What is to be expected on the model; a predictor for the same order beside another scheme.
    at_work: &'a [AtWork],
}

/// The file of the lines that bring a block to a running target.
fn beside(block: &Path) -> PathBuf {
    let mut name = block.as_os_str().to_owned();
    name.push(".commands");
    name.into()
}

/// Files of a design.
pub struct DesignFiles<'a> {
    /// The model.
    pub model: &'a Path,
    /// The recording behind it.
    pub data: Option<&'a Path>,
    /// The servo to write.
    pub out: &'a Path,
    /// The block to write.
    pub block: Option<&'a Path>,
    /// Wiring of the converters.
    pub front_end: Option<&'a Path>,
}

/// What is asked of the servo.
pub struct DesignRequest {
    /// Highest frequency of references, Hz.
    pub reference_hz: f64,
    /// Noise of the sensor, um.
    pub sensor_noise_um: Option<f64>,
    /// Bandwidth of the sensor, Hz.
    pub sensor_bandwidth_hz: Option<f64>,
    /// Largest sensitivity; none: the usual margins where they are cheap.
    pub sensitivity_peak: Option<f64>,
    /// A periodic reference's correction is to be learned.
    pub learning: bool,
    /// The gain of the model is to be corrected while it runs.
    pub adaptation: bool,
    /// Share of its frequency by which the first mode moves.
    pub mode_moves: f64,
    /// Name of the scheme.
    pub scheme: String,
    /// The hysteresis is left to the unknown input.
    pub no_inverse: bool,
}

/// `hysteron design MODEL --out servo.toml [--data DATASET] [--block servo.block] [--front-end
/// front_end.toml]`.
pub fn design(
    files: &DesignFiles,
    wanted: &DesignRequest,
    reading: &ReadArguments,
    outputs: &Outputs,
) -> Result<bool> {
    let DesignFiles {
        model,
        data,
        out,
        block,
        front_end,
    } = *files;
    reading.require_recording(data)?;
    let desk = Desk::new(outputs.force);
    let front_end = match front_end {
        Some(path) => Some(FrontEnd::from_toml(
            &desk.text(path, "the wiring of the converters")?,
            &path.display().to_string(),
        )?),
        // A block is made for some wiring: what is not said is the default, and the servo must fit that.
        None => block.map(|_| FrontEnd::default()),
    };
    let chain = desk.model(model)?;
    let recording = data
        .map(|path| desk.dataset_beside(&chain, path, reading))
        .transpose()?;
    let commands_file = block.map(beside);
    desk.target(Some(out))?;
    desk.target(block)?;
    desk.target(commands_file.as_deref())?;
    outputs.check(&desk)?;
    let DesignRequest {
        reference_hz,
        sensor_noise_um,
        sensor_bandwidth_hz,
        sensitivity_peak,
        learning,
        adaptation,
        mode_moves,
        ..
    } = *wanted;
    let scheme = SchemeChoice::named(&wanted.scheme).map_err(|m| Error::new("--scheme", m))?;
    let (recording, front_end_said) = (recording.as_ref(), front_end.as_ref());
    let order = DesignOrder {
        reference_hz,
        sensor_noise_um,
        sensor_bandwidth_hz,
        sensitivity_peak: sensitivity_peak.unwrap_or(DesignOrder::default().sensitivity_peak),
        usual_margins: sensitivity_peak.is_none(),
        recording,
        front_end: front_end_said,
        learning,
        adaptation,
        mode_moves,
        scheme,
        inverse: !wanted.no_inverse,
    };
    let (design, at_work) =
        design_with_expected_errors(&chain, &order).map_err(|m| wrong(model, m))?;
    // What a target cannot take is no design: it fails before anything is written.
    let block_bytes = match (block, &front_end) {
        (Some(_), Some(front_end)) => Some(amplifier_block::block(&amplifier_parameters(
            &design, front_end,
        )?)?),
        _ => None,
    };
    desk.write_json(
        outputs.json.as_deref(),
        &DesignFigures {
            schema: "hysteron.design/1",
            design: &design,
            at_work: &at_work,
        },
    )?;
    let page = Page {
        title: "Servo design".into(),
        lead_sentence: match &design.chosen {
            Some(chosen) => format!(
                "Expected at {reference_hz} Hz: {:.2} nm of the sensor's noise passed on and {:.2} nm of the model's error let through.",
                1e3 * chosen.noise_um,
                1e3 * chosen.disturbance_um
            ),
            None => design.explanation.first().cloned().unwrap_or_default(),
        },
        sections: vec![Section {
            heading: "Why this one".into(),
            text: design.explanation.join("\n\n"),
            blocks: std::iter::once(trade_off(&design))
                .chain(design.learning.as_ref().map(convergence))
                .map(PageBlock::Plot)
                .collect(),
        }],
        ..Page::default()
    };
    desk.write_page(outputs.report.as_deref(), || page)?;
    if let (Some(path), Some(bytes), Some(commands)) = (block, &block_bytes, &commands_file) {
        desk.write(path, bytes)?;
        desk.write(commands, upload_lines(bytes)?.as_bytes())?;
    }
    desk.write(
        out,
        toml::to_string_pretty(&design)
            .map_err(|e| wrong(out, e))?
            .as_bytes(),
    )?;
    for line in &design.explanation {
        println!("  {line}");
    }
    // Ends and middle of the curve: the whole of it is in the page and in the figures.
    let curve = if design
        .chosen
        .is_some_and(|c| design.trade_off_usual.iter().any(|a| a.tuning == c.tuning))
    {
        &design.trade_off_usual
    } else {
        &design.trade_off
    };
    if let [first, .., last] = curve.as_slice() {
        let point =
            |a: &Assessment| format!("{:.2} and {:.2}", 1e3 * a.noise_um, 1e3 * a.disturbance_um);
        let middle = curve.get(curve.len() / 2).map(point).unwrap_or_default();
        println!(
            "  Trade-off, noise passed on and error let through in nm: {}; {middle}; {}.",
            point(first),
            point(last)
        );
    }
    if let Some(block) = block {
        println!(
            "wrote {0}; its lines for a running target are in {0}.commands",
            block.display()
        );
    }
    // It stands on 1.12 times its amplitude, and has to stay within the travel.
    let reach_um = design.model.reach_um();
    let amplitude_um = if reach_um > 2.12 * 5.0 {
        5.0
    } else {
        (40.0 * reach_um).floor() / 100.0
    };
    let [model, servo] = [model, out].map(as_argument);
    println!(
        "wrote {}; next: hysteron track {model} {servo} --reference sine:{}:{amplitude_um}",
        out.display(),
        reference_hz.min(50.0)
    );
    Ok(true)
}
