//! Data sets from the file system: a folder with `dataset.toml`, a manifest, or one file of numbers.

use super::data_set::Dataset;
use super::reading::{Files, Instructions, from_file_as, from_manifest_as, from_two_files_as};
use crate::error::{Error, Result};
use std::io::Read;
use std::path::Path;

/// Most that is read of one file: a device gives bytes without end.
const BYTES_MAX: u64 = 2 << 30;

const EXPECTED: &str =
    "a folder with `dataset.toml`, or one file of numbers (docs/reference/formats.md)";

/// The files beside a manifest.
struct Folder<'a>(&'a Path);

impl Files for Folder<'_> {
    fn read(&self, name: &str) -> Result<Vec<u8>> {
        bytes(&self.0.join(name), "the file of a record")
    }

    fn place(&self, name: &str) -> String {
        self.0.join(name).display().to_string()
    }
}

/// The bytes of a file; `expected` says what should have been there.
///
/// # Errors
/// When it does not exist or cannot be read.
pub fn bytes(path: &Path, expected: &str) -> Result<Vec<u8>> {
    if !path.exists() {
        return Err(Error::new(
            path.display(),
            format!("does not exist; expected {expected}"),
        ));
    }
    let wrong = |e: std::io::Error| {
        Error::new(
            path.display(),
            format!("cannot be read: {e}; expected {expected}"),
        )
    };
    let mut bytes = Vec::new();
    std::fs::File::open(path)
        .map_err(wrong)?
        .take(BYTES_MAX + 1)
        .read_to_end(&mut bytes)
        .map_err(wrong)?;
    if bytes.len() as u64 > BYTES_MAX {
        return Err(Error::new(
            path.display(),
            format!(
                "goes on beyond {} GiB; expected {expected}",
                BYTES_MAX >> 30
            ),
        ));
    }
    Ok(bytes)
}

/// The text of a file.
///
/// # Errors
/// As [`bytes()`], and when it is no text.
pub fn text(path: &Path, expected: &str) -> Result<String> {
    String::from_utf8(bytes(path, expected)?)
        .map_err(|_| Error::new(path.display(), format!("is not text; expected {expected}")))
}

/// Reads a folder with `dataset.toml`, a manifest, or one file of numbers. The sources of data set and
/// records are the paths that were read.
///
/// # Errors
/// One message with file, row or field, and what was expected.
pub fn load(path: &Path) -> Result<Dataset> {
    load_as(path, &Instructions::default())
}

/// Reads a file that is fitted and another one that judges.
///
/// # Errors
/// As [`load`], and where the first is no file of numbers.
pub fn load_two_as(fitted: &Path, held_out: &Path, instructions: &Instructions) -> Result<Dataset> {
    if fitted.is_dir() || fitted.extension().is_some_and(|end| end == "toml") {
        return Err(Error::new(
            "--held-out",
            format!(
                "{} specifies itself what is held out; expected one file of numbers before it",
                fitted.display()
            ),
        ));
    }
    let same = |a: &Path, b: &Path| a.canonicalize().ok().zip(b.canonicalize().ok());
    if same(fitted, held_out).is_some_and(|(a, b)| a == b) {
        return Err(Error::new(
            "--held-out",
            format!(
                "{} is the file that is fitted; expected another one",
                held_out.display()
            ),
        ));
    }
    let [fitted, held_out] = [fitted, held_out].map(|path| {
        bytes(path, "one file of numbers (docs/reference/formats.md)")
            .map(|bytes| (path.display().to_string(), bytes))
    });
    let (fitted, held_out) = (fitted?, held_out?);
    from_two_files_as(
        (&fitted.0, &fitted.1),
        (&held_out.0, &held_out.1),
        instructions,
    )
}

/// Reads as [`load`] does, with what a person says about columns and units.
///
/// # Errors
/// As [`load`].
pub fn load_as(path: &Path, instructions: &Instructions) -> Result<Dataset> {
    if path.is_dir() {
        let manifest = path.join("dataset.toml");
        if !manifest.is_file() {
            return Err(Error::new(
                path.display(),
                "is a folder without `dataset.toml`; expected a manifest there (docs/reference/dataset.md) or one file of numbers (docs/reference/formats.md)",
            ));
        }
        return load_as(&manifest, instructions);
    }
    let name = path.display().to_string();
    if path
        .extension()
        .is_some_and(|extension| extension == "toml")
    {
        let folder = path.parent().unwrap_or_else(|| Path::new("."));
        return from_manifest_as(&text(path, EXPECTED)?, &name, &Folder(folder), instructions);
    }
    from_file_as(&name, &bytes(path, EXPECTED)?, instructions)
}
