//! Tests of the program as its users start it: one program, so that dependencies are linked once.

mod axes;
mod bad_input;
mod common;
mod formats;
mod front_ends;
mod guide;
mod lab;
mod outputs;
mod own_effects;
mod own_effects_page;
mod own_plant;
mod planting;
mod scope;
mod servo_files;
mod starts;
mod stepping;
mod stopping;
mod surveys;
#[cfg(target_os = "linux")]
mod under_limits;
