//! The lines between the board and what makes a bench safe: three inputs that stop the amplifier, one output
//! that lets its power stage work. The trigger output is on the same port.
//!
//! | signal | level |
//! |---|---|
//! | emergency stop | a closed contact to ground is fine; open, a broken wire included, stops |
//! | interlock | the same |
//! | amplifier ready | the same: the amplifier's output that conducts while it is ready |
//! | enable | high while armed; low after a fault's ramp to rest, and whenever the part does not run |
//!
//! Their pins are the board's ([`Platform::LINES`]).
//!
//! The inputs are looked at in every tick. A stop is the ramp to rest, as at every fault; the enable output
//! falls at its end. An emergency stop that must not depend on a program has a second contact in the enable
//! line itself (firmware/README.md, *Wiring*).

use embassy_stm32::pac::gpio::vals::{Moder, Pupdr};
use hysteron_core::guard::Fault;

use crate::board::{Board, Lines, Platform};

const LINES: Lines = Board::LINES;
const EMERGENCY_STOP: u32 = 1 << LINES.emergency_stop;
const INTERLOCK: u32 = 1 << LINES.interlock;
const AMPLIFIER_READY: u32 = 1 << LINES.amplifier_ready;

/// Sets the pins up; the enable output is low.
pub fn start() {
    Board::clock_lines();
    for pin in [LINES.emergency_stop, LINES.interlock, LINES.amplifier_ready] {
        LINES
            .port
            .pupdr()
            .modify(|w| w.set_pupdr(pin, Pupdr::PULL_UP));
        LINES
            .port
            .moder()
            .modify(|w| w.set_moder(pin, Moder::INPUT));
    }
    set_enable(false);
    set_trigger(false);
    for pin in [LINES.enable, LINES.trigger] {
        LINES
            .port
            .moder()
            .modify(|w| w.set_moder(pin, Moder::OUTPUT));
    }
}

/// What an input asks to stop for.
#[inline(always)]
pub fn fault() -> Option<Fault> {
    let open = LINES.port.idr().read().0 & (EMERGENCY_STOP | INTERLOCK | AMPLIFIER_READY);
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
    LINES.port.bsrr().write(|w| {
        w.0 = if enable {
            1 << LINES.enable
        } else {
            1 << (LINES.enable + 16)
        }
    });
}

/// The trigger output. No line of safety: it shares their port, and tells other instruments when the marked
/// point of a wave begins to act.
#[inline(always)]
pub fn set_trigger(high: bool) {
    LINES.port.bsrr().write(|w| {
        w.0 = if high {
            1 << LINES.trigger
        } else {
            1 << (LINES.trigger + 16)
        }
    });
}
