//! The serial port of the unmodified image: the General Command Set over USART3, at its baud rate, below the
//! control interrupt.

use crate::common;

use common::{best_parameters, block, run_on, typed_back};
use hysteron_emulator::converters::{SharedWorld, World};
use hysteron_emulator::run::{Injection, MILLISECOND, Outcome, Script};
use hysteron_sim::bench::{Bench, Variant};

fn run_with(serial: Vec<(u64, Vec<u8>)>, until_ms: u64) -> (Outcome, SharedWorld) {
    let world = World::new(&Bench::reference().expect("the bench"), Variant::FULL, 3).shared();
    let script = Script {
        block: Some(block(&best_parameters())),
        serial,
        ..Script::listening(until_ms * MILLISECOND)
    };
    let outcome = run_on(&world, script);
    (outcome, world)
}

fn text(outcome: &Outcome) -> String {
    typed_back(outcome)
}

#[test]
fn a_conversation_moves_the_axis_and_reads_it_back() {
    let lines = "*IDN?\nARM 1 2\nRON 1 0\nSVO 1 1\nERR?\nVEL 1 500\nMOV 1 3\nERR?\nMOV 1 99\nERR?\nXYZ\nERR?\n";
    let (outcome, world) = run_with(
        vec![
            (10 * MILLISECOND, lines.into()),
            (
                120 * MILLISECOND,
                b"POS?\nONT? 1\nSVO?\nVOL?\n\x07".to_vec(),
            ),
        ],
        150,
    );
    let answers = text(&outcome);
    let lines: Vec<&str> = answers.lines().collect();
    assert_eq!(lines.len(), 10, "{answers:?}");
    assert!(lines[0].contains("HYSTERON"), "{answers:?}");
    assert_eq!(
        (lines[1], lines[2], lines[3], lines[4]),
        ("0", "0", "7", "2"),
        "{answers:?}"
    );
    let number = |line: &str| -> f64 { line.trim_start_matches("1=").parse().expect("a number") };
    assert!((number(lines[5]) - 3.0).abs() < 0.05, "{answers:?}");
    assert_eq!((lines[6], lines[7]), ("1=1", "1=1"));
    assert!(number(lines[8]) > 1.0, "{answers:?}");
    assert_eq!(lines[9].chars().next(), Some('\u{b1}'));
    // 115200 baud: ten bits take 86.8 us.
    let fastest = outcome
        .serial
        .windows(2)
        .map(|pair| pair[1].0 - pair[0].0)
        .min();
    assert!(
        (86_000..88_000).contains(&fastest.expect("bytes")),
        "{fastest:?}"
    );
    // What the port says is what the converters did.
    let world = world.lock().expect("the world");
    let highest = world
        .codes
        .iter()
        .map(|(_, acting)| *acting)
        .max()
        .expect("codes");
    assert!(
        highest > best_parameters().guard.rest_code + 1000,
        "the drive moved: {highest}"
    );
    assert_eq!(outcome.resets, 0);
}

#[test]
fn a_stop_is_not_held_up_by_an_answer_that_is_being_sent() {
    let begin = "ARM 1 2\nRON 1 0\nSVO 1 1\nMOV 1 5\nHLP?\nHLP?\n";
    // The two lists take half a second at this baud rate.
    let (outcome, world) = run_with(
        vec![
            (10 * MILLISECOND, begin.into()),
            (100 * MILLISECOND, b"\x18".to_vec()),
        ],
        200,
    );
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
        .find(|at| {
            world.codes[*at..*at + 20]
                .windows(2)
                .all(|pair| pair[1].1 + ramp == pair[0].1 || pair[1].1 == rest)
        })
        .expect("a ramp");
    let late_us = (turned as u64 * 50_000 + first).saturating_sub(100 * MILLISECOND) / 1000;
    println!("stop: the ramp began {late_us} us after the byte was given to the line");
    assert!(late_us < 1_300, "{late_us} us");
    assert_eq!(world.codes.last().map(|codes| codes.1), Some(rest));
    let said: Vec<&str> = outcome
        .messages
        .iter()
        .map(|message| message.text.as_str())
        .collect();
    assert!(
        said.iter().any(|text| text.starts_with("stopped")),
        "{said:?}"
    );
}

/// Lines that bring a block, a few at a time.
fn upload(block: &[u8], from_ms: u64) -> Vec<(u64, Vec<u8>)> {
    let mut lines = vec![format!("BLK BEGIN {}\n", block.len())];
    lines.extend(block.chunks(32).enumerate().map(|(nth, piece)| {
        let digits: String = piece.iter().map(|byte| format!("{byte:02x}")).collect();
        format!("BLK DATA {} {digits}\n", 32 * nth)
    }));
    let bunches = lines.chunks(16).enumerate();
    bunches
        .map(|(nth, bunch)| {
            (
                (from_ms + 20 * nth as u64) * MILLISECOND,
                bunch.concat().into_bytes(),
            )
        })
        .collect()
}

#[test]
fn from_an_empty_flash_a_block_is_brought_kept_and_taken() {
    let good = block(&best_parameters());
    let mut serial = vec![(
        10 * MILLISECOND,
        b"SVO 1 1\nERR?\nRBT 1\nERR?\nIFC RSBAUD 921600\n".to_vec(),
    )];
    serial.extend(upload(&good, 30));
    serial.push((
        130 * MILLISECOND,
        b"ERR?\nBLK COMMIT\nBLK?\nRBT\nERR?\n".to_vec(),
    ));
    serial.push((1_300 * MILLISECOND, b"BLK?\nRBT\n".to_vec()));
    serial.push((
        1_350 * MILLISECOND,
        b"*IDN?\nDIA? 1 2 8 9\nIFC?\nARM 1 2\nATZ 1\nERR?\n".to_vec(),
    ));
    let world = World::new(&Bench::reference().expect("the bench"), Variant::FULL, 3).shared();
    let script = Script {
        serial,
        ..Script::listening(1_400 * MILLISECOND)
    };
    let outcome = run_on(&world, script);
    let answers = text(&outcome);
    let lines: Vec<&str> = answers.lines().map(str::trim_end).collect();
    let fingerprint = hysteron_core::parameter_block::fingerprint(&good).expect("a block");
    let last = format!("9={fingerprint}");
    assert_eq!(
        lines[..6],
        ["201", "24", "0", "BUSY", "93", "KEPT"],
        "{answers:?}"
    );
    assert!(lines[6].contains("HYSTERON"), "{answers:?}");
    assert_eq!(
        lines[7..],
        ["1=0", "2=0", "8=1", last.as_str(), "RSBAUD=115200", "0"],
        "{answers:?}"
    );
    assert_eq!(outcome.resets, 1);
    // Ten bits at the speed that was asked for, and again at the usual one after the restart.
    let gaps = |from: u64, to: u64| {
        let sent = outcome
            .serial
            .windows(2)
            .filter(move |pair| (from..to).contains(&(pair[0].0 / MILLISECOND)));
        sent.map(|pair| pair[1].0 - pair[0].0).min().expect("bytes")
    };
    assert!(
        (10_700..11_000).contains(&gaps(130, 200)),
        "{}",
        gaps(130, 200)
    );
    assert!(
        (86_000..88_000).contains(&gaps(1_350, 1_400)),
        "{}",
        gaps(1_350, 1_400)
    );
}

#[test]
fn a_wave_with_the_servo_off_is_a_drive_and_its_record_begins_with_it() {
    let stairs = "ARM 1 2\nWAV 1 X LIN 40 60 0 40 0 0\nWAV 1 & LIN 40 -60 60 40 0 0\nWSL 1 1\nWGC 1 1\nWTR 1 10 0\nRTR 10\nWGO 1 1\nERR?\n";
    let (outcome, world) = run_with(
        vec![
            (10 * MILLISECOND, stairs.into()),
            (70 * MILLISECOND, b"WGO?\nDRR? 1 80 2 4\n".to_vec()),
        ],
        320,
    );
    let answers = text(&outcome);
    let (head, rows) = answers.split_once("# END_HEADER \n").expect("a header");
    assert!(head.starts_with("0\n1=0\n"), "{head:?}");
    let rows: Vec<f64> = rows
        .lines()
        .map(|row| {
            row.split_whitespace()
                .nth(1)
                .and_then(|word| word.parse().ok())
                .expect("a drive")
        })
        .collect();
    assert_eq!(rows.len(), 80);
    // Each sample has the drive that acts from it on, and for as many ticks as lie between two samples.
    let scale = Bench::reference().expect("the bench").converter_scale();
    let world = world.lock().expect("the world");
    let acting: Vec<f64> = world
        .codes
        .iter()
        .map(|(_, acting)| scale.drive_v(*acting))
        .collect();
    let rest_v = acting[100];
    let begin = acting
        .iter()
        .rposition(|v| (v - rest_v).abs() > 1e-6)
        .expect("a drive")
        + 1;
    let first = (0..begin).find(|edge| {
        (0..80).all(|nth| {
            (0..10).all(|tick| (acting[edge + 10 * nth + tick] - rows[nth]).abs() < 2e-3)
        })
    });
    assert!(
        first.is_some(),
        "the record is not in step with the drive: {rows:?}"
    );
}

/// A byte takes so long at 115200 bit/s, ns.
const BYTE_NS: u64 = 86_806;

/// `SVA 1` of 10 V, in which something goes wrong between two of its bytes, and the same once more.
fn drive_with(injections: impl Fn(u64) -> Vec<(u64, Injection)>) -> (String, u32, u32) {
    let world = World::new(&Bench::reference().expect("the bench"), Variant::FULL, 3).shared();
    let (first, second) = (30 * MILLISECOND, 80 * MILLISECOND);
    // Seventeen bytes wait in the receiver's own queue.
    let line = "SVA 1                                  10.0\n";
    let script = Script {
        block: Some(block(&best_parameters())),
        serial: vec![
            (10 * MILLISECOND, b"ARM 1 2\nERR?\n".to_vec()),
            (first, line.into()),
            (first + 10 * MILLISECOND, b"ERR?\nERR?\n".to_vec()),
            (second, line.into()),
            (second + 10 * MILLISECOND, b"ERR?\n".to_vec()),
        ],
        injections: injections(first),
        ..Script::listening(130 * MILLISECOND)
    };
    let outcome = run_on(&world, script);
    let world = world.lock().expect("the world");
    let highest = |from_ms: u64, to_ms: u64| {
        let edge = |ms: u64| ((ms * MILLISECOND - world.began_ns()) / world.period_ns) as usize;
        let acting = &world.codes[edge(from_ms)..edge(to_ms)];
        acting
            .iter()
            .map(|(_, code)| code.steps())
            .max()
            .unwrap_or(0)
    };
    (text(&outcome), highest(20, 79), highest(80, 129))
}

#[test]
fn a_line_that_lost_a_byte_moves_nothing_and_is_an_error() {
    let (rest, ten_volts) = (9_362, 14_043);
    // Without its dot the line is 100 V.
    let dot = 42;
    let during = |from: u64, to: u64, what: Injection, end: Injection| {
        move |first: u64| {
            vec![
                (first + from * BYTE_NS + BYTE_NS / 2, what),
                (first + to * BYTE_NS + BYTE_NS / 2, end),
            ]
        }
    };
    let clean = Injection::SerialErrors {
        noise: 0,
        framing: 0,
    };
    let noise = Injection::SerialErrors {
        noise: 1_000_000,
        framing: 0,
    };
    let framing = Injection::SerialErrors {
        noise: 0,
        framing: 1_000_000,
    };
    for (what, (answers, broken, whole)) in [
        ("noise", drive_with(during(dot, dot + 1, noise, clean))),
        ("framing", drive_with(during(dot, dot + 1, framing, clean))),
        (
            "overrun",
            drive_with(during(
                3,
                30,
                Injection::SerialDeaf(true),
                Injection::SerialDeaf(false),
            )),
        ),
    ] {
        assert_eq!(answers, "0\n4003\n0\n0\n", "{what}");
        assert!(broken <= rest + 1, "{what}: {broken}");
        assert!(whole.abs_diff(ten_volts) <= 2, "{what}: {whole}");
    }
}

#[test]
fn a_stop_byte_acts_in_the_interrupt() {
    let world = World::new(&Bench::reference().expect("the bench"), Variant::FULL, 3).shared();
    let sent = 60 * MILLISECOND;
    let script = Script {
        block: Some(block(&best_parameters())),
        serial: vec![
            (10 * MILLISECOND, b"ARM 1 2\nSVA 1 60\n".to_vec()),
            (sent, vec![0x18]),
        ],
        ..Script::listening(70 * MILLISECOND)
    };
    run_on(&world, script);
    let world = world.lock().expect("the world");
    let falls = world
        .codes
        .windows(2)
        .position(|pair| pair[1].1 < pair[0].1)
        .expect("the drive goes to rest");
    let acts_ns = world.began_ns() + (falls as u64 + 1) * world.period_ns;
    // A byte, the rest of the period in which it ends, and the one in which the code is computed. A task
    // would wait until the line is silent for a byte more.
    let most_ns = BYTE_NS + 2 * world.period_ns;
    assert!(
        (sent..sent + most_ns).contains(&acts_ns),
        "{} ns",
        acts_ns - sent
    );
}
