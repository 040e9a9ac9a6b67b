//! What a diagnosis of data sets simulates, by stage, and how long that takes.
//!
//! A row holds the verdict, the names, the errors on fitted and held-out records, the noise, the seconds of
//! processor and the steps of simulation; below it the steps by stage. A search begins at the effects of
//! `base_effects.txt` in the folder, without one at a gain.
//!
//! ```text
//! cargo run --release -p hysteron --example where_time_goes -- [--steps MILLIONS] [--within SECONDS]
//! [--brief] DATA ...
//! ```

use hysteron::analyse::{Options, Outcome, Start, analyse};
use hysteron::dataset::folder;
use hysteron::model_file::effects_named;
use hysteron::watch::{Deadline, Unwatched};
use std::path::Path;
use std::time::{Duration, Instant};

/// Seconds of processor so far.
fn processor_s() -> f64 {
    let text = std::fs::read_to_string("/proc/self/stat").unwrap_or_default();
    let fields = text.rsplit(')').next().unwrap_or_default();
    let ticks = fields.split_whitespace().skip(11).take(2);
    ticks.filter_map(|t| t.parse::<f64>().ok()).sum::<f64>() / 100.0
}

fn row(path: &Path, options: &Options, within: Option<Duration>) -> hysteron::Result<Outcome> {
    let dataset = folder::load(path)?;
    let list = std::fs::read_to_string(path.join("base_effects.txt"));
    let names: Vec<String> = list
        .unwrap_or_else(|_| "gain".into())
        .split_whitespace()
        .map(|name| name.trim_matches(',').to_owned())
        .collect();
    let effects = effects_named(&names.join(","))?;
    let (before_s, began) = (processor_s(), Instant::now());
    let start = Start::Effects(&effects);
    let found = match within {
        Some(within) => analyse(&dataset, start, options, &Deadline::new(&Unwatched, within))?,
        None => analyse(&dataset, start, options, &Unwatched)?,
    };
    let d = &found.diagnosis;
    let said: Vec<String> = d.findings.iter().map(|f| f.effects.join("|")).collect();
    let last = found.last();
    println!(
        "{:<40} {:<12} {:>9.2}/{:<9.2} noise {:>7.2} {:>6.1} s of processor, {:>6.1} s, {:>7.0} million steps  {}{}",
        path.file_name().unwrap_or_default().to_string_lossy(),
        d.verdict.word(),
        1e3 * last.identify_rms_um,
        1e3 * last.validate_rms_um.unwrap_or(f64::NAN),
        1e3 * found.floor.rms_um.unwrap_or(f64::NAN),
        processor_s() - before_s,
        began.elapsed().as_secs_f64(),
        found.work.steps() as f64 * 1e-6,
        said.join(" + "),
        d.reason.map_or(String::new(), |r| format!(
            " [{r:?}: {}]",
            d.so_far.join(", ")
        )),
    );
    Ok(found)
}

fn main() {
    let mut options = Options::default();
    let (mut within, mut brief) = (None, false);
    let mut arguments = std::env::args().skip(1);
    while let Some(argument) = arguments.next() {
        let mut number = || arguments.next().and_then(|n| n.parse::<f64>().ok());
        match argument.as_str() {
            "--steps" => options.policy.most_steps = 1e6 * number().unwrap_or(f64::INFINITY),
            "--within" => within = number().map(Duration::from_secs_f64),
            "--brief" => brief = true,
            path => match row(Path::new(path), &options, within) {
                Ok(found) if !brief => println!("{}\n", found.work.table()),
                Ok(_) => {}
                Err(problem) => println!("{path}: {problem}"),
            },
        }
    }
}
