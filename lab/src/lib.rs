//! The lab of Hysteron.
