//! How far a loop is from the end of its stability on an actuator: gain and phase margin, bandwidth, and the
//! first unstable value of gain, mass, delay and of a mode that nobody knows of. All by the eigenvalues and
//! the frequency response of the sampled loop.
//!
//! # Limits of the drive
//! Eigenvalues speak of a loop whose drive is free. A servo begins at the lower limit of its drive, and noise
//! or a jump brings it to a limit later; a loop with a lightly damped mode, wrong gain and wrong mass may
//! then swing between the limits for ever although its eigenvalues are stable. So every first unstable value
//! is sought twice: with the drive free, and with any share of what is commanded acting
//! ([`PredictorDesign::at_a_limit`]). Between the two it depends on what happens whether the loop swings; for
//! the one beginning that every servo has, at the lower limit of its drive, the value is found by running the
//! loop ([`super::from_rest`]).

use super::from_rest::Beginning;
use super::law::PredictorDesign;
use super::model::{LinearModel, ModeModel, SampledModel};
use super::moving_mode::ReferenceBand;
use super::plant_set::{DELAY_STEP, GAIN_STEP, PlantVariation, mass_step};
use super::recording::ServoRecording;
use super::sampled_loop::{FrequencyGrid, ResponsePoint, SampledLoop, decibels};
use serde::{Deserialize, Serialize};
use std::f64::consts::TAU;

/// Damping ratio of the unknown mode whose share is sought.
pub const UNKNOWN_DAMPING: f64 = 0.02;
/// Largest factor of gain and mass that is tried.
const LARGEST_FACTOR: f64 = 30.0;
/// Longest delay that is tried, in periods.
const LONGEST_DELAY: f64 = 40.0;
/// The same with a drive at a limit, which takes as many times longer as shares are tried.
const LONGEST_DELAY_AT_A_LIMIT: f64 = 8.0;
/// Largest share of an unknown mode that is tried.
const LARGEST_SHARE: f64 = 0.5;
/// Shares of what is commanded that are tried where the drive is at a limit: each this much of the one
/// before, down to the least.
const NEXT_SHARE: f64 = 0.8;
/// Least of them.
const LEAST_SHARE: f64 = 0.02;
/// First unstable values are found to this share.
const PRECISION: f64 = 1e-3;
/// Factor between values that are run from the lower limit of the drive, ...
const RUN_STEP: f64 = 1.02;
/// ... at most so many of them, ...
const MOST_RUN_STEPS: f64 = 40.0;
/// ... and the share to which the first that swings is then found.
const RUN_PRECISION: f64 = 4e-3;

/// A mode at which a loop becomes unstable.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct UnstableMode {
    /// Its frequency, Hz.
    pub frequency_hz: f64,
    /// Its damping ratio.
    pub damping_ratio: f64,
    /// Smallest share of the static displacement that makes the loop unstable.
    pub share: f64,
}

/// Values at which the loop is no longer stable; none where it still is at the largest that was tried (or
/// where it is never stable).
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct FirstUnstable {
    /// Gain over that of the model, upwards.
    pub gain_up: Option<f64>,
    /// Gain over that of the model, downwards.
    pub gain_down: Option<f64>,
    /// Moving mass over that of the model, upwards.
    pub mass_up: Option<f64>,
    /// Moving mass over that of the model, downwards.
    pub mass_down: Option<f64>,
    /// Additional delay, s.
    pub delay_s: Option<f64>,
    /// An unknown mode between the first mode and half the sampling rate, at its worst frequency.
    pub mode: Option<UnstableMode>,
}

/// One point of the frequency response.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct LoopPoint {
    /// Frequency, Hz.
    pub hz: f64,
    /// Open loop, real and imaginary part.
    pub open: [f64; 2],
    /// Magnitude of the sensitivity: what is left of a disturbance of the reading.
    pub sensitivity: f64,
    /// Magnitude of the complementary sensitivity: what noise makes of the motion.
    pub complementary: f64,
}

impl From<&ResponsePoint> for LoopPoint {
    fn from(point: &ResponsePoint) -> Self {
        Self {
            hz: point.hz,
            open: [point.open.re, point.open.im],
            sensitivity: point.sensitivity.norm(),
            complementary: point.transmission.norm(),
        }
    }
}

/// What a loop is worth on an actuator.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct LoopMargins {
    /// Ratio of the actuator's gain to the one that the law inverts: least, mean and largest over the range.
    pub gain_ratio: [f64; 3],
    /// Largest magnitude of the sampled eigenvalues at each of them.
    pub spectral_radius: [f64; 3],
    /// The worst of what was judged, in words.
    pub worst_case: String,
    /// Factor of the gain to the end of stability, upwards; from the crossing of the open loop at -180
    /// degrees.
    pub gain_margin: Option<f64>,
    /// Phase to the end of stability at the least favourable crossing of gain 1, degrees.
    pub phase_margin_deg: Option<f64>,
    /// Frequency from which disturbances of the reading are no longer brought below 0.71, Hz.
    pub bandwidth_hz: Option<f64>,
    /// How far up a reference is followed, Hz (-3 dB); none where the law does not say what it feeds forward.
    pub reference_bandwidth_hz: Option<f64>,
    /// Largest sensitivity.
    pub sensitivity_peak: f64,
    /// Where it is, Hz.
    pub sensitivity_peak_hz: f64,
    /// Sensor noise that becomes motion, RMS over RMS.
    pub noise_transmission: f64,
    /// The first unstable values, the drive free.
    pub first_unstable: FirstUnstable,
    /// The first values with which it may go on swinging once the drive was at a limit (a delay of at most
    /// eight periods, the mode at the same frequency).
    pub first_swinging: FirstUnstable,
    /// The first values with which it swings where it begins at the lower limit of its drive, as run on this
    /// actuator; none where no beginning was given. The mode is that of a free drive.
    #[serde(default)]
    pub first_from_rest: Option<FirstUnstable>,
    /// An unknown mode was sought among those alone that a recording leaves possible.
    #[serde(default)]
    pub with_recording: bool,
    /// The frequency response.
    pub response: Vec<LoopPoint>,
}

/// The loop of a law and an actuator's linear dynamics.
pub struct Loop<'a> {
    /// The law.
    pub law: &'a PredictorDesign,
    /// The actuator.
    pub linear: &'a LinearModel,
    /// Its gain over the one that the law inverts: least, mean, largest.
    pub gain_ratio: [f64; 3],
    /// Delay of its drive, s.
    pub delay_s: f64,
    /// How the servo begins, where it is to be run from there.
    pub beginning: Option<Beginning<'a>>,
    /// The recording, if it is at hand: an unknown mode that it excludes does not count.
    pub recording: Option<&'a ServoRecording>,
}

impl Loop<'_> {
    /// The actuator, varied.
    fn plant(&self, variation: &PlantVariation) -> SampledModel {
        PlantVariation {
            delay_s: variation.delay_s + self.delay_s,
            ..*variation
        }
        .sampled(self.linear)
    }

    /// Whether it is stable with each of these laws.
    fn stable(&self, laws: &[PredictorDesign], variation: &PlantVariation) -> bool {
        let plant = self.plant(variation);
        laws.iter().all(|law| {
            SampledLoop::new(law, &plant)
                .with_gain(self.gain_ratio[1])
                .is_stable()
        })
    }

    /// Between a stable and an unstable value the value where it turns, by halving the interval's ratio.
    fn turn(
        &self,
        laws: &[PredictorDesign],
        mut good: f64,
        mut bad: f64,
        at: &dyn Fn(f64) -> PlantVariation,
    ) -> f64 {
        while (bad / good - 1.0).abs() > PRECISION {
            let middle = if good > 0.0 {
                (good * bad).sqrt()
            } else {
                0.5 * bad
            };
            if self.stable(laws, &at(middle)) {
                good = middle
            } else {
                bad = middle
            }
        }
        bad
    }

    /// The first of a row of values that is unstable, made precise.
    fn first(
        &self,
        laws: &[PredictorDesign],
        begin: f64,
        values: impl Iterator<Item = f64>,
        at: &dyn Fn(f64) -> PlantVariation,
    ) -> Option<f64> {
        let mut good = begin;
        for value in values {
            if !self.stable(laws, &at(value)) {
                return Some(self.turn(laws, good, value, at));
            }
            good = value;
        }
        None
    }

    fn first_unstable(
        &self,
        laws: &[PredictorDesign],
        longest_delay: f64,
        mode: impl Fn() -> Option<UnstableMode>,
    ) -> FirstUnstable {
        if !self.stable(laws, &PlantVariation::NONE) {
            return FirstUnstable::default();
        }
        let steps = |factor: f64| {
            (1..)
                .map(move |i| factor.powi(i))
                .take_while(|f| *f < LARGEST_FACTOR && *f > 1.0 / LARGEST_FACTOR)
        };
        let mass_step = mass_step(self.linear);
        let period_s = self.linear.period_s;
        let delays = (1..)
            .map(|i| DELAY_STEP * f64::from(i))
            .take_while(|d| *d <= longest_delay)
            .map(|d| d * period_s);
        FirstUnstable {
            gain_up: self.first(laws, 1.0, steps(GAIN_STEP), &PlantVariation::with_gain),
            gain_down: self.first(
                laws,
                1.0,
                steps(1.0 / GAIN_STEP),
                &PlantVariation::with_gain,
            ),
            mass_up: self.first(
                laws,
                1.0,
                steps(mass_step),
                &PlantVariation::with_mass_ratio,
            ),
            mass_down: self.first(
                laws,
                1.0,
                steps(1.0 / mass_step),
                &PlantVariation::with_mass_ratio,
            ),
            delay_s: self.first(laws, 1e-3 * period_s, delays, &PlantVariation::with_delay_s),
            mode: mode(),
        }
    }

    /// The smallest share of a mode at a frequency that makes the loop unstable, if it is below a limit.
    fn unstable_share(
        &self,
        laws: &[PredictorDesign],
        hz: f64,
        limit: f64,
    ) -> Option<UnstableMode> {
        let mode = ModeModel {
            natural_frequency_rad_s: TAU * hz,
            damping_ratio: UNKNOWN_DAMPING,
        };
        let at = |share: f64| PlantVariation {
            mode: Some((share, mode)),
            ..PlantVariation::NONE
        };
        let shares = (0..80)
            .map(|i| 1e-4 * 1.15_f64.powi(i))
            .take_while(|s| *s <= limit);
        let share = self.first(laws, 5e-5, shares, &at)?;
        Some(UnstableMode {
            frequency_hz: hz,
            damping_ratio: UNKNOWN_DAMPING,
            share,
        })
    }

    /// The mode of the smallest share that makes the loop unstable: where `|K S|` is large, and a fine grid
    /// about it.
    fn worst_mode(&self, laws: &[PredictorDesign]) -> Option<UnstableMode> {
        let lowest_hz = self.linear.first_mode.natural_frequency_rad_s / TAU;
        let highest_hz = 0.5 / self.linear.period_s;
        let mut worst: Option<UnstableMode> = None;
        let mut look = |hz: f64| {
            // A mode of this damping has a peak of its share over twice the damping ratio.
            let excluded = self
                .recording
                .and_then(|r| r.level_at(hz))
                .map_or(f64::INFINITY, |level| 2.0 * UNKNOWN_DAMPING * level);
            let limit = worst.map_or(LARGEST_SHARE, |w| w.share).min(excluded);
            if let Some(found) = self
                .unstable_share(laws, hz, limit)
                .filter(|found| worst.is_none_or(|w| found.share < w.share))
            {
                worst = Some(found);
            }
        };
        // Steps of half the width of the mode.
        let count = ((highest_hz * 0.995 / lowest_hz).ln() / 0.02)
            .ceil()
            .max(1.0) as usize;
        (0..=count).for_each(|i| {
            look(lowest_hz * 1.02_f64.powi(i as i32).min(0.995 * highest_hz / lowest_hz))
        });
        worst
    }

    /// Judges the loop.
    #[must_use]
    pub fn judged(&self) -> LoopMargins {
        let plant = self.plant(&PlantVariation::NONE);
        let with_gain = |ratio: f64| SampledLoop::new(self.law, &plant).with_gain(ratio);
        let spectral_radius = self
            .gain_ratio
            .map(|ratio| with_gain(ratio).spectral_radius());
        let response =
            with_gain(self.gain_ratio[1]).response(&FrequencyGrid::about_modes(self.linear));
        let free = [self.law.clone()];
        let first_unstable = self.first_unstable(&free, LONGEST_DELAY, || self.worst_mode(&free));
        let shares = std::iter::successors(Some(1.0), |share| Some(NEXT_SHARE * share))
            .take_while(|share| *share >= LEAST_SHARE);
        let limited: Vec<PredictorDesign> =
            shares.map(|share| self.law.at_a_limit(share)).collect();
        let same_mode = || {
            first_unstable
                .mode
                .and_then(|m| self.unstable_share(&limited, m.frequency_hz, LARGEST_SHARE))
        };
        let first_swinging = self.first_unstable(&limited, LONGEST_DELAY_AT_A_LIMIT, same_mode);
        let first_from_rest = self
            .beginning
            .map(|beginning| first_from_rest(&beginning, &first_unstable, &first_swinging));
        let (sensitivity_peak, sensitivity_peak_hz) = response.sensitivity_peak();
        LoopMargins {
            gain_ratio: self.gain_ratio,
            spectral_radius,
            worst_case: worst_case(
                &self.gain_ratio,
                &spectral_radius,
                [&first_unstable, &first_swinging],
                self.linear.period_s,
            ),
            gain_margin: first_unstable.gain_up,
            phase_margin_deg: response.phase_margin_deg(),
            bandwidth_hz: response.bandwidth_hz(),
            reference_bandwidth_hz: (!self.law.feedforward.is_empty()).then(|| {
                ReferenceBand::followed(self.law, &plant, self.gain_ratio[1]).bandwidth_hz
            }),
            sensitivity_peak,
            sensitivity_peak_hz,
            noise_transmission: response.noise_transmission(),
            first_unstable,
            first_swinging,
            first_from_rest,
            with_recording: self.recording.is_some(),
            response: response.points.iter().map(LoopPoint::from).collect(),
        }
    }
}

/// Between the first values at a limit and those of a free drive the first that swings from the beginning.
fn first_from_rest(
    beginning: &Beginning<'_>,
    free: &FirstUnstable,
    limited: &FirstUnstable,
) -> FirstUnstable {
    let find = |free: Option<f64>, limited: Option<f64>, at: &dyn Fn(f64) -> PlantVariation| {
        let (Some(end), Some(begin)) = (free, limited) else {
            return free;
        };
        if !differ(begin, end) {
            return free;
        }
        let swings = |value: f64| beginning.swings(&at(value));
        let steps = ((end / begin).ln().abs() / RUN_STEP.ln())
            .ceil()
            .clamp(1.0, MOST_RUN_STEPS);
        let mut good = begin;
        for value in (0..steps as i32).map(|i| begin * (end / begin).powf(f64::from(i) / steps)) {
            if swings(value) {
                let mut bad = value;
                while (bad / good - 1.0).abs() > RUN_PRECISION {
                    let middle = (good * bad).sqrt();
                    if swings(middle) {
                        bad = middle
                    } else {
                        good = middle
                    }
                }
                return Some(bad);
            }
            good = value;
        }
        free
    };
    let (gain, mass) = (&PlantVariation::with_gain, &PlantVariation::with_mass_ratio);
    FirstUnstable {
        gain_up: find(free.gain_up, limited.gain_up, gain),
        gain_down: find(free.gain_down, limited.gain_down, gain),
        mass_up: find(free.mass_up, limited.mass_up, mass),
        mass_down: find(free.mass_down, limited.mass_down, mass),
        delay_s: find(free.delay_s, limited.delay_s, &PlantVariation::with_delay_s),
        mode: free.mode,
    }
}

/// Below this share two first values are the same.
pub(super) const NO_DIFFERENCE: f64 = 0.01;

/// Whether two first values are not the same.
#[must_use]
pub fn differ(a: f64, b: f64) -> bool {
    (a / b).ln().abs() > NO_DIFFERENCE
}

/// What comes first of all that was judged.
fn worst_case(
    gain_ratio: &[f64; 3],
    radius: &[f64; 3],
    [first, swinging]: [&FirstUnstable; 2],
    period_s: f64,
) -> String {
    let unstable = gain_ratio
        .iter()
        .zip(radius)
        .find(|(_, radius)| radius.is_nan() || **radius >= 1.0);
    if let Some((ratio, radius)) = unstable {
        return format!(
            "unstable where the actuator's gain is {ratio:.2} times the one that the law inverts (largest eigenvalue {radius:.4})"
        );
    }
    let free = least_reserve(first, period_s)
        .map(|(reserve, text)| (reserve, format!("{text} makes it unstable")));
    let limited = least_reserve(swinging, period_s)
        .filter(|(reserve, _)| {
            free.as_ref()
                .is_none_or(|(of_free, _)| *reserve < (1.0 - NO_DIFFERENCE) * of_free)
        })
        .map(|(_, text)| format!("{text} may keep it swinging once the drive was at a limit"));
    match (free, limited) {
        (None, None) => "nothing that was tried makes it unstable".into(),
        (free, limited) => free
            .map(|(_, text)| text)
            .into_iter()
            .chain(limited)
            .collect::<Vec<_>>()
            .join("; "),
    }
}

/// A first unstable value with so many digits, rounded away from what is stable: with the number that is read
/// it *is* unstable. A servo that holds with twice the mass is not told to be unstable with "2.00 times" of
/// it.
#[must_use]
pub fn unstable_from(value: f64, digits: usize, upwards: bool) -> String {
    let scale = 10f64.powi(digits as i32);
    // A number that is as short as that already stays.
    let scaled = value * scale;
    let nearest = scaled.round();
    let rounded = match ((scaled - nearest).abs() < 1e-9 * scaled.abs(), upwards) {
        (true, _) => nearest,
        (false, true) => scaled.ceil(),
        (false, false) => scaled.floor(),
    };
    format!("{:.digits$}", rounded / scale)
}

/// What comes first of the first unstable values, with how far it can go as a factor.
fn least_reserve(first: &FirstUnstable, period_s: f64) -> Option<(f64, String)> {
    let mut cases: Vec<(f64, String)> = Vec::new();
    let mut add = |reserve: Option<f64>, text: String| cases.extend(reserve.map(|r| (r, text)));
    let from = |value: Option<f64>, digits: usize, upwards: bool| {
        unstable_from(value.unwrap_or(f64::NAN), digits, upwards)
    };
    let gain = |gain: Option<f64>, upwards: bool| {
        format!(
            "{} times the gain ({:.1} dB)",
            from(gain, 2, upwards),
            decibels(gain.unwrap_or(f64::NAN))
        )
    };
    add(first.gain_up, gain(first.gain_up, true));
    add(
        first.gain_down.map(|g| 1.0 / g),
        gain(first.gain_down, false),
    );
    add(
        first.mass_up,
        format!("{} times the mass", from(first.mass_up, 2, true)),
    );
    add(
        first.mass_down.map(|m| 1.0 / m),
        format!("{} times the mass", from(first.mass_down, 2, false)),
    );
    let delay_us = first.delay_s.map(|d| 1e6 * d);
    add(
        first.delay_s.map(|d| 1.0 + d / period_s),
        format!("{} us more of delay", from(delay_us, 0, true)),
    );
    if let Some(mode) = first.mode {
        add(
            Some(1.0 + mode.share / 0.05),
            format!(
                "an unknown mode at {:.0} Hz with {} % of the motion",
                mode.frequency_hz,
                unstable_from(100.0 * mode.share, 2, true)
            ),
        );
    }
    cases.into_iter().min_by(|a, b| a.0.total_cmp(&b.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_read_is_unstable_whatever_the_rounding() {
        let shown = |value, upwards| unstable_from(value, 2, upwards);
        assert_eq!(
            [
                shown(2.0013, true),
                shown(2.0, true),
                shown(0.5, false),
                shown(0.3889, false)
            ],
            ["2.01", "2.00", "0.50", "0.38"]
        );
        assert_eq!(unstable_from(70.2, 0, true), "71");
        let first = FirstUnstable {
            mass_up: Some(2.0013),
            ..FirstUnstable::default()
        };
        let said = worst_case(
            &[1.0; 3],
            &[0.9; 3],
            [&first, &FirstUnstable::default()],
            5e-5,
        );
        assert_eq!(said, "2.01 times the mass makes it unstable");
        // Not "0.6 %", with which it is stable.
        let mode = UnstableMode {
            frequency_hz: 2834.0,
            damping_ratio: 0.02,
            share: 0.006_47,
        };
        let said = worst_case(
            &[1.0; 3],
            &[0.9; 3],
            [
                &FirstUnstable {
                    mode: Some(mode),
                    ..first
                },
                &FirstUnstable::default(),
            ],
            5e-5,
        );
        assert!(said.contains("with 0.65 % of the motion"), "{said}");
    }
}
