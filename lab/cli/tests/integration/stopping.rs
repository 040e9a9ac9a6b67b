//! Ctrl-C during a search: the best model so far is written, and said to be that.
#![cfg(unix)]

use crate::common::{self, assert_done};

use std::io::{BufRead, BufReader, Read};
use std::path::Path;
use std::process::{Child, Command, Output, Stdio};

/// Presses Ctrl-C, as the terminal would, when the program tells the first step of its work.
fn stopped_at_its_first_step(arguments: &[&str], folder: &Path) -> (Output, String) {
    let mut child: Child = Command::new(env!("CARGO_BIN_EXE_hysteron"))
        .args(arguments)
        .current_dir(folder)
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut said = BufReader::new(child.stderr.take().unwrap());
    let mut told = String::new();
    said.read_line(&mut told).unwrap();
    assert!(told.contains("fitting"), "{told}");
    assert!(
        common::interrupted(&child),
        "the program had ended already: {told}"
    );
    said.read_to_string(&mut told).unwrap();
    (child.wait_with_output().unwrap(), told)
}

#[test]
fn the_best_so_far_is_written_and_said_as_such() {
    let folder = tempfile::tempdir().unwrap();
    // Work for many seconds, so that it cannot be over before the key is pressed.
    let example = concat!(env!("CARGO_MANIFEST_DIR"), "/../../examples/hidden_effect");
    let outputs = ["--out", "m.toml", "--json", "m.json", "--report", "m.html"];
    let arguments = [
        &[
            "explain",
            example,
            "--verbose",
            "--from",
            "gain,delay,vibration",
        ][..],
        &outputs,
    ]
    .concat();
    let (output, told) = stopped_at_its_first_step(&arguments, folder.path());
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(output.status.success(), "{told}");
    assert!(told.contains("ending with what is known by now"), "{told}");
    assert!(
        text.contains("Stopped: this is the best so far, not the end of the search."),
        "{text}"
    );
    let figures: serde_json::Value =
        serde_json::from_slice(&std::fs::read(folder.path().join("m.json")).unwrap()).unwrap();
    assert_eq!(figures["stopped"], true);
    assert!(folder.path().join("m.html").exists());
    // What was written is a model like any other.
    let compared = common::hysteron(&["compare", "m.toml", example], folder.path());
    assert_done(&compared);
    let compared = String::from_utf8_lossy(&compared.stdout).into_owned();
    assert!(
        compared.contains("times the noise of ") && compared.contains("`hysteron diagnose`"),
        "{compared}"
    );
}
