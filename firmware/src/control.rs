//! The control interrupt.

use core::sync::atomic::{AtomicU32, Ordering};

static TICKS: AtomicU32 = AtomicU32::new(0);

/// Control ticks since the start.
pub fn ticks() -> u32 {
    TICKS.load(Ordering::Relaxed)
}

/// Runs once a period, 1 us after the edge of the sample clock.
#[unsafe(no_mangle)]
#[unsafe(link_section = ".itcm.control")]
extern "C" fn TIM2() {
    const CC4IF: u32 = 1 << 4;
    embassy_stm32::pac::TIM2.sr().write(|w| w.0 = !CC4IF);
    TICKS.store(TICKS.load(Ordering::Relaxed).wrapping_add(1), Ordering::Relaxed);
}
