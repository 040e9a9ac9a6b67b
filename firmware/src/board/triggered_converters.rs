//! What the parts' own converters, ADC1 and DAC1, have in common once they are set up: a sample to read, a
//! code to write, and a code at once.

use embassy_stm32::pac::{ADC1, DAC1};
use hysteron_core::codes::SensorCode;

/// The highest code of the drive.
const MOST_CODE: u32 = 4_095;
/// Polls of a flag before the converter counts as silent.
const MOST_POLLS: u32 = 400;

/// The sensor's code sampled at the latest edge; `None` if the converter did not answer.
#[inline(always)]
pub fn read() -> Option<SensorCode> {
    let mut polls = 0;
    while !ADC1.isr().read().eoc() {
        polls += 1;
        if polls == MOST_POLLS {
            return None;
        }
    }
    Some(SensorCode::new(ADC1.dr().read().rdata().into()))
}

/// The drive's code for the next edge.
#[inline(always)]
pub fn write(code: u32) -> bool {
    DAC1.dhr12r(0)
        .write(|w| w.set_dhr(code.min(MOST_CODE) as u16));
    true
}

/// The drive at a code without the sample clock; clocks and pins are set up.
pub fn force(code: u32) {
    DAC1.cr().modify(|w| w.set_ten(0, false));
    // Without a trigger a code acts one bus cycle later.
    write(code);
    DAC1.cr().modify(|w| w.set_en(0, true));
}
