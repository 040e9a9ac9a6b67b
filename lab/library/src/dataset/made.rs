//! A data set is made: what is wrong with its records is an error, and what is doubtful is noted.

use super::checks::check_made;
use super::data_set::{Dataset, SAMPLES_MIN};
use super::record::{Record, Role};
use crate::error::{Error, Result, nearest};
use hysteron_sim::chain::InitialState;

/// Lowest sampling rate of a record of something that moves: below, the unit of its time was another.
const RATE_MIN_HZ: f64 = 1.0;
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
    pub(super) fn checked(mut self) -> Result<Self> {
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
        self = check_made(self)?;
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
            // A hold behind a move shows creep: what moves before the window counts.
            let first = match record.initial_state {
                InitialState::Virgin => self.drive_min_v,
                _ => record.drive_v[0],
            };
            if record.role != Role::Noise
                && record.drive_v[..record.window.end]
                    .iter()
                    .all(|u| *u == first)
            {
                return Err(Error::new(
                    place,
                    format!(
                        "the drive is constant ({first} V) up to the window's end; role = \"{}\" expects one that moves (role = \"noise\" is for rest)",
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
