//! What packages are built with, as `cargo tree` tells it.

use std::collections::BTreeSet;
use std::process::Command;

use crate::workspace::root;

/// One line in this format for every package behind these.
pub fn packages(selection: &[&str], format: &str) -> Result<BTreeSet<String>, String> {
    let output = Command::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()))
        .args([
            "tree",
            "--prefix",
            "none",
            "--no-dedupe",
            "--format",
            format,
        ])
        .args(selection)
        .current_dir(root())
        .output()
        .map_err(|error| format!("`cargo tree` cannot be started: {error}"))?;
    if !output.status.success() {
        return Err(format!(
            "`cargo tree`: {}",
            String::from_utf8_lossy(&output.stderr)
        ));
    }
    Ok(String::from_utf8_lossy(&output.stdout)
        .lines()
        .map(|line| line.trim().to_owned())
        .collect())
}
