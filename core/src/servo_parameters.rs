//! Everything that the host computes for the tick: plain integers, `Copy`, quantised once.
//!
//! The formats are those of [`crate::signal`]; where a number has another one, its field says so.

use crate::gain_adaptation::AdaptationParameters;
use crate::learned_feedforward::LearningParameters;
use crate::one_sided_hysteresis::SurfaceCoefficients;
use crate::pid_regulator::PidParameters;
use crate::predictor_law::PredictorParameters;
use crate::signal::narrow;
use crate::sliding_mode_controller::SlidingModeParameters;
use crate::state_estimator::EstimatorParameters;

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
    /// DAC codes per volt, with 20 fraction bits.
    pub dac_codes_per_volt: i32,
    /// Lowest DAC code within the limits of the actuator.
    pub dac_code_min: u16,
    /// Highest DAC code within the limits of the actuator.
    pub dac_code_max: u16,
    /// Largest change of the drive in one tick, codes: the slew limit of the amplifier; `u16::MAX` is none.
    pub slew_codes: u16,
    /// Carries the rounding error of each code into the next one, which moves it to high frequencies.
    pub noise_shaping: bool,
}

impl ConverterParameters {
    /// Position for an ADC code, um with 24 fraction bits.
    #[inline]
    #[must_use]
    pub fn position(&self, adc_code: u16) -> i32 {
        self.adc_zero.saturating_add(narrow((i64::from(adc_code) * self.adc_step) >> 16))
    }

    /// Drive for a DAC code, V with 22 fraction bits.
    #[inline]
    #[must_use]
    pub fn drive(&self, dac_code: u16) -> i32 {
        self.dac_zero.saturating_add(narrow((i64::from(dac_code) * self.dac_step) >> 16))
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
    /// PIDSMC, ideal sliding mode or boundary layer on an estimate of the states: with the PIDSMO the thesis' PIDSMOC, with an alpha-beta
    /// filter its PIDSMC + alpha-beta.
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
    /// Converters and limits.
    pub converters: ConverterParameters,
    /// What stands between the law and the drive.
    pub actuator: ActuatorParameters,
    /// The law.
    pub law: LawParameters,
    /// True if a code acts one period after the reading that it was computed from, as on the target; false if at once.
    pub delayed: bool,
    /// How the correction of a periodic reference is learned; `None`: it is not.
    pub learning: Option<LearningParameters>,
    /// Bounds within which a predictor corrects the gain of its model; `None`: it does not.
    pub adaptation: Option<AdaptationParameters>,
}
