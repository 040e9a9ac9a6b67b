//! Four recordings with something wrong about them, asked from the command line, from the page and by `score`: the same answer.

use super::answer::Answer;
use super::case::{Case, Check, Start, answered};
use super::invariance::uniform;
use super::recorded::write;
use super::results::Row;
use super::{Context, page, spread};
use serde_json::{Value, json};
use std::f64::consts::TAU;
use std::fmt::Write as _;
use std::path::Path;

const RATE_HZ: f64 = 2000.0;
const SAMPLES: usize = 8000;
/// What a reading of the noise deviates by, um.
const NOISE_UM: f64 = 0.002;

/// What is wrong with a recording.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Wrong {
    Disconnected,
    OtherTiming,
    Clipped,
    InitialState,
}

const CASES: [(Wrong, &str); 4] = [
    (Wrong::Disconnected, "disconnected"),
    (Wrong::OtherTiming, "other_timing"),
    (Wrong::Clipped, "clipped"),
    (Wrong::InitialState, "initial_state"),
];

/// The four cases.
pub fn cases(context: &Context, most: Option<usize>) -> Result<Vec<Case>, String> {
    let folder = context.folder_of("front_ends")?;
    let case = |(wrong, name): (Wrong, &str)| -> Result<Case, String> {
        let into = folder.join(name);
        let data = into.join("recorded");
        if !data.join("dataset.toml").exists() {
            recorded(&data, wrong)?;
            let base = if wrong == Wrong::InitialState { "gain,creep" } else { "gain" };
            let truth = json!([{ "name": "recorded", "hidden": null, "base": base.split(',').collect::<Vec<_>>(), "noise_um": NOISE_UM }]);
            write(&into.join("truth.json"), &truth.to_string())?;
        }
        let from = if wrong == Wrong::InitialState { "gain,creep" } else { "gain" };
        Ok(Case { name: name.into(), data, start: Start::Effects(from.into()), check: Check::FrontEnds, noise_um: None })
    };
    Ok(spread(CASES.into_iter().map(case).collect::<Result<Vec<_>, _>>()?, most))
}

/// A stage of 0.1 um/V with a resonance, or with loops where its timing is asked for, or with creep where its states are.
fn recorded(into: &Path, wrong: Wrong) -> Result<(), String> {
    let wave = |k: usize, fast: f64| {
        let sines: f64 = (1..=12).map(|i| 0.4 * (TAU * fast * f64::from(5 * i * i) * k as f64 / RATE_HZ + f64::from(i * i)).sin()).sum();
        (5.0 + sines).clamp(0.0, 10.0)
    };
    let steps = |k: usize| 1.0 + 2.0 * ((k / 800) * 7 % 5) as f64;
    let smooth = |k: usize, fast: f64| 5.0 - 2.5 * (k as f64 * 0.02 * fast).cos() - 1.5 * (k as f64 * 0.11 * fast).sin();
    let timing = if wrong == Wrong::OtherTiming { "" } else { "timing = \"hold_after_sample\"\n" };
    let state = if wrong == Wrong::InitialState { "virgin" } else { "unknown" };
    let mut manifest = format!("name = \"recorded\"\ndrive_min_v = 0.0\ndrive_max_v = 10.0\n{timing}");
    let mut random = 7_u64;
    for (name, role) in [("fitted", "identify"), ("held_out", "validate"), ("rest", "noise")] {
        let drive_v: Vec<f64> = (0..SAMPLES)
            .map(|k| match (role, wrong) {
                ("noise", _) => 0.0,
                (_, Wrong::OtherTiming) => smooth(k, if role == "identify" { 1.0 } else { 1.3 }),
                (_, Wrong::InitialState) => steps(k + if role == "identify" { 0 } else { 1600 }),
                _ => wave(k, if role == "identify" { 1.0 } else { 0.8 }),
            })
            .collect();
        let mut readings = read(&drive_v, wrong);
        // Of a record that is said to begin virgin the beginning is cut away.
        let from = if wrong == Wrong::InitialState && role == "identify" { 1000 } else { 0 };
        readings.iter_mut().for_each(|y| {
            if wrong == Wrong::Disconnected && role != "noise" {
                *y = 0.0;
            }
            // Twelve uniform numbers are near enough to a normal one.
            *y += NOISE_UM * ((0..12).map(|_| uniform(&mut random)).sum::<f64>() - 6.0);
            if wrong == Wrong::Clipped {
                *y = y.min(0.6);
            }
        });
        let mut text = String::from("t_s,u_v,y_um\n");
        for k in from..SAMPLES {
            let _ = writeln!(text, "{:.4},{:.6},{:.6}", (k - from) as f64 / RATE_HZ, drive_v[k], readings[k]);
        }
        write(&into.join(format!("{name}.csv")), &text)?;
        let _ = write!(
            manifest,
            "\n[[record]]\nfile = \"{name}.csv\"\nrole = \"{role}\"\nsample_rate_hz = {RATE_HZ:.1}\ninitial_state = \"{state}\"\n"
        );
    }
    write(&into.join("dataset.toml"), &manifest)
}

/// Readings without noise.
fn read(drive_v: &[f64], wrong: Wrong) -> Vec<f64> {
    const STEPS: usize = 50;
    let (w, z, dt_s) = (1500.0, 0.1, 1.0 / RATE_HZ / STEPS as f64);
    let (mut x, mut v, mut play) = (0.1 * drive_v[0], 0.0, drive_v[0]);
    if wrong == Wrong::InitialState {
        x = 0.0;
    }
    let mut slow = [0.0; 2];
    let one = |u: &f64| match wrong {
        Wrong::OtherTiming => {
            play = f64::clamp(play, u - 1.0, u + 1.0);
            0.07 * u + 0.03 * play
        }
        Wrong::InitialState => {
            let before: f64 = 0.1 * u + slow.iter().sum::<f64>();
            for (state, time_s) in slow.iter_mut().zip([0.1, 1.0]) {
                *state += (0.008 * u - *state) / (time_s * RATE_HZ);
            }
            before
        }
        _ => {
            let before = x;
            for _ in 0..STEPS {
                v += dt_s * (w * w * (0.1 * u - x) - 2.0 * z * w * v);
                x += dt_s * v;
            }
            before
        }
    };
    let mut out: Vec<f64> = drive_v.iter().map(one).collect();
    if wrong == Wrong::InitialState {
        // A reading stands before the drive of its row acts.
        out.rotate_right(1);
        out[0] = 0.0;
    }
    out
}

/// Asks all front ends and compares.
pub fn compared(case: &Case, context: &Context, set: &str) -> Result<Row, String> {
    let Start::Effects(from) = &case.start else { return Err("a front end starts from effects".into()) };
    let folder = context.folder_of("answers")?.join(&context.label);
    std::fs::create_dir_all(&folder).map_err(|e| format!("{}: {e}", folder.display()))?;
    let json = folder.join(format!("{set}_{}.json", case.name));
    let (cli, seconds, processor_s) = answered(&context.program, &["explain", &case.data.to_string_lossy(), "--from", from], &json)?;
    let answer = Answer::of(&cli)?;
    let mut differs = Vec::new();
    let of_page = page::explained(&context.program, &case.data, from)?;
    differs.extend(difference(&without_times(&cli), &without_times(&of_page), "").map(|at| format!("page at {at}")));
    let parent = case.data.parent().ok_or("a case without folder")?;
    let scored = folder.join(format!("{set}_{}.score.json", case.name));
    let (score, ..) = answered(&context.program, &["score", &parent.to_string_lossy()], &scored)?;
    let of_score = &score["cases"][0];
    if of_score["verdict"] != cli["diagnosis"]["verdict"] || of_score["named"] != cli["diagnosis"]["named"] {
        differs.push(format!("score says {}", of_score["verdict"].as_str().unwrap_or_default()));
    }
    let mut row = Row { set: set.into(), case: case.name.clone(), ..Row::default() };
    row.fill(&answer, seconds, processor_s);
    row.mark = if differs.is_empty() { "equal".into() } else { differs.join("; ").replace(',', " ") };
    Ok(row)
}

fn without_times(value: &Value) -> Value {
    let mut value = value.clone();
    if let Some(object) = value.as_object_mut() {
        object.remove("seconds");
    }
    value
}

/// Where two values differ first.
fn difference(a: &Value, b: &Value, at: &str) -> Option<String> {
    match (a, b) {
        (Value::Object(x), Value::Object(y)) => {
            let keys: std::collections::BTreeSet<&String> = x.keys().chain(y.keys()).collect();
            let each = |key: &&String| difference(x.get(*key)?, y.get(*key)?, &format!("{at}.{key}"));
            keys.iter()
                .find(|key| !x.contains_key(**key) || !y.contains_key(**key))
                .map(|key| format!("{at}.{key}"))
                .or_else(|| keys.iter().find_map(each))
        }
        (Value::Array(x), Value::Array(y)) if x.len() == y.len() => {
            x.iter().zip(y).enumerate().find_map(|(i, (x, y))| difference(x, y, &format!("{at}[{i}]")))
        }
        _ => (a != b).then(|| at.to_owned()),
    }
}
