//! A servo on the actuator that it was made for, and on another one.

mod common;

use common::{hysteron, says};
use std::path::{Path, PathBuf};
use tempfile::TempDir;

/// A folder with a model of the example, `m.toml`, a servo for it, `s.toml`, and a model of an actuator with a tenth of the travel, `weak.toml`.
fn folder() -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    let example = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../examples/hidden_effect");
    let effects = "hysteresis,initial_curve,vibration,creep";
    done(&["identify", &example.to_string_lossy(), "--effects", effects, "--out", "m.toml"], folder.path());
    done(&["design", "m.toml", "--out", "s.toml"], folder.path());
    let text = std::fs::read_to_string(folder.path().join("m.toml")).unwrap();
    let mut weak = hysteron::model_file::from_toml(&text, "m.toml").unwrap();
    for effect in weak.effects.iter_mut().filter(|e| e.id == "hysteresis" || e.id == "initial_curve") {
        effect.parameters.iter_mut().for_each(|p| p.value *= 0.1);
    }
    std::fs::write(folder.path().join("weak.toml"), hysteron::model_file::to_toml(&weak, "weak").unwrap()).unwrap();
    folder
}

fn done(arguments: &[&str], folder: &Path) -> String {
    let output = hysteron(arguments, folder);
    assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8_lossy(&output.stdout).into_owned()
}

#[test]
fn a_servo_is_judged_on_the_model_that_is_named() {
    let folder = folder();
    let folder = folder.path();
    says(&["design", "m.toml", "--out", "t.toml", "--sensor-noise-um=-1"], folder, "expected above 0");
    assert!(!folder.join("t.toml").exists());

    let own = done(&["check", "s.toml", "--model", "m.toml", "--report", "page.html"], folder);
    let page = std::fs::read_to_string(folder.join("page.html")).unwrap();
    assert!(page.len() > 10_000, "{own}");
    let other = String::from_utf8_lossy(&hysteron(&["check", "s.toml", "--model", "weak.toml"], folder).stdout).into_owned();
    let margins = |text: &str| text.lines().find(|l| l.contains("gain margin")).map(str::to_owned);
    assert!(margins(&own).is_some() && margins(&own) != margins(&other), "{own}\n{other}");

    done(&["track", "m.toml", "s.toml", "--reference", "sine:50:3"], folder);
    says(&["track", "weak.toml", "s.toml", "--reference", "sine:50:3"], folder, "the drive reaches 0 to");
    says(&["track", "m.toml", "s.toml", "--reference", "sine:1e-9:3"], folder, "at least 0.01 Hz");

    // An edited file with a value that no sensor and no mode has.
    let text = std::fs::read_to_string(folder.join("s.toml")).unwrap();
    for (key, value) in [("sensor_noise_um", "0.0"), ("natural_frequency_rad_s", "nan")] {
        let edited: Vec<String> =
            text.lines().map(|l| if l.starts_with(key) { format!("{key} = {value}") } else { l.to_owned() }).collect();
        std::fs::write(folder.join("edited.toml"), edited.join("\n")).unwrap();
        says(&["check", "edited.toml", "--model", "m.toml"], folder, key);
    }
}
