//! Do the standard deviations tell the truth? The same actuator is measured again and again with fresh noise,
//! identified each time from a wrong start, and every parameter is compared with the one that made the data.

use hysteron::dataset::{Dataset, Record};
use hysteron::identification::fit::{Effort, fit};
use hysteron::identification::linearisation::free_parameters;
use hysteron::identification::uncertainty::estimate_uncertainty;
use hysteron_sim::chain::Model;
use hysteron_sim::noise::WhiteNoise;
use rayon::prelude::*;

/// What the repetitions came to.
#[derive(Clone, Debug, PartialEq)]
pub struct Coverage {
    /// Share of the estimates within three of their standard deviations of the truth, over parameters and
    /// seeds.
    pub within_three_sigma: f64,
    /// The same for the parameter for which it is lowest, with its name.
    pub worst: (String, f64),
    /// Identifications made.
    pub seeds: u64,
}

/// Measures `truth` with the drives of `template` and Gaussian noise once per seed, and identifies it.
///
/// Structure of truth and model are the same here: this is about noise, not about effects left out.
#[must_use]
pub fn coverage(truth: &Model, template: &Dataset, noise_um: f64, seeds: u64) -> Coverage {
    let free = free_parameters(truth);
    let clean: Vec<Vec<f64>> = template
        .records
        .iter()
        .map(|r| truth.simulate(&r.whole_drive()))
        .collect();
    let hits: Vec<Vec<bool>> = (0..seeds)
        .into_par_iter()
        .map(|seed| {
            let mut noise = WhiteNoise::new(noise_um, 90_000 + seed);
            let records: Vec<Record> = template
                .records
                .iter()
                .zip(&clean)
                .map(|(record, signal)| Record {
                    displacement_um: signal.iter().map(|y| y + noise.next_um()).collect(),
                    ..record.clone()
                })
                .collect();
            let data = Dataset {
                records,
                ..template.clone()
            };
            let all: Vec<usize> = (0..data.records.len()).collect();
            // A start that is wrong by a tenth, up and down in turn.
            let mut start = truth.clone();
            for (k, index) in free.iter().enumerate() {
                let value = &mut start.effects[index.effect].parameters[index.parameter];
                value.value = (value.value * if k % 2 == 0 { 1.1 } else { 0.9 })
                    .clamp(value.parameter.lower, value.parameter.upper);
            }
            let mut fitted = fit(
                &start,
                &data,
                &all,
                Effort {
                    relative: 0.0,
                    ..Effort::default()
                },
            )
            .model;
            estimate_uncertainty(&mut fitted, &data, &all);
            free.iter()
                .map(|index| {
                    let estimate = &fitted.effects[index.effect].parameters[index.parameter];
                    let true_value = truth.effects[index.effect].parameters[index.parameter].value;
                    estimate
                        .std
                        .is_some_and(|std| (estimate.value - true_value).abs() <= 3.0 * std)
                })
                .collect()
        })
        .collect();
    let share = |k: usize| hits.iter().filter(|h| h[k]).count() as f64 / seeds.max(1) as f64;
    let shares: Vec<f64> = (0..free.len()).map(share).collect();
    let worst = shares
        .iter()
        .enumerate()
        .min_by(|a, b| a.1.total_cmp(b.1))
        .map_or((String::new(), 1.0), |(k, s)| {
            let effect = &truth.effects[free[k].effect];
            (
                format!(
                    "{}.{}",
                    effect.id, effect.parameters[free[k].parameter].parameter.name
                ),
                *s,
            )
        });
    Coverage {
        within_three_sigma: shares.iter().sum::<f64>() / shares.len().max(1) as f64,
        worst,
        seeds,
    }
}
