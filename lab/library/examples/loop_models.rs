//! Every structure of the loops on one recording of a real stage: fitted at 20 Hz, judged at 40 Hz.
//!
//! Each stands in front of the same mode and creep, whose values are fitted with it. For each: error where it
//! was fitted and where it was not, in nm and in % of the range, the time a sample of the loops takes, and
//! whether an inverse exists: the largest miss of [`LoopInverse`] along the reading, and the time of a
//! sample. Best first by the error at 40 Hz.
//!
//! ```text
//! cargo run --release -p hysteron --example loop_models -- [--data FOLDER] [--csv FILE] [MODEL ...]
//! ```
//!
//! The recordings are not part of the project (docs/results/real_recordings.md names their source); without
//! the folder it reports that.

use hysteron::dataset::{Dataset, Record, Role};
use hysteron::identification::fit::{Effort, fit, rms_over};
use hysteron::statistics::peak_to_peak;
use hysteron_sim::chain::{EffectInstance, Model};
use hysteron_sim::effect::{Overview, Setting, by_id};
use hysteron_sim::loop_inverse::LoopInverse;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// A structure: its name in the table, and its effects.
const MODELS: [(&str, &[&str]); 15] = [
    ("gain", &["gain"]),
    ("polynomial loop", &["polynomial_loop"]),
    ("Prandtl-Ishlinskii", &["prandtl_ishlinskii"]),
    (
        "modified Prandtl-Ishlinskii",
        &["modified_prandtl_ishlinskii"],
    ),
    (
        "rate-dependent Prandtl-Ishlinskii",
        &["rate_dependent_prandtl_ishlinskii"],
    ),
    ("Maxwell slip", &["maxwell_slip"]),
    ("Bouc-Wen", &["bouc_wen"]),
    ("Duhem (Coleman-Hodgdon)", &["duhem"]),
    ("inverse Preisach", &["inverse_preisach"]),
    ("Preisach", &["hysteresis"]),
    ("one-sided (thesis RI)", &["hysteresis", "initial_curve"]),
    (
        "one-sided with one rate factor",
        &["hysteresis", "initial_curve", "rate_dependence"],
    ),
    (
        "one-sided, rate-dependent (thesis RD)",
        &["hysteresis", "initial_curve", "rate_dependent_surfaces"],
    ),
    (
        "one-sided with play operators",
        &["hysteresis", "initial_curve", "play_operators"],
    ),
    (
        "one-sided with play operators, rate-dependent",
        &[
            "hysteresis",
            "initial_curve",
            "play_operators",
            "rate_dependent_surfaces",
        ],
    ),
];

/// The mode that the recording rings with after its first step: 735 Hz, damping ratio 0.014.
const MODE: [f64; 2] = [4618.0, 0.014];

/// Where the first part, in which the stage was switched on, ends, s.
const FROM_S: f64 = 1.5;

struct Row {
    name: &'static str,
    parameters: usize,
    fitted_um: f64,
    judged_um: f64,
    sample_ns: f64,
    /// Largest miss of the inverse, um, and time of a sample, ns.
    inverse: Option<(f64, f64)>,
}

/// One record of the stage, 10 kHz, columns time, drive, displacement. What lies before [`FROM_S`] drives the
/// model and is not judged.
fn record(data: &Path, name: &str, role: Role) -> Result<Record, String> {
    let file = data.join(format!("piezo_stage/{name}.csv"));
    let text =
        std::fs::read_to_string(&file).map_err(|error| format!("{}: {error}", file.display()))?;
    let rows: Vec<Vec<f64>> = text
        .lines()
        .skip(1)
        .filter_map(|l| l.split(',').map(|v| v.parse().ok()).collect())
        .collect();
    let column = |i: usize| {
        rows.iter()
            .filter_map(|r| r.get(i).copied())
            .collect::<Vec<f64>>()
    };
    let mut record = Record::new(name, 10_000.0, column(1), column(2)).with_role(role);
    record.window.start = (FROM_S * record.sample_rate_hz) as usize;
    Ok(record)
}

/// The value behind an option, taken out of the arguments.
fn value_of(arguments: &mut Vec<String>, option: &str) -> Option<String> {
    let at = arguments.iter().position(|a| a == option)?;
    arguments.drain(at..(at + 2).min(arguments.len())).nth(1)
}

fn with(model: &Model, id: &str, overview: &Overview, values: &[f64]) -> Model {
    let mut out = model.clone();
    out.add(EffectInstance::new(
        by_id(id).expect("a built-in effect"),
        overview,
        values,
    ));
    out
}

/// Time of a sample of the loops, and of their inverse along what they give.
fn loops_and_inverse(model: &Model, drive_v: &[f64], dt_s: f64) -> (f64, Option<(f64, f64)>) {
    let main = model
        .effects
        .iter()
        .find(|e| e.effect.declaration().is_main())
        .expect("loops");
    let setting = Setting::of_held_drive(model.drive_min_v, model.drive_max_v, dt_s);
    let mut stage = main.stage(model, &setting).expect("a stage");
    stage.settle(model.drive_min_v);
    let begin = Instant::now();
    let given: Vec<f64> = drive_v
        .iter()
        .enumerate()
        .map(|(k, u)| stage.step(k, *u))
        .collect();
    let sample_ns = begin.elapsed().as_nanos() as f64 / drive_v.len() as f64;
    let inverse = LoopInverse::from_model(model, dt_s).map(|mut inverse| {
        let begin = Instant::now();
        let miss = given
            .iter()
            .map(|y| (inverse.step(*y).output_um - y).abs())
            .fold(0.0, f64::max);
        (miss, begin.elapsed().as_nanos() as f64 / given.len() as f64)
    });
    (sample_ns, inverse)
}

fn main() {
    let mut arguments: Vec<String> = std::env::args().skip(1).collect();
    let csv = value_of(&mut arguments, "--csv");
    let data = value_of(&mut arguments, "--data")
        .map_or_else(|| PathBuf::from("../shared/data/measured"), PathBuf::from);
    let records = [
        ("20_hz_no_lp", Role::Identify),
        ("40_hz_no_lp", Role::Validate),
    ]
    .map(|(name, role)| record(&data, name, role));
    let dataset: Dataset = match records.into_iter().collect::<Result<Vec<_>, _>>() {
        Ok(records) => Dataset::new("piezo_stage", -95.0, 95.0, records)
            .expect("the recordings make a data set"),
        Err(error) => return eprintln!("{error}: give the folder of the recordings with --data"),
    };
    let overview = dataset.overview();
    let range_um =
        peak_to_peak(&dataset.records[1].displacement_um[dataset.records[1].window.clone()]);
    let mut rest = with(
        &Model::new(dataset.drive_min_v, dataset.drive_max_v),
        "gain",
        &overview,
        &[],
    );
    rest = with(
        &with(&rest, "vibration", &overview, &MODE),
        "creep",
        &overview,
        &[],
    );
    let mut rows = Vec::new();
    for (name, effects) in MODELS.iter().filter(|(name, _)| {
        arguments.is_empty() || arguments.iter().any(|a| name.contains(a.as_str()))
    }) {
        // Loops first, then everything with them.
        let mut model = effects
            .iter()
            .fold(rest.clone(), |model, id| with(&model, id, &overview, &[]));
        let effort = Effort {
            iterations: 12,
            ..Effort::default()
        };
        model = fit(&model, &dataset, &[0], effort).model;
        let (sample_ns, inverse) = loops_and_inverse(
            &model,
            &dataset.records[1].drive_v,
            dataset.records[1].dt_s(),
        );
        let parameters = effects
            .iter()
            .filter_map(|id| model.effect(id))
            .flat_map(|e| &e.parameters)
            .filter(|p| !p.parameter.fixed)
            .count();
        let row = Row {
            name,
            parameters,
            fitted_um: rms_over(&model, &dataset, &[0]),
            judged_um: rms_over(&model, &dataset, &[1]),
            sample_ns,
            inverse,
        };
        eprintln!(
            "{name}: {:.1} / {:.1} nm",
            1e3 * row.fitted_um,
            1e3 * row.judged_um
        );
        rows.push(row);
    }
    rows.sort_by(|a, b| a.judged_um.total_cmp(&b.judged_um));
    let mut table = String::from(
        "model,coefficients,rms_20_hz_nm,rms_40_hz_nm,rms_40_hz_pct_range,sample_ns,inverse_miss_nm,inverse_sample_ns\n",
    );
    println!(
        "{:<46} {:>5} {:>10} {:>10} {:>8} {:>9} {:>12} {:>10}",
        "model", "coef.", "20 Hz nm", "40 Hz nm", "% range", "ns", "inverse nm", "ns"
    );
    for row in &rows {
        let (fitted, judged, share) = (
            1e3 * row.fitted_um,
            1e3 * row.judged_um,
            100.0 * row.judged_um / range_um,
        );
        let (miss, time) = row
            .inverse
            .map_or((String::new(), String::new()), |(um, ns)| {
                (format!("{:.1e}", 1e3 * um), format!("{ns:.0}"))
            });
        println!(
            "{:<46} {:>5} {fitted:>10.1} {judged:>10.1} {share:>8.3} {:>9.0} {miss:>12} {time:>10}",
            row.name, row.parameters, row.sample_ns
        );
        let _ = writeln!(
            table,
            "\"{}\",{},{fitted:.2},{judged:.2},{share:.4},{:.0},{miss},{time}",
            row.name, row.parameters, row.sample_ns
        );
    }
    if let Some(file) = csv
        && let Err(error) = std::fs::write(&file, table)
    {
        eprintln!("{file}: {error}");
    }
}
