//! A conversation: lines in, answers and commands out.
//!
//! # How it works
//! [`Session::obey`] looks the mnemonic up in the table of commands and leaves what follows in `pending`;
//! [`Session::next`] takes it from there piece by piece. A command for the amplifier may be refused; only
//! when [`Session::outcome`] says that it acted does the session take note of a new target. What is wrong
//! with a line is kept for `ERR?` and answered with nothing, as the protocol has it.
//!
//! # Where it differs from other controllers
//! * `STP` and `#24` bring the drive to rest, servo off: they take the path that nothing delays. `HLT` stays
//!   where it is, servo on.
//! * Nothing moves before `ARM`: 1 switches the amplifier on and shows by a small step that the sensor
//!   follows, 2 leaves the step out, 0 goes to rest and switches off. A fault and a start disarm.
//! * `SVO 1 1` wants an `ATZ` since the start or the last fault; `RON 1 0` waives it, as it waives a
//!   reference move elsewhere.
//! * `SVO 1 0` holds the drive that is there, which `SVA` then changes no faster than the block's ramp.
//! * Any line may end in its checksum ([`crate::seal`]). A step that is larger than the operator allows
//!   (`SPA` 0x7F00000B, 0x7F00000C) wants `FAR` behind it.
//! * A move is a smooth step (a quintic) whose fastest velocity is that of `VEL`. A stick-slip drive follows
//!   a target of that velocity by teeth, and its positions are those of the travel.
//! * A wave that is defined with the servo on is one of positions, um, and is played with the servo on; one
//!   that is defined with the servo off is one of drives, V, and is played from rest with the servo off, and
//!   goes to rest when it has ended.
//! * `SPA` of a filter acts in any mode, without a step; `WPA 100` keeps the settings at rest (`BLK?` says
//!   when).
//! * The data recorder writes all its tables at the same ticks; `DRC` chooses what is read from each.

mod amplifier_state;
mod axis_parameters;
mod command_table;
mod data_recorder;
mod diagnosis;
mod filters;
mod firmware_update;
mod motion;
mod parameter_block;
mod queries;
mod wave_generator;

use core::fmt::Write;
use core::sync::atomic::AtomicI32;

use heapless::Vec;
use hysteron_core::amplifier_command::{Command, Refusal};
use hysteron_core::filter_design::FilterSetting;
use hysteron_core::parameter_block::AmplifierParameters;
use hysteron_core::reference_window::PREVIEW_TICKS;
use hysteron_core::signal::{MICROMETRE_FRACTION_BITS, TRAVEL_FRACTION_BITS, VOLT_FRACTION_BITS};

use crate::data_array::{DataArray, MOST_COLUMNS};
use crate::decimal::{Decimal, from_fixed, to_fixed};
use crate::device::Device;
use crate::error_code::ErrorCode;
use crate::parameters::DeviceParameter;
use crate::waveform::Segment;
use crate::words::Words;
use crate::{IS_GENERATING, IS_MOVING, IS_READY, help, seal};

/// Most bytes of a piece.
pub const PIECE_BYTES: usize = 512;
/// A piece of an answer.
pub type Piece = Vec<u8, PIECE_BYTES>;

/// Wave tables.
pub const WAVE_TABLES: usize = 4;

/// Channel of the analogue set point.
const SET_POINT_CHANNEL: u32 = 3;

/// What is to be done next.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Step {
    /// Nothing: the line is done with.
    Done,
    /// Send the piece.
    Send,
    /// Give this to the amplifier and say what became of it ([`Session::outcome`]).
    Command(Command),
    /// A piece of work was done and there is more: let others have their turn.
    Work,
}

/// What became of a command.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// It acted at this tick.
    Done(u32),
    /// The amplifier refused it.
    Refused(Refusal),
    /// It could not be given: too many wait.
    NoRoom,
    /// The amplifier was stopped meanwhile.
    Stopped,
}

/// What a command that acted means for the session.
#[derive(Clone, Copy, Debug)]
enum Meaning {
    /// The axis is on its way from one position to another for so many ticks.
    Move { from: i32, target: i32, ticks: u32 },
    /// The drive is on its way to `drive`, V with 22 fraction bits, for so many ticks.
    Drive { drive: Option<i32>, ticks: u32 },
    /// A conditioning or a self-test has begun, or nothing is under way any more.
    Conditioning,
    /// Nothing is under way that was not before.
    Nothing,
    /// The wave generator has begun; it ends on `last` after so many ticks (`None`: never).
    Wave { last: i32, ticks: Option<u32> },
    /// The wave generator plays a drive, for so many ticks (`None`: until it is stopped), and goes to rest
    /// then.
    DriveWave { ticks: Option<u32> },
}

/// What follows from the line that was obeyed.
#[derive(Clone, Debug)]
enum Pending {
    Nothing,
    Text,
    Help(usize),
    ParameterHelp(usize),
    Parameters(usize),
    RecorderHelp(usize),
    DiagnosisHelp(usize),
    Events(u32),
    Update(firmware_update::UpdateStep),
    Recorded(DataArray),
    Codes {
        first: u32,
        count: u32,
    },
    Wave(DataArray),
    Build {
        table: usize,
        at: usize,
        segment: Segment,
        done: u32,
    },
    Commands {
        first: Command,
        then: Option<Command>,
        meaning: Meaning,
    },
    /// Filters that the amplifier is given section by section: a bit for each that is left.
    Filters {
        left: u8,
        new: [FilterSetting; 2],
    },
}

/// Whether the wave generator runs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Generator {
    Off,
    Endless,
    /// Until a tick.
    Until(u64),
}

/// What the points of a wave table are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum WaveQuantity {
    /// um, for the closed loop.
    Position,
    /// V, for the open one.
    Drive,
}

/// What starts the data recorder.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Trigger {
    Generator = 0,
    Target = 1,
    NextCommand = 2,
    Immediately = 4,
}

/// What a table of the data recorder shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Quantity {
    Nothing = 0,
    Target = 1,
    Position = 2,
    Error = 3,
    Voltage = 7,
}

/// A conversation over one line.
pub struct Session<D> {
    device: D,
    parameters: AmplifierParameters,
    waves: &'static [AtomicI32],
    error: u16,
    text: Piece,
    pending: Pending,
    target: i32,
    /// Where the way to the target began.
    from: i32,
    drive: i32,
    moving_until: Option<u64>,
    /// um/s with 24 fraction bits.
    velocity: i64,
    tolerance: i32,
    /// Steps of `MOV` and `MVR`, um, and of `SVA`, V, that are larger need a second word; 0: none does.
    largest_move: i32,
    largest_drive_step: i32,
    settling_ticks: u32,
    wave_lengths: [u32; WAVE_TABLES],
    wave_quantities: [WaveQuantity; WAVE_TABLES],
    wave_selected: u32,
    wave_cycles: u32,
    wave_rate: u32,
    wave_joined: bool,
    /// The point, from 1, with which the trigger output is high; 0: none.
    trigger_point: u32,
    generator: Generator,
    record_every: u32,
    quantities: [Quantity; MOST_COLUMNS],
    trigger: Trigger,
    /// Of set point and sensor, as the amplifier has them.
    filters: [FilterSetting; 2],
}

type Handler<D> = fn(&mut Session<D>, &mut Words<'_>) -> Result<(), ErrorCode>;

/// A number of volts as it is written.
fn volts(value: i32) -> Decimal {
    Decimal {
        billionths: from_fixed(value, VOLT_FRACTION_BITS),
        digits: 6,
    }
}

impl<D: Device + 'static> Session<D> {
    /// For an amplifier with these parameters; `waves` is the memory of the wave tables, of which each of
    /// [`WAVE_TABLES`] has the same share.
    pub fn new(device: D, parameters: AmplifierParameters, waves: &'static [AtomicI32]) -> Self {
        let span = to_fixed(
            i64::from(parameters.physical.sensor_span_nm) * 1_000_000,
            MICROMETRE_FRACTION_BITS,
        )
        .unwrap_or(0);
        let (span, rate) = (i64::from(span), parameters.physical.sample_rate_hz);
        let (tolerance, velocity) = match parameters.stepping.get() {
            // A thousandth of the span, and ten times the span in a second.
            None => ((span / 1000).max(1) as i32, span * 10),
            // As fast as the teeth are.
            Some(stepping) => (stepping.tolerance.to_bits(), span * i64::from(rate)),
        };
        let mut this = Self {
            device,
            waves,
            error: 0,
            text: Piece::new(),
            pending: Pending::Nothing,
            target: 0,
            from: 0,
            drive: 0,
            moving_until: None,
            velocity,
            tolerance,
            largest_move: 0,
            largest_drive_step: 0,
            // 5 ms
            settling_ticks: rate / 200,
            wave_lengths: [0; WAVE_TABLES],
            wave_quantities: [WaveQuantity::Position; WAVE_TABLES],
            wave_selected: 0,
            wave_cycles: 0,
            wave_rate: 1,
            wave_joined: false,
            trigger_point: 0,
            generator: Generator::Off,
            record_every: 1,
            quantities: [
                Quantity::Target,
                Quantity::Position,
                Quantity::Error,
                Quantity::Voltage,
            ],
            trigger: Trigger::Generator,
            filters: [FilterSetting::OFF; 2],
            parameters,
        };
        this.take_kept_settings();
        this.device.set_tolerance(this.tolerance);
        this
    }

    /// Fraction bits of positions: those along a travel are longer.
    fn position_bits(&self) -> u32 {
        match self.parameters.stepping.get() {
            None => MICROMETRE_FRACTION_BITS,
            Some(_) => TRAVEL_FRACTION_BITS,
        }
    }

    /// A position as it is written, um.
    fn micrometres(&self, value: i32) -> Decimal {
        Decimal {
            billionths: from_fixed(value, self.position_bits()),
            digits: 6,
        }
    }

    /// Takes a line that has come; `before_stop`: a stop came after it, and it changes nothing any more.
    pub fn obey(&mut self, line: &[u8], before_stop: bool) {
        self.text.clear();
        self.pending = Pending::Nothing;
        if let Err(error) = self.understand(line, before_stop) {
            self.error = error as u16;
            self.text.clear();
            self.pending = Pending::Nothing;
        }
        if matches!(self.pending, Pending::Nothing) && !self.text.is_empty() {
            let _ = self.text.push(b'\n');
            self.pending = Pending::Text;
        }
    }

    /// A line was longer than there is room for.
    pub fn too_long(&mut self) {
        self.error = ErrorCode::TooLong as u16;
    }

    /// Bytes of a line were lost on their way, and with them the line.
    pub fn lost_bytes(&mut self) {
        self.error = ErrorCode::LostBytes as u16;
    }

    /// Lines came for which there was no room.
    pub fn overrun(&mut self) {
        self.error = ErrorCode::Overrun as u16;
    }

    fn understand(&mut self, line: &[u8], before_stop: bool) -> Result<(), ErrorCode> {
        if let [byte] = line {
            return self.single_byte(*byte);
        }
        let line = core::str::from_utf8(line).map_err(|_| ErrorCode::UnknownCommand)?;
        let mut words = Words::of(seal::opened(line)?);
        let mnemonic = words.word()?;
        let found = Self::COMMANDS
            .iter()
            .find(|(name, _, _)| name.eq_ignore_ascii_case(mnemonic));
        let (name, _, handler) = found.ok_or(ErrorCode::UnknownCommand)?;
        if before_stop && !name.ends_with('?') {
            return Ok(());
        }
        if self.trigger == Trigger::NextCommand && *name != "DRT" {
            self.trigger = Trigger::Generator;
            self.device.record(self.record_every);
        }
        handler(self, &mut words)
    }

    fn single_byte(&mut self, byte: u8) -> Result<(), ErrorCode> {
        match byte {
            IS_MOVING => {
                let moving = u8::from(self.moves());
                self.say(format_args!("{moving}"))
            }
            IS_GENERATING => {
                let generates = u8::from(self.runs());
                self.say(format_args!("{generates}"))
            }
            IS_READY => {
                let ready = if self.is_ready() { 0xB1 } else { 0xB0 };
                self.text.push(ready).map_err(|_| ErrorCode::AnswerTooLong)
            }
            hysteron_core::command_lines::STOP_BYTE => self.stopped(&mut Words::of("")),
            _ => Err(ErrorCode::UnknownCommand),
        }
    }

    /// Another line of the answer.
    fn say(&mut self, text: core::fmt::Arguments<'_>) -> Result<(), ErrorCode> {
        if !self.text.is_empty() {
            self.text
                .extend_from_slice(b" \n")
                .map_err(|_| ErrorCode::AnswerTooLong)?;
        }
        self.text
            .write_fmt(text)
            .map_err(|_| ErrorCode::AnswerTooLong)
    }

    /// Says one value of the axis.
    fn say_axis(
        &mut self,
        words: &mut Words<'_>,
        value: impl core::fmt::Display,
    ) -> Result<(), ErrorCode> {
        words.queried_axis()?;
        self.say(format_args!("1={value}"))
    }

    /// What is to be done next; text to send goes into `piece`.
    pub fn next(&mut self, piece: &mut Piece) -> Step {
        piece.clear();
        match core::mem::replace(&mut self.pending, Pending::Nothing) {
            Pending::Nothing => Step::Done,
            Pending::Text => {
                core::mem::swap(piece, &mut self.text);
                Step::Send
            }
            Pending::Help(nth) => {
                let of_bytes = Self::SINGLE_BYTES.len();
                let entry = nth.checked_sub(1).and_then(|nth| {
                    let command = || {
                        Self::COMMANDS
                            .get(nth - of_bytes)
                            .map(|(name, what, _)| (*name, *what))
                    };
                    if nth < of_bytes {
                        Self::SINGLE_BYTES.get(nth).copied()
                    } else {
                        command()
                    }
                });
                let written = match (nth, entry) {
                    (0, _) => writeln!(piece, "{} ", help::COMMANDS),
                    (_, Some((name, what))) => writeln!(piece, "{name} - {what} "),
                    _ => writeln!(piece, "{}", help::END),
                };
                self.sent(
                    written,
                    if nth > 0 && entry.is_none() {
                        Pending::Nothing
                    } else {
                        Pending::Help(nth + 1)
                    },
                )
            }
            Pending::ParameterHelp(nth) => {
                let entry = nth
                    .checked_sub(1)
                    .and_then(|nth| DeviceParameter::ALL.get(nth));
                let written = match (nth, entry) {
                    (0, _) => writeln!(piece, "{} ", help::PARAMETERS),
                    (_, Some((_, number, kind, what))) => {
                        writeln!(piece, "{number:#x}=\t0\t1\t{kind}\tHysteron\t{what} ")
                    }
                    _ => writeln!(piece, "{}", help::END),
                };
                self.sent(
                    written,
                    if nth > 0 && entry.is_none() {
                        Pending::Nothing
                    } else {
                        Pending::ParameterHelp(nth + 1)
                    },
                )
            }
            Pending::Parameters(nth) => self.next_parameter(nth, piece),
            Pending::DiagnosisHelp(nth) => {
                let entry = nth.checked_sub(1).and_then(|at| help::DIAGNOSIS.get(at));
                let written = match (nth, entry) {
                    (0, _) => writeln!(piece, "{} ", help::DIAGNOSIS_HEAD),
                    (_, Some(what)) => writeln!(piece, "{nth}={what} "),
                    _ => writeln!(piece, "{}", help::END),
                };
                self.sent(
                    written,
                    if nth > 0 && entry.is_none() {
                        Pending::Nothing
                    } else {
                        Pending::DiagnosisHelp(nth + 1)
                    },
                )
            }
            Pending::RecorderHelp(nth) => {
                let line = help::RECORDER.get(nth).copied().unwrap_or(help::END);
                let last = nth + 1 >= help::RECORDER.len();
                let written = writeln!(piece, "{line}{}", if last { "" } else { " " });
                self.sent(
                    written,
                    if last {
                        Pending::Nothing
                    } else {
                        Pending::RecorderHelp(nth + 1)
                    },
                )
            }
            Pending::Events(nth) => self.next_event(nth, piece),
            Pending::Update(step) => self.next_of_update(step),
            Pending::Recorded(array) => self.send_array(
                array,
                piece,
                Pending::Recorded,
                Self::recorded_value,
                Self::recorded_name,
            ),
            Pending::Codes { first, count } => self.send_codes(first, count, piece),
            Pending::Wave(array) => self.send_array(
                array,
                piece,
                Pending::Wave,
                Self::wave_value,
                |_, _| "Wave table",
            ),
            Pending::Build {
                table,
                at,
                segment,
                done,
            } => self.build(table, at, segment, done),
            Pending::Commands {
                first,
                then,
                meaning,
            } => {
                self.pending = Pending::Commands {
                    first,
                    then,
                    meaning,
                };
                Step::Command(first)
            }
            Pending::Filters { left, new } => self.next_filter(left, new),
        }
    }

    /// A piece was written; `then` follows.
    fn sent(&mut self, written: core::fmt::Result, then: Pending) -> Step {
        if written.is_err() {
            self.error = ErrorCode::AnswerTooLong as u16;
            return Step::Done;
        }
        self.pending = then;
        Step::Send
    }

    /// Says what became of the command that [`Session::next`] gave.
    pub fn outcome(&mut self, outcome: Outcome) {
        let (then, meaning) = match core::mem::replace(&mut self.pending, Pending::Nothing) {
            Pending::Commands { then, meaning, .. } => (then, meaning),
            Pending::Filters { left, new } if matches!(outcome, Outcome::Done(_)) => {
                return self.filter_acted(left, new);
            }
            Pending::Filters { .. } => (None, Meaning::Nothing),
            _ => return,
        };
        match (outcome, then) {
            (Outcome::Done(_), Some(first)) => {
                self.pending = Pending::Commands {
                    first,
                    then: None,
                    meaning,
                }
            }
            (Outcome::Done(tick), None) => self.take_note(tick, meaning),
            (Outcome::Refused(refusal), _) => {
                self.error = ErrorCode::of_refusal(refusal, self.device.view().fault) as u16
            }
            (Outcome::NoRoom, _) => self.error = ErrorCode::Overrun as u16,
            // The stop itself is answered in its turn.
            (Outcome::Stopped, _) => {}
        }
    }

    fn take_note(&mut self, tick: u32, meaning: Meaning) {
        // The lowest 32 bits of a tick that is near.
        let now = self.device.view().tick;
        let tick = now.saturating_add_signed(i64::from(tick.wrapping_sub(now as u32) as i32));
        // The reference counts some ticks after it was generated.
        let until = |ticks: u32| tick + u64::from(ticks) + PREVIEW_TICKS as u64 + 1;
        match meaning {
            Meaning::Nothing => {}
            Meaning::Conditioning => {
                self.generator = Generator::Off;
                self.moving_until = None;
            }
            Meaning::Move {
                from,
                target,
                ticks,
            } => {
                (self.from, self.target) = (from, target);
                self.generator = Generator::Off;
                self.moving_until = Some(until(ticks));
            }
            Meaning::Drive { drive, ticks } => {
                self.drive = drive.unwrap_or(self.drive);
                self.generator = Generator::Off;
                self.moving_until = Some(until(ticks));
            }
            Meaning::Wave { last, ticks } => {
                (self.from, self.target) = (last, last);
                self.generator =
                    ticks.map_or(Generator::Endless, |ticks| Generator::Until(until(ticks)));
                self.moving_until = None;
            }
            Meaning::DriveWave { ticks } => {
                self.generator = ticks.map_or(Generator::Endless, |ticks| {
                    Generator::Until(tick + u64::from(ticks))
                });
                self.moving_until = None;
            }
        }
    }
}
