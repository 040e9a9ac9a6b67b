//! Faults that a user met, one test each.

use hysteron::dataset::drive_variety::DriveVariety;
use hysteron::dataset::manifest::Manifest;
use hysteron::dataset::reading::from_file;
use hysteron::diagnosis::words::changed;
use hysteron::identification::noise_floor::noise_floor;
use hysteron::identify::add;
use hysteron::model_file::effects_named;
use hysteron::outcome::ChangedValue;
use hysteron::simulate::simulate;
use hysteron::watch::Unwatched;
use hysteron::{Dataset, Record};
use hysteron_sim::chain::{Drive, EffectInstance, InitialState, Model};
use hysteron_sim::noise::WhiteNoise;

/// Rest, then sines; noise of 3 nm.
fn recording(bad_reading_at: Option<usize>) -> String {
    let mut noise = WhiteNoise::new(0.003, 3);
    let mut text = String::from("t_s,u_v,y_um\n");
    for k in 0..9000_usize {
        let drive = |k: usize| {
            if k < 3000 {
                0.0
            } else {
                30.0 - 30.0 * (0.01 * (k - 3000) as f64).cos()
            }
        };
        let bad = if bad_reading_at == Some(k) { 8.0 } else { 0.0 };
        let y = 0.14 * drive(k.saturating_sub(1)) + noise.next_um() + bad;
        text.push_str(&format!(
            "{:.4},{:.5},{y:.6}\n",
            k as f64 / 2000.0,
            drive(k)
        ));
    }
    text
}

#[test]
fn one_bad_reading_in_the_rest_is_no_noise() {
    let floor_nm = |at| {
        1e3 * noise_floor(&from_file("recording.csv", recording(at).as_bytes()).unwrap())
            .rms_um
            .unwrap()
    };
    let clean_nm = floor_nm(None);
    for at in [700, 1400, 1600, 2900] {
        let nm = floor_nm(Some(at));
        assert!(
            (nm / clean_nm - 1.0).abs() < 0.1,
            "{at}: {nm} nm, without it {clean_nm}"
        );
    }
}

#[test]
fn all_missing_keys_are_told_at_once() {
    let text = "drive_min_v = 0.0\n[[record]]\nfile = \"a.csv\"\n[[record]]\nfile = \"b.csv\"\nrole = \"identify\"\ninitial_state = \"unknown\"\n";
    let message = Manifest::parse(text, "dataset.toml")
        .unwrap_err()
        .to_string();
    for key in [
        "`name`",
        "`drive_max_v`",
        "`role`, `initial_state` of record 1",
    ] {
        assert!(message.contains(key), "{message}");
    }
    assert!(
        !message.contains("record 2") && !message.contains("line 1"),
        "{message}"
    );
}

#[test]
fn implausible_gains_are_doubted() {
    let notes = |gain: f64| {
        let drive: Vec<f64> = (0..2000)
            .map(|k| 30.0 - 30.0 * (0.01 * f64::from(k)).cos())
            .collect();
        let read = (0..2000_usize)
            .map(|k| gain * drive[k.saturating_sub(1)])
            .collect();
        Dataset::new("d", 0.0, 60.0, vec![Record::new("r", 1000.0, drive, read)])
            .unwrap()
            .remarks()
            .join("; ")
    };
    assert!(notes(180.0).contains("180.0 um/V"), "{}", notes(180.0));
    assert!(notes(-0.14).contains("inverted"), "{}", notes(-0.14));
    assert!(!notes(0.14).contains("um/V"), "{}", notes(0.14));
}

#[test]
fn readings_without_noise_are_doubted() {
    let noiseless = |k: usize| {
        if k < 1000 {
            1e-9 * (78.233 * (k * k) as f64).sin()
        } else {
            0.1 * (0.02 * k as f64).sin()
        }
    };
    let drive: Vec<f64> = (0..4000)
        .map(|k| {
            if k < 1000 {
                5.0
            } else {
                5.0 + (0.02 * k as f64).sin()
            }
        })
        .collect();
    let dataset = Dataset::new(
        "d",
        0.0,
        10.0,
        vec![Record::new(
            "r",
            1000.0,
            drive,
            (0..4000).map(noiseless).collect(),
        )],
    )
    .unwrap();
    let floor = noise_floor(&dataset);
    assert!(
        floor
            .warnings
            .iter()
            .any(|w| w.contains("less than any sensor")),
        "{:?} {:?}",
        floor.rms_um,
        floor.warnings
    );
}

/// Limits that were read back through a converter are a little below those that were commanded.
#[test]
fn a_drive_to_the_commanded_limit_is_simulated() {
    let mut model = Model::new(0.0, 94.99969);
    let overview = Dataset::new(
        "d",
        0.0,
        95.0,
        vec![Record::new(
            "r",
            1000.0,
            (0..100).map(f64::from).map(|u| 0.9 * u).collect(),
            (0..100).map(f64::from).collect(),
        )],
    )
    .unwrap()
    .overview();
    let effect = effects_named("hysteresis").unwrap().remove(0);
    model.add(EffectInstance::new(effect, &overview, &[10.0]));
    let reaches = |high: f64| {
        let drive_v: Vec<f64> = (0..100).map(|k| high * f64::from(k) / 99.0).collect();
        simulate(
            &model,
            &Drive::held(&drive_v, 1e-3, InitialState::Virgin),
            "--drive",
        )
    };
    assert!(reaches(95.0).is_ok());
    assert!(reaches(96.0).unwrap_err().to_string().contains("96"));
}

#[test]
fn a_value_that_moved_has_its_name_once_and_its_unit() {
    let moved = |effect: &str, parameter: &str, from: f64, to: f64| {
        changed(&[ChangedValue {
            effect: effect.into(),
            parameter: parameter.into(),
            from,
            to,
        }])
    };
    assert_eq!(
        moved("delay", "delay_s", 2.5e-5, 0.0005243),
        "delay from 0.02500 to 0.5243 ms"
    );
    let mode = moved(
        "vibration",
        "natural_frequency_rad_s",
        std::f64::consts::TAU * 600.0,
        std::f64::consts::TAU * 620.0,
    );
    assert_eq!(mode, "vibration natural frequency from 600.0 to 620.0 Hz");
    assert_eq!(
        moved("vibration", "damping_ratio", 0.5, 0.25),
        "vibration damping ratio from 0.5000 to 0.2500"
    );
}

#[test]
fn an_effect_that_is_there_already_is_refused_with_a_way_on() {
    let drive: Vec<f64> = (0..2000)
        .map(|k| 30.0 - 30.0 * (0.01 * f64::from(k)).cos())
        .collect();
    let read = (0..2000_usize)
        .map(|k| 0.14 * drive[k.saturating_sub(1)])
        .collect();
    let dataset =
        Dataset::new("d", 0.0, 60.0, vec![Record::new("r", 1000.0, drive, read)]).unwrap();
    let mut model = Model::new(0.0, 60.0);
    for (effect, value) in effects_named("gain,delay")
        .unwrap()
        .into_iter()
        .zip([0.14, 1e-3])
    {
        model.add(EffectInstance::new(effect, &dataset.overview(), &[value]));
    }
    let refused = add(
        &effects_named("delay").unwrap()[0],
        model,
        &dataset,
        &Unwatched,
    )
    .err()
    .unwrap()
    .to_string();
    assert!(
        refused.contains("in the model already") && refused.contains("identify DATASET --effects"),
        "{refused}"
    );
    assert!(
        refused.contains("gain") && refused.contains("delay"),
        "{refused}"
    );
}

/// A tape with several frequencies at once moves at many speeds, a triangle at one.
#[test]
fn a_multisine_does_not_move_at_one_speed() {
    let varied = |drive: Vec<f64>| {
        let read = drive.iter().map(|u| 0.1 * u).collect();
        let dataset =
            Dataset::new("d", 0.0, 60.0, vec![Record::new("r", 1000.0, drive, read)]).unwrap();
        DriveVariety::of(&dataset, &[0]).varied_within_a_record()
    };
    let lines: Vec<usize> = (1..=40).collect();
    assert!(varied(hysteron_sim::waveform::multisine(
        4000, &lines, 25.0, 30.0, 1, 5
    )));
    // A fast triangle behind slow ones takes a hundredth of the time.
    let slow_then_fast = |k: i32| {
        let phase = if k < 4000 {
            f64::from(k) / 2000.0
        } else {
            f64::from(k) / 20.0
        };
        60.0 * (1.0 - (2.0 * phase.fract() - 1.0).abs())
    };
    assert!(varied((0..4040).map(slow_then_fast).collect()));
    assert!(!varied(
        (0..4000)
            .map(|k: i32| 60.0 * (1.0 - (f64::from(k % 400) / 200.0 - 1.0).abs()))
            .collect()
    ));
}
