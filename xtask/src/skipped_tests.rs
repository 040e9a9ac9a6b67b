//! Tests that could not run: each adds a line to a file (`tests/src/lib.rs`), and the chore ends with them.

use std::path::PathBuf;

use crate::workspace::root;

/// To which tests that cannot run add a line (`tests/src/lib.rs`).
pub fn file() -> PathBuf {
    root().join("target/skipped_tests.txt")
}

fn lines() -> Vec<String> {
    let mut lines: Vec<String> = std::fs::read_to_string(file()).map_or_else(
        |_| Vec::new(),
        |text| text.lines().map(String::from).collect(),
    );
    lines.sort();
    lines
}

/// What an earlier run had to skip says nothing of this one.
pub fn forget() -> Result<(), String> {
    let file = file();
    if file.exists() {
        std::fs::remove_file(&file).map_err(|error| format!("{}: {error}", file.display()))?;
    }
    Ok(())
}

/// Says which tests could not run.
pub fn print() {
    let skipped = lines();
    if !skipped.is_empty() {
        println!(
            "\n!! {} tests were SKIPPED and say nothing about this checkout:\n!!   {}",
            skipped.len(),
            skipped.join("\n!!   ")
        );
    }
}
