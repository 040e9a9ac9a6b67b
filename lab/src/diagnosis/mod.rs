//! Which physical effect is missing, and how sure we are.
//!
//! * [`screening`] scores every candidate on the residual without refitting;
//! * [`refit`] fits the finalists and judges them on records that were not fitted;
//! * [`transferred`] asks first what a model that came from elsewhere lacks, with its values held;
//! * [`growth`] adds effects one at a time, takes back what is no longer needed, and stops at the floor;
//! * [`verdict`] puts what came out into one of five words.

pub mod growth;
pub mod refit;
pub mod screening;
pub mod transferred;
pub mod verdict;
