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
use super::policy::Policy;
use super::pool::{Entry, Pool};
use super::study::Study;
use crate::identification::fit::{blocks, dot};
use hysteron_sim::chain::Model;
use nalgebra::DMatrix;
use rand::{Rng, SeedableRng};
use rand_pcg::Pcg64Mcg;
use std::collections::BTreeSet;

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

/// What two models are compared on: one record, or all.
struct Scale {
    /// Weight of each record in the whole.
    weights: Vec<f64>,
    /// Which records are held out.
    held_out: Vec<bool>,
    /// Mean square of the best model on each record, um^2, not below its noise.
    unit_um2: Vec<f64>,
    /// Differences below this many units do not matter, by record.
    margin: Vec<f64>,
}

/// Resamples of the blocks.
const RESAMPLES: usize = 400;
/// Neighbouring blocks that are drawn together: what rings beyond one block is not cut.
const DRAWN_TOGETHER: usize = 3;

/// The confidence set of models by their losses.
#[must_use]
pub fn confidence_set(study: &Study, losses: &[&Losses]) -> Vec<Fate> {
    let scale = Scale::of(study, losses);
    let compared = Compared::of(&scale, losses, &study.policy);
    compared.eliminated(&study.policy)
}

/// Whether the data reject a model beside another.
#[must_use]
pub fn rejects(study: &Study, one: &Judged, beside: &Judged) -> bool {
    let losses = [one, beside].map(|judged| Losses::of_judged(study, judged));
    confidence_set(study, &losses.each_ref())[0] != Fate::Kept
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
            .map(|r| {
                let remains = noise_um2(r).map_or(1.0, |noise_um2| 1.0 - noise_um2 / unit_um2[r]);
                (policy.matters_at_noise * (1.0 - remains) + policy.matters_of_remainder * remains)
                    .max(policy.matters_at_noise)
            })
            .collect();
        let is_held_out = |i: &usize| !study.split.identify.contains(i);
        Self {
            weights: both.iter().map(weight).collect(),
            held_out: both.iter().map(is_held_out).collect(),
            unit_um2,
            margin,
        }
    }
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
}

impl Compared {
    fn of(scale: &Scale, losses: &[&Losses], policy: &Policy) -> Self {
        let (records, models) = (scale.weights.len(), losses.len());
        let mut random = Pcg64Mcg::seed_from_u64(policy.seed);
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
        }
    }

    /// By how many standard errors one model is worse than another beyond the margin, and the same of every
    /// resample beside its own mean. On one record alone a model counts as worse only if it is also worse
    /// on the mean of all, and the other is not worse on the held-out records.
    fn worse(&self, one: usize, other: usize, policy: &Policy) -> (f64, Vec<f64>) {
        let all = self.means.len() - 1;
        let mut most = f64::NEG_INFINITY;
        let mut by_chance = vec![f64::NEG_INFINITY; RESAMPLES];
        let in_all = self.means[all][one] - self.means[all][other];
        let holds = self.held_out[other] <= (1.0 + policy.matters_at_noise) * self.held_out[one];
        // Of a few events, as of a ring behind each of some steps, resamples say little; an error that
        // doubles needs no test.
        let kept_share = 1.0 - policy.beyond_chance;
        if self.means[all][other] < kept_share * kept_share * self.means[all][one] {
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
    fn eliminated(&self, policy: &Policy) -> Vec<Fate> {
        let models = self.means[0].len();
        let pairs: Vec<Vec<(f64, Vec<f64>)>> = (0..models)
            .map(|one| {
                (0..models)
                    .map(|other| self.worse(one, other, policy))
                    .collect()
            })
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
            let critical = by_chance[((1.0 - policy.family_wise) * RESAMPLES as f64) as usize];
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

/// What a selection came to: keys of the pool.
#[derive(Clone, Debug, Default)]
pub struct Selected {
    /// The simplest models that the data cannot reject, best first.
    pub minimal: Vec<String>,
    /// Models that were compared and rejected, with the standard errors.
    pub rejected: Vec<(String, f64)>,
}

/// The simplest models of a pool that the data cannot reject: of those with the fewest moves that are kept,
/// all. `forgiven` are not rejected whatever their losses: the effect that another has beside them is not
/// seen beyond chance.
#[must_use]
pub fn select(pool: &mut Pool, forgiven: &BTreeSet<String>) -> Selected {
    pool.compare_best();
    let policy = pool.study.policy.clone();
    // Models are compared with the best that is what it is called, fitted as far as the others.
    let admissible = |pool: &Pool| {
        pool.ranked()
            .into_iter()
            .find(|(_, e)| !e.is_excluded())
            .map(|(k, _)| k.clone())
    };
    while let Some(key) = admissible(pool).filter(|k| !pool.entries[k].compared) {
        pool.compare(&[key]);
    }
    // What no test could keep is not compared: the merit is a logarithm of the error.
    let most = |pool: &Pool| {
        let best = admissible(pool).map_or_else(|| pool.best(), |k| &pool.entries[&k]);
        let margin = if pool.study.near_the_noise(&best.judged) {
            policy.matters_at_noise
        } else {
            policy.matters_of_remainder
        };
        best.merit + 0.5 * (1.0 + margin).ln() + policy.in_contention
    };
    let levels: BTreeSet<usize> = pool.entries.values().map(|e| e.moves.len()).collect();
    let mut rejected: Vec<(String, f64)> = Vec::new();
    for level in levels {
        let limit = most(pool);
        let in_contention = |pool: &Pool| -> Vec<String> {
            let of_level = |(_, e): &(&String, &Entry)| {
                e.moves.len() == level && !e.is_excluded() && (e.merit < limit)
            };
            let ranked = pool.ranked();
            ranked
                .into_iter()
                .filter(of_level)
                .take(policy.compared_of_a_level)
                .map(|(k, _)| k.clone())
                .collect()
        };
        pool.compare(&in_contention(pool));
        let mut models = in_contention(pool);
        let best = pool
            .ranked()
            .into_iter()
            .find(|(_, e)| !e.is_excluded() && e.compared)
            .map(|(k, _)| k.clone());
        let of_level = models.len();
        models.extend(best.filter(|b| !models.contains(b)));
        if of_level == 0 {
            continue;
        }
        pool.weigh(&models);
        let losses: Vec<&Losses> = models
            .iter()
            .filter_map(|k| pool.entries[k].losses.as_ref())
            .collect();
        let fates = confidence_set(pool.study, &losses);
        let mut minimal = Vec::new();
        for (key, fate) in models.into_iter().zip(fates).take(of_level) {
            match fate {
                Fate::Rejected(by) if !forgiven.contains(&key) => rejected.push((key, by)),
                _ => minimal.push(key),
            }
        }
        if !minimal.is_empty() {
            return Selected { minimal, rejected };
        }
    }
    Selected {
        minimal: Vec::new(),
        rejected,
    }
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
        };
        let blocks = |level: f64| {
            (0..60)
                .map(|b| level * (1.0 + 0.1 * f64::from(b % 7)))
                .collect::<Vec<f64>>()
        };
        let without = Losses(vec![blocks(3.6), blocks(1.0)]);
        let fates = |held_out: f64| {
            let with = Losses(vec![blocks(1.0), blocks(held_out)]);
            Compared::of(&scale, &[&without, &with], &Policy::default())
                .eliminated(&Policy::default())
        };
        assert!(matches!(fates(1.0)[..], [Fate::Rejected(_), Fate::Kept]));
        assert_eq!(fates(1.1), [Fate::Kept; 2]);
    }
}
