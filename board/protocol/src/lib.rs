//! A subset of the General Command Set (GCS) 2.0, the text with which programs speak to piezo controllers,
//! for Hysteron's amplifier.
//!
//! # How it works
//! Lines come from [`hysteron_core::command_lines`] in the [`DIALECT`] of this protocol.
//! [`session::Session::obey`] takes one; then [`session::Session::next`] is asked for what follows from it,
//! piece by piece: text to send, a command for the amplifier whose outcome is handed back, or a bounded piece
//! of work, after which others may have their turn. So no line, however long its answer, holds anything up.
//!
//! Nothing is allocated, nothing panics, there are no floats: numbers of the text are whole billionths
//! ([`decimal`]), those of the amplifier are its fixed-point formats. Control mathematics stay in
//! `hysteron_core`.
//!
//! The syntax and the codes of errors are those of the public documents of GCS 2.0 (Physik
//! Instrumente, *PZ281E General Command Set* and the command chapters of its controllers' manuals,
//! E-727 among them). Axis, output channel and wave generator are `1`; units are um, V and s.
#![no_std]

pub mod code_lines;
pub mod data_array;
pub mod decimal;
pub mod device;
pub mod error_code;
pub mod help;
pub mod parameters;
pub mod seal;
pub mod session;
pub mod waveform;
pub mod words;

use hysteron_core::command_lines::{CommandLines, Dialect};

/// Longest line, bytes.
pub const LINE_BYTES: usize = 512;
/// Room for lines that wait, bytes.
pub const STORE_BYTES: usize = 2048;

/// Asks whether the axis moves (`#5`).
pub const IS_MOVING: u8 = 5;
/// Asks whether the controller is ready (`#7`).
pub const IS_READY: u8 = 7;
/// Asks whether the wave generator runs (`#9`).
pub const IS_GENERATING: u8 = 9;

/// Commands of one byte, and which lines stop the amplifier: `STP` (`#24` does in every dialect). They are
/// answered in their turn.
pub const DIALECT: Dialect = Dialect {
    is_stop,
    single_bytes: &[IS_MOVING, IS_READY, IS_GENERATING],
    stop_waits: true,
};

/// The lines of this protocol that have come and wait.
pub type Lines = CommandLines<LINE_BYTES, STORE_BYTES>;

fn is_stop(line: &[u8]) -> bool {
    line.trim_ascii().eq_ignore_ascii_case(b"STP")
}
