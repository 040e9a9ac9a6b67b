//! A page about every effect of the library, from what each declares and what it does to a simulated reading.

use crate::page::{CurveRole, Page, PageBlock, Plot, Section, Series, Table};
use crate::text::{effect_words, figure};
use hysteron::synthetic::signatures::{Signature, SignatureOnRecord};
use hysteron_sim::effect::Place;

/// Most points of a curve.
const POINTS: usize = 900;

/// The page.
#[must_use]
pub fn effects_page(signatures: &[Signature]) -> Page {
    Page {
        title: "Effects of the library".into(),
        lead_sentence: format!(
            "{} effects, each with its physics, its values, what it does to the reading of a simulated actuator, and what looks like it there.",
            signatures.len()
        ),
        sections: signatures.iter().map(section).collect(),
        ..Page::default()
    }
}

fn section(signature: &Signature) -> Section {
    let declaration = &signature.declaration;
    let place = Place::NAMES
        .iter()
        .find(|(_, place)| *place == declaration.place)
        .map_or("", |(name, _)| name);
    let alike: Vec<String> = signature
        .alike
        .iter()
        .map(|(id, cosine)| format!("{} ({cosine:+.2})", effect_words(id)))
        .collect();
    let mut text = vec![declaration.physics.clone()];
    text.push(match &alike[..] {
        [] => "On these drives no other effect looks like it.".to_owned(),
        _ => format!(
            "Looks like it on these drives, with the cosine between the signatures: {}.",
            alike.join(", ")
        ),
    });
    if !declaration.experiment.is_empty() {
        text.push(format!(
            "Shown best by: {}.",
            declaration.experiment.trim_end_matches('.')
        ));
    }
    text.push(format!(
        "Place in the chain: {}. Reference: {}.",
        effect_words(place),
        declaration.reference.trim_end_matches('.')
    ));
    let rows = signature.parameters.iter().map(|(parameter, value)| {
        vec![
            parameter.name.clone(),
            parameter.unit.clone(),
            figure(*value),
            figure(parameter.lower),
            figure(parameter.upper),
        ]
    });
    let mut blocks: Vec<PageBlock> = signature.clearest().map(pictures).unwrap_or_default();
    blocks.push(PageBlock::Table(Table {
        columns: ["value", "unit", "here", "at least", "at most"]
            .map(String::from)
            .to_vec(),
        rows: rows.collect(),
        ..Table::default()
    }));
    Section {
        heading: effect_words(&declaration.id),
        text: text.join("\n\n"),
        blocks,
    }
}

/// The signature over time and over the drive, in the record in which it is largest.
fn pictures(on: &SignatureOnRecord) -> Vec<PageBlock> {
    let every = on.signature_um.len().div_ceil(POINTS).max(1);
    let kept = |values: &[f64], factor: f64| {
        values
            .iter()
            .step_by(every)
            .map(|v| factor * v)
            .collect::<Vec<f64>>()
    };
    let signature_nm = kept(&on.signature_um, 1e3);
    let time_s = (0..on.signature_um.len())
        .step_by(every)
        .map(|k| k as f64 / on.rate_hz)
        .collect();
    let said = |kind: &str| format!("What it adds to the reading {kind}, record {}", on.record);
    vec![
        PageBlock::Plot(
            Plot::new(said("over time"))
                .x_axis("time", "s")
                .y_axis("signature", "nm")
                .with(Series::line(
                    "signature",
                    CurveRole::Residual,
                    time_s,
                    signature_nm.clone(),
                )),
        ),
        PageBlock::Plot(
            Plot::new(said("over the drive"))
                .x_axis("drive", "V")
                .y_axis("signature", "nm")
                .with(Series::line(
                    "signature",
                    CurveRole::Residual,
                    kept(&on.drive_v, 1.0),
                    signature_nm,
                )),
        ),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_effect_has_its_section_with_pictures_and_values() {
        let signatures = hysteron::synthetic::signatures::signatures().unwrap();
        let page = effects_page(&signatures);
        assert_eq!(page.sections.len(), hysteron_sim::effect::registry().len());
        for section in &page.sections {
            assert_eq!(section.blocks.len(), 3, "{}", section.heading);
        }
        assert!(page.to_html().contains("amplifier bandwidth ("));
    }
}
