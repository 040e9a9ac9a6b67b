//! A line with its checksum: a command that moves something comes whole or not at all.
//!
//! # How it works
//! Any line may end in a blank, a `*` and the CRC-32 of all before that blank, in eight hexadecimal digits:
//! `MOV 1 5.25 *` and the digits. Where the last of several words begins with `*`, it must be the right
//! checksum. A line that lost any of its bytes then moves nothing; one that lost the checksum and the blank
//! before it is a line without one.

use hysteron_core::checksum::crc32;

use crate::error_code::ErrorCode;

/// Bytes that a seal adds to a line.
pub const SEAL_BYTES: usize = 10;

/// Commands after which something may move, or moves otherwise: `hysteron` seals them.
pub const MOVING: [&str; 12] = [
    "ARM", "ATZ", "MOV", "MVR", "RON", "SPA", "SVA", "SVO", "WAV", "WGC", "WGO", "WTR",
];

/// The checksum of a line, without its end.
#[must_use]
pub fn checksum(line: &str) -> u32 {
    crc32(line.as_bytes())
}

/// What a line says, without its seal.
///
/// # Errors
/// [`ErrorCode::LostBytes`]: it has a seal, and not the right one.
pub fn opened(line: &str) -> Result<&str, ErrorCode> {
    let line = line.trim_ascii_end();
    let Some((text, digits)) = line.rsplit_once(" *") else {
        return Ok(line);
    };
    let sum = u32::from_str_radix(digits, 16).ok();
    if digits.len() + 2 == SEAL_BYTES && sum == Some(checksum(text)) {
        Ok(text)
    } else {
        Err(ErrorCode::LostBytes)
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;
    use std::format;
    use std::string::String;

    #[test]
    fn a_sealed_line_that_lost_a_byte_says_nothing() {
        let sealed = format!("SVA 1 10.0 *{:08X}", checksum("SVA 1 10.0"));
        assert_eq!(opened(&sealed), Ok("SVA 1 10.0"));
        assert_eq!(
            opened(&sealed.to_lowercase().replace("sva", "SVA")),
            Ok("SVA 1 10.0")
        );
        for at in 0..sealed.len() {
            let mut less = String::from(&sealed[..at]);
            less.push_str(&sealed[at + 1..]);
            // Without the `*` it has a word too many, without the blank a word that is no number.
            let is_refused =
                opened(&less).is_err() || less.contains(" 1 10.0 4") || less.contains("10.0*");
            assert!(is_refused || !less.contains(" *"), "{less}");
        }
        assert_eq!(opened("*IDN?"), Ok("*IDN?"));
        assert_eq!(opened("MOV 1 5"), Ok("MOV 1 5"));
    }
}
