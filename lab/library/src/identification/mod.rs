//! From records to a model: least squares over the whole chain, the noise that nothing explains, finer
//! surfaces of hysteresis.
//!
//! * [`linearisation`]: residual and derivatives of a chain on records; [`nuisance_terms`]: what each
//!   record has of its own;
//! * [`fit`]: estimates parameters; [`uncertainty`]: how well the data fix them,
//!   [`identifiability`]: what they leave open;
//! * [`work`]: what all of these simulate, counted; [`budget`]: where it ends;
//! * [`noise_floor`]: what remains random, and on which evidence;
//! * [`finer_creep`], [`finer_hysteresis`], [`finer_plays`]: more terms and more flexible surfaces, so that a
//!   coarse description cannot pose as a missing effect.

pub mod budget;
pub mod finer_creep;
pub mod finer_hysteresis;
pub mod finer_plays;
pub mod fit;
pub mod held_values;
pub mod identifiability;
pub mod linearisation;
pub mod noise_floor;
pub mod nuisance_terms;
pub mod uncertainty;
pub mod work;
