//! `effects`.

use crate::arguments::Outputs;
use crate::desk::Desk;
use crate::progress::Progress;
use hysteron::Result;
use hysteron::effect_reference;
use hysteron::synthetic::signatures::{Signature, signatures};
use hysteron_report::effects_page;
use serde::Serialize;
use std::path::Path;

/// What `effects --json` carries of one effect.
#[derive(Serialize)]
struct EffectFigures<'a> {
    effect: &'a str,
    physics: &'a str,
    reference: &'a str,
    experiment: &'a str,
    parameters: Vec<&'a str>,
    looks_like: &'a [(String, f64)],
}

/// `hysteron effects [--report effects.html] [--equations effects.md]`: the library, from what each effect
/// declares.
pub fn effects(equations: Option<&Path>, outputs: &Outputs) -> Result<bool> {
    let desk = Desk::new(outputs.force);
    outputs.check(&desk)?;
    if let Some(path) = equations {
        desk.target(Some(path))?;
        desk.write(path, effect_reference::page().as_bytes())?;
        println!("{}", path.display());
        return Ok(true);
    }
    let progress = Progress::start();
    progress.say("simulating what every effect does");
    let found = signatures()?;
    drop(progress);
    let widest = found
        .iter()
        .map(|s| s.declaration.id.len())
        .max()
        .unwrap_or(0);
    for Signature { declaration, .. } in &found {
        println!("  {:widest$}  {}", declaration.id, declaration.physics);
    }
    let figures: Vec<EffectFigures> = found.iter().map(figures).collect();
    desk.write_json(outputs.json.as_deref(), &figures)?;
    desk.write_page(outputs.report.as_deref(), || effects_page(&found))?;
    if outputs.report.is_none() {
        println!("What each does to a reading, and what looks like it: --report effects.html");
    }
    Ok(true)
}

fn figures(signature: &Signature) -> EffectFigures<'_> {
    let declaration = &signature.declaration;
    EffectFigures {
        effect: &declaration.id,
        physics: &declaration.physics,
        reference: &declaration.reference,
        experiment: &declaration.experiment,
        parameters: signature
            .parameters
            .iter()
            .map(|(parameter, _)| parameter.name.as_str())
            .collect(),
        looks_like: &signature.alike,
    }
}
