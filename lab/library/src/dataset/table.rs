//! One file of numbers as columns, whatever its format.

use super::column_rules::ColumnName;
use super::units::split_name;
use crate::error::{Error, Result, nearest};

/// One column of numbers.
#[derive(Clone, Debug, PartialEq)]
pub struct Column {
    /// Its place in the file, counted from 1.
    pub number: usize,
    /// Its name without its unit; empty where the file gives none.
    pub name: String,
    /// Its unit as the file writes it.
    pub unit: Option<String>,
    /// The numbers.
    pub values: Vec<f64>,
}

impl Column {
    /// A column whose header may hold a unit.
    #[must_use]
    pub fn new(number: usize, header: &str, values: Vec<f64>) -> Self {
        let (name, unit) = split_name(header);
        Self {
            number,
            name,
            unit,
            values,
        }
    }

    /// How it is called in messages.
    #[must_use]
    pub fn called(&self) -> String {
        match (&self.name, &self.unit) {
            (name, Some(unit)) if !name.is_empty() => format!("column `{name} [{unit}]`"),
            (name, None) if !name.is_empty() => format!("column `{name}`"),
            (_, Some(unit)) => format!("column {} [{unit}]", self.number),
            _ => format!("column {}", self.number),
        }
    }

    /// The same with its number, where names may repeat.
    #[must_use]
    pub fn called_with_number(&self) -> String {
        if self.name.is_empty() {
            self.called()
        } else {
            format!("{} (column {})", self.called(), self.number)
        }
    }
}

/// Columns of numbers.
#[derive(Clone, Debug, Default)]
pub struct Table {
    /// What the file is called in messages.
    pub place: String,
    /// The columns that hold numbers.
    pub columns: Vec<Column>,
    /// Sampling rate, where the file says one beside its columns.
    pub sample_rate_hz: Option<f64>,
    /// What a reader of the file should know.
    pub notes: Vec<String>,
    /// Lines of the file, counted from 1, in which runs of rows without a gap begin: `(row, line)`.
    pub(super) lines: Vec<(usize, usize)>,
}

/// Fewest values of an array that may be a signal.
const SIGNAL_MIN: usize = 8;
/// Names of a number alone that is the sampling rate, Hz, or the sampling period, s.
const RATES: [&str; 7] = [
    "fs",
    "samplerate",
    "rate",
    "samplingrate",
    "samplingfrequency",
    "fsamp",
    "sampleratehz",
];
const PERIODS: [&str; 6] = [
    "ts",
    "dt",
    "samplingtime",
    "sampletime",
    "samplingperiod",
    "deltat",
];
/// A rate and a period of few digits that mean the same differ by less, relatively.
const RATES_DIFFER: f64 = 1e-3;

impl Table {
    /// A table from named arrays: those that are as long as most of them are the columns, what else there is
    /// is left aside and said.
    ///
    /// # Errors
    /// Without two arrays of one length, or where a number is not finite.
    pub fn from_arrays(place: &str, arrays: Vec<(String, Vec<f64>)>) -> Result<Self> {
        let lengths = arrays
            .iter()
            .map(|(_, values)| values.len())
            .filter(|n| *n >= SIGNAL_MIN);
        let as_long = |length: usize| {
            arrays
                .iter()
                .filter(|(_, values)| values.len() == length)
                .count()
        };
        let Some(length) = lengths.max_by_key(|n| (as_long(*n).min(2), *n)) else {
            let found: Vec<String> = arrays
                .iter()
                .take(8)
                .map(|(name, values)| format!("`{name}` ({})", values.len()))
                .collect();
            return Err(Error::new(
                place,
                format!(
                    "holds no array of {SIGNAL_MIN} or more numbers; expected time, drive and displacement{}{}",
                    if found.is_empty() { "" } else { "; found " },
                    found.join(", ")
                ),
            ));
        };
        let mut table = Self {
            place: place.to_owned(),
            ..Self::default()
        };
        let (mut aside, mut rates_hz) = (Vec::new(), Vec::new());
        for (name, values) in arrays {
            if values.len() == length {
                table
                    .columns
                    .push(Column::new(table.columns.len() + 1, &name, values));
            } else if let [value] = values[..] {
                Self::take_rate(&mut rates_hz, &name, value);
            } else {
                aside.push(format!("`{name}` ({})", values.len()));
            }
        }
        table.take_rates(&rates_hz);
        if !aside.is_empty() {
            let more = aside.len().saturating_sub(6);
            aside.truncate(6);
            let and = if more > 0 {
                format!(" and {more} more")
            } else {
                String::new()
            };
            table.notes.push(format!(
                "arrays of another length than {length} are left aside: {}{and}",
                aside.join(", ")
            ));
        }
        table.finite()
    }

    fn take_rate(rates_hz: &mut Vec<(String, f64)>, name: &str, value: f64) {
        let last = name.rsplit('.').next().unwrap_or_default();
        let plain: String = last
            .chars()
            .filter(|c| c.is_alphanumeric())
            .flat_map(char::to_lowercase)
            .collect();
        if !(value.is_finite() && value > 0.0) {
            return;
        }
        let rate_hz = if RATES.contains(&plain.as_str()) {
            value
        } else if PERIODS.contains(&plain.as_str()) {
            1.0 / value
        } else {
            return;
        };
        rates_hz.push((name.to_owned(), rate_hz));
    }

    /// The sampling rate on which all that name one agree.
    fn take_rates(&mut self, rates_hz: &[(String, f64)]) {
        let Some((first, rate_hz)) = rates_hz.first() else {
            return;
        };
        match rates_hz.iter().find(|(_, other)| (other / rate_hz - 1.0).abs() > RATES_DIFFER) {
            None => self.sample_rate_hz = Some(*rate_hz),
            Some((second, other)) => self.notes.push(format!(
                "no sampling rate is taken from the file: `{first}` is {rate_hz} Hz and `{second}` is {other} Hz; --sample-rate-hz specifies one"
            )),
        }
    }

    /// Line of the file, counted from 1, in which a row of numbers, counted from 0, stands.
    #[must_use]
    pub fn line_of(&self, row: usize) -> usize {
        let run = self.lines.iter().rev().find(|(first, _)| *first <= row);
        run.map_or(row + 1, |(first, line)| line + row - first)
    }

    /// Where the column is that somebody specified; `said` is how, for messages.
    ///
    /// # Errors
    /// No column of this name or number, or two.
    pub fn place_of(&self, wanted: &ColumnName, said: &str) -> Result<usize> {
        let wrong = |message: String| Error::new(&self.place, message);
        match wanted {
            ColumnName::Number(n) => {
                self.columns
                    .iter()
                    .position(|c| c.number == *n)
                    .ok_or_else(|| {
                        let numbers: Vec<String> =
                            self.columns.iter().map(|c| c.number.to_string()).collect();
                        wrong(format!(
                            "{said} = {n}: no such column of numbers; there are {}, counted from 1",
                            numbers.join(", ")
                        ))
                    })
            }
            ColumnName::Name(name) => {
                let (bare, _) = split_name(name);
                let full = |c: &Column| {
                    c.unit
                        .as_ref()
                        .map_or(c.name.clone(), |unit| format!("{} [{unit}]", c.name))
                };
                let is_it = |c: &&Column| c.name == *name || full(c) == *name;
                let called_so: Vec<String> = self
                    .columns
                    .iter()
                    .filter(is_it)
                    .map(|c| c.number.to_string())
                    .collect();
                if called_so.len() > 1 {
                    let numbers = called_so.join(" and ");
                    return Err(wrong(format!(
                        "{said} = \"{name}\": columns {numbers} are called so; expected the number of one of them"
                    )));
                }
                let exact = self.columns.iter().position(|c| is_it(&c));
                let alike = || {
                    self.columns
                        .iter()
                        .position(|c| c.name.eq_ignore_ascii_case(&bare))
                };
                exact.or_else(alike).ok_or_else(|| {
                    let names = self.names();
                    wrong(format!(
                        "{said} = \"{name}\" is not in the header ({}){}",
                        names.join(", "),
                        nearest(name, &names)
                    ))
                })
            }
        }
    }

    /// Names of the columns, for messages.
    #[must_use]
    pub fn names(&self) -> Vec<String> {
        self.columns
            .iter()
            .map(|c| {
                if c.name.is_empty() {
                    c.number.to_string()
                } else {
                    c.name.clone()
                }
            })
            .collect()
    }

    /// Checks that there are numbers, and that they are finite.
    ///
    /// # Errors
    /// The first row and column in which they are not.
    pub fn finite(self) -> Result<Self> {
        if self.columns.iter().all(|c| c.values.is_empty()) {
            return Err(Error::new(&self.place, "is empty; expected numbers"));
        }
        for column in &self.columns {
            if let Some(row) = column.values.iter().position(|v| !v.is_finite()) {
                return Err(Error::new(
                    &self.place,
                    format!(
                        "row {}, {}: {}; expected a finite number",
                        self.line_of(row),
                        column.called(),
                        column.values[row]
                    ),
                ));
            }
        }
        Ok(self)
    }
}
