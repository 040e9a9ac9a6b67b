//! The part's own supply: the drive goes to rest while the part still works.
//!
//! # How it works
//! A voltage detector of the part compares the supply with a level of some 2.8 V. When it falls below, the
//! detector's line of the EXTI raises an interrupt as urgent as the control tick, which writes the rest code
//! at once and restarts ([`fault::stop`]): a supply of 3.3 V that is gone leaves microseconds, far less than
//! a ramp takes. Below the brown-out level of the option bytes ([`crate::option_bytes`]) the part is held in
//! reset, and the drive's converter with it. A start waits until the supply is there. Levels and registers
//! are the board's ([`Platform::watch_supply`]).

use embassy_stm32::pac::iwdg::vals::Key;
use hysteron_core::guard::Fault;

use crate::board::{Board, Platform};
use crate::fault;

/// For the detector to start, core cycles: at least 50 us.
const START_CYCLES: u32 = 20_000;

/// Waits until the supply is there, and lets the detector stop the drive from then on.
pub fn watch() {
    Board::start_supply_detector();
    cortex_m::asm::delay(START_CYCLES);
    if Board::supply_is_low() {
        defmt::error!("the supply is below 2.8 V: waiting for it");
        while Board::supply_is_low() {
            // One that the option bytes let start with the supply; it does nothing to one that has not been
            // started.
            Board::WATCHDOG.kr().write(|w| w.set_key(Key::RESET));
        }
    }
    Board::watch_supply();
    // It fell before the edge could count.
    if Board::supply_is_low() {
        fault::stop(Fault::SupplyLow);
    }
}
