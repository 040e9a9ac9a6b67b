//! How well the closed loop follows, a figure a second: computed below the tick from the samples that it
//! gives away, never inside it.
//!
//! # How it works
//! [`LoopTelemetry::take`] is given every sample of the closed loop, one after the other. A window is
//! [`SEGMENTS`] segments of a twentieth of a second each. The squares of the tracking error and of the drive
//! are summed in integers, so that nothing depends on the order of size. The amplitude at the resonance is
//! Goertzel's: one recursion in single precision over a segment, whose samples are weighted with Hann's
//! `sin^2(pi n / N)`, and of the window the root mean square of its segments' amplitudes. So it has a band of
//! some +-20 Hz, in which a resonance may drift and still be seen (15 % less at 10 Hz beside it, half at 20
//! Hz), and a slow error of micrometres does not leak into it; errors are taken relative to the segment's
//! first. What rings for one segment only counts with `1 / sqrt(20)`.
//!
//! The error is reference minus sensor's reading, noise included: a loop that only hands on noise of `s` nm
//! RMS shows `s sqrt(6 / N)` at every frequency, 0.08 s at 1000 samples a segment.
//!
//! # Precision
//! The square root is micromath's, a few per cent wrong, and two steps of Heron's that make it exact to
//! single precision. The recursion's coefficient is *not* micromath's cosine: that is wrong by up to
//! 0.001, which near 735 Hz of 20 kHz would listen 14 Hz beside the resonance. [`sine`] is there
//! already, and wrong by 2e-8. What the recursion's rounding leaves of other errors, `A` um RMS, is
//! below `1e-8 A / sin^3(2 pi f / f_s)`: 1e-6 of them at 735 Hz and a thousandth at 80 Hz, the lowest
//! frequency that is taken.

use micromath::F32Ext;

use crate::reference_generator::sine;

/// Segments of a window.
pub const SEGMENTS: u32 = 20;
/// Segments in a second: a window lasts one.
const SEGMENTS_PER_SECOND: u32 = 20;
/// A resonance is so many lines of a segment away from zero and from half the sampling rate, so that
/// neither's mirror image is seen.
const LEAST_LINES: u32 = 4;
/// um with 24 fraction bits to 16, V with 22 to 12: their squares' sums over a window fit in 64 bits up to
/// 100 kHz.
const ERROR_SHIFT: u32 = 8;
const DRIVE_SHIFT: u32 = 10;
/// A largest amplitude that can be an alarm, pm: the whole range of positions.
const MOST_ALARM_PM: u32 = 256_000_000;

/// What [`LoopTelemetry::listen`] takes.
pub const EXPECTED_RESONANCE: &str = "expected a resonance from 80 Hz to 80 Hz below half the sampling rate, or 0 for none, and an alarm within the range of positions, or 0";

/// What is listened to, and what is too much of it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ResonanceWatch {
    /// Frequency of the resonance, mHz; 0: nothing is listened to.
    pub frequency_millihertz: u32,
    /// An amplitude above this raises the alarm, pm; 0: no alarm.
    pub alarm_pm: u32,
}

impl ResonanceWatch {
    /// Whether a target of this sampling rate can listen to that: 80 Hz to 80 Hz below half the sampling
    /// rate, or nothing.
    #[must_use]
    pub fn accepted(&self, sample_rate_hz: u32) -> bool {
        let edge_hz = u64::from(SEGMENTS_PER_SECOND * LEAST_LINES);
        let (lowest, highest) = (
            edge_hz * 1000,
            (u64::from(sample_rate_hz) / 2).saturating_sub(edge_hz) * 1000,
        );
        let heard = (lowest..=highest).contains(&u64::from(self.frequency_millihertz))
            || self.frequency_millihertz == 0;
        heard && self.alarm_pm <= MOST_ALARM_PM
    }
}

/// What a window came to.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LoopFigures {
    /// Tracking error, RMS, pm.
    pub error_rms_pm: u32,
    /// Its largest magnitude, pm.
    pub error_peak_pm: u32,
    /// Drive, RMS, uV.
    pub drive_rms_uv: u32,
    /// Amplitude of the error at the resonance, pm; 0 where nothing is listened to.
    pub resonance_pm: u32,
    /// Windows since the start, this one included.
    pub windows: u32,
    /// Windows without a result because samples were missing: the reader was late.
    pub torn_windows: u32,
    /// The amplitude is above the alarm. It ends at three quarters of it, so that one event raises one alarm.
    pub alarm: bool,
}

/// One line of a spectrum, over one segment.
#[derive(Clone, Copy, Debug, Default)]
struct Goertzel {
    cosine: f32,
    sine: f32,
    last: [f32; 2],
}

impl Goertzel {
    /// Of a frequency in turns per sample, 2^32 a turn.
    fn new(increment: u32) -> Self {
        let unit = |value: i32| value as f32 / (1u32 << 30) as f32;
        Self {
            cosine: unit(sine(increment.wrapping_add(1 << 30))),
            sine: unit(sine(increment)),
            last: [0.0; 2],
        }
    }

    fn take(&mut self, value: f32) {
        let [one, two] = self.last;
        self.last = [value + 2.0 * self.cosine * one - two, one];
    }

    /// Square of the sum of values times phases; begins anew.
    fn finish(&mut self) -> f32 {
        let [one, two] = core::mem::take(&mut self.last);
        let (real, imaginary) = (one - two * self.cosine, two * self.sine);
        real * real + imaginary * imaginary
    }
}

/// The figures of the closed loop, window by window.
#[derive(Clone, Debug)]
pub struct LoopTelemetry {
    segment_ticks: u32,
    /// Hann's phase from sample to sample, half turns of 2^31 in a segment.
    hann_increment: u32,
    watch: ResonanceWatch,
    line: Goertzel,
    sample_rate_hz: u32,
    /// The tick that is expected next.
    next_tick: u32,
    in_segment: u32,
    /// The error with which the segment began.
    first_error: i32,
    segments: u32,
    error_squares: u64,
    drive_squares: u64,
    error_peak: u32,
    /// Of the segments so far.
    powers: f32,
    figures: LoopFigures,
}

impl LoopTelemetry {
    /// For samples at this rate; nothing is listened to.
    #[must_use]
    pub const fn new(sample_rate_hz: u32) -> Self {
        let segment_ticks = if sample_rate_hz < SEGMENTS_PER_SECOND {
            1
        } else {
            sample_rate_hz / SEGMENTS_PER_SECOND
        };
        Self {
            segment_ticks,
            hann_increment: (1 << 31) / segment_ticks,
            watch: ResonanceWatch {
                frequency_millihertz: 0,
                alarm_pm: 0,
            },
            line: Goertzel {
                cosine: 0.0,
                sine: 0.0,
                last: [0.0; 2],
            },
            sample_rate_hz,
            next_tick: 0,
            in_segment: 0,
            first_error: 0,
            segments: 0,
            error_squares: 0,
            drive_squares: 0,
            error_peak: 0,
            powers: 0.0,
            figures: LoopFigures {
                error_rms_pm: 0,
                error_peak_pm: 0,
                drive_rms_uv: 0,
                resonance_pm: 0,
                windows: 0,
                torn_windows: 0,
                alarm: false,
            },
        }
    }

    /// Samples of a window.
    #[must_use]
    pub fn window_ticks(&self) -> u32 {
        self.segment_ticks * SEGMENTS
    }

    /// Listens to something else from now on; the window begins anew, and what was heard before is forgotten.
    ///
    /// # Errors
    /// It cannot be listened to ([`ResonanceWatch::accepted`]); nothing has changed then.
    pub fn listen(&mut self, watch: ResonanceWatch) -> Result<(), &'static str> {
        if !watch.accepted(self.sample_rate_hz) {
            return Err(EXPECTED_RESONANCE);
        }
        // Half a last place is 2e-6 Hz.
        let increment = ((u64::from(watch.frequency_millihertz) << 32)
            / (1000 * u64::from(self.sample_rate_hz.max(1)))) as u32;
        self.line = Goertzel::new(increment);
        self.watch = watch;
        (self.figures.resonance_pm, self.figures.alarm) = (0, false);
        self.begin();
        Ok(())
    }

    /// What is listened to.
    #[must_use]
    pub fn watch(&self) -> ResonanceWatch {
        self.watch
    }

    /// What the last whole window came to; zeros before the first.
    #[must_use]
    pub fn figures(&self) -> LoopFigures {
        self.figures
    }

    /// Forgets the window that has begun: the loop is open.
    pub fn begin(&mut self) {
        (self.in_segment, self.segments) = (0, 0);
        (
            self.error_squares,
            self.drive_squares,
            self.error_peak,
            self.powers,
        ) = (0, 0, 0, 0.0);
        self.line.last = [0.0; 2];
    }

    /// Takes the tracking error (um with 24 fraction bits) and the drive (V with 22) of a tick of the closed
    /// loop; `Some` when it ends a window: whether an alarm begins with it.
    pub fn take(&mut self, tick: u32, error: i32, drive: i32) -> Option<bool> {
        if (self.in_segment, self.segments) != (0, 0) && tick != self.next_tick {
            self.figures.torn_windows = self.figures.torn_windows.saturating_add(1);
            self.begin();
        }
        self.next_tick = tick.wrapping_add(1);
        let rounded = |value: i32, shift: u32| {
            u64::from(((i64::from(value) + (1 << (shift - 1))) >> shift).unsigned_abs() as u32)
        };
        let (small_error, small_drive) = (rounded(error, ERROR_SHIFT), rounded(drive, DRIVE_SHIFT));
        self.error_squares = self.error_squares.saturating_add(small_error * small_error);
        self.drive_squares = self.drive_squares.saturating_add(small_drive * small_drive);
        self.error_peak = self.error_peak.max(error.unsigned_abs());
        if self.in_segment == 0 {
            self.first_error = error;
        }
        if self.watch.frequency_millihertz > 0 {
            let root = sine(self.in_segment.wrapping_mul(self.hann_increment)) as f32
                / (1u32 << 30) as f32;
            self.line
                .take(error.saturating_sub(self.first_error) as f32 * root * root);
        }
        self.in_segment += 1;
        if self.in_segment < self.segment_ticks {
            return None;
        }
        self.in_segment = 0;
        self.segments += 1;
        self.powers += self.line.finish();
        if self.segments < SEGMENTS {
            return None;
        }
        Some(self.finish())
    }

    /// Ends a window; whether an alarm begins.
    fn finish(&mut self) -> bool {
        const PM_PER_UM: f32 = 1e6;
        const UV_PER_V: f32 = 1e6;
        let ticks = self.window_ticks() as f32;
        let error =
            square_root(self.error_squares as f32 / ticks) / (1u32 << (24 - ERROR_SHIFT)) as f32;
        let drive =
            square_root(self.drive_squares as f32 / ticks) / (1u32 << (22 - DRIVE_SHIFT)) as f32;
        // Hann's weights have the mean of a half, and half of a sine turns with the phases: a quarter of the
        // amplitude from every sample.
        let resonance = square_root(self.powers / SEGMENTS as f32) * 4.0
            / self.segment_ticks as f32
            / (1u32 << 24) as f32;
        let resonance_pm = whole(resonance * PM_PER_UM);
        let before = self.figures.alarm;
        // 75 % of the alarm ends an event.
        let level = if before {
            self.watch.alarm_pm / 4 * 3
        } else {
            self.watch.alarm_pm
        };
        self.figures = LoopFigures {
            error_rms_pm: whole(error * PM_PER_UM),
            error_peak_pm: (u64::from(self.error_peak) * 1_000_000 / (1 << 24)) as u32,
            drive_rms_uv: whole(drive * UV_PER_V),
            resonance_pm,
            windows: self.figures.windows.saturating_add(1),
            alarm: self.watch.alarm_pm > 0 && resonance_pm > level,
            ..self.figures
        };
        self.begin();
        self.figures.alarm && !before
    }
}

/// To the nearest whole number that 32 bits hold.
fn whole(value: f32) -> u32 {
    (value + 0.5) as u32
}

/// Square root of what is not negative: micromath's estimate, and Heron's steps from a few per cent to the
/// last place but one.
pub(crate) fn square_root(square: f32) -> f32 {
    if square <= 0.0 {
        return 0.0;
    }
    let heron = |root: f32| 0.5 * (root + square / root);
    heron(heron(F32Ext::sqrt(square)))
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;
    use core::f64::consts::PI;
    use proptest::prelude::*;
    use std::vec::Vec;

    const RATE: u32 = 20_000;
    const SEGMENT: usize = 1000;

    /// What a window must come to, in f64 from the definitions: RMS and peak of the error, nm, RMS of the
    /// drive, mV, and the root mean square of the segments' amplitudes, nm, by sums over sines and cosines.
    fn oracle(samples: &[(i32, i32)], frequency_hz: f64) -> [f64; 4] {
        let error_nm = |sample: &(i32, i32)| f64::from(sample.0) / f64::from(1 << 24) * 1000.0;
        let drive_mv = |sample: &(i32, i32)| f64::from(sample.1) / f64::from(1 << 22) * 1000.0;
        let rms = |values: &mut dyn Iterator<Item = f64>| {
            (values.map(|v| v * v).sum::<f64>() / samples.len() as f64).sqrt()
        };
        let power = |segment: &[(i32, i32)]| {
            let (mut real, mut imaginary, mut weights) = (0.0, 0.0, 0.0);
            for (n, sample) in segment.iter().enumerate() {
                let weight = (1.0 - (2.0 * PI * n as f64 / segment.len() as f64).cos()) / 2.0;
                let phase = 2.0 * PI * frequency_hz * n as f64 / f64::from(RATE);
                let error_nm = error_nm(sample) - error_nm(&segment[0]);
                real += weight * error_nm * phase.cos();
                imaginary += weight * error_nm * phase.sin();
                weights += weight;
            }
            (real * real + imaginary * imaginary) * 4.0 / (weights * weights)
        };
        let powers: Vec<f64> = samples.chunks(SEGMENT).map(power).collect();
        [
            rms(&mut samples.iter().map(error_nm)),
            samples
                .iter()
                .map(error_nm)
                .fold(0.0, |most, error| most.max(error.abs())),
            rms(&mut samples.iter().map(drive_mv)),
            (powers.iter().sum::<f64>() / powers.len() as f64).sqrt(),
        ]
    }

    fn listening(frequency_hz: f64, alarm_nm: u32) -> LoopTelemetry {
        let mut telemetry = LoopTelemetry::new(RATE);
        let watch = ResonanceWatch {
            frequency_millihertz: (frequency_hz * 1000.0).round() as u32,
            alarm_pm: alarm_nm * 1000,
        };
        telemetry
            .listen(watch)
            .expect("a frequency that can be heard");
        telemetry
    }

    /// All samples, which begin at this tick; whether an alarm began with the last window that ended.
    fn run(telemetry: &mut LoopTelemetry, first_tick: u32, samples: &[(i32, i32)]) -> Option<bool> {
        let mut told = None;
        for (n, (error, drive)) in samples.iter().enumerate() {
            told = telemetry
                .take(first_tick.wrapping_add(n as u32), *error, *drive)
                .or(told);
        }
        told
    }

    fn micrometres(um: f64) -> i32 {
        (um * f64::from(1 << 24)).round() as i32
    }

    /// Tones `(Hz, um, phase)` on a constant error and white noise, all um, under a sine of the drive.
    fn window(
        tones: &[(f64, f64, f64)],
        constant_um: f64,
        noise_um: f64,
        seed: u32,
    ) -> Vec<(i32, i32)> {
        let mut state = seed | 1;
        (0..RATE)
            .map(|n| {
                let t = f64::from(n) / f64::from(RATE);
                state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                let noise =
                    (f64::from(state) / f64::from(u32::MAX) - 0.5) * 12f64.sqrt() * noise_um;
                let tone: f64 = tones
                    .iter()
                    .map(|(hz, um, phase)| um * (2.0 * PI * hz * t + phase).sin())
                    .sum();
                let drive_v = 40.0 + 35.0 * (2.0 * PI * 10.0 * t).sin();
                (
                    micrometres((tone + constant_um + noise).clamp(-127.0, 127.0)),
                    (drive_v * f64::from(1 << 22)) as i32,
                )
            })
            .collect()
    }

    /// Ours beside the oracle's: RMS to 0.01 % and 0.01 nm (the error is summed in steps of 0.015 nm), peak
    /// to 1 pm, drive to 0.01 % and 0.25 mV, amplitude to 0.01 % and what the recursion's rounding leaves of
    /// the whole error.
    fn agree(figures: LoopFigures, expected: [f64; 4], frequency_hz: f64) {
        let [rms_nm, peak_nm, drive_mv, resonance_nm] = expected;
        let near = |ours: u32, expected: f64, share: f64, beside: f64| {
            let ours = f64::from(ours) / 1000.0;
            assert!(
                (ours - expected).abs() <= share * expected + beside,
                "{ours} instead of {expected} of {figures:?}"
            );
        };
        near(figures.error_rms_pm, rms_nm, 1e-4, 0.01);
        near(figures.error_peak_pm, peak_nm, 0.0, 0.0011);
        near(figures.drive_rms_uv, drive_mv, 1e-4, 0.25);
        let left = 1e-8 / (2.0 * PI * frequency_hz / f64::from(RATE)).sin().powi(3);
        near(
            figures.resonance_pm,
            resonance_nm,
            1e-4,
            left * rms_nm + 0.001,
        );
    }

    #[test]
    fn a_known_sine_at_the_resonance_comes_out() {
        let samples = window(&[(735.0, 0.041, 0.3)], 0.0, 0.0, 1);
        let mut telemetry = listening(735.0, 20);
        assert_eq!(
            run(&mut telemetry, u32::MAX - 7, &samples),
            Some(true),
            "41 nm are above the alarm of 20"
        );
        let figures = telemetry.figures();
        assert!(figures.resonance_pm.abs_diff(41_000) < 20, "{figures:?}");
        assert!(
            figures
                .error_rms_pm
                .abs_diff((41_000.0 / 2f64.sqrt()) as u32)
                < 20,
            "{figures:?}"
        );
        assert!(figures.error_peak_pm.abs_diff(41_000) < 20, "{figures:?}");
        // 40 V and a sine of 35 V.
        assert!(
            figures
                .drive_rms_uv
                .abs_diff((40f64.hypot(35.0 / 2f64.sqrt()) * 1e6) as u32)
                < 300,
            "{figures:?}"
        );
        assert_eq!(
            (figures.windows, figures.torn_windows, figures.alarm),
            (1, 0, true)
        );
        agree(figures, oracle(&samples, 735.0), 735.0);
    }

    #[test]
    fn what_lies_elsewhere_is_not_taken_for_the_resonance() {
        // A slow error of 2 um, a line 100 Hz away and a constant of 1 um: below 0.2 nm of 3 um, and no
        // alarm.
        let samples = window(&[(10.0, 2.0, 0.0), (835.0, 0.5, 1.0)], 1.0, 0.0, 1);
        let mut telemetry = listening(735.0, 20);
        assert_eq!(run(&mut telemetry, 0, &samples), Some(false));
        assert!(
            telemetry.figures().resonance_pm < 200,
            "{:?}",
            telemetry.figures()
        );
        // And a resonance that has drifted by 10 Hz is still seen.
        let drifted = window(&[(745.0, 0.041, 0.3)], 0.0, 0.0, 1);
        assert_eq!(run(&mut telemetry, RATE, &drifted), Some(true));
        assert!(
            telemetry.figures().resonance_pm.abs_diff(34_800) < 400,
            "{:?}",
            telemetry.figures()
        );
    }

    #[test]
    fn an_event_is_told_once() {
        let mut telemetry = listening(735.0, 20);
        let mut tick = 0;
        let mut told = |telemetry: &mut LoopTelemetry, nm: f64| {
            let began = run(
                telemetry,
                tick,
                &window(&[(735.0, nm / 1000.0, 0.0)], 0.0, 0.0, 1),
            );
            tick += RATE;
            (began, telemetry.figures().alarm)
        };
        assert_eq!(told(&mut telemetry, 19.0), (Some(false), false));
        assert_eq!(told(&mut telemetry, 21.0), (Some(true), true));
        assert_eq!(told(&mut telemetry, 30.0), (Some(false), true));
        // Below the alarm, and not yet below three quarters of it: the same event.
        assert_eq!(told(&mut telemetry, 19.0), (Some(false), true));
        assert_eq!(told(&mut telemetry, 21.0), (Some(false), true));
        assert_eq!(told(&mut telemetry, 14.0), (Some(false), false));
        assert_eq!(told(&mut telemetry, 21.0), (Some(true), true));
        telemetry
            .listen(ResonanceWatch {
                frequency_millihertz: 735_000,
                alarm_pm: 0,
            })
            .expect("no alarm");
        assert!(!telemetry.figures().alarm);
        assert_eq!(
            told(&mut telemetry, 900.0),
            (Some(false), false),
            "0 is no alarm"
        );
    }

    #[test]
    fn a_window_is_whole_or_none() {
        let samples = window(&[(735.0, 0.041, 0.3)], 0.0, 0.0, 1);
        let mut telemetry = listening(735.0, 0);
        // A sample is missing: the window begins anew behind the gap.
        assert_eq!(run(&mut telemetry, 0, &samples[..5000]), None);
        assert_eq!(run(&mut telemetry, 5001, &samples[..19_999]), None);
        assert_eq!(
            (
                telemetry.figures().windows,
                telemetry.figures().torn_windows
            ),
            (0, 1)
        );
        assert_eq!(run(&mut telemetry, 25_000, &samples[19_999..]), Some(false));
        agree(telemetry.figures(), oracle(&samples, 735.0), 735.0);
        assert_eq!(
            (
                telemetry.figures().windows,
                telemetry.figures().torn_windows
            ),
            (1, 1)
        );
        // An open loop ends a window without counting it.
        assert_eq!(run(&mut telemetry, 25_001, &samples[..100]), None);
        telemetry.begin();
        assert_eq!(run(&mut telemetry, 90_000, &samples), Some(false));
        assert_eq!(
            (
                telemetry.figures().windows,
                telemetry.figures().torn_windows
            ),
            (2, 1)
        );
    }

    #[test]
    fn the_ends_of_the_formats_fit() {
        let mut telemetry = listening(735.0, 20);
        run(
            &mut telemetry,
            0,
            &std::vec![(i32::MIN, i32::MIN); RATE as usize],
        );
        let figures = telemetry.figures();
        assert!(
            figures.error_rms_pm.abs_diff(128_000_000) < 13_000
                && figures.error_peak_pm == 128_000_000,
            "{figures:?}"
        );
        assert!(
            figures.drive_rms_uv.abs_diff(512_000_000) < 52_000,
            "{figures:?}"
        );
    }

    #[test]
    fn what_cannot_be_heard_is_refused() {
        let watch = |millihertz, alarm_pm| {
            ResonanceWatch {
                frequency_millihertz: millihertz,
                alarm_pm,
            }
            .accepted(RATE)
        };
        assert!(watch(0, 0) && watch(80_000, 1) && watch(9_920_000, 256_000_000));
        assert!(!watch(79_999, 0) && !watch(9_920_001, 0) && !watch(735_000, 256_000_001));
        let mut telemetry = listening(735.0, 20);
        assert!(
            telemetry
                .listen(ResonanceWatch {
                    frequency_millihertz: 1,
                    alarm_pm: 0
                })
                .is_err()
        );
        assert_eq!(
            telemetry.watch(),
            ResonanceWatch {
                frequency_millihertz: 735_000,
                alarm_pm: 20_000
            }
        );
    }

    #[test]
    fn the_square_root_is_one() {
        for n in 0..4000 {
            let square = (0.01 * f64::from(n)).exp() as f32 * 1e-6;
            let share = f64::from(square_root(square)) / f64::from(square).sqrt() - 1.0;
            assert!(share.abs() < 2e-6, "{share} at {square}");
        }
        assert_eq!(square_root(0.0), 0.0);
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(96))]

        #[test]
        fn figures_are_those_of_the_plain_transform(
            frequency_hz in 80.0f64..9920.0,
            tones in prop::collection::vec((1.0f64..9900.0, -4.0f64..2.0, 0.0f64..6.3), 0..4),
            at_resonance in (-5.0f64..1.0, 0.0f64..6.3),
            constant_um in -20.0f64..20.0,
            noise in -5.0f64..0.0,
            seed in any::<u32>(),
            first_tick in any::<u32>(),
        ) {
            let frequency_hz = (frequency_hz * 1000.0).round() / 1000.0;
            let mut all: Vec<_> = tones.into_iter().map(|(hz, exponent, phase)| (hz, 10f64.powf(exponent) / 4.0, phase)).collect();
            all.push((frequency_hz, 10f64.powf(at_resonance.0), at_resonance.1));
            let samples = window(&all, constant_um, 10f64.powf(noise), seed);
            let mut telemetry = listening(frequency_hz, 0);
            run(&mut telemetry, first_tick, &samples);
            agree(telemetry.figures(), oracle(&samples, frequency_hz), frequency_hz);
        }
    }
}
