//! `compare`.

use crate::command_line::{RecordingOutputs, as_typed};
use crate::desk::Desk;
use crate::read_arguments::ReadArguments;
use crate::tables::{print_notes, print_records, say_next};
use hysteron::diagnosis::judgement::{noise_floor_beside, require_finite};
use hysteron::diagnosis::words::nm;
use hysteron::explain::{FitFigures, fit_figures};
use hysteron::{Dataset, Result};
use hysteron_report::{comparison_report, explain_page};
use hysteron_sim::chain::Model;
use std::path::Path;
use std::time::Instant;

/// Compares a model as it is.
pub fn compare(model: &Path, path: &Path, reading: &ReadArguments, outputs: &RecordingOutputs) -> Result<bool> {
    let started = Instant::now();
    let desk = Desk::new(outputs.files.force);
    let model = desk.model(model)?;
    let dataset = desk.dataset(path, reading)?;
    outputs.check(&desk, &dataset)?;
    require_finite(&model, &dataset, &(0..dataset.records.len()).collect::<Vec<_>>())?;
    let floor = noise_floor_beside(&model, &dataset);
    let figures = fit_figures(&model, &dataset, &floor, Vec::new(), &[], started.elapsed().as_secs_f64());
    println!("{}: {}", dataset.name, figures.effects.join(", "));
    print_records(&figures);
    if let Some(floor) = figures.noise_floor_um {
        println!("  noise: {} nm, from {}", nm(floor), figures.floor_basis);
    }
    print_notes(&figures);
    write_fit(&desk, &model, &figures, &dataset, None, outputs)?;
    say_next(&outputs.files, path);
    Ok(true)
}

/// Writes a model with its figures and its page, as far as they are wanted.
pub fn write_fit(
    desk: &Desk,
    model: &Model,
    figures: &FitFigures,
    dataset: &Dataset,
    out: Option<&Path>,
    outputs: &RecordingOutputs,
) -> Result<()> {
    desk.write_model(out, model, &dataset.name)?;
    desk.write_json(outputs.files.json.as_deref(), figures)?;
    outputs.write_series(desk, dataset, &[("modelled", model)])?;
    desk.write_page(outputs.files.report.as_deref(), || explain_page(&comparison_report(model, dataset, figures, as_typed())))
}
