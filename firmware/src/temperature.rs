//! Temperatures of the part, by its own sensor where the board reads it ([`Platform::part_decicelsius`]), and
//! of the amplifier, where the safety envelope has its sensor. Too high a one is a fault,
//! [`Fault::PartTooHot`](hysteron_core::guard::Fault::PartTooHot) and
//! [`Fault::AmplifierTooHot`](hysteron_core::guard::Fault::AmplifierTooHot).

use core::sync::atomic::Ordering;

use crate::board::{Board, Platform};
use crate::temperature_codes::{AMPLIFIER, NOT_YET, PART, code};
use crate::{control, settings};

/// 105 degrees Celsius. The junction bears 125 (DS12110, table 21), the sensor's line is straight to 3 degrees
/// (table 180), and a fan or a cover that is missing leaves some minutes from here.
const MOST_DECICELSIUS: i32 = 1_050;

/// The part's temperature, tenths of a degree Celsius; `None` before the first reading, and on a board that
/// reads none.
pub fn decicelsius() -> Option<i32> {
    Board::part_decicelsius(code(&PART)?)
}

/// The amplifier's, in the same way; `None` also while its sensor is open or shorted.
pub fn amplifier_decicelsius() -> Option<i32> {
    settings::envelope()?.amplifier_decicelsius(code(&AMPLIFIER)?)
}

/// Looks whether part or amplifier are too hot. An amplifier whose sensor does not answer counts as hot.
pub fn watch() {
    let part = decicelsius().is_some_and(|now| now > MOST_DECICELSIUS);
    let is_read = AMPLIFIER.load(Ordering::Relaxed) != NOT_YET;
    let amplifier = is_read
        && settings::envelope()
            .is_some_and(|envelope| envelope.amplifier_is_too_hot(code(&AMPLIFIER)));
    control::set_too_hot(part, amplifier);
}
