//! What every effect is made of: the types below effects and chain.
//!
//! An [`Effect`] gives its [`Declaration`], its [`Parameter`]s, the starts from which it is looked for and a
//! [`Stage`] that walks along a signal. A [`Model`] is a list of effects with values; `chain` runs it.

mod declaration;
mod model;
mod origin;
mod recording;
mod stage;

/// Identifiers by which effects ask a model for one another.
pub mod id {
    /// `effect/amplifier_bandwidth.rs`.
    pub const AMPLIFIER_BANDWIDTH: &str = "amplifier_bandwidth";
    /// `effect/bipolar.rs`.
    pub const BIPOLAR: &str = "bipolar";
    /// `effect/gain.rs`.
    pub const GAIN: &str = "gain";
    /// `effect/hysteresis.rs`.
    pub const HYSTERESIS: &str = "hysteresis";
    /// `effect/initial_curve.rs`.
    pub const INITIAL_CURVE: &str = "initial_curve";
    /// `effect/mains_hum.rs`.
    pub const MAINS_HUM: &str = "mains_hum";
    /// `effect/play_operators.rs`.
    pub const PLAY_OPERATORS: &str = "play_operators";
    /// `effect/rate_dependent_surfaces.rs`.
    pub const RATE_DEPENDENT_SURFACES: &str = "rate_dependent_surfaces";
    /// `effect/second_mode.rs`.
    pub const SECOND_MODE: &str = "second_mode";
    /// `effect/sensor_bandwidth.rs`.
    pub const SENSOR_BANDWIDTH: &str = "sensor_bandwidth";
    /// `effect/slew_limit.rs`.
    pub const SLEW_LIMIT: &str = "slew_limit";
    /// `effect/two_sided.rs`.
    pub const TWO_SIDED: &str = "two_sided";
    /// `effect/vibration.rs`.
    pub const VIBRATION: &str = "vibration";
}

pub use declaration::*;
pub use model::*;
pub use origin::*;
pub use recording::*;
pub use stage::*;
