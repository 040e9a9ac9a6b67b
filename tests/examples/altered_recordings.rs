//! Recordings of a real stage that were altered in a known way: is it named?
//!
//! A model is identified on clean recordings. The reading of the same recordings is then altered as a sensor, an electronics or a data
//! acquisition would alter it, in three sizes each; `explain` is asked from the model (what does this recording have that the model has
//! not?) and, with `--from-gain`, from a bare gain (does the effect end up in the model?).
//!
//! ```text
//! cargo run --release -p hysteron-tests --example altered_recordings -- [--from-gain [--two-speeds]] [--tried] [--trace] [--write FOLDER] [--data FOLDER] [ALTERATION[:SIZE] ...]
//! ```
//!
//! With `--write` nothing is asked: the altered data sets, the model of the clean ones and, in `right.txt`, what counts as right are written to a folder,
//! for other programs.
//!
//! What counts as right was written down before anything was run: [`Alteration::right`] lists the effects that do physically what was done
//! to the column. Told wrong is a single other name with "this data can tell".

use hysteron::dataset::reading_limits::leave_out;
use hysteron::dataset::{Dataset, Record, Role};
use hysteron::diagnosis::judgement::Judged;
use hysteron::explain::{Explanation, Options, Start, explain};
use hysteron::identification::fit::{counted_residual, rms};
use hysteron::model_file::{effects_named, to_toml};
use hysteron::series;
use hysteron::watch::{Unwatched, Watch};
use hysteron_sim::chain::Model;
use hysteron_tests::measured::{Trace, flag, folder as folder_of_recordings, record, stage, value_of};
use std::f64::consts::TAU;
use std::fmt::Write as _;
use std::path::Path;
use std::time::Instant;

/// One way to alter a reading, in three sizes.
struct Alteration {
    name: &'static str,
    sizes: [f64; 3],
    /// Effects that do what was done.
    right: &'static [&'static str],
    alter: fn(&mut Record, f64),
}

const ALTERATIONS: &[Alteration] = &[
    Alteration { name: "delay_ms", sizes: [0.2, 0.5, 1.0], right: &["delay"], alter: delay },
    Alteration { name: "lag_hz", sizes: [1000.0, 400.0, 150.0], right: &["sensor_bandwidth"], alter: first_order },
    Alteration {
        name: "filter_hz",
        sizes: [800.0, 400.0, 200.0],
        // A second-order low-pass is one whatever it is called.
        right: &["sensor_filter", "vibration"],
        alter: second_order,
    },
    Alteration { name: "hum_nm", sizes: [20.0, 60.0, 200.0], right: &["mains_hum"], alter: hum },
    Alteration { name: "bent_percent", sizes: [0.5, 1.0, 3.0], right: &["sensor_nonlinearity"], alter: bend },
    Alteration { name: "steps_nm", sizes: [20.0, 40.0, 100.0], right: &["quantisation"], alter: round },
    Alteration { name: "creep_percent", sizes: [1.0, 2.0, 5.0], right: &["creep"], alter: creep },
    Alteration { name: "gain_percent", sizes: [2.0, 5.0, 10.0], right: &["hysteresis", "gain"], alter: gain },
    Alteration { name: CLIPPING, sizes: [2.0, 5.0, 10.0], right: &["readings that end"], alter: clip },
    Alteration { name: "nothing", sizes: [0.0, 0.0, 0.0], right: &[], alter: |_, _| {} },
];

fn delay(record: &mut Record, ms: f64) {
    let samples = (ms * 1e-3 * record.sample_rate_hz).round() as usize;
    let y = record.displacement_um.clone();
    for (k, value) in record.displacement_um.iter_mut().enumerate() {
        *value = y[k.saturating_sub(samples)];
    }
}

fn first_order(record: &mut Record, cutoff_hz: f64) {
    let decay = (-TAU * cutoff_hz / record.sample_rate_hz).exp();
    let mut state = record.displacement_um[0];
    // The reading between two samples is taken as straight.
    let mut before = state;
    let per_step = (1.0 - decay) / (TAU * cutoff_hz / record.sample_rate_hz);
    for value in &mut record.displacement_um {
        state = decay * state + (1.0 - per_step) * *value + (per_step - decay) * before;
        before = *value;
        *value = state;
    }
}

/// Butterworth, by fine steps of the differential equation.
fn second_order(record: &mut Record, cutoff_hz: f64) {
    const STEPS: usize = 20;
    let (w, dt_s) = (TAU * cutoff_hz, 1.0 / record.sample_rate_hz / STEPS as f64);
    let (mut x, mut v) = (record.displacement_um[0], 0.0);
    let mut before = x;
    for value in &mut record.displacement_um {
        for step in 0..STEPS {
            let input = before + (*value - before) * (step as f64 + 0.5) / STEPS as f64;
            v += dt_s * (w * w * (input - x) - std::f64::consts::SQRT_2 * w * v);
            x += dt_s * v;
        }
        before = *value;
        *value = x;
    }
}

fn hum(record: &mut Record, nm: f64) {
    let phase = record.name.len() as f64;
    for (k, value) in record.displacement_um.iter_mut().enumerate() {
        *value += 1e-3 * nm * (TAU * 50.0 * k as f64 / record.sample_rate_hz * 1.0002 + phase).sin();
    }
}

/// A sensor whose gain falls towards both ends by this share of the range.
fn bend(record: &mut Record, percent: f64) {
    let (low, high) = (-20.0, 20.0);
    for value in &mut record.displacement_um {
        let x = (*value - 0.5 * (low + high)) / (0.5 * (high - low));
        *value += 1e-2 * percent * 0.5 * (high - low) * x * x;
    }
}

fn round(record: &mut Record, nm: f64) {
    for value in &mut record.displacement_um {
        *value = (*value / (1e-3 * nm)).round() * 1e-3 * nm;
    }
}

/// Three more terms of creep, each of this share, on the reading.
fn creep(record: &mut Record, percent: f64) {
    let y = record.displacement_um.clone();
    for time_s in [0.02, 0.2, 2.0] {
        let decay = (-1.0 / (time_s * record.sample_rate_hz)).exp();
        let mut state = y[0];
        for (value, y) in record.displacement_um.iter_mut().zip(&y) {
            state = decay * state + (1.0 - decay) * y;
            *value += 1e-2 * percent * state;
        }
    }
}

fn gain(record: &mut Record, percent: f64) {
    record.displacement_um.iter_mut().for_each(|y| *y *= 1.0 + 1e-2 * percent);
}

/// The alteration that no effect is, but readings that say nothing.
const CLIPPING: &str = "clip_percent";

/// A sensor or its amplifier that ends this share of 36 um below the highest reading of the clean recordings: the same end in all of them.
fn clip(record: &mut Record, percent: f64) {
    let limit = 18.9 - 1e-2 * percent * 36.0;
    record.displacement_um.iter_mut().for_each(|y| *y = y.min(limit));
}

fn load(data: &Path, two_speeds: bool) -> Dataset {
    let mut records = vec![record(data, "20_hz_no_lp", 1.5, Role::Identify), record(data, "40_hz_no_lp", 1.5, Role::Validate)];
    if two_speeds {
        records.push(record(data, "sine50_1", 0.2, Role::Identify));
    }
    stage(records)
}

/// How an answer is judged.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Mark {
    Right,
    RightOr,
    Absorbed,
    Missed,
    WrongOr,
    Wrong,
}

fn mark(alteration: &Alteration, found: &Explanation, clean_um: f64, altered_um: f64) -> Mark {
    let d = &found.diagnosis;
    let changed = d.changed.iter().map(|c| c.effect.clone());
    let mut groups: Vec<Vec<String>> = d.findings.iter().map(|f| f.effects.clone()).collect();
    groups.extend(changed.map(|c| vec![c]));
    // What the verdict says of the recording itself is said beside what is missing.
    groups.extend(d.recording.first().filter(|_| alteration.name == CLIPPING).map(|_| vec!["readings that end".to_owned()]));
    let is_right = |id: &String| alteration.right.contains(&id.as_str());
    if alteration.right.is_empty() {
        return if groups.is_empty() { Mark::Right } else { Mark::Wrong };
    }
    if groups.iter().any(|g| g.iter().any(is_right)) {
        return if groups.iter().all(|g| g.len() == 1) { Mark::Right } else { Mark::RightOr };
    }
    let told = d.sentence.split("cannot tell").nth(1).unwrap_or_default();
    if alteration.right.iter().any(|id| told.contains(&id.replace('_', " "))) {
        return Mark::RightOr;
    }
    if groups.is_empty() {
        return if altered_um < 1.1 * clean_um { Mark::Absorbed } else { Mark::Missed };
    }
    if d.sentence.contains("cannot tell") { Mark::WrongOr } else { Mark::Wrong }
}

/// A data set as a folder that any program can read: time, drive and reading of each record, and the manifest.
fn write_dataset(folder: &Path, dataset: &Dataset) -> std::io::Result<()> {
    std::fs::create_dir_all(folder)?;
    let mut manifest =
        format!("name = \"{}\"\ndrive_min_v = {:.1}\ndrive_max_v = {:.1}\n", dataset.name, dataset.drive_min_v, dataset.drive_max_v);
    for record in &dataset.records {
        // What lies before the window drives the model too.
        let whole = Record { window: 0..record.drive_v.len(), ..record.clone() };
        std::fs::write(folder.join(series::file_name(record)), series::csv(&whole, &[]))?;
        let _ = write!(
            manifest,
            "\n[[record]]\nfile = \"{}\"\nrole = \"{}\"\ninitial_state = \"unknown\"\nsample_rate_hz = {:.1}\nfrom_s = {:.4}\n",
            series::file_name(record),
            record.role.name(),
            record.sample_rate_hz,
            record.window.start as f64 * record.dt_s()
        );
    }
    std::fs::write(folder.join("dataset.toml"), manifest)
}

/// Writes all altered data sets, the model of the clean ones and what counts as right.
fn write_all(folder: &Path, clean: &Dataset, model: &Model) -> std::io::Result<()> {
    let mut right = String::new();
    for alteration in ALTERATIONS {
        // What is not altered has one size only.
        let sizes = &alteration.sizes[..if alteration.right.is_empty() { 1 } else { alteration.sizes.len() }];
        for size in sizes {
            let name = format!("{}_{size}", alteration.name);
            let mut altered = clean.clone();
            altered.records.iter_mut().for_each(|r| (alteration.alter)(r, *size));
            write_dataset(&folder.join(&name), &altered)?;
            let _ = writeln!(right, "{name} {}", alteration.right.join(","));
        }
    }
    std::fs::write(folder.join("right.txt"), right)?;
    std::fs::write(folder.join("clean_model.toml"), to_toml(model, "clean").map_err(std::io::Error::other)?)
}

fn error_um(model: &Model, dataset: &Dataset) -> f64 {
    dataset.records.iter().map(|r| rms(&counted_residual(model, r))).fold(0.0, f64::max)
}

fn errors(judged: &Judged) -> String {
    format!("{:.1} / {:.1} nm", 1e3 * judged.identify_rms_um, 1e3 * judged.validate_rms_um.unwrap_or(f64::NAN))
}

fn main() {
    let mut arguments: Vec<String> = std::env::args().skip(1).collect();
    let show_tried = flag(&mut arguments, "--tried");
    let from_gain = flag(&mut arguments, "--from-gain");
    let trace = Trace::default();
    let watch: &dyn Watch = if flag(&mut arguments, "--trace") { &trace } else { &Unwatched };
    let write_to = value_of(&mut arguments, "--write");
    let Some(data) = folder_of_recordings(&mut arguments) else { return };
    let clean = load(&data, flag(&mut arguments, "--two-speeds"));
    let gain = effects_named("gain").expect("a built-in effect");
    let options = Options::default();
    let begun = explain(&clean, Start::Effects(&gain), &options, &Unwatched).expect("the clean recordings can be explained");
    let clean_um = error_um(&begun.model, &clean);
    println!("clean: {} at {:.1} nm", begun.model.effect_ids().join(","), 1e3 * clean_um);
    if let Some(folder) = write_to {
        write_all(Path::new(&folder), &clean, &begun.model).expect("the altered data sets can be written");
        return;
    }
    let (mut right, mut wrong, mut all) = (0, 0, 0);
    for alteration in ALTERATIONS {
        for size in alteration.sizes {
            let wanted = |name: &String| name == alteration.name || *name == format!("{}:{size}", alteration.name);
            if !arguments.is_empty() && !arguments.iter().any(wanted) {
                continue;
            }
            let mut altered = clean.clone();
            altered.records.iter_mut().for_each(|r| (alteration.alter)(r, size));
            leave_out(&mut altered.records);
            let altered_um = error_um(&begun.model, &altered);
            let begin = Instant::now();
            let start = if from_gain { Start::Effects(&gain) } else { Start::Model(begun.model.clone()) };
            let found = match explain(&altered, start, &options, watch) {
                Ok(found) => found,
                Err(error) => {
                    println!("{:<14} {size:>6}  REFUSED {error}", alteration.name);
                    all += 1;
                    continue;
                }
            };
            let seconds = begin.elapsed().as_secs_f64();
            if from_gain {
                let has = alteration.right.is_empty() || alteration.right.iter().any(|id| found.model.effect(id).is_some());
                let or = found.supported.iter().any(|one| one.names().iter().any(|id| alteration.right.contains(&id.as_str())));
                let left_um = error_um(&found.model, &altered);
                let absorbed = left_um < 1.1 * clean_um;
                (right, all) = (right + usize::from(has || or || absorbed), all + 1);
                for one in found.supported.iter().filter(|_| show_tried) {
                    println!("    {} ({})", one.id, errors(&one.without));
                    for rival in &one.rivals {
                        println!("        or {} ({}): {:?}", rival.id, errors(&rival.judged), rival.decision);
                    }
                }
                println!(
                    "{:<14} {size:>6}  {}  {:.1} nm, {}  {seconds:.1} s",
                    alteration.name,
                    match (has, or, absorbed) {
                        (true, ..) => "in the model",
                        (_, true, _) => "as an \"or\"  ",
                        (.., true) => "absorbed    ",
                        _ => "NOT in it   ",
                    },
                    1e3 * left_um,
                    found.model.effect_ids().join(",")
                );
                continue;
            }
            let mark = mark(alteration, &found, clean_um, altered_um);
            all += 1;
            right += usize::from(matches!(mark, Mark::Right | Mark::RightOr | Mark::Absorbed));
            wrong += usize::from(mark == Mark::Wrong);
            let word = match mark {
                Mark::Right => "right",
                Mark::RightOr => "right, or",
                Mark::Absorbed => "absorbed",
                Mark::Missed => "MISSED",
                Mark::WrongOr => "WRONG, or",
                Mark::Wrong => "WRONG",
            };
            if let Some(elsewhere) = found.elsewhere.as_ref().filter(|_| show_tried) {
                println!(
                    "    as it is {:.1}, refitted {:.1}",
                    1e3 * elsewhere.base.identify_rms_um,
                    1e3 * elsewhere.refitted.identify_rms_um
                );
                for tried in elsewhere.tried.iter().take(8) {
                    let what = tried.hypothesis.effect(&elsewhere.base.model);
                    println!("    {:.1} with {what} ({} values)", 1e3 * tried.judged.identify_rms_um, tried.values);
                }
            }
            println!("{:<14} {size:>6}  {word:<10} {seconds:>4.1} s  {}", alteration.name, found.diagnosis.sentence);
        }
    }
    println!("\n{right} of {all} right; {wrong} told wrong with confidence");
}
