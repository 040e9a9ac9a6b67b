//! Commands that wait for their tick, so that none of them holds up another.
//!
//! # How it works
//! A command that names no tick never comes here: it acts at once. One that names a tick waits in a place of
//! its own until that tick ([`CommandSchedule::due`]), the earliest first, those of the same tick in the
//! order in which they came. Whoever stops the amplifier forgets all of them
//! ([`CommandSchedule::forget_all`]): what was planned before a stop must not act after it.
//!
//! At a tick at which nothing is due, asking costs one comparison.

use core::cell::Cell;

use heapless::Vec;

use crate::amplifier_command::Command;

/// Commands that can wait.
pub const WAITING_COMMANDS: usize = 16;
/// The furthest tick ahead that a command may name: more is a slip of the hand, and would wait for hours.
pub const LONGEST_WAIT_TICKS: u32 = 1 << 27;

/// Why a command cannot wait.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CannotWait {
    /// [`WAITING_COMMANDS`] wait already.
    NoRoom,
    /// Its tick is further away than [`LONGEST_WAIT_TICKS`].
    TooFarAhead,
}

/// The commands that wait, each with a note of type `T` that comes back with it (who sent it).
#[derive(Clone, Debug)]
pub struct CommandSchedule<T> {
    commands: [Option<(Command, T)>; WAITING_COMMANDS],
    /// Places among `commands` that are free, as bits.
    free: u32,
    /// Ticks with the places of their commands, the latest first.
    order: Vec<(u32, u8), WAITING_COMMANDS>,
}

impl<T: Copy> Default for CommandSchedule<T> {
    fn default() -> Self {
        Self {
            commands: [None; WAITING_COMMANDS],
            free: ALL_FREE,
            order: Vec::new(),
        }
    }
}

const ALL_FREE: u32 = (1 << WAITING_COMMANDS) - 1;

/// Ticks from now until `at`, for a tick counter that begins again at its end; `None` once it has passed.
fn ticks_until(now: u32, at: u32) -> Option<u32> {
    let ahead = at.wrapping_sub(now);
    if ahead > LONGEST_WAIT_TICKS && at < now {
        None
    } else {
        Some(ahead)
    }
}

impl<T: Copy> CommandSchedule<T> {
    /// Lets a command wait for the tick `at`; at `now` itself or after it has passed it is due at once.
    ///
    /// # Errors
    /// [`CannotWait`]; nothing has changed then.
    pub fn add(&mut self, now: u32, at: u32, command: Command, from: T) -> Result<(), CannotWait> {
        let at = match ticks_until(now, at) {
            None => now,
            Some(ahead) if ahead <= LONGEST_WAIT_TICKS => at,
            Some(_) => return Err(CannotWait::TooFarAhead),
        };
        let place = self.free.trailing_zeros();
        let free = self
            .commands
            .get_mut(place as usize)
            .ok_or(CannotWait::NoRoom)?;
        self.order
            .push((at, place as u8))
            .map_err(|_| CannotWait::NoRoom)?;
        // It goes before those that are due earlier or came earlier. What has passed is the earliest.
        let since_long_ago =
            |(at, _): (u32, u8)| at.wrapping_sub(now).wrapping_add(LONGEST_WAIT_TICKS);
        for pair in Cell::from_mut(self.order.as_mut_slice())
            .as_slice_of_cells()
            .windows(2)
            .rev()
        {
            let [before, new] = pair else { break };
            if since_long_ago(before.get()) > since_long_ago(new.get()) {
                break;
            }
            before.swap(new);
        }
        *free = Some((command, from));
        self.free &= !(1 << place);
        Ok(())
    }

    /// The command whose tick has come, at most one at a time.
    #[inline]
    pub fn due(&mut self, now: u32) -> Option<(Command, T)> {
        match self.order.last() {
            Some((at, _)) if now.wrapping_sub(*at) <= LONGEST_WAIT_TICKS => self.take_earliest(),
            _ => None,
        }
    }

    #[inline(never)]
    fn take_earliest(&mut self) -> Option<(Command, T)> {
        let (_, place) = self.order.pop()?;
        self.free |= 1 << place;
        self.commands.get_mut(usize::from(place))?.take()
    }

    /// Forgets all of them, and says how many there were.
    pub fn forget_all(&mut self) -> u32 {
        let forgotten = self.order.len() as u32;
        self.order.clear();
        self.free = ALL_FREE;
        forgotten
    }

    /// How many wait.
    #[must_use]
    pub fn count(&self) -> u32 {
        self.order.len() as u32
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;
    use proptest::prelude::*;
    use std::vec::Vec;

    fn run(schedule: &mut CommandSchedule<u32>, from: u32, ticks: u32) -> Vec<(u32, u32)> {
        (0..ticks)
            .filter_map(|k| {
                let now = from.wrapping_add(k);
                schedule.due(now).map(|(_, note)| (now, note))
            })
            .collect()
    }

    #[test]
    fn a_far_tick_holds_nothing_up_and_a_tick_beyond_reach_is_refused() {
        let mut schedule = CommandSchedule::default();
        assert_eq!(
            schedule.add(5, 4_000_000_000, Command::Enable, 1),
            Err(CannotWait::TooFarAhead)
        );
        assert_eq!(schedule.add(5, 100_000_000, Command::Enable, 1), Ok(()));
        assert_eq!(schedule.add(5, 20, Command::Clear, 2), Ok(()));
        assert_eq!(run(&mut schedule, 6, 100), [(20, 2)]);
        assert_eq!(schedule.count(), 1);
    }

    #[test]
    fn a_tick_that_has_passed_means_now_and_the_order_is_kept() {
        let mut schedule = CommandSchedule::default();
        for (note, at) in [(1, 30), (2, 10), (3, 10), (4, 7), (5, 30)] {
            assert_eq!(schedule.add(10, at, Command::Enable, note), Ok(()));
        }
        assert_eq!(
            run(&mut schedule, 10, 40),
            [(10, 2), (11, 3), (12, 4), (30, 1), (31, 5)]
        );
    }

    #[test]
    fn the_counter_of_ticks_may_begin_again() {
        let mut schedule = CommandSchedule::default();
        let now = u32::MAX - 5;
        assert_eq!(schedule.add(now, 3, Command::Enable, 1), Ok(()));
        assert_eq!(schedule.add(now, u32::MAX, Command::Enable, 2), Ok(()));
        assert_eq!(run(&mut schedule, now, 20), [(u32::MAX, 2), (3, 1)]);
    }

    #[test]
    fn a_stop_forgets_what_waits_and_there_is_room_again() {
        let mut schedule = CommandSchedule::default();
        for note in 0..16 {
            assert_eq!(schedule.add(0, 50, Command::Enable, note), Ok(()));
        }
        assert_eq!(
            schedule.add(0, 50, Command::Enable, 16),
            Err(CannotWait::NoRoom)
        );
        assert_eq!(schedule.forget_all(), 16);
        assert_eq!(run(&mut schedule, 0, 100), []);
        assert_eq!(schedule.add(100, 150, Command::Enable, 17), Ok(()));
    }

    proptest! {
        /// Against the obvious: a list that is sorted.
        #[test]
        fn every_command_acts_once_at_its_tick_or_as_soon_after_as_there_is_room(
            start in any::<u32>(),
            ahead in proptest::collection::vec(0u32..40, 0..16),
        ) {
            let mut schedule = CommandSchedule::default();
            for (note, ahead) in (0..).zip(&ahead) {
                prop_assert_eq!(schedule.add(start, start.wrapping_add(*ahead), Command::Enable, note), Ok(()));
            }
            let mut sorted: Vec<(u32, u32)> = ahead.iter().copied().zip(0..).collect();
            sorted.sort_unstable();
            let mut free = 0;
            let expected: Vec<(u32, u32)> = sorted.into_iter().map(|(ahead, note)| {
                let at = ahead.max(free);
                free = at + 1;
                (start.wrapping_add(at), note)
            }).collect();
            prop_assert_eq!(run(&mut schedule, start, 100), expected);
        }
    }
}
