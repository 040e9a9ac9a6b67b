//! A block of samples as a page shows it and as a file keeps it.

use crate::board::record::table;
use hysteron::spectrum::{Spectrum, amplitude_density};
use hysteron_client::watching::Capture;
use serde::Serialize;

/// Digits behind the point of what is drawn: 0.01 nm and 10 uV.
const DRAWN: f64 = 1e5;

/// A block with its spectra.
pub struct ScopeBlock {
    /// Counts from 1.
    pub number: u64,
    /// When its reading had ended, s since the scope began.
    pub at_s: f64,
    /// What the recorder caught.
    pub capture: Capture,
    /// Ticks that passed unseen since the block before, where that one is known.
    pub unseen_ticks: Option<f64>,
    /// Control ticks per second, Hz.
    pub tick_rate_hz: f64,
}

/// What a page draws of it.
#[derive(Serialize)]
pub struct Drawn {
    number: u64,
    sample_rate_hz: f64,
    ticks_per_sample: u32,
    samples: usize,
    unseen_s: Option<f64>,
    mode_changed: bool,
    position_um: Vec<f64>,
    drive_v: Vec<f64>,
    reference_um: Option<Vec<f64>>,
    error_um: Option<Vec<f64>>,
    error_rms_um: Option<f64>,
    position_spectrum: Density,
    error_spectrum: Option<Density>,
}

/// Amplitude density, nm per root Hz.
#[derive(Serialize)]
struct Density {
    frequency_hz: Vec<f64>,
    density_nm: Vec<f64>,
}

impl From<Spectrum> for Density {
    fn from(spectrum: Spectrum) -> Self {
        Self {
            frequency_hz: spectrum.frequency_hz,
            density_nm: spectrum.density.into_iter().map(|um| 1e3 * um).collect(),
        }
    }
}

fn rounded(values: &[f64]) -> Vec<f64> {
    values
        .iter()
        .map(|value| (value * DRAWN).round() / DRAWN)
        .collect()
}

impl ScopeBlock {
    /// As a page draws it.
    pub fn drawn(&self) -> Drawn {
        let Capture {
            recorded,
            reference_um,
            ticks_per_sample,
            before,
            after,
        } = &self.capture;
        let position_um = &recorded.position_um;
        // What is to be minus what is.
        let error_um: Option<Vec<f64>> = reference_um.as_ref().map(|reference| {
            reference
                .iter()
                .zip(position_um)
                .map(|(r, y)| r - y)
                .collect()
        });
        let rms = |error: &Vec<f64>| {
            (error.iter().map(|e| e * e).sum::<f64>() / error.len().max(1) as f64).sqrt()
        };
        let density =
            |signal: &[f64]| Density::from(amplitude_density(signal, recorded.sample_rate_hz));
        Drawn {
            number: self.number,
            sample_rate_hz: recorded.sample_rate_hz,
            ticks_per_sample: *ticks_per_sample,
            samples: position_um.len(),
            unseen_s: self.unseen_ticks.map(|ticks| ticks / self.tick_rate_hz),
            mode_changed: before.mode != after.mode,
            position_um: rounded(position_um),
            drive_v: rounded(&recorded.drive_v),
            reference_um: reference_um.as_deref().map(rounded),
            error_rms_um: error_um.as_ref().map(rms),
            position_spectrum: density(position_um),
            error_spectrum: error_um.as_deref().map(density),
            error_um: error_um.as_deref().map(rounded),
        }
    }

    /// As a file that `hysteron explain` takes: what it is in comments, then columns with units.
    pub fn csv(&self, identification: &str, stage: &str) -> String {
        let Capture {
            recorded,
            reference_um,
            ticks_per_sample,
            before,
            ..
        } = &self.capture;
        // A line that a stranger's board answered ends no comment.
        let one_line = |text: &str| text.replace(|letter: char| letter.is_control(), " ");
        format!(
            "# {}\n# stage {}, {}; one sample every {ticks_per_sample} ticks, from tick {:.0} or just after it\n{}",
            one_line(identification),
            one_line(stage),
            before.mode,
            before.tick,
            table(recorded, reference_um.as_deref())
        )
    }
}
