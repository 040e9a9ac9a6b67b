//! Tables on the screen.

use crate::arguments::Outputs;
use hysteron::diagnosis::words::why;
use hysteron::figures::{FitFigures, StepFigures};
use hysteron::outcome::{Diagnosis, Verdict};
use hysteron::phrases::nm;
use hysteron::replay::lines;
use hysteron_sim::chain::Model;
use std::path::Path;

/// The steps of a growth with their falling error.
pub fn print_steps(steps: &[StepFigures], floor_um: Option<f64>) {
    let width = steps
        .iter()
        .filter_map(|s| s.added.as_ref().map(String::len))
        .max()
        .unwrap_or(0)
        .max(18);
    println!("  {:width$}  fitted nm  held out nm", "");
    for (i, step) in steps.iter().enumerate() {
        let name = match (&step.added, i) {
            (Some(id), _) => format!("+ {id}"),
            (None, 0) => "start".into(),
            (None, _) => step
                .why
                .split([';', ':'])
                .next()
                .unwrap_or_default()
                .to_owned(),
        };
        println!(
            "  {name:width$}  {:>9}  {:>11}",
            nm(step.identify_rms_um),
            step.validate_rms_um.map_or("-".into(), nm)
        );
    }
    if let Some(floor) = floor_um {
        println!("  {:width$}  {:>9}  {:>11}", "noise", nm(floor), nm(floor));
    }
}

/// Records with their errors.
pub fn print_records(figures: &FitFigures) {
    let width = figures
        .records
        .iter()
        .map(|r| r.file.len())
        .max()
        .unwrap_or(6)
        .max(6);
    println!(
        "  {:width$}  {:8}  RMS nm    max nm    % of range    replay nm",
        "record", "role"
    );
    for r in figures.records.iter().filter(|r| r.role != "noise") {
        println!(
            "  {:width$}  {:8}  {:>6}    {:>6}    {:<10.3}    {:>9}",
            r.file,
            r.role,
            nm(r.rms_um),
            nm(r.max_um),
            r.rms_pct_range,
            nm(r.replay_rms_um)
        );
    }
    lines(&figures.replays)
        .iter()
        .for_each(|line| println!("  {line}"));
}

/// The values of a model as an engineer reads them, a line for each effect.
pub fn print_values(figures: &FitFigures) {
    let width = figures
        .values
        .iter()
        .map(|v| v.effect.len())
        .max()
        .unwrap_or(0);
    for of_effect in figures.values.chunk_by(|a, b| a.effect == b.effect) {
        let said: Vec<String> = of_effect
            .iter()
            .map(|v| format!("{} {}", v.name, v.text()))
            .collect();
        println!("  {:width$}  {}", of_effect[0].effect, said.join(", "));
    }
}

/// Things to know, one line each.
pub fn say_notes<'a>(notes: impl IntoIterator<Item = &'a String>) {
    for note in notes_once(notes) {
        println!("  note: {note}");
    }
}

/// Notes in which what several files have in common stands once, behind all of their names.
fn notes_once<'a>(notes: impl IntoIterator<Item = &'a String>) -> Vec<String> {
    let mut said: Vec<(Vec<&str>, &str)> = Vec::new();
    for note in notes {
        let of_file = note
            .split_once(": ")
            .filter(|(name, _)| !name.contains(' '));
        let (names, text) =
            of_file.map_or((vec![], note.as_str()), |(name, text)| (vec![name], text));
        match said
            .iter_mut()
            .find(|(of, other)| *other == text && !of.is_empty())
        {
            Some((of, _)) => of.extend(names),
            None => said.push((names, text)),
        }
    }
    let line = |(names, text): (Vec<&str>, &str)| {
        if names.is_empty() {
            text.to_owned()
        } else {
            format!("{}: {text}", names.join(", "))
        }
    };
    said.into_iter().map(line).collect()
}

/// What to know of a fit, one line each.
pub fn print_notes(figures: &FitFigures) {
    say_notes(&figures.warnings);
    for line in &figures.cannot_identify {
        println!("  cannot be identified from this data: {line}");
    }
}

/// What to do where the verdict is no name.
pub fn say_candidates(diagnosis: &Diagnosis, model: &Model) {
    match diagnosis.verdict {
        Verdict::Ambiguous => {
            for c in diagnosis
                .candidates
                .iter()
                .filter(|c| diagnosis.named.contains(&c.effect))
            {
                println!(
                    "  to tell {} from the others: {}",
                    c.effect, c.next_experiment
                );
            }
        }
        Verdict::Unexplained => {
            match diagnosis.candidates.first() {
                Some(c) if model.effect(&c.effect).is_some() => {
                    println!(
                        "  {} is in the model; for what it leaves nothing was found in the library",
                        c.effect
                    )
                }
                Some(c) => println!(
                    "  the nearest is {}: it would explain {:.0} % of what is left; not taken: {}",
                    c.effect,
                    100.0 * c.explained_share,
                    why(&c.standing)
                ),
                None => {}
            }
            println!(
                "  to try an effect of your own: write it as a .toml file and pass it with --own"
            );
        }
        _ => {}
    }
}

/// Where to look, or how to get something to look at.
pub fn say_next(outputs: &Outputs, dataset: &Path) {
    match &outputs.report {
        Some(path) => println!("Open {} to look at it.", path.display()),
        None => println!(
            "To look at it: add --report page.html  (data: {})",
            dataset.display()
        ),
    }
}

/// Says that a result is the best so far.
pub fn say_stopped(stopped: bool) {
    if stopped {
        println!("Stopped: this is the best so far, not the end of the search.");
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_files_have_in_common_is_said_once() {
        let notes =
            ["a: rests", "its zero is assumed", "b: rests", "b: is short"].map(String::from);
        assert_eq!(
            notes_once(&notes),
            ["a, b: rests", "its zero is assumed", "b: is short"]
        );
    }
}
