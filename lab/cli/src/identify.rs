//! `identify`.

use crate::arguments::StudyOutputs;
use crate::compare::write_fit;
use crate::desk::Desk;
use crate::progress::Progress;
use crate::read_arguments::ReadArguments;
use crate::screen::as_argument;
use crate::tables::{print_notes, print_records, print_values, say_stopped};
use hysteron::error::nearest;
use hysteron::{Error, Result, model_file};
use hysteron_sim::effect::{Effect, Place, registry};
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

/// Names of the thesis' hysteresis models, with the effects that they stand for; others are called as their
/// effect.
const HYSTERESIS_KINDS: [(&str, &str); 3] = [
    ("preisach", "hysteresis"),
    ("one-sided", "hysteresis,initial_curve"),
    ("rate-dependent", "hysteresis,initial_curve,rate_dependence"),
];

/// The list with a hysteresis model in place of whatever stood there.
fn with_kind(effects: Vec<Arc<dyn Effect>>, kind: Option<&str>) -> Result<Vec<Arc<dyn Effect>>> {
    let Some(kind) = kind else { return Ok(effects) };
    let wanted = kind.replace('_', "-");
    let structures = registry()
        .into_iter()
        .filter(|e| e.declaration().is_main())
        .map(|e| e.declaration().id);
    let named = HYSTERESIS_KINDS
        .map(|(name, ids)| (name.to_owned(), ids.to_owned()))
        .into_iter();
    let known: Vec<(String, String)> = named
        .chain(structures.map(|id| (id.replace('_', "-"), id)))
        .collect();
    let Some((_, ids)) = known.iter().find(|(name, _)| *name == wanted) else {
        let known: Vec<String> = known.into_iter().map(|(name, _)| name).collect();
        return Err(Error::new(
            "--hysteresis",
            format!(
                "`{kind}` is not known{}; known are {}",
                nearest(&wanted, &known),
                known.join(", ")
            ),
        ));
    };
    let mut out = model_file::effects_named(ids)?;
    out.extend(
        effects
            .into_iter()
            .filter(|e| e.declaration().place != Place::Hysteresis),
    );
    Ok(out)
}

/// Fits a list of effects.
pub fn identify(
    path: &Path,
    effects: &str,
    kind: Option<&str>,
    reading: &ReadArguments,
    outputs: &StudyOutputs,
) -> Result<bool> {
    let started = Instant::now();
    let desk = Desk::new(outputs.recordings.files.force);
    let effects = with_kind(desk.effects(effects)?, kind)?;
    let dataset = desk.dataset(path, reading)?;
    outputs.check(&desk, &dataset)?;
    let progress = Progress::of_search(false);
    let found = hysteron::identify::identify(&dataset, &effects, &progress)?;
    drop(progress);
    let figures = found.figures(&dataset, started.elapsed().as_secs_f64());
    say_stopped(found.stopped);
    println!("{}: {}", dataset.name, figures.effects.join(", "));
    print_records(&figures);
    print_values(&figures);
    print_notes(&figures);
    write_fit(
        &desk,
        &found.model,
        &figures,
        &dataset,
        outputs.out.as_deref(),
        &outputs.recordings,
    )?;
    let next = outputs.out.as_ref().map_or_else(
        || "Keep the model with --out model.toml.".into(),
        |p| {
            format!(
                "Next: hysteron diagnose {} {}{}",
                as_argument(p),
                as_argument(path),
                reading.as_typed()
            )
        },
    );
    println!("{:.1} s. {next}", figures.seconds);
    Ok(true)
}
