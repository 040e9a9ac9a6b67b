//! Samples of the studies and of the thesis: one program, so that dependencies are linked once.

mod learned_feedforward;
mod light_mode;
mod other_actuators;
mod slow_adaptation;
mod stick_slip;
mod thesis;

use hysteron::dataset::Dataset;
use hysteron::model_file::effects_named;
use hysteron::watch::Unwatched;
use hysteron_sim::chain::Model;
use hysteron_tests::independent_stage::StageTruth;
use hysteron_tests::servo_study::{StudyRecording, record};

/// A stage, what it was recorded with, and its model.
fn recorded(seed: u64) -> (StageTruth, Dataset, Model) {
    let truth = StageTruth::drawn(seed);
    let dataset = record(&truth, StudyRecording::Wideband);
    let effects = effects_named("hysteresis,initial_curve,vibration,second_mode,creep").unwrap();
    let chain = hysteron::identify::identify(&dataset, &effects, &Unwatched)
        .unwrap()
        .model;
    (truth, dataset, chain)
}
