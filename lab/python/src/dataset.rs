//! Data sets of arrays and of files.

use crate::exchange::{bytes, numbers, raised, wrong};
use hysteron::dataset::column_rules::ColumnRules;
use hysteron::dataset::column_rules::{ColumnName, PerColumn};
use hysteron::dataset::reading::Instructions;
use hysteron::dataset::timing::{Timing, intersample_named};
use hysteron::dataset::{Periods, folder};
use hysteron::{Record, Role};
use hysteron_sim::chain::InitialState;
use hysteron_sim::effect::AuxiliarySignal;
use pyo3::prelude::*;
use pyo3::pybacked::PyBackedBytes;
use pyo3::types::PyBytes;
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;

/// Records of one actuator.
#[pyclass(frozen)]
pub struct Dataset(pub Arc<hysteron::Dataset>);

/// A record as a dictionary, with the keys of `hysteron.Record`; signals are `PyBackedBytes` on the way in,
/// `Bound<PyBytes>` on the way out.
#[derive(FromPyObject, IntoPyObject)]
#[pyo3(from_item_all)]
struct RecordParts<Signal> {
    name: String,
    sample_rate_hz: f64,
    drive_v: Signal,
    displacement_um: Signal,
    force_n: Option<Signal>,
    auxiliary: BTreeMap<String, Signal>,
    role: String,
    initial_state: String,
    /// First sample that counts, and the one behind the last.
    window: Option<(usize, usize)>,
    /// Stretches inside the window that do not count.
    left_out: Vec<(usize, usize)>,
    /// First sample of the first steady-state period, samples of a period, whole periods.
    periods: Option<(usize, usize, usize)>,
    repeat_of: Option<String>,
    offset: Option<String>,
}

const STATES: [(&str, InitialState); 3] = [
    ("virgin", InitialState::Virgin),
    ("settled", InitialState::Settled),
    ("unknown", InitialState::Unknown),
];

/// The state that a word stands for, among the first `allowed` of [`STATES`].
pub fn initial_state(place: &str, word: &str, allowed: usize) -> PyResult<InitialState> {
    let known = &STATES[..allowed];
    let words: Vec<&str> = known.iter().map(|(word, _)| *word).collect();
    known
        .iter()
        .find(|(known, _)| *known == word)
        .map(|(_, state)| *state)
        .ok_or_else(|| {
            wrong(
                place,
                format!(
                    "initial_state = \"{word}\"; expected {}",
                    words.join(" or ")
                ),
            )
        })
}

/// Further signals by name.
pub fn auxiliary_signals(by_name: &BTreeMap<String, PyBackedBytes>) -> Vec<AuxiliarySignal> {
    by_name
        .iter()
        .map(|(name, values)| AuxiliarySignal {
            name: name.clone(),
            values: numbers(values),
        })
        .collect()
}

fn record_of(parts: RecordParts<PyBackedBytes>) -> PyResult<Record> {
    let RecordParts {
        name,
        sample_rate_hz,
        drive_v,
        displacement_um,
        force_n,
        role,
        window,
        left_out,
        periods,
        repeat_of,
        offset,
        auxiliary,
        ..
    } = parts;
    let roles = [Role::Identify, Role::Validate, Role::Noise, Role::Test];
    let Some(role) = roles.into_iter().find(|known| known.name() == role) else {
        return Err(wrong(
            &name,
            format!("role = \"{role}\"; expected identify, validate, noise or test"),
        ));
    };
    let initial_state = initial_state(&name, &parts.initial_state, STATES.len())?;
    let offset_is_fitted = match offset.as_deref() {
        Some("fit") => true,
        Some("zero") => false,
        None => initial_state != InitialState::Virgin,
        Some(other) => {
            return Err(wrong(
                &name,
                format!("offset = \"{other}\"; expected fit or zero"),
            ));
        }
    };
    let drive_v = numbers(&drive_v);
    if let Some((from, to)) = left_out
        .iter()
        .find(|(from, to)| from >= to || *to > drive_v.len())
    {
        return Err(wrong(
            &name,
            format!("left_out = ({from}, {to}); expected a first sample, and one behind the last"),
        ));
    }
    let mut record = Record {
        role,
        initial_state,
        offset_is_fitted,
        window: window.map_or(0..drive_v.len(), |(from, to)| from..to),
        periods: periods.map(|(from, length, count)| Periods {
            from,
            length,
            count,
        }),
        repeat_of,
        force_n: force_n.map(|force| numbers(&force)),
        auxiliary: auxiliary_signals(&auxiliary),
        ..Record::new(name, sample_rate_hz, drive_v, numbers(&displacement_um))
    };
    record.leave_out(left_out.into_iter().map(|(from, to)| from..to));
    Ok(record)
}

fn parts_of<'py>(py: Python<'py>, record: &Record) -> RecordParts<Bound<'py, PyBytes>> {
    let state = STATES
        .iter()
        .find(|(_, state)| *state == record.initial_state)
        .map_or("unknown", |(word, _)| word);
    RecordParts {
        name: record.name.clone(),
        sample_rate_hz: record.sample_rate_hz,
        drive_v: bytes(py, &record.drive_v),
        displacement_um: bytes(py, &record.displacement_um),
        force_n: record.force_n.as_ref().map(|force| bytes(py, force)),
        auxiliary: record
            .auxiliary
            .iter()
            .map(|signal| (signal.name.clone(), bytes(py, &signal.values)))
            .collect(),
        role: record.role.name().into(),
        initial_state: state.into(),
        window: Some((record.window.start, record.window.end)),
        left_out: record
            .left_out
            .iter()
            .map(|range| (range.start, range.end))
            .collect(),
        periods: record.periods.map(|p| (p.from, p.length, p.count)),
        repeat_of: record.repeat_of.clone(),
        offset: Some(
            if record.offset_is_fitted {
                "fit"
            } else {
                "zero"
            }
            .into(),
        ),
    }
}

/// A column by its number from 1 or by its name.
#[derive(FromPyObject)]
enum Column {
    Number(usize),
    Name(String),
}

/// What is specified by signal, `t`, `u`, `y` or `force`.
fn by_signal<T, U>(
    argument: &str,
    said: BTreeMap<String, T>,
    value: impl Fn(T) -> U,
) -> PyResult<PerColumn<U>> {
    let mut found = PerColumn::default();
    for (signal, said) in said {
        let Some(place) = found.by_key(&signal) else {
            return Err(wrong(
                argument,
                format!("`{signal}`; expected t, u, y or force"),
            ));
        };
        *place = Some(value(said));
    }
    Ok(found)
}

#[pymethods]
impl Dataset {
    #[staticmethod]
    fn from_records(
        name: String,
        drive_limits_v: (f64, f64),
        sensor_bandwidth_hz: Option<f64>,
        sensor_lsb_um: Option<f64>,
        records: Vec<RecordParts<PyBackedBytes>>,
    ) -> PyResult<Self> {
        let records = records
            .into_iter()
            .map(record_of)
            .collect::<PyResult<_>>()?;
        let dataset = hysteron::Dataset::new(name, drive_limits_v.0, drive_limits_v.1, records)
            .map_err(raised)?;
        Ok(Self(Arc::new(hysteron::Dataset {
            sensor_bandwidth_hz,
            sensor_lsb_um,
            ..dataset
        })))
    }

    #[staticmethod]
    fn load(
        py: Python<'_>,
        path: PathBuf,
        columns: BTreeMap<String, Column>,
        units: BTreeMap<String, String>,
        auxiliary: BTreeMap<String, Column>,
        sample_rate_hz: Option<f64>,
        skip_rows: Option<usize>,
        timing: Option<String>,
        intersample: Option<String>,
    ) -> PyResult<Self> {
        let column = |column| match column {
            Column::Number(number) => ColumnName::Number(number),
            Column::Name(name) => ColumnName::Name(name),
        };
        let (columns, unit) = (
            by_signal("columns", columns, column)?,
            by_signal("units", units, |unit| unit)?,
        );
        let auxiliary = auxiliary
            .into_iter()
            .map(|(name, said)| (name, column(said)))
            .collect();
        let wanted = ColumnRules {
            columns,
            unit,
            scale: PerColumn::default(),
            auxiliary,
        };
        let timing = timing
            .map(|name| Timing::named("timing", &name))
            .transpose()
            .map_err(raised)?;
        let intersample = intersample
            .map(|name| intersample_named("intersample", &name))
            .transpose()
            .map_err(raised)?;
        let instructions = Instructions {
            wanted,
            sample_rate_hz,
            skip_rows,
            timing,
            intersample,
            rate_otherwise_hz: None,
        };
        Ok(Self(Arc::new(
            py.detach(|| folder::load_as(&path, &instructions))
                .map_err(raised)?,
        )))
    }

    fn name(&self) -> &str {
        &self.0.name
    }

    fn drive_limits_v(&self) -> (f64, f64) {
        (self.0.drive_min_v, self.0.drive_max_v)
    }

    fn sensor_bandwidth_hz(&self) -> Option<f64> {
        self.0.sensor_bandwidth_hz
    }

    fn sensor_lsb_um(&self) -> Option<f64> {
        self.0.sensor_lsb_um
    }

    fn notes(&self) -> Vec<String> {
        self.0.remarks()
    }

    fn record_names(&self) -> Vec<String> {
        self.0
            .records
            .iter()
            .map(|record| record.name.clone())
            .collect()
    }

    fn records<'py>(&self, py: Python<'py>) -> Vec<RecordParts<Bound<'py, PyBytes>>> {
        self.0
            .records
            .iter()
            .map(|record| parts_of(py, record))
            .collect()
    }
}
