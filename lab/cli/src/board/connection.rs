//! Where a board is and what is wired to it: the arguments that its commands share.

use clap::{ArgGroup, Args};
use hysteron::servo::amplifier_block::FrontEnd;
use hysteron::{Error, Result};
use hysteron_client::board::Board;
use hysteron_client::port::Address;
use std::path::PathBuf;

use crate::desk::Desk;

/// The line's speed over a cable unless another one is asked for, bit/s.
const CABLE_BAUD: u32 = 921_600;

/// Where the board is.
#[derive(Args, Clone, Debug)]
#[group(skip)]
#[command(group(ArgGroup::new("where").required(true).args(["port", "tcp"])))]
pub struct LineArguments {
    /// Serial port of this machine, /dev/ttyACM0 or COM3
    #[arg(long, value_name = "PORT")]
    port: Option<String>,
    /// A socket: the emulated board, or a serial port behind a bridge
    #[arg(long, value_name = "HOST:PORT")]
    tcp: Option<String>,
    /// Speed of the line, bit/s [default: 921600 over a serial port; over a socket it stays at 115200]
    #[arg(long, value_name = "BAUD")]
    baud: Option<u32>,
}

impl LineArguments {
    /// The speed to change to.
    pub fn baud(&self) -> Option<u32> {
        self.baud.or(self.port.is_some().then_some(CABLE_BAUD))
    }

    /// Where the board is.
    pub fn address(&self) -> Result<Address> {
        match (&self.port, &self.tcp) {
            (Some(name), _) => Ok(Address::Serial(name.clone())),
            (None, Some(name)) => Address::tcp(name).map_err(as_ours),
            (None, None) => Err(Error::new(
                "--port, --tcp",
                "one of them is needed: where the board is",
            )),
        }
    }

    /// Greets the board.
    pub fn connect(&self) -> Result<Board> {
        Board::connect(&self.address()?, self.baud()).map_err(as_ours)
    }
}

/// What the actuator and its converters are.
#[derive(Args, Clone, Debug)]
pub struct WiringArguments {
    /// How the converters are wired, as for `hysteron design` [default: that of the wiring page]
    #[arg(long, value_name = "FILE")]
    front_end: Option<PathBuf>,
    /// Lowest drive of the actuator, V
    #[arg(
        long,
        default_value_t = 0.0,
        value_name = "V",
        allow_negative_numbers = true
    )]
    pub drive_min_v: f64,
    /// Highest drive of the actuator, V
    #[arg(long, value_name = "V", allow_negative_numbers = true)]
    pub drive_max_v: Option<f64>,
}

impl WiringArguments {
    /// How its converters are wired.
    pub fn front_end(&self, desk: &Desk) -> Result<FrontEnd> {
        match &self.front_end {
            Some(path) => FrontEnd::from_toml(
                &desk.text(path, "the wiring of the converters")?,
                &path.display().to_string(),
            ),
            None => Ok(FrontEnd::default()),
        }
    }

    /// The limits of the drive.
    pub fn limits_v(&self) -> Result<(f64, f64)> {
        match self.drive_max_v {
            Some(high_v) if self.drive_min_v < high_v => Ok((self.drive_min_v, high_v)),
            Some(high_v) => Err(Error::new(
                "--drive-max-v",
                format!("{high_v} is not above --drive-min-v {}", self.drive_min_v),
            )),
            None => Err(Error::new(
                "--drive-max-v",
                "is needed: the highest voltage that the actuator stands; nothing on the board knows it",
            )),
        }
    }
}

/// A conversation's error as the program's.
pub fn as_ours(problem: hysteron_client::Error) -> Error {
    Error::new(problem.place(), problem.message())
}
