//! `plant`.

use super::PlantArguments;
use crate::plant::Order;
use crate::plant_set::{SetOrder, kinds, plant_set};
use crate::problem::{Problem, Result};

/// Simulates a data set with known effects, or a set of them.
pub fn plant(wanted: &PlantArguments) -> Result<bool> {
    let strengths = wanted.strengths.iter().map(|s| strength(s, "--strengths")).collect::<Result<Vec<_>>>()?;
    let hysteresis = wanted.hysteresis.replace('-', "_");
    if let Some(hidden) = kinds(&wanted.effects) {
        let order = SetOrder { hidden, strengths, cases: wanted.cases, hysteresis, seed: wanted.seed };
        return plant_many(&order, wanted);
    }
    let hidden = parse_hidden(&wanted.effects)?;
    if wanted.cases > 1 || strengths.len() > 1 {
        let hidden = vec![hidden.into_iter().map(|(id, _)| id).collect()];
        return plant_many(&SetOrder { hidden, strengths, cases: wanted.cases, hysteresis, seed: wanted.seed }, wanted);
    }
    let base: Vec<String> = crate::model_file::parse_effects(&wanted.base)?.iter().map(|e| e.declaration().id).collect();
    let order = Order { hidden, base, hysteresis, seed: wanted.seed };
    let truth = crate::plant::plant(&order, &wanted.out)?;
    println!("{}: hidden {}, noise {:.2} nm", wanted.out.display(), truth.hidden.as_deref().unwrap_or("nothing"), 1e3 * truth.noise_um);
    println!("Next: hysteron explain {} --from {}", wanted.out.display(), order.base.join(","));
    Ok(true)
}

fn plant_many(order: &SetOrder, wanted: &PlantArguments) -> Result<bool> {
    let truths = {
        let bar = super::output::Progress::start();
        plant_set(order, &wanted.out, &|truth| bar.say(&format!("simulated {}", truth.name)))?
    };
    println!("{}: {} cases", wanted.out.display(), truths.len());
    println!("Next: hysteron score {}", wanted.out.display());
    Ok(true)
}

fn strength(text: &str, of: &str) -> Result<f64> {
    let value: f64 = text.trim().parse().map_err(|_| Problem::new("effects", format!("strength `{text}` of {of} is not a number")))?;
    if value > 0.0 && value <= 100.0 {
        Ok(value)
    } else {
        Err(Problem::new("effects", format!("strength {value} of {of}; expected above 0, at most 100")))
    }
}

fn parse_hidden(effects: &str) -> Result<Vec<(String, f64)>> {
    effects
        .split(',')
        .map(str::trim)
        .filter(|e| !e.is_empty() && *e != "none")
        .map(|item| {
            let (id, text) = item.split_once('=').unwrap_or((item, "1"));
            Ok((id.replace('-', "_"), strength(text, id)?))
        })
        .collect()
}
