//! The native half of the Python package `hysteron`: opaque data sets, models and results, arrays as bytes of
//! 64-bit floats, figures as JSON.
//!
//! What a person imports is `hysteron/__init__.py` and the modules beside it, which make NumPy arrays and
//! dictionaries of these. `exchange` has arrays and errors,
//! `at_work` does the work without Python's lock and looks after Ctrl-C; `dataset`,
//! `model`, `results`, `servo` and `survey` hold what is handed out.

mod at_work;
mod dataset;
mod exchange;
mod model;
mod results;
mod servo;
mod survey;

use exchange::HysteronError;
use pyo3::prelude::*;

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
