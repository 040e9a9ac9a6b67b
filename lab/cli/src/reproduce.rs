//! `reproduce`.

use crate::arguments::Outputs;
use crate::desk::Desk;
use crate::progress::Progress;
use hysteron::{Error, Result};
use hysteron_thesis::overview::{NUMBERS, PrintedTable, ReproduceFile, page, tables, totals_in_words};
use hysteron_thesis::scoreboard::{cells, score, totals};
use hysteron_thesis::{CHAPTERS, Chapter, chapter};
use std::io::IsTerminal;

/// Columns of a printed table.
fn print(table: &PrintedTable) {
    println!("\n{}", table.title);
    let cut = |text: &str, width: usize| text.chars().take(width).collect::<String>();
    println!("  {:34}{:30}{:32}{}", "algorithm", "condition", "quantity", NUMBERS.map(|name| format!("{name:>12}")).concat());
    let red = std::io::stdout().is_terminal();
    for line in &table.lines {
        let [algorithm, condition, quantity] = &line.what;
        let text = format!(
            "  {:34}{:30}{:32}{} {}{}",
            cut(algorithm, 33),
            cut(condition, 29),
            cut(quantity, 31),
            line.numbers.each_ref().map(|number| format!("{number:>12}")).concat(),
            line.unit,
            if line.met { "" } else { "  MISSED" }
        );
        if line.met || !red {
            println!("{text}");
        } else {
            println!("\x1b[31m{text}\x1b[0m");
        }
    }
    let mut reasons: Vec<&str> = table.lines.iter().filter(|line| !line.met).filter_map(|line| line.reason.as_deref()).collect();
    reasons.dedup();
    for reason in reasons {
        println!("    missed: {reason}");
    }
}

/// Reproduces chapters of the thesis on the bench; false if an algorithm as printed misses a printed result.
pub fn reproduce(numbers: &[u32], outputs: &Outputs) -> Result<bool> {
    let desk = Desk::new(outputs.force);
    outputs.check(&desk)?;
    let numbers: Vec<u32> = if numbers.is_empty() { CHAPTERS.to_vec() } else { numbers.to_vec() };
    if let Some(unknown) = numbers.iter().find(|n| !CHAPTERS.contains(n)) {
        return Err(Error::new("chapter", format!("{unknown} has nothing to reproduce; expected some of {CHAPTERS:?}")));
    }
    let cells = cells().map_err(|e| Error::new("printed.toml", e))?;
    let mut chapters: Vec<Chapter> = Vec::new();
    for nth in numbers {
        let progress = Progress::start();
        let done = chapter(nth, &|message| progress.say(message)).map_err(|e| Error::new(format!("chapter {nth}"), e))?;
        drop(progress);
        chapters.push(done);
        tables(&score(&chapters[chapters.len() - 1..], &cells)).iter().for_each(print);
    }
    let rows = score(&chapters, &cells);
    println!("\n{}", totals_in_words(&rows));
    let (_, _, missed) = totals(&rows);
    desk.write_json(outputs.json.as_deref(), &ReproduceFile::of(&chapters, &cells))?;
    if let Some(path) = &outputs.report {
        desk.write_page(Some(path), || page(chapters, &cells))?;
        println!("look at {}", path.display());
    } else {
        println!("every figure with ours drawn in: add --report FILE.html");
    }
    Ok(missed == 0)
}
