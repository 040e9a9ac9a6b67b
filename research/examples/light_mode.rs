//! Servos on stages whose first mode is at 739 Hz with a damping ratio of 0.01 to 0.02: bandwidth, noise, and
//! how far the mode may move. Prints the table that belongs to `docs/results/light_first_mode.md`.
//!
//!     cargo run --release --workspace --example light_mode [SEED ...]
//!
//! Models come from the wideband recording and are kept in target/servo_from_data.

use hysteron::servo::design::ServoDesign;
use hysteron::servo::named_scheme::with_scheme;
use hysteron::servo::order::{self, DesignOrder};
use hysteron_research::light_mode_study::{
    MODE_HZ, bandwidth_hz, moved, peak, reference_response, stable_range, with_first_mode,
};
use hysteron_tests::independent_stage::{StageChange, StageTruth};
use hysteron_tests::servo_study::{StudyRecording, at_work, kept_model, record};

/// One line of the table.
fn line(name: &str, truth: &StageTruth, design: &ServoDesign) -> String {
    let followed = |factor: f64| {
        let response = reference_response(&moved(truth, factor), design);
        format!("{:.0} ({:.1})", bandwidth_hz(&response), peak(&response))
    };
    let work = at_work(truth, StageChange::NONE, design);
    if work.unstable {
        return format!("| {name} | unstable | | | | | |");
    }
    let (least, most) = stable_range(truth, design);
    format!(
        "| {name} | {} | {} | {} | {:.2} | {least:.3} to {most:.3} | {} |",
        followed(1.0),
        followed(0.8),
        followed(1.2),
        work.rest_um / truth.noise_um,
        work.errors
            .iter()
            .map(|e| format!("{:.1}", 1e3 * e.rms_um))
            .collect::<Vec<_>>()
            .join(" / ")
    )
}

fn main() {
    let mut seeds: Vec<u64> = std::env::args()
        .skip(1)
        .filter_map(|a| a.parse().ok())
        .collect();
    if seeds.is_empty() {
        // Every third stage is drawn with a lightly damped first mode.
        seeds = (0..24).step_by(3).collect();
    }
    for seed in seeds {
        let truth = with_first_mode(seed, MODE_HZ);
        let dataset = record(&truth, StudyRecording::Wideband);
        let chain = kept_model(&truth, StudyRecording::Wideband, &dataset);
        let second = truth.second_mode.expect("has one");
        println!(
            "\nStage {seed}: first mode {:.0} Hz, damping ratio {:.4}; second mode {:.0} Hz, {:.1} %\n",
            truth.first_mode.frequency_hz,
            truth.first_mode.damping_ratio,
            second.frequency_hz,
            100.0 * second.share
        );
        println!(
            "| servo | bandwidth, Hz (largest amplification) | mode 20 % lower | 20 % higher | noise | stable, mode times | errors, nm |"
        );
        println!("|---|---|---|---|---|---|---|");
        let designed = |mode_moves: f64| {
            order::design(
                &chain,
                &DesignOrder {
                    recording: Some(&dataset),
                    mode_moves,
                    usual_margins: false,
                    ..DesignOrder::default()
                },
            )
        };
        match designed(0.0) {
            Err(reason) => println!("| usual design | refused: {reason} |"),
            Ok(usual) => {
                println!("{}", line("usual design", &truth, &usual));
                for scheme in [
                    "pid",
                    "feedforward-pi-notch",
                    "disturbance-observer-inverse",
                    "pidsmoc",
                ] {
                    match with_scheme(&usual, scheme) {
                        Err(reason) => println!("| {scheme} | {reason} |"),
                        Ok(other) => println!(
                            "{}",
                            line(
                                scheme,
                                &truth,
                                &ServoDesign {
                                    delayed: true,
                                    noise_shaping: true,
                                    ..other
                                }
                            )
                        ),
                    }
                }
            }
        }
        match designed(0.2) {
            Err(reason) => println!("| `--mode-moves 0.2` | refused: {reason} |"),
            Ok(design) => println!("{}", line("`--mode-moves 0.2`", &truth, &design)),
        }
    }
}
