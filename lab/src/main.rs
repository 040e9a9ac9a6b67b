//! The `hysteron` program: see `hysteron --help`, or README.md.

use std::process::ExitCode;

fn main() -> ExitCode {
    hysteron::cli::run()
}
