//! What the control interrupt runs: servo, guard and modes. The host simulation and the emulator run the
//! same, bit for bit.
//!
//! # How it works
//! [`Amplifier::tick`] is called once a period with the reading and returns what leaves in that period.
//! Commands are given between ticks with [`Amplifier::command`].
//!
//! | mode | drive |
//! |---|---|
//! | [`Mode::Rest`] | ramps to the rest code and stays |
//! | [`Mode::Playing`] | an open-loop waveform within limits: conditioning, identification; or a held drive |
//! | [`Mode::Closed`] | the servo |
//! | [`Mode::Fault`] | ramps to rest; stays until the fault is cleared and the sensor healthy long enough |
//!
//! In every mode the drive changes by no more than the slew limit of the block in one tick.
//!
//! # Arming
//! Behind a start and behind every fault the amplifier's power stage is off ([`Amplifier::powered`]), and
//! nothing plays or closes until somebody arms it ([`Command::Arm`]): the power stage is switched on at rest,
//! and a small step shows that the drive moves the sensor as the model says ([`crate::self_test`]). Where the
//! amplifier's output is read, a step without power comes first: a relay that is welded shows.
//! [`Command::Disarm`] goes to rest and switches it off there.
//!
//! A fault of the output itself ([`Fault::is_of_output`]) switches it off at once: the ramp to rest would not
//! arrive.
//!
//! # Conditioning
//! A played raised cosine over the whole range, as long as it is asked for or as long as the slew limit
//! needs, a rest, and then the sensor is zeroed at the mean of the last [`ZERO_TICKS`] readings. It counts
//! only if the drive was at both its limits and the sensor moved with it, as far as the model says; otherwise
//! it ends in a fault that says which.
//!
//! # What is followed
//! A reference that was given with the loop open is followed once it is closed, if it lies within the limits
//! then. A stop, a fault and a conditioning forget it: a loop that is closed behind them stays where the
//! stage stands.
//!
//! # Stick-slip drives
//! With [`AmplifierParameters::stepping`] the closed loop is that of [`crate::stepping`]: it follows
//! [`Command::MoveTo`] and no waveform. A reading is the encoder's count. A conditioning lets the slider ride
//! on one cycle and makes the position behind it 0. A trace has the target and the position in place of
//! reference and applied displacement, um with 16 fraction bits.
//!
//! # What conditioned means
//! The servo inverts the hysteresis from a memory of its own, the drives of the past as it knows them, and
//! that must be the stage's. A cycle over the whole range wipes out every loop in both, so behind it they
//! agree, and the sensor's zero is that of this memory. They go on agreeing for as long as every drive is one
//! that was written here: through rest, open-loop drives and closed loops, however long, because the memory
//! of a hysteresis does not fade. They no longer do once the amplifier's power stage was off, as behind a
//! start and every fault: the stage went its own way. The loop closes only while they agree
//! ([`Amplifier::conditioned`]), unless that is waived ([`Command::RequireConditioning`]).

use crate::amplifier_command::{Command, ENDLESS_TICKS, REST_BEFORE_TICKS, Refusal, ZERO_TICKS};
use crate::block_swap;
use crate::codes::{DriveCode, SensorCode};
use crate::command_limits;
use crate::guard::{Fault, Guard};
use crate::output_monitor::OutputMonitor;
use crate::parameter_block::AmplifierParameters;
use crate::reference_generator::{LOWEST_POINT, ReferenceGenerator, Waveform, sweep};
use crate::reference_window::PREVIEW_TICKS;
use crate::self_test::{Extremes, Motion, SelfTest, has_model};
use crate::servo_parameters::ConverterParameters;
use crate::servo_tick::ServoTick;
use crate::set_point::{InputState, SetPoint};
use crate::signal::{Micrometres, Volts, narrow, volts};
use crate::signal_filter::{FilteredSignal, Place, SectionRow};
use crate::stepping::{Loop, Stepper};
use crate::stepping_parameters::IfStepping;
use crate::swing_watch::SwingWatch;
use crate::trace_frame::TraceSample;

/// Tones of an identification: phase increment and share of the range in 1024ths. 2, 17.3 and 131 Hz at 20
/// kHz, with 63, 25 and 10 % of the range.
pub const IDENTIFICATION_TONES: [(u32, i32); 4] =
    [(429_497, 646), (3_715_146, 256), (28_132_034, 102), (0, 0)];
/// The sweep's share of the range beside them, in 1024ths.
pub const IDENTIFICATION_SWEEP: i32 = 20;

/// What the amplifier is doing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Mode {
    /// At rest.
    Rest = 0,
    /// Plays an open-loop drive.
    Playing = 1,
    /// The servo follows its reference.
    Closed = 2,
    /// Stopped by a fault.
    Fault = 3,
}

/// Mode and fault of a tick, when everything has looked at it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Status {
    /// What the amplifier is doing.
    pub mode: Mode,
    /// The latched fault.
    pub fault: Option<Fault>,
}

impl Status {
    /// As a sample of the trace has it: the mode in the low byte, the fault in the next.
    #[inline]
    #[must_use]
    pub fn flags(self) -> u16 {
        self.mode as u16 | (self.fault.map_or(0, |fault| fault as u16) << 8)
    }

    /// What a sample of the trace says.
    #[must_use]
    pub fn from_flags(flags: u16) -> Self {
        let mode = match flags as u8 {
            0 => Mode::Rest,
            1 => Mode::Playing,
            2 => Mode::Closed,
            _ => Mode::Fault,
        };
        Self {
            mode,
            fault: Fault::from_number((flags >> 8) as u8),
        }
    }
}

impl Mode {
    /// Its name.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Rest => "rest",
            Self::Playing => "playing",
            Self::Closed => "closed",
            Self::Fault => "fault",
        }
    }
}

/// The amplifier with all its state.
// In this order: the servo holds what it has learned, and what stands behind that is beyond the reach of an
// instruction.
#[derive(Clone, Debug)]
#[repr(C)]
pub struct Amplifier {
    guard: Guard,
    swing: SwingWatch,
    mode: Mode,
    fault: Option<Fault>,
    /// What nothing clears.
    for_good: Option<Fault>,
    /// What is followed, or would be; `None`: where the stage stands.
    reference: Option<(Waveform<Micrometres>, Micrometres)>,
    generator: ReferenceGenerator<Micrometres>,
    /// What is played with the loop open.
    player: ReferenceGenerator<Volts>,
    rest_before_ticks: u32,
    /// Amplitude of the sweep beside what is played, V with 22 fraction bits; 0 for none.
    sweep: i32,
    sweep_tick: u32,
    remaining_ticks: u32,
    rest_after_ticks: u32,
    zero_sum: i64,
    cycle: Cycle,
    self_test: Option<SelfTest>,
    armed: bool,
    powered: bool,
    /// A self-test or a conditioning has shown that the stage is the model's, and no fault since.
    tested: bool,
    /// No loop is closed without.
    test_required: bool,
    /// The amplifier plays this code until another command.
    held_code: Option<DriveCode>,
    zeroed: bool,
    conditioned: bool,
    conditioning_required: bool,
    code: DriveCode,
    tick: u32,
    /// Mean square of the drive's change, times [`CURRENT_TICKS`], and its limit.
    change: u64,
    most_change: u64,
    /// Looks at the amplifier's output, where its monitor is wired.
    output: Option<OutputMonitor>,
    /// The analogue set point, where it is wired.
    input: Option<SetPoint>,
    parameters: AmplifierParameters,
    /// What makes it a stick-slip drive.
    stepper: IfStepping<Stepper>,
    servo: ServoTick,
}

/// What a conditioning has seen of the range.
#[derive(Clone, Copy, Debug)]
struct Cycle {
    lowest: DriveCode,
    highest: DriveCode,
    /// At the highest drive: the reading and the model's displacement.
    reading: SensorCode,
    applied: i32,
    /// Readings of the rest behind it.
    noise: Extremes,
}

impl Cycle {
    const NONE: Self = Self {
        lowest: DriveCode::MOST,
        highest: DriveCode::new(0),
        reading: SensorCode::new(0),
        applied: 0,
        noise: Extremes::NONE,
    };
}

/// Ticks over which the mean square of the drive's change is taken, 0.8 s at 20 kHz: what warms an amplifier
/// takes longer.
pub const CURRENT_TICKS: u32 = 1 << CURRENT_SHIFT;
const CURRENT_SHIFT: u32 = 14;

/// A conditioning has been at a limit of the drive if it came as near as this share of the range, 2^-10:
/// amplitudes of tones have 1024ths.
const RANGE_SHIFT: u32 = 10;

impl Amplifier {
    /// At rest. Without a valid block it is made from any parameters and [`Amplifier::refuse`]d at once.
    #[must_use]
    pub fn new(parameters: AmplifierParameters) -> Self {
        let mut servo = ServoTick::new(parameters.servo);
        let code = servo.open_loop(parameters.guard.rest_code);
        let stepper = parameters
            .stepping
            .get()
            .map_or(IfStepping::NONE, |stepping| {
                IfStepping::new(Stepper::new(&parameters.servo, *stepping))
            });
        Self {
            servo,
            stepper,
            guard: Guard::new(parameters.guard),
            swing: SwingWatch::new(&parameters),
            mode: Mode::Rest,
            fault: None,
            for_good: None,
            change: 0,
            most_change: u64::MAX,
            output: None,
            input: None,
            reference: None,
            generator: ReferenceGenerator::new(Waveform::Constant, Micrometres::from_bits(0)),
            player: ReferenceGenerator::new(Waveform::Constant, Volts::from_bits(0)),
            rest_before_ticks: 0,
            sweep: 0,
            sweep_tick: 0,
            remaining_ticks: 0,
            rest_after_ticks: 0,
            zero_sum: 0,
            cycle: Cycle::NONE,
            self_test: None,
            armed: false,
            powered: false,
            tested: false,
            test_required: false,
            held_code: None,
            zeroed: false,
            conditioned: false,
            conditioning_required: true,
            code,
            tick: 0,
            parameters,
        }
    }

    /// Stops with a fault that was found outside the tick.
    // Once, not at each of its dozen callers: it is rare and takes 200 bytes.
    #[inline(never)]
    pub fn refuse(&mut self, fault: Fault) {
        self.fault.get_or_insert(fault);
        self.mode = Mode::Fault;
        self.conditioned = false;
        self.armed = false;
        self.tested = false;
        if fault.is_of_output() {
            self.switch_off();
        }
        self.forget_plans();
    }

    /// Stops for want of a parameter block or a safety envelope. A fault that was found before stays in
    /// front; when it has been cleared this one is named, and nothing clears it.
    pub fn refuse_for_good(&mut self, fault: Fault) {
        self.for_good = Some(fault);
        self.refuse(fault);
    }

    /// From now on a drive that changes by more than this from tick to tick is a fault, mean square over
    /// [`CURRENT_TICKS`] ticks, square codes: the current into the actuator
    /// ([`crate::safety_envelope::SafetyEnvelope::mean_square_codes`]).
    pub fn limit_current(&mut self, mean_square_codes: u64) {
        self.most_change = mean_square_codes << CURRENT_SHIFT;
    }

    /// From now on no loop is closed that neither a self-test nor a conditioning has tried
    /// ([`crate::safety_envelope::SafetyEnvelope::closes_untested`]).
    pub fn require_test(&mut self) {
        self.test_required = true;
    }

    /// Changes a section of a filter, as [`Command::Filter`] does.
    pub fn set_filter(&mut self, signal: FilteredSignal, place: Place, row: &SectionRow) {
        self.servo.set_filter(signal, place, row);
    }

    /// From now on the amplifier's voltage monitor is compared with the drive ([`crate::output_monitor`]).
    pub fn watch_output(&mut self, monitor: OutputMonitor) {
        self.output = Some(monitor);
    }

    /// From now on the analogue set point can be followed ([`crate::set_point`]).
    pub fn wire_input(&mut self, input: SetPoint) {
        self.input = Some(input);
    }

    /// Takes what the analogue set point read during the last period (`None`: its converter did not answer),
    /// 65,536 codes. Call it before the tick.
    #[inline]
    pub fn inspect_input(&mut self, code: Option<u16>) {
        match self.input.as_mut().map(|input| input.follow(code)) {
            Some(Ok(Some(reference))) => self.generator.stay_at(reference),
            Some(Err(fault)) => self.refuse(fault),
            Some(Ok(None)) | None => {}
        }
    }

    /// What the loop has of the analogue set point.
    #[must_use]
    pub fn input_state(&self) -> InputState {
        self.input.as_ref().map_or(InputState::Off, SetPoint::state)
    }

    fn leave_input(&mut self) {
        if let Some(input) = &mut self.input {
            input.end();
        }
    }

    /// Takes what the voltage monitor read during the last period (`None`: its converter did not answer),
    /// 65,536 codes. Call it before the tick.
    #[inline]
    pub fn inspect_output(&mut self, code: Option<u16>) {
        let (drive, powered) = (self.servo.drive().to_bits(), self.powered);
        if let Some(fault) = self
            .output
            .as_mut()
            .and_then(|monitor| monitor.inspect(code, drive, powered))
        {
            self.refuse(fault);
        }
    }

    /// What was asked for before a stop is not done behind it.
    fn forget_plans(&mut self) {
        self.reference = None;
        self.self_test = None;
        self.leave_input();
    }

    /// Takes a command.
    ///
    /// # Errors
    /// [`Refusal`]; nothing has changed then.
    pub fn command(&mut self, command: Command) -> Result<(), Refusal> {
        // A fault is reported before limits.
        if self.mode != Mode::Fault {
            command_limits::check(&command, &self.parameters, self.converters())?;
        }
        if let (Command::Enable, Some((waveform, offset))) = (command, self.reference) {
            // Against the zero that is in force now.
            let reference = Command::Reference { waveform, offset };
            command_limits::check(&reference, &self.parameters, self.converters())?;
        }
        self.obey(command)
    }

    /// Takes a command that may lie beyond the limits.
    pub(crate) fn obey(&mut self, command: Command) -> Result<(), Refusal> {
        match command {
            Command::Disable | Command::Disarm => {
                self.armed &= command == Command::Disable;
                self.forget_plans();
                if self.mode != Mode::Fault {
                    self.mode = Mode::Rest;
                }
                return Ok(());
            }
            Command::Clear => {
                if self.mode == Mode::Fault {
                    if !self.guard.healthy() {
                        return Err(Refusal::NotYetHealthy);
                    }
                    if self.for_good.is_some() && self.fault == self.for_good {
                        return Err(Refusal::NoBlock);
                    }
                    self.fault = self.for_good;
                    self.mode = if self.for_good.is_some() {
                        Mode::Fault
                    } else {
                        Mode::Rest
                    };
                    self.change = 0;
                }
                return Ok(());
            }
            Command::RequireConditioning(required) => self.conditioning_required = required,
            Command::Filter { signal, place, row } => self.set_filter(signal, place, &row),
            _ if self.mode == Mode::Fault => return Err(Refusal::Faulted),
            Command::Reference { .. } | Command::FollowInput { .. }
                if self.stepper.get().is_some() =>
            {
                return Err(Refusal::OtherDrive);
            }
            Command::MoveTo { target, velocity } => {
                let closed = self.mode == Mode::Closed;
                let stepper = self.stepper.get_mut().ok_or(Refusal::OtherDrive)?;
                if !closed {
                    return Err(Refusal::LoopOpen);
                }
                stepper.move_to(target, velocity)?;
            }
            Command::Reference {
                waveform: Waveform::Table(_),
                ..
            } if self.mode != Mode::Closed => return Err(Refusal::LoopOpen),
            Command::Reference { waveform, offset } => {
                self.reference = Some((waveform, offset));
                if self.mode == Mode::Closed {
                    self.begin_reference();
                }
            }
            Command::Arm { tested } => {
                self.at_rest()?;
                let begins_without_power = tested && !self.powered && self.output.is_some();
                self.powered = !begins_without_power;
                self.armed = !tested;
                self.tested = false;
                if tested {
                    self.begin_playing(0, 0);
                    self.self_test = Some(SelfTest::new(&self.parameters, begins_without_power));
                }
            }
            _ if !self.armed => return Err(Refusal::NotArmed),
            // A loop that is closed goes on with what it follows.
            Command::Enable if self.mode == Mode::Closed => {}
            Command::Enable => {
                if self.mode == Mode::Playing && self.held_code.is_none() {
                    return Err(Refusal::NotAtRest);
                }
                if self.test_required && !self.tested {
                    return Err(Refusal::NotTested);
                }
                if self.conditioning_required && !self.conditioned {
                    return Err(Refusal::NotConditioned);
                }
                match self.stepper.get_mut() {
                    None => self.begin_reference(),
                    Some(stepper) => stepper.begin(),
                }
                self.guard.begin_loop();
                self.swing.begin(self.code);
                self.mode = Mode::Closed;
            }
            Command::FollowInput { .. } if self.mode != Mode::Closed => {
                return Err(Refusal::LoopOpen);
            }
            Command::FollowInput { most_step } => {
                let limits = command_limits::positions(self.converters(), &self.parameters.guard);
                let input = self.input.as_mut().ok_or(Refusal::NoInput)?;
                let from = self.servo.asked();
                input.begin(from, most_step, limits);
                self.reference = None;
                self.generator = ReferenceGenerator::new(Waveform::Constant, from);
                self.servo.repeat(None);
            }
            Command::Play {
                waveform,
                offset,
                ticks,
            } => {
                self.at_rest()?;
                self.player = ReferenceGenerator::new(waveform, offset);
                self.begin_playing(ticks, 0);
            }
            Command::Hold { drive } => {
                if self.mode == Mode::Playing && self.held_code.is_none() {
                    return Err(Refusal::NotAtRest);
                }
                self.reference = None;
                self.leave_input();
                self.held_code =
                    Some(drive.map_or(self.code, |drive| self.code_for(drive.to_bits())));
                self.mode = Mode::Playing;
            }
            Command::Condition {
                cycle_ticks,
                rest_ticks,
            } => {
                self.at_rest()?;
                let cycle_ticks = cycle_ticks.max(self.shortest_cycle());
                let increment = u32::MAX.checked_div(cycle_ticks).unwrap_or(0);
                self.reference = None;
                self.cycle = Cycle::NONE;
                self.player = self.over_the_range([(increment, 1 << 10), (0, 0), (0, 0), (0, 0)]);
                self.begin_playing(cycle_ticks, rest_ticks.max(ZERO_TICKS));
            }
            Command::Identify { ticks } => {
                self.at_rest()?;
                self.player = self.over_the_range(IDENTIFICATION_TONES);
                self.begin_playing(ticks, 0);
                self.rest_before_ticks = REST_BEFORE_TICKS;
                self.sweep = self.of_half_the_range(IDENTIFICATION_SWEEP);
            }
        }
        Ok(())
    }

    /// Goes on with another block, at rest or with the loop closed, without a step of the drive: the sensor's
    /// zero, the memory of the hysteresis and the reference stay. Call it between ticks.
    ///
    /// # Errors
    /// Why not ([`block_swap::may_follow`]); nothing has changed then.
    pub fn swap(&mut self, parameters: &AmplifierParameters) -> Result<(), &'static str> {
        match self.mode {
            Mode::Fault => return Err("a fault is latched"),
            Mode::Playing => {
                return Err("a drive is played or held: only at rest, or with the loop closed");
            }
            Mode::Rest | Mode::Closed => {}
        }
        block_swap::may_follow(&self.parameters, parameters)?;
        if self.servo.learner().period_ticks().is_some()
            && self.parameters.servo.learning != parameters.servo.learning
        {
            return Err(
                "a learned correction is played that the block would not go on with: a reference without a period first",
            );
        }
        self.parameters = *parameters;
        self.servo.exchange(&self.parameters.servo);
        self.guard.watch_with(self.parameters.guard);
        self.swing.watch_with(&self.parameters);
        Ok(())
    }

    /// Whether an alarm forbids the servo to adapt its gain.
    #[inline]
    pub fn hold_adaptation(&mut self, held: bool) {
        self.servo.hold_adaptation(held);
    }

    /// A drive of tones (phase increment, share of the range in 1024ths) that all begin at their lowest
    /// point, so that it begins at the lower limit.
    fn over_the_range(&self, tones: [(u32, i32); 4]) -> ReferenceGenerator<Volts> {
        let tones = tones.map(|(increment, share)| {
            (
                increment,
                Volts::from_bits(self.of_half_the_range(share)),
                LOWEST_POINT,
            )
        });
        ReferenceGenerator::new(
            Waveform::Multisine { tones },
            Volts::from_bits(self.middle()),
        )
    }

    /// Middle of the drive's range, V with 22 fraction bits.
    fn middle(&self) -> i32 {
        let physical = &self.parameters.physical;
        volts(physical.drive_min_mv / 2 + physical.drive_max_mv / 2)
    }

    /// So many 1024ths of half the drive's range, V with 22 fraction bits.
    fn of_half_the_range(&self, share: i32) -> i32 {
        let half = self
            .middle()
            .saturating_sub(volts(self.parameters.physical.drive_min_mv));
        narrow((i64::from(half) * i64::from(share)) >> 10)
    }

    fn at_rest(&self) -> Result<(), Refusal> {
        if self.mode == Mode::Rest && self.drive_rests() {
            Ok(())
        } else {
            Err(Refusal::NotAtRest)
        }
    }

    /// Ticks that a cycle over the whole range takes at least, so that its steepest part is within the slew
    /// limit: pi times the range.
    fn shortest_cycle(&self) -> u32 {
        let c = &self.parameters.servo.converters;
        let range = u64::from(c.dac_code_max.abs_diff(c.dac_code_min));
        // 20 bits times 22, over 7: pi, rounded up.
        (range * 22)
            .checked_div(7 * u64::from(c.slew_codes))
            .map_or(u32::MAX, |ticks| ticks as u32 + 1)
    }

    fn begin_reference(&mut self) {
        self.leave_input();
        let (waveform, offset) = self
            .reference
            .unwrap_or_else(|| (Waveform::Constant, self.standing()));
        self.generator = ReferenceGenerator::new(waveform, offset);
        self.servo.repeat(waveform.period_ticks());
        self.servo.enable();
    }

    /// Where the stage stands, within what the sensor can honestly give.
    fn standing(&self) -> Micrometres {
        let (lowest, highest) =
            command_limits::positions(self.converters(), &self.parameters.guard);
        let here = self
            .guard
            .last_code()
            .map_or(0, |code| self.converters().position(code));
        Micrometres::from_bits(here).max(lowest).min(highest)
    }

    /// The converters, with the sensor's zero that is in force.
    fn converters(&self) -> &ConverterParameters {
        &self.servo.parameters().converters
    }

    fn begin_playing(&mut self, ticks: u32, rest_after_ticks: u32) {
        self.rest_before_ticks = 0;
        self.sweep = 0;
        self.sweep_tick = 0;
        self.remaining_ticks = ticks;
        self.rest_after_ticks = rest_after_ticks;
        self.zero_sum = 0;
        self.held_code = None;
        self.mode = Mode::Playing;
    }

    /// One period: the reading (`None`: the converter did not answer) in, everything about the period out;
    /// `dac_code` is to act at the next edge.
    #[inline]
    pub fn tick(&mut self, reading: Option<SensorCode>, overrun: bool) -> TraceSample {
        let tick = self.tick;
        self.tick = tick.wrapping_add(1);
        let reading = match self.stepper.get_mut() {
            None => reading,
            Some(stepper) => stepper.read(
                reading,
                &mut self.guard,
                self.mode == Mode::Closed,
                self.mode == Mode::Playing,
            ),
        };
        let mut fault = self.guard.inspect(reading);
        if overrun {
            fault = Some(Fault::Overrun);
        }
        if let Some(fault) = fault {
            self.refuse(fault);
        }
        let before = self.code;
        self.code = match (self.mode, reading) {
            (Mode::Closed, Some(code)) => match self.close(code) {
                Ok(wanted) => wanted,
                Err(fault) => {
                    self.refuse(fault);
                    self.servo.open_loop(self.guard.towards_rest(before))
                }
            },
            (Mode::Playing, Some(code)) => self.play(code),
            _ => self.servo.open_loop(self.guard.towards_rest(before)),
        };
        let step = u64::from(self.code.abs_diff(before));
        self.change = self.change - (self.change >> CURRENT_SHIFT) + step * step;
        if self.change > self.most_change && self.mode != Mode::Fault {
            self.refuse(Fault::DriveCurrent);
        }
        if !self.armed && self.powered && self.self_test.is_none() && self.drive_rests() {
            self.switch_off();
        }
        let (reference, applied) = match self.stepper.get() {
            Some(stepper) => (stepper.target().to_bits(), stepper.position().to_bits()),
            None => (
                if self.mode == Mode::Closed {
                    self.servo.reference().to_bits()
                } else {
                    0
                },
                self.servo.applied().to_bits(),
            ),
        };
        TraceSample {
            tick,
            adc_code: reading.unwrap_or_default(),
            dac_code: self.code,
            reference,
            applied,
            unknown_input: self.servo.unknown_input(),
            flags: self.status().flags(),
        }
    }

    /// The code that the closed loop wants, or what stops it.
    #[inline(always)]
    fn close(&mut self, reading: SensorCode) -> Result<DriveCode, Fault> {
        if let Some(stepper) = self.stepper.get_mut() {
            let parts = Loop {
                servo: &mut self.servo,
                guard: &mut self.guard,
                swing: &mut self.swing,
                code: self.code,
            };
            return stepper.tick(reading, parts);
        }
        let wanted = self.servo.tick(reading, self.generator.next_value());
        let reference = self.servo.reference().to_bits();
        let error = reference.saturating_sub(self.servo.sensed().to_bits());
        let fault = self
            .guard
            .inspect_loop(error, self.servo.slewing())
            .or_else(|| self.swing.inspect(wanted, reference));
        fault.map_or(Ok(wanted), Err)
    }

    /// The power stage is off from now on, and the stage goes its own way.
    fn switch_off(&mut self) {
        self.powered = false;
        self.conditioned = false;
        self.tested = false;
    }

    /// The next code of the self-test.
    #[inline(never)]
    fn test(&mut self, reading: SensorCode) -> DriveCode {
        let Some(aim) = self.self_test.as_ref().map(SelfTest::aim) else {
            return self.code;
        };
        let code = self.servo.open_loop(self.guard.towards(self.code, aim));
        let applied = self.servo.applied().to_bits();
        let verdict = self.self_test.as_mut().and_then(|test| {
            let verdict = test.take(reading, code == aim, applied);
            self.powered |= test.is_powered();
            verdict
        });
        match verdict {
            None => {}
            Some(Ok(())) => {
                self.self_test = None;
                self.armed = true;
                self.tested = true;
                self.mode = Mode::Rest;
            }
            Some(Err(fault)) => self.refuse(fault),
        }
        code
    }

    /// Whether a conditioning did what it is for: both limits of the drive, and a sensor that moves with it.
    ///
    /// # Errors
    /// What it did not.
    fn judge_cycle(&self) -> Result<(), Fault> {
        let (c, cycle) = (&self.parameters.servo.converters, &self.cycle);
        let short = c.dac_code_max.abs_diff(c.dac_code_min) >> RANGE_SHIFT;
        if cycle.highest + short < c.dac_code_max || cycle.lowest > c.dac_code_min + short {
            return Err(Fault::RangeNotReached);
        }
        let expected = cycle.applied.saturating_sub(self.servo.applied().to_bits());
        let motion = Motion {
            measured: i64::from(cycle.reading) * i64::from(ZERO_TICKS) - self.zero_sum,
            expected: has_model(&self.parameters.servo.actuator).then_some(expected),
            noise_codes: cycle.noise.peak_to_peak(),
            adc_step: c.adc_step,
        };
        motion.judge()
    }

    /// The end of a conditioning: the sensor is zeroed where it stands.
    #[inline(never)]
    fn end_conditioning(&mut self) {
        if let Err(fault) = self.judge_cycle() {
            self.refuse(fault);
            return;
        }
        // codes * ZERO_TICKS (2^10) * um/code (40) -> um (24)
        let adc_step = self.parameters.servo.converters.adc_step;
        match self.stepper.get_mut() {
            Some(stepper) => stepper.zero_at_mean(self.zero_sum, ZERO_TICKS),
            None => self
                .servo
                .zero_sensor(-narrow((self.zero_sum * adc_step) >> 26)),
        }
        self.servo.reset_counters();
        self.zeroed = true;
        self.conditioned = true;
        self.tested = true;
        self.mode = Mode::Rest;
    }

    /// The code of a drive, V with 22 fraction bits; [`ServoTick::open_loop`] has its limits.
    #[inline]
    fn code_for(&self, drive: i32) -> DriveCode {
        DriveCode::new(self.parameters.servo.converters.steps(drive).max(0) as u32)
    }

    /// The next code of an open-loop drive.
    #[inline]
    fn play(&mut self, reading: SensorCode) -> DriveCode {
        if self.self_test.is_some() {
            return self.test(reading);
        }
        if let Some(held) = self.held_code {
            return self.servo.open_loop(self.guard.towards(self.code, held));
        }
        if self.rest_before_ticks > 0 {
            self.rest_before_ticks -= 1;
            return self.servo.open_loop(self.guard.towards_rest(self.code));
        }
        if self.remaining_ticks > 0 {
            if self.remaining_ticks != ENDLESS_TICKS {
                self.remaining_ticks -= 1;
            }
            let mut drive = self.player.next_value().to_bits();
            if self.sweep != 0 {
                drive = drive.saturating_add(sweep(self.sweep, self.sweep_tick));
                self.sweep_tick = self.sweep_tick.wrapping_add(1);
            }
            let (code, c) = (self.code_for(drive), &self.parameters.servo.converters);
            let (lowest, highest) = (self.code - c.slew_codes, self.code + c.slew_codes);
            let code = self.servo.open_loop(code.max(lowest).min(highest));
            if code > self.cycle.highest {
                (self.cycle.highest, self.cycle.reading, self.cycle.applied) =
                    (code, reading, self.servo.applied().to_bits());
            }
            self.cycle.lowest = self.cycle.lowest.min(code);
            return code;
        }
        self.player.forget_marks();
        let code = self.servo.open_loop(self.guard.towards_rest(self.code));
        if self.rest_after_ticks == 0 {
            self.mode = Mode::Rest;
            return code;
        }
        if self.rest_after_ticks <= ZERO_TICKS {
            self.zero_sum += i64::from(reading);
            self.cycle.noise.take(reading);
        }
        self.rest_after_ticks -= 1;
        if self.rest_after_ticks == 0 {
            self.end_conditioning();
        }
        code
    }

    /// Whether the drive is at its rest code.
    #[inline]
    #[must_use]
    pub fn drive_rests(&self) -> bool {
        self.code == self.parameters.guard.rest_code
    }

    /// Mode and fault as of now.
    #[inline]
    #[must_use]
    pub fn status(&self) -> Status {
        Status {
            mode: self.mode,
            fault: self.fault,
        }
    }

    /// What it is doing.
    #[must_use]
    pub fn mode(&self) -> Mode {
        self.mode
    }

    /// The latched fault.
    #[must_use]
    pub fn fault(&self) -> Option<Fault> {
        self.fault
    }

    /// Whether the sensor has been zeroed by a conditioning since the start.
    #[inline]
    #[must_use]
    pub fn zeroed(&self) -> bool {
        self.zeroed
    }

    /// Whether the servo's memory of the hysteresis is the stage's: conditioned, and no fault since.
    #[inline]
    #[must_use]
    pub fn conditioned(&self) -> bool {
        self.conditioned
    }

    /// Whether the power stage is to be on.
    #[inline]
    #[must_use]
    pub fn powered(&self) -> bool {
        self.powered
    }

    /// Whether something may be played, and closed where it is tested.
    #[inline]
    #[must_use]
    pub fn armed(&self) -> bool {
        self.armed
    }

    /// Whether the loop closes only behind a conditioning.
    #[inline]
    #[must_use]
    pub fn conditioning_required(&self) -> bool {
        self.conditioning_required
    }

    /// Whether the marked point of a table begins to act, or acts, with the next edge of the sample clock:
    /// the drive that was computed last, or the reference that the next reading is compared with.
    #[inline]
    #[must_use]
    pub fn marks(&self) -> bool {
        match self.mode {
            // What is generated counts so many ticks later.
            Mode::Closed => self.generator.marked(PREVIEW_TICKS - 1),
            Mode::Playing => self.held_code.is_none() && self.player.marked(0),
            Mode::Rest | Mode::Fault => false,
        }
    }

    /// What makes it a stick-slip drive; `None` for any other drive.
    #[inline]
    #[must_use]
    pub fn stepper(&self) -> Option<&Stepper> {
        self.stepper.get()
    }

    /// The servo.
    #[must_use]
    pub fn servo(&self) -> &ServoTick {
        &self.servo
    }

    /// The block in force. The sensor's zero as it was found is the servo's.
    #[must_use]
    pub fn parameters(&self) -> &AmplifierParameters {
        &self.parameters
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;
    use crate::parameter_block::tests::example;
    use crate::signal::Quantity;
    use crate::wave_table::{POINT_FRACTION_BITS, WaveTable};
    use core::sync::atomic::{AtomicI32, Ordering};
    use std::vec::Vec;

    /// A massless linear actuator with a gain of 1/7 um/V and a little noise, read by the ADC of the example.
    fn reading(code: DriveCode, tick: u32) -> SensorCode {
        let volts = f64::from(code) * 140.0 / 65_536.0 - 20.0;
        SensorCode::new(
            ((volts / 7.0 + 1.0) / 15.0 * 65_536.0) as u32
                + (tick.wrapping_mul(2_654_435_761) >> 30),
        )
    }

    /// At rest, armed by somebody who knows the stage.
    fn armed(parameters: AmplifierParameters) -> Amplifier {
        let mut amplifier = Amplifier::new(parameters);
        assert_eq!(amplifier.command(Command::Arm { tested: false }), Ok(()));
        amplifier
    }

    #[test]
    fn an_identification_of_a_150_v_actuator_sweeps_its_range() {
        let mut parameters = example();
        parameters.physical.drive_max_mv = 150_000;
        let c = &mut parameters.servo.converters;
        (c.dac_zero, c.dac_step, c.dac_codes_per_volt) =
            (0, (200i64 << 38) >> 16, ((65_536i64 << 16) / 200) as i32);
        (c.dac_code_min, c.dac_code_max) = (DriveCode::new(0), DriveCode::new(49_152));
        parameters.guard.rest_code = DriveCode::new(0);
        let mut amplifier = armed(parameters);
        assert_eq!(
            amplifier.command(Command::Identify { ticks: 20_000 }),
            Ok(())
        );
        for k in 0..REST_BEFORE_TICKS {
            assert_eq!(
                amplifier
                    .tick(Some(reading(DriveCode::new(9_362), k)), false)
                    .dac_code,
                DriveCode::new(0),
                "rests first"
            );
        }
        let (mut highest, mut before) = (DriveCode::new(0), DriveCode::new(0));
        for k in 0..20_000 {
            let sample = amplifier.tick(Some(reading(DriveCode::new(9_362), k)), false);
            // The sweep's 2 % of half the range to either side, and what the tones move in a tick.
            assert!(sample.dac_code.abs_diff(before) < 1_300, "no jump");
            before = sample.dac_code;
            highest = highest.max(before);
        }
        assert!(highest > DriveCode::new(47_000), "{highest}");
    }

    #[test]
    fn a_drive_is_held_and_the_loop_closes_from_there() {
        let mut amplifier = armed(example());
        assert_eq!(
            amplifier.command(Command::RequireConditioning(false)),
            Ok(())
        );
        let mut code = amplifier.parameters().guard.rest_code;
        let mut run = |amplifier: &mut Amplifier, ticks: u32| {
            let mut largest_step = 0;
            for k in 0..ticks {
                let next = amplifier.tick(Some(reading(code, k)), false).dac_code;
                largest_step = largest_step.max(next.abs_diff(code));
                code = next;
            }
            (code, largest_step)
        };
        run(&mut amplifier, 10);
        assert_eq!(
            amplifier.command(Command::Hold {
                drive: Some(Volts::from_num(35))
            }),
            Ok(())
        );
        let ramp = amplifier.parameters().guard.ramp_codes;
        // The example's converter: -20 V at code 0, 140 V over 65536 codes.
        assert_eq!(run(&mut amplifier, 4000), (DriveCode::new(25_746), ramp));
        assert_eq!(amplifier.mode(), Mode::Playing);
        assert_eq!(
            amplifier.command(Command::Play {
                waveform: Waveform::Constant,
                offset: Volts::from_bits(0),
                ticks: 5
            }),
            Err(Refusal::NotAtRest)
        );
        assert_eq!(amplifier.command(Command::Hold { drive: None }), Ok(()));
        assert_eq!(run(&mut amplifier, 10), (DriveCode::new(25_746), 0));
        assert_eq!(
            amplifier.command(Command::Reference {
                waveform: Waveform::Constant,
                offset: Micrometres::from_num(5)
            }),
            Ok(())
        );
        assert_eq!(amplifier.command(Command::Enable), Ok(()));
        run(&mut amplifier, 8000);
        assert_eq!(amplifier.mode(), Mode::Closed);
        assert!((amplifier.servo().reading().to_num::<f64>() - 5.0).abs() < 0.01);
        let (closed, _) = run(&mut amplifier, 1);
        assert_eq!(amplifier.command(Command::Hold { drive: None }), Ok(()));
        assert_eq!(run(&mut amplifier, 100), (closed, 0));
        assert_eq!(
            amplifier.command(Command::Hold {
                drive: Some(Volts::MAX)
            }),
            Ok(())
        );
        assert_eq!(
            run(&mut amplifier, 8000).0,
            amplifier.parameters().servo.converters.dac_code_max
        );
        assert_eq!(amplifier.command(Command::Disable), Ok(()));
        assert_eq!(
            run(&mut amplifier, 8000).0,
            amplifier.parameters().guard.rest_code
        );
    }

    #[test]
    fn the_zero_that_a_conditioning_finds_is_the_servos_and_outlives_a_swap() {
        let block = example();
        let mut amplifier = armed(block);
        let mut code = block.guard.rest_code;
        let condition = Command::Condition {
            cycle_ticks: 2000,
            rest_ticks: 2000,
        };
        assert_eq!(amplifier.command(condition), Ok(()));
        for tick in 0..4500 {
            code = amplifier.tick(Some(reading(code, tick)), false).dac_code;
        }
        let zero = |amplifier: &Amplifier| amplifier.servo().parameters().converters.adc_zero;
        let found = zero(&amplifier);
        assert!(amplifier.zeroed() && found != block.servo.converters.adc_zero);
        assert_eq!(amplifier.parameters(), &block);
        let mut other = block;
        other.servo.converters.adc_zero += 1000;
        assert_eq!(amplifier.swap(&other), Ok(()));
        assert_eq!((zero(&amplifier), amplifier.parameters()), (found, &other));
    }

    #[test]
    fn conditions_zeroes_and_follows_then_a_fault_rests_and_is_cleared() {
        let mut amplifier = armed(example());
        let mut code = amplifier.parameters().guard.rest_code;
        let mut run = |amplifier: &mut Amplifier, ticks: u32, sensor: bool| {
            let mut last = TraceSample::default();
            for k in 0..ticks {
                let adc = reading(code, k);
                last = amplifier.tick(sensor.then_some(adc), false);
                code = last.dac_code;
            }
            last
        };
        run(&mut amplifier, 1000, true);
        assert_eq!(
            amplifier.command(Command::Enable),
            Err(Refusal::NotConditioned)
        );
        let condition = Command::Condition {
            cycle_ticks: 2000,
            rest_ticks: 2000,
        };
        assert_eq!(amplifier.command(condition), Ok(()));
        assert_eq!(amplifier.command(Command::Enable), Err(Refusal::NotAtRest));
        run(&mut amplifier, 2500, true);
        // A conditioning that was stopped does not count.
        assert_eq!(amplifier.command(Command::Disable), Ok(()));
        run(&mut amplifier, 4500, true);
        assert_eq!(
            amplifier.command(Command::Enable),
            Err(Refusal::NotConditioned)
        );
        assert_eq!(amplifier.command(condition), Ok(()));
        run(&mut amplifier, 4500, true);
        assert_eq!(amplifier.mode(), Mode::Rest);
        assert_eq!(
            amplifier.command(Command::Reference {
                waveform: Waveform::Constant,
                offset: Micrometres::from_num(5)
            }),
            Ok(())
        );
        assert_eq!(amplifier.command(Command::Enable), Ok(()));
        run(&mut amplifier, 8000, true);
        let error_um = amplifier.servo().reading().to_num::<f64>() - 5.0;
        assert!(error_um.abs() < 0.01, "{error_um}");
        let last = run(&mut amplifier, 1, false);
        assert_eq!(
            (last.flags & 0xff, last.flags >> 8),
            (Mode::Fault as u16, Fault::SensorSilent as u16)
        );
        let last = run(&mut amplifier, 2000, false);
        assert_eq!(last.dac_code, amplifier.parameters().guard.rest_code);
        assert_eq!(
            amplifier.command(Command::Clear),
            Err(Refusal::NotYetHealthy)
        );
        assert_eq!(amplifier.command(Command::Enable), Err(Refusal::Faulted));
        run(&mut amplifier, 1100, true);
        assert_eq!(amplifier.command(Command::Clear), Ok(()));
        assert_eq!(amplifier.command(Command::Enable), Err(Refusal::NotArmed));
        assert_eq!(amplifier.command(Command::Arm { tested: false }), Ok(()));
        // At a fault the power stage is switched off, and nobody knows what the stage did.
        assert_eq!(
            amplifier.command(Command::Enable),
            Err(Refusal::NotConditioned)
        );
        assert_eq!(amplifier.command(condition), Ok(()));
        run(&mut amplifier, 4500, true);
        // An open-loop drive and a rest of any length lose nothing.
        assert_eq!(
            amplifier.command(Command::Play {
                waveform: Waveform::Constant,
                offset: Volts::from_num(9),
                ticks: 500
            }),
            Ok(())
        );
        run(&mut amplifier, 20_000, true);
        assert_eq!(amplifier.command(Command::Enable), Ok(()));
        run(&mut amplifier, 8000, true);
        assert_eq!((amplifier.mode(), amplifier.fault()), (Mode::Closed, None));
    }

    #[test]
    fn a_marked_point_is_told_for_the_edge_at_which_it_acts() {
        static POINTS: [AtomicI32; 4] = [const { AtomicI32::new(3 << POINT_FRACTION_BITS) }; 4];
        POINTS[2].store(4 << POINT_FRACTION_BITS, Ordering::Relaxed);
        fn table<Q: Quantity>() -> Waveform<Q> {
            Waveform::Table(WaveTable::new(&POINTS, 5, false, 3).marking(3))
        }
        let mut amplifier = armed(example());
        let mut code = amplifier.parameters().guard.rest_code;
        // The commands before a tick, and the tick.
        let mut run = |amplifier: &mut Amplifier, ticks: u32| -> Vec<(bool, TraceSample)> {
            (0..ticks)
                .map(|k| {
                    let told = amplifier.marks();
                    let sample = amplifier.tick(Some(reading(code, k)), false);
                    code = sample.dac_code;
                    (told, sample)
                })
                .collect()
        };
        run(&mut amplifier, 10);
        assert_eq!(
            amplifier.command(Command::Play {
                waveform: table(),
                offset: Volts::from_bits(0),
                ticks: 60
            }),
            Ok(())
        );
        let open = run(&mut amplifier, 70);
        // 23 V above the converter's -20 V, 24 V at the marked point: the code of a tick acts at the edge
        // before the next one.
        let high = DriveCode::new(24 * 65_536 / 140);
        let acts: Vec<bool> = open
            .windows(2)
            .map(|pair| pair[0].1.dac_code.abs_diff(high) < 200)
            .collect();
        let told: Vec<bool> = open.iter().skip(1).map(|(told, _)| *told).collect();
        assert_eq!(told.iter().filter(|told| **told).count(), 15);
        assert_eq!(told, acts);
        assert_eq!(
            amplifier.command(Command::RequireConditioning(false)),
            Ok(())
        );
        run(&mut amplifier, 4000);
        let wave = Command::Reference {
            waveform: table(),
            offset: Micrometres::from_bits(0),
        };
        assert_eq!(amplifier.command(wave), Err(Refusal::LoopOpen));
        assert_eq!(
            (amplifier.command(Command::Enable), amplifier.command(wave)),
            (Ok(()), Ok(()))
        );
        let closed = run(&mut amplifier, 80);
        assert_eq!(closed.iter().filter(|(told, _)| *told).count(), 15);
        // The reference rises with the marked point, whatever offset it still has from the beginning of the
        // loop.
        for pair in closed.windows(2).filter(|pair| pair[0].0 != pair[1].0) {
            let step = pair[1].1.reference - pair[0].1.reference;
            assert!((if pair[1].0 { step } else { -step }) > 1 << 23, "{pair:?}");
        }
        assert_eq!(amplifier.command(Command::Disable), Ok(()));
        assert!(
            run(&mut amplifier, 20)
                .iter()
                .skip(1)
                .all(|(told, _)| !told),
            "at rest nothing is marked"
        );
    }

    #[test]
    fn a_reference_from_before_a_stop_is_not_played_again() {
        let mut amplifier = armed(example());
        let mut code = amplifier.parameters().guard.rest_code;
        let mut run = |amplifier: &mut Amplifier, ticks: u32| {
            (0..ticks)
                .map(|k| {
                    let sample = amplifier.tick(Some(reading(code, k)), false);
                    code = sample.dac_code;
                    sample.reference
                })
                .last()
        };
        run(&mut amplifier, 10);
        assert_eq!(
            amplifier.command(Command::RequireConditioning(false)),
            Ok(())
        );
        let far = Command::Reference {
            waveform: Waveform::Constant,
            offset: Micrometres::from_num(8),
        };
        assert_eq!(
            (amplifier.command(far), amplifier.command(Command::Enable)),
            (Ok(()), Ok(()))
        );
        run(&mut amplifier, 4000);
        assert_eq!(amplifier.command(Command::Disable), Ok(()));
        run(&mut amplifier, 4000);
        // Rest is near 0 um; nobody has asked for 8 um since.
        assert_eq!(amplifier.command(Command::Enable), Ok(()));
        assert!(run(&mut amplifier, 4000).is_some_and(|reference| reference < 1 << 24));
        // Nor does a reference act that the sensor cannot show.
        assert_eq!(amplifier.command(Command::Disable), Ok(()));
        run(&mut amplifier, 4000);
        let beyond = Command::Reference {
            waveform: Waveform::Constant,
            offset: Micrometres::from_num(100),
        };
        let refused = amplifier
            .command(beyond)
            .and_then(|()| amplifier.command(Command::Enable));
        assert_eq!(refused, Err(Refusal::BeyondLimits));
    }

    #[test]
    fn nothing_moves_until_somebody_arms_and_the_power_stage_follows() {
        let mut amplifier = Amplifier::new(example());
        let mut code = amplifier.parameters().guard.rest_code;
        let mut run = |amplifier: &mut Amplifier, ticks: u32, sensor: bool| {
            for k in 0..ticks {
                code = amplifier
                    .tick(sensor.then(|| reading(code, k)), false)
                    .dac_code;
            }
            (amplifier.powered(), amplifier.armed(), amplifier.mode())
        };
        let play = Command::Play {
            waveform: Waveform::Constant,
            offset: Volts::from_num(9),
            ticks: 500,
        };
        let condition = Command::Condition {
            cycle_ticks: 2000,
            rest_ticks: 2000,
        };
        assert_eq!(
            amplifier.command(Command::RequireConditioning(false)),
            Ok(())
        );
        for command in [
            play,
            condition,
            Command::Enable,
            Command::Identify { ticks: 9 },
            Command::Hold { drive: None },
        ] {
            assert_eq!(amplifier.command(command), Err(Refusal::NotArmed));
        }
        assert_eq!(run(&mut amplifier, 100, true), (false, false, Mode::Rest));
        assert_eq!(amplifier.command(Command::Arm { tested: true }), Ok(()));
        assert_eq!(
            run(&mut amplifier, 3000, true),
            (true, false, Mode::Playing),
            "the self-test"
        );
        assert_eq!(run(&mut amplifier, 7000, true), (true, true, Mode::Rest));
        assert_eq!(amplifier.command(condition), Ok(()));
        assert_eq!(run(&mut amplifier, 4500, true), (true, true, Mode::Rest));
        assert!(amplifier.conditioned());
        // A stop keeps it armed; whoever disarms switches off, and nobody knows the stage's memory then.
        assert_eq!(
            (
                amplifier.command(Command::Enable),
                amplifier.command(Command::Disable)
            ),
            (Ok(()), Ok(()))
        );
        assert_eq!(run(&mut amplifier, 1000, true), (true, true, Mode::Rest));
        assert_eq!(
            (amplifier.command(play), run(&mut amplifier, 100, true)),
            (Ok(()), (true, true, Mode::Playing))
        );
        assert_eq!(
            (amplifier.command(Command::Disarm), amplifier.powered()),
            (Ok(()), true),
            "until it rests"
        );
        assert_eq!(run(&mut amplifier, 1000, true), (false, false, Mode::Rest));
        assert!(!amplifier.conditioned());
        // A self-test that is stopped does not count, and a sensor that does not follow it is a fault.
        assert_eq!(amplifier.command(Command::Arm { tested: true }), Ok(()));
        run(&mut amplifier, 4000, true);
        assert_eq!(amplifier.command(Command::Disable), Ok(()));
        assert_eq!(run(&mut amplifier, 1000, true), (false, false, Mode::Rest));
        assert_eq!(amplifier.command(Command::Arm { tested: true }), Ok(()));
        let rest = amplifier.parameters().guard.rest_code;
        for k in 0..10_000 {
            amplifier.tick(Some(reading(rest, k)), false);
        }
        assert_eq!(
            (amplifier.fault(), amplifier.powered()),
            (Some(Fault::SensorDoesNotMove), false)
        );
    }

    #[test]
    fn a_loop_that_nothing_has_tried_is_not_closed() {
        let mut amplifier = armed(example());
        amplifier.require_test();
        assert_eq!(
            amplifier.command(Command::RequireConditioning(false)),
            Ok(())
        );
        assert_eq!(amplifier.command(Command::Enable), Err(Refusal::NotTested));
        let condition = Command::Condition {
            cycle_ticks: 2000,
            rest_ticks: 2000,
        };
        assert_eq!(amplifier.command(condition), Ok(()));
        let mut code = amplifier.parameters().guard.rest_code;
        for k in 0..4500 {
            code = amplifier.tick(Some(reading(code, k)), false).dac_code;
        }
        assert_eq!(amplifier.command(Command::Enable), Ok(()));
        // Who closes a closed loop again does not begin its reference anew.
        let sine = Waveform::Multisine {
            tones: [
                (1 << 20, Micrometres::from_num(1), 0),
                (0, Micrometres::from_bits(0), 0),
                (0, Micrometres::from_bits(0), 0),
                (0, Micrometres::from_bits(0), 0),
            ],
        };
        let follow = Command::Reference {
            waveform: sine,
            offset: Micrometres::from_num(5),
        };
        assert_eq!(amplifier.command(follow), Ok(()));
        let mut before = 0;
        for k in 0..2000 {
            if k == 1500 {
                assert_eq!(amplifier.command(Command::Enable), Ok(()));
            }
            let sample = amplifier.tick(Some(reading(code, k)), false);
            assert!(
                k < 1000 || sample.reference.abs_diff(before) < 1 << 17,
                "{k}"
            );
            (code, before) = (sample.dac_code, sample.reference);
        }
        // Somebody switches off and on again.
        assert_eq!(amplifier.command(Command::Disarm), Ok(()));
        for k in 0..2000 {
            code = amplifier.tick(Some(reading(code, k)), false).dac_code;
        }
        assert_eq!(amplifier.command(Command::Arm { tested: false }), Ok(()));
        assert_eq!(amplifier.command(Command::Enable), Err(Refusal::NotTested));
    }

    #[test]
    fn an_endless_drive_is_played_without_an_end() {
        let mut amplifier = armed(example());
        let endless = Command::Play {
            waveform: Waveform::Constant,
            offset: Volts::from_num(9),
            ticks: ENDLESS_TICKS,
        };
        assert_eq!(amplifier.command(endless), Ok(()));
        let left = amplifier.remaining_ticks;
        for k in 0..100 {
            amplifier.tick(Some(reading(DriveCode::new(9_362), k)), false);
        }
        assert_eq!(
            (left, amplifier.remaining_ticks),
            (ENDLESS_TICKS, ENDLESS_TICKS)
        );
    }

    #[test]
    fn a_drive_that_takes_more_current_than_it_may_goes_to_rest() {
        let run = |mean_square_codes| {
            let mut amplifier = armed(example());
            amplifier.limit_current(mean_square_codes);
            let mut code = amplifier.parameters().guard.rest_code;
            // 100 Hz from 10 to 50 V: 0.44 V a tick RMS, 208 codes.
            let tone = (((100u64 << 32) / 20_000) as u32, Volts::from_num(20), 0);
            let none = (0, Volts::ZERO, 0);
            let waveform = Waveform::Multisine {
                tones: [tone, none, none, none],
            };
            assert_eq!(
                amplifier.command(Command::Play {
                    waveform,
                    offset: Volts::from_num(30),
                    ticks: 80_000
                }),
                Ok(())
            );
            let stopped = (0..80_000).find(|k| {
                code = amplifier.tick(Some(reading(code, *k)), false).dac_code;
                amplifier.mode() == Mode::Fault
            });
            (stopped, amplifier.fault())
        };
        assert_eq!(run(215 * 215), (None, None));
        let (stopped, fault) = run(200 * 200);
        assert!(
            stopped.is_some_and(|tick| (16_384..60_000).contains(&tick)),
            "{stopped:?}"
        );
        assert_eq!(fault, Some(Fault::DriveCurrent));
    }

    /// Conditions an actuator that is read through `sensor`; the conditioned state and the mode behind it.
    fn condition(
        parameters: AmplifierParameters,
        sensor: impl Fn(DriveCode, u32) -> SensorCode,
    ) -> (bool, Mode, DriveCode) {
        let mut amplifier = armed(parameters);
        let (mut code, mut highest) = (parameters.guard.rest_code, DriveCode::new(0));
        assert_eq!(
            amplifier.command(Command::Condition {
                cycle_ticks: 2000,
                rest_ticks: 2000
            }),
            Ok(())
        );
        for k in 0..200_000 {
            code = amplifier.tick(Some(sensor(code, k)), false).dac_code;
            highest = highest.max(code);
        }
        (amplifier.conditioned(), amplifier.mode(), highest)
    }

    #[test]
    fn a_conditioning_reaches_the_whole_range_however_slow_the_amplifier_is() {
        for slew_codes in [1, 20, 468, 2340] {
            let mut parameters = example();
            parameters.servo.converters.slew_codes = slew_codes;
            parameters.guard.ramp_codes = slew_codes.min(40);
            let (conditioned, _, highest) = condition(parameters, reading);
            let short = parameters.servo.converters.dac_code_max.abs_diff(highest);
            std::println!(
                "slew {slew_codes} codes a tick: the cycle ends {short} codes below the highest drive"
            );
            assert!(conditioned && short < 40, "{slew_codes}: {short}");
        }
    }

    #[test]
    fn a_dead_amplifier_and_a_reversed_sensor_are_not_conditioned() {
        let rest = example().guard.rest_code;
        let dead = |_, tick| reading(rest, tick);
        let reversed = |code, tick| SensorCode::new(65_536 - reading(code, tick).steps());
        let tenth = |code: DriveCode, tick| reading(rest + (code.abs_diff(rest) / 10), tick);
        for (nth, (conditioned, mode, _)) in [
            condition(example(), dead),
            condition(example(), reversed),
            condition(example(), tenth),
        ]
        .into_iter()
        .enumerate()
        {
            assert_eq!((conditioned, mode), (false, Mode::Fault), "{nth}");
        }
    }

    #[test]
    fn an_operator_who_knows_the_stage_closes_the_loop_without_a_conditioning() {
        let mut amplifier = armed(example());
        assert_eq!(
            amplifier.command(Command::Enable),
            Err(Refusal::NotConditioned)
        );
        assert_eq!(
            amplifier.command(Command::RequireConditioning(false)),
            Ok(())
        );
        assert_eq!(amplifier.command(Command::Enable), Ok(()));
        assert_eq!(amplifier.mode(), Mode::Closed);
        assert_eq!(amplifier.command(Command::Disable), Ok(()));
        assert_eq!(
            amplifier.command(Command::RequireConditioning(true)),
            Ok(())
        );
        assert_eq!(
            amplifier.command(Command::Enable),
            Err(Refusal::NotConditioned)
        );
    }
}
