//! The instants at which tasks wake: every 1.024 ms, 512 us away from the wraps of the time driver's counter.
//!
//! The driver counts 2^15 us at a time. An alarm that falls into the microseconds in which its interrupt
//! notes a wrap is lost on the emulated part (the match between the handler's read and its write of the
//! status is forgotten there), all tasks then sleep for 65 ms, and the watchdog bites. With these instants no
//! alarm ever does.

use embassy_time::{Instant, Timer};

/// From one instant to the next, us: a divisor of 2^15.
const PERIOD_US: u64 = 1024;

/// Waits for the next instant.
pub async fn next() {
    periods(1).await;
}

/// Waits for so many instants.
pub async fn periods(count: u64) {
    let passed = (Instant::now().as_micros() + PERIOD_US / 2) / PERIOD_US;
    Timer::at(Instant::from_micros(
        (passed + count - 1) * PERIOD_US + PERIOD_US / 2,
    ))
    .await;
}
