//! The target plays a drive on an actuator that it has never moved and its log is kept: `cargo xtask check` makes a data set of it
//! and identifies the actuator, with no record from anywhere else.

mod common;

use std::path::Path;

use common::{block, image, parameters, samples};
use hysteron_emulator::board::NucleoBoard;
use hysteron_emulator::converters::World;
use hysteron_emulator::run::{MILLISECOND, Script, run};
use hysteron_sim::bench::{Bench, Variant};

#[test]
fn a_drive_is_played_and_its_log_kept() {
    let bench = Bench::reference().expect("the bench");
    let world = World::new(&bench, Variant::PLAIN, 11).shared();
    let parameters = parameters();
    let commands = "identify 44000\n";
    let script = Script {
        block: Some(block(&parameters)),
        commands: vec![(3 * MILLISECOND, commands.as_bytes().to_vec())],
        ..Script::listening(2_600 * MILLISECOND)
    };
    let outcome = run(&image(), NucleoBoard::with_plant(&world).expect("a board"), script).expect("a run");
    let (samples, lost) = samples(&outcome);
    assert_eq!((lost, outcome.malformed), (0, 0));
    assert!(samples.len() > 50_000 && samples.iter().all(|sample| sample.flags < 2), "rest and playing only");
    // What the log says is what the converters saw.
    let world = world.lock().expect("the world");
    for pair in samples.windows(2).filter(|pair| pair[1].tick == pair[0].tick + 1) {
        let (sensor, acting) = world.codes[pair[1].tick as usize];
        assert_eq!((pair[1].adc_code, pair[0].dac_code), (sensor, acting), "tick {}", pair[1].tick);
    }
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR"));
    std::fs::write(folder.join("record.rtt"), &outcome.raw).expect("written");
    println!("{} bytes of log in {}", outcome.raw.len(), folder.join("record.rtt").display());
}
