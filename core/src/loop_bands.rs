//! How much of its sensor's noise a closed loop passes on, by bands: what a block says of its design.

use crate::wire::wire_struct;

/// Half-octaves from half the sampling rate downwards; the last one reaches to zero, from 14 Hz at 20 kHz.
pub const BANDS: usize = 20;
/// Fraction bits of the bands: what is 8 or more takes no filter at all.
pub const BAND_FRACTION_BITS: u32 = 5;
/// `|T|` of a closed loop, the largest magnitude in each band, rounded up.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LoopBands {
    /// From the highest band to the lowest, with [`BAND_FRACTION_BITS`].
    pub transmission: [u8; BANDS],
}

wire_struct!(LoopBands { transmission });

impl LoopBands {
    /// No loop is closed.
    pub const OPEN: Self = Self {
        transmission: [0; BANDS],
    };
    /// Nothing is known of the loop, so it takes no filter.
    pub const UNKNOWN: Self = Self {
        transmission: [u8::MAX; BANDS],
    };
}
