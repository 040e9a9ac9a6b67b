//! What a servo is asked to follow: a reference that repeats, or one that is given point by point.

use super::design::ServoDesign;
use super::model::SAMPLING_PERIOD_S;
use super::track::{PeriodicReference, lead_s};
use hysteron_sim::waveform;

/// A reference, um, counted from where the actuator stands at its lowest drive.
#[derive(Clone, Debug, PartialEq)]
pub enum Reference {
    /// One that repeats.
    Periodic(PeriodicReference),
    /// A point for each tick.
    Points(Vec<f64>),
}

/// Longest reference that is given point by point, s.
const LONGEST_S: f64 = 600.0;

impl Reference {
    /// One that repeats, by its name ([`PeriodicReference::parse`]).
    ///
    /// # Errors
    /// A message that names the field.
    pub fn named(text: &str) -> Result<Self, String> {
        PeriodicReference::parse(text).map(Self::Periodic)
    }

    /// A reference through points at these times, s, in straight lines between them.
    ///
    /// # Errors
    /// Fewer than two points, times that do not go forward, something that is no number, or more than ten
    /// minutes.
    pub fn through(time_s: &[f64], reference_um: &[f64]) -> Result<Self, String> {
        let (Some(begin_s), Some(end_s)) = (time_s.first(), time_s.last().filter(|_| time_s.len() > 1)) else {
            return Err("one point is no reference; expected two or more".into());
        };
        if let Some(row) = time_s.windows(2).position(|w| w[1] <= w[0] || !w.iter().all(|t| t.is_finite())) {
            return Err(format!("time does not go forward behind point {}", row + 1));
        }
        if let Some(row) = reference_um.iter().position(|r| !r.is_finite()) {
            return Err(format!("point {} is no number", row + 1));
        }
        if end_s - begin_s > LONGEST_S {
            return Err(format!("the reference lasts {:.0} s; expected at most {LONGEST_S:.0} s", end_s - begin_s));
        }
        let ticks = ((end_s - begin_s) / SAMPLING_PERIOD_S * (1.0 + 1e-12)) as usize;
        let at = |tick: usize| {
            let t_s = begin_s + tick as f64 * SAMPLING_PERIOD_S;
            let after = time_s.partition_point(|t| *t <= t_s).clamp(1, time_s.len() - 1);
            let (from_s, to_s) = (time_s[after - 1], time_s[after]);
            let share = ((t_s - from_s) / (to_s - from_s)).min(1.0);
            reference_um[after - 1] + share * (reference_um[after] - reference_um[after - 1])
        };
        Ok(Self::Points((0..=ticks).map(at).collect()))
    }

    /// Samples, grown from zero, and the sample from which the error of a design counts. The first of points
    /// is reached before.
    #[must_use]
    pub fn samples_um(&self, design: &ServoDesign) -> (Vec<f64>, usize) {
        match self {
            Self::Periodic(periodic) => periodic.samples_um(lead_s(design, periodic.frequency_hz)),
            Self::Points(points_um) => {
                let sample_rate_hz = 1.0 / SAMPLING_PERIOD_S;
                // What does not repeat is not learned.
                let mut samples_um = waveform::hold(sample_rate_hz, points_um[0], lead_s(design, f64::INFINITY));
                let from = samples_um.len();
                samples_um.extend(points_um);
                waveform::grow_from_zero(&mut samples_um, sample_rate_hz);
                (samples_um, from)
            }
        }
    }

    /// Ticks after which it repeats; `None` where it does not, or these are no whole number.
    #[must_use]
    pub fn period_ticks(&self) -> Option<u32> {
        match self {
            Self::Periodic(periodic) => periodic.period_ticks(),
            Self::Points(_) => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_are_followed_in_straight_lines_at_every_tick() {
        let Reference::Points(points) = Reference::through(&[1.0, 1.001, 1.003], &[2.0, 3.0, 1.0]).unwrap() else { panic!("points") };
        assert_eq!(points.len(), 61);
        for (tick, expected) in [(0, 2.0), (10, 2.5), (20, 3.0), (40, 2.0), (60, 1.0)] {
            assert!((points[tick] - expected).abs() < 1e-9, "{tick}: {}", points[tick]);
        }
    }

    #[test]
    fn what_is_no_reference_is_refused_with_the_point() {
        for (time_s, reference_um, expected) in [
            (vec![0.0], vec![1.0], "two or more"),
            (vec![0.0, 1.0, 1.0], vec![1.0; 3], "behind point 2"),
            (vec![0.0, 1.0, f64::NAN], vec![1.0; 3], "behind point 2"),
            (vec![0.0, 1.0], vec![1.0, f64::NAN], "point 2 is no number"),
            (vec![0.0, 1e4], vec![1.0; 2], "at most 600 s"),
        ] {
            let refused = Reference::through(&time_s, &reference_um).unwrap_err();
            assert!(refused.contains(expected), "{refused}");
        }
    }
}
