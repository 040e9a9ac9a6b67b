//! The parameters of `SPA` and `SPA?`.

use hysteron_core::host_watch::timeout_ticks;
use hysteron_core::loop_telemetry::ResonanceWatch;
use hysteron_core::set_point::InputState;
use hysteron_core::signal::{MICROMETRE_FRACTION_BITS, VOLT_FRACTION_BITS};

use super::filters::{change_filter, filter_value};
use super::{Pending, Piece, SET_POINT_CHANNEL, Session, Step, WAVE_TABLES, volts};
use crate::data_array::MOST_COLUMNS;
use crate::decimal::{Decimal, ONE, from_fixed, from_wide, to_fixed};
use crate::device::Device;
use crate::error_code::ErrorCode;
use crate::parameters::DeviceParameter;
use crate::words::Words;

impl<D: Device + 'static> Session<D> {
    /// A parameter of the axis named by two words.
    pub(super) fn named_parameter(
        words: &mut Words<'_>,
    ) -> Result<(DeviceParameter, u32), ErrorCode> {
        words.axis()?;
        let number = words.whole()?;
        DeviceParameter::of_number(number)
            .map(|parameter| (parameter, number))
            .ok_or(ErrorCode::UnknownParameter)
    }

    pub(super) fn set_parameter(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        let mut filters = self.filters;
        let mut input = None;
        loop {
            let (parameter, _) = Self::named_parameter(words)?;
            let value = words.number()?;
            match parameter {
                DeviceParameter::Velocity => self.take_velocity(value)?,
                DeviceParameter::Tolerance => {
                    let tolerance =
                        to_fixed(value, self.position_bits()).filter(|tolerance| *tolerance > 0);
                    self.tolerance = tolerance.ok_or(ErrorCode::Range)?;
                    self.device.set_tolerance(self.tolerance);
                }
                DeviceParameter::SettlingTime => {
                    if !(0..=10 * ONE).contains(&value) {
                        return Err(ErrorCode::Range);
                    }
                    let ticks = value / 1000 * i64::from(self.parameters.physical.sample_rate_hz)
                        / (ONE / 1000);
                    self.settling_ticks = u32::try_from(ticks).unwrap_or(u32::MAX);
                }
                DeviceParameter::HostTimeout => {
                    let milliseconds =
                        u32::try_from(value / (ONE / 1000)).map_err(|_| ErrorCode::Range)?;
                    let ticks =
                        timeout_ticks(milliseconds, self.parameters.physical.sample_rate_hz)
                            .filter(|_| value >= 0);
                    // What is chosen and less than a millisecond is not none.
                    let ticks = ticks
                        .filter(|ticks| *ticks > 0 || value == 0)
                        .ok_or(ErrorCode::Range)?;
                    self.device.set_host_timeout(ticks);
                }
                DeviceParameter::LargestMove => {
                    self.largest_move = size(value, self.position_bits())?;
                }
                DeviceParameter::LargestDriveStep => {
                    self.largest_drive_step = size(value, VOLT_FRACTION_BITS)?;
                }
                DeviceParameter::Resonance => {
                    let frequency_millihertz = thousandths(value)?;
                    self.listen(ResonanceWatch {
                        frequency_millihertz,
                        ..self.device.resonance_watch()
                    })?;
                }
                DeviceParameter::ResonanceAlarm => {
                    let alarm_pm = thousandths(value)?;
                    self.listen(ResonanceWatch {
                        alarm_pm,
                        ..self.device.resonance_watch()
                    })?;
                }
                DeviceParameter::InputChannel => input = Some(value / ONE),
                DeviceParameter::Filter(signal, item) => {
                    change_filter(&mut filters[signal as usize], item, thousandths(value)?)
                }
                _ => return Err(ErrorCode::ReadOnly),
            }
            if !words.more() {
                // What the amplifier has to be asked for is asked one at a time.
                return match input {
                    None => self.tune_filters(filters),
                    Some(_) if filters != self.filters => Err(ErrorCode::ParameterCount),
                    Some(channel) => self.follow_input(channel),
                };
            }
        }
    }

    fn listen(&mut self, watch: ResonanceWatch) -> Result<(), ErrorCode> {
        self.device.listen(watch).map_err(|_| ErrorCode::Range)
    }

    /// What is named; everything, a line at a time, where nothing is.
    pub(super) fn parameter(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        if !words.more() {
            self.pending = Pending::Parameters(0);
        }
        while words.more() {
            let (parameter, number) = Self::named_parameter(words)?;
            self.say_parameter(parameter, number)?;
        }
        Ok(())
    }

    pub(super) fn say_parameter(
        &mut self,
        parameter: DeviceParameter,
        number: u32,
    ) -> Result<(), ErrorCode> {
        let (lowest, highest) = self.range(&self.device.view());
        let rate = i64::from(self.parameters.physical.sample_rate_hz.max(1));
        let seconds = |ticks: u32| Decimal {
            billionths: i64::from(ticks) * ONE / rate,
            digits: 9,
        };
        let c = self.parameters.servo.converters;
        let exact = |billionths| Decimal {
            billionths,
            digits: 9,
        };
        // pm as nm, uV as V, mHz as Hz.
        let of_thousandths = |value: u32| Decimal {
            billionths: i64::from(value) * (ONE / 1000),
            digits: 3,
        };
        let of_millionths = |value: u32| Decimal {
            billionths: i64::from(value) * (ONE / 1_000_000),
            digits: 6,
        };
        let (figures, watch) = (self.device.loop_figures(), self.device.resonance_watch());
        let value = match parameter {
            DeviceParameter::RangeMinimum => self.micrometres(lowest),
            DeviceParameter::RangeMaximum => self.micrometres(highest),
            DeviceParameter::Velocity => self.velocity_value(),
            DeviceParameter::Tolerance => self.micrometres(self.tolerance),
            DeviceParameter::SettlingTime => seconds(self.settling_ticks),
            DeviceParameter::HostTimeout => seconds(self.device.host_timeout()),
            DeviceParameter::LargestMove => self.micrometres(self.largest_move),
            DeviceParameter::LargestDriveStep => volts(self.largest_drive_step),
            DeviceParameter::Resonance => of_thousandths(watch.frequency_millihertz),
            DeviceParameter::ResonanceAlarm => of_thousandths(watch.alarm_pm),
            DeviceParameter::ErrorRms => of_thousandths(figures.error_rms_pm),
            DeviceParameter::ErrorPeak => of_thousandths(figures.error_peak_pm),
            DeviceParameter::DriveRms => of_millionths(figures.drive_rms_uv),
            DeviceParameter::ResonanceAmplitude => of_thousandths(figures.resonance_pm),
            DeviceParameter::ServoPeriod => seconds(1),
            DeviceParameter::Filter(signal, item) => {
                of_thousandths(filter_value(&self.filters[signal as usize], item))
            }
            DeviceParameter::SensorAtCode0 => exact(from_fixed(
                self.converters(&self.device.view()).adc_zero,
                MICROMETRE_FRACTION_BITS,
            )),
            // All codes of um with 40 fraction bits: um with 24; likewise V with 38 and 22.
            DeviceParameter::SensorSpan => exact(from_wide(
                (c.adc_step << c.adc_bits) >> 16,
                MICROMETRE_FRACTION_BITS,
            )),
            DeviceParameter::DriveAtCode0 => exact(from_fixed(c.dac_zero, VOLT_FRACTION_BITS)),
            DeviceParameter::DriveSpan => exact(from_wide(
                (c.dac_step << c.dac_bits) >> 16,
                VOLT_FRACTION_BITS,
            )),
            DeviceParameter::DriveMinimum => {
                exact(from_fixed(c.drive(c.dac_code_min), VOLT_FRACTION_BITS))
            }
            DeviceParameter::DriveMaximum => {
                exact(from_fixed(c.drive(c.dac_code_max), VOLT_FRACTION_BITS))
            }
            DeviceParameter::InputChannel => {
                let channel = match self.device.view().input {
                    InputState::Off => 0,
                    InputState::Following | InputState::Limited => SET_POINT_CHANNEL,
                };
                return self.say(format_args!("1 {number:#x}={channel}"));
            }
            DeviceParameter::SensorBits => {
                return self.say(format_args!("1 {number:#x}={}", c.adc_bits));
            }
            DeviceParameter::DriveBits => {
                return self.say(format_args!("1 {number:#x}={}", c.dac_bits));
            }
            DeviceParameter::WavePoints => {
                return self.say(format_args!("1 {number:#x}={}", self.wave_points()));
            }
            DeviceParameter::WaveTables => {
                return self.say(format_args!("1 {number:#x}={WAVE_TABLES}"));
            }
            DeviceParameter::RecorderTables => {
                return self.say(format_args!("1 {number:#x}={MOST_COLUMNS}"));
            }
            DeviceParameter::RecorderPoints => {
                let points = self.device.recorder_room() * MOST_COLUMNS as u32;
                return self.say(format_args!("1 {number:#x}={points}"));
            }
        };
        self.say(format_args!("1 {number:#x}={value}"))
    }

    /// A line of the list of all parameters.
    pub(super) fn next_parameter(&mut self, nth: usize, piece: &mut Piece) -> Step {
        self.text.clear();
        let Some((parameter, number, _, _)) = DeviceParameter::ALL.get(nth) else {
            return Step::Done;
        };
        let end: &[u8] = if nth + 1 < DeviceParameter::ALL.len() {
            b" \n"
        } else {
            b"\n"
        };
        let written = self.say_parameter(*parameter, *number).is_ok()
            && self.text.extend_from_slice(end).is_ok();
        core::mem::swap(piece, &mut self.text);
        self.sent(
            if written {
                Ok(())
            } else {
                Err(core::fmt::Error)
            },
            Pending::Parameters(nth + 1),
        )
    }
}

/// A number that is not negative, as a fixed-point one.
fn size(value: i64, fraction_bits: u32) -> Result<i32, ErrorCode> {
    to_fixed(value, fraction_bits)
        .filter(|size| *size >= 0)
        .ok_or(ErrorCode::Range)
}

/// Thousandths of a number that is not negative.
fn thousandths(value: i64) -> Result<u32, ErrorCode> {
    u32::try_from(value / (ONE / 1000))
        .ok()
        .filter(|_| value >= 0)
        .ok_or(ErrorCode::Range)
}
