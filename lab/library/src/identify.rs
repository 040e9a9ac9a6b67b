//! `identify` and `add`: a list of effects, or one more, fitted to a data set.

use crate::dataset::Dataset;
use crate::diagnosis::judgement::{Judged, require_finite, require_signals};
use crate::diagnosis::path::{ModelChange, PathStep};
use crate::diagnosis::policy::Policy;
use crate::diagnosis::study::Study;
use crate::error::{Error, Result};
use crate::figures::{FitFigures, fit_figures, step_figures};
use crate::identification::finer_hysteresis::main_effect;
use crate::identification::held_values::{as_free_as, holding};
use crate::identification::identifiability::{CannotIdentify, identifiability};
use crate::identification::noise_floor::{NoiseFloor, noise_floor};
use crate::watch::{Watch, WatchEvent};
use hysteron_sim::chain::{EffectInstance, Model};
use hysteron_sim::effect::{Effect, gain};
use std::sync::Arc;

/// A model that was fitted, and how.
pub struct Identification {
    /// The model with standard deviations.
    pub model: Model,
    /// The noise floor of the data.
    pub floor: NoiseFloor,
    /// The steps to it.
    pub steps: Vec<PathStep>,
    /// What the data cannot tell.
    pub cannot_identify: Vec<CannotIdentify>,
    /// The caller wanted the best so far.
    pub stopped: bool,
}

impl Identification {
    /// Figures for files.
    #[must_use]
    pub fn figures(&self, dataset: &Dataset, seconds: f64) -> FitFigures {
        let mut out = fit_figures(
            &self.model,
            dataset,
            &self.floor,
            step_figures(&self.steps),
            &self.cannot_identify,
            seconds,
        );
        out.stopped = self.stopped;
        out
    }
}

/// Fits a list of effects.
///
/// Values that this data do not fix stay where they were begun, and [`Identification::cannot_identify`] says
/// which.
///
/// # Errors
/// An effect that asks for what no record has, that has no place in the chain beside the others, or that
/// gives something that is no number.
/// ```
/// use hysteron::{Dataset, Record, Unwatched, effects_named, identify};
///
/// let drive_v: Vec<f64> = (0..2000).map(|k| 5.0 - 5.0 * (0.1 * f64::from(k)).cos()).collect();
/// // A reading is taken before the drive of its row acts.
/// let reading_um: Vec<f64> = [0.0].into_iter().chain(drive_v.iter().map(|u| 0.1 * u)).take(2000).collect();
/// let record = Record::new("stage", 1000.0, drive_v, reading_um).from_virgin_state();
/// let dataset = Dataset::new("my stage", 0.0, 10.0, vec![record])?;
/// let found = identify(&dataset, &effects_named("gain")?, &Unwatched)?;
/// assert!((found.model.effects[0].parameters[0].value - 0.1).abs() < 1e-9);
/// # Ok::<(), hysteron::Error>(())
/// ```
pub fn identify(
    dataset: &Dataset,
    effects: &[Arc<dyn Effect>],
    watch: &dyn Watch,
) -> Result<Identification> {
    require_chain(effects, dataset)?;
    let floor = noise_floor(dataset);
    let study = Study::new(dataset, Vec::new(), &floor, Policy::default(), watch);
    let judged = study.build(effects)?;
    finished(
        vec![PathStep {
            change: ModelChange::Start,
            judged,
        }],
        floor,
        &study,
    )
}

/// Adds an effect to a model and fits everything again. Values that this data do not fix stay where the model
/// had them.
///
/// # Errors
/// The model has it already, it has no place in the chain, or it gives something that is no number.
/// ```
/// use hysteron::{Dataset, Record, Unwatched, add, effect_named, effects_named, identify};
///
/// let drive_v: Vec<f64> = (0..2000).map(|k| 5.0 - 5.0 * (0.1 * f64::from(k)).cos()).collect();
/// // A reading is taken before the drive of its row acts.
/// let reading_um: Vec<f64> = [0.0].into_iter().chain(drive_v.iter().map(|u| 0.1 * u)).take(2000).collect();
/// let record = Record::new("stage", 1000.0, drive_v, reading_um).from_virgin_state();
/// let dataset = Dataset::new("my stage", 0.0, 10.0, vec![record])?;
///
/// let straight = identify(&dataset, &effects_named("gain")?, &Unwatched)?.model;
/// let lagging = add(&effect_named("sensor_bandwidth")?, straight.clone(), &dataset, &Unwatched)?.model;
/// assert!(lagging.effect_ids().iter().any(|id| id == "sensor_bandwidth"));
/// // It is there once: a second time is an error with a message.
/// assert!(add(&effect_named("sensor_bandwidth")?, lagging, &dataset, &Unwatched).is_err());
/// # Ok::<(), hysteron::Error>(())
/// ```
pub fn add(
    effect: &Arc<dyn Effect>,
    model: Model,
    dataset: &Dataset,
    watch: &dyn Watch,
) -> Result<Identification> {
    watch.event(&WatchEvent::Fitting {
        effect: &effect.declaration().id,
    });
    let id = effect.declaration().id;
    if model.effect(&id).is_some() {
        let all = model.effect_ids().join(",");
        return Err(Error::new(
            "effect",
            format!(
                "{id} is in the model already; to fit it again beside the others: hysteron identify DATASET --effects {all}"
            ),
        ));
    }
    if effect.declaration().is_main()
        && let Some(loops) = main_effect(&model).filter(|loops| loops.id != gain::ID)
    {
        let others = model
            .effect_ids()
            .into_iter()
            .filter(|other| *other != loops.id);
        let all = std::iter::once(id.clone())
            .chain(others)
            .collect::<Vec<_>>()
            .join(",");
        return Err(Error::new(
            "effect",
            format!(
                "{id} would take the place of {}; to fit it instead: hysteron identify DATASET --effects {all}",
                loops.id
            ),
        ));
    }
    require_shown(std::slice::from_ref(effect), dataset)?;
    let floor = noise_floor(dataset);
    let study = Study::new(dataset, Vec::new(), &floor, Policy::default(), watch);
    let before = study.judged(model);
    let (begun, _) = study.found_alone(&before.model, effect, 3, f64::INFINITY)?;
    require_place(&begun, std::slice::from_ref(effect))?;
    let judged = fitted_around(&id, &begun, &study);
    let steps = vec![
        PathStep {
            change: ModelChange::Start,
            judged: before,
        },
        PathStep {
            change: ModelChange::Added(id),
            judged,
        },
    ];
    finished(steps, floor, &study)
}

/// A new fit of all values lowers the error, fitted and held out, by at least this share of it before it
/// replaces the values of the effect alone.
const WORTH_MOVING: f64 = 0.05;

/// Everything fitted again around an effect that was found alone; its own values move along only where that
/// is worth much: a recording that does not fix all values together would let it take up what the others
/// miss.
fn fitted_around(id: &str, begun: &Model, study: &Study) -> Judged {
    let held = holding(begun, |effect, _| effect == id);
    let mut around = study.thoroughly(&study.for_comparison(&held).model);
    around.model = as_free_as(around.model, begun);
    let all = study.thoroughly(&around.model);
    if study.merit(&all) < study.merit(&around) - WORTH_MOVING {
        all
    } else {
        around
    }
}

fn finished(steps: Vec<PathStep>, floor: NoiseFloor, study: &Study) -> Result<Identification> {
    let last = &steps[steps.len() - 1].judged;
    let floor = last
        .floor_beside(&floor, study.policy.explained, study.dataset)
        .unwrap_or(floor);
    let mut model = last.model.clone();
    require_finite(&model, study.dataset, &study.split.both())?;
    let cannot_identify = identifiability(&mut model, study.dataset, &study.split.identify);
    Ok(Identification {
        model,
        floor,
        steps,
        cannot_identify,
        stopped: study.watch.stopped(),
    })
}

/// Whether a list of effects makes one chain on this data, before anything is fitted.
///
/// # Errors
/// None is given, one is given twice, asks for what no record has, or has no place in the chain beside the
/// others.
pub fn require_chain(effects: &[Arc<dyn Effect>], dataset: &Dataset) -> Result<()> {
    if effects.is_empty() {
        return Err(Error::new(
            "effects",
            "none are given; expected at least `gain` or a hysteresis",
        ));
    }
    let ids: Vec<String> = effects.iter().map(|e| e.declaration().id).collect();
    if let Some(twice) = (1..ids.len()).find(|i| ids[..*i].contains(&ids[*i])) {
        return Err(Error::new(
            "effects",
            format!("{} is given twice", ids[twice]),
        ));
    }
    require_shown(effects, dataset)?;
    let overview = dataset.overview();
    let mut chain = Model::new(dataset.drive_min_v, dataset.drive_max_v);
    effects
        .iter()
        .for_each(|effect| chain.add(EffectInstance::new(effect.clone(), &overview, &[])));
    require_place(&chain, effects)
}

/// An effect without any beginning on this data asks for what no record has.
fn require_shown(effects: &[Arc<dyn Effect>], dataset: &Dataset) -> Result<()> {
    let overview = dataset.overview();
    require_signals(effects, dataset)?;
    match effects
        .iter()
        .map(|e| e.declaration())
        .zip(effects)
        .find(|(_, e)| e.starts(&overview).is_empty())
    {
        Some((d, _)) => Err(Error::NotIdentifiable {
            effect: d.id,
            why: format!("no record shows it. Best shown by: {}", d.experiment),
        }),
        None => Ok(()),
    }
}

/// Every effect of a list has found its place in the chain: none was replaced by another that stands there.
fn require_place(model: &Model, effects: &[Arc<dyn Effect>]) -> Result<()> {
    for declaration in effects.iter().map(|e| e.declaration()) {
        if model.effect(&declaration.id).is_some() {
            continue;
        }
        let stands_there = |d: &hysteron_sim::effect::Declaration| {
            d.place == declaration.place && d.modifies.is_none()
        };
        let other = model
            .effects
            .iter()
            .find(|e| stands_there(&e.effect.declaration()))
            .map_or("another effect", |e| e.id.as_str());
        let message = format!(
            "{} and {other} stand in the same place of the chain; expected one of them",
            declaration.id
        );
        return Err(Error::new("effects", message));
    }
    Ok(())
}
