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
/// A model whose error is below this times the floor in every record has nothing left to explain.
const NOTHING_LEFT: f64 = 1.03;
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
}

/// The whole growth.
#[derive(Clone)]
pub struct Growth {
    /// Steps, the first being the start.
    pub steps: Vec<Step>,
    /// Rounds, one per decision; the last found nothing to add, unless the growth ended at its limit.
    pub rounds: Vec<Round>,
    /// The first round tried effects alone, on a model that was identified elsewhere.
    pub transferred: bool,
}

impl Growth {
    /// The beginning of a growth.
    #[must_use]
    pub fn from_base(base: Judged) -> Self {
        let first = Step { added: None, removed: Vec::new(), why: "the model that was started from".into(), judged: base };
        Self { steps: vec![first], rounds: Vec::new(), transferred: false }
    }

    /// The model at the end.
    #[must_use]
    pub fn last(&self) -> &Judged {
        &self.steps[self.steps.len() - 1].judged
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
            let screening = screen(&model, &self.overview, self.dataset, &self.split.identify, std::slice::from_ref(effect), None, 1);
            let before = judge(model.clone(), self.dataset, &self.split);
            model = match screening.scores.first() {
                Some(score) => {
                    refit(&before, score, 0, &self.overview, self.dataset, &self.split, self.floor_um, Trial::for_promise(1.0, 1.0))
                        .judged
                        .model
                }
                None => crate::fit::with_effect(&model, EffectInstance::new(effect.clone(), &self.overview, &[])),
            };
        }
        (self.progress)("fitting all effects together");
        judge(fit(&model, self.dataset, &self.split.identify, Effort::default()).model, self.dataset, &self.split)
    }

    /// Grows a model.
    #[must_use]
    pub fn grow(&self, base: Judged) -> Growth {
        self.grow_on(Growth::from_base(base))
    }

    /// Goes on with a growth.
    #[must_use]
    pub fn grow_on(&self, mut growth: Growth) -> Growth {
        while growth.rounds.len() < ROUNDS_MAX {
            let before = growth.last().clone();
            if !growth.rounds.is_empty() && self.nothing_left(&before) {
                break;
            }
            let hopeless = hopeless(&growth);
            let round = self.round(&before, growth.rounds.len(), &hopeless);
            let refined = self.refine(&before, &round);
            let step = match (refined, round.tied.first()) {
                (Some(judged), _) => Some(Step {
                    added: None,
                    removed: Vec::new(),
                    why: format!("hysteresis {}: the same effect, described more finely", refine::description(&judged.model)),
                    judged,
                }),
                (None, Some(id)) => self.add(&growth, &before, &round, id),
                (None, None) => None,
            };
            growth.rounds.push(round);
            let Some(step) = step else { break };
            growth.steps.push(step);
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
        let accepted: Vec<&Finalist> = finalists.iter().filter(|f| self.accepts(f, &screening)).collect();
        let tied = accepted.first().map_or_else(Vec::new, |best| {
            accepted
                .iter()
                .filter(|f| f.id == best.id || improvement(&f.judged, &best.judged, &self.split).total_z < TIE_Z)
                .map(|f| f.id.clone())
                .collect()
        });
        Round { screening, finalists, tied }
    }

    /// Every judged record is at the floor.
    fn nothing_left(&self, judged: &Judged) -> bool {
        self.floor_um.is_some_and(|floor| judged.residuals.iter().all(|r| crate::fit::rms(r) < NOTHING_LEFT * floor))
    }

    fn accepts(&self, finalist: &Finalist, screening: &Screening) -> bool {
        let score = &screening.scores[finalist.score];
        let i = &finalist.improvement;
        if score.p_adjusted > FALSE_DISCOVERY_RATE {
            return false;
        }
        if self.split.validate.is_empty() {
            return i.total_z > 4.0 && i.record_relative > 0.02;
        }
        if self.floor_um.is_none() {
            return i.validate_z > 2.0 && i.validate_relative > 0.02;
        }
        let held_out = i.validate_z > 2.0;
        let only_seen_in_fitted = i.total_z > 5.0 && i.validate_z > -1.0 && i.record_relative > 2.0 * MATTERS;
        (held_out || only_seen_in_fitted) && i.record_relative > MATTERS
    }

    /// More flexible surfaces, where they do at least as well as the best candidate; as fine as keeps paying.
    fn refine(&self, before: &Judged, round: &Round) -> Option<Judged> {
        let close = |rms: Option<f64>| matches!((rms, self.floor_um), (Some(r), Some(f)) if r < 1.02 * f);
        if close(before.validate_rms_um) && close(Some(before.identify_rms_um)) {
            return None;
        }
        let mut finest = self.finer(before)?;
        let best = round.tied.first().and_then(|id| round.finalists.iter().find(|f| f.id == *id));
        let no_worse =
            best.is_none_or(|f| improvement(&finest, &f.judged, &self.split).total_z < TIE_Z && merit(&finest) < 1.02 * merit(&f.judged));
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

    fn add(&self, growth: &Growth, before: &Judged, round: &Round, id: &str) -> Option<Step> {
        let finalist = round.finalists.iter().find(|f| f.id == id)?;
        (self.progress)(&format!("adding {id}"));
        let full = fit(&finalist.judged.model, self.dataset, &self.split.identify, Effort::default());
        let mut judged = judge(full.model, self.dataset, &self.split);
        let mut removed = Vec::new();
        for earlier in growth.added() {
            let Some(without) = self.without(&judged, &earlier) else { continue };
            let loss = improvement(&without, &judged, &self.split);
            if loss.total_z < 2.0 || loss.record_relative < 0.01 {
                judged = without;
                removed.push(earlier);
            }
        }
        let score = &round.screening.scores[finalist.score];
        let declaration = score.effect.declaration();
        let drop = match (before.validate_rms_um, judged.validate_rms_um) {
            (Some(a), Some(b)) => format!("; held-out error {} to {} nm", nm(a), nm(b)),
            _ => String::new(),
        };
        Some(Step {
            added: Some(id.to_string()),
            why: format!("{} It explains {:.0} % of what is left{drop}", declaration.physics, 100.0 * score.share),
            removed,
            judged,
        })
    }

    fn without(&self, judged: &Judged, id: &str) -> Option<Judged> {
        let mut model = judged.model.clone();
        let replaced_gain = id == "hysteresis";
        if replaced_gain {
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
    match (growth.steps.last(), growth.rounds.last()) {
        (Some(step), Some(round)) if step.added.is_none() => {
            round.finalists.iter().filter(|f| f.improvement.validate_relative <= 0.0).map(|f| f.id.clone()).collect()
        }
        _ => Vec::new(),
    }
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
