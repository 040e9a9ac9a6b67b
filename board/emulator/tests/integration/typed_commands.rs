//! What is typed at the probe and must not act: a loop around an actuator whose memory nobody knows, and
//! references and drives beyond their limits.

use crate::common;

use common::{block, parameters, run_command, run_on, samples, texts, world};
use hysteron_core::amplifier::Mode;
use hysteron_emulator::board::SafetyLine;
use hysteron_emulator::converters::World;
use hysteron_emulator::run::{Injection, MILLISECOND, Script};
use hysteron_sim::bench::{Bench, Variant};

#[test]
fn the_loop_closes_only_around_a_conditioned_actuator() {
    let world = World::new(&Bench::reference().expect("the bench"), Variant::FULL, 3).shared();
    let mut parameters = parameters();
    parameters.guard.healthy_ticks = 100;
    let script = Script {
        block: Some(block(&parameters)),
        commands: vec![
            (
                4 * MILLISECOND,
                b"trace 31 1\narm untested\nreference constant 3000\nenable\n".to_vec(),
            ),
            (20 * MILLISECOND, b"arm untested\ncondition\n".to_vec()),
            // 0.1 s of cycle, the ramp, 1 s of rest.
            (1_300 * MILLISECOND, b"status\nenable\n".to_vec()),
            (
                1_450 * MILLISECOND,
                b"clear\narm untested\nstatus\nenable\n".to_vec(),
            ),
            (
                1_460 * MILLISECOND,
                b"arm untested\nconditioning waived\nenable\n".to_vec(),
            ),
        ],
        injections: vec![
            (
                1_350 * MILLISECOND,
                Injection::Line {
                    line: SafetyLine::Interlock,
                    closed: false,
                },
            ),
            (
                1_400 * MILLISECOND,
                Injection::Line {
                    line: SafetyLine::Interlock,
                    closed: true,
                },
            ),
        ],
        ..Script::listening(1_480 * MILLISECOND)
    };
    let outcome = run_on(&world, script);
    let refused: Vec<u64> = outcome
        .messages
        .iter()
        .filter(|message| {
            message
                .text
                .contains("not conditioned since the start or the last fault")
        })
        .map(|message| message.at_ns / MILLISECOND)
        .collect();
    assert!(
        matches!(refused[..], [4..20, 1_450..1_460]),
        "{refused:?}: {:?}",
        texts(&outcome)
    );
    let (samples, _) = samples(&outcome);
    let began_ns = world.lock().expect("the world").began_ns();
    let closed: Vec<u64> = samples
        .windows(2)
        .filter(|pair| pair[0].flags != pair[1].flags && pair[1].flags == Mode::Closed as u16)
        .map(|pair| (u64::from(pair[1].tick) * 50_000 + began_ns) / MILLISECOND)
        .collect();
    assert!(
        matches!(closed[..], [1_300..1_310, 1_460..1_470]),
        "{closed:?}: {:?}",
        texts(&outcome)
    );
    let said: Vec<&str> = outcome.texts_with("conditioned: ").collect();
    assert!(
        matches!(said[..], [first, second] if first.starts_with("conditioned: true") && second.starts_with("conditioned: false")),
        "{said:?}"
    );
}

#[test]
fn what_leaves_the_limits_is_refused_with_them_and_nothing_moves() {
    let world = world();
    let parameters = parameters();
    let beyond = [
        "reference constant 20000",
        "reference constant -2000",
        "reference sine 1000 9000 9000",
        "reference step 20000 0 100",
        "@200 reference constant 20000",
        "play sine 0 0 80001 100",
        "play sine 1000 1000 0 100",
        "play chirp 1000 2000 60000 60000 100",
    ];
    let text = beyond.join("\n") + "\nreference constant 3000\n";
    let outcome = run_command(&world, &parameters, text, 60);
    let refused: Vec<&str> = outcome.texts_with("beyond the limits").collect();
    assert_eq!(refused.len(), beyond.len(), "{:?}", texts(&outcome));
    // 15 um of sensor with 16 codes at either end that it does not honestly give, from -1 um on.
    let nearest_nm = |code: f64| (-1_000.0 + code * 15_000.0 / 65_536.0).round();
    let expected = format!(
        "{} to {} nm and 0 to 80000 mV",
        nearest_nm(16.0),
        nearest_nm(65_519.0)
    );
    assert!(
        refused.iter().all(|text| text.ends_with(&expected)),
        "{expected}: {refused:?}"
    );
    assert_eq!(
        outcome.texts_with("done at tick").count(),
        1,
        "what is within them is taken: {:?}",
        texts(&outcome)
    );
    let world = world.lock().expect("the world");
    assert!(
        world
            .codes
            .iter()
            .all(|(_, acting)| *acting == parameters.guard.rest_code),
        "the drive has not moved"
    );
}
