//! What crosses the border to Python: errors, and arrays as bytes.

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
pub fn raised(error: hysteron::Error) -> PyErr {
    HysteronError::new_err(error.to_string())
}

/// What is wrong with an argument.
pub fn wrong(place: &str, message: impl std::fmt::Display) -> PyErr {
    raised(hysteron::Error::new(place, message))
}

/// The numbers of a NumPy array of 64-bit floats.
pub fn numbers(bytes: &[u8]) -> Vec<f64> {
    bytes
        .as_chunks()
        .0
        .iter()
        .map(|bytes| f64::from_ne_bytes(*bytes))
        .collect()
}

/// Numbers as NumPy takes them.
pub fn bytes<'py>(py: Python<'py>, numbers: &[f64]) -> Bound<'py, PyBytes> {
    PyBytes::new(
        py,
        numbers
            .iter()
            .flat_map(|number| number.to_ne_bytes())
            .collect::<Vec<u8>>()
            .as_slice(),
    )
}
