//! Tests across rooms: one program, so that dependencies are linked once.

mod bipolar_drive;
mod devtools;
mod lab_page;
mod light_linear_stage;
mod main_job;
mod noise_floors;
mod random_input;
mod real_recordings;
mod report_page;
mod saved_model;
mod score;
mod servo_from_data;
mod servo_loop;
mod telemetry_and_swap;
mod trace_on_page;
