//! The unmodified image runs a PIDSMOC in predictor form: what it reads and drives over 100 000 ticks is what
//! the host's simulation of the same core and plant gives, to the last bit.

use crate::common::{
    assert_same_bits, best_parameters, block, host_run, last_status, lines, number, run_paced,
    samples,
};

use hysteron::servo::model::{LinearModel, ModeModel, NominalModel, SAMPLING_PERIOD_S};
use hysteron::servo::plant_set::PlantVariation;
use hysteron::servo::sampled_loop::SampledLoop;
use hysteron::servo::sliding_mode::{SlidingFamily, SlidingKind, SlidingTuning};
use hysteron::servo::thesis_schemes::SlidingModeLaw;
use hysteron_core::parameter_block::AmplifierParameters;
use hysteron_core::servo_parameters::LawParameters;
use hysteron_emulator::converters::World;
use hysteron_emulator::run::{MILLISECOND, Script};
use hysteron_sim::bench::{Bench, Variant};

const FIRST_TICK: u32 = 22_300;
const TICKS_UNDER_CONTROL: u32 = 100_000;
/// What guard, reference, servo and sample of a tick may take, in instructions: at most, and on the mean.
/// The most is the tick that takes over the loop.
const LIMITS: (u64, u64) = (4_300, 1_150);

/// The block of the other tests, its law replaced by a PIDSMOC for the thesis' mode; the hysteresis stays
/// inverted behind it.
fn pidsmoc() -> AmplifierParameters {
    let nominal = NominalModel::THESIS;
    let mode = ModeModel {
        natural_frequency_rad_s: nominal.natural_frequency_rad_s,
        damping_ratio: nominal.damping_ratio,
    };
    let linear = LinearModel {
        first_mode: mode,
        second_mode: None,
        amplifier_bandwidth_hz: None,
        sensor_bandwidth_hz: None,
        period_s: SAMPLING_PERIOD_S,
    };
    // Stable with half the gain and half as much again, a period more of delay and twice the mass; the
    // assertion below checks the first three.
    let tuning = SlidingTuning {
        m: 3100.0,
        reaching: (5400.0, 0.8),
        estimator: (8000.0, 0.7),
        unknown_rate: 1800.0,
    };
    let family = SlidingFamily {
        kind: SlidingKind::Pidsmoc,
        nominal,
        unknown_bound_v: 0.0,
    };
    let (estimator, controller, reaching) = family.gains(&tuning);
    let law = SlidingModeLaw::predicted(&nominal, &estimator, &controller, &reaching);
    let closing = law.as_predictor().expect("linear");
    let varied = [
        PlantVariation::NONE,
        PlantVariation::with_gain(0.5),
        PlantVariation::with_gain(1.5),
        PlantVariation::with_delay_s(SAMPLING_PERIOD_S),
    ];
    let plants = varied.map(|variation| variation.sampled(&linear));
    assert!(
        plants
            .iter()
            .all(|plant| SampledLoop::new(&closing, plant).is_stable())
    );
    let mut out = best_parameters();
    out.physical.spectral_radius_millionths =
        (1e6 * SampledLoop::new(&closing, &plants[0]).spectral_radius()).ceil() as u32;
    out.servo.law = law.following(&linear).quantised().expect("fits");
    out
}

#[test]
fn a_pidsmoc_agrees_with_the_host_to_the_last_bit() {
    let bench = Bench::reference().expect("the bench");
    let parameters = pidsmoc();
    assert!(
        matches!(&parameters.servo.law, LawParameters::SlidingMode { controller, .. } if controller.prediction.is_some())
    );
    // A step, then a sine of 5 um that goes on to the end.
    let commands = [
        (99, "arm untested"),
        (100, "condition"),
        (FIRST_TICK, "reference sine 10000 5000 5600"),
        (FIRST_TICK + 1, "enable"),
        (
            FIRST_TICK + TICKS_UNDER_CONTROL / 2,
            "reference sine 100000 5000 5600",
        ),
    ];
    let ticks = FIRST_TICK + TICKS_UNDER_CONTROL;
    let world = World::new(&bench, Variant::FULL, 7).shared();
    let script = Script {
        block: Some(block(&parameters)),
        commands: vec![
            (
                2 * MILLISECOND,
                [b"trace 31 1\n".to_vec(), lines(&commands)].concat(),
            ),
            (u64::from(ticks) * 50_000, b"status\n".to_vec()),
        ],
        ..Script::listening(u64::from(ticks) * 50_000 + 20 * MILLISECOND)
    };
    let outcome = run_paced(&world, script);
    let (target, lost) = samples(&outcome);
    assert_eq!((lost, outcome.malformed, outcome.resets), (0, 0, 0));
    let mut twin = World::new(&bench, Variant::FULL, 7);
    let host = host_run(&parameters, &mut twin, &commands, ticks as usize);
    assert_same_bits(&target, &host);
    let status = last_status(&outcome);
    let number = |name| number(status, name);
    println!(
        "{} ticks under control; {} instructions at most, {} on the mean",
        TICKS_UNDER_CONTROL,
        number("most_tick_cycles"),
        number("recent_tick_cycles")
    );
    assert!(
        number("most_tick_cycles") <= LIMITS.0 && number("recent_tick_cycles") <= LIMITS.1,
        "{status}"
    );
}
