//! The part's temperature, by its own sensor where the board reads it ([`Platform::part_decicelsius`]). Too
//! high a one is a fault, [`Fault::PartTooHot`](hysteron_core::guard::Fault::PartTooHot).

use core::sync::atomic::{AtomicU32, Ordering};

use crate::board::{Board, Platform, SAMPLE_RATE_HZ};
use crate::control;

/// 105 degrees Celsius. The junction bears 125 (DS12110, table 21), the sensor's line is straight to 3 degrees
/// (table 180), and a fan or a cover that is missing leaves some minutes from here.
const MOST_DECICELSIUS: i32 = 1_050;

/// Whether it is read at this sampling rate: there must be time for a conversion within a period.
pub const IS_READ: bool = SAMPLE_RATE_HZ <= 20_000;

/// What the sensor's converter gave last, of 65,536, or [`NO_CODE`].
static CODE: AtomicU32 = AtomicU32::new(NO_CODE);
const NO_CODE: u32 = u32::MAX;

/// Takes what the converter gave; the control interrupt calls it.
#[inline(always)]
pub fn take(code: Option<u16>) {
    CODE.store(code.map_or(NO_CODE, u32::from), Ordering::Relaxed);
}

/// The part's temperature, tenths of a degree Celsius; `None` before the first reading, and on a board that
/// reads none.
pub fn decicelsius() -> Option<i32> {
    let code = u16::try_from(CODE.load(Ordering::Relaxed)).ok()?;
    Board::part_decicelsius(code)
}

/// Looks whether the part is too hot.
pub fn watch() {
    if let Some(now) = decicelsius() {
        control::set_too_hot(now > MOST_DECICELSIUS);
    }
}
