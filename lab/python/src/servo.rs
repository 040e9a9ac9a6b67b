//! Servos at work: on a model, on a function of Python as the plant, or tick by tick.

use crate::exchange::{raised, wrong};
use crate::model::Model;
use hysteron::servo::design::ServoDesign;
use hysteron::servo::track::RunningServo;
use hysteron::servo::work::{follow, follow_plant};
use hysteron::servo::{Reference, Work};
use hysteron_sim::closed_loop::Plant;
use pyo3::prelude::*;

fn design_of(toml: &str) -> PyResult<ServoDesign> {
    ServoDesign::from_toml(toml, "servo").map_err(raised)
}

/// A function of Python as the plant: a drive in V gives a reading in um, or a reading and a true position.
struct PythonPlant<'py> {
    function: Bound<'py, PyAny>,
    raised: Option<PyErr>,
    reading_um: f64,
    position_um: f64,
}

impl PythonPlant<'_> {
    fn answer(&self, drive_v: f64) -> PyResult<(f64, f64)> {
        let answer = self.function.call1((drive_v,))?;
        let both = answer.extract::<(f64, f64)>();
        let (reading_um, position_um) = match both {
            Ok(both) => both,
            Err(_) => {
                let reading_um = answer.extract::<f64>()?;
                (reading_um, reading_um)
            }
        };
        if reading_um.is_finite() && position_um.is_finite() {
            Ok((reading_um, position_um))
        } else {
            Err(wrong(
                "plant",
                format!("{reading_um}; expected a finite reading in um"),
            ))
        }
    }
}

impl Plant for PythonPlant<'_> {
    /// No force acts from outside: what does is the function's own.
    fn advance(&mut self, drive_v: f64, _external_um: f64) {
        if self.raised.is_some() {
            return;
        }
        match self.answer(drive_v) {
            Ok((reading_um, position_um)) => {
                (self.reading_um, self.position_um) = (reading_um, position_um);
            }
            Err(error) => self.raised = Some(error),
        }
    }

    fn displacement_um(&self) -> f64 {
        self.position_um
    }

    fn sensor_um(&self) -> f64 {
        self.reading_um
    }
}

/// A reference followed on a model, or on a function of Python; figures as JSON.
#[pyfunction]
pub fn track(
    servo: &str,
    plant: &Bound<'_, PyAny>,
    reference: &str,
    scheme: Option<&str>,
    sensor_noise_um: Option<f64>,
) -> PyResult<String> {
    let design = design_of(servo)?;
    let refused = |message: String| raised(hysteron::Error::new("track", message));
    let followed = Reference::named(reference, design.period_s()).map_err(refused)?;
    let work = Work {
        scheme,
        sensor_noise_um,
        ..Work::default()
    };
    let found = match plant.extract::<PyRef<Model>>() {
        Ok(model) => follow(&model.model, &design, &followed, reference, &work),
        Err(_) => {
            let mut plant = PythonPlant {
                function: plant.clone(),
                raised: None,
                reading_um: 0.0,
                position_um: 0.0,
            };
            let called = "a function of Python";
            let found = follow_plant(&mut plant, called, &design, &followed, reference, &work);
            if let Some(error) = plant.raised {
                return Err(error);
            }
            found
        }
    };
    serde_json::to_string(&found.map_err(refused)?).map_err(|error| wrong("track", error))
}

/// A servo tick by tick.
#[pyclass]
pub struct Loop(RunningServo);

#[pymethods]
impl Loop {
    #[new]
    fn new(servo: &str) -> PyResult<Self> {
        let servo = RunningServo::new(&design_of(servo)?);
        servo.map(Self).map_err(|error| wrong("servo", error))
    }

    fn tick(&mut self, reading_um: f64, reference_um: f64) -> f64 {
        self.0.tick(reading_um, reference_um)
    }
}
