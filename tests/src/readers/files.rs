//! What the program reads from files and from its command line.

use super::shared::{Target, Whole, loops_and_mode, target, text, with_text};
use crate::root;
use hysteron::dataset::reading::{Files, Instructions, from_file_as, from_manifest};
use hysteron::servo::amplifier_block::{FrontEnd, amplifier_parameters};
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
use hysteron_sim::effect::registry;
use std::sync::Arc;

pub(super) fn targets() -> Vec<Target> {
    let servo = design(&loops_and_mode(0.6), &DesignOrder::default()).expect("a servo");
    let servo_text = toml::to_string(&servo).expect("a servo file");
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
            "own effects",
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
    ]
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
            super::board::run(Amplifier::new(parameters));
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
