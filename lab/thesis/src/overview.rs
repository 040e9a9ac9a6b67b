//! The report of a reproduction: figures beside those of the thesis and the goals, then the figures of every chapter.

use super::{Chapter, Goal, Row};
use hysteron_report::{Block, Page, Section, Table, Tone};
use serde::Serialize;

/// What `hysteron reproduce --json` writes.
#[derive(Clone, Debug, Serialize)]
pub struct ReproduceFile {
    /// `hysteron.reproduce/1`.
    pub schema: String,
    /// All figures.
    pub rows: Vec<Row>,
}

impl ReproduceFile {
    /// The figures of some chapters.
    #[must_use]
    pub fn of(chapters: &[Chapter]) -> Self {
        Self { schema: "hysteron.reproduce/1".into(), rows: chapters.iter().flat_map(|c| c.rows.clone()).collect() }
    }
}

/// A goal with what was reached.
#[derive(Clone, Debug)]
pub struct Comparison<'a> {
    /// The line of the goals' file.
    pub goal: &'a Goal,
    /// The error of the true displacement, where ours is an error that the sensor reads.
    pub truth: Option<f64>,
    /// What was measured here; nothing if the figure is missing.
    pub ours: Option<f64>,
}

impl Comparison<'_> {
    /// Reached, or there is nothing to reach.
    #[must_use]
    pub fn met(&self) -> bool {
        match (self.ours, self.goal.goal) {
            (Some(ours), Some(goal)) => ours <= goal,
            (Some(_), None) => true,
            (None, _) => false,
        }
    }
}

/// Every line of the goals' file for the given chapters.
#[must_use]
pub fn compare<'a>(chapters: &[Chapter], goals: &'a [Goal]) -> Vec<Comparison<'a>> {
    goals
        .iter()
        .filter(|g| chapters.iter().any(|c| c.number == g.chapter))
        .map(|goal| {
            let row = chapters.iter().flat_map(|c| &c.rows).find(|r| r.id == goal.id);
            Comparison { goal, truth: row.and_then(|r| r.truth), ours: row.map(|r| r.ours) }
        })
        .collect()
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

/// The page with every figure of the chapters.
#[must_use]
pub fn page(chapters: Vec<Chapter>, goals: &[Goal]) -> Page {
    let comparisons = compare(&chapters, goals);
    let met = comparisons.iter().filter(|c| c.met()).count();
    let table = Table {
        title: "Ours beside the thesis".into(),
        columns: ["figure", "condition", "thesis", "goal", "true", "ours", "unit"].map(String::from).to_vec(),
        rows: comparisons
            .iter()
            .map(|c| {
                vec![
                    format!("Ch. {}: {}", c.goal.chapter, c.goal.item),
                    c.goal.condition.clone(),
                    number(c.goal.thesis),
                    number(c.goal.goal),
                    number(c.truth),
                    number(c.ours),
                    c.goal.unit.clone(),
                ]
            })
            .collect(),
        highlighted_rows: comparisons.iter().enumerate().filter(|(_, c)| !c.met()).map(|(k, _)| k).collect(),
        caption: "Rows that miss their goal are set off. Errors of ours are of what the sensor reads, noise removed, as the thesis has them; true: of the displacement itself, which a late sensor does not show.".into(),
    };
    let all = met == comparisons.len();
    let mut others = Table {
        title: "All other figures".into(),
        columns: ["figure", "true", "ours", "unit", "how"].map(String::from).to_vec(),
        ..Table::default()
    };
    for row in chapters.iter().flat_map(|c| &c.rows).filter(|r| !goals.iter().any(|g| g.id == r.id)) {
        others.rows.push(vec![row.id.clone(), number(row.truth), figure(row.ours), row.unit.clone(), row.note.clone()]);
    }
    let mut sections: Vec<Section> = chapters.iter().flat_map(|c| c.sections.clone()).collect();
    sections.push(Section {
        heading: "Figures and goals".into(),
        text: String::new(),
        blocks: vec![Block::Table(table), Block::Table(others)],
    });
    Page {
        title: "Hysteron: the thesis reproduced".into(),
        lead_sentence: format!("{met} of {} figures are at or below their goal.", comparisons.len()),
        tone: if all { Tone::Good } else { Tone::Attention },
        facts: vec![("Chapters".into(), chapters.iter().map(|c| c.number.to_string()).collect::<Vec<_>>().join(", "))],
        sections,
        footer: vec![format!("hysteron {}, hysteron reproduce", env!("CARGO_PKG_VERSION"))],
        ..Page::default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_missing_or_missed_figure_is_not_met() {
        let goals = crate::goals().unwrap();
        let chapter = Chapter { number: 3, rows: vec![Row::new("ch3.erms", 0.5, "um", "")], sections: Vec::new() };
        assert!(compare(std::slice::from_ref(&chapter), &goals).iter().all(Comparison::met));
        let missed = Chapter { rows: vec![Row::new("ch3.erms", 0.7, "um", "")], ..chapter.clone() };
        assert!(!compare(&[missed], &goals)[0].met());
        assert!(!compare(&[Chapter { rows: Vec::new(), ..chapter }], &goals)[0].met());
    }

    #[test]
    fn figures_keep_three_digits() {
        assert_eq!(figure(0.0013354), "0.00134");
        assert_eq!(figure(482.3), "482");
        assert_eq!(figure(-0.25), "-0.250");
    }
}
