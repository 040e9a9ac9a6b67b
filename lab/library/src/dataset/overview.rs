//! What a data set says before anything is fitted: its remarks, and what starts and bounds follow from.

use super::data_set::Dataset;
use super::drive_variety::DriveVariety;
use super::issue_words::sentence;
use super::record::{Record, Role};
use hysteron_sim::effect::Overview;

impl Dataset {
    /// Notes and issues, in sentences.
    #[must_use]
    pub fn remarks(&self) -> Vec<String> {
        self.notes
            .iter()
            .cloned()
            .chain(self.issues.iter().map(sentence))
            .collect()
    }

    /// What is known before anything is fitted.
    #[must_use]
    pub fn overview(&self) -> Overview {
        let identify = self.with_role(Role::Identify);
        let fitted = if identify.is_empty() {
            self.with_role(Role::Validate)
        } else {
            identify
        };
        let driven = || {
            self.records
                .iter()
                .filter(|r| r.role != Role::Noise && r.role != Role::Test)
        };
        let fold = |f: &dyn Fn(&Record) -> f64| driven().map(f).fold(0.0_f64, f64::max);
        let slope = |r: &Record| {
            r.drive_v
                .windows(2)
                .map(|w| (w[1] - w[0]).abs())
                .fold(0.0, f64::max)
                * r.sample_rate_hz
        };
        let range_um = fold(&Record::range_um);
        Overview {
            drive_min_v: self.drive_min_v,
            drive_max_v: self.drive_max_v,
            drive_peak_v: driven()
                .flat_map(|r| r.drive_v.iter().copied())
                .fold(self.drive_min_v, f64::max),
            sample_rate_max_hz: fold(&|r| r.sample_rate_hz),
            sample_rate_min_hz: driven()
                .map(|r| r.sample_rate_hz)
                .fold(f64::INFINITY, f64::min),
            duration_s: fold(&|r| r.drive_v.len() as f64 / r.sample_rate_hz),
            range_um,
            slope_max_v_s: fold(&slope),
            has_force: driven().any(|r| r.force_n.is_some()),
            gain_um_v: self.straight_line_gain(),
            sensor_bandwidth_hz: self.sensor_bandwidth_hz,
            // Held-out records may move at other speeds; without any, one speed says nothing about the
            // others.
            several_speeds: !self.with_role(Role::Validate).is_empty()
                && !self.with_role(Role::Identify).is_empty()
                || !DriveVariety::of(self, &fitted).one_speed(),
        }
    }
}
