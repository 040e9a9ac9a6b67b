//! The image boots on the emulated part, and its 20 kHz beat is exact in virtual time.

use std::path::PathBuf;

use hysteron_emulator::board::NucleoBoard;
use hysteron_emulator::run::{MILLISECOND, Script, run};

/// The image under test: `HYSTERON_FIRMWARE_ELF`, or where `cargo xtask check` builds it.
fn image() -> PathBuf {
    std::env::var_os("HYSTERON_FIRMWARE_ELF").map_or_else(
        || PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../firmware/target/thumbv7em-none-eabihf/release/hysteron-firmware"),
        PathBuf::from,
    )
}

#[test]
fn the_image_boots_and_beats_at_20_khz() {
    let until_ns = 105 * MILLISECOND;
    let outcome = run(&image(), NucleoBoard::new().expect("a board"), Script::listening(until_ns)).expect("a run");
    println!("end {:?}, resets {}, raw {}, without a model {:?}", outcome.end, outcome.resets, outcome.raw.len(), outcome.without_model);
    let boot: Vec<_> = outcome.texts_with("hysteron ").collect();
    assert_eq!(boot.len(), 1, "boots once: {:?}", outcome.messages);
    assert!(boot[0].contains("core 400000000 Hz, control 20000 Hz"), "{}", boot[0]);
    assert_eq!((outcome.malformed, outcome.resets), (0, 0));

    let counts: Vec<(u64, u64)> =
        outcome.messages.iter().filter_map(|message| Some((message.at_ns, message.text.strip_prefix("ticks ")?.parse().ok()?))).collect();
    assert!(counts.len() >= 15, "reports: {:?}", outcome.messages);
    for pair in counts.windows(2) {
        let [(_, before), (_, after)] = pair else { unreachable!() };
        // A report every 5 ms by TIM5 and ticks every 50 us by TIM2: both timers run from the same clock.
        assert_eq!(after - before, 100, "{counts:?}");
    }
    let (seen_ns, ticks) = counts[counts.len() - 1];
    // The probe sees a message at most 1 ms after it was written, and the beat starts within the first millisecond or two.
    let expected = seen_ns / 50_000;
    assert!(ticks <= expected && ticks + 60 >= expected, "{ticks} ticks at {seen_ns} ns");
}
