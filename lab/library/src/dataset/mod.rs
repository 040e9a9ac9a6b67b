//! Data sets: records of drive and displacement with what is known about them.
//!
//! * [`Record`] holds the signals of one recording, [`Dataset`] the records of one actuator; [`Dataset::new`]
//!   checks them, and reports whatever is wrong with record and sample;
//! * [`readers`]: the bytes of one file of numbers as a [`table`] of named columns; [`recognise`]: which
//!   column is what, by names, [`units`] and [`behaviour`]; [`time_axis`]: even samples from stamps that need
//!   not be even; [`timing`]: when a drive acts; [`manifest`]: the `dataset.toml` of a folder;
//!   [`one_recording`]: which part of a single file is fitted and which judges, by `motion_sections`;
//!   [`reading`]: all of it together (feature `readers`). None of them opens a file: whoever calls hands in
//!   the bytes, or [`folder`] does (feature `files`).
//! * [`drive_variety`]: what the drives can show at all; [`reading_grid`]: the steps that a converter leaves
//!   in the readings. [`issue`]: what is wrong with records.
//!
//! The only timing convention inside the program is `hold_after_sample`: `y[k]` is sampled at `t[k]`, `u[k]`
//! acts from `t[k]` to `t[k+1]`.

#[cfg(feature = "readers")]
pub mod behaviour;
pub(crate) mod checks;
pub mod circumstances;
pub mod column_rules;
pub mod drive_variety;
#[cfg(feature = "files")]
pub mod folder;
pub mod holds;
pub mod issue;
pub mod issue_words;
#[cfg(feature = "readers")]
pub mod manifest;
#[cfg(feature = "readers")]
mod motion_sections;
#[cfg(feature = "readers")]
pub mod one_recording;
#[cfg(feature = "readers")]
pub mod readers;
#[cfg(feature = "readers")]
pub mod reading;
pub mod reading_grid;
#[cfg(feature = "readers")]
pub mod recognise;
mod record;
#[cfg(feature = "readers")]
pub mod table;
#[cfg(feature = "readers")]
pub mod time_axis;
pub mod timing;
pub mod units;

pub use record::{Periods, PlayedDrive, Record, Role};

use crate::error::{Error, Result, nearest};
use hysteron_sim::chain::InitialState;
use hysteron_sim::effect::Overview;
use issue::Issue;
use timing::Timing;
use units::SignalUnits;

/// Records with the limits of the actuator they were taken on.
#[derive(Clone, Debug)]
pub struct Dataset {
    /// Name.
    pub name: String,
    /// Where it came from, for messages.
    pub source: String,
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
    /// Units of drive and reading, where they are not V and um.
    pub units: SignalUnits,
    /// Neither anybody nor the records themselves say whether the drive of a row acts before its reading or
    /// after it: the latter is assumed, and a delay counts from there.
    pub timing_is_assumed: bool,
    /// When the drive of a row acts in the files.
    pub timing: Timing,
    /// Nobody specified what the drive does between samples: a held one is assumed.
    pub intersample_is_assumed: bool,
    /// What a reader should know about how the data were read.
    pub notes: Vec<String>,
    /// What is wrong with the records; what could be corrected is.
    pub issues: Vec<Issue>,
}

/// Lowest sampling rate of a record of something that moves: below, the unit of its time was another.
const RATE_MIN_HZ: f64 = 1.0;
/// Fewest samples of a record that say anything.
pub(crate) const SAMPLES_MIN: usize = 32;

impl Dataset {
    /// Records of one actuator that may be driven from `drive_min_v` to `drive_max_v`.
    ///
    /// # Errors
    /// One message with record and sample, and what was expected: signals of different lengths, numbers that
    /// are not finite, windows outside the record, drives beyond the limits, names given twice, nothing that
    /// moves.
    ///
    /// ```
    /// use hysteron::{Dataset, Record, Role};
    ///
    /// let drive_v: Vec<f64> = (0..2000).map(|k| 5.0 - 5.0 * (0.1 * f64::from(k)).cos()).collect();
    /// let reading_um: Vec<f64> = drive_v.iter().map(|u| 0.1 * u).collect();
    /// let record = |name: &str, reading_um| Record::new(name, 1000.0, drive_v.clone(), reading_um);
    /// let held_out = record("held out", reading_um.clone()).with_role(Role::Validate);
    /// let dataset = Dataset::new("my stage", 0.0, 10.0, vec![record("fitted", reading_um), held_out])?;
    /// // What is wrong with a recording is one message with record and sample.
    /// let mut torn = vec![0.5; 2000];
    /// torn[7] = f64::NAN;
    /// let message = Dataset::new("torn", 0.0, 10.0, vec![record("torn", torn)]).unwrap_err().to_string();
    /// assert!(message.contains("torn"), "{message}");
    /// # Ok::<(), hysteron::Error>(())
    /// ```
    pub fn new(
        name: impl Into<String>,
        drive_min_v: f64,
        drive_max_v: f64,
        records: Vec<Record>,
    ) -> Result<Self> {
        Self::unchecked(name, drive_min_v, drive_max_v, records).checked()
    }

    /// The same before anything is checked.
    pub(crate) fn unchecked(
        name: impl Into<String>,
        drive_min_v: f64,
        drive_max_v: f64,
        records: Vec<Record>,
    ) -> Self {
        let name = name.into();
        Self {
            source: name.clone(),
            name,
            drive_min_v,
            drive_max_v,
            sensor_bandwidth_hz: None,
            sensor_lsb_um: None,
            records,
            timing_is_assumed: false,
            timing: Timing::default(),
            intersample_is_assumed: false,
            units: SignalUnits::default(),
            notes: Vec::new(),
            issues: Vec::new(),
        }
    }

    /// Notes and issues, in sentences.
    #[must_use]
    pub fn remarks(&self) -> Vec<String> {
        self.notes
            .iter()
            .cloned()
            .chain(self.issues.iter().map(issue_words::sentence))
            .collect()
    }

    fn check_names(&self) -> Result<()> {
        for (i, record) in self.records.iter().enumerate() {
            if self.records[..i]
                .iter()
                .any(|earlier| earlier.name == record.name)
            {
                return Err(Error::new(
                    &self.source,
                    format!(
                        "two records are called `{}`; expected different names",
                        record.name
                    ),
                ));
            }
        }
        Ok(())
    }

    fn check_repeats(&self) -> Result<()> {
        let names: Vec<String> = self.records.iter().map(|r| r.name.clone()).collect();
        for record in &self.records {
            let Some(original) = &record.repeat_of else {
                continue;
            };
            let Some(other) = self.records.iter().find(|r| r.name == *original) else {
                return Err(Error::new(
                    &record.source,
                    format!(
                        "repeat_of = \"{original}\" names no record{}",
                        nearest(original, &names)
                    ),
                ));
            };
            if other.drive_v.len() != record.drive_v.len()
                || other.sample_rate_hz != record.sample_rate_hz
            {
                return Err(Error::new(
                    &record.source,
                    format!("repeat_of = \"{original}\" has another length or sampling rate"),
                ));
            }
        }
        Ok(())
    }

    /// Checks what only the whole can show, and notes what is doubtful.
    fn checked(mut self) -> Result<Self> {
        // Zero has no sign: a limit of -0.0 would be printed as "-0 V".
        (self.drive_min_v, self.drive_max_v) = (self.drive_min_v + 0.0, self.drive_max_v + 0.0);
        self.check_names()?;
        for record in &self.records {
            check_signals(record)?;
        }
        self.check_repeats()?;
        let place = &self.source;
        let sheet = [
            ("sensor_bandwidth_hz", self.sensor_bandwidth_hz),
            ("sensor_lsb_um", self.sensor_lsb_um),
        ];
        if let Some((key, value)) = sheet
            .iter()
            .find_map(|(key, v)| v.filter(|v| !(v.is_finite() && *v > 0.0)).map(|v| (key, v)))
        {
            return Err(Error::new(
                place,
                format!("{key} = {value}; expected a positive number"),
            ));
        }
        if let Some(limit) = [self.drive_min_v, self.drive_max_v]
            .into_iter()
            .find(|v| !v.is_finite())
        {
            return Err(Error::new(
                place,
                format!("a limit of the drive is {limit} V; expected a finite number"),
            ));
        }
        if self.drive_min_v.partial_cmp(&self.drive_max_v) != Some(std::cmp::Ordering::Less) {
            return Err(Error::new(
                place,
                format!(
                    "drive_max_v = {} is not above drive_min_v = {}: the drive never changes, or the limits are exchanged",
                    self.drive_max_v, self.drive_min_v
                ),
            ));
        }
        self = checks::check_made(self)?;
        let place = &self.source;
        if !self.records.iter().any(|r| r.role != Role::Noise) {
            return Err(Error::new(
                place,
                "no record has role = \"identify\" or \"validate\"; expected at least one",
            ));
        }
        let tolerance = 1e-6 + 0.05 * (self.drive_max_v - self.drive_min_v);
        for record in &self.records {
            let place = &record.source;
            if record.window.len() < SAMPLES_MIN {
                return Err(Error::new(
                    place,
                    format!(
                        "has {} samples inside its window; expected at least {SAMPLES_MIN}",
                        record.window.len()
                    ),
                ));
            }
            for (row, u) in record.drive_v.iter().enumerate() {
                if *u < self.drive_min_v - tolerance || *u > self.drive_max_v + tolerance {
                    return Err(Error::new(
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
            let first = match (record.window.start, record.initial_state) {
                (0, InitialState::Virgin) => self.drive_min_v,
                (start, _) => record.drive_v[start.saturating_sub(1)],
            };
            if record.role != Role::Noise
                && record.drive_v[record.window.clone()]
                    .iter()
                    .all(|u| *u == first)
            {
                return Err(Error::new(
                    place,
                    format!(
                        "the drive is constant ({first} V) inside the window; role = \"{}\" expects one that moves (role = \"noise\" is for rest)",
                        record.role.name()
                    ),
                ));
            }
            let y0 = record.displacement_um[record.window.start];
            if record.role != Role::Noise
                && record.displacement_um[record.window.clone()]
                    .iter()
                    .all(|y| *y == y0)
            {
                return Err(Error::new(
                    place,
                    format!(
                        "the displacement is constant ({y0} um) in record {}; is the sensor connected, the column right?",
                        record.name
                    ),
                ));
            }
        }
        Ok(self)
    }

    /// Indices of the records with a role.
    #[must_use]
    pub fn with_role(&self, role: Role) -> Vec<usize> {
        (0..self.records.len())
            .filter(|&i| self.records[i].role == role)
            .collect()
    }

    /// What is known before anything is fitted.
    #[must_use]
    pub fn overview(&self) -> Overview {
        let identify = self.with_role(Role::Identify);
        let fitted = if identify.is_empty() {
            self.with_role(Role::Validate)
        } else {
            identify
        };
        let driven = || {
            self.records
                .iter()
                .filter(|r| r.role != Role::Noise && r.role != Role::Test)
        };
        let fold = |f: &dyn Fn(&Record) -> f64| driven().map(f).fold(0.0_f64, f64::max);
        let slope = |r: &Record| {
            r.drive_v
                .windows(2)
                .map(|w| (w[1] - w[0]).abs())
                .fold(0.0, f64::max)
                * r.sample_rate_hz
        };
        let range_um = fold(&Record::range_um);
        Overview {
            drive_min_v: self.drive_min_v,
            drive_max_v: self.drive_max_v,
            drive_peak_v: driven()
                .flat_map(|r| r.drive_v.iter().copied())
                .fold(self.drive_min_v, f64::max),
            sample_rate_max_hz: fold(&|r| r.sample_rate_hz),
            sample_rate_min_hz: driven()
                .map(|r| r.sample_rate_hz)
                .fold(f64::INFINITY, f64::min),
            duration_s: fold(&|r| r.drive_v.len() as f64 / r.sample_rate_hz),
            range_um,
            slope_max_v_s: fold(&slope),
            has_force: driven().any(|r| r.force_n.is_some()),
            gain_um_v: self.straight_line_gain(),
            sensor_bandwidth_hz: self.sensor_bandwidth_hz,
            // Held-out records may move at other speeds; without any, one speed says nothing about the
            // others.
            several_speeds: !self.with_role(Role::Validate).is_empty()
                && !self.with_role(Role::Identify).is_empty()
                || !drive_variety::DriveVariety::of(self, &fitted).one_speed(),
        }
    }

    /// The same to the last digit whatever the order of the records: a search takes another way where a
    /// single one differs.
    pub(crate) fn straight_line_gain(&self) -> f64 {
        let to_fit = if self.with_role(Role::Identify).is_empty() {
            Role::Validate
        } else {
            Role::Identify
        };
        let mut fitted: Vec<&Record> = self.records.iter().filter(|r| r.role == to_fit).collect();
        fitted.sort_by(|a, b| a.name.cmp(&b.name));
        let (mut uu, mut uy) = (0.0, 0.0);
        for record in fitted {
            // y[k] answers to u[k - 1].
            let rows: Vec<usize> = record.counted().filter(|k| *k > 0).collect();
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

/// What every record must be by itself.
fn check_signals(record: &Record) -> Result<()> {
    let wrong = |message: String| Err(Error::new(&record.source, message));
    let samples = record.drive_v.len();
    if !(record.sample_rate_hz.is_finite() && record.sample_rate_hz > 0.0) {
        return wrong(format!(
            "sample_rate_hz = {}; expected a positive number",
            record.sample_rate_hz
        ));
    }
    let force = record.force_n.as_deref();
    let signals = [
        ("drive", Some(&record.drive_v[..])),
        ("displacement", Some(&record.displacement_um[..])),
        ("force", force),
    ];
    let auxiliary = record
        .auxiliary
        .iter()
        .map(|signal| (signal.name.as_str(), Some(&signal.values[..])));
    for (what, signal) in signals.into_iter().chain(auxiliary) {
        let Some(signal) = signal else { continue };
        if signal.len() != samples {
            return wrong(format!(
                "the drive has {samples} samples, the {what} {}; expected as many",
                signal.len()
            ));
        }
        if let Some(at) = signal.iter().position(|v| !v.is_finite()) {
            return wrong(format!(
                "sample {}: {what} {}; expected a finite number",
                at + 1,
                signal[at]
            ));
        }
    }
    if record.sample_rate_hz < RATE_MIN_HZ {
        return wrong(format!(
            "samples come {} s apart; expected at least one a second: is time in another unit (--units t=ms, t=us)?",
            record.dt_s()
        ));
    }
    if samples < SAMPLES_MIN {
        return wrong(format!(
            "has {samples} samples; expected at least {SAMPLES_MIN}"
        ));
    }
    if record.window.start >= record.window.end || record.window.end > samples {
        return wrong(format!(
            "the window {:?} is not inside the {samples} samples",
            record.window
        ));
    }
    if let Some(p) = record
        .periods
        .filter(|p| p.length < 2 || p.count == 0 || p.from + p.length * p.count > samples)
    {
        return wrong(format!(
            "{} periods of {} samples from sample {} do not fit into {samples}",
            p.count,
            p.length,
            p.from + 1
        ));
    }
    Ok(())
}
