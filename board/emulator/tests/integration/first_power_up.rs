//! *First power-up* of firmware/README.md, line by line, on the unmodified image: first a wire in place of
//! amplifier and stage, then a stage at 20 V. Each wrong wiring is met once, in the same run.

use crate::common;

use common::{assert_texts, block, last_status, parameters, run_on, samples, texts, typed_back};
use hysteron::servo::amplifier_block::{FrontEnd, block as block_bytes, wiring_parameters};
use hysteron_core::codes::DriveCode;
use hysteron_core::guard::Fault;
use hysteron_core::parameter_block::AmplifierParameters;
use hysteron_core::safety_envelope::SafetyEnvelope;
use hysteron_emulator::board::SafetyLine;
use hysteron_emulator::converters::{OutputTrouble, PERIOD_NS, SensorTrouble, SharedWorld};
use hysteron_emulator::converters::{Trouble, World};
use hysteron_emulator::run::{
    BROWN_OUT_FLAG, Injection, MILLISECOND, Outcome, Script, envelope_bytes, watched_envelope,
};
use hysteron_sim::bench::Bench;
use hysteron_sim::closed_loop::Plant;

/// The drive of the first power-up, V.
const HIGHEST_V: f64 = 20.0;

/// The envelope of the first power-up: 0 to 20 V, no loop without a self-test.
fn first_envelope() -> SafetyEnvelope {
    let whole = watched_envelope();
    let code = (HIGHEST_V * 1e6 - f64::from(whole.drive_at_code_0_uv)) * 2f64.powi(20)
        / f64::from(whole.drive_span_uv);
    SafetyEnvelope {
        // Up to a code of 16 bits.
        drive_max: DriveCode::new((code / 16.0).ceil() as u32 * 16),
        closes_untested: false,
        ..whole
    }
}

/// A position that follows the drive at once; how far a volt moves it changes at edges.
struct Follows {
    /// um/V from an edge on.
    gains: Vec<(u32, f64)>,
    edges: u32,
    position_um: f64,
}

impl Plant for Follows {
    fn advance(&mut self, drive_v: f64, _: f64) {
        self.edges += 1;
        let begun = self
            .gains
            .iter()
            .rev()
            .find(|(from, _)| *from <= self.edges);
        self.position_um = begun.map_or(0.0, |(_, gain)| gain * drive_v);
    }

    fn displacement_um(&self) -> f64 {
        self.position_um
    }

    fn sensor_um(&self) -> f64 {
        self.position_um
    }
}

fn world_of(gains: &[(u32, f64)]) -> World {
    let bench = Bench::reference().expect("the bench");
    let plant = Follows {
        gains: gains.to_vec(),
        edges: 0,
        position_um: 0.0,
    };
    World::with(
        Box::new(plant),
        bench.converter_scale(),
        bench.converters.sensor_noise_um,
        3,
    )
}

/// Edges of the sample clock in so many ms.
fn edges(ms: u64) -> u32 {
    (ms * MILLISECOND / PERIOD_NS) as u32
}

/// Plays lines of the list, each at its time, ms, and gives the answers.
fn play(
    world: &SharedWorld,
    block: Vec<u8>,
    lines: &[(u64, &str)],
    injections: Vec<(u64, Injection)>,
) -> (Vec<String>, Outcome) {
    let end = lines.last().map_or(0, |(ms, _)| *ms) + 20;
    let script = Script::listening(end * MILLISECOND);
    play_in(script, world, block, lines, injections)
}

/// [`play`] while a probe types what the script has for it.
fn play_in(
    script: Script,
    world: &SharedWorld,
    block: Vec<u8>,
    lines: &[(u64, &str)],
    injections: Vec<(u64, Injection)>,
) -> (Vec<String>, Outcome) {
    let script = Script {
        block: Some(block),
        envelope: Some(envelope_bytes(&first_envelope())),
        monitored: Some(world.clone()),
        serial: lines
            .iter()
            .map(|(ms, line)| (ms * MILLISECOND, format!("{line}\n").into_bytes()))
            .collect(),
        injections: injections
            .into_iter()
            .map(|(ms, injection)| (ms * MILLISECOND, injection))
            .collect(),
        ..script
    };
    let outcome = run_on(world, script);
    let answers = typed_back(&outcome);
    (answers.lines().map(str::to_string).collect(), outcome)
}

/// The number behind the `=` of an answer.
fn number(answer: &str) -> f64 {
    let value = answer.split('=').nth(1).unwrap_or_default();
    value.trim().parse().unwrap_or(f64::NAN)
}

#[test]
fn the_list_is_played_over_a_wire_with_each_wrong_wiring() {
    // A volt is 0.1 um: the range of the drive is within that of the sensor.
    let mut world = world_of(&[(0, 0.1)]);
    let [sensor_off, sensor_on, monitor_off] = [640, 660, 800].map(|ms| u64::from(edges(ms)));
    world.troubles.push(SensorTrouble {
        from: sensor_off,
        to: sensor_on,
        kind: Trouble::Disconnected,
    });
    world.output_trouble = Some((monitor_off, OutputTrouble::CableOpen));
    let world = world.shared();
    let wiring = wiring_parameters(&FrontEnd::default(), 0.0, HIGHEST_V).expect("a block");

    let again = "INI 1\nARM 1 2";
    let lines = [
        (40, "ARM 1 2\nARM? 1"),
        (50, "SVA 1 10"),
        (120, "VOL? 1\nTAD? 2"),
        (130, "STP"),
        (250, "DIA? 1 2\nVOL? 1"),
        (265, "DIA? 2"),
        (390, again),
        (405, "DIA? 2"),
        (530, again),
        (545, "DIA? 2"),
        (620, again),
        (655, "DIA? 2"),
        (790, "INI 1\nARM 1 2\nARM? 1"),
        (815, "SVA 1 5"),
        (1000, "DIA? 2"),
    ];
    let open = |ms, line| {
        [
            (
                ms,
                Injection::Line {
                    line,
                    closed: false,
                },
            ),
            (ms + 20, Injection::Line { line, closed: true }),
        ]
    };
    let injections = [
        open(260, SafetyLine::EmergencyStop),
        open(400, SafetyLine::Interlock),
        open(540, SafetyLine::AmplifierReady),
    ];
    let (answers, outcome) = play(
        &world,
        block_bytes(&wiring).expect("bytes"),
        &lines,
        injections.concat(),
    );
    let said = format!("{answers:?}: {:?}", texts(&outcome));
    assert_eq!(answers.len(), 12, "{said}");
    assert_eq!(answers[0], "1=1", "armed: {said}");
    assert!((number(&answers[1]) - 10.0).abs() < 0.01, "{said}");
    // -30..150 V over 65,536 codes, in whole millivolts of the part's input.
    assert!(
        (number(&answers[2]) - 40.0 / 180.0 * 65_536.0).abs() < 40.0,
        "{said}"
    );
    assert!(
        answers[3].starts_with("1=") && answers[4] == "2=0",
        "{said}"
    );
    assert!(number(&answers[5]).abs() < 0.01, "at rest: {said}");
    assert_eq!(answers[10], "1=1", "armed again: {said}");
    let wrong = [
        Fault::EmergencyStop,
        Fault::Interlock,
        Fault::AmplifierNotReady,
        Fault::SensorOutOfRange,
    ];
    let met = answers[6..10].iter().zip(wrong);
    for (answer, fault) in met.chain([(&answers[11], Fault::MonitorOutOfRange)]) {
        assert_eq!(*answer, format!("2={}", fault as u8), "{fault:?}: {said}");
    }
}

/// The regulator of the tests within the first envelope.
fn first_parameters() -> AmplifierParameters {
    let mut parameters = parameters();
    let c = &mut parameters.servo.converters;
    let code = (f64::from(c.dac_code_min)
        + HIGHEST_V / 80.0 * f64::from(c.dac_code_max.abs_diff(c.dac_code_min)))
    .round();
    c.dac_code_max = DriveCode::new(code as u32);
    parameters.physical.drive_max_mv = (HIGHEST_V * 1e3) as i32;
    parameters.guard.tracking_error = 1 << 24;
    parameters.guard.tracking_ticks = 100;
    parameters
}

#[test]
fn the_list_is_played_on_a_stage_at_20_v() {
    // Three wrong wirings of a self-test each, then the stage of the block.
    let right = 1.0 / 7.0;
    let world = world_of(&[
        (0, -right),
        (edges(750), 0.0),
        (edges(1_500), 2.2 * right),
        (edges(2_250), right),
    ])
    .shared();
    let again = "INI 1\nARM 1 1";
    let lines = [
        (40, "ARM 1 1"),
        (740, "DIA? 2"),
        (760, again),
        (1_490, "DIA? 2"),
        (1_510, again),
        (2_240, "DIA? 2"),
        (2_260, again),
        (2_990, "DIA? 2\nARM? 1"),
        (3_000, "RON 1 0\nSVO 1 1\nMOV 1 1"),
        (3_200, "SVO?\nPOS? 1"),
        // 2 kHz over 2.4 um, which the loop cannot follow.
        (
            3_210,
            "WAV 1 X SIN_P 10 2.4 0 10 0 5\nWSL 1 1\nWGC 1 0\nWGO 1 1",
        ),
        (3_300, "DIA? 2\nVOL? 1"),
    ];
    let (answers, outcome) = play(&world, block(&first_parameters()), &lines, Vec::new());
    let said = format!("{answers:?}: {:?}", texts(&outcome));
    assert_eq!(answers.len(), 9, "{said}");
    let wrong = [
        Fault::SensorReversed,
        Fault::SensorDoesNotMove,
        Fault::GainDiffers,
    ];
    for (answer, fault) in answers.iter().zip(wrong) {
        assert_eq!(*answer, format!("2={}", fault as u8), "{fault:?}: {said}");
    }
    assert_eq!(answers[3..6], ["2=0", "1=1", "1=1"], "{said}");
    assert!((number(&answers[6]) - 1.0).abs() < 0.05, "{said}");
    assert_eq!(
        answers[7],
        format!("2={}", Fault::TrackingError as u8),
        "{said}"
    );
    assert!(number(&answers[8]).abs() < 0.01, "at rest: {said}");
}

#[test]
fn the_list_is_played_with_reset_usb_supply_and_the_probe() {
    let world = world_of(&[(0, 0.1)]).shared();
    let wiring = wiring_parameters(&FrontEnd::default(), 0.0, HIGHEST_V).expect("a block");
    // Each from 10 V: RESET is pressed; the supply falls below the detector's level; USB is pulled, which is
    // the board's supply.
    let driven = "INI 1\nARM 1 2\nSVA 1 10";
    let lines = [
        (40, driven),
        (95, "VOL? 1"),
        (140, "DIA? 2\nARM? 1\nVOL? 1"),
        (260, driven),
        (315, "VOL? 1"),
        (400, "DIA? 2"),
        (520, driven),
        (575, "VOL? 1"),
        (640, "DIA? 2"),
    ];
    let restart = |flags| Injection::Restart { flags };
    let injections = vec![
        (100, restart(0)),
        (320, Injection::Supply { millivolts: 2_600 }),
        (340, Injection::Supply { millivolts: 3_300 }),
        (580, restart(BROWN_OUT_FLAG)),
    ];
    let script = Script {
        commands: vec![(645 * MILLISECOND, b"trace 31 1\nstatus\n".to_vec())],
        ..Script::listening(680 * MILLISECOND)
    };
    let (answers, outcome) = play_in(
        script,
        &world,
        block_bytes(&wiring).expect("bytes"),
        &lines,
        injections,
    );
    let said = format!("{answers:?}: {:?}", texts(&outcome));
    assert_eq!(answers.len(), 8, "{said}");
    for driven in [0, 4, 6] {
        assert!((number(&answers[driven]) - 10.0).abs() < 0.01, "{said}");
    }
    assert_eq!(answers[1..3], ["2=0", "1=0"], "RESET: {said}");
    assert!(number(&answers[3]).abs() < 0.01, "at rest: {said}");
    assert_eq!(
        [&answers[5], &answers[7]],
        [
            &format!("2={}", Fault::SupplyLow as u8),
            &format!("2={}", Fault::BrownOut as u8)
        ],
        "{said}"
    );
    assert_eq!(outcome.resets, 3, "{said}");
    // Each time the power stage is off within 2 ms: a look at it every millisecond.
    let off: Vec<u64> = outcome
        .enabled
        .iter()
        .filter(|(_, on)| !on)
        .map(|(at, _)| at / MILLISECOND)
        .collect();
    assert!(
        matches!(off[..], [100..=102, 320..=322, 580..=582]),
        "{off:?}: {said}"
    );
    assert_texts(&outcome, "core 400000000 Hz, control 20000 Hz", 4);
    let status = last_status(&outcome);
    assert!(status.contains("overruns: 0"), "{status}");
    assert!(!samples(&outcome).0.is_empty(), "the trace runs: {said}");
}
