//! `dataset.toml`: what a folder of records says about itself. Unknown keys are errors, with the nearest known one named.

use super::Role;
use crate::problem::{Problem, Result, nearest};
use hysteron_sim::chain::InitialState;
use serde::Deserialize;
use std::path::Path;

/// The file as it is written.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Manifest {
    /// Name of the data set.
    pub name: String,
    /// Limits of the drive, V.
    pub drive_min_v: f64,
    /// Limits of the drive, V.
    pub drive_max_v: f64,
    /// The one timing convention.
    #[serde(default)]
    pub timing: Timing,
    /// From a data sheet.
    pub sensor_bandwidth_hz: Option<f64>,
    /// From a data sheet.
    pub sensor_lsb_um: Option<f64>,
    /// The records.
    #[serde(default)]
    pub record: Vec<RecordEntry>,
}

/// When samples are taken and drives act.
#[derive(Clone, Copy, Debug, Default, Deserialize, PartialEq, Eq)]
#[serde(rename_all = "snake_case")]
pub enum Timing {
    /// `y[k]` is sampled at `t[k]`; `u[k]` acts from `t[k]` to `t[k+1]`.
    #[default]
    HoldAfterSample,
}

/// State at the first sample.
#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Eq)]
#[serde(rename_all = "lowercase")]
pub enum InitialStateEntry {
    /// All states zero.
    Virgin,
    /// At rest at the first drive value.
    Settled,
    /// Initial states are estimated.
    Unknown,
}

impl From<InitialStateEntry> for InitialState {
    fn from(entry: InitialStateEntry) -> Self {
        match entry {
            InitialStateEntry::Virgin => InitialState::Virgin,
            InitialStateEntry::Settled => InitialState::Settled,
            InitialStateEntry::Unknown => InitialState::Unknown,
        }
    }
}

/// Whether a constant is estimated for a record.
#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Eq)]
#[serde(rename_all = "lowercase")]
pub enum Offset {
    /// It is.
    Fit,
    /// The sensor reads zero at rest.
    Zero,
}

/// A column by its name or by its number, counted from 1.
#[derive(Clone, Debug, Deserialize, PartialEq)]
#[serde(untagged)]
pub enum ColumnName {
    /// Counted from 1.
    Number(usize),
    /// As in the header; with a unit in brackets or as a suffix.
    Name(String),
}

/// Which column is what.
#[derive(Clone, Debug, Default, Deserialize, PartialEq)]
#[serde(deny_unknown_fields)]
pub struct Columns {
    /// Time.
    pub t: Option<ColumnName>,
    /// Drive.
    pub u: Option<ColumnName>,
    /// Displacement.
    pub y: Option<ColumnName>,
    /// External force.
    pub force: Option<ColumnName>,
}

/// One `[[record]]`.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RecordEntry {
    /// File, relative to the manifest.
    pub file: String,
    /// Sampling rate.
    pub sample_rate_hz: f64,
    /// What it is for.
    pub role: Role,
    /// State at the first sample.
    pub initial_state: InitialStateEntry,
    /// Window that counts.
    pub from_s: Option<f64>,
    /// Window that counts.
    pub to_s: Option<f64>,
    /// Steady-state period.
    pub period_s: Option<f64>,
    /// Start of the steady state.
    pub periodic_from_s: Option<f64>,
    /// Same drive as that record.
    pub repeat_of: Option<String>,
    /// Constant of the record.
    pub offset: Option<Offset>,
    /// Which column is what.
    #[serde(default)]
    pub columns: Columns,
}

/// Every key that a manifest may have.
const KEYS: [&str; 22] = [
    "name",
    "drive_min_v",
    "drive_max_v",
    "timing",
    "sensor_bandwidth_hz",
    "sensor_lsb_um",
    "record",
    "file",
    "sample_rate_hz",
    "role",
    "initial_state",
    "from_s",
    "to_s",
    "period_s",
    "periodic_from_s",
    "repeat_of",
    "offset",
    "columns",
    "t",
    "u",
    "y",
    "force",
];

impl Manifest {
    /// Reads and checks the file.
    ///
    /// # Errors
    /// Names line, key and the nearest known key.
    pub fn read(path: &Path) -> Result<Self> {
        let text = std::fs::read_to_string(path).map_err(|e| Problem::file(path, format!("cannot be read: {e}")))?;
        let manifest: Self = toml::from_str(&text).map_err(|e| {
            let line = e.span().map_or(0, |span| text[..span.start.min(text.len())].lines().count().max(1));
            let message = e.message().to_string();
            let hint = message
                .strip_prefix("unknown field `")
                .and_then(|rest| rest.split('`').next())
                .map_or_else(String::new, |key| nearest(key, &KEYS.map(String::from)));
            let brief = if hint.is_empty() { message } else { message.split(", expected").next().unwrap_or_default().to_string() };
            Problem::new(format!("{}: line {line}", path.display()), format!("{brief}{hint}"))
        })?;
        if manifest.record.is_empty() {
            return Err(Problem::file(path, "has no [[record]]; expected at least one"));
        }
        Ok(manifest)
    }
}
