//! The library without its default features: what it may not depend on, and that it builds. That it builds for
//! a browser, with the readers, is shown by [`crate::lab_page`].

use std::collections::BTreeSet;

use crate::dependency_tree::packages;
use crate::workspace::{cargo, root};

/// What belongs to a command line, to threads or to the decoder of the firmware's trace.
const NOT_IN_IT: [&str; 7] = [
    "clap",
    "indicatif",
    "ctrlc",
    "defmt-decoder",
    "defmt-parser",
    "rayon",
    "hysteron-report",
];

/// Names of everything that the library without default features is built with.
fn names() -> Result<BTreeSet<String>, String> {
    let lines = packages(
        &[
            "--package",
            "hysteron",
            "--no-default-features",
            "--edges",
            "normal,build",
        ],
        "{p}",
    )?;
    Ok(lines
        .iter()
        .filter_map(|line| line.split(' ').next())
        .map(String::from)
        .collect())
}

/// Fails where the tree has what it may not have, or does not compile.
pub fn check() -> Result<(), String> {
    let names = names()?;
    if !names.contains("hysteron-sim") {
        return Err(format!(
            "`cargo tree` does not even list hysteron-sim: {names:?}"
        ));
    }
    let wrong: Vec<&str> = NOT_IN_IT
        .into_iter()
        .filter(|name| names.contains(*name))
        .collect();
    if wrong.is_empty() {
        println!(
            "   {} crates, none of {}",
            names.len(),
            NOT_IN_IT.join(", ")
        );
    } else {
        return Err(format!(
            "the library without default features depends on {}",
            wrong.join(", ")
        ));
    }
    let alone = ["--package", "hysteron", "--no-default-features"];
    cargo(
        &[&["check", "--quiet", "--release"], &alone[..]].concat(),
        &root(),
        &[],
    )
}
