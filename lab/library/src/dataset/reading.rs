//! Data sets from the bytes of files: a manifest with the files that it names, or one file of numbers alone.

use super::behaviour::rows_between_news;
use super::circumstances::SEARCHED_SAMPLES;
use super::column_rules::ColumnRules;
use super::data_set::{Dataset, SAMPLES_MIN};
use super::even_signals::Even;
use super::issue::Issue;
use super::manifest::{Manifest, Offset, RecordEntry};
use super::one_recording::{self, Parts};
use super::one_timing::bring_to_one_timing;
use super::readers::{self, Hints};
use super::recognise;
use super::record::{Periods, PlayedDrive, Record, Role};
use super::table::Table;
use super::time_axis::{StampContext, TimeAxis};
use super::timing::Timing;
use super::units::SignalUnits;
use crate::error::{Error, Result};
use crate::statistics::extremes;
use hysteron_sim::chain::InitialState;
use hysteron_sim::intersample::Intersample;
use std::collections::BTreeMap;
use std::ops::Range;

/// Where the files that a manifest names come from: a folder, an archive, what somebody dropped on a page.
pub trait Files {
    /// The bytes of a file.
    ///
    /// # Errors
    /// When there is no such file, or it cannot be read.
    fn read(&self, name: &str) -> Result<Vec<u8>>;

    /// How the file is called in messages.
    fn place(&self, name: &str) -> String {
        name.to_owned()
    }
}

/// Files in memory, by name.
impl Files for BTreeMap<String, Vec<u8>> {
    fn read(&self, name: &str) -> Result<Vec<u8>> {
        self.get(name)
            .cloned()
            .ok_or_else(|| Error::new(name, "does not exist; expected the file of a record"))
    }
}

/// What a person says about the files, before what a manifest or they themselves say.
#[derive(Clone, Debug, Default)]
pub struct Instructions {
    /// Columns, units and factors.
    pub wanted: ColumnRules,
    /// Sampling rate.
    pub sample_rate_hz: Option<f64>,
    /// Sampling rate of files that give none themselves.
    pub rate_otherwise_hz: Option<f64>,
    /// Rows of text to leave out at the top.
    pub skip_rows: Option<usize>,
    /// When the drive of a row acts.
    pub timing: Option<Timing>,
    /// What the drive does between samples.
    pub intersample: Option<Intersample>,
}

impl Instructions {
    /// Values of `self`, and where it has no value those of the other.
    #[must_use]
    pub fn before(&self, wanted: ColumnRules) -> ColumnRules {
        let own = self.wanted.clone();
        ColumnRules {
            columns: own.columns.or(wanted.columns),
            unit: own.unit.or(wanted.unit),
            scale: own.scale.or(wanted.scale),
            auxiliary: wanted.auxiliary.into_iter().chain(own.auxiliary).collect(),
        }
    }
}

/// Reads a data set from the text of its manifest; `place` is what the manifest is called in messages.
///
/// # Errors
/// One message with file, row or field, and what was expected.
pub fn from_manifest(text: &str, place: &str, files: &dyn Files) -> Result<Dataset> {
    from_manifest_as(text, place, files, &Instructions::default())
}

/// Reads as [`from_manifest`] does, with what a person says about the files.
///
/// # Errors
/// As [`from_manifest`].
pub fn from_manifest_as(
    text: &str,
    place: &str,
    files: &dyn Files,
    instructions: &Instructions,
) -> Result<Dataset> {
    let manifest = Manifest::parse(text, place)?;
    let mut records: Vec<Record> = Vec::new();
    let mut notes: Vec<String> = Vec::new();
    let mut units: Option<(String, SignalUnits)> = None;
    // One file may serve as several records: what it says is then said once.
    let mut tables: BTreeMap<(&str, usize), Table> = BTreeMap::new();
    for (index, entry) in manifest.record.iter().enumerate() {
        let source = files.place(&entry.file);
        let skip_rows = instructions.skip_rows.unwrap_or(entry.skip_rows);
        let table = match tables.entry((&entry.file, skip_rows)) {
            std::collections::btree_map::Entry::Occupied(found) => found.into_mut(),
            std::collections::btree_map::Entry::Vacant(place) => place.insert(readers::read(
                &source,
                &files.read(&entry.file)?,
                Hints { skip_rows },
            )?),
        };
        let (mut record, said, of_record) = record_of(
            table,
            entry,
            instructions,
            &format!("{place}: record {} ({})", index + 1, entry.file),
        )?;
        record.name = match &entry.name {
            Some(name) => name.clone(),
            None => name_beside(&stem(&entry.file), &records),
        };
        for note in said.iter().map(|note| format!("{}: {note}", entry.file)) {
            if !notes.contains(&note) {
                notes.push(note);
            }
        }
        if let Some((first, units)) = &units
            && *units != of_record
        {
            return Err(Error::new(
                place,
                format!(
                    "{first} is in {} and {}, {} in {} and {}; expected records of one kind",
                    units.drive, units.reading, record.name, of_record.drive, of_record.reading
                ),
            ));
        }
        units.get_or_insert((record.name.clone(), of_record));
        records.push(record);
    }
    let units = units.map(|(_, units)| units).unwrap_or_default();
    let timing = instructions.timing.or(manifest.timing);
    let intersample = instructions
        .intersample
        .or(manifest.intersample.map(Into::into));
    let shown = timed(&mut records, timing, intersample);
    Dataset {
        timing: shown.timing,
        timing_is_assumed: shown.is_assumed,
        intersample_is_assumed: intersample.is_none(),
        units,
        name: manifest.name.clone(),
        source: place.to_owned(),
        drive_min_v: manifest.drive_min_v,
        drive_max_v: manifest.drive_max_v,
        sensor_bandwidth_hz: manifest.sensor_bandwidth_hz,
        sensor_lsb_um: manifest.sensor_lsb_um,
        records,
        notes,
        issues: shown.issue.into_iter().collect(),
    }
    .checked()
}

/// The timing of records, and how it is known.
struct Timed {
    timing: Timing,
    /// The records show it themselves.
    issue: Option<Issue>,
    is_assumed: bool,
}

/// Gives the records the timing and the way between samples that were specified. A drive that runs on acts
/// from no row to another.
fn timed(
    records: &mut [Record],
    timing: Option<Timing>,
    intersample: Option<Intersample>,
) -> Timed {
    records
        .iter_mut()
        .for_each(|record| record.intersample = intersample.unwrap_or_default());
    if intersample.is_some_and(|one| one != Intersample::Hold) {
        return Timed {
            timing: Timing::default(),
            issue: None,
            is_assumed: false,
        };
    }
    let issue = bring_to_one_timing(records, timing);
    let shown = issue.as_ref().map(|_| Timing::HoldBeforeSample);
    Timed {
        timing: timing.or(shown).unwrap_or_default(),
        is_assumed: timing.is_none() && issue.is_none(),
        issue,
    }
}

/// A name that no earlier record has: one file may serve as several records.
fn name_beside(name: &str, earlier: &[Record]) -> String {
    let taken = |name: &str| earlier.iter().any(|r| r.name == name);
    if !taken(name) {
        return name.to_owned();
    }
    (2..)
        .map(|n| format!("{name}_{n}"))
        .find(|name| !taken(name))
        .unwrap_or_default()
}

/// The signals of a table at even times.
fn even_signals(
    table: &Table,
    wanted: &ColumnRules,
    sample_rate_hz: Option<f64>,
    rate_otherwise_hz: Option<f64>,
    resample: Option<bool>,
) -> Result<Even> {
    let mut signals = recognise::signals(table, wanted)?;
    let known = StampContext {
        place: &table.place,
        line_of: &|row| table.line_of(row),
        sample_rate_hz,
        resample,
    };
    let mut notes = std::mem::take(&mut signals.notes);
    if let (Some(t_s), Some(t_of_y_s)) = (&mut signals.t_s, &signals.t_of_y_s) {
        let common = interpolate_to(t_s, t_of_y_s, &mut signals.y_um, table)?;
        let beside = signals.force_n.iter_mut().chain(
            signals
                .auxiliary
                .iter_mut()
                .map(|signal| &mut signal.values),
        );
        for signal in [t_s, &mut signals.u_v].into_iter().chain(beside) {
            *signal = signal[common.clone()].to_vec();
        }
    }
    let rate = sample_rate_hz
        .or(table.sample_rate_hz)
        .or(rate_otherwise_hz);
    let axis = match (&signals.t_s, rate) {
        (Some(t_s), _) => TimeAxis::from_stamps(t_s, &known)?,
        (None, Some(rate)) => {
            if sample_rate_hz.is_none() {
                let source = match table.sample_rate_hz {
                    Some(_) => "the file says",
                    None => "the model's records have",
                };
                notes.push(format!("{rate:.6} samples per second, as {source}"));
            }
            TimeAxis::without_stamps(rate)
        }
        (None, None) => {
            return Err(Error::new(
                &table.place,
                "has no time column; expected t, or the sampling rate: --sample-rate-hz, or sample_rate_hz in dataset.toml",
            ));
        }
    };
    notes.extend(axis.note.clone());
    notes.extend(seldom_read(
        &signals.u_v,
        &signals.y_um,
        axis.sample_rate_hz,
    ));
    Ok(Even {
        sample_rate_hz: axis.sample_rate_hz,
        start_s: axis.start_s,
        u_v: axis.apply(signals.u_v),
        y_um: axis.apply(signals.y_um),
        force_n: signals.force_n.map(|force_n| axis.apply(force_n)),
        units: signals.units,
        bridged: axis.bridged.clone(),
        auxiliary: signals
            .auxiliary
            .iter()
            .map(|signal| signal.with(|values| axis.apply(values.to_vec())))
            .collect(),
        notes,
    })
}

/// That rows were filled up between the readings of a sensor that is read more seldom; where the drive
/// changes no more often, that is how the stage answers.
fn seldom_read(u_v: &[f64], y_um: &[f64], sample_rate_hz: f64) -> Option<String> {
    let apart = rows_between_news(y_um).filter(|apart| {
        rows_between_news(u_v).is_none_or(|of_the_drive| of_the_drive % apart != 0)
    })?;
    Some(format!(
        "the displacement says something new once in {apart} rows: the sensor gives {:.1} readings per second, and the rows between were filled up; record at that rate, or \
         keep one row in {apart}, since no stage moves as they say",
        sample_rate_hz / apart as f64
    ))
}

/// Brings the displacement to the instants of the drive, as far as both were recorded: the samples of the
/// drive for which that is so.
fn interpolate_to(
    t_s: &[f64],
    t_of_y_s: &[f64],
    y_um: &mut Vec<f64>,
    table: &Table,
) -> Result<Range<usize>> {
    let rising = |t: &[f64]| t.windows(2).position(|w| w[1] <= w[0]);
    if let Some(row) = rising(t_of_y_s) {
        return Err(Error::new(
            &table.place,
            format!(
                "row {}: the time of the displacement does not increase",
                table.line_of(row + 1)
            ),
        ));
    }
    let (first, last) = (t_of_y_s[0], t_of_y_s[t_of_y_s.len() - 1]);
    let (begin, end) = (
        t_s.partition_point(|t| *t < first),
        t_s.partition_point(|t| *t <= last),
    );
    if begin >= end {
        return Err(Error::new(
            &table.place,
            "the two columns of time have no instant in common; say which is meant, as --columns t=1",
        ));
    }
    let mut after = 1;
    let interpolated = t_s[begin..end].iter().map(|t| {
        while after + 1 < t_of_y_s.len() && t_of_y_s[after] < *t {
            after += 1;
        }
        let (before, next) = (t_of_y_s[after - 1], t_of_y_s[after]);
        y_um[after - 1] + (t - before) / (next - before) * (y_um[after] - y_um[after - 1])
    });
    *y_um = interpolated.collect();
    Ok(begin..end)
}

/// One file without a manifest: its drive says which parts are fitted, held out, or show the noise
/// ([`one_recording`]).
///
/// # Errors
/// One message with row or column, and what was expected.
pub fn from_file(place: &str, bytes: &[u8]) -> Result<Dataset> {
    from_file_as(place, bytes, &Instructions::default())
}

/// Reads as [`from_file`] does, with what a person says about the file.
///
/// # Errors
/// As [`from_file`].
pub fn from_file_as(place: &str, bytes: &[u8], instructions: &Instructions) -> Result<Dataset> {
    let even = even_signals_of_file(place, bytes, instructions)?;
    let (even, is_thinned) = even.thinned(SEARCHED_SAMPLES);
    let parts = one_recording::parts(&even.u_v, &even.y_um, even.sample_rate_hz);
    of_files(vec![(place, even, parts)], is_thinned, instructions)
}

/// Two files without a manifest: the first is fitted, and the second judges. Each is a place and its bytes.
///
/// # Errors
/// As [`from_file`]; units that differ.
pub fn from_two_files_as(
    fitted: (&str, &[u8]),
    held_out: (&str, &[u8]),
    instructions: &Instructions,
) -> Result<Dataset> {
    let (mut files, mut some_thinned) = (Vec::new(), false);
    for ((place, bytes), role) in [(fitted, Role::Identify), (held_out, Role::Validate)] {
        let even = even_signals_of_file(place, bytes, instructions)?;
        let (even, is_thinned) = even.thinned(SEARCHED_SAMPLES);
        some_thinned |= is_thinned;
        let parts = one_recording::undivided(&even.u_v, &even.y_um, even.sample_rate_hz, role);
        files.push((place, even, parts));
    }
    of_files(files, some_thinned, instructions)
}

/// The signals of a file, of which there are enough.
fn even_signals_of_file(place: &str, bytes: &[u8], instructions: &Instructions) -> Result<Even> {
    let skip_rows = instructions.skip_rows.unwrap_or(0);
    let table = readers::read(place, bytes, Hints { skip_rows })?;
    let even = even_signals(
        &table,
        &instructions.wanted,
        instructions.sample_rate_hz,
        instructions.rate_otherwise_hz,
        None,
    )?;
    let samples = even.u_v.len();
    if samples < 2 * SAMPLES_MIN {
        return Err(Error::new(
            place,
            format!(
                "has {samples} samples; expected at least {}",
                2 * SAMPLES_MIN
            ),
        ));
    }
    Ok(even)
}

/// A data set of files whose parts are known; between samples that were thinned the drive runs straight.
fn of_files(
    files: Vec<(&str, Even, Parts)>,
    some_thinned: bool,
    instructions: &Instructions,
) -> Result<Dataset> {
    let (place, units) = (files[0].0, files[0].1.units.clone());
    let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
    let (mut records, mut notes) = (Vec::new(), Vec::new());
    for (of_file, even, parts) in &files {
        if even.units != units {
            return Err(Error::new(
                of_file,
                format!("has other units than {place}; expected records of one kind"),
            ));
        }
        let (lowest, highest) = extremes(&even.u_v);
        (low, high) = (low.min(lowest), high.max(highest));
        let before = if files.len() > 1 {
            format!("{}: ", stem(of_file))
        } else {
            String::new()
        };
        let said = even.notes.iter().chain(&parts.notes);
        notes.extend(said.map(|note| format!("{before}{note}")));
        let of_file = one_recording::records(&stem(of_file), of_file, even, parts);
        let rests = |roles: &mut dyn Iterator<Item = Role>| {
            roles.filter(|role| *role == Role::Noise).count()
        };
        if rests(&mut of_file.iter().map(|r| r.role))
            < rests(&mut parts.windows.iter().map(|(role, _)| *role))
        {
            notes.push(format!(
                "{before}a rest in which the reading does not move shows no noise, and is left out"
            ));
        }
        for mut record in of_file {
            record.name = name_beside(&record.name, &records);
            records.push(record);
        }
    }
    let at_rest = records
        .iter()
        .any(|record| record.initial_state == InitialState::Settled);
    let state = if at_rest {
        "it begins at rest, which is assumed"
    } else {
        "the state at its beginning is estimated"
    };
    let of_these = if files.len() > 1 { "files" } else { "file" };
    // A microvolt is less than any converter's step.
    let [low_v, high_v] = [low, high].map(|v: f64| (1e6 * v).round() / 1e6);
    notes.push(format!(
        "limits of the drive taken from the {of_these}: {low_v} to {high_v} V; {state}"
    ));
    let shown = timed(&mut records, instructions.timing, instructions.intersample);
    let dataset = Dataset {
        timing: shown.timing,
        timing_is_assumed: shown.is_assumed,
        intersample_is_assumed: instructions.intersample.is_none(),
        units,
        source: place.to_owned(),
        drive_min_v: low,
        drive_max_v: high,
        sensor_bandwidth_hz: None,
        sensor_lsb_um: None,
        records,
        name: stem(place),
        notes,
        issues: shown.issue.into_iter().collect(),
    }
    .checked()?;
    Ok(if some_thinned && instructions.intersample.is_none() {
        dataset.running_on(Intersample::Linear)
    } else {
        dataset
    })
}

/// The drive of one file: of a recording the one that [`from_file_as`] takes, else its columns t and u.
///
/// # Errors
/// One message with row or column, and what was expected.
pub fn drive_of_file(
    place: &str,
    bytes: &[u8],
    instructions: &Instructions,
) -> Result<PlayedDrive> {
    let skip_rows = instructions.skip_rows.unwrap_or(0);
    let table = readers::read(place, bytes, Hints { skip_rows })?;
    let (wanted, rate) = (&instructions.wanted, instructions.sample_rate_hz);
    if let Ok(even) = even_signals(&table, wanted, rate, instructions.rate_otherwise_hz, None) {
        return Ok(PlayedDrive {
            file: place.to_owned(),
            start_s: even.start_s,
            sample_rate_hz: even.sample_rate_hz,
            drive_v: even.u_v,
            reading_um: Some(even.y_um),
            force_n: even.force_n,
            auxiliary: even.auxiliary,
            notes: even.notes,
        });
    }
    let (t_s, drive_v) = recognise::time_and_drive(&table, wanted)?;
    // A drive alone is played as it is: uneven stamps are an error.
    let known = StampContext {
        place,
        line_of: &|row| table.line_of(row),
        sample_rate_hz: None,
        resample: Some(false),
    };
    let axis = TimeAxis::from_stamps(&t_s, &known)?;
    Ok(PlayedDrive {
        file: place.to_owned(),
        start_s: axis.start_s,
        sample_rate_hz: axis.sample_rate_hz,
        drive_v,
        notes: axis.note.into_iter().collect(),
        ..PlayedDrive::default()
    })
}

/// A file's name without folder and extension.
fn stem(file: &str) -> String {
    std::path::Path::new(file)
        .file_stem()
        .map_or_else(|| "record".into(), |s| s.to_string_lossy().into_owned())
}

fn record_of(
    table: &Table,
    entry: &RecordEntry,
    instructions: &Instructions,
    place: &str,
) -> Result<(Record, Vec<String>, SignalUnits)> {
    let rate = instructions.sample_rate_hz.or(entry.sample_rate_hz);
    if let Some(rate) = rate.filter(|rate| !(rate.is_finite() && *rate > 0.0)) {
        return Err(Error::new(
            place,
            format!("sample_rate_hz = {rate}; expected a positive number"),
        ));
    }
    let even = even_signals(
        table,
        &instructions.before(entry.wanted()),
        rate,
        instructions.rate_otherwise_hz,
        entry.resample,
    )?;
    let (fs, t0) = (even.sample_rate_hz, even.start_s);
    let samples = even.u_v.len();
    if samples < SAMPLES_MIN {
        return Err(Error::new(
            &table.place,
            format!("has {samples} samples; expected at least {SAMPLES_MIN}"),
        ));
    }
    for (key, value) in [
        ("from_s", entry.from_s),
        ("to_s", entry.to_s),
        ("periodic_from_s", entry.periodic_from_s),
    ] {
        if let Some(value) = value.filter(|value| !value.is_finite()) {
            return Err(Error::new(
                place,
                format!("{key} = {value}; expected a time in seconds"),
            ));
        }
    }
    let index = |t: f64| (((t - t0) * fs).round().max(0.0) as usize).min(samples);
    let from = entry.from_s.map_or(0, index);
    let to = entry.to_s.map_or(samples, index);
    if from >= to {
        return Err(Error::new(
            place,
            format!(
                "from_s = {} and to_s = {} leave no sample of {:.3} s",
                entry.from_s.map_or("(start)".into(), |s| s.to_string()),
                entry.to_s.map_or("(end)".into(), |s| s.to_string()),
                samples as f64 / fs
            ),
        ));
    }
    let periods = periods_of(
        entry,
        fs,
        samples,
        entry.periodic_from_s.map_or(from, index),
        place,
    )?;
    let initial_state = entry.initial_state.into();
    let record = Record {
        source: table.place.clone(),
        role: entry.role,
        initial_state,
        window: from..to,
        left_out: even.bridged,
        periods,
        repeat_of: entry.repeat_of.as_deref().map(stem),
        offset_is_fitted: match entry.offset {
            Some(Offset::Fit) => true,
            Some(Offset::Zero) => false,
            None => initial_state != InitialState::Virgin,
        },
        force_n: even.force_n,
        auxiliary: even.auxiliary,
        ..Record::new(stem(&entry.file), fs, even.u_v, even.y_um)
    };
    Ok((record, even.notes, even.units))
}

/// The steady-state periods that an entry declares.
fn periods_of(
    entry: &RecordEntry,
    sample_rate_hz: f64,
    samples: usize,
    start: usize,
    place: &str,
) -> Result<Option<Periods>> {
    let Some(period_s) = entry.period_s else {
        return match entry.periodic_from_s {
            Some(_) => Err(Error::new(
                place,
                "periodic_from_s without period_s; expected both",
            )),
            None => Ok(None),
        };
    };
    let length = (period_s * sample_rate_hz).round();
    let is_whole = (period_s * sample_rate_hz - length).abs() <= 1e-3 * length.max(1.0);
    if !(length >= 2.0 && is_whole) {
        return Err(Error::new(
            place,
            format!(
                "period_s = {period_s} is not a whole number of samples at {sample_rate_hz} Hz"
            ),
        ));
    }
    let (length, left) = (length as usize, samples.saturating_sub(start));
    if left < length {
        let left_s = left as f64 / sample_rate_hz;
        return Err(Error::new(
            place,
            format!(
                "period_s = {period_s}, but only {left_s:.3} s are left from where periods begin"
            ),
        ));
    }
    Ok(Some(Periods {
        from: start,
        length,
        count: left / length,
    }))
}
