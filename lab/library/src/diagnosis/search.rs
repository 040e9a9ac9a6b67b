//! The search over sets of effects: several models are kept and extended, a set is fitted once however it was reached.
//!
//! # How it works
//! A round scores all candidates on what each of the best models leaves, and proposes the sets that promise most: one effect more, or two
//! where together they explain what neither does alone (creep is not seen before the lag beside it is), or a finer description of the
//! hysteresis or the creep. Far above the noise a model can take in what it lacks, as creep and friction do a lag at the speeds that were fitted, and then fails the
//! held-out records: candidates are scored there too. The most promising are fitted on a part of the samples and take their place among all that were fitted; the best that have
//! not been extended yet are extended next. Where additions bring nothing more, effects of the best model are exchanged for others that do much
//! the same beside it ([`Screening::doing_as`]): the first to be added was the best of few. The search ends when nothing is left above the
//! noise, or when neither brings a better model.
//!
//! All of that happens beside one structure of the loops. Where surfaces are not what the loops are, every effect looks like a better description
//! of them. So the other structures of the library are tried in their place, alone and with what was added; as long as one of them comes near, it is extended
//! side by side with the surfaces.
//! What comes out depends on the data alone, not on the order of effects or records, because all sets are compared with one another by
//! fitted and held-out error.

use super::judgement::Judged;
use super::screening::{Score, Screening};
use super::study::Study;
use crate::error::Result;
use crate::identification::{finer_creep, finer_hysteresis};
use crate::parallel;
use crate::watch::Event;
use hysteron_sim::chain::Model;
use hysteron_sim::effect::{gain, hysteresis};
use std::collections::{BTreeMap, BTreeSet};

/// A set of effects that was fitted.
#[derive(Clone)]
pub struct Node {
    /// What was added to the start, by name.
    pub added: Vec<String>,
    /// The model and its errors on the samples of the search.
    pub judged: Judged,
    /// Its merit, which is asked for often.
    merit: f64,
    extended: bool,
    compared: bool,
}

impl Node {
    /// The start, where that is a gain: the surfaces, which are a candidate as effects are, come first in its place.
    fn is_bare_gain(&self) -> bool {
        self.added.is_empty() && structure(&self.judged.model).as_deref() == Some(gain::ID)
    }
}

/// Everything that a search has fitted.
pub struct Search<'s, 'a> {
    study: &'s Study<'a>,
    start: Vec<String>,
    nodes: BTreeMap<String, Node>,
    /// Sets that were much worse than what they extend: they are not tried again beside another description of the hysteresis.
    hopeless: BTreeSet<String>,
    /// Loops of other structures have been tried.
    structures_tried: bool,
    /// Rounds in which loops of the other kind than the best has did not come nearer to it.
    others_no_nearer: usize,
    /// The caller wanted the best so far.
    pub stopped: bool,
    /// Its time was over before it found nothing more.
    pub out_of_time: bool,
}

/// A model that is worth fitting.
struct Proposal {
    key: String,
    added: Vec<String>,
    begin: Model,
    /// Effects that begin in it.
    begun: Vec<String>,
    /// Merit of the model that it extends.
    of: f64,
    /// Error that it may leave, as far as the signatures tell.
    promise: f64,
}

/// An extension whose merit is worse by this much than that of what it extends.
const HOPELESS: f64 = 0.2;
/// Singles of a model that are proposed at most.
const SINGLES: usize = 6;
/// Candidates of which pairs are formed.
const PAIRED: usize = 9;
/// Pairs of a model that are proposed at most.
const PAIRS: usize = 3;
/// Of the extensions that are fitted in one round, those that fitted and held-out records show together where a model fails the held-out ones.
const HELD_OUT_TRIALS: usize = 3;
/// A pair is worth a trial of its own where it leaves less than this share of what the better of the two leaves alone.
const BETTER_TOGETHER: f64 = 0.8;

/// A model with loops of another structure comes near the best where it leaves less than this times as much, as a logarithm. On the recorded stage, whose
/// loops are met by surfaces, following others that left up to three times as much took a third of a search.
const COMES_NEAR: f64 = 0.5;
/// Models with loops of the other kind than the best has that are extended beside those of its own.
const OTHER_LOOPS_WIDTH: usize = 2;
/// Fall of the rank that an effect must bring beside other loops than those it was added to, to be taken along.
const LIKELY_MADE_UP: f64 = 0.05;
/// Extensions of these that are fitted in one round.
const OTHER_LOOPS_TRIALS: usize = 3;
/// Rounds in which they come no nearer to the best after which they are left.
const OTHER_LOOPS_PATIENCE: usize = 2;

/// Others that are tried in the place of an effect.
const EXCHANGED: usize = 3;
/// An effect is exchanged for one whose signature is at least so much like its own. On the recorded stage lags and delays are like one another to
/// 0.84 and more; creep and friction are like them, and like each other, to 0.8 at most, and are tried with them.
const EXCHANGED_SIMILARITY: f64 = 0.7;

impl<'s, 'a> Search<'s, 'a> {
    /// A search that begins at a fitted model.
    #[must_use]
    pub fn from(study: &'s Study<'a>, start: &Model) -> Self {
        let judged = study.judged_quickly(start.clone());
        let mut search = Self {
            study,
            start: start.effect_ids(),
            nodes: BTreeMap::new(),
            hopeless: BTreeSet::new(),
            structures_tried: false,
            others_no_nearer: 0,
            stopped: false,
            out_of_time: false,
        };
        let node = Node { added: Vec::new(), merit: study.merit(&judged), judged, extended: false, compared: true };
        search.nodes.insert(key(&[], start), node);
        search
    }

    /// Rank of a node: its merit, and a little for each effect and each step of a finer hysteresis more.
    fn rank(&self, node: &Node) -> f64 {
        let more = node.added.len() + Study::steps_finer(&node.judged.model);
        node.merit + self.study.policy.gain_per_effect * more as f64
    }

    /// All nodes with their keys, best first.
    fn ranked(&self) -> Vec<(&String, &Node)> {
        let mut out: Vec<(&String, &Node)> = self.nodes.iter().collect();
        out.sort_by(|a, b| self.rank(a.1).total_cmp(&self.rank(b.1)).then_with(|| a.0.cmp(b.0)));
        out
    }

    /// The best node.
    #[must_use]
    pub fn best(&self) -> &Node {
        self.ranked()[0].1
    }

    /// Rank of the best node whose loops are of the other kind than those of the best of all: surfaces, or another structure.
    fn rank_of_other_loops(&self) -> f64 {
        let kind = has_surfaces(&self.best().judged.model);
        self.ranked().into_iter().find(|(_, n)| has_surfaces(&n.judged.model) != kind).map_or(f64::INFINITY, |(_, n)| self.rank(n))
    }

    /// Runs until nothing better comes. Where something is left then, the other structures of the loops are tried once more, beside all that was
    /// added.
    ///
    /// # Errors
    /// A candidate that gives something that is no number.
    pub fn run(&mut self) -> Result<()> {
        self.run_rounds()?;
        // Where not even surfaces in the place of a gain bring anything, it is not the loops that are missing.
        if self.stopped || self.out_of_time || self.explained() || self.best().is_bare_gain() {
            return Ok(());
        }
        let before = self.rank(self.best());
        let proposals = self.propose_structures();
        self.fit(proposals);
        self.compare_best();
        if before - self.rank(self.best()) > self.study.policy.least_gain { self.run_rounds() } else { Ok(()) }
    }

    /// Nothing is left to be explained.
    fn settled(&self) -> bool {
        let best = &self.best().judged;
        self.study.met(best) && self.study.nothing_left(best)
    }

    /// What is left is near enough to the noise for a verdict.
    fn explained(&self) -> bool {
        self.best().judged.within(self.study.policy.explained, &self.study.floors_um, &self.study.split)
    }

    /// Rounds of extension until nothing better comes.
    fn run_rounds(&mut self) -> Result<()> {
        let policy = &self.study.policy;
        let mut without_gain = 0;
        let rounds = policy.effects_max + policy.rounds_without_gain_far_above + policy.exchanges_max;
        let mut exchanges = 0;
        for _ in 0..rounds {
            if self.study.watch.stopped() {
                self.stopped = true;
                return Ok(());
            }
            let (before, other_before) = (self.rank(self.best()), self.rank_of_other_loops());
            if self.settled() {
                return Ok(());
            }
            if self.study.watch.searched_enough() {
                self.out_of_time = true;
                return Ok(());
            }
            let near = self.study.near_the_noise(&self.best().judged);
            let patience = if near { policy.rounds_without_gain } else { policy.rounds_without_gain_far_above };
            let mut proposals = if without_gain < patience { self.propose()? } else { Vec::new() };
            let exchanging = proposals.is_empty();
            if exchanging {
                exchanges += 1;
                if exchanges > policy.exchanges_max {
                    return Ok(());
                }
                proposals = self.propose_exchanges()?;
            } else if !self.structures_tried && !self.best().is_bare_gain() {
                proposals.extend(self.propose_structures());
            }
            self.fit(proposals);
            self.compare_best();
            let best = self.rank(self.best());
            let gained = before - best > policy.least_gain;
            // A second look at the same model would exchange the same.
            if exchanging && !gained {
                return Ok(());
            }
            // Loops of the other kind that come near are on their way as long as they get nearer.
            let other = self.rank_of_other_loops();
            let other_gained = other < best + COMES_NEAR && other_before - other > policy.least_gain;
            // Where there were none before, they have only come.
            let stayed_away = other_before.is_finite() && (other_before - before) - (other - best) <= policy.least_gain;
            self.others_no_nearer = if stayed_away { self.others_no_nearer + 1 } else { 0 };
            without_gain = if gained || other_gained { 0 } else { without_gain + 1 };
        }
        Ok(())
    }

    /// Fits what was proposed.
    fn fit(&mut self, proposals: Vec<Proposal>) {
        let fitted = parallel::map(&proposals, |p| self.study.quickly_beside(&p.begin, &p.begun, p.of));
        for (proposal, judged) in proposals.into_iter().zip(fitted) {
            let merit = self.study.merit(&judged);
            if merit > proposal.of + HOPELESS {
                self.hopeless.insert(proposal.added.join("+"));
            }
            self.keep(proposal.key, Node { added: proposal.added, judged, merit, extended: false, compared: false });
        }
    }

    /// The best model with one of its effects exchanged for another that does much the same: what was added first was the best of few effects
    /// then, and need not be the best beside those that came after it.
    fn propose_exchanges(&self) -> Result<Vec<Proposal>> {
        let best = self.best();
        let may_leave =
            |id: &&String| best.judged.model.effect(id).is_some_and(|e| e.effect.may_leave() && !e.effect.declaration().is_main());
        let leaving: Vec<&String> = best.added.iter().filter(may_leave).collect();
        let bases: Vec<Model> = leaving.iter().map(|id| self.study.without(&best.judged.model, id)).collect();
        // Which lag it is shows near the noise, and matters where what was found does not explain all.
        let near = self.study.near_the_noise(&best.judged) && !self.explained();
        let screenings = parallel::map(&bases, |base| {
            let others = if near { self.study.candidates_in_exchange(base) } else { self.study.candidates_for(base) };
            self.study.score_each(base, &others)
        });
        let relative = best.merit.exp();
        let mut out = Vec::new();
        for ((id, base), screening) in leaving.into_iter().zip(&bases).zip(screenings) {
            let screening = screening?;
            let without = Node {
                added: best.added.iter().filter(|other| *other != id && base.effect(other).is_some()).cloned().collect(),
                ..best.clone()
            };
            for score in screening.doing_as(id, self.study.policy.rival, EXCHANGED_SIMILARITY).into_iter().take(EXCHANGED) {
                let begin = self.study.with(base, &[(score.effect.clone(), score.starts[0].clone())]);
                self.offer(&without, &[score], begin, relative, 0.0, &mut out);
            }
        }
        Ok(out)
    }

    /// The best model, and the start, with loops of the other structures: beside loops of the wrong structure every effect looks like a better
    /// description of them.
    fn propose_structures(&mut self) -> Vec<Proposal> {
        let best = self.best().clone();
        let Some(start) = self.nodes.values().find(|n| n.added.is_empty()).cloned() else { return Vec::new() };
        let mut out: Vec<Proposal> = Vec::new();
        for node in [&best, &start] {
            for begin in finer_hysteresis::of_other_structures(&node.judged.model, &self.study.overview) {
                let kept = node.added.iter().filter(|id| begin.effect(id).is_some()).cloned();
                // Beside loops that were there from the beginning another structure is no effect more.
                let loops_added = self.start.iter().any(|id| id == gain::ID);
                let mut added: Vec<String> = kept.chain(structure(&begin).filter(|_| loops_added)).collect();
                added.sort();
                let key = key(&added, &begin);
                if !self.nodes.contains_key(&key) && !out.iter().any(|p| p.key == key) {
                    // Whether the effects are hopeless beside other loops does not follow from what they do here; these loops are, where half way they come
                    // nowhere near. Once all that was added stands beside them they would have to be better.
                    let near = if self.structures_tried { 0.5 * COMES_NEAR } else { COMES_NEAR };
                    out.push(Proposal { key, added, begin, begun: Vec::new(), of: node.merit + near, promise: 0.0 });
                }
            }
        }
        self.structures_tried |= !out.is_empty();
        out
    }

    /// Takes a node into account, unless the same set was fitted better.
    fn keep(&mut self, key: String, node: Node) {
        if !node.judged.identify_rms_um.is_finite() {
            return;
        }
        let best = self.rank(&node) < self.rank(self.best());
        let (study, judged) = (self.study, &node.judged);
        study.watch.event(&Event::Tried {
            added: &node.added,
            identify_rms_um: judged.identify_rms_um,
            validate_rms_um: judged.validate_rms_um,
            best,
        });
        match self.nodes.get(&key) {
            Some(known) if self.rank(known) <= self.rank(&node) => {}
            _ => {
                self.nodes.insert(key, node);
            }
        }
    }

    /// Brings the best few as far as they can be compared, until those that are best have been.
    fn compare_best(&mut self) {
        while self.compare_once() {}
    }

    fn compare_once(&mut self) -> bool {
        let best = self.ranked().into_iter().take(self.study.policy.width);
        let pending: Vec<String> = best.filter(|(_, n)| !n.compared).map(|(k, _)| k.clone()).collect();
        let more = !pending.is_empty();
        let fitted = parallel::map(&pending, |k| self.study.for_comparison(&self.nodes[k].judged.model));
        for (key, judged) in pending.into_iter().zip(fitted) {
            let Some(node) = self.nodes.get_mut(&key) else { continue };
            node.compared = true;
            // What a fit comes to is what counts, on held-out records too: a good error half way is chance.
            node.merit = self.study.merit(&judged);
            node.judged = judged;
        }
        more
    }

    /// Extensions of the best models that have not been extended.
    fn propose(&mut self) -> Result<Vec<Proposal>> {
        let best = self.best();
        let (kind, near) = (has_surfaces(&best.judged.model), self.rank(best) + COMES_NEAR);
        let far_above = !self.study.near_the_noise(&best.judged);
        let open = |of: bool| self.ranked().into_iter().filter(move |(_, n)| !n.extended && has_surfaces(&n.judged.model) == of);
        // What is missing beside loops of one structure is not what seems to be beside those of another: both go on, side by side.
        let followed = self.others_no_nearer < OTHER_LOOPS_PATIENCE;
        let mut others: Vec<(&String, &Node)> = open(!kind).filter(|(_, n)| followed && self.rank(n) < near).collect();
        // Effects that were added beside one kind of loops, and bring next to nothing beside the other, made up for the loops.
        let plainly = |n: &Node| self.rank(n) + LIKELY_MADE_UP * n.added.len() as f64;
        others.sort_by(|a, b| plainly(a.1).total_cmp(&plainly(b.1)).then_with(|| a.0.cmp(b.0)));
        let extended = open(kind).take(self.study.policy.width).chain(others.into_iter().take(OTHER_LOOPS_WIDTH));
        let (keys, nodes): (Vec<String>, Vec<Node>) = extended.map(|(k, n)| (k.clone(), n.clone())).unzip();
        for k in &keys {
            if let Some(node) = self.nodes.get_mut(k) {
                node.extended = true;
            }
        }
        let screenings = parallel::map(&nodes, |node| {
            let model = &node.judged.model;
            let candidates = self.study.candidates_for(model);
            self.study.watch.event(&Event::Scoring { candidates: candidates.len(), beside: &node.added });
            if far_above && self.study.fails_held_out(&node.judged) {
                let [fitted, on_all] = self.study.score_on_fitted_and_all(model, &candidates)?;
                return Ok((fitted, Some(on_all)));
            }
            Ok((self.study.score_each(model, &candidates)?, None))
        });
        let mut proposed = Proposals::default();
        for (node, screening) in nodes.iter().zip(screenings) {
            let (screening, on_all) = screening?;
            let of_its_kind = has_surfaces(&node.judged.model) == kind;
            let proposals = if of_its_kind { &mut proposed.by_fitted } else { &mut proposed.beside_other_loops };
            let first = proposals.is_empty();
            if first {
                self.offer_finer(self.study.finer(&node.judged.model), node, &screening, proposals);
                self.offer_finer(self.study.finer_plays(&node.judged.model), node, &screening, &mut proposed.finer_terms);
            }
            self.propose_effects(node, &screening, proposals);
            // Far above the noise a finer creep decides which of two that are nearly as good goes on; near it, it would stand in for what is missing.
            if first || (far_above && of_its_kind) {
                self.offer_finer(self.study.finer_creep(&node.judged.model), node, &screening, &mut proposed.finer_terms);
            }
            if let Some(on_all) = on_all.filter(|_| of_its_kind) {
                self.propose_effects(node, &on_all, &mut proposed.by_all);
            }
        }
        Ok(proposed.most_promising(self.study.policy.trials))
    }

    fn propose_effects(&self, node: &Node, screening: &Screening, out: &mut Vec<Proposal>) {
        if node.added.len() >= self.study.policy.effects_max {
            return;
        }
        let total = screening.total_um2().max(f64::MIN_POSITIVE);
        let relative = node.merit.exp();
        let scores = &screening.scores;
        let at_the_noise = self.study.merit_is_at_the_noise(node.merit);
        for (place, score) in scores.iter().take(SINGLES).enumerate() {
            let left = 1.0 - score.explained_um2 / total;
            let seen = at_the_noise && self.study.seen_in_the_noise(score);
            let left = if seen { left.min(self.study.policy.promises_nothing) } else { left };
            // The strongest are begun from two sides.
            for (beginning, start) in score.starts.iter().take(if place < 2 && !score.effect.starts_combine() { 2 } else { 1 }).enumerate()
            {
                let begin = self.study.with(&node.judged.model, &[(score.effect.clone(), start.clone())]);
                self.offer(node, &[score], begin, relative, left + 0.02 * beginning as f64, out);
            }
        }
        let mut pairs: Vec<(f64, usize, usize)> = Vec::new();
        for a in 0..scores.len().min(PAIRED) {
            for b in a + 1..scores.len().min(PAIRED) {
                let left = 1.0 - screening.together(&scores[a], &scores[b]) / total;
                let alone = 1.0 - scores[a].explained_um2.max(scores[b].explained_um2) / total;
                if left < BETTER_TOGETHER * alone {
                    pairs.push((left, a, b));
                }
            }
        }
        pairs.sort_by(|x, y| x.0.total_cmp(&y.0));
        for (left, a, b) in pairs.into_iter().take(PAIRS) {
            let both = [&scores[a], &scores[b]];
            if node.added.len() + 2 > self.study.policy.effects_max {
                continue;
            }
            let begins: Vec<_> = both.iter().map(|s| (s.effect.clone(), s.starts[0].clone())).collect();
            let begin = self.study.with(&node.judged.model, &begins);
            self.offer(node, &both, begin, relative, left, out);
        }
    }

    fn offer_finer(&self, finer: Vec<Model>, node: &Node, screening: &Screening, out: &mut Vec<Proposal>) {
        let relative = node.merit.exp();
        let left = screening.left_by_finer_um2() / screening.total_um2().max(f64::MIN_POSITIVE);
        for begin in finer {
            self.offer(node, &[], begin, relative, left, out);
        }
    }

    fn offer(&self, node: &Node, scores: &[&Score], begin: Model, relative: f64, left: f64, out: &mut Vec<Proposal>) {
        if left > self.study.policy.promises_nothing {
            return;
        }
        let mut added: Vec<String> = node.added.iter().cloned().chain(scores.iter().map(|s| s.id.clone())).collect();
        added.retain(|id| !self.start.contains(id) && begin.effect(id).is_some());
        added.sort();
        added.dedup();
        let key = key(&added, &begin);
        // A set that is known from another side is only tried again from a second beginning in the same round.
        let hopeless = !scores.is_empty() && self.hopeless.contains(&added.join("+"));
        if !self.nodes.contains_key(&key) && !hopeless {
            let begun = scores.iter().map(|s| s.id.clone()).collect();
            out.push(Proposal { key, added, begin, begun, of: node.merit, promise: relative * left });
        }
    }
}

/// What is proposed in one round.
#[derive(Default)]
struct Proposals {
    /// By what models leave of the records that are fitted.
    by_fitted: Vec<Proposal>,
    /// By what those that fail held-out records leave of all: what a model has taken in shows only there.
    by_all: Vec<Proposal>,
    /// Beside loops of the other kind.
    beside_other_loops: Vec<Proposal>,
    /// More terms of creep and of play operators, or freer ones, take the place of no effect that may be missing.
    finer_terms: Vec<Proposal>,
}

impl Proposals {
    fn most_promising(self, trials: usize) -> Vec<Proposal> {
        let Self { by_fitted: mut out, mut by_all, mut beside_other_loops, finer_terms } = self;
        keep_most_promising(&mut out, if by_all.is_empty() { trials } else { trials.saturating_sub(HELD_OUT_TRIALS) });
        by_all.retain(|one| out.iter().all(|other| other.key != one.key));
        keep_most_promising(&mut by_all, HELD_OUT_TRIALS);
        keep_most_promising(&mut beside_other_loops, OTHER_LOOPS_TRIALS);
        out.into_iter().chain(by_all).chain(beside_other_loops).chain(finer_terms).collect()
    }
}

fn keep_most_promising(proposals: &mut Vec<Proposal>, most: usize) {
    proposals.sort_by(|a, b| a.promise.total_cmp(&b.promise).then_with(|| a.key.cmp(&b.key)));
    proposals.truncate(most);
}

/// Whether a model has the surfaces of the thesis for its loops, or none yet.
fn has_surfaces(model: &Model) -> bool {
    structure(model).is_none_or(|of| [hysteresis::ID, gain::ID].contains(&of.as_str()))
}

/// The structure of the loops of a model: the effect that stands for its hysteresis.
fn structure(model: &Model) -> Option<String> {
    finer_hysteresis::main_effect(model).map(|e| e.id.clone())
}

/// A set of effects and how finely its hysteresis and its creep are described.
fn key(added: &[String], model: &Model) -> String {
    let creep = finer_creep::description(model).unwrap_or_default();
    format!("{}|{}|{creep}", added.join("+"), finer_hysteresis::description(model))
}
