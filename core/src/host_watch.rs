//! Whether the host that drives the amplifier is still there.
//!
//! # How it works
//! The tasks that take lines from a host note the tick of the last one ([`HostWatch::hear`]), whatever the
//! line was and on whatever channel; the control interrupt asks at every tick whether that was too long ago
//! ([`HostWatch::is_lost`]). It counts only while the drive is live: nobody is missed at rest. No time is too
//! long until somebody chooses one ([`HostWatch::set_timeout`]), because a program that closes a loop and
//! leaves is a usual thing too.

use core::sync::atomic::{AtomicU32, Ordering};

use crate::amplifier::Mode;

/// The shortest time that can be chosen, ms: several periods of the tasks that take the lines.
pub const SHORTEST_TIMEOUT_MS: u32 = 10;
/// The longest, ms: an hour.
pub const LONGEST_TIMEOUT_MS: u32 = 3_600_000;

/// So many milliseconds in ticks, 0 for none; `None` where they are less than [`SHORTEST_TIMEOUT_MS`] or more
/// than [`LONGEST_TIMEOUT_MS`].
#[must_use]
pub fn timeout_ticks(milliseconds: u32, sample_rate_hz: u32) -> Option<u32> {
    let chosen =
        milliseconds == 0 || (SHORTEST_TIMEOUT_MS..=LONGEST_TIMEOUT_MS).contains(&milliseconds);
    let ticks = u64::from(milliseconds) * u64::from(sample_rate_hz) / 1000;
    u32::try_from(ticks).ok().filter(|_| chosen)
}

/// When the host was last heard, and for how long it may be silent.
#[derive(Debug, Default)]
pub struct HostWatch {
    heard_at: AtomicU32,
    timeout_ticks: AtomicU32,
}

impl HostWatch {
    /// The host may be silent for ever.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            heard_at: AtomicU32::new(0),
            timeout_ticks: AtomicU32::new(0),
        }
    }

    /// The host is there at the tick `now`.
    pub fn hear(&self, now: u32) {
        self.heard_at.store(now, Ordering::Relaxed);
    }

    /// From the tick `now` on it may be silent for so many ticks; 0: for ever.
    pub fn set_timeout(&self, now: u32, ticks: u32) {
        self.hear(now);
        self.timeout_ticks.store(ticks, Ordering::Release);
    }

    /// For how many ticks it may be silent; 0: for ever.
    #[must_use]
    pub fn timeout(&self) -> u32 {
        self.timeout_ticks.load(Ordering::Relaxed)
    }

    /// Whether it has been silent for longer at the tick `now`, the drive being live.
    #[inline(always)]
    #[must_use]
    pub fn is_lost(&self, now: u32, mode: Mode) -> bool {
        let timeout = self.timeout_ticks.load(Ordering::Acquire);
        timeout != 0
            && now.wrapping_sub(self.heard_at.load(Ordering::Relaxed)) > timeout
            && matches!(mode, Mode::Playing | Mode::Closed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_silent_host_is_lost_after_its_time_and_only_while_the_drive_is_live() {
        let watch = HostWatch::new();
        assert!(
            !watch.is_lost(u32::MAX, Mode::Closed),
            "nobody asked for it"
        );
        for start in [0, 1000, u32::MAX - 50] {
            let after = |ticks: u32| start.wrapping_add(ticks);
            watch.set_timeout(start, 100);
            assert!(!watch.is_lost(after(100), Mode::Closed));
            assert!(
                watch.is_lost(after(101), Mode::Closed) && watch.is_lost(after(101), Mode::Playing)
            );
            assert!(
                !watch.is_lost(after(101), Mode::Rest) && !watch.is_lost(after(101), Mode::Fault)
            );
            watch.hear(after(90));
            assert!(
                !watch.is_lost(after(190), Mode::Closed) && watch.is_lost(after(191), Mode::Closed)
            );
        }
        watch.set_timeout(0, 0);
        assert!(!watch.is_lost(1 << 31, Mode::Closed));
    }

    #[test]
    fn a_time_is_ten_milliseconds_to_an_hour_or_none() {
        assert_eq!(
            [0, 10, 250, 3_600_000].map(|ms| timeout_ticks(ms, 20_000)),
            [Some(0), Some(200), Some(5000), Some(72_000_000)]
        );
        assert_eq!(
            [1, 9, 3_600_001, u32::MAX].map(|ms| timeout_ticks(ms, 20_000)),
            [None; 4]
        );
    }
}
