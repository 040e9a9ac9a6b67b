//! The examples of docs/reference/own_effects.md, taken from the page and fitted to simulations that know
//! nothing of them: the values come back.

use crate::common;

use common::{assert_done, hysteron, words};
use std::path::Path;

const RATE_HZ: f64 = 1000.0;
/// Noise of the readings, um RMS.
const NOISE_UM: f64 = 1e-3;

/// The definition on the page with this name.
fn definition(id: &str) -> String {
    let page = std::fs::read_to_string(
        Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/reference/own_effects.md"),
    )
    .unwrap();
    let blocks: Vec<&str> = page
        .split("```toml\n")
        .skip(1)
        .filter_map(|block| block.split("```").next())
        .collect();
    blocks
        .into_iter()
        .find(|block| block.starts_with(&format!("id = \"{id}\"")))
        .unwrap_or_else(|| panic!("{id} is on the page"))
        .to_owned()
}

/// Even noise of unit variance.
fn noise(k: usize) -> f64 {
    12.0_f64.sqrt() * (((k as f64 * 12.9898).sin() * 43_758.545_3).rem_euclid(1.0) - 0.5)
}

/// Two recordings, one to fit and one that judges; `reading_um` turns a drive into what a noiseless sensor
/// reads at the same instants.
fn recordings(folder: &Path, drives: [Vec<f64>; 2], reading_um: impl Fn(&[f64]) -> Vec<f64>) {
    let mut manifest = String::from("name = \"own\"\ndrive_min_v = 0.0\ndrive_max_v = 60.0\n");
    for (name, role, drive_v) in [("a", "identify", &drives[0]), ("b", "validate", &drives[1])] {
        let rows = drive_v.iter().zip(reading_um(drive_v)).enumerate();
        let rows = rows.map(|(k, (u, y))| {
            format!(
                "{:.3},{u:.9},{:.9}\n",
                k as f64 / RATE_HZ,
                y + NOISE_UM * noise(k)
            )
        });
        std::fs::write(
            folder.join(format!("{name}.csv")),
            format!("t_s,u_v,y_um\n{}", rows.collect::<String>()),
        )
        .unwrap();
        manifest += &format!(
            "[[record]]\nfile = \"{name}.csv\"\nsample_rate_hz = {RATE_HZ:.1}\nrole = \"{role}\"\ninitial_state = \"virgin\"\n"
        );
    }
    std::fs::write(folder.join("dataset.toml"), manifest).unwrap();
}

/// Fits the example beside a gain; its values by name, after the errors of both recordings were seen to be
/// the noise.
fn fitted(folder: &Path, id: &str) -> impl Fn(&str) -> f64 {
    std::fs::write(folder.join("own.toml"), definition(id)).unwrap();
    let output = hysteron(
        &words("identify . --effects gain,own.toml --json fit.json"),
        folder,
    );
    assert_done(&output);
    let figures: serde_json::Value =
        serde_json::from_slice(&std::fs::read(folder.join("fit.json")).unwrap()).unwrap();
    for record in figures["records"].as_array().unwrap() {
        let rms_um = record["rms_um"].as_f64().unwrap();
        assert!(
            rms_um < 1.1 * NOISE_UM,
            "{id}, {}: {rms_um} um",
            record["file"]
        );
    }
    move |name| {
        let all = figures["parameters"].as_array().unwrap();
        all.iter()
            .find(|p| p["name"] == name)
            .and_then(|p| p["value"].as_f64())
            .unwrap_or_else(|| panic!("{name} in {all:?}"))
    }
}

fn within(value: f64, expected: f64, share: f64) {
    assert!(
        (value / expected - 1.0).abs() < share,
        "{value} instead of {expected}"
    );
}

/// A cosine from 0 V with a slowly varying width.
fn swelling(samples: usize, hz: f64) -> Vec<f64> {
    let t = |k: usize| k as f64 / RATE_HZ;
    (0..samples)
        .map(|k| {
            28.0 * (1.0 - (std::f64::consts::TAU * hz * t(k)).cos())
                * (0.6 + 0.4 * (1.7 * t(k)).cos())
        })
        .collect()
}

#[test]
fn a_gain_that_warms_up() {
    let folder = tempfile::tempdir().unwrap();
    let (gain, warming, tau_s) = (0.1, 2e-6, 1.2);
    // The heat in closed form over each period, in which the speed is constant.
    recordings(
        folder.path(),
        [swelling(6000, 10.0), swelling(6000, 14.0)],
        |drive_v| {
            let (mut heat, mut before, mut reading) = (0.0, 0.0, Vec::new());
            let kept = (-1.0 / (RATE_HZ * tau_s)).exp();
            reading.push(0.0);
            for u in drive_v {
                let x = gain * u;
                let power = warming * ((x - before) * RATE_HZ).powi(2);
                heat = kept * heat + (1.0 - kept) * tau_s * power;
                before = x;
                reading.push(x * (1.0 + heat));
            }
            reading
        },
    );
    let value = fitted(folder.path(), "self_heating");
    within(value("gain_um_v"), gain, 0.01);
    within(value("warming"), warming, 0.05);
    within(value("tau_s"), tau_s, 0.05);
}

#[test]
fn jiles_and_atherton() {
    let folder = tempfile::tempdir().unwrap();
    let (gain, strength, shape, pinning) = (0.08, 12.0, 40.0, 10.0);
    // Rate-independent: along the drive in a thousand small steps a sample, without any time.
    recordings(
        folder.path(),
        [swelling(3000, 2.0), swelling(3000, 3.1)],
        |drive_v| {
            let (mut p, mut before, mut reading) = (0.0_f64, 0.0, vec![0.0]);
            for u in drive_v {
                let step = (u - before) / 1000.0;
                for i in 0..1000 {
                    let field = before + (f64::from(i) + 0.5) * step;
                    let pull = (field / shape).tanh() - p;
                    if pull * step > 0.0 {
                        p += step.abs() / pinning * pull;
                    }
                }
                before = *u;
                reading.push(gain * (u + strength * p));
            }
            reading
        },
    );
    let value = fitted(folder.path(), "jiles_atherton");
    within(value("gain_um_v"), gain, 0.02);
    within(value("strength_v"), strength, 0.05);
    within(value("shape_v"), shape, 0.05);
    within(value("pinning_v"), pinning, 0.05);
}

#[test]
fn a_bent_lever() {
    let folder = tempfile::tempdir().unwrap();
    let (gain, arm, angle): (f64, f64, f64) = (0.2, 500.0, 0.3);
    recordings(
        folder.path(),
        [swelling(3000, 5.0), swelling(3000, 7.0)],
        |drive_v| {
            let along = |um: f64| arm * ((angle + um / arm).sin() - angle.sin()) / angle.cos();
            std::iter::once(0.0)
                .chain(drive_v.iter().map(|u| along(gain * u)))
                .collect()
        },
    );
    let value = fitted(folder.path(), "bent_lever");
    within(value("gain_um_v"), gain, 0.01);
    within(value("angle_rad"), angle, 0.02);
    within(value("arm_um"), arm, 1e-12);
}

#[test]
fn a_stage_that_grows_with_a_recorded_temperature() {
    let folder = tempfile::tempdir().unwrap();
    let (gain, um_per_k) = (0.2, 0.12);
    let temperature_c = |k: usize| 22.5 + 1.5 * (0.9 * k as f64 / RATE_HZ).sin();
    // The first reading comes before the first drive acts, each other one a period after the temperature that
    // it answers to.
    recordings(
        folder.path(),
        [swelling(3000, 5.0), swelling(3000, 7.0)],
        |drive_v| {
            let grown = |k: usize| um_per_k * (temperature_c(k) - 22.0);
            std::iter::once(grown(0))
                .chain(drive_v.iter().enumerate().map(|(k, u)| gain * u + grown(k)))
                .collect()
        },
    );
    for name in ["a", "b"] {
        let path = folder.path().join(format!("{name}.csv"));
        let text = std::fs::read_to_string(&path).unwrap();
        let rows = text.lines().enumerate().map(|(line, row)| match line {
            0 => format!("{row},chamber [\u{b0}C]\n"),
            _ => format!("{row},{:.6}\n", temperature_c(line - 1)),
        });
        std::fs::write(&path, rows.collect::<String>()).unwrap();
    }
    std::fs::write(folder.path().join("own.toml"), definition("thermal_growth")).unwrap();
    let refused = hysteron(
        &["identify", ".", "--effects", "gain,own.toml"],
        folder.path(),
    );
    let message = String::from_utf8_lossy(&refused.stderr).into_owned();
    assert!(
        refused.status.code() == Some(2) && message.contains("temperature_c"),
        "{message}"
    );
    let manifest = std::fs::read_to_string(folder.path().join("dataset.toml")).unwrap();
    let named = manifest.replace(
        "initial_state = \"virgin\"\n",
        "initial_state = \"virgin\"\nauxiliary = { temperature_c = \"chamber\" }\n",
    );
    std::fs::write(folder.path().join("dataset.toml"), named).unwrap();
    let value = fitted(folder.path(), "thermal_growth");
    within(value("gain_um_v"), gain, 0.01);
    within(value("um_per_k"), um_per_k, 0.02);
}
