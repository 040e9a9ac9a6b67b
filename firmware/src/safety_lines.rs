//! The lines between the board and what makes a bench safe: three inputs that stop the amplifier, one output that lets its power stage work.
//!
//! | signal | pin | level |
//! |---|---|---|
//! | emergency stop | PE0 | a closed contact to ground is fine; open, a broken wire included, stops |
//! | interlock | PE12 | the same |
//! | amplifier ready | PE10 | the same: the amplifier's output that conducts while it is ready |
//! | enable | PE14 | high while the amplifier may drive; low at a fault once the drive has come to rest, and whenever the part does not run |
//!
//! The inputs are looked at in every tick. A stop is the ramp to rest, as at every fault; the enable output falls at its end.

use embassy_stm32::pac::gpio::vals::{Moder, Pupdr};
use embassy_stm32::pac::{GPIOE, RCC};
use hysteron_core::guard::Fault;

const EMERGENCY_STOP: u32 = 1 << 0;
const INTERLOCK: u32 = 1 << 12;
const AMPLIFIER_READY: u32 = 1 << 10;
const ENABLE_PIN: usize = 14;

/// Sets the pins up; the enable output is low.
pub fn start() {
    RCC.ahb4enr().modify(|w| w.set_gpioeen(true));
    let _ = RCC.ahb4enr().read();
    cortex_m::asm::dsb();
    for pin in [0, 12, 10] {
        GPIOE.pupdr().modify(|w| w.set_pupdr(pin, Pupdr::PULL_UP));
        GPIOE.moder().modify(|w| w.set_moder(pin, Moder::INPUT));
    }
    set_enable(false);
    GPIOE.moder().modify(|w| w.set_moder(ENABLE_PIN, Moder::OUTPUT));
}

/// What an input asks to stop for.
#[inline(always)]
pub fn fault() -> Option<Fault> {
    let open = GPIOE.idr().read().0 & (EMERGENCY_STOP | INTERLOCK | AMPLIFIER_READY);
    match open {
        0 => None,
        _ if open & EMERGENCY_STOP != 0 => Some(Fault::EmergencyStop),
        _ if open & INTERLOCK != 0 => Some(Fault::Interlock),
        _ => Some(Fault::AmplifierNotReady),
    }
}

/// Lets the amplifier's power stage work, or not.
#[inline(always)]
pub fn set_enable(enable: bool) {
    GPIOE.bsrr().write(|w| w.0 = if enable { 1 << ENABLE_PIN } else { 1 << (ENABLE_PIN + 16) });
}
