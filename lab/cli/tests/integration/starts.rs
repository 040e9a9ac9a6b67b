//! Lists of effects to start from, and what a manifest calls its records.

use crate::common;

use common::{
    MANIFEST, assert_done, folder_to_search, folder_with_model, good_rows, hysteron, says,
};

#[test]
fn lists_that_make_no_chain_are_refused_before_anything_is_fitted() {
    let folder = folder_with_model();
    for (list, expected) in [
        ("", "none are given"),
        (" , ", "none are given"),
        (
            "hysteresis,bouc_wen",
            "hysteresis and bouc_wen stand in the same place of the chain; expected one of them",
        ),
        ("gain,hysteresis", "stand in the same place"),
        ("gain,delay,delay", "delay is given twice"),
        ("gain,load_force", "load_force"),
    ] {
        says(
            &["explain", ".", "--from", list, "--out", "new.toml"],
            folder.path(),
            expected,
        );
        says(
            &["identify", ".", "--effects", list, "--out", "new.toml"],
            folder.path(),
            expected,
        );
        assert!(!folder.path().join("new.toml").exists());
    }
}

#[test]
fn a_search_that_starts_from_creep_alone_ends() {
    let folder = folder_to_search();
    let output = hysteron(
        &["explain", ".", "--from", "creep", "--json", "x.json"],
        folder.path(),
    );
    assert_done(&output);
    let found: serde_json::Value =
        serde_json::from_slice(&std::fs::read(folder.path().join("x.json")).unwrap()).unwrap();
    let effects: Vec<&str> = found["effects"]
        .as_array()
        .unwrap()
        .iter()
        .filter_map(|e| e.as_str())
        .collect();
    // Something for it to follow: a gain, or loops in its place.
    let is_main = |id: &&str| hysteron::effect_named(id).unwrap().declaration().is_main();
    assert!(
        effects.iter().any(is_main) && effects.contains(&"creep"),
        "{effects:?}"
    );
}

#[test]
fn columns_that_are_not_there_are_told_under_the_key_that_names_them() {
    let folder = folder_with_model();
    let columns = |entry: &str| {
        std::fs::write(
            folder.path().join("dataset.toml"),
            format!("{MANIFEST}[record.columns]\n{entry}\n"),
        )
        .unwrap();
    };
    columns("u = \"volts\"");
    says(
        &["explain", "."],
        folder.path(),
        "[record.columns] u = \"volts\" is not in the header",
    );
    columns("y = 7");
    says(&["explain", "."], folder.path(), "[record.columns] y = 7");
    columns("t = 1\nu = \"u_v\"\ny = 3");
    assert!(
        hysteron(&["identify", ".", "--effects", "gain"], folder.path())
            .status
            .success()
    );
    std::fs::write(folder.path().join("dataset.toml"), MANIFEST).unwrap();
    std::fs::write(
        folder.path().join("a.csv"),
        good_rows(400).replace("t_s,u_v,y_um", "when,what,which"),
    )
    .unwrap();
    // Names that say nothing: the columns are recognised by what they do, and a note reports that and how to
    // specify them.
    let recognised = hysteron(&["explain", "."], folder.path());
    let said = String::from_utf8_lossy(&recognised.stdout).into_owned();
    assert!(
        recognised.status.success()
            && said.contains("u = column `what`")
            && said.contains("--columns t=1,u=2,y=3"),
        "{said}"
    );
}

#[test]
fn a_gap_in_time_is_told_at_its_own_row() {
    let folder = folder_with_model();
    // The row after the header is row 2, so that the first sample after the gap of twenty stands in row 3002.
    let rows: Vec<String> = good_rows(4000).lines().map(String::from).collect();
    let gapped: Vec<String> = rows
        .iter()
        .enumerate()
        .filter(|(i, _)| !(3001..3021).contains(i))
        .map(|(_, row)| row.clone())
        .collect();
    std::fs::write(folder.path().join("a.csv"), gapped.join("\n")).unwrap();
    says(&["explain", "."], folder.path(), "row 3002");
    std::fs::write(folder.path().join("alone.csv"), gapped.join("\n")).unwrap();
    says(&["explain", "alone.csv"], folder.path(), "row 3002");
}

#[test]
fn one_file_can_be_two_records() {
    let folder = folder_with_model();
    let record = |role: &str, more: &str| {
        let entry = MANIFEST.split("[[record]]").nth(1).unwrap();
        format!(
            "[[record]]{}{more}",
            entry.replace("\"identify\"", &format!("\"{role}\""))
        )
    };
    let head = MANIFEST.split("[[record]]").next().unwrap();
    let write = |first: &str, second: &str| {
        let text = format!(
            "{head}{}\n{}",
            record("identify", &format!("to_s = 0.2\n{first}")),
            record("validate", &format!("from_s = 0.2\n{second}"))
        );
        std::fs::write(folder.path().join("dataset.toml"), text).unwrap();
    };
    let files = || -> Vec<String> {
        let output = hysteron(
            &["compare", "m.toml", ".", "--json", "x.json", "--force"],
            folder.path(),
        );
        assert_done(&output);
        let found: serde_json::Value =
            serde_json::from_slice(&std::fs::read(folder.path().join("x.json")).unwrap()).unwrap();
        found["records"]
            .as_array()
            .unwrap()
            .iter()
            .map(|r| r["file"].as_str().unwrap().to_owned())
            .collect()
    };
    write("name = \"rise\"\n", "name = \"fall\"\n");
    assert_eq!(files(), ["rise", "fall"]);
    write("", "");
    assert_eq!(files(), ["a", "a_2"]);
    write("name = \"same\"\n", "name = \"same\"\n");
    says(
        &["compare", "m.toml", "."],
        folder.path(),
        "two records are called `same`",
    );
}
