//! The program `hysteron-board`: `hysteron board ...` runs it. See `hysteron-board --help`.

mod emulate;

use std::process::ExitCode;

const USAGE: &str = "\
hysteron board emulate [--tcp 127.0.0.1:PORT] [--image ELF] [--block FILE | --empty] [--stage MODEL | --stick-slip RIG] [--front-end FILE] [--noise-nm N] [--truth FILE]
    The unmodified firmware image on an emulated STM32H743, with a simulated stage behind its converters, at the sampling rate that the
    image was built for. The serial port of the board is the socket; programs that speak the General Command Set 2.0 connect to it. Runs
    until it is interrupted; the board's log goes to the screen. It is not faster than the clock, and slower where this machine is.

    --tcp        where to listen [default: 127.0.0.1:50000]; port 0 takes a free one, which is said
    --image      the image [default: hysteron-firmware.elf beside this program]
    --block      the parameter block in the board's flash [default: the one designed for the simulated bench at 20 kHz; with --stage none]
    --empty      no parameter block in the flash
    --stage      the stage: a model, as `hysteron identify` writes it, at rest and never driven [default: the simulated bench]
    --stick-slip a stick-slip rig, as `hysteron stepping --rig` writes it; its block is designed unless one is named
    --front-end  how its converters are wired, as for `hysteron design` [default: that of the wiring page]
    --noise-nm   noise of its sensor, nm RMS [default: 2]
    --truth      writes what the stage really does: at every edge of the sample clock both codes and the true position, um";

fn main() -> ExitCode {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let words: Vec<&str> = words.iter().map(String::as_str).collect();
    let result = match words.as_slice() {
        ["emulate", options @ ..] => emulate::Options::read(options).and_then(emulate::run),
        ["--help" | "-h" | "help"] => {
            println!("{USAGE}");
            return ExitCode::SUCCESS;
        }
        [] => Err("expected `emulate`; `hysteron board --help` says more".into()),
        [other, ..] => Err(format!(
            "`{other}`: expected `emulate`; `hysteron board --help` says more"
        )),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(message) => {
            eprintln!("hysteron board: {message}");
            ExitCode::from(2)
        }
    }
}
