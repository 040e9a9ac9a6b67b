//! What a search came to, and how it comes there: search, closure and ablation until nothing better comes,
//! then names, evidence and the model at the end.

use crate::dataset::issue::Issue;
use crate::diagnosis::closure::close;
use crate::diagnosis::findings::{Fits, Weighed, names_and_open, test_slots, weigh};
use crate::diagnosis::judgement::Judged;
use crate::diagnosis::path::{self, ModelChange, PathStep};
use crate::diagnosis::pool::{Entry, Move, Pool};
use crate::diagnosis::screening::{Screening, ScreeningEvidence};
use crate::diagnosis::search::Search;
use crate::diagnosis::selection;
use crate::diagnosis::study::Study;
use crate::error::Result;
use crate::identification::finer_hysteresis::{structure, structure_beside_a_gain};
use crate::identification::work::Stage;
use crate::identification::{finer_creep, finer_hysteresis};
use crate::outcome::{ChangedValue, KeptModel, Residuals};
use crate::parallel;
use crate::quality::{self, Moment};
use crate::watch::WatchEvent;
use hysteron_sim::chain::Model;
use hysteron_sim::effect::vibration;
use std::collections::BTreeSet;

/// What a search came to, however it began.
#[derive(Default)]
pub struct Grown {
    /// The way to the model at the end.
    pub steps: Vec<PathStep>,
    /// What is named, with its evidence.
    pub weighed: Vec<Weighed>,
    /// What survives its test and is no name ([`names_and_open`]).
    pub open: Vec<Weighed>,
    /// The simplest kept models as they are written.
    pub models: Vec<KeptModel>,
    /// The simplest kept models.
    pub simplest: Vec<Entry>,
    /// The model with the named effects alone, where it is another than the last.
    pub named: Option<Judged>,
    /// Values of a prior model that have changed.
    pub changed: Vec<ChangedValue>,
    /// What was tried alone beside a prior model.
    pub tried: Vec<Entry>,
    /// Candidates beside the start, where the model ends there.
    pub beside_start: Option<Screening>,
    /// How the loops at the end are described, where they are of another structure than before.
    pub loops: Vec<String>,
    /// What a quality check found that blocks.
    pub issues: Vec<Issue>,
    /// The caller wanted the best so far.
    pub stopped: bool,
    /// The budget did not reach to find and test what would be named.
    pub out_of_time: bool,
    /// The search ended before it found nothing more.
    pub ended_early: bool,
}

impl Grown {
    /// The model with the named effects alone, where some of them turned out to be none; `last` is the one at
    /// the end.
    pub fn named_less(&mut self, none: &[Weighed], last: &Judged, study: &Study) {
        if none.is_empty() {
            return;
        }
        let named = &self.named.as_ref().unwrap_or(last).model;
        let gone = none.iter().flat_map(|weighed| weighed.slot.effects());
        let less = gone.fold(named.clone(), |model, id| study.without(&model, &id));
        let effects = |model: &Model| BTreeSet::from_iter(model.effect_ids());
        let is_less = |step: &&PathStep| effects(&step.judged.model) == effects(&less);
        let step = self.steps.iter().rev().find(is_less);
        self.named = Some(step.map_or_else(|| study.thoroughly(&less), |s| s.judged.clone()));
    }
}

/// A start at which everything ends.
#[must_use]
pub fn at(judged: Judged) -> Grown {
    Grown {
        steps: vec![PathStep {
            change: ModelChange::Start,
            judged,
        }],
        ..Grown::default()
    }
}

/// From where a pool begins to the best that the data support. `loops` is the structure of the loops that
/// were there before.
///
/// # Errors
/// A candidate that gives something that is no number.
pub fn grow(study: &Study, pool: Pool, base: &Judged, loops: &Option<String>) -> Result<Grown> {
    let mut beside_start = None;
    if study.nothing_left(base) && !study.watch.stopped() {
        // Nothing is left above the noise: only a signature that is there beyond chance is worth a search.
        let screening = beside(study, base)?;
        let significant = |e: &ScreeningEvidence| e.p_adjusted <= study.policy.family_wise;
        let quiet = !screening
            .scores
            .iter()
            .any(|s| s.evidence.as_ref().is_some_and(significant));
        beside_start = Some(screening);
        if quiet {
            return Ok(Grown {
                beside_start,
                ..at(base.clone())
            });
        }
    }
    let (origin, mut search) = (pool.origin.clone(), Search::over(pool));
    let found = match searched(&mut search)? {
        Ended::Found(found) => found,
        Ended::Doubted(issues) => {
            return Ok(Grown {
                issues,
                ..at(base.clone())
            });
        }
        Ended::Stopped => {
            return Ok(Grown {
                stopped: true,
                beside_start,
                ..best_so_far(study, &search.pool, base)
            });
        }
    };
    let grown = end(study, search, found, base, loops)?;
    let ends_at_start = grown.simplest.first().is_none_or(|e| e.moves == origin);
    if beside_start.is_none() && ends_at_start {
        beside_start = Some(beside(study, base)?);
    }
    Ok(Grown {
        beside_start,
        ..grown
    })
}

/// Candidates on what a model leaves, with how likely chance makes as much.
fn beside(study: &Study, base: &Judged) -> Result<Screening> {
    let candidates = study.candidates_for(&base.model);
    study.weigh(&base.model, &candidates, study.policy.seed)
}

/// What a search ended with.
struct Simplest {
    /// Keys of the simplest kept models.
    keys: Vec<String>,
    /// What was searched without, one set of effects each.
    ablated: BTreeSet<Vec<String>>,
}

/// How a search ended.
enum Ended {
    Found(Simplest),
    /// A quality check blocks what it found so far.
    Doubted(Vec<Issue>),
    /// The caller wanted the best so far.
    Stopped,
}

/// Searches, closes and ablates until nothing better comes or the budget ends.
fn searched(search: &mut Search) -> Result<Ended> {
    let (study, mut ablated) = (search.study, BTreeSet::new());
    // Asked once: a drive that acts otherwise between its samples makes a long search of nothing.
    let (mut is_asked, mut issues) = (false, Vec::new());
    let mut is_in_doubt = |best: &Judged| {
        let has_both = structure_beside_a_gain(&best.model).is_some()
            && best.model.effect(vibration::ID).is_some();
        if has_both && !is_asked && !study.near_the_noise(best) {
            is_asked = true;
            issues = quality::issues(study.dataset, Moment::LoopsAndMode(study, best));
        }
        !issues.is_empty()
    };
    let [mut searches, mut begins_again] = [Stage::Search, Stage::BeginningAgain];
    loop {
        study.budget.work.enter(searches);
        search.run(&mut is_in_doubt)?;
        if is_in_doubt(&search.pool.best().judged) {
            return Ok(Ended::Doubted(issues));
        }
        if search.stopped {
            return Ok(Ended::Stopped);
        }
        study.budget.work.enter(begins_again);
        begin_again(&mut search.pool)?;
        let before = search.pool.rank(search.pool.best());
        let keys = ablate(search, &mut ablated)?;
        // What came out of single moves around the simplest models, or of a search without one of their
        // effects, may lead further, in what is left of their share.
        [searches, begins_again] = [Stage::Closure; 2];
        study.budget.work.enter(searches);
        let gained = before - search.pool.rank(search.pool.best()) > study.policy.least_gain;
        let ends = !gained
            || study.budget.is_over()
            || study.met(&search.pool.best().judged)
            || search.closed.len() >= study.policy.closures_max;
        if ends {
            return Ok(if study.watch.stopped() {
                Ended::Stopped
            } else {
                Ended::Found(Simplest { keys, ablated })
            });
        }
    }
}

/// The names with their evidence, and the model at the end with the way to it.
fn end(
    study: &Study,
    search: Search,
    found: Simplest,
    base: &Judged,
    loops: &Option<String>,
) -> Result<Grown> {
    let (ended_early, untested, mut pool) = (search.out_of_time, search.untested, search.pool);
    let mut minimal = found.keys;
    study.budget.work.enter(Stage::Report);
    study
        .watch
        .event(&WatchEvent::Doing("weighing the evidence for each effect"));
    let weighed = weigh(&mut pool, &mut minimal)?;
    let [weighed, open] = names_and_open(weighed, Some(&found.ablated), &study.policy);
    let simplest: Vec<Entry> = minimal.iter().map(|k| pool.entries[k].clone()).collect();
    study.watch.event(&WatchEvent::Doing("fitting to the end"));
    let end = selection::end(&mut pool, &minimal);
    let mut end_judged = study.judged(end.judged.model.clone());
    if study.searched_beginnings() {
        end_judged = with_creep_of_the_whole(study, end_judged);
    }
    let mut steps = way(study, base, &pool.origin, &end, &end_judged)?;
    let named = with_the_named_alone(study, &simplest, &weighed, &end, &end_judged)
        .map(|named| as_on_the_way(&mut steps, named, |judged| study.merit(judged)));
    Ok(Grown {
        steps,
        named,
        models: kept_models(&simplest),
        loops: other_loops(&simplest, &end_judged.model, loops),
        simplest,
        // Without a name nobody knows what a longer search would have found.
        out_of_time: (untested || ended_early) && weighed.is_empty(),
        ended_early: ended_early || untested,
        weighed,
        open,
        ..Grown::default()
    })
}

/// The path from the start to the model at the end.
fn way(
    study: &Study,
    base: &Judged,
    origin: &[Move],
    end: &Entry,
    end_judged: &Judged,
) -> Result<Vec<PathStep>> {
    let mut added = end.added();
    added.retain(|id| !origin.contains(&Move::Added(id.clone())));
    let finer = |m: &Model| {
        (
            finer_hysteresis::description(m),
            finer_creep::description(m),
        )
    };
    if added.is_empty() && finer(&base.model) == finer(&end_judged.model) {
        return Ok(at(base.clone()).steps);
    }
    path::from(study, base, &added, end_judged)
}

/// Closes the pool around the simplest kept models and searches once more without each effect that they would
/// name, until neither changes them: the keys of these models.
fn ablate(search: &mut Search, ablated: &mut BTreeSet<Vec<String>>) -> Result<Vec<String>> {
    let work = &search.study.budget.work;
    loop {
        work.enter(Stage::Closure);
        let minimal = close(&mut search.pool, &mut search.closed)?;
        let open = test_slots(&mut search.pool, &minimal, Fits::ForComparison)
            .into_iter()
            .map(|case| (case.merit_without(&search.pool), case.slot.effects()))
            .filter(|(_, ids)| !ids.is_empty() && !ablated.contains(ids))
            // What is furthest behind without it is soon decided, and the rest of the budget is for the others.
            .max_by(|a, b| a.0.total_cmp(&b.0))
            .map(|(_, ids)| ids);
        let Some(ids) = open.filter(|_| !search.stopped && !search.untested) else {
            return Ok(minimal);
        };
        work.enter(Stage::Ablation);
        search
            .study
            .watch
            .event(&WatchEvent::Doing("searching without what would be named"));
        let from = search.pool.entries[&minimal[0]].clone();
        if search.run_without(&ids, &from)? {
            ablated.insert(ids);
        } else {
            search.untested = true;
        }
    }
}

/// The model with the named effects and no others, fitted to its end; none where that is the model at the end.
fn with_the_named_alone(
    study: &Study,
    simplest: &[Entry],
    weighed: &[Weighed],
    end: &Entry,
    end_judged: &Judged,
) -> Option<Judged> {
    let simplest = simplest.first()?;
    let is_named = |id: &String| weighed.iter().any(|w| w.slot.effects().contains(id));
    let denied: Vec<String> = simplest
        .added()
        .into_iter()
        .filter(|id| !is_named(id))
        .collect();
    if denied.is_empty() && simplest.moves == end.moves {
        return Some(end_judged.clone());
    }
    let less = |model: Model, id: &String| study.without(&model, id);
    let model = denied.iter().fold(simplest.judged.model.clone(), less);
    Some(study.thoroughly(&model))
}

/// One figure for one set of effects: of a model and of the last step of the way with the same effects the
/// better stands in both places. The last step of all is the model at the end and stays.
fn as_on_the_way(steps: &mut [PathStep], found: Judged, merit: impl Fn(&Judged) -> f64) -> Judged {
    let effects =
        |judged: &Judged| -> BTreeSet<String> { judged.model.effect_ids().into_iter().collect() };
    let is_same = |step: &PathStep| {
        step.change != ModelChange::Start && effects(&step.judged) == effects(&found)
    };
    let Some(at) = steps.iter().rposition(is_same) else {
        return found;
    };
    if at + 1 < steps.len() && merit(&found) < merit(&steps[at].judged) {
        steps[at].judged = found.clone();
        return found;
    }
    steps[at].judged.clone()
}

/// The best model of a pool with each effect that has several initial guesses begun again beside the others.
fn begin_again(pool: &mut Pool) -> Result<()> {
    let (study, best) = (pool.study, pool.best().clone());
    if best.moves == pool.origin
        || study.met(&best.judged)
        || study.watch.stopped()
        || study.budget.is_over()
    {
        return Ok(());
    }
    study
        .watch
        .event(&WatchEvent::Doing("beginning values again"));
    let again = study.begun_again(&best.judged)?;
    pool.keep(Entry::new(study, best.moves, again, true));
    Ok(())
}

/// The simplest models as they are written: of those with the same moves the best.
#[must_use]
pub fn kept_models(simplest: &[Entry]) -> Vec<KeptModel> {
    let mut out: Vec<KeptModel> = Vec::new();
    for entry in simplest {
        let effects: Vec<String> = entry.moves.iter().map(|m| m.effect().to_owned()).collect();
        if out.iter().all(|m| m.effects != effects) {
            out.push(KeptModel {
                effects,
                rms_um: Residuals::of(&entry.judged),
            });
        }
    }
    out
}

/// How the loops at the end are described and those of other simplest models, where they are not of the
/// structure that was there before. In the place of a gain loops are an effect that was added, and named as
/// one.
fn other_loops(simplest: &[Entry], end: &Model, before: &Option<String>) -> Vec<String> {
    let Some(before) = before else {
        return Vec::new();
    };
    if structure(end).as_ref() == Some(before) {
        return Vec::new();
    }
    let mut out = vec![finer_hysteresis::description(end)];
    for other in simplest
        .iter()
        .filter(|e| structure(&e.judged.model) != structure(end))
    {
        let description = finer_hysteresis::description(&other.judged.model);
        if !out.contains(&description) {
            out.push(description);
        }
    }
    out
}

/// Where the caller wanted the best so far.
fn best_so_far(study: &Study, pool: &Pool, base: &Judged) -> Grown {
    let best = pool.best();
    let judged = study.judged(best.judged.model.clone());
    let change = if best.added().is_empty() {
        ModelChange::FittedAgain
    } else {
        ModelChange::AddedUnweighed(best.added())
    };
    Grown {
        steps: vec![
            PathStep {
                change: ModelChange::Start,
                judged: base.clone(),
            },
            PathStep { change, judged },
        ],
        ..Grown::default()
    }
}

/// The model with its creep as fine as whole records ask for: what was searched on their beginnings did not
/// see the slow terms.
fn with_creep_of_the_whole(study: &Study, found: Judged) -> Judged {
    let mut best = found;
    while !study.met(&best) && !study.watch.stopped() {
        let finer = parallel::map(&study.finer_creep(&best.model), |begin| {
            study.thoroughly(begin)
        });
        let least = study.merit(&best) - study.policy.least_gain;
        let better = finer.into_iter().filter(|one| study.merit(one) < least);
        let Some(better) = better.min_by(|a, b| study.merit(a).total_cmp(&study.merit(b))) else {
            break;
        };
        best = better;
    }
    best
}

#[cfg(test)]
mod tests {
    use super::*;
    use hysteron_sim::chain::EffectInstance;
    use hysteron_sim::effect::{Overview, by_id};

    fn judged(ids: &[&str], error_um: f64) -> Judged {
        let mut model = Model::new(0.0, 100.0);
        for id in ids {
            let overview = Overview::without_data(0.0, 100.0);
            model.add(EffectInstance::new(by_id(id).unwrap(), &overview, &[]));
        }
        Judged {
            model,
            residuals: Vec::new(),
            identify_rms_um: error_um,
            validate_rms_um: None,
        }
    }

    #[test]
    fn the_named_effects_have_one_error_in_sentence_and_table() {
        for found_um in [0.007, 0.02] {
            let step = |ids: &[&str], error_um: f64| PathStep {
                change: ModelChange::Added(ids[ids.len() - 1].to_owned()),
                judged: judged(ids, error_um),
            };
            let mut steps = [
                step(&["gain"], 0.3),
                step(&["gain", "creep"], 0.01),
                step(&["gain", "creep", "friction"], 0.006),
            ];
            let found = judged(&["creep", "gain"], found_um);
            let named = as_on_the_way(&mut steps, found, Judged::error_um);
            assert_eq!(named.error_um(), found_um.min(0.01));
            assert_eq!(steps[1].judged.error_um(), named.error_um());
            assert_eq!(steps[2].judged.error_um(), 0.006);
        }
    }
}
