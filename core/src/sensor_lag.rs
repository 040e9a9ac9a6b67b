//! The known lag of the sensor, undone in the reference.
//!
//! # How it works
//! A sensor of limited bandwidth reads where the stage was. A law that brings the reading to the reference
//! then brings the stage to where the reference will be: at a constant speed it is early by the sensor's lag,
//! and no reading shows that. So the law compares the reading with the reference as the sensor would read it,
//! and what it feeds forward for is that reference as well; then the stage itself follows what was asked for.
//! With `r` what is asked,
//!
//! `r'[k] = r[k] + a (r'[k-1] - r[k]) + b (r[k-1] - r[k])`
//!
//! with `a` and `b` such that it is as late as the sensor at rest, and as much smaller as the square of the
//! frequency says (a first-order lag through Tustin's rule; Astrom and Wittenmark, Computer-Controlled
//! Systems 1997, 8.3). What has always stood still passes to the last bit. Only the upper halves of products
//! count, so what came to rest may stay a few units of 0.06 pm away: 2 pm for a lag of 20 periods.
//!
//! `a` and `b` are fractions without a unit, with [`LAG_FRACTION_BITS`], whose magnitudes together are at
//! most one; both are zero for a sensor without a lag, or with one that nobody knows.

/// Fraction bits of the coefficients.
pub const LAG_FRACTION_BITS: u32 = 31;

/// Coefficients of the lag.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(C)]
pub struct SensorLag {
    /// `a`, how much is carried on of what was later than asked: its magnitude is below one.
    pub carried: i32,
    /// `b`, the share of the sample before.
    pub before: i32,
}

/// The upper half of a product.
#[inline(always)]
fn upper(a: i32, b: i32) -> i32 {
    ((i64::from(a) * i64::from(b)) >> 32) as i32
}

impl SensorLag {
    /// The sensor reads what is there.
    pub const NONE: Self = Self {
        carried: 0,
        before: 0,
    };

    /// Whether it forgets, and no sum can wrap.
    #[must_use]
    pub fn accepted(&self) -> bool {
        let one = 1u64 << LAG_FRACTION_BITS;
        let (carried, before) = (
            u64::from(self.carried.unsigned_abs()),
            u64::from(self.before.unsigned_abs()),
        );
        carried < one && carried + before <= one
    }

    /// By how much a reference of constant speed, in um a tick with 24 fraction bits, is read lower than
    /// asked.
    #[must_use]
    pub fn late_by(&self, speed: i32) -> i32 {
        // (a + b) / (1 - a) ticks: below 2^62, and the divisor is not zero for what is accepted.
        let (ticks, of) = (
            i64::from(self.carried) + i64::from(self.before),
            (1i64 << LAG_FRACTION_BITS) - i64::from(self.carried),
        );
        let late = (i64::from(speed) * ticks).checked_div(of).unwrap_or(0);
        late.clamp(i64::from(i32::MIN), i64::from(i32::MAX)) as i32
    }

    /// The sample that was asked for (um with 24 fraction bits, as all here) as the sensor will read it, from
    /// the last one as the sensor reads it and as it was asked for.
    #[inline(always)]
    #[must_use]
    pub fn apply(&self, asked: i32, [lagged, before]: [i32; 2]) -> i32 {
        // Half of what it is later by: with magnitudes of at most one together it fits.
        let half = upper(self.carried, lagged.saturating_sub(asked))
            + upper(self.before, before.saturating_sub(asked));
        asked.saturating_add(half.saturating_add(half))
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;
    use proptest::prelude::*;
    use std::vec::Vec;

    fn fraction(value: f64) -> i32 {
        (value * f64::from(1u32 << LAG_FRACTION_BITS)).round() as i32
    }

    /// As late as `ticks` by Tustin's rule.
    fn late(ticks: f64) -> SensorLag {
        SensorLag {
            carried: fraction((2.0 * ticks - 1.0) / (2.0 * ticks + 1.0)),
            before: fraction(1.0 / (2.0 * ticks + 1.0)),
        }
    }

    fn run(lag: &SensorLag, asked: impl Iterator<Item = i32>) -> Vec<i32> {
        let mut last = None;
        let each = asked.map(|asked| {
            let lagged = lag.apply(asked, last.unwrap_or([asked; 2]));
            last = Some([lagged, asked]);
            lagged
        });
        each.collect()
    }

    #[test]
    fn a_ramp_is_as_late_as_the_sensor_and_what_stands_still_is_not_changed() {
        for ticks in [0.26, 0.32, 1.0, 3.2, 12.0] {
            let (lag, slope) = (late(ticks), 60_000);
            assert!(lag.accepted());
            let out = run(&lag, (0..2000).map(|k| (k * slope).min(1000 * slope)));
            let late_by = f64::from(700 * slope - out[700]) / f64::from(slope);
            assert!(
                (f64::from(lag.late_by(slope)) / f64::from(slope) - ticks).abs() < 1e-4,
                "{ticks}: {}",
                lag.late_by(slope)
            );
            // Each of two products loses up to two units of 0.06 pm, and the lag remembers them for some of
            // its length.
            let rounding = 4.0 * (1.0 + ticks) / f64::from(slope);
            assert!((late_by - ticks).abs() < rounding, "{ticks}: {late_by}");
            let rest = 2 + 2 * ticks as i32;
            assert!(
                (out[1999] - 1000 * slope).abs() <= rest,
                "{ticks}: {}",
                out[1999] - 1000 * slope
            );
            let falling = run(&lag, (0..2000).map(|k| (-k * slope).max(-1000 * slope)));
            assert!(
                (falling[1999] + 1000 * slope).abs() <= rest,
                "{ticks}: {}",
                falling[1999] + 1000 * slope
            );
            let still = run(&lag, std::iter::repeat_n(123_456_789, 50));
            assert!(still.iter().all(|v| *v == 123_456_789));
        }
        let moving: Vec<i32> = (0..100).map(|k| k * k * 777 - 5000).collect();
        assert_eq!(run(&SensorLag::NONE, moving.iter().copied()), moving);
    }

    #[test]
    fn a_lag_that_does_not_forget_or_wraps_is_not_accepted() {
        for (carried, before) in [
            (i32::MIN, 0),
            (i32::MIN, i32::MIN),
            (1 << 30, (1 << 30) + 1),
            (-(1 << 30), i32::MAX),
        ] {
            assert!(
                !SensorLag { carried, before }.accepted(),
                "{carried} {before}"
            );
        }
        assert!(
            SensorLag {
                carried: i32::MAX,
                before: -1
            }
            .accepted()
                && SensorLag {
                    carried: 0,
                    before: i32::MIN
                }
                .accepted()
        );
    }

    proptest! {
        /// Whatever is asked through whatever lag that is accepted: no sum wraps (it fails here where it
        /// would).
        #[test]
        fn no_sum_wraps(
            (carried, share) in (-i32::MAX..=i32::MAX, -1.0f64..=1.0),
            asked in prop::collection::vec(prop_oneof![Just(i32::MAX), Just(i32::MIN), any::<i32>()], 2..50),
        ) {
            let before = (f64::from(i32::MAX - carried.abs()) * share) as i32;
            let lag = SensorLag { carried, before };
            prop_assert!(lag.accepted());
            let _ = asked.iter().map(|speed| lag.late_by(*speed)).max();
            let mut last = [asked[0]; 2];
            for asked in asked {
                last = [lag.apply(asked, last), asked];
            }
        }
    }
}
