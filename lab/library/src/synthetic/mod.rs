//! Simulated data sets whose truth is known, and how often a diagnosis finds it.
//!
//! * [`case`](mod@case): one data set with hidden effects; [`case_set`]: many of them;
//! * [`score`]: what was said of them against their truth.

pub mod case;
pub mod case_set;
pub mod score;
