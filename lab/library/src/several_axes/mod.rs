//! Stages with several drives and sensors: which effect is missing in which channel or mode, and a decoupled
//! servo.
//!
//! * [`recordings`]: records and their manifest;
//! * [`structure`]: effects, each in its channel or mode;
//! * [`finder`]: the search;
//! * [`planted`]: simulated stages whose truth is known, and the score on them;

pub mod finder;
mod fit;
pub mod planted;
pub mod recordings;
mod residual_spectra;
pub mod structure;
