//! The unmodified image learns the correction of a periodic reference: what it reads and drives is what the
//! host's simulation of the same core and plant gives, to the last bit, and the error falls.

use crate::common;

use common::{SineRun, best_parameters, learning};
use hysteron_core::learned_feedforward::{
    LEARNING_FRACTION_BITS, LEARNING_TAPS, ROBUSTNESS_FRACTION_BITS, ROBUSTNESS_TAPS,
};
use hysteron_core::parameter_block::AmplifierParameters;
use hysteron_core::trace_frame::TraceSample;
use hysteron_sim::bench::Bench;
use std::f64::consts::TAU;

const TICKS: u32 = 28_000;
/// 125 Hz.
const PERIOD_TICKS: usize = 160;

/// Periods over which an error is averaged.
const PERIODS: usize = 20;

/// The fundamental (cosine, sine) of what was asked minus what was read, nm: over the last periods, so that
/// most of the sensor's noise is out of it.
fn fundamental_nm(
    samples: &[TraceSample],
    parameters: &AmplifierParameters,
    zero: f64,
) -> [f64; 2] {
    let step = parameters.servo.converters.adc_step as f64 / 2f64.powi(40);
    let last = &samples[samples.len() - PERIODS * PERIOD_TICKS..];
    let scale = 2e3 / last.len() as f64;
    last.iter()
        .enumerate()
        .fold([0.0; 2], |[cosine, sine], (k, s)| {
            let (sin, cos) = (TAU * (k % PERIOD_TICKS) as f64 / PERIOD_TICKS as f64).sin_cos();
            let error =
                f64::from(s.reference) / f64::from(1 << 24) - (f64::from(s.adc_code) * step - zero);
            [cosine + scale * error * cos, sine + scale * error * sin]
        })
}

/// What is left of a fundamental when all is learned, over the one without: `(1 - Q) / (1 - Q + Q L T)`. The
/// loop follows the reference but for that error, a thousandth of it, and a correction enters where the
/// reference does: `T` is 1.
fn left(parameters: &AmplifierParameters) -> f64 {
    let learning = parameters.servo.learning.expect("it learns");
    let response = |taps: &[i32], point: usize, fraction_bits: u32| -> f64 {
        let turn = |i: usize| TAU * (i as f64 - point as f64) / PERIOD_TICKS as f64;
        taps.iter()
            .enumerate()
            .map(|(i, c)| f64::from(*c) / f64::from(1u32 << fraction_bits) * turn(i).cos())
            .sum()
    };
    let l = response(
        &learning.learning.coefficients,
        LEARNING_TAPS / 2 - 1,
        LEARNING_FRACTION_BITS,
    );
    let q = response(
        &learning.robustness.coefficients,
        ROBUSTNESS_TAPS / 2,
        ROBUSTNESS_FRACTION_BITS,
    );
    (1.0 - q) / (1.0 - q + q * l)
}

#[test]
fn what_is_learned_agrees_with_the_host_to_the_last_bit() {
    let bench = Bench::reference().expect("the bench");
    let parameters = learning(best_parameters());
    let sine = SineRun::new(
        &bench,
        &parameters,
        "reference sine 125000 5000 5600",
        TICKS,
    );
    let learned = sine.assert_equal(&sine.on_target(b""));
    // And it has learned something: against the same servo that does not.
    let without = sine.on_host(&best_parameters());
    let zero = sine.zero_um(&learned);
    let fundamental = |samples: &[TraceSample]| fundamental_nm(samples, &parameters, zero);
    let (before, after) = (fundamental(&without), fundamental(&learned));
    let predicted = before.map(|part| left(&parameters) * part);
    let size = |[cosine, sine]: [f64; 2]| f64::hypot(cosine, sine);
    println!(
        "the fundamental of what was asked minus read: {:.2} nm without learning, {:.2} nm with it, {:.2} nm predicted",
        size(before),
        size(after),
        size(predicted)
    );
    // Of white noise of 1 um a fundamental over so many samples has sqrt(4 / n) RMS; learning adds less than
    // as much again.
    let noise_nm =
        1e3 * bench.converters.sensor_noise_um * (4.0 / (PERIODS * PERIOD_TICKS) as f64).sqrt();
    let missed = size([after[0] - predicted[0], after[1] - predicted[1]]);
    assert!(missed < 4.0 * noise_nm, "{missed} {noise_nm}");
    assert!(
        size(before) - size(predicted) > 4.0 * noise_nm,
        "learning nothing would be seen: {before:?}"
    );
}
