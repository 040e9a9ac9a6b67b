//! How the board is, in words and units.

use hysteron_core::guard::Fault;

use crate::board::Board;
use crate::error::{Error, Result};
use crate::following::Following;

/// What the board says of itself.
#[derive(Clone, Debug, PartialEq)]
pub struct Condition {
    /// Name of the actuator in the block.
    pub stage: String,
    /// `rest`, `open loop`, `closed loop` or `fault`.
    pub mode: &'static str,
    /// The latched fault.
    pub fault: Option<&'static str>,
    /// Position, um.
    pub position_um: f64,
    /// Drive, V.
    pub drive_v: f64,
    /// Whether the sensor has been zeroed since the start.
    pub zeroed: bool,
    /// The counts and the block, by the names of `HDI?`.
    pub counts: Vec<(String, f64)>,
    /// How well the closed loop followed, where it was closed for a second.
    pub following: Option<Following>,
}

impl Condition {
    /// Asks the board.
    ///
    /// # Errors
    /// It does not answer.
    pub fn ask(board: &mut Board) -> Result<Self> {
        let numbers = board.numbers("DIA?")?;
        let [mode, fault, ..] = numbers[..] else {
            return Err(Error::new("DIA?", "the board answers too few numbers"));
        };
        let help = board.ask("HDI?")?;
        let names = help
            .lines()
            .skip(3)
            .filter_map(|line| line.split_once('='))
            .map(|(_, name)| name.to_string());
        let stage = board.ask("CST? 1")?;
        Ok(Self {
            stage: stage.trim().trim_start_matches("1=").to_string(),
            mode: crate::watching::mode_name(mode),
            fault: Fault::from_number(fault as u8).map(Fault::name),
            position_um: board.number("POS? 1")?,
            drive_v: board.number("VOL? 1")?,
            zeroed: board.number("ATZ? 1")? == 1.0,
            following: Following::ask(board, &numbers)?,
            counts: names.zip(numbers.iter().skip(2).copied()).collect(),
        })
    }

    /// Without a valid parameter block, or without a safety envelope, nothing moves.
    #[must_use]
    pub fn without_block(&self) -> bool {
        [Fault::ParameterBlock, Fault::NoEnvelope]
            .iter()
            .any(|fault| self.fault == Some(fault.name()))
    }
}
