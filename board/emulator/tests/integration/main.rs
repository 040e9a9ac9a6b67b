//! Tests of the image on the emulated part: one program, so that dependencies are linked once.

mod analogue_inputs;
mod board_check;
mod boot;
mod closed_loop;
mod commands;
mod common;
mod dangers;
mod faults;
mod first_power_up;
mod gain_adaptation;
mod host_lost;
mod learned_feedforward;
mod on_chip;
mod option_bytes;
mod output_path;
mod record;
mod sampling_rate;
mod serial_port;
mod sliding_mode;
mod swap;
mod telemetry;
mod tick_cost;
mod trigger_output;
mod typed_commands;
mod update;
mod wide_codes;
