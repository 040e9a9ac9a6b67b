//! A force from outside while a servo is at work, given as the displacement that it would make at rest
//! without any servo.

use serde::Serialize;
use std::f64::consts::TAU;

/// The force.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Disturbance {
    /// It swings all the time.
    Sine {
        /// Frequency, Hz.
        frequency_hz: f64,
        /// Amplitude, um at rest.
        amplitude_um: f64,
    },
    /// It is there from the moment on from which the error counts.
    Step {
        /// um at rest.
        size_um: f64,
    },
}

impl Disturbance {
    /// Reads `sine:HZ:UM` or `step:UM`, for a loop with this sampling period, s.
    ///
    /// # Errors
    /// What was expected.
    pub fn parse(text: &str, period_s: f64) -> Result<Self, String> {
        let fields: Vec<&str> = text.split(':').collect();
        let number = |field: &str| field.parse::<f64>().ok().filter(|v| v.is_finite());
        let found = match fields.as_slice() {
            ["sine", hz, um] => number(hz)
                .filter(|hz| *hz > 0.0 && *hz <= 0.5 / period_s)
                .zip(number(um))
                .map(|(frequency_hz, amplitude_um)| Self::Sine {
                    frequency_hz,
                    amplitude_um,
                }),
            ["step", um] => number(um).map(|size_um| Self::Step { size_um }),
            _ => None,
        };
        found.ok_or_else(|| {
            format!(
                "disturbance `{text}`; expected sine:HZ:UM (HZ above 0, at most {:.0}) or step:UM",
                0.5 / period_s
            )
        })
    }

    /// A sample for each of `count` ticks, um; a step at the tick `from`.
    #[must_use]
    pub fn samples_um(&self, count: usize, from: usize, period_s: f64) -> Vec<f64> {
        let at = |tick: usize| match self {
            Self::Sine {
                frequency_hz,
                amplitude_um,
            } => amplitude_um * (TAU * frequency_hz * tick as f64 * period_s).sin(),
            Self::Step { size_um } => {
                if tick < from {
                    0.0
                } else {
                    *size_um
                }
            }
        };
        (0..count).map(at).collect()
    }
}
