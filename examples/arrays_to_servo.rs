//! From arrays to verdict, model and servo: `cargo run --release -p hysteron --example arrays_to_servo`.

use hysteron::servo::{Demands, design};
use hysteron::{
    Dataset, Drive, EffectInstance, InitialState, Model, Options, Overview, Record, Role, Start,
    Unwatched, WhiteNoise,
};
use hysteron::{analyse, effect_named, effects_named, waveform};

const RATE_HZ: f64 = 20_000.0;

/// What the sensor of an actuator with loops, one mode and a delay reads, um.
fn measured_um(drive_v: &[f64], seed: u64) -> Vec<f64> {
    let mut actuator = Model::new(0.0, 70.0);
    let overview = Overview::without_data(0.0, 70.0);
    for (id, values) in [
        ("hysteresis", &[10.0, 1.2, -1.2][..]),
        ("vibration", &[4000.0, 0.4]),
        ("delay", &[180e-6]),
    ] {
        actuator.add(EffectInstance::new(
            effect_named(id).expect("a built-in effect"),
            &overview,
            values,
        ));
    }
    let drive = Drive::held(drive_v, 1.0 / RATE_HZ, InitialState::Virgin);
    let mut noise = WhiteNoise::new(0.004, seed);
    actuator
        .simulate(&drive)
        .into_iter()
        .map(|y_um| y_um + noise.next_um())
        .collect()
}

pub(crate) fn arrays_to_servo() -> Result<String, Box<dyn std::error::Error>> {
    let lines: Vec<usize> = (1..=140).step_by(3).collect();
    let drives = [
        (
            "triangles",
            Role::Identify,
            waveform::triangles(RATE_HZ, 2000.0, &[0.0, 50.0, 10.0, 60.0, 5.0, 70.0, 0.0]),
        ),
        (
            "multisine",
            Role::Identify,
            waveform::multisine(2000, &lines, 8.0, 35.0, 3, 1),
        ),
        (
            "held out",
            Role::Validate,
            waveform::multisine(2500, &lines, 20.0, 30.0, 3, 2),
        ),
        ("rest", Role::Noise, vec![0.0; 4000]),
    ];
    let record = |(seed, (name, role, drive_v)): (u64, (&str, Role, Vec<f64>))| {
        let displacement_um = measured_um(&drive_v, seed);
        Record::new(name, RATE_HZ, drive_v, displacement_um)
            .from_virgin_state()
            .with_role(role)
    };
    let dataset = Dataset::new(
        "my stage",
        0.0,
        70.0,
        (0..).zip(drives).map(record).collect(),
    )?;
    let found = analyse(
        &dataset,
        Start::Effects(&effects_named("hysteresis,vibration")?),
        &Options::default(),
        &Unwatched,
    )?;
    let servo = design(
        &found.model,
        &Demands {
            sensor_noise_um: 0.004,
            ..Demands::default()
        },
    )?;
    let (verdict, error_nm, effects) = (
        &found.diagnosis.sentence,
        1e3 * found.last().error_um(),
        found.model.effect_ids().join(", "),
    );
    Ok(format!(
        "{verdict}\nThe model: {effects}; held out {error_nm:.2} nm.\nThe servo ({}):\n{}",
        servo.scheme_name(),
        servo.explanation.join("\n")
    ))
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    println!("{}", arrays_to_servo()?);
    Ok(())
}
