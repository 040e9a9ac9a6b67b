//! One model of given structure for all records: modes in which every drive and sensor takes part, and
//! actuators that remember their extension.
//!
//! The linear part begins from the measured responses (`modal_start`); then all numbers are refined together
//! on the records themselves, the actuators' beginning without force.

use super::fit::Problem;
use super::modal_start::modal_start;
use super::recordings::AxesData;
use super::structure::{AxisEffect, Described};
use crate::dataset::Role;
use crate::error::Result;
use crate::identification::budget::Budget;
use crate::identification::work::Stage;
use crate::statistics::rms_about_mean;
use crate::watch::Watch;
use serde::Serialize;

/// What a model is to consist of.
#[derive(Clone, Copy, Debug)]
pub struct Structure {
    /// Modes that are looked for below the highest frequency.
    pub modes: usize,
    /// Whether the forces of the actuators remember their extension.
    pub actuator_hysteresis: bool,
    /// Whether the actuators soften while they move.
    pub actuator_softening: bool,
}

/// Error of a model on a record.
#[derive(Clone, Debug, Serialize)]
pub struct RecordError {
    /// The record.
    pub record: String,
    /// Whether it was fitted or held out.
    pub role: &'static str,
    /// RMS error of all sensors, of the RMS of their readings, per cent.
    pub error_pct: f64,
}

/// Steps between two looks at the watch, and most of them.
const STEPS: usize = 4;
const ROUNDS: usize = 12;
/// Where the softening of an actuator starts, of what it may take: a twentieth of the stiffness of the stage.
const SOFTENING_GUESS: f64 = 0.1;
/// A round that lowers the squares by less ends the fit: half of that is a fifth of a per cent of an error.
const FALL_ENOUGH: f64 = 4e-3;

/// Identifies a model, or refines one, to the best so far where the watch ends it.
///
/// # Errors
/// When the responses show no mode.
pub fn identify(
    data: &AxesData,
    from: Option<Described>,
    structure: Structure,
    watch: &dyn Watch,
) -> Result<Described> {
    let budget = Budget::of_time(watch);
    budget.work.enter(Stage::Report);
    let problem = Problem::with_model_error(data).within(budget.clone());
    let is_over = || budget.is_stopped() || budget.is_over();
    let refined = |mut model: Described| -> Described {
        let mut cost = problem.cost(&model.stage, Role::Identify);
        for _ in 0..ROUNDS {
            model = problem.fit(&model, STEPS, FALL_ENOUGH / STEPS as f64);
            let now = problem.cost(&model.stage, Role::Identify);
            if now > (1.0 - FALL_ENOUGH) * cost || is_over() {
                break;
            }
            cost = now;
        }
        model
    };
    let mut model = match from {
        Some(model) => model,
        None => refined(modal_start(data, structure.modes)?),
    };
    let signals = problem.simulate(&model.stage);
    let reach: Vec<f64> = (0..data.drives.len())
        .map(|drive| problem.extension_reach(&model.stage, &signals, drive))
        .collect();
    let add = |mut model: Described, effect: &dyn Fn(usize) -> AxisEffect| {
        if is_over() {
            return model;
        }
        for (drive, reach) in reach.iter().enumerate() {
            if !model.effects.contains(&effect(drive)) {
                model = model.with(effect(drive), [*reach, SOFTENING_GUESS], &problem.scales);
            }
        }
        refined(model)
    };
    if structure.actuator_softening {
        model = add(model, &|drive| AxisEffect::ActuatorSoftening { drive });
    }
    if structure.actuator_hysteresis {
        model = add(model, &|drive| AxisEffect::ActuatorHysteresis { drive });
    }
    Ok(model)
}

/// The errors of a model on all records.
#[must_use]
pub fn record_errors(data: &AxesData, model: &Described) -> Vec<RecordError> {
    let problem = Problem::new(data);
    let of_record = |n: usize| {
        let record = &data.records[n];
        let counted = record.counted_from..record.counted_to;
        let (mut left, mut all) = (0.0, 0.0);
        for (reading, modelled) in record
            .readings
            .iter()
            .zip(problem.modelled(&model.stage, n))
        {
            let error = |k: usize| reading[k] - modelled[k];
            left += rms_about_mean(&counted.clone().map(error).collect::<Vec<f64>>()).powi(2);
            all += rms_about_mean(&reading[counted.clone()]).powi(2);
        }
        RecordError {
            record: record.name.clone(),
            role: record.role.name(),
            error_pct: 100.0 * (left / all).sqrt(),
        }
    };
    (0..data.records.len()).map(of_record).collect()
}
