//! How well the closed loop followed over the last second, as the board's telemetry has it, in words and
//! units.

use crate::board::Board;
use crate::error::{Error, Result};

/// The parameters of a question, as `hysteron_protocol::parameters` numbers them.
const QUESTION: &str =
    "SPA? 1 0x7F000007 1 0x7F000008 1 0x7F000010 1 0x7F000011 1 0x7F000012 1 0x7F000013";
/// How many numbers of `DIA?` come before the seconds that were measured; and the last of them is the alarm.
const COUNTS: usize = 12;
const ALARMS: usize = 14;

/// What the last second of the closed loop came to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Following {
    /// Frequency of the resonance that is listened to, Hz; 0: none.
    pub resonance_hz: f64,
    /// An amplitude above this is an alarm, nm; 0: none is.
    pub alarm_nm: f64,
    /// Tracking error, RMS, nm.
    pub error_rms_nm: f64,
    /// Its largest magnitude, nm.
    pub error_peak_nm: f64,
    /// Drive, RMS, V.
    pub drive_rms_v: f64,
    /// Amplitude of the error at the resonance, nm.
    pub amplitude_nm: f64,
    /// Whether the alarm is on; it stays so down to three quarters of its amplitude.
    pub alarm: bool,
}

impl Following {
    /// Asks the board; `diagnosis` is what it answered `DIA?`. `None` where its loop was closed for no whole
    /// second yet, or its image is older.
    ///
    /// # Errors
    /// It does not answer, or with something else.
    pub fn ask(board: &mut Board, diagnosis: &[f64]) -> Result<Option<Self>> {
        let alarm = match (diagnosis.get(COUNTS), diagnosis.get(ALARMS)) {
            (Some(seconds), Some(alarms)) if *seconds > 0.0 => *alarms as u32 & 1 == 1,
            _ => return Ok(None),
        };
        let numbers = board.numbers(QUESTION)?;
        let [
            resonance_hz,
            alarm_nm,
            error_rms_nm,
            error_peak_nm,
            drive_rms_v,
            amplitude_nm,
        ] = numbers[..]
        else {
            return Err(Error::new("SPA?", "the board answers something else"));
        };
        Ok(Some(Self {
            resonance_hz,
            alarm_nm,
            error_rms_nm,
            error_peak_nm,
            drive_rms_v,
            amplitude_nm,
            alarm,
        }))
    }

    /// In a line or two.
    #[must_use]
    pub fn words(&self) -> Vec<String> {
        let mut lines = vec![format!(
            "last second of the closed loop: tracking error {} nm RMS, {} nm peak, drive {:.1} V RMS",
            nanometres(self.error_rms_nm),
            nanometres(self.error_peak_nm),
            self.drive_rms_v
        )];
        if self.resonance_hz > 0.0 {
            let beside = match (self.alarm, self.alarm_nm > 0.0) {
                // An event lasts down to three quarters of the alarm.
                (true, _) if self.amplitude_nm > self.alarm_nm => {
                    format!(", above the alarm of {} nm", nanometres(self.alarm_nm))
                }
                (true, _) => format!(
                    ", was above the alarm of {} nm and is not far below it",
                    nanometres(self.alarm_nm)
                ),
                (false, true) => format!(", alarm {} nm", nanometres(self.alarm_nm)),
                (false, false) => String::new(),
            };
            lines.push(format!(
                "amplitude at {:.0} Hz is {} nm{beside}",
                self.resonance_hz,
                nanometres(self.amplitude_nm)
            ));
        }
        lines
    }
}

/// Three significant digits, no finer than a picometre.
fn nanometres(value: f64) -> String {
    let decimals = if value >= 100.0 || value == value.trunc() {
        0
    } else if value >= 10.0 {
        1
    } else if value >= 1.0 {
        2
    } else {
        3
    };
    format!("{value:.decimals$}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_alarm_is_said_in_words() {
        let quiet = Following {
            resonance_hz: 735.0,
            alarm_nm: 20.0,
            error_rms_nm: 1.234,
            error_peak_nm: 12.34,
            drive_rms_v: 41.26,
            amplitude_nm: 0.0414,
            alarm: false,
        };
        assert_eq!(
            quiet.words(),
            [
                "last second of the closed loop: tracking error 1.23 nm RMS, 12.3 nm peak, drive 41.3 V RMS",
                "amplitude at 735 Hz is 0.041 nm, alarm 20 nm"
            ]
        );
        let rings = Following {
            amplitude_nm: 41.0,
            alarm: true,
            ..quiet
        };
        assert_eq!(
            rings.words()[1],
            "amplitude at 735 Hz is 41 nm, above the alarm of 20 nm"
        );
        let after = Following {
            amplitude_nm: 17.0,
            alarm: true,
            ..quiet
        };
        assert_eq!(
            after.words()[1],
            "amplitude at 735 Hz is 17 nm, was above the alarm of 20 nm and is not far below it"
        );
        assert_eq!(
            Following {
                resonance_hz: 0.0,
                ..quiet
            }
            .words()
            .len(),
            1
        );
        assert_eq!(
            Following {
                alarm_nm: 0.0,
                ..quiet
            }
            .words()[1],
            "amplitude at 735 Hz is 0.041 nm"
        );
    }
}
