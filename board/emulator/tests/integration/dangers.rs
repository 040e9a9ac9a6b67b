//! Ways to a slammed stage, and to a drive that nobody asked for: each is made to happen on the emulated
//! part.

use crate::common;

use common::{
    assert_texts, best_parameters, block, image_named, parameters, run_on, texts, typed_back, world,
};
use hysteron_core::codes::DriveCode;
use hysteron_core::command_text::write_upload;
use hysteron_core::loop_bands::LoopBands;
use hysteron_core::loop_margin::NO_MARGIN;
use hysteron_core::parameter_block::{AmplifierParameters, set_generation};
use hysteron_core::safety_envelope::SafetyEnvelope;
use hysteron_emulator::board::{NucleoBoard, ONE_INSTRUCTION_PER_CYCLE, SafetyLine};
use hysteron_emulator::converters::{SharedWorld, World};
use hysteron_emulator::run::{
    Injection, MILLISECOND, Outcome, Script, bench_envelope, envelope_bytes, run,
};
use hysteron_sim::bench::Bench;
use hysteron_sim::closed_loop::Plant;

fn run_in(world: &SharedWorld, script: Script) -> Outcome {
    run_on(world, script)
}

/// Drives that acted, from a while after the start on.
pub fn acting(world: &SharedWorld) -> Vec<DriveCode> {
    world
        .lock()
        .expect("the world")
        .codes
        .iter()
        .skip(100)
        .map(|(_, acting)| *acting)
        .collect()
}

#[test]
fn a_finished_wave_is_not_read_again() {
    let world = world();
    let wave =
        "ARM 1 2\nRON 1 0\nSVO 1 1\nMOV 1 3\nWAV 1 X LIN 100 2 3 100 0 0\nWSL 1 1\nWGC 1 1\n";
    let script = Script {
        block: Some(block(&best_parameters())),
        serial: vec![
            (10 * MILLISECOND, wave.into()),
            (150 * MILLISECOND, b"WGO 1 1\n".to_vec()),
            (
                250 * MILLISECOND,
                b"WAV 1 X LIN 100 0 9 100 0 0\nERR?\nSVO?\n".to_vec(),
            ),
        ],
        ..Script::listening(320 * MILLISECOND)
    };
    let outcome = run_in(&world, script);
    assert_texts(&outcome, "mode fault", 0);
    let answers: String = typed_back(&outcome);
    assert_eq!(
        answers, "0\n1=1\n",
        "the table is written while the loop stays closed"
    );
    let codes = acting(&world);
    let (before, after) = (codes[4_700].steps(), codes[codes.len() - 1].steps());
    // 6 um more would be some 40 V, 20 000 codes.
    assert!(
        before.abs_diff(after) < 300,
        "the stage stays at the end of the wave: {before} and {after}"
    );
}

#[test]
fn two_blocks_of_which_neither_replaces_the_other_drive_nothing() {
    let world = world();
    // A block that was flashed for a first power-up, and one that the board kept long ago.
    let mut kept = block(&best_parameters());
    set_generation(&mut kept, 7).expect("a block");
    let script = Script {
        block: Some(block(&parameters())),
        second_block: Some(kept),
        commands: vec![(
            10 * MILLISECOND,
            b"arm untested\nconditioning waived\nreference constant 3000\nenable\n".to_vec(),
        )],
        ..Script::listening(60 * MILLISECOND)
    };
    let outcome = run_in(&world, script);
    assert_texts(&outcome, "mode closed", 0);
    assert!(
        outcome.texts_with("neither replaces the other").count() > 0,
        "{:?}",
        texts(&outcome)
    );
}

#[test]
fn a_block_that_is_refused_is_said_on_the_serial_port() {
    let mut refused = best_parameters();
    refused.guard.tracking_error = i32::MAX;
    let script = Script {
        block: Some(block(&refused)),
        second_block: Some(block(&parameters())),
        serial: vec![(10 * MILLISECOND, b"BLK?\nDIA? 2\n".to_vec())],
        ..Script::listening(20 * MILLISECOND)
    };
    let answers = typed_back(&run_in(&world(), script));
    assert!(
        answers.starts_with("REFUSED beyond the safety envelope") && answers.ends_with("2=0\n"),
        "{answers}"
    );
}

#[test]
fn a_drive_that_does_not_arrive_is_a_fault() {
    let world = world();
    let script = Script {
        block: Some(block(&parameters())),
        commands: vec![(
            4 * MILLISECOND,
            b"arm untested\nconditioning waived\nplay sine 10000 10000 20000 20000\n".to_vec(),
        )],
        injections: vec![(100 * MILLISECOND, Injection::DriveInterfaceOff)],
        ..Script::listening(140 * MILLISECOND)
    };
    let outcome = run_in(&world, script);
    let at = outcome
        .messages
        .iter()
        .find(|message| message.text == "mode fault: drive does not arrive")
        .map(|message| message.at_ns);
    assert!(
        at.is_some_and(|at| at <= 103 * MILLISECOND),
        "{at:?}: {:?}",
        texts(&outcome)
    );
    let states: Vec<bool> = outcome.enabled.iter().map(|(_, on)| *on).collect();
    assert_eq!(
        states,
        [true, false],
        "the power stage is switched off: {:?}",
        texts(&outcome)
    );
}

#[test]
fn a_block_with_every_guard_off_is_refused() {
    let with = |change: &dyn Fn(&mut AmplifierParameters)| {
        let mut parameters = parameters();
        change(&mut parameters);
        let script = Script {
            block: Some(block(&parameters)),
            ..Script::listening(20 * MILLISECOND)
        };
        let outcome = run_in(&world(), script);
        (
            outcome
                .texts_with("parameter block A refused: beyond the safety envelope")
                .count(),
            format!("{:?}", texts(&outcome)),
        )
    };
    assert_eq!(with(&|_| {}).0, 0, "a block with guards is taken");
    let changes: [&dyn Fn(&mut AmplifierParameters); 6] = [
        &|p| p.guard.stuck_ticks = 0,
        &|p| p.guard.tracking_error = i32::MAX,
        &|p| p.guard.tracking_ticks = u16::MAX,
        &|p| p.guard.adc_code_min = hysteron_core::codes::SensorCode::new(0),
        &|p| p.guard.ramp_codes = 1,
        &|p| p.guard.healthy_ticks = 0,
    ];
    for (nth, change) in changes.into_iter().enumerate() {
        let (refused, said) = with(change);
        assert_eq!(refused, 1, "{nth}: {said}");
    }
}

#[test]
fn kept_settings_that_are_damaged_do_not_arm() {
    let world = world();
    let parameters = best_parameters();
    let mut kept = crate::output_path::kept_filters(&parameters);
    kept[20] ^= 1;
    let script = Script {
        block: Some(block(&parameters)),
        kept: Some(kept),
        serial: vec![
            (10 * MILLISECOND, b"ARM 1 2\nERR?\nDIA? 2\n".to_vec()),
            (140 * MILLISECOND, b"INI 1\nERR?\nARM 1 2\nERR?\n".to_vec()),
        ],
        ..Script::listening(160 * MILLISECOND)
    };
    let outcome = run_in(&world, script);
    let answers = typed_back(&outcome);
    assert_eq!(answers, "333\n2=33\n0\n0\n", "{:?}", texts(&outcome));
}

/// A block brought over the serial port, which is to be swapped in.
fn upload_and_swap(parameters: &AmplifierParameters) -> Vec<u8> {
    let mut text = String::new();
    write_upload(&block(parameters), &mut text).expect("written");
    text.replace("block begin", "BLK BEGIN")
        .replace("block data", "BLK DATA")
        .replace("block commit", "BLK SWAP")
        .into_bytes()
}

#[test]
fn a_closed_loop_takes_no_filter_that_its_margins_do_not_bear() {
    let world = world();
    // A block for which nothing is known of its loop.
    let unknown = AmplifierParameters {
        loop_bands: LoopBands::UNKNOWN,
        ..best_parameters()
    };
    let filters: &[u8] =
        b"SPA 1 0x7F000034 200\nERR?\nSPA 1 0x7F000030 300 1 0x7F000031 300\nERR?\n\
        SPA 1 0x7F000034 9000\nERR?\nSPA? 1 0x7F000030 1 0x7F000034\n";
    let script = Script {
        block: Some(block(&best_parameters())),
        serial: vec![
            (
                10 * MILLISECOND,
                b"ARM 1 2\nRON 1 0\nSVO 1 1\nMOV 1 3\n".to_vec(),
            ),
            (60 * MILLISECOND, filters.to_vec()),
            (110 * MILLISECOND, upload_and_swap(&unknown)),
            (360 * MILLISECOND, b"BLK?\nSVO?\n".to_vec()),
        ],
        ..Script::listening(390 * MILLISECOND)
    };
    let outcome = run_in(&world, script);
    assert_texts(&outcome, "mode fault", 0);
    let answers = typed_back(&outcome);
    assert_eq!(
        answers,
        format!(
            "4005\n4005\n0\n1 0x7f000030=0.000 \n1 0x7f000034=9000.000\nREFUSED {NO_MARGIN}\n1=1\n"
        ),
        "{:?}",
        texts(&outcome)
    );
}

#[test]
fn kept_filters_that_the_loop_does_not_bear_do_not_arm() {
    let parameters = AmplifierParameters {
        loop_bands: LoopBands::UNKNOWN,
        ..best_parameters()
    };
    let script = Script {
        kept: Some(crate::output_path::kept_filters(&parameters)),
        block: Some(block(&parameters)),
        serial: vec![(
            10 * MILLISECOND,
            b"ARM 1 2\nERR?\nDIA? 2\nSPA? 1 0x7F000034\n".to_vec(),
        )],
        ..Script::listening(30 * MILLISECOND)
    };
    let outcome = run_in(&world(), script);
    let answers = typed_back(&outcome);
    assert_eq!(
        answers,
        "333\n2=33\n1 0x7f000034=0.000\n",
        "{:?}",
        texts(&outcome)
    );
}

#[test]
fn a_loop_that_nothing_has_tried_is_not_closed() {
    let world = world();
    let envelope = SafetyEnvelope {
        closes_untested: false,
        ..bench_envelope()
    };
    let script = Script {
        block: Some(block(&best_parameters())),
        envelope: Some(envelope_bytes(&envelope)),
        serial: vec![(
            10 * MILLISECOND,
            b"ARM 1 2\nRON 1 0\nSVO 1 1\nERR?\nSVO?\n".to_vec(),
        )],
        ..Script::listening(40 * MILLISECOND)
    };
    let outcome = run_in(&world, script);
    let answers = typed_back(&outcome);
    assert_eq!(answers, "4006\n1=0\n", "{:?}", texts(&outcome));
}

/// Two boards of the same kind, each with the block of one stage.
#[test]
fn a_block_for_another_stage_is_refused() {
    let parameters = best_parameters();
    let modes = [parameters.physical.name, *b"p753-117042917\0\0"].map(|stage| {
        let script = Script {
            block: Some(block(&parameters)),
            envelope: Some(envelope_bytes(&SafetyEnvelope {
                stage,
                ..bench_envelope()
            })),
            serial: vec![(10 * MILLISECOND, b"ARM 1 2\nERR?\n".to_vec())],
            ..Script::listening(30 * MILLISECOND)
        };
        let outcome = run_in(&world(), script);
        let said = outcome.texts_with("made for another stage").count();
        (said, typed_back(&outcome))
    });
    let [own, other] = modes;
    assert_eq!(own, (0, "0\n".to_string()));
    assert!(other.0 > 0 && other.1 != "0\n", "{other:?}");
}

/// A stage with one mode, which gets another load at an edge.
struct Loaded {
    natural_rad_s: f64,
    damping: f64,
    gain_um_v: f64,
    /// At which edge, and natural frequency, damping and gain over what they were.
    load: (u32, [f64; 3]),
    edges: u32,
    position_um: f64,
    velocity_um_s: f64,
}

impl Plant for Loaded {
    fn advance(&mut self, drive_v: f64, _: f64) {
        const STEPS: u32 = 16;
        if self.edges == self.load.0 {
            let [frequency, damping, gain] = self.load.1;
            self.natural_rad_s *= frequency;
            self.damping *= damping;
            self.gain_um_v *= gain;
        }
        self.edges += 1;
        let step_s = 50e-6 / f64::from(STEPS);
        for _ in 0..STEPS {
            let acceleration = self.natural_rad_s.powi(2)
                * (self.gain_um_v * drive_v - self.position_um)
                - 2.0 * self.damping * self.natural_rad_s * self.velocity_um_s;
            self.velocity_um_s += acceleration * step_s;
            self.position_um += self.velocity_um_s * step_s;
        }
    }

    fn displacement_um(&self) -> f64 {
        self.position_um
    }

    fn sensor_um(&self) -> f64 {
        self.position_um
    }
}

/// The first fault of a loop that gets this load, and the time from the load to it, ms. The loop is closed
/// where the stage stands, behind a drive of 30 V.
fn fault_behind(load: [f64; 3]) -> (Option<String>, u64) {
    const LOAD_EDGE: u32 = 5_000;
    let bench = Bench::reference().expect("the bench");
    let stage = Loaded {
        natural_rad_s: std::f64::consts::TAU * 852.0,
        damping: 0.79,
        gain_um_v: 0.125,
        load: (LOAD_EDGE, load),
        edges: 0,
        position_um: 0.0,
        velocity_um_s: 0.0,
    };
    let world = World::with(
        Box::new(stage),
        bench.converter_scale(),
        bench.converters.sensor_noise_um,
        3,
    )
    .shared();
    let script = Script {
        block: Some(block(&best_parameters())),
        serial: vec![
            (10 * MILLISECOND, b"ARM 1 2\nRON 1 0\nSVA 1 30\n".to_vec()),
            (180 * MILLISECOND, b"SVO 1 1\n".to_vec()),
        ],
        ..Script::listening(320 * MILLISECOND)
    };
    let outcome = run_in(&world, script);
    let loaded_ns = world.lock().expect("the world").began_ns() + u64::from(LOAD_EDGE) * 50_000;
    let fault = outcome
        .messages
        .iter()
        .find_map(|message| Some((message.at_ns, message.text.strip_prefix("mode fault: ")?)));
    println!("{load:?}: {fault:?}");
    assert_texts(&outcome, "mode closed", 1);
    let (at_ns, name) = fault.unzip();
    let after_ms = at_ns.map_or(0, |at_ns| at_ns.saturating_sub(loaded_ns) / MILLISECOND);
    (name.map(str::to_string), after_ms)
}

/// A heavier load on a softer joint.
const SWINGING_LOAD: [f64; 3] = [0.6, 0.03, 1.3];

#[test]
fn a_drive_that_swings_is_stopped() {
    let (fault, after_ms) = fault_behind(SWINGING_LOAD);
    let of_the_loop = ["loop swings", "tracking error", "sensor jump"];
    assert!(
        fault
            .as_deref()
            .is_some_and(|fault| of_the_loop.contains(&fault)),
        "{fault:?}"
    );
    assert!((1..=20).contains(&after_ms), "{after_ms} ms");
    let unloaded = fault_behind([1.0; 3]);
    assert_eq!(
        unloaded,
        (None, 0),
        "without another load it does not swing"
    );
}

#[test]
fn without_a_block_the_converter_stays_clamped() {
    let world = world();
    // Longer than the time after which a converter is set up anew at rest.
    run_in(&world, Script::listening(250 * MILLISECOND));
    assert!(
        world.lock().expect("the world").clamped(),
        "nobody has said which code is 0 V"
    );
}

#[test]
fn the_power_stage_stays_off_until_somebody_arms_it() {
    let world = world();
    let script = Script {
        block: Some(block(&parameters())),
        commands: vec![
            (10 * MILLISECOND, b"clear\nconditioning waived\nreference constant 3000\nenable\nplay sine 1000 1000 1000 100\n".to_vec()),
            (60 * MILLISECOND, b"arm untested\n".to_vec()),
        ],
        ..Script::listening(100 * MILLISECOND)
    };
    let outcome = run_in(&world, script);
    let enabled: Vec<(u64, bool)> = outcome
        .enabled
        .iter()
        .map(|(at, on)| (at / MILLISECOND, *on))
        .collect();
    assert!(
        matches!(enabled[..], [(60..=63, true)]),
        "{enabled:?}: {:?}",
        texts(&outcome)
    );
    assert_eq!(
        outcome.texts_with("mode closed").count() + outcome.texts_with("mode playing").count(),
        0,
        "{:?}",
        texts(&outcome)
    );
}

#[test]
fn the_board_check_drives_nothing_while_a_safety_line_is_open() {
    let world = world();
    let mut board = NucleoBoard::with_plant(&world).expect("a board");
    board.set_line(
        SafetyLine::EmergencyStop,
        false,
        rigless::time::VirtualNanos(0),
    );
    board.instructions_per_second = ONE_INSTRUCTION_PER_CYCLE;
    let outcome = run(
        &image_named("board_check"),
        board,
        Script::listening(300 * MILLISECOND),
    )
    .expect("a run");
    let codes = acting(&world);
    assert!(
        codes.iter().all(|code| *code == codes[0]),
        "{:?}",
        texts(&outcome)
    );
    assert!(
        outcome.texts_with("emergency stop").count() > 0,
        "{:?}",
        texts(&outcome)
    );
}
