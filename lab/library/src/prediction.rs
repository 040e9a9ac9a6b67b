//! What a model predicts of a drive, within which band, and what of the drive was never recorded.
//!
//! # How it works
//! The error that judged the model and the spread of its values make a width at every sample. The spread is to
//! first order, by a small step along each column of the covariance's factor: a large one tears apart what the
//! data fix together. What the constant and the free motions of a record take up over the recorded time is left
//! out of it. The files of the model calibrate both ([`calibrated`]). Their judging samples are off by the error
//! of the values too, so that the spread over them is at most what they are off: more of it is a covariance
//! that overstates. The band is so many times the width as hold 95 % of these samples, and of all of the files.
//!
//! A drive beyond what was recorded gets the whole spread. There creep that no record shows adds to it, a term
//! for each decade of time beyond, of the share that stacks are expected to have. Where the voltage is beyond
//! the recorded one, the slope may be any that the loops have, and a curve that the error hides goes on: a bare
//! gain bends too.

use crate::dataset::{Dataset, Record};
use crate::error::Result;
use crate::identification::nuisance_terms::{Samples, columns, project_out_by_rows};
use crate::loop_figures::loop_figures;
use crate::parallel;
use crate::replay::files;
use crate::simulate::simulate;
use hysteron_sim::chain::{Drive, EffectInstance, InitialState, Model};
use hysteron_sim::effect::{Overview, by_id, creep};
use hysteron_sim::physics::{Identified, RecordStart};
use nalgebra::{DMatrix, DVector};

/// Standard deviations on either side of a 95 % band.
pub const BAND_95: f64 = 1.96;
/// A drive leaves what was recorded where it goes beyond it by more than this share.
const BEYOND: f64 = 0.05;
/// Longest time constant of a record that ends when its motion does, as a share of its length.
const SEEN_CREEP: f64 = 0.5;
/// Largest change of a coordinate by which the spread is derived.
const DERIVATIVE_STEP: f64 = 1e-3;
/// Columns of the factor that are simulated side by side: more would need more memory than a long drive leaves.
const SIDE_BY_SIDE: usize = 8;
/// Share of the samples that a band holds.
const IN_BAND: f64 = 0.95;

/// What a model predicts of a drive.
#[derive(Clone, Debug)]
pub struct Prediction {
    /// The reading before the sensor rounds it, um.
    pub reading_um: Vec<f64>,
    /// Half of the width of the 95 % band; none for a model that does not know how well it is known, um.
    pub half_band_um: Option<Vec<f64>>,
    /// What of the drive was never recorded.
    pub remarks: Vec<String>,
}

/// Predicts the reading under a drive from a start on; `place` is what the drive is called in messages.
///
/// # Errors
/// As [`simulate`].
pub fn predict(
    model: &Model,
    drive: &Drive,
    start: &RecordStart,
    place: &str,
) -> Result<Prediction> {
    let drive = &Drive {
        initial_state: start.state,
        ..*drive
    };
    let mut reading_um = simulate(&model.before_rounding(), drive, place)?;
    let half_band_um = half_band_um(model, drive, start, &reading_um);
    for (k, reading_um) in reading_um.iter_mut().enumerate() {
        *reading_um += start.adds_um(k as f64 * drive.dt_s);
    }
    Ok(Prediction {
        reading_um,
        half_band_um,
        remarks: beyond(model, drive),
    })
}

/// Half of the width of the band around what the chain alone reads, um.
fn half_band_um(
    model: &Model,
    drive: &Drive,
    start: &RecordStart,
    base_um: &[f64],
) -> Option<Vec<f64>> {
    let known = model.identified.as_deref()?;
    let spread = squared_spread(model, known, drive, start, base_um)?;
    // Judged samples say how far spread counts behind the start of their own file.
    let as_judged = !start.file.is_empty() && beyond(model, drive).is_empty();
    let share = match known.spread_share {
        share if share > 0.0 && as_judged => share,
        _ => 1.0,
    };
    let times = match known.band_95 {
        times if times > 0.0 => times,
        _ => BAND_95,
    };
    let lasts_s = drive.drive_v.len() as f64 * drive.dt_s;
    let mut creeps = vec![0.0; base_um.len()];
    // For as long as the records last they would have shown such creep.
    let shown = ((known.seconds / drive.dt_s) as usize).min(base_um.len());
    for more in unseen_creep(model, known.seconds, lasts_s) {
        let moved = more.before_rounding().simulate(drive);
        (shown..base_um.len()).for_each(|k| creeps[k] += (moved[k] - base_um[k]).powi(2));
    }
    let beyond_um = beyond_range_um(model, known, drive, base_um);
    let half = |k: usize| {
        let within = known.error_um.powi(2) + share * share * spread[k];
        (times * times * within + BAND_95 * BAND_95 * creeps[k]).sqrt()
            + beyond_um.get(k).copied().unwrap_or(0.0)
    };
    Some((0..base_um.len()).map(half).collect())
}

/// Variance of the reading by the covariance of the values, sample by sample.
fn squared_spread(
    model: &Model,
    known: &Identified,
    drive: &Drive,
    start: &RecordStart,
    base_um: &[f64],
) -> Option<Vec<f64>> {
    let samples = drive.drive_v.len();
    let record = Record {
        initial_state: start.state,
        offset_is_fitted: start.offset_is_fitted,
        ..Record::new(
            "",
            1.0 / drive.dt_s,
            drive.drive_v.to_vec(),
            vec![0.0; samples],
        )
    };
    // With no motion that begins, a change of the values moves the constant as it does on the record.
    let at_rest = start
        .at_rest
        .as_ref()
        .filter(|_| start.state != InitialState::Unknown)
        .filter(|rest| rest.moves_um.len() == known.factor.len());
    let own = match at_rest {
        Some(_) => DMatrix::zeros(samples, 0),
        None => columns(model, &record, &Samples::Every(0..samples)),
    };
    let recorded: Vec<usize> =
        (0..samples.min((known.seconds / drive.dt_s).ceil() as usize)).collect();
    let of_constant = at_rest.map_or(0.0, |rest| rest.std_um.powi(2));
    let mut sums = vec![of_constant; samples];
    let columns: Vec<usize> = (0..known.factor.len()).collect();
    for some in columns.chunks(SIDE_BY_SIDE) {
        for differs in parallel::map(some, |column| {
            let mut differs = along_column(model, known, *column, drive, base_um)?;
            match at_rest {
                Some(rest) => differs.add_scalar_mut(rest.moves_um[*column]),
                None => project_out_by_rows(&own, &recorded, &mut differs),
            }
            Some(differs)
        }) {
            sums.iter_mut()
                .zip(&differs?)
                .for_each(|(sum, d)| *sum += d * d);
        }
    }
    Some(sums)
}

/// What the constant of a record becomes more along each column of the factor of the covariance, um, where it
/// is the sum of its residuals with these weights; empty where the model lacks a value.
pub(crate) fn constant_moves_um(
    model: &Model,
    record: &Record,
    weights: &[(usize, f64)],
) -> Vec<f64> {
    let Some(known) = model.identified.as_deref() else {
        return Vec::new();
    };
    let drive = record.whole_drive();
    let base_um = model.before_rounding().simulate(&drive);
    let columns: Vec<usize> = (0..known.factor.len()).collect();
    let moves = parallel::map(&columns, |column| {
        let differs = along_column(model, known, *column, &drive, &base_um)?;
        Some(
            -weights
                .iter()
                .map(|(k, weight)| weight * differs[*k])
                .sum::<f64>(),
        )
    });
    moves.into_iter().collect::<Option<_>>().unwrap_or_default()
}

/// How much of the spread counts, and how many widths a band has on either side: each file simulated from its
/// start, as [`predict`] does. The band holds the samples of the records that judge, and all: one state and one
/// constant stand for a whole file, whose parts were judged with their own.
pub(crate) fn calibrated(model: &Model, dataset: &Dataset, judges: &[usize]) -> Option<[f64; 2]> {
    let known = model.identified.as_deref()?;
    let plain = model.before_rounding();
    let mut all: Vec<Replayed> = Vec::new();
    for (records, start) in files(dataset).iter().zip(&known.recorded.starts) {
        let file = &dataset.records[records[0]];
        let drive = Drive {
            initial_state: start.state,
            ..file.whole_drive()
        };
        let base_um = plain.simulate(&drive);
        let spread = squared_spread(model, known, &drive, start, &base_um)?;
        for record in records {
            let judges = judges.contains(record);
            all.extend(dataset.records[*record].counted().map(|k| {
                let reads_um = base_um[k] + start.adds_um(k as f64 * drive.dt_s);
                Replayed {
                    judges,
                    off_um: file.displacement_um[k] - reads_um,
                    spread: spread[k],
                }
            }));
        }
    }
    let sum = |of: &dyn Fn(&Replayed) -> f64| all.iter().filter(|r| r.judges).map(of).sum::<f64>();
    let (off, spread) = (sum(&|r| r.off_um * r.off_um), sum(&|r| r.spread));
    let share = if spread > off {
        (off / spread).sqrt()
    } else {
        1.0
    };
    let times = |which: &dyn Fn(&Replayed) -> bool| {
        let width = |r: &Replayed| (known.error_um.powi(2) + share * share * r.spread).sqrt();
        let counted = all.iter().filter(|r| which(r));
        let mut relative: Vec<f64> = counted.map(|r| r.off_um.abs() / width(r)).collect();
        relative.sort_by(f64::total_cmp);
        let at = (IN_BAND * (relative.len() + 1) as f64).ceil() as usize;
        relative
            .get(at.min(relative.len()).checked_sub(1)?)
            .copied()
    };
    let times = times(&|r| r.judges)?.max(times(&|_| true)?);
    (times.is_finite() && share > 0.0).then_some([share, times])
}

/// A sample of a file that was simulated from its start.
struct Replayed {
    judges: bool,
    off_um: f64,
    /// Variance by the values.
    spread: f64,
}

/// What a step along a column of the factor of the covariance makes of a reading, by a small share of it; none
/// where the model lacks a value.
fn along_column(
    model: &Model,
    known: &Identified,
    column: usize,
    drive: &Drive,
    base_um: &[f64],
) -> Option<DVector<f64>> {
    let moves = || {
        let rows = known.factor.iter().skip(column);
        rows.filter_map(|row| row.get(column))
    };
    let most = moves().map(|by| by.abs()).fold(0.0, f64::max);
    let share = (DERIVATIVE_STEP / most).min(1.0);
    let mut moved = model.clone();
    for ((effect, parameter), by) in known.values.iter().skip(column).zip(moves()) {
        let instance = moved.effects.iter_mut().find(|e| e.id == *effect)?;
        let value = instance
            .parameters
            .iter_mut()
            .find(|p| p.parameter.name == *parameter)?;
        value.set_coordinate(value.coordinate() + share * by);
    }
    let moved_um = moved.before_rounding().simulate(drive);
    let differs = moved_um.iter().zip(base_um).map(|(a, b)| (a - b) / share);
    Some(DVector::from_iterator(base_um.len(), differs))
}

/// How far the reading may be off because voltage goes beyond the recorded one, um: what that makes of the
/// reading, times the share by which the slopes of the loops differ from their mean, and the curve over the
/// voltage that the error can hide. Empty inside the range.
fn beyond_range_um(model: &Model, known: &Identified, drive: &Drive, base_um: &[f64]) -> Vec<f64> {
    let inside_v: Vec<f64> = drive
        .drive_v
        .iter()
        .map(|u| u.max(known.low_v).min(known.high_v))
        .collect();
    if inside_v == drive.drive_v {
        return Vec::new();
    }
    let differs = loop_figures(model).map_or(0.0, |loops| {
        0.5 * (loops.largest_slope_um_v - loops.least_slope_um_v) / loops.gain_um_v
    });
    let inside = Drive {
        drive_v: &inside_v,
        ..*drive
    };
    let within_um = model.before_rounding().simulate(&inside);
    let (middle_v, half_v) = (
        0.5 * (known.low_v + known.high_v),
        0.5 * (known.high_v - known.low_v),
    );
    // The Legendre polynomial of second degree has the root of a fifth as its RMS.
    let hidden_um = |u: f64| {
        let at = ((u - middle_v) / half_v.max(f64::MIN_POSITIVE)).powi(2);
        1.5 * 5f64.sqrt() * known.error_um * (at - 1.0).max(0.0)
    };
    (base_um.iter().zip(&within_um).zip(drive.drive_v))
        .map(|((beyond_um, within_um), u)| {
            (differs * (beyond_um - within_um)).abs() + hidden_um(*u)
        })
        .collect()
}

/// The model with one more term of creep for each decade of time that the drive lasts beyond what was
/// recorded.
fn unseen_creep(model: &Model, recorded_s: f64, lasts_s: f64) -> Vec<Model> {
    let mut out = Vec::new();
    // The slowest creep of a record is known as a part of a straight line only.
    let mut time_constant_s = SEEN_CREEP * recorded_s * 10f64.sqrt();
    let is_seen = recorded_s <= 0.0 || lasts_s <= (1.0 + BEYOND) * recorded_s;
    while !is_seen && time_constant_s < 3.0 * lasts_s {
        let known = model.values(creep::ID).unwrap_or_default();
        let values: Vec<f64> = known
            .iter()
            .copied()
            .chain([creep::EXPECTED_SHARE, time_constant_s])
            .collect();
        if let Some(effect) =
            by_id(creep::ID).and_then(|effect| effect.with_parameters(values.len()))
        {
            let overview = Overview {
                duration_s: 20.0 * lasts_s,
                ..Overview::without_data(model.drive_min_v, model.drive_max_v)
            };
            let mut instance = EffectInstance::new(effect, &overview, &[]);
            instance
                .parameters
                .iter_mut()
                .zip(&values)
                .for_each(|(p, value)| p.value = *value);
            let mut more = model.clone();
            more.add(instance);
            out.push(more);
        }
        time_constant_s *= 10.0;
    }
    out
}

/// What of a drive lies outside what the model was identified from, a sentence each.
#[must_use]
pub fn beyond(model: &Model, drive: &Drive) -> Vec<String> {
    let mut out = Vec::new();
    let takes_force = model
        .effects
        .iter()
        .find(|e| e.effect.declaration().needs_force);
    if let (Some(effect), None) = (takes_force, drive.force_n) {
        out.push(format!(
            "{} takes a force, and the drive comes without one: as if none acted",
            effect.id
        ));
    }
    let Some(known) = model.identified.as_deref() else {
        out.push(
            "the model file does not say what it was identified from, so no band is given".into(),
        );
        return out;
    };
    let (low, high) = crate::statistics::extremes(drive.drive_v);
    let lasts_s = drive.drive_v.len() as f64 * drive.dt_s;
    let slope = drive
        .drive_v
        .windows(2)
        .map(|w| (w[1] - w[0]).abs())
        .fold(0.0, f64::max)
        / drive.dt_s;
    let margin = BEYOND * (known.high_v - known.low_v);
    if lasts_s > (1.0 + BEYOND) * known.seconds {
        out.push(format!(
            "the drive lasts {lasts_s:.3} s, the longest record {:.3} s: creep and drift beyond that are a guess",
            known.seconds
        ));
    }
    if slope > (1.0 + BEYOND) * known.slope_max_v_s {
        out.push(format!(
            "the drive moves at up to {slope:.0} V/s, the records at up to {:.0} V/s",
            known.slope_max_v_s
        ));
    }
    if high > known.high_v + margin || low < known.low_v - margin {
        out.push(format!(
            "the drive goes from {low:.3} to {high:.3} V, the records from {:.3} to {:.3} V: the band is wider where the model goes on as it does inside",
            known.low_v, known.high_v
        ));
    }
    out
}
