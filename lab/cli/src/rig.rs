//! `explain` of a stick-slip rig.

use crate::arguments::{StudyOutputs, as_typed};
use crate::desk::{Desk, wrong};
use crate::explain::ExplainRequest;
use crate::progress::Progress;
use crate::read_arguments::ReadArguments;
use hysteron::outcome::{Evidence, Residuals};
use hysteron::rig_diagnosis::{RigData, RigDiagnosis, diagnose_rig};
use hysteron::servo::stepping_rig;
use hysteron::{Policy, Result};
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
    if wanted.animation.is_some() || series.is_some() {
        return Err(wrong(
            from,
            "is a stick-slip rig, for which --animation and --series have no effect; leave them out",
        ));
    }
    let dataset = desk.dataset_with(path, wanted.held_out, reading)?;
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
            println!(
                "  {}: with it {}, the best model without it {}, {standard_errors:.1} standard errors",
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
