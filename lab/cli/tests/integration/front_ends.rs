//! The same recording asked from the command line, from the page and by `score`: the same answer.
#![cfg(feature = "lab")]

use crate::common::gone_wrong::{CASES, Wrong};
use crate::common::{assert_done, hysteron};
use hysteron_browser::LabSession;
use serde_json::{Value, json};
use std::path::Path;

/// Asks a session as the page does.
fn ask(session: &mut LabSession, question: &Value, files: &[Vec<u8>]) -> Value {
    let text = question.to_string();
    let mut bytes = (text.len() as u64).to_le_bytes().to_vec();
    bytes.extend(text.bytes());
    files.iter().for_each(|file| bytes.extend(file));
    let answer = session.answer(&bytes, &|_: &str| {});
    let length = u64::from_le_bytes(answer[..8].try_into().unwrap()) as usize;
    let value: Value = serde_json::from_slice(&answer[8..8 + length]).unwrap();
    assert!(value.get("error").is_none(), "{question}: {value}");
    value
}

/// What the page answers, as the command line would write it.
fn by_the_page(data: &Path, from: &str) -> Value {
    let names = ["fitted.csv", "held_out.csv", "rest.csv", "dataset.toml"];
    let files: Vec<Vec<u8>> = names
        .iter()
        .map(|name| std::fs::read(data.join(name)).unwrap())
        .collect();
    let entries: Vec<Value> = names
        .iter()
        .zip(&files)
        .map(|(name, file)| json!({ "name": name, "bytes": file.len() }))
        .collect();
    let mut session = LabSession::default();
    ask(
        &mut session,
        &json!({ "ask": "read", "files": entries }),
        &files,
    );
    ask(
        &mut session,
        &json!({ "ask": "explain", "from": from }),
        &[],
    );
    let figures = ask(
        &mut session,
        &json!({ "ask": "figures", "seconds": 0.0, "of_search": true }),
        &[],
    );
    serde_json::from_str(figures["text"].as_str().unwrap()).unwrap()
}

fn json_of(path: &Path) -> Value {
    serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap()
}

/// What a recording with something wrong about it is answered by all front ends, alike but for times.
fn answered(wrong: Wrong) -> Value {
    let folder = tempfile::tempdir().unwrap();
    let data = wrong.write(folder.path()).unwrap();
    let said = hysteron(
        &[
            "explain",
            &data.to_string_lossy(),
            "--from",
            wrong.base(),
            "--json",
            "cli.json",
        ],
        folder.path(),
    );
    assert_done(&said);
    let mut cli = json_of(&folder.path().join("cli.json"));
    cli["seconds"] = json!(0.0);
    assert_eq!(cli, by_the_page(&data, wrong.base()), "{}", wrong.name());
    hysteron(
        &["score", wrong.name(), "--json", "score.json"],
        folder.path(),
    );
    let score = json_of(&folder.path().join("score.json"));
    for key in ["verdict", "named"] {
        assert_eq!(
            score["cases"][0][key],
            cli["diagnosis"][key],
            "{}: {key}",
            wrong.name()
        );
    }
    cli["diagnosis"].clone()
}

fn kinds(diagnosis: &Value) -> Vec<(&str, &str)> {
    let issues = diagnosis["issues"].as_array().unwrap();
    let mut out: Vec<(&str, &str)> = issues
        .iter()
        .map(|i| (i["kind"].as_str().unwrap(), i["severity"].as_str().unwrap()))
        .collect();
    out.dedup();
    out
}

#[test]
fn every_front_end_says_that_a_sensor_is_disconnected() {
    let d = answered(CASES[0]);
    assert_eq!(
        (&d["verdict"], &d["reason"]),
        (&json!("undecidable"), &json!("not_answered")),
        "{d}"
    );
    assert_eq!(kinds(&d), [("not_answered", "blocks")]);
}

#[test]
#[ignore = "open: a drive that runs on between samples is taken where the same row does as well"]
fn every_front_end_repeats_the_search_with_the_timing_that_shows() {
    let d = answered(CASES[1]);
    assert!(
        kinds(&d).contains(&("same_sample_timing", "corrects"))
            || kinds(&d).contains(&("timing_in_readings", "corrects")),
        "{d}"
    );
}

#[test]
#[ignore = "open: an end that is read for fewer than eight samples in a row is not seen"]
fn every_front_end_leaves_clipped_readings_out() {
    let d = answered(CASES[2]);
    assert_eq!(kinds(&d), [("range_ends", "corrects")], "{d}");
    assert_eq!(d["named"], json!(["vibration"]), "{d}");
}

#[test]
#[ignore = "open: creep as declared leaves 1.3 times the noise from unknown states, so they are not taken"]
fn every_front_end_refuses_a_wrong_initial_state() {
    let d = answered(CASES[3]);
    assert_eq!(
        (&d["verdict"], &d["reason"]),
        (&json!("undecidable"), &json!("initial_state")),
        "{d}"
    );
    assert_eq!(kinds(&d), [("initial_state", "blocks")], "{d}");
}
