//! The recording of a stick-slip drive, measured.

use crate::common::hysteron;
use hysteron_sim::stick_slip::StickSlipActuator;
use hysteron_sim::waveform;
use std::fmt::Write;

const SAMPLE_RATE_HZ: f64 = 20_000.0;

/// Two trains with a rest behind each, without noise, as CSV.
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
    let mut csv = "t_s,u_v,y_um\n".to_owned();
    for (k, (u, y)) in drive_v.iter().zip(&motion.end_effector_um).enumerate() {
        writeln!(csv, "{:.5},{u:.5},{y:.5}", k as f64 / SAMPLE_RATE_HZ).unwrap();
    }
    csv
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
    let mut csv = "t_s,u_v,y_um\n".to_owned();
    for k in 0..2000 {
        let u = 25.0 - 25.0 * (0.02 * f64::from(k)).cos();
        writeln!(csv, "{:.4},{u:.4},{:.5}", f64::from(k) * 1e-3, 0.1 * u).unwrap();
    }
    std::fs::write(folder.path().join("sine.csv"), csv).unwrap();
    let output = hysteron(&["stepping", "sine.csv"], folder.path());
    let errors = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2));
    assert!(
        errors.contains("sine.csv") && errors.contains("saw-teeth"),
        "{errors}"
    );
}
