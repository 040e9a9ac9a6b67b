//! What every effect is made of: the types below effects and chain.
//!
//! An [`Effect`] gives its [`Declaration`], its [`Parameter`]s, the starts from which it is looked for and a
//! [`Stage`] that walks along a signal. A [`Model`] is a list of effects with values; `chain` runs it.

mod declaration;
mod model;
mod recording;
mod stage;

pub use declaration::*;
pub use model::*;
pub use recording::*;
pub use stage::*;
