//! The way from the start to what was found, one effect at a time: for people, who want to see the error
//! fall.

use super::judgement::Judged;
use super::study::Study;
use crate::error::Result;
use crate::identification::finer_creep;
use crate::identification::finer_hysteresis::{description, with_the_structure_of};
use crate::parallel;
use hysteron_sim::chain::{EffectInstance, Model};
use hysteron_sim::effect::{Effect, Overview};
use std::sync::Arc;

/// One step of the way.
#[derive(Clone)]
pub struct PathStep {
    /// What changed.
    pub change: ModelChange,
    /// The model after the step.
    pub judged: Judged,
}

/// What changes in a step.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum ModelChange {
    /// The model that was started from.
    Start,
    /// An effect was added.
    Added(String),
    /// These effects were added until the search was stopped; nothing weighed them.
    AddedUnweighed(Vec<String>),
    /// The same hysteresis was described better: more finely, or by loops of another structure.
    FinerHysteresis(String),
    /// The same creep was described better.
    FinerCreep(String),
    /// All values were fitted again, to this recording.
    FittedAgain,
    /// An effect that was there took other values; all others were held.
    Changed(String),
}

impl ModelChange {
    /// The effect that was added, if one was; several with commas between.
    #[must_use]
    pub fn added(&self) -> Option<String> {
        match self {
            Self::Added(id) => Some(id.clone()),
            Self::AddedUnweighed(ids) => Some(ids.join(", ")),
            _ => None,
        }
    }
}

/// What is behind by so much where it can be compared does not come to it, fitted to the end.
const DOES_NOT_COME_TO_IT: f64 = 0.1;

/// A model with one effect more, at the values that another model has for it; its hysteresis begins as coarse
/// as it is declared.
fn joined(model: &Model, effect: &Arc<dyn Effect>, of: &Model, overview: &Overview) -> Model {
    let mut out = model.clone();
    let id = effect.declaration().id;
    let plain = EffectInstance::new(effect.clone(), overview, &[]);
    let same_shape = of
        .effect(&id)
        .filter(|e| e.parameters.len() == plain.parameters.len());
    out.add(same_shape.cloned().unwrap_or(plain));
    out
}

/// An effect that is still to come on the way.
struct OnTheWay {
    effect: Arc<dyn Effect>,
    /// By how much it lowered the merit where it was tried last.
    brought: f64,
}

/// Effects that are tried side by side.
const TRIED_TOGETHER: usize = 2;

/// The effect that lowers the error most beside a model, and how it stands there. Beside a better model an
/// effect seldom brings more than before: those that brought less than another does now are not tried again.
fn next_on_the_way(
    study: &Study,
    last: &Model,
    left: &mut [OnTheWay],
    end: &Model,
) -> Option<(usize, Judged)> {
    let before = study.merit(&study.judged_quickly(last.clone()));
    let mut possible: Vec<usize> = (0..left.len())
        .filter(|i| left[*i].effect.may_join(last, &study.overview))
        .collect();
    possible.sort_by(|a, b| left[*b].brought.total_cmp(&left[*a].brought));
    let mut best: Option<(usize, Judged)> = None;
    for some in possible.chunks(TRIED_TOGETHER) {
        let brought_most = best
            .as_ref()
            .map_or(f64::NEG_INFINITY, |(i, _)| left[*i].brought);
        if some.iter().all(|i| left[*i].brought < brought_most) {
            break;
        }
        // Begun where the end has it: what is shown is the way there. Which comes next shows before its fit
        // is at its end.
        let tried = parallel::map(some, |i| {
            study.roughly(&joined(last, &left[*i].effect, end, &study.overview))
        });
        for (i, judged) in some.iter().zip(tried) {
            left[*i].brought = before - study.merit(&judged);
            if best
                .as_ref()
                .is_none_or(|(of, _)| left[*i].brought > left[*of].brought)
            {
                best = Some((*i, judged));
            }
        }
    }
    best
}

/// From a start to the end: at every step the effect that lowers the error most. The last step is the end
/// itself.
///
/// # Errors
/// A candidate that gives something that is no number.
pub fn from(
    study: &Study,
    start: &Judged,
    added: &[String],
    end: &Judged,
) -> Result<Vec<PathStep>> {
    let mut steps = vec![PathStep {
        change: ModelChange::Start,
        judged: start.clone(),
    }];
    let on_the_way = |e: &EffectInstance| OnTheWay {
        effect: e.effect.clone(),
        brought: f64::INFINITY,
    };
    let mut left: Vec<OnTheWay> = added
        .iter()
        .filter_map(|id| end.model.effect(id))
        .map(on_the_way)
        .collect();
    let mut last = start.model.clone();
    // Loops of another structure first: beside the wrong one no effect shows what it does.
    if let Some(begin) = with_the_structure_of(&last, &end.model)
        .filter(|m| !added.iter().any(|id| m.effect(id).is_some()))
    {
        last = study.for_comparison(&begin).model;
        steps.push(PathStep {
            change: ModelChange::FinerHysteresis(description(&last)),
            judged: study.judged(last.clone()),
        });
    }
    while let Some((i, judged)) = next_on_the_way(study, &last, &mut left, &end.model) {
        let OnTheWay { effect, .. } = left.remove(i);
        last = study.quickly(&judged.model).model;
        steps.push(PathStep {
            change: ModelChange::Added(effect.declaration().id),
            judged: study.judged(last.clone()),
        });
    }
    // What the end has beside all effects: a finer description, where that brings something, and the values
    // of a fit that went as far as it goes.
    let mut end = end.clone();
    let finer_creep = finer_creep::description(&end.model)
        .filter(|_| finer_creep::steps_finer(&end.model) != finer_creep::steps_finer(&last));
    let finer_hysteresis =
        (description(&last) != description(&end.model)).then(|| description(&end.model));
    if finer_hysteresis.is_some() || finer_creep.is_some() {
        let finer_by =
            Study::steps_finer(&end.model).saturating_sub(Study::steps_finer(&last)) as f64;
        let most = study.merit(&end) + study.policy.gain_per_effect * finer_by;
        let coarse = study.for_comparison(&last);
        let coarse = (study.merit(&coarse) < most + DOES_NOT_COME_TO_IT)
            .then(|| study.thoroughly(&coarse.model));
        if let Some(coarse) = coarse.filter(|coarse| study.merit(coarse) <= most) {
            end = coarse;
        } else {
            let change = finer_hysteresis
                .map(ModelChange::FinerHysteresis)
                .or(finer_creep.map(ModelChange::FinerCreep));
            steps.extend(change.map(|change| PathStep {
                change,
                judged: end.clone(),
            }));
        }
    }
    if let Some(step) = steps.last_mut().filter(|s| s.change != ModelChange::Start) {
        step.judged = end;
    }
    Ok(steps)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::{Dataset, Record};
    use crate::diagnosis::policy::Policy;
    use crate::identification::noise_floor::noise_floor;
    use crate::model_file::effects_named;
    use crate::watch::Unwatched;
    use hysteron_sim::chain::Model;

    #[test]
    fn what_lowers_the_error_most_comes_first_and_the_end_is_the_last_step() {
        let drive_v: Vec<f64> = (0..3000)
            .map(|k| 50.0 - 50.0 * (0.006 * f64::from(k)).cos())
            .collect();
        let (mut lagged_um, mut drift_um) = (0.0, 0.0);
        let read = drive_v.iter().map(|v| {
            let read_um = lagged_um + drift_um;
            lagged_um += (0.09 * v - lagged_um) * 0.1;
            drift_um += 5e-6;
            read_um
        });
        let read_um = read.collect();
        let records = vec![Record::new("r", 1000.0, drive_v, read_um)];
        let dataset = Dataset::new("d", 0.0, 100.0, records).unwrap();
        let (floor, policy) = (noise_floor(&dataset), Policy::default());
        let study = Study::new(&dataset, Vec::new(), &floor, policy, &Unwatched);
        let fitted = |names: &str| {
            let mut model = Model::new(0.0, 100.0);
            for effect in effects_named(names).unwrap() {
                model.add(EffectInstance::new(effect, &dataset.overview(), &[]));
            }
            study.thoroughly(&model)
        };
        let (start, end) = (
            fitted("gain"),
            fitted("gain,sensor_bandwidth,thermal_drift"),
        );
        let added = ["thermal_drift", "sensor_bandwidth"].map(str::to_owned);
        let steps = from(&study, &start, &added, &end).unwrap();
        let changes: Vec<Option<String>> = steps.iter().map(|s| s.change.added()).collect();
        let expected = ["sensor_bandwidth", "thermal_drift"].map(|id| Some(id.to_owned()));
        assert_eq!(changes, [vec![None], expected.to_vec()].concat());
        let errors: Vec<f64> = steps.iter().map(|s| s.judged.identify_rms_um).collect();
        assert!(errors.windows(2).all(|w| w[1] < 0.5 * w[0]), "{errors:?}");
        assert_eq!(errors[2], end.identify_rms_um);
    }
}
