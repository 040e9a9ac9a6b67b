//! What the board reads beside the sensor, the analogue set point and temperatures, and its lights.

use crate::common;

use common::{best_parameters, block, run_on, samples, typed_back};
use hysteron_core::safety_envelope::SafetyEnvelope;
use hysteron_emulator::converters::World;
use hysteron_emulator::run::{
    Injection, MILLISECOND, Outcome, Script, bench_envelope, envelope_bytes,
};
use hysteron_sim::bench::{Bench, Variant};

/// -1 to 14 um over 3.3 V, of which 1 to 8 um may be reached.
fn wired() -> SafetyEnvelope {
    SafetyEnvelope {
        set_point_at_code_0_nm: -1_000,
        set_point_span_nm: 15_000,
        set_point_min_nm: 1_000,
        set_point_max_nm: 8_000,
        amplifier_at_code_0_decicelsius: -500,
        amplifier_span_decicelsius: 3_300,
        amplifier_most_decicelsius: 700,
        ..bench_envelope()
    }
}

/// The sensor of the amplifier's temperature gives 10 mV a degree, 0 V at -50.
fn amplifier_at(ms: u64, celsius: u32) -> (u64, Injection) {
    let millivolts = (celsius + 50) * 10;
    (ms, Injection::AmplifierTemperature { millivolts })
}

/// mV of a position.
fn millivolts(um: f64) -> u32 {
    ((um + 1.0) / 15.0 * 3300.0).round() as u32
}

fn observed(serial: &[(u64, &str)], injections: &[(u64, Injection)], until_ms: u64) -> Outcome {
    let world = World::new(&Bench::reference().expect("the bench"), Variant::FULL, 3).shared();
    let script = Script {
        block: Some(block(&best_parameters())),
        envelope: Some(envelope_bytes(&wired())),
        commands: vec![(2 * MILLISECOND, b"trace 31 1\n".to_vec())],
        serial: serial
            .iter()
            .map(|(ms, lines)| (ms * MILLISECOND, format!("{lines}\n").into_bytes()))
            .collect(),
        injections: injections
            .iter()
            .map(|(ms, injection)| (ms * MILLISECOND, *injection))
            .collect(),
        ..Script::listening(until_ms * MILLISECOND)
    };
    run_on(&world, script)
}

/// The first numbers behind a name in the answers.
fn values(answers: &str, name: &str) -> Vec<f64> {
    answers
        .lines()
        .filter_map(|line| line.trim().strip_prefix(name)?.parse().ok())
        .collect()
}

#[test]
fn a_set_point_is_followed_limited_and_missed_when_it_is_open() {
    let at = |ms, um| {
        (
            ms,
            Injection::SetPoint {
                millivolts: millivolts(um),
            },
        )
    };
    let outcome = observed(
        &[
            (
                40,
                "RON 1 0\nSPA 1 0x06000500 3\nERR?\nARM 1 2\nSVO 1 1\nVEL 1 500",
            ),
            (50, "SPA 1 0x06000500 3\nERR?"),
            (110, "POS? 1\nDIA? 19"),
            (170, "POS? 1\nDIA? 19\nTAD? 3"),
            (210, "DIA? 2\nLOG?"),
            (290, "INI 1\nERR?\nSPA 1 0x06000500 3\nERR?"),
        ],
        &[
            amplifier_at(0, 25),
            at(1, 4.0),
            at(120, 12.0),
            (180, Injection::SetPoint { millivolts: 0 }),
        ],
        320,
    );
    let answers = typed_back(&outcome);
    let positions = values(&answers, "1=");
    assert!(
        (positions[0] - 4.0).abs() < 0.03 && (positions[1] - 8.0).abs() < 0.03,
        "{answers}"
    );
    assert_eq!(values(&answers, "19="), [1.0, 2.0], "{answers}");
    let code = f64::from(millivolts(12.0)) / 3300.0 * 65_535.0;
    assert!((values(&answers, "3=")[0] - code).abs() < 2.0, "{answers}");
    assert!(
        answers.contains("2=36") && answers.contains("FAULT=36 analogue set point open"),
        "{answers}"
    );
    // The loop was open, then nothing was wrong, and behind the fault nobody has armed.
    let errors: Vec<&str> = answers
        .lines()
        .filter(|line| line.parse::<u16>().is_ok())
        .collect();
    assert_eq!(errors, ["4001", "0", "0", "4001"], "{answers}");
    assert!(outcome.enabled.last().is_some_and(|(_, on)| !on));
    // As fast as VEL, 500 um/s, and no faster: um with 24 fraction bits in ticks of 50 us. Over 20 of them, as
    // what the trace has of the reference went through the sensor's lag, which rings for a few.
    let window = 20;
    let most = (500.0 / 20_000.0 * f64::from(1 << 24)) as i32 * window as i32;
    let (trace, _) = samples(&outcome);
    let moved: Vec<i32> = trace
        .windows(window + 1)
        .filter(|ticks| ticks.iter().all(|sample| sample.flags == 2))
        .map(|ticks| (ticks[window].reference - ticks[0].reference).abs())
        .collect();
    let within = most + most / 100;
    assert!(
        moved.iter().all(|moved| *moved <= within),
        "{:?}, {most}",
        moved.iter().max()
    );
    assert!(
        moved
            .iter()
            .filter(|moved| **moved > most - most / 100)
            .count()
            > 200
    );
}

#[test]
fn a_part_that_is_too_hot_is_a_fault_until_it_is_cooler() {
    let at = |ms, celsius: i32| {
        (
            ms,
            Injection::Temperature {
                centi_celsius: celsius * 100,
            },
        )
    };
    let outcome = observed(
        &[
            (30, "DIA? 18\nARM 1 2"),
            (1_100, "DIA? 2 18"),
            (2_100, "INI 1\nDIA? 2 18"),
            (3_100, "DIA? 18\nINI 1\nDIA? 2\nLOG?"),
        ],
        &[
            amplifier_at(0, 25),
            at(0, -10),
            at(40, 104),
            (1_120, at(0, 106).1),
            (2_120, at(0, 60).1),
        ],
        3_200,
    );
    let answers = typed_back(&outcome);
    let celsius: Vec<f64> = values(&answers, "18=").iter().map(|v| v / 10.0).collect();
    for (read, true_) in celsius.iter().zip([-10.0, 104.0, 106.0, 60.0]) {
        assert!((read - true_).abs() < 0.6, "{celsius:?}");
    }
    assert_eq!(values(&answers, "2="), [0.0, 35.0, 0.0], "{answers}");
    assert!(answers.contains("FAULT=35 part too hot"), "{answers}");
    assert_eq!(
        outcome
            .enabled
            .iter()
            .map(|(_, on)| *on)
            .collect::<Vec<_>>(),
        [true, false]
    );
}

#[test]
fn an_amplifier_that_is_too_hot_or_not_read_is_a_fault_until_it_is_cooler() {
    let outcome = observed(
        &[
            (30, "DIA? 20\nARM 1 2"),
            (1_100, "DIA? 2 20"),
            (2_100, "INI 1\nARM 1 2\nDIA? 2 20"),
            (3_100, "DIA? 2 20\nINI 1\nDIA? 2\nLOG?"),
        ],
        &[
            amplifier_at(0, 25),
            amplifier_at(40, 71),
            amplifier_at(1_120, 69),
            // Its cable is off, and a resistor pulls the input to ground.
            (2_120, Injection::AmplifierTemperature { millivolts: 0 }),
        ],
        3_200,
    );
    let answers = typed_back(&outcome);
    let celsius: Vec<f64> = values(&answers, "20=").iter().map(|v| v / 10.0).collect();
    for (read, is) in celsius.iter().zip([25.0, 71.0, 69.0, -1_000.0]) {
        assert!((read - is).abs() < 0.2, "{celsius:?}");
    }
    assert_eq!(values(&answers, "2="), [37.0, 0.0, 37.0, 37.0], "{answers}");
    assert_eq!(
        outcome
            .enabled
            .iter()
            .map(|(_, on)| *on)
            .collect::<Vec<_>>(),
        [true, false, true, false]
    );
}

#[test]
fn lights_show_safe_armed_closed_and_fault() {
    let outcome = observed(
        &[
            (40, "RON 1 0\nARM 1 2"),
            (70, "SVO 1 1"),
            (100, "STP"),
            (200, "ARM 1 0"),
        ],
        &[
            amplifier_at(0, 25),
            (
                300,
                Injection::Line {
                    line: hysteron_emulator::board::SafetyLine::Interlock,
                    closed: false,
                },
            ),
        ],
        340,
    );
    let seen: Vec<[bool; 3]> = outcome.lights.iter().map(|(_, lights)| *lights).collect();
    let (safe, armed, closed, fault) = (
        [true, false, false],
        [false, true, false],
        [true, true, false],
        [false, false, true],
    );
    assert_eq!(seen, [safe, armed, closed, armed, safe, fault]);
    // Within three looks of the watch, 10 ms each.
    for ((seen_ns, _), ms) in outcome.lights[1..].iter().zip([40, 70, 100, 200, 300]) {
        assert!(
            seen_ns.abs_diff(ms * MILLISECOND) < 35 * MILLISECOND,
            "{:?}",
            outcome.lights
        );
    }
}
