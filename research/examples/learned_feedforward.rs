//! Learned feedforward on a sharp triangle of 100 Hz over six tenths of the travel, on stages that the
//! simulation does not share, 5 % off the model in gain and in the frequency of every mode: prints the tables
//! that belong to `docs/results/learned_feedforward.md`.
//!
//!     cargo run --release --example learned_feedforward [STAGES [FIRST_SEED]]
//!     cargo run --release --example learned_feedforward bench
//!
//! The second form does the same on the project's reference bench in its full variant, whose sensor has a
//! bandwidth.
//!
//! Models are those of `servo_from_data`, kept in target/servo_from_data.

use hysteron::servo::design::ServoDesign;
use hysteron::servo::order::{self, DesignOrder};
use hysteron::servo::sensor_lag::lag_s;
use hysteron_research::learning_study::{
    FIVE_PERCENT_LESS, FIVE_PERCENT_MORE, LearningWay, changed_bench, designed_on_bench, learned,
    learned_on_bench, sine_on_bench,
};
use hysteron_research::stages_asked_for;
use hysteron_sim::bench::Bench;
use hysteron_tests::independent_stage::StageTruth;
use hysteron_tests::servo_study::{StudyRecording, kept_model, record};

/// Periods that are followed.
const PERIODS: usize = 40;
/// What is asked of the tenth, % of the stroke.
const ASKED_PERCENT: f64 = 0.05;

/// The reference bench: what is left in the tenth period.
fn on_bench() {
    let bench = Bench::reference().expect("the bench's file");
    let design = match designed_on_bench(&bench) {
        Ok(design) => design,
        Err(reason) => return println!("{reason}"),
    };
    println!("{}\n", design.explanation.join(" "));
    let as_it_reads = ServoDesign {
        sensor_lag_s: None,
        ..design.clone()
    };
    let ways = [(false, &as_it_reads), (true, &design)];
    println!(
        "| full bench | lag undone | learning | true, % of stroke | read | read but for the sensor's lag |"
    );
    println!("|---|---|---|---|---|---|");
    for (change, ratio) in [("as recorded", 1.0), ("5 % less", 0.95), ("5 % more", 1.05)] {
        for (undone, design) in ways {
            for learning in [false, true] {
                let found = learned_on_bench(&changed_bench(&bench, ratio), design, learning, 9);
                println!(
                    "| {change} | {undone} | {learning} | {:.4} | {:.4} | {:.4} |",
                    found.true_percent, found.read_percent, found.read_but_for_the_lag_percent
                );
            }
        }
    }
    println!(
        "\n| sine, Hz | true, % of the amplitude, lag not undone | undone | read but for the sensor's lag, not undone | undone |"
    );
    println!("|---|---|---|---|---|");
    for hz in [1.0, 10.0, 50.0, 100.0, 200.0, 300.0, 500.0] {
        let [left, undone] = ways.map(|(_, design)| {
            sine_on_bench(
                &bench,
                &ServoDesign {
                    learning: None,
                    ..design.clone()
                },
                hz,
            )
        });
        println!(
            "| {hz} | {:.4} | {:.4} | {:.4} | {:.4} |",
            left.true_percent,
            undone.true_percent,
            left.read_but_for_the_lag_percent,
            undone.read_but_for_the_lag_percent
        );
    }
    println!(
        "\n| sensor's lag believed, of its own | true with learning, 5 % less, % of stroke | 5 % more |"
    );
    println!("|---|---|---|");
    for share in [0.7, 0.8, 0.9, 1.0, 1.1, 1.2, 1.3] {
        let believed = ServoDesign {
            sensor_lag_s: Some(share * lag_s(bench.full.sensor_bandwidth_hz)),
            ..design.clone()
        };
        let [less, more] = [0.95, 1.05].map(|ratio| {
            learned_on_bench(&changed_bench(&bench, ratio), &believed, true, 9).true_percent
        });
        println!("| {share} | {less:.4} | {more:.4} |");
    }
}

fn main() {
    if std::env::args().nth(1).as_deref() == Some("bench") {
        return on_bench();
    }
    println!(
        "| stage | first mode | second mode | learned to, Hz | contraction | 5 % | way | nm RMS in period 1, 2, 3, 5, 8, 10 | % of stroke in period 10 | after {PERIODS}: % (largest, nm) |"
    );
    println!("|---|---|---|---|---|---|---|---|---|---|");
    let mut met = 0;
    for seed in stages_asked_for() {
        let truth = StageTruth::drawn(seed);
        let dataset = record(&truth, StudyRecording::Wideband);
        let chain = kept_model(&truth, StudyRecording::Wideband, &dataset);
        let design = match order::design(
            &chain,
            &DesignOrder {
                recording: Some(&dataset),
                learning: true,
                usual_margins: false,
                ..DesignOrder::default()
            },
        ) {
            Ok(design) => design,
            Err(reason) => {
                println!("| {seed} | {reason} |");
                continue;
            }
        };
        let filters = design.learning.as_ref().expect("ordered");
        for point in filters
            .convergence
            .iter()
            .step_by(10)
            .filter(|_| std::env::var_os("CURVE").is_some())
        {
            eprintln!(
                "{seed}: {:.0} Hz: Q {:.3}, |1 - L T| {:.3}, at worst {:.3}",
                point.hz, point.robustness, point.nominal, point.worst
            );
        }
        let mut largest_percent = 0.0_f64;
        for (sign, change) in [("less", FIVE_PERCENT_LESS), ("more", FIVE_PERCENT_MORE)] {
            for way in [
                LearningWay::Nothing,
                LearningWay::EveryTick,
                LearningWay::WholePeriods,
                LearningWay::Harmonics,
            ] {
                let found = learned(&truth, change, &design, way, PERIODS);
                if way == LearningWay::EveryTick {
                    largest_percent = largest_percent.max(found.percent(9));
                }
                let nm = |period: usize| format!("{:.1}", 1e3 * found.periods[period - 1].rms_um);
                println!(
                    "| {seed} | {:.0} Hz, {:.2} | {} | {:.0} | {:.2} | {sign} | {way:?} | {} | {:.4} | {:.4} ({:.0}) |",
                    truth.first_mode.frequency_hz,
                    truth.first_mode.damping_ratio,
                    truth.second_mode.map_or("none".into(), |m| format!(
                        "{:.0} Hz, {:.3}",
                        m.frequency_hz, m.damping_ratio
                    )),
                    filters.learns_to_hz(),
                    filters.worst_contraction().0,
                    [1, 2, 3, 5, 8, 10].map(nm).join(" / "),
                    found.percent(9),
                    100.0 * found.at_last.rms_um / found.stroke_um,
                    1e3 * found.at_last.max_um
                );
            }
        }
        met += u64::from(largest_percent <= ASKED_PERCENT);
    }
    println!(
        "\nat most {ASKED_PERCENT} % of the stroke in period 10, 5 % less and 5 % more: {met} of {}",
        stages_asked_for().count()
    );
}
