//! Recordings with several drives and sensors: in memory, and from a manifest.
//!
//! A record that repeats a period is reduced to one mean period, simulated behind a second one that is not
//! counted. The scatter between its periods is the noise.

use crate::dataset::Role;
use crate::dataset::readers::{self, Hints};
use crate::dataset::table::{Column, Table};
use crate::error::{Error, Result, line_of};
use serde::Deserialize;

/// One record.
#[derive(Clone, Debug)]
pub struct AxesRecord {
    /// Its name.
    pub name: String,
    /// Samples per second.
    pub sample_rate_hz: f64,
    /// Whether it is fitted or judges.
    pub role: Role,
    /// Each drive.
    pub drives: Vec<Vec<f64>>,
    /// Each sensor.
    pub readings: Vec<Vec<f64>>,
    /// First sample that counts: before it the stage forgets what nobody recorded.
    pub counted_from: usize,
    /// First sample that does not count any more.
    pub counted_to: usize,
    /// It is a period that was repeated for long.
    pub periodic: bool,
    /// RMS noise of each sensor in what is counted, where the record shows it.
    pub noise: Option<Vec<f64>>,
}

/// Shortest warm-up, as a share of a record that has no period.
const WARM_UP: f64 = 0.05;
/// Share of a record that is fitted, where no other record judges.
const FITTED: f64 = 0.65;

impl AxesRecord {
    /// A record as it was measured, without a period.
    #[must_use]
    pub fn new(name: &str, sample_rate_hz: f64, role: Role, drives: Vec<Vec<f64>>, readings: Vec<Vec<f64>>) -> Self {
        let samples = drives.first().map_or(0, Vec::len);
        let counted_from = (WARM_UP * samples as f64) as usize;
        Self { name: name.into(), sample_rate_hz, role, drives, readings, counted_from, counted_to: samples, periodic: false, noise: None }
    }

    /// The mean of all periods but the first, and the noise that their scatter shows.
    ///
    /// # Errors
    /// Fewer than two whole periods.
    pub fn averaged(self, period: usize) -> Result<Self> {
        let samples = self.drives.first().map_or(0, Vec::len);
        if period == 0 || samples < 2 * period {
            return Err(Error::new(
                &self.name,
                format!("{samples} samples hold {:.1} periods of {period}; expected two or more", samples as f64 / period.max(1) as f64),
            ));
        }
        // In the first period the stage still forgets what was before the record.
        let from = samples % period + period;
        let periods = samples / period - 1;
        let mean = |signal: &Vec<f64>| -> Vec<f64> {
            (0..period).map(|k| (0..periods).map(|p| signal[from + p * period + k]).sum::<f64>() / periods as f64).collect()
        };
        let scatter = |signal: &Vec<f64>, mean: &[f64]| -> f64 {
            let squares: f64 = signal[from..].iter().enumerate().map(|(k, y)| (y - mean[k % period]).powi(2)).sum();
            (squares / (((periods - 1) * period) as f64) / periods as f64).sqrt()
        };
        let readings: Vec<Vec<f64>> = self.readings.iter().map(mean).collect();
        let noise = (periods > 1).then(|| self.readings.iter().zip(&readings).map(|(signal, mean)| scatter(signal, mean)).collect());
        let twice = |signals: Vec<Vec<f64>>| signals.into_iter().map(|signal| signal.repeat(2)).collect::<Vec<_>>();
        let drives = twice(self.drives.iter().map(mean).collect());
        Ok(Self { drives, readings: twice(readings), counted_from: period, counted_to: 2 * period, periodic: true, noise, ..self })
    }

    /// Sampling period, s.
    #[must_use]
    pub fn dt_s(&self) -> f64 {
        1.0 / self.sample_rate_hz
    }
}

/// Records of one stage.
#[derive(Clone, Debug)]
pub struct AxesData {
    /// Name of the data set.
    pub name: String,
    /// Names of the drives, with their unit behind them where the file gives one.
    pub drives: Vec<String>,
    /// Names of the sensors.
    pub sensors: Vec<String>,
    /// Unit of the drives.
    pub drive_unit: String,
    /// Unit of the readings.
    pub sensor_unit: String,
    /// The records.
    pub records: Vec<AxesRecord>,
}

impl AxesData {
    /// Checks that records fit together; where none judges, the last part of each does.
    ///
    /// # Errors
    /// One message with the record and what was expected.
    pub fn new(name: &str, records: Vec<AxesRecord>) -> Result<Self> {
        let first = records.first().ok_or_else(|| Error::new(name, "has no record; expected at least one"))?;
        let (drives, sensors) = (first.drives.len(), first.readings.len());
        if drives == 0 || sensors == 0 {
            return Err(Error::new(name, format!("has {drives} drives and {sensors} sensors; expected at least one of each")));
        }
        for record in &records {
            let wrong = |what: String| Err(Error::new(format!("{name}, {}", record.name), what));
            if (record.drives.len(), record.readings.len()) != (drives, sensors) {
                return wrong(format!(
                    "{} drives and {} sensors; expected {drives} and {sensors} as in {}",
                    record.drives.len(),
                    record.readings.len(),
                    first.name
                ));
            }
            let samples = record.drives[0].len();
            if record.drives.iter().chain(&record.readings).any(|signal| signal.len() != samples) {
                return wrong("its signals have different lengths".into());
            }
            if !(record.sample_rate_hz > 0.0 && record.sample_rate_hz.is_finite()) {
                return wrong(format!("sample_rate_hz = {}; expected a number above zero", record.sample_rate_hz));
            }
            if record.drives.iter().chain(&record.readings).flatten().any(|value| !value.is_finite()) {
                return wrong("holds a value that is not finite".into());
            }
            if record.counted_to.saturating_sub(record.counted_from) < SAMPLES_MIN {
                return wrong(format!("{samples} samples; expected {SAMPLES_MIN} or more behind the warm-up"));
            }
        }
        let names = |what: &str, count: usize| (1..=count).map(|i| format!("{what} {i}")).collect();
        let mut data = Self {
            name: name.into(),
            drives: names("drive", drives),
            sensors: names("sensor", sensors),
            drive_unit: "V".into(),
            sensor_unit: "um".into(),
            records,
        };
        data.records.retain(|record| matches!(record.role, Role::Identify | Role::Validate));
        if !data.records.iter().any(|record| record.role == Role::Identify) {
            return Err(Error::new(name, "has no record with role = \"identify\"; expected one"));
        }
        if !data.records.iter().any(|record| record.role == Role::Validate) {
            let judging: Vec<AxesRecord> = data.records.iter_mut().map(AxesRecord::split).collect();
            data.records.extend(judging);
        }
        Ok(data)
    }

    /// The records that are fitted, or those that judge.
    pub fn of_role(&self, role: Role) -> impl Iterator<Item = (usize, &AxesRecord)> {
        self.records.iter().enumerate().filter(move |(_, record)| record.role == role)
    }
}

/// Fewest samples that count.
const SAMPLES_MIN: usize = 64;

impl AxesRecord {
    /// Leaves its last part to a record that judges.
    fn split(&mut self) -> Self {
        let until = self.counted_from + (FITTED * (self.counted_to - self.counted_from) as f64) as usize;
        let judging = Self { name: format!("{}, last part", self.name), role: Role::Validate, counted_from: until, ..self.clone() };
        self.counted_to = until;
        judging
    }
}

/// A column by its name or by its number, counted from 1.
#[derive(Clone, Debug, Deserialize)]
#[serde(untagged, expecting = "expected the name of a column, or its number from 1")]
enum ColumnName {
    Number(usize),
    Name(String),
}

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
    timing: Option<crate::dataset::timing::Timing>,
    record: Vec<Entry>,
}

/// Whether a manifest describes several drives or sensors: its columns are lists.
#[must_use]
pub fn has_several(text: &str) -> bool {
    let lists = |table: toml::Table| {
        let records = table.get("record")?.as_array()?.clone();
        let is_list = |record: &toml::Value| {
            let columns = record.get("columns")?.as_table()?;
            Some(["u", "y"].iter().any(|key| columns.get(*key).is_some_and(toml::Value::is_array)))
        };
        Some(records.iter().any(|record| is_list(record) == Some(true)))
    };
    toml::from_str::<toml::Table>(text).ok().and_then(lists).unwrap_or(false)
}

/// Reads a manifest; `read` gives the bytes of a file beside it.
///
/// # Errors
/// One message with file, line or column, and what was expected.
pub fn from_manifest(text: &str, place: &str, read: &dyn Fn(&str) -> Result<Vec<u8>>) -> Result<AxesData> {
    let manifest: Manifest =
        toml::from_str(text).map_err(|e| Error::new(format!("{place}: line {}", line_of(text, e.span())), e.message()))?;
    let hold_before = manifest.timing == Some(crate::dataset::timing::Timing::HoldBeforeSample);
    let mut tables: Vec<(String, Table)> = Vec::new();
    let mut records = Vec::new();
    let mut called: Option<(Vec<String>, Vec<String>)> = None;
    for entry in &manifest.record {
        for file in std::iter::once(&entry.file).chain(&entry.y_file) {
            if !tables.iter().any(|(name, _)| name == file) {
                tables.push((file.clone(), readers::read(file, &read(file)?, Hints::default())?));
            }
        }
        let table = |file: &str| &tables.iter().find(|(name, _)| name == file).expect("it was read above").1;
        let pick = |file: &str, names: &[ColumnName]| -> Result<Vec<Column>> {
            names.iter().map(|name| column(table(file), file, name).cloned()).collect()
        };
        let drives = pick(&entry.file, &entry.columns.u)?;
        let sensors = pick(entry.y_file.as_ref().unwrap_or(&entry.file), &entry.columns.y)?;
        let names = |columns: &[Column], what: &str| {
            let name = |(i, column): (usize, &Column)| {
                if column.name.is_empty() { format!("{what} {}", i + 1) } else { column.name.clone() }
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
        let record = AxesRecord::new(&name, entry.sample_rate_hz, entry.role.unwrap_or(Role::Identify), u, y);
        records.push(match entry.period_s {
            Some(period_s) => record.averaged((period_s * entry.sample_rate_hz).round() as usize)?,
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

fn column<'t>(table: &'t Table, file: &str, wanted: &ColumnName) -> Result<&'t Column> {
    let found = match wanted {
        ColumnName::Number(number) => table.columns.iter().find(|column| column.number == *number),
        ColumnName::Name(name) => table.columns.iter().find(|column| {
            let with_unit = column.unit.as_ref().map(|unit| format!("{}_{unit}", column.name));
            column.name.eq_ignore_ascii_case(name) || with_unit.is_some_and(|full| full.eq_ignore_ascii_case(name))
        }),
    };
    let wanted = match wanted {
        ColumnName::Number(number) => number.to_string(),
        ColumnName::Name(name) => format!("`{name}`"),
    };
    found.ok_or_else(|| Error::new(file, format!("has no column {wanted}; its columns are {}", table.names().join(", "))))
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
        assert!(!has_several("name = \"one\"\n[[record]]\nfile = \"a.csv\"\ncolumns = { u = \"ux\" }"));
        let data = from_manifest(MANIFEST, "dataset.toml", &|_| Ok(file(400))).unwrap();
        assert_eq!((data.drives.len(), data.sensors[1].as_str()), (2, "y"));
        assert_eq!(data.records[0].readings[1][3], 12.0);
        // Where nothing else judges, the last part does.
        assert_eq!(data.of_role(Role::Validate).count(), 1);
    }

    #[test]
    fn a_column_that_is_not_there_is_named_with_those_that_are() {
        let text = MANIFEST.replace("\"uy\"", "\"uz\"");
        let refused = from_manifest(&text, "dataset.toml", &|_| Ok(file(400))).unwrap_err().to_string();
        assert!(refused.contains("`uz`") && refused.contains("ux, uy, x, y"), "{refused}");
    }

    #[test]
    fn periods_are_averaged_and_their_scatter_is_the_noise() {
        let mut noise = hysteron_sim::noise::WhiteNoise::new(0.1, 3);
        let y: Vec<f64> = (0..6400).map(|k| (std::f64::consts::TAU * f64::from(k % 640) / 640.0).sin() + noise.next_um()).collect();
        let record = AxesRecord::new("r", 1000.0, Role::Identify, vec![y.clone()], vec![y]).averaged(640).unwrap();
        let shown = record.noise.unwrap()[0];
        // Nine periods are averaged.
        assert!((shown - 0.1 / 3.0).abs() < 0.003, "{shown}");
        assert_eq!((record.counted_from, record.counted_to, record.drives[0].len()), (640, 1280, 1280));
    }
}
