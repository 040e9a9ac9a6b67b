//! The quality of a recording: what is wrong with how it was made, whatever the model.
//!
//! Every check is one file and one function that gives [`Issue`]s: a kind with its figures, the record, and what follows from it ([`Severity`]).
//! [`words`] alone makes sentences of them.

pub mod words;

use serde::Serialize;

/// What follows from an issue.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Severity {
    /// Nothing is searched: the verdict is undecidable for this reason.
    Blocks,
    /// The data set was changed; the sentence says how to override that.
    Corrects,
    /// The reader should know.
    Notes,
}

/// One thing that is wrong with a recording, or may be.
///
/// In JSON: `{"record": ..., "kind": ..., "evidence": {...}, "severity": ...}`.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Issue {
    /// The record; none where it is the data set.
    pub record: Option<String>,
    /// What it is, with the figures that show it.
    #[serde(flatten)]
    pub kind: Kind,
    /// What follows from it.
    pub severity: Severity,
}

/// Kinds of issues, each with its evidence.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(tag = "kind", content = "evidence", rename_all = "snake_case")]
pub enum Kind {
    /// The readings do not answer the drive.
    NotAnswered {
        /// RMS of the readings beside a drift, um.
        moves_um: f64,
        /// Share of its square that goes with the drive.
        share: f64,
    },
    /// The range of the sensor or of its converter ends.
    RangeEnds {
        /// The reading at which it ends, um.
        reading_um: f64,
        /// It is the highest reading; the lowest otherwise.
        highest: bool,
        /// Readings there, which are left out.
        samples: usize,
        /// Share of the record.
        share: f64,
    },
    /// Single readings stand out and were replaced.
    OutliersReplaced {
        /// How many.
        samples: usize,
        /// The first, counted from 1.
        first_sample: usize,
        /// The largest distance from the neighbours, um.
        farthest_um: f64,
    },
    /// Several readings stand out together and are left out.
    OutliersLeftOut {
        /// How many.
        samples: usize,
        /// Places.
        places: usize,
        /// The first sample of the first place, counted from 1.
        first_sample: usize,
        /// The last sample of the first place.
        last_sample: usize,
    },
    /// So many readings stand out that they are no disturbances.
    OutliersKept {
        /// How many.
        samples: usize,
        /// The first, counted from 1.
        first_sample: usize,
    },
    /// The displacement responds to the drive of the same row (`hold_before_sample`).
    SameSampleTiming {
        /// Effects that are not needed with this timing.
        not_needed: Vec<String>,
        /// Error with the timing that was assumed, um.
        assumed_um: f64,
        /// Error with the drive of the same row, um.
        same_sample_um: f64,
    },
    /// The readings alone suggest the timing of the same row, and the manifest specifies another.
    LeadsTheDrive {},
    /// The unit of the displacement is doubtful.
    DisplacementUnit {
        /// Peak to peak, um.
        span_um: f64,
    },
    /// The unit of time is doubtful.
    TimeUnit {
        /// Between two samples, s.
        period_s: f64,
    },
    /// A record does not begin in the specified state.
    InitialState {
        /// Error from the specified state, um.
        specified_um: f64,
        /// Error of the same effects from an unknown state, um.
        unknown_um: f64,
    },
    /// The sensor's zero is off although the manifest specifies none.
    SensorOffset {
        /// Error without a constant, um.
        specified_um: f64,
        /// Error of the same effects with one, um.
        fitted_um: f64,
    },
    /// Loops remember what was before the record.
    RememberedHistory {
        /// Until this time from the first sample, s.
        until_s: f64,
    },
    /// A loop was closed while recording.
    ClosedLoop {
        /// The drive comes so many samples after the noise.
        later_samples: usize,
        /// Correlation of the innovations of both.
        correlation: f64,
        /// The largest at lags where only chance is left.
        by_chance: f64,
    },
    /// The readings are those of another record.
    GivenTwice {
        /// The other record.
        same_as: String,
    },
    /// All readings of a rest are one value.
    RestWithoutNoise {
        /// The readings are whole steps of a converter; otherwise the rest is left out.
        in_steps: bool,
    },
    /// No record is to be fitted: those to validate are.
    NothingJudges {},
    /// The manifest specifies a rest, and the drive moves.
    NotAtRest {
        /// By this much, V.
        moves_v: f64,
    },
    /// The manifest specifies periods, and they differ.
    PeriodsDiffer {
        /// The specified period, s.
        period_s: f64,
        /// RMS of the drive, V.
        drive_v: f64,
        /// RMS of the difference, V.
        differs_v: f64,
    },
    /// The manifest specifies a repeat, and the drives differ.
    RepeatDiffers {
        /// The record that is repeated.
        repeat_of: String,
        /// RMS of the drive, V.
        drive_v: f64,
        /// RMS of the difference, V.
        differs_v: f64,
    },
}

/// Why a verdict is undecidable.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Reason {
    /// Nothing in the data shows the noise.
    NoiseUnknown,
    /// The error is below the noise: one of them is wrong.
    BelowTheNoise,
    /// The readings do not answer the drive.
    NotAnswered,
    /// Records do not begin in the specified state.
    InitialState,
    /// The readings respond to the drive of the same row, and the search was not repeated with this timing.
    SameSampleTiming,
    /// Somebody stopped the search.
    Stopped,
    /// The time was over before the search was.
    OutOfTime,
}

impl Issue {
    /// An issue of one record.
    #[must_use]
    pub fn of(record: impl Into<String>, severity: Severity, kind: Kind) -> Self {
        Self { record: Some(record.into()), kind, severity }
    }

    /// The reason for which nothing can be decided beside this issue.
    #[must_use]
    pub fn reason(&self) -> Option<Reason> {
        let reason = match self.kind {
            Kind::NotAnswered { .. } => Reason::NotAnswered,
            Kind::InitialState { .. } => Reason::InitialState,
            Kind::SameSampleTiming { .. } => Reason::SameSampleTiming,
            _ => return None,
        };
        (self.severity == Severity::Blocks).then_some(reason)
    }

    /// By how much the error falls with what the issue suggests, um: the root of the difference of the mean squares. Effects that lower
    /// the held-out error by more than that stand beside the issue.
    #[must_use]
    pub fn effect_um(&self) -> Option<f64> {
        let fall = |before_um: f64, after_um: f64| (before_um * before_um - after_um * after_um).max(0.0).sqrt();
        match self.kind {
            Kind::SensorOffset { specified_um, fitted_um } => Some(fall(specified_um, fitted_um)),
            Kind::InitialState { specified_um, unknown_um } => Some(fall(specified_um, unknown_um)),
            Kind::SameSampleTiming { assumed_um, same_sample_um, .. } => Some(fall(assumed_um, same_sample_um)),
            _ => None,
        }
    }
}
