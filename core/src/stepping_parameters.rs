//! The integers of a stick-slip drive ([`crate::stepping`]) in a block, and whether a build has them.

use crate::codes::{DriveCode, MOST_BITS};
use crate::servo_parameters::ServoParameters;
use crate::signal::{MICROMETRE_FRACTION_BITS, TRAVEL_FRACTION_BITS, Travel};
use crate::wire::{BlockError, Reader, Wire, Writer, wire_struct};

/// Fraction bits of shares of a flank.
pub const FLANK_FRACTION_BITS: u32 = 15;
/// Bits of the encoder's count in a reading: as many as the widest code has.
pub const ENCODER_BITS: u8 = MOST_BITS;
/// Longest flank: its ticks have room above [`FLANK_FRACTION_BITS`].
pub(crate) const MOST_TICKS: u64 = (1 << (32 - FLANK_FRACTION_BITS)) - 1;

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

/// What of the parameters contradicts the servo's, or itself.
///
/// # Errors
/// That.
pub fn verify(servo: &ServoParameters, p: &SteppingParameters) -> Result<(), &'static str> {
    let c = &servo.converters;
    if servo.learning.is_some() || servo.adaptation.is_some() {
        return Err("a stick-slip drive learns neither a correction nor its gain");
    }
    if !(c.dac_code_min <= p.low && p.low < p.high && p.high <= c.dac_code_max) {
        return Err(
            "ends of the teeth; expected two codes within the drive's limits, the lower first",
        );
    }
    if !(8..=20).contains(&c.adc_bits) {
        return Err("window of the fine law; expected 8 to 20 bits");
    }
    if !(1..1 << 46).contains(&p.encoder_step) || p.encoder_step != c.adc_step {
        return Err("step of the encoder; expected that of the fine law, above zero");
    }
    // um (40) -> um (24)
    let half_window = p
        .encoder_step
        .checked_mul(1 << (c.adc_bits - 1))
        .map(|wide| wide >> 16);
    let middle = half_window.map(|half| half.saturating_add(i64::from(c.adc_zero)));
    // The rounding of the step, over half the codes.
    if middle.is_none_or(|off| off.unsigned_abs() > 1 << 12) {
        return Err("zero of the fine law; expected the middle of its window");
    }
    let reach = i64::from(p.reach.to_bits()) << (MICROMETRE_FRACTION_BITS - TRAVEL_FRACTION_BITS);
    if reach <= 0 || half_window.is_none_or(|half| 2 * reach > half) {
        return Err("reach; expected above zero and at most a quarter of the fine law's window");
    }
    if [p.slow_ticks, p.fast_ticks, p.fine_ticks, p.stall_teeth].contains(&0)
        || u32::from(p.curvature) > 1 << FLANK_FRACTION_BITS
    {
        return Err("flanks; expected ticks and teeth above zero and a curvature of at most 1");
    }
    let positive = [p.lead, p.least_step, p.tolerance];
    if positive.iter().any(|v| *v <= 0) || p.end_zone < 0 || p.travel_min >= p.travel_max {
        return Err(
            "travel; expected its lower end first, and lead, least step and tolerance above zero",
        );
    }
    Ok(())
}
