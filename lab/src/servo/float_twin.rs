//! The predictor law in f64, with the hysteresis inverted by bisection: an oracle for the integer servo.
//!
//! Nothing here is used by a design or a run; [`integer_difference_um`] plays the same experiment with the same noise on both.

use super::design::{Scheme, ServoDesign};
use super::model::SAMPLING_PERIOD_S;
use super::predictor::PredictorDesign;
use super::quantise::QuantisationError;
use super::reproduce;
use hysteron_core::reference_window::{OFFSET_DECAY_SHIFT, PREVIEW_TICKS, WINDOW};
use hysteron_sim::bench::{Bench, Sensor, Variant};
use hysteron_sim::closed_loop::ErrorFigures;
use hysteron_sim::hysteresis_surface::OneSidedHysteresis;
use nalgebra::DVector;

/// The drive that gives `target_um`, by bisection on copies of the hysteresis.
fn inverse_v(hysteresis: &OneSidedHysteresis, target_um: f64, low_v: f64, high_v: f64) -> f64 {
    let output = |u: f64| hysteresis.clone().step(u);
    let (mut low, mut high) = (low_v, high_v);
    for _ in 0..40 {
        let middle = 0.5 * (low + high);
        if output(middle) < target_um {
            low = middle;
        } else {
            high = middle;
        }
    }
    0.5 * (low + high)
}

/// What the sensor reads, noise removed, when the f64 law follows a reference.
fn follow_float(
    bench: &Bench,
    variant: Variant,
    design: &ServoDesign,
    tuning_law: &PredictorDesign,
    reference_um: &[f64],
    seed: u64,
) -> Vec<f64> {
    let model = &design.model;
    let range_v = model.drive_max_v - model.drive_min_v;
    let mut hysteresis = OneSidedHysteresis::virgin(model.surfaces(), model.drive_min_v, range_v);
    let mut plant = bench.plant_with_substeps(variant, reproduce::SUBSTEPS);
    let mut applied_um = 0.0;
    let mut acting_v = bench.drive_min_v;
    for drive_v in bench.conditioning_drive_v() {
        acting_v = bench.drive_after_converter_v(drive_v);
        applied_um = hysteresis.step(acting_v);
        plant.tick(acting_v);
    }
    let zero_um = plant.sensor_um();
    let mut sensor = Sensor::new(bench, zero_um, seed);
    let mut window = Vec::new();
    let mut offset = 0.0;
    let n = tuning_law.b.len();
    let mut z = DVector::<f64>::zeros(n);
    let mut feedforward = 0.0;
    let mut rounding_error_v = 0.0;
    let mut out = Vec::with_capacity(reference_um.len());
    for k in 0..reference_um.len() {
        out.push(plant.sensor_um() - zero_um);
        let reading = sensor.read(&plant);
        let ahead = reference_um.get(k + PREVIEW_TICKS).or(reference_um.last()).copied().unwrap_or(0.0);
        let fresh = window.is_empty();
        if fresh {
            window = vec![reading; WINDOW];
            offset = reading - ahead;
        }
        window.remove(0);
        window.push(ahead + offset);
        offset *= 1.0 - 2.0_f64.powi(-(OFFSET_DECAY_SHIFT as i32));
        let next_feedforward: f64 = tuning_law.feedforward.iter().zip(&window).map(|(f, r)| f * r).sum();
        let next_v = if fresh {
            z[n - 1] = next_feedforward - applied_um;
            acting_v
        } else {
            let innovation = reading - window[WINDOW - 1 - PREVIEW_TICKS] - tuning_law.c.dot(&z);
            z = &tuning_law.a * &z + &tuning_law.l * innovation + &tuning_law.b * (applied_um - feedforward);
            let command = next_feedforward - tuning_law.k.dot(&z);
            let wanted = inverse_v(&hysteresis, command, model.drive_min_v, model.drive_max_v)
                + if design.noise_shaping { rounding_error_v } else { 0.0 };
            let applied_v = bench.drive_after_converter_v(wanted);
            rounding_error_v = wanted - applied_v;
            applied_v
        };
        feedforward = next_feedforward;
        plant.tick(acting_v);
        acting_v = next_v;
        applied_um = hysteresis.step(acting_v);
    }
    out
}

/// Difference of what the sensor reads, integer servo against the same law in f64, after the first half second, um. Both see the same noise.
/// `None` for schemes other than the predictor.
///
/// # Errors
/// If the design does not fit the tick's formats.
pub fn integer_difference_um(
    bench: &Bench,
    variant: Variant,
    design: &ServoDesign,
    reference_um: &[f64],
    seed: u64,
) -> Result<Option<ErrorFigures>, QuantisationError> {
    let Scheme::Predictor { tuning, hysteresis_inverse: true } = &design.scheme else { return Ok(None) };
    let law = PredictorDesign::new(&design.model.linear, tuning);
    let integer = reproduce::run(bench, variant, design, reference_um, seed)?;
    let float = follow_float(bench, variant, design, &law, reference_um, seed);
    let from = (0.5 / SAMPLING_PERIOD_S) as usize;
    Ok(Some(ErrorFigures::between(&integer.sensor_um, &float, from.min(float.len() / 2))))
}
