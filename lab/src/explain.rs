//! The main job: identify, compare, diagnose, add, until the floor; and everything that files and pages show of it.

use crate::dataset::Dataset;
use crate::dataset::drive_variety::DriveVariety;
use crate::dataset::reading_grid::{mean_rounding_um, rounding_noise_um};
use crate::diagnosis::growth::{Growth, Step, Workbench, nm};
use crate::diagnosis::refit::{Judged, Split};
use crate::diagnosis::verdict::{self, Diagnosis};
use crate::experiment::{Limits, Proposal, propose};
use crate::fit::{estimate_uncertainty, residual, rms};
use crate::floor::{NoiseFloor, noise_floor};
use crate::latent_force::latent_force_nm;
use crate::problem::{Problem, Result};
use crate::report::{
    CandidateReport, EvidenceReport, EvidenceTrace, ExperimentReport, ExplainReport, NoiseFloorReport, ParameterReport, RecordReport,
    StepReport,
};
use hysteron_sim::chain::{EffectInstance, Model};
use hysteron_sim::effect::{Effect, Overview, by_id, registry};
use serde::Serialize;
use std::sync::Arc;

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

/// One step of the growth.
#[derive(Clone, Debug, Serialize)]
pub struct StepFigures {
    /// What was added.
    pub added: Option<String>,
    /// What was taken back.
    pub removed: Vec<String>,
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
    /// Every record.
    pub records: Vec<RecordFigures>,
    /// Floor.
    pub noise_floor_um: Option<f64>,
    /// What it rests on.
    pub floor_basis: String,
    /// All values.
    pub parameters: Vec<ParameterFigures>,
    /// The growth.
    pub steps: Vec<StepFigures>,
    /// What the data cannot tell, in words.
    pub cannot_identify: Vec<String>,
    /// Remarks on data and floor.
    pub warnings: Vec<String>,
    /// Wall-clock time.
    pub seconds: f64,
    /// The diagnosis, with `explain` and `diagnose`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub diagnosis: Option<Diagnosis>,
}

/// Everything that one run of the main job found.
pub struct Explanation {
    /// The final model with standard deviations.
    pub model: Model,
    /// The growth.
    pub growth: Growth,
    /// The floor.
    pub floor: NoiseFloor,
    /// The verdict on the starting model.
    pub diagnosis: Diagnosis,
    /// What the data cannot tell.
    pub cannot_identify: Vec<String>,
    /// Records that are fitted and judge.
    pub split: Split,
    /// The drive that would tell the first two of an ambiguous set apart.
    pub next_experiment: Option<NextExperiment>,
}

/// A drive to run next.
pub struct NextExperiment {
    /// The drive.
    pub proposal: Proposal,
    /// What it decides and how well.
    pub sentence: String,
}

/// Where two explanations tie, the drive on which they differ most.
fn next_experiment(growth: &Growth, diagnosis: &Diagnosis, dataset: &Dataset, floor_um: Option<f64>) -> Option<NextExperiment> {
    if diagnosis.verdict != verdict::Verdict::Ambiguous {
        return None;
    }
    let findings = growth.findings();
    let [first, second, ..] = findings.iter().find(|f| f.len() > 1)?.as_slice() else { return None };
    let round = growth.round_of(first)?;
    let model = |id: &String| round.finalists.iter().find(|f| f.id == *id).map(|f| &f.judged.model);
    let proposal = propose(model(first)?, model(second)?, &Limits::of(&dataset.overview()))?;
    let sentence = proposal.sentence(&first.replace('_', " "), &second.replace('_', " "), floor_um);
    Some(NextExperiment { proposal, sentence })
}

/// All built-in candidates and the user's own.
#[must_use]
pub fn candidates(own: &[Arc<dyn Effect>]) -> Vec<Arc<dyn Effect>> {
    let mut all: Vec<Arc<dyn Effect>> = registry().into_iter().filter(|e| e.declaration().candidate).collect();
    all.extend(own.iter().cloned());
    all
}

/// Where a run starts.
pub enum Start<'a> {
    /// From these effects, fitted first.
    Effects(&'a [Arc<dyn Effect>]),
    /// From a model as it is.
    Model(Model),
}

/// Runs the main job.
#[must_use]
pub fn explain(dataset: &Dataset, start: Start, own: &[Arc<dyn Effect>], progress: &(dyn Fn(&str) + Sync)) -> Explanation {
    let floor = noise_floor(dataset);
    let workbench = Workbench {
        dataset,
        overview: dataset.overview(),
        split: Split::of(dataset),
        candidates: candidates(own),
        floor_um: floor.rms_um,
        progress,
    };
    let mut growth = match start {
        Start::Effects(effects) => workbench.grow(workbench.build(effects)),
        Start::Model(model) => workbench.grow_transferred(model),
    };
    quantise(&mut growth, &floor, &workbench.overview);
    let diagnosis = verdict::diagnose(&growth, &floor, dataset);
    let mut model = growth.last().model.clone();
    progress("estimating standard deviations");
    let cannot_identify = unidentified(&mut model, dataset, &workbench.split);
    let next_experiment = next_experiment(&growth, &diagnosis, dataset, floor.rms_um);
    Explanation { model, growth, floor, diagnosis, cannot_identify, split: workbench.split, next_experiment }
}

/// Adds the converter that the readings themselves show. It explains part of the noise, not of the error: the growth is the same without it.
fn quantise(growth: &mut Growth, floor: &NoiseFloor, overview: &Overview) {
    let (Some(step_um), Some(effect)) = (floor.reading_step_um, by_id("quantisation")) else { return };
    let last = growth.last();
    if last.model.effect("quantisation").is_some() {
        return;
    }
    let mut judged = last.clone();
    judged.model.add(EffectInstance::new(effect.clone(), overview, &[step_um]));
    let why = format!(
        "{} All readings are whole steps of {} nm, whatever the model: {} nm RMS of the noise",
        effect.declaration().physics,
        nm(step_um),
        nm(rounding_noise_um(step_um))
    );
    growth.steps.push(Step { added: Some("quantisation".into()), ..Step::without_effect(why, judged) });
}

/// Fills in standard deviations and says in words what the data cannot tell.
pub fn unidentified(model: &mut Model, dataset: &Dataset, split: &Split) -> Vec<String> {
    let mut out: Vec<String> = Vec::new();
    let mut by_effect: Vec<(String, Vec<String>)> = Vec::new();
    for u in estimate_uncertainty(model, dataset, &split.identify) {
        match by_effect.iter_mut().find(|(effect, _)| *effect == u.effect) {
            Some((_, names)) => names.push(u.parameter),
            None => by_effect.push((u.effect, vec![u.parameter])),
        }
    }
    for (effect, names) in by_effect {
        let all = model.effect(&effect).map_or(0, |e| e.parameters.iter().filter(|p| !p.parameter.fixed).count());
        let which = if names.len() == all { "none of its parameters".to_string() } else { format!("not {}", names.join(", ")) };
        out.push(format!("{effect}: this data fixes {which}"));
    }
    out.extend(what_the_drive_cannot_show(dataset, split));
    out
}

/// What the drives of the fitted records leave open, whatever the model.
fn what_the_drive_cannot_show(dataset: &Dataset, split: &Split) -> Vec<String> {
    let seen = DriveVariety::of(dataset, &split.identify);
    let mut out = Vec::new();
    if seen.one_loop() {
        out.push(
            "minor loops: the drive always turns at the same two voltages, so only one loop is known; nested reversals are a guess".into(),
        );
    }
    if seen.one_speed() {
        let fast = seen.speed_max_v_s;
        out.push(format!("rate dependence: the drive moves at one speed only (about {fast:.0} V/s), so loops at other speeds are a guess"));
    }
    out
}

fn record_figures(model: &Model, dataset: &Dataset) -> Vec<RecordFigures> {
    dataset
        .records
        .iter()
        .map(|record| {
            let r = residual(model, record);
            let rms_um = rms(&r);
            let range = record.range_um();
            RecordFigures {
                file: record.name.clone(),
                role: record.role.name(),
                rms_um,
                max_um: r.iter().fold(0.0, |m, v| m.max(v.abs())),
                rms_pct_range: if range > 0.0 { 100.0 * rms_um / range } else { 0.0 },
            }
        })
        .collect()
}

/// All values of a model.
#[must_use]
pub fn parameter_figures(model: &Model) -> Vec<ParameterFigures> {
    model
        .effects
        .iter()
        .flat_map(|e| {
            e.parameters.iter().map(|p| ParameterFigures {
                effect: e.id.clone(),
                name: p.parameter.name.clone(),
                value: p.value,
                std: p.std,
                unit: p.parameter.unit.clone(),
            })
        })
        .collect()
}

/// Figures of a model on a data set.
#[must_use]
pub fn fit_figures(
    model: &Model,
    dataset: &Dataset,
    floor: &NoiseFloor,
    steps: Vec<StepFigures>,
    cannot_identify: Vec<String>,
    seconds: f64,
) -> FitFigures {
    FitFigures {
        schema: "hysteron.fit/1",
        effects: model.effect_ids(),
        records: record_figures(model, dataset),
        noise_floor_um: floor.rms_um,
        floor_basis: floor.basis.clone(),
        parameters: parameter_figures(model),
        steps,
        cannot_identify,
        warnings: dataset.notes.iter().chain(&floor.warnings).cloned().collect(),
        seconds,
        diagnosis: None,
    }
}

impl Explanation {
    /// Figures for files.
    #[must_use]
    pub fn figures(&self, dataset: &Dataset, seconds: f64) -> FitFigures {
        let steps = self.growth.steps.iter().map(|s| step_figures(s.added.clone(), s.removed.clone(), s.why.clone(), &s.judged)).collect();
        let mut out = fit_figures(&self.model, dataset, &self.floor, steps, self.cannot_identify.clone(), seconds);
        out.diagnosis = Some(self.diagnosis.clone());
        out
    }

    /// Everything that the page shows.
    #[must_use]
    pub fn report(&self, dataset: &Dataset, command: String) -> ExplainReport {
        let models: Vec<&Model> = self.growth.steps.iter().map(|s| &s.judged.model).collect();
        let steps = self
            .growth
            .steps
            .iter()
            .map(|s| StepReport {
                added: s.added.clone(),
                removed: s.removed.clone(),
                why: s.why.clone(),
                identify_rms_um: s.judged.identify_rms_um,
                validate_rms_um: s.judged.validate_rms_um,
            })
            .collect();
        let candidates = self
            .diagnosis
            .candidates
            .iter()
            .map(|c| CandidateReport {
                effect: c.effect.clone(),
                explained_share: c.explained_share,
                explained_share_interval: Some(c.explained_share_interval),
                p_value: c.p_value,
                validate_rms_before_um: c.validate_rms_before_um,
                validate_rms_after_um: c.validate_rms_after_um,
                confusable_with: c.confusable_with.clone(),
                next_experiment: c.next_experiment.clone(),
                why: why(c, &self.diagnosis),
            })
            .collect();
        let mut warnings: Vec<String> = dataset.notes.iter().chain(&self.floor.warnings).cloned().collect();
        warnings.extend(self.cannot_identify.iter().map(|c| format!("cannot be identified from this data: {c}")));
        ExplainReport {
            data_set: dataset.name.clone(),
            verdict: self.diagnosis.verdict.word().into(),
            sentence: self.diagnosis.sentence.clone(),
            named: self.diagnosis.named.clone(),
            records: self.with_latent_force(record_reports(&models, dataset)),
            noise_floor: floor_report(&self.floor),
            steps,
            candidates,
            evidence: self.evidence(dataset),
            parameters: parameter_reports(&self.model),
            next_experiment: self.next_experiment.as_ref().map(|next| ExperimentReport {
                why: next.sentence.clone(),
                file: None,
                t_s: (0..next.proposal.drive_v.len()).map(|k| k as f64 / next.proposal.sample_rate_hz).collect(),
                u_v: next.proposal.drive_v.clone(),
            }),
            warnings,
            program_version: env!("CARGO_PKG_VERSION").into(),
            command,
        }
    }

    /// Where something stays without a name, the pages draw the force that would explain it.
    fn with_latent_force(&self, mut records: Vec<RecordReport>) -> Vec<RecordReport> {
        if self.diagnosis.verdict == verdict::Verdict::Unexplained {
            for record in &mut records {
                let Some(last) = record.residual_um.last() else { continue };
                record.latent_force = latent_force_nm(&self.model, last, record.sample_rate_hz, self.floor.rms_um);
                record.latent_unit = "nm".into();
            }
        }
        records
    }

    /// What is left in the end, and what rounding the modelled reading would do.
    fn evidence_of_rounding(&self, dataset: &Dataset) -> EvidenceReport {
        let last = self.growth.last();
        let (step_um, floor_um) = (self.floor.reading_step_um.unwrap_or(f64::MIN_POSITIVE), self.floor.rms_um.unwrap_or(0.0));
        let sigma_um = (floor_um.powi(2) - rounding_noise_um(step_um).powi(2)).max(0.0).sqrt();
        let driven = last.residuals.iter().enumerate().filter(|(_, residual)| !residual.is_empty());
        let traces = driven.map(|(record, residual_um)| {
            let record_of = &dataset.records[record];
            // The residual knows the constant of its record, the reading of the model does not.
            let rounding = |k: usize, residual: f64| mean_rounding_um(record_of.displacement_um[k] - residual, step_um, sigma_um);
            let predicted_um = record_of.window.clone().zip(residual_um).map(|(k, residual)| rounding(k, *residual)).collect();
            EvidenceTrace { record, samples: Vec::new(), residual_um: residual_um.clone(), predicted_um }
        });
        EvidenceReport { effect: "quantisation".into(), caption: String::new(), traces: traces.collect(), reading_step_um: step_um }
    }

    /// What the named effects predicted in the rounds that decided on them, against what the model before them had left.
    fn evidence(&self, dataset: &Dataset) -> Vec<EvidenceReport> {
        let of = |id: &String| {
            if id == "quantisation" {
                return Some(self.evidence_of_rounding(dataset));
            }
            let screening = &self.growth.round_of(id)?.screening;
            let score = screening.scores.iter().find(|score| score.id == *id)?;
            let records = self.split.identify.iter().zip(&screening.residual).zip(&score.signature);
            let traces = records.map(|((&record, residual_um), predicted_um)| EvidenceTrace {
                record,
                samples: Vec::new(),
                residual_um: residual_um.clone(),
                predicted_um: predicted_um.clone(),
            });
            Some(EvidenceReport { effect: id.clone(), traces: traces.collect(), ..EvidenceReport::default() })
        };
        self.diagnosis.named.iter().filter_map(of).collect()
    }
}

/// Figures of one step.
#[must_use]
pub fn step_figures(added: Option<String>, removed: Vec<String>, why: String, judged: &Judged) -> StepFigures {
    StepFigures { added, removed, why, identify_rms_um: judged.identify_rms_um, validate_rms_um: judged.validate_rms_um }
}

fn why(c: &verdict::CandidateFigures, diagnosis: &Diagnosis) -> String {
    if diagnosis.named.contains(&c.effect) {
        return "named".into();
    }
    match (c.validate_rms_before_um, c.validate_rms_after_um) {
        _ if c.p_value > 0.05 => "its signature is not in the residual".into(),
        (Some(before), Some(after)) if after > before => "fits the fitted records, but makes the held-out ones worse".into(),
        (Some(_), Some(_)) => "helps, but another explains more".into(),
        _ => "explains less than the finalists".into(),
    }
}

/// Records with measured and modelled displacement for a page.
#[must_use]
pub fn record_reports(models: &[&Model], dataset: &Dataset) -> Vec<RecordReport> {
    dataset
        .records
        .iter()
        .map(|record| {
            let window = record.window.clone();
            let residuals: Vec<Vec<f64>> = models.iter().map(|m| residual(m, record)).collect();
            let last = residuals.last().cloned().unwrap_or_default();
            RecordReport {
                name: record.name.clone(),
                role: record.role.name().into(),
                sample_rate_hz: record.sample_rate_hz,
                t_s: window.clone().map(|k| k as f64 * record.dt_s()).collect(),
                // The reading of a sample answers to the drive held before it.
                u_v: window.clone().map(|k| record.drive_v[k.saturating_sub(1)]).collect(),
                y_um: record.displacement_um[window.clone()].to_vec(),
                force_n: record.force_n.as_ref().map_or_else(Vec::new, |f| window.clone().map(|k| f[k.saturating_sub(1)]).collect()),
                residual_um: residuals,
                latent_force: Vec::new(),
                latent_unit: String::new(),
                window_from: 0,
                window_to: 0,
                range_um: record.range_um(),
                rms_um: rms(&last),
                max_um: last.iter().fold(0.0, |m, v| m.max(v.abs())),
            }
        })
        .collect()
}

/// Floor for a page.
#[must_use]
pub fn floor_report(floor: &NoiseFloor) -> Option<NoiseFloorReport> {
    floor.rms_um.map(|rms_um| NoiseFloorReport {
        rms_um,
        basis: floor.basis.clone(),
        estimates: floor.estimates.iter().map(|e| (e.basis.clone(), e.rms_um)).collect(),
    })
}

/// Values for a page.
#[must_use]
pub fn parameter_reports(model: &Model) -> Vec<ParameterReport> {
    model
        .effects
        .iter()
        .flat_map(|e| {
            e.parameters.iter().map(|p| ParameterReport {
                effect: e.id.clone(),
                name: p.parameter.name.clone(),
                value: p.value,
                std: p.std,
                unit: p.parameter.unit.clone(),
                note: if p.parameter.fixed {
                    "fixed".into()
                } else if p.value <= p.parameter.lower || p.value >= p.parameter.upper {
                    "at its bound".into()
                } else {
                    String::new()
                },
            })
        })
        .collect()
}

/// Checks that a list of effects can be told by the data at all.
///
/// # Errors
/// Names effects none of whose parameters the data fix.
pub fn require_identifiable(model: &Model, requested: &[Arc<dyn Effect>], cannot: &[String], dataset: &Dataset) -> Result<()> {
    for effect in requested {
        let id = effect.declaration().id;
        if cannot.iter().any(|c| c.starts_with(&format!("{id}: ")) && c.ends_with("none of its parameters")) {
            return Err(Problem::new(
                dataset.path.display(),
                format!("cannot identify {id}: the data fix none of its parameters. Best shown by: {}", effect.declaration().experiment),
            ));
        }
        if id == "load_force" && !dataset.records.iter().any(|r| r.force_n.is_some()) {
            return Err(Problem::new(dataset.path.display(), "cannot identify load_force: no record has a force column"));
        }
        if model.effect(&id).is_none() {
            let place = effect.declaration();
            let taken_by = model.effects.iter().find(|e| e.effect.declaration().place == place.place && place.modifies.is_none());
            return Err(Problem::new(
                "effects",
                taken_by.map_or_else(
                    || format!("{id} needs the effect it modifies in the list"),
                    |other| format!("{id} and {} stand in the same place of the chain; expected one of them", other.id),
                ),
            ));
        }
    }
    Ok(())
}
