//! Points of a reference or of a drive that somebody wrote into memory, played tick by tick.
//!
//! # How it works
//! The memory is a row of atomics that outlives everything ([`WaveTable`]), so that a task may write the
//! points and the control interrupt read them without a lock: a point is whole at any time, and whoever
//! writes points while they are played sees them played. Each point lasts a number of ticks; between two of
//! them the reference goes in a straight line or stays. What comes after the last point is the first one, as
//! often as the table is cycled. Then the last value stays, whatever is written into the memory: a table that
//! has ended is not read again. A table is one of positions or one of drives ([`Quantity`]), and the compiler
//! keeps them apart.

use core::marker::PhantomData;
use core::sync::atomic::{AtomicI32, Ordering};

use crate::signal::Quantity;

/// Fraction bits of a point, um in a table of positions and V in one of drives: as many as a drive has, which
/// reaches further.
pub const POINT_FRACTION_BITS: u32 = 22;

/// A table of `Q` as it is played.
#[derive(Clone, Copy, Debug)]
pub struct WaveTable<Q> {
    points: &'static [AtomicI32],
    of: PhantomData<Q>,
    ticks_per_point: u32,
    /// `2^30 / ticks_per_point` where points are joined by lines; 0 where they stay.
    slope: u32,
    cycles: u32,
    /// The point, from 1, that is marked while it is played; 0: none.
    marked: u32,
}

impl<Q: Quantity> WaveTable<Q> {
    /// From the bits of a point to those of the quantity.
    const SHIFT: u32 = Q::FRACTION_BITS - POINT_FRACTION_BITS;

    /// These points, each with [`POINT_FRACTION_BITS`], for so many ticks (at least 1), joined by lines or
    /// not, so many times (0: for ever). Every point must lie within the format of `Q`, or it is cut to it.
    #[must_use]
    pub fn new(
        points: &'static [AtomicI32],
        ticks_per_point: u32,
        joined: bool,
        cycles: u32,
    ) -> Self {
        let ticks_per_point = ticks_per_point.max(1);
        let slope = if joined && ticks_per_point > 1 {
            (1 << 30) / ticks_per_point
        } else {
            0
        };
        Self {
            points,
            of: PhantomData,
            ticks_per_point,
            slope,
            cycles,
            marked: 0,
        }
    }

    /// Itself with a point that is marked while it is played, from 1; 0 for none.
    #[must_use]
    pub fn marking(self, point: u32) -> Self {
        Self {
            marked: point,
            ..self
        }
    }

    /// Ticks after which it repeats; `None` where it is played once, is empty, or is too long to count.
    #[must_use]
    pub fn period_ticks(&self) -> Option<u32> {
        let points = u32::try_from(self.points.len())
            .ok()
            .filter(|points| *points > 0 && self.cycles != 1)?;
        points.checked_mul(self.ticks_per_point)
    }

    fn point(&self, nth: usize) -> i32 {
        let point = self
            .points
            .get(nth)
            .map_or(0, |point| point.load(Ordering::Relaxed));
        point
            .max(i32::MIN >> Self::SHIFT)
            .min(i32::MAX >> Self::SHIFT)
            << Self::SHIFT
    }
}

impl<Q> PartialEq for WaveTable<Q> {
    fn eq(&self, other: &Self) -> bool {
        core::ptr::eq(self.points, other.points)
            && (self.ticks_per_point, self.slope, self.cycles, self.marked)
                == (
                    other.ticks_per_point,
                    other.slope,
                    other.cycles,
                    other.marked,
                )
    }
}

impl<Q> Eq for WaveTable<Q> {}

/// Where a table is being played.
#[derive(Clone, Debug, Default)]
pub struct TablePlayer {
    point: usize,
    ticks: u32,
    cycles: u32,
    ended: bool,
    /// What was played last: once the table has ended, what stays.
    last: i32,
    /// Whether what was played belonged to the marked point: the last tick in the lowest bit, the tick before
    /// it in the next.
    marks: u32,
}

impl TablePlayer {
    /// What is played at the next tick, in the format of the quantity; 0 of a table without points.
    pub fn next_point<Q: Quantity>(&mut self, table: &WaveTable<Q>) -> i32 {
        self.marks <<= 1;
        if self.ended {
            return self.last;
        }
        let here = table.point(self.point);
        self.marks |= u32::from(self.point as u32 + 1 == table.marked);
        let last = self.point + 1 >= table.points.len();
        let mut value = here;
        if table.slope != 0 {
            let last_of_all = last && table.cycles != 0 && self.cycles + 1 >= table.cycles;
            let next = if last_of_all {
                here
            } else {
                table.point(if last { 0 } else { self.point + 1 })
            };
            let change = i64::from(next) - i64::from(here);
            // A difference of 33 bits times less than 2^30; the sum lies between the two points, whatever the
            // part does.
            value =
                here.wrapping_add(((change * i64::from(self.ticks * table.slope)) >> 30) as i32);
        }
        self.ticks += 1;
        if self.ticks >= table.ticks_per_point {
            self.ticks = 0;
            self.end_of_point(last, table.cycles);
        }
        self.last = value;
        value
    }

    /// Whether what was played so many ticks (0 to 31) before the last one belonged to the marked point.
    #[inline]
    #[must_use]
    pub fn marked(&self, ticks_ago: usize) -> bool {
        self.marks >> (ticks_ago & 31) & 1 != 0
    }

    /// Nothing is played any more.
    #[inline]
    pub fn forget_marks(&mut self) {
        self.marks = 0;
    }

    fn end_of_point(&mut self, last: bool, cycles: u32) {
        if !last {
            self.point += 1;
            return;
        }
        self.cycles = self.cycles.saturating_add(1);
        if cycles != 0 && self.cycles >= cycles {
            self.ended = true;
        } else {
            self.point = 0;
        }
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;
    use crate::signal::{Micrometres, Volts};
    use proptest::prelude::*;
    use std::boxed::Box;
    use std::vec::Vec;

    fn memory(points: &[i32]) -> &'static [AtomicI32] {
        Box::leak(
            points
                .iter()
                .map(|point| AtomicI32::new(*point))
                .collect::<Vec<_>>()
                .into_boxed_slice(),
        )
    }

    fn play<Q: Quantity>(table: WaveTable<Q>, ticks: usize) -> Vec<i32> {
        let mut player = TablePlayer::default();
        (0..ticks).map(|_| player.next_point(&table)).collect()
    }

    #[test]
    fn points_are_played_joined_or_not_so_many_times_and_the_last_one_stays() {
        let points = memory(&[0, 100, -100]);
        assert_eq!(
            play(WaveTable::<Volts>::new(points, 1, true, 2), 8),
            [0, 100, -100, 0, 100, -100, -100, -100]
        );
        assert_eq!(
            play(WaveTable::<Volts>::new(points, 2, false, 1), 8),
            [0, 0, 100, 100, -100, -100, -100, -100]
        );
        assert_eq!(
            play(WaveTable::<Volts>::new(points, 1, false, 0), 301)[300],
            0,
            "for ever"
        );
        // Straight lines; the shares 1/4, 1/2 and 3/4 are a little short of themselves.
        let joined = play(WaveTable::<Volts>::new(points, 4, true, 0), 13);
        let exact = [
            0.0, 25.0, 50.0, 75.0, 100.0, 50.0, 0.0, -50.0, -100.0, -75.0, -50.0, -25.0, 0.0,
        ];
        for (value, exact) in joined.iter().zip(exact) {
            assert!((f64::from(*value) - exact).abs() <= 1.0, "{joined:?}");
        }
        assert_eq!(
            play(WaveTable::<Volts>::new(points, 4, true, 1), 20)[8..],
            [-100; 12],
            "the end joins nothing"
        );
    }

    #[test]
    fn a_table_that_is_cycled_has_a_period() {
        let table = |points: &[i32], ticks, cycles| {
            WaveTable::<Volts>::new(memory(points), ticks, true, cycles).period_ticks()
        };
        assert_eq!(
            (table(&[1, 2], 100, 0), table(&[1, 2, 3], 7, 5)),
            (Some(200), Some(21))
        );
        assert_eq!(
            (
                table(&[1, 2], 100, 1),
                table(&[], 100, 0),
                table(&[1, 2], u32::MAX, 0)
            ),
            (None, None, None)
        );
    }

    #[test]
    fn a_position_has_two_bits_more_than_a_drive_and_never_wraps() {
        let points = memory(&[3 << 22, -5, i32::MAX, i32::MIN]);
        assert_eq!(
            play(WaveTable::<Volts>::new(points, 1, false, 1), 4),
            [3 << 22, -5, i32::MAX, i32::MIN]
        );
        assert_eq!(
            play(WaveTable::<Micrometres>::new(points, 1, false, 1), 4),
            [3 << 24, -20, i32::MAX - 3, i32::MIN]
        );
    }

    #[test]
    fn a_point_is_marked_for_as_long_as_it_lasts_in_every_cycle_and_not_behind_the_last() {
        let marks = |point, cycles| -> Vec<u8> {
            let (table, mut player) = (
                WaveTable::<Volts>::new(memory(&[5, 6, 7]), 2, false, cycles).marking(point),
                TablePlayer::default(),
            );
            (0..16)
                .map(|_| (player.next_point(&table), u8::from(player.marked(0))).1)
                .collect()
        };
        assert_eq!(
            marks(2, 2),
            [0, 0, 1, 1, 0, 0, 0, 0, 1, 1, 0, 0, 0, 0, 0, 0]
        );
        assert_eq!(
            marks(3, 1),
            [0, 0, 0, 0, 1, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0]
        );
        assert_eq!(
            (marks(0, 0), marks(4, 0)),
            ([0; 16].to_vec(), [0; 16].to_vec())
        );
    }

    #[test]
    fn a_finished_table_is_not_read_again() {
        for joined in [false, true] {
            let points = memory(&[5, 6, 7]);
            let (table, mut player) = (
                WaveTable::<Volts>::new(points, 2, joined, 2),
                TablePlayer::default(),
            );
            let last = (0..20).map(|_| player.next_point(&table)).last();
            points
                .iter()
                .for_each(|point| point.store(60 << POINT_FRACTION_BITS, Ordering::Relaxed));
            assert_eq!(
                (last, player.next_point(&table)),
                (Some(7), 7),
                "joined: {joined}"
            );
        }
    }

    #[test]
    fn a_table_without_points_is_zero() {
        assert_eq!(play(WaveTable::<Volts>::new(&[], 3, true, 0), 5), [0; 5]);
    }

    proptest! {
        #[test]
        fn a_line_never_leaves_its_two_points(a in any::<i32>(), b in any::<i32>(), ticks in 1u32..5000, joined: bool) {
            let values = play(WaveTable::<Volts>::new(memory(&[a, b]), ticks, joined, 0), 2 * ticks as usize);
            prop_assert!(values.iter().all(|value| (a.min(b)..=a.max(b)).contains(value)));
        }
    }
}
