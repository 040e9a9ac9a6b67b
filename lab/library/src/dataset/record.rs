//! One record: drive and displacement, sample by sample, with what is known about them.

use crate::statistics::peak_to_peak;
use hysteron_sim::chain::{Drive, InitialState};
use hysteron_sim::effect::AuxiliarySignal;
use hysteron_sim::intersample::Intersample;
use std::ops::Range;

/// What a record is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Deserialize, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Role {
    /// Parameters are estimated from it.
    Identify,
    /// Never fitted; judges what was fitted.
    Validate,
    /// Rest at constant drive: shows the noise.
    Noise,
    /// Takes part in nothing; judged once, at the end.
    Test,
}

impl Role {
    /// The name in files.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Role::Identify => "identify",
            Role::Validate => "validate",
            Role::Noise => "noise",
            Role::Test => "test",
        }
    }
}

/// Steady-state periods inside a record, in samples.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Periods {
    /// First sample of the first period.
    pub from: usize,
    /// Samples in a period.
    pub length: usize,
    /// Whole periods.
    pub count: usize,
}

/// A drive that is to be played.
#[derive(Clone, Debug, Default)]
pub struct PlayedDrive {
    /// What it is called.
    pub file: String,
    /// Time of the first sample, s.
    pub start_s: f64,
    /// Sampling rate, Hz.
    pub sample_rate_hz: f64,
    /// Drive, V.
    pub drive_v: Vec<f64>,
    /// Readings beside it, um, where it is a recording.
    pub reading_um: Option<Vec<f64>>,
    /// External force beside it, N, where it was measured.
    pub force_n: Option<Vec<f64>>,
    /// Further signals beside it.
    pub auxiliary: Vec<AuxiliarySignal>,
    /// What was assumed and mended.
    pub notes: Vec<String>,
}

impl PlayedDrive {
    /// The drive by the rows of its file, with the signals beside it.
    #[must_use]
    pub fn rows(&self) -> Drive<'_> {
        Drive {
            force_n: self.force_n.as_deref(),
            auxiliary: &self.auxiliary,
            ..Drive::held(
                &self.drive_v,
                1.0 / self.sample_rate_hz,
                InitialState::Virgin,
            )
        }
    }
}

/// One record.
#[derive(Clone, Debug)]
pub struct Record {
    /// Its name, unlike that of any other record of the data set.
    pub name: String,
    /// Where it came from, for messages: a file, or the name.
    pub source: String,
    /// Sampling rate.
    pub sample_rate_hz: f64,
    /// What it is for.
    pub role: Role,
    /// State at the first sample.
    pub initial_state: InitialState,
    /// Samples that count.
    pub window: Range<usize>,
    /// Samples that do not, in front of the window and behind it too: their readings say nothing of the
    /// displacement, because the sensor's range ends there (checks find them), or they belong to another record
    /// of the same tape. Ascending.
    pub left_out: Vec<Range<usize>>,
    /// Steady-state periods, if it has any.
    pub periods: Option<Periods>,
    /// Name of the record with the same drive.
    pub repeat_of: Option<String>,
    /// A constant is estimated for this record.
    pub offset_is_fitted: bool,
    /// Samples from which on the readings stand higher or lower, by what is estimated: its sensor slipped.
    pub steps_at: Vec<usize>,
    /// Nobody specified the state at the first sample: the drive stands still there, so rest is assumed, and
    /// a fit with an unknown state checks it.
    pub state_is_assumed: bool,
    /// What the drive does between samples.
    pub intersample: Intersample,
    /// Drive at every sample.
    pub drive_v: Vec<f64>,
    /// Measured displacement, um.
    pub displacement_um: Vec<f64>,
    /// Measured external force, N.
    pub force_n: Option<Vec<f64>>,
    /// Further signals, for effects of the user's own.
    pub auxiliary: Vec<AuxiliarySignal>,
}

impl Record {
    /// A record to be fitted, all of it, from an unknown state and with a constant of its own.
    #[must_use]
    pub fn new(
        name: impl Into<String>,
        sample_rate_hz: f64,
        drive_v: Vec<f64>,
        displacement_um: Vec<f64>,
    ) -> Self {
        let name = name.into();
        Self {
            source: name.clone(),
            name,
            sample_rate_hz,
            role: Role::Identify,
            initial_state: InitialState::Unknown,
            window: 0..drive_v.len(),
            left_out: Vec::new(),
            periods: None,
            repeat_of: None,
            offset_is_fitted: true,
            steps_at: Vec::new(),
            state_is_assumed: false,
            intersample: Intersample::Hold,
            drive_v,
            displacement_um,
            force_n: None,
            auxiliary: Vec::new(),
        }
    }

    /// The same record for another purpose.
    #[must_use]
    pub fn with_role(self, role: Role) -> Self {
        Self { role, ..self }
    }

    /// The same record from an actuator that had never been driven, its sensor zeroed there.
    #[must_use]
    pub fn from_virgin_state(self) -> Self {
        Self {
            initial_state: InitialState::Virgin,
            offset_is_fitted: false,
            ..self
        }
    }

    /// Sampling period, s.
    #[must_use]
    pub fn dt_s(&self) -> f64 {
        1.0 / self.sample_rate_hz
    }

    /// Drive up to the end of the window, as the chain takes it: what comes later acts on no sample that
    /// counts.
    #[must_use]
    pub fn drive(&self) -> Drive<'_> {
        let end = self.window.end;
        Drive {
            drive_v: &self.drive_v[..end],
            force_n: self.force_n.as_ref().map(|force_n| &force_n[..end]),
            ..self.whole_drive()
        }
    }

    /// Drive from the first sample of the file to its last.
    #[must_use]
    pub fn whole_drive(&self) -> Drive<'_> {
        Drive {
            drive_v: &self.drive_v,
            force_n: self.force_n.as_deref(),
            auxiliary: &self.auxiliary,
            dt_s: self.dt_s(),
            initial_state: self.initial_state,
            intersample: self.intersample,
        }
    }

    /// Leaves samples out of what counts, beside those that are left out already.
    pub fn leave_out(&mut self, ranges: impl IntoIterator<Item = Range<usize>>) {
        self.left_out.extend(ranges);
        self.left_out.sort_by_key(|range| range.start);
        self.left_out = std::mem::take(&mut self.left_out)
            .into_iter()
            .filter(|range| !range.is_empty())
            .fold(Vec::new(), |mut out, range| {
                match out
                    .last_mut()
                    .filter(|last: &&mut Range<usize>| range.start <= last.end)
                {
                    Some(last) => last.end = last.end.max(range.end),
                    None => out.push(range),
                }
                out
            });
    }

    /// What is left out inside the window.
    pub fn left_out_in_window(&self) -> impl Iterator<Item = Range<usize>> + '_ {
        let Range { start, end } = self.window;
        self.left_out
            .iter()
            .map(move |range| range.start.max(start)..range.end.min(end))
            .filter(|range| !range.is_empty())
    }

    /// Whether the reading of a sample inside the window says something of the displacement.
    #[must_use]
    pub fn counts(&self, sample: usize) -> bool {
        let before = self.left_out.partition_point(|range| range.end <= sample);
        self.left_out
            .get(before)
            .is_none_or(|range| sample < range.start)
    }

    /// The samples inside the window whose readings say something of the displacement.
    pub fn counted(&self) -> impl Iterator<Item = usize> + '_ {
        self.window.clone().filter(|k| self.counts(*k))
    }

    /// Peak-to-peak displacement inside the window, um.
    #[must_use]
    pub fn range_um(&self) -> f64 {
        peak_to_peak(&self.displacement_um[self.window.clone()])
    }
}
