//! What a servo is asked to follow: a reference that repeats, one that jumps, a random one, or one that is
//! given point by point.

use super::design::ServoDesign;
use hysteron_core::learned_feedforward::MOST_POINTS;
use hysteron_sim::waveform;
use serde::Serialize;

/// Two periods of a slower reference would take minutes to simulate, and more memory than there is.
const LOWEST_FREQUENCY_HZ: f64 = 0.01;

/// Time before the error counts, s: in it a reference grows.
const LEAD_S: f64 = 0.5;
/// Periods of a reference whose correction is learned that pass at its full amplitude before the error
/// counts.
const LEARNED_PERIODS: f64 = 10.0;
/// Time for the gain to be corrected, s: at half a per cent in 0.1 s the largest correction takes four, and
/// the rest of it one.
const ADAPTED_WITHIN_S: f64 = 6.0;

/// Time before the error counts, s: longer where the correction of a reference of this frequency, or the
/// gain, is learned.
#[must_use]
pub fn lead_s(design: &ServoDesign, frequency_hz: f64) -> f64 {
    let learns = design.learning.is_some()
        && period_ticks(frequency_hz, design.period_s())
            .is_some_and(|ticks| ticks <= MOST_POINTS as u32);
    let lead_s = if design.adaptation.is_some() {
        ADAPTED_WITHIN_S
    } else {
        LEAD_S
    };
    if learns {
        lead_s.max(waveform::GROWN_WITHIN_S + LEARNED_PERIODS / frequency_hz)
    } else {
        lead_s
    }
}

/// How a reference goes from its lowest to its highest point and back.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum ReferenceShape {
    /// `offset + amplitude sin(2 pi f t + phase)`.
    Sine,
    /// In straight lines with sharp corners, where the sine would have its extremes.
    Triangle,
}

/// A reference that repeats.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct PeriodicReference {
    /// Shape.
    pub shape: ReferenceShape,
    /// Frequency, Hz.
    pub frequency_hz: f64,
    /// Amplitude, um.
    pub amplitude_um: f64,
    /// Offset, um.
    pub offset_um: f64,
    /// Phase, degrees.
    pub phase_deg: f64,
}

impl PeriodicReference {
    /// Reads `sine:HZ:AMPLITUDE_UM[:OFFSET_UM[:PHASE_DEG]]`, or `triangle:` with the same numbers. Without an
    /// offset it stands on 1.12 times its amplitude, which leaves room for the remnant and for creep; without
    /// a phase it begins at its lowest point. For a loop with this sampling period, s.
    ///
    /// # Errors
    /// A message that names the field.
    pub fn parse(text: &str, period_s: f64) -> Result<Self, String> {
        let expected = format!("expected {NAMES}");
        let mut fields = text.split(':');
        let shape = match fields.next() {
            Some("sine") => ReferenceShape::Sine,
            Some("triangle") => ReferenceShape::Triangle,
            _ => return Err(format!("reference `{text}`: {expected}")),
        };
        let numbers: Vec<f64> = fields
            .map(|f| {
                f.parse::<f64>()
                    .ok()
                    .filter(|v| v.is_finite())
                    .ok_or_else(|| format!("reference `{text}`: `{f}` is not a number; {expected}"))
            })
            .collect::<Result<_, _>>()?;
        let (frequency_hz, amplitude_um) = match numbers.as_slice() {
            [f, a] | [f, a, _] | [f, a, _, _] => (*f, *a),
            _ => return Err(format!("reference `{text}`: {expected}")),
        };
        if !(LOWEST_FREQUENCY_HZ..=0.25 / period_s).contains(&frequency_hz) {
            return Err(format!(
                "reference `{text}`: the frequency must be at least {LOWEST_FREQUENCY_HZ} Hz and at most {} Hz",
                0.25 / period_s
            ));
        }
        if amplitude_um < 0.0 {
            return Err(format!(
                "reference `{text}`: the amplitude must not be negative"
            ));
        }
        Ok(Self {
            shape,
            frequency_hz,
            amplitude_um,
            offset_um: numbers.get(2).copied().unwrap_or(1.12 * amplitude_um),
            phase_deg: numbers.get(3).copied().unwrap_or(-90.0),
        })
    }

    /// Samples of a loop with this sampling period, s, grown from zero, for `lead_s` and then two periods or a
    /// second; and the sample from which the error counts.
    #[must_use]
    pub fn samples_um(&self, lead_s: f64, period_s: f64) -> (Vec<f64>, usize) {
        let fs = 1.0 / period_s;
        let duration_s = lead_s + (2.0 / self.frequency_hz).max(1.0);
        let mut samples = match self.shape {
            ReferenceShape::Sine => waveform::sine(
                fs,
                self.frequency_hz,
                self.amplitude_um,
                self.offset_um,
                self.phase_deg.to_radians(),
                duration_s,
            ),
            ReferenceShape::Triangle => (0..waveform::samples_in(fs, duration_s))
                .map(|k| {
                    let turns = (self.frequency_hz * k as f64 / fs
                        + (self.phase_deg + 90.0) / 360.0)
                        .rem_euclid(1.0);
                    self.offset_um + self.amplitude_um * (1.0 - 4.0 * (turns - 0.5).abs())
                })
                .collect(),
        };
        waveform::grow_from_zero(&mut samples, fs);
        (samples, waveform::samples_in(fs, lead_s))
    }

    /// Ticks of a loop with this sampling period, s, after which it repeats; `None` where these are no whole
    /// number.
    #[must_use]
    pub fn period_ticks(&self, period_s: f64) -> Option<u32> {
        period_ticks(self.frequency_hz, period_s)
    }
}

/// Ticks of a loop with this sampling period, s, after which something of a frequency repeats; `None` where
/// these are no whole number.
#[must_use]
pub fn period_ticks(frequency_hz: f64, period_s: f64) -> Option<u32> {
    let ticks = 1.0 / (frequency_hz * period_s);
    ((ticks - ticks.round()).abs() < 1e-9 * ticks && ticks < f64::from(u32::MAX))
        .then_some(ticks.round() as u32)
}

/// A reference, um, counted from where the actuator stands at its lowest drive.
#[derive(Clone, Debug, PartialEq)]
pub enum Reference {
    /// One that repeats.
    Periodic(PeriodicReference),
    /// One that jumps when the error begins to count.
    Step {
        /// Where it stands before, um.
        from_um: f64,
        /// By how much it jumps, um.
        by_um: f64,
    },
    /// A point for each tick.
    Points(Vec<f64>),
}

/// Time that a step is followed for, s.
const STEP_S: f64 = 0.5;
/// Where a step begins without a word about it, over its size: the room that a sine has below it.
const ROOM: f64 = 0.12;
/// Lines of a random reference, as far as its length allows.
const RANDOM_LINES: f64 = 64.0;
/// Shortest and longest random reference, s.
const RANDOM_S: [f64; 2] = [0.25, 20.0];
/// Lowest upper frequency of a random reference, Hz: of a slower one less than twenty lines would be there.
const LOWEST_RANDOM_HZ: f64 = 1.0;

/// Names of references, for messages.
pub const NAMES: &str = "sine:HZ:UM[:OFFSET_UM[:PHASE_DEG]], triangle: with the same numbers, step:UM[:FROM_UM] or random:HZ:UM[:OFFSET_UM[:SEED]]";

/// Longest reference that is given point by point, s.
const LONGEST_S: f64 = 600.0;

impl Reference {
    /// One by its name: `sine:` and `triangle:` ([`PeriodicReference::parse`]), `step:UM[:FROM_UM]` (a jump
    /// by so much), or `random:HZ:UM[:OFFSET_UM[:SEED]]` (equal sines of random phase up to a frequency,
    /// within an amplitude). For a loop with this sampling period, s.
    ///
    /// # Errors
    /// A message that names the field.
    pub fn named(text: &str, period_s: f64) -> Result<Self, String> {
        let (kind, rest) = text.split_once(':').unwrap_or((text, ""));
        if !matches!(kind, "step" | "random") {
            return PeriodicReference::parse(text, period_s).map(Self::Periodic);
        }
        let number = |field: &str| field.parse::<f64>().ok().filter(|v| v.is_finite());
        let numbers: Option<Vec<f64>> = rest.split(':').map(number).collect();
        let random =
            |hz, um, offset_um, seed| Self::random(text, period_s, [hz, um, offset_um, seed]);
        match (kind, numbers.as_deref()) {
            ("step", Some([by_um] | [by_um, _])) if *by_um == 0.0 => {
                Err(format!("reference `{text}`: a step of zero moves nothing"))
            }
            ("step", Some([by_um])) => Ok(Self::Step {
                from_um: ROOM * by_um.abs() + (-by_um).max(0.0),
                by_um: *by_um,
            }),
            ("step", Some([by_um, from_um])) => Ok(Self::Step {
                from_um: *from_um,
                by_um: *by_um,
            }),
            ("random", Some([hz, um])) => random(*hz, *um, (1.0 + ROOM) * um, 1.0),
            ("random", Some([hz, um, offset_um])) => random(*hz, *um, *offset_um, 1.0),
            ("random", Some([hz, um, offset_um, seed])) => random(*hz, *um, *offset_um, *seed),
            _ => Err(format!("reference `{text}`: expected {NAMES}")),
        }
    }

    fn random(
        text: &str,
        period_s: f64,
        [highest_hz, peak_um, offset_um, seed]: [f64; 4],
    ) -> Result<Self, String> {
        let fastest_hz = 0.25 / period_s;
        if !(LOWEST_RANDOM_HZ..=fastest_hz).contains(&highest_hz) {
            return Err(format!(
                "reference `{text}`: the frequency must be at least {LOWEST_RANDOM_HZ} Hz and at most {fastest_hz} Hz"
            ));
        }
        if peak_um < 0.0 || !(0.0..=f64::from(u32::MAX)).contains(&seed) {
            return Err(format!(
                "reference `{text}`: neither amplitude nor seed may be negative"
            ));
        }
        let lasts_s = (RANDOM_LINES / highest_hz).clamp(RANDOM_S[0], RANDOM_S[1]);
        let lines: Vec<usize> = (1..=(lasts_s * highest_hz) as usize).collect();
        let ticks = (lasts_s / period_s).round() as usize;
        Ok(Self::Points(waveform::multisine(
            ticks,
            &lines,
            peak_um,
            offset_um,
            1,
            seed as u64,
        )))
    }

    /// A reference through points at these times, s, in straight lines between them, for a loop with this
    /// sampling period, s.
    ///
    /// # Errors
    /// Fewer than two points, times that do not go forward, something that is no number, or more than ten
    /// minutes.
    pub fn through(time_s: &[f64], reference_um: &[f64], period_s: f64) -> Result<Self, String> {
        let (Some(begin_s), Some(end_s)) =
            (time_s.first(), time_s.last().filter(|_| time_s.len() > 1))
        else {
            return Err("one point is no reference; expected two or more".into());
        };
        if let Some(row) = time_s
            .windows(2)
            .position(|w| w[1] <= w[0] || !w.iter().all(|t| t.is_finite()))
        {
            return Err(format!("time does not go forward behind point {}", row + 1));
        }
        if let Some(row) = reference_um.iter().position(|r| !r.is_finite()) {
            return Err(format!("point {} is no number", row + 1));
        }
        if end_s - begin_s > LONGEST_S {
            return Err(format!(
                "the reference lasts {:.0} s; expected at most {LONGEST_S:.0} s",
                end_s - begin_s
            ));
        }
        let ticks = ((end_s - begin_s) / period_s * (1.0 + 1e-12)) as usize;
        let at = |tick: usize| {
            let t_s = begin_s + tick as f64 * period_s;
            let after = time_s
                .partition_point(|t| *t <= t_s)
                .clamp(1, time_s.len() - 1);
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
            Self::Periodic(periodic) => {
                periodic.samples_um(lead_s(design, periodic.frequency_hz), design.period_s())
            }
            Self::Step { from_um, by_um } => {
                let sample_rate_hz = 1.0 / design.period_s();
                let mut samples_um =
                    waveform::hold(sample_rate_hz, *from_um, lead_s(design, f64::INFINITY));
                let from = samples_um.len();
                samples_um.extend(waveform::hold(sample_rate_hz, from_um + by_um, STEP_S));
                waveform::grow_from_zero(&mut samples_um, sample_rate_hz);
                (samples_um, from)
            }
            Self::Points(points_um) => {
                let sample_rate_hz = 1.0 / design.period_s();
                // What does not repeat is not learned.
                let mut samples_um =
                    waveform::hold(sample_rate_hz, points_um[0], lead_s(design, f64::INFINITY));
                let from = samples_um.len();
                samples_um.extend(points_um);
                waveform::grow_from_zero(&mut samples_um, sample_rate_hz);
                (samples_um, from)
            }
        }
    }

    /// Ticks of a loop with this sampling period, s, after which it repeats; `None` where it does not, or these
    /// are no whole number.
    #[must_use]
    pub fn period_ticks(&self, period_s: f64) -> Option<u32> {
        match self {
            Self::Periodic(periodic) => periodic.period_ticks(period_s),
            Self::Step { .. } | Self::Points(_) => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::model::SAMPLING_PERIOD_S;
    use super::*;

    #[test]
    fn points_are_followed_in_straight_lines_at_every_tick() {
        let Reference::Points(points) =
            Reference::through(&[1.0, 1.001, 1.003], &[2.0, 3.0, 1.0], SAMPLING_PERIOD_S).unwrap()
        else {
            panic!("points")
        };
        assert_eq!(points.len(), 61);
        for (tick, expected) in [(0, 2.0), (10, 2.5), (20, 3.0), (40, 2.0), (60, 1.0)] {
            assert!(
                (points[tick] - expected).abs() < 1e-9,
                "{tick}: {}",
                points[tick]
            );
        }
    }

    #[test]
    fn a_step_jumps_when_the_error_counts_and_a_random_reference_keeps_its_band() {
        let Reference::Step { from_um, by_um } =
            Reference::named("step:-2", SAMPLING_PERIOD_S).unwrap()
        else {
            panic!("a step")
        };
        assert!(
            (from_um - 2.24).abs() < 1e-12 && by_um == -2.0,
            "{from_um} {by_um}"
        );
        assert_eq!(
            Reference::named("step:2:1", SAMPLING_PERIOD_S),
            Ok(Reference::Step {
                from_um: 1.0,
                by_um: 2.0
            })
        );
        let Reference::Points(points) =
            Reference::named("random:100:2:5:3", SAMPLING_PERIOD_S).unwrap()
        else {
            panic!("points")
        };
        let (low, high) = crate::statistics::extremes(&points);
        assert!(
            (low - 3.0).abs() < 1e-9 || (high - 7.0).abs() < 1e-9,
            "{low} {high}"
        );
        assert!(low > 3.0 - 1e-9 && high < 7.0 + 1e-9, "{low} {high}");
        // Nothing changes faster than all lines at the highest frequency would.
        let fastest = points
            .windows(2)
            .map(|w| (w[1] - w[0]).abs())
            .fold(0.0, f64::max)
            / SAMPLING_PERIOD_S;
        assert!(fastest < std::f64::consts::TAU * 100.0 * 2.0, "{fastest}");
        assert_ne!(
            Reference::named("random:100:2:5:4", SAMPLING_PERIOD_S),
            Reference::named("random:100:2:5:3", SAMPLING_PERIOD_S)
        );
        for (text, expected) in [
            ("step:0", "of zero"),
            ("step", "expected sine"),
            ("random:0.1:2", "at least 1 Hz"),
            ("random:9:-2", "negative"),
            ("ramp:1:2", "triangle:"),
        ] {
            let refused = Reference::named(text, SAMPLING_PERIOD_S).unwrap_err();
            assert!(refused.contains(expected), "{text}: {refused}");
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
            let refused =
                Reference::through(&time_s, &reference_um, SAMPLING_PERIOD_S).unwrap_err();
            assert!(refused.contains(expected), "{refused}");
        }
    }

    #[test]
    fn a_triangle_goes_in_straight_lines_between_its_ends_and_repeats() {
        let triangle = PeriodicReference::parse("triangle:100:3:5", SAMPLING_PERIOD_S).unwrap();
        assert_eq!(triangle.period_ticks(SAMPLING_PERIOD_S), Some(200));
        let (samples, from) = triangle.samples_um(LEAD_S, SAMPLING_PERIOD_S);
        for (k, expected) in [
            (0, 2.0),
            (50, 5.0),
            (100, 8.0),
            (125, 6.5),
            (199, 2.06),
            (200, 2.0),
        ] {
            assert!(
                (samples[from + k] - expected).abs() < 1e-9,
                "{k}: {}",
                samples[from + k]
            );
        }
        let ticks = |text: &str| {
            PeriodicReference::parse(text, SAMPLING_PERIOD_S)
                .unwrap()
                .period_ticks(SAMPLING_PERIOD_S)
        };
        assert_eq!(
            (
                ticks("sine:150:1"),
                ticks("sine:0.3:1"),
                ticks("sine:12.5:1")
            ),
            (None, None, Some(1600))
        );
        assert!(
            PeriodicReference::parse("square:100:3", SAMPLING_PERIOD_S)
                .unwrap_err()
                .contains("triangle:")
        );
    }
}
