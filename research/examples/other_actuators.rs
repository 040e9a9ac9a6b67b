//! What the finder says of actuators that are no piezo: voice coils, motor stages, reluctance actuators by
//! equations of their own.
//!
//! ```text
//! cargo run --release -p hysteron-research --example other_actuators -- [SEEDS]
//! ```

use hysteron::analyse::{Options, Start, analyse};
use hysteron::model_file::effects_named;
use hysteron::outcome::Verdict;
use hysteron::watch::Unwatched;
use hysteron_research::other_actuators::{KINDS, claims_of_ceramics, recorded};
use std::time::Instant;

fn main() {
    let seeds: u64 = std::env::args()
        .nth(1)
        .and_then(|n| n.parse().ok())
        .unwrap_or(4);
    let gain = effects_named("gain").expect("a built-in effect");
    let mut wrong = 0;
    for kind in KINDS {
        for seed in 1..=seeds {
            let dataset = recorded(kind, seed);
            let begin = Instant::now();
            let found = analyse(
                &dataset,
                Start::Effects(&gain),
                &Options::default(),
                &Unwatched,
            )
            .expect("it can be explained");
            let claims = matches!(found.diagnosis.verdict, Verdict::Named | Verdict::Ambiguous);
            let of_ceramics = claims && !claims_of_ceramics(kind, &found.diagnosis).is_empty();
            wrong += usize::from(of_ceramics);
            let (first, last) = (&found.steps[0].judged, found.last());
            println!(
                "{:<20} {seed:>3}  {:<12} {:>8.1} -> {:>7.1} nm (noise {:>5.1}) {:>5.1} s  {}{}",
                kind.name(),
                found.diagnosis.verdict.word(),
                1e3 * first.error_um(),
                1e3 * last.error_um(),
                1e3 * found.floor.rms_um.unwrap_or(f64::NAN),
                begin.elapsed().as_secs_f64(),
                found
                    .diagnosis
                    .findings
                    .iter()
                    .map(|f| f.effects.join(" or "))
                    .collect::<Vec<_>>()
                    .join(", "),
                if of_ceramics { "  <- of a ceramic" } else { "" },
            );
        }
    }
    println!(
        "{wrong} of {} told an effect of ceramics",
        KINDS.len() as u64 * seeds
    );
}
