//! Units that look doubtful: spans and rates that no piezoelectric stage has.

use crate::dataset::data_set::Dataset;
use crate::dataset::issue::{Issue, IssueKind, Severity};
use crate::dataset::record::{Record, Role};
use crate::dataset::units::SignalUnits;
use crate::statistics::peak_to_peak;

/// Span of a displacement in um beyond which a unit is likely to be missing.
const LIKELY_SPAN_MAX_UM: f64 = 2000.0;
/// The same of one that is too small.
const LIKELY_SPAN_MIN_UM: f64 = 1e-3;
/// Sampling rate below which the unit of time is likely to be missing.
const LIKELY_RATE_MIN_HZ: f64 = 50.0;

/// Gain in um/V beyond which a unit is likely to be missing: a millimetre for a command of ten volts is the
/// most that flexures make of a stack.
const LIKELY_GAIN_MAX_UM_V: f64 = 100.0;
/// The same of one that is too small: a single layer of soft ceramic shears by 1.1 nm/V, and a stage has many.
const LIKELY_GAIN_MIN_UM_V: f64 = 1e-3;

/// Examines every driven record.
pub(super) fn check(dataset: &Dataset) -> Vec<Issue> {
    // What is in other units than V and um is no piezoelectric stage.
    if dataset.units != SignalUnits::default() {
        return Vec::new();
    }
    let doubt = |record: &Record| {
        let span_um = record.range_um();
        let kind = if !(LIKELY_SPAN_MIN_UM..=LIKELY_SPAN_MAX_UM).contains(&span_um) {
            IssueKind::DisplacementUnit { span_um }
        } else if record.sample_rate_hz < LIKELY_RATE_MIN_HZ {
            IssueKind::TimeUnit {
                period_s: record.dt_s(),
            }
        } else {
            return None;
        };
        Some(Issue::of(&record.name, Severity::Notes, kind))
    };
    let driven = || dataset.records.iter().filter(|r| r.role != Role::Noise);
    let most = |of: fn(&Record) -> f64| driven().map(of).fold(0.0, f64::max);
    let drive_v = most(|r| peak_to_peak(&r.drive_v[r.window.clone()]));
    let slope_um_v = dataset.straight_line_gain();
    // A drive far above the first mode leaves little of the straight line, but not of the motion.
    let gain_um_v = if (0.0..LIKELY_GAIN_MIN_UM_V).contains(&slope_um_v) && drive_v > 0.0 {
        most(Record::range_um) / drive_v
    } else {
        slope_um_v
    };
    let lowest_um_v = if drive_v > 0.0 {
        LIKELY_GAIN_MIN_UM_V
    } else {
        0.0
    };
    let of_all = (!(lowest_um_v..=LIKELY_GAIN_MAX_UM_V).contains(&gain_um_v))
        .then(|| Issue::of_all(Severity::Notes, IssueKind::Gain { gain_um_v }));
    driven().filter_map(doubt).chain(of_all).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn doubted(to_v: f64, to_um: f64) -> bool {
        let drive_v: Vec<f64> = (0..2000)
            .map(|k| to_v * (50.0 - 40.0 * (0.01 * f64::from(k)).cos()))
            .collect();
        let displacement_um = drive_v.iter().map(|u| 0.26 * to_um / to_v * u).collect();
        let record = Record::new("one", 1000.0, drive_v, displacement_um);
        let found = check(&Dataset::unchecked("d", 0.0, 100.0, vec![record]));
        let is_gain = |issue: &Issue| matches!(issue.kind, IssueKind::Gain { .. });
        found.iter().any(is_gain)
    }

    #[test]
    fn a_gain_that_is_too_small_is_doubted_as_a_large_one_is() {
        // As recorded; displacement in mm and in nm; drive in mV, in kV, and in no unit of this world.
        for (to_v, to_um, expected) in [
            (1.0, 1.0, false),
            (1.0, 1e-3, true),
            (1.0, 1e3, true),
            (1e3, 1.0, true),
            (1e-3, 1.0, true),
            (1e-298, 1.0, true),
        ] {
            assert_eq!(doubted(to_v, to_um), expected, "{to_v} {to_um}");
        }
    }
}
