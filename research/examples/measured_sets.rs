//! How near `explain` from a bare gain comes to the best that the library can reach on recordings of real
//! stages.
//!
//! For each set of records: the effects that `explain` ends with, its fitted and held-out errors, and, with
//! `--subsets`, the best of all subsets of seven effects beside the hysteresis, each fitted with `identify`.
//! The ratio is that of the geometric means of fitted and held-out error. With `--reversed` the records are
//! given in the other order too, which must end at the same effects and errors; with `--within` each has so
//! many seconds.
//!
//! ```text
//! cargo run --release -p hysteron-research --example measured_sets -- [--subsets] [--reversed] [--trace] \
//!     [--within SECONDS] [--identify EFFECTS] [--data FOLDER] [SET ...]
//! ```
//!
//! The recordings are not part of the project (their sources are named in its documentation); without the
//! folder it reports that.

use hysteron::analyse::{Options, Start, analyse};
use hysteron::dataset::{Dataset, folder};
use hysteron::identification::fit::{residual, rms};
use hysteron::identify::identify;
use hysteron::model_file::effects_named;
use hysteron::watch::{Deadline, Unwatched, Watch};
use hysteron_sim::chain::Model;
use hysteron_tests::measured::{MeasuredTrace, flag, folder as folder_of_recordings, value_of};
use serde::Deserialize;
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::Path;
use std::time::{Duration, Instant};

/// `tests/manifests/recorded_sets.toml`.
#[derive(Deserialize)]
struct File {
    stage: BTreeMap<String, Stage>,
    set: Vec<Set>,
}

/// Where recordings of one stage are judged, and its range.
#[derive(Deserialize)]
struct Stage {
    span_v: f64,
    record: String,
    #[serde(default)]
    other: BTreeMap<String, String>,
    #[serde(default)]
    copy_of: BTreeMap<String, String>,
}

/// A set of records: what is fitted, what judges.
#[derive(Deserialize)]
struct Set {
    name: String,
    stage: String,
    fitted: Vec<String>,
    held_out: Vec<String>,
}

fn sets() -> File {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/manifests/recorded_sets.toml");
    toml::from_str(&std::fs::read_to_string(path).expect("the sets are there"))
        .expect("the sets can be read")
}

/// Effects of which subsets are formed.
const SEVEN: [&str; 7] = [
    "initial_curve",
    "creep",
    "vibration",
    "friction",
    "amplifier_bandwidth",
    "sensor_bandwidth",
    "rate_dependence",
];

/// The manifest of a set.
fn manifest(set: &Set, stage: &Stage) -> String {
    let span_v = stage.span_v;
    let mut out = format!(
        "name = \"{}\"\ndrive_min_v = -{span_v:.1}\ndrive_max_v = {span_v:.1}\n",
        set.name
    );
    for (role, records) in [("identify", &set.fitted), ("validate", &set.held_out)] {
        for record in records {
            let part = stage.other.get(record).unwrap_or(&stage.record);
            let _ = write!(
                out,
                "\n[[record]]\nfile = \"{record}.csv\"\nrole = \"{role}\"\ninitial_state = \"unknown\"\n{part}\n"
            );
        }
    }
    out
}

fn load(set: &Set, stage: &Stage, data: &Path) -> Dataset {
    let folder = tempfile::tempdir().expect("a temporary folder");
    for record in set.fitted.iter().chain(&set.held_out) {
        let source = stage.copy_of.get(record).unwrap_or(record);
        std::fs::copy(
            data.join(&set.stage).join(format!("{source}.csv")),
            folder.path().join(format!("{record}.csv")),
        )
        .expect("the recording can be copied");
    }
    std::fs::write(folder.path().join("dataset.toml"), manifest(set, stage))
        .expect("the manifest can be written");
    folder::load(folder.path()).expect("the set can be read")
}

/// Fitted and held-out error, um: root of the mean square over the samples.
fn errors_um(model: &Model, dataset: &Dataset, set: &Set) -> (f64, f64) {
    let of = |names: &[String]| -> f64 {
        let each = dataset.records.iter().filter(|r| names.contains(&r.name));
        let (sum, count) = each.fold((0.0, 0), |(sum, count), record| {
            let left = residual(model, record);
            (
                sum + rms(&left).powi(2) * left.len() as f64,
                count + left.len(),
            )
        });
        (sum / count as f64).sqrt()
    };
    (of(&set.fitted), of(&set.held_out))
}

fn nm(um: f64) -> String {
    format!("{:.1}", 1e3 * um)
}

/// The best subset by the geometric mean of its errors.
fn best_subset(dataset: &Dataset, set: &Set) -> (Vec<&'static str>, f64, f64) {
    let mut best: Option<(Vec<&'static str>, f64, f64)> = None;
    for mask in 0..1_u32 << SEVEN.len() {
        let chosen: Vec<&'static str> = std::iter::once("hysteresis")
            .chain(
                (0..SEVEN.len())
                    .filter(|i| mask >> i & 1 == 1)
                    .map(|i| SEVEN[i]),
            )
            .collect();
        let effects = effects_named(&chosen.join(",")).expect("known effects");
        eprint!("\r{:>4} of 128 subsets", mask + 1);
        let Ok(found) = identify(dataset, &effects, &Unwatched) else {
            continue;
        };
        let (fitted, held_out) = errors_um(&found.model, dataset, set);
        if best
            .as_ref()
            .is_none_or(|(_, f, h)| fitted * held_out < f * h)
        {
            best = Some((chosen, fitted, held_out));
        }
    }
    eprintln!();
    best.expect("at least one subset can be fitted")
}

fn main() {
    let mut arguments: Vec<String> = std::env::args().skip(1).collect();
    let subsets = flag(&mut arguments, "--subsets");
    let reversed = flag(&mut arguments, "--reversed");
    let trace = MeasuredTrace::default();
    let watch: &dyn Watch = if flag(&mut arguments, "--trace") {
        &trace
    } else {
        &Unwatched
    };
    let Some(data) = folder_of_recordings(&mut arguments) else {
        return;
    };
    let only = value_of(&mut arguments, "--identify");
    let within = value_of(&mut arguments, "--within")
        .map(|seconds| Duration::from_secs_f64(seconds.parse().expect("a number of seconds")));
    let sets = sets();
    for set in sets
        .set
        .iter()
        .filter(|s| arguments.is_empty() || arguments.contains(&s.name))
    {
        let dataset = load(set, &sets.stage[&set.stage], &data);
        if let Some(effects) = &only {
            let listed = effects_named(effects).expect("known effects");
            let found = identify(&dataset, &listed, &Unwatched).expect("it can be identified");
            let (fitted, held_out) = errors_um(&found.model, &dataset, set);
            println!(
                "{:<12} {:>7} / {:>7} nm  {}",
                set.name,
                nm(fitted),
                nm(held_out),
                found.model.effect_ids().join(",")
            );
            continue;
        }
        let gain = effects_named("gain").expect("a built-in effect");
        let begin = Instant::now();
        let explained = |watch: &dyn Watch| {
            analyse(&dataset, Start::Effects(&gain), &Options::default(), watch)
                .expect("it can be explained")
        };
        let found = within.map_or_else(
            || explained(watch),
            |within| explained(&Deadline::new(watch, within)),
        );
        let seconds = begin.elapsed().as_secs_f64();
        let (fitted, held_out) = errors_um(&found.model, &dataset, set);
        println!(
            "{:<12} {:>7} / {:>7} nm  {:>5.1} s  {:<13} {}",
            set.name,
            nm(fitted),
            nm(held_out),
            seconds,
            found.diagnosis.verdict.word(),
            found.model.effect_ids().join(","),
        );
        if reversed {
            let mut other = dataset.clone();
            other.records.reverse();
            let again = analyse(
                &other,
                Start::Effects(&gain),
                &Options::default(),
                &Unwatched,
            )
            .expect("it can be explained");
            let (f, h) = errors_um(&again.model, &other, set);
            let same = if again.model.effect_ids() == found.model.effect_ids() {
                "the same effects"
            } else {
                "OTHER EFFECTS"
            };
            println!(
                "{:<12} {:>7} / {:>7} nm  records in the other order: {same}",
                "",
                nm(f),
                nm(h)
            );
        }
        if subsets {
            let (effects, f, h) = best_subset(&dataset, set);
            println!(
                "{:<12} {:>7} / {:>7} nm  ratio {:.3}   {}",
                "",
                nm(f),
                nm(h),
                ((fitted * held_out) / (f * h)).sqrt(),
                effects.join(",")
            );
        }
    }
}
