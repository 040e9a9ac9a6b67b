//! `plant`.

use crate::problem::{Problem, Result};
use std::path::Path;

/// Simulates a data set with known effects.
pub fn plant(effects: &str, base: &str, out: &Path, seed: u64) -> Result<bool> {
    let hidden = effects
        .split(',')
        .map(str::trim)
        .filter(|e| !e.is_empty() && *e != "none")
        .map(|item| {
            let (id, strength) = item.split_once('=').unwrap_or((item, "1"));
            let strength: f64 =
                strength.parse().map_err(|_| Problem::new("effects", format!("strength `{strength}` of {id} is not a number")))?;
            if !(strength > 0.0 && strength <= 100.0) {
                return Err(Problem::new("effects", format!("strength {strength} of {id}; expected above 0, at most 100")));
            }
            Ok((id.to_string(), strength))
        })
        .collect::<Result<Vec<_>>>()?;
    let base: Vec<String> = crate::model_file::parse_effects(base)?.iter().map(|e| e.declaration().id).collect();
    let truth = crate::plant::plant(&hidden, &base, out, seed)?;
    println!("{}: hidden {}, noise {:.2} nm", out.display(), truth.hidden.as_deref().unwrap_or("nothing"), 1e3 * truth.noise_um);
    println!("Next: hysteron explain {} --from {}", out.display(), base.join(","));
    Ok(true)
}
