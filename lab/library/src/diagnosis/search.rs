//! The search over sets of effects: several models are kept and extended, a set is fitted once however it was reached.
//!
//! # How it works
//! A round scores all candidates on what each of the best models leaves, and proposes the sets that promise most: one effect more, or two
//! where together they explain what neither does alone (creep is not seen before the lag beside it is), or a finer description of the
//! hysteresis. The most promising are fitted on a part of the samples and take their place among all that were fitted; the best that have
//! not been extended yet are extended next. Where additions bring nothing more, effects of the best model are exchanged for others that do much
//! the same beside it ([`Screening::doing_as`]): the first to be added was the best of few. The search ends when nothing is left above the
//! noise, or when neither brings a better model.
//! What comes out depends on the data alone, not on the order of effects or records, because all sets are compared with one another by
//! fitted and held-out error.

use super::judgement::Judged;
use super::screening::{Score, Screening};
use super::study::Study;
use crate::error::Result;
use crate::identification::finer_hysteresis;
use crate::parallel;
use crate::watch::Event;
use hysteron_sim::chain::Model;
use hysteron_sim::effect::hysteresis;
use std::collections::{BTreeMap, BTreeSet};

/// A set of effects that was fitted.
#[derive(Clone)]
pub struct Node {
    /// What was added to the start, by name.
    pub added: Vec<String>,
    /// The model and its errors on the samples of the search.
    pub judged: Judged,
    extended: bool,
    compared: bool,
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
    /// The caller wanted the best so far.
    pub stopped: bool,
}

/// A model that is worth fitting.
struct Proposal {
    key: String,
    added: Vec<String>,
    begin: Model,
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
/// A pair is worth a trial of its own where it leaves less than this share of what the better of the two leaves alone.
const BETTER_TOGETHER: f64 = 0.8;

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
            stopped: false,
        };
        let node = Node { added: Vec::new(), judged, extended: false, compared: true };
        search.nodes.insert(key(&[], start), node);
        search
    }

    /// Rank of a node: its merit, and a little for each effect and each step of a finer hysteresis more.
    fn rank(&self, node: &Node) -> f64 {
        let more = node.added.len() + finer_hysteresis::steps_finer(&node.judged.model);
        self.study.merit(&node.judged) + self.study.policy.gain_per_effect * more as f64
    }

    /// All nodes, best first.
    #[must_use]
    pub fn ranked(&self) -> Vec<&Node> {
        let mut out: Vec<&Node> = self.nodes.values().collect();
        out.sort_by(|a, b| self.rank(a).total_cmp(&self.rank(b)));
        out
    }

    /// The best node.
    #[must_use]
    pub fn best(&self) -> &Node {
        self.ranked()[0]
    }

    /// Runs until nothing better comes.
    ///
    /// # Errors
    /// A candidate that gives something that is no number.
    pub fn run(&mut self) -> Result<()> {
        let policy = &self.study.policy;
        let mut without_gain = 0;
        let rounds = policy.effects_max + policy.rounds_without_gain + policy.exchanges_max;
        let mut exchanges = 0;
        for _ in 0..rounds {
            if self.study.watch.stopped() {
                self.stopped = true;
                return Ok(());
            }
            let before = self.rank(self.best());
            if self.study.met(&self.best().judged) && self.study.nothing_left(&self.best().judged) {
                return Ok(());
            }
            let mut proposals = if without_gain < policy.rounds_without_gain { self.propose()? } else { Vec::new() };
            let exchanging = proposals.is_empty();
            if exchanging {
                exchanges += 1;
                if exchanges > policy.exchanges_max {
                    return Ok(());
                }
                proposals = self.propose_exchanges()?;
            } else {
                proposals.sort_by(|a, b| a.promise.total_cmp(&b.promise).then_with(|| a.key.cmp(&b.key)));
                proposals.truncate(policy.trials);
                proposals.extend(self.propose_structures());
            }
            self.fit(proposals);
            self.compare_best();
            let gained = before - self.rank(self.best()) > policy.least_gain;
            // A second look at the same model would exchange the same.
            if exchanging && !gained {
                return Ok(());
            }
            without_gain = if gained { 0 } else { without_gain + 1 };
        }
        Ok(())
    }

    /// Fits what was proposed.
    fn fit(&mut self, proposals: Vec<Proposal>) {
        let fitted = parallel::map(&proposals, |p| self.study.quickly(&p.begin));
        for (proposal, judged) in proposals.into_iter().zip(fitted) {
            if self.study.merit(&judged) > proposal.of + HOPELESS {
                self.hopeless.insert(proposal.added.join("+"));
            }
            self.keep(proposal.key, Node { added: proposal.added, judged, extended: false, compared: false });
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
        let screenings = parallel::map(&bases, |base| self.study.score(base));
        let relative = self.study.merit(&best.judged).exp();
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

    /// The best model with loops of other structures, the first time that it has surfaces: beside loops of the wrong structure every effect looks
    /// like a better description of them.
    fn propose_structures(&mut self) -> Vec<Proposal> {
        let best = self.best().clone();
        let begins = finer_hysteresis::of_other_structures(&best.judged.model, &self.study.overview);
        if self.structures_tried || begins.is_empty() {
            return Vec::new();
        }
        self.structures_tried = true;
        let proposal = |begin: Model| {
            let main = finer_hysteresis::main_effect(&begin).map(|e| e.id.clone());
            let kept = best.added.iter().filter(|id| begin.effect(id).is_some()).cloned();
            // Beside surfaces that were there from the beginning another structure is no effect more.
            let mut added: Vec<String> = kept.chain(main.filter(|_| best.added.iter().any(|id| id == hysteresis::ID))).collect();
            added.sort();
            // Whether the effects are hopeless beside the surfaces does not follow from what they do here.
            Proposal { key: key(&added, &begin), added, begin, of: f64::INFINITY, promise: 0.0 }
        };
        begins.into_iter().map(proposal).collect()
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
        let mut keys: Vec<(f64, String)> = self.nodes.iter().map(|(k, n)| (self.rank(n), k.clone())).collect();
        keys.sort_by(|a, b| a.0.total_cmp(&b.0).then_with(|| a.1.cmp(&b.1)));
        let pending: Vec<String> =
            keys.into_iter().take(self.study.policy.width).map(|(_, k)| k).filter(|k| !self.nodes[k].compared).collect();
        let more = !pending.is_empty();
        let fitted = parallel::map(&pending, |k| self.study.for_comparison(&self.nodes[k].judged.model));
        for (key, judged) in pending.into_iter().zip(fitted) {
            let Some(node) = self.nodes.get_mut(&key) else { continue };
            node.compared = true;
            // What a fit comes to is what counts, on held-out records too: a good error half way is chance.
            node.judged = judged;
        }
        more
    }

    /// Extensions of the best models that have not been extended.
    fn propose(&mut self) -> Result<Vec<Proposal>> {
        let mut keys: Vec<(f64, String)> = self.nodes.iter().filter(|(_, n)| !n.extended).map(|(k, n)| (self.rank(n), k.clone())).collect();
        keys.sort_by(|a, b| a.0.total_cmp(&b.0).then_with(|| a.1.cmp(&b.1)));
        keys.truncate(self.study.policy.width);
        let nodes: Vec<Node> = keys.iter().map(|(_, k)| self.nodes[k].clone()).collect();
        for (_, k) in &keys {
            if let Some(node) = self.nodes.get_mut(k) {
                node.extended = true;
            }
        }
        let screenings = parallel::map(&nodes, |node| {
            let candidates = self.study.candidates_for(&node.judged.model).len();
            self.study.watch.event(&Event::Scoring { candidates, beside: &node.added });
            self.study.score(&node.judged.model)
        });
        let mut out: Vec<Proposal> = Vec::new();
        for (i, (node, screening)) in nodes.iter().zip(screenings).enumerate() {
            let screening = screening?;
            self.propose_effects(node, &screening, &mut out);
            if i == 0 {
                self.propose_finer(node, &screening, &mut out);
            }
        }
        Ok(out)
    }

    fn propose_effects(&self, node: &Node, screening: &Screening, out: &mut Vec<Proposal>) {
        if node.added.len() >= self.study.policy.effects_max {
            return;
        }
        let total = screening.total_um2().max(f64::MIN_POSITIVE);
        let relative = self.study.merit(&node.judged).exp();
        let scores = &screening.scores;
        for (place, score) in scores.iter().take(SINGLES).enumerate() {
            let left = 1.0 - score.explained_um2 / total;
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

    fn propose_finer(&self, node: &Node, screening: &Screening, out: &mut Vec<Proposal>) {
        let relative = self.study.merit(&node.judged).exp();
        let left = screening.left_by_finer_um2() / screening.total_um2().max(f64::MIN_POSITIVE);
        for begin in self.study.finer(&node.judged.model) {
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
            out.push(Proposal { key, added, begin, of: self.study.merit(&node.judged), promise: relative * left });
        }
    }
}

/// A set of effects and how finely its hysteresis is described.
fn key(added: &[String], model: &Model) -> String {
    format!("{}|{}", added.join("+"), finer_hysteresis::description(model))
}
