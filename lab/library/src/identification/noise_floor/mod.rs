//! The noise floor: what remains random, and on which evidence.
//!
//! * [`rest`]: records at rest, and where a drive holds still inside a record;
//! * [`repetition`]: periods and repeated drives, which are found from the drive alone;
//! * [`read_back`]: noise in the column of the drive, which every model passes on;
//! * [`high_band`]: a lower bound from what readings have above everything that the drive excites;
//! * [`random_part`]: lines, slow drift and what follows a measured force are effects, not noise, and are
//!   taken out of all of them.
//! * [`one_over_f`]: noise that is the stronger the slower it is, carried on from a rest to longer records.
//!
//! A record at rest that the data set brings is taken at its word. Without one, every record has the floor
//! that its own repetitions show, or its own hold; a record that has neither has the least of the others,
//! since the sensor is the same. Without any evidence there is no floor, and none is made up. A coarse
//! converter makes noise that neither rest nor repeats show; its step is read from the readings
//! ([`crate::dataset::reading_grid`]).

mod estimate;
mod high_band;
mod one_over_f;
mod random_part;
mod read_back;
mod repetition;
mod rest;

pub use estimate::{FloorEstimate, FloorEvidence};
pub use one_over_f::OneOverFNoise;
pub use random_part::periodogram;
pub use read_back::{DriveNoiseEvidence, ReadBack};

use crate::dataset::reading_grid::{noise_between_repeats_um, reading_step_um, rounding_noise};
use crate::dataset::{Dataset, Record, Role};
use crate::identification::fit::rms;
use crate::parallel;
use hysteron_sim::chain::Model;
use hysteron_sim::effect::LinesAtRest;
use repetition::Repeated;
use rest::AtRest;
use serde::Serialize;

/// The floor that verdicts use, with all the estimates there are.
#[derive(Clone, Debug, Serialize)]
pub struct NoiseFloor {
    /// RMS over all records that are fitted or judge, um; `None` where the data cannot tell.
    pub rms_um: Option<f64>,
    /// What it rests on, or `undecidable`.
    pub basis: String,
    /// RMS of each record of the data set, um.
    pub of_records_um: Vec<Option<f64>>,
    /// The noise is at least this, um.
    pub at_least_um: Option<f64>,
    /// All estimates, the one used first.
    pub estimates: Vec<FloorEstimate>,
    /// 1/f noise of the rest record; `None` where the noise is white as far as the rest shows.
    pub one_over_f: Option<OneOverFNoise>,
    /// Largest standard deviation of the RMS of such noise from one judged record to another, as a share of
    /// it.
    pub one_over_f_relative_std: f64,
    /// Step of a converter that is coarse enough to matter beside the rest of the noise, um.
    pub reading_step_um: Option<f64>,
    /// Where estimates disagree.
    pub warnings: Vec<String>,
    /// Lines that the readings show while the drive stands still.
    #[serde(skip)]
    pub lines_at_rest: LinesAtRest,
    /// Noise in the column of the drive; `None` where the drive stands there as it was commanded.
    #[serde(skip)]
    pub read_back: Option<ReadBack>,
    /// RMS of each record without what that noise makes, um.
    #[serde(skip)]
    pub of_readings_um: Vec<Option<f64>>,
    /// Where estimates disagree, without the warnings on that noise.
    #[serde(skip)]
    pub of_readings_warnings: Vec<String>,
}

impl NoiseFloor {
    /// Standard deviation of the floor as a share of it: that of the estimate that is used, as of white
    /// noise, and that of slow noise from record to record.
    #[must_use]
    pub fn relative_std(&self) -> f64 {
        let white = self
            .estimates
            .first()
            .filter(|e| e.rms_um > 0.0)
            .map_or(0.0, |e| e.std_um / e.rms_um);
        white.hypot(self.one_over_f_relative_std)
    }

    /// RMS of the readings alone over all records that are fitted or judge, um: without what the noise of the
    /// drive's column makes in a model.
    #[must_use]
    pub fn readings_rms_um(&self, dataset: &Dataset) -> Option<f64> {
        over_judging(dataset, &self.of_readings_um)
    }

    /// The floor beside a model that leaves these residuals, um, empty for a record that does not judge: what
    /// the noise of the drive's column makes in the readings of this model is part of it. `None` where the drive
    /// stands in its column as it was commanded, or nothing speaks for noise that nobody saw.
    ///
    /// `explained` times the floor is what a model leaves that explains everything.
    #[must_use]
    pub fn beside(
        &self,
        model: &Model,
        residuals_um: &[Vec<f64>],
        explained: f64,
        dataset: &Dataset,
    ) -> Option<Self> {
        let read_back = self.read_back?;
        let made_in_um: Vec<Vec<f64>> = parallel::map(&dataset.records, |record| {
            if record.role == Role::Noise {
                Vec::new()
            } else {
                read_back.response_um(model, record)
            }
        });
        let rms_of = |of_records: &[Vec<f64>]| -> Vec<Option<f64>> {
            let of_one = |values: &Vec<f64>| (!values.is_empty()).then(|| rms(values));
            of_records.iter().map(of_one).collect()
        };
        let made_um = rms_of(&made_in_um);
        let judged = |um: &[Option<f64>]| over_judging(dataset, um);
        let (left, made, readings) = (
            judged(&rms_of(residuals_um))?,
            judged(&made_um)?,
            judged(&self.of_readings_um),
        );
        let more_than_made = left > LEAVES_WHAT_IT_MAKES * made;
        let speaks_for_it = || {
            readings.is_some_and(|readings| {
                made > readings
                    && left < explained * made.hypot(readings)
                    && read_back::has_spectrum_of(&made_in_um, residuals_um, readings)
            })
        };
        let counts = match read_back.known {
            // What the stage followed as well is no noise of the column.
            DriveNoiseEvidence::Seen => more_than_made,
            DriveNoiseEvidence::InItsBand | DriveNoiseEvidence::Steps { .. }
                if more_than_made && speaks_for_it() =>
            {
                true
            }
            // Of a drive that was commanded in these steps, all of it would be an effect: a warning reports
            // it, and the floor stays.
            DriveNoiseEvidence::Steps { step_v }
                if made > STEPS_MATTER * readings.unwrap_or(0.0) && left > STEPS_MATTER * made =>
            {
                return Some(Self {
                    warnings: self.warnings_and(Some(read_back::words_of_steps(step_v, made))),
                    ..self.clone()
                });
            }
            DriveNoiseEvidence::InItsBand | DriveNoiseEvidence::Steps { .. } => return None,
        };
        Some(self.with_drive_noise(dataset, read_back, |i| {
            if counts {
                made_um[i].unwrap_or(0.0)
            } else {
                0.0
            }
        }))
    }

    /// The floor where the noise of the drive's column makes so much of each record, um.
    fn with_drive_noise(
        &self,
        dataset: &Dataset,
        read_back: ReadBack,
        made_um: impl Fn(usize) -> f64,
    ) -> Self {
        let with = |(i, readings): (usize, &Option<f64>)| {
            readings.map(|readings_um: f64| readings_um.hypot(made_um(i)))
        };
        let of_records_um: Vec<Option<f64>> =
            self.of_readings_um.iter().enumerate().map(with).collect();
        let rms_um = over_judging(dataset, &of_records_um);
        let readings_um = over_judging(dataset, &self.of_readings_um).unwrap_or(0.0);
        let made_um = rms_um.map_or(0.0, |rms_um| {
            (rms_um * rms_um - readings_um * readings_um)
                .max(0.0)
                .sqrt()
        });
        let warnings = self.warnings_and(
            (made_um > DRIVE_NOISE_MATTERS * readings_um).then(|| read_back.words(made_um)),
        );
        Self {
            rms_um,
            of_records_um,
            warnings,
            ..self.clone()
        }
    }

    fn warnings_and(&self, of_the_drive: Option<String>) -> Vec<String> {
        self.of_readings_warnings
            .iter()
            .cloned()
            .chain(of_the_drive)
            .collect()
    }
}

/// Readings that are faster than this show lines of the mains where they are, Hz.
const SHOWS_MAINS_HZ: f64 = 150.0;
/// Rounding matters where it makes this share of the noise's power.
const ROUNDING_MATTERS: f64 = 0.05;
/// Noise in the drive's column is spoken of where it makes this share of the reading's own.
const DRIVE_NOISE_MATTERS: f64 = 0.1;
/// Steps of a drive are spoken of where rounding to them would make this share of the readings' noise, and a
/// model leaves this share of that.
const STEPS_MATTER: f64 = 0.5;
/// A model leaves at least this share of what the noise of its drive makes, unless the stage followed that
/// noise as well.
const LEAVES_WHAT_IT_MAKES: f64 = 0.9;
/// A declared step may differ by this share from the one that the readings show.
const DECLARED_STEP_TOLERANCE: f64 = 0.05;
/// Two estimates whose ratio is larger disagree.
const AGREEMENT: f64 = 1.15;

/// What the rests show of lines; the holds too, where no rest is long enough. Hum is there whatever the drive
/// does: a line that a hold has and a long rest has not is in the gain.
fn lines_at_rest(rests: &[AtRest], holds: &[AtRest]) -> LinesAtRest {
    let of = |still: &[&AtRest]| LinesAtRest {
        lines_hz: still
            .iter()
            .flat_map(|one| one.lines_hz.iter().copied())
            .collect(),
        samples: still
            .iter()
            .filter(|one| one.sample_rate_hz > SHOWS_MAINS_HZ)
            .map(|one| one.samples)
            .max()
            .unwrap_or(0),
    };
    let of_rests = of(&rests.iter().collect::<Vec<_>>());
    if of_rests.show_weak_lines() {
        of_rests
    } else {
        of(&rests.iter().chain(holds).collect::<Vec<_>>())
    }
}

/// Estimates the floor of a data set.
#[must_use]
pub fn noise_floor(dataset: &Dataset) -> NoiseFloor {
    let step_um = reading_step_um(dataset);
    let span_v = dataset.drive_max_v - dataset.drive_min_v;
    let taking_part = |r: &&Record| r.role != Role::Test;
    let driven: Vec<&Record> = dataset
        .records
        .iter()
        .filter(taking_part)
        .filter(|r| r.role != Role::Noise)
        .collect();
    let rests: Vec<AtRest> = dataset
        .records
        .iter()
        .filter(|r| r.role == Role::Noise)
        .map(|r| rest::of_record(r, step_um))
        .collect();
    let holds: Vec<AtRest> = driven
        .iter()
        .filter_map(|r| rest::of_hold(r, step_um))
        .collect();
    let lines_at_rest = lines_at_rest(&rests, &holds);
    let one_over_f = rests.first().and_then(|rest| rest.one_over_f);
    let mut estimates: Vec<FloorEstimate> = rests.into_iter().map(|rest| rest.estimate).collect();
    let mut repeats: Vec<Repeated> = driven
        .iter()
        .filter_map(|r| repetition::of_periods(r, span_v))
        .collect();
    repeats.extend(repetition::of_pairs(dataset));
    let read_back = ReadBack::of(
        dataset,
        repeats.iter().map(|r| r.drive_noise_v).fold(0.0, f64::max),
    );
    let mut repeated: Vec<FloorEstimate> = repeats.into_iter().map(|r| r.estimate).collect();
    if let Some(step_um) = step_um {
        repeated
            .iter_mut()
            .for_each(|e| e.rms_um = noise_between_repeats_um(e.rms_um, step_um));
    }
    estimates.extend(repeated);
    estimates.extend(holds.into_iter().map(|hold| hold.estimate));
    let gain_um_v = dataset.overview().gain_um_v;
    let bounds: Vec<FloorEstimate> = driven
        .iter()
        .filter_map(|r| high_band::of_record(r, gain_um_v))
        .collect();
    let at_least_um = bounds.iter().map(|e| e.rms_um).reduce(f64::min);
    let of_records_um: Vec<Option<f64>> = dataset
        .records
        .iter()
        .map(|r| {
            one_over_f
                .map(|one_over_f| one_over_f.in_record_um(r))
                .or_else(|| of_record(r, &estimates))
        })
        .collect();
    let judged = driven
        .iter()
        .map(|r| one_over_f.map_or(0.0, |one_over_f| one_over_f.relative_std(r)));
    let one_over_f_relative_std = judged.fold(0.0, f64::max);
    let rms_um = over_judging(dataset, &of_records_um);
    let mut warnings = disagreements(&estimates);
    warnings.extend(declared_step(dataset, step_um));
    warnings.extend(one_over_f.map(|w| {
        format!(
            "the noise is the stronger the slower it is ({:.2} nm white, {:.2} nm per root of a hertz at 1 Hz): its floor grows with the length of a record",
            1e3 * w.white_um,
            1e3 * w.at_1_hz_um
        )
    }));
    warnings.extend(rms_um.filter(|rms_um| *rms_um < LEAST_NOISE_UM).map(|rms_um| {
        format!("the noise is {:.2e} nm, less than any sensor has: are the readings simulated, filtered, or in another unit?", 1e3 * rms_um)
    }));
    let matters = |step: &f64| {
        rms_um.is_some_and(|rms_um| {
            rounding_noise(*step).powi(2) > ROUNDING_MATTERS * rms_um * rms_um
        })
    };
    let basis = estimates
        .first()
        .map_or_else(|| "undecidable".to_owned(), |e| e.basis.clone());
    let reading_step_um = step_um.filter(matters);
    estimates.extend(bounds);
    let of_readings_um = of_records_um.clone();
    let floor = NoiseFloor {
        rms_um,
        basis,
        of_records_um,
        at_least_um,
        estimates,
        one_over_f,
        one_over_f_relative_std,
        reading_step_um,
        lines_at_rest,
        of_readings_warnings: warnings.clone(),
        warnings,
        read_back,
        of_readings_um,
    };
    // A model follows what was read of the drive; the stage followed the drive. Before there is a model, by
    // the gain.
    match read_back.filter(|r| r.known == DriveNoiseEvidence::Seen) {
        Some(read_back) => {
            floor.with_drive_noise(dataset, read_back, |_| read_back.noise_v * gain_um_v.abs())
        }
        None => floor,
    }
}

/// The floor of one record: a rest record's, what its own repetitions show, its own hold's, or the least that
/// any record shows.
fn of_record(record: &Record, estimates: &[FloorEstimate]) -> Option<f64> {
    let rest = estimates
        .iter()
        .find(|e| e.evidence == FloorEvidence::RestRecord);
    let own = || {
        estimates
            .iter()
            .filter(|e| e.records.contains(&record.name))
    };
    let least =
        |all: &mut dyn Iterator<Item = &FloorEstimate>| all.map(|e| e.rms_um).reduce(f64::min);
    rest.map(|e| e.rms_um)
        .or_else(|| least(&mut own().filter(|e| e.evidence.under_drive())))
        .or_else(|| least(&mut own()))
        .or_else(|| least(&mut estimates.iter()))
}

/// The RMS over all records that are fitted or judge.
fn over_judging(dataset: &Dataset, of_records_um: &[Option<f64>]) -> Option<f64> {
    let judging = dataset
        .records
        .iter()
        .zip(of_records_um)
        .filter(|(r, _)| matches!(r.role, Role::Identify | Role::Validate));
    let (sum, count) = judging.fold((Some(0.0), 0.0), |(sum, count), (record, floor)| {
        let samples = record.counted().count() as f64;
        (
            sum.zip(*floor)
                .map(|(sum, floor)| sum + samples * floor * floor),
            count + samples,
        )
    });
    sum.filter(|_| count > 0.0).map(|sum| (sum / count).sqrt())
}

/// Noise of a capacitive sensor of a hertz of bandwidth, um: nothing that records motion reads with less.
const LEAST_NOISE_UM: f64 = 1e-6;

fn disagreements(estimates: &[FloorEstimate]) -> Vec<String> {
    let Some((first, others)) = estimates.split_first() else {
        return Vec::new();
    };
    let differs = |e: &&FloorEstimate| {
        e.rms_um > AGREEMENT * first.rms_um || e.rms_um < first.rms_um / AGREEMENT
    };
    let repeats_less_well =
        |e: &&FloorEstimate| match (first.evidence.under_drive(), e.evidence.under_drive()) {
            (true, false) => e.rms_um < first.rms_um,
            (false, true) => e.rms_um > first.rms_um,
            _ => false,
        };
    let (of_the_stage, of_anything): (Vec<&FloorEstimate>, Vec<&FloorEstimate>) =
        others.iter().filter(differs).partition(repeats_less_well);
    let said = |these: &[&FloorEstimate], why: &str| {
        let each: Vec<String> = these
            .iter()
            .map(|e| format!("from {} {:.2} nm", e.basis, 1e3 * e.rms_um))
            .collect();
        (!each.is_empty()).then(|| {
            format!(
                "the floor from {} is {:.2} nm, {}: {why}",
                first.basis,
                1e3 * first.rms_um,
                each.join(", ")
            )
        })
    };
    let stage = said(
        &of_the_stage,
        "the stage repeats itself less well than its sensor reads",
    );
    stage
        .into_iter()
        .chain(said(&of_anything, "they disagree"))
        .collect()
}

fn declared_step(dataset: &Dataset, step_um: Option<f64>) -> Option<String> {
    let (step_um, declared_um) = step_um.zip(dataset.sensor_lsb_um)?;
    ((step_um / declared_um - 1.0).abs() > DECLARED_STEP_TOLERANCE).then(|| {
        format!(
            "the readings are whole steps of {:.3} nm, but the data set declares sensor_lsb_um = {declared_um}, {:.3} nm",
            1e3 * step_um,
            1e3 * declared_um
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two drives that repeat, one of them badly: each record has the floor that its own repeats show.
    #[test]
    fn records_that_repeat_differently_have_different_floors() {
        let drive = |slow: f64| -> Vec<f64> {
            (0..4000)
                .map(|k| 20.0 * (slow * k as f64).sin() + 3.0 * (2.7 * slow * k as f64).cos())
                .collect()
        };
        let record = |name: &str, drive: Vec<f64>, rms_um: f64, seed| {
            let mut noise = hysteron_sim::noise::WhiteNoise::new(rms_um, seed);
            let reading = drive.iter().map(|u| 0.1 * u + noise.next_um()).collect();
            Record::new(name, 10_000.0, drive, reading)
        };
        let records = vec![
            record("a", drive(0.011), 0.002, 1),
            record("a again", drive(0.011), 0.002, 2),
            record("b", drive(0.0171), 0.03, 3),
            record("b again", drive(0.0171), 0.03, 4),
            record("c", drive(0.0231), 0.002, 5),
        ];
        let floor = noise_floor(&Dataset::new("d", -30.0, 30.0, records).unwrap());
        for (found, true_um) in floor
            .of_records_um
            .iter()
            .zip([0.002, 0.002, 0.03, 0.03, 0.002])
        {
            assert!(
                (found.unwrap() / true_um - 1.0).abs() < 0.06,
                "{found:?} {true_um}"
            );
        }
        assert!((floor.at_least_um.unwrap() / 0.002 - 1.0).abs() < 0.06);
    }

    /// A gain that flutters moves the readings of a hold and not those of a rest at zero.
    #[test]
    fn a_long_rest_decides_alone_about_lines() {
        let rate_hz = 10_000.0;
        let record = |name: &str, role, high_v: f64| {
            let drive = |k: usize| match k {
                0..9000 => high_v,
                _ => high_v * (1.0 + 0.2 * (0.01 * (k - 9000) as f64).sin()),
            };
            let drive_v: Vec<f64> = (0..12_000).map(drive).collect();
            let mut noise = hysteron_sim::noise::WhiteNoise::new(0.002, 7);
            let flutter =
                |k: usize| 1.0 + 0.02 * (std::f64::consts::TAU * 50.0 * k as f64 / rate_hz).sin();
            let reads = |(k, u): (usize, &f64)| 0.1 * u * flutter(k) + noise.next_um();
            let displacement_um = drive_v.iter().enumerate().map(reads).collect();
            Record {
                role,
                ..Record::new(name, rate_hz, drive_v, displacement_um)
            }
        };
        let held = record("held", Role::Identify, 50.0);
        let lines_hz = |records: Vec<Record>| {
            let dataset = Dataset::new("d", 0.0, 60.0, records).unwrap();
            noise_floor(&dataset).lines_at_rest.lines_hz
        };
        let of_hold = lines_hz(vec![held.clone()]);
        assert!(
            of_hold.iter().any(|hz| (hz - 50.0).abs() < 1.0),
            "{of_hold:?}"
        );
        let of_rest = lines_hz(vec![held, record("rest", Role::Noise, 0.0)]);
        assert!(of_rest.is_empty(), "{of_rest:?}");
    }
}
