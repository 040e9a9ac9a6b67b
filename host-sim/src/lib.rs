//! The f64 plant of Hysteron: one file per physical effect, chained into a piezoelectric actuator.
//!
//! * [`effect`]: every physical effect, what it declares about itself, and the registry of them;
//! * [`chain`]: a [`chain::Model`] is a list of effects with values; it builds the chain of steppers for one
//!   record and runs it;
//! * [`linear_system`]: exact discretisation of small linear systems, shared by the dynamic effects;
//! * [`hysteresis_surface`]: the polynomial surfaces `F` and `G` of the one-sided model and their collapsed
//!   evaluation.
//!
//! # Time
//! A record is sampled at `t[k]`; the drive `u[k]` acts from `t[k]` to `t[k+1]`. Inside a chain the element
//! `k` of a signal belongs to that interval: it is the value held over it (in front of a dynamic stage) or
//! reached at its end (behind one). What is measured at `t[k]` is therefore element `k - 1`, and the value at
//! rest for `k = 0`.

mod balance_law;
pub mod bench;
pub mod block;
pub mod block_chain;
mod block_laws;
pub mod chain;
pub mod closed_loop;
pub mod converter_scale;
pub mod domain_stage;
pub mod effect;
pub mod elastoplastic_friction;
pub mod electromechanical;
pub mod hysteresis_coefficients;
pub mod hysteresis_inverse;
pub mod hysteresis_surface;
pub mod intersample;
pub mod law;
pub mod linear_system;
pub mod loop_inverse;
mod loop_opening;
pub mod noise;
pub mod physics;
pub mod rate_dependent_hysteresis;
pub mod rig_effects;
pub mod several_axes;
pub mod stepping_loop;
pub mod stick_slip;
pub mod variations;
pub mod waveform;
