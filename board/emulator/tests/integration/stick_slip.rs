//! A stick-slip drive on the image: teeth, fine motion and a velocity give the host's bits, and what stops it
//! has its name.

use crate::common;

#[path = "../../../../tests/src/lugre_rig.rs"]
#[allow(dead_code)] // the tests of the design use more of it
mod lugre_rig;

use common::{assert_same_codes, block, host_run, image, lines, number, texts, typed_back};
use hysteron::servo::stepping_design::{SteppingDesign, SteppingOrder};
use hysteron::servo::stepping_rig;
use hysteron_core::parameter_block::AmplifierParameters;
use hysteron_core::signal::Travel;
use hysteron_core::trace_frame::TraceSample;
use hysteron_emulator::board::{NucleoBoard, ONE_INSTRUCTION_PER_CYCLE};
use hysteron_emulator::converters::World;
use hysteron_emulator::run::{
    MILLISECOND, Outcome, Script, envelope_bytes, run, stick_slip_envelope,
};
use hysteron_sim::closed_loop::Plant;
use hysteron_sim::converter_scale::ConverterScale;
use hysteron_sim::stick_slip::{StickSlipActuator, StickSlipPlant};
use lugre_rig::{LugreRig, RigFactors};

/// A period, ns and s.
const PERIOD_NS: u64 = 50_000;
const PERIOD_S: f64 = 5e-5;
/// Cycles of a period, and with an instruction a cycle instructions.
const PERIOD_CYCLES: u64 = 20_000;

/// The rig of chapter 3, which PIPython's program has as well.
fn thesis() -> StickSlipActuator {
    let rig = stepping_rig::from_toml(include_str!("../rig.toml"), "rig.toml").expect("a rig");
    assert_eq!(rig, StickSlipActuator::thesis(0.0635));
    rig
}

/// The block for that rig, and its converters.
fn designed(order: &SteppingOrder) -> (AmplifierParameters, ConverterScale) {
    let design = SteppingDesign::new(&thesis(), order).expect("a design");
    (
        design.block().expect("a block"),
        order.front_end.scale(0.0, 100.0),
    )
}

fn world(plant: impl Plant + Send + 'static, scale: ConverterScale) -> World {
    let mut world = World::with(Box::new(plant), scale, 0.003, 7);
    world.encoder = true;
    world
}

/// Into the loop; 0.3 mm by teeth, 1 um down inside a step, and back at 400 um/s.
const COMMANDS: [(u32, &str); 6] = [
    (1_000, "arm untested"),
    (1_001, "conditioning waived"),
    (1_002, "enable"),
    (2_000, "travel 300000 0"),
    (12_000, "travel 299000 0"),
    (16_000, "travel 100000 400000"),
];
/// Ticks at which a move of them has arrived, and their number.
const ARRIVED: [usize; 3] = [11_900, 15_900, 29_900];
const TICKS: u32 = 30_000;

/// Image and host on the same rig, which must give the same codes; what the host did.
fn same_bits<P: Plant + Send + Clone + 'static>(
    plant: P,
    commands: &[(u32, &str)],
    ticks: u32,
) -> Vec<TraceSample> {
    let (parameters, scale) = designed(&SteppingOrder::default());
    let shared = world(plant.clone(), scale).shared();
    let mut board = NucleoBoard::with_plant(&shared).expect("a board");
    board.instructions_per_second = ONE_INSTRUCTION_PER_CYCLE;
    let end = u64::from(ticks) * PERIOD_NS;
    // Each a moment before its tick: few wait at once.
    let mut typed: Vec<(u64, Vec<u8>)> = commands
        .iter()
        .map(|command| {
            let from = u64::from(command.0.saturating_sub(200)) * PERIOD_NS;
            (from.max(2 * MILLISECOND), lines(&[*command]))
        })
        .collect();
    typed.push((end, b"status\n".to_vec()));
    let script = Script {
        block: Some(block(&parameters)),
        envelope: Some(envelope_bytes(&stick_slip_envelope(&scale))),
        commands: typed,
        ..Script::listening(end + 20 * MILLISECOND)
    };
    let outcome = run(&image(), board, script).expect("a run");
    let mut twin = world(plant, scale);
    let host = host_run(&parameters, &mut twin, commands, ticks as usize);
    let found = (outcome.malformed, outcome.resets);
    assert_eq!(found, (0, 0), "{:?}", texts(&outcome));
    assert_same_codes(&shared.lock().expect("the world").codes, &twin.codes);
    let status = common::last_status(&outcome);
    let figure = |name| number(status, name);
    assert_eq!((figure("lost_samples"), figure("overruns")), (0, 0));
    // A timer count is two instructions.
    let slowest = 2 * figure("slowest_counts");
    println!(
        "stick-slip tick: {} instructions at most, {} on the mean; the slowest interrupt ends {slowest} of {PERIOD_CYCLES} behind its edge",
        figure("most_tick_cycles"),
        figure("recent_tick_cycles"),
    );
    assert!(slowest < PERIOD_CYCLES / 4, "{status}");
    host
}

/// From the target to the position, um.
fn error_um(sample: &TraceSample) -> f64 {
    let um = |bits| Travel::from_bits(bits).to_num::<f64>();
    um(sample.reference) - um(sample.applied)
}

fn moves_with_the_hosts_bits(plant: impl Plant + Send + Clone + 'static) {
    let host = same_bits(plant, &COMMANDS, TICKS);
    for tick in ARRIVED {
        let error = error_um(&host[tick]);
        assert!(error.abs() < 0.05, "{error} um at tick {tick}");
    }
}

#[test]
fn teeth_and_fine_motion_give_the_hosts_bits() {
    moves_with_the_hosts_bits(StickSlipPlant::at_rest(thesis(), PERIOD_S));
}

#[test]
fn a_rig_of_other_equations_gives_the_hosts_bits() {
    moves_with_the_hosts_bits(LugreRig::at_rest(RigFactors::NOMINAL, PERIOD_S));
}

/// What the board answers on its serial port to lines, each with the instant at which it is typed, ms.
fn answers(
    plant: impl Plant + Send + 'static,
    order: &SteppingOrder,
    typed: &[(u64, &str)],
    until_ms: u64,
) -> Outcome {
    let (parameters, scale) = designed(order);
    let world = world(plant, scale).shared();
    let board = NucleoBoard::with_plant(&world).expect("a board");
    let script = Script {
        block: Some(block(&parameters)),
        envelope: Some(envelope_bytes(&stick_slip_envelope(&scale))),
        serial: typed
            .iter()
            .map(|(at_ms, line)| (at_ms * MILLISECOND, line.as_bytes().to_vec()))
            .collect(),
        ..Script::listening(until_ms * MILLISECOND)
    };
    run(&image(), board, script).expect("a run")
}

const CLOSES: &str = "ARM 1 2\nRON 1 0\nSVO 1 1\n";

#[test]
fn a_slider_that_jams_is_stalled() {
    let plant = Stopped(StickSlipPlant::at_rest(thesis(), PERIOD_S), 95.0);
    let typed = [
        (10, CLOSES),
        (60, "MOV 1 500\n"),
        (500, "DIA? 2\nMOV 1 0\nERR?\n"),
    ];
    let outcome = answers(plant, &SteppingOrder::default(), &typed, 550);
    // 5: a move with the servo off.
    assert_eq!(typed_back(&outcome), "2=38\n5\n", "{:?}", texts(&outcome));
    common::assert_texts(&outcome, "mode fault: stalled", 1);
}

/// A slider that reads no further than a stop.
struct Stopped(StickSlipPlant, f64);

impl Plant for Stopped {
    fn advance(&mut self, drive_v: f64, external_um: f64) {
        self.0.advance(drive_v, external_um);
    }
    fn displacement_um(&self) -> f64 {
        self.0.displacement_um().min(self.1)
    }
    fn sensor_um(&self) -> f64 {
        self.displacement_um()
    }
}

#[test]
fn an_end_of_the_travel_and_a_target_beyond_it_are_named() {
    let order = SteppingOrder {
        travel_um: [-100.0, 100.0],
        ..SteppingOrder::default()
    };
    let plant = Stopped(StickSlipPlant::at_rest(thesis(), PERIOD_S), 92.0);
    let typed = [
        (10, CLOSES),
        (60, "TMX? 1\nMOV 1 100.1\nERR?\nMOV 1 100\n"),
        (800, "DIA? 2\nPOS? 1\n"),
    ];
    let outcome = answers(plant, &order, &typed, 850);
    let text = typed_back(&outcome);
    let answers: Vec<&str> = text.lines().collect();
    assert_eq!(answers[..3], ["1=100.000000", "7", "2=39"], "{text}");
    let position: f64 = answers[3].trim_start_matches("1=").parse().expect("um");
    // The drive on its way to rest takes the slider along.
    assert!((75.0..92.1).contains(&position), "{text}");
    common::assert_texts(&outcome, "mode fault: end of travel", 1);
}

mod long {
    use super::*;

    #[test]
    #[ignore = "minutes of processor: cargo xtask full"]
    fn a_million_ticks_give_the_hosts_bits() {
        // A move by teeth, one inside a step and one at a velocity every 25,000 ticks.
        let moves: Vec<(u32, String)> = (0..39u32)
            .flat_map(|nth| {
                let (at, far) = (2_000 + 25_000 * nth, (nth % 5) * 300_000);
                [
                    (at, format!("travel {far} 0")),
                    (at + 15_000, format!("travel {} 0", far + 700)),
                    (at + 19_000, format!("travel {} 300000", far + 60_000)),
                ]
            })
            .collect();
        let moves = moves.iter().map(|(at, text)| (*at, text.as_str()));
        let commands: Vec<(u32, &str)> = COMMANDS[..3].iter().copied().chain(moves).collect();
        let host = same_bits(
            StickSlipPlant::at_rest(thesis(), PERIOD_S),
            &commands,
            1_000_000,
        );
        let arrived = host.iter().filter(|s| error_um(s).abs() < 0.05).count();
        assert!(arrived > 300_000, "{arrived} ticks at the target");
    }
}
