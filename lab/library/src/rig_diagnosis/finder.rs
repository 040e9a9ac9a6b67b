//! The search: a pool of models that have some effects more than the start, and what the data say of them.
//!
//! # How it works
//! Each level adds every effect to the best models of the level before, fits the values of all added effects,
//! and keeps every model. The search ends at the noise, or where a level lowers the rank no further. Then each
//! effect of the simplest models that the data cannot reject is removed, and exchanged for every other, until
//! these models stay the same. What they have in common is named, if the data reject the best model without it
//! that has no more effects.

use super::fit::{RigFit, RigValues};
use super::recordings::{RigData, RigResiduals};
use crate::diagnosis::confidence_set::{Fate, Losses, confidence_set};
use crate::diagnosis::policy::Policy;
use crate::error::{Error, Result};
use crate::identification::budget::SEARCH_ENDS_AT;
use crate::parallel;
use crate::watch::{Watch, WatchEvent};
use hysteron_sim::rig_effects::RIG_EFFECTS;
use hysteron_sim::stick_slip::StickSlipActuator;
use std::collections::BTreeMap;

/// Further fits of the best model of a level, at most, and the fall of its rank that ends them. Without these
/// the example `rig_diagnosis` ends a stiffness of the contact (seed 15) at 1.18 times the noise, with a false
/// name beside it.
const ENDS_MAX: usize = 8;
const LEAST_FALL: f64 = 0.01;

/// Places in [`RIG_EFFECTS`], ascending.
pub type Added = Vec<usize>;

/// A model of the pool.
#[derive(Clone, Debug)]
pub struct Entry {
    /// The values of effects and contact.
    pub values: RigValues,
    /// Its contact was free too.
    is_finished: bool,
    /// What it misses of every reading.
    pub residuals: RigResiduals,
    /// Its losses.
    pub losses: Losses,
    /// Mean logarithm of its error over the noise; less is better.
    pub rank: f64,
    /// Its physics excludes a value.
    pub is_excluded: bool,
}

/// Data, start and every model that was fitted.
pub struct RigPool<'a> {
    /// What was recorded.
    pub data: &'a RigData,
    /// The rig that the search begins with.
    pub start: &'a StickSlipActuator,
    /// Thresholds.
    pub policy: &'a Policy,
    watch: &'a dyn Watch,
    /// The models by what was added.
    pub entries: BTreeMap<Added, Entry>,
    /// The time was over before the search was.
    pub out_of_time: bool,
}

/// Fits models with more effects than the start. Gives all of them, and the simplest that the data cannot reject.
///
/// # Errors
/// The start's simulation has no finite value.
pub fn search<'a>(
    data: &'a RigData,
    start: &'a StickSlipActuator,
    policy: &'a Policy,
    watch: &'a dyn Watch,
) -> Result<(RigPool<'a>, Vec<Added>)> {
    let mut pool = RigPool {
        data,
        start,
        policy,
        watch,
        entries: BTreeMap::new(),
        out_of_time: false,
    };
    let fit = RigFit::new(data, start, &[]);
    let entry = pool.judged(&fit, pool.of_start(), false);
    if !entry.rank.is_finite() {
        let message =
            "the simulation of the rig has no finite value under this drive; check its values";
        return Err(Error::new(&data.name, message));
    }
    pool.entries.insert(Vec::new(), entry);
    pool.finish_best(0);
    pool.grow();
    let mut simplest = pool.simplest();
    for _ in 0..policy.closures_max {
        let neighbours = simplest.iter().flat_map(neighbours).collect();
        if !pool.fit_all(neighbours) {
            break;
        }
        (0..=policy.effects_max).for_each(|level| pool.finish_best(level));
        simplest = pool.simplest();
    }
    Ok((pool, simplest))
}

/// The same effects without one, and with another in its place.
fn neighbours(added: &Added) -> Vec<(Added, usize)> {
    let mut out = Vec::new();
    for removed in added {
        let rest: Added = added.iter().copied().filter(|nth| nth != removed).collect();
        if let Some(last) = rest.last() {
            out.push((rest.clone(), *last));
        }
        let others = (0..RIG_EFFECTS.len()).filter(|other| !added.contains(other));
        out.extend(others.map(|other| (with(&rest, other), other)));
    }
    out
}

/// The same effects and one more.
fn with(added: &Added, nth: usize) -> Added {
    let mut out = added.clone();
    out.push(nth);
    out.sort_unstable();
    out
}

/// What is added, by name.
#[must_use]
pub fn names(added: &Added) -> Vec<String> {
    added
        .iter()
        .map(|nth| RIG_EFFECTS[*nth].id.to_owned())
        .collect()
}

impl RigPool<'_> {
    /// The search must end.
    fn is_over(&mut self) -> bool {
        self.out_of_time |= self.watch.time_used() > SEARCH_ENDS_AT;
        self.out_of_time || self.watch.stopped()
    }

    /// Somebody stopped it.
    #[must_use]
    pub fn was_stopped(&self) -> bool {
        self.watch.stopped()
    }

    fn of_start(&self) -> RigValues {
        RigValues {
            effects: self.start.effects,
            ..RigValues::default()
        }
    }

    fn judged(&self, fit: &RigFit, values: RigValues, is_finished: bool) -> Entry {
        let residuals = self.data.residuals(&fit.rig(&values), &|_| true);
        let losses = self.data.losses(&residuals, fit.free_values());
        let weights = self.data.weights(self.policy);
        let squares = (0..weights.len()).map(|r| (weights[r], losses.mean(r).max(1.0)));
        Entry {
            rank: squares
                .map(|(weight, square)| 0.5 * weight * square.ln())
                .sum(),
            is_excluded: fit.is_at_an_end(&values),
            is_finished,
            residuals,
            losses,
            values,
        }
    }

    /// Fits the best models of a level with their contacts free, until the best are those.
    fn finish_best(&mut self, level: usize) {
        let count = self.policy.compared_of_a_level;
        loop {
            let best = self.admissible(level).into_iter().take(count);
            let open: Vec<Added> = best
                .filter(|added| !self.entries[*added].is_finished)
                .cloned()
                .collect();
            if open.is_empty() || self.is_over() {
                break;
            }
            let finished = parallel::map(&open, |added| self.finished(added));
            self.entries.extend(open.into_iter().zip(finished));
        }
        self.end_best(level);
    }

    /// Fits the best model of a level again and again, until it is at the noise or falls no further.
    fn end_best(&mut self, level: usize) {
        for _ in 0..ENDS_MAX {
            let Some(best) = self.admissible(level).first().copied().cloned() else {
                return;
            };
            let before = self.entries[&best].rank;
            if self.is_at_the_noise(&self.entries[&best]) || self.is_over() {
                return;
            }
            let further = self.finished(&best);
            if before - further.rank < LEAST_FALL {
                return;
            }
            self.entries.insert(best, further);
        }
    }

    /// A model fitted further with its contact free.
    fn finished(&self, added: &Added) -> Entry {
        let fit = RigFit::new(self.data, self.start, added).with_contact();
        let values = fit.refined(&self.entries[added].values);
        self.judged(&fit, values, true)
    }

    /// Fits sets of effects that are not in the pool, each begun at the best smaller set with another effect
    /// at its guesses. Gives whether there was any.
    fn fit_all(&mut self, mut sets: Vec<(Added, usize)>) -> bool {
        sets.sort();
        sets.dedup_by(|a, b| a.0 == b.0);
        sets.retain(|(added, _)| !self.entries.contains_key(added));
        if sets.is_empty() || self.is_over() {
            return false;
        }
        let beside = sets.first().map_or_else(Vec::new, |(added, newest)| {
            names(&added.iter().copied().filter(|nth| nth != newest).collect())
        });
        let candidates = sets.len();
        self.watch.event(&WatchEvent::Scoring {
            candidates,
            beside: &beside,
        });
        let sets = self.promising(sets);
        let fitted = parallel::map(&sets, |(added, from)| {
            let fit = RigFit::new(self.data, self.start, added);
            self.judged(&fit, fit.refined(from), false)
        });
        for ((added, _), entry) in sets.into_iter().zip(fitted) {
            let errors = self.data.errors(&entry.residuals);
            let best = self.entries.values().all(|other| entry.rank < other.rank);
            self.watch.event(&WatchEvent::Tried {
                added: &names(&added),
                identify_rms_um: errors.identify,
                validate_rms_um: errors.validate,
                best,
            });
            self.entries.insert(added, entry);
        }
        true
    }

    /// The best guesses at the newest effect of each set, of the most promising sets.
    fn promising(&self, sets: Vec<(Added, usize)>) -> Vec<(Added, RigValues)> {
        let guessed = parallel::map(&sets, |(added, newest)| {
            let fit = RigFit::new(self.data, self.start, added);
            let rest: Added = added.iter().copied().filter(|nth| nth != newest).collect();
            let from = self.entries.get(&rest);
            let from = from.map_or_else(|| self.of_start(), |entry| entry.values);
            (rest, fit.guessed(&from, *newest))
        });
        let mut of_rest: BTreeMap<Added, Vec<(f64, Added, RigValues)>> = BTreeMap::new();
        for ((added, _), (rest, (cost, guess))) in sets.into_iter().zip(guessed) {
            of_rest.entry(rest).or_default().push((cost, added, guess));
        }
        let kept = of_rest.into_iter().flat_map(|(rest, mut sets)| {
            sets.sort_by(|a, b| a.0.total_cmp(&b.0));
            let all = rest.is_empty();
            let count = if all { sets.len() } else { self.policy.singles };
            sets.into_iter().take(count)
        });
        kept.map(|(_, added, guess)| (added, guess)).collect()
    }

    /// Every reading is at the noise.
    #[must_use]
    pub fn is_at_the_noise(&self, entry: &Entry) -> bool {
        let bound = self.data.as_the_noise(self.policy).powi(2);
        let readings = self.data.readings.iter().enumerate();
        readings
            .into_iter()
            .all(|(r, reading)| reading.noise_um.is_some() && entry.losses.mean(r) < bound)
    }

    /// Models of so many effects, the best first.
    fn ranked(&self, level: usize) -> Vec<&Added> {
        let of_level = self
            .entries
            .iter()
            .filter(|(added, _)| added.len() == level);
        let mut ranked: Vec<_> = of_level.collect();
        ranked.sort_by(|a, b| a.1.rank.total_cmp(&b.1.rank));
        ranked.into_iter().map(|(added, _)| added).collect()
    }

    /// Of these, the models of which no value is excluded.
    fn admissible(&self, level: usize) -> Vec<&Added> {
        let mut ranked = self.ranked(level);
        ranked.retain(|added| !self.entries[*added].is_excluded);
        ranked
    }

    fn grow(&mut self) {
        for level in 0..self.policy.effects_max {
            let parents: Vec<Added> = self
                .ranked(level)
                .into_iter()
                .take(self.policy.width)
                .cloned()
                .collect();
            let Some(best) = parents.first().map(|added| self.entries[added].clone()) else {
                return;
            };
            if self.is_at_the_noise(&best) {
                return;
            }
            let children = parents.iter().flat_map(|added| {
                let others = (0..RIG_EFFECTS.len()).filter(|nth| !added.contains(nth));
                others
                    .map(|nth| (with(added, nth), nth))
                    .collect::<Vec<_>>()
            });
            if !self.fit_all(children.collect()) {
                return;
            }
            self.finish_best(level + 1);
            let lowest = self
                .ranked(level + 1)
                .first()
                .map(|added| self.entries[*added].rank);
            if lowest.is_none_or(|rank| best.rank - rank < self.policy.least_gain) {
                return;
            }
        }
    }

    /// What the data say of some models.
    #[must_use]
    pub fn fates(&self, models: &[&Added]) -> Vec<Fate> {
        let losses: Vec<&Losses> = models
            .iter()
            .map(|added| &self.entries[*added].losses)
            .collect();
        let scale = self.data.scale(&losses, self.policy);
        confidence_set(&losses, &scale, self.policy.family_wise, self.policy.seed)
    }

    /// The simplest models that the data cannot reject, the best first.
    fn simplest(&self) -> Vec<Added> {
        let most = self.entries.keys().map(Vec::len).max().unwrap_or(0);
        let finalists: Vec<&Added> = (0..=most)
            .flat_map(|level| {
                let allowed = self.admissible(level).into_iter();
                allowed
                    .take(self.policy.compared_of_a_level)
                    .collect::<Vec<_>>()
            })
            .collect();
        let fates = self.fates(&finalists);
        let kept: Vec<&Added> = finalists
            .into_iter()
            .zip(fates)
            .filter(|(_, fate)| *fate == Fate::Kept)
            .map(|(added, _)| added)
            .collect();
        let fewest = kept.iter().map(|added| added.len()).min().unwrap_or(0);
        let mut simplest: Vec<Added> = kept
            .into_iter()
            .filter(|added| added.len() == fewest)
            .cloned()
            .collect();
        simplest.sort_by(|a, b| self.entries[a].rank.total_cmp(&self.entries[b].rank));
        simplest
    }

    /// The best model without any of these effects that has no more than so many.
    #[must_use]
    pub fn best_without(&self, without: &[usize], most: usize) -> Option<&Added> {
        let allowed = self.entries.iter().filter(|(added, entry)| {
            added.len() <= most
                && !entry.is_excluded
                && !added.iter().any(|nth| without.contains(nth))
        });
        allowed
            .min_by(|a, b| a.1.rank.total_cmp(&b.1.rank))
            .map(|(added, _)| added)
    }
}
