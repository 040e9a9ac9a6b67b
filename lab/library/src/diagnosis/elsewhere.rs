//! A model that was identified on other data: what does this recording have that the model has not, or what has other values?
//!
//! The values of such a model are knowledge. Fitting them again to the new recording would let them take up a missing effect, so every
//! hypothesis is first tried *alone*, with all other values held: an effect that the model does not have, or an effect that it has with
//! other values (a gain, a mass, more creep). One hypothesis that explains most of what a new fit of everything could remove is the simpler
//! story, and it is told first; another may stand beside it. A model that was identified on the very data that it is diagnosed on gains
//! nothing by a new fit, and none of this applies.

use super::judgement::Judged;
use super::study::Study;
use crate::error::Result;
use crate::identification::fit::{Effort, fit_rows};
use crate::identification::held_values::{as_free_as, holding};
use crate::identification::linearisation::Rows;
use crate::parallel;
use crate::watch::Event;
use hysteron_sim::chain::{EffectInstance, Model};
use hysteron_sim::effect::{Effect, Place, gain};
use serde::Serialize;
use std::sync::Arc;

/// Least share of what a new fit removes that one hypothesis must explain by itself.
const EXPLAINS_ALONE: f64 = 0.5;
/// One hypothesis must come this near to a new fit of everything: where none does, many values have changed.
const NEAR_REFIT: f64 = 4.0;
/// Two hypotheses whose errors differ by less than this share are not told apart.
const ALIKE: f64 = 0.1;
/// A hypothesis with several values must lower the error to this share of one with a single value: it also takes up what the held values
/// miss.
const WORTH_SEVERAL_VALUES: f64 = 0.5;
/// Two hypotheses whose errors differ by less than this share are not told apart either, however many values they have: a delay is what a
/// low-pass of any order looks like well below its cut-off.
const AS_GOOD: f64 = 0.03;
/// Share of the error of the model as it was handed in, below which a hypothesis leaves nearly nothing.
const NEARLY_NOTHING: f64 = 0.1;
/// Share of the error of a new fit within which nothing is beyond it.
const LEFT_ANYWAY: f64 = 0.1;
/// A hypothesis whose error is so many times below that of a new fit of everything explains what that fit cannot.
const MUCH_LESS: f64 = 2.0;
/// A second hypothesis beside the first must lower the error to this share.
const WORTH_A_SECOND: f64 = 0.7;
/// A value that a hypothesis moves by less than this share, and by less than three of its standard deviations, has not changed.
const SAME_VALUE: f64 = 0.01;
/// Samples on which hypotheses are tried: a few values each.
const SAMPLES: usize = 12_000;

/// What may differ between a model and a recording.
#[derive(Clone)]
pub enum Hypothesis {
    /// An effect is there that the model does not have.
    Missing(Arc<dyn Effect>),
    /// An effect has other values.
    Changed(String),
    /// The whole displacement is larger or smaller, or has the other sign: hysteresis and all that builds on it times one factor.
    Scaled,
}

impl Hypothesis {
    /// The effect that it is about.
    #[must_use]
    pub fn effect(&self, model: &Model) -> String {
        match self {
            Self::Missing(effect) => effect.declaration().id,
            Self::Changed(id) => id.clone(),
            Self::Scaled => model.effects.iter().find(|e| is_main(e)).map_or_else(|| gain::ID.into(), |e| e.id.clone()),
        }
    }
}

fn is_main(e: &EffectInstance) -> bool {
    e.effect.declaration().is_main()
}

/// A value that has changed.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ChangedValue {
    /// The effect.
    pub effect: String,
    /// The parameter; `scale` for all coefficients of a hysteresis together.
    pub parameter: String,
    /// Its value in the model that was handed in.
    pub from: f64,
    /// Its value on this recording.
    pub to: f64,
}

/// A hypothesis after its trial.
#[derive(Clone)]
pub struct Tried {
    /// What was tried.
    pub hypothesis: Hypothesis,
    /// The model with it, all else held, and its errors on the samples of the trial.
    pub judged: Judged,
    /// Values that it estimates.
    pub values: usize,
}

impl Tried {
    /// Error beyond what even a new fit of everything leaves, made larger where several values bring it about.
    fn cost(&self, refitted_um: f64) -> f64 {
        let beyond_um2 = (self.judged.identify_rms_um.powi(2) - refitted_um * refitted_um).max(0.0);
        // What leaves much less than that fit explains what no value of it does.
        let anyway_um = LEFT_ANYWAY * refitted_um.min(MUCH_LESS * self.judged.identify_rms_um);
        (beyond_um2 + anyway_um.powi(2)).sqrt() / if self.values > 1 { WORTH_SEVERAL_VALUES } else { 1.0 }
    }
}

/// What the comparison with a model from elsewhere came to.
pub struct Elsewhere {
    /// The model as it was handed in.
    pub base: Judged,
    /// The same effects fitted again to this recording.
    pub refitted: Judged,
    /// The simplest story, first hypothesis first; empty where none is simple enough.
    pub story: Vec<Tried>,
    /// For each hypothesis of the story, the others that the data do not tell from it.
    pub alternatives: Vec<Vec<Tried>>,
    /// Everything that was tried beside the model as it was handed in, best first.
    pub tried: Vec<Tried>,
    /// The model belongs to this data: nothing above applies.
    pub at_home: bool,
    /// Share of what a new fit could remove that the story explains.
    pub explained_share: f64,
}

impl Elsewhere {
    /// Values that have changed, from the model that was handed in to the story's.
    #[must_use]
    pub fn changed(&self) -> Vec<ChangedValue> {
        let Some(last) = self.story.last() else { return Vec::new() };
        let about: Vec<&Tried> = self.story.iter().filter(|t| !matches!(t.hypothesis, Hypothesis::Missing(_))).collect();
        about.iter().flat_map(|t| changes(&t.hypothesis, &self.base.model, &last.judged.model)).collect()
    }
}

/// The values of a hypothesis that differ between two models.
fn changes(hypothesis: &Hypothesis, before: &Model, after: &Model) -> Vec<ChangedValue> {
    let id = hypothesis.effect(before);
    let (Some(a), Some(b)) = (before.effect(&id), after.effect(&id)) else { return Vec::new() };
    if matches!(hypothesis, Hypothesis::Scaled) {
        let largest = a.parameters.iter().zip(&b.parameters).filter(|(x, y)| x.value != y.value);
        let largest = largest.max_by(|(x, _), (y, _)| x.value.abs().total_cmp(&y.value.abs()));
        let to = largest.map_or(1.0, |(x, y)| y.value / x.value);
        return vec![ChangedValue { effect: id, parameter: "scale".into(), from: 1.0, to }];
    }
    let differs = |x: f64, y: f64| (x - y).abs() > SAME_VALUE * x.abs().max(y.abs());
    let pairs = a.parameters.iter().zip(&b.parameters).filter(|(x, y)| !x.parameter.fixed && differs(x.value, y.value));
    pairs.map(|(x, y)| ChangedValue { effect: id.clone(), parameter: x.parameter.name.clone(), from: x.value, to: y.value }).collect()
}

/// Compares a model that was handed in with the data.
///
/// # Errors
/// As [`Study::begun_again`].
pub fn compare(study: &Study, base: Judged) -> Result<Elsewhere> {
    study.watch.event(&Event::Doing("fitting the model to this recording"));
    let refitted = study.thoroughly(&base.model);
    let mut out =
        Elsewhere { base, refitted, story: Vec::new(), alternatives: Vec::new(), tried: Vec::new(), at_home: false, explained_share: 0.0 };
    out.at_home = out.refitted.identify_rms_um > (1.0 - study.policy.at_home) * out.base.identify_rms_um;
    if out.at_home || study.watch.stopped() {
        return Ok(out);
    }
    let rows = Rows::thinned(study.dataset, &study.split.identify, SAMPLES);
    out.tried = try_all(study, &out.base.model, &rows, &[], out.refitted.identify_rms_um);
    let square = |judged: &Judged| judged.identify_rms_um * judged.identify_rms_um;
    let removable = square(&out.base) - square(&out.refitted);
    let share = |judged: &Judged| if removable > 0.0 { (square(&out.base) - square(judged)) / removable } else { 0.0 };
    let explains = |judged: &Judged| share(judged) > EXPLAINS_ALONE;
    // The cheapest may explain next to nothing; then the story begins with the cheapest that explains most of it.
    let first_explains = out.tried.first().is_some_and(|t| explains(&t.judged));
    let explaining: Vec<Tried> = out.tried.iter().filter(|t| !first_explains && explains(&t.judged)).cloned().collect();
    for first_of in [&out.tried, &explaining] {
        let Some((story, alternatives)) = story_from(study, &out, first_of, &rows) else { continue };
        let last = &story[story.len() - 1].judged;
        out.explained_share = share(last);
        if last.identify_rms_um < NEAR_REFIT * out.refitted.identify_rms_um && explains(last) {
            (out.story, out.alternatives) = (story, alternatives);
            break;
        }
    }
    Ok(out)
}

/// The first of what was tried, and one or two more beside it, as long as each takes much of what is left; for each the others that the data do not tell from
/// it.
fn story_from(study: &Study, compared: &Elsewhere, tried: &[Tried], rows: &Rows) -> Option<(Vec<Tried>, Vec<Vec<Tried>>)> {
    let (base, refitted_um) = (&compared.base, compared.refitted.identify_rms_um);
    let mut story = vec![tried.first()?.clone()];
    let mut alternatives = vec![alike(tried, base.identify_rms_um, refitted_um)];
    // A second one must lower the error itself, the more where several values do it.
    let several = |t: &Tried| if t.values > 1 { 1.0 / WORTH_SEVERAL_VALUES.sqrt() } else { 1.0 };
    while story.len() < 3 {
        let last = &story[story.len() - 1];
        if last.judged.identify_rms_um < 1.3 * refitted_um {
            break;
        }
        let known: Vec<String> = story.iter().map(|t| t.hypothesis.effect(&base.model)).collect();
        let beside = try_all(study, &last.judged.model, rows, &known, refitted_um);
        let Some(next) =
            beside.first().filter(|t| several(t) * t.judged.identify_rms_um < WORTH_A_SECOND * last.judged.identify_rms_um).cloned()
        else {
            break;
        };
        alternatives.push(alike(&beside, last.judged.identify_rms_um, refitted_um));
        story.push(next);
    }
    Some((story, alternatives))
}

/// Others that the data do not tell from the first.
fn alike(tried: &[Tried], base_um: f64, refitted_um: f64) -> Vec<Tried> {
    let Some(best) = tried.first() else { return Vec::new() };
    // What even the best leaves to a new fit is owed to the values held; a difference below that decides nothing.
    let left_by_best = (best.judged.identify_rms_um.powi(2) - refitted_um * refitted_um).max(0.0);
    let cost = |t: &Tried| t.cost(refitted_um);
    let as_good = |t: &Tried| t.judged.identify_rms_um <= (1.0 + AS_GOOD) * best.judged.identify_rms_um;
    // Several values also take up what the held ones miss: beside them a single value that explains nearly everything stands.
    let nearly_all = |t: &Tried| best.values > 1 && t.values == 1 && t.judged.identify_rms_um < NEARLY_NOTHING * base_um;
    let like = |t: &&Tried| {
        cost(t) <= (1.0 + ALIKE) * cost(best) || cost(t).powi(2) - cost(best).powi(2) <= left_by_best || as_good(t) || nearly_all(t)
    };
    tried[1..].iter().filter(like).cloned().collect()
}

/// What would be missing is not what it is called.
fn is_none(tried: &Tried) -> bool {
    matches!(&tried.hypothesis, Hypothesis::Missing(effect) if tried.judged.model.ruled_out_because(&effect.declaration().id).is_some())
}

/// Tries every hypothesis beside a model, all else held; best first.
fn try_all(study: &Study, model: &Model, rows: &Rows, known: &[String], refitted_um: f64) -> Vec<Tried> {
    let mut hypotheses: Vec<(Hypothesis, Vec<Model>)> = Vec::new();
    let held = holding(model, |_, _| true);
    for effect in study.candidates_for(model) {
        let begun = effect.starts(&study.overview).into_iter().map(|start| study.with(&held, &[(effect.clone(), start)]));
        let begun: Vec<Model> = if effect.starts_combine() { begun.take(1).collect() } else { begun.collect() };
        hypotheses.push((Hypothesis::Missing(effect), begun));
    }
    for e in &model.effects {
        if is_main(e) || study.candidates.iter().all(|c| c.declaration().id != e.id) {
            continue;
        }
        hypotheses.push((Hypothesis::Changed(e.id.clone()), vec![holding(model, |id, _| id != e.id)]));
    }
    hypotheses.push((Hypothesis::Scaled, vec![held.clone()]));
    hypotheses.retain(|(h, _)| !known.contains(&h.effect(model)));
    let effort = Effort { iterations: 12, tolerance: 0.3, relative: 0.001, looks_again: false };
    let mut tried: Vec<Tried> = parallel::map(&hypotheses, |(hypothesis, begun)| {
        study.watch.event(&Event::Fitting { effect: &hypothesis.effect(model) });
        let fitted: Vec<Model> = match hypothesis {
            Hypothesis::Scaled => vec![scaled(study, model, rows)],
            _ => begun.iter().map(|m| as_free_as(fit_rows(m, study.dataset, rows, effort).model, model)).collect(),
        };
        let judged = fitted.into_iter().map(|m| super::judgement::judge_rows(m, study.dataset, &study.split, rows));
        let best = judged.min_by(|a, b| a.identify_rms_um.total_cmp(&b.identify_rms_um))?;
        let values = match hypothesis {
            Hypothesis::Scaled => 1,
            _ => {
                let id = hypothesis.effect(model);
                best.model.effect(&id).map_or(1, |e| e.parameters.iter().filter(|p| !p.parameter.fixed).count()).max(1)
            }
        };
        Some(Tried { hypothesis: hypothesis.clone(), judged: best, values })
    })
    .into_iter()
    .flatten()
    .filter(|t| t.judged.identify_rms_um.is_finite() && !is_none(t))
    .collect();
    tried.sort_by(|a, b| {
        a.cost(refitted_um).total_cmp(&b.cost(refitted_um)).then_with(|| a.hypothesis.effect(model).cmp(&b.hypothesis.effect(model)))
    });
    tried
}

/// The model with its hysteresis times the factor that the data ask for.
fn scaled(study: &Study, model: &Model, rows: &Rows) -> Model {
    use crate::identification::linearisation::measured;
    use crate::identification::own_part::{columns, orthonormalised, project_out_of};
    let (mut along, mut power) = (0.0, 0.0);
    for (i, samples) in &rows.records {
        let record = &study.dataset.records[*i];
        let reading = model.simulate(&record.drive());
        let own = orthonormalised(&columns(model, record, samples));
        let mut modelled = samples.of(&reading);
        let mut found = measured(record, samples);
        project_out_of(&own, &mut modelled);
        project_out_of(&own, &mut found);
        along += modelled.dot(&found);
        power += modelled.norm_squared();
    }
    let factor = if power > 0.0 { along / power } else { 1.0 };
    let mut out = model.clone();
    for e in &mut out.effects {
        let d = e.effect.declaration();
        // Coefficients in um and gains are in proportion to the displacement; thresholds and shapes are not.
        if d.place == Place::Hysteresis {
            let proportional = e.parameters.iter_mut().filter(|p| p.parameter.unit == "um" || p.parameter.unit == "um/V");
            proportional.for_each(|p| p.value *= factor);
        }
    }
    out
}
