//! A chain of effects with values.

use crate::at_work::at_work;
use crate::dataset::{Dataset, auxiliary_signals, initial_state};
use crate::exchange::{bytes, numbers, raised, wrong};
use hysteron::export::{Language, export_from};
use hysteron::identification::fit;
use hysteron::model_file;
use hysteron::origin::{self, Initial, Way};
use hysteron_sim::chain::{Drive, EffectInstance, InitialState};
use pyo3::prelude::*;
use pyo3::pybacked::PyBackedBytes;
use pyo3::types::PyBytes;
use std::collections::BTreeMap;

/// A model, and the data set that its file names.
#[pyclass(frozen)]
pub struct Model {
    pub model: hysteron_sim::chain::Model,
    pub data_set: String,
}

/// Effect, name, value, standard deviation and unit.
type Parameter = (String, String, f64, Option<f64>, String);

fn parameters_of(effect: &EffectInstance) -> impl Iterator<Item = Parameter> {
    effect.parameters.iter().map(|p| {
        (
            effect.id.clone(),
            p.parameter.name.clone(),
            p.value,
            p.std,
            p.parameter.unit.clone(),
        )
    })
}

/// Where a simulation begins. At an unknown state nothing can: the first two of the words.
fn begins(place: &str, state: Option<&str>) -> PyResult<Initial> {
    match state {
        Some(state) => Ok(Initial::State(initial_state(place, state, 2)?)),
        None => Ok(Initial::AsRecorded),
    }
}

#[pymethods]
impl Model {
    #[staticmethod]
    fn from_toml(text: &str, name: String) -> PyResult<Self> {
        Ok(Self {
            model: model_file::from_toml(text, &name).map_err(raised)?,
            data_set: name,
        })
    }

    /// Its file; `today` is the date of a fit that has none yet.
    fn to_toml(&self, today: String) -> PyResult<String> {
        model_file::to_toml(&origin::dated(&self.model, today), &self.data_set).map_err(raised)
    }

    fn export(
        &self,
        language: &str,
        sample_rate_hz: Option<f64>,
        name: &str,
        state: Option<&str>,
    ) -> PyResult<String> {
        let language = Language::named("language", language).map_err(raised)?;
        let rate_hz = sample_rate_hz.unwrap_or_else(|| origin::sample_rate_hz(&self.model));
        let begins = (
            &begins("export", state)?,
            Way::told(&self.model, None, None),
        );
        export_from(&self.model, language, rate_hz, name, begins).map_err(raised)
    }

    fn effects(&self) -> Vec<String> {
        self.model.effect_ids()
    }

    fn drive_limits_v(&self) -> (f64, f64) {
        (self.model.drive_min_v, self.model.drive_max_v)
    }

    fn parameters(&self) -> Vec<Parameter> {
        self.model.effects.iter().flat_map(parameters_of).collect()
    }

    fn simulate<'py>(
        &self,
        py: Python<'py>,
        drive_v: &[u8],
        force_n: Option<PyBackedBytes>,
        auxiliary: BTreeMap<String, PyBackedBytes>,
        sample_rate_hz: f64,
        state: Option<&str>,
    ) -> PyResult<Bound<'py, PyBytes>> {
        let initial = begins("simulate", state)?;
        if !(sample_rate_hz.is_finite() && sample_rate_hz > 0.0) {
            return Err(wrong(
                "simulate",
                format!("sample_rate_hz = {sample_rate_hz}; expected a positive number"),
            ));
        }
        let (drive_v, force_n) = (numbers(drive_v), force_n.map(|force| numbers(&force)));
        if let Some(force) = force_n
            .as_ref()
            .filter(|force| force.len() != drive_v.len())
        {
            return Err(wrong(
                "simulate",
                format!(
                    "drive_v has {} samples, force_n {}; expected as many",
                    drive_v.len(),
                    force.len()
                ),
            ));
        }
        let beside = auxiliary_signals(&auxiliary);
        let drive = Drive {
            force_n: force_n.as_deref(),
            auxiliary: &beside,
            ..Drive::held(&drive_v, 1.0 / sample_rate_hz, InitialState::Virgin)
        };
        let way = Way::told(&self.model, None, None);
        let (predicted, _) = at_work(py, None, |_| {
            initial.predict(&self.model, "drive_v", &drive, way, "drive_v")
        })?;
        Ok(bytes(py, &predicted.reading_um))
    }

    /// Measured less modelled inside the window of a record.
    fn residual<'py>(
        &self,
        py: Python<'py>,
        dataset: &Dataset,
        record: usize,
    ) -> PyResult<Bound<'py, PyBytes>> {
        let record = dataset
            .0
            .records
            .get(record)
            .ok_or_else(|| wrong("record", "there is no such record"))?;
        Ok(bytes(py, &py.detach(|| fit::residual(&self.model, record))))
    }
}
