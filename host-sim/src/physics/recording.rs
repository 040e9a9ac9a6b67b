//! What effects know of the data.

/// What is known about the data before anything is fitted; prior guesses come from it.
#[derive(Clone, Debug, PartialEq)]
pub struct Overview {
    /// Limits of the drive, V.
    pub drive_min_v: f64,
    /// Limits of the drive, V.
    pub drive_max_v: f64,
    /// Largest drive that occurs, V.
    pub drive_peak_v: f64,
    /// Fastest sampling, Hz.
    pub sample_rate_max_hz: f64,
    /// Slowest sampling, Hz.
    pub sample_rate_min_hz: f64,
    /// Longest record, s.
    pub duration_s: f64,
    /// Largest span of the measured displacement, um.
    pub range_um: f64,
    /// Largest slope of the drive, V/s.
    pub slope_max_v_s: f64,
    /// A force was measured.
    pub has_force: bool,
    /// Static gain of a straight line through the data, um/V.
    pub gain_um_v: f64,
    /// Bandwidth of the sensor after its data sheet, Hz, if that is known.
    pub sensor_bandwidth_hz: Option<f64>,
    /// The drives move at more than one speed.
    pub several_speeds: bool,
}

impl Overview {
    /// What may be assumed of a drive between these limits where no data are at hand: one second at 20 kHz,
    /// with a force, one micrometre for the whole range.
    #[must_use]
    pub fn without_data(drive_min_v: f64, drive_max_v: f64) -> Self {
        Self {
            drive_min_v,
            drive_max_v,
            drive_peak_v: drive_max_v,
            sample_rate_max_hz: 20_000.0,
            sample_rate_min_hz: 20_000.0,
            duration_s: 1.0,
            range_um: 1.0,
            slope_max_v_s: 1e4,
            has_force: true,
            gain_um_v: 1.0,
            sensor_bandwidth_hz: None,
            several_speeds: true,
        }
    }

    /// Span of the drive, V.
    #[must_use]
    pub fn drive_range_v(&self) -> f64 {
        self.drive_max_v - self.drive_min_v
    }
}

/// A resonance that a residual shows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Resonance {
    /// Natural frequency, rad/s.
    pub natural_frequency_rad_s: f64,
    /// Damping ratio, from its width.
    pub damping_ratio: f64,
}

/// The stage that a simulated data set is of, as far as effects are planted in proportion to it.
#[derive(Clone, Debug, PartialEq)]
pub struct SimulatedStage {
    /// What is known of its data beforehand.
    pub overview: Overview,
    /// Natural frequency of its first mode, rad/s.
    pub natural_frequency_rad_s: f64,
    /// Damping ratio of its first mode.
    pub damping_ratio: f64,
    /// Coefficients of the remnant of its first rise, um.
    pub remnant_um: Vec<f64>,
}

/// What readings show beside their noise while the drive stands still.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LinesAtRest {
    /// Frequencies of lines, Hz, of every rest and hold by itself.
    pub lines_hz: Vec<f64>,
    /// Samples of the longest of them that is read fast enough for lines of the mains: zero without one.
    pub samples: usize,
}

/// Samples at rest that show a line of a tenth of the noise beyond doubt.
const SHOW_WEAK_LINES: usize = 7000;

impl LinesAtRest {
    /// Whether a weak line would be seen.
    #[must_use]
    pub fn show_weak_lines(&self) -> bool {
        self.samples >= SHOW_WEAK_LINES
    }
}

/// A signal that was recorded beside drive and displacement, as a temperature, for effects of the user's own.
#[derive(Clone, Debug, PartialEq)]
pub struct AuxiliarySignal {
    /// The name that expressions call it by.
    pub name: String,
    /// A value for every sample.
    pub values: Vec<f64>,
}

impl AuxiliarySignal {
    /// This signal with other values in the place of these.
    #[must_use]
    pub fn with(&self, values: impl FnOnce(&[f64]) -> Vec<f64>) -> Self {
        Self {
            name: self.name.clone(),
            values: values(&self.values),
        }
    }
}

/// What was recorded beside the displacement, at every sample.
#[derive(Clone, Copy, Debug, Default)]
pub struct Signals<'a> {
    /// Drive, V; empty where none is known beforehand, as in a closed loop.
    pub drive_v: &'a [f64],
    /// External force, N, if it was measured.
    pub force_n: Option<&'a [f64]>,
    /// Further ones.
    pub auxiliary: &'a [AuxiliarySignal],
}
