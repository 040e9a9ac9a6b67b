//! Exports read what the program reads, to 1e-9 um: NumPy, Octave and C on the same drives; and a reader
//! computes two models from docs/reference/effects.md alone.
//!
//! Needs python3 with NumPy (or another interpreter, named by `HYSTERON_PYTHON`), octave-cli and cc:
//! `apt-get install python3-numpy octave gcc`.

use hysteron::export::{Language, export, inverse};
use hysteron::model_file::{own_effect, to_toml};
use hysteron::origin::{Initial, Way};
use hysteron_sim::chain::{Drive, EffectInstance, Identified, InitialState, Model};
use hysteron_sim::effect::{FreeMotion, Overview, by_id};
use hysteron_sim::intersample::Intersample;
use hysteron_sim::loop_inverse::LoopInverse;
use hysteron_sim::physics::{OffsetAtRest, RecordStart, Recorded};
use std::path::Path;
use std::process::Command;
use std::sync::Arc;

const TOLERANCE_UM: f64 = 1e-9;
const SAMPLES: usize = 500;

type Case = (&'static str, f64, &'static [(&'static str, &'static [f64])]);

/// Chains that have every block between them, each at a sampling rate.
const CASES: [Case; 26] = [
    (
        "loops_mode_creep",
        20_000.0,
        &[
            ("hysteresis", &[10.0, 1.2, -1.0, 0.3, -0.2, 0.1]),
            ("initial_curve", &[0.3, -0.1]),
            ("vibration", &[3900.0, 0.03]),
            ("creep", &[0.01, 0.004, 0.02, 0.1]),
            ("quantisation", &[0.001]),
        ],
    ),
    (
        "sub_intervals",
        4000.0,
        &[
            ("amplifier_bandwidth", &[900.0]),
            ("slew_limit", &[30e3]),
            ("hysteresis", &[10.0, 1.2, -1.0]),
            ("rate_dependence", &[0.3, 0.05, 0.1]),
            ("vibration", &[2500.0, 0.2]),
            ("second_mode", &[0.05, 6000.0, 0.02]),
            ("mass_change", &[0.2]),
            ("sensor_bandwidth", &[1500.0]),
            ("sensor_nonlinearity", &[0.001, -0.0002]),
            ("creep", &[0.01, 0.004, 0.02, 0.1]),
        ],
    ),
    (
        "late_mode_and_filter",
        20_000.0,
        &[
            ("delay", &[130e-6]),
            ("gain", &[0.142]),
            ("vibration", &[3900.0, 0.03]),
            ("sensor_bandwidth", &[3000.0]),
            ("sensor_filter", &[2000.0, 0.7]),
            ("thermal_drift", &[0.5, 2.0]),
            ("mains_hum", &[50.0, 0.01, 0.02]),
            ("hum_harmonics", &[0.001, 0.002, 0.003]),
        ],
    ),
    (
        "glide_before_a_sensor",
        20_000.0,
        &[
            ("amplifier_bandwidth", &[900.0]),
            ("bouc_wen", &[11.0, 4.0, 2.0, 0.5]),
            ("sensor_filter", &[2000.0, 0.7]),
            ("second_mode", &[0.1, 5000.0, 0.1]),
        ],
    ),
    (
        "charge_gap_and_force",
        20_000.0,
        &[
            ("saturation", &[55.0, 5.0]),
            ("charge_leakage", &[0.05, 0.02]),
            (
                "prandtl_ishlinskii",
                &[8.0, 0.2, 0.3, 0.1, 0.4, 0.2, 0.1, 0.3, 0.2, 0.1],
            ),
            ("load_force", &[0.02]),
            ("backlash", &[0.05]),
        ],
    ),
    (
        "dead_zones",
        1000.0,
        &[
            (
                "modified_prandtl_ishlinskii",
                &[
                    8.0, 0.2, 0.3, 0.1, 0.4, 0.2, 0.1, 0.3, 0.2, 0.1, 0.1, -0.05, 0.02, 0.03, 9.0,
                ],
            ),
            ("sensor_bandwidth", &[300.0]),
        ],
    ),
    (
        "slip_and_delay",
        20_000.0,
        &[
            ("delay", &[75e-6]),
            (
                "maxwell_slip",
                &[11.0, 0.3, 0.2, 0.1, 0.2, 0.1, 0.3, 0.2, 0.1],
            ),
        ],
    ),
    (
        "duhem",
        20_000.0,
        &[
            ("duhem", &[3.0, 10.0, 7.0]),
            ("vibration", &[3900.0, 0.03]),
            ("creep_pole_pair", &[0.01, 0.002, 40.0, 0.3]),
            ("thermal_drift", &[0.5, 0.0]),
        ],
    ),
    (
        "activated_with_bias",
        10_000.0,
        &[
            (
                "activated_switching",
                &[
                    0.04, 0.6, 5.0, 0.3, -0.2, 2.0, 0.5, -0.3, 0.2, 0.1, -1.0, 0.4, 0.3, -0.1, 0.2,
                    0.5,
                ],
            ),
            ("bias_dependent_gain", &[0.02, 0.01]),
            ("vibration", &[3900.0, 0.03]),
        ],
    ),
    (
        "two_first_ways",
        10_000.0,
        &[
            ("hysteresis", &[10.0, 1.2, -1.0, 0.3, -0.2, 0.1]),
            ("two_sided", &[0.4, 0.4, -0.1, 0.25, 0.05]),
            ("play_operators", &[0.3, 0.05, 0.2, 0.1, -0.1, 0.2]),
        ],
    ),
    (
        "surfaces_by_rate",
        4000.0,
        &[
            ("amplifier_bandwidth", &[900.0]),
            ("bipolar", &[-20.0]),
            ("hysteresis", &[10.0, 1.2, -1.0]),
            ("initial_curve", &[0.3, -0.1]),
            ("rate_dependence", &[0.3, 0.05, 0.1]),
            (
                "rate_dependent_surfaces",
                &[
                    5000.0, 0.3, 0.1, -0.1, 0.05, 0.0, 0.02, 0.1, -0.05, 0.02, 0.2, -0.1, 0.1,
                    0.05, 0.02, 0.0, 0.1, 0.05, 0.02,
                ],
            ),
            ("vibration", &[2500.0, 0.2]),
        ],
    ),
    (
        "plays_by_rate",
        4000.0,
        &[
            ("amplifier_bandwidth", &[900.0]),
            (
                "rate_dependent_prandtl_ishlinskii",
                &[
                    8.0, 0.2, 0.3, 0.1, 0.4, 0.2, 0.1, 0.3, 0.2, 0.1, 0.5, 0.2, 0.1, 0.3, 0.0, 0.1,
                    0.2, 0.1, 0.1, 0.1,
                ],
            ),
            ("sensor_bandwidth", &[1500.0]),
        ],
    ),
    (
        "two_branches",
        10_000.0,
        &[
            ("polynomial_loop", &[10.0, 0.5, -0.3, 2.0, 0.4]),
            (
                "creep_operators",
                &[0.02, 0.1, 0.01, 0.03, 0.5, 0.1, 0.01, 0.0, 0.02],
            ),
        ],
    ),
    (
        "solved_loops",
        10_000.0,
        &[
            (
                "inverse_preisach",
                &[
                    12.0, 90.0, -9.0, 9.0, 2.0, -1.0, 0.5, 0.3, -0.2, 0.1, 0.2, 0.5, -0.1,
                ],
            ),
            ("logarithmic_creep", &[0.01, 0.01, 10.0]),
        ],
    ),
    (
        "written_by_a_user",
        2000.0,
        &[
            ("gain", &[0.142]),
            ("a_pull", &[0.05, 3.0]),
            ("load_force", &[0.02]),
        ],
    ),
    (
        "forces_in_the_balance",
        5000.0,
        &[
            ("gain", &[0.142]),
            ("vibration", &[2500.0, 0.05]),
            ("mass_change", &[0.2]),
            ("nonlinear_stiffness", &[0.02, 0.03, 0.001]),
            ("nonlinear_damping", &[0.5, 1.8, 5.0]),
            ("hysteretic_stiffness", &[0.4, 0.5, -0.2, 1.0]),
            ("second_mode", &[0.05, 6000.0, 0.02]),
            ("sensor_filter", &[800.0, 0.7]),
            ("delay", &[260e-6]),
        ],
    ),
    (
        "forces_behind_a_glide",
        5000.0,
        &[
            ("amplifier_bandwidth", &[900.0]),
            ("gain", &[0.142]),
            ("vibration", &[2500.0, 0.05]),
            ("nonlinear_stiffness", &[-0.005, -0.0005, 0.0]),
            ("hysteretic_stiffness", &[0.1, 0.8, 0.3, 1.5]),
            ("sensor_bandwidth", &[600.0]),
        ],
    ),
    (
        "forces_on_a_fast_mode",
        1000.0,
        &[
            ("gain", &[0.142]),
            ("vibration", &[60_000.0, 0.1]),
            ("nonlinear_stiffness", &[0.02, 0.01, 0.0]),
        ],
    ),
    (
        "forces_and_a_bristle",
        5000.0,
        &[
            ("gain", &[0.142]),
            ("vibration", &[2500.0, 0.05]),
            ("nonlinear_stiffness", &[0.02, 0.01, 0.0]),
            ("friction", &[0.1, 2.0, 0.6]),
        ],
    ),
    (
        "held_mass",
        10_000.0,
        &[
            ("gain", &[0.142]),
            ("friction", &[0.03, 2.0, 0.0]),
            ("vibration", &[2500.0, 0.05]),
            ("second_mode", &[0.05, 6000.0, 0.02]),
            ("sensor_bandwidth", &[600.0]),
        ],
    ),
    (
        "held_mass_with_an_elastic_range",
        10_000.0,
        &[
            ("delay", &[130e-6]),
            ("gain", &[0.142]),
            ("friction", &[0.2, 1.5, 0.6]),
            ("vibration", &[2500.0, 0.05]),
        ],
    ),
    (
        "held_mass_behind_a_glide",
        10_000.0,
        &[
            ("amplifier_bandwidth", &[900.0]),
            ("gain", &[0.142]),
            ("friction", &[0.03, 2.0, 0.0]),
            ("vibration", &[2500.0, 0.05]),
            ("sensor_filter", &[800.0, 0.7]),
        ],
    ),
    (
        "bristle_on_a_fast_mode",
        1000.0,
        &[
            ("gain", &[0.142]),
            ("friction", &[0.03, 1.0, 0.0]),
            ("vibration", &[90_000.0, 0.1]),
        ],
    ),
    (
        "bristle_without_a_mass",
        1000.0,
        &[("gain", &[0.142]), ("friction", &[0.03, 1.0, 0.6])],
    ),
    (
        "forces_without_a_mass",
        1000.0,
        &[
            ("gain", &[0.142]),
            ("hysteretic_stiffness", &[0.4, 0.5, -0.2, 1.0]),
        ],
    ),
    (
        "plays_beside",
        10_000.0,
        &[
            ("delay", &[90e-6]),
            ("hysteresis", &[10.0, 1.2, -1.0]),
            ("play_operators", &[0.3, 0.05, 0.2, 0.1, -0.1, 0.2]),
            ("rate_dependence", &[0.3, 0.05, 0.1]),
            ("sensor_bandwidth", &[1500.0]),
        ],
    ),
];

/// A user's effect with every function and two states, one of which is fast where the input is large.
const WRITTEN: &str = r#"
id = "a_pull"
place = "sensor_nonlinearity"
output = """x + q * share + 1e-3 * dx / (1e4 + abs(dx)) + 0.01 * signum(x - bend) + if(and(x > 1, not(x >= 9)), 0.1, -0.1)
  + 0.01 * (round(x) + trunc(-x) + fract(x) + rem(-x, 3) + or(x < 2, x == 3) + (x != 4) + (x <= 5))
  + 1e-3 * (sqrt(abs(x)) + cbrt(-x) + exp(-x) + ln(1 + abs(x)) + log2(2 + abs(x)) + log10(3 + abs(x)))
  + 1e-3 * (sin(x) + cos(t * 30) + tan(0.1 * x) + asin(x / 20) + acos(x / 20) + atan(x) + atan2(x, 2) + hypot(x, 1))
  + 1e-3 * (sinh(0.1 * x) + cosh(0.1 * x) + tanh(x) + coth(1 + abs(x)) + langevin(x - 2) + asinh(x) + acosh(1 + abs(x)))
  + 1e-3 * (atanh(x / 20) + floor(x) + ceil(x) + max(x, 1, 2) - min(x, 3) + x^2 + (1 + abs(x))^0.3 + 0.1 * force) + 0.01 * p"""
[[parameter]]
name = "share"
lower = 0.0
upper = 1.0
starts = [0.05]
[[parameter]]
name = "bend"
lower = 0.0
upper = 10.0
starts = [3.0]
[[state]]
name = "q"
initial = 0.3
derivative = "300 * (1 + x * x) * (tanh(x - 3) - q) + 0.1 * force + 10 * sin(40 * t)"
[[state]]
name = "p"
derivative = "50 * q - 40 * p"
"#;

fn model(effects: &[(&str, &[f64])]) -> Model {
    let virgin_inside = effects.iter().any(|(id, _)| *id == "two_sided");
    let low = if virgin_inside { -30.0 } else { 0.0 };
    let overview = Overview::without_data(low, 70.0);
    let mut model = Model::new(low, 70.0);
    for (id, values) in effects {
        let effect = by_id(id).unwrap_or_else(|| own_effect(WRITTEN, "a_pull.toml").unwrap());
        let effect = match *id {
            "hysteresis"
            | "initial_curve"
            | "creep"
            | "play_operators"
            | "creep_operators"
            | "rate_dependent_surfaces"
                if !values.is_empty() =>
            {
                effect.with_parameters(values.len()).unwrap()
            }
            _ => effect,
        };
        model.add(EffectInstance::new(effect, &overview, values));
        // Bounds for data are none for a test.
        let added = model.effects.iter_mut().find(|e| e.id == *id).unwrap();
        added
            .parameters
            .iter_mut()
            .zip(*values)
            .for_each(|(p, value)| {
                (p.value, p.parameter.lower, p.parameter.upper) = (
                    *value,
                    p.parameter.lower.min(*value),
                    p.parameter.upper.max(*value),
                );
            });
    }
    model
}

/// Loops that nest, steps, holds, and a force.
fn signals() -> (Vec<f64>, Vec<f64>) {
    let drive = |k: usize| {
        let t = k as f64;
        let smooth =
            5.0 + 30.0 * (1.0 - (0.05 * t).cos()) * (0.013 * t).sin().abs() + 3.0 * (0.9 * t).sin();
        if k % 97 < 20 {
            (smooth / 5.0).round() * 5.0
        } else {
            smooth
        }
    };
    (
        (0..SAMPLES).map(drive).collect(),
        (0..SAMPLES)
            .map(|k| 10.0 * (0.03 * k as f64).sin())
            .collect(),
    )
}

fn read(model: &Model, rate_hz: f64, settled: bool) -> Vec<f64> {
    let (mut drive_v, force_n) = signals();
    drive_v.iter_mut().for_each(|v| *v += model.drive_min_v);
    let initial_state = if settled {
        InitialState::Settled
    } else {
        InitialState::Virgin
    };
    model.before_rounding().simulate(&Drive {
        force_n: Some(&force_n),
        ..Drive::held(&drive_v, 1.0 / rate_hz, initial_state)
    })
}

/// A model that was identified from a recording of this way, from an estimated state.
fn identified(name: &str, hold_before_sample: bool, intersample: Intersample) -> (Case, Model) {
    let case = CASES.into_iter().find(|case| case.0 == name).unwrap();
    let mut model = model(case.2);
    let motion = |decay_per_s, frequency_rad_s| FreeMotion {
        decay_per_s,
        frequency_rad_s,
    };
    let start = RecordStart {
        file: "stage.csv".into(),
        drive_v: signals().0[usize::from(hold_before_sample)],
        state: InitialState::Unknown,
        offset_is_fitted: true,
        offset_um: 0.7,
        at_rest: Some(OffsetAtRest {
            offset_um: 0.2,
            std_um: 0.1,
            moves_um: Vec::new(),
        }),
        motions: vec![
            (motion(20.0, 0.0), [0.3, 0.0]),
            (motion(100.0, 900.0), [0.1, -0.2]),
        ],
    };
    model.identified = Some(Arc::new(Identified {
        recorded: Recorded {
            data_set: "stage".into(),
            sample_rate_hz: case.1,
            hold_before_sample,
            intersample,
            starts: vec![start],
            ..Recorded::default()
        },
        ..Identified::default()
    }));
    (case, model)
}

/// What `simulate` predicts where nothing else is asked for.
fn predicted(model: &Model, rate_hz: f64) -> Vec<f64> {
    let (drive_v, _) = signals();
    let rows = Drive::held(&drive_v, 1.0 / rate_hz, InitialState::Virgin);
    let way = Way::told(model, None, None);
    let found = Initial::AsRecorded.predict(model, "another.csv", &rows, way, "drive");
    found.unwrap().0.reading_um
}

/// Ways of recording, each with a chain in whole periods or in sub-intervals, and a record that begins at
/// another voltage.
fn recorded_ways() -> Vec<(&'static str, Case, Model)> {
    let (case, mut elsewhere) = identified("loops_mode_creep", true, Intersample::Hold);
    let known = elsewhere.identified.as_mut().unwrap();
    Arc::make_mut(known).recorded.starts[0].drive_v += 20.0;
    let mut ways = vec![("elsewhere", case, elsewhere)];
    ways.extend(
        [
            ("rows_before", "loops_mode_creep", true, Intersample::Hold),
            ("straight", "duhem", false, Intersample::Linear),
            ("straight_fine", "sub_intervals", false, Intersample::Linear),
            ("banded", "duhem", false, Intersample::BandLimited),
            (
                "banded_fine",
                "sub_intervals",
                false,
                Intersample::BandLimited,
            ),
        ]
        .map(|(way, name, before, intersample)| {
            let (case, model) = identified(name, before, intersample);
            (way, case, model)
        }),
    );
    ways
}

fn run(folder: &Path, program: &str, arguments: &[&str]) -> String {
    let output = Command::new(program)
        .args(arguments)
        .current_dir(folder)
        .output()
        .unwrap_or_else(|error| {
            panic!("{program}: {error}; apt-get install python3-numpy octave gcc")
        });
    assert!(
        output.status.success(),
        "{program} {arguments:?}: {}{}",
        String::from_utf8_lossy(&output.stderr),
        String::from_utf8_lossy(&output.stdout)
    );
    String::from_utf8_lossy(&output.stdout).into_owned()
}

fn same(what: &str, text: &str, expected: &[f64]) {
    let found: Vec<f64> = text
        .split_whitespace()
        .map(|number| {
            number
                .parse()
                .unwrap_or_else(|_| panic!("{what}: {number}"))
        })
        .collect();
    assert_eq!(found.len(), expected.len(), "{what}");
    for (k, (found, expected)) in found.iter().zip(expected).enumerate() {
        let apart = (found - expected).abs();
        assert!(
            apart < TOLERANCE_UM,
            "{what}, value {k} of {expected} um: {apart:e} um apart"
        );
    }
    // A model that stands still would agree with anything.
    assert!(expected.iter().copied().fold(0.0, f64::max) > 1.0, "{what}");
}

fn write_signals(folder: &Path) {
    let (drive_v, force_n) = signals();
    let text = |values: &[f64]| {
        values
            .iter()
            .map(|v| format!("{v:?}\n"))
            .collect::<String>()
    };
    std::fs::write(folder.join("drive.txt"), text(&drive_v)).unwrap();
    std::fs::write(folder.join("force.txt"), text(&force_n)).unwrap();
}

/// Every effect of the registry stands in one of the cases, or is exported as it comes.
#[test]
fn every_effect_is_compared() {
    let folder = tempfile::tempdir().unwrap();
    write_signals(folder.path());
    for effect in hysteron_sim::effect::registry() {
        let declaration = effect.declaration();
        let id = declaration.id.as_str();
        if CASES
            .iter()
            .any(|case| case.2.iter().any(|(known, _)| *known == id))
        {
            continue;
        }
        let main = declaration.modifies.unwrap_or("gain");
        let values: &[f64] = if main == "gain" {
            &[0.142]
        } else {
            &[10.0, 1.2, -1.0]
        };
        let model = model(&[(main, values), ("vibration", &[3900.0, 0.03]), (id, &[])]);
        let text = export(&model, Language::C, 20_000.0, "m").unwrap();
        let main = format!(
            "    double y = m_init(&m, m_DRIVE_MIN_V);\n    for (int k = 0; k < {SAMPLES}; k++) {{\n        printf(\"%.17g\\n\", y);\n        y = m_step(&m, u[k]);\n    }}\n    (void)f;\n"
        );
        let printed = c_prints(folder.path(), &text, "m", &main);
        same(id, &printed, &read(&model, 20_000.0, false));
    }
}

#[test]
fn numpy_reads_what_the_program_reads() {
    let folder = tempfile::tempdir().unwrap();
    write_signals(folder.path());
    let mut script = String::from(
        "import numpy as np\nu, f = np.loadtxt('drive.txt'), np.loadtxt('force.txt')\n",
    );
    let mut expected = Vec::new();
    for (name, rate_hz, effects) in CASES {
        let model = model(effects);
        let text = export(&model, Language::Python, rate_hz, name).unwrap();
        std::fs::write(folder.path().join(format!("{name}.py")), text).unwrap();
        let force = if model.effect("load_force").is_some() {
            "f, "
        } else {
            ""
        };
        for (settled, word) in [(false, "False"), (true, "True")] {
            script += &format!(
                "import {name}\nfor v in {name}.{name}(u + {name}.DRIVE_MIN_V, {force}settled={word}): print(repr(float(v)))\n"
            );
            expected.extend(read(&model, rate_hz, settled));
        }
    }
    for (way, (_, rate_hz, _), model) in recorded_ways() {
        let text = export(&model, Language::Python, rate_hz, way).unwrap();
        std::fs::write(folder.path().join(format!("{way}.py")), text).unwrap();
        script += &format!("import {way}\nfor v in {way}.{way}(u): print(repr(float(v)))\n");
        expected.extend(predicted(&model, rate_hz));
    }
    std::fs::write(folder.path().join("run.py"), script).unwrap();
    let python = std::env::var("HYSTERON_PYTHON").unwrap_or_else(|_| "python3".into());
    same(
        "python",
        &run(folder.path(), &python, &["run.py"]),
        &expected,
    );
}

#[test]
fn octave_reads_what_the_program_reads() {
    let folder = tempfile::tempdir().unwrap();
    write_signals(folder.path());
    let mut script = String::from("u = load('drive.txt'); f = load('force.txt');\n");
    let mut expected = Vec::new();
    for (name, rate_hz, effects) in CASES {
        let model = model(effects);
        let text = export(&model, Language::Matlab, rate_hz, name).unwrap();
        std::fs::write(folder.path().join(format!("{name}.m")), text).unwrap();
        let force = if model.effect("load_force").is_some() {
            ", f"
        } else {
            ""
        };
        for settled in [false, true] {
            script += &format!(
                "printf('%.17g\\n', {name}(u + {}{force}{}));\n",
                model.drive_min_v,
                if settled { ", true" } else { "" }
            );
            expected.extend(read(&model, rate_hz, settled));
        }
    }
    for (way, (_, rate_hz, _), model) in recorded_ways() {
        let text = export(&model, Language::Matlab, rate_hz, way).unwrap();
        std::fs::write(folder.path().join(format!("{way}.m")), text).unwrap();
        script += &format!("printf('%.17g\\n', {way}(u));\n");
        expected.extend(predicted(&model, rate_hz));
    }
    std::fs::write(folder.path().join("compare_all.m"), script).unwrap();
    same(
        "octave",
        &run(
            folder.path(),
            "octave-cli",
            &["--no-gui", "--norc", "compare_all.m"],
        ),
        &expected,
    );
}

/// What a C program prints: `main` reads the signals into `u` and `f` and calls the model.
fn c_prints(folder: &Path, text: &str, name: &str, main: &str) -> String {
    assert!(!text.contains("malloc"));
    let program = format!(
        "{text}\n#include <stdio.h>\nint main(void)\n{{\n    static double u[{SAMPLES}], f[{SAMPLES}];\n    static {name}_state m;\n    FILE *a = fopen(\"drive.txt\", \"r\"), *b = fopen(\"force.txt\", \
         \"r\");\n    for (int k = 0; k < {SAMPLES}; k++) if (fscanf(a, \"%lf\", u + k) != 1 || fscanf(b, \"%lf\", f + k) != 1) return 1;\n{main}    return 0;\n}}\n"
    );
    std::fs::write(folder.join("model.c"), program).unwrap();
    let arguments =
        "-std=c99 -pedantic -Wall -Wextra -Werror -Wno-unused-function -O1 model.c -lm -o model";
    run(folder, "cc", &arguments.split(' ').collect::<Vec<_>>());
    run(folder, "./model", &[])
}

#[test]
fn c_with_fixed_memory_reads_what_the_program_reads() {
    let folder = tempfile::tempdir().unwrap();
    write_signals(folder.path());
    for (name, rate_hz, effects) in CASES {
        let model = model(effects);
        let text = export(&model, Language::C, rate_hz, name).unwrap();
        let force = if model.effect("load_force").is_some() {
            ", f[k]"
        } else {
            ""
        };
        let main = format!(
            "    for (int settled = 0; settled < 2; settled++) {{\n        int k = 0;\n        double y = {name}_init(&m, settled ? u[0] + {name}_DRIVE_MIN_V : {name}_VIRGIN_V{force});\n        \
             for (; k < {SAMPLES}; k++) {{\n            printf(\"%.17g\\n\", y);\n            y = {name}_step(&m, u[k] + {name}_DRIVE_MIN_V{force});\n        }}\n    }}\n"
        );
        let expected = [read(&model, rate_hz, false), read(&model, rate_hz, true)].concat();
        same(
            name,
            &c_prints(folder.path(), &text, name, &main),
            &expected,
        );
    }
    // C takes the drive that acts, sample by sample; a band-limited one depends on later samples.
    for (way, (_, rate_hz, _), model) in recorded_ways().into_iter().take(4) {
        let text = export(&model, Language::C, rate_hz, way).unwrap();
        let later = format!("u[k + 1 < {SAMPLES} ? k + 1 : {SAMPLES} - 1]");
        let first = match way {
            "rows_before" | "elsewhere" => "u[1]",
            _ => "u[0]",
        };
        // The drive of row 1 acts from sample 0 on where rows act before.
        let main = format!(
            "    double y = {way}_begin(&m, {first});\n    for (int k = 0; k < {SAMPLES}; k++) {{\n        printf(\"%.17g\\n\", y);\n        y = {way}_step(&m, {later});\n    }}\n    (void)f;\n"
        );
        let printed = c_prints(folder.path(), &text, way, &main);
        same(way, &printed, &predicted(&model, rate_hz));
    }
}

/// Chains whose loops have an inverse: surfaces, plays, slip elements and two differential equations.
const INVERTED: [&str; 5] = [
    "loops_mode_creep",
    "charge_gap_and_force",
    "slip_and_delay",
    "glide_before_a_sensor",
    "plays_beside",
];

/// Wanted displacements that Octave takes.
const IN_OCTAVE: usize = 60;

/// Wanted displacements, which turn inside one another, and the drives that the program finds for them.
fn inverted(model: &Model, rate_hz: f64) -> (Vec<f64>, Vec<f64>) {
    let mut found = LoopInverse::from_model(model, 1.0 / rate_hz).unwrap();
    let wanted = |k: usize| {
        let t = k as f64;
        3.0 + 2.0 * (0.06 * t).sin() * (0.011 * t).cos() + 0.5 * (0.4 * t).sin()
    };
    let wanted: Vec<f64> = (0..SAMPLES).map(wanted).collect();
    let drives = wanted.iter().map(|um| found.step(*um).drive_v).collect();
    (wanted, drives)
}

#[test]
fn the_inverse_in_c_and_octave_finds_the_drives_of_the_program() {
    let folder = tempfile::tempdir().unwrap();
    let (mut script, mut expected) = (String::new(), Vec::new());
    for name in INVERTED {
        let (_, rate_hz, effects) = CASES.into_iter().find(|case| case.0 == name).unwrap();
        let mut model = model(effects);
        // What the program's own inverse has no part in.
        model
            .effects
            .retain(|e| e.id != "rate_dependence" && e.id != "creep");
        let (wanted, drives) = inverted(&model, rate_hz);
        let lines = |values: &[f64]| {
            values
                .iter()
                .map(|v| format!("{v:?}\n"))
                .collect::<String>()
        };
        for file in ["drive.txt", "force.txt"] {
            std::fs::write(folder.path().join(file), lines(&wanted)).unwrap();
        }
        std::fs::write(folder.path().join(format!("{name}.txt")), lines(&wanted)).unwrap();
        let text = inverse(&model, Language::C, rate_hz, name).unwrap();
        let main = format!(
            "    {name}_init(&m);\n    for (int k = 0; k < {SAMPLES}; k++) printf(\"%.17g\\n\", {name}_step(&m, u[k]));\n    (void)f;\n"
        );
        same(name, &c_prints(folder.path(), &text, name, &main), &drives);
        let text = inverse(&model, Language::Matlab, rate_hz, name).unwrap();
        std::fs::write(folder.path().join(format!("{name}.m")), text).unwrap();
        // Octave interprets every halving: some turns are enough.
        script +=
            &format!("w = load('{name}.txt'); printf('%.17g\\n', {name}(w(1:{IN_OCTAVE})));\n");
        expected.extend(&drives[..IN_OCTAVE]);
    }
    std::fs::write(folder.path().join("compare_all.m"), script).unwrap();
    let arguments = ["--no-gui", "--norc", "compare_all.m"];
    same(
        "octave",
        &run(folder.path(), "octave-cli", &arguments),
        &expected,
    );
}

/// The model itself judges: simulated under the drives it comes to what was wanted, creep included.
#[test]
fn the_inverse_undoes_creep() {
    let folder = tempfile::tempdir().unwrap();
    let (name, rate_hz, effects) = CASES[0];
    let mut slow = model(effects);
    slow.effects
        .retain(|e| ["hysteresis", "initial_curve", "creep"].contains(&e.id.as_str()));
    let (wanted, _) = inverted(&slow, rate_hz);
    for file in ["drive.txt", "force.txt"] {
        let lines: String = wanted.iter().map(|v| format!("{v:?}\n")).collect();
        std::fs::write(folder.path().join(file), lines).unwrap();
    }
    // The mode is left out by the inverse.
    let text = inverse(&model(effects), Language::C, rate_hz, name).unwrap();
    let main = format!(
        "    {name}_init(&m);\n    for (int k = 0; k < {SAMPLES}; k++) printf(\"%.17g\\n\", {name}_step(&m, u[k]));\n    (void)f;\n"
    );
    let drive_v: Vec<f64> = c_prints(folder.path(), &text, name, &main)
        .lines()
        .map(|line| line.parse().unwrap())
        .collect();
    let drive = Drive::held(&drive_v, 1.0 / rate_hz, InitialState::Virgin);
    let reached = slow.simulate(&drive);
    // What a drive does is read one sample later.
    for (k, (got, wanted)) in reached[1..].iter().zip(&wanted).enumerate() {
        assert!(
            (got - wanted).abs() < 1e-9,
            "sample {k}: {got} instead of {wanted}"
        );
    }
    let mut loops = slow.clone();
    loops.effects.retain(|e| e.id != "creep");
    let crept = reached.last().unwrap() - loops.simulate(&drive).last().unwrap();
    assert!(crept.abs() > 1e-3, "creep moves by {crept} um alone");
}

/// The sampled matrices of a linear model, driven from rest, against the program.
#[test]
fn the_sampled_state_space_reads_what_the_program_reads() {
    let effects: &[(&str, &[f64])] = &[
        ("delay", &[130e-6]),
        ("amplifier_bandwidth", &[900.0]),
        ("gain", &[0.142]),
        ("vibration", &[3900.0, 0.03]),
        ("second_mode", &[0.05, 6000.0, 0.02]),
        ("creep", &[0.01, 0.004, 0.02, 0.1]),
        ("sensor_bandwidth", &[1500.0]),
    ];
    let mut model = model(effects);
    let mode = model
        .effects
        .iter_mut()
        .find(|e| e.id == "vibration")
        .unwrap();
    mode.parameters[0].std = Some(20.0);
    let text = export(&model, Language::StateSpace, 20_000.0, "linear").unwrap();
    let json: serde_json::Value = serde_json::from_str(&text).unwrap();
    let rows = |value: &serde_json::Value| -> Vec<Vec<f64>> {
        serde_json::from_value(value.clone()).unwrap()
    };
    let sampled = &json["sampled"];
    let (a, b, c) = (
        rows(&sampled["A"]),
        rows(&sampled["B"]),
        rows(&sampled["C"]),
    );
    let (drive_v, _) = signals();
    let mut x = vec![0.0; a.len()];
    let times = |row: &[f64], x: &[f64]| row.iter().zip(x).map(|(a, x)| a * x).sum::<f64>();
    let expected = read(&model, 20_000.0, false);
    for (k, u) in drive_v.iter().enumerate() {
        assert!((times(&c[0], &x) - expected[k]).abs() < TOLERANCE_UM, "{k}");
        x = a
            .iter()
            .zip(&b)
            .map(|(row, b)| times(row, &x) + b[0] * u)
            .collect();
    }
    // The same pole in the continuous matrices, and moved by its deviation.
    let trace = |value: &serde_json::Value| {
        rows(&value["A"])
            .iter()
            .enumerate()
            .map(|(i, row)| row[i])
            .sum::<f64>()
    };
    let moved = json["uncertainty"]
        .as_array()
        .unwrap()
        .iter()
        .find(|one| one["parameter"] == "natural_frequency_rad_s")
        .unwrap();
    let by = trace(&moved["plus_one_std"]["continuous"]) - trace(&json["continuous"]);
    assert!((by + 2.0 * 0.03 * 20.0).abs() < 1e-6, "{by}");
    assert_eq!(json["left_out"].as_array().unwrap().len(), 0);
}

#[test]
fn what_cannot_be_exported_is_refused_by_name() {
    for (place, reason) in [
        ("u", "takes the drive"),
        ("heat", "signals that are recorded"),
    ] {
        let mut own = model(&[("gain", &[0.14])]);
        let text = format!(
            "id = \"a_pull\"\nplace = \"creep\"\nauxiliary = [\"heat\"]\noutput = \"x + {place}\""
        );
        let effect = own_effect(&text, "a_pull.toml").unwrap();
        own.add(EffectInstance::new(
            effect,
            &Overview::without_data(0.0, 70.0),
            &[],
        ));
        let message = export(&own, Language::C, 20_000.0, "m")
            .unwrap_err()
            .to_string();
        assert!(
            message.contains("a_pull") && message.contains(reason),
            "{message}"
        );
    }
}

/// A program that was written from docs/reference/effects.md, without a look at the code.
#[test]
fn a_reader_computes_two_models_from_the_equations() {
    let folder = tempfile::tempdir().unwrap();
    write_signals(folder.path());
    let first: &[(&str, &[f64])] = CASES[0].2;
    let second: &[(&str, &[f64])] = &[
        ("amplifier_bandwidth", &[900.0]),
        (
            "prandtl_ishlinskii",
            &[8.0, 0.2, 0.3, 0.1, 0.4, 0.2, 0.1, 0.3, 0.2, 0.1],
        ),
        ("vibration", &[3900.0, 0.03]),
        ("second_mode", &[0.05, 6000.0, 0.02]),
        ("sensor_bandwidth", &[3000.0]),
        ("thermal_drift", &[0.5, 2.0]),
    ];
    for (name, effects) in [("first", first), ("second", second)] {
        let model = model(effects);
        std::fs::write(
            folder.path().join("model.toml"),
            to_toml(&model, name).unwrap(),
        )
        .unwrap();
        let reader = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/from_the_equations.py");
        let found = run(
            folder.path(),
            "python3",
            &[
                &reader.to_string_lossy(),
                "model.toml",
                "drive.txt",
                "20000",
            ],
        );
        // The equations have the sensor's rounding too, which exports leave out.
        let (drive_v, _) = signals();
        let drive = Drive::held(&drive_v, 1.0 / 20_000.0, InitialState::Virgin);
        same(name, &found, &model.simulate(&drive));
    }
}

#[test]
fn the_page_of_equations_is_the_one_in_docs() {
    let page = hysteron::effect_reference::page();
    let kept = std::fs::read_to_string(
        Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/reference/effects.md"),
    )
    .unwrap();
    assert!(
        page == kept,
        "write it again: hysteron effects --equations docs/reference/effects.md --force"
    );
    for effect in hysteron_sim::effect::registry() {
        assert!(
            !effect.declaration().equations.is_empty(),
            "{} has no equations",
            effect.declaration().id
        );
    }
}
