//! `dataset.toml` of a stage with several drives and sensors: `columns` are lists.

use super::recordings::{AxesData, AxesRecord};
use crate::dataset::Role;
use crate::dataset::column_rules::ColumnName;
use crate::dataset::readers::{self, Hints};
use crate::dataset::table::{Column, Table};
use crate::dataset::timing::Timing;
use crate::error::{Error, Result, line_of};
use serde::Deserialize;

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Columns {
    u: Vec<ColumnName>,
    y: Vec<ColumnName>,
    #[serde(rename = "t")]
    _t: Option<ColumnName>,
}

#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct Units {
    u: Option<String>,
    y: Option<String>,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Entry {
    file: String,
    /// Files that hold the sensors, where they are not columns of the same one.
    y_file: Option<String>,
    name: Option<String>,
    sample_rate_hz: f64,
    role: Option<Role>,
    period_s: Option<f64>,
    periodic_from_s: Option<f64>,
    columns: Columns,
    #[serde(default)]
    unit: Units,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Manifest {
    name: String,
    #[serde(rename = "drive_min_v")]
    _drive_min_v: Option<f64>,
    #[serde(rename = "drive_max_v")]
    _drive_max_v: Option<f64>,
    timing: Option<Timing>,
    record: Vec<Entry>,
}

/// Whether a manifest describes several drives or sensors: its columns are lists.
#[must_use]
pub fn has_several(text: &str) -> bool {
    let lists = |table: toml::Table| {
        let records = table.get("record")?.as_array()?.clone();
        let is_list = |record: &toml::Value| {
            let columns = record.get("columns")?.as_table()?;
            Some(
                ["u", "y"]
                    .iter()
                    .any(|key| columns.get(*key).is_some_and(toml::Value::is_array)),
            )
        };
        Some(records.iter().any(|record| is_list(record) == Some(true)))
    };
    toml::from_str::<toml::Table>(text)
        .ok()
        .and_then(lists)
        .unwrap_or(false)
}

/// Reads a manifest; `read` gives the bytes of a file beside it.
///
/// # Errors
/// One message with file, line or column, and what was expected.
pub fn from_manifest(
    text: &str,
    place: &str,
    read: &dyn Fn(&str) -> Result<Vec<u8>>,
) -> Result<AxesData> {
    let manifest: Manifest = toml::from_str(text).map_err(|e| {
        Error::new(
            format!("{place}: line {}", line_of(text, e.span())),
            e.message(),
        )
    })?;
    let hold_before = manifest.timing == Some(Timing::HoldBeforeSample);
    let mut tables: Vec<(String, Table)> = Vec::new();
    let mut records = Vec::new();
    let mut called: Option<(Vec<String>, Vec<String>)> = None;
    for entry in &manifest.record {
        for file in std::iter::once(&entry.file).chain(&entry.y_file) {
            if !tables.iter().any(|(name, _)| name == file) {
                tables.push((
                    file.clone(),
                    readers::read(file, &read(file)?, Hints::default())?,
                ));
            }
        }
        let table = |file: &str| {
            &tables
                .iter()
                .find(|(name, _)| name == file)
                .expect("it was read above")
                .1
        };
        let pick = |file: &str, key: &str, names: &[ColumnName]| -> Result<Vec<Column>> {
            let place = |name| table(file).place_of(name, &format!("[record.columns] {key}"));
            names
                .iter()
                .map(|name| Ok(table(file).columns[place(name)?].clone()))
                .collect()
        };
        let drives = pick(&entry.file, "u", &entry.columns.u)?;
        let sensors = pick(
            entry.y_file.as_ref().unwrap_or(&entry.file),
            "y",
            &entry.columns.y,
        )?;
        let names = |columns: &[Column], what: &str| {
            let name = |(i, column): (usize, &Column)| {
                if column.name.is_empty() {
                    format!("{what} {}", i + 1)
                } else {
                    column.name.clone()
                }
            };
            columns.iter().enumerate().map(name).collect::<Vec<_>>()
        };
        called.get_or_insert_with(|| (names(&drives, "drive"), names(&sensors, "sensor")));
        let mut u: Vec<Vec<f64>> = drives.into_iter().map(|column| column.values).collect();
        let y: Vec<Vec<f64>> = sensors.into_iter().map(|column| column.values).collect();
        if hold_before {
            // The drive of a row acted before its sample: that of the next row acts behind it.
            u.iter_mut().for_each(|signal| {
                signal.rotate_left(1);
                let last = signal.len() - 1;
                signal[last] = signal[last.saturating_sub(1)];
            });
        }
        let name = entry.name.clone().unwrap_or_else(|| entry.file.clone());
        let record = AxesRecord::new(
            &name,
            entry.sample_rate_hz,
            entry.role.unwrap_or(Role::Identify),
            u,
            y,
        );
        records.push(match entry.period_s {
            Some(period_s) => {
                let samples =
                    |seconds: f64| (seconds * entry.sample_rate_hz).round().max(0.0) as usize;
                record.averaged(
                    samples(period_s),
                    samples(entry.periodic_from_s.unwrap_or(period_s)),
                )?
            }
            None => record,
        });
    }
    let mut data = AxesData::new(&manifest.name, records)?;
    if let Some((drives, sensors)) = called {
        (data.drives, data.sensors) = (drives, sensors);
    }
    if let Some(entry) = manifest.record.first() {
        data.drive_unit = entry.unit.u.clone().unwrap_or(data.drive_unit);
        data.sensor_unit = entry.unit.y.clone().unwrap_or(data.sensor_unit);
    }
    Ok(data)
}

#[cfg(test)]
mod tests {
    use super::*;

    const MANIFEST: &str = r#"
name = "two axes"
[[record]]
file = "a.csv"
sample_rate_hz = 1000.0
columns = { u = ["ux", "uy"], y = ["x", 4] }
"#;

    fn file(rows: usize) -> Vec<u8> {
        let mut text = String::from("ux,uy,x,y\n");
        (0..rows).for_each(|k| text.push_str(&format!("{},{},{},{}\n", k, 2 * k, 3 * k, 4 * k)));
        text.into_bytes()
    }

    #[test]
    fn lists_of_columns_are_several_axes() {
        assert!(has_several(MANIFEST));
        assert!(!has_several(
            "name = \"one\"\n[[record]]\nfile = \"a.csv\"\ncolumns = { u = \"ux\" }"
        ));
        let data = from_manifest(MANIFEST, "dataset.toml", &|_| Ok(file(400))).unwrap();
        assert_eq!((data.drives.len(), data.sensors[1].as_str()), (2, "y"));
        assert_eq!(data.records[0].readings[1][3], 12.0);
        // Where nothing else judges, the last part does.
        assert_eq!(data.of_role(Role::Validate).count(), 1);
    }

    #[test]
    fn a_column_that_is_not_there_is_named_with_those_that_are() {
        let text = MANIFEST.replace("\"uy\"", "\"uz\"");
        let refused = from_manifest(&text, "dataset.toml", &|_| Ok(file(400)))
            .unwrap_err()
            .to_string();
        assert!(
            refused.contains("u = \"uz\"") && refused.contains("ux, uy, x, y"),
            "{refused}"
        );
    }
}
