//! What the control interrupt runs: servo, guard and modes. The host simulation and the emulator run the same, bit for bit.
//!
//! # How it works
//! [`Amplifier::tick`] is called once a period with the reading and returns what leaves in that period. Commands are given between
//! ticks with [`Amplifier::command`].
//!
//! | mode | drive |
//! |---|---|
//! | [`Mode::Rest`] | ramps to the rest code and stays |
//! | [`Mode::Playing`] | an open-loop waveform within the limits: conditioning, identification; or a drive that is held |
//! | [`Mode::Closed`] | the servo |
//! | [`Mode::Fault`] | ramps to the rest code and stays, until the fault is cleared and the sensor was healthy long enough |
//!
//! In every mode the drive changes by no more than the slew limit of the block in one tick.
//!
//! Conditioning is a played raised cosine of a given length over the whole range, a rest, and then the sensor is zeroed at the mean of the last
//! [`ZERO_TICKS`] readings.
//!
//! # What conditioned means
//! The servo inverts the hysteresis from a memory of its own, the drives of the past as it knows them, and that must be the stage's. A cycle over the
//! whole range wipes out every loop in both, so behind it they agree, and the sensor's zero is that of this memory. They go on agreeing for as
//! long as every drive is one that was written here: through rest, open-loop drives and closed loops, however long, because the memory of a
//! hysteresis does not fade. They no longer do after a start, and after every fault: there the amplifier's power stage was switched off, and the
//! stage went its own way. The loop closes only while they agree ([`Amplifier::conditioned`]), unless that is waived
//! ([`Command::RequireConditioning`]).

use crate::block_swap;
use crate::codes::{DriveCode, SensorCode};
use crate::guard::{Fault, Guard};
use crate::parameter_block::AmplifierParameters;
use crate::reference_generator::{LOWEST_POINT, ReferenceGenerator, Waveform, sweep};
use crate::reference_window::PREVIEW_TICKS;
use crate::servo_tick::ServoTick;
use crate::signal::{Micrometres, narrow, volts};
use crate::trace_frame::TraceSample;

/// Readings whose mean is the sensor's zero.
pub const ZERO_TICKS: u32 = 1024;

/// Rest that an identification begins with, ticks.
pub const REST_BEFORE_TICKS: u32 = 4096;

/// Tones of an identification: phase increment and share of the range in 1024ths. 2, 17.3 and 131 Hz at 20 kHz, with 63, 25 and 10 % of the range.
pub const IDENTIFICATION_TONES: [(u32, i32); 4] = [(429_497, 646), (3_715_146, 256), (28_132_034, 102), (0, 0)];
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

/// What the amplifier can be told.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Command {
    /// Closes the loop.
    Enable,
    /// Opens it and goes to rest.
    Disable,
    /// Follows another reference.
    Reference {
        /// Its form, amplitudes in um with 24 fraction bits.
        waveform: Waveform,
        /// Its offset, um with 24 fraction bits.
        offset: i32,
    },
    /// Plays an open-loop drive, then goes to rest.
    Play {
        /// Its form, amplitudes in V with 22 fraction bits.
        waveform: Waveform,
        /// Its offset, V with 22 fraction bits.
        offset: i32,
        /// How long, ticks.
        ticks: u32,
    },
    /// Plays one cycle over the whole range, rests, and zeroes the sensor.
    Condition {
        /// Length of the cycle, ticks.
        cycle_ticks: u32,
        /// Length of the rest, ticks; at least [`ZERO_TICKS`].
        rest_ticks: u32,
    },
    /// Rests for [`REST_BEFORE_TICKS`], which shows the noise and that the record begins settled, plays tones that together go over the
    /// whole range, from its lower end, with a small sweep to nearly half the sampling rate on top, then goes to rest: what an identification needs of
    /// slow loops, nested loops and dynamics up to the highest frequency at which a servo acts.
    Identify {
        /// How long the tones last, ticks.
        ticks: u32,
    },
    /// Goes to an open-loop drive, no faster than to rest, and holds it; the loop can be closed from there.
    Hold {
        /// The drive, V with 22 fraction bits, held within its limits; `None`: where it is.
        drive: Option<i32>,
    },
    /// Clears the fault, if the sensor has been healthy long enough.
    Clear,
    /// Whether the loop closes only behind a conditioning, as after every start, or whatever the stage's memory is.
    RequireConditioning(bool),
}

/// Why a command is refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Refusal {
    /// A fault is latched.
    Faulted,
    /// The sensor has not been healthy long enough.
    NotYetHealthy,
    /// Only at rest, the ramp there ended.
    NotAtRest,
    /// There is no valid parameter block, and nothing but a block and a restart helps.
    NoBlock,
    /// The actuator was not conditioned since the start or the last fault.
    NotConditioned,
    /// A reference or a drive leaves its limits ([`crate::command_limits`]).
    BeyondLimits,
}

/// The amplifier with all its state.
// In this order: the servo holds what it has learned, and what stands behind that is beyond the reach of an instruction.
#[derive(Clone, Debug)]
#[repr(C)]
pub struct Amplifier {
    guard: Guard,
    mode: Mode,
    fault: Option<Fault>,
    without_block: bool,
    reference: (Waveform, i32),
    generator: ReferenceGenerator,
    rest_before_ticks: u32,
    /// Amplitude of the sweep beside what is played, V with 22 fraction bits; 0 for none.
    sweep: i32,
    sweep_tick: u32,
    remaining_ticks: u32,
    rest_after_ticks: u32,
    zero_sum: i64,
    /// What is played is this code, until something else is told.
    held_code: Option<DriveCode>,
    zeroed: bool,
    conditioned: bool,
    conditioning_required: bool,
    code: DriveCode,
    tick: u32,
    parameters: AmplifierParameters,
    servo: ServoTick,
}

impl Amplifier {
    /// At rest. Without a valid block it is made from any parameters and [`Amplifier::refuse`]d at once.
    #[must_use]
    pub fn new(parameters: AmplifierParameters) -> Self {
        let mut servo = ServoTick::new(parameters.servo);
        let code = servo.open_loop(parameters.guard.rest_code);
        Self {
            servo,
            guard: Guard::new(parameters.guard),
            mode: Mode::Rest,
            fault: None,
            without_block: false,
            reference: (Waveform::Constant, 0),
            generator: ReferenceGenerator::new(Waveform::Constant, Micrometres::from_bits(0)),
            rest_before_ticks: 0,
            sweep: 0,
            sweep_tick: 0,
            remaining_ticks: 0,
            rest_after_ticks: 0,
            zero_sum: 0,
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
    pub fn refuse(&mut self, fault: Fault) {
        self.fault.get_or_insert(fault);
        self.mode = Mode::Fault;
        self.conditioned = false;
    }

    /// Stops for want of a parameter block. A fault that was found before stays in front; when it has been cleared this one is named, and
    /// nothing clears it.
    pub fn refuse_without_block(&mut self) {
        self.without_block = true;
        self.refuse(Fault::ParameterBlock);
    }

    /// Takes a command.
    ///
    /// # Errors
    /// [`Refusal`]; nothing has changed then.
    pub fn command(&mut self, command: Command) -> Result<(), Refusal> {
        match command {
            Command::Disable => {
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
                    if self.without_block && self.fault == Some(Fault::ParameterBlock) {
                        return Err(Refusal::NoBlock);
                    }
                    self.fault = self.without_block.then_some(Fault::ParameterBlock);
                    self.mode = if self.without_block { Mode::Fault } else { Mode::Rest };
                }
                return Ok(());
            }
            Command::RequireConditioning(required) => self.conditioning_required = required,
            _ if self.mode == Mode::Fault => return Err(Refusal::Faulted),
            Command::Enable => {
                if self.mode == Mode::Playing && self.held_code.is_none() {
                    return Err(Refusal::NotAtRest);
                }
                if self.conditioning_required && !self.conditioned {
                    return Err(Refusal::NotConditioned);
                }
                self.begin_reference();
                self.mode = Mode::Closed;
            }
            Command::Reference { waveform, offset } => {
                self.reference = (waveform, offset);
                if self.mode == Mode::Closed {
                    self.begin_reference();
                }
            }
            Command::Play { waveform, offset, ticks } => {
                self.at_rest()?;
                self.generator = ReferenceGenerator::new(waveform, Micrometres::from_bits(offset));
                self.begin_playing(ticks, 0);
            }
            Command::Hold { drive } => {
                if self.mode == Mode::Playing && self.held_code.is_none() {
                    return Err(Refusal::NotAtRest);
                }
                self.held_code = Some(drive.map_or(self.code, |drive| self.code_for(drive)));
                self.mode = Mode::Playing;
            }
            Command::Condition { cycle_ticks, rest_ticks } => {
                self.at_rest()?;
                let increment = u32::MAX.checked_div(cycle_ticks).unwrap_or(0);
                self.generator = self.over_the_range([(increment, 1 << 10), (0, 0), (0, 0), (0, 0)]);
                self.begin_playing(cycle_ticks, rest_ticks.max(ZERO_TICKS));
            }
            Command::Identify { ticks } => {
                self.at_rest()?;
                self.generator = self.over_the_range(IDENTIFICATION_TONES);
                self.begin_playing(ticks, 0);
                self.rest_before_ticks = REST_BEFORE_TICKS;
                self.sweep = self.of_half_the_range(IDENTIFICATION_SWEEP);
            }
        }
        Ok(())
    }

    /// Goes on with another block, at rest or with the loop closed, without a step of the drive: the sensor's zero, the memory of the hysteresis and the
    /// reference stay. Call it between ticks.
    ///
    /// # Errors
    /// Why not ([`block_swap::may_follow`]); nothing has changed then.
    pub fn swap(&mut self, parameters: &AmplifierParameters) -> Result<(), &'static str> {
        match self.mode {
            Mode::Fault => return Err("a fault is latched"),
            Mode::Playing => return Err("a drive is played or held: only at rest, or with the loop closed"),
            Mode::Rest | Mode::Closed => {}
        }
        block_swap::may_follow(&self.parameters, parameters)?;
        if self.servo.learner().period_ticks().is_some() && self.parameters.servo.learning != parameters.servo.learning {
            return Err("a learned correction is played that the block would not go on with: a reference without a period first");
        }
        let zero = self.parameters.servo.converters.adc_zero;
        self.parameters = *parameters;
        self.parameters.servo.converters.adc_zero = zero;
        self.servo.exchange(&self.parameters.servo);
        self.guard.watch_with(self.parameters.guard);
        Ok(())
    }

    /// Whether an alarm forbids the servo to adapt its gain.
    #[inline]
    pub fn hold_adaptation(&mut self, held: bool) {
        self.servo.hold_adaptation(held);
    }

    /// A drive of tones (phase increment, share of the range in 1024ths) that all begin at their lowest point, so that it begins at the lower
    /// limit.
    fn over_the_range(&self, tones: [(u32, i32); 4]) -> ReferenceGenerator {
        let tones = tones.map(|(increment, share)| (increment, self.of_half_the_range(share), LOWEST_POINT));
        ReferenceGenerator::new(Waveform::Multisine { tones }, Micrometres::from_bits(self.middle()))
    }

    /// Middle of the drive's range, V with 22 fraction bits.
    fn middle(&self) -> i32 {
        let physical = &self.parameters.physical;
        volts(physical.drive_min_mv / 2 + physical.drive_max_mv / 2)
    }

    /// So many 1024ths of half the drive's range, V with 22 fraction bits.
    fn of_half_the_range(&self, share: i32) -> i32 {
        let half = self.middle().saturating_sub(volts(self.parameters.physical.drive_min_mv));
        narrow((i64::from(half) * i64::from(share)) >> 10)
    }

    fn at_rest(&self) -> Result<(), Refusal> {
        if self.mode == Mode::Rest && self.drive_rests() { Ok(()) } else { Err(Refusal::NotAtRest) }
    }

    fn begin_reference(&mut self) {
        let (waveform, offset) = self.reference;
        self.generator = ReferenceGenerator::new(waveform, Micrometres::from_bits(offset));
        self.servo.repeat(waveform.period_ticks());
        self.servo.enable();
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

    /// One period: the reading (`None`: the converter did not answer) in, everything about the period out; `dac_code` is to act at
    /// the next edge.
    #[inline]
    pub fn tick(&mut self, reading: Option<SensorCode>, overrun: bool) -> TraceSample {
        let tick = self.tick;
        self.tick = tick.wrapping_add(1);
        let mut fault = self.guard.inspect(reading);
        if overrun {
            fault = Some(Fault::Overrun);
        }
        if let Some(fault) = fault {
            self.refuse(fault);
        }
        let before = self.code;
        self.code = match (self.mode, reading) {
            (Mode::Closed, Some(code)) => {
                let wanted = self.servo.tick(code, self.generator.next_position());
                let error = self.servo.reference().to_bits().saturating_sub(self.servo.reading().to_bits());
                match self.guard.inspect_loop(error, self.servo.slewing()) {
                    None => wanted,
                    Some(fault) => {
                        self.refuse(fault);
                        self.servo.open_loop(self.guard.towards_rest(before))
                    }
                }
            }
            (Mode::Playing, Some(code)) => self.play(code),
            _ => self.servo.open_loop(self.guard.towards_rest(before)),
        };
        TraceSample {
            tick,
            adc_code: reading.unwrap_or_default(),
            dac_code: self.code,
            reference: if self.mode == Mode::Closed { self.servo.reference().to_bits() } else { 0 },
            applied: self.servo.applied().to_bits(),
            unknown_input: self.servo.unknown_input(),
            flags: self.mode as u16 | (self.fault.map_or(0, |fault| fault as u16) << 8),
        }
    }

    /// The code of a drive (V with 22 fraction bits) within its limits.
    #[inline]
    fn code_for(&self, drive: i32) -> DriveCode {
        let c = &self.parameters.servo.converters;
        DriveCode::new(c.steps(drive).max(0) as u32).max(c.dac_code_min).min(c.dac_code_max)
    }

    /// The next code of an open-loop drive.
    #[inline]
    fn play(&mut self, reading: SensorCode) -> DriveCode {
        if let Some(held) = self.held_code {
            return self.servo.open_loop(self.guard.towards(self.code, held));
        }
        if self.rest_before_ticks > 0 {
            self.rest_before_ticks -= 1;
            return self.servo.open_loop(self.guard.towards_rest(self.code));
        }
        if self.remaining_ticks > 0 {
            self.remaining_ticks -= 1;
            // V with 22 fraction bits, whatever the generator calls it.
            let mut drive = self.generator.next_position().to_bits();
            if self.sweep != 0 {
                drive = drive.saturating_add(sweep(self.sweep, self.sweep_tick));
                self.sweep_tick = self.sweep_tick.wrapping_add(1);
            }
            let (code, c) = (self.code_for(drive), &self.parameters.servo.converters);
            let (lowest, highest) = (self.code - c.slew_codes, self.code + c.slew_codes);
            return self.servo.open_loop(code.max(lowest).min(highest));
        }
        self.generator.forget_marks();
        let code = self.servo.open_loop(self.guard.towards_rest(self.code));
        if self.rest_after_ticks == 0 {
            self.mode = Mode::Rest;
            return code;
        }
        if self.rest_after_ticks <= ZERO_TICKS {
            self.zero_sum += i64::from(reading);
        }
        self.rest_after_ticks -= 1;
        if self.rest_after_ticks == 0 {
            let c = &mut self.parameters.servo.converters;
            // codes * ZERO_TICKS (2^10) * um/code (40) -> um (24)
            c.adc_zero = -narrow((self.zero_sum * c.adc_step) >> 26);
            self.servo.swap(self.parameters.servo);
            self.servo.reset_counters();
            self.zeroed = true;
            self.conditioned = true;
            self.mode = Mode::Rest;
        }
        code
    }

    /// Whether the drive is at its rest code.
    #[inline]
    #[must_use]
    pub fn drive_rests(&self) -> bool {
        self.code == self.parameters.guard.rest_code
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

    /// Whether the loop closes only behind a conditioning.
    #[inline]
    #[must_use]
    pub fn conditioning_required(&self) -> bool {
        self.conditioning_required
    }

    /// Whether the marked point of a table begins to act, or acts, with the next edge of the sample clock: the drive that was computed last, or the
    /// reference that the next reading is compared with.
    #[inline]
    #[must_use]
    pub fn marks(&self) -> bool {
        match self.mode {
            // What is generated counts so many ticks later.
            Mode::Closed => self.generator.marked(PREVIEW_TICKS - 1),
            Mode::Playing => self.held_code.is_none() && self.generator.marked(0),
            Mode::Rest | Mode::Fault => false,
        }
    }

    /// The servo.
    #[must_use]
    pub fn servo(&self) -> &ServoTick {
        &self.servo
    }

    /// The parameters in use, with the sensor's zero as found.
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
    use crate::signal::{MICROMETRE_FRACTION_BITS, VOLT_FRACTION_BITS};
    use crate::wave_table::{POINT_FRACTION_BITS, WaveTable};
    use core::sync::atomic::{AtomicI32, Ordering};
    use std::vec::Vec;

    /// A massless linear actuator with a gain of 1/7 um/V and a little noise, read by the ADC of the example.
    fn reading(code: DriveCode, tick: u32) -> SensorCode {
        let volts = f64::from(code) * 140.0 / 65_536.0 - 20.0;
        SensorCode::new(((volts / 7.0 + 1.0) / 15.0 * 65_536.0) as u32 + (tick.wrapping_mul(2_654_435_761) >> 30))
    }

    #[test]
    fn an_identification_of_a_150_v_actuator_sweeps_its_range() {
        let mut parameters = example();
        parameters.physical.drive_max_mv = 150_000;
        let c = &mut parameters.servo.converters;
        (c.dac_zero, c.dac_step, c.dac_codes_per_volt) = (0, (200i64 << 38) >> 16, ((65_536i64 << 16) / 200) as i32);
        (c.dac_code_min, c.dac_code_max) = (DriveCode::new(0), DriveCode::new(49_152));
        parameters.guard.rest_code = DriveCode::new(0);
        let mut amplifier = Amplifier::new(parameters);
        assert_eq!(amplifier.command(Command::Identify { ticks: 20_000 }), Ok(()));
        for k in 0..REST_BEFORE_TICKS {
            assert_eq!(amplifier.tick(Some(reading(DriveCode::new(9_362), k)), false).dac_code, DriveCode::new(0), "rests first");
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
        let mut amplifier = Amplifier::new(example());
        assert_eq!(amplifier.command(Command::RequireConditioning(false)), Ok(()));
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
        assert_eq!(amplifier.command(Command::Hold { drive: Some(35 << VOLT_FRACTION_BITS) }), Ok(()));
        let ramp = amplifier.parameters().guard.ramp_codes;
        // The example's converter: -20 V at code 0, 140 V over 65536 codes.
        assert_eq!(run(&mut amplifier, 4000), (DriveCode::new(25_746), ramp));
        assert_eq!(amplifier.mode(), Mode::Playing);
        assert_eq!(amplifier.command(Command::Play { waveform: Waveform::Constant, offset: 0, ticks: 5 }), Err(Refusal::NotAtRest));
        assert_eq!(amplifier.command(Command::Hold { drive: None }), Ok(()));
        assert_eq!(run(&mut amplifier, 10), (DriveCode::new(25_746), 0));
        assert_eq!(amplifier.command(Command::Reference { waveform: Waveform::Constant, offset: 5 << 24 }), Ok(()));
        assert_eq!(amplifier.command(Command::Enable), Ok(()));
        run(&mut amplifier, 8000);
        assert_eq!(amplifier.mode(), Mode::Closed);
        assert!((amplifier.servo().reading().to_num::<f64>() - 5.0).abs() < 0.01);
        let (closed, _) = run(&mut amplifier, 1);
        assert_eq!(amplifier.command(Command::Hold { drive: None }), Ok(()));
        assert_eq!(run(&mut amplifier, 100), (closed, 0));
        assert_eq!(amplifier.command(Command::Hold { drive: Some(i32::MAX) }), Ok(()));
        assert_eq!(run(&mut amplifier, 8000).0, amplifier.parameters().servo.converters.dac_code_max);
        assert_eq!(amplifier.command(Command::Disable), Ok(()));
        assert_eq!(run(&mut amplifier, 8000).0, amplifier.parameters().guard.rest_code);
    }

    #[test]
    fn conditions_zeroes_and_follows_then_a_fault_rests_and_is_cleared() {
        let mut amplifier = Amplifier::new(example());
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
        assert_eq!(amplifier.command(Command::Enable), Err(Refusal::NotConditioned));
        let condition = Command::Condition { cycle_ticks: 2000, rest_ticks: 2000 };
        assert_eq!(amplifier.command(condition), Ok(()));
        assert_eq!(amplifier.command(Command::Enable), Err(Refusal::NotAtRest));
        run(&mut amplifier, 2500, true);
        // A conditioning that was stopped is none.
        assert_eq!(amplifier.command(Command::Disable), Ok(()));
        run(&mut amplifier, 4500, true);
        assert_eq!(amplifier.command(Command::Enable), Err(Refusal::NotConditioned));
        assert_eq!(amplifier.command(condition), Ok(()));
        run(&mut amplifier, 4500, true);
        assert_eq!(amplifier.mode(), Mode::Rest);
        assert_eq!(amplifier.command(Command::Reference { waveform: Waveform::Constant, offset: 5 << 24 }), Ok(()));
        assert_eq!(amplifier.command(Command::Enable), Ok(()));
        run(&mut amplifier, 8000, true);
        let error_um = amplifier.servo().reading().to_num::<f64>() - 5.0;
        assert!(error_um.abs() < 0.01, "{error_um}");
        let last = run(&mut amplifier, 1, false);
        assert_eq!((last.flags & 0xff, last.flags >> 8), (Mode::Fault as u16, Fault::SensorSilent as u16));
        let last = run(&mut amplifier, 2000, false);
        assert_eq!(last.dac_code, amplifier.parameters().guard.rest_code);
        assert_eq!(amplifier.command(Command::Clear), Err(Refusal::NotYetHealthy));
        assert_eq!(amplifier.command(Command::Enable), Err(Refusal::Faulted));
        run(&mut amplifier, 1100, true);
        assert_eq!(amplifier.command(Command::Clear), Ok(()));
        // At a fault the power stage is switched off, and nobody knows what the stage did.
        assert_eq!(amplifier.command(Command::Enable), Err(Refusal::NotConditioned));
        assert_eq!(amplifier.command(condition), Ok(()));
        run(&mut amplifier, 4500, true);
        // An open-loop drive and a rest of any length lose nothing.
        assert_eq!(amplifier.command(Command::Play { waveform: Waveform::Constant, offset: 9 << 22, ticks: 500 }), Ok(()));
        run(&mut amplifier, 20_000, true);
        assert_eq!(amplifier.command(Command::Enable), Ok(()));
        run(&mut amplifier, 8000, true);
        assert_eq!((amplifier.mode(), amplifier.fault()), (Mode::Closed, None));
    }

    #[test]
    fn a_marked_point_is_told_for_the_edge_at_which_it_acts() {
        static POINTS: [AtomicI32; 4] = [const { AtomicI32::new(3 << POINT_FRACTION_BITS) }; 4];
        POINTS[2].store(4 << POINT_FRACTION_BITS, Ordering::Relaxed);
        let table = |bits| Waveform::Table(WaveTable::new(&POINTS, bits, 5, false, 3).marking(3));
        let mut amplifier = Amplifier::new(example());
        let mut code = amplifier.parameters().guard.rest_code;
        // What was told before a tick, and the tick.
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
        assert_eq!(amplifier.command(Command::Play { waveform: table(VOLT_FRACTION_BITS), offset: 0, ticks: 60 }), Ok(()));
        let open = run(&mut amplifier, 70);
        // 23 V above the converter's -20 V, 24 V at the marked point: the code of a tick acts at the edge before the next one.
        let high = DriveCode::new(24 * 65_536 / 140);
        let acts: Vec<bool> = open.windows(2).map(|pair| pair[0].1.dac_code.abs_diff(high) < 200).collect();
        let told: Vec<bool> = open.iter().skip(1).map(|(told, _)| *told).collect();
        assert_eq!(told.iter().filter(|told| **told).count(), 15);
        assert_eq!(told, acts);
        assert_eq!(amplifier.command(Command::RequireConditioning(false)), Ok(()));
        run(&mut amplifier, 4000);
        assert_eq!(amplifier.command(Command::Reference { waveform: table(MICROMETRE_FRACTION_BITS), offset: 0 }), Ok(()));
        assert_eq!(amplifier.command(Command::Enable), Ok(()));
        let closed = run(&mut amplifier, 80);
        assert_eq!(closed.iter().filter(|(told, _)| *told).count(), 15);
        // The reference rises with the marked point, whatever offset it still has from the beginning of the loop.
        for pair in closed.windows(2).filter(|pair| pair[0].0 != pair[1].0) {
            let step = pair[1].1.reference - pair[0].1.reference;
            assert!((if pair[1].0 { step } else { -step }) > 1 << 23, "{pair:?}");
        }
        assert_eq!(amplifier.command(Command::Disable), Ok(()));
        assert!(run(&mut amplifier, 20).iter().skip(1).all(|(told, _)| !told), "at rest nothing is marked");
    }

    #[test]
    fn an_operator_who_knows_the_stage_closes_the_loop_without_a_conditioning() {
        let mut amplifier = Amplifier::new(example());
        assert_eq!(amplifier.command(Command::Enable), Err(Refusal::NotConditioned));
        assert_eq!(amplifier.command(Command::RequireConditioning(false)), Ok(()));
        assert_eq!(amplifier.command(Command::Enable), Ok(()));
        assert_eq!(amplifier.mode(), Mode::Closed);
        assert_eq!(amplifier.command(Command::Disable), Ok(()));
        assert_eq!(amplifier.command(Command::RequireConditioning(true)), Ok(()));
        assert_eq!(amplifier.command(Command::Enable), Err(Refusal::NotConditioned));
    }
}
