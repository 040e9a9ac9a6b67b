//! Drives and readings of a stick-slip rig, and what a model misses of them.

use crate::dataset::{Dataset, Record, Role};
use crate::diagnosis::confidence_set::{Losses, Scale};
use crate::diagnosis::policy::Policy;
use crate::diagnosis::selection::margin;
use crate::error::{Error, Result};
use crate::identification::fit::blocks;
use crate::outcome::Residuals;
use crate::statistics::{dot, extremes, mean};
use crate::stepping::rests;
use hysteron_sim::stick_slip::{Integrator, StickSlipActuator};

/// Name of the auxiliary signal that is the platform's position, um.
pub const PLATFORM: &str = "platform_um";
/// Steps in a sample: half of those of a simulation, with an error far below any sensor's noise.
const SUBSTEPS: usize = 8;
/// A drive leaves the model's range by at most this share of it.
const BEYOND_RANGE: f64 = 0.02;
/// Fewest samples that a record counts: one in each block.
const SAMPLES_MIN: usize = 60;
/// Noise that is taken where nothing shows it, um: that of a good encoder.
const USUAL_NOISE_UM: f64 = 3e-3;

/// A drive with what was read under it.
#[derive(Clone, Debug)]
pub struct Tape {
    /// Samples a second.
    pub sample_rate_hz: f64,
    /// Drive, V.
    pub drive_v: Vec<f64>,
    /// Reading of the slider, um.
    pub slider_um: Vec<f64>,
    /// Reading of the platform, um, where there is one.
    pub platform_um: Option<Vec<f64>>,
}

/// Readings of one signal that are fitted, or judge.
#[derive(Clone, Debug)]
pub struct Reading {
    /// Name of the record.
    pub record: String,
    /// The tape.
    pub tape: usize,
    /// It is the platform's, not the slider's.
    pub is_platform: bool,
    /// It only judges.
    pub held_out: bool,
    /// Samples that count.
    pub samples: Vec<usize>,
    /// Noise of the sensor, um RMS, where a rest shows it.
    pub noise_um: Option<f64>,
}

/// The recordings of a rig.
#[derive(Clone, Debug)]
pub struct RigData {
    /// The data set.
    pub name: String,
    /// Drives with their readings.
    pub tapes: Vec<Tape>,
    /// What is fitted and what judges.
    pub readings: Vec<Reading>,
    /// Standard deviation of the noise itself, relative.
    pub noise_relative_std: f64,
    /// What was assumed.
    pub notes: Vec<String>,
}

/// What a model misses of every reading, um; a constant of each is taken out.
pub type RigResiduals = Vec<Vec<f64>>;

impl RigData {
    /// The recordings of a data set, for a rig that is driven between 0 V and this.
    ///
    /// # Errors
    /// A record does not begin at rest at 0 V, leaves the rig's range, is too short, or none is fitted.
    pub fn new(dataset: &Dataset, drive_range_v: f64, samples_max: usize) -> Result<Self> {
        let mut this = Self {
            name: dataset.name.clone(),
            tapes: Vec::new(),
            readings: Vec::new(),
            noise_relative_std: 0.0,
            notes: Vec::new(),
        };
        let judging = |record: &&Record| matches!(record.role, Role::Identify | Role::Validate);
        let samples_max = samples_max / dataset.records.iter().filter(judging).count().max(1);
        for record in dataset.records.iter().filter(judging) {
            this.take(record, drive_range_v, samples_max)?;
        }
        if this.readings.iter().all(|reading| reading.held_out) {
            let expected = "has no record to fit; expected one with the role identify";
            return Err(Error::new(&dataset.source, expected));
        }
        if this.readings.iter().all(|reading| !reading.held_out) {
            this.notes
                .push("nothing is held out, so nothing judges but the fit".into());
        }
        this.estimate_noise();
        Ok(this)
    }

    fn take(&mut self, record: &Record, drive_range_v: f64, samples_max: usize) -> Result<()> {
        require_drive(record, drive_range_v)?;
        let refuse = |message: String| Err(Error::new(&record.source, message));
        let platform_um = (record.auxiliary.iter())
            .find(|signal| signal.name == PLATFORM)
            .map(|signal| signal.values.clone());
        if self
            .tapes
            .iter()
            .any(|tape| tape.platform_um.is_some() != platform_um.is_some())
        {
            return refuse(format!(
                "the signal {PLATFORM} must be in all records, or in none"
            ));
        }
        let mut tape = Tape {
            sample_rate_hz: record.sample_rate_hz,
            drive_v: record.drive_v.clone(),
            slider_um: record.displacement_um.clone(),
            platform_um,
        };
        let counted: Vec<usize> = record.counted().filter(|k| *k < samples_max).collect();
        if tape.drive_v.len() > samples_max {
            let seconds = samples_max as f64 / tape.sample_rate_hz;
            let note = format!("{}: only the first {seconds:.2} s count", record.name);
            self.notes.push(note);
            tape.drive_v.truncate(samples_max);
            tape.slider_um.truncate(samples_max);
            tape.platform_um
                .iter_mut()
                .for_each(|signal| signal.truncate(samples_max));
        }
        if counted.len() < SAMPLES_MIN {
            let expected = format!("{} samples count; expected {SAMPLES_MIN}", counted.len());
            return refuse(expected);
        }
        // A single file is two records of one tape.
        let same =
            |known: &Tape| (&known.drive_v, &known.slider_um) == (&tape.drive_v, &tape.slider_um);
        let nth = self.tapes.iter().position(same).unwrap_or(self.tapes.len());
        let signals = 1 + usize::from(tape.platform_um.is_some());
        if nth == self.tapes.len() {
            self.tapes.push(tape);
        }
        self.readings.extend((0..signals).map(|signal| Reading {
            record: record.name.clone(),
            tape: nth,
            is_platform: signal == 1,
            held_out: record.role == Role::Validate,
            samples: counted.clone(),
            noise_um: None,
        }));
        Ok(())
    }

    /// The noise of each sensor, by all rests together.
    fn estimate_noise(&mut self) {
        let slider = noise_at_rest(
            self.tapes
                .iter()
                .map(|t| (&t.drive_v[..], &t.slider_um[..])),
        );
        let platform = noise_at_rest(self.tapes.iter().filter_map(|t| {
            let signal = t.platform_um.as_deref()?;
            Some((&t.drive_v[..], signal))
        }));
        self.noise_relative_std = slider.map_or(0.0, |(_, count)| 1.0 / (count as f64).sqrt());
        for reading in &mut self.readings {
            let noise = if reading.is_platform {
                platform
            } else {
                slider
            };
            reading.noise_um = noise.map(|(um, _)| um);
        }
    }

    /// What a reading's squares are counted in, um RMS.
    #[must_use]
    pub fn unit_um(&self, reading: usize) -> f64 {
        self.readings[reading].noise_um.unwrap_or(USUAL_NOISE_UM)
    }

    /// What a rig would read, for every reading that is wanted.
    #[must_use]
    pub fn modelled(
        &self,
        rig: &StickSlipActuator,
        wanted: &dyn Fn(&Reading) -> bool,
    ) -> Vec<Vec<f64>> {
        let needed = |nth: usize| self.readings.iter().any(|r| r.tape == nth && wanted(r));
        let motions: Vec<_> = (self.tapes.iter().enumerate())
            .map(|(nth, tape)| {
                needed(nth).then(|| {
                    let force_um = rig.element_um(&tape.drive_v, tape.sample_rate_hz);
                    let integrator = Integrator::default();
                    rig.simulate_with(&force_um, tape.sample_rate_hz, integrator, SUBSTEPS)
                })
            })
            .collect();
        (self.readings.iter())
            .map(|reading| match &motions[reading.tape] {
                Some(motion) if wanted(reading) => {
                    let signal = if reading.is_platform {
                        &motion.platform_um
                    } else {
                        &motion.reading_um
                    };
                    reading.samples.iter().map(|k| signal[*k]).collect()
                }
                _ => Vec::new(),
            })
            .collect()
    }

    /// The samples of a reading that count, um.
    #[must_use]
    pub fn measured(&self, reading: &Reading) -> Vec<f64> {
        let tape = &self.tapes[reading.tape];
        let signal = match &tape.platform_um {
            Some(platform_um) if reading.is_platform => platform_um,
            _ => &tape.slider_um,
        };
        reading.samples.iter().map(|k| signal[*k]).collect()
    }

    /// What a rig misses of every reading that is wanted.
    #[must_use]
    pub fn residuals(
        &self,
        rig: &StickSlipActuator,
        wanted: &dyn Fn(&Reading) -> bool,
    ) -> RigResiduals {
        let modelled = self.modelled(rig, wanted);
        let pairs = self.readings.iter().zip(modelled);
        pairs
            .map(|(reading, modelled)| {
                let measured = self.measured(reading);
                let mut left: Vec<f64> =
                    measured.iter().zip(&modelled).map(|(y, m)| y - m).collect();
                remove_mean(&mut left);
                left
            })
            .collect()
    }

    /// Losses of a model on all readings, in squares of their units; what its free values take out of the
    /// noise of fitted readings is added (Mallows' Cp).
    #[must_use]
    pub fn losses(&self, residuals: &RigResiduals, values: usize) -> Losses {
        let fitted: usize = (self.readings.iter())
            .filter(|reading| !reading.held_out)
            .map(|reading| reading.samples.len())
            .sum();
        let losses = residuals.iter().enumerate().map(|(nth, left)| {
            let reading = &self.readings[nth];
            let unit2 = self.unit_um(nth).powi(2);
            let noise = reading
                .noise_um
                .map_or_else(|| mean_square(left) / unit2, |_| 1.0);
            let taken = if reading.held_out {
                0.0
            } else {
                2.0 * noise * values as f64 / fitted as f64
            };
            let of_block = |b: std::ops::Range<usize>| {
                let part = &left[b];
                mean_square(part) / unit2 + taken
            };
            blocks(left.len()).into_iter().map(of_block).collect()
        });
        Losses(losses.collect())
    }

    /// Weight of each reading: two thirds for all that are held out.
    #[must_use]
    pub fn weights(&self, policy: &Policy) -> Vec<f64> {
        let held_out = self
            .readings
            .iter()
            .filter(|reading| reading.held_out)
            .count();
        let fitted = self.readings.len() - held_out;
        let of_held_out = if held_out == 0 {
            0.0
        } else {
            policy.held_out_weight
        };
        let weight = |reading: &Reading| {
            if reading.held_out {
                of_held_out / held_out as f64
            } else {
                (1.0 - of_held_out) / fitted as f64
            }
        };
        self.readings.iter().map(weight).collect()
    }

    /// How many times the noise an error still counts as the noise.
    #[must_use]
    pub fn as_the_noise(&self, policy: &Policy) -> f64 {
        policy.at_floor + policy.floor_z * self.noise_relative_std
    }

    /// How losses are compared.
    #[must_use]
    pub fn scale(&self, losses: &[&Losses], policy: &Policy) -> Scale {
        let noise = |r: usize| {
            self.readings[r]
                .noise_um
                .map(|_| self.as_the_noise(policy).powi(2))
        };
        let readings = 0..self.readings.len();
        let least = |r: usize| {
            losses
                .iter()
                .map(|l| l.mean(r))
                .fold(f64::INFINITY, f64::min)
        };
        let unit_um2: Vec<f64> = (readings.clone())
            .map(|r| least(r).max(noise(r).unwrap_or(0.0)).max(f64::MIN_POSITIVE))
            .collect();
        Scale {
            weights: self.weights(policy),
            held_out: self
                .readings
                .iter()
                .map(|reading| reading.held_out)
                .collect(),
            margin: readings
                .map(|r| margin(policy, noise(r), unit_um2[r]))
                .collect(),
            unit_um2,
            same_held_out: policy.matters_at_noise,
            beyond_chance: (1.0 - policy.beyond_chance).powi(2),
        }
    }

    /// Errors of the slider's readings, um RMS.
    #[must_use]
    pub fn errors(&self, residuals: &RigResiduals) -> Residuals {
        let over = |held_out: bool| {
            let pairs = self.readings.iter().zip(residuals);
            let all: Vec<f64> = pairs
                .filter(|(reading, _)| reading.held_out == held_out && !reading.is_platform)
                .flat_map(|(_, left)| left.iter().copied())
                .collect();
            (!all.is_empty()).then(|| mean_square(&all).sqrt())
        };
        Residuals {
            identify: over(false).unwrap_or(f64::NAN),
            validate: over(true),
        }
    }
}

/// Refuses a drive that the rig's model does not hold for.
fn require_drive(record: &Record, drive_range_v: f64) -> Result<()> {
    let refuse = |message: String| Err(Error::new(&record.source, message));
    let (low_v, high_v) = extremes(&record.drive_v);
    let beyond_v = BEYOND_RANGE * drive_range_v;
    let first_v = record.drive_v.first().copied().unwrap_or(0.0);
    if first_v.abs() > beyond_v {
        return refuse(format!(
            "begins at {first_v} V; record the rig from rest at 0 V"
        ));
    }
    if !(low_v >= -beyond_v && high_v <= drive_range_v + beyond_v) {
        let goes = format!("the drive goes from {low_v} to {high_v} V");
        return refuse(format!(
            "{goes}; the rig's model holds from 0 to {drive_range_v} V"
        ));
    }
    Ok(())
}

/// Noise where the drive rests, and of how many samples, by third differences: a slider that still swings at
/// a fiftieth of the sampling rate adds a five-hundredth of its swing.
fn noise_at_rest<'a>(
    signals: impl Iterator<Item = (&'a [f64], &'a [f64])>,
) -> Option<(f64, usize)> {
    let (mut squares, mut count) = (0.0, 0usize);
    for (drive_v, reading_um) in signals {
        for rest in rests(drive_v) {
            let late = &reading_um[rest.start + rest.len() / 2..rest.end];
            for four in late.windows(4) {
                squares += (four[3] - 3.0 * four[2] + 3.0 * four[1] - four[0]).powi(2);
                count += 1;
            }
        }
    }
    // 1 + 9 + 9 + 1 times the variance. Readings without noise show that of no sensor.
    let noise_um = (squares / 20.0 / count.max(1) as f64).sqrt();
    (noise_um > 0.0).then_some((noise_um, count))
}

/// Takes the constant of a reading out of it.
pub(super) fn remove_mean(signal: &mut [f64]) {
    let about = mean(signal);
    signal.iter_mut().for_each(|value| *value -= about);
}

/// Mean square.
pub(super) fn mean_square(signal: &[f64]) -> f64 {
    dot(signal, signal) / signal.len().max(1) as f64
}
