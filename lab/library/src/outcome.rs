//! What the main job comes to, as types (`hysteron.diagnosis/1`). [`crate::diagnosis::words`] alone makes
//! sentences of them.

use crate::dataset::issue::Issue;
use crate::diagnosis::judgement::Judged;
use crate::diagnosis::verdict::Reason;
pub use crate::diagnosis::verdict::Verdict;
use crate::identification::noise_floor::FloorEstimate;
use serde::Serialize;

/// Errors on fitted and held-out records, um RMS.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Residuals {
    /// Fitted.
    pub identify: f64,
    /// Held out.
    pub validate: Option<f64>,
}

impl Residuals {
    /// Of a judged model.
    #[must_use]
    pub fn of(judged: &Judged) -> Self {
        Self {
            identify: judged.identify_rms_um,
            validate: judged.validate_rms_um,
        }
    }
}

/// What speaks for a finding: two models, each the best of a search of its own.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(rename_all = "snake_case", tag = "by")]
pub enum Evidence {
    /// The data reject every model without it.
    Models {
        /// Errors of the best model without it that has no more moves.
        without: Residuals,
        /// Errors of the simplest model with it.
        with: Residuals,
        /// Standard errors by which the best model without it is worse beyond the margin; infinite, `null` in
        /// files, where its error is double.
        standard_errors: f64,
    },
    /// The readings themselves show it, whatever the model.
    Readings,
}

/// One finding: an effect that is missing or has other values, with what the data cannot distinguish from it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Finding {
    /// The effects that are missing, likeliest first; more than one where the data cannot distinguish them,
    /// none where only values have changed.
    pub effects: Vec<String>,
    /// Effects of the prior model of which other values explain as much.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub or_other_values_of: Vec<String>,
    /// What speaks for it.
    pub evidence: Evidence,
}

/// What the model at the end leaves unexplained.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Remainder {
    /// Its error, um RMS: held out where there is such a record.
    pub rms_um: f64,
    /// The same in times the noise; none where that is unknown.
    pub times_noise: Option<f64>,
}

/// A value that has changed.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ChangedValue {
    /// The effect.
    pub effect: String,
    /// The parameter; `scale` for all coefficients of a hysteresis together.
    pub parameter: String,
    /// Its value in the prior model.
    pub from: f64,
    /// Its value on this recording.
    pub to: f64,
}

/// How a candidate stands.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(rename_all = "snake_case", tag = "is")]
pub enum Standing {
    /// In every simplest model.
    Named,
    /// In some of the simplest models.
    Alternative,
    /// The readings themselves show it.
    InTheReadings,
    /// In the model at the end, for its errors alone: simpler models are not rejected.
    LowersErrors,
    /// Its own physics excludes the fitted values.
    Excluded,
    /// Fitted, and every model with it in place of a named effect is rejected.
    Rejected,
    /// Its signature explains no more than chance.
    NotInTheResidual,
    /// Not fitted: others explain more.
    NotFitted,
}

/// One candidate in the file.
#[derive(Clone, Debug, Serialize)]
pub struct CandidateFigures {
    /// The effect.
    pub effect: String,
    /// The finding in whose place it was examined; its own name for that one itself.
    pub in_place_of: Option<String>,
    /// Share of the residual above the noise that its signature explains.
    pub explained_share: f64,
    /// 90 % interval of it.
    pub explained_share_interval: (f64, f64),
    /// Share of the resampled blocks in which it explains most of all candidates.
    pub stability: f64,
    /// p-value of its signature beside the model that was searched last, family-wise over all candidates; none
    /// for what is named or was fitted: there two models speak ([`Evidence`]).
    pub p_value: Option<f64>,
    /// Held-out error without it.
    pub validate_rms_before_um: Option<f64>,
    /// Held-out error with it, fitted again; for those that were fitted.
    pub validate_rms_after_um: Option<f64>,
    /// Fitted error with it.
    pub identify_rms_after_um: Option<f64>,
    /// Candidates whose signature looks the same on this data, or that do as well in its place.
    pub confusable_with: Vec<String>,
    /// The experiment that shows it best.
    pub next_experiment: String,
    /// How it stands.
    pub standing: Standing,
    /// What speaks against this reading of the data, from its physics.
    pub unlikely_because: Option<String>,
}

/// A model that the data cannot reject, and that is among the simplest.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct KeptModel {
    /// What it has beside the start, and of what it has other values.
    pub effects: Vec<String>,
    /// Its errors.
    pub rms_um: Residuals,
}

/// Residual in one cell of the map.
#[derive(Clone, Debug, Serialize)]
pub struct Cell {
    /// What the samples have in common.
    pub feature: String,
    /// Residual there.
    pub rms_um: f64,
    /// How many samples.
    pub samples: usize,
}

/// Where a record fails.
#[derive(Clone, Debug, Serialize)]
pub struct RecordCells {
    /// The record.
    pub record: String,
    /// Its cells.
    pub cells: Vec<Cell>,
}

/// The diagnosis as it is written.
#[derive(Clone, Debug, Serialize)]
pub struct Diagnosis {
    /// `hysteron.diagnosis/1`.
    pub schema: &'static str,
    /// The word.
    pub verdict: Verdict,
    /// Why nothing can be decided, or what stays open beside the names.
    pub reason: Option<Reason>,
    /// The same in a sentence.
    pub sentence: String,
    /// Effects that the verdict is about.
    pub named: Vec<String>,
    /// What was ahead and could not be decided.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub so_far: Vec<String>,
    /// What the model at the end has beside the named effects, and does not need.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub also_in_the_model: Vec<String>,
    /// What was found, one entry for each missing effect.
    pub findings: Vec<Finding>,
    /// What the model at the end leaves.
    pub remainder: Remainder,
    /// Effects that are there with other values than in the prior model.
    pub changed: Vec<ChangedValue>,
    /// What is wrong with the recording itself, or left open by it.
    pub issues: Vec<Issue>,
    /// The simplest models that the data cannot reject, best first.
    pub models: Vec<KeptModel>,
    /// How the loops of the model at the end are described, where they are not of the structure that was
    /// started from, and how others are that meet the data as well.
    pub loops: Vec<String>,
    /// Noise used, um RMS.
    pub noise_floor_um: Option<f64>,
    /// What it rests on.
    pub floor_basis: String,
    /// All estimates of the noise.
    pub floor_estimates: Vec<FloorEstimate>,
    /// Errors of the model that was diagnosed.
    pub residual_rms_um: Residuals,
    /// Errors of the model with the named effects alone.
    pub residual_rms_named_um: Residuals,
    /// Errors of the model at the end.
    pub residual_rms_after_um: Residuals,
    /// Candidates, best first.
    pub candidates: Vec<CandidateFigures>,
    /// Where the diagnosed model fails.
    #[serde(rename = "where")]
    pub where_it_fails: Vec<RecordCells>,
}
