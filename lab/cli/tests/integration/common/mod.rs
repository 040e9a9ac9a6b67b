//! What the tests of the program share. Each of them uses a part of it.
#![allow(dead_code)]

pub mod gone_wrong;
#[cfg(unix)]
pub mod page;

use std::path::Path;
use std::process::{Command, Output};

/// Runs the program in a folder.
pub fn hysteron(arguments: &[&str], folder: &Path) -> Output {
    Command::new(env!("CARGO_BIN_EXE_hysteron"))
        .args(arguments)
        .current_dir(folder)
        .output()
        .unwrap()
}

/// Asserts that a run of the program did what it was asked for.
#[track_caller]
pub fn assert_done(output: &Output) {
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{said}");
}

/// The words of a command line, none of which has a space in it.
pub fn words(line: &str) -> Vec<&str> {
    line.split_whitespace().collect()
}

/// Presses Ctrl-C, as the terminal would; whether the program was still there.
#[cfg(unix)]
pub fn interrupted(program: &std::process::Child) -> bool {
    Command::new("sh")
        .args(["-c", &format!("kill -INT {}", program.id())])
        .status()
        .unwrap()
        .success()
}

/// One record, to be fitted.
pub const MANIFEST: &str = "name = \"t\"\ndrive_min_v = 0.0\ndrive_max_v = 10.0\n\n[[record]]\nfile = \"a.csv\"\nsample_rate_hz = 1000.0\nrole = \"identify\"\ninitial_state = \"virgin\"\n";

/// A cosine from 0 to 10 V at 1 kHz and 0.1 um/V.
pub fn good_rows(samples: usize) -> String {
    let mut text = String::from("t_s,u_v,y_um\n");
    for k in 0..samples {
        let u = 5.0 - 5.0 * (k as f64 * 0.05).cos();
        text.push_str(&format!("{:.3},{u:.5},{:.5}\n", k as f64 * 1e-3, 0.1 * u));
    }
    text
}

/// A folder with good rows, a model of them and whatever else a test writes.
pub fn folder_with_model() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("dataset.toml"), MANIFEST).unwrap();
    std::fs::write(folder.path().join("a.csv"), good_rows(400)).unwrap();
    let output = hysteron(
        &["identify", ".", "--effects", "gain", "--out", "m.toml"],
        folder.path(),
    );
    assert_done(&output);
    folder
}

/// Runs a command that must be refused in one line.
pub fn says(arguments: &[&str], folder: &Path, expected: &str) {
    let output = hysteron(arguments, folder);
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(2), "{arguments:?}: {said}");
    assert!(
        said.contains(expected),
        "{arguments:?}: expected `{expected}` in: {said}"
    );
}

/// A folder with two records that a search has something to find in: a first-order lag behind a line, with a
/// held-out record.
pub fn folder_to_search() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let mut manifest = String::from("name = \"lag\"\ndrive_min_v = 0.0\ndrive_max_v = 10.0\n");
    for (name, role, step) in [("a", "identify", 0.02), ("b", "validate", 0.031)] {
        let mut text = String::from("t_s,u_v,y_um\n");
        let mut y = 0.0;
        for k in 0..4000_u32 {
            let u = 5.0 - 5.0 * (f64::from(k) * step).cos();
            let noise = 1e-3 * (f64::from(k) * 12.9898).sin() * (f64::from(k) * 78.233).cos();
            text.push_str(&format!(
                "{:.3},{u:.5},{:.5}\n",
                f64::from(k) * 1e-3,
                y + noise
            ));
            y += 0.4 * (0.1 * u - y);
        }
        std::fs::write(folder.path().join(format!("{name}.csv")), text).unwrap();
        manifest.push_str(&format!(
            "\n[[record]]\nfile = \"{name}.csv\"\nsample_rate_hz = 1000.0\nrole = \"{role}\"\ninitial_state = \"virgin\"\n"
        ));
    }
    std::fs::write(folder.path().join("dataset.toml"), manifest).unwrap();
    folder
}
