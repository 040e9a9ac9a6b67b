//! What the controller says of itself, and the speed of its line: `DIA?`, `HDI?`, `IFC`.

use super::{Pending, Session};
use crate::device::Device;
use crate::error_code::ErrorCode;
use crate::help;
use crate::words::Words;

/// Speeds of the line that are taken, bit/s.
const BAUD: core::ops::RangeInclusive<u32> = 9_600..=2_000_000;

/// Tenths of a degree Celsius that no part has.
const NOT_READ: i64 = -10_000;

impl<D: Device + 'static> Session<D> {
    /// The values in the order of [`help::DIAGNOSIS`].
    fn diagnosis_values(&self) -> [i64; help::DIAGNOSIS.len()] {
        let (view, counts, figures) = (
            self.device.view(),
            self.device.diagnosis(),
            self.device.loop_figures(),
        );
        [
            view.mode as i64,
            view.fault.map_or(0, |fault| fault as i64),
            counts.railed_ticks.into(),
            counts.limited_ticks.into(),
            counts.saturated_values.into(),
            counts.overruns.into(),
            counts.lost_samples.into(),
            counts.block_generation.into(),
            counts.block_checksum.into(),
            view.tick as i64,
            view.conditioned.into(),
            counts.protection.into(),
            figures.windows.into(),
            figures.torn_windows.into(),
            figures.alarm.into(),
            counts.adapted_gain_millionths.into(),
            i64::from(view.powered) | i64::from(view.armed) << 1,
            counts.part_decicelsius.map_or(NOT_READ, i64::from),
            view.input as i64,
            counts.amplifier_decicelsius.map_or(NOT_READ, i64::from),
        ]
    }

    pub(super) fn diagnosis(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        let values = self.diagnosis_values();
        let all = !words.more();
        for (nth, value) in (1..).zip(values).filter(|_| all) {
            self.say(format_args!("{nth}={value}"))?;
        }
        while words.more() {
            let nth = words.whole()?;
            let value = nth
                .checked_sub(1)
                .and_then(|nth| values.get(nth as usize))
                .ok_or(ErrorCode::UnknownParameter)?;
            self.say(format_args!("{nth}={value}"))?;
        }
        Ok(())
    }

    pub(super) fn diagnosis_help(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        self.pending = Pending::DiagnosisHelp(0);
        words.end()
    }

    pub(super) fn set_interface(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        if !words.word()?.eq_ignore_ascii_case("RSBAUD") {
            return Err(ErrorCode::Syntax);
        }
        let baud = words.whole()?;
        words.end()?;
        if !BAUD.contains(&baud) {
            return Err(ErrorCode::Range);
        }
        self.device.set_baud(baud);
        Ok(())
    }

    pub(super) fn interface(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        if words.more() && !words.word()?.eq_ignore_ascii_case("RSBAUD") {
            return Err(ErrorCode::Syntax);
        }
        words.end()?;
        let baud = self.device.baud();
        self.say(format_args!("RSBAUD={baud}"))
    }
}
