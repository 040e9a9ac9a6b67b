//! The search: a beam over models, extended by single moves and by pairs.
//!
//! # How it works
//! A round scores all candidates on the residual of each of the best models ([`super::screening`]), and
//! proposes the moves that promise most: an effect added, two added together where the pair explains what
//! neither does alone (creep is not seen before the lag beside it is), loops or creep described more finely.
//! Where a model leaves much more of the held-out records than of the fitted ones, candidates are scored
//! there as well. The most promising are fitted on a part of the samples and go into the pool; the best
//! models that have not been extended are extended next.
//!
//! All of that happens beside one structure of the loops. Beside loops of the wrong structure every effect
//! looks like a better description of them, so the other structures of the library are tried beside each new
//! best model, and each kind that comes near the best has a beam of its own. A structure that takes long comes
//! once and far above the noise only, when there are loops or nothing else helps.

use super::closure::{close_around, exchange, exchange_of};
use super::judgement::Judged;
use super::pool::{Entry, Move, Pool, key};
use super::screening::{CandidateScore, Screening};
use super::study::{FAR_BEHIND, Study};
use crate::error::Result;
use crate::identification::finer_hysteresis::{structure, structure_beside_a_gain};
use crate::identification::held_values::{as_free_as, holding};
use crate::parallel;
use crate::watch::WatchEvent;
use hysteron_sim::chain::Model;
use hysteron_sim::effect::{Effect, LoopsTried, gain, hysteresis};
use std::collections::BTreeSet;
use std::sync::Arc;

/// A search over the models of a pool.
pub struct Search<'s, 'a> {
    /// Data, candidates and thresholds.
    pub study: &'s Study<'a>,
    /// Everything that was fitted.
    pub pool: Pool<'s, 'a>,
    /// Models around which single moves were tried.
    pub closed: BTreeSet<String>,
    /// Effects of the model that it begins at.
    start: Vec<String>,
    /// What did much worse than what it extends, or stands in the place of, by name.
    hopeless: BTreeSet<String>,
    /// Loops of structures that take long were tried.
    slow_loops_tried: bool,
    /// Each effect was fitted beside the start.
    fitted_each: bool,
    /// Effects that no model of this search may have.
    without: Vec<String>,
    /// Moves that a model of this search may have, at most.
    most_moves: usize,
    /// The caller wanted the best so far.
    pub stopped: bool,
    /// Its share of the budget was used before it found nothing more.
    pub out_of_time: bool,
    /// The budget did not reach to test all that would be named.
    pub untested: bool,
}

/// A model that is worth fitting.
struct Proposal {
    key: String,
    /// What is not tried again where it is hopeless: these additions, or this structure of the loops.
    name: String,
    moves: Vec<Move>,
    begin: Model,
    /// Effects that begin in it.
    begun: Vec<String>,
    /// Merit of the model that it extends.
    of: f64,
    /// Error that it may leave, as far as the signatures say.
    promise: f64,
}

/// What is proposed in one round.
#[derive(Default)]
struct Proposals {
    /// By the residuals of fitted records.
    by_fitted: Vec<Proposal>,
    /// By those of all records: what a model has taken in shows only in the held-out ones.
    by_all: Vec<Proposal>,
    /// Beside loops of the other kind.
    beside_other_loops: Vec<Proposal>,
    /// More or freer terms of creep and of play operators.
    finer_terms: Vec<Proposal>,
}

impl<'s, 'a> Search<'s, 'a> {
    /// A search over a pool from its start.
    #[must_use]
    pub fn over(pool: Pool<'s, 'a>) -> Self {
        let start = pool
            .start()
            .map_or_else(Vec::new, |e| e.judged.model.effect_ids());
        let (hopeless, study) = (BTreeSet::new(), pool.study);
        let most_moves = study.policy.effects_max + pool.origin.len();
        Self {
            study,
            pool,
            closed: BTreeSet::new(),
            start,
            hopeless,
            slow_loops_tried: false,
            fitted_each: false,
            without: Vec::new(),
            most_moves,
            stopped: false,
            out_of_time: false,
            untested: false,
        }
    }

    /// Rounds of extension until nothing better comes, or until the recording is in doubt beside the best model.
    ///
    /// # Errors
    /// A candidate that gives something that is no number.
    pub fn run(&mut self, is_in_doubt: &mut dyn FnMut(&Judged) -> bool) -> Result<()> {
        let policy = &self.study.policy;
        let mut without_gain = 0;
        for _ in 0..policy.effects_max + policy.rounds_without_gain_far_above {
            self.stopped = self.study.watch.stopped();
            if self.stopped || self.settled() {
                return Ok(());
            }
            self.out_of_time = self.study.budget.is_over();
            if self.out_of_time {
                return Ok(());
            }
            let before = self.pool.rank(self.pool.best());
            let near = self.study.near_the_noise(&self.pool.best().judged);
            let patience = if near {
                policy.rounds_without_gain
            } else {
                policy.rounds_without_gain_far_above
            };
            if without_gain >= patience {
                return Ok(());
            }
            let mut proposals = self.propose()?;
            if !self.is_bare_gain(self.pool.best()) {
                proposals.extend(self.propose_structures(LoopsTried::AtFirst));
            }
            let has_loops = structure_beside_a_gain(&self.pool.best().judged.model).is_some();
            if !near && (has_loops || without_gain > 0 || proposals.is_empty()) {
                proposals.extend(self.propose_structures(LoopsTried::FarAbove));
            }
            if proposals.is_empty() {
                return Ok(());
            }
            self.fit(proposals);
            self.pool.compare_best();
            if is_in_doubt(&self.pool.best().judged) {
                return Ok(());
            }
            let gained = |search: &Self, before: f64| {
                before - search.pool.rank(search.pool.best()) > policy.least_gain
            };
            if !gained(self, before) && without_gain == 0 && !near {
                let mut before = before;
                while self.look_around()? && gained(self, before) {
                    before = self.pool.rank(self.pool.best());
                }
            }
            without_gain = if gained(self, before) {
                0
            } else {
                without_gain + 1
            };
        }
        Ok(())
    }

    /// Where a round brought nothing: single moves around the best model, and beside the start each effect that
    /// no model has alone, fitted, whatever its signature promises. What a lag that stands in for another effect
    /// leaves does not show that effect. Whether that was not done before.
    fn look_around(&mut self) -> Result<bool> {
        let best = self.pool.best();
        let key = key(&best.moves, &best.judged.model);
        if self.study.met(&best.judged) || !self.closed.insert(key.clone()) {
            return Ok(false);
        }
        close_around(&mut self.pool, &key)?;
        if !std::mem::replace(&mut self.fitted_each, true) {
            self.fit_each_beside_start()?;
        }
        self.pool.compare_best();
        Ok(true)
    }

    fn fit_each_beside_start(&mut self) -> Result<()> {
        let study = self.study;
        let Some(start) = self.pool.start().cloned() else {
            return Ok(());
        };
        let model = &start.judged.model;
        let with = |effect: &Arc<dyn Effect>| {
            let one = Move::Added(effect.declaration().id);
            let mut moves = [start.moves.as_slice(), &[one]].concat();
            moves.sort();
            moves
        };
        let mut untried = study.candidates_for(model);
        untried.retain(|effect| {
            let moves = with(effect);
            self.pool.entries.values().all(|known| known.moves != moves)
        });
        let fitted = study.budget.while_it_lasts(&untried, |effect| {
            let id = effect.declaration().id;
            let (begin, alone) =
                study.found_alone(model, effect, study.policy.guesses, start.merit)?;
            if study.merit(&alone) >= start.merit - study.policy.least_gain {
                return Ok(None);
            }
            let around = study.quickly(&holding(&begin, |effect, _| effect == id));
            let judged = study.for_comparison(&as_free_as(around.model, &begin));
            Ok(Some(Entry::new(study, with(effect), judged, true)))
        });
        let fitted: Vec<Option<Entry>> = fitted.into_iter().collect::<Result<_>>()?;
        fitted.into_iter().flatten().for_each(|e| self.pool.keep(e));
        Ok(())
    }

    /// A search of its own for the best model without some effects and with no more moves than a model has: from
    /// this model less the effects, what does much the same in the place of each, then every other move open,
    /// until nothing better comes or one does as well as the best of all. Whether it came to its end.
    ///
    /// # Errors
    /// A candidate that gives something that is no number.
    pub fn run_without(&mut self, ids: &[String], from: &Entry) -> Result<bool> {
        let (study, most_moves) = (self.study, self.most_moves);
        self.without = ids.to_vec();
        self.most_moves = from.moves.len();
        let of = self.pool.best().merit;
        let less = |model: Model, id: &String| study.without(&model, id);
        let begin = ids.iter().fold(from.judged.model.clone(), less);
        let is_open = |id: &&String| {
            from.moves.contains(&Move::Added((*id).clone()))
                && !self.pool.exchanged.contains(&exchange_of(from, id))
        };
        let its: Vec<String> = ids.iter().filter(is_open).cloned().collect();
        if !from.held && !its.is_empty() {
            exchange(&mut self.pool, from, &its)?;
        }
        let judged = study.quickly_within(&begin, of, FAR_BEHIND);
        let has = |m: &&Move| judged.model.effect(m.effect()).is_some();
        let moves = from.moves.iter().filter(has).cloned().collect();
        self.pool.keep(Entry::new(study, moves, judged, false));
        let found = self.ablation_rounds();
        self.without.clear();
        self.most_moves = most_moves;
        found
    }

    fn ablation_rounds(&mut self) -> Result<bool> {
        for _ in 0..self.study.policy.effects_max {
            self.stopped = self.study.watch.stopped();
            let is_over = self.study.budget.is_over();
            let (best, of_all) = (self.best(), self.pool.best());
            // As good as the model with the effects: selection compares both.
            let as_good = self.pool.rank(best) <= self.pool.rank(of_all);
            if self.stopped || is_over || as_good {
                return Ok(as_good);
            }
            // What is further behind, and promises no more than to stay so, is rejected whatever comes of it.
            let (before, reach) = (self.pool.rank(best), of_all.merit + FAR_BEHIND);
            let is_near = best.merit <= reach;
            let mut proposals = self.propose()?;
            proposals.retain(|p| p.promise.ln() <= reach);
            if is_near {
                proposals.extend(self.propose_structures(LoopsTried::AtFirst));
            }
            if proposals.is_empty() {
                return Ok(true);
            }
            self.fit(proposals);
            let best: Vec<String> = self.open().take(1).map(|(k, _)| k.clone()).collect();
            self.pool.compare(&best);
            if before - self.pool.rank(self.best()) <= self.study.policy.least_gain {
                return Ok(true);
            }
        }
        Ok(true)
    }

    /// The models that this search may have, best first.
    fn open(&self) -> impl Iterator<Item = (&String, &Entry)> {
        let may_have = |(_, e): &(&String, &Entry)| {
            let has = |id: &String| e.judged.model.effect(id).is_some();
            self.without.is_empty()
                || e.moves.len() <= self.most_moves && !self.without.iter().any(has)
        };
        self.pool.ranked().into_iter().filter(may_have)
    }

    /// The best of these of which no effect is excluded by its own physics, or else the best.
    fn best(&self) -> &Entry {
        let admissible = self.open().find(|(_, e)| !e.is_excluded());
        admissible.map_or_else(|| self.pool.best(), |(_, e)| e)
    }

    /// Nothing is left to be explained.
    fn settled(&self) -> bool {
        let best = &self.pool.best().judged;
        self.study.met(best) && self.study.nothing_left(best)
    }

    /// The start, where that is a gain: the surfaces, a candidate like others, come first in its place.
    fn is_bare_gain(&self, entry: &Entry) -> bool {
        entry.moves == self.pool.origin
            && structure(&entry.judged.model).as_deref() == Some(gain::ID)
    }

    /// Fits proposals, the most promising of each kind first, until the budget ends.
    fn fit(&mut self, proposals: Vec<Proposal>) {
        let fitted = self.study.budget.while_it_lasts(&proposals, |p| {
            self.study.quickly_beside(&p.begin, &p.begun, p.of)
        });
        for (proposal, judged) in proposals.iter().zip(fitted) {
            if self.study.merit(&judged) > proposal.of + self.study.policy.hopeless {
                self.hopeless.insert(proposal.name.clone());
            }
            self.pool.keep(Entry::new(
                self.study,
                proposal.moves.clone(),
                judged,
                false,
            ));
        }
    }

    /// The best model, and the start, with loops of the other structures that are tried at this time.
    fn propose_structures(&mut self, at: LoopsTried) -> Vec<Proposal> {
        if at == LoopsTried::FarAbove && std::mem::replace(&mut self.slow_loops_tried, true) {
            return Vec::new();
        }
        let mut out: Vec<Proposal> = Vec::new();
        for entry in std::iter::once(self.best()).chain(self.pool.start()) {
            let before: Vec<String> = out.iter().map(|p| p.key.clone()).collect();
            for (key, moves, begin) in self.pool.with_other_structures(entry, at) {
                let may_have = !self.without.iter().any(|id| begin.effect(id).is_some());
                let name = structure(&begin).unwrap_or_default();
                if may_have && !before.contains(&key) && !self.hopeless.contains(&name) {
                    let of = entry.merit + self.study.policy.loops_come_near;
                    out.push(Proposal {
                        key,
                        name,
                        moves,
                        begin,
                        begun: Vec::new(),
                        of,
                        promise: 0.0,
                    });
                }
            }
        }
        out
    }

    /// Extensions of the best models that have not been extended.
    fn propose(&mut self) -> Result<Vec<Proposal>> {
        let (study, policy) = (self.study, &self.study.policy);
        let best = self.best();
        let (kind, near) = (
            has_surfaces(&best.judged.model),
            self.pool.rank(best) + policy.loops_come_near,
        );
        let far_above = !study.near_the_noise(&best.judged);
        // Without what would be named only a model near the best counts. With everything open, two of 28 tapes
        // of other equations end higher where models behind by as much are not extended.
        let reach = if self.without.is_empty() {
            f64::INFINITY
        } else {
            best.merit + FAR_BEHIND
        };
        let open = |of: bool| {
            self.open().filter(move |(_, e)| {
                !e.extended && e.merit < reach && has_surfaces(&e.judged.model) == of
            })
        };
        let others = open(!kind)
            .filter(|(_, e)| self.pool.rank(e) < near)
            .take(policy.width);
        let extended: Vec<(String, Entry)> = open(kind)
            .take(policy.width)
            .chain(others)
            .map(|(k, e)| (k.clone(), e.clone()))
            .collect();
        for (key, _) in &extended {
            if let Some(entry) = self.pool.entries.get_mut(key) {
                entry.extended = true;
            }
        }
        let screenings = parallel::map(&extended, |(_, entry)| {
            let model = &entry.judged.model;
            let mut candidates = study.candidates_for(model);
            candidates.retain(|e| !self.without.contains(&e.declaration().id));
            study.watch.event(&WatchEvent::Scoring {
                candidates: candidates.len(),
                beside: &entry.added(),
            });
            if far_above && study.fails_held_out(&entry.judged) {
                let [fitted, on_all] = study.score_on_fitted_and_all(model, &candidates)?;
                return Ok((fitted, Some(on_all)));
            }
            Ok((study.score_each(model, &candidates)?, None))
        });
        let mut proposed = Proposals::default();
        for ((_, entry), screening) in extended.iter().zip(screenings) {
            let (screening, on_all) = screening?;
            let model = &entry.judged.model;
            let of_its_kind = has_surfaces(model) == kind;
            let proposals = if of_its_kind {
                &mut proposed.by_fitted
            } else {
                &mut proposed.beside_other_loops
            };
            let first = proposals.is_empty();
            if first {
                self.offer_finer(study.finer(model), entry, &screening, proposals);
                self.offer_finer(
                    study.finer_plays(model),
                    entry,
                    &screening,
                    &mut proposed.finer_terms,
                );
            }
            self.propose_effects(entry, &screening, proposals);
            // Far above the noise a finer creep decides which of two that are nearly as good goes on; near
            // it, it would stand in for what is missing.
            if first || (far_above && of_its_kind) {
                self.offer_finer(
                    study.finer_creep(model),
                    entry,
                    &screening,
                    &mut proposed.finer_terms,
                );
            }
            if let Some(on_all) = on_all.filter(|_| of_its_kind) {
                self.propose_effects(entry, &on_all, &mut proposed.by_all);
            }
        }
        Ok(proposed.most_promising(policy.trials))
    }

    /// The effects and the pairs that promise most beside a model.
    fn propose_effects(&self, entry: &Entry, screening: &Screening, out: &mut Vec<Proposal>) {
        let policy = &self.study.policy;
        let room = self.most_moves.saturating_sub(entry.moves.len());
        let total = screening.total_um2().max(f64::MIN_POSITIVE);
        let scores = &screening.scores;
        let at_the_noise = self.study.merit_is_at_the_noise(entry.merit);
        for (place, score) in scores
            .iter()
            .take(if room > 0 { policy.singles } else { 0 })
            .enumerate()
        {
            let left = 1.0 - score.explained_um2 / total;
            let seen = at_the_noise && self.study.seen_in_the_noise(score);
            let left = if seen {
                left.min(policy.promises_nothing)
            } else {
                left
            };
            // The strongest are begun from two sides.
            let guesses = if place < policy.guesses && !score.effect.declaration().starts_combine {
                policy.guesses
            } else {
                1
            };
            for start in score.starts.iter().take(guesses) {
                let begin = self.study.with(
                    &entry.judged.model,
                    &[(score.effect.clone(), start.clone())],
                );
                self.offer(entry, &[score], begin, left, out);
            }
        }
        let mut pairs: Vec<(f64, [&CandidateScore; 2])> = Vec::new();
        let paired = &scores[..scores.len().min(if room > 1 { policy.paired } else { 0 })];
        for (i, a) in paired.iter().enumerate() {
            for b in &paired[i + 1..] {
                let left = 1.0 - screening.together(a, b) / total;
                let alone = 1.0 - a.explained_um2.max(b.explained_um2) / total;
                if left < policy.better_together * alone {
                    pairs.push((left, [a, b]));
                }
            }
        }
        pairs.sort_by(|x, y| x.0.total_cmp(&y.0));
        for (left, both) in pairs.into_iter().take(policy.pairs) {
            let begins: Vec<_> = both
                .iter()
                .map(|s| (s.effect.clone(), s.starts[0].clone()))
                .collect();
            self.offer(
                entry,
                &both,
                self.study.with(&entry.judged.model, &begins),
                left,
                out,
            );
        }
    }

    fn offer_finer(
        &self,
        finer: Vec<Model>,
        entry: &Entry,
        screening: &Screening,
        out: &mut Vec<Proposal>,
    ) {
        let left = screening.left_by_finer_um2() / screening.total_um2().max(f64::MIN_POSITIVE);
        finer
            .into_iter()
            .for_each(|begin| self.offer(entry, &[], begin, left, out));
    }

    fn offer(
        &self,
        entry: &Entry,
        scores: &[&CandidateScore],
        begin: Model,
        left: f64,
        out: &mut Vec<Proposal>,
    ) {
        if left > self.study.policy.promises_nothing {
            return;
        }
        let new = scores.iter().map(|s| Move::Added(s.id.clone()));
        let mut moves: Vec<Move> = entry.moves.iter().cloned().chain(new).collect();
        moves.retain(|m| {
            matches!(m, Move::Freed(_))
                || (!self.start.iter().any(|id| id == m.effect())
                    && begin.effect(m.effect()).is_some())
        });
        moves.sort();
        moves.dedup();
        let key = key(&moves, &begin);
        // A set that is known from another side is only tried again from a second initial guess in the same
        // round.
        let name = names(&moves);
        let hopeless = !scores.is_empty() && self.hopeless.contains(&name);
        if !self.pool.entries.contains_key(&key) && !hopeless {
            let begun = scores.iter().map(|s| s.id.clone()).collect();
            out.push(Proposal {
                key,
                name,
                moves,
                begin,
                begun,
                of: entry.merit,
                promise: entry.merit.exp() * left,
            });
        }
    }
}

impl Proposals {
    fn most_promising(self, trials: usize) -> Vec<Proposal> {
        let Self {
            by_fitted: mut out,
            mut by_all,
            mut beside_other_loops,
            finer_terms,
        } = self;
        // Where models fail held-out records, most trials go to what shows there.
        let of_all = if by_all.is_empty() {
            0
        } else {
            trials.div_ceil(2)
        };
        keep_most_promising(&mut out, trials - of_all);
        by_all.retain(|one| out.iter().all(|other| other.key != one.key));
        keep_most_promising(&mut by_all, of_all);
        keep_most_promising(&mut beside_other_loops, trials.div_ceil(2));
        out.into_iter()
            .chain(by_all)
            .chain(beside_other_loops)
            .chain(finer_terms)
            .collect()
    }
}

fn keep_most_promising(proposals: &mut Vec<Proposal>, most: usize) {
    proposals.sort_by(|a, b| {
        a.promise
            .total_cmp(&b.promise)
            .then_with(|| a.key.cmp(&b.key))
    });
    proposals.truncate(most);
}

fn names(moves: &[Move]) -> String {
    moves.iter().map(Move::effect).collect::<Vec<_>>().join("+")
}

/// Whether a model has the surfaces of the thesis for its loops, or none yet.
fn has_surfaces(model: &Model) -> bool {
    structure(model).is_none_or(|of| [hysteresis::ID, gain::ID].contains(&of.as_str()))
}
