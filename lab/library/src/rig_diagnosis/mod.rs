//! Which effect a model of a stick-slip rig misses.
//!
//! * [`recordings`]: drives and readings of a rig, their noise, and the errors of a model by block;
//! * [`fit`]: the values of some effects, refined on the fitted readings;
//! * [`finder`]: the pool of models with effects more than the start, and those that the data cannot reject
//!   ([`crate::diagnosis::confidence_set`]);
//! * [`outcome`]: verdict, findings and values, as types and in a sentence;
//! * [`planted`]: recordings of a rig with a hidden effect, and how an outcome is judged.
//!
//! The values of the start stay as they are: a move adds one effect
//! ([`hysteron_sim::rig_effects`]), or frees the values that it has in the start.

pub mod finder;
pub mod fit;
pub mod outcome;
pub mod planted;
pub mod recordings;

pub use outcome::RigDiagnosis;
pub use recordings::RigData;

use crate::diagnosis::policy::Policy;
use crate::error::Result;
use crate::watch::Watch;
use hysteron_sim::stick_slip::StickSlipActuator;

/// Finds what the model of a rig misses.
///
/// # Errors
/// The model's simulation has no finite value.
pub fn diagnose_rig(
    data: &RigData,
    start: &StickSlipActuator,
    policy: &Policy,
    watch: &dyn Watch,
) -> Result<RigDiagnosis> {
    let (pool, simplest) = finder::search(data, start, policy, watch)?;
    Ok(outcome::report(&pool, &simplest))
}
