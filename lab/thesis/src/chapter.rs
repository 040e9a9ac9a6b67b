//! What reproducing a chapter gives: figures with their identifiers, and sections of a page.

use hysteron_report::{Notes, Section, Tone};

/// A run on the bench: what was played or followed, and the seed of its noise.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct RunKey {
    /// Drive or reference, with its rate.
    pub drive: String,
    /// Seed of the sensor's noise.
    pub seed: u64,
}

impl RunKey {
    /// A run.
    pub fn new(drive: impl Into<String>, seed: u64) -> Self {
        Self {
            drive: drive.into(),
            seed,
        }
    }
}

/// An error with what the sensor reads of it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ErrorPair {
    /// Of the true displacement.
    pub truth: f64,
    /// As the sensor reads it, noise removed.
    pub sensor: f64,
}

/// One figure of the reproduction.
#[derive(Clone, Debug, PartialEq)]
pub struct ChapterRow {
    /// Identifier.
    pub id: String,
    /// Error of the true displacement, where `ours` is that of what the sensor reads: a sensor that is late
    /// shows another one.
    pub truth: Option<f64>,
    /// What was measured here; an error, as the sensor reads it.
    pub ours: f64,
    /// The largest error of the same run, where `ours` is an RMS error.
    pub max: Option<ErrorPair>,
    /// Unit.
    pub unit: String,
    /// How it was obtained, in a sentence.
    pub note: String,
    /// The run that it is judged on; none for a figure that no run of the bench gave.
    pub run: Option<RunKey>,
}

impl ChapterRow {
    /// A figure.
    pub fn new(id: impl Into<String>, ours: f64, unit: &str, note: impl Into<String>) -> Self {
        Self {
            id: id.into(),
            truth: None,
            ours,
            max: None,
            unit: unit.into(),
            note: note.into(),
            run: None,
        }
    }

    /// The same with the run that it is judged on.
    #[must_use]
    pub fn on(self, drive: impl Into<String>, seed: u64) -> Self {
        Self {
            run: Some(RunKey::new(drive, seed)),
            ..self
        }
    }
}

/// What one chapter gave.
#[derive(Clone, Debug, Default)]
pub struct Chapter {
    /// Number of the chapter.
    pub number: u32,
    /// Figures.
    pub rows: Vec<ChapterRow>,
    /// Sections of a report page, figures of the thesis with ours.
    pub sections: Vec<Section>,
    /// Runs by which gains, orders or ways of estimating were chosen.
    pub choices: Vec<RunKey>,
}

/// Tells how far a long run is.
pub type ChapterProgress<'a> = &'a dyn Fn(&str);

/// A list of remarks about the printed source and what was done about each.
#[must_use]
pub fn errata(items: &[&str]) -> Notes {
    Notes {
        title: "Printed source and what was done about it".into(),
        items: items.iter().map(|s| (*s).to_owned()).collect(),
        tone: Tone::Attention,
    }
}
