//! How much faster than real time the closed loop of bench and integer servo runs on one core:
//! `cargo run --release -p hysteron-research --example closed_loop_speed`.

use hysteron::servo::design::{ServoDesign, thesis_scheme};
use hysteron_sim::bench::{Bench, Variant};
use hysteron_thesis::{commission, run, sine_reference_um};
use std::time::Instant;

fn main() {
    let Ok(bench) = Bench::reference() else {
        return;
    };
    let (reference, _) = sine_reference_um(&bench, 10.0, 5.0);
    // A conditioning cycle of 1.1 s comes before the reference.
    let simulated_s = reference.len() as f64 / bench.converters.sample_rate_hz + 1.1;
    for (name, variant) in [("plain", Variant::PLAIN), ("full", Variant::FULL)] {
        let Some(commissioned) = commission(&bench, variant) else {
            continue;
        };
        let mut designs = vec![("predictor", commissioned.design.clone())];
        if let Some(scheme) = thesis_scheme("pidsmoc") {
            designs.push((
                "pidsmoc",
                ServoDesign::new(scheme, &commissioned.identified.model, false),
            ));
        }
        for (scheme, design) in designs {
            // The quickest of several runs: what other programs take does not count.
            let quickest_s = (0..7)
                .filter_map(|seed| {
                    let start = Instant::now();
                    run(&bench, variant, &design, &reference, seed).ok()?;
                    Some(start.elapsed().as_secs_f64())
                })
                .fold(f64::INFINITY, f64::min);
            println!(
                "{name} bench, {scheme}, 10 sub-steps: {:.0} x real time",
                simulated_s / quickest_s
            );
        }
    }
}
