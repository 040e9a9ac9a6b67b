//! A stage without hysteresis, by the closed forms of a held mode and of one creep term: equations of this
//! file, not of host-sim.
//!
//! The diagnosis must match the stage, however its drive came into the file: as it was commanded, or read
//! back with noise or by a coarse converter, which a light mode amplifies and every model passes on; and
//! wherever the time constant of its creep lies.

use hysteron::analyse::{Options, Outcome, Start, analyse};
use hysteron::dataset::issue::{IssueKind, Severity};
use hysteron::dataset::{Dataset, Record, Role};
use hysteron::diagnosis::judgement::{Split, judge};
use hysteron::diagnosis::policy::Policy;
use hysteron::diagnosis::study::Study;
use hysteron::identify::identify;
use hysteron::model_file::effects_named;
use hysteron::outcome::Verdict;
use hysteron::quality::{self, End, Moment};
use hysteron::statistics::mean;
use hysteron::watch::Unwatched;
use hysteron_sim::noise::WhiteNoise;
use std::f64::consts::TAU;

const GAIN_UM_V: f64 = 0.1;
const RANGE_V: (f64, f64) = (0.0, 100.0);

/// A mode of unit gain under a drive that is held from sample to sample: the exact step of a damped
/// oscillator.
fn mode(drive: &[f64], frequency_hz: f64, damping: f64, rate_hz: f64) -> Vec<f64> {
    let (w, h) = (TAU * frequency_hz, 1.0 / rate_hz);
    let (a, wd) = (damping * w, w * (1.0 - damping * damping).sqrt());
    let ((s, c), decay) = ((wd * h).sin_cos(), (-a * h).exp());
    let (mut x, mut v) = (0.0, 0.0);
    let step = |u: &f64| {
        let (read, from_rest) = (x, x - u);
        x = u + decay * ((c + a / wd * s) * from_rest + s / wd * v);
        v = decay * (-w * w / wd * s * from_rest + (c - a / wd * s) * v);
        read
    };
    drive.iter().map(step).collect()
}

/// What one creep term of unit share adds under such a drive.
fn creep_term(drive: &[f64], time_constant_s: f64, rate_hz: f64) -> Vec<f64> {
    let decay = (-1.0 / (rate_hz * time_constant_s)).exp();
    let mut state = 0.0;
    let step = |u: &f64| {
        let read = state;
        state = decay * state + (1.0 - decay) * u;
        read
    };
    drive.iter().map(step).collect()
}

fn noise(rms: f64, samples: usize, seed: u64) -> Vec<f64> {
    let mut noise = WhiteNoise::new(rms, seed);
    (0..samples).map(|_| noise.next_um()).collect()
}

fn sum(a: &[f64], b: &[f64]) -> Vec<f64> {
    a.iter().zip(b).map(|(a, b)| a + b).collect()
}

/// From rest at zero up to the middle, then lines from 1 Hz to this frequency, which never repeat in the
/// file.
fn multisine(to_hz: f64, seconds: f64, rate_hz: f64, seed: u64) -> Vec<f64> {
    let phase =
        |line: usize| TAU * (((line * line) as f64 * 0.618_034 * (seed as f64 + 1.0)).fract());
    let lines: Vec<(f64, f64)> = (1..60)
        .map(|line| {
            (
                to_hz * (line as f64 / 60.0 + 0.001 * seed as f64),
                phase(line),
            )
        })
        .collect();
    let of = |k: usize| {
        lines
            .iter()
            .map(|(hz, phase)| (TAU * hz * k as f64 / rate_hz + phase).sin())
            .sum::<f64>()
    };
    let wave: Vec<f64> = (0..(seconds * rate_hz) as usize).map(of).collect();
    let most = wave.iter().fold(0.0, |most: f64, v| most.max(v.abs()));
    let rise = (0.05 * rate_hz) as usize;
    let first = 50.0 + 30.0 * wave[0] / most;
    (0..rise)
        .map(|k| first * k as f64 / rise as f64)
        .chain(wave.iter().map(|v| 50.0 + 30.0 * v / most))
        .collect()
}

fn held(mut drive: Vec<f64>, seconds: f64, rate_hz: f64) -> Vec<f64> {
    let last = drive[drive.len() - 1];
    drive.resize(drive.len() + (seconds * rate_hz) as usize, last);
    drive
}

fn dataset(rate_hz: f64, records: [(Vec<f64>, Vec<f64>); 2]) -> Dataset {
    let named = ["fitted", "judging"]
        .into_iter()
        .zip([Role::Identify, Role::Validate])
        .zip(records);
    let records = named.map(|((name, role), (drive, reading))| {
        Record::new(name, rate_hz, drive, reading)
            .with_role(role)
            .from_virgin_state()
    });
    let mut out =
        Dataset::new("stage", RANGE_V.0, RANGE_V.1, records.collect()).expect("a data set");
    // As of a file that says nothing of it.
    out.timing_is_assumed = true;
    out
}

fn explained(dataset: &Dataset) -> Outcome {
    analyse(
        dataset,
        Start::Effects(&effects_named("gain").expect("known")),
        &Options::default(),
        &Unwatched,
    )
    .expect("it is explained")
}

fn names_exactly(found: &Outcome, effects: &[&str], what: &str) {
    let (d, sentence) = (&found.diagnosis, &found.diagnosis.sentence);
    assert_eq!(d.verdict, Verdict::Named, "{what}: {sentence}");
    let mut named: Vec<&str> = d.named.iter().map(String::as_str).collect();
    named.sort_unstable();
    assert_eq!(named, effects, "{what}: {sentence}");
    assert!(
        d.issues
            .iter()
            .all(|issue| issue.severity == Severity::Notes),
        "{what}: {:?}",
        d.issues
    );
}

/// The floor is what the exact model leaves when it follows the drive that was read: neither the static gain
/// times its noise, nor the sensor's noise alone.
#[test]
fn a_drive_that_was_read_back_makes_no_missing_effect() {
    let rate_hz = 20_000.0;
    for (what, frequency_hz, damping, read_back_v, step_v) in [
        ("4 mV, light", 900.0, 0.02, 0.004, 0.0),
        ("20 mV, light", 900.0, 0.02, 0.02, 0.0),
        ("20 mV, fast and light", 3000.0, 0.03, 0.02, 0.0),
        ("10 mV, slow and damped", 300.0, 0.3, 0.01, 0.0),
        ("12 bits", 900.0, 0.02, 0.0, 100.0 / 4096.0),
    ] {
        let mut left = Vec::new();
        let records = [1, 2].map(|seed| {
            let drive = held(multisine(1200.0, 1.5, rate_hz, seed), 0.3, rate_hz);
            let motion: Vec<f64> = mode(&drive, frequency_hz, damping, rate_hz)
                .iter()
                .map(|x| GAIN_UM_V * x)
                .collect();
            let reading = sum(&motion, &noise(0.0004, drive.len(), 10 + seed));
            let read = sum(&drive, &noise(read_back_v, drive.len(), 20 + seed));
            let read: Vec<f64> = read
                .iter()
                .map(|u| {
                    if step_v > 0.0 {
                        (u / step_v).round() * step_v
                    } else {
                        *u
                    }
                })
                .collect();
            let exact = mode(&read, frequency_hz, damping, rate_hz);
            left.push(
                mean(
                    &reading
                        .iter()
                        .zip(&exact)
                        .map(|(y, x)| (y - GAIN_UM_V * x).powi(2))
                        .collect::<Vec<_>>(),
                )
                .sqrt(),
            );
            (read, reading)
        });
        let found = explained(&dataset(rate_hz, records));
        names_exactly(&found, &["vibration"], what);
        let (floor_um, left_um) = (found.floor.rms_um.expect("a floor"), mean(&left));
        println!(
            "{what}: floor {:.3} nm, the exact model leaves {:.3} nm",
            1e3 * floor_um,
            1e3 * left_um
        );
        assert!(
            (floor_um / left_um - 1.0).abs() < 0.1,
            "{what}: {floor_um} {left_um}"
        );
    }
}

/// A time constant between two of the grid is creep, and not drift, leakage or loops beside it; and it is
/// found.
#[test]
fn one_creep_term_anywhere_is_creep_alone() {
    let rate_hz = 10_000.0;
    for time_constant_s in [0.15, 0.5, 0.8] {
        let records = [1, 2].map(|seed| {
            let drive = held(multisine(350.0, 3.0, rate_hz, seed), 0.5, rate_hz);
            let (fast, slow) = (
                mode(&drive, 700.0, 0.05, rate_hz),
                creep_term(&drive, time_constant_s, rate_hz),
            );
            let reading = fast
                .iter()
                .zip(&slow)
                .zip(noise(0.001, drive.len(), 30 + seed))
                .map(|((x, c), n)| GAIN_UM_V * (x + 0.05 * c) + n);
            let reading = reading.collect();
            (drive, reading)
        });
        let found = explained(&dataset(rate_hz, records));
        names_exactly(
            &found,
            &["creep", "vibration"],
            &format!("{time_constant_s} s"),
        );
        let values = found.model.values("creep").expect("creep");
        println!("{time_constant_s} s: {values:?}");
        // Two terms that have met are one.
        let there: f64 = values
            .chunks_exact(2)
            .filter(|term| (term[1] / time_constant_s - 1.0).abs() < 0.1)
            .map(|term| term[0])
            .sum();
        assert!(
            (there / 0.05 - 1.0).abs() < 0.1,
            "{time_constant_s} s: {values:?}"
        );
    }
}

/// Records so long that a search sees their beginnings only, of which a slow term is a small part: the whole
/// asks for it.
#[test]
fn a_slow_creep_term_is_found_in_long_records() {
    let rate_hz = 20_000.0;
    let records = [1, 2].map(|seed| {
        let drive = held(multisine(350.0, 7.0, rate_hz, seed), 3.0, rate_hz);
        let (fast, slow) = (
            mode(&drive, 420.0, 0.02, rate_hz),
            creep_term(&drive, 0.8, rate_hz),
        );
        let reading = fast
            .iter()
            .zip(&slow)
            .zip(noise(0.003, drive.len(), 50 + seed))
            .map(|((x, c), n)| GAIN_UM_V * (x + 0.06 * c) + n);
        let reading = reading.collect();
        (drive, reading)
    });
    names_exactly(
        &explained(&dataset(rate_hz, records)),
        &["creep", "vibration"],
        "long",
    );
}

/// What a gain leaves of a mode goes with the drive; of a drive that is smooth it seems to come before it.
#[test]
fn a_missing_mode_is_no_closed_loop() {
    let rate_hz = 10_000.0;
    let records = [1, 2].map(|seed| {
        let drive = multisine(350.0, 2.0, rate_hz, seed);
        let motion = mode(&drive, 700.0, 0.05, rate_hz);
        let reading = motion
            .iter()
            .zip(noise(0.001, drive.len(), 40 + seed))
            .map(|(x, n)| GAIN_UM_V * x + n)
            .collect();
        // As a file writes it.
        (
            drive.iter().map(|u| (u * 1e6).round() * 1e-6).collect(),
            reading,
        )
    });
    let dataset = dataset(rate_hz, records);
    let gain = identify(&dataset, &effects_named("gain").expect("known"), &Unwatched)
        .expect("it is fitted");
    let judged = judge(gain.model, &dataset, &Split::of(&dataset));
    assert!(judged.identify_rms_um > 0.05, "{}", judged.identify_rms_um);
    // Asked however far above the noise it is.
    let policy = Policy {
        near_the_noise: f64::INFINITY,
        ..Policy::default()
    };
    let study = Study::new(&dataset, Vec::new(), &gain.floor, policy, &Unwatched);
    let end = End {
        study: &study,
        noise: &gain.floor,
        first: &judged,
        last: &judged,
        added: &[],
    };
    let issues = quality::issues(&dataset, Moment::End(&end));
    assert!(
        issues
            .iter()
            .all(|issue| !matches!(issue.kind, IssueKind::ClosedLoop { .. })),
        "{issues:?}"
    );
}
