//! Wave tables and the generator that plays them.

use core::sync::atomic::{AtomicI32, Ordering};

use hysteron_core::amplifier_command::{Command, ENDLESS_TICKS};
use hysteron_core::reference_generator::Waveform;
use hysteron_core::signal::{MICROMETRE_FRACTION_BITS, Micrometres, Quantity, Volts};
use hysteron_core::wave_table::{POINT_FRACTION_BITS, WaveTable};

use super::{Meaning, Pending, Session, Step, Trigger, WAVE_TABLES, WaveQuantity};
use crate::decimal::{Decimal, from_fixed};
use crate::device::Device;
use crate::error_code::ErrorCode;
use crate::waveform::{Segment, Shape};
use crate::words::Words;

/// Points of a waveform that are computed in one piece of work.
const POINTS_AT_ONCE: u32 = 32;

impl<D: Device + 'static> Session<D> {
    /// A wave table named by a word, from 0.
    pub(super) fn table(&self, words: &mut Words<'_>) -> Result<usize, ErrorCode> {
        let table = words.whole()?;
        if (1..=WAVE_TABLES as u32).contains(&table) {
            Ok(table as usize - 1)
        } else {
            Err(ErrorCode::Range)
        }
    }

    pub(super) fn points_of(&self, table: usize) -> &'static [AtomicI32] {
        let most = self.wave_points();
        self.waves
            .get(table * most..(table + 1) * most)
            .unwrap_or(&[])
    }

    /// Points for which a table has room.
    pub(super) fn wave_points(&self) -> usize {
        self.waves.len() / WAVE_TABLES
    }

    pub(super) fn length_of(&self, table: usize) -> u32 {
        self.wave_lengths.get(table).copied().unwrap_or(0)
    }

    pub(super) fn set_length(&mut self, table: usize, length: usize) {
        if let Some(place) = self.wave_lengths.get_mut(table) {
            *place = length as u32;
        }
    }

    /// Not while the table is played.
    pub(super) fn may_change(&self, table: usize) -> Result<(), ErrorCode> {
        if self.runs() && self.wave_selected as usize == table + 1 {
            Err(ErrorCode::GeneratorRuns)
        } else {
            Ok(())
        }
    }

    pub(super) fn define_wave(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        let table = self.table(words)?;
        self.may_change(table)?;
        let at = match words.word()? {
            "X" | "x" => 0,
            "&" => self.length_of(table) as usize,
            _ => return Err(ErrorCode::Syntax),
        };
        let shape = match words.word()? {
            "PNT" | "pnt" => return self.define_points(table, at, words),
            "SIN_P" | "sin_p" => Shape::Sine,
            "RAMP" | "ramp" => Shape::Ramp,
            "LIN" | "lin" => Shape::Line,
            _ => return Err(ErrorCode::WaveType),
        };
        let segment = read_segment(shape, words)?;
        if !segment.is_consistent() {
            return Err(ErrorCode::WaveLimit);
        }
        if at + segment.length as usize > self.wave_points() {
            return Err(ErrorCode::WaveTooLong);
        }
        let end = segment
            .offset
            .checked_add(segment.amplitude)
            .ok_or(ErrorCode::WaveLimit)?;
        let quantity = self.quantity_for(table, at);
        if !self.can_be_played(quantity, segment.offset) || !self.can_be_played(quantity, end) {
            return Err(ErrorCode::WaveLimit);
        }
        self.set_quantity(table, quantity);
        self.pending = Pending::Build {
            table,
            at,
            segment,
            done: 0,
        };
        Ok(())
    }

    /// Points from the line: their place in the segment, their number, and themselves.
    pub(super) fn define_points(
        &mut self,
        table: usize,
        at: usize,
        words: &mut Words<'_>,
    ) -> Result<(), ErrorCode> {
        let missing = |error| {
            if error == ErrorCode::Missing {
                ErrorCode::WaveParameters
            } else {
                error
            }
        };
        let first = words.whole().map_err(missing)? as usize;
        let count = words.whole().map_err(missing)? as usize;
        // The start point counts in the segment; behind `&` others count in the table, which is the same
        // place.
        let begin = if at == 0 {
            first.checked_sub(1).ok_or(ErrorCode::WaveIndex)?
        } else {
            at
        };
        let end = begin
            .checked_add(count)
            .filter(|end| *end <= self.wave_points())
            .ok_or(ErrorCode::WaveTooLong)?;
        let (mut given, quantity) = (words.clone(), self.quantity_for(table, begin));
        for _ in 0..count {
            let point = given.wave_point().map_err(missing)?;
            if !self.can_be_played(quantity, point) {
                return Err(ErrorCode::WaveLimit);
            }
        }
        given.end().map_err(|_| ErrorCode::WaveParameters)?;
        for place in self.points_of(table).get(begin..end).unwrap_or(&[]) {
            place.store(words.wave_point()?, Ordering::Relaxed);
        }
        self.set_quantity(table, quantity);
        self.set_length(table, end);
        Ok(())
    }

    /// Some points of a segment.
    pub(super) fn build(&mut self, table: usize, at: usize, segment: Segment, done: u32) -> Step {
        let until = (done + POINTS_AT_ONCE).min(segment.length);
        let places = self.points_of(table);
        for nth in done..until {
            if let Some(place) = places.get(at + nth as usize) {
                place.store(segment.point(nth), Ordering::Relaxed);
            }
        }
        if until == segment.length {
            self.set_length(table, at + segment.length as usize);
        } else {
            self.pending = Pending::Build {
                table,
                at,
                segment,
                done: until,
            };
        }
        Step::Work
    }

    pub(super) fn wave_length(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        let all = !words.more();
        let wanted = if all {
            0..WAVE_TABLES
        } else {
            self.table(words).map(|table| table..table + 1)?
        };
        if words
            .optional_whole()?
            .is_some_and(|parameter| parameter != 1)
        {
            return Err(ErrorCode::Range);
        }
        words.end()?;
        for table in wanted {
            let length = self.length_of(table);
            self.say(format_args!("{} 1={length}.0", table + 1))?;
        }
        Ok(())
    }

    pub(super) fn clear_wave(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        loop {
            let table = self.table(words)?;
            self.may_change(table)?;
            self.set_length(table, 0);
            if !words.more() {
                return Ok(());
            }
        }
    }

    pub(super) fn select_wave(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        let table = words.of_axis(Words::whole)?;
        if table as usize > WAVE_TABLES {
            return Err(ErrorCode::Range);
        }
        if self.runs() {
            return Err(ErrorCode::GeneratorRuns);
        }
        self.wave_selected = table;
        Ok(())
    }

    pub(super) fn selected_wave(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        let table = self.wave_selected;
        self.say_axis(words, table)
    }

    pub(super) fn set_cycles(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        let cycles = words.of_axis(Words::whole)?;
        self.wave_cycles = cycles;
        Ok(())
    }

    pub(super) fn cycles(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        let cycles = self.wave_cycles;
        self.say_axis(words, cycles)
    }

    pub(super) fn set_wave_rate(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        // Generator 0 means all of them.
        if words.whole()? > 1 {
            return Err(ErrorCode::Axis);
        }
        let (rate, joined) = (words.whole()?, words.switch()?);
        words.end()?;
        if !(1..=0xffff).contains(&rate) {
            return Err(ErrorCode::Range);
        }
        (self.wave_rate, self.wave_joined) = (rate, joined);
        Ok(())
    }

    pub(super) fn wave_rate(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        let (rate, joined) = (self.wave_rate, u8::from(self.wave_joined));
        self.say_axis(words, format_args!("{rate} {joined}"))
    }

    pub(super) fn generate(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        let mode = words.of_axis(Words::whole)?;
        match mode {
            0 => {
                if self.runs() && self.closed() {
                    self.stay();
                } else if self.runs() {
                    self.command(
                        Command::Disable,
                        None,
                        Meaning::Drive {
                            drive: None,
                            ticks: 0,
                        },
                    );
                }
                Ok(())
            }
            1 => self.start_generator(),
            _ => Err(ErrorCode::GeneratorMode),
        }
    }

    /// Whether a point lies within the range of positions.
    fn is_position(&self, point: i32) -> bool {
        point
            .checked_mul(1 << (MICROMETRE_FRACTION_BITS - POINT_FRACTION_BITS))
            .is_some_and(|position| self.is_within_range(position))
    }

    /// What a table holds once points are written to it from `at` on: what it has already, or from its
    /// beginning on what the servo plays now.
    fn quantity_for(&self, table: usize, at: usize) -> WaveQuantity {
        let has = self
            .wave_quantities
            .get(table)
            .copied()
            .filter(|_| at > 0 && self.length_of(table) > 0);
        has.unwrap_or(if self.closed() {
            WaveQuantity::Position
        } else {
            WaveQuantity::Drive
        })
    }

    fn set_quantity(&mut self, table: usize, quantity: WaveQuantity) {
        if let Some(place) = self.wave_quantities.get_mut(table) {
            *place = quantity;
        }
    }

    /// Whether a point lies within the limits of its quantity.
    fn can_be_played(&self, quantity: WaveQuantity, point: i32) -> bool {
        match quantity {
            WaveQuantity::Position => self.is_position(point),
            WaveQuantity::Drive => self.is_drive(point),
        }
    }

    /// Plays positions with the servo on, and drives from rest with the servo off.
    fn start_generator(&mut self) -> Result<(), ErrorCode> {
        let table = (self.wave_selected as usize)
            .checked_sub(1)
            .ok_or(ErrorCode::NoWaveSelected)?;
        let length = self.length_of(table);
        let points = self.points_of(table).get(..length as usize).unwrap_or(&[]);
        let last = points
            .last()
            .ok_or(ErrorCode::WaveNotDefined)?
            .load(Ordering::Relaxed);
        let closed = self.closed();
        let quantity = self.quantity_for(table, 1);
        if (quantity == WaveQuantity::Position) != closed {
            return Err(ErrorCode::WaveLimit);
        }
        let within =
            |point: &AtomicI32| self.can_be_played(quantity, point.load(Ordering::Relaxed));
        if !points.iter().all(within) {
            return Err(ErrorCode::WaveLimit);
        }
        let all = u64::from(length) * u64::from(self.wave_rate) * u64::from(self.wave_cycles);
        let ticks = u32::try_from(all)
            .ok()
            .filter(|ticks| *ticks < 1 << 31)
            .ok_or(ErrorCode::Range)?;
        if matches!(self.trigger, Trigger::Generator | Trigger::Target) {
            self.device.record_from_command(self.record_every);
        }
        let ends_after = (self.wave_cycles > 0).then_some(ticks);
        if closed {
            let last = last << (MICROMETRE_FRACTION_BITS - POINT_FRACTION_BITS);
            let waveform = Waveform::Table(self.as_played(points));
            self.command(
                Command::Reference {
                    waveform,
                    offset: Micrometres::from_bits(0),
                },
                None,
                Meaning::Wave {
                    last,
                    ticks: ends_after,
                },
            );
        } else {
            let (waveform, ticks) = (
                Waveform::Table(self.as_played(points)),
                ends_after.unwrap_or(ENDLESS_TICKS),
            );
            self.command(
                Command::Play {
                    waveform,
                    offset: Volts::from_bits(0),
                    ticks,
                },
                None,
                Meaning::DriveWave { ticks: ends_after },
            );
        }
        Ok(())
    }

    fn as_played<Q: Quantity>(&self, points: &'static [AtomicI32]) -> WaveTable<Q> {
        WaveTable::new(points, self.wave_rate, self.wave_joined, self.wave_cycles)
            .marking(self.trigger_point)
    }

    /// One line and one point of it, which counts from the next start of the generator on.
    pub(super) fn set_trigger_point(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        let (line, point, high) = (words.whole()?, words.whole()?, words.switch()?);
        words.end()?;
        if line != 1 || point == 0 || point as usize > self.wave_points() {
            return Err(ErrorCode::Range);
        }
        if high {
            self.trigger_point = point;
        } else if self.trigger_point == point {
            self.trigger_point = 0;
        }
        Ok(())
    }

    pub(super) fn clear_trigger_point(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        words.end()?;
        self.trigger_point = 0;
        Ok(())
    }

    pub(super) fn trigger_point(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        let point = self.trigger_point;
        self.say_axis(words, point)
    }

    pub(super) fn generates(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        let runs = u8::from(self.runs());
        self.say_axis(words, runs)
    }

    pub(super) fn wave_generators(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        words.end()?;
        self.say(format_args!("1"))
    }

    pub(super) fn wave_data(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        let asked = words.more();
        let mut array = self.read_array(words, WAVE_TABLES, self.wave_rate)?;
        if array.tables.is_empty() {
            for (nth, _) in (1u8..)
                .zip(&self.wave_lengths)
                .filter(|(_, length)| **length > 0)
            {
                let _ = array.tables.push(nth);
            }
        }
        let shortest = array
            .tables
            .iter()
            .map(|table| self.length_of(usize::from(*table) - 1))
            .min()
            .unwrap_or(0);
        if !asked {
            array.count = shortest;
        }
        if array.count == 0 || array.first.saturating_add(array.count) > shortest {
            return Err(ErrorCode::WaveIndex);
        }
        self.pending = Pending::Wave(array);
        Ok(())
    }

    pub(super) fn wave_value(&self, table: u8, nth: u32) -> Option<Decimal> {
        let point = self
            .points_of(usize::from(table).checked_sub(1)?)
            .get(nth as usize)?;
        Some(Decimal {
            billionths: from_fixed(point.load(Ordering::Relaxed), POINT_FRACTION_BITS),
            digits: 6,
        })
    }
}

/// `<segment length> <amplitude> <offset> <curve length> <start point>`, then what the shape needs.
fn read_segment(shape: Shape, words: &mut Words<'_>) -> Result<Segment, ErrorCode> {
    let mut read = || -> Result<Segment, ErrorCode> {
        let length = words.whole()?;
        let (amplitude, offset) = (words.wave_point()?, words.wave_point()?);
        let (curve_length, start) = (words.whole()?, words.whole()?);
        let speed_up = if shape == Shape::Sine {
            0
        } else {
            words.whole()?
        };
        let centre = if shape == Shape::Line {
            curve_length
        } else {
            words.whole()?
        };
        Ok(Segment {
            shape,
            length,
            start,
            curve_length,
            centre,
            speed_up,
            amplitude,
            offset,
        })
    };
    let segment = read().map_err(|error| {
        if error == ErrorCode::Missing {
            ErrorCode::WaveParameters
        } else {
            error
        }
    })?;
    words.end().map_err(|_| ErrorCode::WaveParameters)?;
    Ok(segment)
}
