//! One estimate of the noise, and what it rests on.

use serde::Serialize;

/// What an estimate of the noise rests on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum FloorEvidence {
    /// A record at rest.
    RestRecord,
    /// Equal periods inside a record.
    Periods,
    /// Records with the same drive.
    Repeats,
    /// A hold inside a record.
    Hold,
    /// Readings above everything that the drive excites: a lower bound.
    HighBand,
}

impl FloorEvidence {
    /// It was taken while the actuator moved.
    pub(super) fn under_drive(self) -> bool {
        matches!(self, Self::Periods | Self::Repeats)
    }

    fn words(self, records: &[String]) -> String {
        let records = records.join(" and ");
        match self {
            Self::RestRecord => format!("rest record {records}"),
            Self::Periods => format!("repeated periods of {records}"),
            Self::Repeats => format!("repeated records {records}"),
            Self::Hold => format!("a hold in {records}"),
            Self::HighBand => format!("the readings of {records} above the drive's band"),
        }
    }
}

/// One estimate of the floor.
#[derive(Clone, Debug, Serialize)]
pub struct FloorEstimate {
    /// What it rests on, in words.
    pub basis: String,
    /// The same as a kind.
    pub evidence: FloorEvidence,
    /// The records that it comes from.
    pub records: Vec<String>,
    /// RMS, um.
    pub rms_um: f64,
    /// Its standard deviation where the noise is white, um.
    pub std_um: f64,
}

impl FloorEstimate {
    pub(super) fn new(
        evidence: FloorEvidence,
        records: Vec<String>,
        rms_um: f64,
        samples: usize,
    ) -> Self {
        Self {
            basis: evidence.words(&records),
            evidence,
            records,
            rms_um,
            std_um: rms_um / (2.0 * samples.max(1) as f64).sqrt(),
        }
    }
}
