//! Data sets: records of drive and displacement with what is known about them.
//!
//! * [`manifest`]: the `dataset.toml` of a folder;
//! * [`table`]: reading one file of numbers (CSV, NPY, NPZ) into named columns;
//! * [`Dataset::load`]: both together, checked. Whatever is wrong is told with file, row and field.
//!
//! The only timing convention inside the program is `hold_after_sample`: `y[k]` is sampled at `t[k]`, `u[k]` acts from `t[k]` to
//! `t[k+1]`.

pub mod drive_variety;
pub mod manifest;
pub mod reading_grid;
pub mod table;

use crate::problem::{Problem, Result};
use hysteron_sim::chain::{Drive, InitialState};
use hysteron_sim::effect::Overview;
use manifest::{Manifest, RecordEntry};
use std::ops::Range;
use std::path::{Path, PathBuf};

/// What a record is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Deserialize, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Role {
    /// Parameters are estimated from it.
    Identify,
    /// Never fitted; judges what was fitted.
    Validate,
    /// Rest at constant drive: shows the noise.
    Noise,
}

impl Role {
    /// The name in files.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Role::Identify => "identify",
            Role::Validate => "validate",
            Role::Noise => "noise",
        }
    }
}

/// Steady-state periods inside a record, in samples.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Periods {
    /// First sample of the first period.
    pub from: usize,
    /// Samples in a period.
    pub length: usize,
    /// Whole periods.
    pub count: usize,
}

/// One record.
#[derive(Clone, Debug)]
pub struct Record {
    /// File name without extension.
    pub name: String,
    /// Where it was read from.
    pub path: PathBuf,
    /// Sampling rate.
    pub sample_rate_hz: f64,
    /// What it is for.
    pub role: Role,
    /// State at the first sample.
    pub initial_state: InitialState,
    /// Samples that count.
    pub window: Range<usize>,
    /// Steady-state periods, if it has any.
    pub periods: Option<Periods>,
    /// Name of the record with the same drive.
    pub repeat_of: Option<String>,
    /// A constant is estimated for this record.
    pub offset_is_fitted: bool,
    /// Drive, V, held from each sample to the next.
    pub drive_v: Vec<f64>,
    /// Measured displacement, um.
    pub displacement_um: Vec<f64>,
    /// Measured external force, N.
    pub force_n: Option<Vec<f64>>,
}

impl Record {
    /// Sampling period, s.
    #[must_use]
    pub fn dt_s(&self) -> f64 {
        1.0 / self.sample_rate_hz
    }

    /// Drive as the chain takes it.
    #[must_use]
    pub fn drive(&self) -> Drive<'_> {
        Drive { drive_v: &self.drive_v, force_n: self.force_n.as_deref(), dt_s: self.dt_s(), initial_state: self.initial_state }
    }

    /// Peak-to-peak displacement inside the window, um.
    #[must_use]
    pub fn range_um(&self) -> f64 {
        let inside = &self.displacement_um[self.window.clone()];
        let (low, high) = inside.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), y| (l.min(*y), h.max(*y)));
        high - low
    }
}

/// Records with the limits of the actuator they were taken on.
#[derive(Clone, Debug)]
pub struct Dataset {
    /// Name.
    pub name: String,
    /// Where it was read from.
    pub path: PathBuf,
    /// Limits of the drive, V.
    pub drive_min_v: f64,
    /// Limits of the drive, V.
    pub drive_max_v: f64,
    /// Bandwidth of the sensor, if its data sheet gives one.
    pub sensor_bandwidth_hz: Option<f64>,
    /// Resolution of the sensor, if its data sheet gives one.
    pub sensor_lsb_um: Option<f64>,
    /// The records.
    pub records: Vec<Record>,
    /// What a reader should know about how the data were read.
    pub notes: Vec<String>,
}

/// Fewest samples of a record that say anything.
const SAMPLES_MIN: usize = 32;

impl Dataset {
    /// Reads a folder with `dataset.toml`, a manifest, or one file of numbers.
    ///
    /// # Errors
    /// One message with file, row or field, and what was expected.
    pub fn load(path: &Path) -> Result<Self> {
        if path.is_dir() {
            let manifest = path.join("dataset.toml");
            if !manifest.is_file() {
                return Err(Problem::file(
                    path,
                    "is a folder without `dataset.toml`; expected a manifest there (README.md, \"Your own data\") or one CSV, NPY or NPZ file",
                ));
            }
            return Self::from_manifest(&manifest);
        }
        if !path.is_file() {
            return Err(Problem::file(path, "does not exist; expected a folder with `dataset.toml`, or one CSV, NPY or NPZ file"));
        }
        match path.extension().and_then(|e| e.to_str()) {
            Some("toml") => Self::from_manifest(path),
            _ => Self::from_single_file(path),
        }
    }

    fn from_manifest(path: &Path) -> Result<Self> {
        let manifest = Manifest::read(path)?;
        let folder = path.parent().unwrap_or_else(|| Path::new("."));
        let mut records = Vec::new();
        for (index, entry) in manifest.record.iter().enumerate() {
            let place = format!("{}: record {} ({})", path.display(), index + 1, entry.file);
            records.push(record_from_entry(&folder.join(&entry.file), entry, &place)?);
        }
        let names: Vec<String> = records.iter().map(|r: &Record| r.name.clone()).collect();
        for (i, record) in records.iter().enumerate() {
            let place = format!("{}: record {} ({})", path.display(), i + 1, record.name);
            if names[..i].contains(&record.name) {
                return Err(Problem::new(place, "two records of this name; expected different file names"));
            }
            if let Some(original) = &record.repeat_of {
                let Some(other) = records.iter().find(|r| r.name == *original) else {
                    return Err(Problem::new(
                        place,
                        format!("repeat_of = \"{original}\" names no record{}", crate::problem::nearest(original, &names)),
                    ));
                };
                if other.drive_v.len() != record.drive_v.len() || other.sample_rate_hz != record.sample_rate_hz {
                    return Err(Problem::new(place, format!("repeat_of = \"{original}\" has another length or sampling rate")));
                }
            }
        }
        let dataset = Self {
            name: manifest.name.clone(),
            path: path.to_path_buf(),
            drive_min_v: manifest.drive_min_v,
            drive_max_v: manifest.drive_max_v,
            sensor_bandwidth_hz: manifest.sensor_bandwidth_hz,
            sensor_lsb_um: manifest.sensor_lsb_um,
            records,
            notes: Vec::new(),
        };
        dataset.check()
    }

    /// One file without a manifest: the first half is identified from, the second judges.
    fn from_single_file(path: &Path) -> Result<Self> {
        let table = table::Table::read(path)?;
        let columns = table.assign(&manifest::Columns::default())?;
        let sample_rate_hz = table::sample_rate_hz(path, &columns.t_s)?;
        let name = stem(path);
        let samples = columns.u_v.len();
        if samples < 2 * SAMPLES_MIN {
            return Err(Problem::file(path, format!("has {samples} samples; expected at least {}", 2 * SAMPLES_MIN)));
        }
        let (low, high) = columns.u_v.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), u| (l.min(*u), h.max(*u)));
        let half = samples / 2;
        let rests = columns.u_v.iter().take(8).all(|u| *u == columns.u_v[0]) && columns.u_v[0] <= low;
        let make = |suffix: &str, role, window: Range<usize>, to: usize| Record {
            name: format!("{name}_{suffix}"),
            path: path.to_path_buf(),
            sample_rate_hz,
            role,
            initial_state: InitialState::Unknown,
            window,
            periods: None,
            repeat_of: None,
            offset_is_fitted: true,
            drive_v: columns.u_v[..to].to_vec(),
            displacement_um: columns.y_um[..to].to_vec(),
            force_n: columns.force_n.as_ref().map(|f| f[..to].to_vec()),
        };
        let mut notes = vec![
            format!("one file: identified from its first {half} samples, judged on the rest; a dataset.toml can say it better"),
            format!("limits of the drive taken from the file: {low} to {high} V"),
        ];
        if !rests {
            notes.push("the record does not start at rest at the lowest drive: initial states are estimated".into());
        }
        Self {
            name: name.clone(),
            path: path.to_path_buf(),
            drive_min_v: low,
            drive_max_v: high,
            sensor_bandwidth_hz: None,
            sensor_lsb_um: None,
            records: vec![make("first_half", Role::Identify, 0..half, half), make("second_half", Role::Validate, half..samples, samples)],
            notes,
        }
        .check()
    }

    fn check(mut self) -> Result<Self> {
        let doubts: Vec<String> = self.records.iter().filter(|r| r.role != Role::Noise).filter_map(doubt).collect();
        self.notes.extend(doubts);
        if !self.records.iter().any(|r| r.role == Role::Identify) {
            self.notes.push("no record has role = \"identify\": those to validate are fitted, and nothing judges".into());
        }
        let place = self.path.display();
        if self.drive_min_v.partial_cmp(&self.drive_max_v) != Some(std::cmp::Ordering::Less) {
            return Err(Problem::new(
                place,
                format!(
                    "drive_max_v = {} is not above drive_min_v = {}: the drive never changes, or the limits are exchanged",
                    self.drive_max_v, self.drive_min_v
                ),
            ));
        }
        if !self.records.iter().any(|r| r.role != Role::Noise) {
            return Err(Problem::new(place, "no record has role = \"identify\" or \"validate\"; expected at least one"));
        }
        let tolerance = 1e-6 + 0.05 * (self.drive_max_v - self.drive_min_v);
        for record in &self.records {
            let place = record.path.display();
            if record.window.len() < SAMPLES_MIN {
                return Err(Problem::new(
                    place,
                    format!("has {} samples inside its window; expected at least {SAMPLES_MIN}", record.window.len()),
                ));
            }
            for (row, u) in record.drive_v.iter().enumerate() {
                if *u < self.drive_min_v - tolerance || *u > self.drive_max_v + tolerance {
                    return Err(Problem::new(
                        place,
                        format!(
                            "sample {}: drive {u} V is outside drive_min_v = {} .. drive_max_v = {}; wrong unit or limits?",
                            row + 1,
                            self.drive_min_v,
                            self.drive_max_v
                        ),
                    ));
                }
            }
            let first = record.drive_v[record.window.start.saturating_sub(1)];
            if record.role != Role::Noise && record.drive_v[record.window.clone()].iter().all(|u| *u == first) {
                return Err(Problem::new(
                    place,
                    format!(
                        "the drive is constant ({first} V) inside the window; role = \"{}\" expects one that moves (role = \"noise\" is for rest)",
                        record.role.name()
                    ),
                ));
            }
            let y0 = record.displacement_um[record.window.start];
            if record.displacement_um[record.window.clone()].iter().all(|y| *y == y0) {
                return Err(Problem::new(
                    place,
                    format!("the displacement is constant ({y0} um); is the sensor connected, the column right?"),
                ));
            }
        }
        Ok(self)
    }

    /// Indices of the records with a role.
    #[must_use]
    pub fn with_role(&self, role: Role) -> Vec<usize> {
        (0..self.records.len()).filter(|&i| self.records[i].role == role).collect()
    }

    /// What is known before anything is fitted.
    #[must_use]
    pub fn overview(&self) -> Overview {
        let driven = || self.records.iter().filter(|r| r.role != Role::Noise);
        let fold = |f: &dyn Fn(&Record) -> f64| driven().map(f).fold(0.0_f64, f64::max);
        let slope = |r: &Record| r.drive_v.windows(2).map(|w| (w[1] - w[0]).abs()).fold(0.0, f64::max) * r.sample_rate_hz;
        let range_um = fold(&Record::range_um);
        Overview {
            drive_min_v: self.drive_min_v,
            drive_max_v: self.drive_max_v,
            drive_peak_v: driven().flat_map(|r| r.drive_v.iter().copied()).fold(self.drive_min_v, f64::max),
            sample_rate_max_hz: fold(&|r| r.sample_rate_hz),
            sample_rate_min_hz: driven().map(|r| r.sample_rate_hz).fold(f64::INFINITY, f64::min),
            duration_s: fold(&|r| r.drive_v.len() as f64 / r.sample_rate_hz),
            range_um,
            slope_max_v_s: fold(&slope),
            has_force: driven().any(|r| r.force_n.is_some()),
            gain_um_v: self.straight_line_gain(),
            sensor_bandwidth_hz: self.sensor_bandwidth_hz,
        }
    }

    fn straight_line_gain(&self) -> f64 {
        let (mut uu, mut uy) = (0.0, 0.0);
        let to_fit = if self.with_role(Role::Identify).is_empty() { Role::Validate } else { Role::Identify };
        for record in self.records.iter().filter(|r| r.role == to_fit) {
            // y[k] answers to u[k - 1].
            let rows: Vec<usize> = record.window.clone().filter(|k| *k > 0).collect();
            let n = rows.len().max(1) as f64;
            let mean_u = rows.iter().map(|&k| record.drive_v[k - 1]).sum::<f64>() / n;
            let mean_y = rows.iter().map(|&k| record.displacement_um[k]).sum::<f64>() / n;
            for &k in &rows {
                let u = record.drive_v[k - 1] - mean_u;
                uu += u * u;
                uy += u * (record.displacement_um[k] - mean_y);
            }
        }
        if uu > 0.0 { uy / uu } else { 0.0 }
    }
}

/// Span of a displacement in um beyond which a unit is likely to be missing.
const LIKELY_SPAN_MAX_UM: f64 = 2000.0;
/// A reading that leaves this share of the squared error against the drive of its own instant has not waited for the drive to act.
const LEADING_SHARE: f64 = 0.3;

/// What looks as if a record were not what its file says.
fn doubt(record: &Record) -> Option<String> {
    if record.range_um() > LIKELY_SPAN_MAX_UM {
        return Some(format!("{}: the displacement spans {:.0} um; is its column in another unit?", record.name, record.range_um()));
    }
    let from = record.window.start.max(1);
    let left_by = |delay: usize| {
        let pairs = (from..record.window.end).map(|k| (record.drive_v[k - delay], record.displacement_um[k]));
        left_by_straight_line(&pairs.collect::<Vec<_>>())
    };
    (left_by(0) < LEADING_SHARE * left_by(1)).then(|| {
        format!(
            "{}: y[k] follows u[k] much better than u[k-1], but a drive acts only after the sample at its instant; was y read after u was \
             written? Then move u down by one sample",
            record.name
        )
    })
}

/// Sum of squares about the regression line.
fn left_by_straight_line(pairs: &[(f64, f64)]) -> f64 {
    let n = pairs.len().max(1) as f64;
    let (mean_x, mean_y) = pairs.iter().fold((0.0, 0.0), |(x, y), p| (x + p.0 / n, y + p.1 / n));
    let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
    for (x, y) in pairs.iter().map(|p| (p.0 - mean_x, p.1 - mean_y)) {
        xx += x * x;
        xy += x * y;
        yy += y * y;
    }
    if xx > 0.0 { yy - xy * xy / xx } else { yy }
}

fn stem(path: &Path) -> String {
    path.file_stem().map_or_else(|| "record".into(), |s| s.to_string_lossy().into_owned())
}

fn record_from_entry(path: &Path, entry: &RecordEntry, place: &str) -> Result<Record> {
    let table = table::Table::read(path)?;
    let columns = table.assign(&entry.columns)?;
    let fs = entry.sample_rate_hz;
    if !(fs.is_finite() && fs > 0.0) {
        return Err(Problem::new(place, format!("sample_rate_hz = {fs}; expected a positive number")));
    }
    let t0 = match &columns.t_s {
        Some(t_s) => {
            table::check_time(path, t_s, fs, table.first_data_row)?;
            t_s.first().copied().unwrap_or(0.0)
        }
        None => 0.0,
    };
    let samples = columns.u_v.len();
    if samples < SAMPLES_MIN {
        return Err(Problem::file(path, format!("has {samples} samples; expected at least {SAMPLES_MIN}")));
    }
    let index = |t: f64| (((t - t0) * fs).round().max(0.0) as usize).min(samples);
    let from = entry.from_s.map_or(0, index);
    let to = entry.to_s.map_or(samples, index);
    if from >= to {
        return Err(Problem::new(
            place,
            format!(
                "from_s = {} and to_s = {} leave no sample of {:.3} s",
                entry.from_s.map_or("(start)".into(), |s| s.to_string()),
                entry.to_s.map_or("(end)".into(), |s| s.to_string()),
                samples as f64 / fs
            ),
        ));
    }
    let periods = match (entry.period_s, entry.periodic_from_s) {
        (Some(period_s), from_s) => {
            let length = (period_s * fs).round();
            if length < 2.0 || (period_s * fs - length).abs() > 1e-3 * length.max(1.0) {
                return Err(Problem::new(place, format!("period_s = {period_s} is not a whole number of samples at {fs} Hz")));
            }
            let start = from_s.map_or(from, index);
            let length = length as usize;
            if samples.saturating_sub(start) < length {
                let rest_s = samples.saturating_sub(start) as f64 / fs;
                return Err(Problem::new(
                    place,
                    format!("period_s = {period_s}, but only {rest_s:.3} s are left from where periods begin"),
                ));
            }
            Some(Periods { from: start, length, count: samples.saturating_sub(start) / length })
        }
        (None, Some(_)) => return Err(Problem::new(place, "periodic_from_s without period_s; expected both")),
        (None, None) => None,
    };
    let initial_state = entry.initial_state.into();
    Ok(Record {
        name: stem(path),
        path: path.to_path_buf(),
        sample_rate_hz: fs,
        role: entry.role,
        initial_state,
        window: from..to,
        periods,
        repeat_of: entry.repeat_of.as_ref().map(|f| stem(Path::new(f))),
        offset_is_fitted: match entry.offset {
            Some(manifest::Offset::Fit) => true,
            Some(manifest::Offset::Zero) => false,
            None => initial_state != InitialState::Virgin,
        },
        drive_v: columns.u_v,
        displacement_um: columns.y_um,
        force_n: columns.force_n,
    })
}
