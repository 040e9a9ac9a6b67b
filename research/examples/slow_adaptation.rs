//! What a gain and a creep that the model does not know cost a servo, and what slow adaptation takes off:
//! prints the tables that belong to `docs/results/slow_adaptation.md`.
//!
//!     cargo run --release -p hysteron-research --example slow_adaptation [STAGES [FIRST_SEED]]
//!
//! Models are identified from the wideband recording and kept in target/slow_adaptation.

use hysteron::model_file::{effects_named, from_toml, to_toml};
use hysteron::servo::design::ServoDesign;
use hysteron::servo::order::{self, DesignOrder};
use hysteron::watch::Unwatched;
use hysteron_research::adaptation_study::{AdaptationDrift, AdaptationWay, adapted, sine_um};
use hysteron_research::stages_asked_for;
use hysteron_tests::independent_stage::StageTruth;
use hysteron_tests::servo_study::{StudyRecording, record};
use std::path::PathBuf;

fn design_of(truth: &StageTruth) -> Result<ServoDesign, String> {
    let dataset = record(truth, StudyRecording::Wideband);
    let folder = PathBuf::from("target/slow_adaptation");
    let file = folder.join(format!("{}.toml", truth.seed));
    let chain = match std::fs::read_to_string(&file) {
        Ok(text) => from_toml(&text, &file.display().to_string()).map_err(|e| e.to_string())?,
        Err(_) => {
            let effects = effects_named("hysteresis,initial_curve,vibration,second_mode,creep")
                .map_err(|e| e.to_string())?;
            let chain = hysteron::identify::identify(&dataset, &effects, &Unwatched)
                .map_err(|e| e.to_string())?
                .model;
            std::fs::create_dir_all(&folder).map_err(|e| e.to_string())?;
            std::fs::write(
                &file,
                to_toml(&chain, &dataset.name).map_err(|e| e.to_string())?,
            )
            .map_err(|e| e.to_string())?;
            chain
        }
    };
    order::design(
        &chain,
        &DesignOrder {
            recording: Some(&dataset),
            usual_margins: false,
            ..DesignOrder::default()
        },
    )
}

fn nm(um: f64) -> String {
    format!("{:.2}", 1e3 * um)
}

fn main() {
    println!(
        "| stage | gain | Hz | {} | gain believed at the end, in the order of the ways |",
        AdaptationWay::ALL.map(|w| format!("{w:?}")).join(" | ")
    );
    for seed in stages_asked_for() {
        let truth = StageTruth::drawn(seed);
        let design = match design_of(&truth) {
            Ok(design) => design,
            Err(reason) => {
                println!("| {seed} | {reason} |");
                continue;
            }
        };
        let drifts = [0.8, 0.9, 1.0, 1.1, 1.2]
            .map(AdaptationDrift::none)
            .into_iter()
            .chain([AdaptationDrift {
                from: 1.15,
                to: 0.85,
                lasts_s: 12.0,
            }]);
        for drift in drifts {
            for hz in [10.0, 50.0, 150.0] {
                let reference = sine_um(&truth, hz, if drift.lasts_s > 0.0 { 12.0 } else { 7.0 });
                let found =
                    AdaptationWay::ALL.map(|way| adapted(&truth, drift, &design, way, &reference));
                println!(
                    "| {seed} | {} to {} | {hz} | {} | {} |",
                    drift.from,
                    drift.to,
                    found
                        .iter()
                        .map(|f| nm(f.at_last.rms_um))
                        .collect::<Vec<_>>()
                        .join(" | "),
                    found
                        .iter()
                        .map(|f| format!("{:.3}", f.gain))
                        .collect::<Vec<_>>()
                        .join(" / "),
                );
            }
        }
        for times in [0.0, 1.0, 3.0] {
            let mut other = truth.clone();
            other.creep.iter_mut().for_each(|term| term.0 *= times);
            let error = |hz: f64| {
                nm(adapted(
                    &other,
                    AdaptationDrift::none(1.0),
                    &design,
                    AdaptationWay::Nothing,
                    &sine_um(&truth, hz, 7.0),
                )
                .at_last
                .rms_um)
            };
            println!(
                "| {seed} | creep times {times} | 1, 10, 50, 150 | {} |",
                [1.0, 10.0, 50.0, 150.0].map(error).join(" / ")
            );
        }
    }
}
