//! An image that takes the place of the running one, and the way back.
//!
//! # How it works
//! The flash holds three images: the running one, the one before it, and one that came over the line. A
//! sector of its own, the journal, holds a request and five marks, each a flash word that is written once.
//! [`prepare`] is the boot stage's part: it saves the running image, copies the incoming one over it, and lets
//! it run once. An image that does not mark itself healthy before the next start is replaced by the saved
//! one.
//!
//! The source of every copy stays whole until the copy has been read back and marked, so a supply that fails
//! at any instant costs time and nothing else. A word whose writing was cut off cannot be read; as a mark it
//! counts as set, because a mark is written when its step has been done, and as a request it counts as none.
//!
//! Nothing is done without an authentication code: the request has that of the incoming image under the
//! board's [`UpdateKey`], and the boot stage computes it again before it erases anything. An image of a lower
//! version than the running one's ([`ImageHeader::release`]) is refused before it is requested: a signature
//! does not end, and what was signed once could bring back what a later version mended.

use core::hash::Hasher;

use siphasher::sip128::{Hasher128, SipHasher24};

use crate::checksum::crc32;

/// What a flash programs at once, bytes.
pub const WORD_BYTES: usize = 32;
/// The same, as addresses count.
const STRIDE: u32 = WORD_BYTES as u32;
/// A flash word.
pub type Word = [u8; WORD_BYTES];

pub(crate) const ERASED: Word = [0xFF; WORD_BYTES];
/// What a mark holds.
pub const MARKED: Word = [0; WORD_BYTES];
const REQUEST_MAGIC: u32 = 0x4859_5550;

/// Where the images and the journal stand; all of them begin with a sector.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Places {
    /// The image that runs.
    pub running: u32,
    /// The one before it.
    pub previous: u32,
    /// The one that comes.
    pub incoming: u32,
    /// Room for each of them, whole sectors, bytes.
    pub image_bytes: u32,
    /// Bytes of a sector.
    pub sector_bytes: u32,
    /// Request and marks.
    pub journal: u32,
    /// The word that holds the key, in the boot stage's sector.
    pub key: u32,
}

/// Those of the STM32H743ZI (RM0433, 4.3.4): the boot stage has the first sector of bank 1, the running and the
/// previous image three each behind it. The incoming image comes to bank 2, where an erase stalls no code.
pub const H743ZI: Places = Places {
    running: 0x0802_0000,
    previous: 0x0808_0000,
    incoming: 0x0810_0000,
    image_bytes: 3 * 128 * 1024,
    sector_bytes: 128 * 1024,
    journal: 0x081A_0000,
    key: 0x0801_FFE0,
};

/// Bytes of a key, and of an authentication code.
pub const KEY_BYTES: usize = 16;
/// SipHash-2-4 of an image, 128 bits.
pub type AuthenticationCode = [u8; KEY_BYTES];

/// The key under which a board takes images: what whoever signs an image shares with the board.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct UpdateKey([u8; KEY_BYTES]);

impl UpdateKey {
    /// Of these bytes.
    #[must_use]
    pub const fn new(bytes: [u8; KEY_BYTES]) -> Self {
        Self(bytes)
    }

    /// As it stands in the flash: the key, then its complement, so that neither erased nor damaged flash is
    /// one.
    #[must_use]
    pub fn word(&self) -> Word {
        let mut word = MARKED;
        let (key, complement) = word.split_at_mut(KEY_BYTES);
        key.copy_from_slice(&self.0);
        for (to, byte) in complement.iter_mut().zip(self.0) {
            *to = !byte;
        }
        word
    }

    /// Reads it; `None` where nobody has set one.
    #[must_use]
    pub fn read(word: Option<Word>) -> Option<Self> {
        let word = word?;
        let key = Self(*word.first_chunk()?);
        (key.word() == word).then_some(key)
    }

    /// The code of an image whose words follow.
    #[must_use]
    pub fn authenticate(&self) -> Authentication {
        Authentication(SipHasher24::new_with_key(&self.0))
    }
}

/// The authentication code of words that are given one after the other.
pub struct Authentication(SipHasher24);

impl Authentication {
    /// Takes the next word.
    pub fn update(&mut self, word: &Word) {
        self.0.write(word);
    }

    /// The code of what was given so far.
    #[must_use]
    pub fn code(&self) -> AuthenticationCode {
        self.0.finish128().as_bytes()
    }
}

/// A flash as the boot stage has it. Every function waits until it is done.
pub trait UpdateFlash {
    /// The word at an address; `None`: it cannot be read.
    fn word(&mut self, address: u32) -> Option<Word>;
    /// Erases the sector that begins at an address; whether the flash took it.
    fn erase(&mut self, address: u32) -> bool;
    /// Programs a word; whether the flash took it.
    fn program(&mut self, address: u32, word: &Word) -> bool;
}

/// An image that is to be installed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Request {
    /// Its length, whole words.
    pub bytes: u32,
    /// Its authentication code.
    pub code: AuthenticationCode,
}

impl Request {
    /// As it stands in the journal.
    #[must_use]
    pub fn word(&self) -> Word {
        let mut word = MARKED;
        let (content, sum) = word.split_at_mut(8 + KEY_BYTES);
        let (numbers, code) = content.split_at_mut(8);
        for (to, number) in numbers.chunks_exact_mut(4).zip([REQUEST_MAGIC, self.bytes]) {
            to.copy_from_slice(&number.to_le_bytes());
        }
        code.copy_from_slice(&self.code);
        for (to, byte) in sum.iter_mut().zip(crc32(content).to_le_bytes()) {
            *to = byte;
        }
        word
    }

    fn read(word: Option<Word>) -> Option<Self> {
        let word = word?;
        let request = Self {
            bytes: u32::from_le_bytes(word.get(4..8)?.try_into().ok()?),
            code: word.get(8..8 + KEY_BYTES)?.try_into().ok()?,
        };
        (request.word() == word).then_some(request)
    }
}

/// A step that has been done.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum Mark {
    /// The running image stands in the place of the previous one as well.
    Saved = 1,
    /// The incoming image has been copied, and is started.
    Installed = 2,
    /// It has run for its first healthy second.
    Healthy = 3,
    /// It was not installed, or the previous image has been put back.
    Ended = 4,
    /// The image that runs now has logged that.
    Reported = 5,
}

impl Mark {
    /// Where it stands in a journal.
    #[must_use]
    pub fn address(self, journal: u32) -> u32 {
        journal + self as u32 * STRIDE
    }
}

/// What a journal says.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Progress {
    /// No image was brought since the journal was erased.
    Nothing,
    /// The next start installs an image.
    Requested,
    /// The incoming image is being copied over the running one.
    Saved,
    /// The image runs for the first time.
    Trial,
    /// It has been healthy.
    Confirmed,
    /// It was not installed: it did not have its authentication code, or the flash refused it.
    NotInstalled,
    /// It was installed and did not become healthy: the previous one runs.
    RolledBack,
}

/// Reads a journal with a function that reads a word. The request; whether the end was reported.
pub fn journal(
    journal: u32,
    mut word: impl FnMut(u32) -> Option<Word>,
) -> (Progress, Option<Request>, bool) {
    let Some(request) = Request::read(word(journal)) else {
        return (Progress::Nothing, None, true);
    };
    let mut is = |mark: Mark| word(mark.address(journal)) != Some(ERASED);
    let (installed, ended) = (is(Mark::Installed), is(Mark::Ended));
    let progress = match (ended, installed) {
        (true, true) => Progress::RolledBack,
        (true, false) => Progress::NotInstalled,
        (false, true) if is(Mark::Healthy) => Progress::Confirmed,
        (false, true) => Progress::Trial,
        (false, false) if is(Mark::Saved) => Progress::Saved,
        (false, false) => Progress::Requested,
    };
    (progress, Some(request), is(Mark::Reported))
}

/// What the boot stage does then.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Start {
    /// Starts the running image.
    Usual,
    /// The same, with a watchdog that bites unless the image becomes healthy.
    Trial,
    /// Nothing: no image is whole. The next start tries again.
    Nothing,
}

/// Whether an image is in bounds, can be read and has its authentication code under the board's key.
pub fn is_authentic(
    places: &Places,
    at: u32,
    request: &Request,
    mut word: impl FnMut(u32) -> Option<Word>,
) -> bool {
    let Some(key) = UpdateKey::read(word(places.key)) else {
        return false;
    };
    if request.bytes == 0
        || request.bytes > places.image_bytes
        || !request.bytes.is_multiple_of(STRIDE)
    {
        return false;
    }
    let mut authentication = key.authenticate();
    for offset in (0..request.bytes).step_by(WORD_BYTES) {
        match word(at + offset) {
            Some(word) => authentication.update(&word),
            None => return false,
        }
    }
    authentication.code() == request.code
}

/// Sets a mark and sees that it reads as set.
fn mark<F: UpdateFlash>(flash: &mut F, places: &Places, mark: Mark) -> bool {
    let address = mark.address(places.journal);
    flash.program(address, &MARKED) && flash.word(address) != Some(ERASED)
}

/// Copies an image and reads it back. Words of ones are what the erase has left.
fn copy<F: UpdateFlash>(flash: &mut F, places: &Places, from: u32, to: u32, bytes: u32) -> bool {
    for sector in (0..bytes).step_by(places.sector_bytes as usize) {
        if !flash.erase(to + sector) {
            return false;
        }
        for offset in (sector..(sector + places.sector_bytes).min(bytes)).step_by(WORD_BYTES) {
            let Some(word) = flash.word(from + offset) else {
                return false;
            };
            let written = word == ERASED || flash.program(to + offset, &word);
            if !written || flash.word(to + offset) != Some(word) {
                return false;
            }
        }
    }
    true
}

/// Puts the previous image back.
fn restore<F: UpdateFlash>(flash: &mut F, places: &Places) -> Start {
    if copy(
        flash,
        places,
        places.previous,
        places.running,
        places.image_bytes,
    ) && mark(flash, places, Mark::Ended)
    {
        Start::Usual
    } else {
        Start::Nothing
    }
}

/// Brings the running image to what the journal asks for. It may be cut off anywhere and begun again.
pub fn prepare<F: UpdateFlash>(flash: &mut F, places: &Places) -> Start {
    let (progress, request, _) = journal(places.journal, |address| flash.word(address));
    let Some(request) = request else {
        return Start::Usual;
    };
    match progress {
        Progress::Nothing | Progress::Confirmed | Progress::NotInstalled | Progress::RolledBack => {
            return Start::Usual;
        }
        // It was started once and has not become healthy.
        Progress::Trial => return restore(flash, places),
        Progress::Requested => {
            let is_whole = is_authentic(places, places.incoming, &request, |address| {
                flash.word(address)
            });
            let saved = is_whole
                && copy(
                    flash,
                    places,
                    places.running,
                    places.previous,
                    places.image_bytes,
                );
            // Nothing of the running image is erased before the mark reads as set: a second start would take
            // what is left of it for an image.
            if !(saved && mark(flash, places, Mark::Saved)) {
                mark(flash, places, Mark::Ended);
                return Start::Usual;
            }
        }
        Progress::Saved => {
            // The running image may be half erased.
            if !is_authentic(places, places.incoming, &request, |address| {
                flash.word(address)
            }) {
                return restore(flash, places);
            }
        }
    }
    let installed = copy(
        flash,
        places,
        places.incoming,
        places.running,
        request.bytes,
    ) && is_authentic(places, places.running, &request, |address| {
        flash.word(address)
    });
    if installed && mark(flash, places, Mark::Installed) {
        Start::Trial
    } else {
        restore(flash, places)
    }
}

/// Where an image says what it is, from its beginning: behind the vectors.
pub const HEADER_OFFSET: u32 = 0x400;
/// Bytes of that: the image's length, then what [`ImageHeader`] holds.
pub const HEADER_BYTES: usize = 64;
const HEADER_MAGIC: [u8; 8] = *b"HYSTERON";

/// What an image says of itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(C)]
pub struct ImageHeader {
    magic: [u8; 8],
    /// Its sampling rate, Hz.
    pub sample_rate_hz: u32,
    /// The board that it is for, filled with zeros.
    pub board: [u8; 16],
    /// Its converters.
    pub front_end: [u8; 16],
    /// Its version.
    pub version: [u8; 16],
}

/// A text of a header, cut to its room.
const fn padded(text: &str) -> [u8; 16] {
    let (bytes, mut out, mut nth) = (text.as_bytes(), [0; 16], 0);
    while nth < bytes.len() && nth < out.len() {
        out[nth] = bytes[nth];
        nth += 1;
    }
    out
}

/// The characters of a text of a header.
#[must_use]
pub fn text(field: &[u8; 16]) -> &str {
    let end = field
        .iter()
        .position(|byte| !byte.is_ascii_graphic())
        .unwrap_or(field.len());
    field
        .get(..end)
        .and_then(|bytes| core::str::from_utf8(bytes).ok())
        .unwrap_or_default()
}

impl ImageHeader {
    /// Of an image.
    #[must_use]
    pub const fn new(board: &str, front_end: &str, version: &str, sample_rate_hz: u32) -> Self {
        Self {
            magic: HEADER_MAGIC,
            sample_rate_hz,
            board: padded(board),
            front_end: padded(front_end),
            version: padded(version),
        }
    }

    /// Its version as numbers, major first; `None` where the text is no version. That is below every version.
    #[must_use]
    pub fn release(&self) -> Option<[u32; 3]> {
        let (mut release, mut nth, mut digits) = ([0u32; 3], 0, 0);
        for byte in text(&self.version).bytes() {
            match byte {
                b'0'..=b'9' => {
                    let number = release.get_mut(nth)?;
                    *number = number
                        .checked_mul(10)?
                        .checked_add(u32::from(byte - b'0'))?;
                    digits += 1;
                }
                b'.' if digits > 0 => (nth, digits) = (nth + 1, 0),
                _ => return None,
            }
        }
        (nth == 2 && digits > 0).then_some(release)
    }

    /// Reads one, and the length of its image, from what stands at [`HEADER_OFFSET`].
    #[must_use]
    pub fn read(bytes: &[u8]) -> Option<(u32, Self)> {
        let number = |at: usize| Some(u32::from_le_bytes(bytes.get(at..at + 4)?.try_into().ok()?));
        let field = |at: usize| bytes.get(at..at + 16)?.try_into().ok();
        let header = Self {
            magic: bytes.get(4..12)?.try_into().ok()?,
            sample_rate_hz: number(12)?,
            board: field(16)?,
            front_end: field(32)?,
            version: field(48)?,
        };
        (header.magic == HEADER_MAGIC).then_some((number(0)?, header))
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;
    use std::vec::Vec;

    const SECTOR: u32 = 4 * STRIDE;
    const PLACES: Places = Places {
        running: SECTOR,
        previous: 4 * SECTOR,
        incoming: 7 * SECTOR,
        image_bytes: 3 * SECTOR,
        sector_bytes: SECTOR,
        journal: 10 * SECTOR,
        key: 0,
    };
    const KEY: UpdateKey = UpdateKey::new(*b"sixteen bytes of");
    const IMAGE_WORDS: usize = 9;

    /// A flash whose supply may fail.
    struct Cut {
        words: Vec<Option<Word>>,
        /// Erases and programs that are left before the supply fails; `None`: it does not.
        left: Option<u32>,
        off: bool,
        random: u32,
        done: u32,
    }

    impl Cut {
        fn draw(&mut self) -> u32 {
            self.random = self
                .random
                .wrapping_mul(1_664_525)
                .wrapping_add(1_013_904_223);
            self.random >> 24
        }

        /// Whether the supply fails in this operation, or has failed.
        fn fails(&mut self) -> bool {
            self.done += 1;
            match &mut self.left {
                Some(0) => true,
                Some(left) => {
                    *left -= 1;
                    false
                }
                None => false,
            }
        }

        fn place(&mut self, address: u32) -> &mut Option<Word> {
            &mut self.words[(address / STRIDE) as usize]
        }

        fn image(&self, at: u32) -> &[Option<Word>] {
            &self.words[(at / STRIDE) as usize..][..IMAGE_WORDS]
        }
    }

    impl UpdateFlash for Cut {
        fn word(&mut self, address: u32) -> Option<Word> {
            *self.place(address)
        }

        fn erase(&mut self, address: u32) -> bool {
            if self.off {
                return false;
            }
            self.off = self.fails();
            for offset in (0..SECTOR).step_by(WORD_BYTES) {
                let half_way = self.off.then(|| self.draw() % 3);
                let word = self.place(address + offset);
                *word = match half_way {
                    Some(0) => *word,
                    Some(1) => None,
                    _ => Some(ERASED),
                };
            }
            !self.off
        }

        fn program(&mut self, address: u32, new: &Word) -> bool {
            if self.off {
                return false;
            }
            self.off = self.fails();
            let half_way = self.off.then(|| self.draw() % 3);
            let word = self.place(address);
            *word = match (half_way, *word) {
                (Some(0), old) => old,
                (Some(1), _) => None,
                (_, Some(ERASED)) => Some(*new),
                // A word that was written before has no consistent ECC any more.
                _ => None,
            };
            !self.off
        }
    }

    fn image(tag: u8) -> Vec<Option<Word>> {
        (0..IMAGE_WORDS)
            .map(|nth| {
                Some(if nth == 4 {
                    ERASED
                } else {
                    [tag.wrapping_add(nth as u8); WORD_BYTES]
                })
            })
            .collect()
    }

    fn requested() -> Cut {
        let mut words = std::vec![Some(ERASED); 12 * 4];
        let (old, new) = (image(10), image(100));
        words[4..4 + IMAGE_WORDS].copy_from_slice(&old);
        words[28..28 + IMAGE_WORDS].copy_from_slice(&new);
        let mut authentication = KEY.authenticate();
        for word in new.iter().flatten() {
            authentication.update(word);
        }
        let request = Request {
            bytes: IMAGE_WORDS as u32 * STRIDE,
            code: authentication.code(),
        };
        words[0] = Some(KEY.word());
        words[40] = Some(request.word());
        Cut {
            words,
            left: None,
            off: false,
            random: 1,
            done: 0,
        }
    }

    #[test]
    fn an_image_that_was_signed_with_another_key_changes_nothing() {
        let mut flash = requested();
        flash.words[0] = Some(UpdateKey::new([7; KEY_BYTES]).word());
        assert_eq!(prepare(&mut flash, &PLACES), Start::Usual);
        assert_eq!(flash.image(PLACES.running), &image(10)[..]);
    }

    /// The published vector of SipHash-2-4 with 128 bits: key 00 01 .. 0f, of the 32 bytes 00 01 .. 1f.
    #[test]
    fn the_code_is_that_of_siphash_2_4_128() {
        let count = |nth: usize| nth as u8;
        let key = UpdateKey::new(core::array::from_fn(count));
        let mut authentication = key.authenticate();
        authentication.update(&core::array::from_fn(count));
        let hex: std::string::String = authentication
            .code()
            .iter()
            .map(|byte| std::format!("{byte:02x}"))
            .collect();
        assert_eq!(hex, "7c3956ca5eeafc3e363e9d556546eb68");
        assert_eq!(UpdateKey::read(Some(key.word())), Some(key));
        for word in [None, Some(ERASED), Some(MARKED)] {
            assert_eq!(UpdateKey::read(word), None);
        }
    }

    #[test]
    fn a_whole_image_is_installed_on_trial_and_kept_when_healthy() {
        let mut flash = requested();
        assert_eq!(prepare(&mut flash, &PLACES), Start::Trial);
        assert_eq!(
            (flash.image(PLACES.running), flash.image(PLACES.previous)),
            (&image(100)[..], &image(10)[..])
        );
        assert!(mark(&mut flash, &PLACES, Mark::Healthy));
        assert_eq!(prepare(&mut flash, &PLACES), Start::Usual);
        assert_eq!(flash.image(PLACES.running), &image(100)[..]);
    }

    #[test]
    fn an_image_that_is_not_healthy_is_rolled_back_once() {
        let mut flash = requested();
        assert_eq!(prepare(&mut flash, &PLACES), Start::Trial);
        assert_eq!(prepare(&mut flash, &PLACES), Start::Usual);
        assert_eq!(flash.image(PLACES.running), &image(10)[..]);
        let (progress, _, reported) = journal(PLACES.journal, |address| flash.word(address));
        assert_eq!((progress, reported), (Progress::RolledBack, false));
        let done = flash.done;
        assert_eq!(
            (prepare(&mut flash, &PLACES), flash.done),
            (Start::Usual, done),
            "and then nothing is written"
        );
    }

    #[test]
    fn a_damaged_image_request_or_key_changes_nothing() {
        for damaged in [0, 28, 40] {
            for word in [None, Some([7; WORD_BYTES]), Some(ERASED)] {
                let mut flash = requested();
                flash.words[damaged] = word;
                assert_eq!(prepare(&mut flash, &PLACES), Start::Usual);
                assert_eq!(flash.image(PLACES.running), &image(10)[..]);
                assert!(flash.done <= 1, "the mark, and no more");
            }
        }
    }

    /// The supply fails in every operation, in every second one behind it, and so on, with every way in which
    /// a word can be left.
    #[test]
    fn a_supply_that_fails_at_any_instant_leaves_a_whole_image() {
        let operations = {
            let mut flash = requested();
            prepare(&mut flash, &PLACES);
            flash.done
        };
        let mut outcomes = [0u32; 2];
        for first in 0..operations {
            for second in [None, Some(0), Some(1), Some(3), Some(7), Some(12)] {
                for random in 0..40 {
                    let mut flash = requested();
                    flash.random = random * 7919;
                    for left in [Some(first), second] {
                        (flash.left, flash.off) = (left, false);
                        prepare(&mut flash, &PLACES);
                    }
                    (flash.left, flash.off) = (None, false);
                    let start = prepare(&mut flash, &PLACES);
                    assert_ne!(
                        start,
                        Start::Nothing,
                        "cut at {first}, {second:?}, {random}"
                    );
                    let running = flash.image(PLACES.running);
                    let is_new = running == image(100);
                    assert!(
                        is_new || running == image(10),
                        "cut at {first}, {second:?}, {random}: {start:?}"
                    );
                    outcomes[usize::from(is_new)] += 1;
                }
            }
        }
        assert!(outcomes.iter().all(|count| *count > 100), "{outcomes:?}");
    }

    #[test]
    fn a_header_reads_as_it_was_written() {
        let header = ImageHeader::new("NUCLEO-H743ZI2", "spi", "0.1.0", 20_000);
        let mut bytes = [0; HEADER_BYTES];
        bytes[..4].copy_from_slice(&1234u32.to_le_bytes());
        bytes[4..12].copy_from_slice(b"HYSTERON");
        bytes[12..16].copy_from_slice(&20_000u32.to_le_bytes());
        for (at, field) in [
            (16, header.board),
            (32, header.front_end),
            (48, header.version),
        ] {
            bytes[at..at + 16].copy_from_slice(&field);
        }
        assert_eq!(ImageHeader::read(&bytes), Some((1234, header)));
        assert_eq!(
            (text(&header.board), text(&header.version)),
            ("NUCLEO-H743ZI2", "0.1.0")
        );
        bytes[4] = b'X';
        assert_eq!(ImageHeader::read(&bytes), None);
    }

    #[test]
    fn versions_rise_by_their_numbers_and_not_by_their_letters() {
        let release = |version| ImageHeader::new("", "", version, 20_000).release();
        assert_eq!(release("0.10.2"), Some([0, 10, 2]));
        assert!(release("0.10.0") > release("0.9.9") && release("1.0.0") > release("0.99.99"));
        for none in ["", "1.2", "1.2.3.4", "1.2.x", "1.2.3-rc1"] {
            assert!(
                release(none).is_none() && release(none) < release("0.0.0"),
                "{none}"
            );
        }
    }
}
