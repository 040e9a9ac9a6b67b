//! Codes of the two converters, as types that the compiler keeps apart: what the sensor's converter gave is
//! no drive.
//!
//! # How it works
//! A code counts steps of its converter from 0 and has up to [`MOST_BITS`] bits; how many it really has, the
//! parameter block says ([`crate::servo_parameters::ConverterParameters`]). Differences of codes, slew limits
//! and ramps are plain numbers of steps. What would leave the widest code is held at its end: no code wraps.

use core::ops::{Add, Sub};

/// Bits of the widest code.
pub const MOST_BITS: u8 = 20;
/// Bits of the narrowest one.
pub const LEAST_BITS: u8 = 8;
const MOST: u32 = (1 << MOST_BITS) - 1;

macro_rules! code {
    ($(#[$doc:meta])* $name:ident) => {
        $(#[$doc])*
        #[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
        pub struct $name(u32);

        impl $name {
            /// The highest one of the widest converter.
            pub const MOST: Self = Self(MOST);

            /// So many steps above the lowest code; the widest code's end where there are none so far.
            #[inline(always)]
            #[must_use]
            pub const fn new(steps: u32) -> Self {
                Self(if steps > MOST { MOST } else { steps })
            }

            /// So many steps, which are known to be no more than [`Self::MOST`]: the checks of the parameter
            /// block keep them there.
            #[inline(always)]
            #[allow(dead_code)] // the tick makes codes of drives only
            pub(crate) fn known(steps: i32) -> Self {
                #[cfg(test)]
                assert!((0..=MOST as i32).contains(&steps), "{steps} is no code");
                Self(steps as u32)
            }

            /// The highest code of a converter of so many bits.
            #[inline(always)]
            #[must_use]
            pub const fn highest(bits: u8) -> Self {
                Self(if bits < MOST_BITS { (1 << bits) - 1 } else { MOST })
            }

            /// Steps above the lowest code.
            #[inline(always)]
            #[must_use]
            pub const fn steps(self) -> u32 {
                self.0
            }

            /// Steps from one to the other, either way.
            #[inline(always)]
            #[must_use]
            pub const fn abs_diff(self, other: Self) -> u32 {
                self.0.abs_diff(other.0)
            }
        }

        impl From<u16> for $name {
            fn from(steps: u16) -> Self {
                Self(steps.into())
            }
        }

        impl From<$name> for f64 {
            fn from(code: $name) -> Self {
                code.0.into()
            }
        }

        impl From<$name> for i64 {
            #[inline(always)]
            fn from(code: $name) -> Self {
                code.0.into()
            }
        }

        impl core::fmt::Display for $name {
            fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
                self.0.fmt(f)
            }
        }

        /// So many steps higher; held at the end of the widest code.
        impl Add<u32> for $name {
            type Output = Self;
            #[inline(always)]
            fn add(self, steps: u32) -> Self {
                Self::new(self.0.saturating_add(steps))
            }
        }

        /// So many steps lower; held at the lowest code.
        impl Sub<u32> for $name {
            type Output = Self;
            #[inline(always)]
            fn sub(self, steps: u32) -> Self {
                Self(self.0.saturating_sub(steps))
            }
        }
    };
}

code! {
    /// What the sensor's converter gave.
    SensorCode
}
code! {
    /// What the drive's converter is given.
    DriveCode
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_code_wraps() {
        assert_eq!(DriveCode::new(u32::MAX), DriveCode::MOST);
        assert_eq!(
            (DriveCode::MOST + 1, DriveCode::MOST + u32::MAX),
            (DriveCode::MOST, DriveCode::MOST)
        );
        assert_eq!(
            (SensorCode::new(3) - 4, SensorCode::new(3) - u32::MAX),
            (SensorCode::default(), SensorCode::default())
        );
        assert_eq!(SensorCode::new(3).abs_diff(SensorCode::new(10)), 7);
    }

    #[test]
    fn the_highest_code_is_that_of_the_bits() {
        assert_eq!(
            [8, 12, 16, 18, 20].map(|bits| DriveCode::highest(bits).steps()),
            [255, 4095, 65_535, 262_143, 1_048_575]
        );
        assert_eq!(DriveCode::highest(32), DriveCode::MOST);
    }
}
