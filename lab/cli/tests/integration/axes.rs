//! `axes`: stages with several drives and sensors.

use crate::common;

use common::{assert_done, hysteron};

#[test]
fn a_planted_stage_is_read_and_a_missing_column_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let planted = hysteron(
        &["axes", "plant", "coupling", "--out", "stage", "--seed", "3"],
        folder.path(),
    );
    assert_done(&planted);
    let manifest = folder.path().join("stage/dataset.toml");
    let text = std::fs::read_to_string(&manifest).unwrap();
    std::fs::write(&manifest, text.replacen("\"u3\"", "\"u9\"", 1)).unwrap();
    // `explain` knows such a data set by its lists of columns.
    for command in [&["axes", "explain", "stage"][..], &["explain", "stage"][..]] {
        let refused = hysteron(command, folder.path());
        let said = String::from_utf8_lossy(&refused.stderr).into_owned();
        assert_eq!(refused.status.code(), Some(2), "{said}");
        assert!(
            said.contains("record_1.csv") && said.contains("u9") && said.contains("u1, u2, u3"),
            "{said}"
        );
    }
    // What has no effect for several axes is refused, whatever it says.
    for option in [["--columns", "u=1"], ["--series", "s"], ["--policy", "p"]] {
        let refused = hysteron(&["explain", "stage", option[0], option[1]], folder.path());
        let said = String::from_utf8_lossy(&refused.stderr).into_owned();
        assert_eq!(refused.status.code(), Some(2), "{said}");
        let expected = format!(
            "{}: has no effect for a data set of several axes",
            option[0]
        );
        assert!(said.contains(&expected), "{said}");
    }
}

#[test]
fn a_decoupled_servo_is_checked_as_a_whole() {
    let folder = tempfile::tempdir().unwrap();
    let mode = |hz: f64, of_drives: &str, of_sensors: &str| {
        format!(
            "[[stage.modes]]\nfrequency_hz = {hz:.1}\ndamping_ratio = 0.02\nof_drives = {of_drives}\nof_sensors = {of_sensors}\n"
        )
    };
    let model = format!(
        "schema = \"hysteron.axes/1\"\nname = \"two axes\"\nsample_rate_hz = 6400.0\ndrive_names = [\"ux\", \"uy\"]\nsensor_names = [\"x\", \"y\"]\ndrive_unit = \"V\"\nsensor_unit = \"um\"\neffects = []\n[stage]\ndrives = [{{}}, {{}}]\nsensors = [{{}}, {{}}]\nfeedthrough = [[0.0, 0.0], [0.0, 0.0]]\n{}{}",
        mode(180.0, "[1.0, 0.2]", "[0.1, 0.0]"),
        mode(260.0, "[0.0, 1.0]", "[0.0, 0.1]")
    );
    std::fs::write(folder.path().join("model.toml"), model).unwrap();
    let done = hysteron(
        &["axes", "decouple", "model.toml", "--json", "servo.json"],
        folder.path(),
    );
    let said = format!(
        "{}{}",
        String::from_utf8_lossy(&done.stdout),
        String::from_utf8_lossy(&done.stderr)
    );
    assert!(done.status.success(), "{said}");
    let figures: serde_json::Value =
        serde_json::from_slice(&std::fs::read(folder.path().join("servo.json")).unwrap()).unwrap();
    for servo in figures.as_array().unwrap() {
        let radius = |on: &str| servo[on]["spectral_radius"].as_f64().unwrap();
        assert!(
            radius("on_model") < 1.0 && radius("on_hidden") < 1.0,
            "{servo}"
        );
        let crosstalk = |on: &str| servo[on][0]["crosstalk"].as_f64().unwrap();
        // What the design does not know stays as crosstalk.
        assert!(
            crosstalk("track_hidden") > crosstalk("track_model"),
            "{servo}"
        );
    }
    // A reference that no loop follows, or whose turns take hours.
    for hz in ["1e-6", "6000"] {
        let refused = hysteron(
            &["axes", "decouple", "model.toml", "--reference-hz", hz],
            folder.path(),
        );
        let said = String::from_utf8_lossy(&refused.stderr).into_owned();
        assert_eq!(refused.status.code(), Some(2), "{said}");
        assert!(said.contains("expected 0.064 to 640"), "{said}");
    }
    // A stage far from the model is a loop without bound, and no panic.
    let far = ["axes", "decouple", "model.toml", "--hidden-coupling", "5"];
    let done = hysteron(&far, folder.path());
    assert_eq!(done.status.code(), Some(1), "{done:?}");
}
