//! What a library found as the plain structs that a page shows.

use crate::explain_report::{
    CandidateReport, EvidenceReport, EvidenceTrace, ExperimentReport, ExplainReport,
    NoiseFloorReport, ParameterReport, RecordReport, StepReport,
};
use hysteron::analyse::Outcome;
use hysteron::dataset::Dataset;
use hysteron::dataset::reading_grid::{mean_rounding_um, rounding_noise};
use hysteron::diagnosis::judgement::noise_floor_beside;
use hysteron::diagnosis::latent_force::latent_force_nm;
use hysteron::diagnosis::path::PathStep;
use hysteron::diagnosis::words;
use hysteron::engineering::{Figure, figures};
use hysteron::figures::{FitFigures, StepFigures, step_figures};
use hysteron::identification::fit::{residual, rms};
use hysteron::identification::linearisation::{counted_of, fill_left_out};
use hysteron::identification::noise_floor::NoiseFloor;
use hysteron::identification::nuisance_terms::Samples;
use hysteron::outcome::{CandidateFigures, Diagnosis, Residuals, Standing, Verdict};
use hysteron::phrases::nm;
use hysteron::replay::{lines, replays};
use hysteron::statistics::largest;
use hysteron_sim::chain::Model;
use hysteron_sim::effect::Effect;
use hysteron_sim::effect::quantisation::Quantisation;

/// Error of the named effects alone, held out where something is, if it is another than at the end, um.
fn named_rms_um(diagnosis: &Diagnosis) -> Option<f64> {
    let error_um = |of: &Residuals| of.validate.unwrap_or(of.identify);
    let named_um = error_um(&diagnosis.residual_rms_named_um);
    (!diagnosis.named.is_empty() && nm(named_um) != nm(error_um(&diagnosis.residual_rms_after_um)))
        .then_some(named_um)
}

/// Everything that the page of an explanation shows.
#[must_use]
pub fn explain_report(found: &Outcome, dataset: &Dataset, command: String) -> ExplainReport {
    let dataset = found.dataset(dataset);
    let models: Vec<&Model> = found.steps.iter().map(|s| &s.judged.model).collect();
    let mut warnings: Vec<String> = dataset
        .remarks()
        .into_iter()
        .chain(found.floor.warnings.iter().cloned())
        .collect();
    let open = found.cannot_identify.iter().map(words::cannot_identify);
    warnings.extend(open.map(|c| format!("cannot be identified from this data: {c}")));
    ExplainReport {
        data_set: dataset.name.clone(),
        verdict: found.diagnosis.verdict.word().into(),
        sentence: found.diagnosis.sentence.clone(),
        named: found.diagnosis.named.clone(),
        named_rms_um: named_rms_um(&found.diagnosis),
        records: with_latent_force(found, record_reports(&models, dataset)),
        noise_floor: floor_report(&found.floor),
        steps: step_reports(&found.steps),
        candidates: found
            .diagnosis
            .candidates
            .iter()
            .map(candidate_report)
            .collect(),
        evidence: evidence(found, dataset),
        parameters: parameter_reports(&found.model),
        replays: lines(&replays(&found.model, dataset)),
        values: value_reports(&figures(&found.model, &found.cannot_identify)),
        next_experiment: found.next_experiment.as_ref().map(|next| ExperimentReport {
            why: next.sentence.clone(),
            t_s: (0..next.proposal.drive_v.len())
                .map(|k| k as f64 / next.proposal.sample_rate_hz)
                .collect(),
            u_v: next.proposal.drive_v.clone(),
        }),
        warnings,
        program_version: env!("CARGO_PKG_VERSION").into(),
        command,
    }
}

fn step_reports(steps: &[PathStep]) -> Vec<StepReport> {
    let of = |s: StepFigures| StepReport {
        added: s.added,
        why: s.why,
        identify_rms_um: s.identify_rms_um,
        validate_rms_um: s.validate_rms_um,
    };
    step_figures(steps).into_iter().map(of).collect()
}

fn candidate_report(c: &CandidateFigures) -> CandidateReport {
    CandidateReport {
        effect: c.effect.clone(),
        explained_share: c.explained_share,
        explained_share_interval: Some(c.explained_share_interval),
        p_value: c.p_value,
        validate_rms_before_um: c.validate_rms_before_um,
        validate_rms_after_um: c.validate_rms_after_um,
        confusable_with: c.confusable_with.clone(),
        next_experiment: c.next_experiment.clone(),
        why: words::why(&c.standing).into(),
    }
}

/// Where something stays without a name, the pages draw the force that would explain it.
fn with_latent_force(found: &Outcome, mut records: Vec<RecordReport>) -> Vec<RecordReport> {
    if found.diagnosis.verdict == Verdict::Unexplained {
        for record in &mut records {
            let Some(last) = record.residual_um.last() else {
                continue;
            };
            let without_gaps: Vec<f64> = last
                .iter()
                .map(|left| if left.is_finite() { *left } else { 0.0 })
                .collect();
            record.latent_force = latent_force_nm(
                &found.model,
                &without_gaps,
                record.sample_rate_hz,
                found.floor.rms_um,
            );
            record.latent_unit = "nm".into();
        }
    }
    records
}

/// What is left in the end, and what rounding the modelled reading would do.
fn evidence_of_rounding(found: &Outcome, dataset: &Dataset) -> EvidenceReport {
    let (step_um, floor_um) = (
        found.floor.reading_step_um.unwrap_or(f64::MIN_POSITIVE),
        found.floor.rms_um.unwrap_or(0.0),
    );
    let sigma_um = (floor_um.powi(2) - rounding_noise(step_um).powi(2))
        .max(0.0)
        .sqrt();
    let driven = found
        .last()
        .residuals
        .iter()
        .enumerate()
        .filter(|(_, residual)| !residual.is_empty());
    let traces = driven.map(|(record, residual_um)| {
        let record_of = &dataset.records[record];
        // The residual knows the constant of its record, the reading of the model does not.
        let rounding = |k: usize, residual: f64| {
            mean_rounding_um(record_of.displacement_um[k] - residual, step_um, sigma_um)
        };
        let predicted_um = record_of
            .counted()
            .zip(residual_um)
            .map(|(k, residual)| rounding(k, *residual))
            .collect();
        let samples = if record_of.left_out.is_empty() {
            Vec::new()
        } else {
            record_of
                .counted()
                .map(|k| k - record_of.window.start)
                .collect()
        };
        EvidenceTrace {
            record,
            samples,
            residual_um: residual_um.clone(),
            predicted_um,
        }
    });
    let quantisation = Quantisation;
    EvidenceReport {
        effect: quantisation.declaration().id,
        against: quantisation.declaration().picture.against,
        caption: quantisation.declaration().picture.caption.into(),
        traces: traces.collect(),
        reading_step_um: step_um,
    }
}

/// What each named effect predicts, against what the model without it leaves.
fn evidence(found: &Outcome, dataset: &Dataset) -> Vec<EvidenceReport> {
    let of = |id: &String| {
        if found
            .diagnosis
            .candidates
            .iter()
            .any(|c| c.effect == *id && c.standing == Standing::InTheReadings)
        {
            return Some(evidence_of_rounding(found, dataset));
        }
        let weighed = found
            .weighed
            .iter()
            .find(|w| w.slot.effects().contains(id))?;
        let screening = weighed.screening.as_ref()?;
        let score = screening.scores.iter().find(|score| score.id == *id)?;
        let (residual, signature) = (screening.residual(), screening.signature(score));
        let traces = screening
            .records
            .iter()
            .zip(&screening.samples)
            .zip(residual.into_iter().zip(signature));
        let traces =
            traces.map(
                |((&record, samples), (residual_um, predicted_um))| EvidenceTrace {
                    record,
                    samples: match samples {
                        Samples::Every(_) => Vec::new(),
                        Samples::Some(list) => list
                            .iter()
                            .map(|k| k - dataset.records[record].window.start)
                            .collect(),
                    },
                    residual_um,
                    predicted_um,
                },
            );
        Some(EvidenceReport {
            effect: id.clone(),
            against: score.effect.declaration().picture.against,
            caption: score.effect.declaration().picture.caption.into(),
            traces: traces.collect(),
            reading_step_um: 0.0,
        })
    };
    found.diagnosis.named.iter().filter_map(of).collect()
}

/// Records with measured and modelled displacement for a page.
#[must_use]
pub fn record_reports(models: &[&Model], dataset: &Dataset) -> Vec<RecordReport> {
    let replayed = models
        .last()
        .map_or_else(Vec::new, |last| replays(last, dataset));
    dataset
        .records
        .iter()
        .enumerate()
        .map(|(i, record)| {
            let window = record.window.clone();
            let mut residuals: Vec<Vec<f64>> = models.iter().map(|m| residual(m, record)).collect();
            let last = residuals
                .last()
                .map_or_else(Vec::new, |last| counted_of(record, last));
            // Drawn, the distance to a reading that says nothing would be all that one sees.
            residuals
                .iter_mut()
                .for_each(|residual| fill_left_out(record, residual, f64::NAN));
            RecordReport {
                name: record.name.clone(),
                role: record.role.name().into(),
                sample_rate_hz: record.sample_rate_hz,
                t_s: window.clone().map(|k| k as f64 * record.dt_s()).collect(),
                // The reading of a sample answers to the drive held before it.
                u_v: window
                    .clone()
                    .map(|k| record.drive_v[k.saturating_sub(1)])
                    .collect(),
                y_um: record.displacement_um[window.clone()].to_vec(),
                force_n: record.force_n.as_ref().map_or_else(Vec::new, |f| {
                    window.clone().map(|k| f[k.saturating_sub(1)]).collect()
                }),
                residual_um: residuals,
                latent_force: Vec::new(),
                latent_unit: String::new(),
                range_um: record.range_um(),
                rms_um: rms(&last),
                max_um: largest(&last),
                replay_rms_um: replayed
                    .iter()
                    .find(|replay| replay.records.contains(&i))
                    .map_or(0.0, |replay| replay.rms_um),
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
        estimates: floor
            .estimates
            .iter()
            .map(|e| (e.basis.clone(), e.rms_um))
            .collect(),
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

fn value_reports(values: &[Figure]) -> Vec<[String; 3]> {
    values
        .iter()
        .map(|value| [value.effect.clone(), value.name.clone(), value.text()])
        .collect()
}

/// A model as it is on a data set.
#[must_use]
pub fn comparison_report(
    model: &Model,
    dataset: &Dataset,
    figures: &FitFigures,
    command: String,
) -> ExplainReport {
    let floor = noise_floor_beside(model, dataset);
    let mut warnings = figures.warnings.clone();
    warnings.extend(
        figures
            .cannot_identify
            .iter()
            .map(|c| format!("cannot be identified from this data: {c}")),
    );
    ExplainReport {
        data_set: dataset.name.clone(),
        verdict: "compared".into(),
        sentence: figures.comparison_sentence(),
        records: record_reports(&[model], dataset),
        noise_floor: floor_report(&floor),
        steps: vec![StepReport {
            added: None,
            why: "the model as it is".into(),
            identify_rms_um: figures.identify_rms_um,
            validate_rms_um: figures.validate_rms_um,
        }],
        parameters: parameter_reports(model),
        replays: lines(&figures.replays),
        values: value_reports(&figures.values),
        warnings,
        program_version: env!("CARGO_PKG_VERSION").into(),
        command,
        ..ExplainReport::default()
    }
}
