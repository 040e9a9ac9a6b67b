//! What a frequency in mHz makes of the sections of [`crate::signal_filter`]: integers, in integers, so
//! that the board and the host give the same bits. Not for the tick.
//!
//! # How it works
//! With `t = tan(pi f / f_s)`, bilinear transform (Oppenheim and Schafer, Discrete-Time Signal Processing,
//! 7.1):
//!
//! * notch at `f` with the width `B` between its -3 dB points: `b = 1 / (1 + tan(pi B / f_s))`,
//!   `c = (1 - t^2) / (1 + t^2)`, numerator `b [1, -2c, 1]`, denominator `[1, -2bc, 2b - 1]`;
//! * low-pass (Butterworth, second order): `n = 1 / (1 + sqrt(2) t + t^2)`, numerator `n t^2 [1, 2, 1]`,
//!   denominator `[1, 2 n (t^2 - 1), n (1 - sqrt(2) t + t^2)]`.
//!
//! The integers of a notch have a gain of one at rest whatever is rounded; of the low-pass the middle one
//! of the numerator is what makes it so. Sine and cosine are sums of their series with 60 fraction bits.

use crate::signal_filter::{PASSES, Place, SECTION_FRACTION_BITS, SectionRow};

/// Fraction bits of what is computed here.
const BITS: u32 = 60;
const ONE: i64 = 1 << BITS;
/// pi with 60 fraction bits.
const PI: i64 = 3_622_009_729_038_561_421;
/// The square root of 2 with 60 fraction bits.
const ROOT_2: i64 = 1_630_477_228_166_597_776;
/// The lowest frequency, mHz: below it the integers of a section place it too coarsely.
pub const LOWEST_MILLIHERTZ: u32 = 10_000;
/// The highest one, of 1024ths of the sampling rate: 9 kHz at 20 kHz.
const HIGHEST_SHARE: u64 = 461;
/// The narrowest notch, mHz.
pub const NARROWEST_MILLIHERTZ: u32 = 1_000;
/// The width of a notch that was given none, as a share of its frequency: a tenth.
const USUAL_WIDTH: u32 = 10;

/// What was expected of a frequency or a width.
pub const EXPECTED_FILTER: &str = "expected a frequency from 10 Hz to 0.45 of the sampling rate, or 0 for none, and a notch at least 1 Hz wide and no wider than 0.45 of the sampling rate";

/// A notch.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Notch {
    /// Its frequency, mHz; 0: none.
    pub frequency_millihertz: u32,
    /// Width between its -3 dB points, mHz; 0: a tenth of the frequency.
    pub width_millihertz: u32,
}

impl Notch {
    /// None.
    pub const OFF: Self = Self {
        frequency_millihertz: 0,
        width_millihertz: 0,
    };

    /// The width that counts.
    #[must_use]
    pub fn width(&self) -> u32 {
        match self.width_millihertz {
            0 => (self.frequency_millihertz / USUAL_WIDTH).max(NARROWEST_MILLIHERTZ),
            width => width,
        }
    }
}

/// The filter of one signal.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FilterSetting {
    /// Its notches.
    pub notches: [Notch; 2],
    /// Corner of the low-pass, mHz; 0: none.
    pub low_pass_millihertz: u32,
}

/// The product of two numbers.
#[inline(never)]
fn times(a: i64, b: i64) -> i64 {
    ((i128::from(a) * i128::from(b)) >> BITS) as i64
}

/// The quotient of two numbers below 8; the divisor is not zero.
#[inline(never)]
fn over(a: i64, b: i64) -> i64 {
    (i128::from(a) << BITS)
        .checked_div(i128::from(b))
        .map_or(0, |quotient| quotient as i64)
}

/// Sine and cosine of an angle from 0 to pi/2.
fn sine_and_cosine(angle: i64) -> (i64, i64) {
    let (mut term, mut sine, mut cosine) = (ONE, 0i64, ONE);
    // 1.6^26 / 26! is below 2^-60.
    for nth in 1..=26i64 {
        term = times(term, angle) / nth;
        match nth & 3 {
            1 => sine += term,
            2 => cosine -= term,
            3 => sine -= term,
            _ => cosine += term,
        }
    }
    (sine, cosine)
}

/// `tan(pi f / f_s)`, which is below 7 for a frequency that is accepted.
#[inline(never)]
fn tangent(millihertz: u32, sample_rate_hz: u32) -> i64 {
    let share = over(
        i64::from(millihertz),
        i64::from(sample_rate_hz.max(1)) * 1000,
    );
    let (sine, cosine) = sine_and_cosine(times(PI, share));
    over(sine, cosine.max(1))
}

/// The quotient of two numbers; what is divided is below 64, and the divisor is not zero.
#[inline(never)]
fn share(a: i128, b: i128) -> i128 {
    (a << BITS).checked_div(b).unwrap_or(0)
}

/// The nearest number with the fraction bits of a section.
fn rounded(value: i128) -> i32 {
    ((value + (1 << (BITS - SECTION_FRACTION_BITS - 1))) >> (BITS - SECTION_FRACTION_BITS)) as i32
}

impl FilterSetting {
    /// None of them.
    pub const OFF: Self = Self {
        notches: [Notch::OFF; 2],
        low_pass_millihertz: 0,
    };

    /// Whether every section of it can be had.
    #[must_use]
    pub fn accepted(&self, sample_rate_hz: u32) -> bool {
        Place::ALL
            .iter()
            .all(|place| self.exact_tangents(*place, sample_rate_hz).is_ok())
    }

    /// What a section is made of, rounded to 24 bits; none where it is off.
    ///
    /// # Errors
    /// [`EXPECTED_FILTER`].
    pub(crate) fn tangents(
        &self,
        place: Place,
        sample_rate_hz: u32,
    ) -> Result<Option<SectionTangents>, &'static str> {
        let real = |wide: i64| (wide >> (BITS - 24)) as i32 as f32 / (1u32 << 24) as f32;
        let exact = self.exact_tangents(place, sample_rate_hz)?;
        Ok(exact.map(|section| match section {
            SectionTangents::Notch { centre, width } => SectionTangents::Notch {
                centre: real(centre),
                width: real(width),
            },
            SectionTangents::LowPass { corner } => SectionTangents::LowPass {
                corner: real(corner),
            },
        }))
    }

    #[inline(never)]
    fn exact_tangents(
        &self,
        place: Place,
        sample_rate_hz: u32,
    ) -> Result<Option<SectionTangents<i64>>, &'static str> {
        let highest = u64::from(sample_rate_hz) * 1000 * HIGHEST_SHARE / 1024;
        let within = |lowest: u32, millihertz: u32| {
            let accepted = millihertz >= lowest && u64::from(millihertz) <= highest;
            if accepted {
                Ok(tangent(millihertz, sample_rate_hz))
            } else {
                Err(EXPECTED_FILTER)
            }
        };
        let [first, second] = &self.notches;
        let notch = match place {
            Place::LowPass if self.low_pass_millihertz == 0 => return Ok(None),
            Place::LowPass => {
                let corner = within(LOWEST_MILLIHERTZ, self.low_pass_millihertz)?;
                return Ok(Some(SectionTangents::LowPass { corner }));
            }
            Place::Notch1 => first,
            Place::Notch2 => second,
        };
        if notch.frequency_millihertz == 0 {
            return Ok(None);
        }
        Ok(Some(SectionTangents::Notch {
            centre: within(LOWEST_MILLIHERTZ, notch.frequency_millihertz)?,
            width: within(NARROWEST_MILLIHERTZ, notch.width())?,
        }))
    }

    /// The integers of a section.
    ///
    /// # Errors
    /// [`EXPECTED_FILTER`].
    #[inline(never)]
    pub fn row(&self, place: Place, sample_rate_hz: u32) -> Result<SectionRow, &'static str> {
        Ok(match self.exact_tangents(place, sample_rate_hz)? {
            None => PASSES,
            Some(SectionTangents::Notch { centre, width }) => notch_row(centre, width),
            Some(SectionTangents::LowPass { corner }) => low_pass(corner),
        })
    }
}

/// `tan(pi f / f_s)` of the frequencies of a section.
#[derive(Clone, Copy, Debug)]
pub(crate) enum SectionTangents<T = f32> {
    /// A notch and its width.
    Notch { centre: T, width: T },
    /// A low-pass.
    LowPass { corner: T },
}

/// From the tangents of the frequency and of the width.
fn notch_row(centre: i64, width: i64) -> SectionRow {
    // With 60 fraction bits and up to 50 in front of the point.
    let square = (i128::from(centre) * i128::from(centre)) >> BITS;
    let one = i128::from(ONE);
    let b = share(one, one + i128::from(width));
    let cosine = share(one - square, one + square);
    let (b, middle) = (rounded(b), rounded(-2 * ((b * cosine) >> BITS)));
    let last = 2 * b - (1 << SECTION_FRACTION_BITS);
    SectionRow {
        coefficients: [b, middle, b, -middle, -last],
    }
}

fn low_pass(tangent: i64) -> SectionRow {
    let (one, t) = (i128::from(ONE), i128::from(tangent));
    let square = (t * t) >> BITS;
    let damping = (i128::from(ROOT_2) * t) >> BITS;
    let all = one + damping + square;
    let ends = rounded(share(square, all));
    let (a1, a2) = (
        rounded(2 * share(square - one, all)),
        rounded(share(one - damping + square, all)),
    );
    SectionRow {
        coefficients: [
            ends,
            (1 << SECTION_FRACTION_BITS) + a1 + a2 - 2 * ends,
            ends,
            -a1,
            -a2,
        ],
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn real(row: &SectionRow) -> [f64; 5] {
        row.coefficients
            .map(|c| f64::from(c) / f64::from(1 << SECTION_FRACTION_BITS))
    }

    proptest! {
        #[test]
        fn integers_are_those_of_the_formulas_in_floats(
            millihertz in LOWEST_MILLIHERTZ..9_000_000u32,
            width_millihertz in NARROWEST_MILLIHERTZ..9_000_000u32,
        ) {
            let angle = |mhz: u32| core::f64::consts::PI * f64::from(mhz) / 20_000e3;
            let (t, w) = (angle(millihertz).tan(), angle(width_millihertz).tan());
            let notch = Notch { frequency_millihertz: millihertz, width_millihertz };
            let setting = FilterSetting { notches: [notch, Notch::OFF], low_pass_millihertz: millihertz };
            let (b, c) = (1.0 / (1.0 + w), (2.0 * angle(millihertz)).cos());
            let n = 1.0 / (1.0 + 2f64.sqrt() * t + t * t);
            let expected = [
                (Place::Notch1, [b, -2.0 * b * c, b, 2.0 * b * c, 1.0 - 2.0 * b]),
                (Place::LowPass, [n * t * t, 2.0 * n * t * t, n * t * t, -2.0 * n * (t * t - 1.0), -n * (1.0 - 2f64.sqrt() * t + t * t)]),
            ];
            for (place, expected) in expected {
                let row = setting.row(place, 20_000).expect("accepted");
                for (got, expected) in real(&row).iter().zip(expected) {
                    prop_assert!((got - expected).abs() < 2.5 / f64::from(1 << SECTION_FRACTION_BITS), "{place:?} {got} {expected}");
                }
                let [b0, b1, b2, a1, a2] = row.coefficients.map(i64::from);
                prop_assert_eq!(b0 + b1 + b2, (1 << SECTION_FRACTION_BITS) - a1 - a2, "a gain of one at rest");
                // Stable, and no sum can wrap.
                let (p, q) = (-a1, -a2);
                prop_assert!(q < 1 << SECTION_FRACTION_BITS && p.abs() < (1 << SECTION_FRACTION_BITS) + q);
                prop_assert!(row.coefficients.iter().map(|c| i64::from(c.unsigned_abs())).sum::<i64>() < 1 << 31);
            }
        }
    }

    #[test]
    fn what_is_beyond_the_limits_is_refused() {
        let with = |frequency_millihertz, width_millihertz, low_pass_millihertz| {
            let setting = FilterSetting {
                notches: [
                    Notch {
                        frequency_millihertz,
                        width_millihertz,
                    },
                    Notch::OFF,
                ],
                low_pass_millihertz,
            };
            (
                setting.row(Place::Notch1, 20_000).is_ok(),
                setting.row(Place::LowPass, 20_000).is_ok(),
            )
        };
        assert_eq!(with(735_000, 0, 1_000_000), (true, true));
        assert_eq!(with(9_999, 0, 9_999), (false, false));
        assert_eq!(with(9_003_000, 0, 9_005_000), (true, false));
        assert_eq!(with(735_000, 999, 0), (false, true));
        assert_eq!(with(735_000, u32::MAX, u32::MAX), (false, false));
        assert_eq!(FilterSetting::OFF.row(Place::Notch2, 20_000), Ok(PASSES));
    }
}
