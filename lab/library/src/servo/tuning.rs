//! What a design is asked for, and the numbers that its predictor is tuned by.

use serde::{Deserialize, Serialize};

/// What the predictor is tuned by.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PredictorTuning {
    /// Weight of the effort, `rho`.
    pub effort_weight: f64,
    /// RMS change of the unknown input in one period, um.
    pub unknown_change_um: f64,
    /// RMS change of the slope of the unknown input in one period, um per period; zero for no slope.
    pub unknown_slope_change_um: f64,
    /// White force, um RMS.
    pub force_noise_um: f64,
    /// Noise of the sensor, um RMS.
    pub sensor_noise_um: f64,
    /// Noise of the reading about half the sampling rate that the observer reckons with beside the white one,
    /// um RMS: the more, the less the law answers there. Zero for none; it takes one of the law's states, and
    /// where none is free it is left out.
    #[serde(default)]
    pub fast_noise_um: f64,
}

impl PredictorTuning {
    /// Where the scan begins.
    pub const START: Self = Self {
        effort_weight: 1.0,
        unknown_change_um: 0.002,
        unknown_slope_change_um: 0.0,
        force_noise_um: 0.003,
        sensor_noise_um: 0.001,
        fast_noise_um: 0.0,
    };
}
/// What the scan designs for.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Demands {
    /// Highest frequency of references, Hz.
    pub reference_hz: f64,
    /// Error of the hysteresis model at the reference's frequency, um RMS; a third of it at three times the
    /// frequency.
    pub model_error_um: f64,
    /// Noise of the sensor, um RMS.
    pub sensor_noise_um: f64,
    /// Largest sensitivity that is accepted.
    pub sensitivity_peak: f64,
    /// The usual margins are kept where that costs less than a third of the error ([`super::robust`]; the
    /// plain scan of [`super::predictor::tune`] has no such preference).
    #[serde(default)]
    pub usual_margins: bool,
}

impl Default for Demands {
    fn default() -> Self {
        Self {
            reference_hz: 150.0,
            model_error_um: 0.02,
            sensor_noise_um: 0.001,
            sensitivity_peak: 2.5,
            usual_margins: true,
        }
    }
}
