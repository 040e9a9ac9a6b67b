//! The emulated board, its flash empty, in front of a stage of other equations than the simulation's
//! (`tests/src/independent_stage.rs`).
//!
//! `independent_stage SEED IMAGE FRONT_END TRUTH`: the stage is drawn from the seed, the wiring is a file as
//! `hysteron design` takes it, and what the stage really does is written to TRUTH. The serial port is on a
//! free port of 127.0.0.1, which the first line says. Runs until it is interrupted.

// The stage stands beside the tests of the servo and shares no crate with the emulated part.
#[path = "../../../tests/src/independent_stage.rs"]
#[allow(dead_code)] // the tests use more of it
mod independent_stage;

use std::net::SocketAddr;
use std::path::Path;
use std::process::ExitCode;

use hysteron::servo::amplifier_block::FrontEnd;
use hysteron_emulator::converters::World;
use hysteron_emulator::running_board::{serve_board, witness};
use independent_stage::{IndependentStage, StageChange, StageTruth};

fn run(seed: &str, image: &str, front_end: &str, truth_file: &str) -> Result<(), String> {
    let seed: u64 = seed
        .parse()
        .map_err(|_| format!("{seed}: expected a seed, a whole number"))?;
    let truth = StageTruth::drawn(seed);
    let text =
        std::fs::read_to_string(front_end).map_err(|error| format!("{front_end}: {error}"))?;
    let scale = FrontEnd::from_toml(&text, front_end)
        .map_err(|error| error.to_string())?
        .scale(0.0, truth.drive_max_v);
    let stage = IndependentStage::virgin(&truth, StageChange::NONE);
    let mut world = World::with(Box::new(stage), scale, truth.noise_um, seed);
    world.witness = Some(witness(Path::new(truth_file))?);
    serve_board(
        world,
        Path::new(image),
        None,
        SocketAddr::from(([127, 0, 0, 1], 0)),
    )
}

fn main() -> ExitCode {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let result = match words
        .iter()
        .map(String::as_str)
        .collect::<Vec<_>>()
        .as_slice()
    {
        [seed, image, front_end, truth] => run(seed, image, front_end, truth),
        _ => Err("expected SEED IMAGE FRONT_END TRUTH".into()),
    };
    if let Err(message) = result {
        eprintln!("independent_stage: {message}");
        return ExitCode::from(2);
    }
    ExitCode::SUCCESS
}
