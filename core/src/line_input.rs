//! Bytes on their way from the interrupt of a serial port to the task that makes lines of them, in which no
//! byte is missing without notice.
//!
//! # How it works
//! The interrupt puts in what came ([`LineInput::put`]), and `None` for what came garbled or was overrun.
//! Behind a byte that found no room nothing is taken until there is room for the notice of it. So whoever
//! takes the bytes finds [`Arrived::Loss`] where one is missing, and can forget the line that it was in.

use core::sync::atomic::{AtomicBool, AtomicU16, AtomicUsize, Ordering};

/// What stands in the queue for bytes that did not come.
const LOSS: u16 = 1 << 8;

/// What has come.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Arrived {
    /// A byte.
    Byte(u8),
    /// One or more bytes are missing here.
    Loss,
}

/// Room for `N` of them; `N` is a power of two. For one interrupt and one task.
#[derive(Debug)]
pub struct LineInput<const N: usize> {
    slots: [AtomicU16; N],
    /// Ever put in and taken out, wrapping.
    written: AtomicUsize,
    read: AtomicUsize,
    /// A loss for whose notice there was no room yet.
    lost: AtomicBool,
}

impl<const N: usize> Default for LineInput<N> {
    fn default() -> Self {
        Self::new()
    }
}

impl<const N: usize> LineInput<N> {
    const POWER_OF_TWO: () = assert!(N.is_power_of_two());

    /// Nothing has come.
    #[must_use]
    pub const fn new() -> Self {
        let () = Self::POWER_OF_TWO;
        Self {
            slots: [const { AtomicU16::new(0) }; N],
            written: AtomicUsize::new(0),
            read: AtomicUsize::new(0),
            lost: AtomicBool::new(false),
        }
    }

    /// How many wait.
    #[must_use]
    pub fn waiting(&self) -> usize {
        let read = self.read.load(Ordering::Acquire);
        self.written.load(Ordering::Acquire).wrapping_sub(read)
    }

    fn push(&self, what: u16) -> bool {
        let written = self.written.load(Ordering::Relaxed);
        if self.waiting() >= N {
            return false;
        }
        if let Some(slot) = self.slots.get(written & (N - 1)) {
            slot.store(what, Ordering::Relaxed);
        }
        self.written
            .store(written.wrapping_add(1), Ordering::Release);
        true
    }

    /// Of the interrupt: the byte that came; `None` for one that was lost on its way.
    pub fn put(&self, byte: Option<u8>) {
        let lost = self.lost.load(Ordering::Relaxed) || byte.is_none();
        let noticed = !lost || self.push(LOSS);
        let taken = noticed && byte.is_none_or(|byte| self.push(byte.into()));
        self.lost.store(!taken, Ordering::Relaxed);
    }

    /// Of the task: what has waited longest.
    pub fn take(&self) -> Option<Arrived> {
        if self.waiting() == 0 {
            return None;
        }
        let read = self.read.load(Ordering::Relaxed);
        let what = self.slots.get(read & (N - 1))?.load(Ordering::Relaxed);
        self.read.store(read.wrapping_add(1), Ordering::Release);
        Some(match what {
            LOSS => Arrived::Loss,
            byte => Arrived::Byte(byte as u8),
        })
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;
    use proptest::prelude::*;
    use std::vec::Vec;

    #[derive(Clone, Debug)]
    enum Event {
        Byte(u8),
        Garbled,
        /// The task takes so many.
        Take(usize),
    }

    fn event() -> impl Strategy<Value = Event> {
        prop_oneof![
            6 => any::<u8>().prop_map(Event::Byte),
            1 => Just(Event::Garbled),
            1 => (0usize..12).prop_map(Event::Take),
        ]
    }

    proptest! {
        /// Between two notices of a loss the task sees a piece of what was sent without a gap.
        #[test]
        fn no_byte_is_missing_without_notice(events in prop::collection::vec(event(), 0..400)) {
            let input = LineInput::<8>::new();
            // What was sent, a `None` where a byte was garbled, and what the task saw.
            let (mut sent, mut seen) = (Vec::new(), Vec::new());
            let take = |seen: &mut Vec<Arrived>, count: usize| seen.extend((0..count).map_while(|_| input.take()));
            for event in events {
                match event {
                    Event::Byte(byte) => { sent.push(Some(byte)); input.put(Some(byte)); }
                    Event::Garbled => { sent.push(None); input.put(None); }
                    Event::Take(count) => take(&mut seen, count),
                }
            }
            take(&mut seen, 9);
            // Two more bytes tell whether what came last was lost.
            for byte in [1, 2] {
                sent.push(Some(byte));
                input.put(Some(byte));
            }
            take(&mut seen, 9);
            let mut at = 0;
            for piece in seen.split(|arrived| *arrived == Arrived::Loss) {
                let bytes: Vec<Option<u8>> = piece
                    .iter()
                    .map(|arrived| match arrived { Arrived::Byte(byte) => Some(*byte), Arrived::Loss => None })
                    .collect();
                let found = (at..=sent.len() - bytes.len()).find(|from| sent[*from..*from + bytes.len()] == bytes[..]);
                prop_assert!(found.is_some(), "{piece:?} was never sent in a row");
                at = found.unwrap_or(at) + bytes.len();
            }
            let losses = seen.iter().filter(|arrived| **arrived == Arrived::Loss).count();
            let came = seen.len() - losses;
            prop_assert!(came == sent.len() || losses > 0);
        }
    }
}
