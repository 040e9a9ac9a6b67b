//! The thesis' experiments, played on the reference bench and identified from what the sensor read.
//!
//! # How it works
//! Each chapter is a module with one function that plays the experiments as the thesis describes them, identifies the models from those
//! noisy records, and hands back a [`Chapter`]: figures with their identifiers (those of `goals.toml`) and the sections of a report page.
//! Nothing here knows what would be a good figure; goals and the thesis' own figures are read from `goals.toml` for the report only.
//!
//! The constants of the bench are used by the simulation alone ([`hysteron_sim::bench`]); an identification sees only records, the
//! sampling rate and the limits of the drive.

mod chapter_3;
mod chapter_4;
mod chapter_5;
pub mod coverage;
pub mod least_squares;
pub mod overview;
pub mod surface_fit;

use crate::report::{Notes, Section, Tone};
use serde::{Deserialize, Serialize};

/// One figure of the reproduction.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Row {
    /// Identifier, that of `goals.toml` where it is listed there.
    pub id: String,
    /// What was measured here.
    pub ours: f64,
    /// Unit.
    pub unit: String,
    /// How it was obtained, in a sentence.
    pub note: String,
}

impl Row {
    /// A figure.
    pub fn new(id: impl Into<String>, ours: f64, unit: &str, note: impl Into<String>) -> Self {
        Self { id: id.into(), ours, unit: unit.into(), note: note.into() }
    }
}

/// What one chapter gave.
#[derive(Clone, Debug, Default)]
pub struct Chapter {
    /// Number of the chapter.
    pub number: u32,
    /// Figures.
    pub rows: Vec<Row>,
    /// Sections of a report page, figures of the thesis with ours.
    pub sections: Vec<Section>,
}

/// One line of `goals.toml`.
#[derive(Clone, Debug, PartialEq, Deserialize)]
pub struct Goal {
    /// Identifier.
    pub id: String,
    /// Chapter.
    pub chapter: u32,
    /// What is measured.
    pub item: String,
    /// Under which condition.
    pub condition: String,
    /// The author's measurement.
    pub thesis: Option<f64>,
    /// Ours should be at or below it.
    pub goal: Option<f64>,
    /// Unit.
    pub unit: String,
}

#[derive(Deserialize)]
struct Goals {
    row: Vec<Goal>,
}

/// The built-in goals, for tables that stand ours beside the thesis'.
///
/// # Errors
/// If the built-in file cannot be read, which a test excludes.
pub fn goals() -> Result<Vec<Goal>, toml::de::Error> {
    Ok(toml::from_str::<Goals>(include_str!("../../goals.toml"))?.row)
}

/// Tells how far a long run is.
pub type Progress<'a> = &'a dyn Fn(&str);

/// Chapters that can be reproduced here.
pub const CHAPTERS: [u32; 5] = [3, 4, 5, 6, 7];

/// Reproduces one chapter.
///
/// # Errors
/// A message if the chapter is not known or an identification fails.
pub fn chapter(number: u32, progress: Progress) -> Result<Chapter, String> {
    match number {
        3 => chapter_3::reproduce(progress),
        4 => chapter_4::reproduce(progress),
        5 => chapter_5::reproduce(progress),
        6 => crate::servo::reproduce::chapter_6(progress),
        7 => crate::servo::reproduce::chapter_7(progress),
        _ => Err(format!("chapter {number} has nothing to reproduce: choose from {CHAPTERS:?}")),
    }
}

/// A list of remarks about the printed source and what was done about each.
fn errata(items: &[&str]) -> Notes {
    Notes {
        title: "Printed source and what was done about it".into(),
        items: items.iter().map(|s| (*s).to_owned()).collect(),
        tone: Tone::Attention,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn goals_are_readable_and_unique() {
        let goals = goals().unwrap();
        let mut ids: Vec<_> = goals.iter().map(|g| g.id.clone()).collect();
        ids.sort();
        ids.dedup();
        assert_eq!(ids.len(), goals.len());
        assert!(goals.iter().any(|g| g.id == "ch3.erms"));
    }
}
