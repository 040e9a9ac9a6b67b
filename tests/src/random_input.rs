//! Damaged inputs for every reader: a whole input is changed at random, and whatever the program then says
//! of it is no panic, and what it accepts is used.

use hysteron::dataset::reading::{Files, Instructions, from_file_as, from_manifest};
use hysteron::servo::amplifier_block::{
    FrontEnd, amplifier_parameters, block, read_block, upload_lines,
};
use hysteron::servo::design::ServoDesign;
use hysteron::servo::disturbance::Disturbance;
use hysteron::servo::order::{DesignOrder, design};
use hysteron::servo::reference::PeriodicReference;
use hysteron::several_axes::manifest as several_axes;
use hysteron::{
    Drive, Effect, EffectInstance, Error, InitialState, Language, Model, Overview, Policy, Result,
    effect_named, export, from_toml, own_effect, simulate, to_toml, waveform,
};
use hysteron_core::amplifier::Amplifier;
use hysteron_core::amplifier_command::Command;
use hysteron_core::codes::SensorCode;
use hysteron_core::trace_frame::{Channels, ReadBlock, TraceBlock, TraceSample};
use hysteron_core::{checksum::crc32, kept_settings, safety_envelope};
use hysteron_sim::effect::registry;
use rand::{Rng, SeedableRng};
use rand_pcg::Pcg64Mcg;

use crate::root;
use std::panic::catch_unwind;
use std::sync::Arc;

/// A whole input: what it is called, and its bytes.
pub type Whole = (String, Vec<u8>);

/// One reader.
pub struct Target {
    /// What it reads.
    pub name: &'static str,
    /// Inputs that it accepts.
    pub wholes: Vec<Whole>,
    /// Reads an input of this name, and uses what is accepted.
    pub read: fn(&str, &[u8]) -> bool,
}

/// Every reader with inputs that it accepts.
///
/// # Panics
/// Where the project's own files cannot be read.
#[must_use]
pub fn targets() -> Vec<Target> {
    let servo = design(&loops_and_mode(0.6), &DesignOrder::default()).expect("a servo");
    let parameters = amplifier_parameters(&servo, &FrontEnd::default()).expect("a block");
    let servo_text = toml::to_string(&servo).expect("a servo file");
    let text = |name: &str, text: &str| vec![(name.to_owned(), text.as_bytes().to_vec())];
    vec![
        target("recordings", recordings(), read_recording),
        target("manifests", text("dataset.toml", MANIFEST), read_manifest),
        target(
            "manifests of several axes",
            text("axes.toml", AXES),
            read_axes,
        ),
        target("models", models(), read_model),
        target(
            "effects of one's own",
            vec![file("examples/contact.toml")],
            read_effect,
        ),
        target("servo files", text("servo.toml", &servo_text), read_servo),
        target("wirings", text("front_end.toml", FRONT_END), read_front_end),
        target("policies", text("policy.toml", POLICY), read_policy),
        target(
            "references",
            text("reference", "sine:5:2:1"),
            read_reference,
        ),
        target(
            "parameter blocks",
            vec![("block".into(), block(&parameters).expect("bytes"))],
            read_parameters,
        ),
        target("traces", vec![("trace".into(), trace())], read_trace),
    ]
}

fn target(name: &'static str, wholes: Vec<Whole>, read: fn(&str, &[u8]) -> bool) -> Target {
    Target { name, wholes, read }
}

fn file(path: &str) -> Whole {
    let bytes = std::fs::read(root().join(path)).expect("a file of the project");
    (path.to_owned(), bytes)
}

/// The files that the libraries of their formats wrote.
fn recordings() -> Vec<Whole> {
    let folder = root().join("lab/library/tests/formats");
    let mut wholes: Vec<Whole> = std::fs::read_dir(folder)
        .expect("the folder of formats")
        .map(|entry| entry.expect("an entry").path())
        .filter(|path| {
            path.extension()
                .is_some_and(|kind| kind != "py" && kind != "rs")
        })
        .map(|path| {
            let name = path
                .file_name()
                .expect("a name")
                .to_string_lossy()
                .into_owned();
            (name, std::fs::read(&path).expect("a file"))
        })
        .collect();
    wholes.sort();
    wholes
}

/// Loops and a mode.
#[must_use]
pub fn loops_and_mode(damping_ratio: f64) -> Model {
    let overview = Overview::without_data(0.0, 80.0);
    let mut model = Model::new(0.0, 80.0);
    for (id, values) in [
        ("hysteresis", &[9.0, 1.0, -2.0][..]),
        ("vibration", &[5_300.0, damping_ratio]),
    ] {
        let effect = effect_named(id).expect("an effect");
        model.add(EffectInstance::new(effect, &overview, values));
    }
    model
}

/// A model for every effect, at what a fit of it begins with, behind loops and a mode.
fn models() -> Vec<Whole> {
    let overview = Overview::without_data(0.0, 80.0);
    let with = |effect: Arc<dyn Effect>| {
        let mut model = loops_and_mode(0.1);
        let (values, id) = (
            effect.starts(&overview).swap_remove(0),
            effect.declaration().id,
        );
        model.add(EffectInstance::new(effect, &overview, &values));
        let text = to_toml(&model, "stage").expect("a text");
        (format!("{id}.toml"), text.into_bytes())
    };
    registry().into_iter().map(with).collect()
}

fn trace() -> Vec<u8> {
    let mut block = TraceBlock::new(Channels::ALL, 1);
    let mut bytes = Vec::new();
    for tick in 0..16 {
        let sample = TraceSample {
            tick,
            ..TraceSample::default()
        };
        block.push(&sample, 0, |sent| bytes.extend_from_slice(sent));
    }
    block.finish(&mut |sent: &[u8]| bytes.extend_from_slice(sent));
    bytes
}

const MANIFEST: &str = r#"name = "stage"
drive_min_v = 0.0
drive_max_v = 70.0
timing = "hold_after_sample"
[[record]]
file = "first.csv"
sample_rate_hz = 6400.0
role = "identify"
initial_state = "virgin"
[[record]]
file = "second.csv"
role = "validate"
initial_state = "unknown"
from_s = 0.01
period_s = 0.01
columns = { t = "t_s", u = "u1", y = "x" }
unit = { u = "V", y = "um" }
"#;

const AXES: &str = r#"name = "stage"
[[record]]
file = "level_1.csv"
sample_rate_hz = 6400.0
role = "identify"
period_s = 0.02
columns = { u = ["u1", "u2"], y = ["x", "z"] }
unit = { u = "V", y = "um" }
"#;

const FRONT_END: &str = r#"name = "p753"
sensor_min_um = -1.0
sensor_max_um = 14.0
drive_at_lowest_code_v = -20.0
drive_beyond_highest_code_v = 120.0
sample_rate_hz = 20000
sensor_bits = 16
drive_bits = 16
stuck_s = 0.01
tracking_s = 0.005
slew_v_s = 100000.0
ramp_s = 0.05
healthy_s = 0.1
"#;

const POLICY: &str = "seed = 1000\nbetter_together = 0.8\nfloor_z = 3.0\n";

/// The one file that manifests of the targets name.
struct OneFile(Vec<u8>);

impl Files for OneFile {
    fn read(&self, name: &str) -> Result<Vec<u8>> {
        if name.contains("..") {
            return Err(Error::new(name, "is not there"));
        }
        Ok(self.0.clone())
    }
}

/// 400 rows of drives and sensors at 6,400 Hz.
fn rows() -> OneFile {
    let mut text = String::from("t_s,u_v,y_um,u1,u2,x,z\n");
    for k in 0..400 {
        let (t, u) = (
            f64::from(k) / 6400.0,
            20.0 - 20.0 * (0.098 * f64::from(k)).cos(),
        );
        text += &format!(
            "{t:.7},{u:.4},{:.4},{u:.4},{:.4},{:.4},{:.4}\n",
            0.2 * u,
            40.0 - u,
            0.2 * u,
            0.1 * u
        );
    }
    OneFile(text.into_bytes())
}

fn read_recording(name: &str, bytes: &[u8]) -> bool {
    let Ok(dataset) = from_file_as(name, bytes, &Instructions::default()) else {
        return false;
    };
    let mut values = dataset
        .records
        .iter()
        .flat_map(|record| record.drive_v.iter().chain(&record.displacement_um));
    assert!(values.all(|value| value.is_finite()));
    true
}

fn read_manifest(name: &str, bytes: &[u8]) -> bool {
    with_text(bytes, |text| from_manifest(text, name, &rows()).is_ok())
}

fn read_axes(name: &str, bytes: &[u8]) -> bool {
    with_text(bytes, |text| {
        let (is_one, file) = (several_axes::has_several(text), rows());
        several_axes::from_manifest(text, name, &|name| file.read(name)).is_ok() && is_one
    })
}

/// A model that is accepted runs, is written and read again as it is, and is exported.
fn read_model(name: &str, bytes: &[u8]) -> bool {
    with_text(bytes, |text| {
        let Ok(model) = from_toml(text, name) else {
            return false;
        };
        let drive_v = waveform::triangles(20_000.0, 40_000.0, &[0.0, 60.0, 20.0, 80.0]);
        let drive = Drive::held(&drive_v, 1.0 / 20_000.0, InitialState::Virgin);
        let reading_um = simulate(&model, &drive, "a drive");
        let written = to_toml(&model, "stage").expect("a model that was read is written");
        let again = from_toml(&written, name).unwrap_or_else(|error| panic!("{error}\n{written}"));
        assert_eq!(simulate(&again, &drive, "a drive").ok(), reading_um.ok());
        for language in [Language::C, Language::Matlab, Language::Python] {
            // What an export refuses it says; what it writes is compared elsewhere.
            let _ = export(&model, language, 20_000.0, "stage");
        }
        true
    })
}

fn read_effect(name: &str, bytes: &[u8]) -> bool {
    with_text(bytes, |text| {
        let Ok(effect) = own_effect(text, name) else {
            return false;
        };
        let overview = Overview::without_data(0.0, 80.0);
        let mut model = Model::new(0.0, 80.0);
        model.add(EffectInstance::new(
            effect_named("gain").expect("an effect"),
            &overview,
            &[0.1],
        ));
        for values in effect.starts(&overview).into_iter().take(3) {
            let mut with = model.clone();
            with.add(EffectInstance::new(effect.clone(), &overview, &values));
            let drive = Drive::held(&[0.0, 20.0, 80.0, 5.0], 1e-3, InitialState::Virgin);
            let _ = simulate(&with, &drive, "a drive");
        }
        true
    })
}

/// A servo that is accepted and has a block: the block is verified before a target runs it.
fn read_servo(name: &str, bytes: &[u8]) -> bool {
    with_text(bytes, |text| {
        let Ok(servo) = ServoDesign::from_toml(text, name) else {
            return false;
        };
        let _ = servo.law();
        if let Ok(parameters) = amplifier_parameters(&servo, &FrontEnd::default()) {
            run(Amplifier::new(parameters));
        }
        true
    })
}

fn read_front_end(name: &str, bytes: &[u8]) -> bool {
    with_text(bytes, |text| FrontEnd::from_toml(text, name).is_ok())
}

fn read_policy(name: &str, bytes: &[u8]) -> bool {
    with_text(bytes, |text| Policy::from_toml(text, name).is_ok())
}

fn read_reference(_: &str, bytes: &[u8]) -> bool {
    const PERIOD_S: f64 = 5e-5;
    with_text(bytes, |text| {
        let disturbance = Disturbance::parse(text, PERIOD_S);
        if let Ok(disturbance) = &disturbance {
            assert_eq!(disturbance.samples_um(100, 10, PERIOD_S).len(), 100);
        }
        disturbance.is_ok() | PeriodicReference::parse(text, PERIOD_S).is_ok()
    })
}

/// With a right checksum at the end: without it no damage would reach what is behind the check.
fn sealed(bytes: &[u8]) -> Vec<u8> {
    let mut sealed = bytes.to_vec();
    if let Some(end) = sealed.len().checked_sub(4) {
        let sum = crc32(&sealed[..end]).to_le_bytes();
        sealed[end..].copy_from_slice(&sum);
    }
    sealed
}

/// A block that is accepted runs.
fn read_parameters(_: &str, bytes: &[u8]) -> bool {
    let sealed = sealed(bytes);
    let _ = (
        kept_settings::read(&sealed, 20_000),
        safety_envelope::read(&sealed),
    );
    let _ = (read_block(bytes), upload_lines(bytes));
    let Ok(parameters) = read_block(&sealed) else {
        return false;
    };
    run(Amplifier::new(parameters));
    true
}

/// Some ticks with readings from end to end.
fn run(mut amplifier: Amplifier) {
    for command in [Command::Arm { tested: true }, Command::Enable] {
        let _ = amplifier.command(command);
    }
    for tick in 0..400u32 {
        let reading = SensorCode::new(tick.wrapping_mul(40_503) & 0xffff);
        let _ = amplifier.tick((tick % 50 != 49).then_some(reading), false);
    }
}

fn read_trace(_: &str, bytes: &[u8]) -> bool {
    let sealed = sealed(bytes);
    let _ = hysteron::capture::capture(bytes, bytes);
    ReadBlock::read(&sealed).is_ok_and(|block| block.samples().count() > 0)
}

fn with_text(bytes: &[u8], read: impl FnOnce(&str) -> bool) -> bool {
    std::str::from_utf8(bytes).is_ok_and(read)
}

/// Numbers at which readers go wrong.
const NUMBERS: [&str; 16] = [
    "0",
    "-0.0",
    "-1",
    "1e-320",
    "1e308",
    "-1e308",
    "inf",
    "nan",
    "9223372036854775807",
    "18446744073709551616",
    "4294967296",
    "0.1",
    "1e-9",
    "1e9",
    "",
    "\"a\"",
];

/// An input with one to four changes.
fn damaged(target: &Target, seed: u64) -> Whole {
    let mut random = Pcg64Mcg::seed_from_u64(seed);
    let (name, whole) = &target.wholes[random.random_range(0..target.wholes.len())];
    let mut bytes = whole.clone();
    // Most have one change: more than that is refused for the first of them.
    for _ in 0..[1, 1, 1, 2, 4][random.random_range(0..5)] {
        damage(&mut bytes, &mut random);
    }
    (name.clone(), bytes)
}

/// Reads a damaged input for each seed, and how many were accepted.
///
/// # Panics
/// Where a reader does, with the seed.
#[must_use]
pub fn accepted(target: &Target, seeds: std::ops::Range<u64>) -> usize {
    let is_accepted = |seed: &u64| {
        let (name, bytes) = damaged(target, *seed);
        catch_unwind(|| (target.read)(&name, &bytes))
            .unwrap_or_else(|_| panic!("{}: a panic in {name}, seed {seed}", target.name))
    };
    seeds.filter(is_accepted).count()
}

fn damage(bytes: &mut Vec<u8>, random: &mut Pcg64Mcg) {
    if bytes.is_empty() {
        bytes.push(random.random());
        return;
    }
    let at = random.random_range(0..bytes.len());
    match random.random_range(0..10) {
        0 => bytes[at] ^= 1 << random.random_range(0..8),
        1 => bytes.truncate(at),
        2 | 3 => replace_number(bytes, at, random),
        8 | 9 => replace_digit(bytes, at, random),
        4 => {
            // A length or a count of 32 bits.
            let value: u32 = [0, 1, u32::MAX, 1 << 31, random.random()][random.random_range(0..5)];
            let end = bytes.len().min(at + 4);
            bytes[at..end].copy_from_slice(&value.to_le_bytes()[..end - at]);
        }
        5 => {
            let piece = line_at(bytes, at);
            let copy = bytes[piece.clone()].to_vec();
            bytes.splice(piece.end..piece.end, copy);
        }
        6 => {
            let piece = line_at(bytes, at);
            bytes.drain(piece);
        }
        _ => {
            let [from, to] = [
                line_at(bytes, at),
                line_at(bytes, random.random_range(0..bytes.len())),
            ];
            let moved = bytes[from].to_vec();
            bytes.splice(to, moved);
        }
    }
}

/// Puts another number where the next one stands.
fn replace_number(bytes: &mut Vec<u8>, at: usize, random: &mut Pcg64Mcg) {
    let is_of_number = |byte: &u8| byte.is_ascii_digit() || b"+-.eE".contains(byte);
    let Some(from) = bytes[at..]
        .iter()
        .position(u8::is_ascii_digit)
        .map(|k| at + k)
    else {
        return;
    };
    let length = bytes[from..]
        .iter()
        .take_while(|byte| is_of_number(byte))
        .count();
    let number = NUMBERS[random.random_range(0..NUMBERS.len())];
    bytes.splice(from..from + length, number.bytes());
}

/// Another digit for the next one: most numbers stay in their range.
fn replace_digit(bytes: &mut [u8], at: usize, random: &mut Pcg64Mcg) {
    if let Some(digit) = bytes[at..].iter_mut().find(|byte| byte.is_ascii_digit()) {
        *digit = b"0123456789"[random.random_range(0..10)];
    }
}

/// The line around a byte, with its end.
fn line_at(bytes: &[u8], at: usize) -> std::ops::Range<usize> {
    let from = bytes[..at]
        .iter()
        .rposition(|byte| *byte == b'\n')
        .map_or(0, |k| k + 1);
    let to = bytes[at..]
        .iter()
        .position(|byte| *byte == b'\n')
        .map_or(bytes.len(), |k| at + k + 1);
    from..to
}
