//! The native half of the Python package `hysteron`: opaque data sets, models and results, arrays as bytes of
//! 64-bit floats, figures as JSON.
//!
//! What a person imports is `hysteron/__init__.py` and the modules beside it, which make NumPy arrays and
//! dictionaries of these. `at_work` does the work without Python's lock and looks after Ctrl-C; `dataset`,
//! `model`, `results`, `servo` and `survey` hold what is handed out.

mod at_work;
mod dataset;
mod model;
mod results;
mod servo;
mod survey;

use pyo3::create_exception;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyBytes;

create_exception!(
    hysteron,
    HysteronError,
    PyValueError,
    "Wrong input: where, what is wrong, and what was expected."
);

/// The library's one message as an exception.
fn raised(error: hysteron::Error) -> PyErr {
    HysteronError::new_err(error.to_string())
}

/// What is wrong with an argument.
fn wrong(place: &str, message: impl std::fmt::Display) -> PyErr {
    raised(hysteron::Error::new(place, message))
}

/// The numbers of a NumPy array of 64-bit floats.
fn numbers(bytes: &[u8]) -> Vec<f64> {
    bytes
        .as_chunks()
        .0
        .iter()
        .map(|bytes| f64::from_ne_bytes(*bytes))
        .collect()
}

/// Numbers as NumPy takes them.
fn bytes<'py>(py: Python<'py>, numbers: &[f64]) -> Bound<'py, PyBytes> {
    PyBytes::new(
        py,
        numbers
            .iter()
            .flat_map(|number| number.to_ne_bytes())
            .collect::<Vec<u8>>()
            .as_slice(),
    )
}

/// The module that `hysteron/__init__.py` imports.
#[pymodule]
fn _native(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add("HysteronError", module.py().get_type::<HysteronError>())?;
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    module.add_class::<dataset::Dataset>()?;
    module.add_class::<model::Model>()?;
    module.add_class::<results::Outcome>()?;
    module.add_function(wrap_pyfunction!(results::explain, module)?)?;
    module.add_function(wrap_pyfunction!(results::diagnose, module)?)?;
    module.add_function(wrap_pyfunction!(results::identify, module)?)?;
    module.add_function(wrap_pyfunction!(results::add, module)?)?;
    module.add_function(wrap_pyfunction!(results::compare, module)?)?;
    module.add_function(wrap_pyfunction!(results::design, module)?)?;
    module.add_class::<servo::Loop>()?;
    module.add_function(wrap_pyfunction!(servo::track, module)?)?;
    module.add_function(wrap_pyfunction!(survey::common_effects, module)?)?;
    module.add_function(wrap_pyfunction!(survey::survey_row, module)?)?;
    module.add_function(wrap_pyfunction!(survey::survey_of, module)?)
}
