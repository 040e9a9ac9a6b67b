//! What the simplest kept models have in common, and where they differ, with the evidence for each.

use super::judgement::Judged;
use super::pool::{Entry, Move, Pool};
use super::screening::Screening;
use super::selection::{Fate, confidence_set};
use super::study::Study;
use crate::error::Result;
use crate::outcome::{Evidence, Finding, Residuals};
use crate::parallel;
use hysteron_sim::chain::Model;
use hysteron_sim::effect::Doubt;
use std::collections::BTreeSet;

/// One thing that the simplest kept models have: the same move in all, or in each one of these.
#[derive(Clone, Debug, PartialEq)]
pub struct Slot {
    /// The moves, likeliest first.
    pub moves: Vec<Move>,
}

impl Slot {
    /// The effects that it says are missing.
    #[must_use]
    pub fn effects(&self) -> Vec<String> {
        self.of(|m| matches!(m, Move::Added(_)))
    }

    /// The effects of the prior model of which it says that values have changed.
    #[must_use]
    pub fn other_values_of(&self) -> Vec<String> {
        self.of(|m| matches!(m, Move::Freed(_)))
    }

    fn of(&self, kind: impl Fn(&Move) -> bool) -> Vec<String> {
        self.moves
            .iter()
            .filter(|m| kind(m))
            .map(|m| m.effect().to_owned())
            .collect()
    }
}

/// A slot with what was weighed for it.
#[derive(Clone)]
pub struct Weighed {
    /// What the models have.
    pub slot: Slot,
    /// The best model without any of it.
    pub without: Judged,
    /// Candidates on the residual of that model; none beside a prior model.
    pub screening: Option<Screening>,
    /// What speaks for it.
    pub evidence: Evidence,
    /// Key of the model without it.
    without_key: String,
}

impl Weighed {
    /// As a finding.
    #[must_use]
    pub fn finding(&self) -> Finding {
        Finding {
            effects: self.slot.effects(),
            or_other_values_of: self.slot.other_values_of(),
            evidence: self.evidence,
        }
    }

    /// By how much the error falls with it, um: the root of the difference of the mean squares, the larger of
    /// fitted and held-out records.
    #[must_use]
    pub fn fall_um(&self) -> f64 {
        let Evidence::Models { without, with, .. } = self.evidence else {
            return 0.0;
        };
        let fall = |before_um: f64, after_um: f64| {
            (before_um * before_um - after_um * after_um)
                .max(0.0)
                .sqrt()
        };
        let held_out = without
            .validate
            .zip(with.validate)
            .map_or(0.0, |(before_um, after_um)| fall(before_um, after_um));
        held_out.max(if without.validate.is_none() {
            fall(without.identify, with.identify)
        } else {
            0.0
        })
    }
}

/// What the simplest kept models, best first, have in common and where they differ.
#[must_use]
pub fn slots(minimal: &[&Entry]) -> Vec<Slot> {
    let Some((best, others)) = minimal.split_first() else {
        return Vec::new();
    };
    let mut out: Vec<Slot> = best
        .moves
        .iter()
        .map(|m| Slot {
            moves: vec![m.clone()],
        })
        .collect();
    for other in others {
        let place = |m: &Move, entry: &Entry| {
            entry
                .judged
                .model
                .effect(m.effect())
                .map(|e| e.effect.declaration().place)
        };
        let mut missing: Vec<usize> = (0..best.moves.len())
            .filter(|i| !other.moves.contains(&best.moves[*i]))
            .collect();
        let mut instead: Vec<&Move> = other
            .moves
            .iter()
            .filter(|m| !best.moves.contains(m))
            .collect();
        // Of several that differ, those that stand in the same order along the chain take each other's place.
        missing.sort_by_key(|i| place(&best.moves[*i], best));
        instead.sort_by_key(|m| place(m, other));
        for (i, by) in missing.into_iter().zip(instead) {
            if !out[i].moves.contains(by) {
                out[i].moves.push(by.clone());
            }
        }
    }
    let model_with = |m: &Move| {
        minimal
            .iter()
            .find(|e| e.moves.contains(m))
            .map(|e| &e.judged.model)
    };
    let speaks_against = |m: &Move| matches!(m, Move::Added(id) if model_with(m).is_some_and(|model| unlikely(model, id).is_some()));
    out.iter_mut()
        .for_each(|slot| slot.moves.sort_by_key(speaks_against));
    out
}

/// What the physics of an effect says against its values in a model.
#[must_use]
pub fn unlikely(model: &Model, id: &str) -> Option<String> {
    let (Doubt::RuledOut(because) | Doubt::Unlikely(because)) = model.doubt(id)?;
    Some(because)
}

/// Weighs each slot of the simplest kept models. The second part of what comes back are models that stand
/// after all: what a model has beside them is not seen beyond chance.
///
/// # Errors
/// A candidate that gives something that is no number.
pub fn weigh(pool: &mut Pool, minimal: &[String]) -> Result<(Vec<Weighed>, BTreeSet<String>)> {
    let entries: Vec<Entry> = minimal.iter().map(|k| pool.entries[k].clone()).collect();
    let Some(best) = entries.first() else {
        return Ok((Vec::new(), BTreeSet::new()));
    };
    let slots = slots(&entries.iter().collect::<Vec<_>>());
    let without: Vec<Option<String>> = slots.iter().map(|slot| best_without(pool, slot)).collect();
    let keys: Vec<String> = without
        .iter()
        .flatten()
        .cloned()
        .chain(minimal.first().cloned())
        .collect();
    pool.compare(&keys);
    pool.weigh(&keys);
    let study = pool.study;
    let cases: Vec<(usize, Slot, String)> = slots
        .into_iter()
        .zip(without)
        .enumerate()
        .filter_map(|(i, (slot, key))| key.map(|key| (i, slot, key)))
        .collect();
    let weighed = parallel::map(&cases, |(i, slot, key)| {
        one(study, pool, best, slot, key, *i as u64)
    });
    let mut weighed: Vec<Weighed> = weighed.into_iter().collect::<Result<_>>()?;
    weighed.sort_by(|a, b| study.merit(&b.without).total_cmp(&study.merit(&a.without)));
    let by_chance = |w: &&Weighed| {
        let Evidence::Models {
            p_value: Some(p), ..
        } = w.evidence
        else {
            return false;
        };
        let at_the_noise = study.floor_um.is_none()
            || w.without
                .within(study.policy.explained, &study.floors_um, &study.split);
        p > study.policy.family_wise && at_the_noise
    };
    let forgiven = weighed
        .iter()
        .filter(by_chance)
        .map(|w| w.without_key.clone())
        .collect();
    Ok((weighed, forgiven))
}

/// The best model of a pool that has nothing of a slot.
fn best_without(pool: &Pool, slot: &Slot) -> Option<String> {
    pool.ranked()
        .into_iter()
        .find(|(_, e)| !e.is_excluded() && slot.moves.iter().all(|m| !e.moves.contains(m)))
        .map(|(k, _)| k.clone())
}

fn one(
    study: &Study,
    pool: &Pool,
    best: &Entry,
    slot: &Slot,
    key: &str,
    seed: u64,
) -> Result<Weighed> {
    let without = &pool.entries[key];
    let losses = without
        .losses
        .as_ref()
        .zip(best.losses.as_ref().or_else(|| {
            pool.entries
                .get(&super::pool::key(&best.moves, &best.judged.model))?
                .losses
                .as_ref()
        }));
    let fate = losses.map_or(Fate::Kept, |(without, with)| {
        confidence_set(study, &[without, with])[0]
    });
    let standard_errors = if let Fate::Rejected(by) = fate {
        by
    } else {
        0.0
    };
    let (mut screening, mut p_value) = (None, None);
    if let Some(Move::Added(id)) = slot.moves.first().filter(|_| !best.held) {
        let model = &without.judged.model;
        let weighed = study.weigh(
            model,
            &study.candidates_for(model),
            study.policy.seed + seed,
        )?;
        // Loops stand in the place of a gain, which moves with all the rest once they are gone: their
        // signature says little, and the errors decide.
        let is_main = best
            .judged
            .model
            .effect(id)
            .is_some_and(|e| e.effect.declaration().is_main());
        let evidence = weighed
            .scores
            .iter()
            .find(|s| s.id == *id)
            .and_then(|s| s.evidence.as_ref());
        p_value = evidence.map(|e| e.p_adjusted).filter(|_| !is_main);
        screening = Some(weighed);
    }
    let evidence = Evidence::Models {
        without: Residuals::of(&without.judged),
        with: Residuals::of(&best.judged),
        standard_errors,
        p_value,
    };
    Ok(Weighed {
        slot: slot.clone(),
        without: without.judged.clone(),
        screening,
        evidence,
        without_key: key.to_owned(),
    })
}
