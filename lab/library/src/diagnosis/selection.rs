//! Which of the fitted models the data cannot reject, and the simplest of them.
//!
//! # How it works
//! A model's losses are its mean squares by block of every judged record, held-out ones included; on fitted
//! records with what its free values take out of the noise added (Mallows' Cp). Models are compared two by
//! two on each record and on the weighted mean of all. Of two models the one with the larger loss is rejected
//! where the difference exceeds a margin that matters by more than chance brings: the difference in standard
//! errors against the largest that a moving-block bootstrap gives over all pairs and records, at 5 %
//! family-wise. The worst goes first, and the rest is compared again until none is rejected: the *model
//! confidence set* (Hansen, Lunde and Nason, Econometrica 79, 2011).
//!
//! The margin is 2 % of the error at the noise; where the best model stays above the noise, the library lacks
//! something that is larger than any difference below a share of that remainder, and the margin grows by it.

use super::judgement::Judged;
use super::pool::Pool;
use super::study::Study;
use crate::identification::fit::{blocks, dot};
use hysteron_sim::chain::Model;
use nalgebra::DMatrix;
use rand::{Rng, SeedableRng};
use rand_pcg::Pcg64Mcg;
use std::collections::{BTreeMap, BTreeSet};

/// Mean squares of a model by block, of every judged record.
#[derive(Clone, Debug, PartialEq)]
pub struct Losses(Vec<Vec<f64>>);

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

    fn mean(&self, record: usize) -> f64 {
        let blocks = &self.0[record];
        blocks.iter().sum::<f64>() / blocks.len().max(1) as f64
    }
}

/// Whether a model stays, and by how many standard errors beyond the margin it is rejected where it does not.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Fate {
    /// The data cannot reject it.
    Kept,
    /// Another one does better by more than the margin, by so many standard errors.
    Rejected(f64),
}

/// How losses are compared: units, weights and margins by record.
pub struct Scale {
    /// Weight of each record in the whole.
    weights: Vec<f64>,
    /// Which records are held out.
    held_out: Vec<bool>,
    /// Mean square of the best model on each record, um^2, not below its noise.
    unit_um2: Vec<f64>,
    /// Differences below this many units do not matter, by record.
    margin: Vec<f64>,
    /// Held-out errors that differ by less than this share do not differ.
    same_held_out: f64,
    /// A mean square below this share of another needs no test.
    beyond_chance: f64,
}

/// Resamples of the blocks.
const RESAMPLES: usize = 400;
/// Neighbouring blocks that are drawn together: what rings beyond one block is not cut.
const DRAWN_TOGETHER: usize = 3;

/// The confidence set of models by their losses: a function of these alone. `size` is the probability that
/// anything is rejected where nothing differs, over all models and records together.
#[must_use]
pub fn confidence_set(losses: &[&Losses], scale: &Scale, size: f64, seed: u64) -> Vec<Fate> {
    Compared::of(scale, losses, seed).eliminated(size)
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
            .map(|r| margin(study, noise_um2(r), unit_um2[r]))
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
fn margin(study: &Study, noise_um2: Option<f64>, of_um2: f64) -> f64 {
    let policy = &study.policy;
    let remains = noise_um2.map_or(1.0, |noise_um2| 1.0 - noise_um2 / of_um2);
    (policy.matters_at_noise * (1.0 - remains) + policy.matters_of_remainder * remains)
        .max(policy.matters_at_noise)
}

/// RMS of the least difference that matters between models that leave so much.
#[must_use]
pub fn least_difference_um(study: &Study, error_um: f64) -> f64 {
    let noise_um2 = study.floor_um.map(|um| (study.as_the_noise() * um).powi(2));
    let of_um2 = (error_um * error_um).max(noise_um2.unwrap_or(f64::MIN_POSITIVE));
    (margin(study, noise_um2, of_um2) * of_um2).sqrt()
}

/// Losses in units of the best, with their resamples.
struct Compared {
    /// By what they are compared (each record, then all), by model.
    means: Vec<Vec<f64>>,
    /// The same of each resample.
    resampled: Vec<Vec<Vec<f64>>>,
    /// The weighted mean of the held-out records, by model.
    held_out: Vec<f64>,
    margins: Vec<f64>,
    same_held_out: f64,
    beyond_chance: f64,
}

impl Compared {
    fn of(scale: &Scale, losses: &[&Losses], seed: u64) -> Self {
        let (records, models) = (scale.weights.len(), losses.len());
        let mut random = Pcg64Mcg::seed_from_u64(seed);
        let mut means = vec![vec![0.0; models]; records + 1];
        let mut resampled = vec![vec![vec![0.0; models]; RESAMPLES]; records + 1];
        let mut held_out = vec![0.0; models];
        for r in 0..records {
            let count = losses[0].0[r].len();
            let drawn = draws(count, &mut random);
            let blocks =
                DMatrix::from_fn(count, models, |b, m| losses[m].0[r][b] / scale.unit_um2[r]);
            let of_draws = drawn * &blocks;
            for m in 0..models {
                means[r][m] = blocks.column(m).mean();
                means[records][m] += scale.weights[r] * means[r][m];
                held_out[m] += if scale.held_out[r] {
                    scale.weights[r] * means[r][m]
                } else {
                    0.0
                };
                for t in 0..RESAMPLES {
                    resampled[r][t][m] = of_draws[(t, m)];
                    resampled[records][t][m] += scale.weights[r] * of_draws[(t, m)];
                }
            }
        }
        let all = scale
            .weights
            .iter()
            .zip(&scale.margin)
            .map(|(w, m)| w * m)
            .sum();
        Self {
            means,
            resampled,
            held_out,
            margins: scale.margin.iter().copied().chain([all]).collect(),
            same_held_out: scale.same_held_out,
            beyond_chance: scale.beyond_chance,
        }
    }

    /// By how many standard errors one model is worse than another beyond the margin, and the same of every
    /// resample beside its own mean. On one record alone a model counts as worse only if it is also worse
    /// on the mean of all, and the other is not worse on the held-out records.
    fn worse(&self, one: usize, other: usize) -> (f64, Vec<f64>) {
        let all = self.means.len() - 1;
        let mut most = f64::NEG_INFINITY;
        let mut by_chance = vec![f64::NEG_INFINITY; RESAMPLES];
        let in_all = self.means[all][one] - self.means[all][other];
        let holds = self.held_out[other] <= (1.0 + self.same_held_out) * self.held_out[one];
        // Of a few events, as of a ring behind each of some steps, resamples say little; an error that
        // doubles needs no test.
        if self.means[all][other] < self.beyond_chance * self.means[all][one] {
            most = f64::INFINITY;
        }
        for k in 0..=all {
            let by = self.means[k][one] - self.means[k][other];
            let resampled: Vec<f64> = self.resampled[k]
                .iter()
                .map(|m| m[one] - m[other] - by)
                .collect();
            let error = (resampled.iter().map(|d| d * d).sum::<f64>() / RESAMPLES as f64).sqrt();
            if error <= 0.0 {
                continue;
            }
            if k == all || (in_all > 0.0 && holds) {
                most = most.max((by - self.margins[k]) / error);
            }
            by_chance
                .iter_mut()
                .zip(resampled)
                .for_each(|(m, d)| *m = m.max(d / error));
        }
        (most, by_chance)
    }

    /// Rejects the worst until none is worse than another by more than chance.
    fn eliminated(&self, size: f64) -> Vec<Fate> {
        let models = self.means[0].len();
        let pairs: Vec<Vec<(f64, Vec<f64>)>> = (0..models)
            .map(|one| (0..models).map(|other| self.worse(one, other)).collect())
            .collect();
        let mut out = vec![Fate::Kept; models];
        let mut left: BTreeSet<usize> = (0..models).collect();
        while left.len() > 1 {
            let worst_of = |one: &usize| {
                left.iter()
                    .filter(|o| *o != one)
                    .map(|o| pairs[*one][*o].0)
                    .fold(f64::NEG_INFINITY, f64::max)
            };
            let mut by_chance: Vec<f64> = vec![f64::NEG_INFINITY; RESAMPLES];
            for (one, other) in left
                .iter()
                .flat_map(|a| left.iter().map(move |b| (*a, *b)))
                .filter(|(a, b)| a != b)
            {
                by_chance
                    .iter_mut()
                    .zip(&pairs[one][other].1)
                    .for_each(|(m, d)| *m = m.max(*d));
            }
            by_chance.sort_by(f64::total_cmp);
            let critical = by_chance[((1.0 - size) * RESAMPLES as f64) as usize];
            let Some((worst, by)) = left
                .iter()
                .map(|one| (*one, worst_of(one)))
                .max_by(|a, b| a.1.total_cmp(&b.1))
            else {
                break;
            };
            if by <= critical {
                break;
            }
            left.remove(&worst);
            out[worst] = Fate::Rejected(by);
        }
        out
    }
}

/// How often each block is drawn in every resample: neighbours together, around the end to the beginning.
fn draws(count: usize, random: &mut Pcg64Mcg) -> DMatrix<f64> {
    let mut out = DMatrix::zeros(RESAMPLES, count);
    let together = DRAWN_TOGETHER.min(count.max(1));
    for t in 0..RESAMPLES {
        let mut drawn = 0;
        while drawn < count {
            let from = random.random_range(0..count);
            for k in 0..together.min(count - drawn) {
                out[(t, (from + k) % count)] += 1.0 / count as f64;
                drawn += 1;
            }
        }
    }
    out
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

#[cfg(test)]
mod tests {
    use super::*;

    /// One fitted record rejects no model in favour of another that is worse on held-out records.
    #[test]
    fn what_a_fitted_record_shows_alone_must_hold_out() {
        let scale = Scale {
            weights: vec![1.0 / 3.0, 2.0 / 3.0],
            held_out: vec![false, true],
            unit_um2: vec![1.0; 2],
            margin: vec![1.0; 2],
            same_held_out: 0.04,
            beyond_chance: 0.25,
        };
        let blocks = |level: f64| {
            (0..60)
                .map(|b| level * (1.0 + 0.1 * f64::from(b % 7)))
                .collect::<Vec<f64>>()
        };
        let without = Losses(vec![blocks(3.6), blocks(1.0)]);
        let fates = |held_out: f64| {
            let with = Losses(vec![blocks(1.0), blocks(held_out)]);
            confidence_set(&[&without, &with], &scale, 0.05, 1)
        };
        assert!(matches!(fates(1.0)[..], [Fate::Rejected(_), Fate::Kept]));
        assert_eq!(fates(1.1), [Fate::Kept; 2]);
    }

    fn scale(records: usize, margin: f64) -> Scale {
        Scale {
            weights: vec![1.0 / records as f64; records],
            held_out: vec![false; records],
            unit_um2: vec![1.0; records],
            margin: vec![margin; records],
            same_held_out: 0.04,
            beyond_chance: 0.25,
        }
    }

    /// Mean squares by block around a level, each block off by chance.
    fn around(level: f64, random: &mut Pcg64Mcg) -> Losses {
        Losses(vec![
            (0..60)
                .map(|_| level * (1.0 + 0.3 * (random.random::<f64>() - 0.5)))
                .collect(),
        ])
    }

    #[test]
    fn equal_models_are_rejected_in_few_sets_of_any_number() {
        let mut random = Pcg64Mcg::seed_from_u64(7);
        for models in [2, 6, 12] {
            let sets = 60;
            let rejecting = (0..sets)
                .filter(|seed| {
                    let losses: Vec<Losses> =
                        (0..models).map(|_| around(1.0, &mut random)).collect();
                    let all: Vec<&Losses> = losses.iter().collect();
                    let fates = confidence_set(&all, &scale(1, 0.0), 0.05, *seed);
                    fates.iter().any(|fate| *fate != Fate::Kept)
                })
                .count();
            assert!(rejecting <= 9, "{rejecting} of {sets} sets of {models}");
        }
    }

    #[test]
    fn a_model_beyond_the_margin_is_rejected_whatever_stands_beside_it() {
        let mut random = Pcg64Mcg::seed_from_u64(8);
        let levels = [1.0, 1.02, 1.3, 5.0];
        let losses = levels.map(|level| around(level, &mut random));
        let fates = confidence_set(&losses.each_ref(), &scale(1, 0.1), 0.05, 1);
        assert_eq!(fates[..2], [Fate::Kept; 2], "{fates:?}");
        assert!(
            matches!(fates[2], Fate::Rejected(by) if by.is_finite()),
            "{fates:?}"
        );
        assert_eq!(fates[3], Fate::Rejected(f64::INFINITY));
        // The same whatever the order.
        let [a, b, c, d] = &losses;
        let turned = confidence_set(&[d, c, b, a], &scale(1, 0.1), 0.05, 1);
        assert_eq!(turned.iter().rev().copied().collect::<Vec<_>>(), fates);
        assert_eq!(confidence_set(&[a], &scale(1, 0.1), 0.05, 1), [Fate::Kept]);
    }
}
