//! Another block takes over the running loop of the unmodified image: what it reads and drives is what the
//! host gives whose amplifier swaps at the same tick, to the last bit; the drive has no step, the loop stays
//! closed. A block that may not take over leaves everything as it was.

use crate::common;

use common::{
    best_parameters, block, lines, parameters, run_paced, samples, typed_back, wrong_gain,
};
use hysteron_core::amplifier::{Amplifier, Mode};
use hysteron_core::command_text::{Line, parse, write_upload};
use hysteron_core::parameter_block::AmplifierParameters;
use hysteron_core::servo_parameters::LawParameters;
use hysteron_core::trace_frame::TraceSample;
use hysteron_emulator::converters::World;
use hysteron_emulator::run::{MILLISECOND, Outcome, Script};
use hysteron_sim::bench::{Bench, Variant};

const TICKS: u32 = 9_000;
/// When the block is brought, ms; the swap comes some milliseconds later.
const BROUGHT_MS: u64 = 250;
/// What the interrupt may take in which the blocks change, in instructions with the converters: half of a
/// period at one a cycle.
const MOST_INSTRUCTIONS: u64 = 10_000;

fn commands(reference: &str) -> [(u32, &str); 4] {
    [
        (99, "arm untested"),
        (100, "conditioning waived"),
        (300, reference),
        (301, "enable"),
    ]
}

fn new_world() -> World {
    World::new(&Bench::reference().expect("the bench"), Variant::FULL, 7)
}

/// The amplifier on the host, which swaps before a tick.
fn on_host(
    running: &AmplifierParameters,
    reference: &str,
    swap: Option<(u32, &AmplifierParameters)>,
) -> Vec<TraceSample> {
    let (mut world, mut amplifier) = (new_world(), Amplifier::new(*running));
    let commands = commands(reference);
    let mut commands = commands.iter().peekable();
    (0..TICKS)
        .map(|tick| {
            let reading = world.edge();
            if let Some((_, block)) = swap.filter(|(at, _)| *at == tick) {
                amplifier.swap(block).expect("may follow");
            }
            if let Some((_, text)) = commands.next_if(|(at, _)| *at <= tick) {
                let Ok(Line::Control(_, command)) = parse(text, 20_000) else {
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

/// The image, to which a block is brought while its loop is closed, with the order to swap it in.
fn on_target(
    running: &AmplifierParameters,
    reference: &str,
    brought: &[u8],
) -> (Outcome, Vec<TraceSample>) {
    let mut text = String::new();
    write_upload(brought, &mut text).expect("written");
    let upload = text.replace("block commit", "block swap");
    let world = new_world().shared();
    let script = Script {
        block: Some(block(running)),
        commands: vec![
            (
                2 * MILLISECOND,
                [b"trace 31 1\n".to_vec(), lines(&commands(reference))].concat(),
            ),
            // Largest values count from here.
            (
                BROUGHT_MS * MILLISECOND,
                [b"status\n".to_vec(), upload.into_bytes()].concat(),
            ),
        ],
        serial: vec![(
            u64::from(TICKS) * 50_000 + 2 * MILLISECOND,
            b"BLK?\nDIA? 1 8 9\n".to_vec(),
        )],
        ..Script::listening(u64::from(TICKS) * 50_000 + 20 * MILLISECOND)
    };
    let script = Script {
        commands: [
            script.commands.clone(),
            vec![(u64::from(TICKS) * 50_000, b"status\n".to_vec())],
        ]
        .concat(),
        ..script
    };
    let outcome = run_paced(&world, script);
    for message in outcome
        .messages
        .iter()
        .filter(|message| !message.text.starts_with("trace ["))
    {
        println!("{:>12} {} {}", message.at_ns, message.level, message.text);
    }
    let (samples, lost) = samples(&outcome);
    assert_eq!((lost, outcome.resets, outcome.malformed), (0, 0, 0));
    (outcome, samples)
}

/// What both have, from the first tick of the trace on.
fn same(target: &[TraceSample], host: &[TraceSample]) -> bool {
    target
        .iter()
        .filter(|sample| sample.tick < TICKS)
        .all(|sample| host[sample.tick as usize] == *sample)
}

fn serial(outcome: &Outcome) -> String {
    typed_back(outcome)
}

fn slowest_instructions(outcome: &Outcome) -> u64 {
    let status = outcome
        .texts_with("status Report")
        .last()
        .expect("a status")
        .to_string();
    let counts = status
        .split("slowest_counts: ")
        .nth(1)
        .and_then(|rest| rest.split(',').next())
        .expect("counts");
    // A timer count is two instructions; the interrupt is raised 200 counts after the edge.
    (counts.parse::<u64>().expect("a number") - 200) * 2
}

/// Swaps, and says by how many codes the first drive of the new block is another one than the old block's,
/// and the largest step of the old block's drive from tick to tick in the 50 ms before.
fn swaps(
    name: &str,
    running: &AmplifierParameters,
    new: &AmplifierParameters,
    reference: &str,
) -> (u32, u32) {
    let stayed = on_host(running, reference, None);
    let bytes = block(new);
    let (outcome, target) = on_target(running, reference, &bytes);
    assert_eq!(outcome.texts_with("block swapped in").count(), 1);
    let fingerprint = hysteron_core::parameter_block::fingerprint(&bytes).expect("a block");
    assert_eq!(
        serial(&outcome),
        format!("SWAPPED\n1=2 \n8=0 \n9={fingerprint}\n")
    );

    // The tick of the swap is the first from which on the target is not the block that stayed; drives may
    // agree by chance for some ticks.
    let differs = target
        .iter()
        .find(|sample| sample.tick < TICKS && stayed[sample.tick as usize] != **sample)
        .expect("another law")
        .tick;
    let swapped = (differs - 8..=differs)
        .rev()
        .map(|at| (at, on_host(running, reference, Some((at, new)))))
        .find(|(_, host)| same(&target, host));
    let (at, host) = swapped.expect("the host's codes, to the last bit");
    let all_closed = target
        .iter()
        .filter(|sample| sample.tick > 302)
        .all(|sample| sample.flags == Mode::Closed as u16);
    assert!(all_closed, "the loop stays closed");

    let at = at as usize;
    let difference = host[at].dac_code.abs_diff(stayed[at].dac_code);
    let step = |samples: &[TraceSample]| {
        samples
            .windows(2)
            .map(|pair| pair[1].dac_code.abs_diff(pair[0].dac_code))
            .max()
            .unwrap_or(0)
    };
    let own_step = step(&stayed[at - 1000..at]);
    let c = running.servo.converters;
    let error_nm = |samples: &[TraceSample]| {
        let errors = samples
            .iter()
            .map(|sample| (sample.reference - c.position(sample.adc_code)).unsigned_abs());
        f64::from(errors.max().unwrap_or(0)) / f64::from(1 << 24) * 1000.0
    };
    let (before, after, without) = (
        error_nm(&stayed[at - 1000..at]),
        error_nm(&host[at..at + 1000]),
        error_nm(&stayed[at..at + 1000]),
    );
    let instructions = slowest_instructions(&outcome);
    println!(
        "{name}: swap at tick {at}: first drive {difference} codes beside the old block's, step {} codes ({own_step} at most in the 50 ms before); \
         largest error {before:.1} nm before, {after:.1} nm after, {without:.1} nm without a swap; slowest interrupt {instructions} instructions",
        host[at].dac_code.abs_diff(host[at - 1].dac_code)
    );
    assert!(
        instructions <= MOST_INSTRUCTIONS,
        "{instructions} instructions"
    );
    assert!(after <= 2.0 * before.max(without), "{after} nm");
    (difference, own_step)
}

/// A predictor with softer gains over a model of the hysteresis that is 2 % larger.
fn softer() -> AmplifierParameters {
    let mut softer = best_parameters();
    let times = |value: &mut i32, factor: f64| *value = (f64::from(*value) * factor).round() as i32;
    if let LawParameters::Predictor(p) = &mut softer.servo.law {
        p.gain_row
            .coefficients
            .iter_mut()
            .for_each(|c| times(c, 0.8));
        times(&mut p.unknown_gain, 0.8);
        times(&mut p.slope_gain, 0.8);
    }
    if let hysteron_core::servo_parameters::ActuatorParameters::OneSidedHysteresis {
        surfaces,
        ..
    } = &mut softer.servo.actuator
    {
        surfaces
            .g
            .iter_mut()
            .flatten()
            .chain(&mut surfaces.f)
            .for_each(|c| times(c, 1.02));
    }
    softer
}

#[test]
fn a_predictor_takes_over_at_a_constant_reference_and_at_a_moving_one() {
    for (name, reference) in [
        ("constant", "reference constant 5600"),
        ("20 Hz, 3 um", "reference sine 20000 3000 5600"),
    ] {
        let (difference, own_step) = swaps(name, &best_parameters(), &softer(), reference);
        assert!(
            difference <= own_step,
            "{difference} codes, where the drive moves by {own_step} anyway"
        );
    }
}

/// By then a gain has been learned, and behind the swap the new block learns its own.
#[test]
fn a_gain_that_is_adapted_goes_with_its_block_and_the_drive_makes_no_step() {
    let reference = "reference sine 125000 3000 5600";
    let of = |adapts: bool| {
        let wrong = wrong_gain(adapts);
        let mut softer = softer();
        (softer.servo.actuator, softer.servo.adaptation) =
            (wrong.servo.actuator, wrong.servo.adaptation);
        (wrong, softer)
    };
    let ((adapted, next_adapted), (fixed, next_fixed)) = (of(true), of(false));
    // Ticks of the first codes that a learned gain alters: before the swap, and so long behind the loop's
    // closing that the rest suffices for another.
    let [with, without] = [&adapted, &fixed].map(|block| on_host(block, reference, None));
    let learned = (0..)
        .zip(&with)
        .zip(&without)
        .find(|((_, with), without)| with != without)
        .map(|((tick, _), _)| tick)
        .expect("it learns");
    assert!(
        learned < BROUGHT_MS * 20 && BROUGHT_MS * 20 + learned < u64::from(TICKS),
        "{learned}"
    );
    for (name, running, new) in [
        ("adapted to adapted", &adapted, &next_adapted),
        ("adapted to fixed", &adapted, &next_fixed),
        ("fixed to adapted", &fixed, &next_adapted),
    ] {
        let (difference, own_step) = swaps(name, running, new, reference);
        assert!(
            difference <= own_step,
            "{name}: {difference} codes, where the drive moves by {own_step} anyway"
        );
    }
}

#[test]
fn a_regulator_takes_over_from_another() {
    let mut faster = parameters();
    if let LawParameters::Regulator(pid) = &mut faster.servo.law {
        pid.integral = pid.integral / 2 * 3;
    }
    // 0.09 to 0.14 of the error a tick, of 170 nm at most: 8 nm of 0.3 nm a code.
    let (difference, _) = swaps(
        "regulator, 10 Hz, 1 um",
        &parameters(),
        &faster,
        "reference sine 10000 1000 5600",
    );
    assert!(difference <= 30, "{difference} codes");
}

#[test]
fn a_block_that_may_not_take_over_changes_nothing() {
    let reference = "reference sine 20000 3000 5600";
    let stayed = on_host(&best_parameters(), reference, None);
    let with = |change: &dyn Fn(&mut AmplifierParameters)| {
        let mut other = best_parameters();
        change(&mut other);
        block(&other)
    };
    let mut damaged = block(&best_parameters());
    damaged[100] ^= 1;
    let refused = [
        (
            with(&|other| other.guard.rest_code = other.guard.rest_code + 1),
            "another rest, ramp or slew limit",
        ),
        (
            with(&|other| other.physical.name[0] ^= 1),
            "made for another stage",
        ),
        (
            with(&|other| other.servo.actuator = parameters().servo.actuator),
            "another kind of actuator",
        ),
        (
            with(&|other| other.physical.spectral_radius_millionths = 1_000_000),
            "not stable when sampled",
        ),
        (damaged, "checksum does not match"),
    ];
    for (bytes, reason) in refused {
        let (outcome, target) = on_target(&best_parameters(), reference, &bytes);
        assert!(
            outcome
                .texts_with("refused: block: ")
                .any(|text| text.contains(reason)),
            "{reason}"
        );
        let answers = serial(&outcome);
        assert!(
            answers.starts_with("REFUSED ") && answers.contains("1=2 \n"),
            "{answers:?}"
        );
        assert!(
            same(&target, &stayed),
            "{reason}: the running block goes on"
        );
    }
}
