//! Learned feedforward on a sharp triangle of 100 Hz over six tenths of the travel, on stages that the simulation does not share, 5 % off the model
//! in gain and in the frequency of every mode: prints the tables of `docs/learned_feedforward.md`.
//!
//!     cargo run --release --example learned_feedforward [STAGES [FIRST_SEED]]
//!
//! Models are those of `servo_from_data`, kept in target/servo_from_data.

use hysteron::servo::order::{self, Order};
use hysteron_tests::independent_stage::Truth;
use hysteron_tests::learning_study::{FIVE_PERCENT_LESS, FIVE_PERCENT_MORE, Way, learned};
use hysteron_tests::servo_study::{Recording, kept_model, record};

/// Periods that are followed.
const PERIODS: usize = 40;

fn main() {
    let numbers: Vec<u64> = std::env::args().skip(1).filter_map(|a| a.parse().ok()).collect();
    let (stages, first) = (numbers.first().copied().unwrap_or(24), numbers.get(1).copied().unwrap_or(0));
    println!(
        "| stage | first mode | second mode | learned to, Hz | contraction | 5 % | way | nm RMS in period 1, 2, 3, 5, 8, 10 | % of stroke in period 10 | after {PERIODS}: % (largest, nm) |"
    );
    println!("|---|---|---|---|---|---|---|---|---|---|");
    for seed in first..first + stages {
        let truth = Truth::drawn(seed);
        let dataset = record(&truth, Recording::Wideband);
        let chain = kept_model(&truth, Recording::Wideband, &dataset);
        let design = match order::design(&chain, &Order { recording: Some(&dataset), learning: true, ..Order::default() }) {
            Ok(design) => design,
            Err(reason) => {
                println!("| {seed} | {reason} |");
                continue;
            }
        };
        let filters = design.learning.as_ref().expect("ordered");
        for point in filters.convergence.iter().step_by(10).filter(|_| std::env::var_os("CURVE").is_some()) {
            eprintln!("{seed}: {:.0} Hz: Q {:.3}, |1 - L T| {:.3}, at worst {:.3}", point.hz, point.robustness, point.nominal, point.worst);
        }
        for (sign, change) in [("less", FIVE_PERCENT_LESS), ("more", FIVE_PERCENT_MORE)] {
            for way in [Way::Nothing, Way::EveryTick, Way::WholePeriods, Way::Harmonics] {
                let found = learned(&truth, change, &design, way, PERIODS);
                let nm = |period: usize| format!("{:.1}", 1e3 * found.periods[period - 1].rms_um);
                println!(
                    "| {seed} | {:.0} Hz, {:.2} | {} | {:.0} | {:.2} | {sign} | {way:?} | {} | {:.4} | {:.4} ({:.0}) |",
                    truth.first_mode.frequency_hz,
                    truth.first_mode.damping_ratio,
                    truth.second_mode.map_or("none".into(), |m| format!("{:.0} Hz, {:.3}", m.frequency_hz, m.damping_ratio)),
                    filters.learns_to_hz(),
                    filters.worst_contraction().0,
                    [1, 2, 3, 5, 8, 10].map(nm).join(" / "),
                    found.percent(9),
                    100.0 * found.at_last.rms_um / found.stroke_um,
                    1e3 * found.at_last.max_um
                );
            }
        }
    }
}
