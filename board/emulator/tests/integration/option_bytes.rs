//! The option bytes that protect when no program can: said at the start and in the status, written when
//! somebody asks for it at rest.

use crate::common;

use common::{block, parameters, run_on, typed_back, world};
use hysteron_emulator::board::NucleoBoard;
use hysteron_emulator::run::{MILLISECOND, Script};
use rigless::mcu::Mcu;
use rigless::soc::stm32h743::generated::flash;

#[test]
fn they_are_looked_at_said_and_written_at_rest() {
    let world = world();
    let factory = NucleoBoard::new()
        .expect("a board")
        .mcu
        .bus()
        .registers("Flash")
        .expect("the flash")
        .get(flash::Register::OptsrCur);
    assert_eq!(
        (factory >> 2 & 3, factory >> 4 & 1),
        (0, 1),
        "out of the box: no brown-out level, the watchdog waits"
    );
    let script = Script {
        block: Some(block(&parameters())),
        commands: vec![
            (
                4 * MILLISECOND,
                b"arm untested\nconditioning waived\nreference constant 3000\nenable\n".to_vec(),
            ),
            (20 * MILLISECOND, b"protect\n".to_vec()),
            (30 * MILLISECOND, b"status\ndisable\n".to_vec()),
            (100 * MILLISECOND, b"protect\n".to_vec()),
            (120 * MILLISECOND, b"status\n".to_vec()),
        ],
        serial: vec![
            (90 * MILLISECOND, b"DIA? 12\n".to_vec()),
            (130 * MILLISECOND, b"DIA? 12\n".to_vec()),
        ],
        ..Script::listening(140 * MILLISECOND)
    };
    let outcome = run_on(&world, script);
    let texts: Vec<&str> = outcome
        .messages
        .iter()
        .map(|message| message.text.as_str())
        .collect();
    assert_eq!(
        outcome
            .texts_with("option bytes: no brown-out level")
            .count(),
        2,
        "at the start and in the status: {texts:?}"
    );
    assert_eq!(outcome.texts_with("only at rest").count(), 1, "{texts:?}");
    assert_eq!(
        outcome.texts_with("option bytes written").count(),
        1,
        "{texts:?}"
    );
    assert_eq!(
        outcome
            .texts_with("brown-out level and watchdog protect")
            .count(),
        1,
        "{texts:?}"
    );
    let answers: String = typed_back(&outcome);
    assert_eq!(answers, "12=0\n12=3\n");
    let written = outcome
        .board
        .mcu
        .bus()
        .registers("Flash")
        .expect("the flash")
        .get(flash::Register::OptsrCur);
    // BOR_LEV = 2 and IWDG1_SW = 0 (RM0433, 4.9.8), and nothing else.
    assert_eq!(
        written,
        factory & !(3 << 2 | 1 << 4) | 2 << 2,
        "{written:#x}, {factory:#x} before"
    );
    assert_eq!(outcome.resets, 0);
}
