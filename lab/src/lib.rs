//! The lab of Hysteron.

pub mod report;
