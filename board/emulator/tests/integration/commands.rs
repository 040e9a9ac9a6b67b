//! What the target does with more than a line: a parameter block brought by command, a triggered capture, a
//! drive for identification.

use crate::common;

use common::{
    assert_texts, best_parameters, block, parameters, place_of, run_command, run_command_within,
    run_on, samples, texts, world,
};
use hysteron_core::amplifier::Mode;
use hysteron_core::amplifier_command::REST_BEFORE_TICKS;
use hysteron_core::codes::{DriveCode, SensorCode};
use hysteron_core::command_text::write_upload;
use hysteron_core::guard::Fault;
use hysteron_core::servo_parameters::LawParameters;
use hysteron_core::trace_frame::TraceSample;
use hysteron_emulator::converters::{SensorTrouble, Trouble};
use hysteron_emulator::run::{MILLISECOND, Script, unguarded_envelope};

fn upload(block: &[u8]) -> Vec<u8> {
    let mut text = String::new();
    write_upload(block, &mut text).expect("written");
    text.into_bytes()
}

/// Virtual time for an erase and a restart.
const KEPT_AFTER: u64 = 1_500 * MILLISECOND;

#[test]
fn a_block_is_kept_beside_the_last_good_one_and_taken_at_the_next_start() {
    let world = world();
    let old = parameters();
    let new = best_parameters();
    let mut damaged = block(&new);
    damaged[200] ^= 0x10;
    let mut unstable = new;
    unstable.physical.spectral_radius_millionths = 1_000_000;
    let script = Script {
        block: Some(block(&old)),
        commands: vec![
            (4 * MILLISECOND, upload(&damaged)),
            (150 * MILLISECOND, upload(&block(&unstable))),
            (
                300 * MILLISECOND,
                [
                    upload(&block(&new)),
                    // Far enough from rest that the way back takes more than a tick.
                    b"arm untested\nconditioning waived\nreference constant 3000\nenable\n"
                        .to_vec(),
                ]
                .concat(),
            ),
            (
                KEPT_AFTER + 300 * MILLISECOND,
                b"restart\ndisable\n".to_vec(),
            ),
            (KEPT_AFTER + 400 * MILLISECOND, b"restart\n".to_vec()),
        ],
        ..Script::listening(KEPT_AFTER + 500 * MILLISECOND)
    };
    let outcome = run_on(&world, script);
    let texts = texts(&outcome);
    let position = |part| place_of(&texts, part);
    let damaged_at = position("refused: block: checksum does not match");
    let unstable_at =
        position("refused: block: by its own figure the design is not stable when sampled");
    let kept_at = position("block kept as B");
    assert!(
        damaged_at < unstable_at && unstable_at < kept_at,
        "{texts:?}"
    );
    // The loop was closed meanwhile: no restart then, and the watchdog was fed through the erase.
    assert!(position("refused: only at rest") > kept_at, "{texts:?}");
    assert_eq!(outcome.resets, 1, "{texts:?}");
    assert!(
        position("parameter block A taken") < kept_at
            && position("parameter block B taken") > kept_at
    );
    assert_eq!(
        texts.last(),
        Some(&"mode rest"),
        "a restart by command is no fault"
    );
}

#[test]
fn a_capture_holds_every_tick_around_a_fault_however_slow_the_reader_is() {
    const BEFORE: u32 = 1000;
    const AFTER: u32 = 500;
    const TROUBLE: u64 = 4000;
    let world = world();
    world
        .lock()
        .expect("the world")
        .troubles
        .push(SensorTrouble {
            from: TROUBLE,
            to: TROUBLE + 100,
            kind: Trouble::Disconnected,
        });
    let script = Script {
        block: Some(block(&parameters())),
        read_every_ns: Some(40 * MILLISECOND),
        commands: vec![
            (
                MILLISECOND,
                format!("trace 16 1000\narm untested\nconditioning waived\nreference constant 3000\n@300 enable\ncapture fault {BEFORE} {AFTER}\n")
                    .into_bytes(),
            ),
            (280 * MILLISECOND, b"capture send\n".to_vec()),
        ],
        ..Script::listening(1_200 * MILLISECOND)
    };
    let outcome = run_on(&world, script);
    assert_eq!(outcome.malformed, 0);
    assert_texts(&outcome, "capture: 1501 ticks read out", 1);
    let (samples, _) = samples(&outcome);
    let captured: Vec<&TraceSample> = samples
        .windows(2)
        .filter(|pair| pair[1].tick == pair[0].tick + 1)
        .map(|pair| &pair[0])
        .collect();
    assert!(
        captured.len() >= (BEFORE + AFTER) as usize,
        "{} ticks",
        captured.len()
    );
    let fault = captured
        .iter()
        .position(|sample| sample.flags >> 8 == Fault::SensorOutOfRange as u16)
        .expect("the fault");
    assert_eq!(fault, BEFORE as usize, "{} ticks before it", fault);
    assert_eq!(captured[fault - 1].flags, Mode::Closed as u16);
    let world = world.lock().expect("the world");
    for sample in &captured {
        assert_eq!(
            sample.adc_code, world.codes[sample.tick as usize].0,
            "tick {}",
            sample.tick
        );
    }
}

#[test]
fn an_identification_drive_stays_within_the_limits_and_is_traced_whole() {
    let world = world();
    let mut parameters = parameters();
    parameters.guard.jump_codes = 20_000;
    let outcome = run_command_within(
        &unguarded_envelope(),
        &world,
        &parameters,
        b"arm untested\nidentify 12000\n",
        900,
    );
    let (samples, lost) = samples(&outcome);
    let played: Vec<&TraceSample> = samples
        .iter()
        .filter(|sample| sample.flags == Mode::Playing as u16)
        .collect();
    assert_eq!(
        (lost, played.len()),
        (0, REST_BEFORE_TICKS as usize + 12_000),
        "{:?}",
        texts(&outcome)
    );
    let c = parameters.servo.converters;
    let (least, most) = (
        played.iter().map(|s| s.dac_code).min(),
        played.iter().map(|s| s.dac_code).max(),
    );
    println!(
        "drive codes {least:?} to {most:?}, limits {} to {}",
        c.dac_code_min, c.dac_code_max
    );
    assert!(least >= Some(c.dac_code_min) && most <= Some(c.dac_code_max));
    assert!(
        most > Some(c.dac_code_min + c.dac_code_max.abs_diff(c.dac_code_min) / 10 * 9),
        "nearly the whole range"
    );
    let largest_step = played
        .windows(2)
        .map(|pair| pair[1].dac_code.abs_diff(pair[0].dac_code))
        .max();
    assert!(
        largest_step <= Some(c.slew_codes),
        "no jump: {largest_step:?}"
    );
}

#[test]
fn a_restart_waits_for_the_end_of_the_ramp() {
    let world = world();
    let script = Script {
        block: Some(block(&parameters())),
        commands: vec![
            (
                4 * MILLISECOND,
                b"arm untested\nconditioning waived\nreference constant 9000\nenable\n".to_vec(),
            ),
            (100 * MILLISECOND, b"disable\n".to_vec()),
            // The ramp takes 40 ms.
            (
                110 * MILLISECOND,
                b"restart\nplay sine 1000 1000 1000 10\ncondition\nidentify 1000\n".to_vec(),
            ),
            (180 * MILLISECOND, b"restart\n".to_vec()),
        ],
        ..Script::listening(200 * MILLISECOND)
    };
    let outcome = run_on(&world, script);
    assert_texts(&outcome, "only at rest", 4);
    assert_eq!(outcome.resets, 1, "{:?}", texts(&outcome));
}

/// The largest step between two drives that acted.
fn largest_step(codes: &[(SensorCode, DriveCode)]) -> Option<u32> {
    let steps = codes.windows(2).map(|pair| pair[0].1.abs_diff(pair[1].1));
    steps.max()
}

#[test]
fn no_mode_drives_faster_than_the_slew_limit() {
    let world = world();
    let mut parameters = parameters();
    parameters.physical.slew_limit_v_s = 20_000;
    parameters.servo.converters.slew_codes = 468; // 1 V a tick
    parameters.guard.ramp_codes = 400;
    let text = "arm untested\nconditioning waived\nplay sine 0 0 80000 400\n@5000 reference constant 9000\n@5001 enable\n@5400 reference constant 500\n@7000 disable\n";
    let outcome = run_command(&world, &parameters, text, 450);
    let codes = world.lock().expect("the world").codes.clone();
    let steps = |from: usize, to: usize| largest_step(&codes[from..to]);
    assert!(
        codes.iter().map(|(_, acting)| *acting).max() > Some(DriveCode::new(46_000)),
        "{:?}",
        texts(&outcome)
    );
    assert_eq!(steps(0, 4_000), Some(468), "a played jump");
    assert!(
        steps(4_000, codes.len()) <= Some(468),
        "a closed loop, and the ramp to rest: {:?}",
        steps(4_000, codes.len())
    );
    assert_eq!(
        codes.last().map(|(_, acting)| *acting),
        Some(parameters.guard.rest_code)
    );
}

#[test]
fn a_law_that_asks_for_more_gets_no_more_than_the_slew_limit() {
    let world = world();
    let mut parameters = parameters();
    parameters.physical.slew_limit_v_s = 20_000;
    parameters.servo.converters.slew_codes = 468; // 1 V a tick
    parameters.guard.ramp_codes = 400;
    parameters.guard.tracking_ticks = 4000;
    // At a jump of 8 um of the reference the law asks for more than a volt at once.
    if let LawParameters::Regulator(pid) = &mut parameters.servo.law {
        pid.integral *= 6;
    }
    let text = "arm untested\nconditioning waived\nreference constant 1000\n@1000 enable\n@2000 reference constant 9000\n@3000 reference constant 1000\n@4000 disable\n";
    let outcome = run_command_within(&unguarded_envelope(), &world, &parameters, text, 230);
    assert_texts(&outcome, "mode fault", 0);
    let codes = world.lock().expect("the world").codes.clone();
    let steps = |from: usize, to: usize| largest_step(&codes[from..to]);
    assert_eq!(
        (steps(1_900, 2_900), steps(2_900, 3_900)),
        (Some(468), Some(468)),
        "up and down, as fast as it may and no faster"
    );
}

#[test]
fn no_law_drives_beyond_the_limits_of_the_block() {
    let world = world();
    let mut parameters = parameters();
    // Some 97 V and -6 V would be needed for positions that the sensor has; there are 0 to 80 V, and 10 V on
    // either side that the converter has.
    parameters.guard.tracking_ticks = 4000;
    let text = "arm untested\nconditioning waived\nreference constant 1000\n@1000 enable\n@1500 reference constant 13900\n@2800 reference constant -900\n";
    let outcome = run_command_within(&unguarded_envelope(), &world, &parameters, text, 210);
    assert_texts(&outcome, "mode fault", 0);
    let codes = world.lock().expect("the world").codes.clone();
    let c = parameters.servo.converters;
    let beat = 100..codes.len();
    let acting = |range: std::ops::Range<usize>| codes[range].iter().map(|(_, acting)| *acting);
    assert_eq!(
        (acting(beat.clone()).min(), acting(beat).max()),
        (Some(c.dac_code_min), Some(c.dac_code_max))
    );
    assert_eq!(
        acting(2_700..2_750).min(),
        Some(c.dac_code_max),
        "held at the upper limit"
    );
    assert_eq!(
        acting(3_900..4_000).max(),
        Some(c.dac_code_min),
        "and at the lower one"
    );
}

/// The tick at which a sample first has a mode, from a tick on.
fn first_with(samples: &[TraceSample], mode: Mode, from: u32) -> Option<u32> {
    samples
        .iter()
        .find(|sample| sample.tick >= from && sample.flags == mode as u16)
        .map(|sample| sample.tick)
}

#[test]
fn a_command_that_waits_for_its_tick_does_not_hold_up_a_stop() {
    let world = world();
    let script = Script {
        block: Some(block(&parameters())),
        commands: vec![
            (
                4 * MILLISECOND,
                b"trace 31 1\narm untested\nconditioning waived\nreference constant 3000\nenable\n@60000 enable\n@3200 enable\n".to_vec(),
            ),
            (100 * MILLISECOND, b"disable\n".to_vec()),
        ],
        ..Script::listening(200 * MILLISECOND)
    };
    let outcome = run_on(&world, script);
    let (samples, _) = samples(&outcome);
    assert!(
        first_with(&samples, Mode::Closed, 0).is_some(),
        "{:?}",
        texts(&outcome)
    );
    let opened = first_with(&samples, Mode::Rest, 1_900).expect("opens");
    // The probe writes at 100 ms; the task that reads looks every millisecond.
    assert!(opened <= 2_060, "{opened}");
    assert_eq!(
        first_with(&samples, Mode::Closed, opened),
        None,
        "what was planned before the stop does not act after it"
    );
    assert!(samples.last().is_some_and(|sample| sample.tick > 3_300));
    assert_eq!(
        samples.last().map(|sample| sample.dac_code),
        Some(parameters().guard.rest_code)
    );
}

#[test]
fn keeping_a_block_does_not_hold_up_a_stop() {
    let world = world();
    let script = Script {
        block: Some(block(&parameters())),
        commands: vec![
            (
                4 * MILLISECOND,
                [
                    b"trace 31 1\narm untested\nconditioning waived\nreference constant 3000\n@8000 enable\n".to_vec(),
                    upload(&block(&best_parameters())),
                ]
                .concat(),
            ),
            (500 * MILLISECOND, b"disable\n".to_vec()),
        ],
        ..Script::listening(700 * MILLISECOND)
    };
    let outcome = run_on(&world, script);
    let (samples, _) = samples(&outcome);
    assert_eq!(
        outcome.texts_with("block kept as").count(),
        0,
        "the erase goes on: {:?}",
        texts(&outcome)
    );
    let closed = first_with(&samples, Mode::Closed, 0).expect("closes meanwhile");
    assert_eq!(closed, 8_000);
    let opened = first_with(&samples, Mode::Rest, closed).expect("opens");
    assert!(opened <= 10_060, "{opened}");
}
