//! The part of Hysteron that runs on the microcontroller: `no_std`, and integers only in the control tick.
//!
//! Everything here is also what the host simulation runs, bit for bit. The map of the crate is the list of its modules.
#![no_std]

pub mod extrema_stack;
