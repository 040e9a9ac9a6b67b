//! What the simplest kept models have in common, and where they differ, with the evidence for each: the best
//! model without it, for which a search of its own looked, beside the one with it.

use super::judgement::Judged;
use super::pool::{Entry, Move, Pool};
use super::screening::Screening;
use super::selection::{Fate, confidence_set_in};
use super::study::Study;
use crate::error::Result;
use crate::outcome::{Evidence, Finding, Residuals};
use crate::parallel;
use hysteron_sim::chain::Model;
use hysteron_sim::effect::Doubt;

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

/// Weighs each slot of the simplest kept models; what does not survive its test is left out.
///
/// # Errors
/// A candidate that gives something that is no number.
pub fn weigh(pool: &mut Pool, minimal: &[String]) -> Result<Vec<Weighed>> {
    let Some(best) = minimal.first() else {
        return Ok(Vec::new());
    };
    let entries: Vec<&Entry> = minimal.iter().map(|k| &pool.entries[k]).collect();
    let (slots, size) = (slots(&entries), entries[0].moves.len());
    let pair = |slot: &Slot| Some([best_without(pool, slot, size)?, best.clone()]);
    let pairs: Vec<Option<[String; 2]>> = slots.iter().map(pair).collect();
    let keys: Vec<String> = pairs.iter().flatten().flatten().cloned().collect();
    pool.compare(&keys);
    pool.weigh(&keys);
    let study = pool.study;
    let entry = |key: &String| &pool.entries[key];
    let cases: Vec<(usize, Slot, [&Entry; 2])> = slots
        .into_iter()
        .zip(pairs)
        .enumerate()
        .filter_map(|(i, (slot, pair))| pair.map(|pair| (i, slot, pair.each_ref().map(entry))))
        .collect();
    let weighed = parallel::map(&cases, |(i, slot, pair)| one(study, slot, *pair, *i as u64));
    let mut weighed: Vec<Weighed> = weighed
        .into_iter()
        .filter_map(Result::transpose)
        .collect::<Result<_>>()?;
    weighed.sort_by(|a, b| study.merit(&b.without).total_cmp(&study.merit(&a.without)));
    Ok(weighed)
}

/// The best model of a pool that has nothing of a slot and no more moves than so many: two effects in the place
/// of one do not deny it.
fn best_without(pool: &Pool, slot: &Slot, size: usize) -> Option<String> {
    let lacks = |e: &Entry| slot.moves.iter().all(|m| !e.moves.contains(m));
    let mut ranked = pool.ranked().into_iter();
    ranked
        .find(|(_, e)| !e.is_excluded() && e.moves.len() <= size && lacks(e))
        .map(|(k, _)| k.clone())
}

/// A slot with its evidence; none where the model without it is not rejected beside the one with it, or is
/// better on the fitted or on the held-out records alone.
fn one(
    study: &Study,
    slot: &Slot,
    [without, with]: [&Entry; 2],
    seed: u64,
) -> Result<Option<Weighed>> {
    let losses = without.losses.as_ref().zip(with.losses.as_ref());
    let fate = losses.map_or(Fate::Kept, |(without, with)| {
        confidence_set_in(study, &[without, with])[0]
    });
    let errors = [&without.judged, &with.judged].map(Residuals::of);
    let Fate::Rejected(standard_errors) = fate else {
        return Ok(None);
    };
    if is_better_somewhere(errors, study.policy.matters_at_noise) {
        return Ok(None);
    }
    let mut screening = None;
    if let Some(Move::Added(_)) = slot.moves.first().filter(|_| !with.held) {
        let model = &without.judged.model;
        let candidates = study.candidates_for(model);
        screening = Some(study.weigh(model, &candidates, study.policy.seed + seed)?);
    }
    let [without_errors, with_errors] = errors;
    Ok(Some(Weighed {
        slot: slot.clone(),
        without: without.judged.clone(),
        screening,
        evidence: Evidence::Models {
            without: without_errors,
            with: with_errors,
            standard_errors,
        },
    }))
}

/// Whether the first of two models is better on the fitted or on the held-out records alone, by more than a
/// share of the mean square.
fn is_better_somewhere([one, other]: [Residuals; 2], share: f64) -> bool {
    let better = |one: f64, other: f64| one * one * (1.0 + share) < other * other;
    let held_out = one.validate.zip(other.validate);
    better(one.identify, other.identify) || held_out.is_some_and(|(a, b)| better(a, b))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_effect_that_one_side_does_better_without_is_not_named() {
        let errors = |identify: f64, held_out: f64| Residuals {
            identify,
            validate: Some(held_out),
        };
        let denied = |without, with| is_better_somewhere([without, with], 0.04);
        assert!(denied(errors(29.0, 443.0), errors(76.6, 437.0)));
        assert!(denied(errors(39.0, 58.0), errors(11.0, 71.0)));
        assert!(!denied(errors(200.0, 210.0), errors(6.0, 6.1)));
        assert!(!denied(errors(2.0, 210.0), errors(2.01, 6.1)));
    }
}
