//! The checks for a first board run as they are on the emulated part, with a wire from the drive's converter
//! to the sensor's.

use crate::common;

use common::image_named;
use hysteron_emulator::board::{NucleoBoard, ONE_INSTRUCTION_PER_CYCLE};
use hysteron_emulator::converters::World;
use hysteron_emulator::run::{MILLISECOND, Script, run};
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

fn verdicts(wire: bool) -> Vec<String> {
    let mut world = World::new(&Bench::reference().expect("the bench"), Variant::PLAIN, 3);
    world.wire = wire;
    let mut board = NucleoBoard::with_plant(&world.shared()).expect("a board");
    board.instructions_per_second = ONE_INSTRUCTION_PER_CYCLE;
    let outcome = run(
        &image_named("board_check"),
        board,
        Script::listening(4_000 * MILLISECOND),
    )
    .expect("a run");
    outcome.texts_with("check").map(str::to_owned).collect()
}

#[test]
fn a_wired_board_passes_every_check() {
    let texts = verdicts(true);
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
}

#[test]
fn an_actuator_instead_of_the_wire_is_found_out() {
    let texts = verdicts(false);
    assert!(
        texts
            .iter()
            .any(|text| text.starts_with("check linearity:") && text.ends_with("FAIL")),
        "{texts:?}"
    );
}
