//! The parameter blocks in flash: two sectors of bank 2, the newest and the last good one beside it.
//!
//! A block is written by the probe or by the host's tools to either address; at start the first valid one is taken, A before B, and
//! the reason why a block was refused is said.

use hysteron_core::parameter_block::{AmplifierParameters, BLOCK_BYTES, BlockError, read};

/// Addresses of the blocks A and B (`memory.x`, SETTINGS).
const BLOCKS: [(&str, usize); 2] = [("A", 0x081C_0000), ("B", 0x081E_0000)];

/// The first valid block.
pub fn load(sample_rate_hz: u32) -> Result<AmplifierParameters, BlockError> {
    let mut first_error = None;
    for (name, address) in BLOCKS {
        // SAFETY: flash that no code and no data of the image occupies (memory.x), always readable.
        let bytes = unsafe { core::slice::from_raw_parts(address as *const u8, BLOCK_BYTES + 64) };
        match read(bytes, sample_rate_hz) {
            Ok(parameters) => {
                defmt::info!("parameter block {=str} taken", name);
                return Ok(parameters);
            }
            Err(error) => {
                defmt::warn!("parameter block {=str} refused: {=str}", name, error.reason());
                first_error.get_or_insert(error);
            }
        }
    }
    Err(first_error.unwrap_or(BlockError::Absent))
}

/// What runs without a valid block: nothing but rest at the drive code that is zero volts of the reference front end.
pub fn safe_parameters(sample_rate_hz: u32) -> AmplifierParameters {
    use hysteron_core::guard::GuardParameters;
    use hysteron_core::parameter_block::PhysicalDescription;
    use hysteron_core::servo_parameters::{ActuatorParameters, ConverterParameters, LawParameters, ServoParameters};
    /// 0 V of a -20..120 V drive.
    const REST: u16 = 9362;
    AmplifierParameters {
        physical: PhysicalDescription {
            name: [0; 16],
            sample_rate_hz,
            drive_min_mv: 0,
            drive_max_mv: 0,
            sensor_span_nm: 0,
            spectral_radius_millionths: 0,
        },
        servo: ServoParameters {
            converters: ConverterParameters {
                adc_zero: 0,
                adc_step: 0,
                dac_zero: 0,
                dac_step: 0,
                dac_codes_per_volt: 0,
                dac_code_min: REST,
                dac_code_max: REST,
                noise_shaping: false,
            },
            actuator: ActuatorParameters::Direct,
            law: LawParameters::Hold,
            delayed: true,
        },
        guard: GuardParameters {
            adc_code_min: 0,
            adc_code_max: u16::MAX,
            stuck_ticks: 0,
            jump_codes: u16::MAX,
            tracking_error: i32::MAX,
            tracking_ticks: u16::MAX,
            slew_codes: u16::MAX,
            ramp_codes: 1,
            rest_code: REST,
            healthy_ticks: u16::MAX,
        },
    }
}
