//! From a servo design to the bytes that the amplifier keeps in flash: integers, guard limits, and the
//! physical quantities beside them.
//!
//! # How it works
//! The drive's limits are those of the identified model, which has them from its data set. The scale of the
//! converters is the wiring's ([`FrontEnd`], a TOML file; the default is that of the firmware's wiring page).
//! What the guard calls impossible follows from the model: no honest motion is faster than the first mode's
//! answer to a step over the whole range, and a tracking error of a fifth of the range is no tracking.

use hysteron_core::codes::{DriveCode, LEAST_BITS, MOST_BITS, SensorCode};
use hysteron_core::command_text::write_upload;
use hysteron_core::guard::GuardParameters;
use hysteron_core::loop_bands::{BAND_FRACTION_BITS, BANDS, LoopBands};
use hysteron_core::parameter_block::{
    AmplifierParameters, BLOCK_BYTES, PhysicalDescription, read, verify, write,
};
use hysteron_core::sensor_lag::SensorLag;
use hysteron_core::servo_parameters::{
    ActuatorParameters, ConverterParameters, LawParameters, NO_SLEW_LIMIT, ServoParameters,
};
use hysteron_core::stepping_parameters::IfStepping;
use hysteron_core::wire::BlockError;
use hysteron_sim::converter_scale::ConverterScale;
use serde::Deserialize;

use crate::error::{Error, Result};
use crate::servo::design::ServoDesign;
use crate::servo::law::PredictorDesign;
use crate::servo::model::{LinearModel, ModeModel};
use crate::servo::sampled_loop::{FrequencyGrid, SampledLoop};

/// Sampling rate of an image that nothing else is known of, Hz.
pub const USUAL_SAMPLE_RATE_HZ: u32 = 20_000;
/// Sampling rates for which the firmware is built, Hz.
pub const SAMPLE_RATES_HZ: [u32; 3] = [20_000, 50_000, 100_000];
/// Of 65,536 codes of the sensor, those at either end that count as out of range; as much of the span with
/// other bits.
const RAIL_CODES: u32 = 16;

/// Fastest slew limit that a block takes, V/s.
const MOST_SLEW_V_S: f64 = 2e7;

/// How the converters are wired: what their first code and one beyond their last code stand for.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct FrontEnd {
    /// Name of the actuator, up to 16 characters.
    pub name: String,
    /// Position at the sensor's code 0, um.
    pub sensor_min_um: f64,
    /// Position one step beyond its highest code, um.
    pub sensor_max_um: f64,
    /// Drive at code 0, V at the actuator.
    pub drive_at_lowest_code_v: f64,
    /// Drive one step beyond the highest code, V at the actuator.
    pub drive_beyond_highest_code_v: f64,
    /// Sampling rate of the board's image, Hz.
    pub sample_rate_hz: u32,
    /// Bits of the sensor's codes: those of its converter on SPI, 16 for the chip's own.
    pub sensor_bits: u8,
    /// Bits of the drive's codes: up to 20 for converters on SPI, 12 for the chip's own.
    pub drive_bits: u8,
    /// Time for which a code may stay the same, s; 0 for a sensor without noise.
    pub stuck_s: f64,
    /// Time for which the tracking error may be too large, s.
    pub tracking_s: f64,
    /// Fastest change of the drive in any mode, V/s: what the amplifier's peak current gives on the
    /// actuator's capacitance, or less.
    pub slew_v_s: f64,
    /// Time from the highest drive to rest, s.
    pub ramp_s: f64,
    /// Time for which the sensor must be healthy before a fault can be cleared, s.
    pub healthy_s: f64,
}

impl Default for FrontEnd {
    /// The wiring page of the firmware: -20..120 V, and a sensor of 15 um.
    fn default() -> Self {
        Self {
            name: "actuator".into(),
            sensor_min_um: -1.0,
            sensor_max_um: 14.0,
            drive_at_lowest_code_v: -20.0,
            drive_beyond_highest_code_v: 120.0,
            sample_rate_hz: USUAL_SAMPLE_RATE_HZ,
            sensor_bits: 16,
            drive_bits: 16,
            stuck_s: 0.01,
            tracking_s: 0.005,
            slew_v_s: 100_000.0,
            ramp_s: 0.05,
            healthy_s: 0.1,
        }
    }
}

impl FrontEnd {
    /// Reads the text of a file, which is called `place` in messages; what it does not say has its default.
    ///
    /// # Errors
    /// When a field is wrong.
    pub fn from_toml(text: &str, place: &str) -> Result<Self> {
        let this: Self =
            toml::from_str(text).map_err(|error| Error::new(place, error.message()))?;
        let ordered = this.sensor_min_um < this.sensor_max_um
            && this.drive_at_lowest_code_v < this.drive_beyond_highest_code_v;
        if !ordered {
            return Err(Error::new(place, "a lowest value is not below its highest"));
        }
        for (name, bits) in [
            ("sensor_bits", this.sensor_bits),
            ("drive_bits", this.drive_bits),
        ] {
            if !(LEAST_BITS..=MOST_BITS).contains(&bits) {
                return Err(Error::new(
                    place,
                    format!("{name} = {bits}: expected {LEAST_BITS} to {MOST_BITS}"),
                ));
            }
        }
        if !SAMPLE_RATES_HZ.contains(&this.sample_rate_hz) {
            return Err(Error::new(
                place,
                format!(
                    "sample_rate_hz = {}: expected one of {SAMPLE_RATES_HZ:?}",
                    this.sample_rate_hz
                ),
            ));
        }
        if !(this.slew_v_s > 0.0 && this.slew_v_s <= MOST_SLEW_V_S) {
            return Err(Error::new(
                place,
                format!(
                    "slew_v_s = {}: expected more than 0, at most {MOST_SLEW_V_S:.0}",
                    this.slew_v_s
                ),
            ));
        }
        Ok(this)
    }

    /// Sampling period, s.
    #[must_use]
    pub fn period_s(&self) -> f64 {
        1.0 / f64::from(self.sample_rate_hz)
    }

    /// Ticks of a time, s, in a field of 16 bits.
    fn ticks(&self, seconds: f64) -> u16 {
        (seconds * f64::from(self.sample_rate_hz))
            .round()
            .clamp(0.0, 65_535.0) as u16
    }

    /// The scale of the converters for an actuator with these limits of its drive.
    #[must_use]
    pub fn scale(&self, drive_min_v: f64, drive_max_v: f64) -> ConverterScale {
        ConverterScale {
            adc_zero_um: self.sensor_min_um,
            adc_lsb_um: (self.sensor_max_um - self.sensor_min_um)
                / 2f64.powi(i32::from(self.sensor_bits)),
            adc_bits: self.sensor_bits,
            dac_zero_v: self.drive_at_lowest_code_v,
            dac_lsb_v: (self.drive_beyond_highest_code_v - self.drive_at_lowest_code_v)
                / 2f64.powi(i32::from(self.drive_bits)),
            dac_bits: self.drive_bits,
            drive_min_v,
            drive_max_v,
        }
    }
}

/// Highest speed of a mode's answer to a step, as a share of step times natural frequency.
fn step_speed(mode: &ModeModel) -> f64 {
    let damping = mode.damping_ratio.clamp(0.0, 0.999);
    let rest = (1.0 - damping * damping).sqrt();
    (-damping / rest * (rest / damping).atan()).exp()
}

/// The converters' integers, with the slew limit in codes.
fn converters(
    front_end: &FrontEnd,
    drive_min_v: f64,
    drive_max_v: f64,
) -> Result<ConverterParameters> {
    let lowest_v = front_end.drive_at_lowest_code_v;
    // The last code is one step below.
    let codes = 2f64.powi(i32::from(front_end.drive_bits));
    let beyond_v = front_end.drive_beyond_highest_code_v
        - (front_end.drive_beyond_highest_code_v - lowest_v) / codes;
    if drive_min_v < lowest_v || drive_max_v > beyond_v {
        let limits = format!("{drive_min_v} to {drive_max_v} V");
        return Err(Error::new(
            "front end",
            format!("gives {lowest_v} to {beyond_v:.3} V; the actuator's drive is {limits}"),
        ));
    }
    let scale = front_end.scale(drive_min_v, drive_max_v);
    let slew = front_end.slew_v_s * front_end.period_s() / scale.dac_lsb_v;
    if slew < 1.0 {
        let least = scale.dac_lsb_v / front_end.period_s();
        return Err(Error::new(
            "front end",
            format!(
                "slew_v_s = {}: a code of this converter in a tick is {least:.0} V/s",
                front_end.slew_v_s
            ),
        ));
    }
    Ok(ConverterParameters {
        slew_codes: slew.min(f64::from(NO_SLEW_LIMIT)) as u32,
        ..scale.parameters()
    })
}

/// What the integers stand for; `radius` is the largest magnitude of the closed loop's eigenvalues.
fn physical(
    front_end: &FrontEnd,
    converters: &ConverterParameters,
    radius: f64,
) -> PhysicalDescription {
    let mut name = [0u8; 16];
    for (to, from) in name.iter_mut().zip(front_end.name.bytes()) {
        *to = from;
    }
    let drive_mv = |code: DriveCode| {
        let drive_v = (f64::from(converters.dac_zero)
            + f64::from(code) * converters.dac_step as f64 / 65_536.0)
            / 2f64.powi(22);
        (drive_v * 1e3).round() as i32
    };
    PhysicalDescription {
        name,
        sample_rate_hz: front_end.sample_rate_hz,
        drive_min_mv: drive_mv(converters.dac_code_min),
        drive_max_mv: drive_mv(converters.dac_code_max),
        slew_limit_v_s: front_end.slew_v_s.ceil() as u32,
        sensor_span_nm: (converters.adc_step as f64
            / 2f64.powi(40 - i32::from(converters.adc_bits))
            * 1e3)
            .round() as i32,
        spectral_radius_millionths: (radius * 1e6).ceil().clamp(0.0, f64::from(u32::MAX)) as u32,
    }
}

/// The guard's limits; the largest honest change of the sensor, codes, and tracking error, um with 24
/// fraction bits, are the model's.
fn guard(
    front_end: &FrontEnd,
    converters: &ConverterParameters,
    jump_codes: u32,
    tracking_error: i32,
) -> GuardParameters {
    let drive_codes = converters.dac_code_max.abs_diff(converters.dac_code_min);
    let rail = (RAIL_CODES << converters.adc_bits >> 16).max(1);
    GuardParameters {
        adc_code_min: SensorCode::new(rail),
        adc_code_max: SensorCode::highest(converters.adc_bits) - rail,
        stuck_ticks: front_end.ticks(front_end.stuck_s),
        jump_codes,
        tracking_error,
        tracking_ticks: front_end.ticks(front_end.tracking_s),
        ramp_codes: (drive_codes / u32::from(front_end.ticks(front_end.ramp_s)).max(1))
            .max(1)
            .min(converters.slew_codes),
        rest_code: converters.dac_code_min,
        healthy_ticks: front_end.ticks(front_end.healthy_s),
    }
}

/// The largest `|T|` of a loop in each half-octave, on the model that it was designed for. What the board asks
/// of a filter leaves the margin for plants that differ.
fn loop_bands(law: &PredictorDesign, linear: &LinearModel) -> LoopBands {
    let plant = linear.sampled();
    let response = SampledLoop::new(law, &plant).response(&FrequencyGrid::by_octaves(linear));
    let mut bands = [0.0f64; BANDS];
    for point in &response.points {
        let octaves = -(2.0 * point.hz * linear.period_s).log2();
        let band = ((2.0 * octaves).max(0.0) as usize).min(BANDS - 1);
        bands[band] = bands[band].max(point.transmission.norm());
    }
    let steps = f64::from(1u32 << BAND_FRACTION_BITS);
    LoopBands {
        transmission: bands.map(|size| (size * steps).ceil().clamp(0.0, 255.0) as u8),
    }
}

/// A block for a design.
///
/// # Errors
/// When the design has no known eigenvalues, does not fit its formats, or the target would refuse the block:
/// the drive's limits beyond the converter, or a loop that is not stable when sampled.
pub fn amplifier_parameters(
    design: &ServoDesign,
    front_end: &FrontEnd,
) -> Result<AmplifierParameters> {
    let Some(law) = design.law() else {
        return Err(Error::new(
            "parameter block",
            "is made for a law that acts one period after its reading and has sampled eigenvalues",
        ));
    };
    let model = &design.model;
    if model.linear.period_s != front_end.period_s() {
        let rates =
            [model.linear.period_s, front_end.period_s()].map(|period_s| (1.0 / period_s).round());
        return Err(Error::new(
            "front end",
            format!(
                "samples at {} Hz; the servo was designed for {} Hz",
                rates[1], rates[0]
            ),
        ));
    }
    let radius = SampledLoop::new(&law, &model.linear.sampled()).spectral_radius();
    let converters = converters(front_end, model.drive_min_v, model.drive_max_v)?;
    let servo = design
        .parameters(converters)
        .map_err(|error| Error::new("design", error.to_string()))?;
    let step_um = converters.adc_step as f64 / 2f64.powi(40);
    let range_um = model.mean_gain_um_v() * (model.drive_max_v - model.drive_min_v);
    let mode = &model.linear.first_mode;
    let fastest_um_s = step_speed(mode) * mode.natural_frequency_rad_s * range_um;
    let jump_codes = (fastest_um_s * model.linear.period_s / step_um)
        .ceil()
        .clamp(1.0, f64::from(NO_SLEW_LIMIT)) as u32;
    let tracking_error = (range_um / 5.0 * 2f64.powi(24)).min(f64::from(i32::MAX)) as i32;
    let parameters = AmplifierParameters {
        physical: physical(front_end, &converters, radius),
        servo,
        guard: guard(front_end, &converters, jump_codes, tracking_error),
        loop_bands: loop_bands(&law, &model.linear),
        stepping: IfStepping::NONE,
    };
    verify(&parameters, front_end.sample_rate_hz)
        .map_err(|error| Error::new("parameter block", error.reason()))?;
    Ok(parameters)
}

/// A block without a servo: with it a board knows its converters and the limits of the drive, so that it can
/// be conditioned and recorded. What the actuator does is not known yet, so a jump of the sensor is no fault.
///
/// # Errors
/// The drive's limits are beyond the converter, or the slew limit is below a code in a tick.
pub fn wiring_parameters(
    front_end: &FrontEnd,
    drive_min_v: f64,
    drive_max_v: f64,
) -> Result<AmplifierParameters> {
    let converters = converters(front_end, drive_min_v, drive_max_v)?;
    let parameters = AmplifierParameters {
        physical: physical(front_end, &converters, 0.0),
        servo: ServoParameters {
            converters,
            actuator: ActuatorParameters::Direct,
            law: LawParameters::Hold,
            delayed: true,
            sensor_lag: SensorLag::NONE,
            learning: None,
            adaptation: None,
        },
        guard: guard(front_end, &converters, NO_SLEW_LIMIT, i32::MAX),
        loop_bands: LoopBands::OPEN,
        stepping: IfStepping::NONE,
    };
    verify(&parameters, front_end.sample_rate_hz)
        .map_err(|error| Error::new("parameter block", error.reason()))?;
    Ok(parameters)
}

/// A block as a board of any of [`SAMPLE_RATES_HZ`] reads it.
///
/// # Errors
/// What every board would refuse.
pub fn read_block(bytes: &[u8]) -> std::result::Result<AmplifierParameters, BlockError> {
    match read(bytes, USUAL_SAMPLE_RATE_HZ) {
        Err(BlockError::SampleRate(rate_hz)) if SAMPLE_RATES_HZ.contains(&rate_hz) => {
            read(bytes, rate_hz)
        }
        other => other,
    }
}

/// The bytes of a block.
///
/// # Errors
/// Never for parameters that [`amplifier_parameters`] made.
pub fn block(parameters: &AmplifierParameters) -> Result<Vec<u8>> {
    let mut bytes = vec![0xff; BLOCK_BYTES];
    let length = write(parameters, &mut bytes)
        .map_err(|error| Error::new("parameter block", error.reason()))?;
    bytes.truncate(length);
    Ok(bytes)
}

/// The lines that bring a block to a running target.
///
/// # Errors
/// When the block is longer than the target takes.
pub fn upload_lines(block: &[u8]) -> Result<String> {
    let mut lines = String::new();
    write_upload(block, &mut lines).map_err(|error| Error::new("parameter block", error))?;
    Ok(lines)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_speed_of_a_step_is_that_of_the_closed_form() {
        // Undamped: x = 1 - cos(t); critically damped: x' = t exp(-t), at most exp(-1).
        let speed = |damping_ratio| {
            step_speed(&ModeModel {
                natural_frequency_rad_s: 1.0,
                damping_ratio,
            })
        };
        assert!((speed(1e-9) - 1.0).abs() < 1e-6);
        assert!((speed(0.999) - (-1.0f64).exp()).abs() < 1e-3);
    }

    #[test]
    fn a_block_without_a_servo_is_one_that_a_board_takes() {
        let bytes = block(&wiring_parameters(&FrontEnd::default(), 0.0, 80.0).expect("fits"))
            .expect("fits");
        let read = read_block(&bytes).expect("valid");
        assert_eq!(
            (read.servo.law, read.guard.rest_code),
            (LawParameters::Hold, read.servo.converters.dac_code_min)
        );
        assert!((i64::from(read.physical.drive_max_mv) - 80_000).abs() < 3);
        let fast = FrontEnd {
            sample_rate_hz: 100_000,
            ..FrontEnd::default()
        };
        let of_fast = wiring_parameters(&fast, 0.0, 80.0).expect("fits");
        assert_eq!(read_block(&block(&of_fast).expect("fits")), Ok(of_fast));
        assert_eq!(
            (
                of_fast.guard.healthy_ticks,
                of_fast.servo.converters.slew_codes
            ),
            (10_000, read.servo.converters.slew_codes / 5)
        );
        let beyond = wiring_parameters(&FrontEnd::default(), 0.0, 150.0)
            .expect_err("beyond the converter")
            .to_string();
        assert!(beyond.contains("150"), "{beyond}");
    }

    #[test]
    fn a_wrong_front_end_is_said() {
        for (text, part) in [
            ("sensor_max_um = -2.0", "not below"),
            ("sensor_mix_um = 1.0", "unknown field"),
            ("drive_bits = 21", "8 to 20"),
            ("sensor_bits = 7", "8 to 20"),
            ("sample_rate_hz = 30000", "[20000, 50000, 100000]"),
            ("name = 3", "invalid type"),
            ("slew_v_s = 0.0", "more than 0"),
        ] {
            let problem = FrontEnd::from_toml(text, "front_end.toml")
                .expect_err(text)
                .to_string();
            assert!(problem.contains(part), "{problem}");
        }
        let read = FrontEnd::from_toml("name = \"p753\"", "front_end.toml").expect("read");
        assert_eq!(
            read,
            FrontEnd {
                name: "p753".into(),
                ..FrontEnd::default()
            }
        );
    }
}
