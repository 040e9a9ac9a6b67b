//! The checks for a first board run as they are on the emulated part, with a wire from the drive's converter
//! to the sensor's.

use crate::common;
use crate::dangers::acting;

use common::image_named;
use hysteron_emulator::board::{NucleoBoard, ONE_INSTRUCTION_PER_CYCLE};
use hysteron_emulator::converters::{SharedWorld, World};
use hysteron_emulator::run::{MILLISECOND, Outcome, Script, run};
use hysteron_sim::bench::{Bench, Variant};

const CHECKS: [&str; 8] = [
    "period",
    "jitter",
    "noise",
    "delay",
    "linearity",
    "silent",
    "flash",
    "bus error",
];

/// The whole check in front of the bench's stage or a wire, with a watchdog that runs from the start.
fn check(wire: bool) -> (Outcome, Vec<String>, SharedWorld) {
    let mut world = World::new(&Bench::reference().expect("the bench"), Variant::PLAIN, 3);
    world.wire = wire;
    let world = world.shared();
    let mut board = NucleoBoard::with_plant(&world).expect("a board");
    board.instructions_per_second = ONE_INSTRUCTION_PER_CYCLE;
    let script = Script {
        hardware_watchdog: true,
        ..Script::listening(4_000 * MILLISECOND)
    };
    let outcome = run(&image_named("board_check"), board, script).expect("a run");
    let texts = outcome.texts_with("check").map(str::to_owned).collect();
    (outcome, texts, world)
}

#[test]
fn a_wired_board_passes_every_check() {
    let (outcome, texts, world) = check(true);
    println!("{texts:#?}");
    for check in CHECKS {
        assert!(
            texts
                .iter()
                .any(|text| text.starts_with(&format!("check {check}:")) && text.ends_with("pass")),
            "{check}: {texts:?}"
        );
    }
    assert_eq!(
        texts.last().map(String::as_str),
        Some("board check: 0 failed")
    );
    assert_eq!(
        (
            outcome.resets,
            outcome.texts_with("board check: 0 failed").count()
        ),
        (0, 1),
        "{texts:?}"
    );
    let most = acting(&world)
        .windows(2)
        .map(|pair| pair[0].abs_diff(pair[1]))
        .max()
        .expect("codes");
    // 100 V/ms, 5 V a tick, are the slew limit of the bench.
    assert!(most <= 2_341, "{most} codes in a tick");
}

#[test]
fn an_actuator_instead_of_the_wire_is_found_out() {
    let (_, texts, _) = check(false);
    assert!(
        texts
            .iter()
            .any(|text| text.starts_with("check linearity:") && text.ends_with("FAIL")),
        "{texts:?}"
    );
}
