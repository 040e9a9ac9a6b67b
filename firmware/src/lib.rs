//! What Hysteron's images for the boards of [`board`] are made of; each image has its own handlers of
//! interrupts and faults.
//!
//! A hardware timer beats at the sample rate ([`sample_clock`]); its compare interrupt, the only one at the
//! highest priority, runs the control tick ([`control`]). Everything else runs in Embassy tasks below it and
//! can never delay it: the critical sections of the images mask every priority but that one
//! ([`critical_section_below_control`]).
#![no_std]

pub mod board;
pub mod command_port;
pub mod command_tasks;
pub mod control;
pub mod critical_section_below_control;
pub mod event_log;
pub mod fault;
pub mod front_end;
pub mod lights;
pub mod log_channel;
#[cfg(feature = "nucleo-g474re")]
pub mod no_update;
pub mod option_bytes;
pub mod recorder;
pub mod ring;
pub mod safety_lines;
pub mod sample_clock;
pub mod serial_device;
pub mod serial_line;
pub mod serial_port;
pub mod settings;
pub mod stack;
pub mod supply;
pub mod task_clock;
pub mod telemetry;
pub mod temperature;
pub mod temperature_codes;
pub mod trace_tasks;
#[cfg(feature = "nucleo-h743zi")]
pub mod update;
pub mod update_state;
pub mod watchdog;

#[cfg(feature = "nucleo-g474re")]
pub use no_update as update;
