//! The repository and how its commands are run: what every chore needs.

use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::process::Command;

/// The repository's root.
pub fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .parent()
        .map_or_else(|| PathBuf::from("."), Path::to_path_buf)
}

/// A program of the workspace's release build.
pub fn built(name: &str) -> PathBuf {
    std::env::var_os("CARGO_TARGET_DIR")
        .map_or_else(|| root().join("target"), Into::into)
        .join("release")
        .join(name)
}

/// The workspace with all features, in one profile: tests, lints and programs share what they are built with.
/// The emulated part declares a newer compiler than it needs; Cargo.lock names versions that build on this
/// one.
pub const AS_TESTED: &[&str] = &[
    "--release",
    "--workspace",
    "--features",
    "hysteron-cli/full",
    "--ignore-rust-version",
];

/// The product: the workspace without research and what crosses rooms. All but `hysteron-cli` has the same
/// features as in [`AS_TESTED`].
pub const PRODUCT: &[&str] = &[
    "--release",
    "--workspace",
    "--exclude",
    "hysteron-research",
    "--exclude",
    "hysteron-tests",
    "--exclude",
    "hysteron-thesis",
    "--features",
    "hysteron-cli/board,hysteron-cli/formats,hysteron-cli/lab,hysteron-cli/trace",
    "--ignore-rust-version",
];

/// Runs a command in a folder of the repository and fails with its own words.
pub fn command(
    program: impl AsRef<OsStr>,
    arguments: &[&str],
    folder: &Path,
    variables: &[(&str, &str)],
) -> Result<(), String> {
    let program = program.as_ref();
    let words = format!("{} {}", program.to_string_lossy(), arguments.join(" "));
    println!("   {words}");
    let status = Command::new(program)
        .args(arguments)
        .current_dir(folder)
        .envs(variables.iter().copied())
        .status()
        .map_err(|error| format!("`{words}` cannot be started: {error}"))?;
    if status.success() {
        Ok(())
    } else {
        Err(format!(
            "`{words}` in {} ended with {status}",
            folder.display()
        ))
    }
}

/// Runs this cargo.
pub fn cargo(arguments: &[&str], folder: &Path, variables: &[(&str, &str)]) -> Result<(), String> {
    command(
        std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()),
        arguments,
        folder,
        variables,
    )
}

/// A folder under `target/` without what an earlier run left.
pub fn emptied(name: &str) -> Result<PathBuf, String> {
    let folder = root().join("target").join(name);
    let problem = |error| format!("{}: {error}", folder.display());
    if folder.exists() {
        std::fs::remove_dir_all(&folder).map_err(problem)?;
    }
    std::fs::create_dir_all(&folder).map_err(problem)?;
    Ok(folder)
}
