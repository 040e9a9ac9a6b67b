//! `explain`.

use crate::arguments::{Outputs, SearchArguments, StudyOutputs, TimeArguments, as_typed};
use crate::desk::{Desk, wrong};
use crate::progress::Progress;
use crate::read_arguments::ReadArguments;
use crate::tables::{
    print_notes, print_records, print_steps, print_values, say_candidates, say_next, say_stopped,
};
use hysteron::Result;
use hysteron::analyse::{Outcome, Start, analyse};
use hysteron::servo::order;
use hysteron_report::{explain_page, explain_report, falling_error_svg};
use std::path::Path;
use std::time::Instant;

/// What is asked of a run beside the data.
pub struct ExplainRequest<'a> {
    /// The file that judges, where the data set is one file that is fitted.
    pub held_out: Option<&'a Path>,
    /// Effects to start from.
    pub from: &'a str,
    /// How the search goes.
    pub search: &'a SearchArguments,
    /// Every step is reported.
    pub verbose: bool,
    /// How long it may take.
    pub time: TimeArguments,
    /// The picture that moves.
    pub animation: Option<&'a Path>,
}

/// The main job.
pub fn explain(
    path: &Path,
    wanted: &ExplainRequest,
    reading: &ReadArguments,
    outputs: &StudyOutputs,
) -> Result<bool> {
    let ExplainRequest {
        held_out,
        from,
        search,
        verbose,
        time,
        animation,
    } = *wanted;
    let started = Instant::now();
    let desk = Desk::new(outputs.recordings.files.force);
    let effects = desk.effects(from)?;
    let options = search.options(&desk)?;
    let dataset = desk.dataset_with(path, held_out, reading)?;
    outputs.check(&desk, &dataset)?;
    let files = &outputs.recordings.files;
    desk.target(files.next_drive().as_deref())?;
    desk.target(animation)?;
    let progress = Progress::of_search(verbose);
    let found = time.beside(&progress, |watch| {
        analyse(&dataset, Start::Effects(&effects), &options, watch)
    })?;
    let dataset = found.dataset(&dataset).clone();
    drop(progress);
    if verbose {
        eprintln!("{}", found.work.table());
    }
    let figures = found.figures(&dataset, started.elapsed().as_secs_f64());
    say_stopped(found.stopped);
    println!("{}: {}", dataset.name, found.diagnosis.sentence);
    print_steps(&figures.steps, figures.noise_floor_um);
    println!();
    print_records(&figures);
    print_values(&figures);
    print_notes(&figures);
    for step in figures.steps.iter().skip(1) {
        if let Some(id) = &step.added {
            println!("  why {id}: {}", step.why);
        }
    }
    say_candidates(&found.diagnosis, &found.model);
    write_next_experiment(&desk, &found, files)?;
    desk.write_model(outputs.out.as_deref(), &found.model, &dataset.name)?;
    desk.write_json(files.json.as_deref(), &figures)?;
    desk.write_page(files.report.as_deref(), || {
        explain_page(&explain_report(&found, &dataset, as_typed()))
    })?;
    let start = found
        .steps
        .first()
        .map(|step| ("modelled_at_start", &step.judged.model));
    let models: Vec<_> = [("modelled", &found.model)]
        .into_iter()
        .chain(start)
        .collect();
    outputs.recordings.write_series(&desk, &dataset, &models)?;
    if let Some(path) = animation {
        let report = explain_report(&found, &dataset, as_typed());
        let svg = falling_error_svg(&report)
            .ok_or_else(|| wrong(path, "no record was judged; there is nothing to show"))?;
        desk.write(path, svg.as_bytes())?;
    }
    let model = outputs.out.as_ref().map_or_else(
        || "Keep the model with --out model.toml.".into(),
        |p| format!("Model: {}", p.display()),
    );
    println!("{:.1} s. {model}", figures.seconds);
    if let Err(why) = order::designable(&found.model)
        && outputs.out.is_some()
    {
        println!("No servo can be designed from it as it is: {why}.");
    }
    say_next(files, path);
    Ok(true)
}

/// Writes the drive that would decide beside the other outputs.
pub fn write_next_experiment(desk: &Desk, found: &Outcome, outputs: &Outputs) -> Result<()> {
    let Some(next) = &found.next_experiment else {
        return Ok(());
    };
    println!("  {}", next.sentence);
    if let Some(path) = outputs.next_drive() {
        desk.write(&path, next.proposal.csv().as_bytes())?;
        println!("  that drive, ready to run: {}", path.display());
    }
    Ok(())
}
