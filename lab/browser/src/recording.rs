//! A data set from the files that somebody dropped.
//!
//! With a `dataset.toml` among them the manifest says what is what. One file alone is cut by what its drive
//! does, as on the command line. Several files without a manifest are taken as whole records of one actuator:
//! those at rest show the noise, the last that moves is held out, the others are fitted; the manifest for
//! that is written here, so that the command line comes to the same data set. An amplifier's image with its
//! log is decoded as `hysteron capture` does.

use hysteron::capture::capture;
use hysteron::dataset::column_rules::ColumnRules;
use hysteron::dataset::readers::{self, Hints};
use hysteron::dataset::reading::{Instructions, from_file_as, from_manifest_as};
use hysteron::dataset::recognise;
use hysteron::dataset::table::Table;
use hysteron::dataset::timing::Timing;
use hysteron::dataset::{column_rules::PerColumn, manifest::IntersampleEntry};
use hysteron::statistics::extremes;
use hysteron::{Dataset, Error, Result, Role};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::fmt::Write as _;

/// What a person says about the files, beside what they say themselves.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(default)]
pub struct Said {
    /// Columns by name or number from 1.
    pub columns: PerColumn<String>,
    /// Units.
    pub units: PerColumn<String>,
    /// Sampling rate.
    pub sample_rate_hz: Option<f64>,
    /// Rows of text to leave out.
    pub skip_rows: Option<usize>,
    /// When the drive of a row acts.
    pub timing: Option<Timing>,
    /// What the drive does between samples.
    pub intersample: Option<IntersampleEntry>,
    /// Roles of records by their names.
    pub roles: BTreeMap<String, Role>,
}

impl Said {
    /// The same in the words of the library.
    #[must_use]
    pub fn instructions(&self) -> Instructions {
        use hysteron::dataset::column_rules::ColumnName;
        let column = |text: &Option<String>| {
            let text = text.as_deref()?;
            Some(
                text.parse()
                    .map_or_else(|_| ColumnName::Name(text.to_owned()), ColumnName::Number),
            )
        };
        let c = &self.columns;
        let columns = PerColumn {
            t: column(&c.t),
            u: column(&c.u),
            y: column(&c.y),
            force: column(&c.force),
        };
        Instructions {
            wanted: ColumnRules {
                columns,
                unit: self.units.clone(),
                ..ColumnRules::default()
            },
            sample_rate_hz: self.sample_rate_hz,
            skip_rows: self.skip_rows,
            timing: self.timing,
            intersample: self.intersample.map(Into::into),
            rate_otherwise_hz: None,
        }
    }
}

/// A column of a file as a person chooses among them.
#[derive(Clone, Debug, Serialize)]
pub struct ColumnChoice {
    /// Counted from 1.
    pub number: usize,
    /// Name, where the file gives one.
    pub name: String,
    /// Unit, where the file gives one.
    pub unit: Option<String>,
}

/// A data set with what the page shows of its files.
pub struct UploadedRecording {
    /// The data set.
    pub dataset: Dataset,
    /// The manifest that was written for files without one.
    pub manifest: Option<String>,
    /// Columns of the first file of numbers.
    pub columns: Vec<ColumnChoice>,
}

impl UploadedRecording {
    /// A data set that was read, with the roles that a person gave its records and the first of its tables.
    ///
    /// # Errors
    /// Where the roles leave nothing to fit.
    pub fn of(
        dataset: Dataset,
        manifest: Option<String>,
        first: Option<&Table>,
        said: &Said,
    ) -> Result<Self> {
        let columns = first.map_or_else(Vec::new, columns_of);
        Ok(Self {
            dataset: with_roles(dataset, &said.roles)?,
            manifest,
            columns,
        })
    }
}

/// The name of a file without the folders before it.
fn base_name(path: &str) -> &str {
    path.rsplit('/').next().unwrap_or(path)
}

/// Reads a data set from files by name.
///
/// # Errors
/// One message with file, row or field, and what was expected.
pub fn read(files: &BTreeMap<String, Vec<u8>>, said: &Said) -> Result<UploadedRecording> {
    if let Some((image, log)) = trace_of(files)? {
        return from_trace(image, log, said);
    }
    let manifest = files
        .keys()
        .find(|name| base_name(name) == "dataset.toml")
        .or_else(|| files.keys().find(|name| name.ends_with(".toml")));
    let recordings: Vec<(&String, &Vec<u8>)> = files
        .iter()
        .filter(|(name, _)| !name.ends_with(".toml"))
        .collect();
    let instructions = said.instructions();
    let hints = Hints {
        skip_rows: said.skip_rows.unwrap_or(0),
    };
    let (dataset, written, shown) = match (manifest, recordings[..].first()) {
        (Some(name), _) => {
            let text = String::from_utf8(files[name].clone())
                .map_err(|_| Error::new(name, "is not text; expected a manifest"))?;
            let folder = &name[..name.len() - base_name(name).len()];
            let beside: BTreeMap<String, Vec<u8>> = files
                .iter()
                .filter_map(|(name, bytes)| {
                    Some((name.strip_prefix(folder)?.to_owned(), bytes.clone()))
                })
                .collect();
            let dataset = from_manifest_as(&text, name, &beside, &instructions)?;
            let first = dataset
                .records
                .first()
                .and_then(|record| beside.get_key_value(&record.source));
            let table = first
                .map(|(name, bytes)| readers::read(name, bytes, hints))
                .transpose()?;
            (dataset, None, table)
        }
        (None, None) => {
            return Err(Error::new(
                "",
                format!(
                    "no recording among the files; expected {}",
                    readers::FORMATS
                ),
            ));
        }
        (None, Some((name, bytes))) if recordings.len() == 1 => (
            from_file_as(name, bytes, &instructions)?,
            None,
            Some(readers::read(name, bytes, hints)?),
        ),
        (None, Some(_)) => {
            let (text, table) = manifest_of(&recordings, said, &instructions, hints)?;
            (
                from_manifest_as(&text, "dataset.toml", files, &instructions)?,
                Some(text),
                Some(table),
            )
        }
    };
    UploadedRecording::of(dataset, written, shown.as_ref(), said)
}

/// First bytes of an executable image.
const ELF: &[u8] = b"\x7fELF";

/// The image of an amplifier and the log that it wrote, where somebody dropped those two.
fn trace_of(files: &BTreeMap<String, Vec<u8>>) -> Result<Option<(&[u8], &[u8])>> {
    let (images, others): (Vec<_>, Vec<_>) =
        files.iter().partition(|(_, bytes)| bytes.starts_with(ELF));
    match (&images[..], &others[..]) {
        ([], _) => Ok(None),
        ([(_, image)], [(_, log)]) => Ok(Some((image, log))),
        ([(name, _), ..], _) => Err(Error::new(
            name,
            format!(
                "is an image; expected one image and one log beside it, got {} and {}",
                images.len(),
                others.len()
            ),
        )),
    }
}

/// The trace in a log as a data set.
fn from_trace(image: &[u8], log: &[u8], said: &Said) -> Result<UploadedRecording> {
    let (found, files) = capture(image, log)?;
    let mut recording = read(&files.into_iter().collect(), said)?;
    recording.dataset.notes.push(format!(
        "decoded from the log of an amplifier: {} ticks lost on the target, {} gaps, {} damaged blocks",
        found.lost_on_target, found.gaps, found.damaged
    ));
    Ok(recording)
}

fn columns_of(table: &Table) -> Vec<ColumnChoice> {
    table
        .columns
        .iter()
        .map(|c| ColumnChoice {
            number: c.number,
            name: c.name.clone(),
            unit: c.unit.clone(),
        })
        .collect()
}

/// The manifest of several files that bring none, and the table of the first.
fn manifest_of(
    recordings: &[(&String, &Vec<u8>)],
    said: &Said,
    instructions: &Instructions,
    hints: Hints,
) -> Result<(String, Table)> {
    let mut shown = None;
    let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
    let mut roles: Vec<Role> = Vec::new();
    for (name, bytes) in recordings {
        let table = readers::read(name, bytes, hints)?;
        let drive_v = recognise::signals(&table, &instructions.wanted)?.u_v;
        let (l, h) = extremes(&drive_v);
        (low, high) = (low.min(l), high.max(h));
        roles.push(if l < h { Role::Identify } else { Role::Noise });
        shown.get_or_insert(table);
    }
    let moving = roles.iter().filter(|role| **role == Role::Identify).count();
    if let Some(last) = roles
        .iter_mut()
        .rev()
        .find(|role| **role == Role::Identify)
        .filter(|_| moving > 1)
    {
        *last = Role::Validate;
    }
    let mut text =
        format!("name = \"recordings\"\ndrive_min_v = {low:?}\ndrive_max_v = {high:?}\n");
    for ((name, _), role) in recordings.iter().zip(roles) {
        let stem = base_name(name)
            .rsplit_once('.')
            .map_or(base_name(name), |(stem, _)| stem);
        let role = said.roles.get(stem).copied().unwrap_or(role).name();
        let quoted = toml::Value::String((*name).clone());
        // Writing to a text cannot fail.
        let _ = write!(
            text,
            "\n[[record]]\nfile = {quoted}\nrole = \"{role}\"\ninitial_state = \"unknown\"\n"
        );
    }
    shown
        .map(|table| (text, table))
        .ok_or_else(|| Error::new("", "no recording among the files"))
}

/// The same data set with the roles that a person gave its records.
fn with_roles(dataset: Dataset, roles: &BTreeMap<String, Role>) -> Result<Dataset> {
    let changed =
        |name: &str, role: Role| roles.get(name).copied().filter(|wanted| *wanted != role);
    if !dataset
        .records
        .iter()
        .any(|r| changed(&r.name, r.role).is_some())
    {
        return Ok(dataset);
    }
    let records = dataset
        .records
        .into_iter()
        .map(|r| match changed(&r.name, r.role) {
            Some(role) => r.with_role(role),
            None => r,
        });
    let checked = Dataset::new(
        dataset.name,
        dataset.drive_min_v,
        dataset.drive_max_v,
        records.collect(),
    )?;
    let mut notes = dataset.notes;
    for note in &checked.notes {
        if !notes.contains(note) {
            notes.push(note.clone());
        }
    }
    let (sensor_bandwidth_hz, sensor_lsb_um) = (dataset.sensor_bandwidth_hz, dataset.sensor_lsb_um);
    let mut issues = dataset.issues;
    for issue in &checked.issues {
        if !issues.contains(issue) {
            issues.push(issue.clone());
        }
    }
    Ok(Dataset {
        source: dataset.source,
        sensor_bandwidth_hz,
        sensor_lsb_um,
        notes,
        issues,
        ..checked
    })
}
