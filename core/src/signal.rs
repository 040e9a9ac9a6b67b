//! The fixed-point formats of every signal in the tick. Each format is a type of the crate `fixed`, whose raw
//! integer is what the tick computes with; converting costs nothing.
//!
//! | signal | type | unit | range | resolution |
//! |---|---|---|---|---|
//! | position, force-equivalent displacement, errors, estimates | [`Micrometres`] | um | +-128 | 6e-8 |
//! | velocity, times the sampling period | [`Micrometres`] | um per sample | +-128 | 6e-8 |
//! | drive | [`Volts`] | V | +-512 | 2.4e-7 |
//! | travel of a stepping drive ([`crate::stepping`]) | [`Travel`] | um | +-32 768 | 1.5e-5 |
//! | drive above its lower limit, as a share of its range | [`DriveShare`] | 1 | +-2 | 9e-10 |
//!
//! Velocities are carried times the sampling period so that they have the size of positions and need no
//! format of their own. Nothing wraps: a conversion to 32 bits saturates, and counts that it did, or is
//! [`narrow`], where the checks of the parameter block ([`crate::parameter_block::verify`]) make every value
//! fit. The tests of this crate are built so that a value that does not fit, or a sum that wraps, fails them;
//! one of them runs the amplifier over blocks of every kind that is accepted.

/// Position, force-equivalent displacement, or velocity times the sampling period, um.
pub type Micrometres = fixed::types::I8F24;
/// Position of a slider along the travel of a stepping drive, um.
pub type Travel = fixed::types::I16F16;
/// Drive, V.
pub type Volts = fixed::types::I10F22;
/// Drive above its lower limit divided by its range.
pub type DriveShare = fixed::types::I2F30;

/// Fraction bits of [`Micrometres`].
pub const MICROMETRE_FRACTION_BITS: u32 = 24;
/// Fraction bits of [`Travel`].
pub const TRAVEL_FRACTION_BITS: u32 = 16;
/// Fraction bits of [`Volts`].
pub const VOLT_FRACTION_BITS: u32 = 22;
/// Fraction bits of [`DriveShare`].
pub const SHARE_FRACTION_BITS: u32 = 30;

/// A quantity with a unit, in the format that the tick has for it: the types do not mix.
pub trait Quantity: Copy + core::fmt::Debug + Eq {
    /// Fraction bits of its raw integer.
    const FRACTION_BITS: u32;
    /// From its raw integer.
    fn of_bits(bits: i32) -> Self;
    /// Its raw integer.
    fn bits(self) -> i32;
}

macro_rules! quantity {
    ($type:ty, $fraction_bits:expr) => {
        impl Quantity for $type {
            const FRACTION_BITS: u32 = $fraction_bits;
            #[inline(always)]
            fn of_bits(bits: i32) -> Self {
                Self::from_bits(bits)
            }
            #[inline(always)]
            fn bits(self) -> i32 {
                self.to_bits()
            }
        }
    };
}
quantity!(Micrometres, MICROMETRE_FRACTION_BITS);
quantity!(Volts, VOLT_FRACTION_BITS);

/// The nearest 32-bit value; counts when it is not the value itself.
#[inline(always)]
#[must_use]
pub fn saturate(value: i64, saturated: &mut u32) -> i32 {
    let low = value as i32;
    if i64::from(low) == value {
        low
    } else {
        end_of_format(value, saturated)
    }
}

/// A sum with `Q` fraction bits more than it is to have, which are cut off; counts when what is left is not
/// in 32 bits. `Q` is from 1 to 31.
#[inline(always)]
#[must_use]
pub fn saturate_shifted<const Q: u32>(sum: i64, saturated: &mut u32) -> i32 {
    // It fits where all bits above the result's are its sign: one comparison of the upper word.
    let above = ((sum >> 32) as i32).wrapping_add(1 << (Q - 1)) as u32;
    if above < 1 << Q {
        (sum >> Q) as i32
    } else {
        end_of_format(sum, saturated)
    }
}

/// The value in 32 bits, where it is known to fit.
#[inline(always)]
#[must_use]
pub fn narrow(value: i64) -> i32 {
    #[cfg(any(test, debug_assertions))]
    assert!(
        i32::try_from(value).is_ok(),
        "{value} has no room in 32 bits"
    );
    value as i32
}

/// mV to V with 22 fraction bits; a parameter block has none beyond their range.
#[must_use]
pub fn volts(millivolts: i32) -> i32 {
    narrow((i64::from(millivolts) << VOLT_FRACTION_BITS) / 1000)
}

/// A sum that is known to fit.
#[inline(always)]
#[must_use]
pub fn sum(a: i64, b: i64) -> i64 {
    #[cfg(any(test, debug_assertions))]
    assert!(a.checked_add(b).is_some(), "{a} + {b} wraps");
    a.wrapping_add(b)
}

#[cold]
#[inline(never)]
fn end_of_format(value: i64, saturated: &mut u32) -> i32 {
    *saturated = saturated.saturating_add(1);
    if value > 0 { i32::MAX } else { i32::MIN }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;
    use proptest::prelude::*;

    fn both<const Q: u32>(sum: i64) {
        let mut counts = [0, 0];
        let [shifted, plain] = &mut counts;
        assert_eq!(
            saturate_shifted::<Q>(sum, shifted),
            saturate(sum >> Q, plain),
            "{sum} {Q}"
        );
        assert_eq!(counts[0], counts[1], "{sum} {Q}");
    }

    proptest! {
        #[test]
        fn a_shifted_sum_saturates_as_its_value_does(sum in any::<i64>(), less in 0u32..63, beside in -3i64..3) {
            let end = (1i64 << 58).wrapping_add(beside);
            for sum in [sum, sum >> less, end, -end, beside << 58, (beside << 58) - 1, beside << 55, (beside << 55) - 1] {
                both::<1>(sum);
                both::<24>(sum);
                both::<27>(sum);
                both::<31>(sum);
            }
        }
    }
}
