//! The model that is saved holds over the whole file: twelve single recordings of stages whose equations
//! stand here, and one that drifts.

use hysteron::Dataset;
use hysteron::analyse::{Options, Outcome, Start, analyse};
use hysteron::dataset::reading::from_file;
use hysteron::model_file::effects_named;
use hysteron::outcome::Verdict;
use hysteron::replay::{AS_GOOD, Replay, replays};
use hysteron::watch::Unwatched;
use hysteron_sim::noise::WhiteNoise;
use std::f64::consts::TAU;

/// A stage by equations of its own: plays with free thresholds and a bend, a mode by small explicit steps,
/// creep by the logarithm of time as a sum of many relaxations, a drift that dies out.
#[derive(Clone)]
struct Stage {
    plays: Vec<(f64, f64)>,
    gain_um_v: f64,
    bend_per_v: f64,
    mode_hz: f64,
    damping: f64,
    creep_per_decade: f64,
    drift_um: f64,
    drift_s: f64,
    noise_um: f64,
}

impl Stage {
    /// One of many, by a number.
    fn numbered(i: u32) -> Self {
        let share = |k: u32| f64::from((i * 37 + k * 61) % 100) / 100.0;
        let count = 3 + i % 6;
        Self {
            plays: (0..count)
                .map(|k| {
                    (
                        1.0 + 28.0 * f64::from(k) / f64::from(count) + 2.0 * share(k),
                        0.02 * (0.5 + share(k + 9)) / f64::from(count),
                    )
                })
                .collect(),
            gain_um_v: 0.10 + 0.08 * share(1),
            bend_per_v: if i.is_multiple_of(3) {
                6e-4 * (share(2) - 0.5)
            } else {
                0.0
            },
            mode_hz: 250.0 + 500.0 * share(3),
            damping: 0.02 + 0.08 * share(4),
            creep_per_decade: if i.is_multiple_of(2) {
                0.006 + 0.008 * share(5)
            } else {
                0.0
            },
            drift_um: 0.0,
            drift_s: 25.0,
            noise_um: 0.002 + 0.002 * share(6),
        }
    }

    /// The file of one recording: time, drive, reading, from rest at zero.
    fn recording(&self, drive_v: &[f64], rate_hz: f64, seed: u64) -> String {
        let mut noise = WhiteNoise::new(self.noise_um, seed);
        let mut plays = vec![0.0; self.plays.len()];
        let (mut y, mut velocity) = (0.0, 0.0);
        let (w, fine) = (TAU * self.mode_hz, 40);
        let dt_s = 1.0 / rate_hz / f64::from(fine);
        // A decade has three relaxations of a third of its creep each.
        let relaxations: Vec<f64> = (0..15)
            .map(|k| 10f64.powf(-2.5 + f64::from(k) / 3.0))
            .collect();
        let mut crept = vec![0.0; relaxations.len()];
        let mut text = String::from("t_s,u_v,y_um\n");
        for (k, u) in drive_v.iter().enumerate() {
            let t_s = k as f64 / rate_hz;
            let creep: f64 = crept.iter().sum::<f64>() * self.creep_per_decade / 3.0;
            let drift = self.drift_um * (1.0 - (-t_s / self.drift_s).exp());
            text.push_str(&format!(
                "{t_s:.6},{u:.5},{:.6}\n",
                y + creep + drift + noise.next_um()
            ));
            let mut force = self.gain_um_v * u * (1.0 + self.bend_per_v * u);
            for ((threshold, weight), play) in self.plays.iter().zip(&mut plays) {
                *play = f64::clamp(*play, u - threshold, u + threshold);
                force += weight * *play;
            }
            for _ in 0..fine {
                velocity += dt_s * (w * w * (force - y) - 2.0 * self.damping * w * velocity);
                y += dt_s * velocity;
            }
            for (tau_s, crept) in relaxations.iter().zip(&mut crept) {
                *crept += (y - *crept) * (1.0 - (-1.0 / rate_hz / tau_s).exp());
            }
        }
        text
    }
}

/// Rest at zero, loops that nest at two speeds, steps with holds, many frequencies at once.
fn tape(rate_hz: f64, i: u32) -> Vec<f64> {
    let line = |from: f64, to: f64, slope_v_s: f64| {
        let samples = ((to - from).abs() / slope_v_s * rate_hz) as usize;
        (0..samples).map(move |k| from + (to - from) * k as f64 / samples as f64)
    };
    let corners = [
        [0.0, 80.0, 0.0, 60.0, 20.0, 70.0, 10.0, 40.0, 0.0],
        [0.0, 70.0, 20.0, 80.0, 0.0, 50.0, 10.0, 65.0, 0.0],
    ][i as usize % 2];
    let hold = |seconds: f64, level: f64| std::iter::repeat_n(level, (seconds * rate_hz) as usize);
    let mut drive: Vec<f64> = hold(0.3, 0.0).collect();
    for slope in [400.0, 1600.0] {
        corners
            .windows(2)
            .for_each(|w| drive.extend(line(w[0], w[1], slope)));
    }
    [30.0, 60.0, 20.0, 45.0, 10.0, 70.0]
        .into_iter()
        .for_each(|level| drive.extend(hold(0.15, level)));
    let sines = |k: usize| {
        (1..=12)
            .map(|n| {
                (TAU * f64::from(n * n + 3) * 5.0 * k as f64 / rate_hz + f64::from(n * n)).sin()
            })
            .sum::<f64>()
    };
    drive.extend((0..(0.5 * rate_hz) as usize).map(|k| 40.0 + 2.5 * sines(k)));
    drive.extend(line(40.0, 0.0, 400.0));
    drive
}

fn explained(file: &str) -> (Outcome, Vec<Replay>) {
    let dataset: Dataset = from_file("recording.csv", file.as_bytes()).unwrap();
    let start = Start::Effects(&effects_named("gain").unwrap());
    let found = analyse(&dataset, start, &Options::default(), &Unwatched).unwrap();
    let replays = replays(&found.model, found.corrected.as_ref().unwrap_or(&dataset));
    (found, replays)
}

/// How many of these recordings replay as well as they are held out; the others know why not.
fn as_good_among(recordings: std::ops::Range<u32>) -> usize {
    let mut as_good = 0;
    for i in recordings {
        let rate_hz = 8000.0;
        let (_, replays) =
            explained(&Stage::numbered(i).recording(&tape(rate_hz, i), rate_hz, 40 + u64::from(i)));
        assert_eq!(replays.len(), 1, "one file is one replay");
        let replay = &replays[0];
        println!(
            "{i}: {:.2} times, {}",
            replay.times_judged(),
            replay.sentence()
        );
        let cause = replay.drift.as_ref().map(|drift| drift.cause.as_str());
        assert!(
            replay.times_judged() <= AS_GOOD || cause.is_some_and(|cause| cause != "unknown"),
            "{i}: {}",
            replay.sentence()
        );
        as_good += usize::from(replay.times_judged() <= AS_GOOD);
    }
    as_good
}

#[test]
fn recordings_replay_as_well_as_they_are_held_out() {
    assert!(as_good_among(0..3) > 0);
}

/// Run by `cargo xtask full`.
mod long {
    #[test]
    #[ignore = "twelve searches"]
    fn twelve_recordings_replay_as_well_as_they_are_held_out() {
        let as_good = super::as_good_among(0..12);
        assert!(as_good >= 10, "{as_good} of 12");
    }
}

/// 150 nm with a time constant of 25 s, of which 65 nm come within the tape, while the drive goes on as ever:
/// a creep of 25 s would meet that from free states.
#[test]
fn a_drift_within_one_tape_is_named() {
    let rate_hz = 2000.0;
    let stage = Stage {
        drift_um: 0.15,
        mode_hz: 180.0,
        creep_per_decade: 0.0,
        ..Stage::numbered(1)
    };
    let mut drive: Vec<f64> = vec![0.0; 1000];
    for cycle in 0..7 {
        let high = [80.0, 60.0, 70.0, 80.0, 50.0, 65.0, 80.0][cycle];
        drive.extend((0..3800).map(|k| {
            0.5 * high
                * (1.0
                    - (TAU * f64::from(k) / 3800.0 * if cycle % 2 == 0 { 2.0 } else { 5.0 }).cos())
        }));
    }
    let (found, replays) = explained(&stage.recording(&drive, rate_hz, 7));
    let d = &found.diagnosis;
    assert!(
        matches!(d.verdict, Verdict::Named | Verdict::Ambiguous),
        "{}",
        d.sentence
    );
    assert!(
        found.model.effect("thermal_drift").is_some()
            && d.named.iter().any(|id| id == "thermal_drift"),
        "{}",
        d.sentence
    );
    assert!(
        replays[0].times_judged() <= AS_GOOD,
        "{}",
        replays[0].sentence()
    );
}

/// A model without its drift, replayed: the trend is named as the cause, with what to record.
#[test]
fn a_replay_that_drifts_names_its_cause() {
    let rate_hz = 2000.0;
    let stage = Stage {
        drift_um: 0.3,
        drift_s: 8.0,
        plays: Vec::new(),
        bend_per_v: 0.0,
        mode_hz: 180.0,
        creep_per_decade: 0.0,
        ..Stage::numbered(1)
    };
    let mut drive: Vec<f64> = vec![0.0; 1000];
    drive.extend((0..16_000).map(|k| 35.0 * (1.0 - (TAU * f64::from(k) / 1600.0).cos())));
    // Judged in short windows, each with a constant of its own.
    let whole = from_file(
        "recording.csv",
        stage.recording(&drive, rate_hz, 7).as_bytes(),
    )
    .unwrap();
    let of = |role, window: std::ops::Range<usize>, name: &str| {
        let mut record = whole
            .records
            .iter()
            .find(|r| r.role != hysteron::Role::Noise)
            .unwrap()
            .clone()
            .with_role(role);
        (record.name, record.window) = (name.into(), window);
        record.left_out.clear();
        record
    };
    let parts = (0..10).map(|i| {
        let role = if i % 2 == 0 {
            hysteron::Role::Identify
        } else {
            hysteron::Role::Validate
        };
        of(role, 1000 + 1600 * i..2600 + 1600 * i, &format!("part_{i}"))
    });
    let dataset =
        Dataset::new("cut", whole.drive_min_v, whole.drive_max_v, parts.collect()).unwrap();
    let found = hysteron::identify::identify(
        &dataset,
        &effects_named("gain,vibration").unwrap(),
        &Unwatched,
    )
    .unwrap();
    let replay = &replays(&found.model, &dataset)[0];
    let drift = replay
        .drift
        .as_ref()
        .unwrap_or_else(|| panic!("{}", replay.sentence()));
    assert_eq!(drift.cause, "trend", "{}", replay.sentence());
    assert!(drift.sentence.contains("rest"), "{}", drift.sentence);
}
