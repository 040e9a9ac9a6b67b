//! Invariant 5 of ARCHITECTURE.md: an effect is named only with evidence. The comparison of models on
//! residuals made for it, and the evidence beside every name on data that end in each kind of verdict.

use hysteron::analyse::{Options, Outcome, Start, analyse};
use hysteron::dataset::{Dataset, Record, Role};
use hysteron::diagnosis::confidence_set::{Fate, Losses};
use hysteron::diagnosis::judgement::Judged;
use hysteron::diagnosis::policy::Policy;
use hysteron::diagnosis::selection::confidence_set_in;
use hysteron::diagnosis::study::Study;
use hysteron::diagnosis::verdict::Reason;
use hysteron::identification::noise_floor::NoiseFloor;
use hysteron::identify::identify;
use hysteron::model_file::effects_named;
use hysteron::outcome::{Evidence, Standing, Verdict};
use hysteron::watch::{Unwatched, Watch, WatchEvent};
use hysteron_sim::chain::{Drive, EffectInstance, InitialState, Model};
use hysteron_sim::effect::{Overview, by_id};
use hysteron_sim::noise::WhiteNoise;
use hysteron_sim::waveform;
use std::sync::atomic::{AtomicUsize, Ordering};

const SAMPLES: usize = 4000;

/// Noise of a standard deviation; the same seed gives the same numbers.
fn noise(seed: u64, std: f64) -> Vec<f64> {
    let mut noise = WhiteNoise::new(std, seed);
    (0..SAMPLES).map(|_| noise.next_um()).collect()
}

fn scaled(values: &[f64], by: f64) -> Vec<f64> {
    values.iter().map(|v| by * v).collect()
}

fn rms(values: &[f64]) -> f64 {
    (values.iter().map(|v| v * v).sum::<f64>() / values.len() as f64).sqrt()
}

/// A fitted record and one that judges.
fn records() -> Dataset {
    let drive_v: Vec<f64> = (0..SAMPLES)
        .map(|k| 5.0 - 5.0 * (k as f64 * 0.01).cos())
        .collect();
    let record = |name: &str| Record::new(name, 1000.0, drive_v.clone(), scaled(&drive_v, 0.1));
    Dataset::new(
        "t",
        0.0,
        10.0,
        vec![
            record("fitted"),
            record("judging").with_role(Role::Validate),
        ],
    )
    .unwrap()
}

fn judged(fitted: Vec<f64>, held_out: Vec<f64>) -> Judged {
    let (identify_rms_um, validate_rms_um) = (rms(&fitted), Some(rms(&held_out)));
    Judged {
        model: Model::new(0.0, 10.0),
        residuals: vec![fitted, held_out],
        identify_rms_um,
        validate_rms_um,
    }
}

/// A floor that is the same in all records, or none.
fn known(rms_um: Option<f64>, records: usize) -> NoiseFloor {
    NoiseFloor {
        rms_um,
        basis: "said".into(),
        of_records_um: vec![rms_um; records],
        at_least_um: None,
        estimates: Vec::new(),
        one_over_f: None,
        one_over_f_relative_std: 0.0,
        reading_step_um: None,
        lines_at_rest: hysteron_sim::effect::LinesAtRest::default(),
        warnings: Vec::new(),
        read_back: None,
        of_readings_um: vec![rms_um; records],
        of_readings_warnings: Vec::new(),
    }
}

/// How the second of two models fares whose residuals are so many times the noise on the fitted and on the
/// held-out record.
fn fate(floor_um: Option<f64>, best: (f64, f64), other: (f64, f64)) -> Fate {
    let dataset = records();
    let study = Study::new(
        &dataset,
        Vec::new(),
        &known(floor_um, dataset.records.len()),
        Policy::default(),
        &Unwatched,
    );
    let (a, b) = (noise(1, 1.0), noise(2, 1.0));
    let (a, b) = (scaled(&a, 1.0 / rms(&a)), scaled(&b, 1.0 / rms(&b)));
    let losses = [best, other].map(|(fitted, held_out)| {
        Losses::of_judged(&study, &judged(scaled(&a, fitted), scaled(&b, held_out)))
    });
    confidence_set_in(&study, &losses.each_ref())[1]
}

fn is_rejected(fate: Fate) -> bool {
    matches!(fate, Fate::Rejected(by) if by > 0.0)
}

#[test]
fn at_the_noise_two_percent_of_the_error_matter() {
    assert_eq!(fate(Some(1.0), (1.0, 1.0), (1.0, 1.0)), Fate::Kept);
    assert_eq!(fate(Some(1.0), (1.0, 1.0), (1.015, 1.015)), Fate::Kept);
    assert!(is_rejected(fate(Some(1.0), (1.0, 1.0), (1.2, 1.2))));
}

#[test]
fn one_record_shows_an_effect_unless_the_other_gets_worse() {
    assert!(is_rejected(fate(Some(1.0), (1.0, 1.0), (1.0, 1.3))));
    assert!(is_rejected(fate(Some(1.0), (1.0, 1.0), (1.3, 1.0))));
    assert_eq!(fate(Some(1.0), (1.0, 1.2), (1.3, 1.0)), Fate::Kept);
}

#[test]
fn above_the_noise_a_difference_matters_that_exceeds_the_remainder() {
    assert_eq!(fate(Some(1.0), (20.0, 20.0), (25.0, 25.0)), Fate::Kept);
    assert!(is_rejected(fate(Some(1.0), (34.0, 34.0), (1117.0, 1117.0))));
    // Without a noise all that is left may be the remainder.
    assert_eq!(fate(None, (3.0, 3.0), (3.6, 3.6)), Fate::Kept);
    assert!(is_rejected(fate(None, (3.0, 3.0), (5.0, 5.0))));
}

/// What each record was driven with, and the readings of a chain with noise.
fn recorded(
    chain: &[(&str, &[f64])],
    noise_um: f64,
    lsb_um: f64,
    held_out: bool,
    rest: bool,
) -> Dataset {
    const RATE_HZ: f64 = 2000.0;
    let mut model = Model::new(0.0, 10.0);
    for (id, values) in chain {
        model.add(EffectInstance::new(
            by_id(id).unwrap(),
            &Overview::without_data(0.0, 10.0),
            values,
        ));
    }
    let lines: Vec<usize> = (1..=150).step_by(4).collect();
    let drives = [
        (
            "multisine",
            Role::Identify,
            waveform::multisine(500, &lines, 4.0, 5.0, 4, 3),
        ),
        (
            "steps",
            Role::Identify,
            waveform::steps(RATE_HZ, &[(0.0, 0.1), (6.0, 0.4), (2.0, 0.4)]),
        ),
        (
            "other_multisine",
            Role::Validate,
            waveform::multisine(400, &lines, 3.0, 5.0, 4, 4),
        ),
        ("rest", Role::Noise, vec![0.0; 2000]),
    ];
    let wanted =
        |role: &Role| (held_out || *role != Role::Validate) && (rest || *role != Role::Noise);
    let record = |(i, (name, role, drive_v)): (usize, (&str, Role, Vec<f64>))| {
        let drive = Drive::held(&drive_v, 1.0 / RATE_HZ, InitialState::Virgin);
        let mut noise = WhiteNoise::new(noise_um, 100 + i as u64);
        let read = |y: f64| {
            if lsb_um > 0.0 {
                (y / lsb_um).round() * lsb_um
            } else {
                y
            }
        };
        let readings = model
            .simulate(&drive)
            .into_iter()
            .map(|y| read(y + noise.next_um()))
            .collect();
        Record::new(name, RATE_HZ, drive_v, readings)
            .from_virgin_state()
            .with_role(role)
    };
    let records = drives
        .into_iter()
        .filter(|(_, role, _)| wanted(role))
        .enumerate()
        .map(record)
        .collect();
    Dataset::new("recorded", 0.0, 10.0, records).unwrap()
}

/// Every name has a finding with evidence and a candidate; a verdict without names has none, and says why
/// where nothing can be decided.
fn holds_invariant_5(found: &Outcome) {
    let d = &found.diagnosis;
    for name in &d.named {
        let finding = d
            .findings
            .iter()
            .find(|f| f.effects.contains(name))
            .unwrap_or_else(|| panic!("{name} without finding: {}", d.sentence));
        if let Evidence::Models { without, with, .. } = finding.evidence {
            assert!(
                with.identify < without.identify || with.validate < without.validate,
                "{name}: {:?}",
                finding.evidence
            );
            // Better on one side alone is no evidence: on no side is the model without it better.
            let worse = |with: f64, without: f64| with * with > 1.04 * without * without;
            let held_out = with.validate.zip(without.validate);
            assert!(
                !worse(with.identify, without.identify)
                    && held_out.is_none_or(|(with, without)| !worse(with, without)),
                "{name}: {:?}",
                finding.evidence
            );
        }
        let candidate = d
            .candidates
            .iter()
            .find(|c| c.effect == *name)
            .unwrap_or_else(|| panic!("{name} is no candidate: {}", d.sentence));
        let stands = matches!(
            candidate.standing,
            Standing::Named | Standing::Alternative | Standing::InTheReadings
        );
        assert!(stands, "{name}: {:?}", candidate.standing);
    }
    match d.verdict {
        Verdict::Named | Verdict::Ambiguous => assert!(!d.named.is_empty()),
        Verdict::AtFloor | Verdict::Unexplained => {
            assert!(d.named.is_empty() && d.reason.is_none(), "{}", d.sentence)
        }
        Verdict::Undecidable => assert!(d.reason.is_some(), "{}", d.sentence),
    }
}

fn explained(dataset: &Dataset, from: &str) -> Outcome {
    let effects = effects_named(from).unwrap();
    let found = analyse(
        dataset,
        Start::Effects(&effects),
        &Options::default(),
        &Unwatched,
    )
    .unwrap();
    holds_invariant_5(&found);
    found
}

const MODE: (&str, &[f64]) = ("vibration", &[1500.0, 0.1]);

/// Time that is over once so many models were tried.
struct TimeByTrials {
    most: usize,
    tried: AtomicUsize,
}

impl Watch for TimeByTrials {
    fn event(&self, event: &WatchEvent<'_>) {
        if matches!(event, WatchEvent::Tried { .. }) {
            self.tried.fetch_add(1, Ordering::Relaxed);
        }
    }
    fn time_used(&self) -> f64 {
        f64::from(self.tried.load(Ordering::Relaxed) >= self.most)
    }
}

/// A search whose time is over decides nothing of what it has not looked for, and weighs what it has found.
#[test]
fn a_search_whose_time_is_over_does_not_say_that_the_library_has_nothing() {
    let dataset = recorded(&[("gain", &[0.1]), MODE], 0.002, 0.0, true, true);
    let gain = effects_named("gain").unwrap();
    let within = |most: usize| {
        let watch = TimeByTrials {
            most,
            tried: AtomicUsize::new(0),
        };
        analyse(&dataset, Start::Effects(&gain), &Options::default(), &watch).unwrap()
    };
    let nothing = within(0);
    let (d, notes) = (&nothing.diagnosis, &nothing.floor.warnings);
    assert_eq!(
        (d.verdict, d.named.len()),
        (Verdict::Undecidable, 0),
        "{}",
        d.sentence
    );
    assert!(
        d.reason == Some(Reason::OutOfTime)
            && notes.iter().any(|n| n.contains("a longer --within")),
        "{} {notes:?}",
        d.sentence
    );
    // The mode is found in the first round, which comes to the noise, and nobody tried to do without it.
    let d = within(1).diagnosis;
    assert_eq!(
        (d.verdict, d.reason, d.named.len(), &d.so_far),
        (
            Verdict::Undecidable,
            Some(Reason::OutOfTime),
            0,
            &vec!["vibration".to_owned()]
        ),
        "{}",
        d.sentence
    );
    let all = within(usize::MAX);
    assert_eq!(
        (all.diagnosis.verdict, &all.diagnosis.named),
        (Verdict::Named, &vec!["vibration".to_owned()]),
        "{}",
        all.diagnosis.sentence
    );
    assert!(
        all.floor
            .warnings
            .iter()
            .all(|note| !note.contains("ended before")),
        "{:?}",
        all.floor.warnings
    );
}

/// A budget of steps is kept, and the same one brings the same answer.
#[test]
fn a_search_keeps_to_its_steps_and_ends_alike() {
    let dataset = recorded(&[("gain", &[0.1]), MODE], 0.002, 0.0, true, true);
    let gain = effects_named("gain").unwrap();
    let with = |most_steps: f64| {
        let mut options = Options::default();
        options.policy.most_steps = most_steps;
        let found = analyse(&dataset, Start::Effects(&gain), &options, &Unwatched).unwrap();
        (found.work.steps(), found.diagnosis.sentence)
    };
    let (whole, _) = with(f64::INFINITY);
    let most = 0.5 * whole as f64;
    let half = with(most);
    // A round that begins within its share comes to its end, and here there are few.
    assert!(10 * half.0 < 8 * whole, "{} of {whole}", half.0);
    assert_eq!(half, with(most));
    // More time would not help.
    let (_, sentence) = with(1.0);
    assert!(sentence.contains("larger most_steps"), "{sentence}");
}

/// Stops where something begins.
struct StopsAt(&'static str, AtomicUsize);

impl Watch for StopsAt {
    fn event(&self, event: &WatchEvent<'_>) {
        if matches!(event, WatchEvent::Doing(what) if *what == self.0) {
            self.1.store(1, Ordering::Relaxed);
        }
    }

    fn stopped(&self) -> bool {
        self.1.load(Ordering::Relaxed) > 0
    }
}

#[test]
fn who_stops_while_names_are_tested_reads_that_it_was_stopped() {
    let dataset = recorded(&[("gain", &[0.1]), MODE], 0.002, 0.0, true, true);
    let gain = effects_named("gain").unwrap();
    for doing in [
        "searching without what would be named",
        "weighing the evidence for each effect",
        "fitting to the end",
    ] {
        let watch = StopsAt(doing, AtomicUsize::new(0));
        let found = analyse(&dataset, Start::Effects(&gain), &Options::default(), &watch).unwrap();
        let d = found.diagnosis;
        assert!(found.stopped && watch.stopped(), "{doing}");
        assert_eq!(
            (d.verdict, d.reason, d.named.len(), &d.so_far),
            (
                Verdict::Undecidable,
                Some(Reason::Stopped),
                0,
                &vec!["vibration".to_owned()]
            ),
            "{doing}: {}",
            d.sentence
        );
    }
}

/// Too short for a coherence of both.
#[test]
fn two_signals_with_nothing_in_common_are_no_stage() {
    let record = |seed: u64| {
        let drive_v = noise(seed, 1.0).iter().map(|v| 5.0 + v).collect();
        Record::new(format!("r{seed}"), 1000.0, drive_v, noise(seed + 1, 0.1))
    };
    let mut records = vec![record(1), record(3).with_role(Role::Validate)];
    for record in &mut records {
        record.window = 0..1500;
        record.offset_is_fitted = true;
    }
    let dataset = Dataset::new("t", -5.0, 15.0, records).unwrap();
    let gain = effects_named("gain").unwrap();
    let found = analyse(
        &dataset,
        Start::Effects(&gain),
        &Options::default(),
        &Unwatched,
    )
    .unwrap();
    let d = found.diagnosis;
    assert_eq!(
        (d.verdict, d.reason),
        (Verdict::Undecidable, Some(Reason::NotAnswered)),
        "{}",
        d.sentence
    );
    assert!(d.sentence.contains("nothing in common"), "{}", d.sentence);
}

#[test]
fn a_name_rests_on_held_out_records_or_says_that_there_are_none() {
    let chain: [(&str, &[f64]); 2] = [("gain", &[0.1]), MODE];
    let found = explained(&recorded(&chain, 0.002, 0.0, true, true), "gain");
    assert_eq!(
        found.diagnosis.named,
        ["vibration"],
        "{}",
        found.diagnosis.sentence
    );
    let found = explained(&recorded(&chain, 0.002, 0.0, false, true), "gain");
    assert_eq!(
        found.diagnosis.named,
        ["vibration"],
        "{}",
        found.diagnosis.sentence
    );
    let found = explained(&recorded(&chain, 0.002, 0.0, true, true), "gain,vibration");
    assert_eq!(
        found.diagnosis.verdict,
        Verdict::AtFloor,
        "{}",
        found.diagnosis.sentence
    );
}

/// A held-out record of a stage with twice the gain moves the error there and no value.
#[test]
fn a_held_out_record_is_never_fitted() {
    let gain_of = |held_out_um_v: f64| {
        let mut dataset = records();
        let held_out = &mut dataset.records[1];
        held_out.displacement_um = scaled(&held_out.drive_v, held_out_um_v);
        let effects = effects_named("gain").unwrap();
        let model = identify(&dataset, &effects, &Unwatched).unwrap().model;
        model.effects[0].parameters[0].value
    };
    assert_eq!(gain_of(0.2), gain_of(0.1));
}

#[test]
fn the_steps_of_a_converter_are_named_by_the_readings_alone() {
    let found = explained(
        &recorded(&[("gain", &[0.1]), MODE], 0.002, 0.01, true, true),
        "gain,vibration",
    );
    let finding = found
        .diagnosis
        .findings
        .iter()
        .find(|f| f.effects == ["quantisation"])
        .unwrap();
    assert_eq!(finding.evidence, Evidence::Readings);
}

#[test]
fn beside_a_prior_model_an_effect_that_alone_explains_it_is_named() {
    let model = explained(
        &recorded(&[("gain", &[0.1]), MODE], 0.002, 0.0, true, true),
        "gain,vibration",
    )
    .model;
    let lagging = recorded(
        &[("gain", &[0.1]), MODE, ("sensor_bandwidth", &[120.0])],
        0.002,
        0.0,
        true,
        true,
    );
    let found = analyse(
        &lagging,
        Start::Model(model),
        &Options::default(),
        &Unwatched,
    )
    .unwrap();
    holds_invariant_5(&found);
    // A lag in front of a mode does the same as one behind it: both are named.
    assert!(
        found
            .diagnosis
            .named
            .contains(&"sensor_bandwidth".to_owned()),
        "{}",
        found.diagnosis.sentence
    );
    assert!(
        found.diagnosis.findings[0]
            .effects
            .contains(&"sensor_bandwidth".to_owned())
    );
}
