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

/// Numbers in a text, in their order.
fn numbers(text: &str) -> Vec<f64> {
    text.split(|c: char| !c.is_ascii_digit() && c != '.').filter_map(|word| word.trim_matches('.').parse().ok()).collect()
}

#[test]
fn what_a_design_says_is_so_and_what_it_cannot_do_is_refused() {
    let folder = folder();
    let folder = folder.path();
    let example = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../examples/hidden_effect");
    let example = example.to_string_lossy();

    // The parts of the expected error come to the whole.
    let said = done(&["design", "m.toml", "--data", &example, "--out", "d.toml"], folder);
    let sentence = said.split("expected error, ").nth(1).unwrap_or_default();
    let [whole, noise, _, at_once, _, slow, ..] = numbers(sentence)[..] else { panic!("{said}") };
    assert!((whole - noise.hypot(at_once).hypot(slow)).abs() < 0.015, "{sentence}");

    // Periods that are too short or too long for the memory.
    for (hz, expected) in [("9999", "4.9 to 277 Hz"), ("278", "4.9 to 277 Hz"), ("4", "4.9 to 277 Hz")] {
        let arguments = ["design", "m.toml", "--data", &example, "--learning", "--reference-hz", hz, "--out", "no.toml"];
        says(&arguments, folder, expected);
    }
    // Slower than that nothing is said of it where nothing is learned.
    done(&["design", "m.toml", "--data", &example, "--reference-hz", "4", "--out", "slow.toml"], folder);

    // A recording of a stage with ten times the gain.
    let arguments = ["design", "weak.toml", "--data", &example, "--out", "no.toml"];
    says(&arguments, folder, "is not of the stage that this model describes");
    says(&arguments, folder, "times its displacement it would leave");
    assert!(!folder.join("no.toml").exists());

    // A bandwidth of the sensor that is said is undone, and told beside the errors.
    let late = done(&["design", "m.toml", "--data", &example, "--sensor-bandwidth-hz", "10000", "--out", "late.toml"], folder);
    assert!(late.contains("15.9 us late"), "{late}");
    let tracked = done(&["track", "m.toml", "late.toml", "--reference", "sine:50:3"], folder);
    assert!(tracked.contains("reads 15.9 us late, which the servo undoes"), "{tracked}");
    says(&["design", "m.toml", "--sensor-bandwidth-hz=50", "--out", "no.toml"], folder, "expected at least 160");
}

#[test]
fn an_unstable_loop_is_told_with_the_criterion_that_it_breaks() {
    let folder = folder();
    let folder = folder.path();
    let text = std::fs::read_to_string(folder.join("m.toml")).unwrap();
    let mut strong = hysteron::model_file::from_toml(&text, "m.toml").unwrap();
    for effect in strong.effects.iter_mut().filter(|e| e.id == "hysteresis" || e.id == "initial_curve") {
        effect.parameters.iter_mut().for_each(|p| p.value *= 7.0);
    }
    std::fs::write(folder.join("strong.toml"), hysteron::model_file::to_toml(&strong, "strong").unwrap()).unwrap();
    let output = hysteron(&["check", "s.toml", "--model", "strong.toml"], folder);
    let said = String::from_utf8_lossy(&output.stdout).into_owned();
    assert_eq!(output.status.code(), Some(1), "{said}");
    let eigenvalue = said.lines().next().and_then(|line| line.split("the largest eigenvalue with the mean gain is ").nth(1));
    assert!(eigenvalue.and_then(|v| v.parse::<f64>().ok()).is_some_and(|v| v >= 1.0), "{said}");
}
