//! What is wrong with a recording, or may be, as types. [`super::issue_words`] alone makes sentences of them.

use serde::Serialize;
use std::ops::Range;

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
    pub kind: IssueKind,
    /// What follows from it.
    pub severity: Severity,
    /// The samples that it is about, which a correction leaves out.
    #[serde(skip)]
    pub samples: Vec<Range<usize>>,
}

/// Kinds of issues, each with its evidence.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(tag = "kind", content = "evidence", rename_all = "snake_case")]
pub enum IssueKind {
    /// The readings do not answer the drive.
    NotAnswered {
        /// RMS of the readings beside a drift, um.
        moves_um: f64,
        /// The largest coherence of drive and readings.
        coherence: f64,
        /// The coherence that chance reaches.
        by_chance: f64,
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
    /// The readings no longer follow the drive, in parts that are left out.
    NotFollowed {
        /// Where the first part begins, s.
        from_s: f64,
        /// Where it ends, s.
        to_s: f64,
        /// How many parts.
        parts: usize,
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
    /// The drive is not held between its samples.
    RunsOnBetweenSamples {
        /// What it does there.
        intersample: String,
        /// Error with a held drive, um.
        held_um: f64,
        /// Error of the same effects with this one, um.
        runs_on_um: f64,
    },
    /// The readings themselves show that they respond to the drive of the same row.
    TimingInReadings {
        /// Jumps of the drive that the readings answer in their row; none where a straight line shows it.
        jumps: Option<usize>,
    },
    /// The readings alone suggest the timing of the same row, and the manifest specifies another.
    LeadsTheDrive {},
    /// The unit of the displacement is doubtful.
    DisplacementUnit {
        /// Peak to peak, um.
        span_um: f64,
    },
    /// The unit or the sign of drive or displacement is doubtful.
    Gain {
        /// Of a straight line, um/V.
        gain_um_v: f64,
    },
    /// A record that is not fitted answers its drive with another unit or sign.
    GainDiffers {
        /// Of a straight line, um/V.
        gain_um_v: f64,
        /// Of the fitted records, um/V.
        fitted_um_v: f64,
    },
    /// The drive of a record that is not fitted goes beyond the fitted ones.
    BeyondFitted {
        /// The lowest and the highest fitted drive, V.
        fitted_v: [f64; 2],
        /// Share of its samples there.
        share: f64,
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
    /// The reading jumps once and stays.
    SensorJump {
        /// Samples before it.
        sample: usize,
        /// When, s from the first sample.
        at_s: f64,
        /// By how much, um.
        by_um: f64,
    },
    /// Loops remember what was before the record.
    RememberedHistory {
        /// Until this time from the first sample, s.
        until_s: f64,
        /// How long the record goes on then, s.
        left_s: f64,
    },
    /// The model at the end takes nothing of the readings.
    NothingInCommon {
        /// Share of the squares that it takes of the record of which it takes most.
        share: f64,
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

impl Issue {
    /// An issue of one record.
    #[must_use]
    pub fn of(record: impl Into<String>, severity: Severity, kind: IssueKind) -> Self {
        Self {
            record: Some(record.into()),
            kind,
            severity,
            samples: Vec::new(),
        }
    }

    /// An issue of the data set.
    #[must_use]
    pub fn of_all(severity: Severity, kind: IssueKind) -> Self {
        Self {
            record: None,
            kind,
            severity,
            samples: Vec::new(),
        }
    }

    /// The same with the samples that it is about.
    pub(crate) fn with_samples(self, samples: Vec<Range<usize>>) -> Self {
        Self { samples, ..self }
    }

    /// A search on corrected data may answer otherwise.
    #[must_use]
    pub fn asks_for_another_search(&self) -> bool {
        match self.kind {
            IssueKind::SameSampleTiming { .. }
            | IssueKind::SensorJump { .. }
            | IssueKind::SensorOffset { .. }
            | IssueKind::RunsOnBetweenSamples { .. } => self.severity != Severity::Corrects,
            // A state that somebody specified is not changed.
            IssueKind::InitialState { .. } => self.severity == Severity::Notes,
            _ => false,
        }
    }

    /// By how much the error falls with what the issue suggests, um: the root of the difference of the mean
    /// squares. Effects that lower the held-out error by more than that stand beside the issue.
    #[must_use]
    pub fn effect_um(&self) -> Option<f64> {
        let fall = |before_um: f64, after_um: f64| {
            (before_um * before_um - after_um * after_um)
                .max(0.0)
                .sqrt()
        };
        match self.kind {
            IssueKind::SensorOffset {
                specified_um,
                fitted_um,
            } => Some(fall(specified_um, fitted_um)),
            IssueKind::InitialState {
                specified_um,
                unknown_um,
            } => Some(fall(specified_um, unknown_um)),
            IssueKind::SameSampleTiming {
                assumed_um,
                same_sample_um,
                ..
            } => Some(fall(assumed_um, same_sample_um)),
            IssueKind::RunsOnBetweenSamples {
                held_um,
                runs_on_um,
                ..
            } => Some(fall(held_um, runs_on_um)),
            _ => None,
        }
    }
}
