//! `add`.

use crate::arguments::RecordingOutputs;
use crate::compare::write_fit;
use crate::desk::Desk;
use crate::progress::Progress;
use crate::read_arguments::ReadArguments;
use crate::tables::{print_notes, print_records, print_steps, print_values, say_stopped};
use hysteron::{Error, Result};
use std::path::Path;
use std::time::Instant;

/// Adds one effect and fits again.
pub fn add(
    effect: &str,
    model: &Path,
    path: &Path,
    out: &Path,
    reading: &ReadArguments,
    outputs: &RecordingOutputs,
) -> Result<bool> {
    let started = Instant::now();
    let desk = Desk::new(outputs.files.force);
    let requested = desk.effects(effect)?;
    let [effect] = &requested[..] else {
        return Err(Error::new(
            "effect",
            format!("expected one effect, got {}", requested.len()),
        ));
    };
    let model = desk.model(model)?;
    let dataset = desk.dataset_beside(&model, path, reading)?;
    desk.target(Some(out))?;
    outputs.check(&desk, &dataset)?;
    let progress = Progress::of_search(false);
    let found = hysteron::identify::add(effect, model, &dataset, &progress)?;
    drop(progress);
    let figures = found.figures(&dataset, started.elapsed().as_secs_f64());
    say_stopped(found.stopped);
    print_steps(&figures.steps, figures.noise_floor_um);
    print_records(&figures);
    print_values(&figures);
    print_notes(&figures);
    write_fit(&desk, &found.model, &figures, &dataset, Some(out), outputs)?;
    println!("{:.1} s. Model: {}", figures.seconds, out.display());
    Ok(true)
}
