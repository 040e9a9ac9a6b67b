//! Where a model comes from: what its records were, how they were read, and how well its values are known.

use super::stage::FreeMotion;
use crate::intersample::Intersample;

/// The state of the actuator at the first sample of a record.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum InitialState {
    /// Never driven: all states zero at the lower limit of the drive.
    Virgin,
    /// At rest at the first drive value.
    Settled,
    /// Anything; slow states are estimated.
    Unknown,
}

/// What a model was identified from, and how well its values are known together.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Identified {
    /// The values, each by effect and parameter.
    pub values: Vec<(String, String)>,
    /// Lower triangular factor of their covariance in coordinates, by rows.
    pub factor: Vec<Vec<f64>>,
    /// The error that judged the model, um.
    pub error_um: f64,
    /// So many times the width that error and spread of the values make together hold 95 % of the samples that
    /// judged, to either side.
    pub band_95: f64,
    /// Share of the spread that these samples leave room for; zero where nobody looked.
    pub spread_share: f64,
    /// Longest record, s.
    pub seconds: f64,
    /// Lowest drive, V.
    pub low_v: f64,
    /// Highest drive, V.
    pub high_v: f64,
    /// Largest slope of the drive, V/s.
    pub slope_max_v_s: f64,
    /// How the records were read.
    pub recorded: Recorded,
}

/// How records were read, and how they begin.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Recorded {
    /// The data set.
    pub data_set: String,
    /// Date of the fit, as `2026-11-28`; empty where nobody noted it.
    pub fitted_on: String,
    /// Largest sampling rate, Hz.
    pub sample_rate_hz: f64,
    /// The drive of a row acts up to its sample, not from it on.
    pub hold_before_sample: bool,
    /// What the drive does between samples.
    pub intersample: Intersample,
    /// Step of the sensor, where a data sheet gives one, um.
    pub sensor_lsb_um: Option<f64>,
    /// How each file begins beside the model; the first one stands for drives that are none of them.
    pub starts: Vec<RecordStart>,
}

/// What the readings of one file have beside its model: the state at the first sample and a constant.
#[derive(Clone, Debug, PartialEq)]
pub struct RecordStart {
    /// Name of the file.
    pub file: String,
    /// The drive of its first sample, V.
    pub drive_v: f64,
    /// State at the first sample.
    pub state: InitialState,
    /// A constant was estimated.
    pub offset_is_fitted: bool,
    /// The constant, um.
    pub offset_um: f64,
    /// The constant where nothing moves at the start; none where nobody looked.
    pub at_rest: Option<OffsetAtRest>,
    /// Free motions, each with its cosine and its sine at the first sample, um.
    pub motions: Vec<(FreeMotion, [f64; 2])>,
}

/// The constant of a file beside motions that its states can have, for a drive that begins at rest elsewhere.
#[derive(Clone, Debug, PartialEq)]
pub struct OffsetAtRest {
    /// The constant, um.
    pub offset_um: f64,
    /// Its standard deviation beside the values of the model, um.
    pub std_um: f64,
    /// What it becomes more along each column of the covariance's factor, um; empty where nobody looked.
    pub moves_um: Vec<f64>,
}

impl RecordStart {
    /// A state in which nothing moves and the sensor reads what the model says.
    #[must_use]
    pub fn resting(state: InitialState, drive_v: f64) -> Self {
        Self {
            file: String::new(),
            drive_v,
            state,
            offset_is_fitted: false,
            offset_um: 0.0,
            at_rest: None,
            motions: Vec::new(),
        }
    }

    /// What it adds to a reading `seconds` behind the first sample, um.
    #[must_use]
    pub fn adds_um(&self, seconds: f64) -> f64 {
        let of_motion = |(motion, [cosine, sine]): &(FreeMotion, [f64; 2])| {
            let angle = motion.frequency_rad_s * seconds;
            (-motion.decay_per_s * seconds).exp() * (cosine * angle.cos() + sine * angle.sin())
        };
        self.offset_um + self.motions.iter().map(of_motion).sum::<f64>()
    }
}

impl InitialState {
    /// All of them with the names that files use.
    pub const NAMES: [(&'static str, Self); 3] = [
        ("virgin", Self::Virgin),
        ("settled", Self::Settled),
        ("unknown", Self::Unknown),
    ];

    /// The state of this name.
    #[must_use]
    pub fn named(name: &str) -> Option<Self> {
        let found = Self::NAMES.into_iter().find(|(known, _)| *known == name);
        found.map(|(_, state)| state)
    }

    /// The name that files use.
    #[must_use]
    pub fn name(self) -> &'static str {
        Self::NAMES[self as usize].0
    }
}
