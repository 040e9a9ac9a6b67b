//! The reference page of the effects, from what they declare: `docs/reference/effects.md`.

use hysteron_sim::effect::{Overview, Parameter, Place, Scale, registry};
use std::fmt::Write;

/// How a chain is computed, in front of the effects.
const INTRODUCTION: &str = include_str!("effect_reference.md");

/// The page in Markdown.
#[must_use]
pub fn page() -> String {
    let mut out = INTRODUCTION.to_owned();
    let overview = Overview::without_data(0.0, 100.0);
    let mut place = None;
    for effect in registry() {
        let declaration = effect.declaration();
        // Writing to a text cannot fail.
        if place.replace(declaration.place) != Some(declaration.place) {
            let name = Place::NAMES
                .iter()
                .find(|(_, at)| *at == declaration.place)
                .map_or("", |(name, _)| name);
            let _ = write!(out, "\n## {}\n", capital(&name.replace('_', " ")));
        }
        let _ = write!(
            out,
            "\n### `{}`\n\n{}\n",
            declaration.id, declaration.physics
        );
        if let Some(other) = declaration.modifies {
            let _ = write!(
                out,
                "\nIts equations enter the stage of `{other}` where the model has one.\n"
            );
        }
        let _ = write!(out, "\n{}\n", effect.declaration().equations);
        let _ = write!(out, "\n| parameter | unit | |\n|---|---|---|\n");
        effect.parameters(&overview).iter().for_each(|p| {
            let _ = writeln!(
                out,
                "| `{}` | {} | {} |",
                p.name,
                if p.unit == "1" { "" } else { p.unit.as_str() },
                remark(p)
            );
        });
        let _ = write!(
            out,
            "\nReference: {}. Best shown by: {}.\n",
            declaration.reference.trim_end_matches('.'),
            declaration.experiment.trim_end_matches('.')
        );
    }
    out
}

fn remark(parameter: &Parameter) -> &'static str {
    match (parameter.of_a_grid, parameter.fixed, parameter.scale) {
        (true, ..) => "stays on its grid",
        (_, true, _) => "stays where it is put",
        (_, _, Scale::Logarithmic) => "positive",
        _ => "",
    }
}

fn capital(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map_or_else(String::new, |c| {
        c.to_uppercase().collect::<String>() + letters.as_str()
    })
}
