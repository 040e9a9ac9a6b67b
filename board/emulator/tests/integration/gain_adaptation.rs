//! The unmodified image corrects the gain of its model: what it reads and drives is what the host's
//! simulation of the same core and plant gives, to the last bit, the error falls, and the serial port tells
//! the gain.

use crate::common;

use common::{
    SineRun, assert_texts, best_parameters, block, learning, lines, run_on, typed_back, wrong_gain,
};
use hysteron_core::gain_adaptation::ONE;
use hysteron_core::parameter_block::AmplifierParameters;
use hysteron_core::trace_frame::TraceSample;
use hysteron_emulator::converters::World;
use hysteron_emulator::run::{MILLISECOND, Outcome, Script};
use hysteron_sim::bench::{Bench, Variant};

const TICKS: u32 = 60_000;
/// What was asked minus what was read over the last quarter of a second, nm RMS.
fn error_nm(samples: &[TraceSample], parameters: &AmplifierParameters, zero: f64) -> f64 {
    let step = parameters.servo.converters.adc_step as f64 / 2f64.powi(40);
    let last = &samples[samples.len() - 5000..];
    let square = |s: &TraceSample| {
        (f64::from(s.reference) / f64::from(1 << 24) - (f64::from(s.adc_code) * step - zero))
            .powi(2)
    };
    1e3 * (last.iter().map(square).sum::<f64>() / last.len() as f64).sqrt()
}

/// What `DIA? 16` was answered.
fn gains(outcome: &Outcome) -> Vec<f64> {
    let text: String = typed_back(outcome);
    text.lines()
        .map(|line| {
            line.trim()
                .strip_prefix("16=")
                .and_then(|number| number.parse().ok())
                .expect("a gain")
        })
        .collect()
}

#[test]
fn an_alarm_of_the_resonance_holds_the_gain_where_it_is() {
    let bench = Bench::reference().expect("the bench");
    let mut parameters = wrong_gain(true);
    // So slowly that a second is not enough.
    parameters.servo.adaptation.as_mut().expect("on").most_step = ONE / 400;
    let commands = [
        (99, "arm untested"),
        (100, "conditioning waived"),
        (300, "reference sine 125000 2000 5600"),
        (310, "enable"),
    ];
    let world = World::new(&bench, Variant::FULL, 7).shared();
    // The first second ends near tick 20,310; the error at 125 Hz is then still an alarm.
    let asked = [16_000, 22_000, 29_000].map(|tick: u64| tick * 50_000);
    let first = [b"resonance 125000 2\n".to_vec(), lines(&commands)].concat();
    let script = Script {
        block: Some(block(&parameters)),
        commands: vec![(2 * MILLISECOND, first)],
        serial: asked
            .iter()
            .map(|at| (*at, b"DIA? 16\n".to_vec()))
            .collect(),
        ..Script::listening(30_000 * 50_000)
    };
    let outcome = run_on(&world, script);
    assert_texts(&outcome, "above the alarm", 1);
    let [before, held, later] = gains(&outcome)[..] else {
        panic!("three answers")
    };
    println!("DIA? 16: {before} {held} {later}");
    assert!(
        before > 1_002_000.0 && held > before,
        "it learns until the alarm: {before} {held}"
    );
    assert!(
        held == later && held < 1_100_000.0,
        "and not behind it: {held} {later}"
    );
}

#[test]
fn the_gain_that_is_learned_agrees_with_the_host_to_the_last_bit() {
    let bench = Bench::reference().expect("the bench");
    let parameters = wrong_gain(true);
    let sine = SineRun::new(
        &bench,
        &parameters,
        "reference sine 125000 3000 4000",
        TICKS,
    );
    let outcome = sine.on_target(b"DIA? 16\n");
    let adapted = sine.assert_equal(&outcome);
    // And it has learned something: against the same servo that does not, and against the one whose model is
    // right.
    let zero = sine.zero_um(&adapted);
    let error = |samples: &[TraceSample]| error_nm(samples, &parameters, zero);
    let (before, after, right) = (
        error(&sine.on_host(&wrong_gain(false))),
        error(&adapted),
        error(&sine.on_host(&best_parameters())),
    );
    println!(
        "what was asked minus read: {before:.2} nm with the wrong gain, {after:.2} nm adapted, {right:.2} nm with the right one"
    );
    assert!(
        after < 1.05 * right && before > 3.0 * right,
        "{before} {after} {right}"
    );
    let [millionths] = gains(&outcome)[..] else {
        panic!("one answer")
    };
    println!("DIA? 16: {millionths}");
    assert!(
        (millionths / 1e6 * f64::from(common::MODEL_HUNDREDTHS) / 100.0 - 1.0).abs() < 0.02,
        "{millionths}"
    );
}

#[test]
fn a_gain_and_a_correction_are_learned_together() {
    let bench = Bench::reference().expect("the bench");
    let parameters = learning(wrong_gain(true));
    // 160 ticks: eight points of the reference's period fall into every mean of what the gain is learned
    // from.
    let sine = SineRun::new(
        &bench,
        &parameters,
        "reference sine 125000 3000 4000",
        TICKS,
    );
    let outcome = sine.on_target(b"DIA? 16\n");
    let both = sine.assert_equal(&outcome);
    let zero = sine.zero_um(&both);
    let error = |samples: &[TraceSample]| error_nm(samples, &parameters, zero);
    let (gain, correction) = (
        error(&sine.on_host(&wrong_gain(true))),
        error(&sine.on_host(&learning(wrong_gain(false)))),
    );
    let (right, both) = (
        error(&sine.on_host(&learning(best_parameters()))),
        error(&both),
    );
    println!(
        "what was asked minus read: gain alone {gain:.2} nm, correction alone {correction:.2} nm, both {both:.2} nm, right gain and correction {right:.2} nm"
    );
    let [millionths] = gains(&outcome)[..] else {
        panic!("one answer")
    };
    println!("DIA? 16: {millionths}");
    // The correction takes nothing from what the gain is learned from.
    assert!(
        (millionths / 1e6 * f64::from(common::MODEL_HUNDREDTHS) / 100.0 - 1.0).abs() < 0.02,
        "{millionths}"
    );
    assert!(
        both < 1.05 * right && both < 1.05 * gain.min(correction),
        "{both} {right} {gain} {correction}"
    );
}
