//! Stages whose equations stand here, sample by sample, and not in the simulation: what is missing beside a
//! bare gain.

use hysteron::analyse::{Options, Outcome, Start, analyse};
use hysteron::dataset::reading::from_file;
use hysteron::dataset::{Dataset, Record, Role, folder};
use hysteron::model_file::effects_named;
use hysteron::outcome::{Evidence, Finding, Standing, Verdict};
use hysteron::phrases::nm;
use hysteron::synthetic::case::{CaseOrder, simulate_case};
use hysteron::watch::Unwatched;
use hysteron_sim::noise::WhiteNoise;

const RATE_HZ: f64 = 8000.0;
const NOISE_UM: f64 = 0.003;

/// Straight lines between voltages, with so many V/s.
fn triangles(corners_v: &[f64], slope_v_s: f64) -> Vec<f64> {
    let line = |w: &[f64]| {
        let samples = ((w[1] - w[0]).abs() / slope_v_s * RATE_HZ) as usize;
        let (from_v, to_v) = (w[0], w[1]);
        (0..samples).map(move |k| from_v + (to_v - from_v) * k as f64 / samples as f64)
    };
    corners_v.windows(2).flat_map(line).collect()
}

/// A fitted, a held-out and a resting record of a stage that reads so many um for drives of so many V, one
/// after the other.
fn explained(reads: &mut dyn FnMut(&[f64]) -> Vec<f64>, drives: [Vec<f64>; 2]) -> Outcome {
    explained_with(NOISE_UM, reads, drives)
}

/// The same with so much noise.
fn explained_with(
    noise_um: f64,
    reads: &mut dyn FnMut(&[f64]) -> Vec<f64>,
    drives: [Vec<f64>; 2],
) -> Outcome {
    explained_as_read(noise_um, &|um| um, reads, drives)
}

/// The same of readings that are made so of what the sensor sees.
fn explained_as_read(
    noise_um: f64,
    as_read: &dyn Fn(f64) -> f64,
    reads: &mut dyn FnMut(&[f64]) -> Vec<f64>,
    drives: [Vec<f64>; 2],
) -> Outcome {
    let dataset = read(noise_um, as_read, reads, drives);
    let found = analyse(
        &dataset,
        Start::Effects(&effects_named("gain").unwrap()),
        &Options::default(),
        &Unwatched,
    )
    .unwrap();
    each_name_does_better_with_it(&found);
    // What is saved is what the sentence speaks of.
    let d = &found.diagnosis;
    assert!(
        d.sentence
            .contains(&format!("{} nm", nm(d.remainder.rms_um))),
        "{}",
        d.sentence
    );
    found
}

/// The evidence beside every name: on no side is the best model without it better by what matters, and on one
/// it is worse by that.
fn each_name_does_better_with_it(found: &Outcome) {
    for finding in &found.diagnosis.findings {
        let Evidence::Models { without, with, .. } = finding.evidence else {
            continue;
        };
        let held_out = with.validate.zip(without.validate);
        let sides: Vec<(f64, f64)> = held_out
            .into_iter()
            .chain([(with.identify, without.identify)])
            .collect();
        let better = |(a, b): &(f64, f64)| 1.04 * a * a < b * b;
        assert!(
            sides.iter().any(better)
                && !sides
                    .iter()
                    .any(|(with, without)| better(&(*without, *with))),
            "{finding:?}"
        );
    }
}

/// What is read so.
fn read(
    noise_um: f64,
    as_read: &dyn Fn(f64) -> f64,
    reads: &mut dyn FnMut(&[f64]) -> Vec<f64>,
    drives: [Vec<f64>; 2],
) -> Dataset {
    let [fitted, held_out] = drives;
    let records = [
        ("fitted", Role::Identify, fitted),
        ("held_out", Role::Validate, held_out),
        ("rest", Role::Noise, vec![0.0; 4000]),
    ];
    let record = |(i, (name, role, drive_v)): (usize, (&str, Role, Vec<f64>))| {
        let mut noise = WhiteNoise::new(noise_um, 700 + i as u64);
        let readings = reads(&drive_v)
            .into_iter()
            .map(|um| as_read(um + noise.next_um()))
            .collect();
        Record::new(name, RATE_HZ, drive_v, readings).with_role(role)
    };
    let records = records.into_iter().enumerate().map(record).collect();
    let mut dataset = Dataset::new("by_hand", 0.0, 80.0, records).unwrap();
    // As of a file that does not say when a drive acts.
    dataset.timing_is_assumed = true;
    dataset
}

/// Read in the row after the one whose drive acts.
fn in_the_next_row(um: Vec<f64>) -> Vec<f64> {
    std::iter::once(um[0])
        .chain(um[..um.len() - 1].iter().copied())
        .collect()
}

fn usual_drives() -> [Vec<f64>; 2] {
    [
        triangles(&[0.0, 80.0, 0.0, 60.0, 20.0, 70.0, 10.0, 40.0, 0.0], 150.0),
        triangles(&[0.0, 50.0, 10.0, 70.0, 30.0, 60.0, 0.0, 80.0, 0.0], 200.0),
    ]
}

/// A stage that moves on at 30 nm/s whatever the drive: the free states of creep would meet that too, and
/// answer no drive.
#[test]
fn a_straight_drift_is_not_creep_alone() {
    let mut drifting = |drive_v: &[f64]| {
        let straight = drive_v
            .iter()
            .enumerate()
            .map(|(k, v)| 0.08 * v + 0.03 * k as f64 / RATE_HZ)
            .collect();
        in_the_next_row(straight)
    };
    let d = explained(&mut drifting, usual_drives()).diagnosis;
    assert!(
        matches!(d.verdict, Verdict::Named | Verdict::Ambiguous),
        "{}",
        d.sentence
    );
    assert_eq!(d.findings.len(), 1, "{}", d.sentence);
    assert_eq!(d.findings[0].effects[0], "thermal_drift", "{}", d.sentence);
}

/// What a straight stage reads that creeps with the logarithm of time after every step, from rest: by
/// superposition, exact.
fn creeping_with_the_logarithm(steps: &[(f64, f64)], samples: usize) -> [Vec<f64>; 2] {
    let at = |k: usize, from_s: f64| k as f64 / RATE_HZ - from_s;
    let drive = |k| {
        steps
            .iter()
            .filter(|(from_s, _)| at(k, *from_s) >= 0.0)
            .map(|(_, by_v)| by_v)
            .sum()
    };
    let creeps = |k| {
        let begun = steps.iter().filter(|(from_s, _)| at(k, *from_s) > 0.0);
        begun
            .map(|(from_s, by_v)| 0.4 * by_v * (1.0 + 0.02 * (1.0 + at(k, *from_s) / 0.1).log10()))
            .sum()
    };
    [
        (0..samples).map(drive).collect(),
        (0..samples).map(creeps).collect(),
    ]
}

/// Such creep goes on for longer than any record: terms that settle within it leave 0.8 nm, which looked like
/// loops, drift or another state to begin in.
#[test]
fn creep_that_outlasts_its_records_is_creep_alone() {
    let [drive_v, read_um] = creeping_with_the_logarithm(
        &[
            (0.3, 50.0),
            (0.8, -30.0),
            (1.1, 45.0),
            (3.0, -50.0),
            (3.3, 30.0),
            (6.0, -45.0),
        ],
        72_000,
    );
    let [other_v, other_um] = creeping_with_the_logarithm(
        &[
            (0.2, 70.0),
            (0.6, -40.0),
            (2.8, 20.0),
            (3.4, -45.0),
            (4.0, 60.0),
            (6.5, -30.0),
        ],
        72_000,
    );
    let mut read = [read_um, other_um, vec![0.0; 4000]].into_iter();
    let found = explained_with(0.0005, &mut |_| read.next().unwrap(), [drive_v, other_v]);
    let d = &found.diagnosis;
    assert_eq!(
        (d.verdict, d.named.as_slice()),
        (Verdict::Named, ["creep".to_owned()].as_slice()),
        "{}",
        d.sentence
    );
    let left_um = found.steps.last().unwrap().judged.validate_rms_um.unwrap();
    assert!(left_um < 0.000_53, "{left_um}");
}

/// An amplifier that follows no faster than 6000 V/s in front of a straight stage without inertia.
#[test]
fn a_slew_limit_without_inertia_behind_it_is_named() {
    let mut limited = |drive_v: &[f64]| {
        let mut voltage_v = drive_v[0];
        let follow = drive_v.iter().map(|v| {
            voltage_v += (v - voltage_v).clamp(-6000.0 / RATE_HZ, 6000.0 / RATE_HZ);
            0.08 * voltage_v
        });
        in_the_next_row(follow.collect())
    };
    let sine = |hz: f64, samples: usize| -> Vec<f64> {
        (0..samples)
            .map(|k| 40.0 - 35.0 * (std::f64::consts::TAU * hz * k as f64 / RATE_HZ).cos())
            .collect()
    };
    let d = explained(&mut limited, [sine(50.0, 8000), sine(37.0, 6000)]).diagnosis;
    assert_eq!(
        (d.verdict, d.named.as_slice()),
        (Verdict::Named, ["slew_limit".to_owned()].as_slice()),
        "{}",
        d.sentence
    );
}

/// An amplifier that lags by 200 Hz and follows no faster than 8000 V/s. A lag alone stands in for both, and
/// beside it nothing shows a limit: only a fit of both does.
#[test]
fn a_lag_and_a_slew_limit_of_one_amplifier_are_named() {
    const PARTS: usize = 8;
    let part_s = 1.0 / (RATE_HZ * PARTS as f64);
    let follows = 1.0 - (-std::f64::consts::TAU * 200.0 * part_s).exp();
    let mut limited = |drive_v: &[f64]| {
        let (mut lagging_v, mut voltage_v) = (drive_v[0], drive_v[0]);
        let follow = drive_v.iter().map(|v| {
            for _ in 0..PARTS {
                lagging_v += (v - lagging_v) * follows;
                voltage_v += (lagging_v - voltage_v).clamp(-8000.0 * part_s, 8000.0 * part_s);
            }
            0.1 * voltage_v
        });
        in_the_next_row(follow.collect())
    };
    let sines = |each: &[(f64, f64)]| -> Vec<f64> {
        let one = |&(hz, half_v): &(f64, f64)| {
            (0..4000).map(move |k| {
                half_v - half_v * (std::f64::consts::TAU * hz * f64::from(k) / RATE_HZ).cos()
            })
        };
        each.iter().flat_map(one).collect()
    };
    let drives = [
        sines(&[(4.0, 40.0), (10.0, 35.0), (40.0, 30.0), (150.0, 20.0)]),
        sines(&[(6.0, 20.0), (26.0, 40.0), (80.0, 35.0)]),
    ];
    let d = explained(&mut limited, drives).diagnosis;
    let mut named = d.named.clone();
    named.sort();
    assert_eq!(
        (d.verdict, named.as_slice()),
        (
            Verdict::Named,
            ["amplifier_bandwidth".to_owned(), "slew_limit".to_owned()].as_slice()
        ),
        "{}",
        d.sentence
    );
}

/// A logarithmic sweep around 40 V, with the ways from 0 V and back.
fn sweep(rate_hz: f64, [from_hz, to_hz]: [f64; 2], seconds: f64, half_v: f64) -> Vec<f64> {
    let ramp = |share: f64| 20.0 - 20.0 * (std::f64::consts::PI * share).cos();
    let samples = (seconds * rate_hz) as usize;
    let there = (0..1000).map(|k| ramp(f64::from(k) / 1000.0));
    let swept = (0..samples).map(|k| {
        let (share, growth) = (k as f64 / samples as f64, (to_hz / from_hz).ln());
        let cycles = from_hz * seconds / growth * ((share * growth).exp() - 1.0);
        40.0 + half_v * (std::f64::consts::TAU * cycles).sin()
    });
    let back = (0..1000).rev().map(|k| ramp(f64::from(k) / 1000.0));
    let rest = || vec![0.0; 2000];
    let moved = there.chain(swept).chain(back);
    rest().into_iter().chain(moved).chain(rest()).collect()
}

/// Coleman and Hodgdon's loops, read by a sensor of 400 Hz, in one file. Friction beside the lag comes to
/// 13 nm and hides the loops.
#[test]
fn loops_that_friction_stands_in_for_are_named_in_one_file() {
    const ONE_RATE_HZ: f64 = 10_000.0;
    const PARTS: usize = 16;
    let triangles = triangles(
        &[0.0, 90.0, 20.0, 60.0, 0.0, 40.0, 0.0],
        200.0 / ONE_RATE_HZ * RATE_HZ,
    );
    let drive_v = [
        sweep(ONE_RATE_HZ, [1.0, 800.0], 2.0, 20.0),
        triangles,
        sweep(ONE_RATE_HZ, [2.0, 500.0], 1.5, 10.0),
    ]
    .concat();
    let (approach, slope_um_v, elastic_um_v) = (0.02, 0.11, 0.07);
    let follows = 1.0 - (-std::f64::consts::TAU * 400.0 / ONE_RATE_HZ / PARTS as f64).exp();
    let (mut stage_um, mut at_v, mut read_um) = (0.0, 0.0, 0.0);
    let mut noise = WhiteNoise::new(0.004, 17);
    let mut text = "t [s],u [V],y [um]\n".to_owned();
    for (k, v) in drive_v.iter().enumerate() {
        let reading_um = read_um + noise.next_um();
        text += &format!("{:.7},{v:.7},{reading_um:.7}\n", k as f64 / ONE_RATE_HZ);
        // y' = approach |u'| (slope u - y) + elastic u', solved along a straight u.
        let by_v: f64 = v - at_v;
        let off_um = (elastic_um_v - slope_um_v) * by_v.signum() / approach;
        let line_um = |v: f64| slope_um_v * v + off_um;
        stage_um = line_um(*v) + (stage_um - line_um(at_v)) * (-approach * by_v.abs()).exp();
        at_v = *v;
        (0..PARTS).for_each(|_| read_um += follows * (stage_um - read_um));
    }
    let dataset = from_file("tape.csv", text.as_bytes()).unwrap();
    let from = effects_named("gain").unwrap();
    let options = Options::default();
    let found = analyse(&dataset, Start::Effects(&from), &options, &Unwatched).unwrap();
    let d = &found.diagnosis;
    let [loops, lag] = d.findings.as_slice() else {
        panic!("{}", d.sentence);
    };
    let either = ["bouc_wen", "duhem"];
    assert!(
        loops.effects.iter().any(|id| id == "duhem")
            && loops.effects.iter().all(|id| either.contains(&id.as_str()))
            && lag.effects.iter().any(|id| id == "sensor_bandwidth"),
        "{}",
        d.sentence
    );
    assert!(d.remainder.rms_um < 1.05 * 0.004, "{}", d.sentence);
}

/// Twenty plays and a mode, read in the row of their own drive: a second mode would make up for the period
/// beside the true one.
#[test]
#[ignore = "open: the search ends at 1.9 times the noise, and the other timing is not tried there"]
fn readings_of_their_own_row_are_no_second_mode_beside_a_true_one() {
    let mut stage = |drive_v: &[f64]| {
        let mut plays = [0.0_f64; 20];
        let (mut um, mut velocity, w, fine) = (0.0, 0.0, std::f64::consts::TAU * 900.0, 40);
        let dt_s = 1.0 / RATE_HZ / f64::from(fine);
        let read = drive_v.iter().map(|v| {
            let mut force_um = 0.06 * v;
            for (i, play) in plays.iter_mut().enumerate() {
                let half_width_v = 1.0 + i as f64;
                *play = play.clamp(v - half_width_v, v + half_width_v);
                force_um += 0.003 * *play;
            }
            for _ in 0..fine {
                velocity += dt_s * (w * w * (force_um - um) - 0.1 * w * velocity);
                um += dt_s * velocity;
            }
            um
        });
        read.collect::<Vec<_>>()
    };
    let chirped = |phase: f64| -> Vec<f64> {
        let swept = (0..10_000).map(|k| {
            let t_s = f64::from(k) / RATE_HZ;
            40.0 - 35.0
                * (std::f64::consts::TAU * (2.0 * t_s + 40.0 * t_s * t_s) + phase).cos()
                * (t_s / 0.1).min(1.0)
        });
        triangles(&[0.0, 80.0, 0.0, 40.0], 400.0)
            .into_iter()
            .chain(swept)
            .collect()
    };
    let found = explained(
        &mut stage,
        [
            chirped(std::f64::consts::FRAC_PI_2),
            chirped(-std::f64::consts::FRAC_PI_2),
        ],
    );
    let d = &found.diagnosis;
    assert!(
        found.corrected.is_some(),
        "{} {:?}",
        d.sentence,
        found.model.effect_ids()
    );
    assert!(
        !d.named.iter().any(|id| id == "second_mode"),
        "{}",
        d.sentence
    );
}

/// What is named in a case that the project simulates, from a list of effects, ascending.
fn named_of_case(hidden: &[&str], base: &str, seed: u64) -> Vec<String> {
    let order = CaseOrder {
        hidden: hidden.iter().map(|id| ((*id).to_owned(), 1.0)).collect(),
        base: base.split(',').map(str::to_owned).collect(),
        hysteresis: "hysteresis".into(),
        seed,
    };
    let folder = tempfile::tempdir().unwrap();
    for (name, bytes) in simulate_case(&order, "case").unwrap().files {
        std::fs::write(folder.path().join(name), bytes).unwrap();
    }
    let dataset = folder::load(folder.path()).unwrap();
    let from = effects_named(base).unwrap();
    let mut named = analyse(
        &dataset,
        Start::Effects(&from),
        &Options::default(),
        &Unwatched,
    )
    .unwrap()
    .diagnosis
    .named;
    named.sort();
    named
}

/// A drift of which a few nanometres are left beside creep, in holds alone.
#[test]
fn a_drift_at_the_noise_is_named_beside_another_effect() {
    let three = "hysteresis,initial_curve,vibration";
    assert_eq!(
        named_of_case(&["creep", "thermal_drift"], three, 7139),
        ["creep", "thermal_drift"]
    );
}

/// A delay beside friction: a lag of the sensor is found first, and a second mode beside it meets the noise.
/// One delay does as well.
#[test]
#[ignore = "open: a sensor filter is named beside the delay"]
fn a_delay_takes_the_place_of_two_that_stood_in_for_it() {
    let hidden = ["delay", "friction", "mains_hum"];
    assert_eq!(
        named_of_case(&hidden, "hysteresis,initial_curve,vibration,creep", 5026),
        hidden
    );
}

/// Tones up to a tenth of the sampling rate around the middle, which fade in behind a hold.
fn tones(phase: f64) -> Vec<f64> {
    let tone = |hz: f64, t_s: f64| (std::f64::consts::TAU * hz * t_s + phase * hz).sin();
    let at = |t_s: f64| {
        [13.0, 37.0, 110.0, 290.0, 610.0]
            .map(|hz| tone(hz, t_s))
            .iter()
            .sum::<f64>()
    };
    (0..8000)
        .map(|k| f64::from(k) / RATE_HZ - 0.1)
        .map(|t_s| 40.0 + 6.0 * (t_s / 0.1).clamp(0.0, 1.0) * at(t_s))
        .collect()
}

/// One effect beside a gain, by its closed form, from noise of a tenth of it to one of a hundredth and less:
/// it is named, and nothing else is.
#[test]
fn one_effect_of_a_straight_stage_is_named_however_little_noise_there_is() {
    type Reads = fn(&[f64]) -> Vec<f64>;
    let late: Reads = |um| {
        (0..um.len())
            .map(|k| 0.4 * um[k.saturating_sub(3)] + 0.6 * um[k.saturating_sub(2)])
            .collect()
    };
    let rings: Reads = |um| {
        let (w, xi, dt_s) = (std::f64::consts::TAU * 900.0, 0.02_f64, 1.0 / RATE_HZ);
        let turns = w * (1.0 - xi * xi).sqrt();
        let (decay, (sin, cos)) = ((-xi * w * dt_s).exp(), (turns * dt_s).sin_cos());
        let (mut x, mut v) = (um[0], 0.0);
        let read = um.iter().map(|force| {
            let (before, off) = (x, x - force);
            x = force + decay * ((cos + xi * w / turns * sin) * off + sin / turns * v);
            v = decay * ((cos - xi * w / turns * sin) * v - w * w / turns * sin * off);
            before
        });
        read.collect()
    };
    let hums: Reads = |um| {
        let hum = |k: usize| 0.05 * (std::f64::consts::TAU * 50.0 * k as f64 / RATE_HZ + 1.0).sin();
        in_the_next_row(um.to_vec())
            .iter()
            .enumerate()
            .map(|(k, um)| um + hum(k))
            .collect()
    };
    let drifts: Reads = |um| {
        in_the_next_row(um.to_vec())
            .iter()
            .enumerate()
            .map(|(k, um)| um + 0.07 * k as f64 / RATE_HZ)
            .collect()
    };
    for (id, reads) in [
        ("delay", late),
        ("vibration", rings),
        ("mains_hum", hums),
        ("thermal_drift", drifts),
    ] {
        for noise_um in [2e-4, 1e-3, 5e-3] {
            let mut stage =
                |drive_v: &[f64]| reads(&drive_v.iter().map(|v| 0.08 * v).collect::<Vec<_>>());
            let d = explained_with(noise_um, &mut stage, [tones(0.3), tones(0.7)]).diagnosis;
            assert_eq!(
                (d.verdict, d.named.as_slice()),
                (Verdict::Named, [id.to_owned()].as_slice()),
                "{id}, {noise_um} um: {}",
                d.sentence
            );
        }
    }
}

/// Mains that come with their multiples, as they do behind rectifiers and transformers: they are no resonance
/// of the stage.
#[test]
fn multiples_of_the_mains_are_named_beside_its_hum() {
    let line = |um: f64, hz: f64, k: usize| {
        um * (std::f64::consts::TAU * hz * k as f64 / RATE_HZ + hz).sin()
    };
    let hum = |k: usize| line(0.01, 50.01, k) + line(0.002, 100.02, k) + line(0.004, 150.03, k);
    let mut stage = |drive_v: &[f64]| {
        let moves = mode_read_by(
            &drive_v.iter().map(|v| 0.08 * v).collect::<Vec<_>>(),
            Behind::Nothing,
        );
        moves
            .iter()
            .enumerate()
            .map(|(k, um)| um + hum(k))
            .collect::<Vec<_>>()
    };
    let behind_a_hold = |phase: f64| {
        let moves = tones(phase);
        [vec![moves[0]; (0.5 * RATE_HZ) as usize], moves].concat()
    };
    let d = explained_with(1e-3, &mut stage, [behind_a_hold(0.3), behind_a_hold(0.7)]).diagnosis;
    assert_eq!(d.verdict, Verdict::Named, "{}", d.sentence);
    assert_eq!(
        d.named,
        ["vibration", "mains_hum", "hum_harmonics"],
        "{}",
        d.sentence
    );
}

/// What reads a mode.
#[derive(Clone, Copy)]
enum Behind {
    Nothing,
    /// A first-order lag, Hz.
    Lag(f64),
    /// A filter of second order, Hz.
    Filter(f64),
}

/// What a mode, and what reads it, make of a force, by Runge and Kutta's method in 16 parts of every period.
fn mode_read_by(force_um: &[f64], behind: Behind) -> Vec<f64> {
    mode_of(380.0, force_um, behind)
}

/// The same of a mode of this frequency, Hz.
fn mode_of(hz: f64, force_um: &[f64], behind: Behind) -> Vec<f64> {
    let tau = std::f64::consts::TAU;
    let ((w, xi), parts) = ((tau * hz, 0.02), 16);
    let dt_s = 1.0 / RATE_HZ / f64::from(parts);
    let rates = |[x, v, y, u]: [f64; 4], force: f64| {
        let [y_rate, u_rate] = match behind {
            Behind::Nothing => [v, 0.0],
            Behind::Lag(hz) => [tau * hz * (x - y), 0.0],
            Behind::Filter(hz) => [u, (tau * hz).powi(2) * (x - y) - 2.0 * 0.7 * tau * hz * u],
        };
        [v, w * w * (force - x) - 2.0 * xi * w * v, y_rate, u_rate]
    };
    let mut state = [force_um[0], 0.0, force_um[0], 0.0];
    let read = force_um.iter().map(|force| {
        let before = state;
        for _ in 0..parts {
            let moved =
                |by: [f64; 4], share: f64| std::array::from_fn(|i| state[i] + share * dt_s * by[i]);
            let one = rates(state, *force);
            let two = rates(moved(one, 0.5), *force);
            let three = rates(moved(two, 0.5), *force);
            let four = rates(moved(three, 1.0), *force);
            state = std::array::from_fn(|i| {
                state[i] + dt_s / 6.0 * (one[i] + 2.0 * two[i] + 2.0 * three[i] + four[i])
            });
        }
        before[2]
    });
    read.collect()
}

/// Rises, a sweep from 2 Hz and steps that are held.
fn swept() -> [Vec<f64>; 2] {
    [400.0_f64, 250.0].map(|to_hz| {
        let sweep = (0..9600).map(|k| {
            let share = f64::from(k) / 9600.0;
            let cycles = 2.4 / (to_hz / 2.0).ln() * ((to_hz / 2.0).powf(share) - 1.0);
            40.0 + 12.0
                * (share / 0.05).min(1.0)
                * ((1.0 - share) / 0.05).min(1.0)
                * (std::f64::consts::TAU * cycles).sin()
        });
        let steps = [40.0, 60.0, 30.0, 50.0]
            .into_iter()
            .flat_map(|v| vec![v; 2000]);
        triangles(&[0.0, 80.0, 0.0, 60.0, 15.0, 40.0], 400.0)
            .into_iter()
            .chain(sweep)
            .chain(steps)
            .collect()
    })
}

/// Thirty plays of equal weight.
fn played(drive_v: &[f64]) -> Vec<f64> {
    let mut plays = [0.0_f64; 30];
    let follow = drive_v.iter().map(|v| {
        plays
            .iter_mut()
            .enumerate()
            .for_each(|(i, play)| *play = play.clamp(v - 1.2 * i as f64, v + 1.2 * i as f64));
        0.06 * v + 0.002 * plays.iter().sum::<f64>()
    });
    follow.collect()
}

/// Another stage of the same kind has two modes, where the model that is handed in has one that swings more
/// slowly. A second mode beside that one leaves many times the noise until all values begin again.
#[test]
#[ignore = "open: a delay is named beside the second mode"]
fn a_second_mode_beside_one_that_has_moved_is_met() {
    const NOISE_UM: f64 = 0.002;
    let home = explained_with(
        NOISE_UM,
        &mut |drive_v| mode_of(150.0, &played(drive_v), Behind::Nothing),
        swept(),
    );
    for modes_hz in [[400.0, 455.0], [380.0, 900.0], [500.0, 520.0]] {
        let mut two_modes = |drive_v: &[f64]| {
            let [slow, fast] = modes_hz.map(|hz| mode_of(hz, &played(drive_v), Behind::Nothing));
            slow.iter()
                .zip(&fast)
                .map(|(slow, fast)| 0.55 * slow + 0.45 * fast)
                .collect()
        };
        let there = read(NOISE_UM, &|um| um, &mut two_modes, swept());
        let found = analyse(
            &there,
            Start::Model(home.model.clone()),
            &Options::default(),
            &Unwatched,
        )
        .unwrap();
        assert_eq!(
            found.diagnosis.named,
            ["second_mode"],
            "{modes_hz:?}: {}",
            found.diagnosis.sentence
        );
        assert!(
            found.last().error_um() < 1.15 * NOISE_UM,
            "{modes_hz:?}: {}",
            found.diagnosis.sentence
        );
    }
}

/// The sensor's scale is not even, which the library lacks. A model from before left as much of it.
#[test]
fn what_was_missing_before_is_nothing_new() {
    let uneven = |drive_v: &[f64]| -> Vec<f64> {
        let even_um = drive_v.iter().map(|v| 0.08 * v);
        even_um.map(|um| um + 0.02 * (20.0 * um).sin()).collect()
    };
    let home = explained(&mut { uneven }, swept());
    let then_um = home.model.identified.as_ref().unwrap().error_um;
    assert!(then_um > 3.0 * NOISE_UM, "{then_um}");
    let again = read(NOISE_UM, &|um| um, &mut { uneven }, swept());
    let found = analyse(
        &again,
        Start::Model(home.model),
        &Options::default(),
        &Unwatched,
    )
    .unwrap();
    assert_eq!(found.diagnosis.verdict, Verdict::Unexplained);
    let sentence = &found.diagnosis.sentence;
    assert!(sentence.contains("not missing then"), "{sentence}");
}

/// The electronics of a sensor behind a mode: a delay beside the mode comes near, and meets the noise
/// nowhere.
#[test]
fn a_filter_behind_a_mode_is_no_delay() {
    let mut stage = |drive_v: &[f64]| {
        mode_read_by(
            &drive_v.iter().map(|v| 0.08 * v).collect::<Vec<_>>(),
            Behind::Filter(1500.0),
        )
    };
    let d = explained_with(5e-4, &mut stage, [tones(0.3), tones(0.7)]).diagnosis;
    assert_eq!(d.verdict, Verdict::Named, "{}", d.sentence);
    assert!(
        d.named.iter().any(|id| id == "sensor_filter") && d.named.len() == 2,
        "{}",
        d.sentence
    );
}

/// Lags in front of a mode and behind it make the same of the same drive: both are named, though a fit of the
/// one from its own beginnings ends far from where the other is.
#[test]
#[ignore = "open: at 100 Hz a sensor filter is named beside the lag: the quick fit of lag and mode together ends in another minimum"]
fn a_slow_lag_beside_a_mode_is_the_amplifiers_or_the_sensors() {
    for lag_hz in [60.0, 100.0, 150.0, 250.0] {
        let mut stage = |drive_v: &[f64]| {
            mode_read_by(
                &drive_v.iter().map(|v| 0.08 * v).collect::<Vec<_>>(),
                Behind::Lag(lag_hz),
            )
        };
        let d = explained_with(1e-3, &mut stage, [tones(0.3), tones(0.7)]).diagnosis;
        let lag = d
            .findings
            .iter()
            .find(|f| f.effects.iter().any(|id| id == "sensor_bandwidth"))
            .unwrap_or_else(|| panic!("{lag_hz}: {}", d.sentence));
        assert!(
            lag.effects.iter().any(|id| id == "amplifier_bandwidth"),
            "{lag_hz}: {}",
            d.sentence
        );
        assert_eq!(d.findings.len(), 2, "{lag_hz}: {}", d.sentence);
    }
}

/// Eight plays at thresholds that no grid has: on one their kinks left 9 nm, and the verdict was that the
/// library does not know.
#[test]
fn plays_at_thresholds_of_their_own_are_hysteresis() {
    let half_widths_v = [0.8, 2.4, 5.6, 8.8, 14.4, 20.8, 28.0, 37.6];
    let weights_um_v = [0.02, 0.015, 0.01, 0.012, 0.008, 0.01, 0.006, 0.005];
    let mut loops = |drive_v: &[f64]| {
        let mut plays = [0.0_f64; 8];
        let follow = drive_v.iter().map(|v| {
            plays
                .iter_mut()
                .zip(half_widths_v)
                .for_each(|(play, half)| *play = play.clamp(v - half, v + half));
            0.42 * v
                + plays
                    .iter()
                    .zip(weights_um_v)
                    .map(|(play, weight)| weight * play)
                    .sum::<f64>()
        });
        in_the_next_row(follow.collect())
    };
    let found = explained_with(0.0005, &mut loops, usual_drives());
    let d = &found.diagnosis;
    assert_eq!(
        (d.verdict, d.named.as_slice()),
        (Verdict::Named, ["hysteresis".to_owned()].as_slice()),
        "{}",
        d.sentence
    );
    let left_um = found.steps.last().unwrap().judged.validate_rms_um.unwrap();
    assert!(left_um < 0.000_55, "{left_um}");
}

/// Readings in steps of 10 nm with noise below a step: what rounding leaves is small, and follows the drive
/// in its way. A rest stays on one code.
#[test]
fn what_coarse_readings_leave_has_no_name_of_loops() {
    for noise_um in [3e-4, 1.5e-3, 3e-3] {
        let mut stage = |drive_v: &[f64]| {
            mode_read_by(
                &drive_v.iter().map(|v| 0.08 * v).collect::<Vec<_>>(),
                Behind::Nothing,
            )
        };
        let in_steps = |um: f64| 0.01 * (um / 0.01).round();
        let d = explained_as_read(noise_um, &in_steps, &mut stage, usual_drives()).diagnosis;
        assert_eq!(
            d.named,
            ["vibration", "quantisation"],
            "{noise_um}: {}",
            d.sentence
        );
    }
}

/// A spring that stiffens in front of a mode: surfaces are the only curve of the library there, and their
/// loops do not open. A bent sensor behind the mode does as well where little of the motion rings, and both
/// are named; where much does, surfaces are no name.
#[test]
#[ignore = "open: the curve is named; the mode behind it is in the model and has no name"]
fn a_curve_without_loops_is_no_hysteresis() {
    for (drives, told_beside) in [(usual_drives(), true), ([tones(0.3), tones(1.0)], false)] {
        let mut stage = |drive_v: &[f64]| {
            mode_read_by(
                &drive_v
                    .iter()
                    .map(|v| 0.08 * (v - 6e-4 * v * v))
                    .collect::<Vec<_>>(),
                Behind::Nothing,
            )
        };
        let d = explained_with(2e-4, &mut stage, drives).diagnosis;
        let loops = d
            .candidates
            .iter()
            .find(|c| c.effect == "hysteresis")
            .unwrap_or_else(|| {
                panic!(
                    "surfaces: {} {:?}",
                    d.sentence,
                    d.candidates.iter().map(|c| &c.effect).collect::<Vec<_>>()
                )
            });
        assert!(
            loops
                .unlikely_because
                .as_ref()
                .is_some_and(|why| why.contains("its loops open by 0.0")),
            "{}",
            d.sentence
        );
        assert!(
            d.sentence.contains("a curve without memory"),
            "{}",
            d.sentence
        );
        let beside: Vec<&Finding> = d
            .findings
            .iter()
            .filter(|f| f.effects.iter().any(|id| id == "hysteresis"))
            .collect();
        assert!(
            beside.iter().all(|f| f.effects.len() > 1) && beside.is_empty() != told_beside,
            "{}",
            d.sentence
        );
        assert_eq!(
            loops.standing == Standing::Excluded,
            !told_beside,
            "{}: {:?}",
            d.sentence,
            loops.standing
        );
        assert!(d.named.iter().any(|id| id == "vibration"), "{}", d.sentence);
    }
}

/// A sensor that drifts on through two records, in each of which it begins at another rate: no creep alone,
/// and no loops.
#[test]
fn a_drift_that_differs_from_record_to_record_is_no_creep_alone() {
    let mut begun = 0;
    let mut drifting = |drive_v: &[f64]| {
        let wanders = |k: usize| 0.05 * (std::f64::consts::TAU * k as f64 / RATE_HZ / 60.0).sin();
        let read = mode_read_by(
            &drive_v.iter().map(|v| 0.08 * v).collect::<Vec<_>>(),
            Behind::Nothing,
        );
        begun += 20 * RATE_HZ as usize;
        read.iter()
            .enumerate()
            .map(|(k, um)| um + wanders(begun + k))
            .collect::<Vec<_>>()
    };
    let d = explained_with(1e-3, &mut drifting, usual_drives()).diagnosis;
    assert!(
        d.findings
            .iter()
            .any(|f| f.effects.iter().any(|id| id == "thermal_drift")),
        "{}",
        d.sentence
    );
    assert!(
        !d.named
            .iter()
            .any(|id| id == "hysteresis" || id == "initial_curve"),
        "{}",
        d.sentence
    );
}

/// A low-pass of first order and nothing else: in front of a straight stage or behind it, it reads the same,
/// and no drive tells which. With little noise a fit has far to go before it shows that.
#[test]
fn a_lag_of_a_straight_stage_is_the_amplifiers_or_the_sensors() {
    for (bandwidth_hz, noise_um) in [
        (700.0, NOISE_UM),
        (150.0, 1e-4),
        (60.0, 1e-3),
        (1500.0, 1e-4),
    ] {
        let kept = (-std::f64::consts::TAU * bandwidth_hz / RATE_HZ).exp();
        let mut lagging = |drive_v: &[f64]| {
            let mut um = 0.08 * drive_v[0];
            let read = drive_v.iter().map(|v| {
                um += (1.0 - kept) * (0.08 * v - um);
                um
            });
            in_the_next_row(read.collect())
        };
        let found = explained_with(noise_um, &mut lagging, [tones(0.3), tones(0.7)]);
        let d = &found.diagnosis;
        let mut named = d.named.clone();
        named.sort();
        let either = ["amplifier_bandwidth", "sensor_bandwidth"]
            .map(str::to_owned)
            .to_vec();
        assert_eq!(
            (d.verdict, named),
            (Verdict::Ambiguous, either),
            "{bandwidth_hz} Hz, {noise_um} um: {}",
            d.sentence
        );
        let advice: Vec<&String> = d
            .candidates
            .iter()
            .filter(|c| d.named.contains(&c.effect))
            .map(|c| &c.next_experiment)
            .collect();
        assert!(
            found.next_experiment.is_none()
                && advice
                    .iter()
                    .all(|a| a.contains("no drive within the limits")),
            "{advice:?}"
        );
    }
}

/// A gap of 0.3 um that is crossed at every reversal, in front of a mode and in front of nothing: it is
/// easily taken for friction, or left at four times the noise.
#[test]
fn a_gap_is_backlash_with_a_mode_behind_it_and_without() {
    let behind_a_gap = |drive_v: &[f64]| -> Vec<f64> {
        let mut taken_um = 0.0_f64;
        let along = |v: &f64| {
            taken_um = taken_um.clamp(0.08 * v - 0.15, 0.08 * v + 0.15);
            taken_um
        };
        drive_v.iter().map(along).collect()
    };
    let drives = || {
        [0.3, 1.0].map(|phase| {
            usual_drives()
                .into_iter()
                .flatten()
                .chain(tones(phase))
                .collect()
        })
    };
    let mut with_a_mode = |drive_v: &[f64]| mode_read_by(&behind_a_gap(drive_v), Behind::Nothing);
    let d = explained(&mut with_a_mode, drives()).diagnosis;
    let mut named = d.named.clone();
    named.sort();
    assert_eq!(
        (d.verdict, named),
        (
            Verdict::Named,
            ["backlash", "vibration"].map(str::to_owned).to_vec()
        ),
        "{}",
        d.sentence
    );
    let mut alone = |drive_v: &[f64]| in_the_next_row(behind_a_gap(drive_v));
    let d = explained(&mut alone, usual_drives()).diagnosis;
    assert!(
        matches!(d.verdict, Verdict::Named | Verdict::Ambiguous),
        "{}",
        d.sentence
    );
    assert_eq!(
        (d.findings.len(), d.findings[0].effects[0].as_str()),
        (1, "backlash"),
        "{}",
        d.sentence
    );
}
