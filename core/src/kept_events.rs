//! Faults as records in flash, which a loss of the supply leaves.
//!
//! # How it works
//! A record is a word of the flash: the event, a number that counts up, and a checksum. Records are appended
//! until their room is full, and then it is erased and the newest are written again. A word whose writing the
//! supply cut off is no record, and the next one goes behind it.

use crate::checksum::crc32;
use crate::firmware_update::{ERASED, WORD_BYTES, Word};

/// A fault that was latched.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Event {
    /// Number of the start in which it was latched.
    pub start: u32,
    /// The tick at which it was latched; 0 at a start.
    pub tick: u32,
    /// The number of it.
    pub fault: u32,
}

/// Bytes in front of the checksum.
const SUMMED_BYTES: usize = WORD_BYTES - 4;

/// The record of an event.
#[must_use]
pub fn record(number: u32, event: Event) -> Word {
    let mut word = [0; WORD_BYTES];
    for (to, field) in word
        .chunks_exact_mut(4)
        .zip([number, event.start, event.tick, event.fault])
    {
        to.copy_from_slice(&field.to_le_bytes());
    }
    let (summed, sum) = word.split_at_mut(SUMMED_BYTES);
    sum.copy_from_slice(&crc32(summed).to_le_bytes());
    word
}

/// The event of a record, and its number.
fn read(word: &Word) -> Option<(u32, Event)> {
    let mut fields = word
        .chunks_exact(4)
        .filter_map(|field| Some(u32::from_le_bytes(*field.first_chunk()?)));
    let (number, start, tick, fault) = (
        fields.next()?,
        fields.next()?,
        fields.next()?,
        fields.next()?,
    );
    let sum = fields.next_back()?;
    let summed = word.get(..SUMMED_BYTES)?;
    (crc32(summed) == sum).then_some((number, Event { start, tick, fault }))
}

/// Gives every record in the order in which they were written; the first place that is free. `word` reads a
/// place, and gives `None` where it is damaged.
pub fn scan(
    places: u32,
    mut word: impl FnMut(u32) -> Option<Word>,
    mut found: impl FnMut(u32, Event),
) -> u32 {
    for place in 0..places {
        match word(place) {
            Some(ERASED) => return place,
            Some(word) => {
                if let Some((number, event)) = read(&word) {
                    found(number, event);
                }
            }
            None => {}
        }
    }
    places
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;
    use std::vec::Vec;

    fn event(n: u32) -> Event {
        Event {
            start: n / 3,
            tick: n.wrapping_mul(0x9E37_79B9),
            fault: n % 36,
        }
    }

    fn all(places: &[Option<Word>]) -> (u32, Vec<(u32, Event)>) {
        let mut found = Vec::new();
        let free = scan(
            places.len() as u32,
            |place| places[place as usize],
            |number, event| found.push((number, event)),
        );
        (free, found)
    }

    #[test]
    fn records_come_back_in_their_order_up_to_the_first_free_place() {
        let mut places: Vec<_> = (0..5).map(|n| Some(record(n + 7, event(n)))).collect();
        places.extend([Some(ERASED), Some(ERASED)]);
        let (free, found) = all(&places);
        assert_eq!(free, 5);
        assert_eq!(found, (0..5).map(|n| (n + 7, event(n))).collect::<Vec<_>>());
        assert_eq!(all(&places[..5]).0, 5, "full");
        assert_eq!(all(&[Some(ERASED)]), (0, Vec::new()));
    }

    #[test]
    fn a_word_that_was_cut_off_is_no_record_and_hides_none() {
        let whole = record(3, event(3));
        for byte in 0..WORD_BYTES {
            let mut damaged = whole;
            damaged[byte] ^= 0x10;
            let places = [Some(damaged), None, Some(whole), Some(ERASED)];
            assert_eq!(all(&places), (3, std::vec![(3, event(3))]), "byte {byte}");
        }
    }
}
