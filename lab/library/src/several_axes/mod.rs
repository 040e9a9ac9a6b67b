//! Stages with several drives and sensors: which effect is missing in which channel or mode, and a decoupled
//! servo.
//!
//! * [`recordings`]: records in memory; `manifest`: from files (feature `readers`);
//! * [`structure`]: effects, each in its channel or mode;
//! * [`finder`]: the search; `all_responses`: where it begins with a stage of many modes;
//! * [`identification`]: one model of given structure, from the responses to the records;
//! * [`planted`]: simulated stages whose truth is known, and the score on them;
//! * [`decoupling`]: a servo for every mode; [`matrix_law`]: PIDSMO and PIDSMC with matrices;
//! * [`loop_check`]: the loops of both as a whole;
//! * [`model_text`]: models as text and figures of a search.

mod all_responses;
pub mod decoupling;
pub mod finder;
mod fit;
pub mod identification;
pub mod loop_check;
#[cfg(feature = "readers")]
pub mod manifest;
pub mod matrix_law;
mod modal_start;
pub mod model_text;
pub mod planted;
pub mod recordings;
mod residual_spectra;
pub mod response_matrix;
pub mod structure;
