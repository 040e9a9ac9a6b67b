//! Another image over the serial port: the unmodified image takes it, the unmodified boot stage installs it,
//! and a bad one leaves the image that was there.

use crate::common;

use std::net::TcpListener;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use common::{block, image, parameters, typed_back, world};
use hysteron_client::board::Board;
use hysteron_client::image::FirmwareImage;
use hysteron_client::port::Address;
use hysteron_client::update::{bring, install, state};
use hysteron_core::firmware_update::{H743ZI, HEADER_OFFSET, Mark, Request, UpdateKey, WORD_BYTES};
use hysteron_emulator::board::NucleoBoard;
use hysteron_emulator::run::{
    BROWN_OUT_FLAG, Injection, MILLISECOND, Outcome, Script, address_of, run,
};
use hysteron_emulator::serial_line::SharedLine;
use hysteron_emulator::serial_socket;

const SECOND: u64 = 1_000 * MILLISECOND;
/// What a flash word reads that is erased.
const ERASED: u64 = 0xFFFF_FFFF;

/// The key of the board, and that of somebody else.
const KEY: UpdateKey = UpdateKey::new(*b"the board's key.");
const OTHER_KEY: UpdateKey = UpdateKey::new(*b"another board's.");

/// The image under test as the line carries it.
fn sent() -> FirmwareImage {
    FirmwareImage::from_elf(&std::fs::read(image()).expect("an image"))
        .expect("an image of this board")
}

/// A program with other bytes at a place.
fn altered(at: usize, bytes: &[u8]) -> FirmwareImage {
    let mut image = sent().bytes;
    image[at..at + bytes.len()].copy_from_slice(bytes);
    FirmwareImage::from_bytes(image).expect("an image")
}

/// This program under another version.
fn newer() -> FirmwareImage {
    altered(HEADER_OFFSET as usize + 48, b"9.8.7\0")
}

/// The flash of a board to which an image has come, and which has not restarted yet.
fn requested(image: &FirmwareImage) -> Vec<(u64, Vec<u8>)> {
    let request = Request {
        bytes: image.bytes.len() as u32,
        code: image.signed(&KEY),
    };
    vec![
        (H743ZI.incoming.into(), image.bytes.clone()),
        (H743ZI.journal.into(), request.word().to_vec()),
    ]
}

/// The script on a board with [`KEY`], unless the script says what stands in its place.
fn run_with(mut script: Script) -> Outcome {
    let place = u64::from(H743ZI.key);
    if script.flash.iter().all(|(address, _)| *address != place) {
        script.flash.push((place, KEY.word().to_vec()));
    }
    let world = world();
    let outcome = run(
        &image(),
        NucleoBoard::with_plant(&world).expect("a board"),
        Script {
            block: Some(block(&parameters())),
            ..script
        },
    );
    outcome.expect("a run")
}

fn text(outcome: &Outcome) -> String {
    typed_back(outcome)
}

fn said(outcome: &Outcome) -> Vec<(u64, &str)> {
    let said = outcome
        .messages
        .iter()
        .filter(|message| !message.text.starts_with("trace ["));
    said.map(|message| (message.at_ns / MILLISECOND, message.text.as_str()))
        .collect()
}

const QUESTIONS: &[u8] = b"*IDN?\nUPD?\nDIA? 2\nLOG?\n";

/// Ends the run, however the operator ends.
struct End(Arc<AtomicBool>);

impl Drop for End {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
    }
}

#[test]
fn an_update_and_what_is_kept_exclude_each_other() {
    let answers = |serial: &[u8]| {
        let outcome = run_with(Script {
            serial: vec![(10 * MILLISECOND, serial.to_vec())],
            ..Script::listening(50 * MILLISECOND)
        });
        text(&outcome)
    };
    let kept =
        answers(b"UPD BEGIN 65536\nWPA 100\nERR?\nBLK COMMIT\nERR?\nBLK ENVELOPE 1\nERR?\nBLK?\n");
    assert_eq!(kept, "93\n93\n93\nNOTHING\n");
    let updated = answers(b"WPA 100\nUPD BEGIN 65536\nERR?\nBLK COMMIT\nERR?\nBLK?\n");
    assert_eq!(updated, "93\n93\nBUSY\n");
}

#[test]
fn only_a_signed_and_whole_update_over_the_line_runs() {
    let (line, ended) = (SharedLine::default(), Arc::new(AtomicBool::new(false)));
    let listener = TcpListener::bind("127.0.0.1:0").expect("a socket");
    let address =
        Address::tcp(&listener.local_addr().expect("an address").to_string()).expect("an address");
    serial_socket::serve(listener, &line);
    let end = End(Arc::clone(&ended));
    let operator = std::thread::spawn(move || {
        let _end = end;
        operate(&address)
    });
    let outcome = run_with(Script {
        line: Some(line),
        ended: Some(ended),
        ..Script::listening(600 * SECOND)
    });
    let result = operator.join().expect("the operator");
    println!(
        "{} ms of the board, {} instructions",
        outcome.end.0 / MILLISECOND,
        outcome.end.1
    );
    result.unwrap_or_else(|problem| panic!("{problem}: {:?}", said(&outcome)));
    assert_eq!(
        outcome.resets,
        2,
        "the restart behind the damaged image, and the one that installs: {:?}",
        said(&outcome)
    );
    assert!(
        outcome.enabled.iter().filter(|(_, on)| *on).count() <= 1,
        "the power stage was only on while armed: {:?}",
        outcome.enabled
    );
}

/// Lets the line be fast: it takes longer than the flash.
fn hurry(board: &mut Board) -> hysteron_client::Result<()> {
    board.send(b"IFC RSBAUD 921600\n")?;
    // Passes over late answers to greetings.
    state(board).map(|_| ())
}

/// What an operator does who sends a damaged image first.
fn operate(address: &Address) -> hysteron_client::Result<()> {
    // The emulated part needs a while to begin.
    let connected = (0..60).find_map(|_| Board::connect(address, None).ok());
    let mut board = connected.map_or_else(|| Board::connect(address, None), Ok)?;
    hurry(&mut board)?;
    let old = board.identification.clone();
    let new = newer();
    let code = new.signed(&KEY);
    board.tell("ARM 1 2")?;
    let refused = bring(&mut board, &new, &code, |_| {}).expect_err("armed");
    assert!(refused.message().contains("armed"), "{refused}");
    assert!(
        board
            .tell("UPD BEGIN 4096")
            .expect_err("armed")
            .message()
            .contains("error 93")
    );
    board.tell("ARM 1 0")?;
    board.wait("ARM? 1", |answer| Ok(answer == "1=0"))?;
    board.wait("DIA? 1", |mode| Ok(mode == "1=0"))?;

    // The first 16 KiB: not signed, signed for another board, and one of which a byte changes on its way.
    let part = FirmwareImage {
        bytes: new.bytes[..0x4000].to_vec(),
        ..new.clone()
    };
    let mut damaged = part.clone();
    damaged.bytes[0x2000] ^= 0x10;
    for (image, code) in [
        (&part, [0; 16]),
        (&part, part.signed(&OTHER_KEY)),
        (&damaged, part.signed(&KEY)),
    ] {
        let refused = bring(&mut board, image, &code, |_| {}).expect_err("not signed");
        assert!(
            refused
                .message()
                .contains("not signed with the board's key"),
            "{refused}"
        );
    }
    let nothing = install(&mut board, None, |_| {}).expect_err("nothing to install");
    assert!(nothing.message().contains("at NOTHING"), "{nothing}");
    hurry(&mut board)?;
    assert_eq!(
        board.identification, old,
        "the running image has not changed"
    );

    bring(&mut board, &new, &code, |_| {})?;
    assert_eq!(board.ask("*IDN?")?.trim(), old, "it runs until the restart");
    let now = install(&mut board, None, |_| {})?;
    assert!(
        now.ends_with("9.8.7") && !old.ends_with("9.8.7"),
        "{old}, then {now}"
    );
    assert_eq!(state(&mut board)?, "CONFIRMED");
    Ok(())
}

/// The first words of this program under another version: all that the running image looks at.
fn head(version: &[u8]) -> FirmwareImage {
    let mut bytes = sent().bytes;
    bytes.truncate(HEADER_OFFSET as usize + 96);
    let (header, length) = (HEADER_OFFSET as usize, bytes.len() as u32);
    bytes[header..header + 4].copy_from_slice(&length.to_le_bytes());
    bytes[header + 48..header + 48 + version.len()].copy_from_slice(version);
    FirmwareImage::from_bytes(bytes).expect("an image")
}

/// What brings an image once its room is there, with its own authentication code, and the question behind it.
fn brings(image: &FirmwareImage) -> Vec<u8> {
    let hexadecimal =
        |bytes: &[u8]| -> String { bytes.iter().map(|byte| format!("{byte:02x}")).collect() };
    let words = image.bytes.chunks(WORD_BYTES).enumerate();
    let mut lines: String = words
        .map(|(nth, word)| format!("UPD DATA {} {}\n", nth * WORD_BYTES, hexadecimal(word)))
        .collect();
    lines += &format!("UPD COMMIT {}\n", hexadecimal(&image.signed(&KEY)));
    lines.into_bytes()
}

#[test]
fn an_older_image_that_was_signed_comes_only_by_leave_of_the_probe() {
    let (older, same) = (head(b"0.0.9\0"), head(b""));
    let begin = format!("UPD BEGIN {}\n", older.bytes.len()).into_bytes();
    // Two sectors are erased, then 1.1 KiB take 0.3 s.
    let (erased, brought) = (4 * SECOND, 5 * SECOND);
    let mut serial = Vec::new();
    for (nth, image) in [&older, &same, &older].into_iter().enumerate() {
        let from = nth as u64 * 6 * SECOND + 10 * MILLISECOND;
        serial.extend([
            (from, begin.clone()),
            (from + erased, brings(image)),
            (from + brought, b"UPD?\nERR?\n".to_vec()),
        ]);
    }
    let outcome = run_with(Script {
        serial,
        commands: vec![(12 * SECOND, b"update older\n".to_vec())],
        ..Script::listening(18 * SECOND)
    });
    let answers = text(&outcome);
    let states: Vec<&str> = answers
        .lines()
        .filter_map(|line| line.trim().strip_prefix("STATE="))
        .collect();
    assert!(
        states.len() == 3 && states[0].starts_with("REFUSED its version is lower"),
        "{answers}"
    );
    assert_eq!(states[1..], ["READY", "READY"], "{answers}");
    assert_eq!(outcome.resets, 0);
}

/// The program stops in an endless loop before it feeds the watchdog.
#[test]
fn an_image_that_does_not_become_healthy_is_rolled_back() {
    let main = address_of(&image(), "main").expect("a program") - u64::from(H743ZI.running);
    let bad = altered(main as usize, &0xE7FEu16.to_le_bytes());
    let peeks = (1..17)
        .map(|second| {
            (
                second * SECOND,
                u64::from(Mark::Installed.address(H743ZI.journal)),
            )
        })
        .collect();
    let script = Script {
        flash: requested(&bad),
        peeks,
        serial: vec![(16_600 * MILLISECOND, QUESTIONS.into())],
        ..Script::listening(16_700 * MILLISECOND)
    };
    let outcome = run_with(script);
    let answers = text(&outcome);
    assert!(
        outcome.peeked.contains(&0) && outcome.peeked[0] == ERASED,
        "it was installed: {:x?}",
        outcome.peeked
    );
    assert_eq!(outcome.resets, 1, "the watchdog's: {:?}", said(&outcome));
    assert!(
        answers.contains("STATE=ROLLED_BACK") && answers.contains("2=31"),
        "{answers}, {:?}",
        said(&outcome)
    );
    assert!(
        answers.contains("FAULT=31 update rolled back"),
        "the log of faults: {answers}"
    );
    assert_eq!(
        outcome
            .texts_with("did not become healthy and was rolled back")
            .count(),
        1,
        "{:?}",
        said(&outcome)
    );
}

/// The supply fails while the running image is saved, and while the first sector of the new one is copied over
/// it: the boot stage begins again.
#[test]
fn a_supply_that_fails_within_the_swap_is_recovered() {
    let end_of_sector = u64::from(H743ZI.running + H743ZI.sector_bytes) - 32;
    // From a start with the mark "saved" the first sector is erased after 1.1 s, and full after 1.5 s.
    let cuts = [2 * SECOND, 7_500 * MILLISECOND, 8_850 * MILLISECOND];
    let script = Script {
        flash: requested(&newer()),
        injections: cuts
            .iter()
            .map(|at| {
                (
                    *at,
                    Injection::Restart {
                        flags: BROWN_OUT_FLAG,
                    },
                )
            })
            .collect(),
        peeks: cuts
            .iter()
            .map(|at| (*at - MILLISECOND, end_of_sector))
            .collect(),
        serial: vec![(14_400 * MILLISECOND, QUESTIONS.into())],
        ..Script::listening(14_500 * MILLISECOND)
    };
    let outcome = run_with(script);
    let answers = text(&outcome);
    assert!(
        outcome.peeked[0] != ERASED && outcome.peeked[2] == ERASED,
        "no image is whole at the last cut: {:x?}",
        outcome.peeked
    );
    assert_eq!(outcome.resets, 3);
    assert!(
        answers.contains("9.8.7") && answers.contains("STATE=CONFIRMED"),
        "{answers}, {:?}",
        said(&outcome)
    );
}

/// The boot stage computes the authentication code again; nothing is erased.
#[test]
fn a_request_whose_image_is_damaged_or_not_signed_installs_nothing() {
    let mut damaged = requested(&newer());
    damaged[0].1[0x8000] ^= 1;
    let mut of_another = requested(&newer());
    of_another.push((H743ZI.key.into(), OTHER_KEY.word().to_vec()));
    for flash in [damaged, of_another] {
        let script = Script {
            flash,
            serial: vec![(400 * MILLISECOND, QUESTIONS.into())],
            ..Script::listening(450 * MILLISECOND)
        };
        let outcome = run_with(script);
        let answers = text(&outcome);
        assert!(
            answers.contains("STATE=NOT_INSTALLED")
                && !answers.contains("9.8.7")
                && answers.contains("2=0"),
            "{answers}"
        );
        assert_eq!(outcome.resets, 0);
    }
}

#[test]
fn a_board_without_a_key_takes_no_image() {
    let outcome = run_with(Script {
        flash: vec![(H743ZI.key.into(), vec![0xFF; WORD_BYTES])],
        serial: vec![
            (10 * MILLISECOND, b"UPD BEGIN 65536\n".to_vec()),
            (40 * MILLISECOND, b"UPD DATA 0 00ff\nERR?\nUPD?\n".to_vec()),
        ],
        ..Script::listening(60 * MILLISECOND)
    });
    let answers = text(&outcome);
    assert!(
        answers.contains("STATE=REFUSED the board has no key") && !answers.starts_with("0\n"),
        "{answers}"
    );
}
