//! The output path is closed: the amplifier's voltage monitor and the register of the drive's converter are
//! compared with the code at every tick, and what differs switches the power stage off at once. And
//! filters: the loop with all of it on gives the host's bits.

use crate::common;

use common::{
    SineRun, assert_texts, best_parameters, block, last_status, lines, number, parameters, run_on,
    run_paced, samples, texts, typed_back, world,
};
use hysteron_core::amplifier::Amplifier;
use hysteron_core::amplifier_command::Command;
use hysteron_core::filter_design::{FilterSetting, Notch};
use hysteron_core::guard::Fault;
use hysteron_core::kept_settings::{self, KeptSettings, SETTINGS_BYTES};
use hysteron_core::loop_telemetry::ResonanceWatch;
use hysteron_core::parameter_block::AmplifierParameters;
use hysteron_core::signal_filter::{FilteredSignal, Place};
use hysteron_emulator::converters::{OutputTrouble, PERIOD_NS, SharedWorld, World};
use hysteron_emulator::run::{MILLISECOND, Outcome, Script, envelope_bytes, watched_envelope};
use hysteron_sim::bench::{Bench, Variant};

/// The edge at which something goes wrong: the sine is played since tick 2400.
const TROUBLE_EDGE: u64 = 4_000;

/// A sine of 10 V around 20 V is played from 120 ms on; what happens to the output is in the world.
fn played(world: &SharedWorld) -> Outcome {
    let script = Script {
        block: Some(block(&parameters())),
        envelope: Some(envelope_bytes(&watched_envelope())),
        monitored: Some(world.clone()),
        commands: vec![
            (4 * MILLISECOND, b"arm untested\n".to_vec()),
            (
                120 * MILLISECOND,
                b"play sine 10000 10000 20000 20000\n".to_vec(),
            ),
        ],
        ..Script::listening(260 * MILLISECOND)
    };
    run_on(world, script)
}

/// That the fault is named, and the power stage off within 2 ms of the trouble: a look at it every
/// millisecond.
fn assert_switched_off(world: &SharedWorld, outcome: &Outcome, fault: &str) {
    let named = format!("mode fault: {fault}");
    assert_texts(outcome, &named, 1);
    let begun = world.lock().expect("the world").began_ns();
    let off = outcome.enabled.last().copied();
    let after_ns = off.map(|(at, _)| at as i64 - (begun + TROUBLE_EDGE * PERIOD_NS) as i64);
    println!(
        "{fault}: power stage off {} us behind the trouble",
        after_ns.unwrap_or(i64::MAX) / 1000
    );
    assert!(
        matches!(off, Some((_, false))) && after_ns.is_some_and(|ns| ns < 2 * MILLISECOND as i64),
        "{off:?} {after_ns:?}"
    );
}

#[test]
fn an_output_that_follows_is_no_fault() {
    let outcome = played(&world());
    assert_texts(&outcome, "mode fault", 0);
    assert_eq!(
        outcome
            .enabled
            .iter()
            .map(|(_, on)| *on)
            .collect::<Vec<_>>(),
        [true],
        "{:?}",
        texts(&outcome)
    );
}

#[test]
fn an_amplifier_with_another_gain_is_switched_off() {
    // Half of the gain; a block made for an amplifier of 10 in front of one of 15; none at all.
    for gain in [0.5, 1.5, 0.0] {
        let world = world();
        world.lock().expect("the world").output_trouble =
            Some((TROUBLE_EDGE, OutputTrouble::Gain(gain)));
        assert_switched_off(
            &world,
            &played(&world),
            "output of the amplifier is not the drive",
        );
    }
}

#[test]
fn an_open_cable_of_the_monitor_is_named() {
    let world = world();
    world.lock().expect("the world").output_trouble =
        Some((TROUBLE_EDGE, OutputTrouble::CableOpen));
    assert_switched_off(&world, &played(&world), "voltage monitor out of range");
}

#[test]
fn a_relay_that_is_welded_is_found_before_the_power_stage_is_switched_on() {
    let arms = |trouble: Option<OutputTrouble>| {
        let world = world();
        world.lock().expect("the world").output_trouble = trouble.map(|trouble| (0, trouble));
        let script = Script {
            block: Some(block(&parameters())),
            envelope: Some(envelope_bytes(&watched_envelope())),
            monitored: Some(world.clone()),
            serial: vec![
                (40 * MILLISECOND, b"ARM 1 1\n".to_vec()),
                (220 * MILLISECOND, b"DIA? 2\n".to_vec()),
            ],
            ..Script::listening(270 * MILLISECOND)
        };
        let outcome = run_on(&world, script);
        let on: Vec<u64> = outcome
            .enabled
            .iter()
            .map(|(at, _)| at / MILLISECOND)
            .collect();
        (typed_back(&outcome), on)
    };
    assert_eq!(
        arms(Some(OutputTrouble::RelayWelded)),
        (format!("2={}\n", Fault::OutputWhileOff as u8), vec![])
    );
    let (answer, on) = arms(None);
    assert_eq!(answer, "2=0\n");
    assert!(
        matches!(on[..], [235..=255]),
        "0.1 s at either place, then on: {on:?}"
    );
}

#[test]
fn a_register_that_keeps_another_code_is_named() {
    let world = world();
    world.lock().expect("the world").register_stuck_from = Some(TROUBLE_EDGE);
    assert_switched_off(
        &world,
        &played(&world),
        "drive's converter holds another code",
    );
}

/// Notches and low-passes on both signals, at the same shares of the sampling rate.
fn filters(sample_rate_hz: u32) -> [FilterSetting; 2] {
    let millihertz = |at_20_khz: u32| at_20_khz * (sample_rate_hz / 20);
    let notch = |hz: u32, width_hz: u32| Notch {
        frequency_millihertz: millihertz(hz),
        width_millihertz: millihertz(width_hz),
    };
    [
        FilterSetting {
            notches: [notch(852, 60), notch(2_500, 100)],
            low_pass_millihertz: millihertz(3_000),
        },
        FilterSetting {
            notches: [notch(4_000, 200), notch(8_500, 200)],
            low_pass_millihertz: millihertz(9_000),
        },
    ]
}

/// The host's amplifier with these filters.
pub fn amplifier_with_filters(parameters: &AmplifierParameters) -> Amplifier {
    let (mut amplifier, rate_hz) = (
        Amplifier::new(*parameters),
        parameters.physical.sample_rate_hz,
    );
    for (signal, setting) in [FilteredSignal::SetPoint, FilteredSignal::Sensor]
        .into_iter()
        .zip(filters(rate_hz))
    {
        for place in Place::ALL {
            let row = setting.row(place, rate_hz).expect("within the limits");
            amplifier
                .command(Command::Filter { signal, place, row })
                .expect("accepted");
        }
    }
    amplifier
}

/// What the board has in its flash of these filters.
pub fn kept_filters(parameters: &AmplifierParameters) -> Vec<u8> {
    let settings = KeptSettings {
        stage: parameters.physical.name,
        velocity: 100 << 24,
        tolerance: 1 << 18,
        settling_us: 5_000,
        host_timeout_ms: 0,
        largest_move: 0,
        largest_drive_step: 0,
        baud: 115_200,
        watch: ResonanceWatch::default(),
        filters: filters(parameters.physical.sample_rate_hz),
    };
    let mut bytes = [0xFF; SETTINGS_BYTES];
    kept_settings::write(&settings, &mut bytes).expect("room");
    bytes.to_vec()
}

/// With all six sections, the monitor and the register read back: 1,538 measured. Images of the same sources
/// differ between machines.
const MOST_TICK_INSTRUCTIONS: u64 = 1_570;
/// Instructions of a tick on the mean.
const MEAN_TICK_INSTRUCTIONS: u64 = 1_300;

#[test]
fn the_loop_with_filters_monitor_and_read_back_gives_the_hosts_bits() {
    let bench = Bench::reference().expect("the bench");
    let parameters = best_parameters();
    let (first, ticks) = (22_300, 30_000);
    let commands = [
        (99, "arm untested"),
        (100, "condition"),
        (first, "reference sine 50000 5000 5600"),
        (first + 1, "enable"),
    ];
    let world = World::new(&bench, Variant::FULL, 7).shared();
    let end = u64::from(ticks) * PERIOD_NS;
    let script = Script {
        block: Some(block(&parameters)),
        envelope: Some(envelope_bytes(&watched_envelope())),
        kept: Some(kept_filters(&parameters)),
        monitored: Some(world.clone()),
        commands: vec![
            (
                2 * MILLISECOND,
                [b"trace 31 1\n".to_vec(), lines(&commands)].concat(),
            ),
            (
                u64::from(first) * PERIOD_NS + 20 * MILLISECOND,
                b"status\n".to_vec(),
            ),
            (end, b"status\n".to_vec()),
        ],
        serial: vec![(end, b"SPA? 1 0x7F000020 1 0x7F000034\n".to_vec())],
        ..Script::listening(end + 30 * MILLISECOND)
    };
    let outcome = run_paced(&world, script);
    let (target, lost) = samples(&outcome);
    assert_eq!(
        (lost, outcome.malformed, outcome.resets),
        (0, 0, 0),
        "{:?}",
        texts(&outcome)
    );

    let mut twin = World::new(&bench, Variant::FULL, 7);
    let host = common::host_run_of(
        amplifier_with_filters(&parameters),
        &mut twin,
        &commands,
        ticks as usize,
    );
    common::assert_same_bits(&target, &host);
    let unfiltered = SineRun::new(&bench, &parameters, "reference sine 50000 5000 5600", ticks)
        .on_host(&parameters);
    assert_ne!(host, unfiltered, "the filters are on");

    let answers: String = typed_back(&outcome);
    assert_eq!(answers, "1 0x7f000020=852.000 \n1 0x7f000034=9000.000\n");
    let status = last_status(&outcome);
    let number = |name| number(status, name);
    println!(
        "tick with six sections: {} instructions at most, {} on the mean; slowest interrupt {} instructions behind its edge",
        number("most_tick_cycles"),
        number("recent_tick_cycles"),
        (number("slowest_counts") - 200) * 2
    );
    assert_eq!(
        (number("lost_samples"), number("overruns")),
        (0, 0),
        "{status}"
    );
    assert!(
        number("most_tick_cycles") <= MOST_TICK_INSTRUCTIONS
            && number("recent_tick_cycles") <= MEAN_TICK_INSTRUCTIONS,
        "{status}"
    );
}
