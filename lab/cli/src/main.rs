//! The `hysteron` program: see `hysteron --help`, or README.md.

mod add;
mod board;
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
mod identify;
mod lab;
mod plant;
mod progress;
mod read_arguments;
mod reproduce;
mod score;
mod simulate;
mod tables;
mod track;
mod write_whole;

use std::process::ExitCode;

/// A reader that has seen enough (`hysteron ... | head`) ends the program without a word, and a decoder that stumbles over a damaged file says
/// nothing: the error does.
fn keep_panics_from_users() {
    let usual = std::panic::take_hook();
    std::panic::set_hook(Box::new(move |panic| {
        let text = panic.payload().downcast_ref::<String>().map_or("", String::as_str);
        if text.starts_with("failed printing to stdout") {
            std::process::exit(0);
        }
        if !hysteron::dataset::readers::foreign::is_decoding() {
            usual(panic);
        }
    }));
}

fn main() -> ExitCode {
    keep_panics_from_users();
    command_line::run()
}
