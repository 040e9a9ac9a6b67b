//! What the packages that are linked are licensed under: every expression must leave a choice that is
//! permissive.

use std::collections::BTreeSet;

use spdx::{Expression, ParseMode};

use crate::dependency_tree::packages;

/// Licences that ask for no more than their text beside a copy.
const PERMISSIVE: [&str; 11] = [
    "MIT",
    "Apache-2.0",
    "BSD-2-Clause",
    "BSD-3-Clause",
    "ISC",
    "Zlib",
    "0BSD",
    "Unlicense",
    "CC0-1.0",
    "BSL-1.0",
    "Unicode-3.0",
];

/// Licensed under MPL-2.0, which asks for the source of its own files where they are changed: the serial port,
/// for which there is no other crate that is kept, and what prints the log of a trace.
const UNCHANGED_FILES: [&str; 3] = ["serialport", "colored", "alterable_logger"];

/// Whether a package may be linked by its licence.
fn is_permissive(name: &str, licence: &str) -> Result<bool, String> {
    let expression = Expression::parse_mode(licence, ParseMode::LAX)
        .map_err(|error| format!("{name}: licence `{licence}`: {}", error.reason))?;
    Ok(expression.evaluate(|wanted| {
        let id = wanted.license.id().map_or("", |id| id.name);
        PERMISSIVE.contains(&id) || (id == "MPL-2.0" && UNCHANGED_FILES.contains(&name))
    }))
}

/// The workspace, the firmware and the probe's program.
const MANIFESTS: [&str; 3] = [
    "Cargo.toml",
    "firmware/Cargo.toml",
    "board/probe/Cargo.toml",
];

/// Every package that is linked on any target.
///
/// # Errors
/// Those whose licence is missing, unknown or not permissive.
pub fn check() -> Result<(), String> {
    let mut listed = BTreeSet::new();
    for manifest in MANIFESTS {
        let selection = format!(
            "--manifest-path {manifest} --workspace --all-features --target all --edges normal,build"
        );
        let words: Vec<&str> = selection.split(' ').collect();
        listed.extend(packages(&words, "{p}|{l}")?);
    }
    // A line without a package stands between the trees of two members.
    listed.remove("");
    let refused = |line: &String| {
        let (package, licence) = line.split_once('|').unwrap_or((line, ""));
        match is_permissive(package.split(' ').next().unwrap_or_default(), licence) {
            Ok(true) => None,
            Ok(false) => Some(format!("{package}: {licence}")),
            Err(problem) => Some(problem),
        }
    };
    let refused: Vec<String> = listed.iter().filter_map(refused).collect();
    println!("   {} packages", listed.len());
    if refused.is_empty() {
        Ok(())
    } else {
        Err(refused.join("\n"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_choice_that_is_permissive_suffices_and_all_parts_count() {
        assert_eq!(is_permissive("a", "MIT/Apache-2.0"), Ok(true));
        assert_eq!(is_permissive("a", "MIT OR GPL-3.0-only"), Ok(true));
        assert_eq!(is_permissive("a", "MIT AND GPL-3.0-only"), Ok(false));
        assert_eq!(is_permissive("a", "MPL-2.0"), Ok(false));
        assert_eq!(is_permissive("serialport", "MPL-2.0"), Ok(true));
        assert!(is_permissive("a", "").is_err());
    }
}
