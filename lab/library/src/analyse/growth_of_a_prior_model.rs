//! What a search came to from a model that was identified before.

use super::growth::{Grown, at, grow, kept_models};
use crate::diagnosis::findings::{names_and_open, weigh};
use crate::diagnosis::judgement::Judged;
use crate::diagnosis::path::{ModelChange, PathStep};
use crate::diagnosis::pool::{Entry, Move, Pool};
use crate::diagnosis::prior::{self, Compared};
use crate::diagnosis::study::Study;
use crate::error::Result;
use crate::identification::finer_hysteresis::structure_beside_a_gain;
use crate::outcome::ChangedValue;
use crate::quality::{self, Moment};
use hysteron_sim::chain::Model;

/// What a model of before lacks on this recording, and which of its values have changed.
///
/// # Errors
/// A candidate that gives something that is no number.
pub fn grow_from_prior(study: &Study, model: Model) -> Result<Grown> {
    let base = study.judged(model);
    let of_the_model = quality::issues(study.dataset, Moment::PriorModel(study, &base));
    if !of_the_model.is_empty() {
        return Ok(Grown {
            issues: of_the_model,
            ..at(base)
        });
    }
    let compared = prior::compare(study, base)?;
    let issues = quality::issues(study.dataset, Moment::FirstFit(study, &compared.refitted));
    if !issues.is_empty() {
        return Ok(Grown {
            issues,
            ..at(compared.refitted)
        });
    }
    if compared.at_home || study.watch.stopped() {
        let (pool, base) = (Pool::of(study, &compared.base.model), &compared.base);
        return grow(study, pool, base, &structure_beside_a_gain(&base.model));
    }
    away_from_home(study, compared)
}

/// Of a model that the data reject as it is.
fn away_from_home(study: &Study, compared: Compared) -> Result<Grown> {
    let Compared {
        base,
        refitted,
        mut pool,
        mut minimal,
        ..
    } = compared;
    let simplest = minimal
        .first()
        .map(|k| pool.entries[k].clone())
        .filter(|e| e.held);
    let (mut steps, fitted) = told_and_fitted(study, &base, refitted, simplest.as_ref());
    let tried = |pool: &Pool| -> Vec<Entry> {
        let alone = pool
            .entries
            .values()
            .filter(|e| e.held && e.moves.len() == 1);
        alone.cloned().collect()
    };
    // Far above the noise, or where nobody knows it, the prior model left as much at home, and the question
    // was what the new recording has.
    let goes_on = study.floor_um.is_some()
        && !study.met(&fitted)
        && (study.near_the_noise(&fitted) || simplest.is_none());
    let mut grown = Grown {
        stopped: study.watch.stopped(),
        ..Grown::default()
    };
    if goes_on && !grown.stopped {
        begin_at(study, &mut pool, &base, simplest.as_ref(), &fitted);
        let tried = tried(&pool);
        grown = grow(study, pool, &fitted, &structure_beside_a_gain(&base.model))?;
        steps.extend(grown.steps.drain(..).skip(1));
        grown.tried = tried;
    } else {
        let weighed = weigh(&mut pool, &mut minimal)?;
        [grown.weighed, grown.open] = names_and_open(weighed, None, &study.policy);
        grown.simplest = minimal.iter().map(|k| pool.entries[k].clone()).collect();
        grown.models = kept_models(&grown.simplest);
        grown.tried = tried(&pool);
    }
    // A new fit of everything is no value that has changed.
    match grown.simplest.first().filter(|e| e.held) {
        Some(told) => grown.changed = changed_values(study, &grown, &base, told),
        None => grown
            .weighed
            .retain(|w| w.slot.moves.iter().any(|m| matches!(m, Move::Added(_)))),
    }
    grown.steps = steps;
    Ok(grown)
}

/// The path to the simplest model of what was tried beside the prior one, and that model with all its values
/// fitted, where that is better; without a simplest model the prior one fitted again.
fn told_and_fitted(
    study: &Study,
    base: &Judged,
    refitted: Judged,
    simplest: Option<&Entry>,
) -> (Vec<PathStep>, Judged) {
    let step = |change: ModelChange, judged: &Judged| PathStep {
        change,
        judged: judged.clone(),
    };
    let mut steps = vec![step(ModelChange::Start, base)];
    let fitted = simplest.map_or(refitted, |entry| {
        let told = study.judged(prior::all_free(&entry.judged.model, &base.model));
        steps.extend(entry.moves.iter().map(|m| {
            let change = match m {
                Move::Added(id) => ModelChange::Added(id.clone()),
                Move::Freed(id) => ModelChange::Changed(id.clone()),
            };
            step(change, &told)
        }));
        let again = study.thoroughly(&told.model);
        // Values that this recording does not fix are better where they were identified than where its
        // noise would bring them: the held-out records decide.
        let met_better = study.merit(&again) <= study.merit(&told)
            && again.validate_rms_um <= told.validate_rms_um;
        if met_better { again } else { told }
    });
    steps.push(step(ModelChange::FittedAgain, &fitted));
    (steps, fitted)
}

/// Lets the search of a pool begin at the fitted model: with every value of the prior model free, and what was
/// added to it.
fn begin_at(
    study: &Study,
    pool: &mut Pool,
    base: &Judged,
    simplest: Option<&Entry>,
    fitted: &Judged,
) {
    let moves = simplest.map_or(&[][..], |entry| &entry.moves);
    let added = moves.iter().filter(|m| matches!(m, Move::Added(_)));
    let all_freed = base.model.effects.iter().map(|e| Move::Freed(e.id.clone()));
    let mut origin: Vec<Move> = added.cloned().chain(all_freed).collect();
    origin.sort();
    let judged = study.judged_quickly(fitted.model.clone());
    pool.keep(Entry::new(study, origin.clone(), judged, true));
    if let Some(start) = pool.entries.values_mut().find(|e| e.moves == origin) {
        start.extended = false;
    }
    pool.origin = origin;
}

fn changed_values(study: &Study, grown: &Grown, base: &Judged, told: &Entry) -> Vec<ChangedValue> {
    let moved = grown.weighed.iter().filter_map(|w| w.slot.moves.first());
    let freed = moved.filter_map(|m| match m {
        Move::Freed(id) => Some(id),
        Move::Added(_) => None,
    });
    freed
        .flat_map(|id| prior::changes(study, id, &base.model, &told.judged.model))
        .collect()
}
