//! How well a model predicts: the band that its values' covariance makes, and what of a drive was never
//! recorded.
//!
//! # How it works
//! The band is the first-order spread of the reading: one simulation for each column of the covariance's
//! factor. A drive that is longer than what was recorded meets creep that no record shows: each decade of
//! time beyond it adds a term of the share that stacks are expected to have. The error that judged the model
//! is part of the band, since nothing says that it is smaller elsewhere.

use crate::parallel;
use hysteron_sim::chain::{Drive, EffectInstance, Model};
use hysteron_sim::effect::{Overview, by_id, creep};

/// Standard deviations on either side of a 95 % band.
pub const BAND_95: f64 = 1.96;
/// A drive leaves what was recorded where it goes beyond it by more than this share.
const BEYOND: f64 = 0.05;
/// Longest time constant of a record that ends when its motion does, as a share of its length.
const SEEN_CREEP: f64 = 0.5;

/// Standard deviation of what the sensor reads at every sample, um; none for a model that does not know how
/// well its values are known.
#[must_use]
pub fn std_um(model: &Model, drive: &Drive) -> Option<Vec<f64>> {
    let identified = model.identified.clone()?;
    let mut variations: Vec<Model> = Vec::new();
    for column in 0..identified.factor.len() {
        let mut moved = model.clone();
        for ((effect, parameter), row) in identified
            .values
            .iter()
            .zip(&identified.factor)
            .skip(column)
        {
            let value = moved
                .effects
                .iter_mut()
                .find(|e| e.id == *effect)?
                .parameters
                .iter_mut()
                .find(|p| p.parameter.name == *parameter)?;
            value.set_coordinate(value.coordinate() + row.get(column)?);
        }
        variations.push(moved);
    }
    variations.extend(unseen_creep(
        model,
        identified.seconds,
        drive.drive_v.len() as f64 * drive.dt_s,
    ));
    let base = model.simulate(drive);
    let squares = parallel::map(&variations, |one| {
        one.simulate(drive)
            .iter()
            .zip(&base)
            .map(|(a, b)| (a - b).powi(2))
            .collect::<Vec<f64>>()
    });
    let mut sums = vec![identified.error_um.powi(2); base.len()];
    squares.iter().for_each(|one| {
        sums.iter_mut()
            .zip(one)
            .for_each(|(sum, square)| *sum += square)
    });
    Some(sums.into_iter().map(f64::sqrt).collect())
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
            "the drive goes from {low:.3} to {high:.3} V, the records from {:.3} to {:.3} V",
            known.low_v, known.high_v
        ));
    }
    out
}
