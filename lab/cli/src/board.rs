//! `board`: what an operator does with the amplifier's board.
//!
//! Commands that speak with a board's serial port are here, each in a file of its own, on `hysteron_client`.
//! What goes over the debug probe is done by the program `hysteron-probe`, which needs USB, everything else
//! by `hysteron-board`, which needs another compiler; both are built apart.

mod attach;
mod connection;
mod envelope;
mod record;
mod record_over_probe;
mod scope;
mod status;
mod sweep;
mod tune;
mod update;
mod upload;

use clap::{CommandFactory, Parser, Subcommand};
use connection::{LineArguments, WiringArguments};
use hysteron::{Error, Result};
use hysteron_browser::local_server::ANY_PORT;
use std::ffi::OsString;
use std::net::SocketAddr;
use std::path::PathBuf;
use std::process::{Command, ExitCode};

use crate::arguments::SensorSaid;

/// Work with the amplifier's board over its serial port
#[derive(Parser)]
#[command(
    name = "hysteron board",
    max_term_width = 100,
    after_help = "Example:\n  hysteron board tune tuned --port /dev/ttyACM0 --drive-max-v 80"
)]
struct BoardArguments {
    #[command(subcommand)]
    command: BoardCommand,
}

#[derive(Subcommand)]
enum BoardCommand {
    /// From an empty board to a running servo: condition, record, explain, design, check, upload, verify, one
    /// report
    Tune {
        /// Folder to write: recording, model, servo, block, report.html, tune.json
        out: PathBuf,
        /// What the actuator is
        #[command(flatten)]
        wiring: WiringArguments,
        /// Highest frequency of references, Hz
        #[arg(long, default_value_t = 50.0, value_name = "HZ")]
        reference_hz: f64,
        /// What is known of the sensor
        #[command(flatten)]
        sensor: SensorSaid,
        /// Where the board is
        #[command(flatten)]
        line: LineArguments,
        /// Replace files that exist
        #[arg(long)]
        force: bool,
    },
    /// Condition the actuator, play exponential sines over a band, and write what came as a data set, with the
    /// transfer function and the distortion
    Sweep {
        /// Folder to write, as `hysteron explain` takes it
        out: PathBuf,
        /// Lowest frequency, Hz
        #[arg(long, value_name = "HZ")]
        from_hz: f64,
        /// Highest frequency, Hz: up to a quarter of the board's sampling rate
        #[arg(long, value_name = "HZ")]
        to_hz: f64,
        /// Amplitude, V
        #[arg(long, value_name = "V")]
        amplitude_v: f64,
        /// Drive about which it swings, V [default: the middle of the range]
        #[arg(long, value_name = "V")]
        offset_v: Option<f64>,
        /// What the actuator is, for a board without a block
        #[command(flatten)]
        wiring: WiringArguments,
        /// Where the board is
        #[command(flatten)]
        line: LineArguments,
        /// Replace files that exist
        #[arg(long)]
        force: bool,
    },
    /// Condition the actuator, play drives that show what there is to see, and write what came as a data set;
    /// `record OUT IMAGE --probe` does it over the debug probe
    Record {
        /// Folder to write, as `hysteron explain` takes it
        out: PathBuf,
        /// What the actuator is, for a board without a block
        #[command(flatten)]
        wiring: WiringArguments,
        /// Where the board is
        #[command(flatten)]
        line: LineArguments,
        /// Replace files that exist
        #[arg(long)]
        force: bool,
    },
    /// Show position, reference, drive, error and spectrum on a page of this machine; it commands nothing but
    /// STOP
    #[command(
        after_help = "Without a board:\n  hysteron board emulate --tcp 127.0.0.1:50000\n  hysteron board scope --tcp 127.0.0.1:50000 --baud 921600"
    )]
    Scope {
        /// Where the page is served: an address of this machine alone
        #[arg(long, value_name = "ADDRESS:PORT", default_value_t = ANY_PORT)]
        listen: SocketAddr,
        /// Do not open a browser
        #[arg(long)]
        no_open: bool,
        /// Where the board is
        #[command(flatten)]
        line: LineArguments,
    },
    /// Bring a parameter block and restart with it, or let it take over the running loop (--swap)
    Upload {
        /// The block, from `hysteron design --block`
        block: PathBuf,
        /// Take the place of the running block without opening the loop and without a step of the drive; not
        /// kept in the flash
        #[arg(long)]
        swap: bool,
        /// Where the board is
        #[command(flatten)]
        line: LineArguments,
    },
    /// Bring another image over the line and restart with it; the board puts the previous one back unless it
    /// runs for a healthy second
    Update {
        /// The image, an ELF file, as `cargo xtask firmware` builds it
        image: PathBuf,
        /// Its authentication code, as `board sign` prints it
        #[arg(long, value_name = "HEX")]
        code: String,
        /// Where the board is
        #[command(flatten)]
        line: LineArguments,
    },
    /// Print the authentication code without which the board takes no image
    Sign {
        /// The image, an ELF file, as `cargo xtask firmware` builds it
        image: PathBuf,
        /// The board's key, 32 hexadecimal digits
        #[arg(long, value_name = "FILE")]
        key: PathBuf,
    },
    /// Write the boot stage's sector with a key, for the debug probe: the only way in which a board gets one
    BootSector {
        /// The boot stage, an ELF file, as `cargo xtask firmware` builds it
        stage: PathBuf,
        /// The board's key, 32 hexadecimal digits
        #[arg(long, value_name = "FILE")]
        key: PathBuf,
        /// The sector
        #[arg(long, value_name = "FILE")]
        out: PathBuf,
        /// Replace a file that exists
        #[arg(long)]
        force: bool,
    },
    /// Say what a safety envelope allows, and bring it to the board where its checksum is named
    Envelope {
        /// The envelope: limits of drive, slew, current and guards that no block exceeds
        /// (firmware/README.md, *Safety envelope*)
        file: PathBuf,
        /// The checksum that this command says without it
        #[arg(long, value_name = "HEX")]
        checksum: Option<String>,
        /// Where the board is
        #[command(flatten)]
        line: LineArguments,
    },
    /// Say how the board is
    Status {
        /// Where the board is
        #[command(flatten)]
        line: LineArguments,
    },
    /// Send commands of the General Command Set and print the answers
    Send {
        /// The commands, each in quotes
        #[arg(required = true)]
        commands: Vec<String>,
        /// Where the board is
        #[command(flatten)]
        line: LineArguments,
    },
    /// Pass what is typed on to the board and print what comes; with --probe IMAGE show its log over the
    /// debug probe
    Attach {
        /// Where the board is
        #[command(flatten)]
        line: LineArguments,
    },
    /// Write an image into the board's flash over the debug probe (by `hysteron-probe`)
    #[command(after_help = PROBE_NEEDED)]
    Flash {
        /// The image, an ELF file, as `cargo xtask firmware` builds it, and options of `hysteron-probe flash`
        #[arg(required = true)]
        words: Vec<String>,
    },
    /// Run the unmodified image on an emulated board, its serial port on a socket (by `hysteron-board`)
    #[command(after_help = BOARD_NEEDED)]
    Emulate {
        /// Options of `hysteron-board emulate`, as --tcp 127.0.0.1:50000
        words: Vec<String>,
    },
}

/// What a command needs that another program does, where it is not there.
const PROBE_NEEDED: &str = "It is done by `hysteron-probe`: in the project's folder `cargo install --path board/probe --locked` installs it.";
const BOARD_NEEDED: &str =
    "It is done by `hysteron-board`: `cargo xtask firmware` and `cargo xtask board` build it.";

/// Runs it.
pub fn run(words: &[OsString]) -> ExitCode {
    let first = words
        .first()
        .and_then(|word| word.to_str())
        .unwrap_or("--help");
    if is_for_probe(words) {
        return pass_on("hysteron-probe", words, PROBE_NEEDED);
    }
    if first == "record" && names_probe(words) {
        return record_over_probe::record(words, |words| {
            pass_on("hysteron-probe", words, PROBE_NEEDED)
        });
    }
    if first == "emulate" {
        return pass_on("hysteron-board", words, BOARD_NEEDED);
    }
    let help = [OsString::from("--help")];
    let words = if words.is_empty() { &help } else { words };
    let words = std::iter::once(OsString::from("hysteron board")).chain(words.iter().cloned());
    let arguments = match BoardArguments::try_parse_from(words) {
        Ok(arguments) => arguments,
        Err(error) => {
            // Where printing fails, no way is left to report it.
            let _ = error.print();
            return if error.use_stderr() {
                ExitCode::from(2)
            } else {
                ExitCode::SUCCESS
            };
        }
    };
    match obey(arguments.command) {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::from(1),
        Err(problem) => {
            eprintln!("error: {problem}");
            ExitCode::from(2)
        }
    }
}

fn obey(command: BoardCommand) -> Result<bool> {
    match command {
        BoardCommand::Tune {
            out,
            wiring,
            reference_hz,
            sensor,
            line,
            force,
        } => tune::tune(
            &out,
            &wiring,
            &tune::TuneRequest {
                reference_hz,
                sensor_bandwidth_hz: sensor.sensor_bandwidth_hz,
            },
            &line,
            force,
        ),
        BoardCommand::Record {
            out,
            wiring,
            line,
            force,
        } => record::record(&out, &wiring, &line, force),
        BoardCommand::Sweep {
            out,
            from_hz,
            to_hz,
            amplitude_v,
            offset_v,
            wiring,
            line,
            force,
        } => sweep::sweep(
            &out,
            &sweep::SweepRequest {
                from_hz,
                to_hz,
                amplitude_v,
                offset_v,
            },
            &wiring,
            &line,
            force,
        ),
        BoardCommand::Scope {
            listen,
            no_open,
            line,
        } => scope::scope(listen, no_open, &line),
        BoardCommand::Upload { block, swap, line } => upload::upload(&block, swap, &line),
        BoardCommand::Update { image, code, line } => update::update(&image, &code, &line),
        BoardCommand::Sign { image, key } => update::sign(&image, &key),
        BoardCommand::BootSector {
            stage,
            key,
            out,
            force,
        } => update::write_boot_sector(&stage, &key, &out, force),
        BoardCommand::Envelope {
            file,
            checksum,
            line,
        } => envelope::envelope(&file, checksum.as_deref(), &line),
        BoardCommand::Status { line } => status::status(&line),
        BoardCommand::Send { commands, line } => attach::send(&commands, &line),
        BoardCommand::Attach { line } => attach::attach(&line),
        // Words that other programs understand were passed on before they came here.
        BoardCommand::Flash { .. } => Err(Error::new("flash", PROBE_NEEDED)),
        BoardCommand::Emulate { .. } => Err(Error::new("emulate", BOARD_NEEDED)),
    }
}

/// What works over the debug probe is another program's.
fn is_for_probe(words: &[OsString]) -> bool {
    let mut words = words.iter().map(|word| word.to_string_lossy());
    match words.next().as_deref() {
        Some("flash") => true,
        Some("attach") => words.any(|word| is_probe(&word)),
        _ => false,
    }
}

/// Whether a recording is to be made over the probe.
fn names_probe(words: &[OsString]) -> bool {
    words.iter().any(|word| is_probe(&word.to_string_lossy()))
}

fn is_probe(word: &str) -> bool {
    word == "--probe" || word.starts_with("--probe=")
}

/// Hands the words to a program beside this one, or on the path, and ends as it ends.
fn pass_on(name: &str, words: &[OsString], how_to_get_it: &str) -> ExitCode {
    let name = format!("{name}{}", std::env::consts::EXE_SUFFIX);
    let beside = std::env::current_exe()
        .map(|this| this.with_file_name(&name))
        .ok()
        .filter(|beside| beside.is_file());
    let program = beside.unwrap_or_else(|| PathBuf::from(&name));
    match Command::new(&program).args(words).status() {
        Ok(status) => ExitCode::from(
            status
                .code()
                .and_then(|code| u8::try_from(code).ok())
                .unwrap_or(1),
        ),
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => {
            if words.iter().any(|word| word == "--help" || word == "-h") && say_own_help(words) {
                return ExitCode::SUCCESS;
            }
            eprintln!(
                "error: {name} is neither beside this program nor on the path. {how_to_get_it}"
            );
            ExitCode::from(2)
        }
        Err(error) => {
            eprintln!("error: {}: {error}. {how_to_get_it}", program.display());
            ExitCode::from(2)
        }
    }
}

/// What this program knows of a command that another one has; whether it knows it.
fn say_own_help(words: &[OsString]) -> bool {
    let mut whole = BoardArguments::command();
    whole.build();
    let command = words
        .first()
        .and_then(|word| word.to_str())
        .and_then(|name| whole.find_subcommand_mut(name));
    // Where printing fails, no way is left to report it.
    command.map(|command| command.print_long_help()).is_some()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_goes_over_the_probe_is_known_by_its_words() {
        let words = |text: &str| text.split(' ').map(OsString::from).collect::<Vec<_>>();
        for text in [
            "flash image.elf",
            "flash",
            "attach --probe image.elf",
            "attach image.elf --probe=0483:374e",
        ] {
            assert!(is_for_probe(&words(text)), "{text}");
        }
        for text in [
            "attach --port /dev/ttyACM0",
            "scope --tcp 127.0.0.1:1",
            "emulate",
            "status --probe",
        ] {
            assert!(!is_for_probe(&words(text)), "{text}");
        }
    }
}
