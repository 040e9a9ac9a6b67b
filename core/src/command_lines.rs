//! Lines of commands out of a stream of bytes, in which nothing that came before can hold up a stop.
//!
//! # How it works
//! [`CommandLines::receive`] takes whatever has come. A complete line waits in a store of [`STORE_BYTES`] until the program has time and room for it
//! ([`CommandLines::next`]); but a stop (`stop`, `disable`, or the single byte [`STOP_BYTE`], which needs no end of line) is told at
//! once, and the lines that wait are marked as from before it, so that none of them moves the drive any more.

use heapless::{Deque, Vec};

/// Longest line, bytes.
pub const LINE_BYTES: usize = 96;
/// Room for lines that wait, bytes; each takes one more than its length.
pub const STORE_BYTES: usize = 2048;
/// Stops from anywhere in a line (Ctrl-X; the General Command Set's `#24`).
pub const STOP_BYTE: u8 = 0x18;

/// A line that waited.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct WaitingLine {
    /// Its bytes, without the end of line.
    pub bytes: Vec<u8, LINE_BYTES>,
    /// A stop came after it.
    pub before_stop: bool,
}

/// What receiving some bytes came to.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Received {
    /// The amplifier is to be stopped, now.
    pub stop: bool,
    /// Lines longer than [`LINE_BYTES`], forgotten.
    pub too_long: u32,
    /// Lines for which there was no room, forgotten.
    pub no_room: u32,
}

/// The lines that have come and wait.
#[derive(Debug, Default)]
pub struct CommandLines {
    line: Vec<u8, LINE_BYTES>,
    /// The line that is coming is longer than any.
    overlong: bool,
    store: Deque<u8, STORE_BYTES>,
    complete: usize,
    /// Of those, the oldest ones: a stop came after them.
    before_stop: usize,
}

fn is_stop(line: &[u8]) -> bool {
    let word = line.trim_ascii();
    word == b"stop" || word == b"disable"
}

impl CommandLines {
    /// Nothing has come yet.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Takes bytes.
    pub fn receive(&mut self, bytes: &[u8]) -> Received {
        let mut received = Received::default();
        for byte in bytes {
            match *byte {
                STOP_BYTE => {
                    self.line.clear();
                    self.overlong = false;
                    self.before_stop = self.complete;
                    received.stop = true;
                }
                b'\n' | b'\r' => self.end_of_line(&mut received),
                other => self.overlong |= self.line.push(other).is_err(),
            }
        }
        received
    }

    fn end_of_line(&mut self, received: &mut Received) {
        if core::mem::take(&mut self.overlong) {
            received.too_long = received.too_long.saturating_add(1);
        } else if is_stop(&self.line) {
            self.before_stop = self.complete;
            received.stop = true;
        } else if !self.line.trim_ascii().is_empty() {
            if self.store.capacity() - self.store.len() > self.line.len() {
                for byte in self.line.iter().chain(b"\n") {
                    let _ = self.store.push_back(*byte);
                }
                self.complete += 1;
            } else {
                received.no_room = received.no_room.saturating_add(1);
            }
        }
        self.line.clear();
    }

    /// The line that has waited longest.
    #[allow(clippy::should_implement_trait)] // no iterator: more may come after the last
    pub fn next(&mut self) -> Option<WaitingLine> {
        self.complete = self.complete.checked_sub(1)?;
        let mut bytes = Vec::new();
        while let Some(byte) = self.store.pop_front() {
            if byte == b'\n' || bytes.push(byte).is_err() {
                break;
            }
        }
        let before_stop = self.before_stop > 0;
        self.before_stop = self.before_stop.saturating_sub(1);
        Some(WaitingLine { bytes, before_stop })
    }

    /// Lines that wait.
    #[must_use]
    pub fn waiting(&self) -> usize {
        self.complete
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;
    use proptest::prelude::*;
    use std::string::String;
    use std::vec::Vec;

    fn rest(lines: &mut CommandLines) -> Vec<String> {
        core::iter::from_fn(|| lines.next()).map(|line| text(&line)).collect()
    }

    fn text(line: &WaitingLine) -> String {
        String::from_utf8(line.bytes.to_vec()).expect("text")
    }

    #[test]
    fn lines_come_out_as_they_went_in_whatever_the_pieces() {
        let text = b"enable\r\nreference sine 1000 20 30\n\n  \nstatus\nunfin";
        for size in 1..20 {
            let mut lines = CommandLines::new();
            for piece in text.chunks(size) {
                assert_eq!(lines.receive(piece), Received::default());
            }
            assert_eq!(rest(&mut lines), ["enable", "reference sine 1000 20 30", "status"]);
            assert_eq!(lines.receive(b"ished\n"), Received::default());
            assert_eq!(rest(&mut lines), ["unfinished"]);
        }
    }

    #[test]
    fn a_stop_is_told_at_once_and_marks_what_came_before_it() {
        for stop in [&b"disable\n"[..], b" stop\r", b"\x18"] {
            let mut lines = CommandLines::new();
            lines.receive(b"enable\nplay sine 1 2 3 4\n");
            assert!(lines.next().is_some_and(|line| !line.before_stop), "obeyed before the stop came");
            assert!(lines.receive(&[stop, b"status\n"].concat()).stop);
            let rest: Vec<(String, bool)> = core::iter::from_fn(|| lines.next()).map(|line| (text(&line), line.before_stop)).collect();
            assert_eq!(rest, [("play sine 1 2 3 4".into(), true), ("status".into(), false)]);
        }
        let mut lines = CommandLines::new();
        assert!(!lines.receive(b"@100 disable\ndisabled\n").stop, "that one waits for its tick, and that one is none");
        assert!(lines.receive(b"ena\x18ble\n").stop);
        assert_eq!(rest(&mut lines), ["@100 disable", "disabled", "ble"]);
    }

    #[test]
    fn too_much_is_counted_and_does_no_harm() {
        let mut lines = CommandLines::new();
        let received = lines.receive(&[&[b'x'; 500][..], b"\nstatus\n"].concat());
        assert_eq!((received.too_long, received.no_room), (1, 0));
        assert_eq!(rest(&mut lines), ["status"]);
        let received = lines.receive(&b"status\n".repeat(400));
        assert_eq!(received.no_room, 400 - (STORE_BYTES / 7) as u32);
        assert!(lines.receive(b"stop\n").stop, "a full store holds up no stop");
        assert!(core::iter::from_fn(|| lines.next()).all(|line| line.before_stop));
    }

    proptest! {
        #[test]
        fn no_bytes_do_harm_and_a_stop_is_never_missed(before in proptest::collection::vec(any::<u8>(), 0..3000)) {
            let mut lines = CommandLines::new();
            lines.receive(&before);
            prop_assert!(lines.receive(&[STOP_BYTE]).stop);
            while let Some(line) = lines.next() {
                prop_assert!(line.before_stop);
            }
            lines.receive(&before);
            prop_assert!(lines.receive(b"\ndisable\n").stop);
        }
    }
}
