//! Recordings of real stages, which lie beside the project and are never copied into it.

use hysteron::dataset::{Dataset, Record, Role};
use hysteron::watch::{Watch, WatchEvent};
use std::path::{Path, PathBuf};

/// Takes a flag out of the arguments of an example; whether it was there.
pub fn flag(arguments: &mut Vec<String>, name: &str) -> bool {
    arguments
        .iter()
        .position(|a| a == name)
        .map(|i| arguments.remove(i))
        .is_some()
}

/// Takes an option and its value out of the arguments of an example.
pub fn value_of(arguments: &mut Vec<String>, option: &str) -> Option<String> {
    let at = arguments.iter().position(|a| a == option)?;
    Some(
        arguments
            .drain(at..(at + 2).min(arguments.len()))
            .next_back()
            .unwrap_or_default(),
    )
}

/// Takes `--data FOLDER` out of the arguments of an example: where the recordings are. `None`, said, where
/// they are not.
pub fn folder(arguments: &mut Vec<String>) -> Option<PathBuf> {
    let data = value_of(arguments, "--data").map_or_else(
        || crate::root().join("../shared/data/measured"),
        PathBuf::from,
    );
    if !data.exists() {
        eprintln!(
            "no recordings at {}: give their folder with --data",
            data.display()
        );
    }
    data.exists().then_some(data)
}

/// One record of the stage in `piezo_stage`: 10 kHz, columns time, drive, displacement. What lies before
/// `from_s` drives the model and is not judged.
///
/// # Panics
/// Where the file is not there or is no table of numbers.
#[must_use]
pub fn record(data: &Path, name: &str, from_s: f64, role: Role) -> Record {
    let text = std::fs::read_to_string(data.join(format!("piezo_stage/{name}.csv")))
        .expect("the recording can be read");
    let rows: Vec<Vec<f64>> = text
        .lines()
        .skip(1)
        .filter_map(|l| l.split(',').map(|v| v.parse().ok()).collect())
        .collect();
    let column = |i: usize| rows.iter().map(|r| r[i]).collect::<Vec<f64>>();
    let mut record = Record::new(name, 10_000.0, column(1), column(2)).with_role(role);
    record.window.start = (from_s * record.sample_rate_hz) as usize;
    record
}

/// Records of that stage as a data set.
///
/// # Panics
/// Where they make none.
#[must_use]
pub fn stage(records: Vec<Record>) -> Dataset {
    Dataset::new("piezo_stage", -95.0, 95.0, records).expect("the recordings make a data set")
}

/// Prints what a search does, with the seconds since it was made: for `--trace` of an example.
pub struct MeasuredTrace(std::time::Instant);

impl Default for MeasuredTrace {
    fn default() -> Self {
        Self(std::time::Instant::now())
    }
}

impl Watch for MeasuredTrace {
    fn event(&self, event: &WatchEvent<'_>) {
        let seconds = self.0.elapsed().as_secs_f64();
        match event {
            WatchEvent::Tried {
                added,
                identify_rms_um,
                validate_rms_um,
                best,
            } => eprintln!(
                "    {seconds:>6.1} s {:>7.1} / {:>7.1} nm {} {}",
                1e3 * identify_rms_um,
                1e3 * validate_rms_um.unwrap_or(f64::NAN),
                if *best { "best" } else { "    " },
                added.join(",")
            ),
            other => eprintln!("    {seconds:>6.1} s {other}"),
        }
    }
}
