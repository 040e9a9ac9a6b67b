//! `reproduce`.

use crate::arguments::{Benches, Outputs};
use crate::desk::Desk;
use crate::progress::Progress;
use hysteron::{Error, Result};
use hysteron_thesis::overview::{
    NUMBERS, PrintedTable, ReproduceFile, page, rows_as_csv, tables, totals_in_words,
};
use hysteron_thesis::scoreboard::{ScoreRow, cells, score, score_both, totals};
use hysteron_thesis::{CHAPTERS, Chapter, PlayedOn, chapter};
use std::io::IsTerminal;
use std::path::Path;

/// The benches of the request, in the order of the rows' columns.
fn played_on(benches: Benches) -> Vec<PlayedOn> {
    match benches {
        Benches::Both => PlayedOn::BOTH.to_vec(),
        Benches::Reference => vec![PlayedOn::Reference],
        Benches::Domains => vec![PlayedOn::Domains],
    }
}

/// Columns of a printed table.
fn print(table: &PrintedTable) {
    println!("\n{}", table.title);
    let cut = |text: &str, width: usize| text.chars().take(width).collect::<String>();
    println!(
        "  {:34}{:30}{:32}{}",
        "algorithm",
        "condition",
        "quantity",
        NUMBERS.map(|name| format!("{name:>12}")).concat()
    );
    let red = std::io::stdout().is_terminal();
    for line in &table.lines {
        let [algorithm, condition, quantity] = &line.what;
        let text = format!(
            "  {:34}{:30}{:32}{} {}{}",
            cut(algorithm, 33),
            cut(condition, 29),
            cut(quantity, 31),
            line.numbers
                .each_ref()
                .map(|number| format!("{number:>12}"))
                .concat(),
            line.unit,
            if line.met { "" } else { "  MISSED" }
        );
        if line.met || !red {
            println!("{text}");
        } else {
            println!("\x1b[31m{text}\x1b[0m");
        }
    }
    let mut reasons: Vec<&str> = table
        .lines
        .iter()
        .filter(|line| !line.met)
        .filter_map(|line| line.reason.as_deref())
        .collect();
    reasons.dedup();
    for reason in reasons {
        println!("    missed: {reason}");
    }
}

/// Reproduces chapters of the thesis on simulated benches; false if an algorithm as printed misses a printed
/// result.
pub fn reproduce(
    numbers: &[u32],
    benches: Benches,
    csv: Option<&Path>,
    outputs: &Outputs,
) -> Result<bool> {
    let desk = Desk::new(outputs.force);
    outputs.check(&desk)?;
    desk.target(csv)?;
    let numbers: Vec<u32> = if numbers.is_empty() {
        CHAPTERS.to_vec()
    } else {
        numbers.to_vec()
    };
    if let Some(unknown) = numbers.iter().find(|n| !CHAPTERS.contains(n)) {
        return Err(Error::new(
            "chapter",
            format!("{unknown} has nothing to reproduce; expected some of {CHAPTERS:?}"),
        ));
    }
    let cells = cells().map_err(|e| Error::new("printed.toml", e))?;
    let played_on = played_on(benches);
    // For each bench its chapters; of one bench or of both.
    let mut chapters: Vec<Vec<Chapter>> = vec![Vec::new(); played_on.len()];
    let rows_of = |of: &[&[Chapter]]| -> Vec<ScoreRow> {
        match of {
            [reference, domains] => score_both(reference, domains, &cells),
            one => one
                .iter()
                .flat_map(|chapters| score(chapters, &cells))
                .collect(),
        }
    };
    for nth in numbers {
        for (on, done) in played_on.iter().zip(&mut chapters) {
            let progress = Progress::start();
            let say = |message: &str| progress.say(&format!("{message} ({})", on.name()));
            done.push(
                chapter(nth, *on, &say)
                    .map_err(|e| Error::new(format!("chapter {nth}, bench {}", on.name()), e))?,
            );
        }
        let newest: Vec<&[Chapter]> = chapters
            .iter()
            .map(|done| &done[done.len() - 1..])
            .collect();
        tables(&rows_of(&newest)).iter().for_each(print);
    }
    let rows = rows_of(&chapters.iter().map(Vec::as_slice).collect::<Vec<_>>());
    println!("\n{}", totals_in_words(&rows));
    let (_, _, missed) = totals(&rows);
    desk.write_json(outputs.json.as_deref(), &ReproduceFile::of(rows.clone()))?;
    if let Some(path) = csv {
        desk.write(path, rows_as_csv(&rows).as_bytes())?;
    }
    if let Some(path) = &outputs.report {
        desk.write_page(Some(path), || page(&chapters[0], &rows))?;
        println!("look at {}", path.display());
    } else {
        println!("every figure with ours drawn in: add --report FILE.html");
    }
    Ok(missed == 0)
}
