//! Tests that cross the rooms of Hysteron, and what they share.

pub mod independent_stage;
pub mod lugre_rig;
pub mod measured;
pub mod random_input;
pub mod readers;
pub mod running_amplifier;
pub mod saved_model;
pub mod saved_tapes;
pub mod servo_study;

use std::io::Write;
use std::path::{Path, PathBuf};

/// Where `cargo xtask check` reads which tests were skipped: a file that every skipped test adds a line to.
pub const SKIPPED_FILE: &str = "HYSTERON_SKIPPED";
/// Set where the data beside the project must be there (continuous integration that has them): a test that
/// misses them then fails.
pub const NEEDS_SHARED: &str = "HYSTERON_NEEDS_SHARED";

/// The root of the repository.
#[must_use]
pub fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

/// A folder of planted or measured data, which lie beside the project and are never copied into it; `None`,
/// said loudly, where they do not.
///
/// # Panics
/// Where they must be there ([`NEEDS_SHARED`] in CI) and are not.
#[must_use]
pub fn beside(path: &str) -> Option<PathBuf> {
    let folder = root().join("../shared/data").join(path);
    if folder.exists() {
        return Some(folder);
    }
    let is = |variable: &str, value: &str| std::env::var(variable).is_ok_and(|v| v == value);
    assert!(
        !(is("CI", "true") && is(NEEDS_SHARED, "1")),
        "{} is not there, and {NEEDS_SHARED}=1 asks for it",
        folder.display()
    );
    skipped(&format!("no {path} data in ../shared/data"));
    None
}

/// Says that the calling test skips what it is for, and why.
pub fn skipped(why: &str) {
    let test = std::thread::current().name().unwrap_or("a test").to_owned();
    eprintln!("skipped {test}: {why}");
    let Some(file) = std::env::var_os(SKIPPED_FILE) else {
        return;
    };
    let line = std::fs::OpenOptions::new()
        .create(true)
        .append(true)
        .open(file)
        .and_then(|mut f| f.write_all(format!("{test}: {why}\n").as_bytes()));
    assert!(line.is_ok(), "{SKIPPED_FILE} cannot be written: {line:?}");
}
