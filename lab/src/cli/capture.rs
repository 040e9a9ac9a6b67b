//! `capture`.

use crate::problem::Result;
use std::path::Path;

/// Decodes a target's log into a data set.
pub fn capture(elf: &Path, raw: &Path, out: &Path) -> Result<bool> {
    let summary = crate::capture::capture(elf, raw, out)?;
    for (file, samples) in &summary.records {
        println!("{}: {samples} samples", out.join(file).display());
    }
    if summary.gaps > 0 || summary.damaged > 0 || summary.lost_on_target > 0 {
        println!(
            "Not whole: {} gaps, {} damaged frames, {} ticks lost on the target; what is between them was kept.",
            summary.gaps, summary.damaged, summary.lost_on_target
        );
    }
    println!("Next: hysteron explain {}", out.display());
    Ok(true)
}
