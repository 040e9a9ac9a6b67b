//! Moves, the servo, the open-loop drive, conditioning, and every way to stop.

use hysteron_core::amplifier::Mode;
use hysteron_core::amplifier_command::Command;
use hysteron_core::reference_generator::Waveform;
use hysteron_core::set_point::InputState;
use hysteron_core::signal::{MICROMETRE_FRACTION_BITS, Micrometres, Travel, Volts};

use super::{Generator, Meaning, Pending, SET_POINT_CHANNEL, Session, Trigger};
use crate::decimal::ONE;
use crate::device::Device;
use crate::error_code::ErrorCode;
use crate::words::Words;

/// A conditioning cycle takes the tenth part of a second.
const CONDITIONING_HZ: u32 = 10;

/// The longest move, ticks.
const LONGEST_MOVE_TICKS: i64 = 1 << 24;

/// Whether a step is larger than the operator allows without a second word; 0: none is.
fn exceeds(step: i32, largest: i32) -> bool {
    largest > 0 && step.unsigned_abs() > largest.unsigned_abs()
}

impl<D: Device + 'static> Session<D> {
    pub(super) fn command(&mut self, first: Command, then: Option<Command>, meaning: Meaning) {
        self.pending = Pending::Commands {
            first,
            then,
            meaning,
        };
    }

    /// Starts the recorder where a command that changes the target does so.
    pub(super) fn begin_motion(&mut self) {
        if self.trigger == Trigger::Target {
            self.device.record_from_command(self.record_every);
        }
    }

    pub(super) fn stopped(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        words.end()?;
        self.generator = Generator::Off;
        self.moving_until = None;
        self.error = ErrorCode::Stopped as u16;
        Ok(())
    }

    pub(super) fn halt(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        words.queried_axis()?;
        self.stay();
        self.error = ErrorCode::Stopped as u16;
        Ok(())
    }

    /// Stays where it is.
    pub(super) fn stay(&mut self) {
        let view = self.device.view();
        match view.mode {
            Mode::Closed => {
                let (lowest, highest) = self.range(&view);
                let here = self.reference_now(&view).max(lowest).min(highest);
                self.command(
                    self.way(here, here, 0),
                    None,
                    Meaning::Move {
                        from: here,
                        target: here,
                        ticks: 0,
                    },
                );
            }
            Mode::Playing => self.command(
                Command::Hold { drive: None },
                None,
                Meaning::Drive {
                    drive: None,
                    ticks: 0,
                },
            ),
            Mode::Rest | Mode::Fault => {}
        }
    }

    /// Follows the analogue set point no faster than `VEL`, or stays where that has led to.
    pub(super) fn follow_input(&mut self, channel: i64) -> Result<(), ErrorCode> {
        if channel == 0 {
            if self.device.view().input != InputState::Off {
                self.stay();
            }
            return Ok(());
        }
        if channel != i64::from(SET_POINT_CHANNEL) {
            return Err(ErrorCode::Axis);
        }
        let rate = i64::from(self.parameters.physical.sample_rate_hz.max(1));
        let step = (self.velocity / rate).clamp(1, i32::MAX.into()) as i32;
        self.begin_motion();
        let (first, last) = (
            Command::FollowInput {
                most_step: Micrometres::from_bits(step),
            },
            self.target,
        );
        self.command(first, None, Meaning::Wave { last, ticks: None });
        Ok(())
    }

    pub(super) fn set_servo(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        let wanted = words.of_axis(Words::switch)?;
        let view = self.device.view();
        match (wanted, view.mode == Mode::Closed) {
            (true, false) => {
                let (lowest, highest) = self.range(&view);
                let here = self.position_now(&view).max(lowest).min(highest);
                // A stick-slip drive stays where it is by itself.
                let (first, then) = match self.parameters.stepping.get() {
                    None => (self.way(here, here, 0), Some(Command::Enable)),
                    Some(_) => (Command::Enable, None),
                };
                self.command(
                    first,
                    then,
                    Meaning::Move {
                        from: here,
                        target: here,
                        ticks: 0,
                    },
                );
            }
            (false, true) => {
                let drive = self.parameters.servo.converters.drive(view.dac_code);
                self.command(
                    Command::Hold { drive: None },
                    None,
                    Meaning::Drive {
                        drive: Some(drive),
                        ticks: 0,
                    },
                );
            }
            _ => {}
        }
        Ok(())
    }

    /// The command for a way of so many ticks between two positions.
    fn way(&self, from: i32, target: i32, ticks: u32) -> Command {
        if self.parameters.stepping.get().is_some() {
            let rate = i64::from(self.parameters.physical.sample_rate_hz.max(1));
            return Command::MoveTo {
                target: Travel::from_bits(target),
                velocity: Micrometres::from_bits(
                    (self.velocity / rate).clamp(1, i32::MAX.into()) as i32
                ),
            };
        }
        let waveform = match target.saturating_sub(from) {
            0 => Waveform::Constant,
            height => Waveform::QuasiStep {
                height: Micrometres::from_bits(height),
                delay_ticks: 0,
                duration_ticks: ticks,
            },
        };
        Command::Reference {
            waveform,
            offset: Micrometres::from_bits(from),
        }
    }

    pub(super) fn move_to(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        let (target, far) = self.asked_position(words)?;
        self.go(target, far)
    }

    /// A position or a distance, and whether it may be far.
    fn asked_position(&self, words: &mut Words<'_>) -> Result<(i32, bool), ErrorCode> {
        let bits = self.position_bits();
        words.of_axis(|words| Ok((words.micrometres(bits, ErrorCode::Position)?, words.far()?)))
    }

    pub(super) fn move_by(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        let (distance, far) = self.asked_position(words)?;
        let target = self.target.checked_add(distance);
        self.go(target.ok_or(ErrorCode::Position)?, far)
    }

    /// `far`: also where that is a larger step than usual.
    fn go(&mut self, target: i32, far: bool) -> Result<(), ErrorCode> {
        if !self.closed() {
            return Err(ErrorCode::ServoIsOff);
        }
        if self.runs() {
            return Err(ErrorCode::GeneratorRuns);
        }
        if !self.is_within_range(target) {
            return Err(ErrorCode::Position);
        }
        let from = if self.moves() {
            self.reference_now(&self.device.view())
        } else {
            self.target
        };
        let height = target.checked_sub(from).ok_or(ErrorCode::Position)?;
        if !far && exceeds(height, self.largest_move) {
            return Err(ErrorCode::StepTooLarge);
        }
        // The quintic is 15/8 as fast as its mean at its middle.
        let rate = i64::from(self.parameters.physical.sample_rate_hz);
        let ticks = (i64::from(height).abs() * 15 * rate / 8)
            .checked_div(self.velocity)
            .unwrap_or(LONGEST_MOVE_TICKS);
        let ticks = match self.parameters.stepping.get() {
            None => ticks.clamp(1, LONGEST_MOVE_TICKS) as u32,
            // Until the trace shows the new target.
            Some(_) => self.settling_ticks,
        };
        self.begin_motion();
        self.command(
            self.way(from, target, ticks),
            None,
            Meaning::Move {
                from,
                target,
                ticks,
            },
        );
        Ok(())
    }

    pub(super) fn set_drive(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        let (drive, far) = words.of_axis(|words| Ok((words.volts()?, words.far()?)))?;
        let view = self.device.view();
        if view.mode == Mode::Closed {
            return Err(ErrorCode::ServoIsOn);
        }
        if !self.is_drive(drive) {
            return Err(ErrorCode::Voltage);
        }
        let c = &self.parameters.servo.converters;
        let distance = i64::from(drive.saturating_sub(c.drive(view.dac_code)));
        if !far && exceeds(distance as i32, self.largest_drive_step) {
            return Err(ErrorCode::StepTooLarge);
        }
        let codes = (distance.abs() * i64::from(c.dac_codes_per_volt)) >> 42;
        let ticks = codes / i64::from(self.parameters.guard.ramp_codes.max(1)) + 1;
        self.begin_motion();
        let meaning = Meaning::Drive {
            drive: Some(drive),
            ticks: ticks.min(LONGEST_MOVE_TICKS) as u32,
        };
        self.command(
            Command::Hold {
                drive: Some(Volts::from_bits(drive)),
            },
            None,
            meaning,
        );
        Ok(())
    }

    pub(super) fn set_velocity(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        let velocity = words.of_axis(Words::number)?;
        self.take_velocity(velocity)
    }

    /// Takes a velocity in billionths of um/s: up to the whole span in a tick.
    pub(super) fn take_velocity(&mut self, billionths: i64) -> Result<(), ErrorCode> {
        let physical = &self.parameters.physical;
        let most = i64::from(physical.sensor_span_nm)
            .saturating_mul(1_000_000)
            .saturating_mul(i64::from(physical.sample_rate_hz));
        if billionths <= 0 || billionths > most {
            return Err(ErrorCode::Velocity);
        }
        // Whole um/s and the rest apart, so that both have room.
        let (whole, part) = (billionths / ONE, billionths % ONE);
        self.velocity =
            (whole << MICROMETRE_FRACTION_BITS) + (part << MICROMETRE_FRACTION_BITS) / ONE;
        Ok(())
    }

    pub(super) fn arm(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        let (command, meaning) = match words.of_axis(Words::whole)? {
            0 => (Command::Disarm, Meaning::Conditioning),
            1 => (Command::Arm { tested: true }, Meaning::Conditioning),
            2 => (Command::Arm { tested: false }, Meaning::Nothing),
            _ => return Err(ErrorCode::Range),
        };
        self.command(command, None, meaning);
        Ok(())
    }

    pub(super) fn armed(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        let view = self.device.view();
        let state = match (view.powered, view.armed) {
            (_, true) => 1,
            (true, false) => 2,
            (false, false) => 0,
        };
        self.say_axis(words, state)
    }

    pub(super) fn require_conditioning(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        let required = words.of_axis(Words::switch)?;
        self.command(
            Command::RequireConditioning(required),
            None,
            Meaning::Nothing,
        );
        Ok(())
    }

    pub(super) fn auto_zero(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        if words.more() {
            words.axis()?;
        }
        // A lowest voltage is not needed: the whole range is driven.
        let _ = words.optional();
        words.end()?;
        let rate = self.parameters.physical.sample_rate_hz;
        self.command(
            Command::Condition {
                cycle_ticks: rate / CONDITIONING_HZ,
                rest_ticks: rate,
            },
            None,
            Meaning::Conditioning,
        );
        Ok(())
    }
}
