//! One file of numbers as columns with units: CSV with or without a header (comma, semicolon, tab), NPY and NPZ arrays.

use super::manifest::{ColumnName, Columns};
use crate::problem::{Problem, Result, nearest};
use std::path::{Path, PathBuf};

/// Columns of numbers.
#[derive(Clone, Debug)]
pub struct Table {
    /// The file.
    pub path: PathBuf,
    /// Names from the header, or empty.
    pub names: Vec<String>,
    /// The columns.
    pub columns: Vec<Vec<f64>>,
    /// Row of the file in which the numbers begin, counted from 1.
    pub first_data_row: usize,
}

/// The signals of a record in the program's units.
#[derive(Clone, Debug)]
pub struct Signals {
    /// Time, s.
    pub t_s: Option<Vec<f64>>,
    /// Drive, V.
    pub u_v: Vec<f64>,
    /// Displacement, um.
    pub y_um: Vec<f64>,
    /// Force, N.
    pub force_n: Option<Vec<f64>>,
}

/// What a column may be: key, words that its name may begin with, and the units it may have with their factors.
struct Quantity {
    key: &'static str,
    words: &'static [&'static str],
    units: &'static [(&'static str, f64)],
}

const TIME: Quantity =
    Quantity { key: "t", words: &["t", "time", "zeit"], units: &[("s", 1.0), ("ms", 1e-3), ("us", 1e-6), ("µs", 1e-6), ("min", 60.0)] };
const DRIVE: Quantity =
    Quantity { key: "u", words: &["u", "v", "voltage", "drive", "input", "padrag"], units: &[("v", 1.0), ("mv", 1e-3), ("kv", 1e3)] };
const DISPLACEMENT: Quantity = Quantity {
    key: "y",
    words: &["y", "x", "displacement", "position", "disp", "pos", "output", "sensor"],
    units: &[("um", 1.0), ("µm", 1.0), ("nm", 1e-3), ("mm", 1e3), ("m", 1e6)],
};
const FORCE: Quantity = Quantity { key: "force", words: &["force", "f", "load"], units: &[("n", 1.0), ("mn", 1e-3), ("kn", 1e3)] };

impl Table {
    /// Reads a file by its extension; anything that is not NPY or NPZ is taken for CSV.
    ///
    /// # Errors
    /// Missing, empty or ragged files, text or NaN in a cell: with the row and the column.
    pub fn read(path: &Path) -> Result<Self> {
        if !path.is_file() {
            return Err(Problem::file(path, "does not exist; expected the file of a record"));
        }
        match path.extension().and_then(|e| e.to_str()).map(str::to_lowercase).as_deref() {
            Some("npy") => Self::read_npy(path),
            Some("npz") => Self::read_npz(path),
            _ => Self::read_csv(path),
        }
    }

    fn read_csv(path: &Path) -> Result<Self> {
        let bytes = std::fs::read(path).map_err(|e| Problem::file(path, format!("cannot be read: {e}")))?;
        let text = String::from_utf8(bytes).map_err(|_| Problem::file(path, "is not text; expected CSV, NPY or NPZ"))?;
        let text = text.strip_prefix('\u{feff}').unwrap_or(&text);
        let Some(first) = text.lines().find(|l| !l.trim().is_empty()) else {
            return Err(Problem::file(path, "is empty; expected rows of numbers"));
        };
        let delimiter = [b'\t', b';', b','].into_iter().find(|d| first.as_bytes().contains(d)).unwrap_or(b',');
        let decimal_comma = delimiter != b',';
        let mut reader = csv::ReaderBuilder::new()
            .delimiter(delimiter)
            .has_headers(false)
            .flexible(true)
            .comment(Some(b'#'))
            .trim(csv::Trim::All)
            .from_reader(text.as_bytes());
        let number = |cell: &str| -> Option<f64> {
            cell.parse().ok().or_else(|| if decimal_comma { cell.replace(',', ".").parse().ok() } else { None })
        };
        let mut names: Vec<String> = Vec::new();
        let mut columns: Vec<Vec<f64>> = Vec::new();
        let mut blank: Vec<bool> = Vec::new();
        let mut first_data_row = 1;
        for (index, row) in reader.records().enumerate() {
            let row = row.map_err(|e| Problem::file(path, e))?;
            let line = row.position().map_or(index + 1, |p| p.line() as usize);
            if columns.is_empty() {
                if names.is_empty() && row.iter().any(|cell| !cell.is_empty() && number(cell).is_none()) {
                    names = row.iter().map(str::to_string).collect();
                    continue;
                }
                if !names.is_empty() && row.len() != names.len() {
                    return Err(Problem::file(path, format!("row {line}: {} cells under a header of {}", row.len(), names.len())));
                }
                columns = vec![Vec::new(); row.len()];
                blank = row.iter().map(str::is_empty).collect();
                first_data_row = line;
            }
            if row.len() != columns.len() {
                return Err(Problem::file(
                    path,
                    format!("row {line}: {} cells; expected {} as in the first row", row.len(), columns.len()),
                ));
            }
            for (c, cell) in row.iter().enumerate() {
                if blank[c] && cell.is_empty() {
                    continue;
                }
                let name = names.get(c).map_or_else(|| format!("column {}", c + 1), |n| format!("column `{n}`"));
                let value = number(cell).ok_or_else(|| Problem::file(path, format!("row {line}, {name}: \"{cell}\" is not a number")))?;
                if !value.is_finite() {
                    return Err(Problem::file(path, format!("row {line}, {name}: {cell}; expected a finite number")));
                }
                columns[c].push(value);
            }
        }
        if columns.first().is_none_or(Vec::is_empty) && columns.iter().all(Vec::is_empty) {
            return Err(Problem::file(path, "has no rows of numbers"));
        }
        Ok(Self { path: path.to_path_buf(), names, columns, first_data_row })
    }

    fn read_npy(path: &Path) -> Result<Self> {
        let bytes = std::fs::read(path).map_err(|e| Problem::file(path, format!("cannot be read: {e}")))?;
        let (shape, values) = npy_values(path, &bytes[..])?;
        let (rows, width) = match shape[..] {
            [rows, width] => (rows, width),
            _ => return Err(Problem::file(path, format!("has shape {shape:?}; expected (samples, columns) with columns t, u, y"))),
        };
        let columns: Vec<Vec<f64>> = (0..width).map(|c| (0..rows).map(|r| values[r * width + c]).collect()).collect();
        Self { path: path.to_path_buf(), names: Vec::new(), columns, first_data_row: 1 }.finite()
    }

    fn read_npz(path: &Path) -> Result<Self> {
        let fail = |e: std::io::Error| Problem::file(path, format!("cannot be read as NPZ: {e}"));
        let mut archive = npyz::npz::NpzArchive::open(path).map_err(fail)?;
        let mut names: Vec<String> = archive.array_names().map(str::to_string).collect();
        names.sort();
        let mut columns = Vec::new();
        for name in &names {
            let Some(file) = archive.by_name(name).map_err(fail)? else { continue };
            columns.push(f64_values(path, file)?.1);
        }
        if let Some(i) = columns.iter().position(|c| c.len() != columns[0].len()) {
            return Err(Problem::file(
                path,
                format!("array `{}` has {} values, `{}` {}", names[i], columns[i].len(), names[0], columns[0].len()),
            ));
        }
        Self { path: path.to_path_buf(), names, columns, first_data_row: 1 }.finite()
    }

    fn finite(self) -> Result<Self> {
        if self.columns.is_empty() || self.columns[0].is_empty() {
            return Err(Problem::file(&self.path, "is empty; expected numbers"));
        }
        for (c, column) in self.columns.iter().enumerate() {
            if let Some(row) = column.iter().position(|v| !v.is_finite()) {
                return Err(Problem::file(&self.path, format!("row {}, column {}: not a finite number", row + 1, c + 1)));
            }
        }
        Ok(self)
    }

    /// Picks the signals of a record.
    ///
    /// # Errors
    /// A column that is not there, with the nearest name; a unit that is not known.
    pub fn assign(&self, wanted: &Columns) -> Result<Signals> {
        let time = self.find(&TIME, wanted.t.as_ref())?;
        let drive = self.find(&DRIVE, wanted.u.as_ref())?;
        let displacement = self.find(&DISPLACEMENT, wanted.y.as_ref())?;
        let force = self.find(&FORCE, wanted.force.as_ref())?;
        let anonymous = self.names.is_empty() && *wanted == Columns::default();
        let (time, drive, displacement) = if anonymous {
            let filled: Vec<usize> = (0..self.columns.len()).filter(|&c| !self.columns[c].is_empty()).collect();
            match filled[..] {
                [t, u, y] => (Some((t, 1.0)), Some((u, 1.0)), Some((y, 1.0))),
                _ => {
                    return Err(Problem::file(
                        &self.path,
                        format!(
                            "has {} columns and no header; expected t, u, y, or [columns] in dataset.toml that says which is which",
                            filled.len()
                        ),
                    ));
                }
            }
        } else {
            (time, drive, displacement)
        };
        let missing = |q: &Quantity| {
            Problem::file(
                &self.path,
                format!("no column for {} found among {}; name it under [columns] in dataset.toml", q.key, self.names.join(", ")),
            )
        };
        let (u, u_factor) = drive.ok_or_else(|| missing(&DRIVE))?;
        let (y, y_factor) = displacement.ok_or_else(|| missing(&DISPLACEMENT))?;
        let scaled = |(c, factor): (usize, f64)| -> Vec<f64> { self.columns[c].iter().map(|v| v * factor).collect() };
        Ok(Signals { t_s: time.map(scaled), u_v: scaled((u, u_factor)), y_um: scaled((y, y_factor)), force_n: force.map(scaled) })
    }

    /// Time and drive of a file that has no displacement.
    ///
    /// # Errors
    /// When either column is missing.
    pub fn drive_only(&self) -> Result<(Vec<f64>, Vec<f64>)> {
        let pick = |quantity: &Quantity, anonymous: usize| -> Result<Vec<f64>> {
            let found = if self.names.is_empty() { Some((anonymous, 1.0)) } else { self.find(quantity, None)? };
            let (c, factor) = found
                .filter(|(c, _)| self.columns.get(*c).is_some_and(|column| !column.is_empty()))
                .ok_or_else(|| Problem::file(&self.path, format!("no column for {}; expected t and u", quantity.key)))?;
            Ok(self.columns[c].iter().map(|v| v * factor).collect())
        };
        Ok((pick(&TIME, 0)?, pick(&DRIVE, 1)?))
    }

    fn find(&self, quantity: &Quantity, wanted: Option<&ColumnName>) -> Result<Option<(usize, f64)>> {
        match wanted {
            Some(ColumnName::Number(n)) => {
                let filled = *n >= 1 && self.columns.get(*n - 1).is_some_and(|c| !c.is_empty());
                if !filled {
                    return Err(Problem::file(
                        &self.path,
                        format!("[columns] {} = {n}: there are {} columns, counted from 1", quantity.key, self.columns.len()),
                    ));
                }
                Ok(Some((n - 1, 1.0)))
            }
            Some(ColumnName::Name(name)) => {
                let bare = |s: &str| s.split('[').next().unwrap_or_default().trim().to_lowercase();
                let at = self.names.iter().position(|n| n == name).or_else(|| self.names.iter().position(|n| bare(n) == bare(name)));
                let Some(at) = at else {
                    return Err(Problem::file(
                        &self.path,
                        format!(
                            "[columns] {} = \"{name}\" is not in the header ({}){}",
                            quantity.key,
                            self.names.join(", "),
                            nearest(name, &self.names)
                        ),
                    ));
                };
                Ok(Some((at, self.unit_factor(quantity, name)?)))
            }
            None => {
                for word in quantity.words {
                    for (c, name) in self.names.iter().enumerate() {
                        let lower = name.to_lowercase();
                        let head = lower.split(['_', ' ', '[', '(']).next().unwrap_or_default();
                        if head == *word {
                            return Ok(Some((c, self.unit_factor(quantity, name)?)));
                        }
                    }
                }
                Ok(None)
            }
        }
    }

    fn unit_factor(&self, quantity: &Quantity, name: &str) -> Result<f64> {
        let lower = name.to_lowercase();
        let bracketed = lower.split_once(['[', '(']).map(|(_, rest)| rest.trim_end_matches([']', ')']).trim().to_string());
        let suffix = lower.rsplit_once('_').map(|(_, unit)| unit.to_string());
        let known = |unit: &str| quantity.units.iter().find(|(u, _)| *u == unit).map(|(_, f)| *f);
        match (bracketed, suffix) {
            (Some(unit), _) => known(&unit).ok_or_else(|| {
                let expected: Vec<_> = quantity.units.iter().map(|(u, _)| *u).collect();
                Problem::file(
                    &self.path,
                    format!("column `{name}`: unit \"{unit}\" is not one of {} for {}", expected.join(", "), quantity.key),
                )
            }),
            (None, Some(unit)) => Ok(known(&unit).unwrap_or(1.0)),
            (None, None) => Ok(1.0),
        }
    }
}

fn npy_values(path: &Path, bytes: &[u8]) -> Result<(Vec<usize>, Vec<f64>)> {
    let file = npyz::NpyFile::new(bytes).map_err(|e| Problem::file(path, format!("cannot be read as NPY: {e}")))?;
    f64_values(path, file)
}

fn f64_values<R: std::io::Read>(path: &Path, file: npyz::NpyFile<R>) -> Result<(Vec<usize>, Vec<f64>)> {
    let fail = |e: &dyn std::fmt::Display| Problem::file(path, format!("cannot be read as an array of numbers: {e}"));
    let shape: Vec<usize> = file.shape().iter().map(|n| *n as usize).collect();
    let order = file.order();
    let kind = file.dtype().descr();
    let values: Vec<f64> = if kind.contains("f4") {
        file.into_vec::<f32>().map_err(|e| fail(&e))?.into_iter().map(f64::from).collect()
    } else {
        file.into_vec::<f64>().map_err(|e| fail(&e))?
    };
    if order == npyz::Order::Fortran && shape.len() == 2 {
        let (rows, width) = (shape[0], shape[1]);
        let c_order = (0..rows * width).map(|i| values[(i % width) * rows + i / width]).collect();
        return Ok((shape, c_order));
    }
    Ok((shape, values))
}

/// Sampling rate from time stamps.
///
/// # Errors
/// Without time, or where time does not run evenly.
pub fn sample_rate_hz(path: &Path, t_s: &Option<Vec<f64>>) -> Result<f64> {
    let Some(t_s) = t_s.as_ref().filter(|t| t.len() > 1) else {
        return Err(Problem::file(path, "has no time column; expected t in s, or a dataset.toml with sample_rate_hz"));
    };
    let span = t_s[t_s.len() - 1] - t_s[0];
    if span <= 0.0 {
        return Err(Problem::file(path, "time does not increase from the first to the last row"));
    }
    let fs = (t_s.len() - 1) as f64 / span;
    check_time(path, t_s, fs, 1)?;
    Ok(fs)
}

/// Checks that time stamps run evenly at a sampling rate, within 1 % of a period.
///
/// # Errors
/// The row in which time stands still, runs backwards or jumps.
pub fn check_time(path: &Path, t_s: &[f64], sample_rate_hz: f64, first_data_row: usize) -> Result<()> {
    let period = 1.0 / sample_rate_hz;
    for (k, pair) in t_s.windows(2).enumerate() {
        let row = first_data_row + k + 1;
        let step = pair[1] - pair[0];
        if step <= 0.0 {
            return Err(Problem::file(path, format!("row {row}: time {} s does not increase (row before: {} s)", pair[1], pair[0])));
        }
        if (step - period).abs() > 0.01 * period + 1e-9 {
            return Err(Problem::file(
                path,
                format!("row {row}: time jumps by {step:.6e} s; expected {period:.6e} s within 1 % (sample_rate_hz = {sample_rate_hz:.6})"),
            ));
        }
    }
    Ok(())
}
