//! The part of Hysteron that runs on the microcontroller: `no_std`, and integers only in the control tick.
//!
//! [`loop_telemetry`] and [`loop_margin`] stand below the tick; no other module has floats.
//!
//! Everything here is also what the host simulation runs, bit for bit. The map of the crate is the list of
//! its modules: [`servo_tick`] is the entry (ADC code in, DAC code out), [`servo_parameters`] is everything
//! that the host computes for it; the other modules are its parts. Signals and their formats are in
//! [`signal`].
#![no_std]

#[cfg(test)]
mod accepted_blocks;
pub mod amplifier;
pub mod amplifier_command;
pub mod block_choice;
pub mod block_swap;
pub mod checksum;
pub mod codes;
pub mod command_limits;
pub mod command_lines;
pub mod command_schedule;
pub mod command_text;
pub mod creep_inverse;
pub mod extrema_stack;
pub mod filter_design;
pub mod firmware_update;
pub mod gain_adaptation;
pub mod guard;
pub mod host_watch;
pub mod integer_row;
pub mod kept_events;
pub mod kept_settings;
pub mod learned_feedforward;
pub mod line_input;
pub mod loop_bands;
pub mod loop_margin;
pub mod loop_telemetry;
pub mod one_sided_hysteresis;
pub mod output_limit;
pub mod output_monitor;
pub mod parameter_block;
pub mod pid_regulator;
pub mod predictor_law;
pub mod reference_generator;
pub mod reference_window;
pub mod safety_envelope;
pub mod self_test;
pub mod sensor_lag;
pub mod sensor_linearisation;
pub mod servo_parameters;
pub mod servo_tick;
pub mod set_point;
pub mod signal;
pub mod signal_filter;
pub mod sliding_mode_controller;
pub mod state_estimator;
pub mod stepping;
pub mod stepping_parameters;
pub mod swing_watch;
pub mod trace_frame;
pub mod wave_table;
pub mod wire;
