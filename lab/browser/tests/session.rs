//! Questions as the page asks them, answered on the host.

use hysteron_browser::LabSession;
use serde_json::{Value, json};

/// Asks, and gives the answer with its columns.
fn ask(
    session: &mut LabSession,
    mut question: Value,
    files: &[(&str, String)],
) -> (Value, Vec<Vec<f64>>) {
    if question["ask"] == "read" {
        question["files"] = files
            .iter()
            .map(|(name, text)| json!({ "name": name, "bytes": text.len() }))
            .collect();
    }
    let text = question.to_string();
    let mut bytes = (text.len() as u64).to_le_bytes().to_vec();
    bytes.extend(text.bytes());
    files
        .iter()
        .for_each(|(_, file)| bytes.extend(file.bytes()));
    let answer = session.answer(&bytes, &|_: &str| {});
    let length = u64::from_le_bytes(answer[..8].try_into().unwrap()) as usize;
    let json: Value = serde_json::from_slice(&answer[8..8 + length]).unwrap();
    let mut numbers = answer[8 + length..]
        .chunks_exact(8)
        .map(|b| f64::from_le_bytes(b.try_into().unwrap()));
    let columns = json["columns"].as_array().unwrap();
    let columns = columns
        .iter()
        .map(|n| {
            numbers
                .by_ref()
                .take(n.as_u64().unwrap() as usize)
                .collect()
        })
        .collect();
    (json, columns)
}

fn recording(hz: f64) -> String {
    let rows = (0..2000).map(|k| {
        let u = |k: i32| {
            if hz > 0.0 {
                20.0 - 20.0 * (0.006 * hz * f64::from(k)).cos()
            } else {
                0.0
            }
        };
        format!(
            "{:.3},{:.5},{:.5}\n",
            f64::from(k) * 1e-3,
            u(k),
            0.1 * u(k - 1) + 1e-3 * (f64::from(k * k) * 78.233).sin()
        )
    });
    format!("t_s,u_v,y_um\n{}", rows.collect::<String>())
}

#[test]
fn several_files_become_a_data_set_that_the_manifest_repeats() {
    let files = [
        ("a.csv", recording(1.0)),
        ("b.csv", recording(2.0)),
        ("rest.csv", recording(0.0)),
    ];
    let mut session = LabSession::default();
    let (read, _) = ask(&mut session, json!({ "ask": "read" }), &files);
    let roles = |read: &Value| -> Vec<String> {
        read["records"]
            .as_array()
            .unwrap()
            .iter()
            .map(|r| r["role"].as_str().unwrap().to_owned())
            .collect()
    };
    assert_eq!(roles(&read), ["identify", "validate", "noise"], "{read}");
    let mut with_manifest = files.to_vec();
    with_manifest.push((
        "dataset.toml",
        read["manifest"].as_str().unwrap().to_owned(),
    ));
    let (again, _) = ask(
        &mut LabSession::default(),
        json!({ "ask": "read" }),
        &with_manifest,
    );
    assert_eq!(again["records"], read["records"]);
    let (other, _) = ask(
        &mut session,
        json!({ "ask": "read", "said": { "roles": { "a": "test", "b": "identify" } } }),
        &files,
    );
    assert_eq!(roles(&other), ["test", "identify", "noise"], "{other}");
}

#[test]
fn a_trial_moves_the_error_and_leaves_the_model() {
    let mut session = LabSession::default();
    ask(
        &mut session,
        json!({ "ask": "read" }),
        &[("one.csv", recording(1.0))],
    );
    let (model, _) = ask(
        &mut session,
        json!({ "ask": "identify", "effects": "gain" }),
        &[],
    );
    let gain = model["effects"][0]["parameters"][0]["value"]
        .as_f64()
        .unwrap();
    assert!((gain - 0.1).abs() < 1e-3, "{model}");
    let (before, columns) = ask(&mut session, json!({ "ask": "compare", "record": 0 }), &[]);
    let (_, signals) = ask(&mut session, json!({ "ask": "signals", "record": 0 }), &[]);
    assert_eq!(columns[0].len(), signals[1].len());
    let trial =
        json!({ "ask": "compare", "record": 0, "trial": { "values": [[1.1 * gain]], "off": [] } });
    let (after, _) = ask(&mut session, trial, &[]);
    assert!(
        after["fitted_um"].as_f64() > Some(10.0 * before["fitted_um"].as_f64().unwrap()),
        "{after}"
    );
    assert_eq!(
        ask(&mut session, json!({ "ask": "compare", "record": 0 }), &[]).0,
        before
    );
    let (saved, _) = ask(&mut session, json!({ "ask": "save" }), &[]);
    let (loaded, _) = ask(
        &mut session,
        json!({ "ask": "load", "text": saved["text"], "name": "model.toml" }),
        &[],
    );
    assert_eq!(loaded["effects"], model["effects"]);
}

#[test]
fn what_cannot_be_answered_is_said() {
    let mut session = LabSession::default();
    for (question, expected) in [
        (json!({ "ask": "compare", "record": 0 }), "no recording"),
        (json!({ "ask": "dance" }), "dance"),
        (json!({ "ask": "read" }), "no recording among the files"),
        (json!({ "ask": "identify", "effects": "crepe" }), "creep"),
    ] {
        let (answer, _) = ask(&mut session, question.clone(), &[]);
        assert!(
            answer["error"]
                .as_str()
                .is_some_and(|e| e.contains(expected)),
            "{question}: {answer}"
        );
    }
    let cut_off = session.answer(&[1, 2, 3], &|_: &str| {});
    assert!(String::from_utf8_lossy(&cut_off).contains("cut off"));
}
