//! Every fault that can be injected ends at the safe output with its name, and the way back works.

use crate::common;

use common::{
    assert_texts, best_parameters, block, image, last_place_of, parameters, run_command_within,
    run_on, samples, texts, world,
};
use hysteron_core::amplifier::Mode;
use hysteron_core::codes::{DriveCode, SensorCode};
use hysteron_core::guard::Fault;
use hysteron_core::safety_envelope::SafetyEnvelope;
use hysteron_emulator::board::{NucleoBoard, SafetyLine};
use hysteron_emulator::converters::{SensorTrouble, Trouble, World};
use hysteron_emulator::run::{
    BROWN_OUT_FLAG, Injection, MILLISECOND, Outcome, Script, WATCHDOG_FLAG, address_of,
    bench_envelope, envelope_bytes, halfword_at, run, unguarded_envelope,
};
use hysteron_sim::bench::{Bench, Variant};

const ENABLED_AT: u32 = 300;
const TROUBLE_FROM: u64 = 2000;
const TROUBLE_TO: u64 = 4000;

/// Closed loop on a constant reference, a sensor in trouble from 100 ms to 200 ms, `clear` too early and
/// again late, `enable`.
fn with_trouble(kind: Trouble) -> (Outcome, DriveCode) {
    let bench = Bench::reference().expect("the bench");
    let mut world = World::new(&bench, Variant::PLAIN, 3);
    world.troubles.push(SensorTrouble {
        from: TROUBLE_FROM,
        to: TROUBLE_TO,
        kind,
    });
    let world = world.shared();
    let mut parameters = parameters();
    parameters.guard.healthy_ticks = 500;
    let script = Script {
        block: Some(block(&parameters)),
        commands: vec![
            (
                4 * MILLISECOND,
                format!("trace 31 1\narm untested\nconditioning waived\nreference constant 3000\n@{ENABLED_AT} enable\n").into_bytes(),
            ),
            (205 * MILLISECOND, b"clear\nenable\n".to_vec()),
            (300 * MILLISECOND, b"clear\narm untested\nreference constant 3000\nenable\n".to_vec()),
        ],
        ..Script::listening(400 * MILLISECOND)
    };
    let outcome = run_on(&world, script);
    (outcome, parameters.guard.rest_code)
}

fn ends_safe_and_comes_back(kind: Trouble, fault: Fault) {
    let (outcome, rest) = with_trouble(kind);
    let (samples, lost) = samples(&outcome);
    assert_eq!(lost, 0);
    let at = |tick: u64| {
        samples
            .iter()
            .find(|sample| u64::from(sample.tick) == tick)
            .expect("traced")
    };
    assert_eq!(at(TROUBLE_FROM - 1).flags, Mode::Closed as u16);
    let first = samples
        .iter()
        .find(|sample| {
            sample.flags != Mode::Closed as u16 && u64::from(sample.tick) >= TROUBLE_FROM
        })
        .expect("a fault");
    assert_eq!(
        first.flags,
        Mode::Fault as u16 | (fault as u16) << 8,
        "named"
    );
    println!(
        "{}: named {} ticks after it began",
        fault.name(),
        u64::from(first.tick) - TROUBLE_FROM
    );
    assert_eq!(at(TROUBLE_TO - 1).dac_code, rest, "at rest");
    assert!(
        outcome
            .texts_with(&format!("mode fault: {}", fault.name()))
            .count()
            >= 1,
        "said"
    );
    assert_eq!(
        outcome.texts_with("a fault is latched").count(),
        1,
        "nothing else acts until it is cleared: {:?}",
        texts(&outcome)
    );
    assert!(
        outcome
            .texts_with("has not been healthy long enough")
            .count()
            == 1,
        "{:?}",
        outcome.texts_with("refused").collect::<Vec<_>>()
    );
    let last = samples.last().expect("samples");
    assert_eq!(last.flags, Mode::Closed as u16, "closed again");
    assert!((f64::from(last.reference) / f64::from(1 << 24) - 3.0).abs() < 0.01);
}

#[test]
fn a_stuck_sensor() {
    ends_safe_and_comes_back(Trouble::Stuck, Fault::SensorStuck);
}

#[test]
fn a_disconnected_sensor() {
    ends_safe_and_comes_back(Trouble::Disconnected, Fault::SensorOutOfRange);
}

#[test]
fn a_sensor_that_jumps() {
    // 1.4 um between two ticks, where the guard's limit is 1 um; further than that the loop would follow it.
    ends_safe_and_comes_back(Trouble::Shifted(6_000), Fault::SensorJump);
}

#[test]
fn a_law_that_goes_on_wanting_more_than_the_slew_limit() {
    let world = world();
    let mut parameters = parameters();
    // 0.1 V a tick: the 56 V of a jump of 8 um take 560 ticks, and the law is given 200.
    parameters.physical.slew_limit_v_s = 2_010;
    parameters.servo.converters.slew_codes = 47;
    parameters.guard.tracking_ticks = 200;
    parameters.guard.tracking_error = 100 << 24;
    let text = "trace 31 1\narm untested\nconditioning waived\nreference constant 1000\n@1000 enable\n@2500 reference constant 9000\n";
    let outcome = run_command_within(&unguarded_envelope(), &world, &parameters, text, 230);
    let (samples, _) = samples(&outcome);
    let first = samples
        .iter()
        .find(|sample| sample.flags as u8 == Mode::Fault as u8)
        .expect("a fault");
    assert_eq!(
        first.flags,
        Mode::Fault as u16 | (Fault::DriveSlew as u16) << 8,
        "named"
    );
    // More ticks at the limit than below it by 200, and the tick of the fault.
    let law = samples
        .windows(2)
        .filter(|pair| (2_500..first.tick).contains(&pair[1].tick));
    let counted = law.fold(0u32, |count, pair| {
        match pair[1].dac_code.abs_diff(pair[0].dac_code) {
            47 => count + 1,
            _ => count.saturating_sub(1),
        }
    });
    assert_eq!(counted, 200, "at tick {}", first.tick);
    let before = samples
        .iter()
        .find(|sample| sample.tick + 1 == first.tick)
        .expect("the tick before");
    assert_eq!(before.flags, Mode::Closed as u16);
    assert_eq!(
        before.dac_code,
        first.dac_code + parameters.guard.ramp_codes,
        "on the way to rest in the very tick"
    );
    assert_eq!(
        samples.last().map(|sample| (sample.dac_code, sample.flags)),
        Some((parameters.guard.rest_code, first.flags))
    );
}

#[test]
fn a_corrupt_block_is_refused_with_its_reason_and_the_drive_rests() {
    let bench = Bench::reference().expect("the bench");
    let good = parameters();
    let mut damaged = block(&good);
    damaged[100] ^= 1;
    let mut unstable = good;
    unstable.physical.spectral_radius_millionths = 1_200_000;
    let mut mismatched = good;
    mismatched.physical.drive_max_mv = 120_000;
    for (bytes, reason) in [
        (damaged, "checksum does not match"),
        (
            block(&unstable),
            "by its own figure the design is not stable when sampled",
        ),
        (
            block(&mismatched),
            "integers contradict the physical limits",
        ),
    ] {
        let world = World::new(&bench, Variant::PLAIN, 3).shared();
        let script = Script {
            block: Some(bytes),
            commands: vec![(5 * MILLISECOND, b"enable\ncondition\nclear\n".to_vec())],
            ..Script::listening(60 * MILLISECOND)
        };
        let outcome = run_on(&world, script);
        assert_texts(&outcome, &format!("parameter block A refused: {reason}"), 1);
        assert_eq!(outcome.texts_with("mode fault: parameter block").count(), 1);
        assert_eq!(outcome.texts_with("refused at tick").count(), 3);
        let world = world.lock().expect("the world");
        assert!(
            world
                .codes
                .iter()
                .all(|(_, acting)| *acting == good.guard.rest_code)
        );
    }
}

/// Closed loop, then something happens to the processor; `clear` and `enable` bring the loop back. Returns
/// the run and the acting codes.
fn with_injections(injections: Vec<(u64, Injection)>) -> (Outcome, Codes) {
    let bench = Bench::reference().expect("the bench");
    let world = World::new(&bench, Variant::PLAIN, 3).shared();
    let mut parameters = parameters();
    parameters.guard.healthy_ticks = 500;
    let script = Script {
        block: Some(block(&parameters)),
        commands: vec![
            (4 * MILLISECOND, b"trace 31 1\narm untested\nconditioning waived\nreference constant 3000\nenable\n".to_vec()),
            (300 * MILLISECOND, b"clear\narm untested\nconditioning waived\ntrace 31 1\nreference constant 3000\nenable\n".to_vec()),
        ],
        injections,
        ..Script::listening(400 * MILLISECOND)
    };
    let outcome = run_on(&world, script);
    let world = world.lock().expect("the world");
    (
        outcome,
        Codes {
            codes: world.codes.clone(),
            began_ns: world.began_ns(),
            lowest_between_edges: world.lowest_between_edges,
        },
    )
}

/// What the converters saw.
struct Codes {
    codes: Vec<(SensorCode, DriveCode)>,
    began_ns: u64,
    lowest_between_edges: DriveCode,
}

/// The drive rests from a while after `at_ns` until the loop is closed again, and then it is closed.
fn rests_and_comes_back(outcome: &Outcome, seen: &Codes, from_ns: u64, fault: Fault) {
    let codes = &seen.codes;
    let rest = parameters().guard.rest_code;
    // The first edge at or after an instant; it shows what acts from it on.
    let edge = |at_ns: u64| (at_ns - seen.began_ns).div_ceil(50_000) as usize;
    assert!(
        seen.lowest_between_edges >= rest,
        "no code but rest acts by hand: {}",
        seen.lowest_between_edges
    );
    assert!(
        codes[edge(90 * MILLISECOND)].1 > rest + 1000,
        "closed before"
    );
    assert!(
        codes[edge(from_ns)..edge(295 * MILLISECOND)]
            .iter()
            .all(|(_, acting)| *acting == rest),
        "rests"
    );
    assert_eq!(
        outcome
            .texts_with(&format!("mode fault: {}", fault.name()))
            .count(),
        1,
        "{:?}",
        texts(outcome)
    );
    let (samples, _) = samples(outcome);
    assert_eq!(
        samples.last().expect("samples").flags,
        Mode::Closed as u16,
        "closed again: {:?}",
        texts(outcome)
    );
    assert!(codes.last().expect("codes").1 > rest + 1000, "and driving");
}

/// Thumb instructions that replace the first one of the control interrupt.
const UNDEFINED: u16 = 0xDE00;
const JUMP_TO_ITSELF: u16 = 0xE7FE;
const RETURN: u16 = 0x4770;

#[test]
fn an_overrun() {
    let handler = address_of(&image(), "TIM2").expect("the control interrupt");
    let bytes = std::fs::read(image()).expect("the image");
    let honest = halfword_at(&bytes, handler).expect("its first instruction");
    // For 120 us the interrupt returns at once, unacknowledged, and begins again: two edges go by without a
    // tick.
    let (outcome, codes) = with_injections(vec![
        (
            100 * MILLISECOND,
            Injection::Halfword {
                address: handler,
                value: RETURN,
            },
        ),
        (
            100 * MILLISECOND + 120_000,
            Injection::Halfword {
                address: handler,
                value: honest,
            },
        ),
    ]);
    rests_and_comes_back(&outcome, &codes, 160 * MILLISECOND, Fault::Overrun);
    assert_eq!(outcome.resets, 0);
}

#[test]
fn a_hard_fault() {
    let handler = address_of(&image(), "TIM2").expect("the control interrupt");
    let (outcome, codes) = with_injections(vec![
        (
            100 * MILLISECOND,
            Injection::Halfword {
                address: handler,
                value: UNDEFINED,
            },
        ),
        // Changes nothing: the run stops there, at the end of an instruction, and the enable output is looked
        // at.
        (
            100 * MILLISECOND + 79_000,
            Injection::Line {
                line: SafetyLine::Interlock,
                closed: true,
            },
        ),
    ]);
    // At once: the interrupt that fails begins within 50 us, and neither the edge after it nor the restart
    // 100 us later is waited for.
    rests_and_comes_back(
        &outcome,
        &codes,
        100 * MILLISECOND + 60_000,
        Fault::HardFault,
    );
    assert_eq!(outcome.resets, 1);
    let fell = outcome
        .enabled
        .iter()
        .find(|(at, on)| *at >= 100 * MILLISECOND && !on)
        .map(|(at, _)| at - 100 * MILLISECOND);
    assert!(
        fell.is_some_and(|after_ns| after_ns <= 80_000),
        "the enable output falls before the restart: {fell:?}"
    );
}

#[test]
fn a_hard_fault_goes_to_the_rest_that_the_block_says() {
    let world = world();
    let mut parameters = parameters();
    // Not the 0 V that is rest without a block.
    parameters.guard.rest_code = parameters.servo.converters.dac_code_min + 3_000;
    let handler = address_of(&image(), "TIM2").expect("the control interrupt");
    // 16 bits of a block in 20 of the converter.
    let envelope = SafetyEnvelope {
        safe_code: DriveCode::new(parameters.guard.rest_code.steps() << 4),
        ..bench_envelope()
    };
    let script = Script {
        block: Some(block(&parameters)),
        envelope: Some(envelope_bytes(&envelope)),
        commands: vec![(
            4 * MILLISECOND,
            b"arm untested\nconditioning waived\nreference constant 5000\nenable\n".to_vec(),
        )],
        injections: vec![(
            100 * MILLISECOND,
            Injection::Halfword {
                address: handler,
                value: UNDEFINED,
            },
        )],
        ..Script::listening(110 * MILLISECOND)
    };
    run_on(&world, script);
    let world = world.lock().expect("the world");
    // The interrupt that fails begins within 50 us; the reset, which clamps the converter to ground, comes
    // 100 us later.
    let at = ((100 * MILLISECOND + 60_000 - world.began_ns()).div_ceil(50_000)) as usize;
    assert!(
        world.codes[at - 10].1 > parameters.guard.rest_code + 5_000,
        "closed before: {:?}",
        world.codes[at - 10]
    );
    assert_eq!(world.codes[at].1, parameters.guard.rest_code);
}

/// The control interrupt's first instructions are replaced by these at 100 ms.
fn with_instructions(instructions: &[u16]) -> (Outcome, Codes) {
    let handler = address_of(&image(), "TIM2").expect("the control interrupt");
    let patch = instructions
        .iter()
        .zip(0u64..)
        .map(|(value, nth)| Injection::Halfword {
            address: handler + 2 * nth,
            value: *value,
        });
    with_injections(
        patch
            .map(|injection| (100 * MILLISECOND, injection))
            .collect(),
    )
}

/// A double ECC error of the flash is a bus error (RM0433, 4.7.9), which an address behind the flash has too:
/// of a constant and of an instruction.
#[test]
fn a_bus_error_of_code_or_constants() {
    // `movw r0, #0; movt r0, #0x0820; ldr r1, [r0]`, and `movw r0, #1; movt r0, #0x0820; bx r0`.
    for instructions in [
        [0xF240, 0x0000, 0xF6C0, 0x0020, 0x6801],
        [0xF240, 0x0001, 0xF6C0, 0x0020, 0x4700],
    ] {
        let (outcome, codes) = with_instructions(&instructions);
        rests_and_comes_back(
            &outcome,
            &codes,
            100 * MILLISECOND + 60_000,
            Fault::HardFault,
        );
    }
}

#[test]
fn a_hard_fault_with_the_drives_interface_off() {
    // SPI3 is disabled (CR1 at 0x40003C00): `movw r0, #0x3C00; movt r0, #0x4000; movs r1, #0;
    // str r1, [r0]; udf`.
    let (outcome, codes) =
        with_instructions(&[0xF643, 0x4000, 0xF2C4, 0x0000, 0x2100, 0x6001, UNDEFINED]);
    rests_and_comes_back(
        &outcome,
        &codes,
        100 * MILLISECOND + 60_000,
        Fault::HardFault,
    );
    assert_eq!(outcome.resets, 1);
}

#[test]
fn a_crystal_that_stops() {
    // What the clock security system raises is an NMI, and here the program itself: NMIPENDSET of ICSR
    // (Armv7-M, B3.2.4), `movw r0, #0xED04; movt r0, #0xE000; mov.w r1, #0x80000000; str r1, [r0]; b .`.
    let (outcome, codes) = with_instructions(&[
        0xF64E,
        0x5004,
        0xF2CE,
        0x0000,
        0xF04F,
        0x4100,
        0x6001,
        JUMP_TO_ITSELF,
    ]);
    rests_and_comes_back(
        &outcome,
        &codes,
        100 * MILLISECOND + 60_000,
        Fault::ClockLost,
    );
    assert_eq!(outcome.resets, 1);
}

#[test]
fn a_tick_that_takes_longer_than_a_period() {
    /// So slow a core that it has the time for a tick at rest and not for one of the closed loop, which takes
    /// less than a period and a half: no edge goes by without a tick for a while, so the cycle counter alone
    /// would not tell.
    const SLOW: u64 = 24_000_000;
    let world = world();
    let script = Script {
        block: Some(block(&best_parameters())),
        commands: vec![(
            200 * MILLISECOND,
            b"arm untested\nconditioning waived\nreference constant 3000\n@5000 enable\n".to_vec(),
        )],
        ..Script::listening(400 * MILLISECOND)
    };
    let mut board = NucleoBoard::with_plant(&world).expect("a board");
    board.instructions_per_second = SLOW;
    let outcome = run(&image(), board, script).expect("a run");
    assert_eq!(
        outcome.texts_with("mode rest").count(),
        1,
        "at rest there is time: {:?}",
        texts(&outcome)
    );
    assert_texts(&outcome, "mode fault: overrun", 1);
    assert_eq!(
        (outcome.texts_with("mode fault").count(), outcome.resets),
        (1, 0),
        "{:?}",
        texts(&outcome)
    );
}

#[test]
fn an_overflow_of_the_stack_is_a_hard_fault_that_keeps_what_it_needs() {
    const PUSH_ALL: u16 = 0xB5FF;
    const BACK_TO_IT: u16 = 0xE7FD;
    let handler = address_of(&image(), "TIM2").expect("the control interrupt");
    let (outcome, codes) = with_injections(vec![
        (
            100 * MILLISECOND,
            Injection::Halfword {
                address: handler + 2,
                value: BACK_TO_IT,
            },
        ),
        (
            100 * MILLISECOND,
            Injection::Halfword {
                address: handler,
                value: PUSH_ALL,
            },
        ),
    ]);
    // 70 kB of stack are filled first, in 2 ms at most.
    rests_and_comes_back(&outcome, &codes, 102 * MILLISECOND, Fault::HardFault);
    assert_eq!(outcome.resets, 1);
}

#[test]
fn without_a_block_the_cause_of_a_restart_is_named_and_nothing_closes_a_loop() {
    let bench = Bench::reference().expect("the bench");
    let world = World::new(&bench, Variant::PLAIN, 3).shared();
    let script = Script {
        commands: vec![
            (130 * MILLISECOND, b"clear\nenable\n".to_vec()),
            (150 * MILLISECOND, b"clear\nenable\ncondition\n".to_vec()),
        ],
        injections: vec![(
            10 * MILLISECOND,
            Injection::Restart {
                flags: WATCHDOG_FLAG,
            },
        )],
        ..Script::listening(180 * MILLISECOND)
    };
    let outcome = run_on(&world, script);
    let texts = texts(&outcome);
    let position = |part| last_place_of(&texts, part);
    assert!(
        position("last restart: watchdog") < position("mode fault: watchdog"),
        "{texts:?}"
    );
    assert!(
        position("mode fault: watchdog") < position("mode fault: parameter block"),
        "{texts:?}"
    );
    assert!(
        position("mode fault: parameter block") < position("no valid parameter block"),
        "{texts:?}"
    );
    assert_eq!(
        outcome.texts_with("mode closed").count() + outcome.texts_with("mode rest").count(),
        0,
        "{texts:?}"
    );
    let world = world.lock().expect("the world");
    let rest = bench.converter_scale().dac_code(0.0);
    assert!(
        world.codes.iter().all(|(_, acting)| *acting == rest) && world.lowest_between_edges >= rest
    );
}

#[test]
fn a_program_that_hangs_is_restarted_by_the_watchdog() {
    let handler = address_of(&image(), "TIM2").expect("the control interrupt");
    let (outcome, codes) = with_injections(vec![(
        100 * MILLISECOND,
        Injection::Halfword {
            address: handler,
            value: JUMP_TO_ITSELF,
        },
    )]);
    rests_and_comes_back(&outcome, &codes, 175 * MILLISECOND, Fault::Watchdog);
    assert_eq!(outcome.resets, 1);
}

/// Acknowledges the sample clock's interrupt and returns:
/// `mov.w r0, #0x40000000; mvn.w r1, #16; str r1, [r0, #16]; bx lr`.
const ACKNOWLEDGE_AND_RETURN: [u16; 6] = [0xF04F, 0x4080, 0xF06F, 0x0110, 0x6101, 0x4770];

#[test]
fn tasks_that_go_on_without_ticks_are_not_taken_for_a_program_that_runs() {
    let (outcome, codes) = with_instructions(&ACKNOWLEDGE_AND_RETURN);
    rests_and_comes_back(&outcome, &codes, 175 * MILLISECOND, Fault::Watchdog);
    assert_eq!(outcome.resets, 1);
}

#[test]
fn a_brown_out() {
    let (outcome, codes) = with_injections(vec![(
        100 * MILLISECOND,
        Injection::Restart {
            flags: BROWN_OUT_FLAG,
        },
    )]);
    rests_and_comes_back(&outcome, &codes, 110 * MILLISECOND, Fault::BrownOut);
    assert_eq!(outcome.resets, 1);
}

#[test]
fn a_supply_that_falls() {
    // To between the detector's level and the brown-out, for 100 ms.
    let (outcome, codes) = with_injections(vec![
        (100 * MILLISECOND, Injection::Supply { millivolts: 2_600 }),
        (200 * MILLISECOND, Injection::Supply { millivolts: 3_300 }),
    ]);
    // At once: the interrupt waits at most for the end of a tick.
    rests_and_comes_back(
        &outcome,
        &codes,
        100 * MILLISECOND + 60_000,
        Fault::SupplyLow,
    );
    assert_eq!(
        outcome.resets,
        1,
        "and waits for the supply: {:?}",
        texts(&outcome)
    );
    assert_texts(&outcome, "below 2.8 V: waiting", 1);
    assert_texts(&outcome, "last restart: supply low", 1);
    let fault_at = outcome
        .messages
        .iter()
        .find(|message| message.text == "mode fault: supply low")
        .map(|message| message.at_ns);
    assert!(
        fault_at > Some(200 * MILLISECOND),
        "nothing runs before the supply is there: {fault_at:?}"
    );
}

#[test]
fn without_a_reader_the_control_goes_on_and_losses_are_seen() {
    let bench = Bench::reference().expect("the bench");
    let run_with = |read_every_ns| {
        let world = World::new(&bench, Variant::PLAIN, 3).shared();
        let script = Script {
            block: Some(block(&parameters())),
            read_every_ns,
            commands: vec![(
                4 * MILLISECOND,
                b"trace 31 1\narm untested\nconditioning waived\nreference constant 3000\n@500 enable\n".to_vec(),
            )],
            ..Script::listening(500 * MILLISECOND)
        };
        let outcome = run_on(&world, script);
        let codes = world.lock().expect("the world").codes.clone();
        (outcome, codes)
    };
    let (_, codes) = run_with(Some(MILLISECOND));
    let (absent, codes_absent) = run_with(None);
    assert_eq!(
        codes, codes_absent,
        "the loop does not know whether somebody listens"
    );
    assert!(absent.raw.is_empty());
    let (slow, codes_slow) = run_with(Some(140 * MILLISECOND));
    let (samples, lost) = samples(&slow);
    let gaps = samples
        .windows(2)
        .filter(|pair| pair[1].tick != pair[0].tick + 1 && pair[1].tick != pair[0].tick + 20)
        .count();
    println!(
        "slow reader: {} samples came, {gaps} gaps, {} torn frames, {lost} lost on the target",
        samples.len(),
        slow.malformed
    );
    assert_eq!(codes.len(), codes_slow.len());
    assert!(gaps > 0 || slow.malformed > 0, "a loss is seen");
}

#[test]
fn what_is_not_a_command_is_refused() {
    let bench = Bench::reference().expect("the bench");
    let world = World::new(&bench, Variant::PLAIN, 3).shared();
    let script = Script {
        block: Some(block(&parameters())),
        commands: vec![(
            5 * MILLISECOND,
            [
                b"enabel\nreference sine\n\xff\xfe\n".to_vec(),
                vec![b'x'; 200],
                b"\narm untested\nconditioning waived\nenable\n".to_vec(),
            ]
            .concat(),
        )],
        ..Script::listening(60 * MILLISECOND)
    };
    let outcome = run_on(&world, script);
    assert!(
        outcome.texts_with("refused:").count() >= 4,
        "{:?}",
        outcome.messages
    );
    assert_eq!(outcome.texts_with("mode closed").count(), 1);
    assert_eq!(outcome.resets, 0);
}

/// Closed loop; then a line is opened from 60 ms to 160 ms, with `clear` while it is open and again
/// afterwards.
fn with_an_open_line(line: SafetyLine, fault: Fault) {
    let world = world();
    let mut parameters = parameters();
    parameters.guard.healthy_ticks = 100;
    let script = Script {
        block: Some(block(&parameters)),
        commands: vec![
            (
                4 * MILLISECOND,
                b"trace 31 1\narm untested\nconditioning waived\nreference constant 3000\nenable\n"
                    .to_vec(),
            ),
            (150 * MILLISECOND, b"clear\nenable\n".to_vec()),
            (
                170 * MILLISECOND,
                b"clear\narm untested\nreference constant 3000\nenable\n".to_vec(),
            ),
        ],
        injections: vec![
            (
                60 * MILLISECOND,
                Injection::Line {
                    line,
                    closed: false,
                },
            ),
            (160 * MILLISECOND, Injection::Line { line, closed: true }),
        ],
        ..Script::listening(240 * MILLISECOND)
    };
    let outcome = run_on(&world, script);
    let (samples, _) = samples(&outcome);
    let began_ns = world.lock().expect("the world").began_ns();
    let open_at = (60 * MILLISECOND - began_ns) / 50_000;
    let first = samples
        .iter()
        .find(|sample| sample.flags as u8 == Mode::Fault as u8)
        .expect("a fault");
    assert_eq!(
        first.flags,
        Mode::Fault as u16 | (fault as u16) << 8,
        "named"
    );
    let ticks = u64::from(first.tick).saturating_sub(open_at);
    println!(
        "{}: the ramp begins {ticks} ticks after the line was opened",
        fault.name()
    );
    assert!(ticks <= 2, "{ticks}");
    let before = samples
        .iter()
        .find(|sample| sample.tick + 1 == first.tick)
        .expect("the tick before");
    assert_eq!(
        before.dac_code,
        first.dac_code + parameters.guard.ramp_codes,
        "on the way to rest in the very tick"
    );
    let closed_again = |sample: &&hysteron_core::trace_frame::TraceSample| {
        sample.tick > first.tick && sample.flags == Mode::Closed as u16
    };
    let again = samples.iter().find(closed_again).expect("closed again");
    assert!(
        u64::from(again.tick) > (160 * MILLISECOND - began_ns) / 50_000,
        "not while the line is open: tick {}",
        again.tick
    );
    assert!(
        outcome
            .texts_with(&format!("mode fault: {}", fault.name()))
            .count()
            >= 1,
        "said"
    );
    // The enable output: on from the start, off once the drive rests, on again when the fault was cleared.
    let changes: Vec<(u64, bool)> = outcome
        .enabled
        .iter()
        .map(|(at, on)| (at / MILLISECOND, *on))
        .collect();
    let states: Vec<bool> = changes.iter().map(|(_, on)| *on).collect();
    assert_eq!(states, [true, false, true], "{changes:?}");
    let rests = samples
        .iter()
        .find(|sample| sample.tick > first.tick && sample.dac_code == parameters.guard.rest_code)
        .expect("rest");
    let rests_ms = (u64::from(rests.tick) * 50_000 + began_ns) / MILLISECOND;
    assert!(
        (rests_ms..=rests_ms + 2).contains(&changes[1].0) && (160..180).contains(&changes[2].0),
        "{changes:?}, rest at {rests_ms} ms"
    );
}

#[test]
fn what_was_planned_before_a_fault_does_not_act_after_it() {
    let world = world();
    let mut parameters = parameters();
    parameters.guard.healthy_ticks = 100;
    let line = SafetyLine::EmergencyStop;
    let script = Script {
        block: Some(block(&parameters)),
        commands: vec![
            (4 * MILLISECOND, b"trace 31 1\narm untested\nconditioning waived\nreference constant 3000\nenable\n@3000 enable\n".to_vec()),
            (100 * MILLISECOND, b"clear\n".to_vec()),
        ],
        injections: vec![
            (60 * MILLISECOND, Injection::Line { line, closed: false }),
            (80 * MILLISECOND, Injection::Line { line, closed: true }),
        ],
        ..Script::listening(180 * MILLISECOND)
    };
    let outcome = run_on(&world, script);
    let (samples, _) = samples(&outcome);
    let first = |mode: Mode, from: u32| {
        samples
            .iter()
            .find(|s| s.tick >= from && s.flags as u8 == mode as u8)
            .map(|s| s.tick)
    };
    let closed = first(Mode::Closed, 0).expect("closed");
    let stopped = first(Mode::Fault, closed).expect("stopped");
    let cleared = first(Mode::Rest, stopped).expect("cleared");
    assert!(
        cleared < 3_000 && samples.last().is_some_and(|sample| sample.tick > 3_200),
        "{cleared}: {:?}",
        texts(&outcome)
    );
    assert_eq!(first(Mode::Closed, cleared), None, "{:?}", texts(&outcome));
}

#[test]
fn an_emergency_stop() {
    with_an_open_line(SafetyLine::EmergencyStop, Fault::EmergencyStop);
}

#[test]
fn an_open_interlock() {
    with_an_open_line(SafetyLine::Interlock, Fault::Interlock);
}

#[test]
fn an_amplifier_that_is_not_ready() {
    with_an_open_line(SafetyLine::AmplifierReady, Fault::AmplifierNotReady);
}

#[test]
fn a_converter_that_lost_its_supply_is_set_up_again_at_rest_and_only_there() {
    let bench = Bench::reference().expect("the bench");
    let scale = bench.converter_scale();
    let mut world = World::new(&bench, Variant::PLAIN, 3);
    // In the closed loop: the drive is gone, the tracking error ends it, and at rest the converter comes
    // back.
    world.converter_brown_outs.push(2000);
    let world = world.shared();
    let mut parameters = parameters();
    parameters.guard.healthy_ticks = 100;
    parameters.guard.tracking_error = 1 << 24;
    parameters.guard.tracking_ticks = 100;
    let script = Script {
        block: Some(block(&parameters)),
        commands: vec![
            (
                4 * MILLISECOND,
                b"trace 31 1\narm untested\nconditioning waived\nreference constant 3000\nenable\n"
                    .to_vec(),
            ),
            (
                320 * MILLISECOND,
                b"clear\narm untested\nreference constant 3000\nenable\n".to_vec(),
            ),
        ],
        ..Script::listening(400 * MILLISECOND)
    };
    let outcome = run_on(&world, script);
    assert!(
        outcome.texts_with("mode fault: tracking error").count() == 1,
        "{:?}",
        outcome.texts_with("mode").collect::<Vec<_>>()
    );
    let world = world.lock().expect("the world");
    let ground = scale.dac_code(0.0);
    let dead = world
        .codes
        .iter()
        .skip(2000)
        .take_while(|(_, acting)| *acting == ground)
        .count();
    println!("the drive's converter without its supply: back {dead} edges later");
    let last = world.codes.last().expect("codes").1;
    assert!(
        last > parameters.guard.rest_code + 5000,
        "closed again, and the drive acts: {last}"
    );
    assert!(
        world
            .codes
            .iter()
            .skip(200)
            .all(|(_, acting)| *acting >= ground),
        "never below ground: its register was empty"
    );
}
