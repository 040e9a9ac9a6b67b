//! Fit and decision where noise, gain and sampling rate are far from those of a usual stage, and the standard
//! deviations of a fit against its scatter over seeds.
//!
//! The stage has loops and a mode, and a delay that the model lacks. Its times scale with the sampling period,
//! its motion with the gain. Two tables in a folder:
//!
//! * `numerics.csv`: in how many seeds the delay is named, alone or within an "or", which other names stand
//!   where it does not, and the held-out error over the noise;
//! * `deviations.csv`: by value of the true model, the scatter over its stated standard deviation, how far the
//!   mean is off in stated deviations, and the share of seeds whose 95 % hold the truth.
//!
//! ```text
//! cargo run --release -p hysteron --example numerics -- benchmarks/results
//! ```

use hysteron::{
    Dataset, Drive, EffectInstance, InitialState, Model, Options, Overview, Record, Role, Start,
    Unwatched, WhiteNoise, analyse, effect_named, effects_named, identify, waveform,
};
use std::collections::BTreeSet;
use std::fmt::Write as _;
use std::path::PathBuf;

/// Of the usual stage: rate, noise, and a mode and a delay in sampling periods.
const RATE_HZ: f64 = 20_000.0;
const NOISE_UM: f64 = 0.004;
const MODE_RAD: f64 = 0.2;
const DELAY_PERIODS: f64 = 3.6;

/// How a stage differs from the usual one, as factors.
#[derive(Clone, Copy)]
struct Scales {
    noise: f64,
    gain: f64,
    rate: f64,
}

const USUAL: Scales = Scales {
    noise: 1.0,
    gain: 1.0,
    rate: 1.0,
};

impl Scales {
    fn stage(self) -> Model {
        let rate_hz = self.rate * RATE_HZ;
        let mut stage = Model::new(0.0, 70.0);
        let overview = Overview {
            sample_rate_max_hz: rate_hz,
            sample_rate_min_hz: rate_hz,
            ..Overview::without_data(0.0, 70.0)
        };
        for (id, values) in [
            (
                "hysteresis",
                &[10.0, 1.2, -1.2].map(|um| self.gain * um)[..],
            ),
            ("vibration", &[MODE_RAD * rate_hz, 0.4]),
            ("delay", &[DELAY_PERIODS / rate_hz]),
        ] {
            let effect = effect_named(id).expect("a built-in effect");
            stage.add(EffectInstance::new(effect, &overview, values));
        }
        stage
    }

    fn recorded(self, seed: u64) -> Dataset {
        let rate_hz = self.rate * RATE_HZ;
        let lines: Vec<usize> = (1..=140).step_by(3).collect();
        let volts = [0.0, 50.0, 10.0, 60.0, 5.0, 70.0, 0.0];
        let drives = [
            (
                "triangles",
                Role::Identify,
                waveform::triangles(rate_hz, 0.1 * rate_hz, &volts),
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
        let stage = self.stage();
        let mut noise = WhiteNoise::new(self.noise * self.gain * NOISE_UM, seed);
        let records = drives.map(|(name, role, drive_v)| {
            let drive = Drive::held(&drive_v, 1.0 / rate_hz, InitialState::Virgin);
            let read = stage.simulate(&drive).into_iter();
            let readings_um = read.map(|y_um| y_um + noise.next_um()).collect();
            Record::new(name, rate_hz, drive_v, readings_um)
                .from_virgin_state()
                .with_role(role)
        });
        Dataset::new("stage", 0.0, 70.0, records.into()).expect("records of one stage")
    }
}

/// Each scale alone, then all together at their ends.
fn scales() -> Vec<Scales> {
    let noise = [0.1, 0.3, 1.0, 3.0, 10.0].map(|noise| Scales { noise, ..USUAL });
    let gain = [1e-3, 1e-2, 1e2, 1e3].map(|gain| Scales { gain, ..USUAL });
    let rate = [0.005, 0.05, 5.0, 50.0].map(|rate| Scales { rate, ..USUAL });
    let mut out = [&noise[..], &gain, &rate].concat();
    for noise in [0.1, 10.0] {
        for gain in [1e-3, 1e3] {
            out.extend([0.005, 50.0].map(|rate| Scales { noise, gain, rate }));
        }
    }
    out
}

fn decisions(seeds: u64) -> String {
    let mut table = String::from(
        "noise,gain,rate_hz,seeds,delay_named,within_an_or,other_names,held_out_over_noise\n",
    );
    let start = effects_named("hysteresis,vibration").expect("built-in effects");
    for scales in scales() {
        let (mut alone, mut within_an_or) = (0, 0);
        let (mut others, mut worst) = (BTreeSet::new(), 0.0_f64);
        for seed in 0..seeds {
            let dataset = scales.recorded(1000 * seed + 7);
            let options = Options::default();
            let found = analyse(&dataset, Start::Effects(&start), &options, &Unwatched)
                .expect("the stage is explained");
            for finding in found.diagnosis.findings {
                let with_delay = finding.effects.iter().any(|name| name == "delay");
                match finding.effects.len() {
                    1 if with_delay => alone += 1,
                    _ if with_delay => within_an_or += 1,
                    _ => others.extend(finding.effects),
                }
            }
            let held_out = dataset.with_role(Role::Validate);
            let error_um =
                hysteron::identification::fit::rms_over(&found.model, &dataset, &held_out);
            worst = worst.max(error_um / (scales.noise * scales.gain * NOISE_UM));
        }
        let others = Vec::from_iter(others).join(" ");
        let row = format!(
            "{},{},{:.0},{seeds},{alone},{within_an_or},{others},{worst:.2}",
            scales.noise,
            scales.gain,
            scales.rate * RATE_HZ
        );
        println!("{row}");
        let _ = writeln!(table, "{row}");
    }
    table
}

/// Of one value: its truth, then what each seed found with its stated deviation.
struct Estimates {
    name: String,
    truth: f64,
    found: Vec<(f64, f64)>,
}

fn deviations(seeds: u64) -> String {
    let effects = effects_named("hysteresis,vibration,delay").expect("built-in effects");
    let stage = USUAL.stage();
    let mut all: Vec<Estimates> = Vec::new();
    for instance in &stage.effects {
        all.extend(instance.parameters.iter().map(|p| Estimates {
            name: format!("{}.{}", instance.id, p.parameter.name),
            truth: p.value,
            found: Vec::new(),
        }));
    }
    for seed in 0..seeds {
        let dataset = USUAL.recorded(31 * seed + 11);
        let model = identify(&dataset, &effects, &Unwatched)
            .expect("the stage is fitted")
            .model;
        for instance in &model.effects {
            for p in &instance.parameters {
                let name = format!("{}.{}", instance.id, p.parameter.name);
                let same = all.iter_mut().find(|estimates| estimates.name == name);
                if let (Some(estimates), Some(std)) = (same, p.std) {
                    estimates.found.push((p.value, std));
                }
            }
        }
    }
    let mut table = String::from(
        "value,truth,seeds,scatter_over_stated,mean_off_in_stated,percent_within_95\n",
    );
    for Estimates { name, truth, found } in all.iter().filter(|one| !one.found.is_empty()) {
        let count = found.len() as f64;
        let mean = found.iter().map(|(value, _)| value).sum::<f64>() / count;
        let off = found.iter().map(|(value, _)| (value - mean).powi(2));
        let scatter = (off.sum::<f64>() / (count - 1.0)).sqrt();
        let stated = (found.iter().map(|(_, std)| std * std).sum::<f64>() / count).sqrt();
        let within = found
            .iter()
            .filter(|(value, std)| (value - truth).abs() <= 1.96 * std);
        let row = format!(
            "{name},{truth},{},{:.2},{:.2},{:.0}",
            found.len(),
            scatter / stated,
            (mean - truth) / stated,
            100.0 * within.count() as f64 / count
        );
        println!("{row}");
        let _ = writeln!(table, "{row}");
    }
    table
}

fn main() {
    let mut arguments = std::env::args().skip(1);
    let folder = PathBuf::from(arguments.next().unwrap_or_else(|| ".".into()));
    let number =
        |text: Option<String>, usual| text.and_then(|text| text.parse().ok()).unwrap_or(usual);
    let (cases, seeds) = (number(arguments.next(), 3), number(arguments.next(), 200));
    for (name, table) in [
        ("deviations.csv", deviations(seeds)),
        ("numerics.csv", decisions(cases)),
    ] {
        let path = folder.join(name);
        if let Err(error) = std::fs::write(&path, table) {
            eprintln!("{}: {error}", path.display());
        }
    }
}
