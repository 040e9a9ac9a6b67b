//! Archives and compressed parts that claim more than a recording can hold. Compression by Deflate reaches a
//! thousand to one, so a file of some kilobytes could ask for gigabytes.

use crate::error::{Error, Result};

/// What may be unpacked from a file of any size, bytes.
const ALWAYS: u64 = 64 << 20;
/// Unpacked bytes of one packed byte. A constant column packs by a thousand, and a column with one bit of
/// noise a sample by 30: no file that holds a reading comes to this on the whole.
const TIMES: u64 = 250;
/// The most that is unpacked from any file, and that one part of it may have, bytes.
const AT_MOST: u64 = 1 << 34;
const OF_A_PART: u64 = 1 << 31;

/// What may still be unpacked from a file.
pub(super) struct Room {
    bytes: u64,
    of_file: usize,
}

impl Room {
    /// Of a file of so many bytes.
    pub(super) fn of_file(of_file: usize) -> Self {
        let bytes = (TIMES * of_file as u64).clamp(ALWAYS, AT_MOST);
        Self { bytes, of_file }
    }

    /// Most bytes that are read of the next part: one more than there is room for.
    pub(super) fn limit(&self) -> u64 {
        self.bytes.min(OF_A_PART) + 1
    }

    /// Takes the room of a part that was read.
    ///
    /// # Errors
    /// There is less.
    pub(super) fn take(&mut self, place: &str, read: u64) -> Result<()> {
        if read >= self.limit() {
            return Err(Error::new(
                place,
                format!(
                    "unpacks to more than {} MB, and the file has {} kB; expected a recording, store it without compression",
                    (self.limit() - 1) >> 20,
                    self.of_file.div_ceil(1 << 10)
                ),
            ));
        }
        self.bytes -= read;
        Ok(())
    }
}

/// Refuses an archive whose members unpack to more than a recording holds, before a decoder of others keeps
/// them. What is damaged that decoder reports, where it matters.
///
/// # Errors
/// The archive claims too much.
#[cfg(feature = "spreadsheet")]
pub(super) fn check_archive(place: &str, bytes: &[u8]) -> Result<()> {
    use std::io::{Read, copy};
    let Ok(mut archive) = zip::ZipArchive::new(std::io::Cursor::new(bytes)) else {
        return Ok(());
    };
    let mut room = Room::of_file(bytes.len());
    for i in 0..archive.len() {
        let Ok(member) = archive.by_index(i) else {
            continue;
        };
        let mut counted = Counted(0);
        // Damage ends the copy, and what came before it counts.
        let _ = copy(&mut member.take(room.limit()), &mut counted);
        room.take(place, counted.0)?;
    }
    Ok(())
}

/// Counts the bytes that are written to it.
#[cfg(feature = "spreadsheet")]
struct Counted(u64);

#[cfg(feature = "spreadsheet")]
impl std::io::Write for Counted {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        self.0 += bytes.len() as u64;
        Ok(bytes.len())
    }

    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn there_is_room_for_a_recording_and_for_nothing_beyond() {
        let mut room = Room::of_file(1 << 20);
        assert_eq!(room.limit() - 1, 250 << 20);
        assert!(room.take("a", 200 << 20).is_ok());
        assert!(room.take("a", 50 << 20).is_ok(), "to the last byte");
        assert!(room.take("a", 1).is_err());
        // Small files may hold constants, large ones parts of two gigabytes.
        assert_eq!(Room::of_file(0).limit() - 1, 64 << 20);
        assert_eq!(Room::of_file(usize::MAX >> 8).limit() - 1, 1 << 31);
    }
}
