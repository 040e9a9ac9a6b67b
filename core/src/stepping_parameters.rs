//! The integers of a stick-slip drive ([`crate::stepping`]) in a block, and whether a build has them.

use crate::codes::{DriveCode, MOST_BITS};
use crate::signal::Travel;
use crate::wire::{BlockError, Reader, Wire, Writer, wire_struct};

/// Fraction bits of shares of a flank.
pub const FLANK_FRACTION_BITS: u32 = 15;
/// Bits of the encoder's count in a reading: as many as the widest code has.
pub const ENCODER_BITS: u8 = MOST_BITS;
/// Places of an [`IfStepping`].
const PLACES: usize = cfg!(feature = "stepping") as usize;

/// What a stepping drive has and another one has not. In a build without the feature `stepping` it is never
/// there and takes no room.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct IfStepping<T>([Option<T>; PLACES]);

impl<T> IfStepping<T> {
    /// Not there.
    pub const NONE: Self = Self([const { None }; PLACES]);

    /// There, in a build that has it.
    #[must_use]
    pub fn new(value: T) -> Self {
        let mut value = Some(value);
        Self([const { None }; PLACES].map(|_: Option<T>| value.take()))
    }

    /// The value.
    #[inline(always)]
    #[must_use]
    pub fn get(&self) -> Option<&T> {
        self.0.first()?.as_ref()
    }

    /// The value, to change it.
    #[inline(always)]
    #[must_use]
    pub fn get_mut(&mut self) -> Option<&mut T> {
        self.0.first_mut()?.as_mut()
    }
}

/// Integers of the stepping, quantised once on the host.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SteppingParameters {
    /// Travel per count of the encoder, um with 40 fraction bits.
    pub encoder_step: i64,
    /// Lower end of the teeth.
    pub low: DriveCode,
    /// Upper end of the teeth.
    pub high: DriveCode,
    /// Ticks of a whole slow flank.
    pub slow_ticks: u16,
    /// Ticks of a whole fast flank.
    pub fast_ticks: u16,
    /// How much the slow flank gathers speed, with [`FLANK_FRACTION_BITS`]: 0 is straight, 1 begins at rest.
    pub curvature: u16,
    /// Ticks of rest between coarse and fine motion.
    pub settle_ticks: u16,
    /// Ticks of the way to the target in fine motion.
    pub fine_ticks: u16,
    /// Distance within which fine motion takes over.
    pub reach: Travel,
    /// Distance behind a moving target at which a tooth begins.
    pub lead: Travel,
    /// Lower end of the travel.
    pub travel_min: Travel,
    /// Upper end of the travel.
    pub travel_max: Travel,
    /// Distance from an end within which a stall is an end stop; a position further beyond is one too.
    pub end_zone: Travel,
    /// Least travel of a whole tooth.
    pub least_step: Travel,
    /// Whole teeth in a row with less, or teeth for want of reach on the way to one target, that are a stall.
    pub stall_teeth: u16,
    /// Distance from the target that counts as arrived.
    pub tolerance: Travel,
    /// Ticks in a row within it.
    pub arrival_ticks: u16,
}

impl Wire for Travel {
    fn write(&self, to: &mut Writer<'_>) -> Result<(), BlockError> {
        self.to_bits().write(to)
    }
    fn read(from: &mut Reader<'_>) -> Result<Self, BlockError> {
        i32::read(from).map(Self::from_bits)
    }
}

wire_struct!(SteppingParameters {
    encoder_step,
    low,
    high,
    slow_ticks,
    fast_ticks,
    curvature,
    settle_ticks,
    fine_ticks,
    reach,
    lead,
    travel_min,
    travel_max,
    end_zone,
    least_step,
    stall_teeth,
    tolerance,
    arrival_ticks,
});
/// Bytes of them in a block.
pub(crate) const STEPPING_BYTES: usize = 58;
