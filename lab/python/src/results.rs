//! The pieces of work that the program has as commands, and what they come to.

use crate::at_work::at_work;
use crate::dataset::Dataset;
use crate::exchange::{raised, wrong};
use crate::model::Model;
use hysteron::analyse::{Options, Outcome as Found, Start, analyse};
use hysteron::diagnosis::judgement::{noise_floor_beside, require_finite};
use hysteron::figures::{FitFigures, fit_figures};
use hysteron::identify::{Identification, add as add_effect, identify as identify_effects};
use hysteron::model_file;
use hysteron::origin::read_as_recorded;
use hysteron::servo::commands::design_with_expected_errors;
use hysteron::servo::order::DesignOrder;
use hysteron_report::{comparison_report, explain_page, explain_report};
use hysteron_sim::effect::Effect;
use pyo3::prelude::*;
use serde::Serialize;
use std::sync::Arc;
use std::time::Instant;

fn json(value: &impl Serialize) -> PyResult<String> {
    serde_json::to_string(value).map_err(|error| wrong("figures", error))
}

/// Figures, model and page of one piece of work.
#[pyclass(frozen)]
pub struct Outcome {
    model: hysteron_sim::chain::Model,
    dataset: Arc<hysteron::Dataset>,
    figures: FitFigures,
    /// All that was found, where something was looked for.
    found: Option<Box<Found>>,
}

/// The page's remark on what made it.
const MADE_BY: &str = "the Python package hysteron";

#[pymethods]
impl Outcome {
    fn model(&self) -> Model {
        Model {
            model: self.model.clone(),
            data_set: self.dataset.name.clone(),
        }
    }

    fn figures(&self) -> PyResult<String> {
        json(&self.figures)
    }

    fn html(&self, py: Python<'_>) -> String {
        py.detach(|| {
            let report = match &self.found {
                Some(found) => explain_report(found, &self.dataset, MADE_BY.into()),
                None => {
                    comparison_report(&self.model, &self.dataset, &self.figures, MADE_BY.into())
                }
            };
            explain_page(&report).to_html()
        })
    }

    fn next_drive(&self) -> Option<String> {
        self.found
            .as_ref()?
            .next_experiment
            .as_ref()
            .map(|next| next.proposal.csv())
    }
}

/// An effect by its name, or of the user's own: the text of its definition and what that is called in
/// messages.
#[derive(FromPyObject)]
pub enum EffectSaid {
    Named(String),
    Own(String, String),
}

fn effects_of(said: Vec<EffectSaid>) -> PyResult<Vec<Arc<dyn Effect>>> {
    let effect = |said| match said {
        EffectSaid::Named(name) => model_file::effect_named(&name),
        EffectSaid::Own(text, name) => model_file::own_effect(&text, &name),
    };
    said.into_iter()
        .map(effect)
        .collect::<hysteron::Result<_>>()
        .map_err(raised)
}

fn searched(
    py: Python<'_>,
    dataset: &Dataset,
    start: Start,
    own: Vec<EffectSaid>,
    progress: Option<Py<PyAny>>,
) -> PyResult<Outcome> {
    let options = Options {
        own: effects_of(own)?,
        ..Options::default()
    };
    let (dataset, started) = (&dataset.0, Instant::now());
    at_work(py, progress, |told| {
        let found = analyse(dataset, start, &options, told)?;
        let figures = found.figures(dataset, started.elapsed().as_secs_f64());
        Ok(Outcome {
            model: found.model.clone(),
            dataset: Arc::new(found.dataset(dataset).clone()),
            figures,
            found: Some(Box::new(found)),
        })
    })
}

fn fitted(
    py: Python<'_>,
    dataset: &Dataset,
    progress: Option<Py<PyAny>>,
    work: impl FnOnce(&crate::at_work::Told) -> hysteron::Result<Identification> + Send,
) -> PyResult<Outcome> {
    let (dataset, started) = (&dataset.0, Instant::now());
    at_work(py, progress, |told| {
        let fit = work(told)?;
        let figures = fit.figures(dataset, started.elapsed().as_secs_f64());
        Ok(Outcome {
            model: fit.model,
            dataset: Arc::clone(dataset),
            figures,
            found: None,
        })
    })
}

/// The main job from a list of effects.
#[pyfunction]
pub fn explain(
    py: Python<'_>,
    dataset: &Dataset,
    effects: Vec<EffectSaid>,
    own: Vec<EffectSaid>,
    progress: Option<Py<PyAny>>,
) -> PyResult<Outcome> {
    let effects = effects_of(effects)?;
    searched(py, dataset, Start::Effects(&effects), own, progress)
}

/// The data set as the records of a model were read, in all that nobody specified.
fn as_recorded(model: &Model, dataset: &Dataset) -> Dataset {
    let read = read_as_recorded(&model.model, &dataset.0);
    Dataset(read.map_or_else(|| Arc::clone(&dataset.0), Arc::new))
}

/// The main job from a model as it is.
#[pyfunction]
pub fn diagnose(
    py: Python<'_>,
    model: &Model,
    dataset: &Dataset,
    own: Vec<EffectSaid>,
    progress: Option<Py<PyAny>>,
) -> PyResult<Outcome> {
    searched(
        py,
        dataset,
        Start::Model(model.model.clone()),
        own,
        progress,
    )
}

/// A list of effects fitted.
#[pyfunction]
pub fn identify(
    py: Python<'_>,
    dataset: &Dataset,
    effects: Vec<EffectSaid>,
    progress: Option<Py<PyAny>>,
) -> PyResult<Outcome> {
    let effects = effects_of(effects)?;
    fitted(py, dataset, progress, |told| {
        identify_effects(&dataset.0, &effects, told)
    })
}

/// One effect more.
#[pyfunction]
pub fn add(
    py: Python<'_>,
    effect: EffectSaid,
    model: &Model,
    dataset: &Dataset,
    progress: Option<Py<PyAny>>,
) -> PyResult<Outcome> {
    let effect = effects_of(vec![effect])?;
    let dataset = &as_recorded(model, dataset);
    fitted(py, dataset, progress, |told| {
        add_effect(&effect[0], model.model.clone(), &dataset.0, told)
    })
}

/// A model as it is.
#[pyfunction]
pub fn compare(py: Python<'_>, model: &Model, dataset: &Dataset) -> PyResult<Outcome> {
    let (dataset, started) = (&as_recorded(model, dataset).0, Instant::now());
    let model = model.model.clone();
    at_work(py, None, |_| {
        require_finite(
            &model,
            dataset,
            &(0..dataset.records.len()).collect::<Vec<_>>(),
        )?;
        let figures = fit_figures(
            &model,
            dataset,
            &noise_floor_beside(&model, dataset),
            Vec::new(),
            &[],
            started.elapsed().as_secs_f64(),
        );
        Ok(Outcome {
            model,
            dataset: Arc::clone(dataset),
            figures,
            found: None,
        })
    })
}

/// The servo as the text of its file, and its figures.
#[pyfunction]
pub fn design(
    py: Python<'_>,
    model: &Model,
    dataset: Option<&Dataset>,
    reference_hz: f64,
    sensor_noise_um: Option<f64>,
    sensor_bandwidth_hz: Option<f64>,
    sensitivity_peak: Option<f64>,
) -> PyResult<(String, String)> {
    let dataset = dataset.map(|dataset| as_recorded(model, dataset));
    let recording = dataset.as_ref().map(|dataset| dataset.0.as_ref());
    let usual = DesignOrder::default();
    let order = DesignOrder {
        reference_hz,
        sensor_noise_um,
        sensor_bandwidth_hz,
        sensitivity_peak: sensitivity_peak.unwrap_or(usual.sensitivity_peak),
        usual_margins: sensitivity_peak.is_none(),
        recording,
        ..usual
    };
    let design = at_work(py, None, |_| {
        design_with_expected_errors(&model.model, &order)
            .map(|(design, _)| design)
            .map_err(|why| hysteron::Error::new("design", why))
    })?;
    Ok((
        toml::to_string_pretty(&design).map_err(|error| wrong("design", error))?,
        json(&design)?,
    ))
}
