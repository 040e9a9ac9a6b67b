//! What the tests on the emulated part share.
#![allow(dead_code)] // each test uses a part of it

use std::path::PathBuf;

use hysteron_core::amplifier::Amplifier;
use hysteron_core::codes::{DriveCode, SensorCode};
use hysteron_core::creep_inverse::CreepInverseParameters;
use hysteron_core::gain_adaptation::{AdaptationParameters, LARGEST_STEP, MOST, ONE};
use hysteron_core::guard::GuardParameters;
use hysteron_core::integer_row::Row;
use hysteron_core::learned_feedforward::{
    LEARNING_FRACTION_BITS, LEARNING_TAPS, LearningParameters, ROBUSTNESS_FRACTION_BITS,
    ROBUSTNESS_TAPS,
};
use hysteron_core::loop_bands::LoopBands;
use hysteron_core::parameter_block::{
    AmplifierParameters, BLOCK_BYTES, PhysicalDescription, read, write,
};
use hysteron_core::pid_regulator::PidParameters;
use hysteron_core::safety_envelope::SafetyEnvelope;
use hysteron_core::sensor_lag::SensorLag;
use hysteron_core::servo_parameters::{
    ActuatorParameters, ConverterParameters, LawParameters, ServoParameters,
};
use hysteron_core::stepping_parameters::IfStepping;
use hysteron_core::trace_frame::{ReadBlock, TraceSample};
use hysteron_emulator::board::{NucleoBoard, ONE_INSTRUCTION_PER_CYCLE};
use hysteron_emulator::converters::{SharedWorld, World};
use hysteron_emulator::run::{MILLISECOND, Outcome, Script, bench_envelope, envelope_bytes, run};
use hysteron_sim::bench::{Bench, Variant};

/// The image under test.
pub fn image() -> PathBuf {
    image_named("hysteron-firmware")
}

/// An image where `cargo xtask check` builds it, or where whoever runs the test says (`cargo xtask mutate`).
pub fn image_named(name: &str) -> PathBuf {
    let built = || {
        PathBuf::from(env!("CARGO_MANIFEST_DIR"))
            .join("../../firmware/target/thumbv7em-none-eabihf/release")
    };
    std::env::var_os("HYSTERON_IMAGES")
        .map_or_else(built, PathBuf::from)
        .join(name)
}

/// A servo for the reference bench that needs no identification: integral control through a mean gain, and
/// the guard's limits.
pub fn parameters() -> AmplifierParameters {
    let bench = Bench::reference().expect("the bench");
    let mut name = [0; 16];
    name[..4].copy_from_slice(b"p753");
    let converters = ConverterParameters {
        slew_codes: 2340,
        ..bench.converter_scale().parameters()
    };
    AmplifierParameters {
        physical: PhysicalDescription {
            name,
            sample_rate_hz: 20_000,
            drive_min_mv: 0,
            drive_max_mv: 80_000,
            slew_limit_v_s: 100_000,
            sensor_span_nm: 15_000,
            spectral_radius_millionths: 950_000,
        },
        servo: ServoParameters {
            converters,
            actuator: ActuatorParameters::Linear {
                volts_per_micrometre: 7 << 20,
                micrometres_per_volt: (1 << 28) / 7,
            },
            law: LawParameters::Regulator(PidParameters {
                proportional_derivative: Row {
                    coefficients: [1 << 16, 0],
                },
                integral: 3 << 21,
                feedforward: Row::default(),
                creep: CreepInverseParameters::default(),
                notch: Row {
                    coefficients: [1 << 28, 0, 0, 0, 0],
                },
            }),
            delayed: true,
            sensor_lag: SensorLag::NONE,
            learning: None,
            adaptation: None,
        },
        guard: GuardParameters {
            adc_code_min: SensorCode::new(16),
            adc_code_max: SensorCode::new(65_519),
            stuck_ticks: 200,
            jump_codes: 4500,
            tracking_error: 5 << 23,
            tracking_ticks: 100,
            ramp_codes: 40,
            rest_code: converters.dac_code_min,
            healthy_ticks: 2000,
        },
        loop_bands: LoopBands::UNKNOWN,
        stepping: IfStepping::NONE,
    }
}

/// The best design for the reference bench, made from records of it: `lab/examples/reference_block.rs` wrote
/// the file.
pub fn best_parameters() -> AmplifierParameters {
    read(include_bytes!("../../p753.block"), 20_000).expect("a valid block")
}

/// The gain of the model of [`wrong_gain`] over the true one, hundredths.
pub const MODEL_HUNDREDTHS: i32 = 88;

/// The best servo with a model whose gain is too small, and bounds that let it correct that in a second.
pub fn wrong_gain(adaptation: bool) -> AmplifierParameters {
    let mut out = best_parameters();
    let ActuatorParameters::OneSidedHysteresis { surfaces, .. } = &mut out.servo.actuator else {
        panic!("an inverted hysteresis")
    };
    surfaces
        .g
        .iter_mut()
        .flatten()
        .chain(&mut surfaces.f)
        .for_each(|c| *c = (i64::from(*c) * i64::from(MODEL_HUNDREDTHS) / 100) as i32);
    let bounds = AdaptationParameters {
        most: MOST,
        most_step: LARGEST_STEP,
        error_limit: 1 << 23,
        least_motion: ONE / 50,
    };
    assert!(bounds.accepted());
    out.servo.adaptation = adaptation.then_some(bounds);
    out
}

/// Filters that need no design: a share of the error itself, seen through a Hann window in time, which ends
/// near 600 Hz. The loop follows so far without much phase.
pub fn learning(parameters: AmplifierParameters) -> AmplifierParameters {
    let mut row = [0; LEARNING_TAPS];
    row[31] = 3 << (LEARNING_FRACTION_BITS - 2);
    // One number on both sides: symmetric to the last bit.
    let hann = |k: usize| {
        (std::f64::consts::PI * k.min(ROBUSTNESS_TAPS - k) as f64 / ROBUSTNESS_TAPS as f64)
            .sin()
            .powi(2)
    };
    let sum: f64 = (0..ROBUSTNESS_TAPS).map(hann).sum();
    let smooth =
        std::array::from_fn(|k| (hann(k) / sum * f64::from(1 << ROBUSTNESS_FRACTION_BITS)) as i32);
    let learning = LearningParameters {
        learning: Row { coefficients: row },
        robustness: Row {
            coefficients: smooth,
        },
        error_limit: 1 << 23,
        point_limit: 1 << 14,
        periods_per_halving: 4,
        most_halvings: 2,
    };
    assert!(learning.accepted());
    let mut out = parameters;
    out.servo.learning = Some(learning);
    out
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
        let bytes: Option<Vec<u8>> = text
            .strip_prefix("trace [")
            .and_then(|rest| rest.strip_suffix(']'))
            .and_then(|list| list.split(", ").map(|byte| byte.parse().ok()).collect());
        // A block that a slow reader tore is found by its length and checksum, and is missing then.
        let Some(Ok(block)) = bytes.as_deref().map(ReadBlock::read) else {
            continue;
        };
        lost = block.lost_ticks;
        samples.extend(block.samples());
    }
    (samples, lost)
}

/// Asserts that image and host agree in every sample from where the trace runs at full rate, tick 100.
pub fn assert_same_bits(target: &[TraceSample], host: &[TraceSample]) {
    let ticks = host.len() as u32;
    let full_rate: Vec<_> = target
        .iter()
        .filter(|sample| sample.tick >= 100 && sample.tick < ticks)
        .collect();
    assert_eq!(full_rate.len(), (ticks - 100) as usize);
    for (ours, theirs) in full_rate.iter().zip(&host[100..]) {
        assert_eq!(**ours, *theirs);
    }
}

/// Asserts that image and host agree in the codes of every edge that the host has.
#[track_caller]
pub fn assert_same_codes(image: &[(SensorCode, DriveCode)], host: &[(SensorCode, DriveCode)]) {
    assert!(image.len() >= host.len() && !host.is_empty());
    let mut pairs = image.iter().zip(host);
    if let Some(at) = pairs.position(|(ours, theirs)| ours != theirs) {
        let around = at.saturating_sub(3)..(at + 4).min(host.len());
        panic!(
            "image and host differ at edge {at}: {:?}, {:?}",
            &image[around.clone()],
            &host[around]
        );
    }
}

/// The amplifier of the image on the host, with commands at their ticks: what the target must have done, bit by bit.
pub fn host_run(
    parameters: &AmplifierParameters,
    world: &mut World,
    commands: &[(u32, &str)],
    ticks: usize,
) -> Vec<TraceSample> {
    host_run_of(Amplifier::new(*parameters), world, commands, ticks)
}

/// [`host_run`] of an amplifier that was given something before.
pub fn host_run_of(
    mut amplifier: Amplifier,
    world: &mut World,
    commands: &[(u32, &str)],
    ticks: usize,
) -> Vec<TraceSample> {
    let mut commands = commands.iter().peekable();
    (0..ticks)
        .map(|tick| {
            let reading = world.edge();
            // The interrupt takes at most one command in a tick.
            if let Some((_, text)) = commands.next_if(|(at, _)| *at as usize <= tick) {
                let rate_hz = amplifier.parameters().physical.sample_rate_hz;
                let Ok(hysteron_core::command_text::Line::Control(_, command)) =
                    hysteron_core::command_text::parse(text, rate_hz)
                else {
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

/// A conditioning and a sine of the reference on the reference bench, every tick traced: what the image did,
/// and what the host does.
pub struct SineRun<'a> {
    bench: &'a Bench,
    parameters: &'a AmplifierParameters,
    commands: [(u32, &'a str); 4],
    ticks: u32,
}

impl<'a> SineRun<'a> {
    /// The tick at which the loop is closed: the conditioning is over by then.
    const ENABLE_TICK: u32 = 22_300;

    /// `reference` is the command for the sine.
    pub fn new(
        bench: &'a Bench,
        parameters: &'a AmplifierParameters,
        reference: &'a str,
        ticks: u32,
    ) -> Self {
        let commands = [
            (99, "arm untested"),
            (100, "condition"),
            (Self::ENABLE_TICK, reference),
            (Self::ENABLE_TICK + 1, "enable"),
        ];
        Self {
            bench,
            parameters,
            commands,
            ticks,
        }
    }

    /// The image with its block; what is typed on the serial port comes at the end. Largest values are
    /// counted from where the loop is closed.
    pub fn on_target(&self, typed: &[u8]) -> Outcome {
        let world = World::new(self.bench, Variant::FULL, 7).shared();
        let end = u64::from(self.ticks) * 50_000;
        let script = Script {
            block: Some(block(self.parameters)),
            commands: vec![
                (
                    2 * MILLISECOND,
                    [b"trace 31 1\n".to_vec(), lines(&self.commands)].concat(),
                ),
                (
                    u64::from(Self::ENABLE_TICK) * 50_000 + 20 * MILLISECOND,
                    b"status\n".to_vec(),
                ),
                (end, b"status\n".to_vec()),
            ],
            serial: vec![(end, typed.to_vec())],
            ..Script::listening(end + 30 * MILLISECOND)
        };
        run_paced(&world, script)
    }

    /// The host with the same commands, and perhaps another block.
    pub fn on_host(&self, parameters: &AmplifierParameters) -> Vec<TraceSample> {
        host_run(
            parameters,
            &mut World::new(self.bench, Variant::FULL, 7),
            &self.commands,
            self.ticks as usize,
        )
    }

    /// That the image lost nothing and did what the host does, to the last bit; the host's samples.
    pub fn assert_equal(&self, outcome: &Outcome) -> Vec<TraceSample> {
        let (target, lost) = samples(outcome);
        assert_eq!(
            (lost, outcome.malformed, outcome.resets),
            (0, 0, 0),
            "{:?}",
            outcome.messages
        );
        let host = self.on_host(self.parameters);
        assert_same_bits(&target, &host);
        let status = last_status(outcome);
        println!("{status}");
        assert!(status.contains("overruns: 0"), "{status}");
        host
    }

    /// Reading at the zero that the conditioning found, um: a mean over its last 1024 ticks.
    pub fn zero_um(&self, host: &[TraceSample]) -> f64 {
        let zeroing = &host[100 + 2000 + 20_000 - 1024..100 + 2000 + 20_000];
        let step = self.parameters.servo.converters.adc_step as f64 / 2f64.powi(40);
        zeroing.iter().map(|s| f64::from(s.adc_code)).sum::<f64>() / 1024.0 * step
    }
}

/// Commands as bytes for the target, all sent at once, each with its tick.
pub fn lines(commands: &[(u32, &str)]) -> Vec<u8> {
    commands
        .iter()
        .flat_map(|(at, text)| format!("@{at} {text}\n").into_bytes())
        .collect()
}

/// A world around the reference bench.
pub fn world() -> SharedWorld {
    World::new(&Bench::reference().expect("the bench"), Variant::PLAIN, 3).shared()
}

/// The image on a board in this world.
pub fn run_on(world: &SharedWorld, script: Script) -> Outcome {
    let board = NucleoBoard::with_plant(world).expect("a board");
    run(&image(), board, script).expect("a run")
}

/// The image with a block, run for so many milliseconds; the command comes at the fourth.
pub fn run_command(
    world: &SharedWorld,
    parameters: &AmplifierParameters,
    command: impl Into<Vec<u8>>,
    run_ms: u64,
) -> Outcome {
    run_command_within(&bench_envelope(), world, parameters, command, run_ms)
}

/// As [`run_command`], with another safety envelope than the bench's.
pub fn run_command_within(
    envelope: &SafetyEnvelope,
    world: &SharedWorld,
    parameters: &AmplifierParameters,
    command: impl Into<Vec<u8>>,
    run_ms: u64,
) -> Outcome {
    let script = Script {
        block: Some(block(parameters)),
        envelope: Some(envelope_bytes(envelope)),
        commands: vec![(4 * MILLISECOND, command.into())],
        ..Script::listening(run_ms * MILLISECOND)
    };
    run_on(world, script)
}

/// As [`run_on`], an instruction a cycle: what the image has time for.
pub fn run_paced(world: &SharedWorld, script: Script) -> Outcome {
    let mut board = NucleoBoard::with_plant(world).expect("a board");
    board.instructions_per_second = ONE_INSTRUCTION_PER_CYCLE;
    run(&image(), board, script).expect("a run")
}

/// The last status of a run.
pub fn last_status(outcome: &Outcome) -> &str {
    outcome.texts_with("status").last().expect("a status")
}

/// The number behind a name in a status.
pub fn number(status: &str, name: &str) -> u64 {
    let rest = status.split(&format!("{name}: ")).nth(1);
    let digits = rest
        .unwrap_or_default()
        .split(|c: char| !c.is_ascii_digit());
    let mut digits = digits.map(str::parse);
    digits.next().and_then(Result::ok).unwrap_or(u64::MAX)
}

/// What the image typed on the serial port.
pub fn typed_back(outcome: &Outcome) -> String {
    let characters = outcome.serial.iter().map(|(_, byte)| char::from(*byte));
    characters.collect()
}

/// What a run says beside its trace.
pub fn texts(outcome: &Outcome) -> Vec<&str> {
    outcome
        .messages
        .iter()
        .map(|message| message.text.as_str())
        .filter(|text| !text.starts_with("trace ["))
        .collect()
}

/// Asserts how often a run says something.
#[track_caller]
pub fn assert_texts(outcome: &Outcome, part: &str, times: usize) {
    let said = outcome.texts_with(part).count();
    assert_eq!(said, times, "{part}: {:?}", texts(outcome));
}

/// The place of the first text that contains a part.
pub fn place_of(texts: &[&str], part: &str) -> usize {
    let at = texts.iter().position(|text| text.contains(part));
    at.unwrap_or_else(|| panic!("{part}: {texts:?}"))
}

/// The place of the last text that contains a part.
pub fn last_place_of(texts: &[&str], part: &str) -> usize {
    let at = texts.iter().rposition(|text| text.contains(part));
    at.unwrap_or_else(|| panic!("{part}: {texts:?}"))
}
