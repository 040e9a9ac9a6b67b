//! Signals of a recording at even times.

use super::units::SignalUnits;
use crate::statistics::peak_to_peak;
use hysteron_sim::effect::AuxiliarySignal;
use std::ops::Range;

/// Signals at even times.
pub(super) struct Even {
    /// Samples per second.
    pub sample_rate_hz: f64,
    pub start_s: f64,
    pub u_v: Vec<f64>,
    pub y_um: Vec<f64>,
    pub force_n: Option<Vec<f64>>,
    pub auxiliary: Vec<AuxiliarySignal>,
    /// Samples that nobody recorded.
    pub bridged: Vec<Range<usize>>,
    pub units: SignalUnits,
    /// What was assumed and mended.
    pub notes: Vec<String>,
}

/// A drive is slow for its sampling rate where it moves by no more than this share of its range between two
/// samples that are kept. A turn between them is missed by half of that; loops, a tenth as wide as the range,
/// then err by 5e-5 of it, 1 nm of 20 um.
const SLOW: f64 = 1e-3;
/// Samples per second that are kept at least: mains hum stays what it is up to its ninth harmonic.
const KEPT_MIN_HZ: f64 = 1000.0;

impl Even {
    /// Of a recording of more samples every second, third and so on, where its drive is slow for its rate and
    /// so runs nearly straight between them; whether that is so. What stands between was recorded again and
    /// again, and a search that takes only the beginning for it misses the rest.
    pub fn thinned(mut self, most: usize) -> (Self, bool) {
        let samples = self.u_v.len();
        let wanted = samples.div_ceil(most);
        let by_rate = (self.sample_rate_hz / KEPT_MIN_HZ) as usize;
        let slow_v = SLOW * peak_to_peak(&self.u_v);
        let is_slow = |apart: &usize| {
            let ends = self.u_v.iter().zip(&self.u_v[*apart..]);
            ends.into_iter().all(|(a, b)| (b - a).abs() <= slow_v)
        };
        let Some(apart) = (2..=wanted.min(by_rate)).rev().find(is_slow) else {
            return (self, false);
        };
        let kept = |signal: &[f64]| signal.iter().step_by(apart).copied().collect::<Vec<f64>>();
        self.sample_rate_hz /= apart as f64;
        self.u_v = kept(&self.u_v);
        self.y_um = kept(&self.y_um);
        self.force_n = self.force_n.as_deref().map(kept);
        let auxiliary = self.auxiliary.iter();
        self.auxiliary = auxiliary.map(|signal| signal.with(kept)).collect();
        let place = |range: &Range<usize>| range.start.div_ceil(apart)..range.end.div_ceil(apart);
        self.bridged = self.bridged.iter().map(place).collect();
        self.bridged.retain(|range| !range.is_empty());
        self.notes.push(format!(
            "{samples} samples of a slow drive: one in {apart} is taken, {:.1} samples per second, between which it runs straight",
            self.sample_rate_hz
        ));
        (self, true)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn even(drive: impl Fn(f64) -> f64) -> Even {
        let u_v: Vec<f64> = (0..40_000).map(|k| drive(k as f64 / 20_000.0)).collect();
        Even {
            sample_rate_hz: 20_000.0,
            start_s: 0.0,
            y_um: u_v.iter().map(|u| 0.1 * u).collect(),
            u_v,
            force_n: None,
            auxiliary: Vec::new(),
            bridged: vec![5..6, 8..14],
            units: SignalUnits::default(),
            notes: Vec::new(),
        }
    }

    #[test]
    fn only_a_slow_drive_is_thinned_and_no_further_than_asked() {
        let ramp = |t: f64| 10.0 * t;
        let (thin, is_thinned) = even(ramp).thinned(10_000);
        assert!(is_thinned && thin.sample_rate_hz == 5000.0);
        assert!(thin.bridged.len() == 1 && thin.bridged[0] == (2..4));
        assert_eq!(
            (thin.u_v.len(), thin.u_v[3]),
            (10_000, 10.0 * (12.0 / 20_000.0))
        );
        assert_eq!(even(ramp).thinned(10).0.sample_rate_hz, 1000.0);
        assert!(!even(ramp).thinned(40_000).1);
        let steps = |t: f64| if t < 1.0 { 0.0 } else { 10.0 };
        assert!(!even(steps).thinned(10_000).1);
        let sweep = |t: f64| (400.0 * t * t).sin();
        assert!(!even(sweep).thinned(10_000).1);
    }
}
