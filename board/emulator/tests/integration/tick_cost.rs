//! What the servo's tick costs in instructions, counted by the emulated part's cycle counter at one
//! instruction a cycle.

use crate::common;

use common::{assert_texts, image_named};
use hysteron_emulator::board::NucleoBoard;
use hysteron_emulator::run::{MILLISECOND, Script, run};

/// Core clock after reset, before any clock set-up: the count of instructions a second that makes a cycle an
/// instruction.
const RESET_CLOCK_HZ: u64 = 64_000_000;
/// The part's clock in the firmware, kHz: shares of a period take an instruction as a cycle.
const CORE_KHZ: u32 = 400_000;
/// Instructions at most and on the mean, for each case: `follow`, `jump` and `chatter` are the servo's tick
/// from the ADC's code to the DAC's, with 16 pairs of extrema stored, and the same while the correction of a
/// triangle is learned, or the gain adapted; `amplifier` is all that the interrupt does between its
/// converters. `exchange` is what the servo does, once, when a block with another hysteresis takes over,
/// `swap` all that the interrupt does when the same block does; both stand before the tick of that period.
/// `amplifier conditions` is a whole conditioning, whose last tick judges it and zeroes the sensor.
/// How much of `exchange` the compiler lays in line changes it by a tenth; a period has 20,000. A change that
/// needs more raises the limit here.
const LIMITS: [(&str, u32, u32); 11] = [
    ("follow", 1_000, 800),
    ("learn", 1_500, 1_400),
    ("adapt", 1_500, 900),
    ("jump", 1_300, 950),
    ("jump while learning", 1_800, 1_150),
    ("chatter", 1_050, 950),
    ("amplifier begins", 1_300, 1_150),
    ("amplifier follows", 1_400, 1_150),
    ("amplifier conditions", 700, 400),
    ("exchange", 9_800, 9_700),
    ("swap", 4_550, 4_550),
];

#[test]
fn the_servo_tick_keeps_its_count_with_a_full_memory() {
    let mut board = NucleoBoard::new().expect("a board");
    board.instructions_per_second = RESET_CLOCK_HZ;
    let outcome = run(
        &image_named("tick_cost"),
        board,
        Script::listening(1_000 * MILLISECOND),
    )
    .expect("a run");
    assert_texts(&outcome, "tick cost done", 1);
    for (case, most, typical) in LIMITS {
        let begin = format!("tick cost {case} most");
        let text = outcome
            .texts_with(&begin)
            .next()
            .expect("every case is reported");
        println!("{text} (limits {most}, {typical})");
        let number = |name: &str| -> u32 {
            let mut words = text.split(' ').skip_while(|word| *word != name);
            words
                .nth(1)
                .and_then(|word| word.parse().ok())
                .unwrap_or(u32::MAX)
        };
        let share = |khz: u32| 100.0 * f64::from(number("most") * khz) / f64::from(CORE_KHZ);
        println!(
            "   of a period: {:.1} % at 20 kHz, {:.1} % at 50 kHz, {:.1} % at 100 kHz",
            share(20),
            share(50),
            share(100)
        );
        assert!(
            number("most") <= most && number("typical") <= typical,
            "{text}"
        );
        if case == "follow" {
            assert_eq!(number("pairs"), 16, "the memory is full: {text}");
        }
    }
}
