//! `reproduce`.

use crate::command_line::Outputs;
use crate::desk::Desk;
use crate::progress::Progress;
use hysteron::{Error, Result};
use hysteron_thesis::overview::{ReproduceFile, compare, number, page};
use hysteron_thesis::{CHAPTERS, Chapter, chapter, goals};

/// Reproduces chapters of the thesis on the bench; false if a goal is missed.
pub fn reproduce(numbers: &[u32], outputs: &Outputs) -> Result<bool> {
    let desk = Desk::new(outputs.force);
    outputs.check(&desk)?;
    let numbers: Vec<u32> = if numbers.is_empty() { CHAPTERS.to_vec() } else { numbers.to_vec() };
    if let Some(unknown) = numbers.iter().find(|n| !CHAPTERS.contains(n)) {
        return Err(Error::new("chapter", format!("{unknown} has nothing to reproduce; expected some of {CHAPTERS:?}")));
    }
    let goals = goals().map_err(|e| Error::new("goals.toml", e))?;
    let mut chapters: Vec<Chapter> = Vec::new();
    for nth in numbers {
        let progress = Progress::start();
        let done = chapter(nth, &|message| progress.say(message)).map_err(|e| Error::new(format!("chapter {nth}"), e))?;
        drop(progress);
        chapters.push(done);
        println!("chapter {nth}{:42}{:>10}{:>10}{:>10}{:>10}", "", "thesis", "goal", "true", "ours");
        // True: the error of the displacement itself, where ours is that of the reading.
        for c in compare(&chapters[chapters.len() - 1..], &goals) {
            let mark = if c.met() { "" } else { "  missed" };
            println!(
                "  {:48}{:>10}{:>10}{:>10}{:>10} {}{mark}",
                c.goal.id,
                number(c.goal.thesis),
                number(c.goal.goal),
                number(c.truth),
                number(c.ours),
                c.goal.unit
            );
        }
    }
    let comparisons = compare(&chapters, &goals);
    let met = comparisons.iter().filter(|c| c.met()).count();
    println!("{met} of {} figures at or below their goal", comparisons.len());
    let all_met = met == comparisons.len();
    desk.write_json(outputs.json.as_deref(), &ReproduceFile::of(&chapters))?;
    if let Some(path) = &outputs.report {
        desk.write_page(Some(path), || page(chapters, &goals))?;
        println!("look at {}", path.display());
    } else {
        println!("every figure with ours drawn in: add --report FILE.html");
    }
    Ok(all_met)
}
