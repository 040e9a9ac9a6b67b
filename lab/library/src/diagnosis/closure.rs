//! Single moves around the simplest models that are kept, until these no longer change: each effect dropped,
//! each exchanged for others that do much the same, and one tried in the place of two. So what could stand in
//! the place of an effect is in the pool before anything is named.

use super::judgement::Judged;
use super::pool::{Entry, Move, Pool, key};
use super::screening::CandidateScore;
use super::selection::select;
use super::study::{FAR_BEHIND, Study};
use crate::error::Result;
use crate::identification::finer_hysteresis::structure_beside_a_gain;
use crate::watch::WatchEvent;
use hysteron_sim::chain::Model;
use hysteron_sim::effect::{LoopsTried, Parameter};
use std::collections::BTreeSet;

/// The model without an effect, fitted again.
pub(super) struct Dropped {
    id: String,
    entry: Entry,
    /// Its merit is no further than this from that of the model with the effect.
    near: bool,
}

/// Closes a pool around its simplest kept models, and gives these.
///
/// # Errors
/// A candidate that gives something that is no number.
pub fn close(pool: &mut Pool, done: &mut BTreeSet<String>) -> Result<Vec<String>> {
    loop {
        let minimal = select(pool);
        let policy = &pool.study.policy;
        let open: Vec<String> = minimal
            .iter()
            .take(policy.closed_around)
            .filter(|k| !done.contains(*k))
            .cloned()
            .collect();
        let spent = done.len() >= policy.closures_max
            || pool.study.watch.stopped()
            || pool.study.budget.is_over();
        let Some(key) = open.into_iter().next().filter(|_| !spent) else {
            return Ok(minimal);
        };
        close_around(pool, &key)?;
        done.insert(key);
    }
}

/// Tries single moves around a model of a pool.
///
/// # Errors
/// A candidate that gives something that is no number.
pub(super) fn close_around(pool: &mut Pool, key: &str) -> Result<()> {
    let entry = pool.entries[key].clone();
    let study = pool.study;
    if entry.held {
        return Ok(());
    }
    study
        .watch
        .event(&WatchEvent::Doing("trying what else could do"));
    let dropped = exchange(pool, &entry, &entry.added())?;
    let instead_of_two = exchange_pairs(study, &entry)?;
    let finer: Vec<Entry> = dropped
        .iter()
        .filter(|d| d.near)
        .flat_map(|d| finer_than(study, &d.entry))
        .collect();
    let dropped = dropped.into_iter().map(|d| d.entry);
    dropped
        .chain(finer)
        .chain(instead_of_two)
        .for_each(|entry| pool.keep(entry));
    Ok(())
}

/// Tries others in the place of these effects of a model, and where these are loops, those of other structures:
/// one effect after the other to its end, so that what the budget does not reach may come later. The model
/// without each.
///
/// # Errors
/// A candidate that gives something that is no number.
pub(super) fn exchange(pool: &mut Pool, entry: &Entry, ids: &[String]) -> Result<Vec<Dropped>> {
    let study = pool.study;
    let dropped = drop_each(study, entry, ids);
    for leaving in &dropped {
        if study.budget.is_over() {
            break;
        }
        let tried = in_the_place_of(study, entry, leaving)?;
        let other_loops = with_other_loops(pool, entry, &leaving.id, &tried);
        tried
            .into_iter()
            .chain(other_loops)
            .for_each(|entry| pool.keep(entry));
        if !study.budget.is_over() {
            pool.exchanged.insert(exchange_of(entry, &leaving.id));
        }
    }
    Ok(dropped)
}

/// What the exchange of an effect of a model is known by.
pub(super) fn exchange_of(entry: &Entry, id: &str) -> (String, String) {
    (key(&entry.moves, &entry.judged.model), id.to_owned())
}

/// The moves without those whose effect is gone from a model.
fn moves_in(entry: &Entry, model: &Model, by: Option<&str>) -> Vec<Move> {
    let present = entry
        .moves
        .iter()
        .filter(|m| model.effect(m.effect()).is_some())
        .cloned();
    present
        .chain(by.map(|id| Move::Added(id.to_owned())))
        .collect()
}

/// The model without each of these effects.
fn drop_each(study: &Study, entry: &Entry, leaving: &[String]) -> Vec<Dropped> {
    study.budget.while_it_lasts(leaving, |id| {
        let quick = study.quickly_within(
            &study.without(&entry.judged.model, id),
            entry.merit,
            FAR_BEHIND,
        );
        let near = study.merit(&quick) < entry.merit + study.policy.in_contention;
        let judged = if near {
            study.for_comparison(&quick.model)
        } else {
            quick
        };
        let moves = moves_in(entry, &judged.model, None);
        Dropped {
            id: id.clone(),
            near,
            entry: Entry::new(study, moves, judged, near),
        }
    })
}

/// What describes loops and creep more finely in the place of what was dropped.
fn finer_than(study: &Study, without: &Entry) -> Vec<Entry> {
    if study.far_above_the_noise(&without.judged) {
        return Vec::new();
    }
    let model = &without.judged.model;
    let finer: Vec<Model> = study
        .finer(model)
        .into_iter()
        .chain(study.finer_plays(model))
        .chain(study.finer_creep(model))
        .collect();
    let fitted = study.budget.while_it_lasts(&finer, |begin| {
        study.quickly_within(begin, without.merit, FAR_BEHIND)
    });
    fitted
        .into_iter()
        .map(|judged| Entry::new(study, without.moves.clone(), judged, false))
        .collect()
}

/// Others that do much the same in the place of an effect. Where held-out records are not met, what loops take
/// in of a lag shows there only, and others are compared on all records.
fn in_the_place_of(study: &Study, entry: &Entry, leaving: &Dropped) -> Result<Vec<Entry>> {
    let model = &leaving.entry.judged.model;
    let candidates = study.candidates_for(model);
    let screening = if study.leaves_values_open(&leaving.entry.judged) {
        let [_, on_all] = study.score_on_fitted_and_all(model, &candidates)?;
        on_all
    } else {
        study.score_each(model, &candidates)?
    };
    let policy = &study.policy;
    let doing_as = screening.doing_as(&leaving.id, policy.rival, policy.rival_similarity);
    let others = doing_as
        .into_iter()
        .filter(|s| entry.judged.model.effect(&s.id).is_none());
    // One law at another place of the chain is tried, however many others come before it.
    let is_tried = |(place, s): &(usize, &CandidateScore)| {
        *place < policy.rivals || same_law(study, entry, &leaving.id, s).is_some()
    };
    let trials: Vec<&CandidateScore> = others
        .enumerate()
        .filter(is_tried)
        .map(|(_, s)| s)
        .collect();
    Ok(study.budget.while_it_lasts(&trials, |score| {
        let judged = in_its_place(study, entry, leaving, score);
        let moves = moves_in(&leaving.entry, &judged.model, Some(&score.id));
        Entry::new(study, moves, judged, false)
    }))
}

/// Loops of the other structures, in the place of those of a model where these leave, or of those that took the
/// place of what leaves: surfaces are scored for all of them.
fn with_other_loops(pool: &Pool, entry: &Entry, leaving: &str, tried: &[Entry]) -> Vec<Entry> {
    let study = pool.study;
    let added_loops = |e: &Entry| {
        let loops = structure_beside_a_gain(&e.judged.model);
        loops.filter(|id| e.moves.contains(&Move::Added(id.clone())))
    };
    let bases: Vec<&Entry> = match added_loops(entry) {
        Some(loops) if loops == leaving => vec![entry],
        Some(_) => Vec::new(),
        None => tried.iter().filter(|e| added_loops(e).is_some()).collect(),
    };
    let begun: Vec<(String, Vec<Move>, Model)> = bases
        .into_iter()
        .flat_map(|base| pool.with_other_structures(base, LoopsTried::AtFirst))
        .collect();
    study.budget.while_it_lasts(&begun, |(_, moves, begin)| {
        let judged = study.quickly_within(begin, entry.merit, FAR_BEHIND);
        Entry::new(study, moves.clone(), judged, false)
    })
}

/// One effect in the place of another, from its best two initial guesses, and from the values of the other
/// where both are one law at two places.
fn in_its_place(study: &Study, entry: &Entry, dropped: &Dropped, score: &CandidateScore) -> Judged {
    let base = &dropped.entry.judged.model;
    let begin = |start: &Vec<f64>| study.with(base, &[(score.effect.clone(), start.clone())]);
    let starts = if score.effect.declaration().starts_combine {
        1
    } else {
        study.policy.guesses
    };
    let same_law = same_law(study, entry, &dropped.id, score);
    let begun = score.starts.iter().take(starts).map(begin).chain(same_law);
    let fitted = begun.map(|model| study.quickly_within(&model, entry.merit, FAR_BEHIND));
    let best = fitted.min_by(|a, b| study.merit(a).total_cmp(&study.merit(b)));
    best.unwrap_or_else(|| dropped.entry.judged.clone())
}

/// An effect at the values of another of the same law, as lags in front of a mode and behind it are.
fn same_law(study: &Study, entry: &Entry, id: &str, score: &CandidateScore) -> Option<Model> {
    let instance = entry.judged.model.effect(id)?;
    let others = score.effect.parameters(&study.overview);
    let quantities = instance
        .parameters
        .iter()
        .map(|own| (own, own.parameter.quantity()));
    let both = quantities.zip(others.iter().map(Parameter::quantity));
    let is_same = instance.parameters.len() == others.len()
        && both.clone().all(|((_, (own, _)), (other, _))| own == other);
    is_same.then(|| {
        let values = both
            .map(|((own, (_, unit)), (_, other))| own.value * (unit / other))
            .collect();
        study.with(
            &study.without(&entry.judged.model, id),
            &[(score.effect.clone(), values)],
        )
    })
}

/// One effect in the place of every two, where the noise is near enough to show it: two lags that were added
/// one after the other may stand in for a delay.
fn exchange_pairs(study: &Study, entry: &Entry) -> Result<Vec<Entry>> {
    let leaving = entry.added();
    if leaving.len() < 2 || !study.near_the_noise(&entry.judged) {
        return Ok(Vec::new());
    }
    let pairs: Vec<[&String; 2]> = leaving
        .iter()
        .enumerate()
        .flat_map(|(i, a)| leaving[i + 1..].iter().map(move |b| [a, b]))
        .collect();
    let without = study.budget.while_it_lasts(&pairs, |[a, b]| {
        study.quickly(&study.without(&study.without(&entry.judged.model, a), b))
    });
    let scored = study.budget.while_it_lasts(&without, |judged| {
        study.score_each(&judged.model, &study.candidates_for(&judged.model))
    });
    let mut promising: Vec<(f64, &Judged, CandidateScore)> = Vec::new();
    for (judged, screening) in without.iter().zip(scored) {
        let screening = screening?;
        let total = screening.total_um2().max(f64::MIN_POSITIVE);
        let new = screening
            .scores
            .iter()
            .filter(|s| entry.judged.model.effect(&s.id).is_none());
        for score in new.take(study.policy.guesses) {
            let left = (1.0 - score.explained_um2 / total).max(f64::MIN_POSITIVE);
            promising.push((study.merit(judged) + 0.5 * left.ln(), judged, score.clone()));
        }
    }
    promising.sort_by(|a, b| a.0.total_cmp(&b.0).then_with(|| a.2.id.cmp(&b.2.id)));
    promising.truncate(study.policy.rivals);
    let fitted = study
        .budget
        .while_it_lasts(&promising, |(_, judged, score)| {
            let begin = study.with(
                &judged.model,
                &[(score.effect.clone(), score.starts[0].clone())],
            );
            let mut one = study.quickly(&begin);
            if study.merit(&one) < entry.merit + study.policy.in_contention {
                // The values of the others are still those that made up for it.
                one = study.begun_again(&study.for_comparison(&one.model))?;
            }
            Ok(Entry::new(
                study,
                moves_in(entry, &one.model, Some(&score.id)),
                one,
                false,
            ))
        });
    fitted.into_iter().collect()
}
