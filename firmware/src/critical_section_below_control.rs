//! Critical sections that mask every interrupt but the control interrupt.
//!
//! The usual implementation disables all interrupts, and a log message would then delay the control tick.
//! Here BASEPRI masks priorities 1 and below; the control interrupt has priority 0 and shares nothing with
//! the rest but atomics and single-producer single-consumer queues, so it needs no critical section and must
//! never take one.

use critical_section::RawRestoreState;

/// BASEPRI value of the highest priority that a critical section masks (4 priority bits, priority 1).
const MASKED_FROM: u8 = 1 << 4;

struct BelowControl;
critical_section::set_impl!(BelowControl);

// SAFETY: all code that shares data through critical sections runs at priority 1 or below, on the only core.
unsafe impl critical_section::Impl for BelowControl {
    unsafe fn acquire() -> RawRestoreState {
        let before = cortex_m::register::basepri::read();
        // SAFETY: raising the mask is always allowed; `release` restores it. `basepri_max` only ever raises.
        cortex_m::register::basepri_max::write(MASKED_FROM);
        core::sync::atomic::compiler_fence(core::sync::atomic::Ordering::SeqCst);
        before
    }

    unsafe fn release(before: RawRestoreState) {
        core::sync::atomic::compiler_fence(core::sync::atomic::Ordering::SeqCst);
        // SAFETY: restores what `acquire` found.
        unsafe { cortex_m::register::basepri::write(before) };
    }
}
