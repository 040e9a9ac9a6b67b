//! The predictor law in f64, with the hysteresis inverted by bisection: an oracle for the integer servo.
//!
//! Nothing here is used by a design or a run; [`integer_difference_um`] plays the same experiment with the
//! same noise on both.

use crate::bench_runs::{SUBSTEPS, run};
use hysteron::servo::design::{Scheme, ServoDesign};
use hysteron::servo::law::PredictorDesign;
use hysteron::servo::model::SAMPLING_PERIOD_S;
use hysteron::servo::quantise::QuantisationError;
use hysteron_core::codes::{DriveCode, SensorCode};
use hysteron_core::reference_window::{OFFSET_DECAY_SHIFT, PREVIEW_TICKS, WINDOW};
use hysteron_sim::bench::{Bench, Variant};
use hysteron_sim::closed_loop::{Controller, ErrorFigures, Experiment};
use hysteron_sim::converter_scale::ConverterScale;
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

/// The law in f64, with what it remembers.
struct FloatPredictor<'a> {
    design: &'a ServoDesign,
    law: &'a PredictorDesign,
    scale: ConverterScale,
    hysteresis: OneSidedHysteresis,
    acting_v: f64,
    applied_um: f64,
    window: Vec<f64>,
    offset_um: f64,
    state: DVector<f64>,
    feedforward_um: f64,
    rounding_error_v: f64,
}

impl<'a> FloatPredictor<'a> {
    fn new(design: &'a ServoDesign, law: &'a PredictorDesign, scale: ConverterScale) -> Self {
        let model = &design.model;
        Self {
            design,
            law,
            scale,
            hysteresis: OneSidedHysteresis::virgin(
                model.surfaces(),
                model.drive_min_v,
                model.drive_max_v - model.drive_min_v,
            ),
            acting_v: scale.drive_min_v,
            applied_um: 0.0,
            window: Vec::new(),
            offset_um: 0.0,
            state: DVector::zeros(law.b.len()),
            feedforward_um: 0.0,
            rounding_error_v: 0.0,
        }
    }

    fn apply(&mut self, code: DriveCode) -> DriveCode {
        self.acting_v = self.scale.drive_v(code);
        self.applied_um = self.hysteresis.step(self.acting_v);
        code
    }
}

impl Controller for FloatPredictor<'_> {
    fn open_loop(&mut self, dac_code: DriveCode) -> DriveCode {
        self.apply(dac_code)
    }

    fn take_scale(&mut self, scale: &ConverterScale) {
        self.scale = *scale;
    }

    fn enable(&mut self) {}

    fn drive_v(&self) -> f64 {
        self.acting_v
    }

    fn delayed(&self) -> bool {
        true
    }

    fn tick(&mut self, adc_code: SensorCode, ahead_um: f64) -> DriveCode {
        let reading_um = self.scale.position_um(adc_code);
        let first = self.window.is_empty();
        if first {
            self.window = vec![reading_um; WINDOW];
            self.offset_um = reading_um - ahead_um;
        }
        self.window.remove(0);
        self.window.push(ahead_um + self.offset_um);
        self.offset_um *= 1.0 - 2.0_f64.powi(-(OFFSET_DECAY_SHIFT as i32));
        let next_feedforward_um: f64 = self
            .law
            .feedforward
            .iter()
            .zip(&self.window)
            .map(|(f, r)| f * r)
            .sum();
        let n = self.state.len();
        let code = if first {
            self.state[n - 1] = next_feedforward_um - self.applied_um;
            self.scale.dac_code(self.acting_v)
        } else {
            let innovation =
                reading_um - self.window[WINDOW - 1 - PREVIEW_TICKS] - self.law.c.dot(&self.state);
            self.state = &self.law.a * &self.state
                + &self.law.l * innovation
                + &self.law.b * (self.applied_um - self.feedforward_um);
            let command_um = next_feedforward_um - self.law.k.dot(&self.state);
            let carried_v = if self.design.noise_shaping {
                self.rounding_error_v
            } else {
                0.0
            };
            let wanted_v = inverse_v(
                &self.hysteresis,
                command_um,
                self.scale.drive_min_v,
                self.scale.drive_max_v,
            ) + carried_v;
            let code = self.scale.dac_code(wanted_v);
            self.rounding_error_v = wanted_v - self.scale.drive_v(code);
            code
        };
        self.feedforward_um = next_feedforward_um;
        self.apply(code)
    }
}

/// Difference of what the sensor reads, integer servo against the same law in f64, after the first half
/// second, um. Both see the same noise. `None` for schemes other than the predictor.
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
    let Scheme::Predictor {
        tuning,
        hysteresis_inverse: true,
    } = &design.scheme
    else {
        return Ok(None);
    };
    let law = PredictorDesign::new(&design.model.linear, tuning);
    let integer = run(bench, variant, design, reference_um, seed)?;
    let experiment = Experiment {
        substeps: SUBSTEPS,
        ..Experiment::new(bench, variant, seed)
    };
    let float = experiment.follow_with(
        FloatPredictor::new(design, &law, bench.converter_scale()),
        reference_um,
    );
    let from = (0.5 / SAMPLING_PERIOD_S) as usize;
    Ok(Some(ErrorFigures::between(
        &integer.sensor_um,
        &float.sensor_um,
        from.min(float.sensor_um.len() / 2),
    )))
}
