//! The bytes of a text file as text: UTF-8 with or without a mark, UTF-16 with one, else Latin-1.

use crate::error::{Error, Result};
use std::borrow::Cow;

/// Share of control characters above which bytes are no text.
const CONTROL_MAX: f64 = 0.001;

/// The text, and what was assumed to read it.
pub fn decode<'a>(
    place: &str,
    bytes: &'a [u8],
    expected: &str,
) -> Result<(Cow<'a, str>, Option<String>)> {
    let no_text = |why: &str| {
        Err(Error::new(
            place,
            format!("is no text ({why}) and no other format that is known; expected {expected}"),
        ))
    };
    if let Some(little) = match bytes {
        [0xff, 0xfe, ..] => Some(true),
        [0xfe, 0xff, ..] => Some(false),
        _ => None,
    } {
        let units = bytes[2..].chunks_exact(2).map(|pair| {
            let pair = [pair[0], pair[1]];
            if little {
                u16::from_le_bytes(pair)
            } else {
                u16::from_be_bytes(pair)
            }
        });
        let text: String = char::decode_utf16(units)
            .map(|c| c.unwrap_or(char::REPLACEMENT_CHARACTER))
            .collect();
        if text.contains(char::REPLACEMENT_CHARACTER) {
            return no_text("damaged UTF-16");
        }
        return Ok((Cow::Owned(text), None));
    }
    let bytes = bytes.strip_prefix(&[0xef, 0xbb, 0xbf]).unwrap_or(bytes);
    let control = |b: &&u8| {
        (**b < 0x20 && !b.is_ascii_whitespace() && **b != 0x1a && **b != 0x0b) || **b == 0x7f
    };
    let controls = bytes.iter().filter(control).count();
    if controls as f64 > CONTROL_MAX * bytes.len() as f64 {
        let at = bytes.iter().position(|b| control(&b)).unwrap_or(0);
        return no_text(&format!("byte {at} is a control character"));
    }
    match std::str::from_utf8(bytes) {
        Ok(text) => Ok((Cow::Borrowed(text), None)),
        Err(error) => {
            let line = bytes[..error.valid_up_to()]
                .iter()
                .filter(|b| **b == b'\n')
                .count()
                + 1;
            // Every byte is a character of Latin-1, and its code point is the byte.
            let text: String = bytes.iter().map(|b| char::from(*b)).collect();
            Ok((
                Cow::Owned(text),
                Some(format!("row {line} is not UTF-8: read as Latin-1")),
            ))
        }
    }
}
