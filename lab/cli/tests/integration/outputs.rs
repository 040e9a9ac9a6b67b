//! Where results may be written: never over what was read, over another file only with `--force`, and known
//! before the work begins.

use crate::common;

use common::{assert_done, folder_to_search, folder_with_model, good_rows, hysteron, says, words};
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
        (
            "alone.csv",
            &["explain", "alone.csv", "--out", "alone.csv"][..],
        ),
        (
            "alone.csv",
            &["explain", "alone.csv", "--json", "./alone.csv"],
        ),
        (
            "dataset.toml",
            &["explain", ".", "--report", "dataset.toml"],
        ),
        (
            "list.txt",
            &["explain", ".", "--from", "list.txt", "--out", "list.txt"],
        ),
        (
            "dataset.toml",
            &[
                "identify",
                ".",
                "--effects",
                "gain",
                "--out",
                "dataset.toml",
            ],
        ),
        (
            "a.csv",
            &["identify", ".", "--effects", "gain", "--out", "a.csv"],
        ),
        ("m.toml", &["compare", "m.toml", ".", "--json", "m.toml"]),
        ("m.toml", &["diagnose", "m.toml", ".", "--report", "m.toml"]),
        (
            "m.toml",
            &["add", "delay", "m.toml", ".", "--out", "m.toml"],
        ),
        (
            "m.toml",
            &[
                "simulate",
                "m.toml",
                "--drive",
                "step:1:0.1",
                "--out",
                "m.toml",
            ],
        ),
        (
            "drive.csv",
            &[
                "simulate",
                "m.toml",
                "--drive",
                "drive.csv",
                "--out",
                "drive.csv",
            ],
        ),
    ] {
        let before = bytes(folder.path(), input);
        says(
            &[command, &["--force"]].concat(),
            folder.path(),
            "was read by this command and is not written over",
        );
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
    for outputs in [
        ["--out", "old.toml"],
        ["--json", "old.json"],
        ["--report", "old.html"],
    ] {
        says(
            &[&identify[..], &outputs].concat(),
            folder.path(),
            "--force",
        );
        assert_eq!(bytes(folder.path(), outputs[1]), b"mine");
        assert!(
            hysteron(
                &[&identify[..], &outputs, &["--force"]].concat(),
                folder.path()
            )
            .status
            .success()
        );
        assert_ne!(bytes(folder.path(), outputs[1]), b"mine");
    }
    let simulate = [
        "simulate",
        "m.toml",
        "--drive",
        "step:1:0.1",
        "--out",
        "old.csv",
    ];
    says(&simulate, folder.path(), "--force");
    assert_eq!(bytes(folder.path(), "old.csv"), b"mine");
    assert!(
        hysteron(&[&simulate[..], &["--force"]].concat(), folder.path())
            .status
            .success()
    );
}

/// `--verbose` tells every step of the work: work that has not begun has no step.
#[test]
fn a_target_that_cannot_be_written_is_known_before_the_work_begins() {
    let folder = folder_with_model();
    std::fs::create_dir(folder.path().join("folder")).unwrap();
    for (target, expected) in [
        ("missing/m2.toml", "does not exist"),
        ("folder", "is a folder"),
        // Nobody may write there, not even root.
        #[cfg(target_os = "linux")]
        ("/proc/m2.toml", "cannot be written"),
    ] {
        for option in ["--out", "--json", "--report"] {
            let output = hysteron(
                &["explain", ".", "--verbose", option, target],
                folder.path(),
            );
            let said = String::from_utf8_lossy(&output.stderr).into_owned();
            assert_eq!(output.status.code(), Some(2), "{said}");
            assert!(said.contains(target) && said.contains(expected), "{said}");
            assert!(!said.contains("fitting"), "the work had begun: {said}");
        }
    }
    #[cfg(unix)]
    says(
        &words("identify . --effects gain --force --out /dev/null"),
        folder.path(),
        "is a device or a pipe",
    );
    let twice = ["explain", ".", "--out", "same", "--json", "same"];
    says(&twice, folder.path(), "written twice");
    let left: Vec<_> = std::fs::read_dir(folder.path())
        .unwrap()
        .map(|e| e.unwrap().file_name().into_string().unwrap())
        .collect();
    assert!(
        left.iter()
            .all(|name| !name.contains("trial") && !name.contains("part")),
        "{left:?}"
    );
}

/// What is written as a table is what the figures are of: the residual's RMS is that of the JSON, measured is
/// what was recorded, and the table is a recording again.
#[test]
fn signals_are_written_as_tables_that_fit_the_figures() {
    let folder = folder_to_search();
    let explained = hysteron(
        &words("explain . --series signals --json figures.json"),
        folder.path(),
    );
    assert_done(&explained);
    let figures: serde_json::Value =
        serde_json::from_slice(&bytes(folder.path(), "figures.json")).unwrap();
    for record in figures["records"].as_array().unwrap() {
        let name = record["file"].as_str().unwrap();
        let text = String::from_utf8(bytes(
            folder.path(),
            &format!("signals/{}.csv", name.trim_end_matches(".csv")),
        ))
        .unwrap();
        let mut lines = text.lines();
        assert_eq!(
            lines.next(),
            Some(
                "t_s,u_v,y_um,modelled_um,modelled_residual_um,modelled_at_start_um,modelled_at_start_residual_um"
            )
        );
        let rows: Vec<Vec<f64>> = lines
            .map(|line| line.split(',').map(|cell| cell.parse().unwrap()).collect())
            .collect();
        let rms_um = |column: usize| {
            (rows.iter().map(|r| r[column] * r[column]).sum::<f64>() / rows.len() as f64).sqrt()
        };
        assert!(
            (rms_um(4) - record["rms_um"].as_f64().unwrap()).abs() < 1e-6,
            "{name}: {} {}",
            rms_um(4),
            record["rms_um"]
        );
        assert!(
            rms_um(6) > 3.0 * rms_um(4),
            "{name}: the start is no better than the end"
        );
        assert!(
            rows.iter()
                .all(|r| (r[2] - r[3] - r[4]).abs() < 2e-6 && (r[2] - r[5] - r[6]).abs() < 2e-6)
        );
        let recorded = String::from_utf8(bytes(
            folder.path(),
            &format!("{}.csv", name.trim_end_matches(".csv")),
        ))
        .unwrap();
        for (row, line) in rows.iter().zip(recorded.lines().skip(1)) {
            let was: Vec<f64> = line.split(',').map(|cell| cell.parse().unwrap()).collect();
            assert!(
                row.iter()
                    .zip(&was)
                    .all(|(now, was)| (now - was).abs() < 1e-5),
                "{row:?} {was:?}"
            );
        }
    }
    says(
        &["explain", ".", "--series", "signals"],
        folder.path(),
        "--force",
    );
    says(
        &["explain", ".", "--series", "not/there"],
        folder.path(),
        "expected a new name in a folder that exists",
    );
    let again = hysteron(
        &["identify", "signals/a.csv", "--effects", "gain"],
        folder.path(),
    );
    assert_done(&again);
}

/// The sentence at the head of the page is that of the terminal, and its error that of the JSON.
#[test]
fn the_page_of_a_comparison_says_what_the_terminal_says() {
    let folder = folder_to_search();
    for role in ["validate", "identify"] {
        let manifest = std::fs::read_to_string(folder.path().join("dataset.toml")).unwrap();
        std::fs::write(
            folder.path().join("dataset.toml"),
            manifest.replace("\"validate\"", &format!("\"{role}\"")),
        )
        .unwrap();
        let made = hysteron(
            &words("identify . --effects gain --out m.toml --force"),
            folder.path(),
        );
        assert_done(&made);
        let compared = hysteron(
            &[
                "compare", "m.toml", ".", "--json", "c.json", "--report", "c.html", "--force",
            ],
            folder.path(),
        );
        let said = String::from_utf8_lossy(&compared.stdout).into_owned();
        let sentence = said
            .lines()
            .next()
            .and_then(|line| line.split_once(": "))
            .expect("a headline")
            .1;
        let page = String::from_utf8(bytes(folder.path(), "c.html")).unwrap();
        assert!(page.contains(sentence), "{sentence}");
        let figures: serde_json::Value =
            serde_json::from_slice(&bytes(folder.path(), "c.json")).unwrap();
        let records = figures["records"].as_array().unwrap();
        let rms_um = |role: &str| -> f64 {
            let squares: Vec<f64> = records
                .iter()
                .filter(|r| r["role"] == role)
                .map(|r| r["rms_um"].as_f64().unwrap().powi(2))
                .collect();
            // Records of one length.
            (squares.iter().sum::<f64>() / squares.len().max(1) as f64).sqrt()
        };
        let rms_nm = 1e3 * rms_um("identify").max(rms_um("validate"));
        let told: f64 = sentence
            .split_once("these records within ")
            .unwrap()
            .1
            .split(' ')
            .next()
            .unwrap()
            .parse()
            .unwrap();
        assert!((told / rms_nm - 1.0).abs() < 6e-3, "{told} {rms_nm}");
    }
}

#[test]
fn figures_for_the_screen_stand_there_alone() {
    let folder = folder_with_model();
    let output = hysteron(&words("compare m.toml . --json -"), folder.path());
    assert_done(&output);
    let figures: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(figures["schema"], "hysteron.fit/1");
    let files = std::fs::read_dir(folder.path()).unwrap().count();
    let output = hysteron(&words("explain a.csv --quiet"), folder.path());
    assert_done(&output);
    assert!(output.stdout.is_empty());
    assert_done(&hysteron(&words("explain a.csv --json -"), folder.path()));
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), files);
}
