//! What a person says about the files of a data set: columns, units, sampling rate.

use crate::screen::as_argument;
use hysteron::dataset::column_rules::ColumnRules;
use hysteron::dataset::column_rules::{ColumnName, PerColumn};
use hysteron::dataset::reading::Instructions;
use hysteron::dataset::timing::{Timing, intersample_named};
use hysteron::{Error, Model, Result};
use std::collections::BTreeMap;
use std::path::Path;

/// Arguments of every command that reads recordings.
#[derive(clap::Args, Clone, Debug, Default)]
pub struct ReadArguments {
    /// Which column is what, by number from 1 or by name: t=1,u=3,y=2
    #[arg(long, value_name = "LIST", help_heading = "Reading")]
    columns: Option<String>,
    /// Units of columns, or sensitivities: u=mV,y=nm or y=5um/V
    #[arg(long, value_name = "LIST", help_heading = "Reading")]
    units: Option<String>,
    /// Columns of further signals that own effects take part of: temperature_c=4
    #[arg(long, value_name = "LIST", help_heading = "Reading")]
    auxiliary: Option<String>,
    /// Sampling rate of files without time stamps
    #[arg(long, value_name = "HZ", help_heading = "Reading")]
    sample_rate_hz: Option<f64>,
    /// Whether the drive of a row acts from its sample on (hold_after_sample) or up to it
    /// (hold_before_sample)
    #[arg(long, value_name = "NAME", help_heading = "Reading")]
    timing: Option<String>,
    /// What the drive does between samples: hold (a converter's output), linear, band_limited (a measured
    /// signal)
    #[arg(long, value_name = "NAME", help_heading = "Reading")]
    intersample: Option<String>,
    /// Rows of text to leave out at the top of a file
    #[arg(long, value_name = "N", help_heading = "Reading")]
    skip_rows: Option<usize>,
}

impl ReadArguments {
    /// What is specified of a recording where there is one.
    pub fn require_recording(&self, recording: Option<&Path>) -> Result<()> {
        match self.as_words().first() {
            Some(option) if recording.is_none() => Err(Error::new(
                option,
                "has no effect without --data; name the recording, or leave it out",
            )),
            _ => Ok(()),
        }
    }

    /// The same as words behind a data set: options and their values.
    pub fn as_words(&self) -> Vec<String> {
        let rate = self.sample_rate_hz.map(|rate| rate.to_string());
        let rows = self.skip_rows.map(|rows| rows.to_string());
        let said = [
            ("--columns", &self.columns),
            ("--units", &self.units),
            ("--auxiliary", &self.auxiliary),
            ("--sample-rate-hz", &rate),
            ("--timing", &self.timing),
            ("--intersample", &self.intersample),
            ("--skip-rows", &rows),
        ];
        let given = said
            .into_iter()
            .filter_map(|(name, value)| Some([name.to_owned(), value.clone()?]));
        given.flatten().collect()
    }

    /// The same as they are typed, each with a space before it, for a suggested command.
    pub fn as_typed(&self) -> String {
        let words = self.as_words();
        words
            .iter()
            .map(|word| format!(" {}", as_argument(Path::new(word))))
            .collect()
    }

    /// The same in the words of the library.
    ///
    /// # Errors
    /// What is not of the form `t=1,u=3`.
    pub fn instructions(&self) -> Result<Instructions> {
        let column = |text: &str| {
            text.parse()
                .map_or_else(|_| ColumnName::Name(text.to_owned()), ColumnName::Number)
        };
        if let Some(rate) = self
            .sample_rate_hz
            .filter(|rate| !(rate.is_finite() && *rate > 0.0))
        {
            return Err(Error::new(
                "--sample-rate-hz",
                format!("{rate}; expected a positive number"),
            ));
        }
        Ok(Instructions {
            timing: self
                .timing
                .as_deref()
                .map(|name| Timing::named("--timing", name))
                .transpose()?,
            intersample: self
                .intersample
                .as_deref()
                .map(|name| intersample_named("--intersample", name))
                .transpose()?,
            wanted: ColumnRules {
                columns: by_signal("--columns", self.columns.as_deref(), column)?,
                unit: by_signal("--units", self.units.as_deref(), str::to_owned)?,
                scale: PerColumn::default(),
                auxiliary: by_name(self.auxiliary.as_deref(), column)?,
            },
            sample_rate_hz: self.sample_rate_hz,
            skip_rows: self.skip_rows,
            rate_otherwise_hz: None,
        })
    }

    /// The same beside a model, whose records give the rate that a file lacks.
    pub fn instructions_beside(&self, model: &Model) -> Result<Instructions> {
        let known = model.identified.as_deref();
        let rate = known.map(|known| known.recorded.sample_rate_hz);
        Ok(Instructions {
            rate_otherwise_hz: rate.filter(|rate| *rate > 0.0),
            ..self.instructions()?
        })
    }
}

/// `temperature_c=4,..` as one column by name.
fn by_name(
    list: Option<&str>,
    column: impl Fn(&str) -> ColumnName,
) -> Result<BTreeMap<String, ColumnName>> {
    let mut found = BTreeMap::new();
    for item in list
        .unwrap_or_default()
        .split(',')
        .map(str::trim)
        .filter(|item| !item.is_empty())
    {
        let said = item
            .split_once('=')
            .map(|(name, text)| (name.trim(), text.trim()))
            .filter(|(name, text)| !name.is_empty() && !text.is_empty());
        let Some((name, text)) = said.filter(|(name, _)| !found.contains_key(*name)) else {
            return Err(Error::new(
                "--auxiliary",
                format!("`{item}`; expected names with their columns, each once: temperature_c=4"),
            ));
        };
        found.insert(name.to_owned(), column(text));
    }
    Ok(found)
}

/// `t=..,u=..` as one value by signal.
fn by_signal<T>(
    option: &str,
    list: Option<&str>,
    value: impl Fn(&str) -> T,
) -> Result<PerColumn<T>> {
    let mut found = PerColumn::default();
    for item in list
        .unwrap_or_default()
        .split(',')
        .map(str::trim)
        .filter(|item| !item.is_empty())
    {
        let (key, text) = item
            .split_once('=')
            .map_or((item, ""), |(key, text)| (key.trim(), text.trim()));
        let place = found
            .by_key(key)
            .filter(|place| place.is_none() && !text.is_empty());
        let Some(place) = place else {
            return Err(Error::new(
                option,
                format!(
                    "`{item}`; expected t=.., u=.., y=.. or force=.., each once, with commas between"
                ),
            ));
        };
        *place = Some(value(text));
    }
    Ok(found)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lists_by_signal() {
        let said = |columns: &str, units: &str| {
            ReadArguments {
                columns: Some(columns.into()),
                units: Some(units.into()),
                ..Default::default()
            }
            .instructions()
        };
        let found = said("t=1, u=drive", "y=5um/V").unwrap().wanted;
        assert_eq!(found.columns.t, Some(ColumnName::Number(1)));
        assert_eq!(found.columns.u, Some(ColumnName::Name("drive".into())));
        assert_eq!(found.unit.y.as_deref(), Some("5um/V"));
        for wrong in ["q=1", "t", "t=1,t=2", "t="] {
            assert!(
                said(wrong, "")
                    .unwrap_err()
                    .to_string()
                    .contains("--columns"),
                "{wrong}"
            );
        }
    }
}
