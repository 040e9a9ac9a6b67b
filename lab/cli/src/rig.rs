//! `explain` of a stick-slip rig.

use crate::arguments::{StudyOutputs, as_typed, refuse_without_effect};
use crate::desk::Desk;
use crate::explain::ExplainRequest;
use crate::progress::Progress;
use crate::read_arguments::ReadArguments;
use hysteron::outcome::{Evidence, Residuals};
use hysteron::rig_diagnosis::recordings::PLATFORM;
use hysteron::rig_diagnosis::{RigData, RigDiagnosis, diagnose_rig};
use hysteron::servo::stepping_rig;
use hysteron::{Error, Policy, Result};
use hysteron_report::rig_page;
use std::path::Path;

/// Whether `--from` is a rig.
pub fn is_rig(from: &str) -> bool {
    from.ends_with(".toml")
        && std::fs::read_to_string(from).is_ok_and(|text| stepping_rig::is_rig(&text))
}

/// Finds what the model of a rig misses.
pub fn explain(
    path: &Path,
    wanted: &ExplainRequest,
    reading: &ReadArguments,
    outputs: &StudyOutputs,
) -> Result<bool> {
    let (out, series) = (outputs.out.as_deref(), &outputs.recordings.series);
    let outputs = &outputs.recordings.files;
    let desk = Desk::new(outputs.force);
    let from = Path::new(wanted.from);
    let text = desk.text(from, "a rig written by `hysteron stepping`")?;
    let start = stepping_rig::from_toml(&text, &from.display().to_string())?;
    let policy: Policy = wanted.search.options(&desk)?.policy;
    let [own, _] = wanted.search.given();
    let without_effect = [
        own,
        ("--animation", wanted.animation.is_some()),
        ("--series", series.is_some()),
    ];
    refuse_without_effect("a stick-slip rig", &without_effect)?;
    let dataset = desk.dataset_with(path, wanted.held_out, reading)?;
    let signals = dataset.records.iter().flat_map(|record| &record.auxiliary);
    if let Some(other) = signals.into_iter().find(|signal| signal.name != PLATFORM) {
        return Err(Error::new(
            &other.name,
            format!("has no effect for a stick-slip rig; expected the column {PLATFORM}, or none"),
        ));
    }
    desk.target(out)?;
    outputs.check(&desk)?;
    let data = RigData::new(&dataset, start.drive_range_v, policy.walked_samples)?;
    let progress = Progress::of_search(wanted.verbose);
    let time = wanted.time;
    let found = time.beside(&progress, |watch| {
        diagnose_rig(&data, &start, &policy, watch)
    })?;
    drop(progress);
    print(&found);
    if let Some(out) = out {
        desk.write(out, stepping_rig::to_toml(&found.rig)?.as_bytes())?;
        println!("Rig: {}", out.display());
    }
    desk.write_json(outputs.json.as_deref(), &found)?;
    desk.write_page(outputs.report.as_deref(), || {
        rig_page(&found, &data, &start, as_typed())
    })?;
    Ok(true)
}

/// Fitted and held-out error.
fn errors(errors: Residuals) -> String {
    let held_out = errors
        .validate
        .map_or_else(String::new, |um| format!(" / {:.3}", 1e3 * um));
    format!("{:.3}{held_out} nm", 1e3 * errors.identify)
}

fn print(found: &RigDiagnosis) {
    println!(
        "{}: {} ({})",
        found.name,
        found.sentence,
        found.verdict.word()
    );
    println!(
        "  errors fitted / held out: before {}",
        errors(found.residual_rms_um)
    );
    println!(
        "                            after  {}",
        errors(found.residual_rms_after_um)
    );
    for finding in &found.findings {
        if let Evidence::Models {
            without,
            with,
            standard_errors,
        } = finding.evidence
        {
            // Without a scatter any difference is beyond chance.
            let apart = if standard_errors.is_finite() {
                format!(", {standard_errors:.1} standard errors")
            } else {
                String::new()
            };
            println!(
                "  {}: with it {}, the best model without it {}{apart}",
                finding.effects.join(" or "),
                errors(with),
                errors(without)
            );
        }
    }
    for value in &found.values {
        println!(
            "    {} = {:.4e} ± {:.1e} {} (was {:.4e})",
            value.parameter, value.to.value, value.to.std, value.unit, value.from
        );
    }
    for note in &found.notes {
        println!("  note: {note}");
    }
}
