//! The images that are built for 50 and 100 kHz close the loop around the bench that is sampled as fast: what
//! they read and drive is the host's, to the last bit.

use crate::common;
use crate::output_path::{amplifier_with_filters, kept_filters};

use common::{assert_same_codes, block, host_run_of, image_named, lines, number, samples, texts};
use hysteron_core::amplifier::Amplifier;
use hysteron_core::parameter_block::{AmplifierParameters, read};
use hysteron_core::trace_frame::TraceSample;
use hysteron_emulator::board::{NucleoBoard, ONE_INSTRUCTION_PER_CYCLE};
use hysteron_emulator::converters::World;
use hysteron_emulator::run::{
    MILLISECOND, Script, envelope_bytes, run, sample_rate_hz, watched_envelope,
};
use hysteron_sim::bench::{Bench, Variant};

/// Cycles of the core in a second, and with them instructions.
const CORE_HZ: u64 = 400_000_000;

/// A sampling rate, with its image and its block: `lab/thesis/examples/reference_block.rs` designed it for the
/// reference bench.
#[derive(Clone, Copy)]
struct Rate {
    hz: u32,
    image: &'static str,
    block: &'static [u8],
}

const AT_50_KHZ: Rate = Rate {
    hz: 50_000,
    image: "hysteron-firmware-50khz",
    block: include_bytes!("../p753_50khz.block"),
};
const AT_100_KHZ: Rate = Rate {
    hz: 100_000,
    image: "hysteron-firmware-100khz",
    block: include_bytes!("../p753_100khz.block"),
};

impl Rate {
    fn period_ns(self) -> u64 {
        1_000_000_000 / u64::from(self.hz)
    }

    fn cycles(self) -> u64 {
        CORE_HZ / u64::from(self.hz)
    }

    fn bench(self) -> Bench {
        let mut bench = Bench::reference().expect("the bench");
        bench.converters.sample_rate_hz = self.hz.into();
        bench
    }

    fn parameters(self) -> AmplifierParameters {
        read(self.block, self.hz).expect("a valid block")
    }
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

/// Within so many cycles behind its edge the slowest interrupt ends, with every equipment: of the 4,000 of a
/// period at 100 kHz, 300 stay for what runs below it.
const MOST_CYCLES: u64 = 3_700;

/// The stage is virgin, as the servo takes it to be: a conditioning would take a second more.
const COMMANDS: [(u32, &str); 4] = [
    (1_000, "arm untested"),
    (1_001, "conditioning waived"),
    (1_002, "reference sine 50000 3000 6000"),
    (1_003, "enable"),
];

/// So many ticks on the host: what it did, and its codes.
fn on_the_host(rate: Rate, equipment: Equipment, ticks: u32) -> (Vec<TraceSample>, World) {
    let parameters = rate.parameters();
    let amplifier = match equipment {
        Equipment::None => Amplifier::new(parameters),
        Equipment::All => amplifier_with_filters(&parameters),
    };
    let mut world = World::new(&rate.bench(), Variant::FULL, 7);
    (
        host_run_of(amplifier, &mut world, &COMMANDS, ticks as usize),
        world,
    )
}

/// So many ticks of the closed loop on image and host, which must give the same codes. Returns what the host
/// did.
fn loop_at(rate: Rate, equipment: Equipment, ticks: u32) -> Vec<TraceSample> {
    let image = image_named(rate.image);
    assert_eq!(sample_rate_hz(&image).expect("an image"), rate.hz);
    let parameters = rate.parameters();
    let world = World::new(&rate.bench(), Variant::FULL, 7).shared();
    let end = u64::from(ticks) * rate.period_ns();
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

    let (host, twin) = on_the_host(rate, equipment, ticks);
    let world = world.lock().expect("the world");
    assert_same_codes(&world.codes, &twin.codes);
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
        "tick at {} kHz: {} instructions at most, {} on the mean; slowest interrupt {} instructions, ends {slowest} of {} behind its edge; {} instructions in {} ms",
        rate.hz / 1_000,
        number(&status, "most_tick_cycles"),
        number(&status, "recent_tick_cycles"),
        slowest - 400,
        rate.cycles(),
        outcome.end.1,
        outcome.end.0 / MILLISECOND,
    );
    assert!(slowest <= MOST_CYCLES, "{status}");
    host
}

/// The error of what the sensor reads over the last half second, um RMS.
fn error_of_the_reading_um(rate: Rate, host: &[TraceSample]) -> f64 {
    let parameters = rate.parameters();
    let c = &parameters.servo.converters;
    let error_um = |sample: &TraceSample| {
        let position = f64::from(c.adc_zero) / 2f64.powi(24)
            + f64::from(sample.adc_code) * c.adc_step as f64 / 2f64.powi(40);
        position - f64::from(sample.reference) / 2f64.powi(24)
    };
    let last = &host[host.len() - rate.hz as usize / 2..];
    (last
        .iter()
        .map(|sample| error_um(sample).powi(2))
        .sum::<f64>()
        / last.len() as f64)
        .sqrt()
}

fn follows_with_the_hosts_bits(rate: Rate) {
    let host = loop_at(rate, Equipment::None, rate.hz + 1_100);
    let rms_um = error_of_the_reading_um(rate, &host);
    println!("50 Hz, 3 um: {rms_um:.4} um RMS of the sensor's reading, noise included");
    assert!(rms_um < 0.03, "{rms_um} um");
}

#[test]
fn a_loop_at_50_khz_gives_the_hosts_bits() {
    follows_with_the_hosts_bits(AT_50_KHZ);
}

#[test]
fn a_loop_at_100_khz_gives_the_hosts_bits() {
    follows_with_the_hosts_bits(AT_100_KHZ);
}

#[test]
fn a_loop_at_100_khz_with_filters_monitor_and_read_back_gives_the_hosts_bits() {
    let ticks = 60_000;
    let host = loop_at(AT_100_KHZ, Equipment::All, ticks);
    assert_ne!(
        host,
        on_the_host(AT_100_KHZ, Equipment::None, ticks).0,
        "the filters are on"
    );
}
