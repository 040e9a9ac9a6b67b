//! The page of what a model of a stick-slip rig misses: findings with their evidence, values, and every reading
//! beside the models before and after.

use crate::page::{CurveRole, Page, PageBlock, Plot, Section, Series, Table, Tone, Width};
use hysteron::outcome::{Evidence, Residuals, Verdict};
use hysteron::rig_diagnosis::{RigData, RigDiagnosis};
use hysteron_sim::stick_slip::StickSlipActuator;

fn nm(um: f64) -> String {
    format!("{:.3}", 1e3 * um)
}

/// Fitted and held-out error, nm.
fn errors(errors: Residuals) -> String {
    let held_out = errors
        .validate
        .map_or_else(String::new, |um| format!(" / {}", nm(um)));
    nm(errors.identify) + &held_out
}

fn table(columns: &[&str], rows: Vec<Vec<String>>) -> PageBlock {
    PageBlock::Table(Table {
        columns: columns.iter().map(|name| (*name).to_owned()).collect(),
        rows,
        ..Table::default()
    })
}

/// The page of what was found; `made_by` is the command.
#[must_use]
pub fn rig_page(
    found: &RigDiagnosis,
    data: &RigData,
    start: &StickSlipActuator,
    made_by: String,
) -> Page {
    let noise = found
        .noise_floor_um
        .map_or_else(|| "unknown".into(), |um| nm(um) + " nm RMS");
    Page {
        title: format!("{}: stick-slip rig", found.name),
        lead_sentence: found.sentence.clone(),
        tone: if found.verdict == Verdict::AtFloor {
            Tone::Good
        } else {
            Tone::Attention
        },
        facts: vec![
            ("verdict".into(), found.verdict.word().into()),
            ("error before, nm".into(), errors(found.residual_rms_um)),
            (
                "error after, nm".into(),
                errors(found.residual_rms_after_um),
            ),
            ("noise of the sensor".into(), noise),
        ],
        sections: vec![
            findings(found),
            signals(found, data, start),
            candidates(found),
        ],
        footer: vec![made_by],
        ..Page::default()
    }
}

fn findings(found: &RigDiagnosis) -> Section {
    let evidence = (found.findings.iter()).map(|finding| {
        let effects = finding.effects.join(" or ");
        match finding.evidence {
            Evidence::Models {
                without,
                with,
                standard_errors,
            } => {
                let by = format!("{standard_errors:.1}");
                vec![effects, errors(without), errors(with), by]
            }
            Evidence::Readings => vec![effects],
        }
    });
    let values = (found.values.iter()).map(|value| {
        let to = format!("{:.4e} ± {:.1e}", value.to.value, value.to.std);
        let unit = value.unit.to_owned();
        vec![
            value.parameter.to_owned(),
            format!("{:.4e}", value.from),
            to,
            unit,
        ]
    });
    let columns = [
        "Missing",
        "Without it, nm",
        "With it, nm",
        "Standard errors",
    ];
    Section {
        heading: "What is missing".into(),
        text: "Errors are those of fitted and held-out records. The best model without an effect has no more effects than the one with it.".into(),
        blocks: vec![
            table(&columns, evidence.collect()),
            table(&["Value", "Before", "Now", "Unit"], values.collect()),
        ],
    }
}

fn signals(found: &RigDiagnosis, data: &RigData, start: &StickSlipActuator) -> Section {
    let [before, after] = [start, &found.rig].map(|rig| data.modelled(rig, &|_| true));
    let mut blocks = Vec::new();
    for (nth, reading) in data.readings.iter().enumerate() {
        let rate_hz = data.tapes[reading.tape].sample_rate_hz;
        let t: Vec<f64> = reading
            .samples
            .iter()
            .map(|k| *k as f64 / rate_hz)
            .collect();
        let y = data.measured(reading);
        let signal = if reading.is_platform {
            "platform"
        } else {
            "slider"
        };
        let role = if reading.held_out { ", held out" } else { "" };
        let plot = |what: &str, unit: &str| {
            Plot::new(format!("{}{role}: {what}", reading.record))
                .x_axis("time", "s")
                .y_axis(signal, unit)
                .link(&reading.record)
                .width(Width::Half)
        };
        let curves = [
            ("measured", CurveRole::Measured, &y),
            ("model before", CurveRole::Other1, &before[nth]),
            ("model after", CurveRole::Model, &after[nth]),
        ];
        let motion = curves
            .into_iter()
            .fold(plot(signal, "um"), |plot, (name, role, curve)| {
                plot.with(Series::line(name, role, t.clone(), curve.clone()))
            });
        let left = |modelled: &[f64]| -> Vec<f64> {
            y.iter().zip(modelled).map(|(y, m)| 1e3 * (y - m)).collect()
        };
        let residual = plot(&format!("residual of the {signal}"), "nm")
            .with(Series::line(
                "before",
                CurveRole::Other1,
                t.clone(),
                left(&before[nth]),
            ))
            .with(Series::line(
                "after",
                CurveRole::Residual,
                t,
                left(&after[nth]),
            ));
        blocks.extend([PageBlock::Plot(motion), PageBlock::Plot(residual)]);
    }
    Section {
        heading: "Measured and modelled".into(),
        blocks,
        ..Section::default()
    }
}

fn candidates(found: &RigDiagnosis) -> Section {
    let rows = found.candidates.iter().map(|candidate| {
        let alone = candidate.alone.map_or_else(|| "-".into(), errors);
        let excluded = if candidate.is_excluded {
            "at an end of its range"
        } else {
            ""
        };
        vec![
            candidate.effect.to_owned(),
            candidate.sentence.to_owned(),
            alone,
            excluded.to_owned(),
        ]
    });
    Section {
        heading: "All effects".into(),
        text: "The error of the rig with one effect more.".into(),
        blocks: vec![table(
            &["Effect", "Physics", "Error alone, nm", ""],
            rows.collect(),
        )],
    }
}
