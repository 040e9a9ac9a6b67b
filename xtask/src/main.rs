//! Build and check chores: `cargo xtask check` is the test command of the project.
//!
//! `check` runs every step of [`steps`] in order, announces each with its time, and stops at the first that fails. What a step
//! needs and the machine lacks is installed where that is possible ([`toolchain`]), and said either way. No step is skipped
//! silently: outside CI what is missing is named and the check fails; in CI (`CI=true`) likewise.

mod browser;
mod control_code;
mod steps;
mod toolchain;
mod whole_circle;

use std::process::ExitCode;

const USAGE: &str = "\
cargo xtask check      everything: format, lints, docs, tests, the firmware's cross-build, the emulated target
cargo xtask host       the first four steps only
cargo xtask firmware   builds the firmware's images and checks the binaries
cargo xtask emulate    runs the tests of the images on the emulated STM32H743 (after `firmware`)";

fn main() -> ExitCode {
    let wanted: Vec<String> = std::env::args().skip(1).collect();
    let steps = match wanted.iter().map(String::as_str).collect::<Vec<_>>().as_slice() {
        ["check"] => steps::all(),
        ["host"] => steps::host(),
        ["firmware"] => steps::firmware(),
        ["emulate"] => steps::emulator(),
        _ => {
            eprintln!("{USAGE}");
            return ExitCode::from(2);
        }
    };
    match steps::run(&steps) {
        Ok(()) => ExitCode::SUCCESS,
        Err(message) => {
            eprintln!("\n{message}");
            ExitCode::FAILURE
        }
    }
}
