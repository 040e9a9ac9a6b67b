//! Answers to the page.

use crate::recording::{ColumnChoice, UploadedRecording};
use hysteron::analyse::Outcome;
use hysteron::dataset::issue_words;
use hysteron::diagnosis::residual_map::{drive_features, residual_by_feature};
use hysteron::diagnosis::words;
use hysteron::figures::FitFigures;
use hysteron::identification::linearisation::fill_left_out;
use hysteron::identification::noise_floor::NoiseFloor;
use hysteron::watch::WatchEvent;
use hysteron::{Dataset, Record};
use hysteron_report::explain_report;
use hysteron_sim::chain::Model;
use hysteron_sim::effect::{Against, Scale, registry};
use serde::Serialize;
use serde_json::{Value, json};

/// JSON with columns of numbers behind it.
pub struct Answer {
    /// The figures.
    pub json: Value,
    /// The columns.
    pub columns: Vec<Vec<f64>>,
}

impl Answer {
    /// Figures alone.
    #[must_use]
    pub fn of(json: Value) -> Self {
        Self {
            json,
            columns: Vec::new(),
        }
    }

    /// Length of the JSON, the JSON filled up with blanks to a multiple of eight bytes, the columns as 64-bit
    /// floats; numbers are little-endian. The key `columns` gives the lengths.
    #[must_use]
    pub fn bytes(mut self) -> Vec<u8> {
        if let Some(object) = self.json.as_object_mut() {
            object.insert(
                "columns".into(),
                json!(self.columns.iter().map(Vec::len).collect::<Vec<_>>()),
            );
        }
        let mut text = self.json.to_string().into_bytes();
        text.resize(text.len().next_multiple_of(8), b' ');
        let mut out = Vec::with_capacity(
            8 + text.len() + 8 * self.columns.iter().map(Vec::len).sum::<usize>(),
        );
        out.extend((text.len() as u64).to_le_bytes());
        out.extend(text);
        self.columns
            .iter()
            .flatten()
            .for_each(|value| out.extend(value.to_le_bytes()));
        out
    }
}

/// One record in a list.
#[derive(Serialize)]
struct RecordLine<'a> {
    name: &'a str,
    role: &'static str,
    sample_rate_hz: f64,
    samples: usize,
    from_s: f64,
    to_s: f64,
    range_um: f64,
}

/// A data set as it was read.
#[must_use]
pub fn recording(recording: &UploadedRecording, floor: &NoiseFloor) -> Value {
    let UploadedRecording {
        dataset,
        manifest,
        columns,
    } = recording;
    let line = |r: &Record| {
        json!(RecordLine {
            name: &r.name,
            role: r.role.name(),
            sample_rate_hz: r.sample_rate_hz,
            samples: r.window.len(),
            from_s: r.window.start as f64 * r.dt_s(),
            to_s: r.window.end as f64 * r.dt_s(),
            range_um: r.range_um(),
        })
    };
    let columns: &[ColumnChoice] = columns;
    json!({
        "name": dataset.name,
        "drive_min_v": dataset.drive_min_v,
        "drive_max_v": dataset.drive_max_v,
        "notes": dataset.remarks(),
        "records": dataset.records.iter().map(line).collect::<Vec<_>>(),
        "table": columns,
        "manifest": manifest,
        "floor": { "rms_um": floor.rms_um, "basis": floor.basis, "warnings": floor.warnings },
        "features": drive_features(dataset.drive_min_v, dataset.drive_max_v),
    })
}

/// Drive and reading of a record inside its window; the reading of a sample answers to the drive held before
/// it.
#[must_use]
pub fn signals(record: &Record) -> Answer {
    let window = record.window.clone();
    let drive_v = window
        .clone()
        .map(|k| record.drive_v[k.saturating_sub(1)])
        .collect();
    Answer {
        json: json!({ "rate_hz": record.sample_rate_hz, "from_s": window.start as f64 * record.dt_s() }),
        columns: vec![drive_v, record.displacement_um[window].to_vec()],
    }
}

/// A model with all that is needed to show and to change it.
#[must_use]
pub fn model(model: &Model) -> Value {
    let effects = model.effects.iter().map(|e| {
        let declaration = e.effect.declaration();
        let parameters = e.parameters.iter().map(|p| {
            json!({
                "name": p.parameter.name, "unit": p.parameter.unit, "value": p.value, "std": p.std,
                "lower": p.parameter.lower, "upper": p.parameter.upper, "fixed": p.parameter.fixed,
                "step": match p.parameter.scale { Scale::Linear(step) => Some(step), Scale::Logarithmic => None },
            })
        });
        json!({
            "id": e.id, "physics": declaration.physics, "reference": declaration.reference,
            "parameters": parameters.collect::<Vec<_>>(),
        })
    });
    json!({ "effects": effects.collect::<Vec<_>>() })
}

/// Where a model fails in a record: RMS of the residual inside its window by what the drive does; `null`
/// where too few samples show it.
#[must_use]
pub fn map_row(dataset: &Dataset, record: &Record, residual_um: &[f64]) -> Value {
    // The map counts turns and maxima before the window; there is no residual there.
    let mut from_start = vec![f64::NAN; record.window.start];
    from_start.extend(residual_um);
    fill_left_out(record, &mut from_start[record.window.start..], f64::NAN);
    let limits = (dataset.drive_min_v, dataset.drive_max_v);
    let cells = residual_by_feature(
        &record.drive_v,
        &from_start,
        record.sample_rate_hz,
        record.window.clone(),
        limits,
    );
    json!(
        cells
            .into_iter()
            .map(|cell| cell.map(|c| c.rms))
            .collect::<Vec<_>>()
    )
}

/// What happens in a search.
#[must_use]
pub fn event(event: &WatchEvent<'_>) -> Value {
    let text = event.to_string();
    match event {
        WatchEvent::Tried {
            added,
            identify_rms_um,
            validate_rms_um,
            best,
        } => {
            json!({ "text": text, "added": added, "fitted_um": identify_rms_um, "held_out_um": validate_rms_um, "best": best })
        }
        _ => json!({ "text": text }),
    }
}

fn against(kind: Against) -> &'static str {
    match kind {
        Against::TimeHeld | Against::TimeSinceTurn => "time since the last turn",
        Against::Drive => "drive",
        Against::Displacement => "displacement",
        Against::WithinStep => "place within a step",
        Against::Rate => "rate of the drive",
        Against::Force => "force",
        Against::Time => "time",
        Against::Frequency => "frequency",
    }
}

/// What was found, with the words for every candidate, and the curves of the evidence behind it: samples
/// counted from the beginning of the window, residual, prediction.
#[must_use]
pub fn explanation(found: &Outcome, dataset: &Dataset, figures: &FitFigures) -> Answer {
    let dataset = found.dataset(dataset);
    let report = explain_report(found, dataset, String::new());
    let mut columns = Vec::new();
    let mut curves = Vec::new();
    for evidence in &report.evidence {
        for trace in &evidence.traces {
            let record = &dataset.records[trace.record];
            let samples: Vec<f64> = match trace.samples[..] {
                [] => (0..trace.residual_um.len()).map(|k| k as f64).collect(),
                _ => trace.samples.iter().map(|k| *k as f64).collect(),
            };
            curves.push(json!({
                "effect": evidence.effect, "caption": evidence.caption, "against": against(evidence.against),
                "record": record.name, "column": columns.len(),
            }));
            columns.extend([
                samples,
                trace.residual_um.clone(),
                trace.predicted_um.clone(),
            ]);
        }
    }
    let candidates = found.diagnosis.candidates.iter().map(|c| {
        json!({
            "effect": c.effect, "why": words::why(&c.standing), "share": c.explained_share, "p": c.p_value,
            "before_um": c.validate_rms_before_um, "after_um": c.validate_rms_after_um, "in_place_of": c.in_place_of,
            "unlikely_because": c.unlikely_because, "next_experiment": c.next_experiment,
        })
    });
    let steps = found.steps.iter().zip(&figures.steps).map(|(step, said)| {
        json!({
            "added": said.added, "why": said.why, "fitted_um": said.identify_rms_um, "held_out_um": said.validate_rms_um,
            "effects": step.judged.model.effect_ids(),
        })
    });
    let d = &found.diagnosis;
    Answer {
        json: json!({
            "verdict": d.verdict.word(), "sentence": d.sentence, "named": d.named,
            "findings": d.findings, "changed": words::changed(&d.changed), "reason": d.reason, "remainder": d.remainder,
            "issues": d.issues.iter().map(issue_words::sentence).collect::<Vec<_>>(),
            "candidates": candidates.collect::<Vec<_>>(), "steps": steps.collect::<Vec<_>>(), "curves": curves,
            "cannot_identify": figures.cannot_identify, "warnings": figures.warnings,
            "next_experiment": found.next_experiment.as_ref().map(|n| json!({ "sentence": n.sentence, "csv": n.proposal.csv() })),
        }),
        columns,
    }
}

/// All effects that there are.
#[must_use]
pub fn effects() -> Value {
    let line = registry()
        .into_iter()
        .map(|e| e.declaration())
        .map(|d| json!({ "id": d.id, "physics": d.physics, "experiment": d.experiment }));
    json!({ "effects": line.collect::<Vec<_>>() })
}
