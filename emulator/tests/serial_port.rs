//! The serial port of the unmodified image: the General Command Set over USART3, at its baud rate, below the control interrupt.

mod common;

use common::{best_parameters, block, image};
use hysteron_emulator::board::NucleoBoard;
use hysteron_emulator::converters::{SharedWorld, World};
use hysteron_emulator::run::{MILLISECOND, Outcome, Script, run};
use hysteron_sim::bench::{Bench, Variant};

fn run_with(serial: Vec<(u64, Vec<u8>)>, until_ms: u64) -> (Outcome, SharedWorld) {
    let world = World::new(&Bench::reference().expect("the bench"), Variant::FULL, 3).shared();
    let script = Script { block: Some(block(&best_parameters())), serial, ..Script::listening(until_ms * MILLISECOND) };
    let outcome = run(&image(), NucleoBoard::with_plant(&world).expect("a board"), script).expect("a run");
    (outcome, world)
}

fn text(outcome: &Outcome) -> String {
    outcome.serial.iter().map(|(_, byte)| char::from(*byte)).collect()
}

#[test]
fn a_conversation_moves_the_axis_and_reads_it_back() {
    let lines = "*IDN?\nSVO 1 1\nERR?\nVEL 1 500\nMOV 1 3\nERR?\nMOV 1 99\nERR?\nXYZ\nERR?\n";
    let (outcome, world) =
        run_with(vec![(10 * MILLISECOND, lines.into()), (120 * MILLISECOND, b"POS?\nONT? 1\nSVO?\nVOL?\n\x07".to_vec())], 150);
    let answers = text(&outcome);
    let lines: Vec<&str> = answers.lines().collect();
    assert_eq!(lines.len(), 10, "{answers:?}");
    assert!(lines[0].contains("HYSTERON"), "{answers:?}");
    assert_eq!((lines[1], lines[2], lines[3], lines[4]), ("0", "0", "7", "2"), "{answers:?}");
    let number = |line: &str| -> f64 { line.trim_start_matches("1=").parse().expect("a number") };
    assert!((number(lines[5]) - 3.0).abs() < 0.05, "{answers:?}");
    assert_eq!((lines[6], lines[7]), ("1=1", "1=1"));
    assert!(number(lines[8]) > 1.0, "{answers:?}");
    assert_eq!(lines[9].chars().next(), Some('\u{b1}'));
    // 115200 baud: ten bits take 86.8 us.
    let fastest = outcome.serial.windows(2).map(|pair| pair[1].0 - pair[0].0).min();
    assert!((86_000..88_000).contains(&fastest.expect("bytes")), "{fastest:?}");
    // What the port says is what the converters did.
    let world = world.lock().expect("the world");
    let highest = world.codes.iter().map(|(_, acting)| *acting).max().expect("codes");
    assert!(highest > best_parameters().guard.rest_code + 1000, "the drive moved: {highest}");
    assert_eq!(outcome.resets, 0);
}

#[test]
fn a_stop_is_not_held_up_by_an_answer_that_is_being_sent() {
    let begin = "SVO 1 1\nMOV 1 5\nHLP?\nHLP?\n";
    // The two lists take half a second at this baud rate.
    let (outcome, world) = run_with(vec![(10 * MILLISECOND, begin.into()), (100 * MILLISECOND, b"\x18".to_vec())], 200);
    let rest = best_parameters().guard.rest_code;
    let sent_until = outcome.serial.last().expect("an answer").0;
    assert!(
        sent_until > 190 * MILLISECOND,
        "the answer has ended at {sent_until} ns, {} bytes, ends with {:?}",
        outcome.serial.len(),
        text(&outcome).chars().rev().take(80).collect::<String>()
    );
    let world = world.lock().expect("the world");
    let first = world.began_ns();
    // The byte takes 87 us on the line.
    let edge = |at_ns: u64| usize::try_from((at_ns - first) / 50_000).expect("an edge");
    let before = world.codes[edge(100 * MILLISECOND)].1;
    assert!(before > rest + 5_000, "the loop is closed: {before}");
    let ramp = best_parameters().guard.ramp_codes;
    let turned = (edge(100 * MILLISECOND)..world.codes.len() - 20)
        .find(|at| world.codes[*at..*at + 20].windows(2).all(|pair| pair[0].1 - pair[1].1 == ramp || pair[1].1 == rest))
        .expect("a ramp");
    let late_us = (turned as u64 * 50_000 + first).saturating_sub(100 * MILLISECOND) / 1000;
    println!("stop: the ramp began {late_us} us after the byte was given to the line");
    assert!(late_us < 1_300, "{late_us} us");
    assert_eq!(world.codes.last().map(|codes| codes.1), Some(rest));
    let said: Vec<&str> = outcome.messages.iter().map(|message| message.text.as_str()).collect();
    assert!(said.iter().any(|text| text.starts_with("stopped")), "{said:?}");
}
