//! `survey`: a row for each recording, whatever happens to its processes, and on from where it stopped.

use crate::common::{assert_done, hysteron, says, words};

use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

/// Recordings of a first-order lag behind a gain, one of which has another gain, and a file that is no
/// recording.
fn recordings(folder: &Path, count: usize) {
    let inside = folder.join("recordings");
    std::fs::create_dir(&inside).unwrap();
    for number in 0..count {
        let gain = 0.1 * (1.0 + 0.004 * (number * 37 % 8) as f64);
        let gain = if number == 3 { 0.15 } else { gain };
        let (mut text, mut y) = (String::from("t_s,u_v,y_um\n"), 0.0);
        for k in 0..1500 {
            let t = k as f64 * 1e-3;
            let u = 30.0 - 30.0 * (t * (20.0 + 40.0 * t)).cos();
            let noise = 1e-3 * ((k * 7919 + number * 104_729) % 1000) as f64 / 500.0;
            text.push_str(&format!("{t:.3},{u:.5},{:.5}\n", y + noise));
            y += (gain * u - y) * 0.4;
        }
        std::fs::write(inside.join(format!("day_{number:02}.csv")), text).unwrap();
    }
    std::fs::write(inside.join("notes.csv"), "nothing but words\n").unwrap();
}

/// The rows of a survey by their recordings.
fn rows(folder: &Path) -> Vec<serde_json::Value> {
    let text = std::fs::read_to_string(folder.join("survey.jsonl")).unwrap();
    let row = |line: &str| serde_json::from_str(line).unwrap();
    text.lines().skip(1).map(row).collect()
}

const SURVEY: &str = "survey recordings --from gain,sensor_bandwidth --report survey.html --json survey.json --force";

#[test]
fn a_survey_names_outliers_and_goes_on_where_it_stopped() {
    let folder = tempfile::tempdir().unwrap();
    recordings(folder.path(), 7);
    assert_done(&hysteron(&words(SURVEY), folder.path()));
    let first = rows(folder.path());
    assert_eq!(first.len(), 8);
    // A row was lost, and the last line was cut off.
    let file = folder.path().join("survey.jsonl");
    let text = std::fs::read_to_string(&file).unwrap();
    let lines: Vec<&str> = text.lines().collect();
    let cut = [lines[..6].join("\n"), lines[7][..40].to_owned()].join("\n");
    std::fs::write(&file, cut).unwrap();
    let output = hysteron(&words(SURVEY), folder.path());
    assert_done(&output);
    let said = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(said.contains("8 recordings, 5 of them known"), "{said}");
    let again = rows(folder.path());
    assert_eq!(again.len(), 8);
    // What was known is not computed again: to the last digit of the time that it took.
    assert_eq!(again[..5], first[..5]);
    let json = std::fs::read_to_string(folder.path().join("survey.json")).unwrap();
    let found: serde_json::Value = serde_json::from_str(&json).unwrap();
    let outliers = found["outliers"].as_array().unwrap();
    assert!(
        outliers
            .iter()
            .any(|o| o["recording"] == "day_03.csv" && o["in_what"].to_string().contains("gain")),
        "{outliers:?}"
    );
    let broken = found["rows"]
        .as_array()
        .unwrap()
        .iter()
        .find(|row| row["recording"] == "notes.csv");
    assert!(
        broken.unwrap()["error"]
            .as_str()
            .unwrap()
            .contains("notes.csv")
    );
    let page = std::fs::read_to_string(folder.path().join("survey.html")).unwrap();
    assert!(page.contains("day_03.csv") && page.contains("What stands out"));
    says(
        &["survey", "."],
        folder.path(),
        "survey.jsonl: has a row of day_0",
    );
    // What a survey wrote is no recording.
    let inside = folder.path().join("recordings");
    let here = [
        "survey",
        ".",
        "--from",
        "gain,sensor_bandwidth",
        "--report",
        "page.html",
    ];
    for _ in 0..2 {
        assert_done(&hysteron(&here, &inside));
        assert_eq!(rows(&inside).len(), 8);
        std::fs::rename(inside.join("page.html"), inside.join("first.html")).unwrap();
    }
}

#[test]
#[cfg(unix)]
fn what_a_survey_prints_into_a_file_is_no_recording() {
    let folder = tempfile::tempdir().unwrap();
    recordings(folder.path(), 3);
    let inside = folder.path().join("recordings");
    for _ in 0..2 {
        let into = |name: &str| {
            let mut file = std::fs::OpenOptions::new();
            file.create(true).append(true);
            file.open(inside.join(name)).unwrap()
        };
        let status = Command::new(env!("CARGO_BIN_EXE_hysteron"))
            .args(["survey", ".", "--from", "gain,sensor_bandwidth"])
            .current_dir(&inside)
            .stdout(into("log.txt"))
            .stderr(into("errors.txt"))
            .status();
        assert!(status.unwrap().success());
        assert_eq!(rows(&inside).len(), 4);
    }
}

/// The processes whose parent is this one.
#[cfg(target_os = "linux")]
fn children(parent: u32) -> Vec<u32> {
    let processes = std::fs::read_dir("/proc").unwrap().flatten();
    let ids = processes.filter_map(|entry| entry.file_name().to_string_lossy().parse().ok());
    let is_child = |id: &u32| {
        let stat = std::fs::read_to_string(format!("/proc/{id}/stat")).unwrap_or_default();
        // Behind the name in brackets: state, parent.
        let after = stat.rsplit(')').next().unwrap_or_default();
        after.split_whitespace().nth(1) == Some(parent.to_string().as_str())
    };
    ids.filter(is_child).collect()
}

#[test]
#[cfg(target_os = "linux")]
fn a_worker_that_is_killed_loses_no_recording() {
    let folder = tempfile::tempdir().unwrap();
    recordings(folder.path(), 7);
    let mut survey = Command::new(env!("CARGO_BIN_EXE_hysteron"))
        .args(words(SURVEY))
        .args(["--workers", "1"])
        .current_dir(folder.path())
        .stdout(Stdio::null())
        .spawn()
        .unwrap();
    let began = Instant::now();
    let worker = loop {
        if let Some(worker) = children(survey.id()).first() {
            break *worker;
        }
        assert!(
            began.elapsed() < Duration::from_secs(60),
            "no worker was started"
        );
        std::thread::sleep(Duration::from_millis(5));
    };
    let killed = Command::new("kill")
        .args(["-9", &worker.to_string()])
        .status()
        .unwrap();
    assert!(killed.success());
    assert!(survey.wait().unwrap().success());
    let rows = rows(folder.path());
    let errors: Vec<&serde_json::Value> = rows
        .iter()
        .filter(|row| row.get("error").is_some())
        .collect();
    assert_eq!((rows.len(), errors.len()), (8, 1), "{errors:?}");
    assert_eq!(errors[0]["recording"], "notes.csv");
}
