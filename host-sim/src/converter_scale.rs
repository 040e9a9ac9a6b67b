//! How the codes of the two converters are related to the physical world, in f64 and in the integers of the
//! tick.

use hysteron_core::codes::{DriveCode, SensorCode};
use hysteron_core::servo_parameters::{
    CODES_PER_VOLT_FRACTION_BITS, ConverterParameters, NO_SLEW_LIMIT,
};

/// Scale of sensor and drive converters, and which drives are allowed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ConverterScale {
    /// Position at the sensor's code 0, um.
    pub adc_zero_um: f64,
    /// Position per code of the sensor, um.
    pub adc_lsb_um: f64,
    /// Bits of the sensor's codes.
    pub adc_bits: u8,
    /// Drive at code 0, V.
    pub dac_zero_v: f64,
    /// Drive per code, V.
    pub dac_lsb_v: f64,
    /// Bits of the drive's codes.
    pub dac_bits: u8,
    /// Lowest drive of the actuator, V.
    pub drive_min_v: f64,
    /// Highest drive of the actuator, V.
    pub drive_max_v: f64,
}

impl ConverterScale {
    /// Converters of 16 bits for an actuator whose drive and travel are known: the drive's spans its range
    /// with a quarter below and half above, the sensor's spans the travel with a tenth below and a quarter
    /// above.
    #[must_use]
    pub fn around(drive_min_v: f64, drive_max_v: f64, travel_um: f64) -> Self {
        let range_v = drive_max_v - drive_min_v;
        Self {
            adc_zero_um: -0.1 * travel_um,
            adc_lsb_um: 1.35 * travel_um / 65_536.0,
            adc_bits: 16,
            dac_zero_v: drive_min_v - 0.25 * range_v,
            dac_lsb_v: 1.75 * range_v / 65_536.0,
            dac_bits: 16,
            drive_min_v,
            drive_max_v,
        }
    }

    /// These converters with the sensor's zero moved to what is now `zero_um`.
    #[must_use]
    pub fn zeroed_at(self, zero_um: f64) -> Self {
        Self {
            adc_zero_um: self.adc_zero_um - zero_um,
            ..self
        }
    }

    /// The sensor's code for a position.
    #[must_use]
    pub fn adc_code(&self, position_um: f64) -> SensorCode {
        let code = ((position_um - self.adc_zero_um) / self.adc_lsb_um).round();
        SensorCode::new(code.clamp(0.0, SensorCode::highest(self.adc_bits).into()) as u32)
    }

    /// The position that a code of the sensor stands for, um.
    #[must_use]
    pub fn position_um(&self, adc_code: SensorCode) -> f64 {
        f64::from(adc_code) * self.adc_lsb_um + self.adc_zero_um
    }

    /// The drive's code for a voltage, within the limits of the actuator.
    #[must_use]
    pub fn dac_code(&self, drive_v: f64) -> DriveCode {
        let code = ((drive_v.clamp(self.drive_min_v, self.drive_max_v) - self.dac_zero_v)
            / self.dac_lsb_v)
            .round();
        DriveCode::new(code.clamp(0.0, DriveCode::highest(self.dac_bits).into()) as u32)
    }

    /// The voltage that a code of the drive stands for, V.
    #[must_use]
    pub fn drive_v(&self, dac_code: DriveCode) -> f64 {
        self.dac_zero_v + f64::from(dac_code) * self.dac_lsb_v
    }

    /// In the integers of the tick.
    #[must_use]
    pub fn parameters(&self) -> ConverterParameters {
        ConverterParameters {
            adc_zero: (self.adc_zero_um * 2.0_f64.powi(24)).round() as i32,
            adc_step: (self.adc_lsb_um * 2.0_f64.powi(40)).round() as i64,
            dac_zero: (self.dac_zero_v * 2.0_f64.powi(22)).round() as i32,
            dac_step: (self.dac_lsb_v * 2.0_f64.powi(38)).round() as i64,
            dac_codes_per_volt: (2.0_f64.powi(CODES_PER_VOLT_FRACTION_BITS as i32) / self.dac_lsb_v)
                .round() as i32,
            dac_code_min: self.dac_code(self.drive_min_v),
            dac_code_max: self.dac_code(self.drive_max_v),
            slew_codes: NO_SLEW_LIMIT,
            adc_bits: self.adc_bits,
            dac_bits: self.dac_bits,
            noise_shaping: false,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn codes_and_the_world_agree_to_half_a_code() {
        let scale = ConverterScale::around(-10.0, 90.0, 12.0);
        for share in [0.0, 0.123, 0.5, 0.999, 1.0] {
            let (drive_v, position_um) = (-10.0 + 100.0 * share, 12.0 * share);
            assert!(
                (scale.drive_v(scale.dac_code(drive_v)) - drive_v).abs() <= 0.5 * scale.dac_lsb_v
            );
            assert!(
                (scale.position_um(scale.adc_code(position_um)) - position_um).abs()
                    <= 0.5 * scale.adc_lsb_um
            );
        }
        assert_eq!(scale.dac_code(1e9), scale.dac_code(90.0));
        assert_eq!(scale.adc_code(1e9), SensorCode::highest(16));
        let zeroed = scale.zeroed_at(2.0);
        assert!((zeroed.position_um(scale.adc_code(2.0))).abs() <= 0.5 * scale.adc_lsb_um);
    }
}
