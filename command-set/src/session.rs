//! A conversation: lines in, answers and commands out.
//!
//! # How it works
//! [`Session::obey`] looks the mnemonic up in the table of commands and leaves what follows in `pending`; [`Session::next`] takes it from there
//! piece by piece. A command for the amplifier may be refused; only when [`Session::outcome`] says that it acted does the session take note
//! of a new target. What is wrong with a line is kept for `ERR?` and answered with nothing, as the protocol has it.
//!
//! # Where it differs from other controllers
//! * `STP` and `#24` bring the drive to rest, servo off: they take the path that nothing delays. `HLT` stays where it is, servo on.
//! * `SVO 1 0` holds the drive that is there, which `SVA` then changes no faster than the block's ramp.
//! * A move is a smooth step (a quintic) whose fastest velocity is that of `VEL`.
//! * The data recorder writes all its tables at the same ticks; `DRC` chooses what is read from each.

use core::fmt::Write;
use core::sync::atomic::{AtomicI32, Ordering};

use heapless::Vec;
use hysteron_core::amplifier::{Command, Mode, Refusal};
use hysteron_core::parameter_block::AmplifierParameters;
use hysteron_core::reference_generator::Waveform;
use hysteron_core::reference_window::PREVIEW_TICKS;
use hysteron_core::servo_parameters::ConverterParameters;
use hysteron_core::signal::{MICROMETRE_FRACTION_BITS, VOLT_FRACTION_BITS};
use hysteron_core::trace_frame::TraceSample;
use hysteron_core::wave_table::WaveTable;

use crate::data_array::{DataArray, MOST_COLUMNS};
use crate::decimal::{Decimal, ONE, from_fixed, to_fixed};
use crate::device::{Device, View};
use crate::error_code::ErrorCode;
use crate::parameters::Parameter;
use crate::waveform::{Segment, Shape};
use crate::words::Words;
use crate::{IS_GENERATING, IS_MOVING, IS_READY, help};

/// Most bytes of a piece.
pub const PIECE_BYTES: usize = 512;
/// A piece of an answer.
pub type Piece = Vec<u8, PIECE_BYTES>;

/// Wave tables.
pub const WAVE_TABLES: usize = 4;
/// Points of each.
pub const WAVE_POINTS: usize = 4096;
/// Memory of all wave tables.
pub const WAVE_MEMORY: usize = WAVE_TABLES * WAVE_POINTS;
/// Points of a waveform that are computed in one piece of work.
const POINTS_AT_ONCE: u32 = 32;

/// A conditioning cycle takes the tenth part of a second.
const CONDITIONING_HZ: u32 = 10;
/// The longest move, ticks.
const LONGEST_MOVE_TICKS: i64 = 1 << 24;

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
    /// A conditioning has begun.
    Conditioning,
    /// The wave generator has begun; it ends on `last` after so many ticks (`None`: never).
    Wave { last: i32, ticks: Option<u32> },
}

/// What follows from the line that was obeyed.
#[derive(Clone, Debug)]
enum Pending {
    Nothing,
    Text,
    Help(usize),
    ParameterHelp(usize),
    RecorderHelp(usize),
    Recorded(DataArray),
    Wave(DataArray),
    Build { table: usize, at: usize, segment: Segment, done: u32 },
    Commands { first: Command, then: Option<Command>, meaning: Meaning },
}

/// Whether the wave generator runs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Generator {
    Off,
    Endless,
    Until(u32),
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
    moving_until: Option<u32>,
    /// um/s with 24 fraction bits.
    velocity: i64,
    tolerance: i32,
    settling_ticks: u32,
    wave_lengths: [u32; WAVE_TABLES],
    wave_selected: u32,
    wave_cycles: u32,
    wave_rate: u32,
    wave_joined: bool,
    generator: Generator,
    record_every: u32,
    quantities: [Quantity; MOST_COLUMNS],
    trigger: Trigger,
}

type Handler<D> = fn(&mut Session<D>, &mut Words<'_>) -> Result<(), ErrorCode>;

/// A number of micrometres as it is written.
fn micrometres(value: i32) -> Decimal {
    Decimal { billionths: from_fixed(value, MICROMETRE_FRACTION_BITS), digits: 6 }
}

/// A number of volts as it is written.
fn volts(value: i32) -> Decimal {
    Decimal { billionths: from_fixed(value, VOLT_FRACTION_BITS), digits: 6 }
}

impl<D: Device + 'static> Session<D> {
    /// Every command with its help; a query ends in a question mark.
    const COMMANDS: &'static [(&'static str, &'static str, Handler<D>)] = &[
        ("*IDN?", "get device identification", Self::identification),
        ("ATZ", "[<axis> [<low voltage>]] condition the actuator and zero the sensor", Self::auto_zero),
        ("ATZ?", "[<axis>] get whether the sensor has been zeroed", Self::auto_zeroed),
        ("CST?", "[<axis>] get the name of the stage", Self::stage),
        ("CSV?", "get the version of the syntax", Self::syntax_version),
        ("DRC", "{<table> <source> <option>} set what the data recorder records", Self::set_recorder),
        ("DRC?", "[{<table>}] get what the data recorder records", Self::recorder),
        ("DRL?", "[{<table>}] get the number of recorded points", Self::recorded_points),
        ("DRR?", "[<start> <number> [{<table>}]] get recorded data", Self::recorded_data),
        ("DRT", "{<table> <trigger source> <value>} set what starts the data recorder", Self::set_trigger),
        ("DRT?", "[{<table>}] get what starts the data recorder", Self::trigger),
        ("ERR?", "get and clear the last error", Self::last_error),
        ("GWD?", "[<start> <number> [{<table>}]] get the points of wave tables", Self::wave_data),
        ("HDR?", "get the options of the data recorder", Self::recorder_help),
        ("HLP?", "get this list", Self::command_help),
        ("HLT", "[<axis>] halt the motion, servo on", Self::halt),
        ("HPA?", "get the list of parameters", Self::parameter_help),
        ("MOV", "<axis> <position> set the target, um", Self::move_to),
        ("MOV?", "[<axis>] get the target, um", Self::target),
        ("MVR", "<axis> <distance> move relative to the target, um", Self::move_by),
        ("ONT?", "[<axis>] get whether the target is reached", Self::on_target),
        ("OVF?", "[<axis>] get whether the drive is at a limit", Self::overflow),
        ("POS?", "[<axis>] get the position, um", Self::position),
        ("RTR", "<ticks> set the record table rate", Self::set_record_rate),
        ("RTR?", "get the record table rate", Self::record_rate),
        ("SAI?", "[ALL] get the axis", Self::axes),
        ("SPA", "{<item> <parameter> <value>} set a parameter", Self::set_parameter),
        ("SPA?", "[{<item> <parameter>}] get parameters", Self::parameter),
        ("STP", "stop: the drive goes to rest", Self::stopped),
        ("SVA", "<axis> <drive> set the open-loop drive, V", Self::set_drive),
        ("SVA?", "[<axis>] get the open-loop drive, V", Self::open_loop_drive),
        ("SVO", "<axis> <0|1> switch the servo", Self::set_servo),
        ("SVO?", "[<axis>] get the servo", Self::servo),
        ("TMN?", "[<axis>] get the lowest position, um", Self::lowest),
        ("TMX?", "[<axis>] get the highest position, um", Self::highest),
        ("TNR?", "get the number of record tables", Self::record_tables),
        ("TWG?", "get the number of wave generators", Self::wave_generators),
        ("VEL", "<axis> <velocity> set the fastest velocity of moves, um/s", Self::set_velocity),
        ("VEL?", "[<axis>] get the velocity, um/s", Self::velocity),
        ("VER?", "get versions", Self::version),
        ("VOL?", "[<channel>] get the drive, V", Self::voltage),
        ("WAV", "<table> <X|&> <PNT|SIN_P|RAMP|LIN> {<parameter>} define a waveform", Self::define_wave),
        ("WAV?", "[<table> <1>] get the length of a wave table", Self::wave_length),
        ("WCL", "{<table>} clear wave tables", Self::clear_wave),
        ("WGC", "<generator> <cycles> set the number of cycles, 0: endless", Self::set_cycles),
        ("WGC?", "[<generator>] get the number of cycles", Self::cycles),
        ("WGO", "<generator> <0|1> stop or start the wave generator", Self::generate),
        ("WGO?", "[<generator>] get whether the wave generator runs", Self::generates),
        ("WSL", "<generator> <table> select a wave table, 0: none", Self::select_wave),
        ("WSL?", "[<generator>] get the selected wave table", Self::selected_wave),
        ("WTR", "<generator> <ticks> <interpolation> set the time of a point", Self::set_wave_rate),
        ("WTR?", "[<generator>] get the time of a point", Self::wave_rate),
    ];

    /// Bytes that are commands, as `HLP?` lists them.
    const SINGLE_BYTES: [(&'static str, &'static str); 4] = [
        ("#5", "get whether the axis moves"),
        ("#7", "get whether the controller is ready"),
        ("#9", "get whether the wave generator runs"),
        ("#24", "stop: the drive goes to rest"),
    ];

    /// For an amplifier with these parameters; `waves` is the memory of the wave tables, [`WAVE_MEMORY`] points.
    pub fn new(mut device: D, parameters: AmplifierParameters, waves: &'static [AtomicI32]) -> Self {
        let span = to_fixed(i64::from(parameters.physical.sensor_span_nm) * 1_000_000, MICROMETRE_FRACTION_BITS).unwrap_or(0);
        // A thousandth of the span, and ten times the span in a second.
        let tolerance = (span / 1000).max(1);
        device.set_tolerance(tolerance);
        Self {
            device,
            waves,
            error: 0,
            text: Piece::new(),
            pending: Pending::Nothing,
            target: 0,
            from: 0,
            drive: 0,
            moving_until: None,
            velocity: i64::from(span) * 10,
            tolerance,
            // 5 ms
            settling_ticks: parameters.physical.sample_rate_hz / 200,
            wave_lengths: [0; WAVE_TABLES],
            wave_selected: 0,
            wave_cycles: 0,
            wave_rate: 1,
            wave_joined: false,
            generator: Generator::Off,
            record_every: 1,
            quantities: [Quantity::Target, Quantity::Position, Quantity::Error, Quantity::Voltage],
            trigger: Trigger::Generator,
            parameters,
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

    /// Lines came for which there was no room.
    pub fn overrun(&mut self) {
        self.error = ErrorCode::Overrun as u16;
    }

    fn understand(&mut self, line: &[u8], before_stop: bool) -> Result<(), ErrorCode> {
        if let [byte] = line {
            return self.single_byte(*byte);
        }
        let line = core::str::from_utf8(line).map_err(|_| ErrorCode::UnknownCommand)?;
        let mut words = Words::of(line);
        let mnemonic = words.word()?;
        let found = Self::COMMANDS.iter().find(|(name, _, _)| name.eq_ignore_ascii_case(mnemonic));
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
            self.text.extend_from_slice(b" \n").map_err(|_| ErrorCode::AnswerTooLong)?;
        }
        self.text.write_fmt(text).map_err(|_| ErrorCode::AnswerTooLong)
    }

    /// Says one value of the axis.
    fn say_axis(&mut self, words: &mut Words<'_>, value: impl core::fmt::Display) -> Result<(), ErrorCode> {
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
                    let command = || Self::COMMANDS.get(nth - of_bytes).map(|(name, what, _)| (*name, *what));
                    if nth < of_bytes { Self::SINGLE_BYTES.get(nth).copied() } else { command() }
                });
                let written = match (nth, entry) {
                    (0, _) => writeln!(piece, "{} ", help::COMMANDS),
                    (_, Some((name, what))) => writeln!(piece, "{name} - {what} "),
                    _ => writeln!(piece, "{}", help::END),
                };
                self.sent(written, if nth > 0 && entry.is_none() { Pending::Nothing } else { Pending::Help(nth + 1) })
            }
            Pending::ParameterHelp(nth) => {
                let entry = nth.checked_sub(1).and_then(|nth| Parameter::ALL.get(nth));
                let written = match (nth, entry) {
                    (0, _) => writeln!(piece, "{} ", help::PARAMETERS),
                    (_, Some((_, number, kind, what))) => writeln!(piece, "{number:#x}=\t0\t1\t{kind}\tHysteron\t{what} "),
                    _ => writeln!(piece, "{}", help::END),
                };
                self.sent(written, if nth > 0 && entry.is_none() { Pending::Nothing } else { Pending::ParameterHelp(nth + 1) })
            }
            Pending::RecorderHelp(nth) => {
                let line = help::RECORDER.get(nth).copied().unwrap_or(help::END);
                let last = nth + 1 >= help::RECORDER.len();
                let written = writeln!(piece, "{line}{}", if last { "" } else { " " });
                self.sent(written, if last { Pending::Nothing } else { Pending::RecorderHelp(nth + 1) })
            }
            Pending::Recorded(array) => self.send_array(array, piece, Pending::Recorded, Self::recorded_value, Self::recorded_name),
            Pending::Wave(array) => self.send_array(array, piece, Pending::Wave, Self::wave_value, |_, _| "Wave table"),
            Pending::Build { table, at, segment, done } => self.build(table, at, segment, done),
            Pending::Commands { first, then, meaning } => {
                self.pending = Pending::Commands { first, then, meaning };
                Step::Command(first)
            }
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
        let Pending::Commands { then, meaning, .. } = core::mem::replace(&mut self.pending, Pending::Nothing) else { return };
        match (outcome, then) {
            (Outcome::Done(_), Some(first)) => self.pending = Pending::Commands { first, then: None, meaning },
            (Outcome::Done(tick), None) => self.take_note(tick, meaning),
            (Outcome::Refused(refusal), _) => self.error = ErrorCode::of_refusal(refusal, self.device.view().fault) as u16,
            (Outcome::NoRoom, _) => self.error = ErrorCode::Overrun as u16,
            // The stop itself is answered in its turn.
            (Outcome::Stopped, _) => {}
        }
    }

    fn take_note(&mut self, tick: u32, meaning: Meaning) {
        // The reference counts some ticks after it was generated.
        let until = |ticks: u32| tick.wrapping_add(ticks).wrapping_add(PREVIEW_TICKS as u32 + 1);
        match meaning {
            Meaning::Conditioning => {
                self.generator = Generator::Off;
                self.moving_until = None;
            }
            Meaning::Move { from, target, ticks } => {
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
                self.generator = ticks.map_or(Generator::Endless, |ticks| Generator::Until(until(ticks)));
                self.moving_until = None;
            }
        }
    }

    // What is known of the amplifier.

    fn converters(&self, view: &View) -> ConverterParameters {
        ConverterParameters { adc_zero: view.adc_zero, ..self.parameters.servo.converters }
    }

    fn position_now(&self, view: &View) -> i32 {
        self.converters(view).position(view.adc_code)
    }

    /// The reference now. The sample that is known may be from before the last command, hence not beyond the way to the target.
    fn reference_now(&self, view: &View) -> i32 {
        if self.runs() {
            return view.reference;
        }
        view.reference.max(self.from.min(self.target)).min(self.from.max(self.target))
    }

    /// The lowest and highest position that the sensor can honestly give, um with 24 fraction bits.
    fn range(&self, view: &View) -> (i32, i32) {
        let (c, guard) = (self.converters(view), &self.parameters.guard);
        (c.position(guard.adc_code_min), c.position(guard.adc_code_max))
    }

    fn is_within_range(&self, position: i32) -> bool {
        let (lowest, highest) = self.range(&self.device.view());
        (lowest..=highest).contains(&position)
    }

    fn closed(&self) -> bool {
        self.device.view().mode == Mode::Closed
    }

    /// Whether the wave generator runs.
    fn runs(&self) -> bool {
        let view = self.device.view();
        view.mode == Mode::Closed
            && match self.generator {
                Generator::Off => false,
                Generator::Endless => true,
                Generator::Until(tick) => is_before(view.tick, tick),
            }
    }

    fn moves(&self) -> bool {
        let view = self.device.view();
        let under_way = self.moving_until.is_some_and(|until| is_before(view.tick, until));
        self.runs() || !self.is_ready() || (under_way && matches!(view.mode, Mode::Closed | Mode::Playing))
    }

    /// Not while a conditioning or an identification is played.
    fn is_ready(&self) -> bool {
        self.device.view().mode != Mode::Playing || self.moving_until.is_some()
    }

    // Queries.

    fn identification(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        words.end()?;
        self.say(format_args!("(c)2026 Hysteron, HYSTERON, 0, {}", env!("CARGO_PKG_VERSION")))
    }

    fn syntax_version(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        words.end()?;
        self.say(format_args!("2.0"))
    }

    fn version(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        words.end()?;
        self.say(format_args!("FW_CORE: Hysteron {}", env!("CARGO_PKG_VERSION")))
    }

    fn last_error(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        words.end()?;
        let error = core::mem::take(&mut self.error);
        self.say(format_args!("{error}"))
    }

    fn axes(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        if words.more() && !words.word()?.eq_ignore_ascii_case("ALL") {
            return Err(ErrorCode::Syntax);
        }
        words.end()?;
        self.say(format_args!("1"))
    }

    fn stage(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        let name = self.parameters.physical.name;
        let end = name.iter().position(|byte| !byte.is_ascii_graphic()).unwrap_or(name.len());
        let name = name.get(..end).and_then(|name| core::str::from_utf8(name).ok()).filter(|name| !name.is_empty());
        self.say_axis(words, name.unwrap_or("NOSTAGE"))
    }

    fn servo(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        let closed = u8::from(self.closed());
        self.say_axis(words, closed)
    }

    fn target(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        let target = self.target;
        self.say_axis(words, micrometres(target))
    }

    fn position(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        let position = self.position_now(&self.device.view());
        self.say_axis(words, micrometres(position))
    }

    fn voltage(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        let drive = self.parameters.servo.converters.drive(self.device.view().dac_code);
        self.say_axis(words, volts(drive))
    }

    fn open_loop_drive(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        let drive = self.drive;
        self.say_axis(words, volts(drive))
    }

    fn on_target(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        let view = self.device.view();
        let reached = view.mode == Mode::Closed && !self.moves() && view.on_target_ticks >= self.settling_ticks;
        self.say_axis(words, u8::from(reached))
    }

    fn overflow(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        let (view, c) = (self.device.view(), self.parameters.servo.converters);
        let at_limit = view.mode == Mode::Closed && (view.dac_code <= c.dac_code_min || view.dac_code >= c.dac_code_max);
        self.say_axis(words, u8::from(at_limit))
    }

    fn lowest(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        let (lowest, _) = self.range(&self.device.view());
        self.say_axis(words, micrometres(lowest))
    }

    fn highest(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        let (_, highest) = self.range(&self.device.view());
        self.say_axis(words, micrometres(highest))
    }

    fn velocity(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        let velocity = self.velocity_value();
        self.say_axis(words, velocity)
    }

    fn velocity_value(&self) -> Decimal {
        let (whole, part) = (self.velocity >> MICROMETRE_FRACTION_BITS, self.velocity & ((1 << MICROMETRE_FRACTION_BITS) - 1));
        Decimal { billionths: whole.saturating_mul(ONE).saturating_add((part * ONE) >> MICROMETRE_FRACTION_BITS), digits: 6 }
    }

    fn auto_zeroed(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        let zeroed = u8::from(self.device.view().zeroed);
        self.say_axis(words, zeroed)
    }

    fn command_help(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        self.pending = Pending::Help(0);
        words.end()
    }

    fn parameter_help(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        self.pending = Pending::ParameterHelp(0);
        words.end()
    }

    fn recorder_help(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        self.pending = Pending::RecorderHelp(0);
        words.end()
    }

    // Motion.

    fn command(&mut self, first: Command, then: Option<Command>, meaning: Meaning) {
        self.pending = Pending::Commands { first, then, meaning };
    }

    /// Starts the recorder where a command that changes the target does so.
    fn begin_motion(&mut self) {
        if self.trigger == Trigger::Target {
            self.device.record(self.record_every);
        }
    }

    fn stopped(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        words.end()?;
        self.generator = Generator::Off;
        self.moving_until = None;
        self.error = ErrorCode::Stopped as u16;
        Ok(())
    }

    fn halt(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        words.queried_axis()?;
        self.stay();
        self.error = ErrorCode::Stopped as u16;
        Ok(())
    }

    /// Stays where it is.
    fn stay(&mut self) {
        let view = self.device.view();
        match view.mode {
            Mode::Closed => {
                let here = self.reference_now(&view);
                let stay = Command::Reference { waveform: Waveform::Constant, offset: here };
                self.command(stay, None, Meaning::Move { from: here, target: here, ticks: 0 });
            }
            Mode::Playing => self.command(Command::Hold { drive: None }, None, Meaning::Drive { drive: None, ticks: 0 }),
            Mode::Rest | Mode::Fault => {}
        }
    }

    fn set_servo(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        let wanted = words.of_axis(Words::switch)?;
        let view = self.device.view();
        match (wanted, view.mode == Mode::Closed) {
            (true, false) => {
                let (lowest, highest) = self.range(&view);
                let here = self.position_now(&view).max(lowest).min(highest);
                let stay = Command::Reference { waveform: Waveform::Constant, offset: here };
                self.command(stay, Some(Command::Enable), Meaning::Move { from: here, target: here, ticks: 0 });
            }
            (false, true) => {
                let drive = self.parameters.servo.converters.drive(view.dac_code);
                self.command(Command::Hold { drive: None }, None, Meaning::Drive { drive: Some(drive), ticks: 0 });
            }
            _ => {}
        }
        Ok(())
    }

    fn move_to(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        let target = words.of_axis(|words| words.micrometres(ErrorCode::Position))?;
        self.go(target)
    }

    fn move_by(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        let distance = words.of_axis(|words| words.micrometres(ErrorCode::Position))?;
        self.go(self.target.checked_add(distance).ok_or(ErrorCode::Position)?)
    }

    fn go(&mut self, target: i32) -> Result<(), ErrorCode> {
        if !self.closed() {
            return Err(ErrorCode::ServoIsOff);
        }
        if self.runs() {
            return Err(ErrorCode::GeneratorRuns);
        }
        if !self.is_within_range(target) {
            return Err(ErrorCode::Position);
        }
        let from = if self.moves() { self.reference_now(&self.device.view()) } else { self.target };
        let height = target.checked_sub(from).ok_or(ErrorCode::Position)?;
        // The quintic is 15/8 as fast as its mean at its middle.
        let rate = i64::from(self.parameters.physical.sample_rate_hz);
        let ticks = (i64::from(height).abs() * 15 * rate / 8).checked_div(self.velocity).unwrap_or(LONGEST_MOVE_TICKS);
        let ticks = ticks.clamp(1, LONGEST_MOVE_TICKS) as u32;
        let waveform = Waveform::QuasiStep { height, delay_ticks: 0, duration_ticks: ticks };
        self.begin_motion();
        self.command(Command::Reference { waveform, offset: from }, None, Meaning::Move { from, target, ticks });
        Ok(())
    }

    fn set_drive(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        let drive = words.of_axis(Words::volts)?;
        let view = self.device.view();
        if view.mode == Mode::Closed {
            return Err(ErrorCode::ServoIsOn);
        }
        let limit = |millivolts: i32| to_fixed(i64::from(millivolts) * 1_000_000, VOLT_FRACTION_BITS).unwrap_or(0);
        let physical = &self.parameters.physical;
        if !(limit(physical.drive_min_mv)..=limit(physical.drive_max_mv)).contains(&drive) {
            return Err(ErrorCode::Voltage);
        }
        let c = &self.parameters.servo.converters;
        let distance = i64::from(drive.saturating_sub(c.drive(view.dac_code)));
        let codes = (distance.abs() * i64::from(c.dac_codes_per_volt)) >> 42;
        let ticks = codes / i64::from(self.parameters.guard.ramp_codes.max(1)) + 1;
        self.begin_motion();
        let meaning = Meaning::Drive { drive: Some(drive), ticks: ticks.min(LONGEST_MOVE_TICKS) as u32 };
        self.command(Command::Hold { drive: Some(drive) }, None, meaning);
        Ok(())
    }

    fn set_velocity(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        let velocity = words.of_axis(Words::number)?;
        self.take_velocity(velocity)
    }

    /// Takes a velocity in billionths of um/s: up to the whole span in a tick.
    fn take_velocity(&mut self, billionths: i64) -> Result<(), ErrorCode> {
        let physical = &self.parameters.physical;
        let most = i64::from(physical.sensor_span_nm).saturating_mul(1_000_000).saturating_mul(i64::from(physical.sample_rate_hz));
        if billionths <= 0 || billionths > most {
            return Err(ErrorCode::Velocity);
        }
        // Whole um/s and the rest apart, so that both have room.
        let (whole, part) = (billionths / ONE, billionths % ONE);
        self.velocity = (whole << MICROMETRE_FRACTION_BITS) + (part << MICROMETRE_FRACTION_BITS) / ONE;
        Ok(())
    }

    fn auto_zero(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        if words.more() {
            words.axis()?;
        }
        // A lowest voltage is not needed: the whole range is driven.
        let _ = words.optional();
        words.end()?;
        let rate = self.parameters.physical.sample_rate_hz;
        self.command(Command::Condition { cycle_ticks: rate / CONDITIONING_HZ, rest_ticks: rate }, None, Meaning::Conditioning);
        Ok(())
    }

    // Wave tables and their generator.

    /// A wave table named by a word, from 0.
    fn table(&self, words: &mut Words<'_>) -> Result<usize, ErrorCode> {
        let table = words.whole()?;
        if (1..=WAVE_TABLES as u32).contains(&table) { Ok(table as usize - 1) } else { Err(ErrorCode::Range) }
    }

    fn points_of(&self, table: usize) -> &'static [AtomicI32] {
        self.waves.get(table * WAVE_POINTS..(table + 1) * WAVE_POINTS).unwrap_or(&[])
    }

    fn length_of(&self, table: usize) -> u32 {
        self.wave_lengths.get(table).copied().unwrap_or(0)
    }

    fn set_length(&mut self, table: usize, length: usize) {
        if let Some(place) = self.wave_lengths.get_mut(table) {
            *place = length as u32;
        }
    }

    /// Not while the table is played.
    fn may_change(&self, table: usize) -> Result<(), ErrorCode> {
        if self.runs() && self.wave_selected as usize == table + 1 { Err(ErrorCode::GeneratorRuns) } else { Ok(()) }
    }

    fn define_wave(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
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
        if at + segment.length as usize > WAVE_POINTS {
            return Err(ErrorCode::WaveTooLong);
        }
        let end = segment.offset.checked_add(segment.amplitude).ok_or(ErrorCode::WaveLimit)?;
        if !self.is_within_range(segment.offset) || !self.is_within_range(end) {
            return Err(ErrorCode::WaveLimit);
        }
        self.pending = Pending::Build { table, at, segment, done: 0 };
        Ok(())
    }

    /// Points from the line: their place in the segment, their number, and themselves.
    fn define_points(&mut self, table: usize, at: usize, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        let missing = |error| if error == ErrorCode::Missing { ErrorCode::WaveParameters } else { error };
        let first = words.whole().map_err(missing)? as usize;
        let count = words.whole().map_err(missing)? as usize;
        // The start point counts in the segment; behind `&` others count in the table, which is the same place.
        let begin = if at == 0 { first.checked_sub(1).ok_or(ErrorCode::WaveIndex)? } else { at };
        let end = begin.checked_add(count).filter(|end| *end <= WAVE_POINTS).ok_or(ErrorCode::WaveTooLong)?;
        let mut given = words.clone();
        for _ in 0..count {
            let point = given.micrometres(ErrorCode::WaveLimit).map_err(missing)?;
            if !self.is_within_range(point) {
                return Err(ErrorCode::WaveLimit);
            }
        }
        given.end().map_err(|_| ErrorCode::WaveParameters)?;
        for place in self.points_of(table).get(begin..end).unwrap_or(&[]) {
            place.store(words.micrometres(ErrorCode::WaveLimit)?, Ordering::Relaxed);
        }
        self.set_length(table, end);
        Ok(())
    }

    /// Some points of a segment.
    fn build(&mut self, table: usize, at: usize, segment: Segment, done: u32) -> Step {
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
            self.pending = Pending::Build { table, at, segment, done: until };
        }
        Step::Work
    }

    fn wave_length(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        let all = !words.more();
        let wanted = if all { 0..WAVE_TABLES } else { self.table(words).map(|table| table..table + 1)? };
        if words.optional_whole()?.is_some_and(|parameter| parameter != 1) {
            return Err(ErrorCode::Range);
        }
        words.end()?;
        for table in wanted {
            let length = self.length_of(table);
            self.say(format_args!("{} 1={length}.0", table + 1))?;
        }
        Ok(())
    }

    fn clear_wave(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        loop {
            let table = self.table(words)?;
            self.may_change(table)?;
            self.set_length(table, 0);
            if !words.more() {
                return Ok(());
            }
        }
    }

    fn select_wave(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
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

    fn selected_wave(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        let table = self.wave_selected;
        self.say_axis(words, table)
    }

    fn set_cycles(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        let cycles = words.of_axis(Words::whole)?;
        self.wave_cycles = cycles;
        Ok(())
    }

    fn cycles(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        let cycles = self.wave_cycles;
        self.say_axis(words, cycles)
    }

    fn set_wave_rate(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
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

    fn wave_rate(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        let (rate, joined) = (self.wave_rate, u8::from(self.wave_joined));
        self.say_axis(words, format_args!("{rate} {joined}"))
    }

    fn generate(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        let mode = words.of_axis(Words::whole)?;
        match mode {
            0 => {
                if self.runs() {
                    self.stay();
                }
                Ok(())
            }
            1 => self.start_generator(),
            _ => Err(ErrorCode::GeneratorMode),
        }
    }

    fn start_generator(&mut self) -> Result<(), ErrorCode> {
        if !self.closed() {
            return Err(ErrorCode::ServoIsOff);
        }
        let table = (self.wave_selected as usize).checked_sub(1).ok_or(ErrorCode::NoWaveSelected)?;
        let length = self.length_of(table);
        let points = self.points_of(table).get(..length as usize).unwrap_or(&[]);
        let last = points.last().ok_or(ErrorCode::WaveNotDefined)?.load(Ordering::Relaxed);
        let all = u64::from(length) * u64::from(self.wave_rate) * u64::from(self.wave_cycles);
        let ticks = u32::try_from(all).ok().filter(|ticks| *ticks < 1 << 31).ok_or(ErrorCode::Range)?;
        if matches!(self.trigger, Trigger::Generator | Trigger::Target) {
            self.device.record(self.record_every);
        }
        let table = WaveTable::new(points, self.wave_rate, self.wave_joined, self.wave_cycles);
        let meaning = Meaning::Wave { last, ticks: (self.wave_cycles > 0).then_some(ticks) };
        self.command(Command::Reference { waveform: Waveform::Table(table), offset: 0 }, None, meaning);
        Ok(())
    }

    fn generates(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        let runs = u8::from(self.runs());
        self.say_axis(words, runs)
    }

    fn wave_generators(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        words.end()?;
        self.say(format_args!("1"))
    }

    fn wave_data(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        let asked = words.more();
        let mut array = self.read_array(words, WAVE_TABLES, self.wave_rate)?;
        if array.tables.is_empty() {
            for (nth, _) in (1u8..).zip(&self.wave_lengths).filter(|(_, length)| **length > 0) {
                let _ = array.tables.push(nth);
            }
        }
        let shortest = array.tables.iter().map(|table| self.length_of(usize::from(*table) - 1)).min().unwrap_or(0);
        if !asked {
            array.count = shortest;
        }
        if array.count == 0 || array.first.saturating_add(array.count) > shortest {
            return Err(ErrorCode::WaveIndex);
        }
        self.pending = Pending::Wave(array);
        Ok(())
    }

    fn wave_value(&self, table: u8, nth: u32) -> Option<Decimal> {
        let point = self.points_of(usize::from(table).checked_sub(1)?).get(nth as usize)?;
        Some(micrometres(point.load(Ordering::Relaxed)))
    }

    // The data recorder.

    /// A table of the data recorder named by a word, from 0.
    fn record_table(&self, words: &mut Words<'_>) -> Result<usize, ErrorCode> {
        let table = words.whole()?;
        if (1..=MOST_COLUMNS as u32).contains(&table) { Ok(table as usize - 1) } else { Err(ErrorCode::RecorderTable) }
    }

    fn set_recorder(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
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
    fn say_tables(&mut self, words: &mut Words<'_>, what: impl Fn(&Self, usize) -> (u32, Option<u32>)) -> Result<(), ErrorCode> {
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

    fn recorder(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        self.say_tables(words, |this, table| (1, this.quantities.get(table).map(|quantity| *quantity as u32)))
    }

    fn recorded_points(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        let recorded = self.device.recorded();
        self.say_tables(words, |_, _| (recorded, None))
    }

    fn trigger(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        self.say_tables(words, |this, _| (this.trigger as u32, Some(0)))
    }

    fn set_trigger(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
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

    fn record_tables(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        words.end()?;
        self.say(format_args!("{MOST_COLUMNS}"))
    }

    fn set_record_rate(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        let ticks = words.whole()?;
        words.end()?;
        if !(1..=0xffff).contains(&ticks) {
            return Err(ErrorCode::Range);
        }
        self.record_every = ticks;
        Ok(())
    }

    fn record_rate(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        words.end()?;
        let ticks = self.record_every;
        self.say(format_args!("{ticks}"))
    }

    /// `[<start> <number> [{<table>}]]`; without anything, no table and no point yet.
    fn read_array(&self, words: &mut Words<'_>, most_tables: usize, every_ticks: u32) -> Result<DataArray, ErrorCode> {
        let rate = i64::from(self.parameters.physical.sample_rate_hz.max(1));
        let sample_time = i64::from(every_ticks) * ONE / rate;
        let mut array = DataArray { tables: Vec::new(), first: 0, count: 0, sample_time, sent: 0 };
        if words.more() {
            array.first = words.whole()?.checked_sub(1).ok_or(ErrorCode::Range)?;
            array.count = words.whole()?;
        }
        while words.more() {
            let table = words.whole()?;
            if !(1..=most_tables as u32).contains(&table) {
                return Err(ErrorCode::RecorderTable);
            }
            array.tables.push(table as u8).map_err(|_| ErrorCode::ParameterCount)?;
        }
        Ok(array)
    }

    fn recorded_data(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        let asked = words.more();
        let mut array = self.read_array(words, MOST_COLUMNS, self.record_every)?;
        if array.tables.is_empty() {
            for (nth, _) in (1u8..).zip(&self.quantities).filter(|(_, quantity)| **quantity != Quantity::Nothing) {
                let _ = array.tables.push(nth);
            }
        }
        let recorded = self.device.recorded();
        if !asked {
            array.count = recorded;
        }
        if array.count == 0 || array.tables.is_empty() || array.first.saturating_add(array.count) > recorded {
            return Err(ErrorCode::NotEnoughRecorded);
        }
        self.device.end_recording();
        self.pending = Pending::Recorded(array);
        Ok(())
    }

    fn recorded_value(&self, table: u8, nth: u32) -> Option<Decimal> {
        let quantity = self.quantities.get(usize::from(table).checked_sub(1)?)?;
        let sample: TraceSample = self.device.sample(nth)?;
        let c = self.converters(&self.device.view());
        Some(match quantity {
            Quantity::Nothing => Decimal { billionths: 0, digits: 6 },
            Quantity::Target => micrometres(sample.reference),
            Quantity::Position => micrometres(c.position(sample.adc_code)),
            Quantity::Error => micrometres(sample.reference.saturating_sub(c.position(sample.adc_code))),
            Quantity::Voltage => volts(c.drive(sample.dac_code)),
        })
    }

    fn recorded_name(&self, table: u8) -> &'static str {
        let quantity = usize::from(table).checked_sub(1).and_then(|table| self.quantities.get(table));
        match quantity {
            Some(Quantity::Target) => "Target position of axis AXIS:1",
            Some(Quantity::Position) => "Actual position of axis AXIS:1",
            Some(Quantity::Error) => "Position error of axis AXIS:1",
            Some(Quantity::Voltage) => "Voltage of output channel CHAN:1",
            _ => "Nothing is recorded",
        }
    }

    /// The next line of an array.
    fn send_array(
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

    fn write_row(&self, array: &DataArray, nth: u32, piece: &mut Piece, value: fn(&Self, u8, u32) -> Option<Decimal>) -> core::fmt::Result {
        for (column, table) in array.tables.iter().enumerate() {
            let number = value(self, *table, nth).ok_or(core::fmt::Error)?;
            write!(piece, "{}{number}", if column == 0 { "" } else { " " })?;
        }
        let last = nth.saturating_add(1) >= array.first.saturating_add(array.count);
        piece.write_str(if last { "\n" } else { " \n" })
    }

    // Parameters.

    /// A parameter of the axis named by two words.
    fn named_parameter(words: &mut Words<'_>) -> Result<(Parameter, u32), ErrorCode> {
        words.axis()?;
        let number = words.whole()?;
        Parameter::of_number(number).map(|parameter| (parameter, number)).ok_or(ErrorCode::UnknownParameter)
    }

    fn set_parameter(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        loop {
            let (parameter, _) = Self::named_parameter(words)?;
            let value = words.number()?;
            match parameter {
                Parameter::Velocity => self.take_velocity(value)?,
                Parameter::Tolerance => {
                    let tolerance = to_fixed(value, MICROMETRE_FRACTION_BITS).filter(|tolerance| *tolerance > 0);
                    self.tolerance = tolerance.ok_or(ErrorCode::Range)?;
                    self.device.set_tolerance(self.tolerance);
                }
                Parameter::SettlingTime => {
                    if !(0..=10 * ONE).contains(&value) {
                        return Err(ErrorCode::Range);
                    }
                    let ticks = value / 1000 * i64::from(self.parameters.physical.sample_rate_hz) / (ONE / 1000);
                    self.settling_ticks = u32::try_from(ticks).unwrap_or(u32::MAX);
                }
                _ => return Err(ErrorCode::ReadOnly),
            }
            if !words.more() {
                return Ok(());
            }
        }
    }

    fn parameter(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        if !words.more() {
            for (parameter, number, _, _) in Parameter::ALL {
                self.say_parameter(parameter, number)?;
            }
        }
        while words.more() {
            let (parameter, number) = Self::named_parameter(words)?;
            self.say_parameter(parameter, number)?;
        }
        Ok(())
    }

    fn say_parameter(&mut self, parameter: Parameter, number: u32) -> Result<(), ErrorCode> {
        let (lowest, highest) = self.range(&self.device.view());
        let rate = i64::from(self.parameters.physical.sample_rate_hz.max(1));
        let seconds = |ticks: u32| Decimal { billionths: i64::from(ticks) * ONE / rate, digits: 9 };
        let value = match parameter {
            Parameter::RangeMinimum => micrometres(lowest),
            Parameter::RangeMaximum => micrometres(highest),
            Parameter::Velocity => self.velocity_value(),
            Parameter::Tolerance => micrometres(self.tolerance),
            Parameter::SettlingTime => seconds(self.settling_ticks),
            Parameter::ServoPeriod => seconds(1),
            Parameter::WavePoints => return self.say(format_args!("1 {number:#x}={WAVE_POINTS}")),
            Parameter::WaveTables => return self.say(format_args!("1 {number:#x}={WAVE_TABLES}")),
            Parameter::RecorderTables => return self.say(format_args!("1 {number:#x}={MOST_COLUMNS}")),
            Parameter::RecorderPoints => {
                let points = self.device.recorder_room() * MOST_COLUMNS as u32;
                return self.say(format_args!("1 {number:#x}={points}"));
            }
        };
        self.say(format_args!("1 {number:#x}={value}"))
    }
}

/// Whether a tick comes before another, for a counter that begins again.
fn is_before(tick: u32, other: u32) -> bool {
    let ahead = other.wrapping_sub(tick);
    ahead != 0 && ahead < 1 << 31
}

/// `<segment length> <amplitude> <offset> <curve length> <start point>`, then what the shape needs.
fn read_segment(shape: Shape, words: &mut Words<'_>) -> Result<Segment, ErrorCode> {
    let mut read = || -> Result<Segment, ErrorCode> {
        let length = words.whole()?;
        let (amplitude, offset) = (words.micrometres(ErrorCode::WaveLimit)?, words.micrometres(ErrorCode::WaveLimit)?);
        let (curve_length, start) = (words.whole()?, words.whole()?);
        let speed_up = if shape == Shape::Sine { 0 } else { words.whole()? };
        let centre = if shape == Shape::Line { curve_length } else { words.whole()? };
        Ok(Segment { shape, length, start, curve_length, centre, speed_up, amplitude, offset })
    };
    let segment = read().map_err(|error| if error == ErrorCode::Missing { ErrorCode::WaveParameters } else { error })?;
    words.end().map_err(|_| ErrorCode::WaveParameters)?;
    Ok(segment)
}
