//! The trigger output of the unmodified image: it is high while the chosen point of a wave acts.

use crate::common;

use common::{best_parameters, block, run_on, typed_back};
use hysteron_emulator::converters::World;
use hysteron_emulator::run::{MILLISECOND, Script};
use hysteron_sim::bench::{Bench, Variant};

/// Time between two edges of the sample clock, which is also how often the pin is looked at, ns.
const PERIOD_NS: u64 = 50_000;
/// Ticks of a point.
const TICKS: u64 = 6;

#[test]
fn the_output_is_high_while_the_chosen_point_acts_in_every_cycle() {
    // Points 1 to 4 at 10 V but the third, at 11 V; three cycles from rest with the servo off.
    let lines = format!(
        "ARM 1 2\nWAV 1 X PNT 1 4 10 10 11 10\nWSL 1 1\nWGC 1 3\nWTR 1 {TICKS} 0\nTWS 1 5000 1\nERR?\nTWS 2 3 1\nERR?\nTWS 1 3 1\nERR?\nTWS?\nWGO 1 1\n"
    );
    let serial = vec![
        (10 * MILLISECOND, lines.into_bytes()),
        // The same wave without a trigger point.
        (80 * MILLISECOND, b"TWC\nTWS?\nWGO 1 1\nERR?\n".to_vec()),
    ];
    let world = World::new(&Bench::reference().expect("the bench"), Variant::FULL, 3).shared();
    let script = Script {
        block: Some(block(&best_parameters())),
        serial,
        read_every_ns: Some(PERIOD_NS),
        ..Script::listening(130 * MILLISECOND)
    };
    let outcome = run_on(&world, script);
    let answers: String = typed_back(&outcome);
    assert_eq!(answers, "17\n17\n0\n1=3\n1=0\n0\n");

    // When the third point acted, as the drive's converter saw it.
    let world = world.lock().expect("the world");
    let began_ns = world.began_ns();
    // 0.5 V above the 10 V of the others, of -20..120 V.
    let is_third =
        |code: hysteron_core::codes::DriveCode| f64::from(code) > (10.5 + 20.0) / 140.0 * 65_536.0;
    let acting: Vec<bool> = world
        .codes
        .iter()
        .map(|(_, code)| is_third(*code))
        .collect();
    let edges: Vec<(u64, bool)> = (1u64..)
        .zip(acting.windows(2))
        .filter(|(_, pair)| pair[0] != pair[1])
        .map(|(edge, pair)| (began_ns + edge * PERIOD_NS, pair[1]))
        .collect();
    assert_eq!(edges.len(), 12, "three cycles, twice: {edges:?}");
    assert_eq!(
        outcome.triggered.len(),
        6,
        "with the first three, and not without a point: {:?}",
        outcome.triggered
    );
    for ((seen_ns, high), (acts_ns, third)) in outcome.triggered.iter().zip(&edges) {
        let late_ns = seen_ns.checked_sub(*acts_ns);
        assert!(
            high == third && late_ns.is_some_and(|late_ns| late_ns <= PERIOD_NS),
            "{:?}\n{edges:?}",
            outcome.triggered
        );
    }
    assert_eq!(outcome.resets, 0);
}
