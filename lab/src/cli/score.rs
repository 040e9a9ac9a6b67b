//! `score`.

use super::Outputs;
use super::output::{check_writable, write_json};
use crate::problem::Result;
use std::path::Path;

/// Scores a folder of planted cases.
pub fn score(dir: &Path, outputs: &Outputs) -> Result<bool> {
    check_writable(outputs.json.as_deref())?;
    let score = crate::score::score(dir, &|case, i, n| {
        let said = if case.named.is_empty() { String::new() } else { format!(" {}", case.named.join(", ")) };
        let mark = if case.right_first {
            "right"
        } else if case.right_in_set {
            "in set"
        } else {
            "WRONG"
        };
        println!(
            "{i:>3}/{n} {:20} {:30} {:6} {}{said}  {:.3} x noise, {:.1} s",
            case.case, case.hidden, mark, case.verdict, case.validate_over_noise, case.seconds
        );
    })?;
    println!();
    println!("right first          {:>6.1} %", 100.0 * score.right_first);
    println!("right or in the set  {:>6.1} %", 100.0 * score.right_in_set);
    println!("false discoveries    {:>6.1} %", 100.0 * score.false_discoveries);
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
    if let Some(path) = &outputs.json {
        write_json(path, &score)?;
    }
    Ok(score.cases.iter().all(|c| c.right_in_set))
}
