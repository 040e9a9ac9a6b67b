//! Estimators of the velocity that the thesis argues against, beside its PIDSMO, on both benches: error,
//! phase lag and noise gain of the velocity estimate.
//!
//! ```text
//! cargo run --release -p hysteron-thesis --example velocity_estimators -- [--csv FILE]
//! ```
//!
//! The bench of domains is the plant that is not the model. Each estimator has one number that makes it
//! faster; it is chosen by the least error on another record of the same bench.

use hysteron_thesis::{ChapterRow, PlayedOn, estimators};
use std::fmt::Write as _;
use std::process::ExitCode;

/// Estimators in the order of the table.
const ESTIMATORS: [&str; 6] = [
    "pidsmo_thesis",
    "pidsmo",
    "alpha_beta",
    "high_gain",
    "super_twisting",
    "ekf",
];

fn figure<'a>(rows: &'a [ChapterRow], estimator: &str, what: &str) -> Option<&'a ChapterRow> {
    rows.iter()
        .find(|row| row.id == format!("ch7.estimator.{estimator}.{what}"))
}

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let csv = match arguments.as_slice() {
        [] => None,
        [option, file] if option == "--csv" => Some(file),
        _ => {
            eprintln!("expected [--csv FILE], found {}", arguments.join(" "));
            return ExitCode::from(2);
        }
    };
    let mut table =
        String::from("bench,estimator,error_um_s,lag_deg_at_100_hz,noise_gain_1_s,chosen\n");
    println!(
        "{:<10} {:<15} {:>12} {:>12} {:>14}  chosen",
        "bench", "estimator", "error um/s", "lag deg", "noise gain 1/s"
    );
    for on in PlayedOn::BOTH {
        let bench = match on.bench() {
            Ok(bench) => bench,
            Err(error) => {
                eprintln!("{error}");
                return ExitCode::from(2);
            }
        };
        let rows = estimators::rows(&bench);
        for estimator in ESTIMATORS {
            let [Some(error), Some(lag), Some(gain)] =
                ["velocity.rms", "lag", "noise_gain"].map(|what| figure(&rows, estimator, what))
            else {
                continue;
            };
            let chosen = error.note.split(", ").next().unwrap_or_default();
            println!(
                "{:<10} {estimator:<15} {:>12.2} {:>12.2} {:>14.0}  {chosen}",
                on.name(),
                error.ours,
                lag.ours,
                gain.ours
            );
            let _ = writeln!(
                table,
                "{},{estimator},{:.3},{:.3},{:.0},\"{chosen}\"",
                on.name(),
                error.ours,
                lag.ours,
                gain.ours
            );
        }
        if let Some(refused) =
            figure(&rows, "unknown_input_observer", "refused").filter(|row| row.ours == 1.0)
        {
            println!("{:<10} {:<15} {}", on.name(), "unknown input", refused.note);
            let _ = writeln!(
                table,
                "{},unknown_input_observer,,,,\"{}\"",
                on.name(),
                refused.note
            );
        }
    }
    if let Some(file) = csv
        && let Err(error) = std::fs::write(file, table)
    {
        eprintln!("{file}: {error}");
        return ExitCode::from(2);
    }
    ExitCode::SUCCESS
}
