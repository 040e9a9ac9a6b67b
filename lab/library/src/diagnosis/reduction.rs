//! What a search has found is taken back as far as the data do not need it, and asked for rivals: what else would do in its place.
//!
//! Each added effect is looked at alone: the model without it is fitted again, the effect must be in what that model leaves, and the model
//! with it must be better by a rule of [`super::decision`]. The one that is needed least goes first. Where none can go alone, two may go
//! together: a pair that makes up for badly begun values of a third is not missed once that has begun again. Whatever else explains much of what
//! the model without an effect leaves is fitted in its place; where the data do not tell the two apart, both are named.

use super::decision::{Decision, decide};
use super::judgement::Judged;
use super::screening::{Score, Screening};
use super::study::{FAR_BEHIND, Study};

use crate::parallel;
use crate::watch::Event;
use hysteron_sim::chain::Model;
use hysteron_sim::effect::{Effect, Place, thermal_drift};
use std::collections::BTreeSet;

/// A model whose merit is worse by this much than another's is out of the question, however long it is fitted.
const CLEARLY_MISSED: f64 = 0.5;
/// The same where both are far above the noise, and only the error decides.
const CLEARLY_MISSED_FAR_ABOVE: f64 = 0.25;
/// Rivals of an effect that are fitted at most.
const RIVALS_MAX: usize = 4;
/// A rival's signature is at least so much like that of the effect: what acts in quite another way is found by the search itself.
const RIVALS_SIMILARITY: f64 = 0.25;
/// How often a rival that does better takes the place of an effect.
const BETTER_RIVALS_MAX: usize = 2;
/// A rival whose quick fit is worse by this much does not come to a tie, however long it is fitted.
const CLEARLY_BEHIND: f64 = 0.25;

/// Candidates for the place of a pair that are looked at.
const ONES_FOR_A_PAIR: usize = 2;
/// What may do as well as a pair: the error that its signature promises is at most so much larger, as a logarithm. A signature is the beginning of
/// a curve, and promises less than a fit.
const MAY_DO_AS_WELL: f64 = 1.0;
/// What no search has tried is fitted in the place of a pair where its signature leaves less than this share.
const LEAVES_LITTLE: f64 = 0.3;
/// One in the place of two is fitted to the end where it is worse by no more than this.
const NEARLY_AS_WELL: f64 = 0.05;
/// Steps by which loops are described more finely in the place of what holds back.
const STEPS_FINER: usize = 3;
/// Ones in the place of two that are fitted.
const ONES_FITTED: usize = 4;

/// Something else in the place of an effect.
#[derive(Clone)]
pub struct Rival {
    /// The effect.
    pub id: String,
    /// The model with it in place of the other, and its errors.
    pub judged: Judged,
    /// Told apart or not.
    pub decision: Decision,
}

/// An effect that stays, with what was looked at for it.
#[derive(Clone)]
pub struct Supported {
    /// The effect.
    pub id: String,
    /// The rule that admitted it.
    pub decision: Decision,
    /// The model without it, fitted again.
    pub without: Judged,
    /// All candidates on what that model leaves.
    pub screening: Screening,
    /// What else was fitted in its place.
    pub rivals: Vec<Rival>,
    /// Nothing of it answers the drive: the free motions of its states do as well alone.
    pub undriven: bool,
}

impl Supported {
    /// The effect and those that the data do not tell from it. What does not answer the drive is a drift as much as what is left of a drive before
    /// the record.
    #[must_use]
    pub fn names(&self) -> Vec<String> {
        let tied = self.rivals.iter().filter(|r| r.decision == Decision::NotToldApart).map(|r| r.id.clone());
        let drift = self.undriven.then(|| thermal_drift::ID.to_owned());
        let all = drift.into_iter().chain(std::iter::once(self.id.clone())).chain(tied);
        all.fold(Vec::new(), |mut names, id| {
            if !names.contains(&id) {
                names.push(id);
            }
            names
        })
    }
}

/// What is left of a search.
pub struct Reduced {
    /// The model, judged on all samples.
    pub judged: Judged,
    /// What stays, each with its evidence.
    pub supported: Vec<Supported>,
    /// What was taken back, with the rule.
    pub taken_back: Vec<(String, Decision)>,
}

/// How much an effect is missed: what deciding which goes first rests on.
fn missed(study: &Study, without: &Judged, with: &Judged) -> f64 {
    study.merit(without) - study.merit(with)
}

/// Whether what was decided takes effects out of the model. Far above the noise, where the library does not know all, a model is as good as its errors,
/// and evidence is asked for a name alone: what lowers them stays, named or not.
fn goes(study: &Study, decision: Decision, without: &Judged, with: &Judged) -> bool {
    let lowers_errors = study.far_above_the_noise(with) && missed(study, without, with) > study.policy.least_gain;
    !decision.admits() && !lowers_errors
}

/// Takes back what the data do not need and looks for rivals of the rest; a rival that does better than what it was compared with takes its
/// place, and all is looked at again.
///
/// # Errors
/// A candidate that gives something that is no number.
pub fn reduce(study: &Study, found: &Judged, added: &[String]) -> crate::error::Result<Reduced> {
    let mut reduced = reduce_once(study, found, added)?;
    for _ in 0..BETTER_RIVALS_MAX {
        let at_all = study.merit(&reduced.judged) - study.policy.least_gain;
        let better = |r: &&Rival| study.merit(&r.judged) < at_all;
        let all = reduced.supported.iter().flat_map(|one| one.rivals.iter().filter(better).map(move |rival| (&one.id, rival)));
        let Some((id, rival)) = all.min_by(|a, b| study.merit(&a.1.judged).total_cmp(&study.merit(&b.1.judged))) else { break };
        if study.watch.stopped() || (study.watch.searched_enough() && study.far_above_the_noise(&reduced.judged)) {
            break;
        }
        let present = |other: &String| rival.judged.model.effect(other).is_some();
        let kept = reduced.supported.iter().map(|one| &one.id).filter(|other| *other != id && present(other)).cloned();
        let added: Vec<String> = kept.chain(std::iter::once(rival.id.clone())).collect();
        let mut again = reduce_once(study, &rival.judged, &added)?;
        if study.merit(&again.judged) > at_all {
            break;
        }
        again.taken_back.splice(0..0, std::mem::take(&mut reduced.taken_back));
        reduced = again;
    }
    Ok(reduced)
}

/// Takes back what the data do not need and looks for rivals of the rest.
fn reduce_once(study: &Study, found: &Judged, added: &[String]) -> crate::error::Result<Reduced> {
    let mut judged = study.judged(found.model.clone());
    let mut added: Vec<String> = added.to_vec();
    let mut taken_back = Vec::new();
    let mut clearly_missed: BTreeSet<String> = BTreeSet::new();
    loop {
        study.watch.event(&Event::Doing("taking back what is not needed"));
        let far_above = study.far_above_the_noise(&judged);
        let clear = if far_above { CLEARLY_MISSED_FAR_ABOVE } else { CLEARLY_MISSED };
        // What was clearly missed before another effect went is missed beside what stayed, and is asked once nothing else goes.
        let mut without = without_each(study, &judged, &added, clear, |id| !clearly_missed.contains(id));
        let may_leave = |id: &String| judged.model.effect(id).is_none_or(|e| e.effect.may_leave());
        // Loops that were added in the place of a gain can go back to one.
        let may_go = |id: &String| may_leave(id) || judged.model.effect(id).is_some_and(|e| e.effect.declaration().is_main());
        let refused = |without: &[(usize, Judged)]| -> Option<(usize, Decision)> {
            without
                .iter()
                .filter(|(i, _)| may_go(&added[*i]))
                .map(|(i, without)| (*i, without, decide(study, without, &judged, None)))
                .filter(|(_, without, decision)| goes(study, *decision, without, &judged))
                .min_by(|a, b| missed(study, a.1, &judged).total_cmp(&missed(study, b.1, &judged)))
                .map(|(i, _, decision)| (i, decision))
        };
        let mut goes_first = refused(&without);
        if goes_first.is_none() && without.len() < added.len() {
            without.extend(without_each(study, &judged, &added, clear, |id| clearly_missed.contains(id)));
            without.sort_by_key(|(i, _)| *i);
            goes_first = refused(&without);
        }
        clearly_missed.extend(without.iter().filter(|(_, one)| missed(study, one, &judged) > clear).map(|(i, _)| added[*i].clone()));
        let screenings = match goes_first {
            Some((i, decision)) => Err((i, decision)),
            None => {
                // Two that stand in for one are worth looking for where the one may reach the noise.
                let without_pairs = if far_above { Vec::new() } else { without_each_pair(study, &judged, &added, &may_leave) };
                // Of two effects each was looked at alone.
                let of_more = if added.len() > 2 { without_pairs.as_slice() } else { &[] };
                if let Some((pair, without_pair, decision)) = pair_not_needed(study, &judged, of_more)? {
                    judged = without_pair;
                    added.retain(|id| !pair.contains(id) && judged.model.effect(id).is_some());
                    taken_back.extend(pair.into_iter().map(|id| (id, decision)));
                    continue;
                }
                if let Some(exchange) = one_in_place_of_two(study, &judged, &without_pairs)? {
                    added.retain(|id| !exchange.pair.contains(id) && exchange.judged.model.effect(id).is_some());
                    added.push(exchange.by);
                    judged = exchange.judged;
                    taken_back.extend(exchange.pair.into_iter().map(|id| (id, exchange.decision)));
                    continue;
                }
                study.watch.event(&Event::Doing("weighing the evidence for each effect"));
                let without: Vec<&Judged> = without.iter().map(|(_, one)| one).collect();
                weigh_each(study, &added, &without, &judged, &may_go)?
            }
        };
        match screenings {
            Err((i, decision)) => {
                let id = added.remove(i);
                judged = without.into_iter().find(|(of, _)| *of == i).map_or(judged, |(_, one)| one);
                // What built on it went with it.
                added.retain(|other| judged.model.effect(other).is_some());
                taken_back.push((id, decision));
            }
            Ok((weighed, p)) => {
                let found: Vec<_> = without.into_iter().zip(weighed.into_iter().zip(p)).collect();
                let asked = parallel::map(&found, |((i, without), (screening, p))| {
                    let id = &added[*i];
                    let evidence = decide(study, without, &judged, *p);
                    let kept_for_errors = !evidence.admits() && study.far_above_the_noise(&judged);
                    let decision = if kept_for_errors { Decision::LowersErrors { by: missed(study, without, &judged) } } else { evidence };
                    // What has no name needs no rival of its name.
                    let rivals = if kept_for_errors { Vec::new() } else { rivals_of(study, id, without, screening, &judged) };
                    (decision, rivals, does_not_answer_the_drive(study, id, &judged))
                });
                let mut supported: Vec<Supported> = found
                    .into_iter()
                    .zip(asked)
                    .map(|(((i, without), (screening, _)), (decision, rivals, undriven))| Supported {
                        id: added[i].clone(),
                        decision,
                        without,
                        screening,
                        rivals,
                        undriven,
                    })
                    .collect();
                supported.sort_by(|a, b| {
                    missed(study, &b.without, &judged).total_cmp(&missed(study, &a.without, &judged)).then_with(|| a.id.cmp(&b.id))
                });
                return Ok(Reduced { judged, supported, taken_back });
            }
        }
    }
}

/// The model without each of the effects that are asked for, fitted again: its place among all, and what the rest leaves.
fn without_each(study: &Study, judged: &Judged, added: &[String], clear: f64, asked: impl Fn(&String) -> bool) -> Vec<(usize, Judged)> {
    let asked: Vec<usize> = (0..added.len()).filter(|i| asked(&added[*i])).collect();
    parallel::map(&asked, |i| {
        let begin = study.without(&judged.model, &added[*i]);
        let quick = study.quickly_within(&begin, study.merit(judged), FAR_BEHIND);
        // Where much is missed, how much exactly decides nothing.
        let clear = missed(study, &quick, judged) > clear;
        let quick = if clear { quick } else { study.for_comparison(&quick.model) };
        let instead = (!clear).then(|| with_finer_loops_instead(study, &added[*i], &quick, judged)).flatten();
        (*i, study.judged(instead.unwrap_or(quick).model))
    })
}

/// What friction and a gap do to a stage that follows at once are loops too, of the smallest turns, and a description of loops that has none so small leaves them: where
/// loops are described more finely in the place of either, that is what the model is without it.
fn with_finer_loops_instead(study: &Study, id: &str, without: &Judged, judged: &Judged) -> Option<Judged> {
    let holds_back = judged.model.effect(id).is_some_and(|e| e.effect.declaration().place == Place::Friction);
    if !holds_back || study.far_above_the_noise(judged) {
        return None;
    }
    let one_step_finer = |of: &Judged| {
        let finer = study.finer(&of.model).into_iter().chain(study.finer_plays(&of.model));
        let fitted = finer.map(|begin| study.for_comparison(&study.quickly(&begin).model));
        let best = fitted.min_by(|a, b| study.merit(a).total_cmp(&study.merit(b)));
        best.filter(|one| study.merit(one) < study.merit(of) - study.policy.gain_per_effect)
    };
    let step_behind = |of: &Judged| if missed(study, of, judged) > 0.0 { one_step_finer(of) } else { None };
    std::iter::successors(one_step_finer(without), step_behind).take(STEPS_FINER).last()
}

/// Two of the added effects, and the others fitted quickly without them.
struct WithoutPair {
    pair: [String; 2],
    quick: Judged,
}

/// Every two of the added effects that may leave, and what the others come to without them.
fn without_each_pair(study: &Study, judged: &Judged, added: &[String], may_leave: &dyn Fn(&String) -> bool) -> Vec<WithoutPair> {
    let leaving: Vec<&String> = added.iter().filter(|id| may_leave(id)).collect();
    let pairs: Vec<[&String; 2]> = leaving.iter().enumerate().flat_map(|(i, a)| leaving[i + 1..].iter().map(move |b| [*a, *b])).collect();
    parallel::map(&pairs, |[a, b]| WithoutPair {
        pair: [(*a).clone(), (*b).clone()],
        quick: study.quickly(&study.without(&study.without(&judged.model, a), b)),
    })
}

/// Two added effects without which the rest, begun again, does as well; the two whose lack is felt least are tried.
fn pair_not_needed(
    study: &Study,
    judged: &Judged,
    without_pairs: &[WithoutPair],
) -> crate::error::Result<Option<([String; 2], Judged, Decision)>> {
    let nearest = without_pairs.iter().min_by(|x, y| study.merit(&x.quick).total_cmp(&study.merit(&y.quick)));
    let Some(nearest) = nearest.filter(|nearest| missed(study, &nearest.quick, judged) < CLEARLY_BEHIND) else { return Ok(None) };
    let begun = study.begun_again(&study.for_comparison(&nearest.quick.model))?;
    let without = study.judged(begun.model);
    let decision = decide(study, &without, judged, None);
    Ok(goes(study, decision, &without, judged).then(|| (nearest.pair.clone(), without, decision)))
}

/// One effect that does as well as two of those that were added.
struct Exchange {
    pair: [String; 2],
    by: String,
    judged: Judged,
    /// Why the two are not needed beside it.
    decision: Decision,
}

/// Two lags that were added one after the other may stand in for a delay, and a search that extends one set at a time does not come back. So what
/// explains nearly all that the model without a pair leaves is tried in its place; the most promising few are fitted.
fn one_in_place_of_two(study: &Study, judged: &Judged, without_pairs: &[WithoutPair]) -> crate::error::Result<Option<Exchange>> {
    if without_pairs.is_empty() || study.watch.stopped() {
        return Ok(None);
    }
    study.watch.event(&Event::Doing("trying one effect in the place of two"));
    let scored = parallel::map(without_pairs, |without| {
        let model = &without.quick.model;
        study.score_each(model, &study.candidates_in_exchange(model))
    });
    let mut promising: Vec<(f64, &WithoutPair, Score)> = Vec::new();
    for (without, screening) in without_pairs.iter().zip(scored) {
        let screening = screening?;
        let total = screening.total_um2().max(f64::MIN_POSITIVE);
        let new = |s: &&Score| judged.model.effect(&s.id).is_none();
        for score in screening.scores.iter().filter(new).take(ONES_FOR_A_PAIR) {
            let left = 1.0 - score.explained_um2 / total;
            let merit = study.merit(&without.quick) + 0.5 * left.max(f64::MIN_POSITIVE).ln();
            let seldom_tried = score.effect.in_exchange() && left < LEAVES_LITTLE;
            if seldom_tried || merit < study.merit(judged) + MAY_DO_AS_WELL {
                promising.push((merit, without, score.clone()));
            }
        }
    }
    promising.sort_by(|a, b| a.0.total_cmp(&b.0).then_with(|| a.2.id.cmp(&b.2.id)));
    promising.truncate(ONES_FITTED);
    let fitted = parallel::map(&promising, |(_, without, score)| {
        let quick = study.quickly(&study.with(&without.quick.model, &[(score.effect.clone(), score.starts[0].clone())]));
        if missed(study, &quick, judged) < CLEARLY_MISSED { study.judged(study.for_comparison(&quick.model).model) } else { quick }
    });
    for ((_, without, score), one) in promising.into_iter().zip(fitted) {
        if missed(study, &one, judged) > NEARLY_AS_WELL {
            continue;
        }
        // The others' values are still those that made up for it.
        let one = study.thoroughly(&study.begun_together(&study.begun_again(&one)?)?.model);
        // The same question as for each effect alone: whether the two bring enough beside the one to be kept.
        let decision = decide(study, &one, judged, None);
        if !decision.admits() || !study.told_apart(&one, judged) {
            return Ok(Some(Exchange { pair: without.pair.clone(), by: score.id, decision, judged: one }));
        }
    }
    Ok(None)
}

/// What was weighed of all effects, or the one that is not in what the model without it leaves.
type Weighed = Result<(Vec<Screening>, Vec<Option<f64>>), (usize, Decision)>;

/// Weighs the evidence for each effect, the one that is missed least first, and ends at the first that is refused.
fn weigh_each(
    study: &Study,
    added: &[String],
    without: &[&Judged],
    judged: &Judged,
    may_go: &dyn Fn(&String) -> bool,
) -> crate::error::Result<Weighed> {
    let mut order: Vec<usize> = (0..added.len()).collect();
    order.sort_by(|a, b| missed(study, without[*a], judged).total_cmp(&missed(study, without[*b], judged)));
    let mut screenings: Vec<Option<Screening>> = vec![None; added.len()];
    for some in order.chunks(parallel::parts_of_each(1)) {
        let weighed = parallel::map(some, |i| {
            let model = &without[*i].model;
            study.weigh(model, &study.candidates_and(&added[*i], model), 1000 + *i as u64)
        });
        for (i, screening) in some.iter().copied().zip(weighed) {
            let screening = screening?;
            let decision = decide(study, without[i], judged, p_of(judged, &screening, &added[i]));
            if may_go(&added[i]) && goes(study, decision, without[i], judged) {
                return Ok(Err((i, decision)));
            }
            screenings[i] = Some(screening);
        }
    }
    let screenings: Vec<Screening> = screenings.into_iter().flatten().collect();
    let p = screenings.iter().zip(added).map(|(s, id)| p_of(judged, s, id)).collect();
    Ok(Ok((screenings, p)))
}

/// How probable a signature as good as an effect's is by chance. Loops stand in the place of a gain, which moves with all the rest once they
/// are gone: their signature on what is left says little of them, and the error alone decides.
fn p_of(judged: &Judged, screening: &Screening, id: &str) -> Option<f64> {
    if judged.model.effect(id).is_some_and(|e| e.effect.declaration().is_main()) {
        return None;
    }
    screening.scores.iter().find(|s| s.id == id).and_then(|s| s.evidence.as_ref()).map(|e| e.p_adjusted)
}

/// Whether an effect with slow states does as well where nothing of it answers the drive: what it brought are the free motions of its states alone.
fn does_not_answer_the_drive(study: &Study, id: &str, judged: &Judged) -> bool {
    let mut model = judged.model.clone();
    let Some(instance) = model.effects.iter_mut().find(|e| e.id == id) else { return false };
    let by = instance.effect.answers_drive_by();
    for place in &by {
        instance.parameters[*place].value = 0.0;
        instance.parameters[*place].parameter.fixed = true;
    }
    !by.is_empty() && !study.told_apart(&study.judged(study.quickly_within(&model, study.merit(judged), FAR_BEHIND).model), judged)
}

/// A rival with the values of the effect in whose place it is tried, where both are one law at two places, as lags in front of a mode and behind it are: far
/// from there its fit may come to another end.
fn as_it_stands(study: &Study, id: &str, rival: &Score, best: &Judged) -> Option<Model> {
    let instance = best.model.effect(id)?;
    let names = |effect: &dyn Effect| effect.parameters(&study.overview).into_iter().map(|p| p.name).collect::<Vec<_>>();
    let same_law = names(instance.effect.as_ref()) == names(rival.effect.as_ref());
    same_law.then(|| study.with(&study.without(&best.model, id), &[(rival.effect.clone(), instance.values())]))
}

/// What else explains much of what the model without an effect leaves, fitted in its place.
fn rivals_of(study: &Study, id: &str, without: &Judged, screening: &Screening, best: &Judged) -> Vec<Rival> {
    let present = |other: &str| best.model.effect(other).is_some();
    let doing_as: Vec<&Score> =
        screening.doing_as(id, study.policy.rival, RIVALS_SIMILARITY).into_iter().filter(|s| !present(&s.id)).collect();
    let worth: Vec<&Score> = doing_as.into_iter().take(RIVALS_MAX).collect();
    if !worth.is_empty() {
        study.watch.event(&Event::Doing("trying what else could do"));
    }
    let mut rivals = parallel::map(&worth, |score| {
        let begun = |start: &Vec<f64>| {
            let begin = study.with(&without.model, &[(score.effect.clone(), start.clone())]);
            study.quickly_within(&begin, study.merit(best), FAR_BEHIND)
        };
        let mut fitted = begun(&score.starts[0]);
        if missed(study, &fitted, best) < CLEARLY_MISSED {
            let others = score.starts.iter().skip(1).take(if score.effect.starts_combine() { 0 } else { 1 }).map(begun);
            fitted = others.fold(fitted, |a, b| if study.merit(&b) < study.merit(&a) { b } else { a });
        }
        if let Some(begin) = as_it_stands(study, id, score, best) {
            let there = study.quickly_within(&begin, study.merit(best), FAR_BEHIND);
            fitted = if study.merit(&there) < study.merit(&fitted) { there } else { fitted };
        }
        if missed(study, &fitted, best) < CLEARLY_BEHIND {
            fitted = study.for_comparison(&fitted.model);
        }
        let judged = study.judged(fitted.model);
        let decision = if study.told_apart(&judged, best) { Decision::AnotherLeavesLess } else { Decision::NotToldApart };
        Rival { id: score.id.clone(), judged, decision }
    });
    rivals.sort_by(|a, b| study.merit(&a.judged).total_cmp(&study.merit(&b.judged)).then_with(|| a.id.cmp(&b.id)));
    rivals
}
