//! Recordings with several drives and sensors, in memory.
//!
//! A record that repeats a period is reduced to one mean period, simulated behind a second one that is not
//! counted. The scatter between its periods is the noise.

use crate::dataset::Role;
use crate::error::{Error, Result};

/// One record.
#[derive(Clone, Debug)]
pub struct AxesRecord {
    /// Its name.
    pub name: String,
    /// Samples per second.
    pub sample_rate_hz: f64,
    /// Whether it is fitted or judges.
    pub role: Role,
    /// Each drive.
    pub drives: Vec<Vec<f64>>,
    /// Each sensor.
    pub readings: Vec<Vec<f64>>,
    /// First sample that counts: before it the stage forgets what nobody recorded.
    pub counted_from: usize,
    /// First sample that does not count any more.
    pub counted_to: usize,
    /// It is a period that was repeated for long.
    pub periodic: bool,
    /// RMS noise of each sensor in what is counted, where the record shows it.
    pub noise: Option<Vec<f64>>,
}

/// Shortest warm-up, as a share of a record that has no period.
const WARM_UP: f64 = 0.05;
/// Share of a record that is fitted, where no other record judges.
const FITTED: f64 = 0.65;

impl AxesRecord {
    /// A record as it was measured, without a period.
    #[must_use]
    pub fn new(
        name: &str,
        sample_rate_hz: f64,
        role: Role,
        drives: Vec<Vec<f64>>,
        readings: Vec<Vec<f64>>,
    ) -> Self {
        let samples = drives.first().map_or(0, Vec::len);
        let counted_from = (WARM_UP * samples as f64) as usize;
        Self {
            name: name.into(),
            sample_rate_hz,
            role,
            drives,
            readings,
            counted_from,
            counted_to: samples,
            periodic: false,
            noise: None,
        }
    }

    /// The mean of the periods from a sample on, and the noise that their scatter shows. Before it the stage
    /// still forgets what was before the record: a period, for a stage that begins at rest.
    ///
    /// # Errors
    /// No whole period.
    pub fn averaged(self, period: usize, periodic_from: usize) -> Result<Self> {
        let samples = self.drives.first().map_or(0, Vec::len);
        let behind = samples.saturating_sub(periodic_from);
        if period == 0 || behind < period {
            return Err(Error::new(
                &self.name,
                format!(
                    "{behind} samples hold {:.1} periods of {period}; expected one or more",
                    behind as f64 / period.max(1) as f64
                ),
            ));
        }
        let periods = behind / period;
        let from = samples - periods * period;
        let mean = |signal: &Vec<f64>| -> Vec<f64> {
            (0..period)
                .map(|k| {
                    (0..periods)
                        .map(|p| signal[from + p * period + k])
                        .sum::<f64>()
                        / periods as f64
                })
                .collect()
        };
        let scatter = |signal: &Vec<f64>, mean: &[f64]| -> f64 {
            let squares: f64 = signal[from..]
                .iter()
                .enumerate()
                .map(|(k, y)| (y - mean[k % period]).powi(2))
                .sum();
            (squares / (((periods - 1) * period) as f64) / periods as f64).sqrt()
        };
        let readings: Vec<Vec<f64>> = self.readings.iter().map(mean).collect();
        let noise = (periods > 1).then(|| {
            self.readings
                .iter()
                .zip(&readings)
                .map(|(signal, mean)| scatter(signal, mean))
                .collect()
        });
        let twice = |signals: Vec<Vec<f64>>| {
            signals
                .into_iter()
                .map(|signal| signal.repeat(2))
                .collect::<Vec<_>>()
        };
        let drives = twice(self.drives.iter().map(mean).collect());
        Ok(Self {
            drives,
            readings: twice(readings),
            counted_from: period,
            counted_to: 2 * period,
            periodic: true,
            noise,
            ..self
        })
    }

    /// Sampling period, s.
    #[must_use]
    pub fn dt_s(&self) -> f64 {
        1.0 / self.sample_rate_hz
    }
}

/// Records of one stage.
#[derive(Clone, Debug)]
pub struct AxesData {
    /// Name of the data set.
    pub name: String,
    /// Names of the drives, with their unit behind them where the file gives one.
    pub drives: Vec<String>,
    /// Names of the sensors.
    pub sensors: Vec<String>,
    /// Unit of the drives.
    pub drive_unit: String,
    /// Unit of the readings.
    pub sensor_unit: String,
    /// The records.
    pub records: Vec<AxesRecord>,
}

impl AxesData {
    /// Checks that records fit together; where none judges, the last part of each does.
    ///
    /// # Errors
    /// One message with the record and what was expected.
    pub fn new(name: &str, records: Vec<AxesRecord>) -> Result<Self> {
        let first = records
            .first()
            .ok_or_else(|| Error::new(name, "has no record; expected at least one"))?;
        let (drives, sensors) = (first.drives.len(), first.readings.len());
        if drives == 0 || sensors == 0 {
            return Err(Error::new(
                name,
                format!("has {drives} drives and {sensors} sensors; expected at least one of each"),
            ));
        }
        for record in &records {
            let wrong = |what: String| Err(Error::new(format!("{name}, {}", record.name), what));
            if (record.drives.len(), record.readings.len()) != (drives, sensors) {
                return wrong(format!(
                    "{} drives and {} sensors; expected {drives} and {sensors} as in {}",
                    record.drives.len(),
                    record.readings.len(),
                    first.name
                ));
            }
            let samples = record.drives[0].len();
            if record
                .drives
                .iter()
                .chain(&record.readings)
                .any(|signal| signal.len() != samples)
            {
                return wrong("its signals have different lengths".into());
            }
            if !(record.sample_rate_hz > 0.0 && record.sample_rate_hz.is_finite()) {
                return wrong(format!(
                    "sample_rate_hz = {}; expected a number above zero",
                    record.sample_rate_hz
                ));
            }
            if record
                .drives
                .iter()
                .chain(&record.readings)
                .flatten()
                .any(|value| !value.is_finite())
            {
                return wrong("holds a value that is not finite".into());
            }
            if record.counted_to.saturating_sub(record.counted_from) < SAMPLES_MIN {
                return wrong(format!(
                    "{samples} samples; expected {SAMPLES_MIN} or more behind the warm-up"
                ));
            }
        }
        let names = |what: &str, count: usize| (1..=count).map(|i| format!("{what} {i}")).collect();
        let mut data = Self {
            name: name.into(),
            drives: names("drive", drives),
            sensors: names("sensor", sensors),
            drive_unit: "V".into(),
            sensor_unit: "um".into(),
            records,
        };
        data.records
            .retain(|record| matches!(record.role, Role::Identify | Role::Validate));
        if !data
            .records
            .iter()
            .any(|record| record.role == Role::Identify)
        {
            return Err(Error::new(
                name,
                "has no record with role = \"identify\"; expected one",
            ));
        }
        if !data
            .records
            .iter()
            .any(|record| record.role == Role::Validate)
        {
            let judging: Vec<AxesRecord> = data.records.iter_mut().map(AxesRecord::split).collect();
            data.records.extend(judging);
        }
        Ok(data)
    }

    /// The records that are fitted, or those that judge.
    pub fn of_role(&self, role: Role) -> impl Iterator<Item = (usize, &AxesRecord)> {
        self.records
            .iter()
            .enumerate()
            .filter(move |(_, record)| record.role == role)
    }
}

/// Fewest samples that count.
const SAMPLES_MIN: usize = 64;

impl AxesRecord {
    /// Leaves its last part to a record that judges.
    fn split(&mut self) -> Self {
        let until =
            self.counted_from + (FITTED * (self.counted_to - self.counted_from) as f64) as usize;
        let judging = Self {
            name: format!("{}, last part", self.name),
            role: Role::Validate,
            counted_from: until,
            ..self.clone()
        };
        self.counted_to = until;
        judging
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn periods_are_averaged_and_their_scatter_is_the_noise() {
        let mut noise = hysteron_sim::noise::WhiteNoise::new(0.1, 3);
        let y: Vec<f64> = (0..6400)
            .map(|k| (std::f64::consts::TAU * f64::from(k % 640) / 640.0).sin() + noise.next_um())
            .collect();
        let record = AxesRecord::new("r", 1000.0, Role::Identify, vec![y.clone()], vec![y])
            .averaged(640, 640)
            .unwrap();
        let shown = record.noise.unwrap()[0];
        // Nine periods are averaged.
        assert!((shown - 0.1 / 3.0).abs() < 0.003, "{shown}");
        assert_eq!(
            (
                record.counted_from,
                record.counted_to,
                record.drives[0].len()
            ),
            (640, 1280, 1280)
        );
    }
}
