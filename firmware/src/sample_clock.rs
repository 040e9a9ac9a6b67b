//! The beat of the samples: TIM2. Its edges, not software, set the instants of sampling and of the drive.
//!
//! | channel | what it does |
//! |---|---|
//! | CH1 | high from the edge for 0.5 us: starts an external sensor converter |
//! | CH3 | low from the edge for 0.7 us: latches the interrupt's last drive code into an external converter |
//! | TRGO | the edge itself: triggers the chip's own converters, where they are the front end |
//! | CH4 | compare 1 or 2 us after the edge, when the conversion is done: raises the control interrupt |
//!
//! So a code computed from the sample of edge k acts at edge k+1, whatever the interrupt's latency.

use embassy_stm32::interrupt;
use embassy_stm32::interrupt::{InterruptExt, Priority};
use embassy_stm32::pac::TIM2;
use embassy_stm32::pac::timer::vals::Mms;

use crate::board::{Board, Platform, SAMPLE_RATE_HZ};

const CONVERSION_PULSE_NS: u32 = 500;
/// Longer than the sensor's converter converts (AD4000 family: 320 ns), so that LDAC does not rise meanwhile,
/// and shorter than the way to the first frame.
const LATCH_PULSE_NS: u32 = 700;
/// OCxM: the output is high, or low, from the edge to the compare. Parts name them differently.
const PWM_MODE_1: u8 = 6;
const PWM_MODE_2: u8 = 7;

/// Starts the beat, with the control interrupt so long after the edge.
pub fn start(timer_clock_hz: u32, interrupt_after_ns: u32) {
    Board::clock_sample_timer();
    let counts = |nanoseconds: u32| timer_clock_hz / 1_000_000 * nanoseconds / 1_000;
    TIM2.arr().write_value(timer_clock_hz / SAMPLE_RATE_HZ - 1);
    TIM2.ccr(0).write_value(counts(CONVERSION_PULSE_NS));
    TIM2.ccr(2).write_value(counts(LATCH_PULSE_NS));
    TIM2.ccr(3).write_value(counts(interrupt_after_ns));
    TIM2.ccmr_output(0)
        .modify(|w| w.set_ocm(0, PWM_MODE_1.into()));
    TIM2.ccmr_output(1)
        .modify(|w| w.set_ocm(0, PWM_MODE_2.into()));
    TIM2.ccer().modify(|w| {
        w.set_cce(0, true);
        w.set_cce(2, true);
    });
    TIM2.cr2().modify(|w| w.set_mms(Mms::UPDATE));
    TIM2.egr().write(|w| w.set_ug(true));
    TIM2.sr().write(|w| w.0 = 0);
    TIM2.dier().modify(|w| w.set_ccie(3, true));
    interrupt::TIM2.set_priority(Priority::P0);
    // SAFETY: the handler of `control` is ready and owns everything it touches.
    unsafe { interrupt::TIM2.enable() };
    TIM2.cr1().modify(|w| w.set_cen(true));
}
