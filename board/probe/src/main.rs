//! The program `hysteron-probe`: `hysteron board flash`, and `attach` and `record` with `--probe`, run it.
//! See `hysteron-probe --help`.
//!
//! # How it works
//! [`image`] looks at an image before any probe is touched: is it one of this project, for this chip, and
//! where would it go? [`chip`] finds the one probe that is meant and sees that the chip behind it is the
//! right one and can be written. [`flash`], [`log`] and [`record`] do the work.

mod chip;
mod failure;
mod flash;
mod image;
mod log;
mod record;

use clap::{Args, Parser, Subcommand};
use flash::BootStage;
use std::path::PathBuf;
use std::process::ExitCode;

/// Hysteron's amplifier over a debug probe
#[derive(Parser)]
#[command(name = "hysteron-probe", max_term_width = 100)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Write the boot stage and the image into the board's flash and read them back. The board restarts; its
    /// parameter blocks stay
    Flash {
        /// The image, an ELF file, as `cargo xtask firmware` builds it
        image: PathBuf,
        /// The boot stage, an ELF file [default: hysteron-boot-stage beside the image]
        #[arg(long, value_name = "FILE", conflicts_with = "keep_boot_stage")]
        boot_stage: Option<PathBuf>,
        /// Leave the boot stage that the board has
        #[arg(long)]
        keep_boot_stage: bool,
        /// Look at the image and say what would be written; no probe is needed
        #[arg(long)]
        dry_run: bool,
        /// Which probe, where there are several
        #[command(flatten)]
        which: Which,
    },
    /// Show the log of a board that runs, until Ctrl-C, and pass on what is typed as commands
    Attach {
        /// The image that it runs
        image: PathBuf,
        /// Restart the board first: a log from its start is what `hysteron capture` takes
        #[arg(long)]
        restart: bool,
        /// Also write the log as it comes, for `hysteron capture`; a file that exists is not replaced
        #[arg(long, value_name = "FILE")]
        raw: Option<PathBuf>,
        /// Which probe, where there are several
        #[command(flatten)]
        which: Which,
    },
    /// Restart the board, condition its actuator, play the drive of an identification and keep the log, for
    /// `hysteron capture`
    Record {
        /// The image that it runs
        image: PathBuf,
        /// The log's file; one that exists is not replaced
        raw: PathBuf,
        /// How long the drive lasts, ticks
        #[arg(long, default_value_t = 100_000, value_parser = clap::value_parser!(u32).range(record::TICKS))]
        ticks: u32,
        /// Which probe, where there are several
        #[command(flatten)]
        which: Which,
    },
    /// List the probes of this machine
    List,
}

/// Which probe is meant.
#[derive(Args, Clone, Debug)]
struct Which {
    /// A probe by --probe=VID:PID or --probe=VID:PID:SERIAL, as `list` shows it; not needed where there is
    /// one
    #[arg(long, value_name = "PROBE", num_args = 0..=1, require_equals = true, default_missing_value = "")]
    probe: Option<String>,
}

impl Which {
    /// The selector, if one was typed.
    fn selector(&self) -> Option<&str> {
        self.probe.as_deref().filter(|text| !text.is_empty())
    }
}

fn main() -> ExitCode {
    let done = match Arguments::parse().command {
        Command::Flash {
            image,
            boot_stage,
            keep_boot_stage,
            dry_run,
            which,
        } => {
            let kept = if keep_boot_stage {
                BootStage::Kept
            } else {
                BootStage::Beside
            };
            flash::flash(
                &image,
                boot_stage.map_or(kept, BootStage::File),
                dry_run,
                which.selector(),
            )
        }
        Command::Attach {
            image,
            restart,
            raw,
            which,
        } => log::attach(&image, restart, raw.as_deref(), which.selector()),
        Command::Record {
            image,
            raw,
            ticks,
            which,
        } => record::record(&image, &raw, ticks, which.selector()),
        Command::List => chip::list(),
    };
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(message) => {
            eprintln!("error: {message}");
            ExitCode::from(2)
        }
    }
}
