//! What the board's codes stand for, as the block in use says, and how much of them it keeps.

use hysteron_core::codes::{DriveCode, SensorCode};

use crate::board::Board;
use crate::error::{Error, Result};

/// Codes to um and V.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scale {
    /// Position at the sensor's code 0, um; a conditioning moves it.
    pub sensor_at_code_0_um: f64,
    /// Positions of all its codes, um.
    pub sensor_span_um: f64,
    /// Drive at code 0, V.
    pub drive_at_code_0_v: f64,
    /// Drives of all codes, V.
    pub drive_span_v: f64,
    /// Codes of the sensor.
    pub sensor_codes: f64,
    /// Codes of the drive.
    pub drive_codes: f64,
    /// Lowest drive, V.
    pub drive_min_v: f64,
    /// Highest drive, V.
    pub drive_max_v: f64,
    /// Control ticks per second, Hz.
    pub sample_rate_hz: f64,
    /// Points of a wave table, at most.
    pub most_points: usize,
    /// Samples of the recorder, at most.
    pub most_samples: usize,
}

impl Scale {
    /// Asks the board.
    ///
    /// # Errors
    /// It does not answer, or has no block.
    pub fn ask(board: &mut Board) -> Result<Self> {
        let question = "SPA? 1 0x7F000000 1 0x7F000001 1 0x7F000002 1 0x7F000003 1 0x7F000004 1 0x7F000005 1 0x0E000200 \
                        1 0x13000004 1 0x16000200 1 0x16000300 1 0x7F000009 1 0x7F00000A";
        let numbers = board.numbers(question)?;
        let [
            sensor_at_code_0_um,
            sensor_span_um,
            drive_at_code_0_v,
            drive_span_v,
            drive_min_v,
            drive_max_v,
            period_s,
            points,
            all_samples,
            tables,
            sensor_bits,
            drive_bits,
        ] = numbers[..]
        else {
            return Err(Error::new(
                question,
                "the board does not know these parameters: its image is older than this program",
            ));
        };
        if sensor_span_um <= 0.0 || drive_span_v <= 0.0 || period_s <= 0.0 {
            return Err(Error::new(
                "board",
                "has no valid parameter block, so nothing says what its codes stand for",
            ));
        }
        Ok(Self {
            sensor_at_code_0_um,
            sensor_span_um,
            drive_at_code_0_v,
            drive_span_v,
            sensor_codes: sensor_bits.exp2(),
            drive_codes: drive_bits.exp2(),
            drive_min_v,
            drive_max_v,
            sample_rate_hz: (1.0 / period_s).round(),
            most_points: points as usize,
            most_samples: (all_samples / tables.max(1.0)) as usize,
        })
    }

    /// A sensor's code, um.
    #[must_use]
    pub fn position_um(&self, code: SensorCode) -> f64 {
        self.sensor_at_code_0_um + self.sensor_step_um() * f64::from(code)
    }

    /// A drive's code, V.
    #[must_use]
    pub fn drive_v(&self, code: DriveCode) -> f64 {
        self.drive_at_code_0_v + self.drive_step_v() * f64::from(code)
    }

    /// Step of the sensor's converter, um.
    #[must_use]
    pub fn sensor_step_um(&self) -> f64 {
        self.sensor_span_um / self.sensor_codes
    }

    /// Step of the drive's converter, V.
    #[must_use]
    pub fn drive_step_v(&self) -> f64 {
        self.drive_span_v / self.drive_codes
    }
}
