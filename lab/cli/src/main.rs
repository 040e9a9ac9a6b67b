//! The `hysteron` program: see `hysteron --help`, or README.md.

mod add;
mod capture;
mod check;
mod command_line;
mod compare;
mod design;
mod desk;
mod diagnose;
mod explain;
mod identify;
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

/// A reader that has seen enough (`hysteron ... | head`) ends the program without a word.
fn end_quietly_with_the_reader() {
    let usual = std::panic::take_hook();
    std::panic::set_hook(Box::new(move |panic| {
        let text = panic.payload().downcast_ref::<String>().map_or("", String::as_str);
        if text.starts_with("failed printing to stdout") {
            std::process::exit(0);
        }
        usual(panic);
    }));
}

fn main() -> ExitCode {
    end_quietly_with_the_reader();
    command_line::run()
}
