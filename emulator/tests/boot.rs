//! The image boots on the emulated part, and its 20 kHz beat is exact in virtual time.

mod common;

use common::image;
use hysteron_emulator::board::NucleoBoard;
use hysteron_emulator::converters::World;
use hysteron_emulator::run::{MILLISECOND, Script, run};
use hysteron_sim::bench::{Bench, Variant};

#[test]
fn the_image_boots_beats_at_20_khz_and_rests_without_a_block() {
    let until_ns = 105 * MILLISECOND;
    let bench = Bench::reference().expect("the bench");
    let world = World::new(&bench, Variant::PLAIN, 1).shared();
    let mut script = Script::listening(until_ns);
    for status in 0..18 {
        script.commands.push(((10 + 5 * status) * MILLISECOND, b"status\n".to_vec()));
    }
    let outcome = run(&image(), NucleoBoard::with_plant(&world).expect("a board"), script).expect("a run");
    println!("end {:?}, without a model: {:?}", outcome.end, outcome.without_model);
    let boot: Vec<_> = outcome.texts_with("hysteron ").collect();
    assert_eq!(boot.len(), 1, "boots once: {:?}", outcome.messages);
    assert!(boot[0].contains("core 400000000 Hz, control 20000 Hz"), "{}", boot[0]);
    assert_eq!((outcome.malformed, outcome.resets), (0, 0));
    assert!(outcome.texts_with("mode fault: parameter block").count() == 1, "{:?}", outcome.messages);

    let counts: Vec<(u64, u64)> = outcome
        .messages
        .iter()
        .filter_map(|message| {
            let rest = message.text.split("ticks: ").nth(1)?;
            Some((message.at_ns, rest.split(',').next()?.parse().ok()?))
        })
        .collect();
    assert!(counts.len() >= 15, "reports: {:?}", outcome.messages);
    // TIM2 beats every 50 us; a report is written within the millisecond after the probe asked.
    for (at_ns, ticks) in &counts {
        let since_first_ns = (at_ns - counts[0].0) as i64;
        let deviation = (ticks - counts[0].1) as i64 - since_first_ns / 50_000;
        assert!(deviation.abs() <= 20, "{counts:?}");
    }
    let world = world.lock().expect("the world");
    let rest = bench.converter_scale().dac_code(bench.drive_min_v);
    // The converters saw every edge: the beat began at most 4 ms after the start and is exact.
    let expected = until_ns / 50_000;
    assert!((expected - 80..=expected).contains(&(world.codes.len() as u64)), "{} edges", world.codes.len());
    assert!(world.codes.iter().all(|(_, acting)| *acting == rest), "always the safe output");
}
