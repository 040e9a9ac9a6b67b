//! Tests across rooms: one program, so that dependencies are linked once.

mod devtools;
mod lab_page;
mod learned_feedforward;
mod light_linear_stage;
mod light_mode;
mod main_job;
mod noise_floors;
mod other_actuators;
mod real_recordings;
mod report_page;
mod saved_model;
mod score;
mod servo_from_data;
mod servo_loop;
mod slow_adaptation;
mod telemetry_and_swap;
mod thesis;
mod trace_on_page;
