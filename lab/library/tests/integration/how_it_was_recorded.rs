//! What is wrong with how a record was taken, and no missing effect: it begins in another state than
//! declared, its sensor slipped, or a loop was closed.

use hysteron::analyse::{Options, Outcome, Start, analyse};
use hysteron::dataset::issue::{Issue, IssueKind, Severity};
use hysteron::dataset::{Dataset, Record, Role};
use hysteron::diagnosis::verdict::Reason;
use hysteron::model_file::effects_named;
use hysteron::outcome::{Diagnosis, Verdict};
use hysteron::watch::{Unwatched, Watch, WatchEvent};
use hysteron_sim::chain::{Drive, EffectInstance, InitialState, Model};
use hysteron_sim::effect::{Overview, by_id};
use hysteron_sim::noise::WhiteNoise;
use hysteron_sim::waveform;

const RATE_HZ: f64 = 2000.0;
const NOISE_UM: f64 = 0.002;

fn stage(creep: bool) -> Model {
    let mut model = Model::new(0.0, 10.0);
    let creep = creep.then_some((
        "creep",
        [0.02, 0.01, 0.02, 0.06, 0.02, 0.3, 0.02, 2.0].as_slice(),
    ));
    for (id, values) in [("gain", [0.1].as_slice()), ("vibration", &[1500.0, 0.1])]
        .into_iter()
        .chain(creep)
    {
        model.add(EffectInstance::new(
            by_id(id).unwrap(),
            &Overview::without_data(0.0, 10.0),
            values,
        ));
    }
    model
}

/// Records declared to begin virgin; of the second one the first samples are cut away.
fn recorded(model: &Model, cut_samples: usize) -> Dataset {
    let lines: Vec<usize> = (1..=150).step_by(4).collect();
    let drives = [
        (
            "multisine",
            Role::Identify,
            waveform::multisine(500, &lines, 4.0, 5.0, 8, 3),
        ),
        (
            "steps",
            Role::Identify,
            waveform::steps(
                RATE_HZ,
                &[(0.0, 0.1), (6.0, 0.4), (2.0, 0.6), (8.0, 0.6), (1.0, 0.4)],
            ),
        ),
        (
            "held_out",
            Role::Validate,
            waveform::multisine(400, &lines, 3.0, 5.0, 8, 4),
        ),
        ("rest", Role::Noise, vec![0.0; 4000]),
    ];
    let record = |(i, (name, role, drive_v)): (usize, (&str, Role, Vec<f64>))| {
        let drive = Drive::held(&drive_v, 1.0 / RATE_HZ, InitialState::Virgin);
        let mut noise = WhiteNoise::new(NOISE_UM, 100 + i as u64);
        let readings: Vec<f64> = model
            .simulate(&drive)
            .into_iter()
            .map(|y| y + noise.next_um())
            .collect();
        let from = if name == "steps" { cut_samples } else { 0 };
        Record::new(
            name,
            RATE_HZ,
            drive_v[from..].to_vec(),
            readings[from..].to_vec(),
        )
        .from_virgin_state()
        .with_role(role)
    };
    let records = drives.into_iter().enumerate().map(record).collect();
    Dataset::new("recorded", 0.0, 10.0, records).unwrap()
}

fn explained(dataset: &Dataset, from: &str) -> Outcome {
    analyse(
        dataset,
        Start::Effects(&effects_named(from).unwrap()),
        &Options::default(),
        &Unwatched,
    )
    .unwrap()
}

/// Keeps what a run says that it does.
#[derive(Default)]
struct Told(std::sync::Mutex<Vec<String>>);

impl Watch for Told {
    fn event(&self, event: &WatchEvent<'_>) {
        self.0.lock().unwrap().push(event.to_string());
    }
}

/// Kinds of issues that a model shows, and in which records.
fn issues(d: &Diagnosis) -> Vec<(&str, Severity)> {
    d.issues
        .iter()
        .map(|issue| (issue.record.as_deref().unwrap_or_default(), issue.severity))
        .collect()
}

/// The sensor of one of four records was not connected: noise alone stands in its column, or a random walk.
/// Nothing is fitted.
#[test]
fn a_disconnected_sensor_blocks_without_a_single_fit() {
    for walks in [false, true] {
        let mut dataset = recorded(&stage(false), 0);
        let (mut noise, mut walk_um) = (WhiteNoise::new(0.2, 31), 0.0);
        dataset.records[0].displacement_um.iter_mut().for_each(|y| {
            walk_um = if walks { walk_um } else { 0.0 } + noise.next_um();
            *y = walk_um;
        });
        let told = Told::default();
        let gain = effects_named("gain").unwrap();
        let found = analyse(&dataset, Start::Effects(&gain), &Options::default(), &told).unwrap();
        let d = &found.diagnosis;
        assert_eq!(
            (d.verdict, d.reason),
            (Verdict::Undecidable, Some(Reason::NotAnswered)),
            "{}",
            d.sentence
        );
        assert!(
            d.named.is_empty() && found.steps.len() == 1,
            "{}",
            d.sentence
        );
        assert_eq!(
            issues(d),
            [("multisine", Severity::Blocks)],
            "{:?}",
            d.issues
        );
        assert!(
            d.sentence
                .contains("multisine: the readings do not answer the drive"),
            "{}",
            d.sentence
        );
        // The values are those that a gain begins with, and no work was announced.
        let unfitted = EffectInstance::new(by_id("gain").unwrap(), &dataset.overview(), &[]);
        assert_eq!(found.model.effects[0].values(), unfitted.values());
        assert!(
            told.0.lock().unwrap().is_empty(),
            "{:?}",
            told.0.lock().unwrap()
        );
    }
}

/// A sensor's zero is off by 20 nm in records that are specified to begin virgin: that is no drift, and what
/// is missing beside it is named all the same.
#[test]
fn a_sensor_whose_zero_is_off_is_corrected_and_no_drift() {
    let mut dataset = recorded(&stage(false), 0);
    dataset
        .records
        .iter_mut()
        .flat_map(|record| &mut record.displacement_um)
        .for_each(|y| *y += 0.02);
    let found = explained(&dataset, "gain");
    let d = &found.diagnosis;
    assert!(
        d.verdict == Verdict::Named && d.named == ["vibration"],
        "{}",
        d.sentence
    );
    let corrected = found.corrected.as_ref().unwrap();
    let offsets = d.issues.iter().filter(|i| {
        matches!(i.kind, IssueKind::SensorOffset { .. }) && i.severity == Severity::Corrects
    });
    assert_eq!(offsets.count(), 3, "{:?}", d.issues);
    assert!(corrected.records[..3].iter().all(|r| r.offset_is_fitted));
}

/// A target that slips while the stage moves: the readings count without the jump, and what is missing is named.
#[test]
fn a_reading_that_jumps_and_stays_is_corrected() {
    let mut dataset = recorded(&stage(true), 0);
    let clean = dataset.clone();
    dataset.records[0]
        .displacement_um
        .iter_mut()
        .skip(2345)
        .for_each(|y| *y += 0.15);
    let found = explained(&dataset, "gain");
    let d = &found.diagnosis;
    assert_eq!(d.named, explained(&clean, "gain").diagnosis.named);
    let jumps = |i: &&Issue| matches!(i.kind, IssueKind::SensorJump { sample: 2345, .. });
    let jumps: Vec<&Issue> = d.issues.iter().filter(jumps).collect();
    assert_eq!(jumps.len(), 1, "{:?}", d.issues);
    assert_eq!(jumps[0].severity, Severity::Corrects);
    let corrected = &found.corrected.as_ref().unwrap().records[0];
    assert_eq!(corrected.steps_at, [2345]);
    assert!(found.last().error_um() < 1.15 * NOISE_UM, "{}", d.sentence);
}

/// A record that was cut in the middle of its motion begins with what creep and the mode were doing there.
#[test]
fn a_record_that_begins_otherwise_is_said_and_nothing_is_named() {
    let dataset = recorded(&stage(true), 350);
    let d = explained(&dataset, "gain,vibration,creep").diagnosis;
    assert_eq!(d.verdict, Verdict::Undecidable, "{}", d.sentence);
    assert!(
        d.named.is_empty() && d.findings.is_empty(),
        "{}",
        d.sentence
    );
    assert_eq!(d.reason, Some(Reason::InitialState), "{}", d.sentence);
    assert_eq!(issues(&d), [("steps", Severity::Blocks)], "{:?}", d.issues);
    // Said as it is, nothing is missing.
    let mut unsaid = dataset;
    for record in unsaid.records.iter_mut().filter(|r| r.name == "steps") {
        (record.initial_state, record.offset_is_fitted) = (InitialState::Unknown, true);
    }
    let d = explained(&unsaid, "gain,vibration,creep").diagnosis;
    assert_eq!(d.verdict, Verdict::AtFloor, "{}", d.sentence);
}

/// Where records begin as declared, a missing effect is not put down to their states, and no issue mentions
/// them.
#[test]
fn a_missing_effect_is_no_other_state() {
    let d = explained(&recorded(&stage(true), 0), "gain,vibration").diagnosis;
    assert_eq!(d.named, ["creep"], "{}", d.sentence);
    assert_eq!(issues(&d), [], "{:?}", d.issues);
    let d = explained(&recorded(&stage(false), 0), "gain").diagnosis;
    assert_eq!(d.named, ["vibration"], "{}", d.sentence);
    assert_eq!(issues(&d), [], "{:?}", d.issues);
    // A drift from each record's first sample on is met by unknown states of creep too, which are many more
    // values.
    let mut drifting = stage(true);
    drifting.add(EffectInstance::new(
        by_id("thermal_drift").unwrap(),
        &Overview::without_data(0.0, 10.0),
        &[0.05, 0.5],
    ));
    let d = explained(&recorded(&drifting, 0), "gain,vibration,creep").diagnosis;
    assert_eq!(d.named, ["thermal_drift"], "{}", d.sentence);
    assert_eq!(issues(&d), [], "{:?}", d.issues);
}

/// The same stage in a loop with an integrating controller, whose drive was recorded: what was found stands,
/// and an issue reports the loop.
#[test]
fn a_loop_that_was_closed_while_recording_is_said() {
    let samples = 8000;
    let mut dataset = recorded(&stage(false), 0);
    let reference_um =
        |k: usize| 0.5 - 0.3 * (k as f64 * 0.02).cos() + 0.1 * (k as f64 * 0.31).sin();
    let mut chain = StepByStep::new();
    let mut noise = WhiteNoise::new(NOISE_UM, 900);
    let (mut drive_v, mut readings) = (Vec::new(), Vec::new());
    let mut u = 5.0;
    for k in 0..samples {
        let reading_um = chain.displacement_um + noise.next_um();
        readings.push(reading_um);
        u += 1.5 * (reference_um(k) - reading_um);
        u = u.clamp(0.0, 10.0);
        drive_v.push(u);
        chain.held(u);
    }
    dataset
        .records
        .push(Record::new("in_a_loop", RATE_HZ, drive_v, readings));
    let dataset = Dataset::new("recorded", 0.0, 10.0, dataset.records).unwrap();
    let d = explained(&dataset, "gain").diagnosis;
    assert!(d.named.contains(&"vibration".to_owned()), "{}", d.sentence);
    assert_eq!(
        issues(&d),
        [("in_a_loop", Severity::Notes)],
        "{:?}",
        d.issues
    );
    assert!(
        d.sentence
            .contains("in_a_loop: the drive answers the noise of the readings"),
        "{}",
        d.sentence
    );
}

/// The stage with a mode, one held interval after another, in fine steps.
struct StepByStep {
    displacement_um: f64,
    velocity_um_per_s: f64,
}

impl StepByStep {
    fn new() -> Self {
        Self {
            displacement_um: 0.5,
            velocity_um_per_s: 0.0,
        }
    }

    fn held(&mut self, drive_v: f64) {
        const STEPS: usize = 50;
        let (w, z, dt_s) = (1500.0, 0.1, 1.0 / RATE_HZ / STEPS as f64);
        for _ in 0..STEPS {
            let acceleration = w * w * (0.1 * drive_v - self.displacement_um)
                - 2.0 * z * w * self.velocity_um_per_s;
            self.velocity_um_per_s += dt_s * acceleration;
            self.displacement_um += dt_s * self.velocity_um_per_s;
        }
    }
}

/// A smooth drive with same-sample timing: a mode as fast as the recording can show makes up for the period,
/// and is not named.
#[test]
fn readings_of_their_own_row_are_no_mode() {
    let smooth = |k: usize, fast: f64| {
        5.0 - 2.5 * (k as f64 * 0.02 * fast).cos() - 1.5 * (k as f64 * 0.11 * fast).sin()
    };
    let records = [
        ("fitted", Role::Identify, 1.0),
        ("held_out", Role::Validate, 1.3),
        ("rest", Role::Noise, 0.0),
    ];
    let record = |(i, (name, role, fast)): (usize, (&str, Role, f64))| {
        let mut noise = WhiteNoise::new(NOISE_UM, 300 + i as u64);
        let drive_v: Vec<f64> = (0..8000).map(|k| smooth(k, fast)).collect();
        let readings = drive_v.iter().map(|u| 0.1 * u + noise.next_um()).collect();
        Record::new(name, RATE_HZ, drive_v, readings).with_role(role)
    };
    let mut dataset = Dataset::new(
        "own_row",
        0.0,
        10.0,
        records.into_iter().enumerate().map(record).collect(),
    )
    .unwrap();
    // As of a file that does not say when a drive acts; where it does, nobody is contradicted.
    dataset.timing_is_assumed = true;
    let gain = effects_named("gain").unwrap();
    let run = |dataset: &Dataset| {
        analyse(
            dataset,
            Start::Effects(&gain),
            &Options::default(),
            &Unwatched,
        )
        .unwrap()
    };
    // The answer is of the recording as it was timed, and reports that timing.
    let found = run(&dataset);
    let timed = found
        .corrected
        .as_ref()
        .expect("the timing that the readings show");
    let is_timing = |i: &Issue| {
        matches!(i.kind, IssueKind::SameSampleTiming { .. }) && i.severity == Severity::Corrects
    };
    assert!(
        !timed.timing_is_assumed && found.diagnosis.issues.iter().any(is_timing),
        "{:?}",
        found.diagnosis.issues
    );
    assert_eq!(
        (found.diagnosis.verdict, found.model.effect_ids()),
        (Verdict::AtFloor, vec!["gain".to_owned()]),
        "{}",
        found.diagnosis.sentence
    );
    dataset.timing_is_assumed = false;
    let issues = run(&dataset).diagnosis.issues;
    assert!(
        issues
            .iter()
            .all(|i| !matches!(i.kind, IssueKind::SameSampleTiming { .. })),
        "{issues:?}"
    );
}

/// A rest of which next to nothing counts is refused for that, whatever its readings.
#[test]
fn a_rest_that_is_too_short_is_refused() {
    let moves = Record::new(
        "moves",
        1000.0,
        [0.0, 40.0].repeat(1000),
        [0.0, 3.1].repeat(1000),
    );
    let mut rest =
        Record::new("rest", 1000.0, vec![0.0; 2000], vec![0.0; 2000]).with_role(Role::Noise);
    rest.window = 0..10;
    let refused = Dataset::new("short", 0.0, 80.0, vec![moves, rest])
        .unwrap_err()
        .to_string();
    assert!(
        refused.contains("has 10 samples inside its window"),
        "{refused}"
    );
}

/// A rest in which all readings are the same is no error: of a converter with steps it shows that the noise
/// is below a step, of one without it shows nothing.
#[test]
fn a_rest_without_noise_is_noted() {
    for (step_um, is_left_out) in [(Some(0.01), false), (None, true)] {
        let drive_v: Vec<f64> = (0..4000)
            .map(|k| 40.0 * (1.0 - (0.003 * f64::from(k)).cos()))
            .collect();
        let read = |um: f64| step_um.map_or(um, |step_um| step_um * (um / step_um).round());
        let moves = Record::new(
            "moves",
            1000.0,
            drive_v.clone(),
            drive_v.iter().map(|v| read(0.07931 * v)).collect(),
        );
        let rest =
            Record::new("rest", 1000.0, vec![0.0; 2000], vec![0.0; 2000]).with_role(Role::Noise);
        let dataset = Dataset::new("quiet", 0.0, 80.0, vec![moves, rest]).unwrap();
        assert_eq!(dataset.with_role(Role::Noise).is_empty(), is_left_out);
        let noted = dataset
            .issues
            .iter()
            .find(|i| i.record.as_deref() == Some("rest"))
            .map(|i| &i.kind);
        assert_eq!(
            noted,
            Some(&IssueKind::RestWithoutNoise {
                in_steps: step_um.is_some()
            })
        );
    }
}
