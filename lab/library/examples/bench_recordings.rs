//! Recordings of a bench for the program, and what a feedforward that was identified from them comes to on
//! that bench.
//!
//! ```text
//! cargo run --release -p hysteron --example bench_recordings -- [--bench reference|domains] [--full]
//! [--effects LIST] [--out DIR]
//! ```
//!
//! With `--out` the records are written as a data set, for `hysteron explain DIR`. Records: nested loops of
//! many heights, a multisine to a third of the sampling rate, steps that are held for seconds (every
//! hundredth reading); others of the same kinds are held out. Each begins virgin.
//!
//! Then the effects of the list are fitted, and a feedforward without any feedback follows sines of 5 um on
//! the same bench: without the inverse of creep, with its first-order terms alone, and with all of it. Errors
//! are of the true displacement.

use hysteron::dataset::{Dataset, Record, Role};
use hysteron::identification::fit::rms_over;
use hysteron::identify::identify;
use hysteron::model_file::effects_named;
use hysteron::servo::design::{Scheme, ServoDesign};
use hysteron::servo::model::{ActuatorModel, required_model};
use hysteron::servo::thesis_schemes::PidGains;
use hysteron::watch::Unwatched;
use hysteron_sim::bench::{Bench, Start, Variant};
use hysteron_sim::closed_loop::Experiment;
use hysteron_sim::waveform;
use std::fmt::Write as _;
use std::path::Path;

/// Readings of the steps: one in so many.
const THINNED: usize = 200;

/// Effects of the reference bench without what its full variant adds.
const EFFECTS: &str = "hysteresis,initial_curve,vibration,creep,creep_pole_pair";

/// The value behind an option, taken out of the arguments.
fn value_of(arguments: &mut Vec<String>, option: &str) -> Option<String> {
    let at = arguments.iter().position(|a| a == option)?;
    arguments.drain(at..(at + 2).min(arguments.len())).nth(1)
}

fn loops(fs: f64, levels: &[f64]) -> Vec<f64> {
    waveform::concatenate(&[
        waveform::half_cosines(fs, 0.01, levels),
        vec![*levels.last().unwrap_or(&0.0)],
    ])
}

fn steps(fs: f64, levels: &[(f64, f64)]) -> Vec<f64> {
    waveform::concatenate(
        &levels
            .iter()
            .map(|(level, seconds)| waveform::hold(fs, *level, *seconds))
            .collect::<Vec<_>>(),
    )
}

fn multisine(fs: f64, seed: u64) -> Vec<f64> {
    let lines: Vec<usize> = (1..=220).map(|k| 3 * k).collect();
    waveform::concatenate(&[
        waveform::half_cosines(fs, 0.01, &[0.0, 40.0]),
        waveform::multisine(2000, &lines, 15.0, 40.0, 2, seed),
    ])
}

/// Name, role, drive and by how much the readings are thinned out.
fn drives(fs: f64) -> Vec<(&'static str, Role, Vec<f64>, usize)> {
    let heights = [0.0, 15.0, 0.0, 30.0, 0.0, 45.0, 0.0, 60.0, 0.0, 80.0, 0.0];
    let nested = [
        0.0, 80.0, 0.0, 60.0, 30.0, 50.0, 10.0, 70.0, 40.0, 65.0, 20.0, 35.0, 25.0, 75.0, 5.0,
        45.0, 15.0, 30.0, 0.0,
    ];
    let others = [
        0.0, 25.0, 5.0, 55.0, 20.0, 40.0, 10.0, 72.0, 33.0, 64.0, 48.0, 58.0, 12.0, 37.0, 0.0,
        66.0, 22.0, 0.0,
    ];
    vec![
        ("heights", Role::Identify, loops(fs, &heights), 1),
        ("nested", Role::Identify, loops(fs, &nested), 1),
        ("multisine", Role::Identify, multisine(fs, 59), 1),
        (
            "steps",
            Role::Identify,
            steps(
                fs,
                &[
                    (0.0, 0.5),
                    (30.0, 8.0),
                    (60.0, 4.0),
                    (20.0, 8.0),
                    (70.0, 6.0),
                    (0.0, 8.0),
                ],
            ),
            THINNED,
        ),
        ("other_loops", Role::Validate, loops(fs, &others), 1),
        (
            "other_steps",
            Role::Validate,
            steps(
                fs,
                &[
                    (0.0, 0.5),
                    (45.0, 6.0),
                    (10.0, 6.0),
                    (75.0, 6.0),
                    (40.0, 6.0),
                ],
            ),
            THINNED,
        ),
    ]
}

fn play(bench: &Bench, variant: Variant) -> Vec<Record> {
    let fs = bench.converters.sample_rate_hz;
    let of = |(k, (name, role, drive, thinned)): (usize, (&str, Role, Vec<f64>, usize))| {
        let played = bench.record(variant, Start::Virgin, &drive, 900 + k as u64);
        let thin = |signal: &[f64]| signal.iter().copied().step_by(thinned).collect::<Vec<_>>();
        Record::new(
            name,
            fs / thinned as f64,
            thin(&played.drive_v),
            thin(&played.reading_um),
        )
        .from_virgin_state()
        .with_role(role)
    };
    drives(fs).into_iter().enumerate().map(of).collect()
}

fn write(dataset: &Dataset, folder: &Path) -> std::io::Result<()> {
    std::fs::create_dir_all(folder)?;
    let mut manifest = format!(
        "name = \"{}\"\ndrive_min_v = {:.1}\ndrive_max_v = {:.1}\ntiming = \"hold_after_sample\"\n",
        dataset.name, dataset.drive_min_v, dataset.drive_max_v
    );
    for record in &dataset.records {
        let role = if record.role == Role::Validate {
            "validate"
        } else {
            "identify"
        };
        let _ = write!(
            manifest,
            "\n[[record]]\nfile = \"{}.csv\"\nsample_rate_hz = {:.1}\nrole = \"{role}\"\ninitial_state = \"virgin\"\n",
            record.name, record.sample_rate_hz
        );
        let mut rows = String::from("t_s,u_V,y_um\n");
        for (k, (u, y)) in record
            .drive_v
            .iter()
            .zip(&record.displacement_um)
            .enumerate()
        {
            let _ = writeln!(
                rows,
                "{:.6},{u:.6},{y:.6}",
                k as f64 / record.sample_rate_hz
            );
        }
        std::fs::write(folder.join(format!("{}.csv", record.name)), rows)?;
    }
    std::fs::write(folder.join("dataset.toml"), manifest)
}

/// True error of a feedforward of this model, um RMS.
fn feedforward_error_um(
    bench: &Bench,
    variant: Variant,
    model: &ActuatorModel,
    frequency_hz: f64,
    creep_inverse: bool,
) -> Option<f64> {
    let gains = PidGains {
        p: 0.0,
        i: 0.0,
        d: 0.0,
    };
    let design = ServoDesign::new(
        Scheme::Feedforward {
            gains,
            notch: None,
            creep_inverse,
        },
        model,
        true,
    );
    let parameters = design
        .parameters(bench.converter_scale().parameters())
        .map_err(|error| eprintln!("{error}"))
        .ok()?;
    let fs = bench.converters.sample_rate_hz;
    let seconds = 0.5 + (2.0 / frequency_hz).max(1.0);
    let mut reference = waveform::sine(
        fs,
        frequency_hz,
        5.0,
        bench.reference_offset_um,
        -std::f64::consts::FRAC_PI_2,
        seconds,
    );
    waveform::grow_from_zero(&mut reference, fs);
    let experiment = Experiment {
        substeps: 10,
        ..Experiment::new(bench, variant, 77)
    };
    Some(
        experiment
            .follow(&parameters, &reference)
            .true_error(waveform::samples_in(fs, 0.5))
            .rms_um,
    )
}

fn main() {
    let mut arguments: Vec<String> = std::env::args().skip(1).collect();
    let full = arguments.iter().any(|a| a == "--full");
    let name = value_of(&mut arguments, "--bench").unwrap_or_else(|| "reference".into());
    let out = value_of(&mut arguments, "--out");
    let list = value_of(&mut arguments, "--effects");
    let bench = if name == "domains" {
        Bench::domains()
    } else {
        Bench::reference()
    }
    .expect("the bench's file");
    let variant = if full { Variant::FULL } else { Variant::PLAIN };
    let dataset = Dataset::new(
        &bench.name,
        bench.drive_min_v,
        bench.drive_max_v,
        play(&bench, variant),
    )
    .expect("the records make a data set");
    if let Some(folder) = &out {
        write(&dataset, Path::new(folder)).expect("the data set can be written");
        println!("wrote {folder}");
    }
    let added = if full {
        ",second_mode,amplifier_bandwidth,sensor_bandwidth"
    } else {
        ""
    };
    let list = list.unwrap_or_else(|| format!("{EFFECTS}{added}"));
    let found = identify(
        &dataset,
        &effects_named(&list).expect("known effects"),
        &Unwatched,
    )
    .expect("it can be identified");
    let noise_um = bench.converters.sensor_noise_um;
    let (fitted, held_out) = (
        rms_over(&found.model, &dataset, &[0, 1, 2, 3]),
        rms_over(&found.model, &dataset, &[4, 5]),
    );
    println!("{list}");
    println!(
        "fitted {:.2} nm, held out {:.2} nm; white noise {:.2} nm",
        1e3 * fitted,
        1e3 * held_out,
        1e3 * noise_um
    );
    let Ok(model) = required_model(&found.model).map_err(|error| eprintln!("{error}")) else {
        return;
    };
    let model = model.for_the_tick().0;
    let first_order = ActuatorModel {
        creep_pair: None,
        ..model.clone()
    };
    println!("feedforward alone, 5 um sine, true error, nm:");
    println!(
        "{:>8} {:>14} {:>18} {:>10}",
        "Hz", "without creep", "first-order terms", "all creep"
    );
    for frequency_hz in [1.0, 10.0, 50.0, 100.0] {
        let nm = |of: &ActuatorModel, inverse: bool| {
            feedforward_error_um(&bench, variant, of, frequency_hz, inverse)
                .map_or_else(|| "-".into(), |um| format!("{:.2}", 1e3 * um))
        };
        println!(
            "{frequency_hz:>8} {:>14} {:>18} {:>10}",
            nm(&model, false),
            nm(&first_order, true),
            nm(&model, true)
        );
    }
}
