//! What ends or restarts the program, and that the drive is at rest whenever it does.
//!
//! A panic, a hard fault (an overflow of the stack is one, [`crate::stack`]), a lost crystal (the clock
//! security system's NMI, which the board takes) or a supply that falls ([`crate::supply`]) first sets the
//! drive's converter up anew and puts the rest code on it, at once and from any state ([`FrontEnd::force`]).
//! It then leaves a mark in memory that survives a reset, and restarts. The watchdog restarts a program whose
//! ticks or tasks have stopped. At start [`cause_of_last_restart`] names what happened, and the amplifier
//! stays at rest until that fault is cleared.

use core::mem::MaybeUninit;
use core::panic::PanicInfo;
use core::sync::atomic::{AtomicU32, Ordering};

use cortex_m::peripheral::DWT;
use embassy_stm32::pac::iwdg::vals::{Key, Pr};
use hysteron_core::codes::DriveCode;
use hysteron_core::guard::Fault;

use crate::board::{Board, Converters, Platform};
use crate::control;
use crate::front_end::{CodeBits, FrontEnd, Wiring};
use crate::safety_lines;
use crate::serial_port;
use crate::task_clock;
use crate::update;

/// A mark that says "this program stopped itself"; its lowest byte is the fault's number.
const MARK: u32 = 0x4859_5300;
#[unsafe(link_section = ".uninit.restart_mark")]
static mut RESTART_MARK: MaybeUninit<u32> = MaybeUninit::uninit();
/// In the converter's own bits. No code until a block gives one: the converter is then as it left its reset.
static REST_CODE: AtomicU32 = AtomicU32::new(NO_CODE);
const NO_CODE: u32 = u32::MAX;

/// Watchdog period: 32 kHz / 16 counts down from this in 50 ms.
const WATCHDOG_COUNTS: u16 = 100;
/// Periods of the tasks' clock between two feedings: 10 ms.
const WATCH_PERIODS: u64 = 10;

/// Feedings in a row, each behind ticks that went on and were not late, with a serial port that answers, that make an image healthy: 1 s.
const HEALTHY_FEEDINGS: u32 = 100;
/// An image on trial that has not been healthy after so many is restarted, and so rolled back: 10 s.
const MOST_TRIAL_FEEDINGS: u32 = 1_000;

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

/// Starts the watchdog and feeds it as long as ticks and tasks go on.
pub async fn watch() {
    Board::WATCHDOG.kr().write(|w| w.set_key(Key::START));
    Board::WATCHDOG.kr().write(|w| w.set_key(Key::ENABLE));
    Board::WATCHDOG.pr().write(|w| w.set_pr(Pr::DIVIDE_BY16));
    Board::WATCHDOG.rlr().write(|w| w.set_rl(WATCHDOG_COUNTS));
    let mut last = control::ticks();
    let (mut overruns, mut healthy, mut of_trial) = (control::overruns(), 0, 0);
    loop {
        task_clock::periods(WATCH_PERIODS).await;
        let ticks = control::ticks();
        if ticks != last {
            Board::WATCHDOG.kr().write(|w| w.set_key(Key::RESET));
        }
        if update::is_on_trial() {
            let went_on = ticks != last
                && control::overruns() == overruns
                // Without it nobody could bring another image.
                && serial_port::is_alive();
            healthy = if went_on { healthy + 1 } else { 0 };
            of_trial += 1;
            if healthy == HEALTHY_FEEDINGS {
                update::healthy();
            } else if of_trial == MOST_TRIAL_FEEDINGS {
                stop(Fault::UpdateRolledBack);
            }
        }
        overruns = control::overruns();
        last = ticks;
    }
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

#[panic_handler]
fn panic(_: &PanicInfo) -> ! {
    stop(Fault::HardFault)
}

#[cortex_m_rt::exception]
unsafe fn HardFault(_: &cortex_m_rt::ExceptionFrame) -> ! {
    stop(Fault::HardFault)
}
