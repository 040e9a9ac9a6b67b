//! `score`.

use crate::arguments::Outputs;
use crate::desk::{Desk, wrong};
use crate::read_arguments::ReadArguments;
use hysteron::Result;
use hysteron::synthetic::case::Truth;
use hysteron::synthetic::score::{CaseScore, score_case, summarise};
use std::path::Path;
use std::time::Instant;

/// Scores a folder of planted cases.
pub fn score(dir: &Path, outputs: &Outputs) -> Result<bool> {
    let desk = Desk::new(outputs.force);
    let path = dir.join("truth.json");
    let truths: Vec<Truth> = serde_json::from_str(&desk.text(&path, "the truth of planted cases")?)
        .map_err(|e| wrong(&path, e))?;
    if truths.is_empty() {
        return Err(wrong(&path, "has no cases"));
    }
    outputs.check(&desk)?;
    let mut cases: Vec<CaseScore> = Vec::new();
    for truth in &truths {
        let started = Instant::now();
        let mut case = score_case(
            &desk.dataset(&dir.join(&truth.name), &ReadArguments::default())?,
            truth,
        )?;
        case.seconds = started.elapsed().as_secs_f64();
        let said = if case.named.is_empty() {
            String::new()
        } else {
            format!(" {}", case.named.join(", "))
        };
        let mark = if case.right_first {
            "right"
        } else if case.right_in_set {
            "in set"
        } else {
            "WRONG"
        };
        println!(
            "{:>3}/{} {:20} {:30} {:6} {}{said}  {:.3} x noise, {:.1} s",
            cases.len() + 1,
            truths.len(),
            case.case,
            case.hidden,
            mark,
            case.verdict,
            case.validate_over_noise,
            case.seconds
        );
        cases.push(case);
    }
    let score = summarise(cases);
    println!();
    println!("right first          {:>6.1} %", 100.0 * score.right_first);
    println!("right or in the set  {:>6.1} %", 100.0 * score.right_in_set);
    println!(
        "false discoveries    {:>6.1} %",
        100.0 * score.false_discoveries
    );
    if let Some(share) = score.unexplained_recognised {
        println!("unexplained seen     {:>6.1} %", 100.0 * share);
    }
    println!("within 1.15 x noise  {:>6.1} %", 100.0 * score.within_noise);
    if let Some(share) = score.null_share_below_5_pct {
        println!("p < 0.05 with nothing missing {:>5.1} %", 100.0 * share);
    }
    if !score.detected_from_nm.is_empty() {
        println!("found in nine of ten from (nm RMS in the record that it changes most):");
        for (kind, nm) in &score.detected_from_nm {
            println!("  {kind:30} {nm:>8.2}");
        }
    }
    println!("longest case         {:>6.1} s", score.seconds_max);
    desk.write_json(outputs.json.as_deref(), &score)?;
    Ok(score.cases.iter().all(|c| c.right_in_set))
}
