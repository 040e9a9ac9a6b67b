//! Whether the host that drives the amplifier is still there.
//!
//! # How it works
//! The tasks that take lines from a host note the tick of the last one ([`HostWatch::hear`]), whatever the
//! line was and on whatever channel; the control interrupt asks at every tick whether that was too long ago
//! ([`HostWatch::missed`]). While the drive is live that is a fault. At rest the power stage is switched off:
//! nobody leaves a bench with high voltage on. Behind a start the time is [`USUAL_TIMEOUT_S`]; a host that
//! closes a loop and leaves chooses none ([`HostWatch::set_timeout`]).

use core::sync::atomic::{AtomicU32, Ordering};

use crate::amplifier::Mode;

/// The shortest time that can be chosen, ms: several periods of the tasks that take the lines.
pub const SHORTEST_TIMEOUT_MS: u32 = 10;
/// The time behind a start, s: longer than an operator thinks between two lines.
pub const USUAL_TIMEOUT_S: u32 = 600;
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
#[derive(Debug)]
pub struct HostWatch {
    heard_at: AtomicU32,
    timeout_ticks: AtomicU32,
}

impl HostWatch {
    /// The host may be silent for [`USUAL_TIMEOUT_S`].
    #[must_use]
    pub const fn new(sample_rate_hz: u32) -> Self {
        Self {
            heard_at: AtomicU32::new(0),
            timeout_ticks: AtomicU32::new(USUAL_TIMEOUT_S * sample_rate_hz),
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

    /// What is to be done at the tick `now`, where it has been silent for longer.
    #[inline(always)]
    #[must_use]
    pub fn missed(&self, now: u32, mode: Mode, powered: bool) -> Option<Missed> {
        let timeout = self.timeout_ticks.load(Ordering::Acquire);
        let silent = now.wrapping_sub(self.heard_at.load(Ordering::Relaxed)) > timeout;
        match mode {
            _ if timeout == 0 || !silent => None,
            Mode::Playing | Mode::Closed => Some(Missed::Stop),
            Mode::Rest if powered => Some(Missed::SwitchOff),
            Mode::Rest | Mode::Fault => None,
        }
    }
}

/// What a host that has been silent for too long leaves to do.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Missed {
    /// The drive is live, which is [`crate::guard::Fault::HostLost`].
    Stop,
    /// The drive rests, and the power stage is on: disarm.
    SwitchOff,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_silent_host_stops_what_is_live_and_switches_off_what_rests() {
        let watch = HostWatch::new(20_000);
        assert_eq!(watch.timeout(), 12_000_000);
        let (lost, off) = (Some(Missed::Stop), Some(Missed::SwitchOff));
        for start in [0, 1000, u32::MAX - 50] {
            let missed =
                |ticks: u32, mode, powered| watch.missed(start.wrapping_add(ticks), mode, powered);
            watch.set_timeout(start, 100);
            assert_eq!(missed(100, Mode::Closed, true), None);
            assert_eq!(missed(101, Mode::Closed, true), lost);
            assert_eq!(missed(101, Mode::Playing, true), lost);
            assert_eq!(missed(101, Mode::Rest, true), off);
            assert_eq!(missed(101, Mode::Rest, false), None);
            assert_eq!(missed(101, Mode::Fault, true), None);
            watch.hear(start.wrapping_add(90));
            assert_eq!(missed(190, Mode::Closed, true), None);
            assert_eq!(missed(191, Mode::Closed, true), lost);
        }
        watch.set_timeout(0, 0);
        assert_eq!(watch.missed(1 << 31, Mode::Closed, true), None);
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
