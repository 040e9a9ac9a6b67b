//! `dataset.toml`: what a folder of records says about itself. Unknown keys are errors, with the nearest
//! known one named.

use super::column_rules::{ColumnName, ColumnRules, Columns, PerColumn};
use super::record::Role;
use super::timing::Timing;
use crate::error::{Error, Result, line_of, nearest};
use hysteron_sim::chain::InitialState;
use hysteron_sim::intersample::Intersample;
use serde::Deserialize;
use std::collections::BTreeMap;

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
    /// When the drive of a row acts; from the records where it is not said.
    pub timing: Option<Timing>,
    /// What the drive does between samples; from the records where it is not specified.
    pub intersample: Option<IntersampleEntry>,
    /// From a data sheet.
    pub sensor_bandwidth_hz: Option<f64>,
    /// From a data sheet.
    pub sensor_lsb_um: Option<f64>,
    /// The records.
    #[serde(default)]
    pub record: Vec<RecordEntry>,
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

/// What the drive does between samples.
#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Eq)]
#[serde(rename_all = "snake_case")]
pub enum IntersampleEntry {
    /// A converter holds it.
    Hold,
    /// It runs straight.
    Linear,
    /// It has no power above half the sampling rate.
    BandLimited,
}

impl From<IntersampleEntry> for Intersample {
    fn from(entry: IntersampleEntry) -> Self {
        match entry {
            IntersampleEntry::Hold => Self::Hold,
            IntersampleEntry::Linear => Self::Linear,
            IntersampleEntry::BandLimited => Self::BandLimited,
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

/// One `[[record]]`.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RecordEntry {
    /// File, relative to the manifest.
    pub file: String,
    /// What the record is called; the file's name without its extension where it is not said.
    pub name: Option<String>,
    /// Sampling rate; from the time stamps where it is not said.
    pub sample_rate_hz: Option<f64>,
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
    /// Units by signal, where the file does not give them: `mV`, or a sensitivity `5 um/V`.
    #[serde(default)]
    pub unit: PerColumn<String>,
    /// Factors by signal, beside that of the unit.
    #[serde(default)]
    pub scale: PerColumn<f64>,
    /// Columns of further signals, for effects of the user's own, by the name that those call them by.
    #[serde(default)]
    pub auxiliary: BTreeMap<String, ColumnName>,
    /// Rows of text to leave out at the top of the file.
    #[serde(default)]
    pub skip_rows: usize,
    /// Uneven time stamps: `true` resamples whatever the gaps, `false` refuses; where it is not said, jitter
    /// and short gaps are resampled.
    pub resample: Option<bool>,
}

impl RecordEntry {
    /// What the entry specifies for the columns of the file.
    #[must_use]
    pub fn wanted(&self) -> ColumnRules {
        ColumnRules {
            columns: self.columns.clone(),
            unit: self.unit.clone(),
            scale: self.scale.clone(),
            auxiliary: self.auxiliary.clone(),
        }
    }
}

/// Every key that a manifest may have.
const KEYS: [&str; 28] = [
    "intersample",
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
    "unit",
    "scale",
    "auxiliary",
    "skip_rows",
    "resample",
    "t",
    "u",
    "y",
    "force",
];

/// How the message about a key that nobody knows begins.
const UNKNOWN: &str = "unknown field `";

/// Keys that a data set needs, and each of its records.
const NEEDED: [&str; 3] = ["name", "drive_min_v", "drive_max_v"];
const NEEDED_OF_A_RECORD: [&str; 3] = ["file", "role", "initial_state"];

/// Every key that is needed and missing, so that one run tells all of them.
fn missing_keys(table: &toml::Table) -> Vec<String> {
    let of = |table: &toml::Table, needed: &[&str]| {
        needed
            .iter()
            .filter(|key| !table.contains_key(**key))
            .map(|key| format!("`{key}`"))
            .collect::<Vec<_>>()
    };
    let mut out = Vec::new();
    let own = of(table, &NEEDED);
    if !own.is_empty() {
        out.push(format!(
            "{} (limits in V, beside [[record]])",
            own.join(", ")
        ));
    }
    let records = table
        .get("record")
        .and_then(toml::Value::as_array)
        .cloned()
        .unwrap_or_default();
    for (i, record) in records
        .iter()
        .enumerate()
        .filter_map(|(i, record)| Some((i, record.as_table()?)))
    {
        let keys = of(record, &NEEDED_OF_A_RECORD);
        if !keys.is_empty() {
            out.push(format!("{} of record {}", keys.join(", "), i + 1));
        }
    }
    out
}

impl Manifest {
    /// Reads and checks the text; `place` is what the file is called in messages.
    ///
    /// # Errors
    /// Names line, key and the nearest known key.
    pub fn parse(text: &str, place: &str) -> Result<Self> {
        if let Ok(table) = toml::from_str::<toml::Table>(text) {
            if let Some(schema) = table.get("schema").and_then(toml::Value::as_str) {
                let message = format!(
                    "is a file of schema {schema}, not a data set; expected a dataset.toml with [[record]], or recordings"
                );
                return Err(Error::new(place, message));
            }
            let missing = missing_keys(&table);
            // A key that is misspelt is missing too: the line that has it says more.
            let is_misspelt = || {
                let read = toml::from_str::<Self>(text);
                read.is_err_and(|e| e.message().starts_with(UNKNOWN))
            };
            if !missing.is_empty() && !is_misspelt() {
                return Err(Error::new(place, format!("misses {}", missing.join("; "))));
            }
        }
        let manifest: Self = toml::from_str(text).map_err(|e| {
            let line = line_of(text, e.span());
            let message = e.message().to_string();
            let hint = message
                .strip_prefix(UNKNOWN)
                .and_then(|rest| rest.split('`').next())
                .map_or_else(String::new, |key| nearest(key, &KEYS.map(String::from)));
            let brief = if hint.is_empty() {
                message
            } else {
                message
                    .split(", expected")
                    .next()
                    .unwrap_or_default()
                    .to_string()
            };
            Error::new(format!("{place}: line {line}"), format!("{brief}{hint}"))
        })?;
        if manifest.record.is_empty() {
            return Err(Error::new(
                place,
                "has no [[record]]; expected at least one",
            ));
        }
        Ok(manifest)
    }
}
