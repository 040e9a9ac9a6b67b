//! Whether the drive of the closed loop swings by itself.
//!
//! # How it works
//! A loop that is not stable any more grows until a limit of the drive bounds it, and swings from then on. Its
//! tracking error may stay below any limit: above the resonance the stage hardly moves. What is seen is the
//! drive: it turns again and again after an eighth of its range or more ([`AMPLITUDE_SHIFT`]), and the
//! reference does not. Turns of the reference explain those of the drive, so the count begins anew with each
//! ([`REFERENCE_SHIFT`]). [`MOST_TURNS`] in a row, none later behind the one before than
//! [`GAP_SHIFT`] of the guard's `tracking_ticks`, are a fault: three cycles, 20 ms at 150 Hz. What rings and is
//! damped is not: a way of less than half of the widest one begins the count anew.

use crate::codes::DriveCode;
use crate::guard::Fault;
use crate::parameter_block::AmplifierParameters;

/// Turns of the drive that are a fault. With a damping ratio above 0.06 what rings has fallen by half after
/// four.
pub const MOST_TURNS: u8 = 6;
/// A turn of the drive counts from this share of its range on, 2^-n: 10 V of 80, above what noise and
/// switching laws make.
const AMPLITUDE_SHIFT: u32 = 3;
/// A turn of the reference counts from this share of the largest tracking error on, 2^-n: some 10 nm. It has
/// no noise.
const REFERENCE_SHIFT: u32 = 6;
/// Turns belong together within 2^n of the guard's `tracking_ticks`: 20 ms, so that a swing of 25 Hz is one.
const GAP_SHIFT: u32 = 2;

/// Finds the turns of a signal that come after a certain way.
#[derive(Clone, Copy, Debug)]
struct Turns {
    /// Furthest value in the present direction.
    furthest: i32,
    /// Where the present direction began.
    turned_at: i32,
    rises: bool,
    least: i32,
}

impl Turns {
    /// None yet, from this value on.
    fn beginning_at(value: i32, least: i32) -> Self {
        Self {
            furthest: value,
            turned_at: value,
            rises: true,
            least,
        }
    }

    /// How far the signal has come since it turned, where it turns out to have done so.
    #[inline]
    fn take(&mut self, value: i32) -> Option<u32> {
        let onwards = if self.rises {
            value >= self.furthest
        } else {
            value <= self.furthest
        };
        if onwards {
            self.furthest = value;
            return None;
        }
        let way = value.abs_diff(self.furthest);
        if way < self.least as u32 {
            return None;
        }
        let whole = self.furthest.abs_diff(self.turned_at);
        (self.turned_at, self.furthest) = (self.furthest, value);
        self.rises = !self.rises;
        Some(whole)
    }
}

/// The watch with its memory.
#[derive(Clone, Debug)]
pub struct SwingWatch {
    drive: Turns,
    reference: Turns,
    turns: u8,
    /// The widest way between two of them.
    widest: u32,
    /// Ticks since the last turn of the drive.
    since: u32,
    gap: u32,
}

impl SwingWatch {
    /// For an amplifier with these parameters.
    #[must_use]
    pub fn new(parameters: &AmplifierParameters) -> Self {
        let mut this = Self {
            drive: Turns::beginning_at(0, 0),
            reference: Turns::beginning_at(0, 0),
            turns: 0,
            widest: 0,
            since: 0,
            gap: 0,
        };
        this.watch_with(parameters);
        this
    }

    /// Watches with the limits of another block from now on.
    pub fn watch_with(&mut self, parameters: &AmplifierParameters) {
        let (c, guard) = (&parameters.servo.converters, &parameters.guard);
        let range = c.dac_code_max.abs_diff(c.dac_code_min);
        self.drive.least = (range >> AMPLITUDE_SHIFT).max(1) as i32;
        self.reference.least = (guard.tracking_error >> REFERENCE_SHIFT).max(1);
        self.gap = u32::from(guard.tracking_ticks) << GAP_SHIFT;
    }

    /// The loop is closed at this drive; nothing is left of what was seen of another one.
    pub fn begin(&mut self, code: DriveCode) {
        self.drive = Turns::beginning_at(code.steps() as i32, self.drive.least);
        self.reference = Turns::beginning_at(0, self.reference.least);
        (self.turns, self.widest, self.since) = (0, 0, 0);
    }

    /// Looks at what leaves in this tick and at the reference, um with 24 fraction bits.
    #[inline]
    pub fn inspect(&mut self, code: DriveCode, reference: i32) -> Option<Fault> {
        self.since = self.since.saturating_add(1);
        if self.reference.take(reference).is_some() || self.since > self.gap {
            self.turns = 0;
        }
        if let Some(way) = self.drive.take(code.steps() as i32) {
            if self.turns == 0 || way < self.widest / 2 {
                (self.turns, self.widest) = (0, 0);
            }
            self.widest = self.widest.max(way);
            self.since = 0;
            self.turns += 1;
        }
        (self.turns >= MOST_TURNS).then_some(Fault::LoopSwings)
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;
    use crate::parameter_block::tests::example;
    use proptest::prelude::*;

    /// The tick at which a drive (share of the range around its middle) and a reference (um) are a fault.
    fn first_fault(drive: impl Fn(f64) -> f64, reference: impl Fn(f64) -> f64) -> Option<u32> {
        let mut parameters = example();
        parameters.guard.tracking_ticks = 100;
        let c = parameters.servo.converters;
        let range = f64::from(c.dac_code_max) - f64::from(c.dac_code_min);
        let mut watch = SwingWatch::new(&parameters);
        watch.begin(c.dac_code_min);
        (0..20_000).find(|tick| {
            let seconds = f64::from(*tick) / 20_000.0;
            let code = f64::from(c.dac_code_min) + range * (0.5 + drive(seconds));
            let um = (reference(seconds) * 2f64.powi(24)) as i32;
            watch.inspect(DriveCode::new(code as u32), um).is_some()
        })
    }

    fn sine(hz: f64, seconds: f64) -> f64 {
        (std::f64::consts::TAU * hz * seconds).sin()
    }

    proptest! {
        /// From 200 Hz on within 20 ms, from 26 Hz on within four cycles.
        #[test]
        fn a_drive_that_swings_by_itself_is_a_fault(hz in 26.0f64..4_000.0, share in 0.08f64..0.5) {
            let first = first_fault(|s| share * sine(hz, s), |_| 5.0);
            prop_assert!(first.is_some_and(|first| f64::from(first) / 20_000.0 <= (4.0 / hz).max(0.02)), "{first:?}");
        }

        /// Not even at a hundred times the distance that a turn of the reference must have.
        #[test]
        fn a_drive_that_swings_with_its_reference_is_none(hz in 1.0f64..2_000.0, um in 0.08f64..5.0) {
            let follows = first_fault(|s| 0.5 * sine(hz, s), |s| um * sine(hz, s));
            prop_assert_eq!(follows, None);
        }
    }

    const TRACKING_TICKS: u16 = 100;

    /// The first fault of a drive that stands for so many ticks at each of these codes above its least one,
    /// beside a reference that steps to and fro by `reference` every four ticks.
    fn stands(above: &[u32], ticks: u32, reference: i32) -> Option<u32> {
        let mut parameters = example();
        parameters.guard.tracking_ticks = TRACKING_TICKS;
        let least = parameters.servo.converters.dac_code_min;
        let mut watch = SwingWatch::new(&parameters);
        watch.begin(least);
        (0..ticks * above.len() as u32).find(|tick| {
            let um = if tick / 4 % 2 == 0 { 0 } else { reference };
            let code = least + above[(tick / ticks) as usize];
            watch.inspect(code, um).is_some()
        })
    }

    /// At each limit and one step beside it.
    #[test]
    fn a_turn_counts_from_its_way_its_gap_and_its_neighbours_on() {
        let c = example().servo.converters;
        let least = c.dac_code_max.abs_diff(c.dac_code_min) / 8;
        let gap = u32::from(TRACKING_TICKS) * 4;
        let to_and_fro = |way: u32| [0, way, 0, way, 0, way, 0, way];
        // Before the first way up the drive has no way to turn from, so the sixth turn is the seventh way.
        assert_eq!(stands(&to_and_fro(least), gap, 0), Some(7 * gap));
        assert_eq!(stands(&to_and_fro(least - 1), gap, 0), None);
        assert_eq!(stands(&to_and_fro(least), gap + 1, 0), None);
        // A way of half the widest goes on with the count, a shorter one begins it anew.
        let after_a_wide_one = |way: u32| {
            let wide = 4 * least;
            [
                0,
                wide,
                wide - way,
                wide,
                wide - way,
                wide,
                wide - way,
                wide,
            ]
        };
        assert_eq!(stands(&after_a_wide_one(2 * least), 9, 0), Some(63));
        assert_eq!(stands(&after_a_wide_one(2 * least - 1), 9, 0), None);
        // A reference that turns explains turns of the drive.
        let turns = example().guard.tracking_error / 64;
        assert_eq!(stands(&to_and_fro(least), 9, turns), None);
        assert_eq!(stands(&to_and_fro(least), 9, turns - 1), Some(63));
    }

    #[test]
    fn a_loop_that_is_closed_anew_begins_to_count_anew() {
        let parameters = example();
        let c = parameters.servo.converters;
        let mut watch = SwingWatch::new(&parameters);
        let mut turns = 0;
        for round in 0..10 {
            watch.begin(c.dac_code_min);
            for code in [
                c.dac_code_max,
                c.dac_code_min,
                c.dac_code_max,
                c.dac_code_min,
            ] {
                turns += u32::from(watch.inspect(code, 0).is_some());
            }
            assert_eq!(turns, 0, "round {round}");
        }
    }

    #[test]
    fn what_is_small_slow_or_damped_is_none() {
        assert_eq!(first_fault(|s| 0.06 * sine(300.0, s), |_| 5.0), None);
        assert_eq!(first_fault(|s| 0.5 * sine(20.0, s), |_| 5.0), None);
        let rings = |s: f64| 0.5 * (-s * 300.0).exp() * sine(800.0, s);
        assert_eq!(first_fault(rings, |_| 5.0), None);
    }
}
