//! What the NUCLEO-H743ZI2 runs before the firmware: it brings the running image to what the journal asks for
//! ([`hysteron_core::firmware_update`]) and starts it.
//!
//! All of it runs from ITCM, on the internal oscillator, without interrupts. No pin is set up: the power
//! stage's enable line is low by its resistor, and the drive's converter is as its reset left it. The reset
//! flags stay for the firmware.
#![no_std]
#![no_main]

mod flash;

use core::panic::PanicInfo;

use cortex_m::peripheral::SCB;
use hysteron_core::firmware_update::{H743ZI, Start, UpdateFlash, prepare};
use stm32_metapac::IWDG1;
use stm32_metapac::iwdg::vals::{Key, Pr};

/// Where a stack begins: the end of DTCM.
const STACK: u32 = 0x2002_0000;

/// An image on trial is restarted, and so rolled back, unless it feeds the watchdog within the 4096 counts of
/// 32 kHz / 32 that the reset leaves: 4.1 s. The firmware sets its own period when it begins to feed.
fn start_watchdog() {
    IWDG1.kr().write(|w| w.set_key(Key::START));
    IWDG1.kr().write(|w| w.set_key(Key::ENABLE));
    IWDG1.pr().write(|w| w.set_pr(Pr::DIVIDE_BY32));
}

/// Whether vectors stand at the beginning of the running image.
fn has_vectors(flash: &mut flash::Flash) -> bool {
    let Some([a, b, c, d, e, f, g, h, ..]) = flash.word(H743ZI.running) else {
        return false;
    };
    let (stack, reset) = (
        u32::from_le_bytes([a, b, c, d]),
        u32::from_le_bytes([e, f, g, h]),
    );
    stack == STACK
        && reset & 1 == 1
        && (H743ZI.running..H743ZI.running + H743ZI.image_bytes).contains(&reset)
}

#[cortex_m_rt::entry]
fn main() -> ! {
    let mut flash = flash::Flash;
    let start = prepare(&mut flash, &H743ZI);
    if start == Start::Nothing || !has_vectors(&mut flash) {
        // The power stage stays off. A watchdog of the option bytes starts this anew, or the supply.
        loop {
            cortex_m::asm::nop();
        }
    }
    if start == Start::Trial {
        start_watchdog();
    }
    let vectors = H743ZI.running as *const u32;
    // SAFETY: vectors stand there, no interrupt is enabled, and nothing of this stage runs any more.
    unsafe {
        (*SCB::PTR).vtor.write(H743ZI.running);
        cortex_m::asm::dsb();
        cortex_m::asm::isb();
        cortex_m::asm::bootload(vectors)
    }
}

#[panic_handler]
fn panic(_: &PanicInfo) -> ! {
    SCB::sys_reset()
}
