//! Queries of the axis, the drive and the controller itself.

use hysteron_core::amplifier::Mode;
use hysteron_core::firmware_update::text;
use hysteron_core::signal::MICROMETRE_FRACTION_BITS;

use super::{Pending, SET_POINT_CHANNEL, Session, volts};
use crate::decimal::{Decimal, from_wide};
use crate::device::Device;
use crate::error_code::ErrorCode;
use crate::words::Words;

impl<D: Device + 'static> Session<D> {
    pub(super) fn identification(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        words.end()?;
        match self.device.image() {
            Some(image) => self.say(format_args!(
                "(c)2026 Hysteron, HYSTERON, 0, {}",
                text(&image.version)
            )),
            None => self.say(format_args!(
                "(c)2026 Hysteron, HYSTERON, 0, {}",
                env!("CARGO_PKG_VERSION")
            )),
        }
    }

    pub(super) fn syntax_version(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        words.end()?;
        self.say(format_args!("2.0"))
    }

    pub(super) fn version(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        words.end()?;
        self.say(format_args!(
            "FW_CORE: Hysteron {}",
            env!("CARGO_PKG_VERSION")
        ))
    }

    pub(super) fn last_error(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        words.end()?;
        let error = core::mem::take(&mut self.error);
        self.say(format_args!("{error}"))
    }

    pub(super) fn axes(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        if words.more() && !words.word()?.eq_ignore_ascii_case("ALL") {
            return Err(ErrorCode::Syntax);
        }
        words.end()?;
        self.say(format_args!("1"))
    }

    pub(super) fn stage(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        let name = self.parameters.physical.name;
        let end = name
            .iter()
            .position(|byte| !byte.is_ascii_graphic())
            .unwrap_or(name.len());
        let name = name
            .get(..end)
            .and_then(|name| core::str::from_utf8(name).ok())
            .filter(|name| !name.is_empty());
        self.say_axis(words, name.unwrap_or("NOSTAGE"))
    }

    /// What a converter reads now.
    pub(super) fn code(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        let channel = words.whole()?;
        words.end()?;
        let view = self.device.view();
        let code = match channel {
            1 => view.adc_code.steps(),
            2 => view.monitor_code.ok_or(ErrorCode::Axis)?.into(),
            SET_POINT_CHANNEL => view.set_point_code.ok_or(ErrorCode::Axis)?.into(),
            _ => return Err(ErrorCode::Axis),
        };
        self.say(format_args!("{channel}={code}"))
    }

    pub(super) fn servo(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        let closed = u8::from(self.closed());
        self.say_axis(words, closed)
    }

    pub(super) fn target(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        let target = self.target;
        let target = self.micrometres(target);
        self.say_axis(words, target)
    }

    pub(super) fn position(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        let position = self.position_now(&self.device.view());
        let position = self.micrometres(position);
        self.say_axis(words, position)
    }

    pub(super) fn voltage(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        let drive = self
            .parameters
            .servo
            .converters
            .drive(self.device.view().dac_code);
        self.say_axis(words, volts(drive))
    }

    pub(super) fn open_loop_drive(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        let drive = self.drive;
        self.say_axis(words, volts(drive))
    }

    pub(super) fn on_target(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        let view = self.device.view();
        let reached = view.mode == Mode::Closed
            && !self.moves()
            && view.on_target_ticks >= self.settling_ticks;
        self.say_axis(words, u8::from(reached))
    }

    pub(super) fn overflow(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        let (view, c) = (self.device.view(), self.parameters.servo.converters);
        let at_limit = view.mode == Mode::Closed
            && (view.dac_code <= c.dac_code_min || view.dac_code >= c.dac_code_max);
        self.say_axis(words, u8::from(at_limit))
    }

    pub(super) fn lowest(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        let (lowest, _) = self.range(&self.device.view());
        let lowest = self.micrometres(lowest);
        self.say_axis(words, lowest)
    }

    pub(super) fn highest(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        let (_, highest) = self.range(&self.device.view());
        let highest = self.micrometres(highest);
        self.say_axis(words, highest)
    }

    pub(super) fn velocity(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        let velocity = self.velocity_value();
        self.say_axis(words, velocity)
    }

    pub(super) fn velocity_value(&self) -> Decimal {
        Decimal {
            billionths: from_wide(self.velocity, MICROMETRE_FRACTION_BITS),
            digits: 6,
        }
    }

    pub(super) fn auto_zeroed(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        let zeroed = u8::from(self.device.view().zeroed);
        self.say_axis(words, zeroed)
    }

    pub(super) fn conditioned(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        let conditioned = u8::from(self.device.view().conditioned);
        self.say_axis(words, conditioned)
    }

    pub(super) fn conditioning_required(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        let required = u8::from(self.device.view().conditioning_required);
        self.say_axis(words, required)
    }

    pub(super) fn command_help(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        self.pending = Pending::Help(0);
        words.end()
    }

    pub(super) fn parameter_help(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        self.pending = Pending::ParameterHelp(0);
        words.end()
    }

    pub(super) fn recorder_help(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        self.pending = Pending::RecorderHelp(0);
        words.end()
    }
}
