//! `track --plant`: a program of the user closes the loop.

use crate::common;

use common::{hysteron, says};
use std::path::Path;

/// A stage of 0.1 um/V with a mode of 1 kHz, stepped exactly enough at 20 kHz, that is 0.2 um off its reading.
const STAGE: &str = r#"
import math, os, sys
period = float(os.environ["HYSTERON_PERIOD_S"])
steps, y, v = 20, 0.0, 0.0
w, xi, h = 2 * math.pi * 1000, 0.3, period / 20
for line in sys.stdin:
    force = 0.1 * float(line)
    for _ in range(steps):
        v += h * (w * w * (force - y) - 2 * xi * w * v)
        y += h * v
    print(y + 0.2, y, flush=True)
"#;

const DIES: &str = r#"
import sys
for n, line in enumerate(sys.stdin):
    if n == 3:
        raise SystemExit("the cable is off")
    print(0.0, flush=True)
"#;

/// A folder with the stage, its model `m.toml` and a servo for it, `s.toml`.
fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let overview = hysteron::Overview::without_data(0.0, 100.0);
    let mut model = hysteron::Model::new(0.0, 100.0);
    for (id, values) in [
        ("gain", &[0.1][..]),
        ("vibration", &[std::f64::consts::TAU * 1000.0, 0.3]),
    ] {
        let effect = hysteron::effect_named(id).unwrap();
        model.add(hysteron::EffectInstance::new(effect, &overview, values));
    }
    let text = hysteron::model_file::to_toml(&model, "a stage in Python").unwrap();
    std::fs::write(folder.path().join("m.toml"), text).unwrap();
    for (name, text) in [
        ("stage.py", STAGE),
        ("dies.py", DIES),
        ("talks.py", "input()\nprint('ready', flush=True)\ninput()"),
    ] {
        std::fs::write(folder.path().join(name), text).unwrap();
    }
    let design = ["design", "m.toml", "--out", "s.toml"];
    assert!(hysteron(&design, folder.path()).status.success());
    folder
}

fn track(plant: &str) -> Vec<&str> {
    let mut out = vec!["track", "m.toml", "s.toml", "--reference", "sine:50:2"];
    out.extend(["--plant", plant]);
    out
}

fn true_rms_um(arguments: &[&str], folder: &Path) -> f64 {
    let output = hysteron(arguments, folder);
    assert!(output.status.success(), "{output:?}");
    let text = std::fs::read_to_string(folder.join("t.json")).unwrap();
    let json: serde_json::Value = serde_json::from_str(&text).unwrap();
    json["true"]["rms_um"].as_f64().unwrap()
}

#[test]
fn a_python_stage_is_followed_as_its_model_is() {
    let folder = folder();
    let json = ["--json", "t.json", "--force", "--sensor-noise-um", "0"];
    let own = [track("python3 stage.py"), json.to_vec()].concat();
    let model = [track("")[..5].to_vec(), json.to_vec()].concat();
    let [own, model] = [own, model].map(|a| true_rms_um(&a, folder.path()));
    assert!(own < 0.002 && (own - model).abs() < 3e-4, "{own} {model}");
}

#[test]
fn a_plant_that_fails_is_one_message() {
    let folder = folder();
    let folder = folder.path();
    for (plant, said) in [
        ("python3 dies.py", "ended after 3 answers"),
        ("python3 dies.py", "the cable is off"),
        ("python3 talks.py", "answers `ready` in line 1"),
        (
            "no_such_program_here",
            "cannot start `no_such_program_here`",
        ),
        ("", "is empty"),
    ] {
        says(&track(plant), folder, said);
    }
    let loaded = [track("python3 stage.py"), vec!["--added-mass", "1"]].concat();
    assert_eq!(hysteron(&loaded, folder).status.code(), Some(2));
}
