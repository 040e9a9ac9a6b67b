//! What the page about an explanation needs to know: plain arrays, filled by the pipeline.
//!
//! The pipeline gives samples and figures only. Spectra, the map of the residual over drive features, the
//! views of the latent force and the evidence picture of its own kind for each effect are made from them in
//! `explain_page`, so that they look the same wherever a residual comes from.

use hysteron_sim::effect::Against;
use serde::{Deserialize, Serialize};

/// Everything about one explanation (or one diagnosis: then `steps` has a single entry).
#[derive(Clone, Debug, Default)]
pub struct ExplainReport {
    /// Name of the data set.
    pub data_set: String,
    /// `at_floor`, `named`, `ambiguous`, `unexplained` or `undecidable`.
    pub verdict: String,
    /// The verdict as one sentence in plain words.
    pub sentence: String,
    /// Effects that the verdict names; all those it cannot distinguish if it is `ambiguous`.
    pub named: Vec<String>,
    /// Error of the model with the named effects and no others, where the last one has more and another
    /// error, um.
    pub named_rms_um: Option<f64>,
    /// The records in the order of the data set.
    pub records: Vec<RecordReport>,
    /// The noise floor, if the data has one.
    pub noise_floor: Option<NoiseFloorReport>,
    /// The model's growth; the residuals of the records have one array for each.
    pub steps: Vec<StepReport>,
    /// Candidates, best first.
    pub candidates: Vec<CandidateReport>,
    /// What the residual does against what a signature predicts, for the named effect (or each of an
    /// ambiguous set).
    pub evidence: Vec<EvidenceReport>,
    /// Parameters of the last model.
    pub parameters: Vec<ParameterReport>,
    /// The drive that would decide, if something is undecided.
    pub next_experiment: Option<ExperimentReport>,
    /// What the model leaves of whole files, from their first sample to their last, a sentence each.
    pub replays: Vec<String>,
    /// The model as an engineer reads it: effect, what it is, and its value with deviation and unit.
    pub values: Vec<[String; 3]>,
    /// Remarks on the data and on what it cannot identify.
    pub warnings: Vec<String>,
    /// Version of the program.
    pub program_version: String,
    /// Command line that made the page.
    pub command: String,
}

/// One record, sample by sample. All arrays that are not empty have the same length.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct RecordReport {
    /// Name, usually the file's.
    pub name: String,
    /// `identify`, `validate` or `noise`.
    pub role: String,
    /// Sample rate, Hz.
    pub sample_rate_hz: f64,
    /// Time stamps, s.
    pub t_s: Vec<f64>,
    /// Drive, V.
    pub u_v: Vec<f64>,
    /// Measured displacement, um.
    pub y_um: Vec<f64>,
    /// External force, N, if it was measured; else empty.
    pub force_n: Vec<f64>,
    /// Measured minus modelled displacement, um: one array for each step of the model's growth. The modelled
    /// displacement is the difference to `y_um`.
    pub residual_um: Vec<Vec<f64>>,
    /// The input disturbance that would explain the last residual, in `latent_unit`; empty if none was
    /// estimated (the views then show the residual itself).
    pub latent_force: Vec<f64>,
    /// Unit of `latent_force`.
    pub latent_unit: String,
    /// Peak to peak of the measured displacement, um.
    pub range_um: f64,
    /// RMS of the last residual, um.
    pub rms_um: f64,
    /// Largest magnitude of the last residual, um.
    pub max_um: f64,
    /// RMS of the last model's replay over the whole file, um; zero without a replay.
    #[serde(default)]
    pub replay_rms_um: f64,
}

/// The noise floor and what it rests on.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct NoiseFloorReport {
    /// The floor, um RMS.
    pub rms_um: f64,
    /// What it rests on, in words.
    pub basis: String,
    /// Every estimate that the data allows: (basis, um RMS).
    pub estimates: Vec<(String, f64)>,
}

/// One step of the model's growth.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct StepReport {
    /// Effect added in this step; none for the model that was started from.
    pub added: Option<String>,
    /// Why, in words.
    pub why: String,
    /// RMS over the fitted records, um.
    pub identify_rms_um: f64,
    /// RMS over the held-out records, um; none without any.
    pub validate_rms_um: Option<f64>,
}

/// One candidate of the ranking.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct CandidateReport {
    /// Effect.
    pub effect: String,
    /// Share of the residual's power above the floor that its signature explains, 0..1.
    pub explained_share: f64,
    /// 90 % interval of that share, if it was resampled.
    pub explained_share_interval: Option<(f64, f64)>,
    /// p-value after correction for all candidates tried; none where it was not weighed.
    pub p_value: Option<f64>,
    /// Validation RMS before adding it, um.
    pub validate_rms_before_um: Option<f64>,
    /// Validation RMS after adding it and refitting, um.
    pub validate_rms_after_um: Option<f64>,
    /// Effects that this data cannot tell from it.
    pub confusable_with: Vec<String>,
    /// The experiment that shows it best.
    pub next_experiment: String,
    /// Why it is, or is not, the answer.
    pub why: String,
}

/// The residual and a signature, both after everything that the present model could absorb has been projected
/// out.
#[derive(Clone, Debug)]
pub struct EvidenceReport {
    /// Effect.
    pub effect: String,
    /// What the residual is drawn against.
    pub against: Against,
    /// What to see, in a sentence.
    pub caption: String,
    /// By record.
    pub traces: Vec<EvidenceTrace>,
    /// Step of the readings, um, where the effect is the converter's rounding.
    pub reading_step_um: f64,
}

/// Evidence in one record.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct EvidenceTrace {
    /// Index into [`ExplainReport::records`].
    pub record: usize,
    /// Indices of the samples used, ascending; empty means all of them.
    pub samples: Vec<usize>,
    /// What the residual does, um.
    pub residual_um: Vec<f64>,
    /// What the effect's signature predicts, scaled to fit, um.
    pub predicted_um: Vec<f64>,
}

/// One fitted value.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct ParameterReport {
    /// Effect that it belongs to.
    pub effect: String,
    /// Name.
    pub name: String,
    /// Value.
    pub value: f64,
    /// Standard deviation, if known.
    pub std: Option<f64>,
    /// Unit.
    pub unit: String,
    /// Remark, for instance "at its bound" or "given".
    pub note: String,
}

/// A proposed drive.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct ExperimentReport {
    /// What it decides, in a sentence.
    pub why: String,
    /// Time, s.
    pub t_s: Vec<f64>,
    /// Drive, V.
    pub u_v: Vec<f64>,
}
