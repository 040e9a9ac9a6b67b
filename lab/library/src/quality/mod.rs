//! The quality of a recording: what is wrong with how it was made, whatever the model.
//!
//! Every check is one file with one signature ([`Check`]). It gives [`Issue`]s: a kind with its figures, the
//! record, and what follows from it ([`Severity`]). [`words`] alone makes sentences of them.
//!
//! The same list of checks runs at every [`Moment`]: when a data set is made, before a search, and once after
//! it for those that need a model. Each check answers where it can. What a check at the end corrects goes
//! through one more search ([`corrected`]).

mod answer;
#[cfg(feature = "readers")]
mod answered_jumps;
mod as_specified;
mod between_samples;
mod closed_loop;
mod given_twice;
mod initial_state;
mod outliers;
mod range;
mod remembered_history;
mod rest;
mod sensor_offset;
mod timing;
mod units;
pub mod words;

#[cfg(feature = "readers")]
pub(crate) use answered_jumps::shown_by_readings;

use crate::dataset::Dataset;
use crate::diagnosis::judgement::Judged;
use crate::diagnosis::study::Study;
pub use crate::diagnosis::verdict::Reason;
use crate::error::{Error, Result};
use crate::identification::noise_floor::NoiseFloor;
use hysteron_sim::chain::InitialState;
use serde::Serialize;
use std::ops::Range;

/// What a check examines.
#[derive(Clone, Copy)]
pub struct Subject<'a> {
    /// The data set.
    pub dataset: &'a Dataset,
    /// When.
    pub moment: Moment<'a>,
}

/// When checks run.
#[derive(Clone, Copy)]
pub enum Moment<'a> {
    /// A data set is made.
    Made,
    /// Before anything is fitted.
    BeforeSearch,
    /// A prior model as it is.
    PriorModel(&'a Study<'a>, &'a Judged),
    /// The first fitted model.
    FirstFit(&'a Study<'a>, &'a Judged),
    /// After the search.
    End(&'a End<'a>),
}

/// What a search came to.
pub struct End<'a> {
    /// Fits other models to the same data.
    pub study: &'a Study<'a>,
    /// The noise.
    pub noise: &'a NoiseFloor,
    /// The model that the search started from.
    pub first: &'a Judged,
    /// The model at the end.
    pub last: &'a Judged,
    /// Effects that the search added.
    pub added: &'a [String],
}

/// A check of the quality.
pub type Check = fn(&Subject) -> Vec<Issue>;

/// All checks. Those that correct a data set when it is made stand in the order in which they must; of two
/// that explain the same error the simpler one stands first.
const CHECKS: [Check; 15] = [
    rest::check,
    outliers::single,
    range::check,
    outliers::together,
    units::check,
    given_twice::check,
    as_specified::check,
    answer::check,
    between_samples::check,
    timing::check,
    sensor_offset::check,
    initial_state::check,
    closed_loop::check,
    remembered_history::check,
    timing::leads_the_drive,
];

/// All issues at a moment; up to the first that asks for another search, after which all checks run again.
#[must_use]
pub fn issues(dataset: &Dataset, moment: Moment) -> Vec<Issue> {
    let mut out: Vec<Issue> = Vec::new();
    for check in CHECKS {
        out.extend(check(&Subject { dataset, moment }));
        if out.iter().any(Issue::asks_for_another_search) {
            break;
        }
    }
    out
}

/// Checks a data set that is being made: what can be corrected is, check after check.
///
/// # Errors
/// What the manifest specifies and the drive contradicts.
pub(crate) fn check_made(mut dataset: Dataset) -> Result<Dataset> {
    for check in CHECKS {
        let issues = check(&Subject {
            dataset: &dataset,
            moment: Moment::Made,
        });
        for issue in issues {
            if issue.severity == Severity::Blocks {
                let source = dataset
                    .records
                    .iter()
                    .find(|r| Some(&r.name) == issue.record.as_ref())
                    .map_or(&dataset.source, |r| &r.source);
                return Err(Error::new(source, words::of_kind(&issue.kind)));
            }
            apply(&mut dataset, &issue);
            dataset.issues.push(issue);
        }
    }
    Ok(dataset)
}

/// The data set with the issues of a finished search corrected: what one more search is for. None where
/// nothing can be.
#[must_use]
pub fn corrected(dataset: &Dataset, issues: &[Issue]) -> Option<Dataset> {
    let mut out = dataset.clone();
    for issue in issues
        .iter()
        .filter(|issue| issue.asks_for_another_search())
    {
        apply(&mut out, issue);
        out.issues.push(Issue {
            severity: Severity::Corrects,
            ..issue.clone()
        });
    }
    (out.issues.len() > dataset.issues.len()).then_some(out)
}

/// Changes a data set as an issue asks for.
fn apply(dataset: &mut Dataset, issue: &Issue) {
    let Dataset { records, .. } = dataset;
    let of_the_issue = records
        .iter_mut()
        .find(|r| Some(&r.name) == issue.record.as_ref());
    match (&issue.kind, of_the_issue) {
        (IssueKind::RestWithoutNoise { in_steps: false }, _) => {
            records.retain(|r| Some(&r.name) != issue.record.as_ref())
        }
        (IssueKind::OutliersReplaced { .. }, Some(record)) => {
            outliers::interpolate(record, &issue.samples);
            record.leave_out(issue.samples.iter().cloned());
        }
        (IssueKind::RangeEnds { .. } | IssueKind::OutliersLeftOut { .. }, Some(record)) => {
            record.leave_out(issue.samples.iter().cloned())
        }
        (IssueKind::SensorOffset { .. }, Some(record)) => record.offset_is_fitted = true,
        // All records of the tape begin in the same state.
        (IssueKind::InitialState { .. }, Some(record)) => {
            let source = record.source.clone();
            let of_the_tape = records
                .iter_mut()
                .filter(|r| r.state_is_assumed && r.source == source);
            of_the_tape.for_each(|r| r.initial_state = InitialState::Unknown);
        }
        (IssueKind::SameSampleTiming { .. }, _) => *dataset = dataset.in_own_rows(),
        (IssueKind::RunsOnBetweenSamples { intersample, .. }, _) => {
            *dataset = dataset.running_on(between_samples::named(intersample))
        }
        _ => {}
    }
}

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
    fn with_samples(self, samples: Vec<Range<usize>>) -> Self {
        Self { samples, ..self }
    }

    /// A search on corrected data may answer otherwise.
    #[must_use]
    pub fn asks_for_another_search(&self) -> bool {
        match self.kind {
            IssueKind::SameSampleTiming { .. }
            | IssueKind::SensorOffset { .. }
            | IssueKind::RunsOnBetweenSamples { .. } => self.severity != Severity::Corrects,
            // A state that somebody specified is not changed.
            IssueKind::InitialState { .. } => self.severity == Severity::Notes,
            _ => false,
        }
    }

    /// The reason for which nothing can be decided beside this issue.
    #[must_use]
    pub fn reason(&self) -> Option<Reason> {
        let reason = match self.kind {
            IssueKind::NotAnswered { .. } | IssueKind::NothingInCommon { .. } => {
                Reason::NotAnswered
            }
            IssueKind::InitialState { .. } => Reason::InitialState,
            IssueKind::SameSampleTiming { .. } => Reason::SameSampleTiming,
            IssueKind::RunsOnBetweenSamples { .. } => Reason::RunsOnBetweenSamples,
            _ => return None,
        };
        (self.severity == Severity::Blocks).then_some(reason)
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
