//! Recorded codes in lines of text that take little room on the line and show when they were garbled.
//!
//! # The format
//! A line is base 64 (RFC 4648, padded) of up to [`SAMPLES_IN_LINE`] samples of five bytes, the sensor's code
//! and the drive's code of 20 bits each, low byte first ([`code_bytes`]), and of the CRC-32 of those bytes
//! behind them, low byte first.

use heapless::Vec;
use hysteron_core::checksum::crc32;
use hysteron_core::trace_frame::{CODE_BYTES, TraceSample, code_bytes};

/// Most samples in a line.
pub const SAMPLES_IN_LINE: u32 = 72;
/// Bytes of a full line before they are text.
const LINE_BYTES: usize = CODE_BYTES * SAMPLES_IN_LINE as usize + 4;

const ALPHABET: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";

/// Writes up to [`SAMPLES_IN_LINE`] samples; nothing where there is no room.
#[must_use]
pub fn write_line<const ROOM: usize>(
    samples: impl Iterator<Item = TraceSample>,
    to: &mut Vec<u8, ROOM>,
) -> Option<()> {
    let mut bytes: Vec<u8, LINE_BYTES> = Vec::new();
    for sample in samples.take(SAMPLES_IN_LINE as usize) {
        bytes
            .extend_from_slice(&code_bytes(sample.adc_code, sample.dac_code))
            .ok()?;
    }
    bytes.extend_from_slice(&crc32(&bytes).to_le_bytes()).ok()?;
    for three in bytes.chunks(3) {
        let word = three
            .iter()
            .zip([16, 8, 0])
            .fold(0u32, |word, (byte, shift)| word | u32::from(*byte) << shift);
        for (nth, shift) in [18, 12, 6, 0].into_iter().enumerate() {
            let digit = ALPHABET
                .get((word >> shift & 63) as usize)
                .copied()
                .filter(|_| nth <= three.len());
            to.push(digit.unwrap_or(b'=')).ok()?;
        }
    }
    Some(())
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;
    use hysteron_core::codes::{DriveCode, SensorCode};

    #[test]
    fn the_examples_of_the_standard() {
        // The checksum of nothing is 0; what base 64 makes of bytes is in the client's tests, with a decoder
        // that others wrote.
        let mut text: Vec<u8, 16> = Vec::new();
        assert_eq!(write_line(core::iter::empty(), &mut text), Some(()));
        assert_eq!(text.as_slice(), b"AAAAAA==");
        let sample = TraceSample {
            adc_code: SensorCode::new(0xf_6f66),
            dac_code: DriveCode::new(0x6_1626),
            ..TraceSample::default()
        };
        let mut text: Vec<u8, 16> = Vec::new();
        assert_eq!(write_line(core::iter::once(sample), &mut text), Some(()));
        // "fooba" is Zm9vYmE= by itself (RFC 4648, 10).
        assert!(
            text.starts_with(b"Zm9vYm"),
            "{:?}",
            core::str::from_utf8(&text)
        );
        let mut short: Vec<u8, 8> = Vec::new();
        assert_eq!(
            write_line(core::iter::repeat_n(sample, 90), &mut short),
            None
        );
    }
}
