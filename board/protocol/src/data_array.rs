//! Columns of numbers as the GCS array format has them: a header of comments, then a line for each point.

use core::fmt::Write;

use heapless::Vec;

use crate::decimal::Decimal;

/// Most columns.
pub const MOST_COLUMNS: usize = 4;

/// One that is being sent.
#[derive(Clone, Debug)]
pub struct DataArray {
    /// The tables, from 1.
    pub tables: Vec<u8, MOST_COLUMNS>,
    /// Its first point, from 0.
    pub first: u32,
    /// Its points.
    pub count: u32,
    /// Time from point to point, billionths of a second.
    pub sample_time: i64,
    /// Lines sent.
    pub sent: u32,
}

/// Lines of the header that do not name a column, in front of those that do.
const FIXED_LINES: u32 = 7;

impl DataArray {
    /// Lines of the header.
    #[must_use]
    pub fn header_lines(&self) -> u32 {
        FIXED_LINES + self.tables.len() as u32 + 1
    }

    /// The point that the next line has, once the header is sent; `None` behind the last.
    #[must_use]
    pub fn point(&self) -> Option<u32> {
        let nth = self.sent.checked_sub(self.header_lines())?;
        (nth < self.count).then_some(self.first.saturating_add(nth))
    }

    /// A line of the header; `name` is that of a table.
    pub fn write_header(
        &self,
        to: &mut impl Write,
        name: impl Fn(u8) -> &'static str,
    ) -> core::fmt::Result {
        match self.sent {
            0 => write!(to, "# REM Hysteron"),
            1 => write!(to, "# VERSION = 1"),
            2 => write!(to, "# TYPE = 1"),
            3 => write!(to, "# SEPARATOR = 32"),
            4 => write!(to, "# DIM = {}", self.tables.len()),
            5 => write!(
                to,
                "# SAMPLE_TIME = {}",
                Decimal {
                    billionths: self.sample_time,
                    digits: 9
                }
            ),
            6 => write!(to, "# NDATA = {}", self.count),
            nth => match self.tables.get(nth.saturating_sub(FIXED_LINES) as usize) {
                Some(table) => write!(to, "# NAME{} = {}", nth - FIXED_LINES, name(*table)),
                None => write!(to, "# END_HEADER"),
            },
        }?;
        to.write_str(" \n")
    }
}
