//! The guides in docs/ as somebody would follow them: their commands in their order, and what they say that
//! the program says.

use crate::common::{self, words};

use crate::stepping::{record_rig, recorded_rig};
use hysteron_sim::rig_effects::RigEffects;
use std::path::Path;

const EXAMPLE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../examples/hidden_effect");

/// Runs the commands of a guide in a folder; gives how many there were, and how many lines of their output
/// were compared.
fn followed(guide: &str, folder: &Path) -> (usize, usize) {
    let mut said = String::new();
    let (mut commands, mut compared) = (0, 0);
    // Every second part stands between fences: a program, no command.
    let shown = guide.split("```").step_by(2).flat_map(str::lines);
    for line in shown.filter_map(|line| line.strip_prefix("    ")) {
        if let Some(arguments) = line.strip_prefix("hysteron ") {
            let output = common::hysteron(&unquoted(arguments), folder);
            assert!(
                output.status.success(),
                "{line}: {}",
                String::from_utf8_lossy(&output.stderr)
            );
            said = String::from_utf8_lossy(&output.stdout).into_owned();
            commands += 1;
        } else {
            assert!(
                said.contains(line.trim_end()),
                "the guide shows\n{line}\nand the program said\n{said}"
            );
            compared += 1;
        }
    }
    (commands, compared)
}

/// The words of a command line, of which those between quotes are one.
fn unquoted(line: &str) -> Vec<&str> {
    line.split('"')
        .enumerate()
        .flat_map(|(part, text)| match part % 2 {
            0 => text.split_whitespace().collect(),
            _ => vec![text],
        })
        .collect()
}

fn require_files(folder: &Path, names: &[&str]) {
    for name in names {
        assert!(folder.join(name).is_file(), "{name}");
    }
}

#[test]
fn the_five_minutes_are_as_they_are_told() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::copy(
        Path::new(EXAMPLE).join("validation.csv"),
        folder.path().join("recording.csv"),
    )
    .unwrap();
    let guide = include_str!("../../../../docs/guides/five_minutes.md")
        .split("## From MATLAB")
        .next()
        .unwrap();
    let (commands, compared) = followed(guide, folder.path());
    assert!(
        commands >= 4 && compared >= 9,
        "{commands} commands, {compared} lines compared"
    );
    require_files(
        folder.path(),
        &[
            "model.toml",
            "report.html",
            "explain.json",
            "simulated.csv",
            "better.toml",
        ],
    );
}

#[test]
fn the_thirty_minutes_to_a_servo_are_as_they_are_told() {
    let folder = tempfile::tempdir().unwrap();
    let stage = folder.path().join("my_stage");
    std::fs::create_dir(&stage).unwrap();
    for entry in std::fs::read_dir(EXAMPLE).unwrap() {
        let path = entry.unwrap().path();
        std::fs::copy(&path, stage.join(path.file_name().unwrap())).unwrap();
    }
    let guide = include_str!("../../../../docs/guides/servo_in_thirty_minutes.md");
    let plant = guide.split("```").nth(1).unwrap();
    let plant = plant.strip_prefix("python\n").unwrap();
    std::fs::write(folder.path().join("my_stage.py"), plant).unwrap();
    let (commands, compared) = followed(guide, folder.path());
    assert!(
        commands >= 6 && compared >= 4,
        "{commands} commands, {compared} lines compared"
    );
    require_files(
        folder.path(),
        &[
            "servo.html",
            "check.html",
            "track.html",
            "servo.block",
            "servo.block.commands",
            "drives/drive_wideband.csv",
        ],
    );
}

#[test]
fn the_way_to_a_stick_slip_drive_is_as_it_is_told() {
    let folder = tempfile::tempdir().unwrap();
    record_rig(folder.path());
    // Another day the rig is tilted.
    let tilted = recorded_rig(RigEffects {
        tilt_rad: 0.015,
        ..RigEffects::default()
    });
    std::fs::rename(tilted.path(), folder.path().join("other_day")).unwrap();
    let guide = include_str!("../../../../docs/guides/stick_slip.md");
    let (commands, compared) = followed(guide, folder.path());
    assert!(
        commands >= 2 && compared >= 1,
        "{commands} commands, {compared} lines compared"
    );
    require_files(
        folder.path(),
        &[
            "platform.toml",
            "rig.toml",
            "rig.block",
            "stepping.html",
            "better.toml",
            "missing.html",
        ],
    );
}

#[test]
fn the_table_of_verdicts_is_the_same_wherever_it_stands() {
    let table = |page: &'static str| -> Vec<&'static str> {
        let lines = page
            .lines()
            .skip_while(|line| !line.starts_with("| verdict |"));
        lines.take_while(|line| line.starts_with('|')).collect()
    };
    let readme = table(include_str!("../../../../README.md"));
    assert_eq!(readme.len(), 7);
    assert_eq!(
        readme,
        table(include_str!("../../../../docs/reference/method.md"))
    );
}

/// A session as docs/guides/recording.md asks for it: the drives one after another on one simulated actuator,
/// whose history goes on.
#[test]
fn a_session_with_the_recommended_drives_is_read_by_their_manifest_and_explained() {
    let folder = tempfile::tempdir().unwrap();
    let run = |arguments: &[&str]| {
        let output = common::hysteron(arguments, folder.path());
        assert!(
            output.status.success(),
            "{arguments:?}: {}",
            String::from_utf8_lossy(&output.stderr)
        );
        String::from_utf8_lossy(&output.stdout).into_owned()
    };
    let start = "hysteresis,initial_curve,vibration";
    run(&[
        "explain",
        EXAMPLE,
        "--from",
        start,
        "--out",
        "actuator.toml",
    ]);
    run(&["drives", "--drive-max-v", "70", "--out", "drives"]);
    let recording = include_str!("../../../../docs/guides/recording.md");
    let drives = folder.path().join("drives");
    for entry in std::fs::read_dir(&drives).unwrap() {
        let path = entry.unwrap().path();
        let Some(name) = path
            .file_name()
            .and_then(|n| n.to_str())
            .and_then(|n| n.strip_prefix("drive_"))
        else {
            continue;
        };
        assert!(
            recording.contains(&format!("`{}`", name.trim_end_matches(".csv"))),
            "{name} is on the page"
        );
        let text = std::fs::read_to_string(&path).unwrap();
        let rows: Vec<Vec<f64>> = text
            .lines()
            .skip(1)
            .map(|row| row.split(',').map(|cell| cell.parse().unwrap()).collect())
            .collect();
        let rate_hz = ((rows.len() - 1) as f64 / rows[rows.len() - 1][0]).round();
        // What was played before: for all but the first drive the actuator has been over its range, and
        // rested.
        let before: Vec<f64> = match name {
            "stair.csv" => Vec::new(),
            _ => {
                let cycle = (0..rate_hz as usize)
                    .map(|k| 35.0 - 35.0 * (std::f64::consts::TAU * k as f64 / rate_hz).cos());
                cycle
                    .chain(std::iter::repeat_n(0.0, rate_hz as usize))
                    .collect()
            }
        };
        let all = before
            .iter()
            .copied()
            .chain(rows.iter().map(|row| row[1]))
            .enumerate();
        let played: String = all
            .map(|(k, u)| format!("{:.6},{u:.5}\n", k as f64 / rate_hz))
            .collect();
        std::fs::write(
            folder.path().join("played.csv"),
            format!("t_s,u_v\n{played}"),
        )
        .unwrap();
        run(&words(
            "simulate actuator.toml --drive played.csv --out read.csv --force",
        ));
        let read = std::fs::read_to_string(folder.path().join("read.csv")).unwrap();
        let noise =
            |k: usize| 0.014 * (((k as f64 * 12.9898).sin() * 43_758.545_3).rem_euclid(1.0) - 0.5);
        let recorded = read
            .lines()
            .skip(1 + before.len())
            .zip(&rows)
            .enumerate()
            .map(|(k, (line, row))| {
                let y: f64 = line.split(',').nth(2).unwrap().parse().unwrap();
                format!("{:.6},{:.5},{:.6}\n", row[0], row[1], y + noise(k))
            });
        std::fs::write(
            drives.join(name),
            format!("t_s,u_v,y_um\n{}", recorded.collect::<String>()),
        )
        .unwrap();
    }
    let said = run(&["explain", "drives", "--from", start]);
    assert!(said.starts_with("my_stage: Creep is missing"), "{said}");
}
