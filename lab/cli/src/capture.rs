//! `capture`.

use crate::desk::Desk;
use crate::screen::as_argument;
use hysteron::Result;
use std::path::Path;

/// Decodes a target's log into a data set.
pub fn capture(elf: &Path, raw: &Path, out: &Path, force: bool) -> Result<bool> {
    let desk = Desk::new(force);
    let (image, log) = (
        desk.bytes(elf, "the image that was flashed")?,
        desk.bytes(raw, "the raw bytes of its log channel")?,
    );
    let (summary, files) = hysteron::capture::capture(&image, &log)?;
    desk.folder(
        out,
        &files
            .iter()
            .map(|(name, _)| name.clone())
            .collect::<Vec<_>>(),
    )?;
    for (name, bytes) in &files {
        desk.write(&out.join(name), bytes)?;
    }
    for (file, samples) in &summary.records {
        println!("{}: {samples} samples", out.join(file).display());
    }
    if summary.gaps > 0 || summary.damaged > 0 || summary.lost_on_target > 0 {
        println!(
            "Not whole: {} gaps, {} damaged frames, {} ticks lost on the target; what is between them was kept.",
            summary.gaps, summary.damaged, summary.lost_on_target
        );
    }
    println!("Next: hysteron explain {}", as_argument(out));
    Ok(true)
}
