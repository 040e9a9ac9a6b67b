//! The words behind a command's mnemonic, and what they may be.

use hysteron_core::signal::VOLT_FRACTION_BITS;
use hysteron_core::wave_table::POINT_FRACTION_BITS;

use crate::decimal::{billionths, to_fixed};
use crate::error_code::ErrorCode;

/// The words of a line that have not been taken yet.
#[derive(Clone, Debug)]
pub struct Words<'a> {
    rest: core::str::SplitAsciiWhitespace<'a>,
}

/// A whole number, decimal or hexadecimal with `0x`.
fn whole(word: &str) -> Option<u32> {
    match word.strip_prefix("0x").or_else(|| word.strip_prefix("0X")) {
        Some(digits) => u32::from_str_radix(digits, 16).ok(),
        None => word.parse().ok(),
    }
}

impl<'a> Words<'a> {
    /// Of a line.
    #[must_use]
    pub fn of(line: &'a str) -> Self {
        Self {
            rest: line.split_ascii_whitespace(),
        }
    }

    /// The next word, if there is one.
    pub fn optional(&mut self) -> Option<&'a str> {
        self.rest.next()
    }

    /// The next word.
    ///
    /// # Errors
    /// No word is left.
    pub fn word(&mut self) -> Result<&'a str, ErrorCode> {
        self.rest.next().ok_or(ErrorCode::Missing)
    }

    /// Whether there are more.
    #[must_use]
    pub fn more(&self) -> bool {
        self.rest.clone().next().is_some()
    }

    /// No word may be left.
    ///
    /// # Errors
    /// There is one.
    pub fn end(&mut self) -> Result<(), ErrorCode> {
        if self.more() {
            Err(ErrorCode::ParameterCount)
        } else {
            Ok(())
        }
    }

    /// A whole number.
    ///
    /// # Errors
    /// The word is missing or is no whole number.
    pub fn whole(&mut self) -> Result<u32, ErrorCode> {
        whole(self.word()?).ok_or(ErrorCode::Syntax)
    }

    /// The next word as a whole number, if there is one.
    ///
    /// # Errors
    /// The word is no whole number.
    pub fn optional_whole(&mut self) -> Result<Option<u32>, ErrorCode> {
        self.optional()
            .map(|word| whole(word).ok_or(ErrorCode::Syntax))
            .transpose()
    }

    /// `0` or `1`.
    ///
    /// # Errors
    /// The word is missing or is neither.
    pub fn switch(&mut self) -> Result<bool, ErrorCode> {
        match self.whole()? {
            0 => Ok(false),
            1 => Ok(true),
            _ => Err(ErrorCode::Range),
        }
    }

    /// A number, billionths.
    ///
    /// # Errors
    /// The word is missing or is no number.
    pub fn number(&mut self) -> Result<i64, ErrorCode> {
        billionths(self.word()?).ok_or(ErrorCode::Syntax)
    }

    /// A position, um with so many fraction bits; `beyond` if it has no room.
    ///
    /// # Errors
    /// The word is missing or is no number, or `beyond`.
    pub fn micrometres(&mut self, bits: u32, beyond: ErrorCode) -> Result<i32, ErrorCode> {
        to_fixed(self.number()?, bits).ok_or(beyond)
    }

    /// A drive, V with 22 fraction bits.
    ///
    /// # Errors
    /// The word is missing or is no number, or it has no room.
    pub fn volts(&mut self) -> Result<i32, ErrorCode> {
        to_fixed(self.number()?, VOLT_FRACTION_BITS).ok_or(ErrorCode::Voltage)
    }

    /// A point of a wave table, um or V.
    ///
    /// # Errors
    /// The word is missing or is no number, or it has no room.
    pub fn wave_point(&mut self) -> Result<i32, ErrorCode> {
        to_fixed(self.number()?, POINT_FRACTION_BITS).ok_or(ErrorCode::WaveLimit)
    }

    /// Whether the word `FAR` follows: the step is meant.
    ///
    /// # Errors
    /// Another word follows.
    pub fn far(&mut self) -> Result<bool, ErrorCode> {
        match self.optional() {
            None => Ok(false),
            Some(word) if word.eq_ignore_ascii_case("FAR") => Ok(true),
            Some(_) => Err(ErrorCode::ParameterCount),
        }
    }

    /// The one axis, channel or generator, `1`.
    ///
    /// # Errors
    /// The word is missing or names another one.
    pub fn axis(&mut self) -> Result<(), ErrorCode> {
        if self.word()? == "1" {
            Ok(())
        } else {
            Err(ErrorCode::Axis)
        }
    }

    /// The axis, one value and nothing more.
    ///
    /// # Errors
    /// The axis is missing or another one, the value is refused, or more follows.
    pub fn of_axis<T>(
        &mut self,
        value: impl FnOnce(&mut Self) -> Result<T, ErrorCode>,
    ) -> Result<T, ErrorCode> {
        self.axis()?;
        let value = value(self)?;
        self.end()?;
        Ok(value)
    }

    /// Of a query: the axis, or nothing, which means all of them.
    ///
    /// # Errors
    /// Another one is named, or more than one.
    pub fn queried_axis(&mut self) -> Result<(), ErrorCode> {
        if self.more() {
            self.axis()?;
        }
        self.end()
    }
}
