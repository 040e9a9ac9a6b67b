//! The probe's side of SEGGER's real-time transfer (RTT): ring buffers in the target's memory, read and
//! written while it runs.

use rigless::emulator::Memory;
use rigless::soc::Width;

const IDENTIFIER: &[u8; 16] = b"SEGGER RTT\0\0\0\0\0\0";
const HEADER_BYTES: u64 = 24;
const CHANNEL_BYTES: u64 = 24;
const BUFFER: u64 = 4;
const SIZE: u64 = 8;
const WRITE: u64 = 12;
const READ: u64 = 16;

/// The control block `_SEGGER_RTT` at a known address.
#[derive(Clone, Copy, Debug)]
pub struct ControlBlock {
    address: u64,
}

impl ControlBlock {
    /// The control block at `address`, the value of the image's symbol `_SEGGER_RTT`.
    #[must_use]
    pub fn at(address: u64) -> Self {
        Self { address }
    }

    fn word(memory: &mut dyn Memory, address: u64) -> Option<u64> {
        memory.read(address, Width::W32).ok()
    }

    /// Whether the target has set the control block up.
    pub fn ready(self, memory: &mut dyn Memory) -> bool {
        IDENTIFIER.chunks(4).zip(0u64..).all(|(expected, word)| {
            let expected = expected
                .iter()
                .rev()
                .fold(0u64, |sum, byte| sum << 8 | u64::from(*byte));
            Self::word(memory, self.address + 4 * word) == Some(expected)
        })
    }

    /// Takes everything that up channel 0 holds.
    pub fn take_up(self, memory: &mut dyn Memory, into: &mut Vec<u8>) -> Option<()> {
        let channel = self.address + HEADER_BYTES;
        let (buffer, size) = (
            Self::word(memory, channel + BUFFER)?,
            Self::word(memory, channel + SIZE)?,
        );
        let write = Self::word(memory, channel + WRITE)?;
        let mut read = Self::word(memory, channel + READ)?;
        if size == 0 || write >= size || read >= size {
            return None;
        }
        while read != write {
            into.push(u8::try_from(memory.read(buffer + read, Width::W8).ok()?).ok()?);
            read = (read + 1) % size;
        }
        memory.write(channel + READ, Width::W32, read).ok()
    }

    /// Puts bytes into down channel 0; returns how many found room.
    pub fn put_down(self, memory: &mut dyn Memory, bytes: &[u8]) -> Option<usize> {
        let up_channels = Self::word(memory, self.address + 16)?;
        let channel = self.address + HEADER_BYTES + up_channels * CHANNEL_BYTES;
        let (buffer, size) = (
            Self::word(memory, channel + BUFFER)?,
            Self::word(memory, channel + SIZE)?,
        );
        let mut write = Self::word(memory, channel + WRITE)?;
        let read = Self::word(memory, channel + READ)?;
        if size == 0 || write >= size || read >= size {
            return None;
        }
        let mut put = 0;
        for byte in bytes {
            let next = (write + 1) % size;
            if next == read {
                break;
            }
            memory
                .write(buffer + write, Width::W8, u64::from(*byte))
                .ok()?;
            write = next;
            put += 1;
        }
        memory.write(channel + WRITE, Width::W32, write).ok()?;
        Some(put)
    }
}
