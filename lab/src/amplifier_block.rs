//! From a servo design to the bytes that the amplifier keeps in flash: integers, guard limits, and the physical quantities beside them.

use hysteron_core::guard::GuardParameters;
use hysteron_core::parameter_block::{AmplifierParameters, BLOCK_BYTES, PhysicalDescription, verify, write};
use hysteron_core::servo_parameters::{ConverterParameters, LawParameters};

use crate::problem::{Problem, Result};
use crate::servo::design::ServoDesign;

/// Sampling rate of the target, Hz.
pub const SAMPLE_RATE_HZ: u32 = 20_000;
/// Fraction of the sensor's codes at either end that count as out of range.
const RAIL_CODES: u16 = 16;

/// A block for a design.
///
/// `spectral_radius` is the largest magnitude of the eigenvalues of the sampled closed loop: the target refuses one that is not
/// below one. `fastest_um_s` is the fastest honest motion, for the guard's jump limit.
///
/// # Errors
/// When the design does not fit its formats, or the target would refuse the block.
pub fn amplifier_parameters(
    design: &ServoDesign,
    converters: ConverterParameters,
    name: &str,
    spectral_radius: f64,
    fastest_um_s: f64,
) -> Result<AmplifierParameters> {
    let servo = design.parameters(converters).map_err(|error| Problem::new("design", format!("{error:?}")))?;
    let mut padded = [0u8; 16];
    for (to, from) in padded.iter_mut().zip(name.bytes()) {
        *to = from;
    }
    let drive_mv = |code: u16| {
        let drive_v = (f64::from(converters.dac_zero) + f64::from(code) * converters.dac_step as f64 / 65_536.0) / 2f64.powi(22);
        (drive_v * 1e3).round() as i32
    };
    let step_um = converters.adc_step as f64 / 2f64.powi(40);
    let closed = !matches!(servo.law, LawParameters::Hold);
    let parameters = AmplifierParameters {
        physical: PhysicalDescription {
            name: padded,
            sample_rate_hz: SAMPLE_RATE_HZ,
            drive_min_mv: drive_mv(converters.dac_code_min),
            drive_max_mv: drive_mv(converters.dac_code_max),
            sensor_span_nm: (step_um * 65_536.0 * 1e3).round() as i32,
            spectral_radius_millionths: if closed { (spectral_radius * 1e6).ceil().clamp(0.0, f64::from(u32::MAX)) as u32 } else { 0 },
        },
        servo,
        guard: GuardParameters {
            adc_code_min: RAIL_CODES,
            adc_code_max: u16::MAX - RAIL_CODES,
            stuck_ticks: 200,
            jump_codes: (fastest_um_s / f64::from(SAMPLE_RATE_HZ) / step_um).ceil().clamp(1.0, 65_535.0) as u16,
            tracking_error: 2 << 24,
            tracking_ticks: 100,
            slew_codes: 12_000,
            ramp_codes: 40,
            rest_code: converters.dac_code_min,
            healthy_ticks: 2000,
        },
    };
    verify(&parameters, SAMPLE_RATE_HZ).map_err(|error| Problem::new("parameter block", error.reason()))?;
    Ok(parameters)
}

/// The bytes of a block.
///
/// # Errors
/// Never for parameters that [`amplifier_parameters`] made.
pub fn block(parameters: &AmplifierParameters) -> Result<Vec<u8>> {
    let mut bytes = vec![0xff; BLOCK_BYTES];
    let length = write(parameters, &mut bytes).map_err(|error| Problem::new("parameter block", error.reason()))?;
    bytes.truncate(length);
    Ok(bytes)
}
