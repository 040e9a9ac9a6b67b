//! The image that is built for 100 kHz closes the loop around the bench that is sampled as fast: what it reads
//! and drives is the host's, to the last bit.

use crate::common;

use common::{block, host_run, image_named, lines, samples};
use hysteron_core::parameter_block::{AmplifierParameters, read};
use hysteron_core::trace_frame::TraceSample;
use hysteron_emulator::board::{NucleoBoard, ONE_INSTRUCTION_PER_CYCLE};
use hysteron_emulator::converters::World;
use hysteron_emulator::run::{MILLISECOND, Outcome, Script, run, sample_rate_hz};
use hysteron_sim::bench::{Bench, Variant};

const RATE_HZ: u32 = 100_000;
const PERIOD_NS: u64 = 10_000;
/// Core cycles in a period, and with them instructions.
const CYCLES: u64 = 4_000;
/// Within so many of them behind its edge the slowest interrupt ends.
const MOST_CYCLES: u64 = 3_600;

fn fast_bench() -> Bench {
    let mut bench = Bench::reference().expect("the bench");
    bench.converters.sample_rate_hz = RATE_HZ.into();
    bench
}

/// Designed for the reference bench: `lab/thesis/examples/reference_block.rs` wrote the file.
fn fast_parameters() -> AmplifierParameters {
    read(include_bytes!("../p753_100khz.block"), RATE_HZ).expect("a valid block")
}

fn number(status: &str, name: &str) -> u64 {
    let rest = status.split(&format!("{name}: ")).nth(1).unwrap_or_default();
    rest.split(|c: char| !c.is_ascii_digit()).next().unwrap_or_default().parse().unwrap_or(u64::MAX)
}

fn board(world: &hysteron_emulator::converters::SharedWorld) -> NucleoBoard {
    let mut board = NucleoBoard::with_plant(world).expect("a board");
    board.instructions_per_second = ONE_INSTRUCTION_PER_CYCLE;
    board
}

fn without_trace(outcome: &Outcome) -> Vec<&str> {
    outcome.messages.iter().map(|message| message.text.as_str()).filter(|text| !text.starts_with("trace [")).collect()
}

#[test]
fn a_loop_at_100_khz_gives_the_hosts_bits() {
    let image = image_named("hysteron-firmware-100khz");
    assert_eq!(sample_rate_hz(&image).expect("an image"), RATE_HZ);
    let (bench, parameters) = (fast_bench(), fast_parameters());
    // The stage is virgin, as the servo takes it to be: a conditioning would take a second more.
    let (first, ticks) = (1_000u32, 101_100u32);
    let commands =
        [(first, "arm untested"), (first + 1, "conditioning waived"), (first + 2, "reference sine 50000 3000 6000"), (first + 3, "enable")];
    let world = World::new(&bench, Variant::FULL, 7).shared();
    let end = u64::from(ticks) * PERIOD_NS;
    let script = Script {
        block: Some(block(&parameters)),
        commands: vec![(2 * MILLISECOND, lines(&commands)), (end, b"status\n".to_vec())],
        ..Script::listening(end + 20 * MILLISECOND)
    };
    let outcome = run(&image, board(&world), script).expect("a run");
    let texts = without_trace(&outcome);
    println!("{}", texts.join("\n"));
    assert_eq!((outcome.malformed, outcome.resets, samples(&outcome).1), (0, 0, 0), "{texts:?}");

    let mut twin = World::new(&bench, Variant::FULL, 7);
    let host = host_run(&parameters, &mut twin, &commands, ticks as usize);
    let world = world.lock().expect("the world");
    let differs = world.codes.iter().zip(&twin.codes).position(|(ours, theirs)| ours != theirs);
    assert!(world.codes.len() >= twin.codes.len() && twin.codes.len() == ticks as usize);
    if let Some(at) = differs {
        let around = at.saturating_sub(3)..(at + 4).min(ticks as usize);
        panic!("image and host differ at edge {at}: {:?}, {:?}", &world.codes[around.clone()], &twin.codes[around]);
    }

    // It is a servo: the error of what the sensor reads over the last half second.
    let c = &parameters.servo.converters;
    let error_um = |sample: &TraceSample| {
        let position = f64::from(c.adc_zero) / 2f64.powi(24) + f64::from(sample.adc_code) * c.adc_step as f64 / 2f64.powi(40);
        position - f64::from(sample.reference) / 2f64.powi(24)
    };
    let last = &host[host.len() - 50_000..];
    let rms_um = (last.iter().map(|sample| error_um(sample).powi(2)).sum::<f64>() / last.len() as f64).sqrt();
    println!("50 Hz, 3 um: {rms_um:.4} um RMS of the sensor's reading, noise included");
    assert!(rms_um < 0.03, "{rms_um} um");
    let status = outcome.texts_with("status").last().expect("a status").to_string();
    assert_eq!((number(&status, "lost_samples"), number(&status, "overruns")), (0, 0), "{status}");
    // A timer count is two instructions; the interrupt is raised 200 counts after the edge.
    let slowest = number(&status, "slowest_counts") * 2;
    println!(
        "tick at 100 kHz: {} instructions at most, {} on the mean; slowest interrupt {} instructions, ends {slowest} of {CYCLES} behind its edge; {} instructions in {} ms",
        number(&status, "most_tick_cycles"),
        number(&status, "recent_tick_cycles"),
        slowest - 400,
        outcome.end.1,
        outcome.end.0 / MILLISECOND,
    );
    assert!(slowest <= MOST_CYCLES, "{status}");
}
