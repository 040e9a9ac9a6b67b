//! The part's own supply: the drive goes to rest while the part still works.
//!
//! # How it works
//! The programmable voltage detector compares the supply with 2.76 V (falling; 2.86 V rising, DS12110, table 116). When it falls below, EXTI line 16
//! raises an interrupt as urgent as the control tick, which writes the rest code at once and restarts ([`fault::stop`]): a supply of
//! 3.3 V that is gone leaves microseconds, far less than a ramp takes. Below the brown-out level of the option bytes
//! ([`crate::option_bytes`]), 2.4 V, the part is held in reset, and the drive's converter with it. A start waits until the supply is there.

use embassy_stm32::interrupt;
use embassy_stm32::interrupt::{InterruptExt, Priority};
use embassy_stm32::pac::iwdg::vals::Key;
use embassy_stm32::pac::{EXTI, IWDG1, PWR};
use hysteron_core::guard::Fault;

use crate::fault;

/// PLS: the highest of the detector's own levels.
const LEVEL_2V76: u8 = 6;
/// The detector's line of the EXTI (RM0433, table 150).
const DETECTOR_LINE: usize = 16;
/// For the detector to start, core cycles: some 50 us.
const START_CYCLES: u32 = 20_000;

fn is_low() -> bool {
    PWR.csr1().read().pvdo()
}

/// Waits until the supply is there, and lets the detector stop the drive from then on.
pub fn watch() {
    PWR.cr1().modify(|w| {
        w.set_pls(LEVEL_2V76);
        w.set_pvde(true);
    });
    cortex_m::asm::delay(START_CYCLES);
    if is_low() {
        defmt::error!("the supply is below 2.8 V: waiting for it");
        while is_low() {
            // One that the option bytes let start with the supply; it does nothing to one that has not been started.
            IWDG1.kr().write(|w| w.set_key(Key::RESET));
        }
    }
    EXTI.rtsr(0).modify(|w| w.set_line(DETECTOR_LINE, true));
    EXTI.pr(0).write(|w| w.set_line(DETECTOR_LINE, true));
    EXTI.imr(0).modify(|w| w.set_line(DETECTOR_LINE, true));
    interrupt::PVD_AVD.set_priority(Priority::P0);
    // SAFETY: the handler below shares nothing with what it interrupts, and never returns to it.
    unsafe { interrupt::PVD_AVD.enable() };
    // It fell before the edge could count.
    if is_low() {
        fault::stop(Fault::SupplyLow);
    }
}

#[unsafe(no_mangle)]
extern "C" fn PVD_AVD() {
    fault::stop(Fault::SupplyLow)
}
