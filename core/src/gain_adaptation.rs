//! A slow correction of the actuator model's gain, learned from what the unknown input carries of the
//! reference's own motion.
//!
//! # How it works
//! An actuator whose gain is `g` times the model's moves by `g v` where `v` was meant. The observer of the
//! predictor law takes the difference for an unknown input, `d = (g - 1) v`, and undoes it, but as late as it
//! is: at rest nothing is left of it, at 150 Hz much. A part of `d` that moves as the feedforward `v_ff` does
//! is therefore a wrong gain, and nothing else that is slow is (creep, drift and noise do not move with
//! `v_ff`, which holds nothing that was measured). With `c` the gain that is believed, over windows of
//! [`WINDOW_BLOCKS`] means of [`BLOCK_TICKS`] ticks,
//!
//! `c := c (1 + m q)`, `q = sum(D d D v_ff) / sum(D v_ff^2)`,
//!
//! `D` the difference from one mean to the next, which holds no constant and little of what is slow. For `q`
//! stands the power of two that the places of its two sums give, half of it, so there is no division: `m` is
//! between a quarter and one. A step is at most [`AdaptationParameters::most_step`], `c` within one plus or
//! minus [`AdaptationParameters::most`].
//!
//! The gain is not a factor in the tick but in the law's coefficients: with the law's output in the model's
//! um, the feedforward, the control gain and the observer's gains of the unknown input are divided by `c`,
//! the column of the drive in the observer is multiplied by it. At each tick behind a window a few of these
//! are computed from those of the block, and then all are taken at once, with the unknown input taking the
//! difference, so that the drive makes no step ([`crate::predictor_law::PredictorLaw::rescale`]).
//!
//! Nothing is learned while the drive is at a limit, while the error is beyond
//! [`AdaptationParameters::error_limit`], while an alarm holds it ([`GainAdaptation::hold`]), and for
//! [`SETTLING_TICKS`] behind each of these; a window whose reference moved by less than
//! [`AdaptationParameters::least_motion`] is let by.

use crate::predictor_law::{GainCoefficients, PredictorParameters};
use crate::reference_window::WINDOW;

/// Ticks of a mean.
pub const BLOCK_TICKS: u32 = 16;
/// Means of a window; with [`BLOCK_TICKS`] 0.1 s at 20 kHz.
pub const WINDOW_BLOCKS: u32 = 128;
/// Ticks without a limit, an error or a change of the law before something is learned.
pub const SETTLING_TICKS: u32 = 512;
/// Fraction bits of a gain.
pub const GAIN_FRACTION_BITS: u32 = 24;
/// A gain of one.
pub const ONE: i32 = 1 << GAIN_FRACTION_BITS;
/// A gain farther from one than this is not accepted: the law is proved for it on actuators that are as far
/// from the model to the other side.
pub const MOST: i32 = ONE / 5;
/// Largest step that is accepted.
pub const LARGEST_STEP: i32 = ONE / 32;
/// Shift of a mean: its sum keeps the format of what is summed.
const MEAN_SHIFT: u32 = BLOCK_TICKS.trailing_zeros();
/// From um with 24 fraction bits to what is multiplied: the sums of a window fit 64 bits.
const PRODUCT_SHIFT: u32 = 8;
/// A step is so many binary places below the quotient's.
const STEP_SHIFT: u32 = 1;

/// What the host chooses.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct AdaptationParameters {
    /// Farthest from one, with [`GAIN_FRACTION_BITS`]; at most [`MOST`].
    pub most: i32,
    /// Largest step of a window, with [`GAIN_FRACTION_BITS`]; at most [`LARGEST_STEP`].
    pub most_step: i32,
    /// Nothing is learned from errors beyond this, um with 24 fraction bits.
    pub error_limit: i32,
    /// RMS change of the feedforward from mean to mean below which a window says nothing, um with 24 fraction
    /// bits.
    pub least_motion: i32,
}

impl AdaptationParameters {
    /// Whether these are bounds.
    #[must_use]
    pub fn accepted(&self) -> bool {
        (1..=MOST).contains(&self.most)
            && (1..=LARGEST_STEP).contains(&self.most_step)
            && self.error_limit > 0
            && self.least_motion >> PRODUCT_SHIFT > 0
    }

    /// The sum of squares that a window must have.
    fn least_sum(&self) -> i64 {
        let least = i64::from(self.least_motion >> PRODUCT_SHIFT);
        least * least * i64::from(WINDOW_BLOCKS)
    }
}

/// The gain with what it is learned from.
#[derive(Clone, Debug)]
pub struct GainAdaptation {
    on: bool,
    /// Sums of the block, of the unknown input and of the feedforward: their means, um with 24 fraction bits.
    sums: [i32; 2],
    ticks: u32,
    /// Means of the block before.
    before: [i32; 2],
    /// Blocks of the window; the first only gives `before`.
    blocks: u32,
    product: i64,
    square: i64,
    waiting: u32,
    held: bool,
    gain: i32,
    inverse: i32,
    /// Windows that would have taken the gain beyond its bounds.
    bounded_windows: u32,
    /// The coefficient of the feedforward that is computed next; none while nothing is prepared.
    preparing: Option<u8>,
    /// Coefficients of the block, and for the gain that comes.
    base: GainCoefficients,
    next: GainCoefficients,
}

impl GainAdaptation {
    /// Adapts nothing.
    #[must_use]
    pub const fn off() -> Self {
        Self {
            on: false,
            sums: [0; 2],
            ticks: 0,
            before: [0; 2],
            blocks: 0,
            product: 0,
            square: 0,
            waiting: 0,
            held: false,
            gain: ONE,
            inverse: ONE,
            bounded_windows: 0,
            preparing: None,
            base: GainCoefficients::NONE,
            next: GainCoefficients::NONE,
        }
    }

    /// Believes the model of a law; without one nothing is adapted.
    pub fn begin(&mut self, law: Option<&PredictorParameters>) {
        self.on = law.is_some();
        (
            self.gain,
            self.inverse,
            self.bounded_windows,
            self.preparing,
        ) = (ONE, ONE, 0, None);
        self.wait();
        if let Some(law) = law {
            self.base = law.of_gain();
        }
    }

    /// Whether a gain is adapted.
    #[inline]
    #[must_use]
    pub fn is_on(&self) -> bool {
        self.on
    }

    /// The gain over the model's, with [`GAIN_FRACTION_BITS`].
    #[must_use]
    pub fn gain(&self) -> i32 {
        self.gain
    }

    /// Windows that would have taken the gain beyond its bounds.
    #[must_use]
    pub fn bounded_windows(&self) -> u32 {
        self.bounded_windows
    }

    /// The coefficients of the block.
    #[must_use]
    pub fn base(&self) -> &GainCoefficients {
        &self.base
    }

    /// Whether something outside forbids to learn: an alarm.
    pub fn hold(&mut self, held: bool) {
        self.held = held;
    }

    /// The window begins again, some ticks from now.
    pub fn wait(&mut self) {
        self.waiting = SETTLING_TICKS;
    }

    fn begin_window(&mut self) {
        (
            self.sums,
            self.ticks,
            self.blocks,
            self.product,
            self.square,
        ) = ([0; 2], 0, 0, 0, 0);
    }

    /// Behind each tick of the law: its unknown input and its feedforward for the next period, um with 24
    /// fraction bits. `trusted`: the drive was not at a limit and the error within its own. Gives
    /// coefficients that the law is to take.
    #[inline]
    pub fn observe(
        &mut self,
        parameters: &AdaptationParameters,
        unknown: i32,
        feedforward: i32,
        trusted: bool,
    ) -> Option<&GainCoefficients> {
        if let Some(nth) = self.preparing {
            return self.prepare(nth);
        }
        if !trusted || self.held {
            self.wait();
        }
        if self.waiting > 0 {
            self.waiting -= 1;
            self.begin_window();
            return None;
        }
        let [unknowns, feedforwards] = self.sums;
        self.sums = [
            unknowns.saturating_add(unknown >> MEAN_SHIFT),
            feedforwards.saturating_add(feedforward >> MEAN_SHIFT),
        ];
        self.ticks += 1;
        if self.ticks >= BLOCK_TICKS {
            self.end_block(parameters);
        }
        None
    }

    #[inline(never)]
    fn end_block(&mut self, parameters: &AdaptationParameters) {
        let means = core::mem::take(&mut self.sums);
        let changes = [
            means[0].saturating_sub(self.before[0]),
            means[1].saturating_sub(self.before[1]),
        ];
        self.before = means;
        self.ticks = 0;
        if self.blocks > 0 {
            let [unknown, feedforward] = changes.map(|change| i64::from(change >> PRODUCT_SHIFT));
            self.product = self.product.saturating_add(unknown * feedforward);
            self.square = self.square.saturating_add(feedforward * feedforward);
        }
        self.blocks += 1;
        if self.blocks > WINDOW_BLOCKS {
            if self.square >= parameters.least_sum() {
                self.step(parameters);
            }
            self.begin_window();
        }
    }

    /// Moves the gain by what a window says of it.
    fn step(&mut self, parameters: &AdaptationParameters) {
        // Places that the quotient is below one; an unknown input larger than the motion counts as large as
        // it.
        let places = self
            .product
            .unsigned_abs()
            .leading_zeros()
            .saturating_sub(self.square.leading_zeros());
        let relative = ONE
            .checked_shr(places + STEP_SHIFT)
            .unwrap_or(0)
            .min(parameters.most_step);
        let step = if self.product < 0 {
            -relative
        } else {
            relative
        };
        let wanted = self.gain.saturating_add(times(self.gain, step));
        let within = wanted.max(ONE - parameters.most).min(ONE + parameters.most);
        if within != wanted {
            self.bounded_windows = self.bounded_windows.saturating_add(1);
        }
        if within != self.gain {
            self.gain = within;
            // Newton's rule for the reciprocal: each round squares what is missing, and a step is small.
            for _ in 0..3 {
                self.inverse = times(
                    self.inverse,
                    (2 * ONE).saturating_sub(times(self.gain, self.inverse)),
                );
            }
            self.preparing = Some(0);
        }
    }

    /// Computes some more coefficients; gives all of them behind the last.
    fn prepare(&mut self, nth: u8) -> Option<&GainCoefficients> {
        let (gain, inverse, at) = (self.gain, self.inverse, usize::from(nth));
        let (base, next) = (&self.base, &mut self.next);
        scale(&base.feedforward, &mut next.feedforward, at, inverse);
        scale(&base.gain_row, &mut next.gain_row, at, inverse);
        scale(&base.unknown, &mut next.unknown, at, inverse);
        scale(&base.drive, &mut next.drive, at, gain);
        if at + 1 < WINDOW {
            self.preparing = Some(nth + 1);
            return None;
        }
        self.preparing = None;
        self.wait();
        Some(&self.next)
    }
}

/// A coefficient times a gain, where there are so many.
#[inline(never)]
fn scale(base: &[i32], next: &mut [i32], nth: usize, gain: i32) {
    if let (Some(to), Some(from)) = (next.get_mut(nth), base.get(nth)) {
        *to = times(*from, gain);
    }
}

/// A value times a gain, rounded; where both are within their bounds it fits.
#[inline]
fn times(value: i32, gain: i32) -> i32 {
    let wide = (i64::from(value) * i64::from(gain) + (1i64 << (GAIN_FRACTION_BITS - 1)))
        >> GAIN_FRACTION_BITS;
    wide.max(i64::from(i32::MIN)).min(i64::from(i32::MAX)) as i32
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;
    use crate::codes::{DriveCode, SensorCode};
    use crate::parameter_block::tests::example;
    use crate::predictor_law::{
        OUTPUT_ROW_FRACTION_BITS, PredictorParameters, STATE_ROW_FRACTION_BITS, STATES,
    };
    use crate::reference_window::PREVIEW_TICKS;
    use crate::servo_parameters::{ActuatorParameters, LawParameters, ServoParameters};
    use crate::servo_tick::ServoTick;
    use crate::signal::Micrometres;
    use proptest::prelude::*;
    use std::vec::Vec;

    const BOUNDS: AdaptationParameters = AdaptationParameters {
        most: MOST,
        most_step: ONE / 200,
        error_limit: 1 << 23,
        least_motion: ONE / 100,
    };

    /// A law for an actuator without dynamics: its state is the reading that is predicted, and what is fed
    /// forward the reference at the end of the period in which it acts, two samples after now.
    fn law() -> PredictorParameters {
        let mut p = PredictorParameters {
            state_rows: Default::default(),
            unknown_gain: (1 << STATE_ROW_FRACTION_BITS) / 16,
            slope_gain: 0,
            reading_row: Default::default(),
            gain_row: Default::default(),
            feedforward: Default::default(),
        };
        p.state_rows[0].coefficients[STATES + 1] = 1 << STATE_ROW_FRACTION_BITS;
        p.reading_row.coefficients[0] = 1 << STATE_ROW_FRACTION_BITS;
        p.feedforward.coefficients[WINDOW - PREVIEW_TICKS + 1] = 1 << OUTPUT_ROW_FRACTION_BITS;
        p
    }

    fn parameters(adaptation: Option<AdaptationParameters>) -> ServoParameters {
        let mut servo = example().servo;
        servo.actuator = ActuatorParameters::Linear {
            volts_per_micrometre: 7 << 20,
            micrometres_per_volt: (1 << 28) / 7,
        };
        servo.law = LawParameters::Predictor(law());
        servo.adaptation = adaptation;
        servo
    }

    /// An actuator without dynamics whose gain is so many hundredths of the model's, following a triangle;
    /// the codes and errors of all ticks.
    fn run(
        servo: &mut ServoTick,
        hundredths: i64,
        ticks: usize,
        amplitude: i32,
    ) -> (Vec<DriveCode>, Vec<i32>) {
        let c = servo.parameters().converters;
        let code_of = |um: i64| {
            SensorCode::new(
                (((um - i64::from(c.adc_zero)) << 16) / c.adc_step).clamp(0, 65_535) as u32,
            )
        };
        let reference =
            |k: usize| (5 << 24) + ((k % 200).min(200 - k % 200) as i32 - 50) * (amplitude / 50);
        servo.open_loop(c.dac_code_min + 16_000);
        let mut acting = i64::from(servo.applied().to_bits());
        let (mut codes, mut errors) = (Vec::new(), Vec::new());
        servo.enable();
        for k in 0..ticks {
            let read = code_of(acting * hundredths / 100);
            let coming = i64::from(servo.applied().to_bits());
            codes.push(servo.tick(read, Micrometres::from_bits(reference(k + PREVIEW_TICKS))));
            errors.push((servo.reference() - servo.reading()).to_bits());
            acting = coming;
        }
        (codes, errors)
    }

    fn largest(errors: &[i32]) -> i32 {
        errors.iter().map(|e| e.abs()).max().unwrap_or(0)
    }

    fn gain(servo: &ServoTick) -> f64 {
        f64::from(servo.adaptation().map_or(0, GainAdaptation::gain)) / f64::from(ONE)
    }

    #[test]
    fn the_gain_of_an_actuator_is_found_and_the_error_falls() {
        for hundredths in [82, 90, 95, 106, 118] {
            let mut servo = ServoTick::new(parameters(Some(BOUNDS)));
            let (_, errors) = run(&mut servo, hundredths, 140_000, 1 << 23);
            let found = gain(&servo);
            assert!(
                (found - hundredths as f64 / 100.0).abs() < 0.003,
                "{hundredths}: {found}"
            );
            let (before, after) = (largest(&errors[4000..8000]), largest(&errors[130_000..]));
            assert!(after * 5 < before, "{hundredths}: {before} {after}");
            assert_eq!(servo.counters().saturated_values, 0);
        }
    }

    #[test]
    fn a_gain_beyond_the_bounds_stays_at_them_and_is_counted() {
        for (hundredths, expected) in [(140, ONE + MOST), (70, ONE - MOST)] {
            let mut servo = ServoTick::new(parameters(Some(BOUNDS)));
            run(&mut servo, hundredths, 200_000, 1 << 22);
            let adaptation = servo.adaptation().expect("on");
            assert_eq!(adaptation.gain(), expected);
            assert!(adaptation.bounded_windows() > 0);
        }
    }

    #[test]
    fn nothing_is_learned_at_rest_while_held_or_from_large_errors() {
        let stays = |bounds: AdaptationParameters, held: bool, amplitude: i32| {
            let mut servo = ServoTick::new(parameters(Some(bounds)));
            servo.hold_adaptation(held);
            run(&mut servo, 85, 60_000, amplitude);
            servo.adaptation().map(GainAdaptation::gain) == Some(ONE)
        };
        assert!(!stays(BOUNDS, false, 1 << 23));
        assert!(stays(BOUNDS, true, 1 << 23), "held");
        assert!(stays(BOUNDS, false, 0), "at rest");
        assert!(
            stays(
                AdaptationParameters {
                    error_limit: 1 << 16,
                    ..BOUNDS
                },
                false,
                1 << 23
            ),
            "errors"
        );
        // A drive that meets its limit in every period.
        let mut limited = parameters(Some(BOUNDS));
        limited.converters.dac_code_max = limited.converters.dac_code_min + 17_000;
        let mut servo = ServoTick::new(limited);
        run(&mut servo, 85, 60_000, 1 << 24);
        assert!(servo.counters().limited_ticks > 100);
        assert_eq!(servo.adaptation().map(GainAdaptation::gain), Some(ONE));
    }

    #[test]
    fn without_bounds_nothing_changes_and_the_first_window_changes_nothing_either() {
        let run = |bounds: Option<AdaptationParameters>| {
            run(&mut ServoTick::new(parameters(bounds)), 85, 20_000, 1 << 23).0
        };
        let (off, on) = (run(None), run(Some(BOUNDS)));
        let first = off
            .iter()
            .zip(&on)
            .position(|(a, b)| a != b)
            .expect("it learns");
        let window = (SETTLING_TICKS + BLOCK_TICKS * (WINDOW_BLOCKS + 1)) as usize;
        assert!((window..window + WINDOW + 20).contains(&first), "{first}");
    }

    #[test]
    fn another_gain_makes_no_step_of_the_drive() {
        // At the tick behind which the coefficients change both give what they would have given but for the
        // change of one tick.
        let mut servo = ServoTick::new(parameters(Some(AdaptationParameters {
            most_step: LARGEST_STEP,
            ..BOUNDS
        })));
        let (codes, _) = run(&mut servo, 85, 60_000, 1 << 23);
        assert!(gain(&servo) < 0.9);
        // A tick of the triangle is 10 nm, 33 codes.
        let steps: Vec<u32> = codes
            .windows(2)
            .skip(1000)
            .map(|pair| pair[0].abs_diff(pair[1]))
            .collect();
        assert!(
            steps.iter().all(|step| *step < 80),
            "{:?}",
            steps.iter().max()
        );
    }

    #[test]
    fn a_block_that_takes_over_believes_its_own_gain_without_a_step() {
        let mut servo = ServoTick::new(parameters(Some(BOUNDS)));
        run(&mut servo, 90, 60_000, 1 << 23);
        assert!(gain(&servo) < 0.92);
        let mut stayed = servo.clone();
        let block = parameters(Some(BOUNDS));
        servo.exchange(&block);
        assert_eq!((gain(&servo), servo.parameters() == &block), (1.0, true));
        let c = block.converters;
        let read = SensorCode::new(
            ((i64::from(stayed.reference().to_bits() - c.adc_zero) << 16) / c.adc_step) as u32,
        );
        let ahead = stayed.reference();
        let codes = [&mut stayed, &mut servo].map(|servo| servo.tick(read, ahead));
        // The reference moves by 10 nm a tick, 33 codes: a tenth of it is what the gains differ by.
        assert!(codes[0].abs_diff(codes[1]) < 8, "{codes:?}");
    }

    #[test]
    fn bounds_that_are_none_are_not_accepted() {
        assert!(BOUNDS.accepted());
        for bad in [
            AdaptationParameters {
                most: MOST + 1,
                ..BOUNDS
            },
            AdaptationParameters { most: 0, ..BOUNDS },
            AdaptationParameters {
                most_step: 0,
                ..BOUNDS
            },
            AdaptationParameters {
                most_step: LARGEST_STEP + 1,
                ..BOUNDS
            },
            AdaptationParameters {
                error_limit: 0,
                ..BOUNDS
            },
            AdaptationParameters {
                least_motion: 255,
                ..BOUNDS
            },
        ] {
            assert!(!bad.accepted(), "{bad:?}");
        }
    }

    proptest! {
        /// Whatever is observed: the gain stays within its bounds, its reciprocal is one, and every
        /// coefficient is the block's times one of them.
        #[test]
        fn the_gain_stays_within_its_bounds(
            (most, most_step) in (1..=MOST, 1..=LARGEST_STEP),
            signals in prop::collection::vec((prop_oneof![Just(i32::MAX), Just(i32::MIN), any::<i32>()], any::<i32>(), any::<u8>()), 1..60),
            base in any::<i32>(),
        ) {
            let bounds = AdaptationParameters { most, most_step, error_limit: 1, least_motion: 256 };
            prop_assume!(bounds.accepted());
            let mut law = law();
            let base = base >> 1;
            let all = GainCoefficients { feedforward: [base; 16], gain_row: [base; STATES], unknown: [base; 2], drive: [base; STATES] };
            law.set_of_gain(&all);
            prop_assert_eq!(law.of_gain(), all);
            let mut adaptation = GainAdaptation::off();
            adaptation.begin(Some(&law));
            for (unknown, feedforward, doubt) in signals.iter().cycle().take(9000) {
                let scaled = adaptation.observe(&bounds, *unknown, *feedforward, *doubt > 0 || signals.len() < 30).copied();
                let (gain, inverse) = (adaptation.gain, adaptation.inverse);
                prop_assert!((gain - ONE).abs() <= most);
                prop_assert!((times(gain, inverse) - ONE).abs() <= 4, "{gain} {inverse}");
                if let Some(scaled) = scaled {
                    let (divided, multiplied) = (times(base, inverse), times(base, gain));
                    let expected =
                        GainCoefficients { feedforward: [divided; 16], gain_row: [divided; STATES], unknown: [divided; 2], drive: [multiplied; STATES] };
                    prop_assert_eq!(scaled, expected);
                }
            }
        }
    }
}
