//! A correction of a periodic reference that is learned from the errors of its periods.
//!
//! # How it works
//! The reference repeats after `N` samples. What the loop missed at a sample of one period it will miss
//! again, so the reference is given with a correction `f` that is kept for each sample of the period
//! (repetitive control, Hara et al. 1988, with the learning filter in the manner of iterative learning,
//! Bristow et al. 2006). With `e` the error of the reading from the reference that was asked for,
//!
//! `f[k + N] = (1 - g) f[k] + g Q (f[k] + L e[k])`
//!
//! where `L` is the *learning filter*, an approximate inverse of the loop from a correction to the motion,
//! `Q` the *robustness filter*, and `g` a share that falls with the number of learned periods, so that noise
//! is averaged (and what is learned in the end does not depend on it). A period is room enough for both
//! filters to look ahead: `Q` is symmetric, so it has no phase, and `L` undoes the loop's. The filters are
//! designed on the host from the sampled frequency response of every plant that is left possible, such that
//! `|Q (1 - L T)| < 1`; then all periods of at least [`LEAST_PERIOD_TICKS`] converge.
//!
//! Each tick works on one point: the newest error enters a row; `L` over that row gives the step of the point
//! 32 samples ago; `Q` over the row of stepped points gives the new value of the point 63 samples ago.
//! Nothing is shifted and nothing is done at the end of a period.
//!
//! | what | format |
//! |---|---|
//! | points, [`MOST_POINTS`] | 16 bits, um, [`POINT_FRACTION_BITS`] of fraction: +-1 um, steps of 0.03 nm |
//! | errors, stepped points | um with 24 fraction bits |
//!
//! Points stay as they are for [`SETTLING_TICKS`] after a tick at which the drive was at a limit or the error
//! beyond
//! [`LearningParameters::error_limit`]: until nothing of that tick is left in a row. A new reference begins
//! with no correction.

use crate::integer_row::{Row, four};
use crate::reference_window::PREVIEW_TICKS;
use crate::signal::{saturate_shifted, sum as sum_of};

/// Most samples in a period: 4.9 Hz at 20 kHz.
pub const MOST_POINTS: usize = 4096;
/// Taps of the learning filter; the first weighs the error 31 samples before the point.
pub const LEARNING_TAPS: usize = 64;
/// Fraction bits of the learning filter.
pub const LEARNING_FRACTION_BITS: u32 = 24;
/// Taps of the robustness filter, the first of which is zero so that the others are symmetric about the
/// point.
pub const ROBUSTNESS_TAPS: usize = 64;
/// Fraction bits of the robustness filter.
pub const ROBUSTNESS_FRACTION_BITS: u32 = 29;
/// Fraction bits of the points, um.
pub const POINT_FRACTION_BITS: u32 = 15;
/// From an error to the step that it makes, samples.
const STEP_DELAY_TICKS: u32 = LEARNING_TAPS as u32 / 2;
/// From an error to the point that is written, samples.
const POINT_DELAY_TICKS: u32 = STEP_DELAY_TICKS + ROBUSTNESS_TAPS as u32 / 2 - 1;
/// Fewest samples in a period: a point is written before it is played again.
pub const LEAST_PERIOD_TICKS: u32 = POINT_DELAY_TICKS + PREVIEW_TICKS as u32 + 1;
/// Ticks after which nothing of an error is left in a row.
pub const SETTLING_TICKS: u32 = (LEARNING_TAPS + ROBUSTNESS_TAPS) as u32;
/// From the signals' fraction bits to those of the points.
const POINT_SHIFT: u32 = 24 - POINT_FRACTION_BITS;

/// What the host designs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LearningParameters {
    /// `L` over the errors, um per um.
    pub learning: Row<LEARNING_TAPS, LEARNING_FRACTION_BITS>,
    /// `Q` over the stepped points.
    pub robustness: Row<ROBUSTNESS_TAPS, ROBUSTNESS_FRACTION_BITS>,
    /// Nothing is learned from errors beyond this, um with 24 fraction bits.
    pub error_limit: i32,
    /// Largest magnitude of a correction, um with [`POINT_FRACTION_BITS`] fraction bits.
    pub point_limit: i16,
    /// The share `g` is halved after each so many learned periods; at least 1.
    pub periods_per_halving: u8,
    /// At most so many times.
    pub most_halvings: u8,
}

impl LearningParameters {
    /// Whether no signal can wrap, and the filters are what they must be: `Q` symmetric.
    #[must_use]
    pub fn accepted(&self) -> bool {
        let fits = |sum: i64| sum < 1 << 31;
        let sum = |taps: &[i32]| {
            taps.iter()
                .map(|c| i64::from(c.unsigned_abs()))
                .sum::<i64>()
        };
        let symmetric = match self.robustness.coefficients.split_first() {
            Some((first, rest)) => *first == 0 && rest.iter().eq(rest.iter().rev()),
            None => false,
        };
        fits(sum(&self.learning.coefficients))
            && fits(sum(&self.robustness.coefficients))
            && symmetric
            && self.error_limit > 0
            && self.point_limit > 0
            && self.periods_per_halving > 0
            && self.most_halvings < 16
    }
}

/// The newest signals in one piece of memory: each is stored twice.
#[derive(Clone, Debug)]
struct Newest {
    signals: [i32; 2 * LEARNING_TAPS],
    oldest: usize,
}

impl Newest {
    const NONE: Self = Self {
        signals: [0; 2 * LEARNING_TAPS],
        oldest: 0,
    };

    #[inline]
    fn push(&mut self, signal: i32) {
        let oldest = self.oldest % LEARNING_TAPS;
        self.signals[oldest] = signal;
        self.signals[oldest + LEARNING_TAPS] = signal;
        self.oldest = (oldest + 1) % LEARNING_TAPS;
    }

    /// Oldest first.
    #[inline]
    fn row(&self) -> &[i32; LEARNING_TAPS] {
        const NONE: &[i32; LEARNING_TAPS] = &[0; LEARNING_TAPS];
        let oldest = self.oldest % LEARNING_TAPS;
        self.signals
            .get(oldest..oldest + LEARNING_TAPS)
            .and_then(|row| row.first_chunk())
            .unwrap_or(NONE)
    }
}

/// The correction with its memory.
// In this order: the points are long, and what stands behind them is beyond the reach of an instruction.
#[derive(Clone, Debug)]
#[repr(C)]
pub struct LearnedFeedforward {
    /// Samples in a period; 0: nothing is learned.
    period_ticks: u32,
    /// Correction of the sample that counts now, um with 24 fraction bits.
    present: i32,
    /// The point of the sample that enters next.
    entering: u32,
    /// Points that still hold what was learned for another reference.
    stale: u32,
    /// Ticks until points are written.
    waiting: u32,
    /// Points written since the share was last halved.
    written: u32,
    halvings: u8,
    errors: Newest,
    stepped: Newest,
    points: [i16; MOST_POINTS],
}

impl LearnedFeedforward {
    /// Learns nothing.
    #[must_use]
    pub fn off() -> Self {
        Self {
            period_ticks: 0,
            present: 0,
            entering: 0,
            stale: 0,
            waiting: 0,
            written: 0,
            halvings: 0,
            errors: Newest::NONE,
            stepped: Newest::NONE,
            points: [0; MOST_POINTS],
        }
    }

    /// Learns a reference of this period from its first sample on; `None`, or a period that is too short or
    /// too long: learns nothing.
    pub fn begin(&mut self, period_ticks: Option<u32>) {
        let fits = |period: &u32| (LEAST_PERIOD_TICKS..=MOST_POINTS as u32).contains(period);
        self.period_ticks = period_ticks.filter(fits).unwrap_or(0);
        self.restart();
    }

    /// Forgets what was learned; the reference begins again with its first sample.
    pub fn restart(&mut self) {
        self.entering = 0;
        self.present = 0;
        // The points are cleared one by one as their samples pass.
        self.stale = self.period_ticks;
        self.waiting = self.period_ticks.saturating_add(SETTLING_TICKS);
        self.written = 0;
        self.halvings = 0;
    }

    /// Samples in a period, while something is learned.
    #[must_use]
    pub fn period_ticks(&self) -> Option<u32> {
        (self.period_ticks > 0).then_some(self.period_ticks)
    }

    #[inline]
    fn point(&self, index: u32) -> i32 {
        self.points
            .get(index as usize)
            .map_or(0, |point| i32::from(*point) << POINT_SHIFT)
    }

    /// The point so many samples (less than a period) before another one.
    #[inline]
    fn before(&self, index: u32, samples: u32) -> u32 {
        if index >= samples {
            index - samples
        } else {
            (index + self.period_ticks).saturating_sub(samples)
        }
    }

    /// The correction of the sample that enters, um with 24 fraction bits; [`Self::present`] is that of the
    /// one that counts now.
    #[inline]
    pub fn enter(&mut self) -> i32 {
        if self.period_ticks == 0 {
            return 0;
        }
        let entering = self.entering;
        self.entering = if entering + 1 >= self.period_ticks {
            0
        } else {
            entering + 1
        };
        if self.stale > 0 {
            self.stale -= 1;
            if let Some(point) = self.points.get_mut(entering as usize) {
                *point = 0;
            }
            return 0;
        }
        self.present = self.point(self.before(entering, PREVIEW_TICKS as u32));
        self.point(entering)
    }

    /// The correction of the sample that counts now, um with 24 fraction bits.
    #[inline]
    #[must_use]
    pub fn present(&self) -> i32 {
        self.present
    }

    /// Takes the error (asked minus read, um with 24 fraction bits) of the sample that counts now, after
    /// [`Self::enter`] in every tick. `trusted`: the drive was not at a limit.
    #[inline]
    pub fn learn(
        &mut self,
        parameters: &LearningParameters,
        error: i32,
        trusted: bool,
        saturated: &mut u32,
    ) {
        if self.period_ticks == 0 {
            return;
        }
        if !trusted || error.saturating_abs() > parameters.error_limit {
            self.waiting = self.waiting.max(SETTLING_TICKS);
        }
        // The sample that counts now entered `PREVIEW_TICKS` samples before the last one that entered.
        let now = self.before(self.entering, PREVIEW_TICKS as u32 + 1);
        self.errors.push(error);
        let mut stepped = self.point(self.before(now, STEP_DELAY_TICKS));
        // What is stepped earlier has left its row when points are written again.
        if self.waiting < ROBUSTNESS_TAPS as u32 {
            stepped =
                stepped.saturating_add(parameters.learning.apply(self.errors.row(), saturated));
        }
        self.stepped.push(stepped);
        if self.waiting > 0 {
            self.waiting -= 1;
            return;
        }
        let smooth = symmetric(&parameters.robustness, self.stepped.row(), saturated);
        self.write(
            parameters,
            self.before(now, POINT_DELAY_TICKS),
            smooth,
            saturated,
        );
    }

    /// Moves a point by its share towards what was learned, um with 24 fraction bits.
    #[inline]
    fn write(
        &mut self,
        parameters: &LearningParameters,
        index: u32,
        learned: i32,
        saturated: &mut u32,
    ) {
        let old = self.point(index);
        let shift = POINT_SHIFT + u32::from(self.halvings.min(15));
        let change = (i64::from(learned) - i64::from(old) + (1i64 << (shift - 1))) >> shift;
        let wanted = i64::from(old >> POINT_SHIFT) + change;
        let limit = i64::from(parameters.point_limit);
        let within = wanted.max(-limit).min(limit);
        if within != wanted {
            *saturated = saturated.saturating_add(1);
        }
        if let Some(point) = self.points.get_mut(index as usize) {
            *point = within as i16;
        }
        self.written += 1;
        if self.written
            >= self
                .period_ticks
                .saturating_mul(u32::from(parameters.periods_per_halving))
        {
            self.written = 0;
            self.halvings = self
                .halvings
                .saturating_add(1)
                .min(parameters.most_halvings);
        }
    }
}

/// `Q` over a row: two signals as far from the point have the same coefficient, and are added first.
#[inline]
fn symmetric(
    robustness: &Row<ROBUSTNESS_TAPS, ROBUSTNESS_FRACTION_BITS>,
    row: &[i32; ROBUSTNESS_TAPS],
    saturated: &mut u32,
) -> i32 {
    const POINT: usize = ROBUSTNESS_TAPS / 2;
    // The first coefficient is zero.
    let (coefficients, rest) = robustness.coefficients[1..POINT].as_chunks::<4>();
    let (before, near_before) = row[1..POINT].as_chunks::<4>();
    let (near_behind, behind) = row[POINT + 1..].as_rchunks::<4>();
    let mut sum = 1i64 << (ROBUSTNESS_FRACTION_BITS - 1);
    for (c, ([a, b, c0, d], [e, f, g, h])) in coefficients
        .iter()
        .zip(before.iter().zip(behind.iter().rev()))
    {
        sum = four(
            sum,
            *c,
            [
                a.saturating_add(*h),
                b.saturating_add(*g),
                c0.saturating_add(*f),
                d.saturating_add(*e),
            ],
        );
    }
    for (coefficient, (a, b)) in rest
        .iter()
        .zip(near_before.iter().zip(near_behind.iter().rev()))
    {
        sum = sum_of(
            sum,
            i64::from(*coefficient) * i64::from(a.saturating_add(*b)),
        );
    }
    saturate_shifted::<ROBUSTNESS_FRACTION_BITS>(
        sum_of(
            sum,
            i64::from(robustness.coefficients[POINT]) * i64::from(row[POINT]),
        ),
        saturated,
    )
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;
    use proptest::prelude::*;
    use std::vec;
    use std::vec::Vec;

    /// No filtering: the step of a point is its own error.
    fn plain() -> LearningParameters {
        let mut learning = Row::default();
        learning.coefficients[31] = 1 << LEARNING_FRACTION_BITS;
        let mut robustness = Row::default();
        robustness.coefficients[32] = 1 << ROBUSTNESS_FRACTION_BITS;
        LearningParameters {
            learning,
            robustness,
            error_limit: 1 << 24,
            point_limit: i16::MAX,
            periods_per_halving: 100,
            most_halvings: 0,
        }
    }

    /// A loop that follows at once but for an error that repeats: `error[k]` at sample `k` of the period.
    /// Returns the errors of all ticks.
    fn run(
        learner: &mut LearnedFeedforward,
        p: &LearningParameters,
        repeating: &[i32],
        ticks: usize,
        trusted: impl Fn(usize) -> bool,
    ) -> Vec<i32> {
        let n = repeating.len();
        let mut pushed = vec![0; PREVIEW_TICKS];
        let mut saturated = 0;
        let mut errors = Vec::new();
        for k in 0..ticks {
            pushed.push(learner.enter());
            let correction = pushed[k];
            assert_eq!(correction, learner.present(), "{k}");
            let error = if k < PREVIEW_TICKS {
                0
            } else {
                repeating[(k - PREVIEW_TICKS) % n] - correction
            };
            learner.learn(p, error, trusted(k), &mut saturated);
            errors.push(error);
        }
        assert_eq!(saturated, 0);
        errors
    }

    #[test]
    fn a_repeating_error_is_gone_after_it_was_learned_once() {
        for n in [LEAST_PERIOD_TICKS as usize, 200, MOST_POINTS] {
            let repeating: Vec<i32> = (0..n)
                .map(|k| ((k * 7919) % 1000) as i32 * 512 - 391 * 512)
                .collect();
            let mut learner = LearnedFeedforward::off();
            learner.begin(Some(n as u32));
            let errors = run(&mut learner, &plain(), &repeating, 4 * n + 500, |_| true);
            assert!(errors[PREVIEW_TICKS..n].iter().any(|e| *e != 0));
            assert!(errors[3 * n + 300..].iter().all(|e| *e == 0), "{n}");
            // Another reference begins with nothing.
            learner.restart();
            let errors = run(&mut learner, &plain(), &repeating, n, |_| true);
            assert_eq!(errors[n - 1], repeating[n - 1 - PREVIEW_TICKS]);
        }
    }

    #[test]
    fn what_cannot_be_a_period_learns_nothing() {
        for period in [
            None,
            Some(0),
            Some(LEAST_PERIOD_TICKS - 1),
            Some(MOST_POINTS as u32 + 1),
            Some(u32::MAX),
        ] {
            let mut learner = LearnedFeedforward::off();
            learner.begin(period);
            assert_eq!(learner.period_ticks(), None);
            let errors = run(&mut learner, &plain(), &[1 << 20; 100], 1000, |_| true);
            assert!(errors[PREVIEW_TICKS..].iter().all(|e| *e == 1 << 20));
        }
    }

    #[test]
    fn points_stay_while_the_drive_is_limited_or_the_error_large() {
        let n = 128usize;
        let repeating: Vec<i32> = (0..n).map(|k| (k as i32 - 64) << 14).collect();
        let mut learner = LearnedFeedforward::off();
        learner.begin(Some(n as u32));
        run(&mut learner, &plain(), &repeating, 8 * n, |_| true);
        let learned = learner.points;
        assert!(learned[..n].iter().any(|point| *point != 0));
        // A tick without trust in every `SETTLING_TICKS`: nothing is written, and what was learned is played.
        let mut saturated = 0;
        for k in 0..4 * n {
            learner.enter();
            learner.learn(
                &plain(),
                12_345,
                !k.is_multiple_of(SETTLING_TICKS as usize),
                &mut saturated,
            );
        }
        assert_eq!(learner.points, learned);
        for k in 0..4 * n {
            learner.enter();
            learner.learn(
                &plain(),
                if k.is_multiple_of(100) { 2 << 24 } else { 777 },
                true,
                &mut saturated,
            );
        }
        assert_eq!(learner.points, learned);
        for _ in 0..SETTLING_TICKS + 1 {
            learner.enter();
            learner.learn(&plain(), 512, true, &mut saturated);
        }
        assert_ne!(learner.points, learned);
    }

    #[test]
    fn the_share_falls_as_it_should() {
        let (n, parameters) = (
            100u32,
            LearningParameters {
                periods_per_halving: 2,
                most_halvings: 2,
                ..plain()
            },
        );
        let mut learner = LearnedFeedforward::off();
        learner.begin(Some(n));
        let mut halvings = Vec::new();
        for _ in 0..n + SETTLING_TICKS + 7 * n {
            learner.enter();
            learner.learn(&parameters, 1, true, &mut 0);
            halvings.push(learner.halvings);
        }
        let from = (n + SETTLING_TICKS) as usize;
        for (period, expected) in [0u8, 0, 1, 1, 2, 2, 2].into_iter().enumerate() {
            assert_eq!(
                halvings[from + period * n as usize + 50],
                expected,
                "{period}"
            );
        }
    }

    #[test]
    fn filters_that_are_none_are_not_accepted() {
        assert!(plain().accepted());
        let mut lopsided = plain();
        lopsided.robustness.coefficients[33] = 5;
        let mut large = plain();
        large.learning.coefficients = [i32::MAX / 32; LEARNING_TAPS];
        let zero = LearningParameters {
            periods_per_halving: 0,
            ..plain()
        };
        for bad in [
            lopsided,
            large,
            zero,
            LearningParameters {
                point_limit: 0,
                ..plain()
            },
            LearningParameters {
                error_limit: 0,
                ..plain()
            },
        ] {
            assert!(!bad.accepted());
        }
    }

    fn taps() -> impl Strategy<Value = [i32; 64]> {
        (prop::array::uniform::<_, 64>(any::<i32>()), 6u32..16)
            .prop_map(|(raw, less)| raw.map(|tap| tap >> less))
    }

    proptest! {
        /// Whatever is learned from whatever errors: nothing wraps (the sums fail here where they would),
        /// corrections stay within their limit, and every index is one of the memory.
        #[test]
        fn corrections_stay_within_their_limit(
            learning in taps(),
            half in prop::array::uniform32(any::<i32>()),
            (less, point_limit, halving) in (6u32..12, 1i16..=i16::MAX, (1u8..4, 0u8..16)),
            period in LEAST_PERIOD_TICKS..600,
            errors in prop::collection::vec(prop_oneof![Just(i32::MAX), Just(i32::MIN), any::<i32>(), -1000i32..1000], 1..40),
        ) {
            let mut robustness = [0i32; 64];
            for (i, tap) in half.iter().enumerate() {
                robustness[32 - i.min(31)] = tap >> less;
                robustness[32 + i.min(31)] = tap >> less;
            }
            let parameters = LearningParameters {
                learning: Row { coefficients: learning },
                robustness: Row { coefficients: robustness },
                error_limit: i32::MAX,
                point_limit,
                periods_per_halving: halving.0,
                most_halvings: halving.1,
            };
            prop_assume!(parameters.accepted());
            let mut learner = LearnedFeedforward::off();
            learner.begin(Some(period));
            let (limit, mut saturated) = (i32::from(point_limit) << POINT_SHIFT, 0);
            for error in errors.iter().cycle().take(4 * period as usize + 300) {
                let entering = learner.enter();
                prop_assert!(entering.abs() <= limit && learner.present().abs() <= limit);
                prop_assert!(learner.entering < period);
                learner.learn(&parameters, *error, error % 7 != 0, &mut saturated);
            }
        }
    }
}
