//! Lines of commands out of a stream of bytes, in which nothing that came before can hold up a stop.
//!
//! # How it works
//! [`CommandLines::receive`] takes whatever has come. A complete line waits in a store of [`STORE_BYTES`]
//! until the program has time and room for it ([`CommandLines::next`]); but a stop (`stop`, `disable`, or the
//! single byte [`STOP_BYTE`], which needs no end of line) is reported at once, and the lines that wait are
//! marked as from before it, so that none of them moves the drive any more.
//!
//! Several protocols can be read so; what a stop is called in one, and which bytes are commands without an
//! end of line, its [`Dialect`] says.

use heapless::{Deque, Vec};

/// Longest line, bytes.
pub const LINE_BYTES: usize = 96;
/// Room for lines that wait, bytes; each takes one more than its length.
pub const STORE_BYTES: usize = 2048;
/// Stops from anywhere in a line (Ctrl-X; the General Command Set's `#24`).
pub const STOP_BYTE: u8 = 0x18;

/// What a protocol has besides lines of text.
#[derive(Clone, Copy, Debug)]
pub struct Dialect {
    /// Whether a line, without its end, is a stop.
    pub is_stop: fn(&[u8]) -> bool,
    /// Bytes that are a line of their own wherever they come, also in the middle of another.
    pub single_bytes: &'static [u8],
    /// A stop also waits as a line, so that the program can answer it in its turn.
    pub stop_waits: bool,
}

/// That of [`crate::command_text`].
pub const COMMAND_TEXT: Dialect = Dialect {
    is_stop,
    single_bytes: &[],
    stop_waits: false,
};

/// A line that waited.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct WaitingLine<const LINE: usize = LINE_BYTES> {
    /// Its bytes, without the end of line.
    pub bytes: Vec<u8, LINE>,
    /// A stop came after it.
    pub before_stop: bool,
}

/// What receiving some bytes came to.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Received {
    /// The amplifier is to be stopped, now.
    pub stop: bool,
    /// Lines longer than there is room for, forgotten.
    pub too_long: u32,
    /// Lines for which there was no room, forgotten.
    pub no_room: u32,
    /// Lines of which bytes are missing, forgotten.
    pub incomplete: u32,
}

/// The lines that have come and wait: each of up to `LINE` bytes, in a store of `STORE`.
#[derive(Debug)]
pub struct CommandLines<const LINE: usize = LINE_BYTES, const STORE: usize = STORE_BYTES> {
    dialect: Dialect,
    line: Vec<u8, LINE>,
    /// The line that is coming is longer than any.
    overlong: bool,
    /// Bytes of it are missing.
    incomplete: bool,
    store: Deque<u8, STORE>,
    complete: usize,
    /// Of those, the oldest ones: a stop came after them.
    before_stop: usize,
}

fn is_stop(line: &[u8]) -> bool {
    let word = line.trim_ascii();
    word == b"stop" || word == b"disable"
}

impl Default for CommandLines {
    fn default() -> Self {
        Self::new()
    }
}

impl CommandLines {
    /// For [`COMMAND_TEXT`]; nothing has come yet.
    #[must_use]
    pub fn new() -> Self {
        Self::of(COMMAND_TEXT)
    }
}

impl<const LINE: usize, const STORE: usize> CommandLines<LINE, STORE> {
    /// For a dialect; nothing has come yet.
    #[must_use]
    pub const fn of(dialect: Dialect) -> Self {
        Self {
            dialect,
            line: Vec::new(),
            overlong: false,
            incomplete: false,
            store: Deque::new(),
            complete: 0,
            before_stop: 0,
        }
    }

    /// Takes bytes.
    pub fn receive(&mut self, bytes: &[u8]) -> Received {
        let mut received = Received::default();
        for byte in bytes {
            match *byte {
                STOP_BYTE => {
                    self.line.clear();
                    self.overlong = false;
                    self.stop(&[STOP_BYTE], &mut received);
                }
                b'\n' | b'\r' => self.end_of_line(&mut received),
                single if !self.incomplete && self.dialect.single_bytes.contains(&single) => {
                    self.keep(&[single], &mut received)
                }
                other => self.overlong |= self.line.push(other).is_err(),
            }
        }
        received
    }

    /// Bytes are missing here: all up to the next end of a line is forgotten.
    pub fn lose(&mut self) {
        self.incomplete = true;
    }

    fn end_of_line(&mut self, received: &mut Received) {
        let line = core::mem::take(&mut self.line);
        if core::mem::take(&mut self.incomplete) {
            self.overlong = false;
            received.incomplete = received.incomplete.saturating_add(1);
        } else if core::mem::take(&mut self.overlong) {
            received.too_long = received.too_long.saturating_add(1);
        } else if (self.dialect.is_stop)(&line) {
            self.stop(&line, received);
        } else if !line.trim_ascii().is_empty() {
            self.keep(&line, received);
        }
    }

    fn stop(&mut self, line: &[u8], received: &mut Received) {
        self.before_stop = self.complete;
        received.stop = true;
        if self.dialect.stop_waits {
            self.keep(line, received);
        }
    }

    fn keep(&mut self, line: &[u8], received: &mut Received) {
        if self.store.capacity() - self.store.len() > line.len() {
            for byte in line.iter().chain(b"\n") {
                let _ = self.store.push_back(*byte);
            }
            self.complete += 1;
        } else {
            received.no_room = received.no_room.saturating_add(1);
        }
    }

    /// The line that has waited longest.
    #[allow(clippy::should_implement_trait)] // no iterator: more may come after the last
    pub fn next(&mut self) -> Option<WaitingLine<LINE>> {
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
        core::iter::from_fn(|| lines.next())
            .map(|line| text(&line))
            .collect()
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
            assert_eq!(
                rest(&mut lines),
                ["enable", "reference sine 1000 20 30", "status"]
            );
            assert_eq!(lines.receive(b"ished\n"), Received::default());
            assert_eq!(rest(&mut lines), ["unfinished"]);
        }
    }

    #[test]
    fn a_stop_is_told_at_once_and_marks_what_came_before_it() {
        for stop in [&b"disable\n"[..], b" stop\r", b"\x18"] {
            let mut lines = CommandLines::new();
            lines.receive(b"enable\nplay sine 1 2 3 4\n");
            assert!(
                lines.next().is_some_and(|line| !line.before_stop),
                "obeyed before the stop came"
            );
            assert!(lines.receive(&[stop, b"status\n"].concat()).stop);
            let rest: Vec<(String, bool)> = core::iter::from_fn(|| lines.next())
                .map(|line| (text(&line), line.before_stop))
                .collect();
            assert_eq!(
                rest,
                [("play sine 1 2 3 4".into(), true), ("status".into(), false)]
            );
        }
        let mut lines = CommandLines::new();
        assert!(
            !lines.receive(b"@100 disable\ndisabled\n").stop,
            "the first waits for its tick, the second stops nothing"
        );
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
        assert!(
            lines.receive(b"stop\n").stop,
            "a full store holds up no stop"
        );
        assert!(core::iter::from_fn(|| lines.next()).all(|line| line.before_stop));
    }

    #[test]
    fn single_bytes_and_stops_wait_in_their_turn_where_the_dialect_says_so() {
        let dialect = Dialect {
            is_stop: |line| line == b"STP",
            single_bytes: &[5, 7],
            stop_waits: true,
        };
        let mut lines = CommandLines::<32, 256>::of(dialect);
        assert!(!lines.receive(b"POS? \x05").stop);
        assert!(lines.receive(b"1\nSTP\nERR?\n\x18\x07").stop);
        let all: Vec<(Vec<u8>, bool)> = core::iter::from_fn(|| lines.next())
            .map(|line| (line.bytes.to_vec(), line.before_stop))
            .collect();
        let expected: [(&[u8], bool); 6] = [
            (b"\x05", true),
            (b"POS? 1", true),
            (b"STP", true),
            (b"ERR?", true),
            (b"\x18", false),
            (b"\x07", false),
        ];
        assert_eq!(all.len(), expected.len());
        for (line, expected) in all.iter().zip(expected) {
            assert_eq!((line.0.as_slice(), line.1), expected);
        }
    }

    #[test]
    fn a_line_of_which_bytes_are_missing_is_forgotten_to_its_end() {
        let mut lines = CommandLines::new();
        assert_eq!(lines.receive(b"play 1"), Received::default());
        lines.lose();
        let received = lines.receive(b"0\nstatus\n");
        assert_eq!(
            (received.incomplete, rest(&mut lines)),
            (1, ["status".into()].into())
        );
        // An end of line that is missing joins two lines: both are forgotten. A stop is not.
        lines.receive(b"enable");
        lines.lose();
        assert!(lines.receive(b"play 1 2\x18 3\nstatus\n").stop);
        assert_eq!(rest(&mut lines), ["status"]);
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
