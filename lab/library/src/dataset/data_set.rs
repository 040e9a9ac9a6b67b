//! The records of one actuator.

use super::issue::Issue;
use super::record::{Record, Role};
use super::timing::Timing;
use super::units::SignalUnits;

/// Records with the limits of the actuator they were taken on.
#[derive(Clone, Debug)]
pub struct Dataset {
    /// Name.
    pub name: String,
    /// Where it came from, for messages.
    pub source: String,
    /// Limits of the drive, V.
    pub drive_min_v: f64,
    /// Limits of the drive, V.
    pub drive_max_v: f64,
    /// Bandwidth of the sensor, if its data sheet gives one.
    pub sensor_bandwidth_hz: Option<f64>,
    /// Resolution of the sensor, if its data sheet gives one.
    pub sensor_lsb_um: Option<f64>,
    /// The records.
    pub records: Vec<Record>,
    /// Units of drive and reading, where they are not V and um.
    pub units: SignalUnits,
    /// Neither anybody nor the records themselves say whether the drive of a row acts before its reading or
    /// after it: the latter is assumed, and a delay counts from there.
    pub timing_is_assumed: bool,
    /// When the drive of a row acts in the files.
    pub timing: Timing,
    /// Nobody specified what the drive does between samples: a held one is assumed.
    pub intersample_is_assumed: bool,
    /// What a reader should know about how the data were read.
    pub notes: Vec<String>,
    /// What is wrong with the records; what could be corrected is.
    pub issues: Vec<Issue>,
}

/// Fewest samples of a record that say anything.
pub(crate) const SAMPLES_MIN: usize = 32;

impl Dataset {
    /// The same before anything is checked.
    pub(crate) fn unchecked(
        name: impl Into<String>,
        drive_min_v: f64,
        drive_max_v: f64,
        records: Vec<Record>,
    ) -> Self {
        let name = name.into();
        Self {
            source: name.clone(),
            name,
            drive_min_v,
            drive_max_v,
            sensor_bandwidth_hz: None,
            sensor_lsb_um: None,
            records,
            timing_is_assumed: false,
            timing: Timing::default(),
            intersample_is_assumed: false,
            units: SignalUnits::default(),
            notes: Vec::new(),
            issues: Vec::new(),
        }
    }

    /// Indices of the records with a role.
    #[must_use]
    pub fn with_role(&self, role: Role) -> Vec<usize> {
        (0..self.records.len())
            .filter(|&i| self.records[i].role == role)
            .collect()
    }

    /// Slope of drive and reading of what is fitted, um/V. A search takes another way where a single digit
    /// differs.
    pub(crate) fn straight_line_gain(&self) -> f64 {
        let to_fit = if self.with_role(Role::Identify).is_empty() {
            Role::Validate
        } else {
            Role::Identify
        };
        let fitted: Vec<&Record> = self.records.iter().filter(|r| r.role == to_fit).collect();
        straight_line(&fitted).gain_um_v
    }
}

/// Readings of which a straight line explains this share follow the drive slowly: no mode, no lag and no
/// filter decides what they do. With it no check of gains or of lost parts speaks of 24 independent stages
/// (`hysteron_tests::servo_study`), of whose wide-band records a light mode holds many ways.
pub(super) const FOLLOWS: f64 = 0.8;

/// The straight line through drive and readings of records.
pub(super) struct StraightLine {
    /// Its slope, um/V, zero without motion.
    pub(super) gain_um_v: f64,
    /// Share of the readings' squares about their means that it explains.
    pub(super) share: f64,
}

/// The straight line of records, the same to the last digit whatever their order.
pub(super) fn straight_line(records: &[&Record]) -> StraightLine {
    let mut records = records.to_vec();
    records.sort_by(|a, b| a.name.cmp(&b.name));
    let (mut uu, mut uy, mut yy) = (0.0, 0.0, 0.0);
    for record in records {
        // y[k] answers to u[k - 1].
        let rows: Vec<usize> = record.counted().filter(|k| *k > 0).collect();
        let n = rows.len().max(1) as f64;
        let mean_u = rows.iter().map(|&k| record.drive_v[k - 1]).sum::<f64>() / n;
        let mean_y = rows.iter().map(|&k| record.displacement_um[k]).sum::<f64>() / n;
        for &k in &rows {
            let (u, y) = (
                record.drive_v[k - 1] - mean_u,
                record.displacement_um[k] - mean_y,
            );
            uu += u * u;
            uy += u * y;
            yy += y * y;
        }
    }
    let moves = uu > 0.0 && yy > 0.0;
    StraightLine {
        gain_um_v: if uu > 0.0 { uy / uu } else { 0.0 },
        share: if moves { uy * uy / (uu * yy) } else { 0.0 },
    }
}
