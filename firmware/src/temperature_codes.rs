//! What the converter gave last of the temperatures of part and amplifier: the control interrupt writes it,
//! tasks read it.

use core::sync::atomic::{AtomicU32, Ordering};

/// What the converter gave last of part and amplifier, of 65,536, [`NO_CODE`] or [`NOT_YET`].
pub static PART: AtomicU32 = AtomicU32::new(NOT_YET);
pub static AMPLIFIER: AtomicU32 = AtomicU32::new(NOT_YET);
/// The converter gave nothing.
const NO_CODE: u32 = u32::MAX;
/// Nothing has been read since the start.
pub const NOT_YET: u32 = NO_CODE - 1;

/// Takes what the converter gave of the part; the control interrupt calls it.
#[inline(always)]
pub fn take(code: Option<u16>) {
    PART.store(code.map_or(NO_CODE, u32::from), Ordering::Relaxed);
}

/// Takes what it gave of the amplifier.
#[inline(always)]
pub fn take_amplifiers(code: Option<u16>) {
    AMPLIFIER.store(code.map_or(NO_CODE, u32::from), Ordering::Relaxed);
}

/// The code of one of them, if the converter gave one.
pub fn code(place: &AtomicU32) -> Option<u16> {
    u16::try_from(place.load(Ordering::Relaxed)).ok()
}
