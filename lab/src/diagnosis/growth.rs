//! A model grows: add the effect that explains most, take back what is no longer needed, stop at the floor.
//!
//! A round screens all candidates on the residual, fits the finalists and more flexible hysteresis surfaces, and takes the best that
//!
//! * passes the screening under control of false discoveries,
//! * lowers the error on held-out records by more than chance, or is seen beyond doubt in fitted records while the held-out ones, which may
//!   not excite it, get no worse,
//! * and matters: some record improves by more than [`MATTERS`].
//!
//! Surfaces come first where they do as well: a wrong degree is not a missing effect.

use super::refit::{Finalist, Judged, Split, Trial, improvement, judge, refit};
use super::screening::{Screening, screen};
use crate::dataset::Dataset;
use crate::dataset::drive_variety::DriveVariety;
use crate::fit::{Effort, fit};
use crate::refine;
use hysteron_sim::chain::{EffectInstance, Model};
use hysteron_sim::effect::{Effect, Overview};
use std::sync::Arc;

/// Least relative improvement of some record for an effect to count.
pub const MATTERS: f64 = 0.025;
/// False discovery rate over all candidates of a round.
const FALSE_DISCOVERY_RATE: f64 = 0.05;
/// Most effects that are added.
const ROUNDS_MAX: usize = 6;
/// Finalists of a round.
const FINALISTS_MAX: usize = 6;
/// An effect that takes this share of the squared error above the floor explains most of it.
const TAKES_MOST: f64 = 0.5;
/// Finalists that are followed one step further.
const RIVALS_MAX: usize = 4;
/// Least share of what the best finalist takes of the logarithm of the error, for one to be followed.
const RIVAL: f64 = 0.5;
/// A model whose error is below this times the floor in every record has nothing left to explain.
const NOTHING_LEFT: f64 = 1.03;
/// A model leaves something in a record where its error is above this times the floor; a verdict that leaves so much explains nothing.
pub const EXPLAINED: f64 = 1.15;
/// A quickly fitted model whose error is below this times the floor will leave nothing.
const MET: f64 = 1.05;
/// Two models closer than this, in standard errors of their difference, are not told apart.
const TIE_Z: f64 = 3.0;

/// One step of the growth.
#[derive(Clone)]
pub struct Step {
    /// Effect that was added, if any.
    pub added: Option<String>,
    /// Effects that were taken back in this step.
    pub removed: Vec<String>,
    /// Why, in a sentence.
    pub why: String,
    /// The model after the step.
    pub judged: Judged,
    /// What was looked at before the step was taken; none for the start and for a mere new fit.
    pub round: Option<Round>,
}

impl Step {
    /// A step that adds nothing.
    #[must_use]
    pub fn without_effect(why: String, judged: Judged) -> Self {
        Self { added: None, removed: Vec::new(), why, judged, round: None }
    }
}

/// An accepted finalist, and the best that may come of it.
struct Ahead {
    id: String,
    end: Judged,
    /// The round that ended there, if it leaves nothing.
    successor: Option<Box<Round>>,
}

impl Ahead {
    /// It leaves nothing, with this effect added.
    fn leads_to(&self, id: &str) -> bool {
        self.successor.as_ref().is_some_and(|round| round.tied.first().is_some_and(|added| added == id))
    }
}

/// What one round looked at.
#[derive(Clone)]
pub struct Round {
    /// All candidates, scored.
    pub screening: Screening,
    /// Those that were fitted.
    pub finalists: Vec<Finalist>,
    /// Accepted finalists that this data cannot tell from the best, the best first.
    pub tied: Vec<String>,
    /// What was found by looking ahead from the best.
    successor: Option<Box<Round>>,
}

impl Round {
    /// A round with its outcome.
    #[must_use]
    pub fn decided(screening: Screening, finalists: Vec<Finalist>, tied: Vec<String>) -> Self {
        Self { screening, finalists, tied, successor: None }
    }

    /// The best of the round, if any was accepted.
    fn best(&self) -> Option<&Finalist> {
        self.tied.first().and_then(|id| self.finalists.iter().find(|f| f.id == *id))
    }
}

/// The whole growth.
#[derive(Clone)]
pub struct Growth {
    /// Steps, the first being the start.
    pub steps: Vec<Step>,
    /// The round that found nothing to add, unless the growth ended at the floor or at its limit.
    pub last_round: Option<Round>,
    /// The first round tried effects alone, on a model that was identified elsewhere.
    pub transferred: bool,
}

impl Growth {
    /// The beginning of a growth.
    #[must_use]
    pub fn from_base(base: Judged) -> Self {
        Self { steps: vec![Step::without_effect("the model that was started from".into(), base)], last_round: None, transferred: false }
    }

    /// All rounds, first to last.
    pub fn rounds(&self) -> impl Iterator<Item = &Round> {
        self.steps.iter().filter_map(|step| step.round.as_ref()).chain(&self.last_round)
    }

    /// The model at the end.
    #[must_use]
    pub fn last(&self) -> &Judged {
        &self.steps[self.steps.len() - 1].judged
    }

    /// Effects that were added and stayed, each with those that do as well in its place.
    #[must_use]
    pub fn findings(&self) -> Vec<Vec<String>> {
        let added = self.added();
        let others = |step: &Step| -> Vec<String> {
            step.round.iter().flat_map(|round| &round.tied).filter(|id| !added.contains(id)).cloned().collect()
        };
        let step_of = |id: &String| self.steps.iter().rev().find(|s| s.added.as_ref() == Some(id));
        added.iter().map(|id| std::iter::once(id.clone()).chain(step_of(id).map(others).unwrap_or_default()).collect()).collect()
    }

    /// The round in which an effect was chosen, or did as well as the one that was.
    #[must_use]
    pub fn round_of(&self, id: &String) -> Option<&Round> {
        let chosen = self.steps.iter().rev().filter(|s| s.added.as_ref() == Some(id)).find_map(|s| s.round.as_ref());
        chosen.or_else(|| self.rounds().find(|round| round.tied.contains(id)))
    }

    /// Effects that were added and stayed, in the order of their addition.
    #[must_use]
    pub fn added(&self) -> Vec<String> {
        let mut out: Vec<String> = Vec::new();
        for step in &self.steps {
            out.retain(|id| !step.removed.contains(id));
            out.extend(step.added.clone());
        }
        out
    }
}

/// What a growth works on.
pub struct Workbench<'a> {
    /// The data.
    pub dataset: &'a Dataset,
    /// What is known of them beforehand.
    pub overview: Overview,
    /// Fitted and held-out records.
    pub split: Split,
    /// Effects that may be added.
    pub candidates: Vec<Arc<dyn Effect>>,
    /// Noise floor, um.
    pub floor_um: Option<f64>,
    /// Told what is being done.
    pub progress: &'a (dyn Fn(&str) + Sync),
}

impl Workbench<'_> {
    /// Candidates that make sense beside a model.
    #[must_use]
    pub fn candidates_for(&self, model: &Model) -> Vec<Arc<dyn Effect>> {
        let has_hysteresis = model.effect("hysteresis").is_some();
        // Held-out records may move at other speeds; without any, one speed says nothing about the others.
        let several_speeds = !self.split.validate.is_empty() || !DriveVariety::of(self.dataset, &self.split.identify).one_speed();
        self.candidates
            .iter()
            .filter(|effect| {
                let declaration = effect.declaration();
                let needs = match declaration.id.as_str() {
                    "initial_curve" => has_hysteresis,
                    "rate_dependence" => has_hysteresis && several_speeds,
                    "second_mode" => model.effect("vibration").is_some(),
                    "hysteresis" => model.effect("gain").is_some(),
                    _ => true,
                };
                needs && declaration.candidate && model.effect(&declaration.id).is_none() && !effect.starts(&self.overview).is_empty()
            })
            .cloned()
            .collect()
    }

    /// Fits a list of effects, each begun from the start that explains most of what the others leave.
    #[must_use]
    pub fn build(&self, effects: &[Arc<dyn Effect>]) -> Judged {
        let mut order: Vec<&Arc<dyn Effect>> = effects.iter().collect();
        order.sort_by_key(|e| build_rank(&e.declaration().id));
        let mut model = Model::new(self.dataset.drive_min_v, self.dataset.drive_max_v);
        if !order.iter().any(|e| e.declaration().place == hysteron_sim::effect::Place::Hysteresis && e.declaration().modifies.is_none()) {
            model.add(EffectInstance::new(Arc::new(hysteron_sim::effect::gain::Gain), &self.overview, &[]));
        }
        for effect in order {
            (self.progress)(&format!("fitting {}", effect.declaration().id));
            if effect.starts_combine() || effect.starts(&self.overview).len() <= 1 || model.effects.is_empty() {
                model.add(EffectInstance::new(effect.clone(), &self.overview, &[]));
                model = fit(&model, self.dataset, &self.split.identify, Effort { iterations: 6, tolerance: 1.0, relative: 0.003 }).model;
                continue;
            }
            model = self.seated(&model, effect);
        }
        (self.progress)("fitting all effects together");
        judge(fit(&model, self.dataset, &self.split.identify, Effort::default()).model, self.dataset, &self.split)
    }

    /// The model with an effect begun from the start that explains most of what the others leave.
    fn seated(&self, model: &Model, effect: &Arc<dyn Effect>) -> Model {
        let screening = screen(model, &self.overview, self.dataset, &self.split.identify, std::slice::from_ref(effect), None, 1);
        let before = judge(model.clone(), self.dataset, &self.split);
        match screening.scores.first() {
            Some(score) => refit(&before, score, 0, &self.overview, self.dataset, &self.split, self.floor_um, Trial::RANKING).judged.model,
            None => crate::fit::with_effect(model, EffectInstance::new(effect.clone(), &self.overview, &[])),
        }
    }

    /// The model with each effect that had been begun without `newest` begun again beside it: while something was missing, it may have
    /// settled far from where it belongs.
    fn seated_anew(&self, judged: &Judged, newest: &str) -> Judged {
        let mut best = judged.clone();
        let begins_anew = |effect: &Arc<dyn Effect>| {
            let id = effect.declaration().id;
            let takes_in_others = judged.model.effects.iter().any(|e| e.id != newest && e.effect.declaration().modifies == Some(&id));
            id != newest && !takes_in_others && !effect.starts_combine() && effect.starts(&self.overview).len() > 1
        };
        let again: Vec<Arc<dyn Effect>> = judged.model.effects.iter().map(|e| e.effect.clone()).filter(begins_anew).collect();
        for effect in again {
            let id = effect.declaration().id;
            (self.progress)(&format!("beginning {id} again"));
            let mut without = best.model.clone();
            without.effects.retain(|e| e.id != id);
            let full = fit(&self.seated(&without, &effect), self.dataset, &self.split.identify, Effort::default());
            let again = judge(full.model, self.dataset, &self.split);
            if merit(&again) < merit(&best) {
                best = again;
            }
        }
        best
    }

    /// Grows a model.
    #[must_use]
    pub fn grow(&self, base: Judged) -> Growth {
        self.grow_on(Growth::from_base(base))
    }

    /// Goes on with a growth.
    #[must_use]
    pub fn grow_on(&self, mut growth: Growth) -> Growth {
        for number in growth.rounds().count()..ROUNDS_MAX {
            let before = growth.last().clone();
            if number > 0 && self.nothing_left(&before) {
                break;
            }
            let mut round = self.round(&before, number, &hopeless(&growth));
            if let Some(judged) = self.refine(&before, &round) {
                let why = format!("hysteresis {}: the same effect, described more finely", refine::description(&judged.model));
                growth.steps.push(Step { round: Some(round), ..Step::without_effect(why, judged) });
            } else if let Some(best) = round.best().cloned() {
                match round.successor.take() {
                    Some(successor) => {
                        growth.steps.push(self.step(&before, round, best.judged, Vec::new()));
                        self.add(&mut growth, *successor);
                    }
                    None => self.add(&mut growth, round),
                }
            } else {
                growth.last_round = Some(round);
                break;
            }
        }
        growth
    }

    fn round(&self, before: &Judged, number: usize, hopeless: &[String]) -> Round {
        let candidates = self.candidates_for(&before.model);
        (self.progress)(&format!("scoring {} candidate effects", candidates.len()));
        let screening =
            screen(&before.model, &self.overview, self.dataset, &self.split.identify, &candidates, self.floor_um, 1000 + number as u64);
        let strongest = screening.scores.first().map_or(0.0, |s| s.explained_um2);
        let chosen: Vec<usize> = (0..screening.scores.len())
            .filter(|&i| {
                let score = &screening.scores[i];
                let again = hopeless.contains(&score.id);
                (i < 3 && number == 0) || (!again && i < FINALISTS_MAX && score.p_value <= 0.05 && score.explained_um2 > 0.15 * strongest)
            })
            .collect();
        let mut finalists: Vec<Finalist> = chosen
            .into_iter()
            .map(|i| {
                (self.progress)(&format!("fitting with {}", screening.scores[i].id));
                let trial = Trial::for_promise(screening.scores[i].explained_um2, strongest);
                refit(before, &screening.scores[i], i, &self.overview, self.dataset, &self.split, self.floor_um, trial)
            })
            .collect();
        finalists.sort_by(|a, b| merit(&a.judged).total_cmp(&merit(&b.judged)));
        let accepted: Vec<&Finalist> = finalists.iter().filter(|f| self.accepts(before, f, &screening)).collect();
        let mut ahead = self.look_ahead(before, &accepted);
        let tied = ahead
            .iter()
            .filter(|rival| rival.id == ahead[0].id || !self.told_apart(&rival.end, &ahead[0].end))
            .map(|rival| rival.id.clone())
            .collect();
        let successor = if ahead.is_empty() { None } else { ahead.swap_remove(0).successor };
        Round { screening, finalists, tied, successor }
    }

    /// The accepted finalists, best first; where several take much and none all of it, the best is the one after whose best successor least
    /// is left. Of two missing effects the one that imitates their sum best need not be either of them.
    fn look_ahead(&self, before: &Judged, accepted: &[&Finalist]) -> Vec<Ahead> {
        let mut out: Vec<Ahead> = accepted.iter().map(|f| Ahead { id: f.id.clone(), end: f.judged.clone(), successor: None }).collect();
        let Some(best) = accepted.first() else { return out };
        let taken = |f: &Finalist| merit(before) - merit(&f.judged);
        let rivals = accepted.iter().take(RIVALS_MAX).take_while(|f| taken(f) > RIVAL * taken(best)).count();
        // Without a floor nobody knows whether the best takes all of it.
        if rivals < 2 || self.floor_um.is_none() || self.met(&best.judged) {
            return out;
        }
        for i in 0..rivals {
            // Two effects are the same two in either order.
            let reached = out[..i].iter().find(|earlier| earlier.leads_to(&out[i].id)).map(|earlier| earlier.end.clone());
            match reached {
                Some(end) => out[i].end = end,
                None => {
                    (self.progress)(&format!("looking ahead from {}", out[i].id));
                    // Once two effects explain everything, it only remains to see whether another two do so as well.
                    let trial = if out[..i].iter().any(|earlier| earlier.successor.is_some()) { Trial::BRIEF } else { Trial::RANKING };
                    self.follow(&mut out[i], trial);
                }
            }
        }
        out[..rivals].sort_by(|a, b| merit(&a.end).total_cmp(&merit(&b.end)));
        out
    }

    /// Adds the candidate that explains most of what is left; one that leaves nothing at all is the successor.
    fn follow(&self, ahead: &mut Ahead, trial: Trial) {
        let candidates = self.candidates_for(&ahead.end.model);
        let screening = screen(&ahead.end.model, &self.overview, self.dataset, &self.split.identify, &candidates, self.floor_um, 1500);
        let Some(score) = screening.scores.first().filter(|s| s.p_adjusted <= FALSE_DISCOVERY_RATE) else { return };
        let finalist = refit(&ahead.end, score, 0, &self.overview, self.dataset, &self.split, self.floor_um, trial);
        if merit(&finalist.judged) < merit(&ahead.end) {
            ahead.end = finalist.judged.clone();
            if self.met(&ahead.end) {
                ahead.successor = Some(Box::new(Round::decided(screening, vec![finalist.clone()], vec![finalist.id])));
            }
        }
    }

    /// The data prefer one model to its rival: beyond chance, or because it leaves nothing in records where the rival leaves something.
    fn told_apart(&self, rival: &Judged, best: &Judged) -> bool {
        let leaves_something = |floor: f64| rival.residuals.iter().any(|r| crate::fit::rms(r) > EXPLAINED * floor);
        improvement(rival, best, &self.split).total_z >= TIE_Z || (self.nothing_left(best) && self.floor_um.is_some_and(leaves_something))
    }

    /// Fitted and held-out records together are about at the floor, as far as a quick fit gets.
    fn met(&self, judged: &Judged) -> bool {
        let error = judged.validate_rms_um.map_or(judged.identify_rms_um, |v| v.max(judged.identify_rms_um));
        self.floor_um.is_some_and(|floor| error < MET * floor)
    }

    /// Every judged record is at the floor.
    fn nothing_left(&self, judged: &Judged) -> bool {
        self.floor_um.is_some_and(|floor| judged.residuals.iter().all(|r| crate::fit::rms(r) < NOTHING_LEFT * floor))
    }

    fn accepts(&self, before: &Judged, finalist: &Finalist, screening: &Screening) -> bool {
        let score = &screening.scores[finalist.score];
        let i = &finalist.improvement;
        // What takes a model from clearly above the floor down to it, held-out records included, needs no other proof.
        let reaches_floor = !self.met(before) && self.met(&finalist.judged);
        if score.p_adjusted > FALSE_DISCOVERY_RATE && !reaches_floor {
            return false;
        }
        if self.split.validate.is_empty() {
            return i.total_z > 4.0 && i.record_relative > 0.02;
        }
        let Some(floor_um) = self.floor_um else { return i.validate_z > 2.0 && i.validate_relative > 0.02 };
        let held_out = i.validate_z > 2.0;
        let beyond_doubt = i.total_z > 5.0 || self.share_of_excess(before, &finalist.judged, floor_um) > TAKES_MOST;
        let only_seen_in_fitted = beyond_doubt && i.validate_z > -1.0 && i.record_relative > 2.0 * MATTERS;
        (held_out || only_seen_in_fitted) && i.record_relative > MATTERS
    }

    /// Share of the sum of squares above the floor, over all judged records, that is gone. Where few events hold most of an error, it says
    /// more than the scatter between blocks.
    fn share_of_excess(&self, before: &Judged, after: &Judged, floor_um: f64) -> f64 {
        let square = |judged: &Judged| judged.residuals.iter().map(|r| crate::fit::dot(r, r)).sum::<f64>();
        let samples: usize = before.residuals.iter().map(Vec::len).sum();
        let excess = square(before) - samples as f64 * floor_um * floor_um;
        if excess > 0.0 { (square(before) - square(after)) / excess } else { 0.0 }
    }

    /// More flexible surfaces, where they do at least as well as the best candidate; as fine as keeps paying.
    fn refine(&self, before: &Judged, round: &Round) -> Option<Judged> {
        let close = |rms: Option<f64>| matches!((rms, self.floor_um), (Some(r), Some(f)) if r < 1.02 * f);
        if close(before.validate_rms_um) && close(Some(before.identify_rms_um)) {
            return None;
        }
        let mut finest = self.finer(before)?;
        let accepted = round.finalists.iter().find(|f| round.tied.contains(&f.id));
        let no_worse = accepted
            .is_none_or(|f| improvement(&finest, &f.judged, &self.split).total_z < TIE_Z && merit(&finest) < 1.02 * merit(&f.judged));
        if !no_worse {
            return None;
        }
        while let Some(finer) = self.finer(&finest) {
            finest = finer;
        }
        Some(finest)
    }

    /// Surfaces of one degree more, or play operators beside them, whichever does better, if it is worth it.
    fn finer(&self, before: &Judged) -> Option<Judged> {
        let ways = [refine::refined(&before.model, &self.overview, 1), refine::with_play_operators(&before.model, &self.overview)];
        let judged = ways.into_iter().flatten().filter_map(|finer| self.worth(before, &finer));
        judged.min_by(|a, b| merit(a).total_cmp(&merit(b)))
    }

    /// A finer description after its fit, if it is worth it.
    fn worth(&self, before: &Judged, finer: &Model) -> Option<Judged> {
        (self.progress)("fitting finer hysteresis surfaces");
        let effort = Effort { iterations: 8, tolerance: 0.3, relative: 0.001 };
        let judged = judge(fit(finer, self.dataset, &self.split.identify, effort).model, self.dataset, &self.split);
        let gain = improvement(before, &judged, &self.split);
        let least = if self.floor_um.is_some() { 0.005 } else { 0.02 };
        let worth =
            if self.split.validate.is_empty() { gain.total_z > 4.0 } else { gain.validate_z > 2.0 && gain.validate_relative > least };
        worth.then_some(judged)
    }

    /// Fits the best of a round thoroughly, takes back what it makes needless, and makes the step.
    fn add(&self, growth: &mut Growth, round: Round) {
        let Some(finalist) = round.best() else { return };
        (self.progress)(&format!("adding {}", finalist.id));
        let full = fit(&finalist.judged.model, self.dataset, &self.split.identify, Effort::default());
        let mut judged = judge(full.model, self.dataset, &self.split);
        if self.floor_um.is_some() && !self.met(&judged) {
            judged = self.seated_anew(&judged, &finalist.id);
        }
        let mut removed = Vec::new();
        for earlier in growth.added() {
            let Some(without) = self.without(&judged, &earlier) else { continue };
            let loss = improvement(&without, &judged, &self.split);
            if loss.total_z < 2.0 || loss.record_relative < 0.01 {
                judged = without;
                removed.push(earlier);
            }
        }
        let step = self.step(growth.last(), round, judged, removed);
        growth.steps.push(step);
    }

    /// The step that adds the best of a round.
    fn step(&self, before: &Judged, round: Round, judged: Judged, removed: Vec<String>) -> Step {
        let (added, why) = round.best().map_or_else(Default::default, |best| {
            let score = &round.screening.scores[best.score];
            let drop = match (before.validate_rms_um, judged.validate_rms_um) {
                (Some(a), Some(b)) => format!("; held-out error {} to {} nm", nm(a), nm(b)),
                _ => String::new(),
            };
            let why = format!("{} It explains {:.0} % of what is left{drop}", score.effect.declaration().physics, 100.0 * score.share);
            (Some(best.id.clone()), why)
        });
        Step { added, removed, why, judged, round: Some(round) }
    }

    fn without(&self, judged: &Judged, id: &str) -> Option<Judged> {
        let mut model = judged.model.clone();
        if id == "hysteresis" {
            return None; // nothing would be left to drive the chain
        }
        model.effects.retain(|e| e.id != id);
        Some(judge(
            fit(&model, self.dataset, &self.split.identify, Effort { iterations: 8, tolerance: 0.3, relative: 0.001 }).model,
            self.dataset,
            &self.split,
        ))
    }
}

/// Candidates that were fitted in the last round and did not help the held-out records, where only the surfaces have changed since.
fn hopeless(growth: &Growth) -> Vec<String> {
    let Some(Step { added: None, round: Some(round), .. }) = growth.steps.last() else { return Vec::new() };
    round.finalists.iter().filter(|f| f.improvement.validate_relative <= 0.0).map(|f| f.id.clone()).collect()
}

/// What finalists are ranked by: fitted and held-out error count alike.
fn merit(judged: &Judged) -> f64 {
    judged.identify_rms_um.max(1e-300).ln() + judged.validate_rms_um.map_or(0.0, |v| v.max(1e-300).ln())
}

/// Effects that others build on are fitted first.
fn build_rank(id: &str) -> usize {
    ["gain", "hysteresis", "initial_curve", "vibration", "creep", "rate_dependence", "second_mode"].iter().position(|k| *k == id).unwrap_or(
        if ["prandtl_ishlinskii", "modified_prandtl_ishlinskii", "maxwell_slip", "bouc_wen", "duhem"].contains(&id) { 1 } else { 9 },
    )
}

/// Nanometres with three figures.
#[must_use]
pub fn nm(um: f64) -> String {
    let value = 1e3 * um;
    if value >= 100.0 {
        format!("{value:.0}")
    } else if value >= 10.0 {
        format!("{value:.1}")
    } else {
        format!("{value:.2}")
    }
}
