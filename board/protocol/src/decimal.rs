//! Decimal numbers without floats: whole billionths of a unit.

use core::fmt::{self, Write};

/// Billionths in one.
pub const ONE: i64 = 1_000_000_000;

/// Most digits that are looked at; more than 64 bits hold in any case.
const MOST_EXPONENT: i32 = 40;

/// A number of a text (`5`, `-2.25`, `1e-3`) in billionths, rounded; `None` if it is no number or beyond
/// +-9.2e9.
#[must_use]
pub fn billionths(text: &str) -> Option<i64> {
    let (negative, digits) = match text.as_bytes() {
        [b'-', rest @ ..] => (true, rest),
        [b'+', rest @ ..] => (false, rest),
        rest => (false, rest),
    };
    let (mut mantissa, mut scale, mut any, mut behind_point) = (0i64, 9i32, false, false);
    let mut rest = digits.iter();
    while let Some(byte) = rest.next() {
        match byte {
            b'0'..=b'9' => {
                any = true;
                match mantissa
                    .checked_mul(10)
                    .and_then(|tens| tens.checked_add(i64::from(byte - b'0')))
                {
                    Some(next) => {
                        mantissa = next;
                        scale = scale.saturating_sub(i32::from(behind_point));
                    }
                    // More digits than matter.
                    None => scale = scale.saturating_add(i32::from(!behind_point)),
                }
            }
            b'.' if !behind_point => behind_point = true,
            b'e' | b'E' if any => {
                let exponent: i32 = core::str::from_utf8(rest.as_slice()).ok()?.parse().ok()?;
                scale = scale.saturating_add(exponent);
                break;
            }
            _ => return None,
        }
    }
    let value = if any {
        scaled(mantissa, scale)?
    } else {
        return None;
    };
    Some(if negative { -value } else { value })
}

/// `mantissa * 10^scale`, rounded.
fn scaled(mantissa: i64, scale: i32) -> Option<i64> {
    let mut value = mantissa;
    for _ in 0..scale.clamp(0, MOST_EXPONENT) {
        value = value.checked_mul(10)?;
    }
    let divisions = scale.saturating_neg().clamp(0, MOST_EXPONENT);
    for nth in 1..=divisions {
        value = if nth == divisions {
            value / 10 + i64::from(value % 10 >= 5)
        } else {
            value / 10
        };
    }
    Some(value)
}

/// Billionths of a fixed-point number of so many fraction bits, at most 32, that may have more bits than a
/// signal; cut, not rounded.
#[must_use]
pub fn from_wide(value: i64, fraction_bits: u32) -> i64 {
    let (whole, part) = (value >> fraction_bits, value & ((1 << fraction_bits) - 1));
    whole
        .saturating_mul(ONE)
        .saturating_add((part * ONE) >> fraction_bits)
}

/// Billionths as a fixed-point number of so many fraction bits, rounded; `None` where it has no room.
#[must_use]
pub fn to_fixed(billionths: i64, fraction_bits: u32) -> Option<i32> {
    let most = ONE << 31u32.checked_sub(fraction_bits)?;
    if billionths.abs() > most {
        return None;
    }
    // At most 10^9 * 2^31, which is below 2^61.
    let shifted = billionths << fraction_bits;
    i32::try_from((shifted + shifted.signum() * (ONE / 2)) / ONE).ok()
}

/// A fixed-point number of so many fraction bits in billionths, rounded.
#[must_use]
pub fn from_fixed(value: i32, fraction_bits: u32) -> i64 {
    let half = 1i64
        .checked_shl(fraction_bits.saturating_sub(1))
        .unwrap_or(0);
    (i64::from(value) * ONE + half) >> fraction_bits
}

/// Billionths written with so many digits behind the point, 1 to 9; what lies behind them is rounded.
#[derive(Clone, Copy, Debug)]
pub struct Decimal {
    /// The number.
    pub billionths: i64,
    /// Digits behind the point.
    pub digits: u32,
}

impl fmt::Display for Decimal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let digits = self.digits.clamp(1, 9);
        let unit = 10i64.pow(9 - digits);
        let rounded = self
            .billionths
            .unsigned_abs()
            .saturating_add(unit.unsigned_abs() / 2)
            / unit.unsigned_abs();
        let (whole, part) = (rounded / 10u64.pow(digits), rounded % 10u64.pow(digits));
        if self.billionths < 0 && rounded != 0 {
            f.write_char('-')?;
        }
        write!(f, "{whole}.{part:0width$}", width = digits as usize)
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;
    use proptest::prelude::*;
    use std::string::ToString;

    #[test]
    fn what_programs_write_is_understood() {
        for (text, expected) in [
            ("5", Some(5 * ONE)),
            ("-2.25", Some(-2_250_000_000)),
            ("+0.5", Some(ONE / 2)),
            (".5", Some(ONE / 2)),
            ("5.", Some(5 * ONE)),
            ("1e-05", Some(10_000)),
            ("1.5E3", Some(1500 * ONE)),
            ("1e-40", Some(0)),
            ("0e99", Some(0)),
            ("0.12345678949", Some(123_456_789)),
            ("9999999999", None),
            ("1e30", None),
            ("99999999999999999999999999", None),
            ("", None),
            ("-", None),
            (".", None),
            ("e5", None),
            ("1e", None),
            ("1.2.3", None),
            ("nan", None),
            ("0x10", None),
        ] {
            assert_eq!(billionths(text), expected, "{text}");
        }
    }

    #[test]
    fn numbers_are_written_as_they_are() {
        let text = |billionths, digits| Decimal { billionths, digits }.to_string();
        assert_eq!(text(5 * ONE, 6), "5.000000");
        assert_eq!(text(-1, 6), "0.000000");
        assert_eq!(text(-1_500, 6), "-0.000002");
        assert_eq!(text(50_000, 6), "0.000050");
        assert_eq!(text(i64::MIN, 9), "-9223372036.854775808");
    }

    proptest! {
        /// The oracle is the standard library's double, which has fifteen digits to spare here.
        #[test]
        fn a_number_agrees_with_floats(value in -100.0f64..100.0, digits in 0usize..9) {
            let text = std::format!("{value:.digits$}");
            let ours = billionths(&text).map(|n| n as f64 / 1e9);
            let theirs: f64 = text.parse().unwrap();
            prop_assert!((ours.unwrap() - theirs).abs() < 1e-9, "{}", text);
            let fixed = to_fixed(billionths(&text).unwrap(), 24).unwrap();
            prop_assert!((f64::from(fixed) / 16_777_216.0 - theirs).abs() < 1e-7);
            prop_assert!((from_fixed(fixed, 24) as f64 / 1e9 - theirs).abs() < 1e-7);
        }

        #[test]
        fn no_text_does_harm(text in "\\PC{0,40}", value: i64, digits in 0u32..20, bits in 0u32..40) {
            let _ = billionths(&text);
            let _ = to_fixed(value, bits.min(31));
            let _ = Decimal { billionths: value, digits }.to_string();
        }
    }
}
