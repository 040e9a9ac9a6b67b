//! Figures of models and fits for files (`hysteron.fit/1`).

use crate::dataset::Dataset;
use crate::dataset::units::SignalUnits;
use crate::diagnosis::judgement::{Split, rms_of};
use crate::diagnosis::path::PathStep;
use crate::diagnosis::words;
use crate::engineering::{self, Figure};
use crate::identification::fit::{counted_residual, rms};
use crate::identification::identifiability::CannotIdentify;
use crate::identification::noise_floor::NoiseFloor;
use crate::outcome::Diagnosis;
use crate::parallel;
use crate::phrases::nm;
use crate::replay::{Replay, replays};
use crate::statistics::largest;
use hysteron_sim::chain::{EffectInstance, Model};
use serde::Serialize;

/// How one record is met.
#[derive(Clone, Debug, Serialize)]
pub struct RecordFigures {
    /// The record.
    pub file: String,
    /// Its role.
    pub role: &'static str,
    /// Residual, um.
    pub rms_um: f64,
    /// Largest residual, um.
    pub max_um: f64,
    /// Residual in % of the measured range.
    pub rms_pct_range: f64,
    /// Error of the replay of the whole file that the record is a part of, um.
    pub replay_rms_um: f64,
    /// Largest error of that replay, um.
    pub replay_max_um: f64,
}

/// One value of a model.
#[derive(Clone, Debug, Serialize)]
pub struct ParameterFigures {
    /// The effect.
    pub effect: String,
    /// The parameter.
    pub name: String,
    /// Its value.
    pub value: f64,
    /// Its standard deviation.
    pub std: Option<f64>,
    /// Its unit.
    pub unit: String,
}

/// One step of the way to a model.
#[derive(Clone, Debug, Serialize)]
pub struct StepFigures {
    /// What was added.
    pub added: Option<String>,
    /// Why.
    pub why: String,
    /// Fitted error.
    pub identify_rms_um: f64,
    /// Held-out error.
    pub validate_rms_um: Option<f64>,
}

/// What `identify`, `add`, `explain` and `compare` write (`hysteron.fit/1`).
#[derive(Clone, Debug, Serialize)]
pub struct FitFigures {
    /// `hysteron.fit/1`.
    pub schema: &'static str,
    /// Effects in the order of the chain.
    pub effects: Vec<String>,
    /// What V and um stand for in the names of the fields.
    pub units: SignalUnits,
    /// Every record.
    pub records: Vec<RecordFigures>,
    /// Error of all fitted records, um.
    pub identify_rms_um: f64,
    /// Error of all held-out records, um.
    pub validate_rms_um: Option<f64>,
    /// The model driven from the first sample of each file to its last.
    pub replays: Vec<Replay>,
    /// Floor.
    pub noise_floor_um: Option<f64>,
    /// What it rests on.
    pub floor_basis: String,
    /// All values.
    pub parameters: Vec<ParameterFigures>,
    /// The same as an engineer reads them.
    pub values: Vec<Figure>,
    /// The way to it.
    pub steps: Vec<StepFigures>,
    /// What the data cannot tell, in words.
    pub cannot_identify: Vec<String>,
    /// Remarks on data and floor.
    pub warnings: Vec<String>,
    /// It was stopped: this is the best so far.
    pub stopped: bool,
    /// Wall-clock time.
    pub seconds: f64,
    /// The diagnosis, with `explain` and `diagnose`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub diagnosis: Option<Diagnosis>,
}

impl FitFigures {
    /// How well the model as it is meets the recording, in a sentence.
    #[must_use]
    pub fn comparison_sentence(&self) -> String {
        // Nobody fits here, and a model does not know which of these it was fitted with: both roles count.
        let rms_um = self
            .identify_rms_um
            .max(self.validate_rms_um.unwrap_or(0.0));
        let noise = self.noise_floor_um.map_or_else(String::new, |floor_um| {
            format!("; the noise is {} nm", nm(floor_um))
        });
        format!(
            "The model ({}) meets these records within {} nm RMS{noise}.",
            self.effects.join(", "),
            nm(rms_um)
        )
    }
}

fn record_figures(
    residuals: &[Vec<f64>],
    dataset: &Dataset,
    replays: &[Replay],
) -> Vec<RecordFigures> {
    let replayed = |i: usize| {
        replays
            .iter()
            .find(|replay| replay.records.contains(&i))
            .map(|replay| (replay.rms_um, replay.max_um))
    };
    dataset
        .records
        .iter()
        .zip(residuals)
        .enumerate()
        .map(|(i, (record, r))| {
            let rms_um = rms(r);
            let range = record.range_um();
            let (replay_rms_um, replay_max_um) = replayed(i).unwrap_or((rms_um, largest(r)));
            RecordFigures {
                replay_rms_um,
                replay_max_um,
                file: record.name.clone(),
                role: record.role.name(),
                rms_um,
                max_um: largest(r),
                rms_pct_range: if range > 0.0 {
                    100.0 * rms_um / range
                } else {
                    0.0
                },
            }
        })
        .collect()
}

/// All values of a model.
#[must_use]
pub fn parameter_figures(model: &Model) -> Vec<ParameterFigures> {
    let of = |e: &EffectInstance| -> Vec<ParameterFigures> {
        let figures = e.parameters.iter().map(|p| ParameterFigures {
            effect: e.id.clone(),
            name: p.parameter.name.clone(),
            value: p.value,
            std: p.std,
            unit: p.parameter.unit.clone(),
        });
        figures.collect()
    };
    model.effects.iter().flat_map(of).collect()
}

/// Figures of a model on a data set.
#[must_use]
pub fn fit_figures(
    model: &Model,
    dataset: &Dataset,
    floor: &NoiseFloor,
    steps: Vec<StepFigures>,
    cannot_identify: &[CannotIdentify],
    seconds: f64,
) -> FitFigures {
    let replays = replays(model, dataset);
    let split = Split::of(dataset);
    let residuals = parallel::map(&dataset.records, |record| counted_residual(model, record));
    FitFigures {
        schema: "hysteron.fit/1",
        effects: model.effect_ids(),
        units: dataset.units.clone(),
        records: record_figures(&residuals, dataset, &replays),
        identify_rms_um: rms_of(&residuals, &split.identify).unwrap_or(0.0),
        validate_rms_um: rms_of(&residuals, &split.validate),
        replays,
        noise_floor_um: floor.rms_um,
        floor_basis: floor.basis.clone(),
        parameters: parameter_figures(model),
        values: engineering::figures(model, cannot_identify),
        steps,
        cannot_identify: cannot_identify.iter().map(words::cannot_identify).collect(),
        warnings: dataset
            .remarks()
            .into_iter()
            .chain(floor.warnings.iter().cloned())
            .collect(),
        stopped: false,
        seconds,
        diagnosis: None,
    }
}

/// Figures of the steps to a model.
#[must_use]
pub fn step_figures(steps: &[PathStep]) -> Vec<StepFigures> {
    let before = std::iter::once(None).chain(steps.iter().map(|s| Some(&s.judged)));
    steps
        .iter()
        .zip(before)
        .map(|(step, before)| StepFigures {
            added: step.change.added(),
            why: words::why_step(&step.change, before, &step.judged),
            identify_rms_um: step.judged.identify_rms_um,
            validate_rms_um: step.judged.validate_rms_um,
        })
        .collect()
}
