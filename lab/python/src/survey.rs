//! Many recordings: effects that they have in common, a row for each, and the page.

use crate::at_work::at_work;
use crate::dataset::Dataset;
use crate::exchange::{raised, wrong};
use hysteron::analyse::{Options, Start, analyse};
use hysteron::survey::{Survey, SurveyRow};
use hysteron::{effects_named, survey};
use hysteron_report::survey_page;
use pyo3::prelude::*;
use std::time::Instant;

fn json(value: &impl serde::Serialize) -> PyResult<String> {
    serde_json::to_string(value).map_err(|error| wrong("survey", error))
}

/// Effects that the recordings of a sample have in common.
#[pyfunction]
pub fn common_effects(
    py: Python<'_>,
    sample: Vec<PyRef<Dataset>>,
    start: &str,
) -> PyResult<Vec<String>> {
    let sample: Vec<hysteron::Dataset> = sample.iter().map(|read| (*read.0).clone()).collect();
    let start = effects_named(start).map_err(raised)?;
    at_work(py, None, |told| {
        survey::common_effects(&sample, &start, &Options::default(), told)
    })
}

/// The row of a recording, as JSON.
#[pyfunction]
pub fn survey_row(
    py: Python<'_>,
    recording: &str,
    dataset: &Dataset,
    effects: &str,
) -> PyResult<String> {
    let effects = effects_named(effects).map_err(raised)?;
    let (dataset, began) = (&dataset.0, Instant::now());
    let row = at_work(py, None, |told| {
        let found = analyse(dataset, Start::Effects(&effects), &Options::default(), told)?;
        let read = found.dataset(dataset);
        let seconds = began.elapsed().as_secs_f64();
        Ok(SurveyRow::found(recording, read, &found, seconds))
    })?;
    json(&row)
}

/// Rows side by side: figures as JSON, and the page.
#[pyfunction]
pub fn survey_of(effects: Vec<String>, rows: &str) -> PyResult<(String, String)> {
    let rows: Vec<SurveyRow> = serde_json::from_str(rows).map_err(|error| wrong("rows", error))?;
    let survey = Survey::new(effects, rows);
    let page = survey_page(&survey, "the Python package hysteron".into());
    Ok((json(&survey)?, page.to_html()))
}
