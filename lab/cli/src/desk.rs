//! The files of one command: what it read is never written over, and whether a target can be written is known
//! before the work begins.

use crate::read_arguments::ReadArguments;
use crate::screen;
use crate::write_whole::write_whole;
use hysteron::dataset::folder;
use hysteron::dataset::reading::Instructions;
use hysteron::origin::{dated, read_as_recorded};
use hysteron::{Dataset, Error, Result, model_file};
use hysteron_sim::chain::Model;
use hysteron_sim::effect::Effect;
use std::cell::RefCell;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Inputs and targets of a command.
#[derive(Debug, Default)]
pub struct Desk {
    read: RefCell<Vec<PathBuf>>,
    targets: RefCell<Vec<PathBuf>>,
    force: bool,
}

/// As the file of `--json`: the figures go to the screen, and nothing else does.
pub const SCREEN: &str = "-";

/// The same file has the same name here, however it was called.
fn canonical(path: &Path) -> PathBuf {
    let folder = path
        .parent()
        .filter(|p| !p.as_os_str().is_empty())
        .unwrap_or_else(|| Path::new("."));
    path.canonicalize()
        .ok()
        .or_else(|| Some(folder.canonicalize().ok()?.join(path.file_name()?)))
        .unwrap_or_else(|| path.to_path_buf())
}

/// A file as it is called in messages.
pub fn wrong(path: &Path, message: impl std::fmt::Display) -> Error {
    Error::new(path.display(), message)
}

impl Desk {
    /// For a command that may replace files that exist, or not.
    pub fn new(force: bool) -> Self {
        Self {
            force,
            ..Self::default()
        }
    }

    /// The bytes of an input; `expected` says what should have been there.
    pub fn bytes(&self, path: &Path, expected: &str) -> Result<Vec<u8>> {
        let bytes = folder::bytes(path, expected)?;
        self.read.borrow_mut().push(canonical(path));
        Ok(bytes)
    }

    /// The text of an input.
    pub fn text(&self, path: &Path, expected: &str) -> Result<String> {
        String::from_utf8(self.bytes(path, expected)?)
            .map_err(|_| wrong(path, format!("is not text; expected {expected}")))
    }

    /// A folder with `dataset.toml`, a manifest, or one file of numbers.
    pub fn dataset(&self, path: &Path, reading: &ReadArguments) -> Result<Dataset> {
        self.dataset_as(path, &reading.instructions()?)
    }

    /// The same, or a file of numbers that is fitted and another one that judges.
    pub fn dataset_with(
        &self,
        path: &Path,
        held_out: Option<&Path>,
        reading: &ReadArguments,
    ) -> Result<Dataset> {
        match held_out {
            Some(held_out) => Ok(self.taken_in(folder::load_two_as(
                path,
                held_out,
                &reading.instructions()?,
            )?)),
            None => self.dataset(path, reading),
        }
    }

    /// The same as the records of a model were read, in all that nobody specifies.
    pub fn dataset_beside(
        &self,
        model: &Model,
        path: &Path,
        reading: &ReadArguments,
    ) -> Result<Dataset> {
        let dataset = self.dataset_as(path, &reading.instructions_beside(model)?)?;
        Ok(read_as_recorded(model, &dataset).unwrap_or(dataset))
    }

    fn dataset_as(&self, path: &Path, instructions: &Instructions) -> Result<Dataset> {
        Ok(self.taken_in(folder::load_as(path, instructions)?))
    }

    /// A data set whose files are not written, and in whose units lines are.
    fn taken_in(&self, dataset: Dataset) -> Dataset {
        let sources =
            std::iter::once(&dataset.source).chain(dataset.records.iter().map(|r| &r.source));
        self.read
            .borrow_mut()
            .extend(sources.map(|source| canonical(Path::new(source))));
        screen::speak_in(&dataset.units);
        dataset
    }

    /// A model that the program has written.
    pub fn model(&self, path: &Path) -> Result<Model> {
        let text = self.text(path, "a model written by `hysteron`")?;
        model_file::from_toml(&text, &path.display().to_string())
    }

    /// Effects by a list of names, or by a file that lists them; items that end in `.toml` define effects of
    /// the user's own.
    pub fn effects(&self, list: &str) -> Result<Vec<Arc<dyn Effect>>> {
        let path = Path::new(list);
        let names = if !list.ends_with(".toml") && path.is_file() {
            self.text(path, "a list of effects")?
        } else {
            list.to_owned()
        };
        let items = names
            .split([',', '\n', ' '])
            .map(str::trim)
            .filter(|item| !item.is_empty());
        items
            .map(|item| match item {
                _ if item.ends_with(".toml") => self.own_effect(Path::new(item)),
                _ => model_file::effect_named(item).map_err(|unknown| {
                    let what = match Path::new(item) {
                        path if path.is_dir() => "is a folder",
                        _ if item.contains(['.', '/', '\\']) => "does not exist",
                        _ => return unknown,
                    };
                    let expected =
                        "expected a file that lists effects, a .toml file that defines one, or names of effects separated by commas";
                    wrong(Path::new(item), format!("{what}; {expected}"))
                }),
            })
            .collect()
    }

    fn own_effect(&self, path: &Path) -> Result<Arc<dyn Effect>> {
        let text = self.text(path, "the definition of an effect")?;
        if model_file::is_model(&text) {
            return Err(wrong(
                path,
                "is a model; expected effects. For a model of another recording: hysteron diagnose MODEL DATASET; for one effect more: hysteron add EFFECT MODEL DATASET",
            ));
        }
        model_file::own_effect(&text, &path.display().to_string())
    }

    /// Takes a file as a target, once everything has been read and before the work begins.
    ///
    /// # Errors
    /// It was read, it exists and may not be replaced, it is a target already, or it cannot be written.
    pub fn target(&self, path: Option<&Path>) -> Result<()> {
        let Some(path) = path else { return Ok(()) };
        let this = canonical(path);
        if self.read.borrow().contains(&this) {
            return Err(wrong(
                path,
                "was read by this command and is not written over; expected another name",
            ));
        }
        if self.targets.borrow().contains(&this) {
            return Err(wrong(
                path,
                "is to be written twice by this command; expected different names",
            ));
        }
        let folder = path
            .parent()
            .filter(|p| !p.as_os_str().is_empty())
            .unwrap_or_else(|| Path::new("."));
        if !folder.is_dir() {
            return Err(wrong(
                path,
                format!("the folder {} does not exist", folder.display()),
            ));
        }
        if path.is_dir() {
            return Err(wrong(path, "is a folder; expected a file name"));
        }
        if path.exists() && !path.is_file() {
            return Err(wrong(
                path,
                "is a device or a pipe; expected the name of a file",
            ));
        }
        if path.exists() && !self.force {
            return Err(wrong(
                path,
                "exists; expected another name, or --force to replace it",
            ));
        }
        let trial = folder.join(format!(".hysteron.{}.trial", std::process::id()));
        let written = std::fs::File::create(&trial);
        // The trial file may never have come to be.
        let _ = std::fs::remove_file(&trial);
        written.map_err(|e| wrong(path, format!("cannot be written: {e}")))?;
        self.targets.borrow_mut().push(this);
        Ok(())
    }

    /// Takes a folder as the place of new files: none of them may exist already, unless they may be replaced.
    /// The folder around it has to be there.
    pub fn folder(&self, path: &Path, files: &[String]) -> Result<()> {
        self.make_folder(path)?;
        files
            .iter()
            .try_for_each(|name| self.target(Some(&path.join(name))))
    }

    /// Takes a folder as [`Desk::folder`] does, but leaves no trace of it where it is not there:
    /// [`Desk::make_folder`] makes it when there is something to be written.
    #[cfg(feature = "board")]
    pub fn folder_to_be(&self, path: &Path, files: &[String]) -> Result<()> {
        if path.is_dir() {
            return files
                .iter()
                .try_for_each(|name| self.target(Some(&path.join(name))));
        }
        let around = path
            .parent()
            .filter(|p| !p.as_os_str().is_empty())
            .unwrap_or_else(|| Path::new("."));
        if path.exists() || !around.is_dir() {
            return Err(wrong(
                path,
                "cannot be made; expected a new name in a folder that exists",
            ));
        }
        Ok(())
    }

    /// Makes a folder, where it is not there.
    pub fn make_folder(&self, path: &Path) -> Result<()> {
        if path.is_dir() {
            return Ok(());
        }
        std::fs::create_dir(path).map_err(|e| {
            wrong(
                path,
                format!("cannot be made: {e}; expected a new name in a folder that exists"),
            )
        })
    }

    /// Writes a target whole or not at all.
    pub fn write(&self, path: &Path, bytes: &[u8]) -> Result<()> {
        write_whole(path, bytes).map_err(|e| wrong(path, format!("cannot be written: {e}")))
    }

    /// Writes figures as JSON, if a file is wanted.
    pub fn write_json(&self, path: Option<&Path>, value: &impl serde::Serialize) -> Result<()> {
        let Some(path) = path else { return Ok(()) };
        let text = if screen::has_own_units() {
            serde_json::to_value(value)
                .and_then(|value| serde_json::to_string_pretty(&in_units(value)))
        } else {
            serde_json::to_string_pretty(value)
        };
        let text = text.map_err(|e| wrong(path, e))? + "\n";
        if path == Path::new(SCREEN) {
            screen::give(&text);
            return Ok(());
        }
        self.write(path, text.as_bytes())
    }

    /// Writes a page, if a file is wanted.
    pub fn write_page(
        &self,
        path: Option<&Path>,
        page: impl FnOnce() -> hysteron_report::Page,
    ) -> Result<()> {
        path.map_or(Ok(()), |path| {
            self.write(path, page().to_html_in(&screen::in_units).as_bytes())
        })
    }

    /// Writes a model, if a file is wanted.
    pub fn write_model(&self, path: Option<&Path>, model: &Model, data_set: &str) -> Result<()> {
        path.map_or(Ok(()), |path| {
            let model = dated(model, today());
            self.write(path, model_file::to_toml(&model, data_set)?.as_bytes())
        })
    }
}

/// The date, as `2026-11-28`, by the days since 1970 (H. Hinnant, chrono-compatible low-level date
/// algorithms, 2013).
fn today() -> String {
    let since = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH);
    let days = since.map_or(0, |since| since.as_secs() / 86_400) + 719_468;
    let (era, of_era) = (days / 146_097, days % 146_097);
    let year = (of_era - of_era / 1460 + of_era / 36_524 - of_era / 146_096) / 365;
    let of_year = of_era - (365 * year + year / 4 - year / 100);
    let month = (5 * of_year + 2) / 153;
    let day = of_year - (153 * month + 2) / 5 + 1;
    let month = if month < 10 { month + 3 } else { month - 9 };
    let year = year + 400 * era + u64::from(month <= 2);
    format!("{year:04}-{month:02}-{day:02}")
}

/// The texts of a value in the units of the data set.
fn in_units(value: serde_json::Value) -> serde_json::Value {
    use serde_json::Value;
    match value {
        Value::String(text) => Value::String(screen::in_units(&text)),
        Value::Array(values) => Value::Array(values.into_iter().map(in_units).collect()),
        Value::Object(fields) => {
            // The units themselves stay what they are.
            let said = |(key, value): (String, Value)| {
                if key == "units" {
                    (key, value)
                } else {
                    (key, in_units(value))
                }
            };
            Value::Object(fields.into_iter().map(said).collect())
        }
        other => other,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_read_is_no_target_however_it_is_called() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("data.csv");
        std::fs::write(&file, "1").unwrap();
        let desk = Desk::new(true);
        desk.bytes(&file, "data").unwrap();
        let by_another_name = folder.path().join(".").join("data.csv");
        let refused = desk.target(Some(&by_another_name)).unwrap_err().to_string();
        assert!(refused.contains("was read"), "{refused}");
    }

    #[test]
    fn a_folder_that_vanishes_before_the_write_is_an_error_with_its_name() {
        let folder = tempfile::tempdir().unwrap();
        let target = folder.path().join("results/page.html");
        let desk = Desk::new(false);
        desk.make_folder(&folder.path().join("results")).unwrap();
        desk.target(Some(&target)).unwrap();
        std::fs::remove_dir(folder.path().join("results")).unwrap();
        let said = desk.write(&target, b"page").unwrap_err().to_string();
        assert!(
            said.contains("page.html") && said.contains("cannot be written"),
            "{said}"
        );
        assert!(!folder.path().join("results").exists());
    }

    #[test]
    fn what_exists_needs_force_and_two_targets_are_two_files() {
        let folder = tempfile::tempdir().unwrap();
        let (old, new) = (folder.path().join("old"), folder.path().join("new"));
        std::fs::write(&old, "1").unwrap();
        assert!(
            Desk::new(false)
                .target(Some(&old))
                .unwrap_err()
                .to_string()
                .contains("--force")
        );
        let desk = Desk::new(true);
        desk.target(Some(&old)).unwrap();
        desk.target(Some(&new)).unwrap();
        assert!(
            desk.target(Some(&new))
                .unwrap_err()
                .to_string()
                .contains("twice")
        );
        assert!(!new.exists());
    }
}
