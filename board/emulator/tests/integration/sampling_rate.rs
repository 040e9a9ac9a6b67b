//! The image that is built for 100 kHz closes the loop around the bench that is sampled as fast: what it reads
//! and drives is the host's, to the last bit.

use crate::common;
use crate::output_path::{amplifier_with_filters, kept_filters};

use common::{block, host_run_of, image_named, lines, number, samples, texts};
use hysteron_core::amplifier::Amplifier;
use hysteron_core::parameter_block::{AmplifierParameters, read};
use hysteron_core::trace_frame::TraceSample;
use hysteron_emulator::board::{NucleoBoard, ONE_INSTRUCTION_PER_CYCLE};
use hysteron_emulator::converters::World;
use hysteron_emulator::run::{
    MILLISECOND, Script, envelope_bytes, run, sample_rate_hz, watched_envelope,
};
use hysteron_sim::bench::{Bench, Variant};

const RATE_HZ: u32 = 100_000;
const PERIOD_NS: u64 = 10_000;
/// Core cycles in a period, and with them instructions.
const CYCLES: u64 = 4_000;

fn fast_bench() -> Bench {
    let mut bench = Bench::reference().expect("the bench");
    bench.converters.sample_rate_hz = RATE_HZ.into();
    bench
}

/// Designed for the reference bench: `lab/thesis/examples/reference_block.rs` wrote the file.
fn fast_parameters() -> AmplifierParameters {
    read(include_bytes!("../p753_100khz.block"), RATE_HZ).expect("a valid block")
}

fn board(world: &hysteron_emulator::converters::SharedWorld) -> NucleoBoard {
    let mut board = NucleoBoard::with_plant(world).expect("a board");
    board.instructions_per_second = ONE_INSTRUCTION_PER_CYCLE;
    board
}

/// Whether the image runs with everything that the bench may switch on.
#[derive(Clone, Copy)]
enum Equipment {
    None,
    /// All six sections of the filters, the amplifier's voltage monitor, the register read back.
    All,
}

impl Equipment {
    /// Within so many cycles behind its edge the slowest interrupt ends.
    fn most_cycles(self) -> u64 {
        match self {
            Self::None => 3_600,
            Self::All => 3_960,
        }
    }
}

/// The stage is virgin, as the servo takes it to be: a conditioning would take a second more.
const COMMANDS: [(u32, &str); 4] = [
    (1_000, "arm untested"),
    (1_001, "conditioning waived"),
    (1_002, "reference sine 50000 3000 6000"),
    (1_003, "enable"),
];

/// So many ticks on the host: what it did, and its codes.
fn on_the_host(equipment: Equipment, ticks: u32) -> (Vec<TraceSample>, World) {
    let parameters = fast_parameters();
    let amplifier = match equipment {
        Equipment::None => Amplifier::new(parameters),
        Equipment::All => amplifier_with_filters(&parameters),
    };
    let mut world = World::new(&fast_bench(), Variant::FULL, 7);
    (
        host_run_of(amplifier, &mut world, &COMMANDS, ticks as usize),
        world,
    )
}

/// So many ticks of the closed loop on image and host, which must give the same codes. Returns what the host
/// did.
fn loop_at_100_khz(equipment: Equipment, ticks: u32) -> Vec<TraceSample> {
    let image = image_named("hysteron-firmware-100khz");
    assert_eq!(sample_rate_hz(&image).expect("an image"), RATE_HZ);
    let parameters = fast_parameters();
    let world = World::new(&fast_bench(), Variant::FULL, 7).shared();
    let end = u64::from(ticks) * PERIOD_NS;
    let script = Script {
        block: Some(block(&parameters)),
        commands: vec![
            (2 * MILLISECOND, lines(&COMMANDS)),
            (end, b"status\n".to_vec()),
        ],
        ..Script::listening(end + 20 * MILLISECOND)
    };
    let script = match equipment {
        Equipment::None => script,
        Equipment::All => {
            let (envelope, kept) = (
                Some(envelope_bytes(&watched_envelope())),
                Some(kept_filters(&parameters)),
            );
            Script {
                envelope,
                kept,
                monitored: Some(world.clone()),
                ..script
            }
        }
    };
    let outcome = run(&image, board(&world), script).expect("a run");
    let texts = texts(&outcome);
    println!("{}", texts.join("\n"));
    assert_eq!(
        (outcome.malformed, outcome.resets, samples(&outcome).1),
        (0, 0, 0),
        "{texts:?}"
    );

    let (host, twin) = on_the_host(equipment, ticks);
    let world = world.lock().expect("the world");
    let differs = world
        .codes
        .iter()
        .zip(&twin.codes)
        .position(|(ours, theirs)| ours != theirs);
    assert!(world.codes.len() >= twin.codes.len() && twin.codes.len() == ticks as usize);
    if let Some(at) = differs {
        let around = at.saturating_sub(3)..(at + 4).min(ticks as usize);
        panic!(
            "image and host differ at edge {at}: {:?}, {:?}",
            &world.codes[around.clone()],
            &twin.codes[around]
        );
    }
    let status = outcome
        .texts_with("status")
        .last()
        .expect("a status")
        .to_string();
    assert_eq!(
        (number(&status, "lost_samples"), number(&status, "overruns")),
        (0, 0),
        "{status}"
    );
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
    assert!(slowest <= equipment.most_cycles(), "{status}");
    host
}

/// The error of what the sensor reads over the last half second, um RMS.
fn error_of_the_reading_um(host: &[TraceSample]) -> f64 {
    let parameters = fast_parameters();
    let c = &parameters.servo.converters;
    let error_um = |sample: &TraceSample| {
        let position = f64::from(c.adc_zero) / 2f64.powi(24)
            + f64::from(sample.adc_code) * c.adc_step as f64 / 2f64.powi(40);
        position - f64::from(sample.reference) / 2f64.powi(24)
    };
    let last = &host[host.len() - 50_000..];
    (last
        .iter()
        .map(|sample| error_um(sample).powi(2))
        .sum::<f64>()
        / last.len() as f64)
        .sqrt()
}

#[test]
fn a_loop_at_100_khz_gives_the_hosts_bits() {
    let host = loop_at_100_khz(Equipment::None, 101_100);
    let rms_um = error_of_the_reading_um(&host);
    println!("50 Hz, 3 um: {rms_um:.4} um RMS of the sensor's reading, noise included");
    assert!(rms_um < 0.03, "{rms_um} um");
}

#[test]
fn a_loop_at_100_khz_with_filters_monitor_and_read_back_gives_the_hosts_bits() {
    let ticks = 60_000;
    let host = loop_at_100_khz(Equipment::All, ticks);
    assert_ne!(
        host,
        on_the_host(Equipment::None, ticks).0,
        "the filters are on"
    );
}
