//! The main job on real input: planted cases, measured recordings, and the example that the project ships.
//!
//! Measured and planted data lie beside the project and are never copied into it; without them a test reports
//! that and passes.

use hysteron::analyse::{Options, Outcome, Start, analyse};
use hysteron::dataset::folder;
use hysteron::dataset::issue::IssueKind;
use hysteron::dataset::{Dataset, Record, Role};
use hysteron::diagnosis::words::cannot_identify;
use hysteron::identification::fit::{residual, rms};
use hysteron::model_file::{effects_named, own_effect};
use hysteron::outcome::Verdict;
use hysteron::synthetic::case::Truth;
use hysteron::watch::{Unwatched, Watch, WatchEvent};
use hysteron_sim::noise::WhiteNoise;
use hysteron_tests::{beside, root};
use std::path::Path;

fn run(dataset: &Dataset, effects: &str) -> Outcome {
    let effects = effects_named(effects).unwrap();
    analyse(
        dataset,
        Start::Effects(&effects),
        &Options::default(),
        &Unwatched,
    )
    .unwrap()
}

/// A folder with a manifest of the project and the measured files that it names.
fn measured(name: &str, files: &[(&str, &str)]) -> Option<(tempfile::TempDir, Dataset)> {
    let source = beside("measured")?.join(name);
    let folder = tempfile::tempdir().unwrap();
    for (from, to) in files {
        std::fs::copy(source.join(from), folder.path().join(to)).unwrap();
    }
    let manifest = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("manifests/{name}.toml"));
    std::fs::copy(manifest, folder.path().join("dataset.toml")).unwrap();
    let dataset = folder::load(folder.path()).unwrap();
    Some((folder, dataset))
}

fn percent_of_range(found: &Outcome, dataset: &Dataset, record: &str) -> f64 {
    let record = dataset.records.iter().find(|r| r.name == record).unwrap();
    100.0 * rms(&residual(&found.model, record)) / record.range_um()
}

#[test]
fn a_real_stage_is_explained_effect_by_effect() {
    let Some((_folder, dataset)) = measured(
        "piezo_stage",
        &[
            ("20_hz_no_lp.csv", "20_hz_no_lp.csv"),
            ("40_hz_no_lp.csv", "40_hz_no_lp.csv"),
        ],
    ) else {
        return;
    };
    let found = run(&dataset, "gain");
    assert!(percent_of_range(&found, &dataset, "20_hz_no_lp") <= 0.03);
    assert!(percent_of_range(&found, &dataset, "40_hz_no_lp") <= 0.08);
    assert!(found.steps.len() > 2);
    // The hold at the beginning of each record shows the noise, and the best that is known leaves far more.
    let floor_um = found.floor.rms_um.unwrap();
    assert!((0.001..0.002).contains(&floor_um), "{floor_um}");
    // What stays unexplained takes no name away from what was found.
    let diagnosis = &found.diagnosis;
    assert!(
        matches!(diagnosis.verdict, Verdict::Named | Verdict::Ambiguous),
        "{}",
        diagnosis.sentence
    );
    let names = |id: &str| diagnosis.named.iter().any(|named| named == id);
    let stand_ins = ["friction", "backlash", "sensor_nonlinearity", "second_mode"];
    assert!(
        names("activated_switching") && !stand_ins.into_iter().any(names),
        "{:?}: {}",
        diagnosis.named,
        diagnosis.sentence
    );
    // Activation makes the creep: no record fixes a share of its own.
    assert!(
        !names("creep") && diagnosis.so_far.iter().any(|id| id == "creep"),
        "{}",
        diagnosis.sentence
    );
    assert!(
        diagnosis.sentence.contains("stay unexplained"),
        "{}",
        diagnosis.sentence
    );
}

#[test]
fn one_real_loop_is_met_and_what_it_cannot_tell_is_said() {
    let file = "hysteresis_v_150_1hz.csv";
    let Some((_folder, dataset)) =
        measured("piezo_150v_1hz", &[(file, file), (file, "second_half.csv")])
    else {
        return;
    };
    let found = run(&dataset, "gain");
    assert!(percent_of_range(&found, &dataset, "second_half") <= 0.20);
    let said = found
        .cannot_identify
        .iter()
        .map(cannot_identify)
        .collect::<Vec<_>>()
        .join("\n");
    assert!(
        said.contains("minor loops") && said.contains("rate dependence"),
        "{said}"
    );
}

#[test]
fn the_missing_effect_of_the_planted_cases_is_named_first() {
    let Some(folder) = beside("planted") else {
        return;
    };
    let truths: Vec<Truth> =
        serde_json::from_str(&std::fs::read_to_string(folder.join("truth.json")).unwrap()).unwrap();
    let spine = [
        Some("hysteresis"),
        Some("initial_curve"),
        Some("vibration"),
        Some("creep"),
        Some("delay"),
        None,
    ];
    for truth in truths
        .iter()
        .filter(|t| spine.contains(&t.hidden.as_deref()))
    {
        let dataset = folder::load(&folder.join(&truth.name)).unwrap();
        let found = run(&dataset, &truth.base.join(","));
        let first = found.diagnosis.named.first().map(String::as_str);
        assert_eq!(
            first,
            truth.hidden.as_deref(),
            "{}: {}",
            truth.name,
            found.diagnosis.sentence
        );
        let ratio = found.steps.last().unwrap().judged.validate_rms_um.unwrap() / truth.noise_um;
        assert!(ratio <= 1.15, "{}: {ratio}", truth.name);
        if truth.hidden.is_none() {
            assert_eq!(found.diagnosis.verdict, Verdict::AtFloor);
            assert_eq!(found.steps.len(), 1);
        }
    }
}

#[test]
fn what_no_library_knows_is_unexplained_until_the_user_writes_it() {
    let Some(folder) = beside("planted") else {
        return;
    };
    let dataset = folder::load(&folder.join("case000")).unwrap();
    let base = "hysteresis,initial_curve,vibration";
    let found = run(&dataset, base);
    assert_eq!(
        found.diagnosis.verdict,
        Verdict::Unexplained,
        "{}",
        found.diagnosis.sentence
    );
    let text = std::fs::read_to_string(root().join("examples/contact.toml")).unwrap();
    let own = [own_effect(&text, "contact.toml").unwrap()];
    let effects = effects_named(base).unwrap();
    let found = analyse(
        &dataset,
        Start::Effects(&effects),
        &Options {
            own: own.to_vec(),
            ..Options::default()
        },
        &Unwatched,
    )
    .unwrap();
    assert_eq!(
        found.diagnosis.named.first().map(String::as_str),
        Some("contact"),
        "{}",
        found.diagnosis.sentence
    );
    let ratio =
        found.steps.last().unwrap().judged.validate_rms_um.unwrap() / found.floor.rms_um.unwrap();
    assert!(ratio <= 1.15, "{ratio}");
}

/// Wants the best so far as soon as an effect that was added is the best.
#[derive(Default)]
struct UntilSomethingIsAdded(std::sync::atomic::AtomicBool);

impl Watch for UntilSomethingIsAdded {
    fn event(&self, event: &WatchEvent<'_>) {
        if matches!(event, WatchEvent::Tried { added, best: true, .. } if !added.is_empty()) {
            self.0.store(true, std::sync::atomic::Ordering::Relaxed);
        }
    }
    fn stopped(&self) -> bool {
        self.0.load(std::sync::atomic::Ordering::Relaxed)
    }
}

#[test]
fn a_search_that_was_stopped_claims_nothing_of_what_it_added() {
    let dataset = folder::load(&root().join("examples/hidden_effect")).unwrap();
    let effects = effects_named("hysteresis,initial_curve,vibration").unwrap();
    let found = analyse(
        &dataset,
        Start::Effects(&effects),
        &Options::default(),
        &UntilSomethingIsAdded::default(),
    )
    .unwrap();
    assert!(
        found.stopped && found.diagnosis.named.is_empty(),
        "{}",
        found.diagnosis.sentence
    );
    assert_eq!(found.diagnosis.verdict, Verdict::Undecidable);
    assert!(
        found
            .diagnosis
            .sentence
            .starts_with("Stopped before the evidence was weighed: the held-out error is "),
        "{}",
        found.diagnosis.sentence
    );
    let figures = found.figures(&dataset, 0.0);
    assert!(
        figures
            .steps
            .last()
            .is_some_and(|step| step.added.as_ref().is_some_and(|added| !added.is_empty())),
        "{:?}",
        figures.steps
    );
}

#[test]
fn the_shipped_example_is_explained_twice_alike() {
    let dataset = folder::load(&root().join("examples/hidden_effect")).unwrap();
    let text = || {
        let found = run(&dataset, "hysteresis,initial_curve,vibration");
        assert_eq!(found.diagnosis.named, ["creep"]);
        serde_json::to_string(&found.figures(&dataset, 0.0)).unwrap()
    };
    assert_eq!(
        text(),
        text(),
        "the same input must give the same output, bit for bit"
    );
}

/// A model of the stage, and a recording whose displacement went through an extra lag in the sensor chain.
#[test]
#[ignore = "open: a lag of 600 Hz put into a real recording is called a vibration, a sensor filter or a delay"]
fn a_lag_that_a_recording_has_and_the_model_has_not_is_recognised() {
    let Some((_folder, mut dataset)) = measured(
        "piezo_stage",
        &[
            ("20_hz_no_lp.csv", "20_hz_no_lp.csv"),
            ("40_hz_no_lp.csv", "40_hz_no_lp.csv"),
        ],
    ) else {
        return;
    };
    let mut recording = dataset.clone();
    dataset.records.retain(|r| r.name == "20_hz_no_lp");
    recording.records.retain(|r| r.name == "40_hz_no_lp");
    let model = run(&dataset, "hysteresis,initial_curve,creep").steps[0]
        .judged
        .model
        .clone();
    for bandwidth_hz in [200.0, 600.0] {
        let mut lagging = recording.clone();
        let record = &mut lagging.records[0];
        let decay = (-std::f64::consts::TAU * bandwidth_hz / record.sample_rate_hz).exp();
        let mut reading = record.displacement_um[0];
        for value in &mut record.displacement_um {
            reading = *value + decay * (reading - *value);
            *value = reading;
        }
        let found = analyse(
            &lagging,
            Start::Model(model.clone()),
            &Options::default(),
            &Unwatched,
        )
        .unwrap();
        let named = &found.diagnosis.named;
        // From another record at another frequency the values held err by about as much as the lags differ:
        // all of them must be said.
        assert!(
            named.contains(&"sensor_bandwidth".to_string()),
            "{bandwidth_hz}: {}",
            found.diagnosis.sentence
        );
        assert!(
            named.iter().all(|id| [
                "sensor_bandwidth",
                "sensor_filter",
                "delay",
                "amplifier_bandwidth",
                "vibration"
            ]
            .contains(&id.as_str())),
            "{bandwidth_hz}: {}",
            found.diagnosis.sentence
        );
        let (before, after) = (&found.steps[0].judged, &found.steps[1].judged);
        assert!(after.identify_rms_um < 0.2 * before.identify_rms_um);
    }
}

/// Another gain is another value, not another effect: a tenth less displacement than the model was identified
/// on.
#[test]
fn other_values_are_no_missing_effect() {
    let example = Path::new(env!("CARGO_MANIFEST_DIR")).join("../examples/hidden_effect");
    let mut dataset = folder::load(&example).unwrap();
    let model = run(&dataset, "hysteresis,initial_curve,vibration,creep").model;
    dataset
        .records
        .iter_mut()
        .flat_map(|r| &mut r.displacement_um)
        .for_each(|y| *y *= 0.9);
    let found = analyse(
        &dataset,
        Start::Model(model),
        &Options::default(),
        &Unwatched,
    )
    .unwrap();
    assert_eq!(
        found.diagnosis.verdict,
        Verdict::AtFloor,
        "{}",
        found.diagnosis.sentence
    );
    let changed = &found.diagnosis.changed;
    assert_eq!(
        (changed.len(), changed[0].effect.as_str()),
        (1, "hysteresis"),
        "{}",
        found.diagnosis.sentence
    );
    assert!(
        (changed[0].to / changed[0].from - 0.9).abs() < 1e-3,
        "{}",
        found.diagnosis.sentence
    );
}

/// A sensor that ends within the motion is no amplifier that does: what it reads there says nothing, and what
/// is missing is found in the rest.
#[test]
fn readings_that_end_say_nothing_of_the_rest() {
    let mut dataset = folder::load(&root().join("examples/hidden_effect")).unwrap();
    for record in &mut dataset.records {
        record
            .displacement_um
            .iter_mut()
            .for_each(|y| *y = y.min(8.0));
    }
    let dataset = Dataset::new(
        dataset.name,
        dataset.drive_min_v,
        dataset.drive_max_v,
        dataset.records,
    )
    .unwrap();
    let found = run(&dataset, "hysteresis,initial_curve,vibration");
    let issues = &found.diagnosis.issues;
    let ends = |kind: &IssueKind| matches!(kind, IssueKind::RangeEnds { reading_um, highest: true, .. } if *reading_um == 8.0);
    assert!(
        !issues.is_empty() && issues.iter().all(|issue| ends(&issue.kind)),
        "{issues:?}"
    );
    let sentence = &found.diagnosis.sentence;
    assert_eq!(
        (found.diagnosis.verdict, &found.diagnosis.named[..]),
        (Verdict::Named, &["creep".to_owned()][..]),
        "{sentence}"
    );
}

/// A Butterworth filter in the sensor's electronics is the same equation as a resonance; its damping tells
/// which it is, and the headline names it although nothing else is confusable with it.
#[test]
fn a_filter_in_the_electronics_is_told_from_a_resonance_by_its_damping() {
    let (rate_hz, cut_off_hz, fine) = (10_000.0, 400.0, 40);
    let record = |name: &str, seed: u64, role: Role| {
        let mut noise = WhiteNoise::new(0.002, seed);
        let tones = [7.0, 23.0, 71.0, 190.0, 430.0, 900.0];
        let tone = |t: f64, (n, f): (usize, &f64)| {
            4.0 * (std::f64::consts::TAU * f * t + (n as f64 + seed as f64).powi(2)).sin()
        };
        let drive_v: Vec<f64> = (0..8000)
            .map(|k| {
                if k < 800 {
                    50.0
                } else {
                    50.0 + tones
                        .iter()
                        .enumerate()
                        .map(|one| tone(f64::from(k) / rate_hz, one))
                        .sum::<f64>()
                }
            })
            .collect();
        // The filter's own equations in steps forty times as fine; the reading is taken before the drive of
        // its row is written.
        let (w, h) = (
            std::f64::consts::TAU * cut_off_hz,
            1.0 / (rate_hz * f64::from(fine)),
        );
        let (mut x, mut v) = (0.1 * drive_v[0], 0.0);
        let mut displacement_um = Vec::with_capacity(drive_v.len());
        for u in &drive_v {
            displacement_um.push(x + noise.next_um());
            for _ in 0..fine {
                v += h * (w * w * (0.1 * u - x) - 2.0_f64.sqrt() * w * v);
                x += h * v;
            }
        }
        Record::new(name, rate_hz, drive_v, displacement_um).with_role(role)
    };
    let records = vec![
        record("a", 3, Role::Identify),
        record("b", 8, Role::Validate),
    ];
    let dataset = Dataset::new("a filter", 0.0, 100.0, records).unwrap();
    let found = run(&dataset, "gain");
    let sentence = &found.diagnosis.sentence;
    // Both have the filter's equations: the damping ratio alone says which is likelier.
    let named: Vec<&str> = found.diagnosis.named.iter().map(String::as_str).collect();
    assert_eq!(
        (found.diagnosis.verdict, &named[..]),
        (Verdict::Ambiguous, &["sensor_filter", "vibration"][..]),
        "{sentence}"
    );
    assert!(
        sentence.contains("second-order low-pass of 40")
            || sentence.contains("second-order low-pass of 39"),
        "{sentence}"
    );
}
