//! Simulated data sets whose truth is known, and how often a diagnosis finds it.
//!
//! * [`case`](mod@case): one data set with hidden effects; [`case_set`]: many of them;
//! * [`drives`]: what they are driven with, and what is recommended for a recording;
//! * [`signatures`]: what every effect does to the reading, and which others look alike;
//! * [`score`]: diagnoses of them against their truth.

pub mod case;
pub mod case_set;
pub mod drives;
pub mod score;
pub mod signatures;
