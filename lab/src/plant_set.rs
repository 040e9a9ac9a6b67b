//! Many simulated data sets: the cases on which the diagnosis is scored, of every kind, at several strengths.

use crate::plant::{OUTSIDE_LIBRARY, Order, Truth, plant};
use crate::problem::{Problem, Result, write_whole};
use rayon::prelude::*;
use std::path::Path;

/// Kinds of which one is hidden in a case of `all`, the unknown ones and none beside.
pub const KINDS: [&str; 18] = [
    "hysteresis",
    "initial_curve",
    "vibration",
    "creep",
    "delay",
    "amplifier_bandwidth",
    "slew_limit",
    "saturation",
    "rate_dependence",
    "load_force",
    "friction",
    "second_mode",
    "thermal_drift",
    "sensor_nonlinearity",
    "sensor_bandwidth",
    "mains_hum",
    "charge_leakage",
    "quantisation",
];

/// Kinds of which two are hidden in a case of `pairs`.
const PAIRED: [&str; 10] = [
    "creep",
    "delay",
    "second_mode",
    "mains_hum",
    "thermal_drift",
    "sensor_nonlinearity",
    "rate_dependence",
    "saturation",
    "friction",
    "load_force",
];

/// What is hidden in the cases of a set, without strengths: `all`, `pairs`, or one list.
#[must_use]
pub fn kinds(wanted: &str) -> Option<Vec<Vec<String>>> {
    match wanted {
        "all" => Some(KINDS.iter().chain(&OUTSIDE_LIBRARY).map(|id| vec![(*id).to_string()]).chain(std::iter::once(Vec::new())).collect()),
        "pairs" => Some(
            (0..PAIRED.len())
                .flat_map(|i| (i + 1..PAIRED.len()).map(move |j| vec![PAIRED[i].to_string(), PAIRED[j].to_string()]))
                .collect(),
        ),
        _ => None,
    }
}

/// What the user of a case already models: the usual three, creep in every second case, never what is hidden.
fn base_of(hidden: &[String], number: usize) -> Vec<String> {
    let mut base = vec!["hysteresis", "initial_curve", "vibration"];
    if number % 2 == 1 {
        base.push("creep");
    }
    // Without surfaces there is nothing that an initial curve could belong to.
    let without_surfaces = hidden.iter().any(|id| id == "hysteresis");
    let excluded = |id: &str| hidden.iter().any(|h| h == id) || (without_surfaces && id == "initial_curve");
    base.into_iter().filter(|id| !excluded(id)).map(String::from).collect()
}

/// A set of cases.
pub struct SetOrder {
    /// What is hidden, case by case.
    pub hidden: Vec<Vec<String>>,
    /// Strengths.
    pub strengths: Vec<f64>,
    /// Cases of each kind and strength.
    pub cases: usize,
    /// Structure of the hysteresis.
    pub hysteresis: String,
    /// Seed of the first case.
    pub seed: u64,
}

/// Simulates a set in `folder/case000`, ... with `folder/truth.json`.
///
/// # Errors
/// As [`plant`].
pub fn plant_set(order: &SetOrder, folder: &Path, progress: &(dyn Fn(&Truth) + Sync)) -> Result<Vec<Truth>> {
    let mut orders = Vec::new();
    for _ in 0..order.cases {
        for hidden in &order.hidden {
            // Nothing has no strength.
            let strengths = if hidden.is_empty() { &order.strengths[..1] } else { &order.strengths[..] };
            for strength in strengths {
                orders.push(Order {
                    hidden: hidden.iter().map(|id| (id.clone(), *strength)).collect(),
                    base: base_of(hidden, orders.len()),
                    hysteresis: order.hysteresis.clone(),
                    seed: order.seed.wrapping_add(orders.len() as u64),
                });
            }
        }
    }
    let truths = orders
        .par_iter()
        .enumerate()
        .map(|(i, one)| {
            let name = format!("case{i:03}");
            let truth = Truth { name: name.clone(), ..plant(one, &folder.join(&name))? };
            progress(&truth);
            Ok(truth)
        })
        .collect::<Result<Vec<Truth>>>()?;
    let path = folder.join("truth.json");
    let json = serde_json::to_string_pretty(&truths).map_err(|e| Problem::file(&path, e))?;
    write_whole(&path, (json + "\n").as_bytes())?;
    Ok(truths)
}
