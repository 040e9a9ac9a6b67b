//! What reproducing a chapter gives: figures with the identifiers of `goals.toml`, and sections of a page.

use hysteron_report::{Notes, Section, Tone};
use serde::Serialize;

/// One figure of the reproduction.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Row {
    /// Identifier, that of `goals.toml` where it is listed there.
    pub id: String,
    /// Error of the true displacement, where `ours` is that of what the sensor reads: a sensor that is late shows another one.
    #[serde(rename = "true", skip_serializing_if = "Option::is_none")]
    pub truth: Option<f64>,
    /// What was measured here; an error, as the sensor reads it.
    pub ours: f64,
    /// Unit.
    pub unit: String,
    /// How it was obtained, in a sentence.
    pub note: String,
}

impl Row {
    /// A figure.
    pub fn new(id: impl Into<String>, ours: f64, unit: &str, note: impl Into<String>) -> Self {
        Self { id: id.into(), truth: None, ours, unit: unit.into(), note: note.into() }
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

/// Tells how far a long run is.
pub type Progress<'a> = &'a dyn Fn(&str);

/// A list of remarks about the printed source and what was done about each.
#[must_use]
pub fn errata(items: &[&str]) -> Notes {
    Notes {
        title: "Printed source and what was done about it".into(),
        items: items.iter().map(|s| (*s).to_owned()).collect(),
        tone: Tone::Attention,
    }
}
