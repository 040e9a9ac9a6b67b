//! `cargo xtask mutants [FILE ..]`: changes every expression of the files that decide a fault or a name, one at
//! a time, and counts the changes that no test notices (cargo-mutants). [`crate::mutate`] takes whole lines of
//! safety out of the image instead.
//!
//! # How it works
//! Files of the core are changed in a copy of the workspace and tried with the core's own tests of that file
//! and of the amplifier. The verdict's files depend on nothing of the library: a small crate of these alone
//! builds in seconds, where the library takes minutes.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use crate::result_tables;
use crate::workspace::root;

const VERSION: &str = "27.1.0";
const RESULTS: &str = "benchmarks/results/mutants.csv";
const HEADER: &str = "file,changes,noticed,not_noticed,percent_noticed";

/// Files of the core.
const CORE: &[&str] = &[
    "core/src/guard.rs",
    "core/src/output_limit.rs",
    "core/src/swing_watch.rs",
    "core/src/command_limits.rs",
    "core/src/output_monitor.rs",
    "core/src/command_text.rs",
    "core/src/safety_envelope.rs",
];
/// Files of the verdict, which need nothing else of the library.
const VERDICT: &[&str] = &[
    "lab/library/src/diagnosis/verdict.rs",
    "lab/library/src/diagnosis/confidence_set.rs",
];
/// Crates that they need, and those of their tests.
const DEPENDENCIES: &[&str] = &["serde", "nalgebra", "rand", "rand_pcg"];
const OF_TESTS: &[&str] = &["serde_json"];

/// Runs the files with these names, or all, and stores a row for each.
pub fn run(names: &[String]) -> Result<(), String> {
    let found = Command::new("cargo")
        .args(["mutants", "--version"])
        .output();
    if !found.is_ok_and(|output| output.status.success()) {
        return Err(format!(
            "cargo-mutants is not installed; run `cargo install cargo-mutants --locked --version {VERSION}`"
        ));
    }
    let wanted = |file: &&&str| {
        let stem = Path::new(file).file_stem().unwrap_or_default();
        names.is_empty() || names.iter().any(|name| stem == name.as_str())
    };
    let files: Vec<&str> = [CORE, VERDICT].concat();
    let chosen: Vec<&&str> = files.iter().filter(wanted).collect();
    if chosen.is_empty() {
        return Err(format!(
            "no such file; expected some of {}",
            files.join(", ")
        ));
    }
    for file in chosen {
        let row = if CORE.contains(file) {
            of_core(file)?
        } else {
            of_verdict(file)?
        };
        store(file, &row)?;
    }
    result_tables::write()
}

fn of_core(file: &str) -> Result<String, String> {
    let stem = file.trim_start_matches("core/src/").trim_end_matches(".rs");
    let arguments = ["-p", "hysteron-core", "-f", file];
    let tests = ["--", stem, "amplifier"];
    counted(file, &root(), &arguments, &tests)
}

fn of_verdict(file: &str) -> Result<String, String> {
    let folder = root().join("target/mutants/verdict");
    let problem = |e: std::io::Error| format!("{}: {e}", folder.display());
    fs::create_dir_all(folder.join("src")).map_err(problem)?;
    let mut modules = String::new();
    for each in VERDICT {
        let name = Path::new(each).file_name().unwrap_or_default();
        fs::copy(root().join(each), folder.join("src").join(name)).map_err(problem)?;
        let stem = Path::new(each).file_stem().unwrap_or_default();
        modules += &format!("pub mod {};\n", stem.display());
    }
    fs::write(folder.join("src/lib.rs"), modules).map_err(problem)?;
    fs::write(folder.join("Cargo.toml"), manifest()?).map_err(problem)?;
    fs::copy(root().join("Cargo.lock"), folder.join("Cargo.lock")).map_err(problem)?;
    let name = Path::new(file).file_name().unwrap_or_default();
    let inside = format!("src/{}", name.display());
    // Cases by the hundred cost seconds, and notice nothing that the others do not.
    counted(
        file,
        &folder,
        &["-f", &inside],
        &["--", "--skip", "of_any_noise"],
    )
}

/// The manifest of the verdict's crate, with the crates as the workspace has them.
fn manifest() -> Result<String, String> {
    let path = root().join("Cargo.toml");
    let problem = |e: &dyn std::fmt::Display| format!("{}: {e}", path.display());
    let text = fs::read_to_string(&path).map_err(|e| problem(&e))?;
    let workspace: toml::Table = toml::from_str(&text).map_err(|e| problem(&e))?;
    let pinned = &workspace["workspace"]["dependencies"];
    let lines = |names: &[&str]| {
        let line = |name: &&str| format!("{name} = {}\n", pinned[*name]);
        names.iter().map(line).collect::<String>()
    };
    Ok(format!(
        "[package]\nname = \"verdict\"\nversion = \"0.0.0\"\nedition = \"2024\"\n\n[dependencies]\n{}\n[dev-dependencies]\n{}\n[profile.dev]\nopt-level = 1\n\n[workspace]\n",
        lines(DEPENDENCIES),
        lines(OF_TESTS)
    ))
}

/// Changes a file and gives its row. Changes that the compiler refuses do not count.
fn counted(
    file: &str,
    folder: &Path,
    arguments: &[&str],
    tests: &[&str],
) -> Result<String, String> {
    let out = root().join("target/mutants").join(file);
    let problem = |e: std::io::Error| format!("{}: {e}", out.display());
    fs::create_dir_all(&out).map_err(problem)?;
    println!("   {file}: {}/mutants.out", out.display());
    let status = Command::new("cargo")
        .args(["mutants", "--colors", "never", "--timeout", "120"])
        .args([
            "--cargo-arg=--ignore-rust-version",
            "--cargo-arg=--lib",
            "-o",
        ])
        .arg(&out)
        .args(arguments)
        .arg("--")
        .args(tests)
        .current_dir(folder)
        .env("CARGO_TARGET_DIR", root().join("target/mutants/build"))
        .envs([
            ("CARGO_INCREMENTAL", "1"),
            ("CARGO_PROFILE_DEV_DEBUG", "0"),
            ("PROPTEST_RNG_SEED", "20260101"),
        ])
        .status()
        .map_err(|e| format!("cargo mutants: {e}"))?;
    // 2: some were not noticed, 3: some did not end.
    if !matches!(status.code(), Some(0 | 2 | 3)) {
        return Err(format!("cargo mutants on {file} ended with {status}"));
    }
    let lines = |name: &str| -> Result<usize, String> {
        let path: PathBuf = out.join("mutants.out").join(name);
        let text = fs::read_to_string(&path).map_err(|e| format!("{}: {e}", path.display()))?;
        Ok(text.lines().count())
    };
    let noticed = lines("caught.txt")? + lines("timeout.txt")?;
    let not_noticed = lines("missed.txt")?;
    let all = noticed + not_noticed;
    let percent = 100.0 * noticed as f64 / all.max(1) as f64;
    Ok(format!("{file},{all},{noticed},{not_noticed},{percent:.1}"))
}

/// Puts a row in the place of the one that the file had.
fn store(file: &str, row: &str) -> Result<(), String> {
    let path = root().join(RESULTS);
    let text = fs::read_to_string(&path).unwrap_or_default();
    let others = text.lines().skip(1).filter(|line| {
        !line
            .strip_prefix(file)
            .is_some_and(|rest| rest.starts_with(','))
    });
    let mut rows: Vec<&str> = others.chain([row]).collect();
    rows.sort_unstable();
    println!("   {row}");
    fs::write(&path, format!("{HEADER}\n{}\n", rows.join("\n")))
        .map_err(|e| format!("{RESULTS}: {e}"))
}
