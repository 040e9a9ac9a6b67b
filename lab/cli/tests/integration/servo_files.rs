//! A servo on the actuator that it was made for, and on another one.

use crate::common;

use common::{hysteron, says, words};
use std::path::{Path, PathBuf};
use tempfile::TempDir;

/// A folder with a model of the example, `m.toml`, a servo for it, `s.toml`, and a model of an actuator with
/// a tenth of the travel, `weak.toml`.
fn folder() -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    let example = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../examples/hidden_effect");
    let effects = "hysteresis,initial_curve,vibration,creep";
    done(
        &[
            "identify",
            &example.to_string_lossy(),
            "--effects",
            effects,
            "--out",
            "m.toml",
        ],
        folder.path(),
    );
    done(&["design", "m.toml", "--out", "s.toml"], folder.path());
    let text = std::fs::read_to_string(folder.path().join("m.toml")).unwrap();
    let mut weak = hysteron::model_file::from_toml(&text, "m.toml").unwrap();
    for effect in weak
        .effects
        .iter_mut()
        .filter(|e| e.id == "hysteresis" || e.id == "initial_curve")
    {
        effect.parameters.iter_mut().for_each(|p| p.value *= 0.1);
    }
    std::fs::write(
        folder.path().join("weak.toml"),
        hysteron::model_file::to_toml(&weak, "weak").unwrap(),
    )
    .unwrap();
    folder
}

fn done(arguments: &[&str], folder: &Path) -> String {
    let output = hysteron(arguments, folder);
    assert!(
        output.status.success(),
        "{arguments:?}: {}",
        String::from_utf8_lossy(&output.stderr)
    );
    String::from_utf8_lossy(&output.stdout).into_owned()
}

#[test]
fn a_servo_is_judged_on_the_model_that_is_named() {
    let folder = folder();
    let folder = folder.path();
    says(
        &words("design m.toml --out t.toml --sensor-noise-um=-1"),
        folder,
        "expected above 0",
    );
    assert!(!folder.join("t.toml").exists());

    let own = done(
        &words("check s.toml --model m.toml --report page.html"),
        folder,
    );
    let page = std::fs::read_to_string(folder.join("page.html")).unwrap();
    assert!(page.len() > 10_000, "{own}");
    let other = String::from_utf8_lossy(
        &hysteron(&["check", "s.toml", "--model", "weak.toml"], folder).stdout,
    )
    .into_owned();
    let margins = |text: &str| {
        text.lines()
            .find(|l| l.contains("gain margin"))
            .map(str::to_owned)
    };
    assert!(
        margins(&own).is_some() && margins(&own) != margins(&other),
        "{own}\n{other}"
    );

    let followed = done(
        &["track", "m.toml", "s.toml", "--reference", "sine:50:3"],
        folder,
    );
    // What a file is stands in it, so their order does not matter.
    assert_eq!(
        followed,
        done(
            &["track", "s.toml", "m.toml", "--reference", "sine:50:3"],
            folder
        )
    );
    for files in [["m.toml", "s.toml"], ["s.toml", "m.toml"]] {
        assert_eq!(
            own.lines().next(),
            done(&["check", files[0], files[1]], folder).lines().next()
        );
    }
    says(&["check", "s.toml"], folder, "check MODEL SERVO");
    says(
        &["track", "weak.toml", "s.toml", "--reference", "sine:50:3"],
        folder,
        "the drive reaches 0 to",
    );
    says(
        &["track", "m.toml", "s.toml", "--reference", "sine:1e-9:3"],
        folder,
        "at least 0.01 Hz",
    );

    // An edited file with a value that no sensor and no mode has.
    let text = std::fs::read_to_string(folder.join("s.toml")).unwrap();
    for (key, value) in [
        ("sensor_noise_um", "0.0"),
        ("natural_frequency_rad_s", "nan"),
    ] {
        let edited: Vec<String> = text
            .lines()
            .map(|l| {
                if l.starts_with(key) {
                    format!("{key} = {value}")
                } else {
                    l.to_owned()
                }
            })
            .collect();
        std::fs::write(folder.join("edited.toml"), edited.join("\n")).unwrap();
        says(&["check", "edited.toml", "--model", "m.toml"], folder, key);
    }
}

/// Numbers in a text, in their order.
fn numbers(text: &str) -> Vec<f64> {
    text.split(|c: char| !c.is_ascii_digit() && c != '.')
        .filter_map(|word| word.trim_matches('.').parse().ok())
        .collect()
}

#[test]
fn what_a_design_says_is_so_and_what_it_cannot_do_is_refused() {
    let folder = folder();
    let folder = folder.path();
    let example = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../examples/hidden_effect");
    let example = example.to_string_lossy();

    // The parts of the expected error come to the whole.
    let said = done(
        &["design", "m.toml", "--data", &example, "--out", "d.toml"],
        folder,
    );
    let sentence = said.split("expected error, ").nth(1).unwrap_or_default();
    let [whole, noise, _, at_once, _, slow, ..] = numbers(sentence)[..] else {
        panic!("{said}")
    };
    assert!(
        (whole - noise.hypot(at_once).hypot(slow)).abs() < 0.015,
        "{sentence}"
    );

    // Periods that are too short or too long for the memory.
    for (hz, expected) in [
        ("9999", "4.9 to 277 Hz"),
        ("278", "4.9 to 277 Hz"),
        ("4", "4.9 to 277 Hz"),
    ] {
        let arguments = [
            "design",
            "m.toml",
            "--data",
            &example,
            "--learning",
            "--reference-hz",
            hz,
            "--out",
            "no.toml",
        ];
        says(&arguments, folder, expected);
    }
    // Slower than that, and without learning, no message mentions it.
    done(
        &[
            "design",
            "m.toml",
            "--data",
            &example,
            "--reference-hz",
            "4",
            "--out",
            "slow.toml",
        ],
        folder,
    );

    // A recording of a stage with ten times the gain.
    let arguments = [
        "design",
        "weak.toml",
        "--data",
        &example,
        "--out",
        "no.toml",
    ];
    says(
        &arguments,
        folder,
        "is not of the stage that this model describes",
    );
    says(&arguments, folder, "times its displacement it would leave");
    assert!(!folder.join("no.toml").exists());

    // A stage whose first mode is elsewhere, and hardly damped: more drive would not show it.
    edit_model("m.toml", "elsewhere.toml", folder, |model| {
        let mode = model
            .effects
            .iter_mut()
            .find(|e| e.id == "vibration")
            .unwrap();
        mode.parameters[0].value *= 0.6;
        mode.parameters[1].value *= 0.1;
    });
    // One that is there, but elsewhere: the data show it.
    edit_model("m.toml", "stiff.toml", folder, |model| {
        model
            .effects
            .iter_mut()
            .find(|e| e.id == "vibration")
            .unwrap()
            .parameters[0]
            .value *= 3.0;
    });
    says(
        &[
            "design",
            "stiff.toml",
            "--data",
            &example,
            "--out",
            "no.toml",
        ],
        folder,
        "does not describe --data",
    );
    let refused = String::from_utf8_lossy(
        &hysteron(
            &[
                "design",
                "elsewhere.toml",
                "--data",
                &example,
                "--out",
                "no.toml",
            ],
            folder,
        )
        .stderr,
    )
    .into_owned();
    assert!(
        refused.contains("does not describe --data") && !refused.contains("record a multisine"),
        "{refused}"
    );
    let [left_nm, noise_nm, ..] =
        numbers(refused.split("it leaves").nth(1).unwrap_or_default())[..]
    else {
        panic!("{refused}")
    };
    assert!(left_nm > 5.0 * noise_nm && noise_nm > 0.5, "{refused}");

    // A specified bandwidth of the sensor is undone, and reported beside the errors.
    let late = done(
        &[
            "design",
            "m.toml",
            "--data",
            &example,
            "--sensor-bandwidth-hz",
            "10000",
            "--out",
            "late.toml",
        ],
        folder,
    );
    assert!(late.contains("15.9 us late"), "{late}");
    let tracked = done(
        &["track", "m.toml", "late.toml", "--reference", "sine:50:3"],
        folder,
    );
    assert!(
        tracked.contains("undoes 15.9 us") && tracked.contains("the model's sensor has none"),
        "{tracked}"
    );
    edit_model("m.toml", "slow.toml", folder, |model| {
        let overview =
            hysteron_sim::effect::Overview::without_data(model.drive_min_v, model.drive_max_v);
        let sensor = hysteron_sim::effect::by_id("sensor_bandwidth").unwrap();
        model.effects.push(hysteron_sim::chain::EffectInstance::new(
            sensor,
            &overview,
            &[8000.0],
        ));
    });
    let mut true_nm = Vec::new();
    for (servo, expected) in [
        (
            "late.toml",
            "reads 19.9 us late and the servo undoes 15.9 us",
        ),
        (
            "s.toml",
            "reads 19.9 us late, and the servo does not undo it",
        ),
    ] {
        let tracked = done(
            &["track", "slow.toml", servo, "--reference", "sine:50:3"],
            folder,
        );
        assert!(tracked.contains(expected), "{tracked}");
        true_nm.push(numbers(tracked.split("true    RMS").nth(1).unwrap())[0]);
    }
    // 19.9 us of 3 um at 50 Hz are 13.3 nm RMS, of which 15.9 us leave 2.7: the position counts, not the
    // reading.
    assert!(
        true_nm[0] < 5.0 && (true_nm[1] - 13.3).abs() < 3.0,
        "{true_nm:?}"
    );
    let tracked = done(
        &["track", "m.toml", "s.toml", "--reference", "sine:50:3"],
        folder,
    );
    assert!(!tracked.contains(" us late"), "{tracked}");
    // A recording is read as specified when the model was made, and the suggested command can be typed.
    says(
        &[
            "design", "m.toml", "--data", &example, "--timing", "sideways", "--out", "no.toml",
        ],
        folder,
        "hold_after_sample",
    );
    std::fs::copy(
        Path::new(example.as_ref()).join("validation.csv"),
        folder.join("my data.csv"),
    )
    .unwrap();
    let read_as = ["--timing", "hold_after_sample"];
    let told = done(
        &[
            "identify",
            "my data.csv",
            "--effects",
            "gain",
            "--out",
            "my gain.toml",
            read_as[0],
            read_as[1],
        ],
        folder,
    );
    assert!(
        told.contains(
            "hysteron diagnose \"my gain.toml\" \"my data.csv\" --timing hold_after_sample"
        ),
        "{told}"
    );
    let slower = done(
        &words("design slow.toml --sensor-bandwidth-hz 1000 --out slower.toml"),
        folder,
    );
    assert!(
        slower.contains("CAUTION: that is more than everything that is late in the model, 19.9 us"),
        "{slower}"
    );
    says(
        &words("design m.toml --sensor-bandwidth-hz=50 --out no.toml"),
        folder,
        "expected at least 160",
    );
}

/// What is around a servo at work: a reference by points, a force from outside, a load.
#[test]
fn a_servo_is_put_to_work_under_other_circumstances() {
    let folder = folder();
    let folder = folder.path();
    let track = |more: &[&str]| done(&[&["track", "m.toml", "s.toml"], more].concat(), folder);
    let true_nm = |told: &str| numbers(told.split("true    RMS").nth(1).unwrap())[0];

    // A sine by points is the sine.
    let by_name = true_nm(&track(&["--reference", "sine:20:3:5"]));
    let points: String =
        (0..20_001)
            .map(|k| f64::from(k) * 5e-5)
            .fold("t_s,reference_um\n".into(), |text, t| {
                format!(
                    "{text}{t},{}\n",
                    5.0 - 3.0 * (std::f64::consts::TAU * 20.0 * t).cos()
                )
            });
    std::fs::write(folder.join("points.csv"), points).unwrap();
    let by_points = true_nm(&track(&["--reference", "points.csv"]));
    assert!(
        (by_points / by_name - 1.0).abs() < 0.3,
        "{by_points} {by_name}"
    );

    // A force far above what the loop holds down moves the stage, one far below hardly; and a step is met in
    // the end.
    let rest = ["--reference", "sine:1:0:5", "--sensor-noise-um", "0"];
    let pushed = |force: &str| true_nm(&track(&[&rest[..], &["--disturbance", force]].concat()));
    let (slow, fast) = (pushed("sine:1:0.1"), pushed("sine:3000:0.1"));
    assert!(
        slow < 10.0 && fast < 20.0 && pushed("step:0.1") < 30.0,
        "{slow} {fast}"
    );
    let quiet = true_nm(&track(&rest));
    assert!(pushed("sine:100:0.1") > 5.0 * quiet.max(0.05), "{quiet}");

    // Beyond its margins a load makes an end of it.
    let loaded = hysteron(
        &words("track m.toml s.toml --reference sine:20:3:5 --added-mass 20"),
        folder,
    );
    assert!(String::from_utf8_lossy(&loaded.stdout).contains("21 times the moving mass"));

    says(
        &["track", "m.toml", "s.toml", "--reference", "missing.csv"],
        folder,
        "missing.csv",
    );
    std::fs::write(folder.join("back.csv"), "t_s,r_um\n0,1\n0.2,1\n0.1,1\n").unwrap();
    says(
        &["track", "m.toml", "s.toml", "--reference", "back.csv"],
        folder,
        "point 2",
    );
    std::fs::write(folder.join("nm.csv"), "t [s],r [nm]\n0,1\n0.2,1\n").unwrap();
    says(
        &["track", "m.toml", "s.toml", "--reference", "nm.csv"],
        folder,
        "expected um",
    );
    says(
        &words("track m.toml s.toml --reference sine:20:3 --disturbance push:3"),
        folder,
        "sine:HZ:UM",
    );
    says(
        &words("track m.toml s.toml --reference sine:20:3 --added-mass=-1"),
        folder,
        "from 0 to 50",
    );
}

/// Writes a model that differs from another one.
fn edit_model(from: &str, to: &str, folder: &Path, edit: impl Fn(&mut hysteron_sim::chain::Model)) {
    let text = std::fs::read_to_string(folder.join(from)).unwrap();
    let mut model = hysteron::model_file::from_toml(&text, from).unwrap();
    edit(&mut model);
    std::fs::write(
        folder.join(to),
        hysteron::model_file::to_toml(&model, to).unwrap(),
    )
    .unwrap();
}

#[test]
fn a_stage_without_loops_gets_a_servo_and_one_without_a_mode_is_told_why_not() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let example = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../examples/hidden_effect");
    let example = example.to_string_lossy();
    done(
        &[
            "identify",
            &example,
            "--effects",
            "gain,vibration",
            "--out",
            "fitted.toml",
        ],
        folder,
    );
    edit_model("fitted.toml", "linear.toml", folder, |model| {
        let mode = model
            .effects
            .iter_mut()
            .find(|e| e.id == "vibration")
            .unwrap();
        mode.parameters
            .iter_mut()
            .zip([4000.0, 0.4])
            .for_each(|(p, value)| p.value = value);
    });
    done(
        &words("design linear.toml --out servo.toml --block servo.block"),
        folder,
    );
    let judged = done(&["check", "servo.toml", "--model", "linear.toml"], folder);
    assert!(judged.contains("predictor: stable"), "{judged}");
    let tracked = done(
        &words("track linear.toml servo.toml --reference sine:50:2 --json t.json"),
        folder,
    );
    let text = std::fs::read_to_string(folder.join("t.json")).unwrap();
    let figures: serde_json::Value = serde_json::from_str(&text).unwrap();
    let (error_um, noise_um) = (
        figures["true"]["rms_um"].as_f64().unwrap(),
        figures["noise_um"].as_f64().unwrap(),
    );
    assert!(error_um < 1.3 * noise_um, "{tracked}");

    edit_model("linear.toml", "still.toml", folder, |model| {
        model.effects.retain(|e| e.id == "gain");
        model.identified = None;
    });
    let expected = "has no first mode: identify one with --effects gain,vibration";
    says(
        &["design", "still.toml", "--out", "no.toml"],
        folder,
        expected,
    );
    says(
        &["check", "servo.toml", "--model", "still.toml"],
        folder,
        expected,
    );
    // A recording that is too slow for a mode: nothing of it is found.
    let rows: Vec<String> = (0..4000)
        .map(|k| 0.01 * f64::from(k))
        .map(|t| (t, 5.0 - 5.0 * (3.0 * t).cos()))
        .map(|(t, u)| format!("{t:.2},{u:.6},{:.6}", 0.1 * u))
        .collect();
    std::fs::write(
        folder.join("slow.csv"),
        format!("t,u_v,y_um\n{}", rows.join("\n")),
    )
    .unwrap();
    // Said of a model that is kept, and of no other.
    let unkept = done(&["explain", "slow.csv", "--from", "gain"], folder);
    assert!(!unkept.contains("servo"), "{unkept}");
    let explained = done(
        &words("explain slow.csv --from gain --out slow.toml"),
        folder,
    );
    assert!(
        explained.contains("No servo can be designed from it as it is")
            && explained.contains("no first mode"),
        "{explained}"
    );
    edit_model("linear.toml", "against.toml", folder, |model| {
        model.effects[0].parameters[0].value *= -1.0
    });
    says(
        &["design", "against.toml", "--out", "no.toml"],
        folder,
        "rises with the drive",
    );
}

#[test]
fn an_unstable_loop_is_told_with_the_criterion_that_it_breaks() {
    let folder = folder();
    let folder = folder.path();
    let text = std::fs::read_to_string(folder.join("m.toml")).unwrap();
    let mut strong = hysteron::model_file::from_toml(&text, "m.toml").unwrap();
    for effect in strong
        .effects
        .iter_mut()
        .filter(|e| e.id == "hysteresis" || e.id == "initial_curve")
    {
        effect.parameters.iter_mut().for_each(|p| p.value *= 7.0);
    }
    std::fs::write(
        folder.join("strong.toml"),
        hysteron::model_file::to_toml(&strong, "strong").unwrap(),
    )
    .unwrap();
    let output = hysteron(&["check", "s.toml", "--model", "strong.toml"], folder);
    let said = String::from_utf8_lossy(&output.stdout).into_owned();
    assert_eq!(output.status.code(), Some(1), "{said}");
    let eigenvalue = said.lines().next().and_then(|line| {
        line.split("the largest eigenvalue with the mean gain is ")
            .nth(1)
    });
    assert!(
        eigenvalue
            .and_then(|v| v.parse::<f64>().ok())
            .is_some_and(|v| v >= 1.0),
        "{said}"
    );
}

/// Without feedback nothing can be unstable.
#[test]
fn a_scheme_without_feedback_has_no_loop_to_judge() {
    let folder = folder();
    for scheme in ["feedforward", "feedforward-without-creep"] {
        let said = done(
            &["check", "s.toml", "m.toml", "--scheme", scheme],
            folder.path(),
        );
        assert!(
            said.contains("no loop to judge") && !said.contains("UNSTABLE"),
            "{said}"
        );
    }
}

/// The number behind a word in a text.
fn behind(text: &str, word: &str) -> f64 {
    numbers(
        text.split(word)
            .nth(1)
            .unwrap_or_else(|| panic!("{word} in {text}")),
    )[0]
}

/// What a servo does on other plants than its model, on references that do not repeat, and what it takes.
#[test]
fn a_servo_prints_a_band_over_plants_and_the_worst() {
    let folder = folder();
    let folder = folder.path();
    let track = |more: &[&str]| done(&[&["track", "m.toml", "s.toml"], more].concat(), folder);

    let sine = track(&words(
        "--reference sine:150:3 --json t.json --report t.html --capacitance-uf 3",
    ));
    let text = std::fs::read_to_string(folder.join("t.json")).unwrap();
    let figures: serde_json::Value = serde_json::from_str(&text).unwrap();
    let members = figures["band"]["members"].as_array().unwrap();
    let named = |name: &str| {
        members
            .iter()
            .find(|m| m["plant"].as_str() == Some(name))
            .unwrap_or_else(|| panic!("{name}: {text}"))
    };
    let rms_um = |member: &serde_json::Value| member["true"]["rms_um"].as_f64().unwrap();
    let nominal = rms_um(named("the model itself"));
    assert_eq!(nominal, figures["true"]["rms_um"].as_f64().unwrap());
    // A gain that is off and a mode elsewhere let more of a fast reference through than the model.
    for plant in [
        "gain 20 % lower",
        "gain 20 % higher",
        "first mode 5 % lower and 40 % less damped",
    ] {
        assert!(rms_um(named(plant)) > 1.2 * nominal, "{plant}: {sine}");
    }
    assert!(
        members
            .iter()
            .any(|m| m["plant"].as_str().unwrap().starts_with("draw 6 of 6")),
        "{text}"
    );
    let worst = members
        .iter()
        .max_by(|a, b| rms_um(a).total_cmp(&rms_um(b)))
        .unwrap();
    assert!(
        sine.contains(&format!("worst   {}", worst["plant"].as_str().unwrap())),
        "{sine}"
    );
    // The readings hold the noise that the true position has in part only.
    let [as_read, noise] =
        [&figures["as_read"]["rms_um"], &figures["noise_um"]].map(|v| v.as_f64().unwrap());
    assert!(as_read > nominal.max(noise), "{sine}");
    // 3 uF at a slope of 2 pi 150 Hz x 3 um / 0.156 um/V take 54 mA in the RMS of a sine over sqrt 2.
    assert!(behind(&sine, "current") > 30.0, "{sine}");
    let page = std::fs::read_to_string(folder.join("t.html")).unwrap();
    for part in [
        "The last two periods",
        "Spectrum of the error",
        "A step",
        "On other plants",
        "Current into the actuator",
    ] {
        assert!(page.contains(part), "{part}");
    }

    let step = track(&["--reference", "step:0.5:4"]);
    let settling_ms = behind(&step, "settles to 2 % in");
    assert!(settling_ms > 0.05 && settling_ms < 20.0, "{step}");
    let random = track(&["--reference", "random:50:2:4:7"]);
    assert!(behind(&random, "true    RMS") < 50.0, "{random}");
    says(
        &["track", "m.toml", "s.toml", "--reference", "step:0"],
        folder,
        "a step of zero",
    );
    says(
        &words("track m.toml s.toml --reference step:1 --capacitance-uf=-1"),
        folder,
        "expected above 0",
    );
}

/// The default keeps the usual margins where they are cheap; `check` judges with the plants of `design`.
#[test]
fn a_design_keeps_the_usual_margins_and_check_has_its_plants() {
    let folder = folder();
    let folder = folder.path();
    let example = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../examples/hidden_effect");
    let example = example.to_string_lossy();
    let usual = done(
        &[
            "design",
            "m.toml",
            "--data",
            &example,
            "--out",
            "usual.toml",
        ],
        folder,
    );
    let fast = done(
        &[
            "design",
            "m.toml",
            "--data",
            &example,
            "--sensitivity-peak",
            "2.5",
            "--out",
            "fast.toml",
        ],
        folder,
    );
    let expected = |said: &str| behind(said, "smallest expected error,");
    assert!(
        expected(&fast) < expected(&usual) && expected(&usual) < 4.0 / 3.0 * expected(&fast),
        "{usual}{fast}"
    );
    assert!(
        usual.contains("With smaller margins the expected error is")
            && !fast.contains("With smaller margins"),
        "{usual}{fast}"
    );
    for (servo, keeps) in [("usual.toml", true), ("fast.toml", false)] {
        let checked = done(
            &["check", servo, "--model", "m.toml", "--data", &example],
            folder,
        );
        let margins = [
            behind(&checked, "gain margin"),
            behind(&checked, "phase margin"),
            -behind(&checked, "peak sensitivity"),
        ];
        let kept = margins
            .iter()
            .zip([8.0, 35.0, -1.8])
            .all(|(margin, least)| *margin > least - 0.01);
        assert_eq!(kept, keeps, "{checked}");
        assert!(
            checked.contains("  holds for the ")
                && checked.contains("unstable beyond gain x ")
                && checked.contains(" dB), mass x "),
            "{checked}"
        );
        // Without the recording a mode is reckoned with that it excludes.
        let blind = done(&["check", servo, "--model", "m.toml"], folder);
        let refused = blind
            .lines()
            .find(|line| line.contains("does not hold for the"))
            .unwrap_or_else(|| panic!("{blind}"));
        assert!(refused.contains("without --data"), "{blind}");
    }
    says(
        &[
            "check",
            "usual.toml",
            "--model",
            "weak.toml",
            "--data",
            &example,
        ],
        folder,
        "is not of the stage that this model describes",
    );
}

#[test]
fn every_scheme_has_a_sentence_in_the_help() {
    let folder = tempfile::tempdir().unwrap();
    for command in ["check", "track"] {
        let help = done(&[command, "--help"], folder.path());
        for (name, what) in hysteron::servo::named_scheme::SCHEMES {
            let begins = what
                .split_whitespace()
                .take(3)
                .collect::<Vec<_>>()
                .join(" ");
            assert!(
                help.contains(&format!("- {name}:"))
                    && help
                        .split_whitespace()
                        .collect::<Vec<_>>()
                        .join(" ")
                        .contains(&begins),
                "{name}: {help}"
            );
        }
    }
    says(
        &words("track m.toml s.toml --reference step:1 --scheme lqg"),
        folder.path(),
        "predictor",
    );
}
