//! How fast models, fits, inverse and servo run on one core:
//! `cargo run --release -p hysteron-research --example speed`, as lines `case,samples,seconds`.
//!
//! `-- once CASE SAMPLES` runs a case and prints nothing, for a program that counts instructions. `--
//! cases` lists them.

use std::hint::black_box;
use std::time::Instant;

use hysteron::servo::design::{ServoDesign, thesis_scheme};
use hysteron::servo::model::actuator_model;
use hysteron::{
    Dataset, Drive, EffectInstance, InitialState, Model, Overview, Record, Unwatched, effect_named,
    effects_named, identify,
};
use hysteron_core::codes::SensorCode;
use hysteron_core::servo_tick::ServoTick;
use hysteron_core::signal::Micrometres;
use hysteron_sim::bench::Bench;
use hysteron_sim::effect::{PlantedCase, SimulatedStage, registry};
use hysteron_sim::hysteresis_inverse::HysteresisInverse;
use hysteron_sim::hysteresis_surface::{OneSidedHysteresis, Surfaces};

const RATE_HZ: f64 = 20_000.0;
const DRIVE_MAX_V: f64 = 70.0;
/// The quickest of several runs: what other programs take does not count.
const RUNS: usize = 5;

/// What is done with a drive, V.
type Run = Box<dyn Fn(&[f64])>;

/// Something that is timed by its number of samples.
struct Case {
    name: String,
    samples: usize,
    run: Run,
}

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let cases = cases();
    match arguments.iter().map(String::as_str).collect::<Vec<_>>()[..] {
        ["cases"] => cases.iter().for_each(|case| println!("{}", case.name)),
        ["once", name, samples] => {
            let (case, samples) = (cases.iter().find(|case| case.name == name), samples.parse());
            if let (Some(case), Ok(samples)) = (case, samples) {
                (case.run)(&drive_v(samples));
            }
        }
        _ => {
            println!("case,samples,seconds");
            for case in &cases {
                let drive_v = drive_v(case.samples);
                let quickest_s = (0..RUNS)
                    .map(|_| {
                        let begin = Instant::now();
                        (case.run)(&drive_v);
                        begin.elapsed().as_secs_f64()
                    })
                    .fold(f64::INFINITY, f64::min);
                println!("{},{},{quickest_s:.6}", case.name, case.samples);
            }
        }
    }
}

fn cases() -> Vec<Case> {
    let mut out = vec![
        simulation("chain", chain(), 1_000_000),
        Case {
            name: "inverse".into(),
            samples: 200_000,
            run: Box::new(invert),
        },
        Case {
            name: "fit".into(),
            samples: 100_000,
            run: Box::new(fit),
        },
        Case {
            name: "servo tick".into(),
            samples: 200_000,
            run: Box::new(tick),
        },
    ];
    for effect in registry() {
        let id = effect.declaration().id;
        if let Some(model) = alone(&id) {
            out.push(simulation(&format!("effect {id}"), model, 200_000));
        }
    }
    out
}

/// Ten plays, three relaxations and a mode: what `benchmarks/speed/chain.py` computes with other programs.
fn chain() -> Model {
    let overview = overview();
    let mut model = Model::new(0.0, DRIVE_MAX_V);
    for (id, values) in [
        ("prandtl_ishlinskii", vec![]),
        ("creep", vec![0.02, 0.1, 0.02, 1.0, 0.02, 10.0]),
        ("vibration", vec![5000.0, 0.3]),
    ] {
        if let Ok(effect) = effect_named(id) {
            model.add(EffectInstance::new(effect, &overview, &values));
        }
    }
    model
}

/// A gain and one effect, or the effect alone where it is a structure of loops; none for what needs others.
fn alone(id: &str) -> Option<Model> {
    let (overview, effect) = (overview(), effect_named(id).ok()?);
    let stage = SimulatedStage {
        overview: overview.clone(),
        natural_frequency_rad_s: 5000.0,
        damping_ratio: 0.3,
        remnant_um: vec![0.1, 0.0, 0.0, 0.0],
    };
    let declaration = effect.declaration();
    let values = effect.values_at(&mut PlantedCase {
        strength: 1.0,
        stage: &stage,
        random: &mut || 0.5,
    });
    let values = match values {
        Some(values) => values,
        None if declaration.is_main() => Vec::new(),
        None => return None,
    };
    let mut model = Model::new(0.0, DRIVE_MAX_V);
    if !declaration.is_main() {
        let gain = effect_named("gain").ok()?;
        model.add(EffectInstance::new(gain, &overview, &[0.15]));
    }
    let needs = declaration.modifies.filter(|other| *other != id);
    if let Some(other) = needs.and_then(|other| effect_named(other).ok()) {
        model.add(EffectInstance::new(other, &overview, &[]));
    }
    model.add(EffectInstance::new(effect, &overview, &values));
    Some(model)
}

fn overview() -> Overview {
    Overview {
        sample_rate_max_hz: RATE_HZ,
        sample_rate_min_hz: RATE_HZ,
        duration_s: 40.0,
        range_um: 11.0,
        gain_um_v: 0.15,
        has_force: true,
        ..Overview::without_data(0.0, DRIVE_MAX_V)
    }
}

/// Two triangles whose periods have no common multiple below 10^5 samples, so that turning points are stored
/// and wiped out. It costs little beside what is counted.
fn drive_v(samples: usize) -> Vec<f64> {
    let triangle = |k: usize, period: usize| {
        let share = (k % period) as f64 / period as f64;
        1.0 - (2.0 * share - 1.0).abs()
    };
    (0..samples)
        .map(|k| DRIVE_MAX_V * (0.01 + 0.6 * triangle(k, 1181) + 0.38 * triangle(k, 281)))
        .collect()
}

fn simulation(name: &str, model: Model, samples: usize) -> Case {
    let run = move |drive_v: &[f64]| {
        let force_n = vec![0.0; drive_v.len()];
        let drive = Drive {
            force_n: Some(&force_n),
            ..Drive::held(drive_v, 1.0 / RATE_HZ, InitialState::Virgin)
        };
        black_box(model.simulate(&drive));
    };
    Case {
        name: name.into(),
        samples,
        run: Box::new(run),
    }
}

fn invert(drive_v: &[f64]) {
    let Ok(bench) = Bench::reference() else {
        return;
    };
    let surfaces =
        Surfaces::from_thesis_powers(&bench.hysteresis.f, &bench.hysteresis.g, DRIVE_MAX_V);
    let mut inverse = HysteresisInverse::new(
        OneSidedHysteresis::virgin(surfaces, 0.0, DRIVE_MAX_V),
        0.0,
        DRIVE_MAX_V,
    );
    for volts in drive_v {
        black_box(inverse.step(0.1 * volts));
    }
}

/// The chain, fitted to what it gave.
fn fit(drive_v: &[f64]) {
    let reading_um = chain().simulate(&Drive::held(drive_v, 1.0 / RATE_HZ, InitialState::Virgin));
    let record = Record::new("stage", RATE_HZ, drive_v.to_vec(), reading_um).from_virgin_state();
    let dataset = Dataset::new("stage", 0.0, DRIVE_MAX_V, vec![record]);
    let effects = effects_named("prandtl_ishlinskii,creep,vibration");
    if let (Ok(dataset), Ok(effects)) = (dataset, effects) {
        black_box(identify(&dataset, &effects, &Unwatched).is_ok());
    }
}

/// The integer tick of the sliding-mode observer and controller, which reads what it asks for.
fn tick(drive_v: &[f64]) {
    let overview = overview();
    let mut model = Model::new(0.0, DRIVE_MAX_V);
    for (id, values) in [("hysteresis", [10.0, 1.0]), ("vibration", [5000.0, 0.3])] {
        if let Ok(effect) = effect_named(id) {
            model.add(EffectInstance::new(effect, &overview, &values));
        }
    }
    let design = thesis_scheme("pidsmoc")
        .zip(actuator_model(&model))
        .map(|(scheme, model)| ServoDesign::new(scheme, &model, false));
    let parameters = design
        .zip(Bench::reference().ok())
        .and_then(|(design, bench)| design.parameters(bench.converter_scale().parameters()).ok());
    let Some(parameters) = parameters else {
        return;
    };
    let mut servo = ServoTick::new(parameters);
    for volts in drive_v {
        let reference = Micrometres::saturating_from_num(0.1 * volts);
        let code = SensorCode::new((300.0 * volts) as u32);
        black_box(servo.tick(code, reference));
    }
}
