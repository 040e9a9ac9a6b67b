//! The guides in docs/ as somebody would follow them: their commands in their order, and what they say that the program says.

mod common;

use std::path::Path;

const EXAMPLE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../examples/hidden_effect");

/// Runs the commands of a guide in a folder; gives how many there were, and how many lines of their output were compared.
fn followed(guide: &str, folder: &Path) -> (usize, usize) {
    let mut said = String::new();
    let (mut commands, mut compared) = (0, 0);
    for line in guide.lines().filter_map(|line| line.strip_prefix("    ")) {
        if let Some(arguments) = line.strip_prefix("hysteron ") {
            let output = common::hysteron(&arguments.split_whitespace().collect::<Vec<_>>(), folder);
            assert!(output.status.success(), "{line}: {}", String::from_utf8_lossy(&output.stderr));
            said = String::from_utf8_lossy(&output.stdout).into_owned();
            commands += 1;
        } else {
            assert!(said.contains(line.trim_end()), "the guide shows\n{line}\nand the program said\n{said}");
            compared += 1;
        }
    }
    (commands, compared)
}

fn require_files(folder: &Path, names: &[&str]) {
    for name in names {
        assert!(folder.join(name).is_file(), "{name}");
    }
}

#[test]
fn the_five_minutes_are_as_they_are_told() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::copy(Path::new(EXAMPLE).join("validation.csv"), folder.path().join("recording.csv")).unwrap();
    let guide = include_str!("../../../docs/five_minutes.md").split("## From MATLAB").next().unwrap();
    let (commands, compared) = followed(guide, folder.path());
    assert!(commands >= 4 && compared >= 9, "{commands} commands, {compared} lines compared");
    require_files(folder.path(), &["model.toml", "report.html", "explain.json", "simulated.csv", "better.toml"]);
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
    let (commands, compared) = followed(include_str!("../../../docs/servo_in_thirty_minutes.md"), folder.path());
    assert!(commands >= 6 && compared >= 4, "{commands} commands, {compared} lines compared");
    require_files(
        folder.path(),
        &["servo.html", "check.html", "track.html", "servo.block", "servo.block.commands", "drives/drive_wideband.csv"],
    );
}

#[test]
fn what_is_recorded_with_the_recommended_drives_is_read_by_their_manifest() {
    let folder = tempfile::tempdir().unwrap();
    let recording = include_str!("../../../docs/recording.md");
    assert_eq!(followed(recording, folder.path()).0, 1);
    let drives = folder.path().join("drives");
    for entry in std::fs::read_dir(&drives).unwrap() {
        let path = entry.unwrap().path();
        let Some(name) = path.file_name().and_then(|n| n.to_str()).and_then(|n| n.strip_prefix("drive_")) else { continue };
        assert!(recording.contains(&format!("`{}`", name.trim_end_matches(".csv"))), "{name} is on the page");
        // A straight line with noise: what the manifest makes of it is looked at, not what is found.
        let text = std::fs::read_to_string(&path).unwrap();
        let rows = text.lines().skip(1).enumerate().map(|(k, row)| {
            let u: f64 = row.split(',').nth(1).unwrap().parse().unwrap();
            format!("{row},{:.6}\n", 0.1 * u + 1e-3 * ((k as f64 * 12.9898).sin() * 43_758.545_3).rem_euclid(1.0))
        });
        std::fs::write(drives.join(name), format!("t_s,u_v,y_um\n{}", rows.collect::<String>())).unwrap();
    }
    let output = common::hysteron(&["identify", "drives", "--effects", "gain", "--out", "model.toml"], folder.path());
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
}
