//! `compare`.

use crate::arguments::{RecordingOutputs, as_typed};
use crate::desk::Desk;
use crate::read_arguments::ReadArguments;
use crate::tables::{print_notes, print_records, print_values, say_next};
use hysteron::dataset::Role;
use hysteron::diagnosis::judgement::{noise_floor_beside, require_finite};
use hysteron::diagnosis::policy::Policy;
use hysteron::figures::{FitFigures, RecordFigures, fit_figures};
use hysteron::identification::noise_floor::NoiseFloor;
use hysteron::phrases::nm;
use hysteron::{Dataset, Result};
use hysteron_report::{comparison_report, explain_page};
use hysteron_sim::chain::Model;
use std::path::Path;
use std::time::Instant;

/// Compares a model as it is.
pub fn compare(
    model: &Path,
    path: &Path,
    reading: &ReadArguments,
    outputs: &RecordingOutputs,
) -> Result<bool> {
    let started = Instant::now();
    let desk = Desk::new(outputs.files.force);
    let model = desk.model(model)?;
    let dataset = desk.dataset_beside(&model, path, reading)?;
    outputs.check(&desk, &dataset)?;
    require_finite(
        &model,
        &dataset,
        &(0..dataset.records.len()).collect::<Vec<_>>(),
    )?;
    let floor = noise_floor_beside(&model, &dataset);
    let figures = fit_figures(
        &model,
        &dataset,
        &floor,
        Vec::new(),
        &[],
        started.elapsed().as_secs_f64(),
    );
    println!("{}: {}", dataset.name, figures.comparison_sentence());
    print_records(&figures);
    print_values(&figures);
    if let Some(floor) = figures.noise_floor_um {
        println!("  noise: {} nm, from {}", nm(floor), figures.floor_basis);
    }
    println!("  {}", against_the_noise(&figures, &floor));
    print_notes(&figures);
    write_fit(&desk, &model, &figures, &dataset, None, outputs)?;
    say_next(&outputs.files, path);
    Ok(true)
}

/// How far what the model leaves is above the noise, in the record in which it is furthest, and what to do
/// then.
fn against_the_noise(figures: &FitFigures, floor: &NoiseFloor) -> String {
    let policy = Policy::default();
    let times = |(record, floor_um): (&RecordFigures, &Option<f64>)| {
        Some((record.rms_um / (*floor_um)?, record.file.clone()))
    };
    let judged = figures
        .records
        .iter()
        .zip(&floor.of_records_um)
        .filter(|(record, _)| record.role != Role::Noise.name());
    match judged.filter_map(times).max_by(|a, b| a.0.total_cmp(&b.0)) {
        None => "nothing in this data shows the noise, so nobody can say how much of that a better model would leave".into(),
        Some((times, _)) if times < policy.explained => "what the model leaves is the noise".into(),
        Some((times, file)) => {
            format!(
                "the model leaves {times:.1} times the noise of {file}: `hysteron diagnose` with the same model and data says what it misses"
            )
        }
    }
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
    desk.write_page(outputs.files.report.as_deref(), || {
        explain_page(&comparison_report(model, dataset, figures, as_typed()))
    })
}
