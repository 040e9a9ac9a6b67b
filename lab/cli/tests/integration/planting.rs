//! `plant`: what it refuses, and what it never replaces.

use crate::common;

use common::{assert_done, folder_with_model, hysteron, says};

#[test]
fn a_set_of_cases_takes_its_strengths_from_one_place() {
    let folder = tempfile::tempdir().unwrap();
    let output = hysteron(
        &["plant", "creep=2", "--cases", "3", "--out", "cases"],
        folder.path(),
    );
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(2), "{said}");
    assert!(said.contains("--strengths"), "{said}");
    assert!(!folder.path().join("cases").exists());
}

#[test]
fn planting_does_not_overwrite_data() {
    let folder = folder_with_model();
    let before = std::fs::read(folder.path().join("dataset.toml")).unwrap();
    says(
        &["plant", "creep=2", "--out", "."],
        folder.path(),
        "was not planted",
    );
    assert_eq!(
        std::fs::read(folder.path().join("dataset.toml")).unwrap(),
        before
    );
    std::fs::create_dir(folder.path().join("mine")).unwrap();
    std::fs::write(folder.path().join("mine/notes.txt"), "mine").unwrap();
    says(
        &["plant", "creep", "--out", "mine"],
        folder.path(),
        "holds other things",
    );
    assert_eq!(
        std::fs::read_dir(folder.path().join("mine"))
            .unwrap()
            .count(),
        1
    );
    says(
        &["plant", "creep", "--base", "hysteresis,creep", "--out", "p"],
        folder.path(),
        "--base models it",
    );
    says(
        &["plant", "creep,creep", "--out", "p"],
        folder.path(),
        "given twice",
    );
    says(
        &["plant", "", "--out", "p"],
        folder.path(),
        "none are given",
    );
}

/// The strength that is asked for is the strength that is planted, for an effect that another one's stage
/// takes in too.
#[test]
fn a_strength_is_honoured() {
    let folder = tempfile::tempdir().unwrap();
    let largest_um = |wanted: &str, out: &str| -> f64 {
        let output = hysteron(
            &["plant", wanted, "--out", out, "--seed", "5"],
            folder.path(),
        );
        assert_done(&output);
        let truth: serde_json::Value = serde_json::from_slice(
            &std::fs::read(folder.path().join(out).join("truth.json")).unwrap(),
        )
        .unwrap();
        let changed = truth[0]["effect_rms_um"]
            .as_array()
            .unwrap()
            .iter()
            .map(|entry| entry[1].as_f64().unwrap());
        changed.fold(0.0, f64::max)
    };
    // A mass ratio of 0.1 and of 0.4: what it changes grows with it, less than in proportion.
    let (one, four) = (
        largest_um("mass_change=1", "one"),
        largest_um("mass_change=4", "four"),
    );
    assert!(four > 2.0 * one && four < 5.0 * one, "{one} {four}");
}
