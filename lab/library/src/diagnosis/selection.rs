//! Which of the fitted models the data cannot reject ([`super::confidence_set`]), and the simplest of them.
//!
//! # How it works
//! Losses are taken on held-out records as well; on fitted records what a model's free values take out of the
//! noise is added (Mallows' Cp). The margin is 2 % of the error at the noise; where the best model stays above
//! the noise, the library lacks something that is larger than any difference below a share of that remainder,
//! and the margin grows by it.

use super::confidence_set::{Fate, Losses, Scale, confidence_set};
use super::judgement::Judged;
use super::policy::Policy;
use super::pool::{Entry, Move, Pool};
use super::study::Study;
use crate::identification::fit::{blocks, dot};
use hysteron_sim::chain::Model;
use std::collections::BTreeMap;

impl Losses {
    /// Of a fitted model, on all judged samples.
    #[must_use]
    pub fn of(study: &Study, model: Model) -> Self {
        Self::of_judged(study, &study.judged(model))
    }

    /// Of a model that was judged on all samples.
    #[must_use]
    pub fn of_judged(study: &Study, judged: &Judged) -> Self {
        let both = study.split.both();
        let fitted_samples: usize = study
            .split
            .identify
            .iter()
            .map(|i| judged.residuals[*i].len())
            .sum();
        let values = judged
            .model
            .effects
            .iter()
            .flat_map(|e| &e.parameters)
            .filter(|p| !p.parameter.fixed)
            .count();
        let of_record = |i: &usize| -> Vec<f64> {
            let left = &judged.residuals[*i];
            // What so many free values take out of the noise of the records that they were fitted to, given
            // back twice.
            let noise_um2 = study.floors_um[*i]
                .map_or_else(|| dot(left, left) / left.len().max(1) as f64, |um| um * um);
            let taken_um2 = if study.split.identify.contains(i) {
                2.0 * noise_um2 * values as f64 / fitted_samples.max(1) as f64
            } else {
                0.0
            };
            blocks(left.len())
                .into_iter()
                .map(|b| {
                    dot(&left[b.clone()], &left[b.clone()]) / b.len().max(1) as f64 + taken_um2
                })
                .collect()
        };
        Self(both.iter().map(of_record).collect())
    }
}

/// The confidence set of models on the records of a study.
#[must_use]
pub fn confidence_set_in(study: &Study, losses: &[&Losses]) -> Vec<Fate> {
    let (scale, policy) = (Scale::of(study, losses), &study.policy);
    confidence_set(losses, &scale, policy.family_wise, policy.seed)
}

/// Whether the data reject a model beside another.
#[must_use]
pub fn rejects(study: &Study, one: &Judged, beside: &Judged) -> bool {
    let losses = [one, beside].map(|judged| Losses::of_judged(study, judged));
    confidence_set_in(study, &losses.each_ref())[0] != Fate::Kept
}

impl Scale {
    fn of(study: &Study, losses: &[&Losses]) -> Self {
        let (both, policy) = (study.split.both(), &study.policy);
        let (fitted, held_out) = (study.split.identify.len(), study.split.validate.len());
        let of_held_out = if held_out == 0 {
            0.0
        } else {
            policy.held_out_weight
        };
        let weight = |i: &usize| {
            if study.split.identify.contains(i) {
                (1.0 - of_held_out) / fitted.max(1) as f64
            } else {
                of_held_out / held_out.max(1) as f64
            }
        };
        let least = |r: usize| {
            losses
                .iter()
                .map(|l| l.mean(r))
                .fold(f64::INFINITY, f64::min)
        };
        let noise_um2 =
            |r: usize| study.floors_um[both[r]].map(|um| (study.as_the_noise() * um).powi(2));
        let unit_um2: Vec<f64> = (0..both.len())
            .map(|r| {
                least(r)
                    .max(noise_um2(r).unwrap_or(0.0))
                    .max(f64::MIN_POSITIVE)
            })
            .collect();
        let margin = (0..both.len())
            .map(|r| margin(policy, noise_um2(r), unit_um2[r]))
            .collect();
        let is_held_out = |i: &usize| !study.split.identify.contains(i);
        Self {
            weights: both.iter().map(weight).collect(),
            held_out: both.iter().map(is_held_out).collect(),
            unit_um2,
            margin,
            same_held_out: policy.matters_at_noise,
            beyond_chance: (1.0 - policy.beyond_chance).powi(2),
        }
    }
}

/// The margin as a share of a mean square, in which the noise has a part.
pub fn margin(policy: &Policy, noise_um2: Option<f64>, of_um2: f64) -> f64 {
    let remains = noise_um2.map_or(1.0, |noise_um2| 1.0 - noise_um2 / of_um2);
    (policy.matters_at_noise * (1.0 - remains) + policy.matters_of_remainder * remains)
        .max(policy.matters_at_noise)
}

/// RMS of the least difference that matters between models that leave so much.
#[must_use]
pub fn least_difference_um(study: &Study, error_um: f64) -> f64 {
    let noise_um2 = study.floor_um.map(|um| (study.as_the_noise() * um).powi(2));
    let of_um2 = (error_um * error_um).max(noise_um2.unwrap_or(f64::MIN_POSITIVE));
    (margin(&study.policy, noise_um2, of_um2) * of_um2).sqrt()
}

/// The simplest models of a pool that the data cannot reject, best first, by their keys: of those with the
/// fewest moves that are kept, all. The finalists of all sizes are compared at once: the best few of each
/// number of moves that come near the best, no larger than this.
#[must_use]
pub fn select(pool: &mut Pool) -> Vec<String> {
    pool.compare_best();
    // Models are compared with the best that is what it is called, fitted as far as the others.
    while let Some(key) = admissible(pool).filter(|k| !pool.entries[k].compared) {
        pool.compare(&[key]);
    }
    loop {
        let finalists = finalists(pool);
        if finalists.iter().all(|k| pool.entries[k].compared) {
            pool.weigh(&finalists);
            return simplest_kept(pool, finalists);
        }
        // A model that was not fitted so far may fall behind, and another come in its place.
        pool.compare(&finalists);
    }
}

/// The best model of which no effect is excluded by its own physics.
fn admissible(pool: &Pool) -> Option<String> {
    let ranked = pool.ranked();
    let best = ranked.into_iter().find(|(_, e)| !e.is_excluded());
    best.map(|(k, _)| k.clone())
}

fn finalists(pool: &Pool) -> Vec<String> {
    let policy = &pool.study.policy;
    let best = admissible(pool).map_or_else(|| pool.best(), |k| &pool.entries[&k]);
    // What no test could keep is not compared: the merit is a logarithm of the error.
    let margin = if pool.study.near_the_noise(&best.judged) {
        policy.matters_at_noise
    } else {
        policy.matters_of_remainder
    };
    let limit = best.merit + 0.5 * (1.0 + margin).ln() + policy.in_contention;
    let mut of_level: BTreeMap<usize, usize> = BTreeMap::new();
    let mut out = Vec::new();
    for (key, entry) in pool.ranked() {
        let size = entry.moves.len();
        if entry.is_excluded() || entry.merit >= limit || size > best.moves.len() {
            continue;
        }
        let taken = of_level.entry(size).or_default();
        *taken += 1;
        if *taken <= policy.compared_of_a_level {
            out.push(key.clone());
        }
    }
    out
}

fn simplest_kept(pool: &Pool, finalists: Vec<String>) -> Vec<String> {
    let losses: Vec<&Losses> = finalists
        .iter()
        .filter_map(|k| pool.entries[k].losses.as_ref())
        .collect();
    let fates = confidence_set_in(pool.study, &losses);
    let size = |key: &String| pool.entries[key].moves.len();
    let kept: Vec<String> = finalists
        .into_iter()
        .zip(fates)
        .filter(|(_, fate)| *fate == Fate::Kept)
        .map(|(key, _)| key)
        .collect();
    let fewest = kept.iter().map(size).min().unwrap_or(0);
    kept.into_iter().filter(|k| size(k) == fewest).collect()
}

/// The model at the end of a search: the best of those that have all that one of the simplest has, where every move must
/// lower the error by the margin at the noise. It is the best once it is fitted to its end: a good held-out
/// error half way is chance.
#[must_use]
pub fn end(pool: &mut Pool, minimal: &[String]) -> Entry {
    let simplest: Vec<Vec<Move>> = minimal
        .iter()
        .map(|k| pool.entries[k].moves.clone())
        .collect();
    let margin = pool.study.policy.matters_at_noise;
    let has_all = |e: &Entry| {
        e.compared
            && simplest
                .iter()
                .any(|moves| moves.iter().all(|m| e.moves.contains(m)))
    };
    loop {
        let cost = |e: &Entry| pool.rank(e) + 0.5 * margin * e.moves.len() as f64;
        let ends = pool.entries.iter().filter(|(_, e)| has_all(e));
        let Some((key, _)) = ends.min_by(|a, b| cost(a.1).total_cmp(&cost(b.1))) else {
            return pool.best().clone();
        };
        let key = key.clone();
        let is_last = pool.entries[&key].finished || pool.study.budget.is_over();
        pool.finish(&key);
        if is_last {
            return pool.entries[&key].clone();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::{Dataset, Record, Role};
    use crate::diagnosis::pool::{added, key};
    use crate::identification::noise_floor::noise_floor;
    use crate::model_file::effects_named;
    use crate::watch::Unwatched;
    use hysteron_sim::chain::{EffectInstance, Model};
    use hysteron_sim::noise::WhiteNoise;

    /// A stage that moves 5 % further where it is held out. A fit that has not ended may stand there.
    #[test]
    fn a_fit_that_is_good_half_way_is_not_the_end() {
        let record = |name: &str, role: Role, gain: f64| {
            let drive_v: Vec<f64> = (0..2000)
                .map(|k| 50.0 - 50.0 * (0.006 * f64::from(k)).cos())
                .collect();
            let before_v = std::iter::once(0.0).chain(drive_v.iter().copied());
            let mut noise = WhiteNoise::new(0.002, name.len() as u64);
            let read_um = before_v
                .take(2000)
                .map(|v| gain * v + noise.next_um())
                .collect();
            Record::new(name, 1000.0, drive_v, read_um).with_role(role)
        };
        let records = vec![
            record("fitted", Role::Identify, 0.1),
            record("judging", Role::Validate, 0.105),
        ];
        let dataset = Dataset::new("d", 0.0, 100.0, records).unwrap();
        let (floor, policy) = (noise_floor(&dataset), Policy::default());
        let study = Study::new(&dataset, Vec::new(), &floor, policy, &Unwatched);
        let entry = |names: &str, moves: &[String], gain: f64| {
            let mut model = Model::new(0.0, 100.0);
            for effect in effects_named(names).unwrap() {
                let is_gain = effect.declaration().id == "gain";
                let values: &[f64] = if is_gain { &[gain] } else { &[] };
                model.add(EffectInstance::new(effect, &dataset.overview(), values));
            }
            Entry::new(&study, added(moves), study.judged_quickly(model), true)
        };
        let simplest = entry("gain", &[], 0.1);
        let keys = [key(&simplest.moves, &simplest.judged.model)];
        let mut pool = Pool::of(&study, &simplest.judged.model);
        pool.keep(simplest);
        pool.keep(entry("gain,delay", &["delay".to_owned()], 0.1049));
        assert_eq!(pool.best().added(), ["delay"]);
        assert!(end(&mut pool, &keys).added().is_empty());
    }
}
