//! Invariant 5 of ARCHITECTURE.md: an effect is named only by a rule. Every rule of the decision on residuals made for it, and the rule beside
//! every name on data that end in each kind of verdict.

use hysteron::dataset::{Dataset, Record, Role};
use hysteron::diagnosis::decision::{Decision, decide};
use hysteron::diagnosis::judgement::Judged;
use hysteron::diagnosis::policy::Policy;
use hysteron::diagnosis::study::Study;
use hysteron::diagnosis::verdict::Verdict;
use hysteron::explain::{Explanation, Options, Start, explain};
use hysteron::identification::noise_floor::NoiseFloor;
use hysteron::model_file::effects_named;
use hysteron::watch::{Event, Unwatched, Watch};
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

/// A fitted record and, perhaps, one that judges.
fn records(held_out: bool) -> Dataset {
    let drive_v: Vec<f64> = (0..SAMPLES).map(|k| 5.0 - 5.0 * (k as f64 * 0.01).cos()).collect();
    let record = |name: &str| Record::new(name, 1000.0, drive_v.clone(), scaled(&drive_v, 0.1));
    let mut all = vec![record("fitted")];
    if held_out {
        all.push(record("judging").with_role(Role::Validate));
    }
    Dataset::new("t", 0.0, 10.0, all).unwrap()
}

fn judged(fitted: Vec<f64>, held_out: Option<Vec<f64>>) -> Judged {
    let (identify_rms_um, validate_rms_um) = (rms(&fitted), held_out.as_deref().map(rms));
    Judged { model: Model::new(0.0, 10.0), residuals: std::iter::once(fitted).chain(held_out).collect(), identify_rms_um, validate_rms_um }
}

/// A floor that is the same in all records, or none.
fn known(rms_um: Option<f64>, records: usize) -> NoiseFloor {
    NoiseFloor {
        rms_um,
        basis: "said".into(),
        of_records_um: vec![rms_um; records],
        at_least_um: None,
        estimates: Vec::new(),
        wander: None,
        wander_relative_std: 0.0,
        reading_step_um: None,
        lines_at_rest: hysteron_sim::effect::LinesAtRest::default(),
        warnings: Vec::new(),
        read_back: None,
        of_readings_um: vec![rms_um; records],
        of_readings_warnings: Vec::new(),
    }
}

/// What is decided where the residuals of fitted and held-out record go from one size to another, the noise being 1 where it is known.
fn decided(floor_um: Option<f64>, fitted: (f64, f64), held_out: Option<(f64, f64)>, p: Option<f64>) -> Decision {
    let dataset = records(held_out.is_some());
    let floor = known(floor_um, dataset.records.len());
    let study = Study::new(&dataset, Vec::new(), &floor, Policy::default(), &Unwatched);
    let (a, b) = (noise(1, 1.0), noise(2, 1.0));
    let (a, b) = (scaled(&a, 1.0 / rms(&a)), scaled(&b, 1.0 / rms(&b)));
    let at = |fitted: f64, held_out: Option<f64>| judged(scaled(&a, fitted), held_out.map(|size| scaled(&b, size)));
    decide(&study, &at(fitted.0, held_out.map(|h| h.0)), &at(fitted.1, held_out.map(|h| h.1)), p)
}

#[test]
fn what_is_not_in_the_residual_is_refused_unless_it_reaches_the_noise() {
    let refused = decided(Some(1.0), (3.0, 2.0), Some((3.0, 2.0)), Some(0.2));
    assert_eq!(refused, Decision::NotInTheResidual { p: 0.2 });
    assert!(!refused.admits());
    assert_eq!(decided(Some(1.0), (1.5, 1.0), Some((1.5, 1.0)), Some(0.2)), Decision::ReachesTheFloor);
    // From barely above what counts as the noise to barely below it, by less than matters.
    assert!(matches!(decided(Some(1.0), (1.06, 1.045), Some((1.06, 1.045)), None), Decision::TooSmall { .. }));
    // A ring behind each of a few steps: signs say little of few events, errors that fall to less than half do.
    assert!(matches!(decided(Some(1.0), (800.0, 1.3), Some((900.0, 1.3)), Some(0.2)), Decision::HeldOutErrorFalls { .. }));
    assert_eq!(decided(Some(1.0), (800.0, 1.3), Some((900.0, 600.0)), Some(0.2)), Decision::NotInTheResidual { p: 0.2 });
    // Reached where it was fitted only.
    assert!(!matches!(decided(Some(1.0), (1.5, 1.0), Some((1.5, 1.5)), None), Decision::ReachesTheFloor));
}

#[test]
fn a_held_out_error_that_falls_by_more_than_chance_admits() {
    let admitted = decided(Some(1.0), (3.0, 2.7), Some((3.0, 2.7)), Some(0.01));
    let Decision::HeldOutErrorFalls { z, relative } = admitted else { panic!("{admitted:?}") };
    assert!(z > 2.0 && (relative - 0.1).abs() < 1e-9 && admitted.admits());
    assert!(matches!(decided(Some(1.0), (3.0, 2.95), Some((3.0, 2.95)), Some(0.01)), Decision::TooSmall { .. }));
}

#[test]
fn what_the_held_out_records_do_not_show_must_be_beyond_doubt_and_must_not_harm_them() {
    let admitted = decided(Some(1.0), (3.0, 2.0), Some((3.0, 3.0)), Some(0.01));
    assert!(matches!(admitted, Decision::SeenBeyondDoubt { z, .. } if z > 5.0), "{admitted:?}");
    assert!(admitted.admits());
    let refused = decided(Some(1.0), (3.0, 2.0), Some((3.0, 3.3)), Some(0.01));
    assert!(matches!(refused, Decision::HeldOutErrorDoesNotFall { relative, .. } if relative < 0.0), "{refused:?}");
    assert!(!refused.admits());
}

#[test]
fn without_a_known_noise_two_percent_of_the_held_out_error_are_asked() {
    assert!(matches!(decided(None, (3.0, 2.85), Some((3.0, 2.85)), None), Decision::HeldOutErrorFalls { .. }));
    assert!(matches!(decided(None, (3.0, 2.91), Some((3.0, 2.97)), None), Decision::HeldOutErrorDoesNotFall { .. }));
}

#[test]
fn where_nothing_judges_chance_is_excluded_the_more_clearly() {
    assert!(matches!(decided(Some(1.0), (3.0, 2.7), None, None), Decision::FittedErrorFalls { .. }));
    assert!(matches!(decided(Some(1.0), (3.0, 2.95), None, None), Decision::TooSmall { .. }));
}

/// What each record was driven with, and the readings of a chain with noise.
fn recorded(chain: &[(&str, &[f64])], noise_um: f64, lsb_um: f64, held_out: bool, rest: bool) -> Dataset {
    const RATE_HZ: f64 = 2000.0;
    let mut model = Model::new(0.0, 10.0);
    for (id, values) in chain {
        model.add(EffectInstance::new(by_id(id).unwrap(), &Overview::without_data(0.0, 10.0), values));
    }
    let lines: Vec<usize> = (1..=150).step_by(4).collect();
    let drives = [
        ("multisine", Role::Identify, waveform::multisine(500, &lines, 4.0, 5.0, 4, 3)),
        ("steps", Role::Identify, waveform::steps(RATE_HZ, &[(0.0, 0.1), (6.0, 0.4), (2.0, 0.4)])),
        ("other_multisine", Role::Validate, waveform::multisine(400, &lines, 3.0, 5.0, 4, 4)),
        ("rest", Role::Noise, vec![0.0; 2000]),
    ];
    let wanted = |role: &Role| (held_out || *role != Role::Validate) && (rest || *role != Role::Noise);
    let record = |(i, (name, role, drive_v)): (usize, (&str, Role, Vec<f64>))| {
        let drive = Drive { drive_v: &drive_v, force_n: None, auxiliary: &[], dt_s: 1.0 / RATE_HZ, initial_state: InitialState::Virgin };
        let mut noise = WhiteNoise::new(noise_um, 100 + i as u64);
        let read = |y: f64| if lsb_um > 0.0 { (y / lsb_um).round() * lsb_um } else { y };
        let readings = model.simulate(&drive).into_iter().map(|y| read(y + noise.next_um())).collect();
        Record::new(name, RATE_HZ, drive_v, readings).from_virgin_state().with_role(role)
    };
    let records = drives.into_iter().filter(|(_, role, _)| wanted(role)).enumerate().map(record).collect();
    Dataset::new("recorded", 0.0, 10.0, records).unwrap()
}

/// Every name has a finding and a candidate, each admitted by a rule; what was taken back was refused; the whole comes to the noise.
fn holds_invariant_5(found: &Explanation) {
    let d = &found.diagnosis;
    for name in &d.named {
        let finding =
            d.findings.iter().find(|f| f.effects.contains(name)).unwrap_or_else(|| panic!("{name} without finding: {}", d.sentence));
        assert!(finding.decision.admits(), "{name}: {:?}", finding.decision);
        let candidate = d.candidates.iter().find(|c| c.effect == *name).unwrap_or_else(|| panic!("{name} is no candidate: {}", d.sentence));
        assert!(candidate.decision.admits(), "{name}: {:?}", candidate.decision);
    }
    assert!(d.taken_back.iter().all(|(_, decision)| !decision.admits()), "{:?}", d.taken_back);
    let floor = &found.floor;
    let floors_um = if floor.rms_um.is_some() { floor.of_records_um.clone() } else { vec![floor.at_least_um; floor.of_records_um.len()] };
    match d.verdict {
        Verdict::Named | Verdict::Ambiguous => {
            assert!(!d.named.is_empty());
            assert!(found.last().within(Policy::default().explained, &floors_um, &found.split), "{}", d.sentence);
        }
        Verdict::AtFloor | Verdict::Unexplained => assert!(d.named.is_empty(), "{}", d.sentence),
        Verdict::Undecidable => assert!(floor.rms_um.is_none() || d.below_the_floor, "{}", d.sentence),
    }
}

fn explained(dataset: &Dataset, from: &str) -> Explanation {
    let effects = effects_named(from).unwrap();
    let found = explain(dataset, Start::Effects(&effects), &Options::default(), &Unwatched).unwrap();
    holds_invariant_5(&found);
    found
}

const MODE: (&str, &[f64]) = ("vibration", &[1500.0, 0.1]);

/// A search that has its time for so many looks at the clock.
struct LooksAtTheClock {
    most: usize,
    taken: AtomicUsize,
}

impl Watch for LooksAtTheClock {
    fn event(&self, _event: &Event<'_>) {}
    fn searched_enough(&self) -> bool {
        self.taken.fetch_add(1, Ordering::Relaxed) >= self.most
    }
}

/// A search whose time is over decides nothing of what it has not looked for, and weighs what it has found.
#[test]
fn a_search_whose_time_is_over_does_not_say_that_the_library_has_nothing() {
    let dataset = recorded(&[("gain", &[0.1]), MODE], 0.002, 0.0, true, true);
    let gain = effects_named("gain").unwrap();
    let within = |most: usize| {
        let watch = LooksAtTheClock { most, taken: AtomicUsize::new(0) };
        explain(&dataset, Start::Effects(&gain), &Options::default(), &watch).unwrap()
    };
    let nothing = within(0);
    let (d, notes) = (&nothing.diagnosis, &nothing.floor.warnings);
    assert_eq!((d.verdict, d.named.len()), (Verdict::Undecidable, 0), "{}", d.sentence);
    assert!(d.sentence.contains("in the time there was") && notes.iter().any(|n| n.contains("time was over")), "{} {notes:?}", d.sentence);
    // The mode is found in the first round, which comes to the noise: nothing was cut short.
    let all = within(1);
    assert_eq!(
        (all.diagnosis.verdict, &all.diagnosis.named),
        (Verdict::Named, &vec!["vibration".to_owned()]),
        "{}",
        all.diagnosis.sentence
    );
    assert!(all.floor.warnings.iter().all(|note| !note.contains("time was over")), "{:?}", all.floor.warnings);
}

#[test]
fn a_name_rests_on_held_out_records_or_says_that_there_are_none() {
    let chain: [(&str, &[f64]); 2] = [("gain", &[0.1]), MODE];
    let found = explained(&recorded(&chain, 0.002, 0.0, true, true), "gain");
    assert_eq!(found.diagnosis.named, ["vibration"], "{}", found.diagnosis.sentence);
    let found = explained(&recorded(&chain, 0.002, 0.0, false, true), "gain");
    assert_eq!(found.diagnosis.named, ["vibration"], "{}", found.diagnosis.sentence);
    let found = explained(&recorded(&chain, 0.002, 0.0, true, true), "gain,vibration");
    assert_eq!(found.diagnosis.verdict, Verdict::AtFloor, "{}", found.diagnosis.sentence);
}

#[test]
fn the_steps_of_a_converter_are_named_by_the_readings_alone() {
    let found = explained(&recorded(&[("gain", &[0.1]), MODE], 0.002, 0.01, true, true), "gain,vibration");
    let finding = found.diagnosis.findings.iter().find(|f| f.effects == ["quantisation"]).unwrap();
    assert_eq!(finding.decision, Decision::ReadingsShowIt);
}

#[test]
fn beside_a_model_from_elsewhere_an_effect_is_named_that_alone_explains_what_a_new_fit_could_remove() {
    let model = explained(&recorded(&[("gain", &[0.1]), MODE], 0.002, 0.0, true, true), "gain,vibration").model;
    let lagging = recorded(&[("gain", &[0.1]), MODE, ("sensor_bandwidth", &[120.0])], 0.002, 0.0, true, true);
    let found = explain(&lagging, Start::Model(model), &Options::default(), &Unwatched).unwrap();
    holds_invariant_5(&found);
    // A lag in front of a mode does the same as one behind it: both are said.
    assert!(found.diagnosis.named.contains(&"sensor_bandwidth".to_owned()), "{}", found.diagnosis.sentence);
    assert!(found.diagnosis.findings[0].effects.contains(&"sensor_bandwidth".to_owned()));
    assert!(matches!(found.diagnosis.findings[0].decision, Decision::ExplainsAlone { share } if share > 0.5));
}
