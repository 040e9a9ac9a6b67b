//! What a model predicts of a drive, within which band, and what of the drive was never recorded.
//!
//! # How it works
//! The band is so many times the error that judged the model as hold 95 % of the samples that judged. Three
//! things make it wider. The spread of the values, to first order: one simulation for each column of the
//! covariance's factor, less what the constant and the free motions of a record take up over the recorded
//! time. Creep that no record shows, where a drive lasts longer: each decade of time beyond adds a term of
//! the share that stacks are expected to have. And the voltage beyond the recorded one: there the slope may
//! be any that the loops have.

use crate::dataset::Record;
use crate::engineering::loop_figures;
use crate::error::Result;
use crate::identification::nuisance_terms::{Samples, columns, project_out_by_rows};
use crate::parallel;
use crate::simulate::simulate;
use hysteron_sim::chain::{Drive, EffectInstance, Model};
use hysteron_sim::effect::{Overview, by_id, creep};
use hysteron_sim::physics::{Identified, RecordStart};
use nalgebra::DVector;

/// Standard deviations on either side of a 95 % band.
pub const BAND_95: f64 = 1.96;
/// A drive leaves what was recorded where it goes beyond it by more than this share.
const BEYOND: f64 = 0.05;
/// Longest time constant of a record that ends when its motion does, as a share of its length.
const SEEN_CREEP: f64 = 0.5;

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
    let samples = drive.drive_v.len();
    let mut variations = (0..known.factor.len())
        .map(|column| along_column(model, known, column))
        .collect::<Option<Vec<Model>>>()?;
    let unseen = unseen_creep(model, known.seconds, samples as f64 * drive.dt_s);
    let of_values = variations.len();
    variations.extend(unseen);
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
    let own = columns(model, &record, &Samples::Every(0..samples));
    let recorded: Vec<usize> =
        (0..samples.min((known.seconds / drive.dt_s).ceil() as usize)).collect();
    let spread = parallel::map_indices(variations.len(), |i| {
        let moved = variations[i].before_rounding().simulate(drive);
        let mut differs =
            DVector::from_iterator(samples, moved.iter().zip(base_um).map(|(a, b)| a - b));
        if i < of_values {
            project_out_by_rows(&own, &recorded, &mut differs);
        }
        differs
    });
    let mut sums = vec![known.error_um.powi(2); samples];
    for differs in &spread {
        sums.iter_mut()
            .zip(differs)
            .for_each(|(sum, d)| *sum += d * d);
    }
    let times = if known.band_95 > 0.0 {
        known.band_95
    } else {
        BAND_95
    };
    let beyond_um = beyond_range_um(model, known, drive, base_um);
    let half =
        |(k, sum): (usize, &f64)| times * sum.sqrt() + beyond_um.get(k).copied().unwrap_or(0.0);
    Some(sums.iter().enumerate().map(half).collect())
}

/// The model moved by a column of the factor of its covariance; none where it lacks a value.
fn along_column(model: &Model, known: &Identified, column: usize) -> Option<Model> {
    let mut moved = model.clone();
    for ((effect, parameter), row) in known.values.iter().zip(&known.factor).skip(column) {
        let instance = moved.effects.iter_mut().find(|e| e.id == *effect)?;
        let value = instance
            .parameters
            .iter_mut()
            .find(|p| p.parameter.name == *parameter)?;
        value.set_coordinate(value.coordinate() + row.get(column)?);
    }
    Some(moved)
}

/// How far the reading may be off because voltage goes beyond the recorded one, um: what that makes of the
/// reading, times the share by which the slopes of the loops differ from their mean. Empty inside the range.
fn beyond_range_um(model: &Model, known: &Identified, drive: &Drive, base_um: &[f64]) -> Vec<f64> {
    let inside_v: Vec<f64> = drive
        .drive_v
        .iter()
        .map(|u| u.max(known.low_v).min(known.high_v))
        .collect();
    let (true, Some(loops)) = (inside_v != drive.drive_v, loop_figures(model)) else {
        return Vec::new();
    };
    let differs = 0.5 * (loops.largest_slope_um_v - loops.least_slope_um_v) / loops.gain_um_v;
    let inside = Drive {
        drive_v: &inside_v,
        ..*drive
    };
    let within_um = model.before_rounding().simulate(&inside);
    let off_um = |(a, b): (&f64, &f64)| (differs * (a - b)).abs();
    base_um.iter().zip(&within_um).map(off_um).collect()
}

/// The model with one more term of creep for each decade of time that the drive lasts beyond what was
/// recorded.
fn unseen_creep(model: &Model, recorded_s: f64, lasts_s: f64) -> Vec<Model> {
    let mut out = Vec::new();
    // The slowest creep of a record is known as a part of a straight line only.
    let mut time_constant_s = SEEN_CREEP * recorded_s * 10f64.sqrt();
    while recorded_s > 0.0 && time_constant_s < 3.0 * lasts_s {
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
    let Some(known) = model.identified.as_deref() else {
        return vec![
            "the model file does not say what it was identified from, so no band is given".into(),
        ];
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
    let mut out = Vec::new();
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
