//! Progress, tables and files.

use crate::diagnosis::growth::nm;
use crate::explain::{FitFigures, StepFigures};
use crate::problem::{Problem, Result, write_whole};
use indicatif::{ProgressBar, ProgressStyle};
use std::path::Path;
use std::time::Duration;

/// A line that says what is being done, on terminals only.
pub struct Progress(ProgressBar);

impl Progress {
    /// Starts it.
    pub fn start() -> Self {
        let bar = ProgressBar::new_spinner();
        if let Ok(style) = ProgressStyle::with_template("{spinner} {elapsed:>4} {msg}") {
            bar.set_style(style);
        }
        bar.enable_steady_tick(Duration::from_millis(120));
        Self(bar)
    }

    /// Says what is being done now.
    pub fn say(&self, message: &str) {
        self.0.set_message(message.to_string());
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        self.0.finish_and_clear();
    }
}

/// Writes JSON.
pub fn write_json(path: &Path, value: &impl serde::Serialize) -> Result<()> {
    let mut text = serde_json::to_string_pretty(value).map_err(|e| Problem::file(path, e))?;
    text.push('\n');
    write_whole(path, text.as_bytes())
}

/// Checks before a long run that an output can be written where it is wanted.
pub fn check_writable(path: Option<&Path>) -> Result<()> {
    let Some(path) = path else { return Ok(()) };
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or_else(|| Path::new("."));
    if !folder.is_dir() {
        return Err(Problem::file(path, format!("the folder {} does not exist", folder.display())));
    }
    if path.is_dir() {
        return Err(Problem::file(path, "is a folder; expected a file name"));
    }
    Ok(())
}

/// The steps of a growth with their falling error.
pub fn print_steps(steps: &[StepFigures], floor_um: Option<f64>) {
    let width = steps.iter().filter_map(|s| s.added.as_ref().map(String::len)).max().unwrap_or(0).max(18);
    println!("  {:width$}  fitted nm  held out nm", "");
    for (i, step) in steps.iter().enumerate() {
        let name = match (&step.added, i) {
            (Some(id), _) => format!("+ {id}"),
            (None, 0) => "start".into(),
            (None, _) => "finer surfaces".into(),
        };
        let taken_back =
            if step.removed.is_empty() { String::new() } else { format!("   (no longer needed: {})", step.removed.join(", ")) };
        println!("  {name:width$}  {:>9}  {:>11}{taken_back}", nm(step.identify_rms_um), step.validate_rms_um.map_or("-".into(), nm));
    }
    if let Some(floor) = floor_um {
        println!("  {:width$}  {:>9}  {:>11}", "noise", nm(floor), nm(floor));
    }
}

/// Records with their errors.
pub fn print_records(figures: &FitFigures) {
    let width = figures.records.iter().map(|r| r.file.len()).max().unwrap_or(6).max(6);
    println!("  {:width$}  {:8}  RMS nm    max nm    % of range", "record", "role");
    for r in figures.records.iter().filter(|r| r.role != "noise") {
        println!("  {:width$}  {:8}  {:>6}    {:>6}    {:.3}", r.file, r.role, nm(r.rms_um), nm(r.max_um), r.rms_pct_range);
    }
}

/// Things to know, one line each.
pub fn print_notes(figures: &FitFigures) {
    for warning in &figures.warnings {
        println!("  note: {warning}");
    }
    for line in &figures.cannot_identify {
        println!("  cannot be identified from this data: {line}");
    }
}
