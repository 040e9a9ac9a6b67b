//! Where results may be written: never over what was read, over another file only with `--force`, and known before the work begins.

mod common;

use common::{folder_with_model, good_rows, hysteron, says};
use std::path::Path;

fn bytes(folder: &Path, file: &str) -> Vec<u8> {
    std::fs::read(folder.join(file)).unwrap()
}

#[test]
fn what_was_read_is_never_written_over_not_even_with_force() {
    let folder = folder_with_model();
    std::fs::write(folder.path().join("alone.csv"), good_rows(400)).unwrap();
    std::fs::write(folder.path().join("list.txt"), "gain\n").unwrap();
    std::fs::write(folder.path().join("drive.csv"), good_rows(100)).unwrap();
    for (input, command) in [
        ("alone.csv", &["explain", "alone.csv", "--out", "alone.csv"][..]),
        ("alone.csv", &["explain", "alone.csv", "--json", "./alone.csv"]),
        ("dataset.toml", &["explain", ".", "--report", "dataset.toml"]),
        ("list.txt", &["explain", ".", "--from", "list.txt", "--out", "list.txt"]),
        ("dataset.toml", &["identify", ".", "--effects", "gain", "--out", "dataset.toml"]),
        ("a.csv", &["identify", ".", "--effects", "gain", "--out", "a.csv"]),
        ("m.toml", &["compare", "m.toml", ".", "--json", "m.toml"]),
        ("m.toml", &["diagnose", "m.toml", ".", "--report", "m.toml"]),
        ("m.toml", &["add", "delay", "m.toml", ".", "--out", "m.toml"]),
        ("m.toml", &["simulate", "m.toml", "--drive", "step:1:0.1", "--out", "m.toml"]),
        ("drive.csv", &["simulate", "m.toml", "--drive", "drive.csv", "--out", "drive.csv"]),
    ] {
        let before = bytes(folder.path(), input);
        says(&[command, &["--force"]].concat(), folder.path(), "was read by this command and is not written over");
        assert_eq!(bytes(folder.path(), input), before, "{command:?}");
    }
}

#[test]
fn another_file_that_exists_needs_force() {
    let folder = folder_with_model();
    for file in ["old.toml", "old.json", "old.html", "old.csv"] {
        std::fs::write(folder.path().join(file), "mine").unwrap();
    }
    let identify = ["identify", ".", "--effects", "gain"];
    for outputs in [["--out", "old.toml"], ["--json", "old.json"], ["--report", "old.html"]] {
        says(&[&identify[..], &outputs].concat(), folder.path(), "--force");
        assert_eq!(bytes(folder.path(), outputs[1]), b"mine");
        assert!(hysteron(&[&identify[..], &outputs, &["--force"]].concat(), folder.path()).status.success());
        assert_ne!(bytes(folder.path(), outputs[1]), b"mine");
    }
    let simulate = ["simulate", "m.toml", "--drive", "step:1:0.1", "--out", "old.csv"];
    says(&simulate, folder.path(), "--force");
    assert_eq!(bytes(folder.path(), "old.csv"), b"mine");
    assert!(hysteron(&[&simulate[..], &["--force"]].concat(), folder.path()).status.success());
}

/// `--verbose` tells every step of the work: of work that has not begun there is none.
#[test]
fn a_target_that_cannot_be_written_is_known_before_the_work_begins() {
    let folder = folder_with_model();
    std::fs::create_dir(folder.path().join("folder")).unwrap();
    for (target, expected) in [("missing/m2.toml", "does not exist"), ("folder", "is a folder")] {
        for option in ["--out", "--json", "--report"] {
            let output = hysteron(&["explain", ".", "--verbose", option, target], folder.path());
            let said = String::from_utf8_lossy(&output.stderr).into_owned();
            assert_eq!(output.status.code(), Some(2), "{said}");
            assert!(said.contains(target) && said.contains(expected), "{said}");
            assert!(!said.contains("fitting"), "the work had begun: {said}");
        }
    }
    let twice = ["explain", ".", "--out", "same", "--json", "same"];
    says(&twice, folder.path(), "written twice");
    let left: Vec<_> = std::fs::read_dir(folder.path()).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
    assert!(left.iter().all(|name| !name.contains("trial") && !name.contains("part")), "{left:?}");
}
