//! Signals of a recording at even times.

use super::units::SignalUnits;
use hysteron_sim::effect::AuxiliarySignal;

/// Signals at even times.
pub(super) struct Even {
    /// Samples per second.
    pub sample_rate_hz: f64,
    pub start_s: f64,
    pub u_v: Vec<f64>,
    pub y_um: Vec<f64>,
    pub force_n: Option<Vec<f64>>,
    pub auxiliary: Vec<AuxiliarySignal>,
    pub units: SignalUnits,
    /// What was assumed and mended.
    pub notes: Vec<String>,
}
