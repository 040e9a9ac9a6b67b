//! Units that look doubtful: spans and rates that no piezoelectric stage has.

use crate::dataset::data_set::Dataset;
use crate::dataset::issue::{Issue, IssueKind, Severity};
use crate::dataset::record::{Record, Role};
use crate::dataset::units::SignalUnits;

/// Span of a displacement in um beyond which a unit is likely to be missing.
const LIKELY_SPAN_MAX_UM: f64 = 2000.0;
/// The same of one that is too small.
const LIKELY_SPAN_MIN_UM: f64 = 1e-3;
/// Sampling rate below which the unit of time is likely to be missing.
const LIKELY_RATE_MIN_HZ: f64 = 50.0;

/// Gain in um/V beyond which a unit is likely to be missing: a millimetre for a command of ten volts is the
/// most that flexures make of a stack.
const LIKELY_GAIN_MAX_UM_V: f64 = 100.0;

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
    let gain_um_v = dataset.straight_line_gain();
    let of_all = (!(0.0..=LIKELY_GAIN_MAX_UM_V).contains(&gain_um_v))
        .then(|| Issue::of_all(Severity::Notes, IssueKind::Gain { gain_um_v }));
    dataset
        .records
        .iter()
        .filter(|r| r.role != Role::Noise)
        .filter_map(doubt)
        .chain(of_all)
        .collect()
}
