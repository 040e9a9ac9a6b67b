//! What the tests on the emulated part share.
#![allow(dead_code)] // each test uses a part of it

use std::path::PathBuf;

use hysteron_core::amplifier::Amplifier;
use hysteron_core::parameter_block::{AmplifierParameters, BLOCK_BYTES, read, write};
use hysteron_core::trace_frame::{ReadBlock, TraceSample};
use hysteron_emulator::converters::World;
use hysteron_emulator::run::Outcome;

/// The image under test: `HYSTERON_FIRMWARE_ELF`, or where `cargo xtask check` builds it.
pub fn image() -> PathBuf {
    std::env::var_os("HYSTERON_FIRMWARE_ELF").map_or_else(
        || PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../firmware/target/thumbv7em-none-eabihf/release/hysteron-firmware"),
        PathBuf::from,
    )
}

/// The block of the best design for the reference bench, as `tests/p753.block` keeps it.
pub fn parameters() -> AmplifierParameters {
    read(include_bytes!("../p753.block"), 20_000).expect("a valid block")
}

/// A block as bytes.
pub fn block(parameters: &AmplifierParameters) -> Vec<u8> {
    let mut bytes = [0xff; BLOCK_BYTES];
    let length = write(parameters, &mut bytes).expect("fits");
    bytes[..length].to_vec()
}

/// All samples of a run's trace, in order, and the ticks that the target says it lost.
pub fn samples(outcome: &Outcome) -> (Vec<TraceSample>, u32) {
    let (mut samples, mut lost) = (Vec::new(), 0);
    for text in outcome.texts_with("trace [") {
        let bytes: Vec<u8> =
            text["trace [".len()..text.len() - 1].split(", ").map(|byte| byte.parse().expect("a byte")).collect();
        let block = ReadBlock::read(&bytes).expect("a whole block");
        lost = block.lost_ticks;
        samples.extend(block.samples());
    }
    (samples, lost)
}

/// The same amplifier on the host, with commands at their ticks: what the target must have done, bit by bit.
pub fn host_run(parameters: &AmplifierParameters, world: &mut World, commands: &[(u32, &str)], ticks: usize) -> Vec<TraceSample> {
    let mut amplifier = Amplifier::new(*parameters);
    let mut commands = commands.iter().peekable();
    (0..ticks)
        .map(|tick| {
            let reading = world.edge();
            // The interrupt takes at most one command in a tick.
            if let Some((_, text)) = commands.next_if(|(at, _)| *at as usize <= tick) {
                let Ok(hysteron_core::command_text::Line::Control(_, command)) = hysteron_core::command_text::parse(text, 20_000) else {
                    panic!("{text}")
                };
                amplifier.command(command).expect("accepted");
            }
            let sample = amplifier.tick(Some(reading), false);
            world.write(sample.dac_code);
            sample
        })
        .collect()
}

/// Commands as bytes for the target, all sent at once, each with its tick.
pub fn lines(commands: &[(u32, &str)]) -> Vec<u8> {
    commands.iter().flat_map(|(at, text)| format!("@{at} {text}\n").into_bytes()).collect()
}
