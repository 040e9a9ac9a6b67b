//! The reference around the present sample, and what the laws need of it.
//!
//! References reach the tick [`PREVIEW_TICKS`] samples before they count, which every generator and every
//! stream from the host can do. The window then holds the past and the future of the instant that is being
//! computed, so that velocity, acceleration and the feedforward through the inverse of the linear dynamics
//! are symmetric sums over the window: without phase lag, and without any derivative having to be sent. Their
//! coefficients are designed on the host by least squares over the band of the reference.
//!
//! Every sample is stored twice, [`WINDOW`] places apart: then the window is always one piece of the memory,
//! and nothing is shifted.
//!
//! A jump between the reference and the position at which the servo is enabled is kept as an offset that
//! decays over about 2^[`OFFSET_DECAY_SHIFT`] samples.
//!
//! What stands in the window is the reference as the sensor will read it ([`crate::sensor_lag`]): readings
//! are compared with it.

use crate::integer_row::Row;
use crate::sensor_lag::SensorLag;

/// Samples in the window.
pub const WINDOW: usize = 16;
/// How many samples ahead of the present one the newest element is.
pub const PREVIEW_TICKS: usize = 8;
/// The offset loses this binary fraction of itself at every sample.
pub const OFFSET_DECAY_SHIFT: u32 = 8;

/// Coefficients over the window, oldest first: element `i` is the reference `i + 1 - (WINDOW -
/// PREVIEW_TICKS)` samples after now.
pub type WindowRow<const Q: u32> = Row<WINDOW, Q>;

/// The reference from 7 samples ago to 8 samples ahead, as the sensor will read it, um.
#[derive(Clone, Debug)]
pub struct ReferenceWindow {
    positions: [i32; 2 * WINDOW],
    /// Where the oldest sample stands.
    oldest: usize,
    /// The newest sample as the sensor will read it, and as it was asked for, without offset and correction.
    newest: [i32; 2],
    offset: i32,
}

impl ReferenceWindow {
    /// A window at rest at `position`.
    #[must_use]
    pub fn at_rest(position: i32) -> Self {
        Self {
            positions: [position; 2 * WINDOW],
            oldest: 0,
            newest: [position; 2],
            offset: 0,
        }
    }

    /// Begins again at rest at `position`, from where it goes to what is asked for as if that were constant
    /// until now.
    #[cold]
    #[inline(never)]
    pub fn restart(&mut self, position: i32, asked: i32) {
        *self = Self {
            newest: [asked; 2],
            offset: position.saturating_sub(asked),
            ..Self::at_rest(position)
        };
    }

    /// The newest reference that was asked for, um with 24 fraction bits.
    #[must_use]
    pub fn asked(&self) -> i32 {
        let [_, asked] = self.newest;
        asked
    }

    /// Takes the reference that is asked for [`PREVIEW_TICKS`] samples from now, through the sensor's lag,
    /// and what it is corrected by.
    #[inline]
    pub fn push(&mut self, lag: &SensorLag, asked: i32, correction: i32) {
        let lagged = lag.apply(asked, self.newest);
        self.newest = [lagged, asked];
        let sample = lagged
            .saturating_add(self.offset)
            .saturating_add(correction);
        let oldest = self.oldest % WINDOW;
        self.positions[oldest] = sample;
        self.positions[oldest + WINDOW] = sample;
        self.oldest = (oldest + 1) % WINDOW;
        // Towards zero, ending there.
        self.offset -= (self.offset >> OFFSET_DECAY_SHIFT) + i32::from(self.offset > 0);
    }

    /// Goes on with another lag of the sensor: what that would have made of a reference as fast as the last
    /// two samples, and what this differs by as an offset that decays, so that the reference does not jump.
    #[cold]
    #[inline(never)]
    pub fn change_lag(&mut self, lag: &SensorLag) {
        let [.., before, last] = *self.positions();
        let [lagged, asked] = self.newest;
        let as_read = asked.saturating_sub(lag.late_by(last.saturating_sub(before)));
        self.offset = self.offset.saturating_add(lagged.saturating_sub(as_read));
        self.newest = [as_read, asked];
    }

    /// The reference now.
    #[inline]
    #[must_use]
    pub fn now(&self) -> i32 {
        self.positions()[WINDOW - 1 - PREVIEW_TICKS]
    }

    /// The reference one sample from now, when a drive that is computed now begins to act.
    #[inline]
    #[must_use]
    pub fn next(&self) -> i32 {
        self.positions()[WINDOW - PREVIEW_TICKS]
    }

    /// All of it, oldest first.
    #[inline]
    #[must_use]
    pub fn positions(&self) -> &[i32; WINDOW] {
        const NONE: &[i32; WINDOW] = &[0; WINDOW];
        let oldest = self.oldest % WINDOW;
        self.positions
            .get(oldest..oldest + WINDOW)
            .and_then(|window| window.first_chunk())
            .unwrap_or(NONE)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_window_is_the_last_samples_in_their_order() {
        let (mut window, lag) = (ReferenceWindow::at_rest(0), SensorLag::NONE);
        window.push(&lag, 0, 0);
        for k in 1..100 {
            window.push(&lag, k, 0);
            assert_eq!(window.positions()[WINDOW - 1], k);
            assert_eq!(window.now(), (k - PREVIEW_TICKS as i32).max(0));
            assert!(
                window
                    .positions()
                    .windows(2)
                    .all(|pair| pair[1] == pair[0] + 1 || pair == [0, 0])
            );
        }
    }

    /// From one lag to another on a ramp: no sample jumps, and the end is as late as the other lag says.
    #[test]
    fn another_lag_takes_over_without_a_jump() {
        let [none, late] = [
            SensorLag::NONE,
            SensorLag {
                carried: -(1 << 29),
                before: 5 << 28,
            },
        ];
        for (from, to) in [(none, late), (late, none)] {
            let (mut window, speed) = (ReferenceWindow::at_rest(0), 100_000);
            for k in 0..10_000 {
                let last = window.positions()[WINDOW - 1];
                if k == 5000 {
                    window.change_lag(&to);
                }
                window.push(if k < 5000 { &from } else { &to }, k * speed, 0);
                let step = window.positions()[WINDOW - 1] - last;
                // What decays in a tick of the difference of the two lags, half a tick of the ramp.
                assert!(
                    k < 100 || (step - speed).abs() <= ((speed / 2) >> OFFSET_DECAY_SHIFT) + 8,
                    "{k}: {step}"
                );
            }
            assert!(
                (window.positions()[WINDOW - 1] - (9_999 * speed - to.late_by(speed))).abs() < 8
            );
        }
    }

    /// Asked for something else than where it stands, with a lag: it begins where it stands, and ends where a
    /// window that has always been asked for it is.
    #[test]
    fn a_jump_decays_and_no_lag_is_seen_of_it() {
        let lag = SensorLag {
            carried: -(1 << 29),
            before: 5 << 28,
        };
        let asked = |k: i32| (3 << 24) + 1000 * k;
        let mut window = ReferenceWindow::at_rest(77);
        window.restart(1 << 24, asked(0));
        window.push(&lag, asked(0), 0);
        assert_eq!(window.positions()[WINDOW - 1], 1 << 24);
        let mut always = ReferenceWindow::at_rest(asked(0));
        always.push(&lag, asked(0), 0);
        for k in 1..10_000 {
            window.push(&lag, asked(k), 5);
            always.push(&lag, asked(k), 5);
            let apart = always.positions()[WINDOW - 1] - window.positions()[WINDOW - 1];
            assert!((0..=2 << 24).contains(&apart), "{k}: {apart}");
            assert!(k < 9_000 || apart == 0, "{k}: {apart}");
        }
    }
}
