//! The report of a reproduction: every printed result with ours beside it, then the figures of every chapter.

use crate::chapter::Chapter;
use crate::scoreboard::{ScoreRow, Value, counts, met_on_reference, totals};
use hysteron_report::{Page, PageBlock, Section, Table, Tone};
use serde::Serialize;

/// What `hysteron reproduce --json` writes.
#[derive(Clone, Debug, Serialize)]
pub struct ReproduceFile {
    /// `hysteron.reproduce/1`.
    pub schema: String,
    /// Every printed result that is computed, and all other figures.
    pub rows: Vec<ScoreRow>,
}

impl ReproduceFile {
    /// Of these rows.
    #[must_use]
    pub fn of(rows: Vec<ScoreRow>) -> Self {
        Self {
            schema: "hysteron.reproduce/1".into(),
            rows,
        }
    }
}

/// A figure with three significant digits, in the unit's own size.
#[must_use]
pub fn figure(value: f64) -> String {
    if value == 0.0 {
        return "0".into();
    }
    let digits = (2 - value.abs().log10().floor() as i32).clamp(0, 6) as usize;
    format!("{value:.digits$}")
}

/// The same of one that may be missing.
#[must_use]
pub fn number(value: Option<f64>) -> String {
    value.map_or_else(|| "-".into(), figure)
}

/// The same of a number or a pole.
#[must_use]
pub fn value(value: Option<Value>) -> String {
    match value {
        None => "-".into(),
        Some(Value::Number(value)) => figure(value),
        Some(Value::Pair([re, im])) => format!("{re:.1}{im:+.1}i"),
    }
}

/// A printed table with ours: of every result the printed value and ours by the algorithm as printed, by an
/// improved procedure and by our own.
#[derive(Clone, Debug)]
pub struct PrintedTable {
    /// Its name in the thesis.
    pub title: String,
    /// One line a printed result.
    pub lines: Vec<TableLine>,
}

/// A line of a [`PrintedTable`].
#[derive(Clone, Debug)]
pub struct TableLine {
    /// Algorithm, condition and quantity.
    pub what: [String; 3],
    /// Printed; as printed without and with the thesis' noise; as the sensor reads it; as printed on the
    /// bench of domains; improved; our own.
    pub numbers: [String; 7],
    /// Unit.
    pub unit: String,
    /// Whether the algorithm as printed reaches the printed value.
    pub met: bool,
    /// Why not, or what has to be known.
    pub reason: Option<String>,
}

/// Headings of the numbers of a line.
pub const NUMBERS: [&str; 7] = [
    "thesis",
    "as printed",
    "with noise",
    "sensor",
    "domains",
    "improved",
    "ours",
];

/// The first words of a text, up to a comma or a bracket.
fn short(text: &str) -> String {
    text.split(['(', ','])
        .next()
        .unwrap_or(text)
        .trim()
        .to_owned()
}

/// Our figure for a row by another procedure: `.improved` or `.ours`.
fn by_procedure(rows: &[ScoreRow], row: &ScoreRow, suffix: &str) -> Option<Value> {
    let id = format!("{}{suffix}", row.id);
    rows.iter().find(|r| r.id == id).and_then(|r| r.ours)
}

/// The tables of the thesis, in its order.
#[must_use]
pub fn tables(rows: &[ScoreRow]) -> Vec<PrintedTable> {
    let mut out: Vec<PrintedTable> = Vec::new();
    for row in rows.iter().filter(|row| counts(row)) {
        let line = TableLine {
            what: [
                short(&row.algorithm),
                row.condition.clone(),
                row.quantity.clone(),
            ],
            numbers: [
                value(row.thesis),
                value(row.printed_algorithm),
                number(row.with_noise),
                number(row.sensor),
                value(row.on_domains),
                value(by_procedure(rows, row, ".improved")),
                value(by_procedure(rows, row, ".ours")),
            ],
            unit: row.unit.clone(),
            met: row.met == Some(true),
            reason: row.reason.clone(),
        };
        match out.iter_mut().find(|table| table.title == row.table) {
            Some(table) => table.lines.push(line),
            None => out.push(PrintedTable {
                title: row.table.clone(),
                lines: vec![line],
            }),
        }
    }
    out
}

/// A row for each printed result, as a table of text; figures with six digits.
#[must_use]
pub fn rows_as_csv(rows: &[ScoreRow]) -> String {
    let six = |v: f64| {
        format!("{v:.5e}")
            .parse::<f64>()
            .map_or_else(|_| v.to_string(), |v| v.to_string())
    };
    let number = |v: Option<f64>| v.map_or_else(String::new, six);
    let value = |v: Option<Value>| match v {
        None => String::new(),
        Some(Value::Number(v)) => six(v),
        Some(Value::Pair([re, im])) => {
            format!("{}{}{}i", six(re), if im < 0.0 { "" } else { "+" }, six(im))
        }
    };
    let met = |met: Option<bool>| met.map_or("", |met| if met { "met" } else { "missed" });
    let mut out = String::from(
        "id,thesis,as_printed,with_noise,sensor,domains,improved,ours,unit,met,met_on_reference,reason\n",
    );
    for row in rows.iter().filter(|row| counts(row)) {
        let reason = row
            .reason
            .as_deref()
            .filter(|_| row.met == Some(false))
            .unwrap_or_default();
        let cells = [
            row.id.clone(),
            value(row.thesis),
            value(row.printed_algorithm),
            number(row.with_noise),
            number(row.sensor),
            value(row.on_domains),
            value(by_procedure(rows, row, ".improved")),
            value(by_procedure(rows, row, ".ours")),
            row.unit.clone(),
            met(row.met).into(),
            met(row.met_on_reference).into(),
            if reason.contains([',', '"']) {
                format!("\"{}\"", reason.replace('"', "\"\""))
            } else {
                reason.into()
            },
        ];
        out.push_str(&cells.join(","));
        out.push('\n');
    }
    out
}

/// What the counts say, in a sentence.
#[must_use]
pub fn totals_in_words(rows: &[ScoreRow]) -> String {
    let (covered, met, missed) = totals(rows);
    let improved = rows
        .iter()
        .filter(|row| row.id.ends_with(".improved") && row.met == Some(true))
        .count();
    let ours = rows
        .iter()
        .filter(|row| row.id.ends_with(".ours") && row.met == Some(true))
        .count();
    let reference = met_on_reference(rows).map_or_else(String::new, |met| {
        format!(" (on the reference bench {met})")
    });
    format!(
        "Of {covered} printed results the algorithms as printed reach {met}{reference} and miss {missed}; improved procedures reach {improved}, our own {ours}."
    )
}

/// The page with every figure of the chapters, whose rows these are.
#[must_use]
pub fn page(chapters: &[Chapter], rows: &[ScoreRow]) -> Page {
    let (_, _, missed) = totals(rows);
    let of_thesis = tables(rows).into_iter().map(|table| {
        let columns: Vec<String> =
            ["algorithm", "condition", "quantity"].iter().chain(&NUMBERS).chain(&["unit", "reason"]).map(|c| (*c).to_owned()).collect();
        PageBlock::Table(Table {
            title: table.title,
            columns,
            highlighted_rows: table.lines.iter().enumerate().filter(|(_, line)| !line.met).map(|(k, _)| k).collect(),
            rows: table
                .lines
                .into_iter()
                .map(|line| {
                    let mut cells = line.what.to_vec();
                    cells.extend(line.numbers);
                    cells.extend([line.unit, line.reason.unwrap_or_default()]);
                    cells
                })
                .collect(),
            caption: "Rows that miss the printed value are set off. As printed: the thesis' algorithm, errors of the true displacement; with noise: the same with the thesis' sensor noise in every record, which then decides. Domains: the same algorithm on the bench of other equations, which decides where it was played.".into(),
        })
    });
    let mut others = Table {
        title: "All other figures".into(),
        columns: ["figure", "true", "sensor", "unit", "how"]
            .map(String::from)
            .to_vec(),
        ..Table::default()
    };
    for row in rows.iter().filter(|row| row.thesis.is_none()) {
        others.rows.push(vec![
            row.id.clone(),
            value(row.ours),
            number(row.sensor),
            row.unit.clone(),
            row.algorithm.clone(),
        ]);
    }
    let scoreboard = Section {
        heading: "The printed results".into(),
        text: String::new(),
        blocks: of_thesis.chain([PageBlock::Table(others)]).collect(),
    };
    let sections: Vec<Section> = std::iter::once(scoreboard)
        .chain(chapters.iter().flat_map(|c| c.sections.clone()))
        .collect();
    Page {
        title: "Hysteron: the thesis reproduced".into(),
        lead_sentence: totals_in_words(rows),
        tone: if missed == 0 {
            Tone::Good
        } else {
            Tone::Attention
        },
        facts: vec![(
            "Chapters".into(),
            chapters
                .iter()
                .map(|c| c.number.to_string())
                .collect::<Vec<_>>()
                .join(", "),
        )],
        sections,
        footer: vec![format!(
            "hysteron {}, hysteron reproduce",
            env!("CARGO_PKG_VERSION")
        )],
        ..Page::default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::chapter::ChapterRow;
    use crate::scoreboard::{cells, score};

    #[test]
    fn a_missed_result_is_set_off_with_its_reason() {
        let of = |ours: f64| {
            let rows = vec![ChapterRow::new("ch6.pid_thesis.10hz.rms", ours, "um", "")];
            let cells: Vec<_> = cells()
                .unwrap()
                .into_iter()
                .filter(|c| c.id == "ch6.table1.pid.10hz.rms")
                .collect();
            tables(&score(
                &[Chapter {
                    number: 6,
                    rows,
                    ..Chapter::default()
                }],
                &cells,
            ))
        };
        let missed = of(0.5);
        assert_eq!(
            (missed[0].title.as_str(), missed[0].lines[0].met),
            ("Ch. 6, Table I", false)
        );
        assert_eq!(
            missed[0].lines[0].numbers[..2],
            ["0.0230".to_owned(), "0.500".to_owned()]
        );
        assert!(of(0.02)[0].lines[0].met);
    }

    #[test]
    fn a_row_of_the_table_of_text_has_its_reason_in_quotes() {
        let rows = vec![ChapterRow::new("ch6.pid_thesis.10hz.rms", 0.5, "um", "")];
        let mut cells: Vec<_> = cells()
            .unwrap()
            .into_iter()
            .filter(|c| c.id == "ch6.table1.pid.10hz.rms")
            .collect();
        cells[0].missed_because = Some("too slow, as printed".into());
        let text = rows_as_csv(&score(
            &[Chapter {
                number: 6,
                rows,
                ..Chapter::default()
            }],
            &cells,
        ));
        let line = text.lines().nth(1).unwrap();
        assert!(
            line.starts_with(
                "ch6.table1.pid.10hz.rms,0.023,0.5,,,,,,um,missed,,\"too slow, as printed\""
            ),
            "{text}"
        );
    }

    #[test]
    fn figures_keep_three_digits() {
        assert_eq!(figure(0.0013354), "0.00134");
        assert_eq!(figure(482.3), "482");
        assert_eq!(figure(-0.25), "-0.250");
        assert_eq!(value(Some(Value::Pair([-38.79, 5193.6]))), "-38.8+5193.6i");
    }
}
