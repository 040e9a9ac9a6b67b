//! The recording of a stick-slip drive, measured.

use crate::common::hysteron;
use hysteron::rig_diagnosis::planted::{NOISE_UM, rig_drives};
use hysteron::servo::stepping_rig;
use hysteron_sim::rig_effects::RigEffects;
use hysteron_sim::stick_slip::StickSlipActuator;
use hysteron_sim::waveform;
use std::fmt::Write;
use std::path::Path;

const SAMPLE_RATE_HZ: f64 = 20_000.0;

fn csv(drive_v: &[f64], reading_um: &[f64]) -> String {
    let mut csv = "t_s,u_v,y_um\n".to_owned();
    for (k, (u, y)) in drive_v.iter().zip(reading_um).enumerate() {
        writeln!(csv, "{:.5},{u:.5},{y:.5}", k as f64 / SAMPLE_RATE_HZ).unwrap();
    }
    csv
}

/// Two trains with a rest behind each, without noise.
fn recording() -> String {
    let mut drive_v = vec![0.0; 100];
    for (frequency_hz, height_v) in [(50.0, 50.0), (80.0, 70.0)] {
        drive_v.extend(waveform::saw_tooth(
            SAMPLE_RATE_HZ,
            frequency_hz,
            height_v,
            1.0,
            12,
        ));
        drive_v.extend([0.0; 600]);
    }
    let motion = StickSlipActuator::thesis(0.0635).simulate(&drive_v, SAMPLE_RATE_HZ);
    csv(&drive_v, &motion.end_effector_um)
}

#[test]
fn a_stick_slip_recording_is_measured() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("rig.csv"), recording()).unwrap();
    let arguments = [
        "stepping", "rig.csv", "--json", "rig.json", "--report", "rig.html",
    ];
    let output = hysteron(&arguments, folder.path());
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{errors}");
    let text = std::fs::read_to_string(folder.path().join("rig.json")).unwrap();
    let figures: serde_json::Value = serde_json::from_str(&text).unwrap();
    let trains = figures["trains"].as_array().unwrap();
    assert_eq!(
        trains.len(),
        2,
        "{}",
        String::from_utf8_lossy(&output.stdout)
    );
    // Chapter 3: the speed grows with amplitude and frequency.
    let velocity = |nth: usize| trains[nth]["velocity_um_s"]["value"].as_f64().unwrap();
    assert!(velocity(0) > 50.0 && velocity(1) > 1.5 * velocity(0));
    let page = std::fs::read_to_string(folder.path().join("rig.html")).unwrap();
    assert!(page.contains("Trains of saw-teeth"));
}

#[test]
fn a_recording_without_saw_teeth_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let drive_v: Vec<f64> = (0..2000)
        .map(|k| 25.0 - 25.0 * (0.02 * f64::from(k)).cos())
        .collect();
    let reading_um: Vec<f64> = drive_v.iter().map(|u| 0.1 * u).collect();
    std::fs::write(folder.path().join("sine.csv"), csv(&drive_v, &reading_um)).unwrap();
    let output = hysteron(&["stepping", "sine.csv"], folder.path());
    let errors = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2));
    assert!(
        errors.contains("sine.csv") && errors.contains("saw-teeth"),
        "{errors}"
    );
}

/// Records the platform without the slider, and the slider under saw-teeth.
pub fn record_rig(folder: &Path) {
    record_rig_after(400, folder);
}

/// The same, the slider after a rest of so many samples.
fn record_rig_after(rest: usize, folder: &Path) {
    let rig = StickSlipActuator::thesis(0.0635);
    let mut noise = hysteron::WhiteNoise::new(0.003, 5);
    let mut noisy = |y: &[f64]| -> Vec<f64> { y.iter().map(|y| y + noise.next_um()).collect() };
    let vertices = [
        0.0, 20.0, 5.0, 40.0, 10.0, 60.0, 20.0, 80.0, 0.0, 100.0, 0.0, 70.0, 30.0, 90.0, 0.0,
    ];
    let mut drive_v = vec![0.0; 400];
    drive_v.extend(waveform::triangles(SAMPLE_RATE_HZ, 2000.0, &vertices));
    drive_v.extend([40.0; 600].iter().chain(&[0.0; 800]));
    drive_v.extend([90.0; 600].iter().chain(&[0.0; 800]));
    let platform = rig.simulate(&drive_v, SAMPLE_RATE_HZ).platform_um;
    std::fs::write(
        folder.join("platform.csv"),
        csv(&drive_v, &noisy(&platform)),
    )
    .unwrap();
    let mut drive_v = vec![0.0; rest];
    drive_v.extend(waveform::saw_tooth(SAMPLE_RATE_HZ, 60.0, 50.0, 1.0, 6));
    drive_v.extend([0.0; 400]);
    let slider = rig.simulate(&drive_v, SAMPLE_RATE_HZ).end_effector_um;
    std::fs::write(folder.join("slider.csv"), csv(&drive_v, &noisy(&slider))).unwrap();
}

#[test]
fn the_contact_is_identified_from_recordings_of_platform_and_slider() {
    let folder = tempfile::tempdir().unwrap();
    // A rest that is a record of its own and shows the noise.
    record_rig_after(1200, folder.path());
    for line in [
        "identify platform.csv --effects hysteresis,vibration --out platform.toml",
        "stepping slider.csv --platform platform.toml --slider-kg 0.0635 --platform-stiffness-n-um 45 --json rig.json",
    ] {
        let arguments: Vec<&str> = line.split_whitespace().collect();
        let output = hysteron(&arguments, folder.path());
        let text = String::from_utf8_lossy(&output.stdout);
        println!("{text}");
        assert!(
            output.status.success(),
            "{}",
            String::from_utf8_lossy(&output.stderr)
        );
        assert_eq!(
            line.starts_with("stepping"),
            text.contains("fastest saw-teeth")
        );
    }
    let text = std::fs::read_to_string(folder.path().join("rig.json")).unwrap();
    let figures: serde_json::Value = serde_json::from_str(&text).unwrap();
    let found = |name: &str| figures["contact"][name]["value"].as_f64().unwrap();
    let load = &figures["load_that_stops_n"];
    let [load_n, std_n] = ["value", "std"].map(|name| load[name].as_f64().unwrap());
    assert!(load_n < 0.0362 && std_n < 0.1 * load_n, "{load}");
    // The platform's model has an error of its own, so the deviations of the contact alone do not bound these.
    assert!(
        (found("coulomb_force_n") / 0.0362 - 1.0).abs() < 0.03,
        "{text}"
    );
    assert!(
        (found("stiffness_n_um") / 0.482 - 1.0).abs() < 0.06,
        "{text}"
    );
}

/// A folder with the rig that was identified, and recordings of it with these effects.
pub fn recorded_rig(effects: RigEffects) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let mut rig = StickSlipActuator::thesis(0.0635);
    let text = stepping_rig::to_toml(&rig).unwrap();
    std::fs::write(folder.path().join("rig.toml"), text).unwrap();
    rig.effects = effects;
    let mut manifest = "name = \"rig\"\ndrive_min_v = 0.0\ndrive_max_v = 100.0\n".to_owned();
    for (nth, (name, role, drive_v)) in rig_drives(3).into_iter().enumerate() {
        let mut noise = hysteron::WhiteNoise::new(NOISE_UM, nth as u64);
        let reading_um = rig.simulate(&drive_v, SAMPLE_RATE_HZ).reading_um;
        let reading_um: Vec<f64> = reading_um.iter().map(|y| y + noise.next_um()).collect();
        let rows = csv(&drive_v, &reading_um);
        std::fs::write(folder.path().join(format!("{name}.csv")), rows).unwrap();
        let role = role.name();
        writeln!(
            manifest,
            "\n[[record]]\nfile = \"{name}.csv\"\nrole = \"{role}\"\ninitial_state = \"virgin\""
        )
        .unwrap();
    }
    std::fs::write(folder.path().join("dataset.toml"), manifest).unwrap();
    folder
}

/// Explains the recordings of a folder, and gives the figures.
fn explained(folder: &Path) -> serde_json::Value {
    let arguments = [
        "explain",
        ".",
        "--from",
        "rig.toml",
        "--out",
        "better.toml",
        "--json",
        "found.json",
        "--report",
        "found.html",
    ];
    let output = hysteron(&arguments, folder);
    println!("{}", String::from_utf8_lossy(&output.stdout));
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{errors}");
    let page = std::fs::read_to_string(folder.join("found.html")).unwrap();
    assert!(page.contains("What is missing") && page.contains("held out"));
    serde_json::from_str(&std::fs::read_to_string(folder.join("found.json")).unwrap()).unwrap()
}

#[test]
fn a_tilt_of_the_rig_is_named_and_its_model_is_written() {
    let tilt_rad = 0.015;
    let folder = recorded_rig(RigEffects {
        tilt_rad,
        ..RigEffects::default()
    });
    let found = explained(folder.path());
    assert_eq!(found["verdict"], "named", "{found}");
    assert_eq!(found["findings"][0]["effects"], serde_json::json!(["tilt"]));
    let held_out = found["residual_rms_after_um"]["validate"].as_f64().unwrap();
    assert!((held_out / NOISE_UM - 1.0).abs() < 0.05, "{held_out}");
    let text = std::fs::read_to_string(folder.path().join("better.toml")).unwrap();
    let rig = stepping_rig::from_toml(&text, "better.toml").unwrap();
    assert!(
        (rig.effects.tilt_rad / tilt_rad - 1.0).abs() < 0.02,
        "{text}"
    );
}

#[test]
fn a_rig_without_anything_hidden_names_nothing() {
    let found = explained(recorded_rig(RigEffects::default()).path());
    assert_eq!(found["verdict"], "at_floor", "{found}");
    assert_eq!(found["findings"], serde_json::json!([]));
}

#[test]
fn recordings_and_rigs_that_do_not_suit_are_refused() {
    let folder = recorded_rig(RigEffects::default());
    let rig = std::fs::read_to_string(folder.path().join("rig.toml")).unwrap();
    let up = std::fs::read_to_string(folder.path().join("up.csv")).unwrap();
    let file = |name: &str, text: String| std::fs::write(folder.path().join(name), text).unwrap();
    file(
        "negative.toml",
        rig.replace("coulomb_force_n = ", "coulomb_force_n = -"),
    );
    file("surface.toml", rig.replace("g_um = [[", "g_um = [[], ["));
    file("effect.toml", format!("{rig}\n[effects]\ntilt_rad = 7.0\n"));
    file(
        "short.toml",
        rig.replace("drive_range_v = 100.0", "drive_range_v = 20.0"),
    );
    file(
        "late.csv",
        up.lines()
            .take(1)
            .chain(up.lines().skip(1200))
            .collect::<Vec<_>>()
            .join("\n"),
    );
    file(
        "few.csv",
        up.lines().take(40).collect::<Vec<_>>().join("\n"),
    );
    let with_heat = |line: (usize, &str)| match line {
        (0, head) => format!("{head},heat"),
        (_, row) => format!("{row},20"),
    };
    let heated: Vec<String> = up.lines().enumerate().map(with_heat).collect();
    file("heated.csv", heated.join("\n"));
    for (data, from, expected) in [
        ("up.csv", "negative.toml", "coulomb_force_n"),
        ("up.csv", "surface.toml", "g_um"),
        ("up.csv", "effect.toml", "tilt_rad"),
        ("up.csv", "short.toml", "20 V"),
        ("late.csv", "rig.toml", "from rest at 0 V"),
        ("few.csv", "rig.toml", "samples"),
    ] {
        let output = hysteron(&["explain", data, "--from", from], folder.path());
        let errors = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{data} {from}: {errors}");
        assert!(errors.contains(expected), "{data} {from}: {errors}");
        assert!(!errors.contains("panicked"), "{errors}");
    }
    for (command, expected) in [
        (
            &["compare", "rig.toml", "up.csv"][..],
            "this is a stick-slip rig, not a model",
        ),
        (
            &[
                "explain",
                "heated.csv",
                "--from",
                "rig.toml",
                "--auxiliary",
                "heat=4",
            ][..],
            "heat: has no effect for a stick-slip rig; expected the column platform_um",
        ),
    ] {
        let output = hysteron(command, folder.path());
        let errors = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{errors}");
        assert!(errors.contains(expected), "{errors}");
    }
}
