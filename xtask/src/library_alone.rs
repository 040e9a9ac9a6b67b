//! The library without its default features: what it may not depend on. That it builds for a browser is shown by [`crate::lab_page`].

use std::process::Command;

use crate::steps::root;

/// What belongs to a command line, to threads or to the decoder of the firmware's trace.
const NOT_IN_IT: [&str; 7] = ["clap", "indicatif", "ctrlc", "defmt-decoder", "defmt-parser", "rayon", "hysteron-report"];

/// Names of everything that the library without default features is built with.
fn names() -> Result<Vec<String>, String> {
    let arguments =
        ["tree", "--package", "hysteron", "--no-default-features", "--edges", "normal,build", "--prefix", "none", "--format", "{p}"];
    let output = Command::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()))
        .args(arguments)
        .current_dir(root())
        .output()
        .map_err(|error| format!("`cargo tree` cannot be started: {error}"))?;
    if !output.status.success() {
        return Err(format!("`cargo tree`: {}", String::from_utf8_lossy(&output.stderr)));
    }
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    let mut names: Vec<String> = text.lines().filter_map(|line| line.split(' ').next()).map(String::from).collect();
    names.sort();
    names.dedup();
    Ok(names)
}

/// Fails where the tree has what it may not have.
pub fn dependencies() -> Result<(), String> {
    let names = names()?;
    if !names.iter().any(|name| name == "hysteron-sim") {
        return Err(format!("`cargo tree` does not even list hysteron-sim: {}", names.join(", ")));
    }
    let wrong: Vec<&str> = NOT_IN_IT.into_iter().filter(|name| names.iter().any(|n| n == name)).collect();
    if wrong.is_empty() {
        println!("   {} crates, none of {}", names.len(), NOT_IN_IT.join(", "));
        Ok(())
    } else {
        Err(format!("the library without default features depends on {}", wrong.join(", ")))
    }
}
