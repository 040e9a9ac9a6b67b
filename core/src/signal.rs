//! The fixed-point formats of every signal in the tick. Each format is a type of the crate `fixed`, whose raw integer is what the tick
//! computes with; converting costs nothing.
//!
//! | signal | type | unit | range | resolution |
//! |---|---|---|---|---|
//! | position, force-equivalent displacement, their errors and estimates | [`Micrometres`] | um | +-128 | 6e-8 |
//! | velocity, times the sampling period | [`Micrometres`] | um per sample | +-128 | 6e-8 |
//! | drive | [`Volts`] | V | +-512 | 2.4e-7 |
//! | drive above its lower limit, as a share of its range | [`DriveShare`] | 1 | +-2 | 9e-10 |
//!
//! Velocities are carried times the sampling period so that they have the size of positions and need no format of their own.
//! Nothing wraps: a conversion to 32 bits saturates, and counts that it did, or is [`narrow`], where the checks of the parameter block
//! ([`crate::parameter_block::verify`]) make every value fit. The tests of this crate are built so that a value that does not fit, or a sum
//! that wraps, fails them; one of them runs the amplifier over blocks of every kind that is accepted.

/// Position, force-equivalent displacement, or velocity times the sampling period, um.
pub type Micrometres = fixed::types::I8F24;
/// Drive, V.
pub type Volts = fixed::types::I10F22;
/// Drive above its lower limit divided by its range.
pub type DriveShare = fixed::types::I2F30;

/// Fraction bits of [`Micrometres`].
pub const MICROMETRE_FRACTION_BITS: u32 = 24;
/// Fraction bits of [`Volts`].
pub const VOLT_FRACTION_BITS: u32 = 22;
/// Fraction bits of [`DriveShare`].
pub const SHARE_FRACTION_BITS: u32 = 30;

/// The nearest 32-bit value; counts when it is not the value itself.
#[inline(always)]
#[must_use]
pub fn saturate(value: i64, saturated: &mut u32) -> i32 {
    let low = value as i32;
    if i64::from(low) == value { low } else { end_of_format(value, saturated) }
}

/// The value in 32 bits, where it is known to fit.
#[inline(always)]
#[must_use]
pub fn narrow(value: i64) -> i32 {
    #[cfg(test)]
    assert!(i32::try_from(value).is_ok(), "{value} has no room in 32 bits");
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
    #[cfg(test)]
    assert!(a.checked_add(b).is_some(), "{a} + {b} wraps");
    a.wrapping_add(b)
}

#[cold]
#[inline(never)]
fn end_of_format(value: i64, saturated: &mut u32) -> i32 {
    *saturated = saturated.saturating_add(1);
    if value > 0 { i32::MAX } else { i32::MIN }
}
