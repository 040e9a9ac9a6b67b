//! Everything that the host computes for the tick: plain integers, `Copy`, quantised once.
//!
//! The formats are those of [`crate::signal`]; where a number has another one, its field gives it.

use crate::codes::{DriveCode, MOST_BITS, SensorCode};
use crate::gain_adaptation::AdaptationParameters;
use crate::learned_feedforward::LearningParameters;
use crate::one_sided_hysteresis::SurfaceCoefficients;
use crate::pid_regulator::PidParameters;
use crate::predictor_law::PredictorParameters;
use crate::sensor_lag::SensorLag;
use crate::signal::narrow;
use crate::sliding_mode_controller::SlidingModeParameters;
use crate::state_estimator::EstimatorParameters;

/// Fraction bits of codes per volt.
pub const CODES_PER_VOLT_FRACTION_BITS: u32 = 16;
/// More codes than any converter has.
pub const NO_SLEW_LIMIT: u32 = 1 << MOST_BITS;

/// Converters and limits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ConverterParameters {
    /// Position at ADC code 0, um with 24 fraction bits.
    pub adc_zero: i32,
    /// Position per ADC code, um with 40 fraction bits.
    pub adc_step: i64,
    /// Drive at DAC code 0, V with 22 fraction bits.
    pub dac_zero: i32,
    /// Drive per DAC code, V with 38 fraction bits.
    pub dac_step: i64,
    /// DAC codes per volt, with [`CODES_PER_VOLT_FRACTION_BITS`]: below 32 768 codes per volt, 20 bits over
    /// 32 V.
    pub dac_codes_per_volt: i32,
    /// Lowest DAC code within the limits of the actuator.
    pub dac_code_min: DriveCode,
    /// Highest DAC code within the limits of the actuator.
    pub dac_code_max: DriveCode,
    /// Largest change of the drive in one tick, codes: the slew limit of the amplifier; [`NO_SLEW_LIMIT`]
    /// limits nothing.
    pub slew_codes: u32,
    /// Bits of the ADC's codes, 8 to 20.
    pub adc_bits: u8,
    /// Bits of the DAC's codes, 8 to 20.
    pub dac_bits: u8,
    /// Carries the rounding error of each code into the next one, which moves it to high frequencies.
    pub noise_shaping: bool,
}

impl ConverterParameters {
    /// Position for an ADC code, um with 24 fraction bits.
    #[inline]
    #[must_use]
    pub fn position(&self, adc_code: SensorCode) -> i32 {
        self.adc_zero
            .saturating_add(narrow((i64::from(adc_code) * self.adc_step) >> 16))
    }

    /// The nearest DAC code to a drive (V with 22 fraction bits), in steps; below 0 and beyond the last one
    /// it is no code.
    #[inline]
    #[must_use]
    pub fn steps(&self, drive: i32) -> i32 {
        // V (22) * codes/V (16) -> codes; 63 bits less 38 always fit.
        narrow(
            (i64::from(drive.saturating_sub(self.dac_zero)) * i64::from(self.dac_codes_per_volt)
                + (1i64 << 37))
                >> 38,
        )
    }

    /// Drive for a DAC code, V with 22 fraction bits.
    #[inline]
    #[must_use]
    pub fn drive(&self, dac_code: DriveCode) -> i32 {
        self.dac_zero
            .saturating_add(narrow((i64::from(dac_code) * self.dac_step) >> 16))
    }
}

/// What stands between the law's output and the drive.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ActuatorParameters {
    /// The law's output is the drive, V.
    Direct,
    /// The law's output is a force-equivalent displacement, um, and the actuator is taken to be linear.
    Linear {
        /// Drive per displacement, V/um with 20 fraction bits.
        volts_per_micrometre: i32,
        /// Displacement per drive, um/V with 28 fraction bits.
        micrometres_per_volt: i32,
    },
    /// The law's output is a force-equivalent displacement, um; the hysteresis is inverted.
    OneSidedHysteresis {
        /// Surfaces of the hysteresis.
        surfaces: SurfaceCoefficients,
        /// Lower limit of the drive, V with 22 fraction bits.
        drive_min: i32,
        /// Range of the drive, V with 22 fraction bits.
        drive_range: i32,
        /// Its reciprocal, 1/V with 32 fraction bits.
        share_per_volt: i64,
    },
}

/// The control law.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(clippy::large_enum_variant)] // without allocation every variant takes the largest one's room anyway
pub enum LawParameters {
    /// The drive stays where it is.
    Hold,
    /// PID, PI, feedforward and their union (with a notch).
    Regulator(PidParameters),
    /// PIDSMC, ideal sliding mode or boundary layer on an estimate of the states: with the PIDSMO the thesis'
    /// PIDSMOC, with an alpha-beta filter its PIDSMC + alpha-beta.
    SlidingMode {
        /// Estimator of position and velocity.
        estimator: EstimatorParameters,
        /// Controller.
        controller: SlidingModeParameters,
    },
    /// PIDSMOC in the predictor form.
    Predictor(PredictorParameters),
}

/// All parameters of the tick.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(C)]
pub struct ServoParameters {
    /// How late the sensor is known to be: the reference is made as late before a reading is compared with
    /// it.
    pub sensor_lag: SensorLag,
    /// Converters and limits.
    pub converters: ConverterParameters,
    /// What stands between the law and the drive.
    pub actuator: ActuatorParameters,
    /// The law.
    pub law: LawParameters,
    /// True if a code acts one period after the reading that it was computed from, as on the target; false if
    /// at once.
    pub delayed: bool,
    /// How the correction of a periodic reference is learned; `None`: it is not.
    pub learning: Option<LearningParameters>,
    /// Bounds within which a predictor corrects the gain of its model; `None`: it does not.
    pub adaptation: Option<AdaptationParameters>,
}
