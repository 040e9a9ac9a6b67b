//! The parameters of `SPA` and `SPA?`.

use hysteron_core::host_watch::timeout_ticks;
use hysteron_core::signal::{MICROMETRE_FRACTION_BITS, VOLT_FRACTION_BITS};

use super::{Session, WAVE_TABLES, micrometres};
use crate::data_array::MOST_COLUMNS;
use crate::decimal::{Decimal, ONE, from_fixed, from_wide, to_fixed};
use crate::device::Device;
use crate::error_code::ErrorCode;
use crate::parameters::Parameter;
use crate::words::Words;

impl<D: Device + 'static> Session<D> {
    /// A parameter of the axis named by two words.
    pub(super) fn named_parameter(words: &mut Words<'_>) -> Result<(Parameter, u32), ErrorCode> {
        words.axis()?;
        let number = words.whole()?;
        Parameter::of_number(number).map(|parameter| (parameter, number)).ok_or(ErrorCode::UnknownParameter)
    }

    pub(super) fn set_parameter(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
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
                Parameter::HostTimeout => {
                    let milliseconds = u32::try_from(value / (ONE / 1000)).map_err(|_| ErrorCode::Range)?;
                    let ticks = timeout_ticks(milliseconds, self.parameters.physical.sample_rate_hz).filter(|_| value >= 0);
                    // What is chosen and less than a millisecond is not none.
                    let ticks = ticks.filter(|ticks| *ticks > 0 || value == 0).ok_or(ErrorCode::Range)?;
                    self.device.set_host_timeout(ticks);
                }
                _ => return Err(ErrorCode::ReadOnly),
            }
            if !words.more() {
                return Ok(());
            }
        }
    }

    pub(super) fn parameter(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
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

    pub(super) fn say_parameter(&mut self, parameter: Parameter, number: u32) -> Result<(), ErrorCode> {
        let (lowest, highest) = self.range(&self.device.view());
        let rate = i64::from(self.parameters.physical.sample_rate_hz.max(1));
        let seconds = |ticks: u32| Decimal { billionths: i64::from(ticks) * ONE / rate, digits: 9 };
        let c = self.parameters.servo.converters;
        let exact = |billionths| Decimal { billionths, digits: 9 };
        let value = match parameter {
            Parameter::RangeMinimum => micrometres(lowest),
            Parameter::RangeMaximum => micrometres(highest),
            Parameter::Velocity => self.velocity_value(),
            Parameter::Tolerance => micrometres(self.tolerance),
            Parameter::SettlingTime => seconds(self.settling_ticks),
            Parameter::HostTimeout => seconds(self.device.host_timeout()),
            Parameter::ServoPeriod => seconds(1),
            Parameter::SensorAtCode0 => exact(from_fixed(self.converters(&self.device.view()).adc_zero, MICROMETRE_FRACTION_BITS)),
            // 65,536 codes of um with 40 fraction bits: um with 24; likewise V with 38 and 22.
            Parameter::SensorSpan => exact(from_wide(c.adc_step, MICROMETRE_FRACTION_BITS)),
            Parameter::DriveAtCode0 => exact(from_fixed(c.dac_zero, VOLT_FRACTION_BITS)),
            Parameter::DriveSpan => exact(from_wide(c.dac_step, VOLT_FRACTION_BITS)),
            Parameter::DriveMinimum => exact(from_fixed(c.drive(c.dac_code_min), VOLT_FRACTION_BITS)),
            Parameter::DriveMaximum => exact(from_fixed(c.drive(c.dac_code_max), VOLT_FRACTION_BITS)),
            Parameter::WavePoints => return self.say(format_args!("1 {number:#x}={}", self.wave_points())),
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
