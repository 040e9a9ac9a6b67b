//! What ends or restarts the program, and that the drive is at rest whenever it does.
//!
//! A panic, a hard fault (an overflow of the stack is one), a lost crystal (the clock security system's NMI)
//! or a supply that falls first sets the drive's converter up anew and puts the rest code on it, at once and
//! from any state ([`FrontEnd::force`]). It then leaves a mark in memory that survives a reset, and restarts.
//! At start [`cause_of_last_restart`] names what happened, the watchdog's bite included, and the amplifier
//! stays at rest until that fault is cleared.

use core::mem::MaybeUninit;
use core::sync::atomic::{AtomicU32, Ordering};

use cortex_m::peripheral::DWT;
use hysteron_core::codes::DriveCode;
use hysteron_core::guard::Fault;

use crate::board::{Board, Converters, Platform};
use crate::front_end::{CodeBits, FrontEnd, Wiring};
use crate::safety_lines;

/// A mark that says "this program stopped itself"; its lowest byte is the fault's number.
const MARK: u32 = 0x4859_5300;
#[unsafe(link_section = ".uninit.restart_mark")]
static mut RESTART_MARK: MaybeUninit<u32> = MaybeUninit::uninit();
/// In the converter's own bits. No code until a block gives one: the converter is then as it left its reset.
static REST_CODE: AtomicU32 = AtomicU32::new(NO_CODE);
const NO_CODE: u32 = u32::MAX;

/// Tells the fault handlers which code of so many bits is rest.
pub fn remember_rest(code: DriveCode, bits: CodeBits) {
    REST_CODE.store(
        code.steps() << Converters::BITS.dac.saturating_sub(bits.dac),
        Ordering::Relaxed,
    );
}

/// Why the part restarted, if that was a fault; clears the flags.
pub fn cause_of_last_restart() -> Option<Fault> {
    // SAFETY: memory that nothing initialises; any value may be there. Only thread code before the start
    // touches it.
    let marked = unsafe {
        let mark = &raw mut RESTART_MARK;
        let marked = mark.cast::<u32>().read_volatile();
        mark.cast::<u32>().write_volatile(0);
        marked
    };
    let cause = Board::reset_cause();
    if cause.watchdog {
        Some(Fault::Watchdog)
    } else if marked & !0xFF == MARK && cause.software {
        Fault::from_number(marked as u8)
    } else if cause.brown_out {
        Some(Fault::BrownOut)
    } else {
        None
    }
}

/// Whether the cycle counter runs: with it the control interrupt finds ticks that were skipped.
pub fn cycle_counter_runs() -> bool {
    let before = DWT::cycle_count();
    cortex_m::asm::delay(100);
    DWT::cycle_count() != before
}

/// The drive to rest, then a restart that remembers why.
pub fn stop(fault: Fault) -> ! {
    cortex_m::interrupt::disable();
    safety_lines::set_enable(false);
    let rest = REST_CODE.load(Ordering::Relaxed);
    if rest != NO_CODE {
        Converters::new(Converters::BITS, Wiring::default()).force(DriveCode::new(rest));
    }
    // SAFETY: interrupts are off; nobody else runs any more.
    unsafe {
        (&raw mut RESTART_MARK)
            .cast::<u32>()
            .write_volatile(MARK | fault as u32)
    };
    cortex_m::asm::dsb();
    // A converter that took no code at once has two edges of the sample clock to take it.
    cortex_m::asm::delay(40_000);
    cortex_m::peripheral::SCB::sys_reset()
}
