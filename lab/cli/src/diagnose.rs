//! `diagnose`.

use crate::arguments::{RecordingOutputs, SearchArguments, TimeArguments, as_typed};
use crate::desk::Desk;
use crate::explain::write_next_experiment;
use crate::progress::Progress;
use crate::read_arguments::ReadArguments;
use crate::tables::{say_candidates, say_next, say_notes, say_stopped};
use hysteron::Result;
use hysteron::analyse::{Start, analyse};
use hysteron::phrases::nm;
use hysteron_report::{explain_page, explain_report};
use std::path::Path;

/// Says what a model misses.
pub fn diagnose(
    model: &Path,
    path: &Path,
    search: &SearchArguments,
    time: TimeArguments,
    reading: &ReadArguments,
    outputs: &RecordingOutputs,
) -> Result<bool> {
    let desk = Desk::new(outputs.files.force);
    let options = search.options(&desk)?;
    let model = desk.model(model)?;
    let dataset = desk.dataset_beside(&model, path, reading)?;
    outputs.check(&desk, &dataset)?;
    let files = &outputs.files;
    desk.target(files.next_drive().as_deref())?;
    let progress = Progress::of_search(false);
    let found = time.beside(&progress, |watch| {
        analyse(&dataset, Start::Model(model), &options, watch)
    })?;
    let dataset = found.dataset(&dataset).clone();
    drop(progress);
    let d = &found.diagnosis;
    say_stopped(found.stopped);
    println!("{}: {}", dataset.name, d.sentence);
    say_notes(dataset.remarks().iter().chain(&found.floor.warnings));
    println!(
        "  {:24} share   p        held out nm before, after",
        "candidate"
    );
    for c in d.candidates.iter().take(6) {
        println!(
            "  {:24} {:>4.0} %  {:<7}  {} , {}{}",
            c.effect,
            100.0 * c.explained_share,
            c.p_value.map_or("-".into(), |p| format!("{p:.4}")),
            c.validate_rms_before_um.map_or("-".into(), nm),
            c.validate_rms_after_um.map_or("-".into(), nm),
            if c.confusable_with.is_empty() {
                String::new()
            } else {
                format!("   looks like {}", c.confusable_with.join(", "))
            }
        );
    }
    say_candidates(d, &found.model);
    write_next_experiment(&desk, &found, files)?;
    desk.write_json(files.json.as_deref(), d)?;
    desk.write_page(files.report.as_deref(), || {
        explain_page(&explain_report(&found, &dataset, as_typed()))
    })?;
    let start = found
        .steps
        .first()
        .map(|step| ("modelled", &step.judged.model));
    outputs.write_series(&desk, &dataset, &start.into_iter().collect::<Vec<_>>())?;
    say_next(files, path);
    Ok(true)
}
