//! Ours beside every printed result that is computed here, each under the algorithm that it belongs to.
//!
//! # How it works
//! `printed.toml` lists the printed results with the identifiers of our figures: by the algorithm as printed,
//! by an improved procedure, by our own algorithm, and with the noise that the thesis states. A printed
//! result becomes one row for the algorithm as printed, which alone decides whether it is met, and one row
//! each for the others. Errors of a servo are those of the true displacement; what the sensor reads stands
//! beside.
//!
//! Where the chapters were played on the bench of domains as well, that one decides: its plant is not the
//! model that the algorithms assume.

use crate::chapter::{Chapter, ChapterRow};
use serde::{Deserialize, Serialize};
use std::collections::HashMap;

/// A number, or a pole as real and imaginary part.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum Value {
    /// A number.
    Number(f64),
    /// Real and imaginary part.
    Pair([f64; 2]),
}

impl Value {
    /// The number, or the magnitude of the pair.
    #[must_use]
    pub fn number(self) -> f64 {
        match self {
            Self::Number(value) => value,
            Self::Pair([re, im]) => re.hypot(im),
        }
    }

    fn is_finite(self) -> bool {
        self.number().is_finite()
    }
}

/// When a printed result is met.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Judge {
    /// Ours is at or below it.
    AtMost,
    /// Ours is at or above it.
    AtLeast,
    /// The magnitude of ours is at or below its own.
    MagnitudeAtMost,
    /// Ours is within the cell's tolerance.
    Near,
}

/// A printed result.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ScoreboardCell {
    /// Identifier.
    pub id: String,
    /// Chapter.
    pub chapter: u32,
    /// Table or section.
    pub table: String,
    /// The algorithm that it belongs to.
    pub algorithm: String,
    /// Under which condition.
    pub condition: String,
    /// What is printed.
    pub quantity: String,
    /// Its value.
    pub value: Value,
    /// Its unit.
    pub unit: String,
    /// When it is met.
    pub judge: Judge,
    /// Tolerance of [`Judge::Near`]: half the last printed digit.
    #[serde(default)]
    pub within: f64,
    /// Our figure by the algorithm as printed.
    pub printed: Option<String>,
    /// The largest of these figures in the place of one.
    #[serde(default)]
    pub worst_of: Vec<String>,
    /// A percentage of this.
    pub per_cent_of: Option<f64>,
    /// Our figure by an improved procedure.
    pub improved: Option<String>,
    /// Our figure by our own algorithm.
    pub ours: Option<String>,
    /// Our figure by the algorithm as printed, with the thesis' noise of the sensor.
    pub with_noise: Option<String>,
    /// What a reader has to know of the comparison although it is met.
    pub caution: Option<String>,
    /// Why it is missed.
    pub missed_because: Option<String>,
}

#[derive(Deserialize)]
struct Cells {
    cell: Vec<ScoreboardCell>,
}

/// The printed results.
///
/// # Errors
/// If the built-in file cannot be read, which a test excludes.
pub fn cells() -> Result<Vec<ScoreboardCell>, toml::de::Error> {
    Ok(toml::from_str::<Cells>(include_str!("../printed.toml"))?.cell)
}

/// A row of the scoreboard.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ScoreRow {
    /// Identifier: that of the printed result, with `.improved` or `.ours` behind it for another algorithm;
    /// or that of another figure.
    pub id: String,
    /// The algorithm that gave ours.
    pub algorithm: String,
    /// Table or section of the thesis.
    #[serde(skip_serializing_if = "String::is_empty")]
    pub table: String,
    /// Condition.
    #[serde(skip_serializing_if = "String::is_empty")]
    pub condition: String,
    /// What it is.
    #[serde(skip_serializing_if = "String::is_empty")]
    pub quantity: String,
    /// The printed value.
    pub thesis: Option<Value>,
    /// Ours by the algorithm as printed.
    pub printed_algorithm: Option<Value>,
    /// Ours by the row's own algorithm, where that is another one; beside a printed result our best.
    pub ours: Option<Value>,
    /// Unit.
    pub unit: String,
    /// The row's figure on the bench of domains, where that was played: what is judged then.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub on_domains: Option<Value>,
    /// Whether the printed value is reached; none where nothing is printed. On the bench of domains, where
    /// that was played.
    pub met: Option<bool>,
    /// The same on the reference bench, where both were played.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub met_on_reference: Option<bool>,
    /// Why it is missed, or what has to be known although it is met.
    pub reason: Option<String>,
    /// The same error as the sensor reads it, noise removed.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sensor: Option<f64>,
    /// By the algorithm as printed with the thesis' noise of the sensor in every record; `printed_algorithm`
    /// is without.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub with_noise: Option<f64>,
}

/// A figure: its value, what the sensor reads, how it was obtained.
struct Figure<'a> {
    value: f64,
    sensor: Option<f64>,
    unit: &'a str,
    note: &'a str,
}

/// All figures by their identifiers; the largest error of a run has that of its RMS error with another
/// ending.
struct Figures<'a>(HashMap<&'a str, &'a ChapterRow>);

impl<'a> Figures<'a> {
    fn of(chapters: &'a [Chapter]) -> Self {
        Self(
            chapters
                .iter()
                .flat_map(|c| &c.rows)
                .map(|row| (row.id.as_str(), row))
                .collect(),
        )
    }

    fn get(&self, id: &str) -> Option<Figure<'a>> {
        if let Some(row) = self.0.get(id) {
            let sensor = row.truth.map(|_| row.ours);
            return Some(Figure {
                value: row.truth.unwrap_or(row.ours),
                sensor,
                unit: &row.unit,
                note: &row.note,
            });
        }
        let row = self
            .0
            .get(format!("{}.rms", id.strip_suffix(".max")?).as_str())?;
        let max = row.max?;
        Some(Figure {
            value: max.truth,
            sensor: Some(max.sensor),
            unit: &row.unit,
            note: &row.note,
        })
    }

    /// A figure; a pole stands as two.
    fn value(&self, id: &str) -> Option<(Value, Option<f64>, &'a str)> {
        if let Some(found) = self.get(id) {
            return Some((Value::Number(found.value), found.sensor, found.note));
        }
        let (re, im) = (
            self.get(&format!("{id}.re"))?,
            self.get(&format!("{id}.im"))?,
        );
        Some((Value::Pair([re.value, im.value]), None, re.note))
    }
}

impl ScoreboardCell {
    fn is_met(&self, value: Value) -> bool {
        let (ours, printed) = (value.number(), self.value.number());
        match self.judge {
            Judge::AtMost => ours <= printed,
            Judge::AtLeast => ours >= printed,
            Judge::MagnitudeAtMost => ours.abs() <= printed.abs(),
            Judge::Near => match (value, self.value) {
                (Value::Pair([a, b]), Value::Pair([c, d])) => {
                    (a - c).abs().max((b - d).abs()) <= self.within
                }
                _ => (ours - printed).abs() <= self.within,
            },
        }
    }

    fn as_printed(&self, figures: &Figures<'_>) -> Option<(Value, Option<f64>)> {
        if let Some(id) = &self.printed {
            return figures.value(id).map(|(value, sensor, _)| (value, sensor));
        }
        let all: Option<Vec<f64>> = self
            .worst_of
            .iter()
            .map(|id| figures.get(id).map(|f| f.value))
            .collect();
        let worst = all?.into_iter().fold(f64::NEG_INFINITY, f64::max);
        Some((Value::Number(100.0 * worst / self.per_cent_of?), None))
    }

    fn row(&self, suffix: &str, algorithm: &str) -> ScoreRow {
        ScoreRow {
            id: format!("{}{suffix}", self.id),
            algorithm: algorithm.into(),
            table: self.table.clone(),
            condition: self.condition.clone(),
            quantity: self.quantity.clone(),
            thesis: Some(self.value),
            printed_algorithm: None,
            ours: None,
            unit: self.unit.clone(),
            on_domains: None,
            met: None,
            met_on_reference: None,
            reason: None,
            sensor: None,
            with_noise: None,
        }
    }

    fn rows(&self, figures: &Figures<'_>) -> Vec<ScoreRow> {
        let mut main = self.row("", &self.algorithm);
        let printed = self.as_printed(figures);
        main.printed_algorithm = printed.map(|(value, _)| value);
        main.sensor = printed.and_then(|(_, sensor)| sensor);
        main.with_noise = self
            .with_noise
            .as_ref()
            .and_then(|id| figures.get(id))
            .map(|f| f.value);
        // The thesis never says that noise was removed: where it states its noise, that is what is judged.
        let judged = main
            .with_noise
            .map(Value::Number)
            .or(main.printed_algorithm);
        let met = judged.is_some_and(|value| value.is_finite() && self.is_met(value));
        main.met = Some(met);
        main.reason = if met {
            self.caution.clone()
        } else {
            self.missed_because.clone().or_else(|| self.caution.clone())
        };
        let mut out = Vec::new();
        for (suffix, id) in [(".improved", &self.improved), (".ours", &self.ours)] {
            let Some((value, sensor, note)) = id.as_ref().and_then(|id| figures.value(id)) else {
                continue;
            };
            let mut row = self.row(suffix, note);
            (row.ours, row.sensor) = (Some(value), sensor);
            row.met = Some(value.is_finite() && self.is_met(value));
            main.ours = Some(value);
            out.push(row);
        }
        out.insert(0, main);
        out
    }
}

/// The rows of some chapters: every printed result, and every other figure.
#[must_use]
pub fn score(chapters: &[Chapter], cells: &[ScoreboardCell]) -> Vec<ScoreRow> {
    let figures = Figures::of(chapters);
    let here = |cell: &&ScoreboardCell| chapters.iter().any(|c| c.number == cell.chapter);
    let mut out: Vec<ScoreRow> = cells
        .iter()
        .filter(here)
        .flat_map(|cell| cell.rows(&figures))
        .collect();
    for row in chapters.iter().flat_map(|c| &c.rows) {
        let Some(found) = figures.get(&row.id) else {
            continue;
        };
        let plain = |id: String, f: &Figure<'_>| ScoreRow {
            id,
            algorithm: f.note.to_owned(),
            table: String::new(),
            condition: String::new(),
            quantity: String::new(),
            thesis: None,
            printed_algorithm: None,
            ours: Some(Value::Number(f.value)),
            unit: f.unit.to_owned(),
            on_domains: None,
            met: None,
            met_on_reference: None,
            reason: None,
            sensor: f.sensor,
            with_noise: None,
        };
        out.push(plain(row.id.clone(), &found));
        let of_max = row
            .id
            .strip_suffix(".rms")
            .map(|stem| format!("{stem}.max"));
        if let Some((id, max)) =
            of_max.and_then(|id| row.max.and_then(|_| figures.get(&id)).map(|max| (id, max)))
        {
            out.push(plain(id, &max));
        }
    }
    out
}

/// Why a result that is met on the reference bench may be missed on the other.
const NOT_THE_MODEL: &str =
    "Met on the reference bench. The bench of domains follows other equations than the model does.";

/// The rows of chapters that were played on both benches, judged on the bench of domains.
#[must_use]
pub fn score_both(
    reference: &[Chapter],
    domains: &[Chapter],
    cells: &[ScoreboardCell],
) -> Vec<ScoreRow> {
    let others: HashMap<String, ScoreRow> = score(domains, cells)
        .into_iter()
        .map(|row| (row.id.clone(), row))
        .collect();
    let judged = |mut row: ScoreRow| {
        let other = others.get(&row.id);
        row.on_domains = other.and_then(|o| {
            o.with_noise.map(Value::Number).or(if counts(o) {
                o.printed_algorithm
            } else {
                o.ours
            })
        });
        if row.thesis.is_some() {
            row.met_on_reference = row.met;
            let met = other.and_then(|o| o.met).unwrap_or(false);
            row.reason = match (met, row.met) {
                (true, _) => other.and_then(|o| o.reason.clone()),
                (false, Some(true)) => Some(NOT_THE_MODEL.into()),
                (false, _) => row.reason.take(),
            };
            row.met = Some(met);
        }
        row
    };
    score(reference, cells).into_iter().map(judged).collect()
}

/// Whether a row is that of the algorithm as printed, which alone counts.
#[must_use]
pub fn counts(row: &ScoreRow) -> bool {
    row.thesis.is_some() && !row.id.ends_with(".improved") && !row.id.ends_with(".ours")
}

/// Printed results covered, met and missed.
#[must_use]
pub fn totals(rows: &[ScoreRow]) -> (usize, usize, usize) {
    let printed: Vec<&ScoreRow> = rows.iter().filter(|row| counts(row)).collect();
    let met = printed.iter().filter(|row| row.met == Some(true)).count();
    (printed.len(), met, printed.len() - met)
}

/// Printed results met on the reference bench, where both were played.
#[must_use]
pub fn met_on_reference(rows: &[ScoreRow]) -> Option<usize> {
    let printed: Option<Vec<bool>> = rows
        .iter()
        .filter(|row| counts(row))
        .map(|row| row.met_on_reference)
        .collect();
    printed.map(|met| met.into_iter().filter(|met| *met).count())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn chapter(rows: Vec<ChapterRow>) -> Chapter {
        Chapter {
            number: 6,
            rows,
            ..Chapter::default()
        }
    }

    #[test]
    fn the_printed_results_are_readable_unique_and_name_a_figure() {
        let cells = cells().unwrap();
        let mut ids: Vec<_> = cells.iter().map(|c| c.id.clone()).collect();
        ids.sort();
        ids.dedup();
        assert_eq!(ids.len(), cells.len());
        for cell in &cells {
            assert!(
                cell.printed.is_some() == cell.worst_of.is_empty(),
                "{}",
                cell.id
            );
            assert!(
                cell.value.is_finite() && !cell.algorithm.is_empty(),
                "{}",
                cell.id
            );
        }
    }

    #[test]
    fn only_the_algorithm_as_printed_meets_a_printed_result() {
        let cells: Vec<ScoreboardCell> = cells()
            .unwrap()
            .into_iter()
            .filter(|c| c.id == "ch6.table1.sm_ab.10hz.rms")
            .collect();
        let run = |as_printed: f64, tuned: f64| {
            let rows = vec![
                ChapterRow::new("ch6.sm_ab_thesis.10hz.rms", as_printed, "um", ""),
                ChapterRow::new("ch6.sm_ab.10hz.rms", tuned, "um", "tuned"),
            ];
            score(&[chapter(rows)], &cells)
        };
        let missed = run(0.9, 0.1);
        assert_eq!(
            (missed[0].met, missed[1].id.as_str(), missed[1].met),
            (
                Some(false),
                "ch6.table1.sm_ab.10hz.rms.improved",
                Some(true)
            )
        );
        assert!(missed[0].reason.is_some(), "a miss has its reason");
        assert_eq!(totals(&missed), (1, 0, 1));
        assert_eq!(totals(&run(0.4, 9.0)), (1, 1, 0));
    }

    #[test]
    fn the_bench_of_domains_decides_where_both_were_played() {
        let cells: Vec<ScoreboardCell> = cells()
            .unwrap()
            .into_iter()
            .filter(|c| c.id == "ch6.table1.sm_ab.10hz.rms")
            .collect();
        let run = |um: f64| {
            [chapter(vec![ChapterRow::new(
                "ch6.sm_ab_thesis.10hz.rms",
                um,
                "um",
                "",
            )])]
        };
        let (low, high) = (run(0.1), run(0.9));
        let missed = score_both(&low, &high, &cells);
        assert_eq!(
            (
                missed[0].met,
                missed[0].met_on_reference,
                missed[0].on_domains
            ),
            (Some(false), Some(true), Some(Value::Number(0.9)))
        );
        assert_eq!(missed[0].reason.as_deref(), Some(NOT_THE_MODEL));
        assert_eq!(
            (totals(&missed), met_on_reference(&missed)),
            ((1, 0, 1), Some(1))
        );
        let met = score_both(&high, &low, &cells);
        assert_eq!(
            (
                met[0].met,
                met[0].met_on_reference,
                met[0].printed_algorithm
            ),
            (Some(true), Some(false), Some(Value::Number(0.9)))
        );
        assert_eq!(met_on_reference(&score(&low, &cells)), None);
    }

    #[test]
    fn the_true_error_counts_and_a_largest_error_is_found_beside_its_rms() {
        let cells: Vec<ScoreboardCell> = cells()
            .unwrap()
            .into_iter()
            .filter(|c| c.id.starts_with("ch6.table1.pidsm_ab.10hz."))
            .collect();
        let row = ChapterRow {
            truth: Some(0.1),
            max: Some(ErrorPair {
                truth: 0.05,
                sensor: 0.2,
            }),
            ..ChapterRow::new("ch6.pidsm_ab.10hz.rms", 0.001, "um", "")
        };
        let rows = score(&[chapter(vec![row])], &cells);
        assert_eq!(
            (rows[0].printed_algorithm, rows[0].sensor, rows[0].met),
            (Some(Value::Number(0.1)), Some(0.001), Some(false))
        );
        assert_eq!(
            (rows[1].printed_algorithm, rows[1].sensor, rows[1].met),
            (Some(Value::Number(0.05)), Some(0.2), Some(true))
        );
    }

    use crate::chapter::ErrorPair;
}
