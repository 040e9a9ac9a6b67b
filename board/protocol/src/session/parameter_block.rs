//! Parameter blocks over the line, the restart that takes them, and the fault that is cleared: `BLK`, `RBT`, `INI`.

use hysteron_core::amplifier::Command;
use hysteron_core::command_text::BlockPiece;

use super::{Meaning, Session};
use crate::device::{Brought, Device, Moving};
use crate::error_code::ErrorCode;
use crate::words::Words;

impl<D: Device + 'static> Session<D> {
    /// `BEGIN <bytes>`, `DATA <offset> <hexadecimal>` in order, `COMMIT` or `SWAP`.
    pub(super) fn bring_block(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        match words.word()? {
            "BEGIN" | "begin" => {
                let bytes = words.whole()?;
                words.end()?;
                self.device.begin_block(bytes).map_err(|_| ErrorCode::InvalidBlock)
            }
            "DATA" | "data" => {
                let offset = words.whole()?;
                let piece = BlockPiece::parse(offset, words.word()?).map_err(|_| ErrorCode::Syntax)?;
                words.end()?;
                self.device.take_block(&piece).map_err(|_| ErrorCode::InvalidBlock)
            }
            "COMMIT" | "commit" => {
                words.end()?;
                self.device.keep_block().map_err(|Moving| ErrorCode::InMotion)
            }
            "SWAP" | "swap" => {
                words.end()?;
                self.device.swap_block();
                Ok(())
            }
            _ => Err(ErrorCode::Syntax),
        }
    }

    pub(super) fn brought_block(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        words.end()?;
        match self.device.brought() {
            Brought::Nothing => self.say(format_args!("NOTHING")),
            Brought::Busy => self.say(format_args!("BUSY")),
            Brought::Swapped => self.say(format_args!("SWAPPED")),
            Brought::Kept => self.say(format_args!("KEPT")),
            Brought::Refused(reason) => self.say(format_args!("REFUSED {reason}")),
        }
    }

    pub(super) fn restart(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        words.end()?;
        self.device.restart().map_err(|Moving| ErrorCode::InMotion)
    }

    pub(super) fn clear_fault(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        words.queried_axis()?;
        self.command(Command::Clear, None, Meaning::Drive { drive: None, ticks: 0 });
        Ok(())
    }
}
