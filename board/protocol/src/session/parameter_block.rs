//! Parameter blocks over the line, the restart that takes them, and the fault that is cleared: `BLK`, `RBT`,
//! `INI`.

use hysteron_core::amplifier_command::Command;
use hysteron_core::command_text::BlockPiece;
use hysteron_core::firmware_update::text;
use hysteron_core::safety_envelope::fingerprint;

use core::fmt::Write;

use super::{Meaning, Pending, Piece, Session, Step};
use crate::decimal::Decimal;
use crate::device::{Brought, Device, DeviceEvent, Moving};
use crate::error_code::ErrorCode;
use crate::words::Words;

impl<D: Device + 'static> Session<D> {
    /// `BEGIN <bytes>`, `DATA <offset> <hexadecimal>` in order, `COMMIT`, `SWAP` or `ENVELOPE <checksum>`.
    pub(super) fn bring_block(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        match words.word()? {
            "BEGIN" | "begin" => {
                let bytes = words.whole()?;
                words.end()?;
                self.device
                    .begin_block(bytes)
                    .map_err(|_| ErrorCode::InvalidBlock)
            }
            "DATA" | "data" => {
                let offset = words.whole()?;
                let piece =
                    BlockPiece::parse(offset, words.word()?).map_err(|_| ErrorCode::Syntax)?;
                words.end()?;
                self.device
                    .take_block(&piece)
                    .map_err(|_| ErrorCode::InvalidBlock)
            }
            "COMMIT" | "commit" => {
                words.end()?;
                self.device
                    .keep_block()
                    .map_err(|Moving| ErrorCode::InMotion)
            }
            "SWAP" | "swap" => {
                words.end()?;
                self.device.swap_block();
                Ok(())
            }
            "ENVELOPE" | "envelope" => {
                let fingerprint = words.whole()?;
                words.end()?;
                self.device
                    .keep_envelope(fingerprint)
                    .map_err(|Moving| ErrorCode::InMotion)
            }
            _ => Err(ErrorCode::Syntax),
        }
    }

    /// Checksum, stage, least and most drive, rest, slew and current of the envelope in force.
    pub(super) fn envelope(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        words.end()?;
        let Some(envelope) = self.device.envelope() else {
            return self.say(format_args!("NONE"));
        };
        let volts = |code| Decimal {
            billionths: envelope.drive_uv(code) * 1_000,
            digits: 3,
        };
        let (lowest, highest, rest) = (
            volts(envelope.drive_min),
            volts(envelope.drive_max),
            volts(envelope.safe_code),
        );
        self.say(format_args!("CHECKSUM={:#010x}", fingerprint(&envelope)))?;
        match text(&envelope.stage) {
            "" => self.say(format_args!("STAGE=ANY"))?,
            stage => self.say(format_args!("STAGE={stage}"))?,
        }
        self.say(format_args!("DRIVE={lowest} {highest} V"))?;
        self.say(format_args!("REST={rest} V"))?;
        self.say(format_args!("SLEW={} V/s", envelope.slew_limit_v_s))?;
        self.say(format_args!(
            "CURRENT={} uA {} nF",
            envelope.current_ua, envelope.capacitance_nf
        ))?;
        self.say(format_args!(
            "READ_BACK={}",
            u8::from(envelope.drive_reads_back)
        ))?;
        if envelope.set_point_span_nm > 0 {
            self.say(format_args!(
                "SET_POINT={} {} nm",
                envelope.set_point_min_nm, envelope.set_point_max_nm
            ))?;
        }
        if envelope.amplifier_span_decicelsius != 0 {
            self.say(format_args!(
                "AMPLIFIER_TEMPERATURE={}",
                envelope.amplifier_most_decicelsius
            ))?;
        }
        match envelope.monitor_span_uv {
            0 => self.say(format_args!("MONITOR=NONE")),
            _ => self.say(format_args!(
                "MONITOR={} mV {} us",
                envelope.monitor_tolerance_mv, envelope.monitor_lag_us
            )),
        }
    }

    /// A line of the log of faults, the last one first.
    pub(super) fn next_event(&mut self, nth: u32, piece: &mut Piece) -> Step {
        let written = match self.device.event(nth) {
            Some(DeviceEvent { start, tick, fault }) => {
                let end = if self.device.event(nth + 1).is_some() {
                    " "
                } else {
                    ""
                };
                writeln!(
                    piece,
                    "START={start} TICK={tick} FAULT={} {}{end}",
                    fault as u8,
                    fault.name()
                )
            }
            None if nth == 0 => writeln!(piece, "NONE"),
            None => return Step::Done,
        };
        self.sent(written, Pending::Events(nth + 1))
    }

    pub(super) fn events(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        self.pending = Pending::Events(0);
        words.end()
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
        self.command(
            Command::Clear,
            None,
            Meaning::Drive {
                drive: None,
                ticks: 0,
            },
        );
        Ok(())
    }
}
