//! The `hysteron` program: see `hysteron --help`, or README.md.

/// As the standard one, but that nothing is printed to a reader who has gone.
macro_rules! println {
    () => { println!("") };
    ($($text:tt)*) => { $crate::screen::say(format_args!($($text)*)) };
}

mod add;
mod arguments;
mod axes;
#[cfg(feature = "board")]
mod board;
#[cfg(feature = "trace")]
mod capture;
mod check;
mod command_line;
mod compare;
mod design;
mod desk;
mod diagnose;
mod drives;
mod effects;
mod explain;
mod export;
mod full_build;
mod identify;
#[cfg(feature = "lab")]
mod lab;
mod manual;
mod plant;
mod plant_program;
mod progress;
mod read_arguments;
#[cfg(feature = "thesis")]
mod reproduce;
mod rig;
mod score;
mod screen;
mod simulate;
mod stepping;
mod survey;
mod tables;
mod track;
mod write_whole;

use std::process::ExitCode;

/// A decoder that stumbles over a damaged file says nothing: the error does.
fn keep_panics_from_users() {
    let usual = std::panic::take_hook();
    std::panic::set_hook(Box::new(move |panic| {
        if !hysteron::dataset::readers::foreign::is_decoding() {
            usual(panic);
        }
    }));
}

fn main() -> ExitCode {
    keep_panics_from_users();
    command_line::run()
}
