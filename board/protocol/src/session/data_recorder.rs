//! The data recorder: what it records, what starts it, and how it is read.

use core::fmt::Write;

use heapless::Vec;
use hysteron_core::trace_frame::TraceSample;

use super::{Pending, Piece, Quantity, Session, Step, Trigger, volts};
use crate::code_lines::{SAMPLES_IN_LINE, write_line};
use crate::data_array::{DataArray, MOST_COLUMNS};
use crate::decimal::{Decimal, ONE};
use crate::device::Device;
use crate::error_code::ErrorCode;
use crate::words::Words;

impl<D: Device + 'static> Session<D> {
    /// A table of the data recorder named by a word, from 0.
    pub(super) fn record_table(&self, words: &mut Words<'_>) -> Result<usize, ErrorCode> {
        let table = words.whole()?;
        if (1..=MOST_COLUMNS as u32).contains(&table) {
            Ok(table as usize - 1)
        } else {
            Err(ErrorCode::RecorderTable)
        }
    }

    pub(super) fn set_recorder(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        loop {
            let table = self.record_table(words)?;
            let _source = words.word()?;
            let quantity = match words.whole()? {
                0 => Quantity::Nothing,
                1 => Quantity::Target,
                2 => Quantity::Position,
                3 => Quantity::Error,
                7 => Quantity::Voltage,
                _ => return Err(ErrorCode::RecorderOption),
            };
            if let Some(place) = self.quantities.get_mut(table) {
                *place = quantity;
            }
            if !words.more() {
                return Ok(());
            }
        }
    }

    /// Says something of the tables that are asked for, or of all.
    pub(super) fn say_tables(
        &mut self,
        words: &mut Words<'_>,
        what: impl Fn(&Self, usize) -> (u32, Option<u32>),
    ) -> Result<(), ErrorCode> {
        let all = !words.more();
        for nth in 0..MOST_COLUMNS {
            let table = if all { nth } else { self.record_table(words)? };
            let (first, second) = what(self, table);
            match second {
                Some(second) => self.say(format_args!("{}={first} {second}", table + 1))?,
                None => self.say(format_args!("{}={first}", table + 1))?,
            }
            if !all && !words.more() {
                break;
            }
        }
        words.end()
    }

    pub(super) fn recorder(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        self.say_tables(words, |this, table| {
            (
                1,
                this.quantities.get(table).map(|quantity| *quantity as u32),
            )
        })
    }

    pub(super) fn recorded_points(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        let recorded = self.device.recorded();
        self.say_tables(words, |_, _| (recorded, None))
    }

    pub(super) fn trigger(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        self.say_tables(words, |this, _| (this.trigger as u32, Some(0)))
    }

    pub(super) fn set_trigger(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        loop {
            // One trigger serves all tables; 0 names them all.
            if words.whole()? > MOST_COLUMNS as u32 {
                return Err(ErrorCode::RecorderTable);
            }
            let trigger = match words.whole()? {
                0 => Trigger::Generator,
                1 => Trigger::Target,
                2 => Trigger::NextCommand,
                4 => Trigger::Immediately,
                _ => return Err(ErrorCode::RecorderOption),
            };
            let _value = words.optional();
            self.trigger = trigger;
            if !words.more() {
                break;
            }
        }
        if self.trigger == Trigger::Immediately {
            self.device.record(self.record_every);
        }
        Ok(())
    }

    pub(super) fn record_tables(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        words.end()?;
        self.say(format_args!("{MOST_COLUMNS}"))
    }

    pub(super) fn set_record_rate(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        let ticks = words.whole()?;
        words.end()?;
        if !(1..=0xffff).contains(&ticks) {
            return Err(ErrorCode::Range);
        }
        self.record_every = ticks;
        Ok(())
    }

    pub(super) fn record_rate(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        words.end()?;
        let ticks = self.record_every;
        self.say(format_args!("{ticks}"))
    }

    /// `[<start> <number> [{<table>}]]`; without anything, no table and no point yet.
    pub(super) fn read_array(
        &self,
        words: &mut Words<'_>,
        most_tables: usize,
        every_ticks: u32,
    ) -> Result<DataArray, ErrorCode> {
        let rate = i64::from(self.parameters.physical.sample_rate_hz.max(1));
        let sample_time = i64::from(every_ticks) * ONE / rate;
        let mut array = DataArray {
            tables: Vec::new(),
            first: 0,
            count: 0,
            sample_time,
            sent: 0,
        };
        if words.more() {
            array.first = words.whole()?.checked_sub(1).ok_or(ErrorCode::Range)?;
            array.count = words.whole()?;
        }
        while words.more() {
            let table = words.whole()?;
            if !(1..=most_tables as u32).contains(&table) {
                return Err(ErrorCode::RecorderTable);
            }
            array
                .tables
                .push(table as u8)
                .map_err(|_| ErrorCode::ParameterCount)?;
        }
        Ok(array)
    }

    pub(super) fn recorded_data(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        let asked = words.more();
        let mut array = self.read_array(words, MOST_COLUMNS, self.record_every)?;
        if array.tables.is_empty() {
            for (nth, _) in (1u8..)
                .zip(&self.quantities)
                .filter(|(_, quantity)| **quantity != Quantity::Nothing)
            {
                let _ = array.tables.push(nth);
            }
        }
        let recorded = self.device.recorded();
        if !asked {
            array.count = recorded;
        }
        if array.count == 0
            || array.tables.is_empty()
            || array.first.saturating_add(array.count) > recorded
        {
            return Err(ErrorCode::NotEnoughRecorded);
        }
        self.device.end_recording();
        self.pending = Pending::Recorded(array);
        Ok(())
    }

    /// `[<first> <number>]`: what was recorded, as codes.
    pub(super) fn recorded_codes(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        let recorded = self.device.recorded();
        let (first, count) = if words.more() {
            (
                words.whole()?.checked_sub(1).ok_or(ErrorCode::Range)?,
                words.whole()?,
            )
        } else {
            (0, recorded)
        };
        words.end()?;
        if count == 0 || first.saturating_add(count) > recorded {
            return Err(ErrorCode::NotEnoughRecorded);
        }
        self.device.end_recording();
        self.pending = Pending::Codes { first, count };
        Ok(())
    }

    /// The next line of codes.
    pub(super) fn send_codes(&mut self, first: u32, count: u32, piece: &mut Piece) -> Step {
        let here = count.min(SAMPLES_IN_LINE);
        let samples = (first..first.saturating_add(here)).map_while(|nth| self.device.sample(nth));
        let ends = if count > here { " \n" } else { "\n" };
        let written = write_line(samples, piece)
            .ok_or(core::fmt::Error)
            .and_then(|()| piece.write_str(ends));
        let rest = Pending::Codes {
            first: first.saturating_add(here),
            count: count - here,
        };
        self.sent(written, if count > here { rest } else { Pending::Nothing })
    }

    pub(super) fn recorded_value(&self, table: u8, nth: u32) -> Option<Decimal> {
        let quantity = self.quantities.get(usize::from(table).checked_sub(1)?)?;
        let sample: TraceSample = self.device.sample(nth)?;
        let c = self.converters(&self.device.view());
        let position = match self.parameters.stepping.get() {
            None => c.position(sample.adc_code),
            Some(_) => sample.applied,
        };
        Some(match quantity {
            Quantity::Nothing => Decimal {
                billionths: 0,
                digits: 6,
            },
            Quantity::Target => self.micrometres(sample.reference),
            Quantity::Position => self.micrometres(position),
            Quantity::Error => self.micrometres(sample.reference.saturating_sub(position)),
            Quantity::Voltage => volts(c.drive(sample.dac_code)),
        })
    }

    pub(super) fn recorded_name(&self, table: u8) -> &'static str {
        let quantity = usize::from(table)
            .checked_sub(1)
            .and_then(|table| self.quantities.get(table));
        match quantity {
            Some(Quantity::Target) => "Target position of axis AXIS:1",
            Some(Quantity::Position) => "Actual position of axis AXIS:1",
            Some(Quantity::Error) => "Position error of axis AXIS:1",
            Some(Quantity::Voltage) => "Voltage of output channel CHAN:1",
            _ => "Nothing is recorded",
        }
    }

    /// The next line of an array.
    pub(super) fn send_array(
        &mut self,
        mut array: DataArray,
        piece: &mut Piece,
        again: fn(DataArray) -> Pending,
        value: fn(&Self, u8, u32) -> Option<Decimal>,
        name: fn(&Self, u8) -> &'static str,
    ) -> Step {
        let written = if array.sent < array.header_lines() {
            array.write_header(piece, |table| name(self, table))
        } else if let Some(nth) = array.point() {
            self.write_row(&array, nth, piece, value)
        } else {
            return Step::Done;
        };
        array.sent += 1;
        let over = array.sent >= array.header_lines() && array.point().is_none();
        self.sent(written, if over { Pending::Nothing } else { again(array) })
    }

    pub(super) fn write_row(
        &self,
        array: &DataArray,
        nth: u32,
        piece: &mut Piece,
        value: fn(&Self, u8, u32) -> Option<Decimal>,
    ) -> core::fmt::Result {
        for (column, table) in array.tables.iter().enumerate() {
            let number = value(self, *table, nth).ok_or(core::fmt::Error)?;
            write!(piece, "{}{number}", if column == 0 { "" } else { " " })?;
        }
        let last = nth.saturating_add(1) >= array.first.saturating_add(array.count);
        piece.write_str(if last { "\n" } else { " \n" })
    }
}
