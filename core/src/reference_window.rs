//! The reference around the present sample, and what the laws need of it.
//!
//! References reach the tick [`PREVIEW_TICKS`] samples before they count, which every generator and every stream from the host can do.
//! The window then holds the past and the future of the instant that is being computed, so that velocity, acceleration and the
//! feedforward through the inverse of the linear dynamics are symmetric sums over the window: without phase lag, and without any
//! derivative having to be sent. Their coefficients are designed on the host by least squares over the band of the reference.
//!
//! Every sample is stored twice, [`WINDOW`] places apart: then the window is always one piece of the memory, and nothing is shifted.
//!
//! A jump between the reference and the position at which the servo is enabled is kept as an offset that decays over about
//! 2^[`OFFSET_DECAY_SHIFT`] samples.

use crate::integer_row::Row;

/// Samples in the window.
pub const WINDOW: usize = 16;
/// How many samples ahead of the present one the newest element is.
pub const PREVIEW_TICKS: usize = 8;
/// The offset loses this binary fraction of itself at every sample.
pub const OFFSET_DECAY_SHIFT: u32 = 8;

/// Coefficients over the window, oldest first: element `i` is the reference `i + 1 - (WINDOW - PREVIEW_TICKS)` samples after now.
pub type WindowRow<const Q: u32> = Row<WINDOW, Q>;

/// The reference from 7 samples ago to 8 samples ahead, um.
#[derive(Clone, Debug)]
pub struct ReferenceWindow {
    positions: [i32; 2 * WINDOW],
    /// Where the oldest sample stands.
    oldest: usize,
    offset: i32,
    fresh: bool,
}

impl ReferenceWindow {
    /// A window at rest at `position`; the offset to the reference is taken at the first sample that is pushed.
    #[must_use]
    pub fn at_rest(position: i32) -> Self {
        Self { positions: [position; 2 * WINDOW], oldest: 0, offset: 0, fresh: true }
    }

    /// Takes the reference that counts [`PREVIEW_TICKS`] samples from now.
    #[inline]
    pub fn push(&mut self, ahead: i32) {
        if self.fresh {
            self.fresh = false;
            self.offset = self.positions()[WINDOW - 1].saturating_sub(ahead);
        }
        let sample = ahead.saturating_add(self.offset);
        let oldest = self.oldest % WINDOW;
        self.positions[oldest] = sample;
        self.positions[oldest + WINDOW] = sample;
        self.oldest = (oldest + 1) % WINDOW;
        // Towards zero, ending there.
        self.offset -= (self.offset >> OFFSET_DECAY_SHIFT) + i32::from(self.offset > 0);
    }

    /// The reference now.
    #[inline]
    #[must_use]
    pub fn now(&self) -> i32 {
        self.positions()[WINDOW - 1 - PREVIEW_TICKS]
    }

    /// All of it, oldest first.
    #[inline]
    #[must_use]
    pub fn positions(&self) -> &[i32; WINDOW] {
        const NONE: &[i32; WINDOW] = &[0; WINDOW];
        let oldest = self.oldest % WINDOW;
        self.positions.get(oldest..oldest + WINDOW).and_then(|window| window.first_chunk()).unwrap_or(NONE)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_window_is_the_last_samples_in_their_order() {
        let mut window = ReferenceWindow::at_rest(0);
        window.push(0);
        for k in 1..100 {
            window.push(k);
            assert_eq!(window.positions()[WINDOW - 1], k);
            assert_eq!(window.now(), (k - PREVIEW_TICKS as i32).max(0));
            assert!(window.positions().windows(2).all(|pair| pair[1] == pair[0] + 1 || pair == [0, 0]));
        }
    }
}
