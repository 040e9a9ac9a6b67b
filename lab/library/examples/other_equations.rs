//! A test bed for the finder: tapes of stages whose equations stand here and in no library, each as one file
//! and as two.
//!
//! A stage has plays, a Bouc-Wen law or ferroelectric domains (an irreversible polarisation that lags an
//! anhysteretic one), then modes, creep, a delay, a lag of the sensor, or nothing of these. Every tape is read
//! with 2 nm of noise. The program is asked from a bare gain. A row holds what it names, what is true, the
//! errors of its model on fitted and on held-out samples, those of the true effects by `identify`, and the
//! seconds of processor.
//!
//! ```text
//! cargo run --release -p hysteron --example other_equations -- FOLDER [PROGRAM [CASE ...]]
//! ```

use hysteron_sim::noise::WhiteNoise;
use serde_json::Value;
use std::f64::consts::TAU;
use std::fmt::Write as _;
use std::path::Path;
use std::process::{Command, Stdio};

const NOISE_UM: f64 = 0.002;
/// Steps of the stage between two samples.
const FINE: usize = 8;
const RANGE_V: f64 = 100.0;

#[derive(Clone, Copy, PartialEq)]
enum Loops {
    None,
    Plays,
    BoucWen,
    Domains,
}

/// What a stage has.
#[derive(Clone)]
struct Stage {
    loops: Loops,
    /// Cycled over its range before it is recorded.
    conditioned: bool,
    delay_s: f64,
    /// Natural frequency, Hz, damping ratio and share of the motion.
    modes: &'static [(f64, f64, f64)],
    creeps: bool,
    sensor_hz: f64,
    /// The gain flutters by this share at 3 Hz, which is in no library.
    flutter: f64,
}

const PLAIN: Stage = Stage {
    loops: Loops::Plays,
    conditioned: true,
    delay_s: 0.0,
    modes: &[],
    creeps: false,
    sensor_hz: f64::INFINITY,
    flutter: 0.0,
};

/// One tape.
struct Case {
    name: &'static str,
    stage: Stage,
    rate_hz: f64,
    /// Seconds of the whole tape, about.
    lasts_s: f64,
    /// Effects that are missing beside a gain; those of the second list may be named beside them.
    truth: &'static [&'static str],
    also: &'static [&'static str],
    /// The true effects in the library's terms.
    effects: &'static str,
}

const LOOPS: [&str; 7] = [
    "hysteresis",
    "prandtl_ishlinskii",
    "modified_prandtl_ishlinskii",
    "maxwell_slip",
    "bouc_wen",
    "duhem",
    "play_operators",
];

fn cases() -> Vec<Case> {
    let case = |name, stage, rate_hz, lasts_s, truth, also, effects| Case {
        name,
        stage,
        rate_hz,
        lasts_s,
        truth,
        also,
        effects,
    };
    use Loops::{BoucWen, Domains};
    let stage = PLAIN;
    vec![
        case(
            "plays_virgin",
            Stage {
                conditioned: false,
                ..stage.clone()
            },
            2000.0,
            4.0,
            &["loops"],
            &["initial_curve"],
            "hysteresis,initial_curve,play_operators",
        ),
        case(
            "plays_delay",
            Stage {
                delay_s: 4e-4,
                modes: &[(400.0, 0.03, 1.0)],
                creeps: true,
                ..stage.clone()
            },
            8000.0,
            1.5,
            &["loops", "delay", "vibration"],
            &["creep"],
            "hysteresis,play_operators,vibration,creep,delay",
        ),
        case(
            "plays_sensor",
            Stage {
                sensor_hz: 300.0,
                ..stage.clone()
            },
            10_000.0,
            1.0,
            &["loops", "sensor"],
            &[],
            "hysteresis,play_operators,sensor_bandwidth",
        ),
        case(
            "plays_two_modes",
            Stage {
                modes: &[(500.0, 0.02, 0.8), (1300.0, 0.02, 0.2)],
                ..stage.clone()
            },
            20_000.0,
            0.6,
            &["loops", "vibration", "second_mode"],
            &[],
            "hysteresis,play_operators,vibration,second_mode",
        ),
        case(
            "plays_creep",
            Stage {
                creeps: true,
                ..stage.clone()
            },
            1000.0,
            8.0,
            &["loops", "creep"],
            &[],
            "hysteresis,play_operators,creep",
        ),
        case(
            "plays_fast",
            Stage {
                modes: &[(3000.0, 0.02, 1.0)],
                ..stage.clone()
            },
            50_000.0,
            0.3,
            &["loops", "vibration"],
            &[],
            "hysteresis,play_operators,vibration",
        ),
        case(
            "bouc_wen_virgin",
            Stage {
                loops: BoucWen,
                conditioned: false,
                ..stage.clone()
            },
            1000.0,
            6.0,
            &["loops"],
            &["initial_curve"],
            "bouc_wen",
        ),
        case(
            "bouc_wen_mode",
            Stage {
                loops: BoucWen,
                modes: &[(780.0, 0.02, 1.0)],
                ..stage.clone()
            },
            10_000.0,
            1.0,
            &["loops", "vibration"],
            &[],
            "bouc_wen,vibration",
        ),
        case(
            "bouc_wen_delay",
            Stage {
                loops: BoucWen,
                delay_s: 1e-3,
                ..stage.clone()
            },
            5000.0,
            1.5,
            &["loops", "delay"],
            &[],
            "bouc_wen,delay",
        ),
        case(
            "domains",
            Stage {
                loops: Domains,
                ..stage.clone()
            },
            2000.0,
            3.0,
            &["loops"],
            &[],
            "hysteresis,play_operators",
        ),
        case(
            "domains_mode_delay",
            Stage {
                loops: Domains,
                delay_s: 2e-4,
                modes: &[(600.0, 0.02, 1.0)],
                ..stage.clone()
            },
            20_000.0,
            0.6,
            &["loops", "vibration", "delay"],
            &[],
            "hysteresis,play_operators,vibration,delay",
        ),
        case(
            "domains_creep_virgin",
            Stage {
                loops: Domains,
                conditioned: false,
                creeps: true,
                ..stage.clone()
            },
            1000.0,
            8.0,
            &["loops", "creep"],
            &["initial_curve"],
            "hysteresis,initial_curve,play_operators,creep",
        ),
        case(
            "straight",
            Stage {
                loops: Loops::None,
                ..stage.clone()
            },
            5000.0,
            1.5,
            &[],
            &[],
            "gain",
        ),
        case(
            "flutter",
            Stage {
                flutter: 0.01,
                ..stage.clone()
            },
            2000.0,
            4.0,
            &["loops"],
            &[],
            "hysteresis,play_operators",
        ),
    ]
}

/// Two drives of so many seconds: rest, nested loops, sines at rising frequencies, steps with holds.
fn drive(case: &Case, second: bool) -> Vec<f64> {
    let count = |share: f64| (share * case.lasts_s * case.rate_hz) as usize;
    let mut out = vec![0.0; count(0.1)];
    let corners: &[f64] = if second {
        &[0.0, 75.0, 15.0, 100.0, 30.0, 60.0, 10.0, 90.0, 0.0, 50.0]
    } else {
        &[0.0, 60.0, 20.0, 80.0, 0.0, 100.0, 40.0, 70.0, 10.0, 50.0]
    };
    let way_v: f64 = corners.windows(2).map(|w| (w[1] - w[0]).abs()).sum();
    for w in corners.windows(2) {
        let samples = count(0.4 * (w[1] - w[0]).abs() / way_v);
        out.extend((1..=samples).map(|k| w[0] + (w[1] - w[0]) * k as f64 / samples as f64));
    }
    let sines = count(0.3);
    let (from, to) = if second { (5.0, 45.0) } else { (4.0, 50.0) };
    out.extend((0..sines).map(|k| {
        let x = k as f64 / sines as f64;
        50.0 + 30.0 * (TAU * (from * x + 0.5 * (to - from) * x * x)).sin()
    }));
    let steps: &[f64] = if second {
        &[20.0, 70.0, 45.0, 10.0]
    } else {
        &[30.0, 80.0, 55.0, 15.0]
    };
    steps.iter().for_each(|v| out.extend(vec![*v; count(0.05)]));
    out
}

/// A second-order mode under a force that is held, by its closed form.
struct Mode {
    x: f64,
    v: f64,
    w: f64,
    xi: f64,
}

impl Mode {
    fn step(&mut self, force: f64, dt_s: f64) -> f64 {
        let turns = self.w * (1.0 - self.xi * self.xi).sqrt();
        let decay = (-self.xi * self.w * dt_s).exp();
        let (sin, cos) = (turns * dt_s).sin_cos();
        let off = self.x - force;
        let x =
            force + decay * ((cos + self.xi * self.w / turns * sin) * off + sin / turns * self.v);
        self.v = decay
            * ((cos - self.xi * self.w / turns * sin) * self.v
                - self.w * self.w / turns * sin * off);
        self.x = x;
        x
    }
}

/// The loops of a stage, um, in small steps of the voltage.
struct Hysteretic {
    loops: Loops,
    plays_v: [f64; 12],
    lag: f64,
    before_v: f64,
}

impl Hysteretic {
    fn step(&mut self, v: f64) -> f64 {
        let parts = ((v - self.before_v).abs() / 0.05).ceil().max(1.0) as usize;
        let (from, mut um) = (self.before_v, 0.0);
        for part in 1..=parts {
            let v = from + (v - from) * part as f64 / parts as f64;
            let by = v - self.before_v;
            self.before_v = v;
            um = match self.loops {
                Loops::None => 0.09 * v,
                Loops::Plays => {
                    let mut um = 0.05 * v;
                    for (i, play) in self.plays_v.iter_mut().enumerate() {
                        let half_v = 1.0 + 1.5 * i as f64;
                        *play = play.clamp(v - half_v, v + half_v);
                        um += 0.004 * *play;
                    }
                    um
                }
                Loops::BoucWen => {
                    let z = self.lag;
                    self.lag += by
                        * (0.02
                            - 0.05 * z * z.abs().sqrt() * by.signum() * z.signum() * z.signum()
                            - 0.01 * z * z);
                    0.09 * v + self.lag
                }
                Loops::Domains => {
                    let x = (v - 40.0) / 25.0;
                    let anhysteretic = 2.0
                        * if x.abs() < 1e-3 {
                            x / 3.0
                        } else {
                            1.0 / x.tanh() - 1.0 / x
                        };
                    let off = anhysteretic - self.lag;
                    if off * by > 0.0 {
                        self.lag += (off / 12.0 * by.abs()).abs().min(off.abs()) * off.signum();
                    }
                    0.06 * v + 0.3 * anhysteretic + 0.7 * self.lag
                }
            };
        }
        um
    }
}

/// What a stage reads: sample k before the drive of row k acts.
fn reads(case: &Case, drive_v: &[f64], seed: u64) -> Vec<f64> {
    let stage = &case.stage;
    let dt_s = 1.0 / case.rate_hz / FINE as f64;
    let mut loops = Hysteretic {
        loops: stage.loops,
        plays_v: [0.0; 12],
        lag: 0.0,
        before_v: 0.0,
    };
    if stage.loops == Loops::Domains {
        let x: f64 = -40.0 / 25.0;
        loops.lag = 2.0 * (1.0 / x.tanh() - 1.0 / x);
    }
    if stage.conditioned {
        for v in [RANGE_V, 0.0, RANGE_V, 0.0] {
            loops.step(v);
        }
    }
    let at_rest = loops.step(drive_v[0]);
    let mut modes: Vec<(f64, Mode)> = stage
        .modes
        .iter()
        .map(|(hz, xi, share)| {
            (
                *share,
                Mode {
                    x: at_rest,
                    v: 0.0,
                    w: TAU * hz,
                    xi: *xi,
                },
            )
        })
        .collect();
    let late = (stage.delay_s / dt_s).round() as usize;
    // Terms of creep: share of the motion, and time constants as shares of the tape.
    let mut creep: Vec<(f64, f64, f64)> = [(0.01, 0.01), (0.01, 0.1), (0.015, 0.5)]
        .iter()
        .map(|(share, of_tape)| (*share, of_tape * case.lasts_s, at_rest))
        .collect();
    let mut sensed = at_rest;
    let mut noise = WhiteNoise::new(NOISE_UM, seed);
    let mut out = Vec::with_capacity(drive_v.len());
    let mut um = at_rest;
    for k in 0..drive_v.len() {
        out.push(um - at_rest + noise.next_um());
        for fine in 0..FINE {
            let at = (k * FINE + fine).saturating_sub(late) / FINE;
            let force = loops.step(drive_v[at]);
            let moved = if modes.is_empty() {
                force
            } else {
                modes
                    .iter_mut()
                    .map(|(share, mode)| *share * mode.step(force, dt_s))
                    .sum()
            };
            let mut total = moved;
            if stage.creeps {
                for (share, tau_s, state) in &mut creep {
                    *state += dt_s / *tau_s * (moved - *state);
                    total += *share * (*state - moved);
                }
            }
            let t_s = (k * FINE + fine) as f64 * dt_s;
            total *= 1.0 + stage.flutter * (TAU * 3.0 * t_s).sin();
            sensed = if stage.sensor_hz.is_finite() {
                total + (sensed - total) * (-TAU * stage.sensor_hz * dt_s).exp()
            } else {
                total
            };
        }
        um = sensed;
    }
    out
}

fn table(case: &Case, drive_v: &[f64], seed: u64) -> String {
    let mut out = "t_s,u_v,y_um\n".to_owned();
    for (k, (v, um)) in drive_v.iter().zip(reads(case, drive_v, seed)).enumerate() {
        let _ = writeln!(out, "{:.7},{v:.6},{um:.6}", k as f64 / case.rate_hz);
    }
    out
}

/// Writes one tape, and the same stage as two files.
fn write(case: &Case, folder: &Path) -> std::io::Result<()> {
    let two = folder.join(format!("{}_two", case.name));
    std::fs::create_dir_all(&two)?;
    let [a, b] = [drive(case, false), drive(case, true)];
    std::fs::write(
        folder.join(format!("{}.csv", case.name)),
        table(case, &a, 11),
    )?;
    std::fs::write(two.join("a.csv"), table(case, &a, 11))?;
    std::fs::write(two.join("b.csv"), table(case, &b, 12))?;
    let state = if case.stage.conditioned {
        "settled"
    } else {
        "virgin"
    };
    let rest_s = 0.1 * case.lasts_s;
    let text = format!(
        "name = \"{}\"\ndrive_min_v = 0.0\ndrive_max_v = {RANGE_V:.1}\n\n\
         [[record]]\nfile = \"a.csv\"\nname = \"fitted\"\nrole = \"identify\"\ninitial_state = \"{state}\"\n\n\
         [[record]]\nfile = \"b.csv\"\nname = \"held_out\"\nrole = \"validate\"\ninitial_state = \"{state}\"\n\n\
         [[record]]\nfile = \"a.csv\"\nname = \"rest\"\nrole = \"noise\"\ninitial_state = \"{state}\"\nto_s = {rest_s}\n",
        case.name
    );
    std::fs::write(two.join("dataset.toml"), text)
}

/// Seconds of processor of all children so far.
fn of_children_s() -> f64 {
    let text = std::fs::read_to_string("/proc/self/stat").unwrap_or_default();
    let fields: Vec<&str> = text
        .rsplit(')')
        .next()
        .unwrap_or_default()
        .split_whitespace()
        .collect();
    let ticks = |at: usize| {
        fields
            .get(at)
            .and_then(|t| t.parse::<f64>().ok())
            .unwrap_or(0.0)
    };
    (ticks(13) + ticks(14)) / 100.0
}

/// The program's answer as JSON, and its seconds of processor.
fn answer(program: &str, arguments: &[&str], json: &Path) -> Option<(Value, f64)> {
    let before_s = of_children_s();
    // An answer of another run is none.
    let _ = std::fs::remove_file(json);
    let path = json.to_string_lossy();
    Command::new(program)
        .args(arguments)
        .args(["--json", &path, "--force"])
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .status()
        .ok()?;
    let value = serde_json::from_str(&std::fs::read_to_string(json).ok()?).ok()?;
    Some((value, of_children_s() - before_s))
}

fn texts(value: &Value) -> Vec<String> {
    let all = value.as_array().cloned().unwrap_or_default();
    all.iter()
        .filter_map(|v| v.as_str().map(str::to_owned))
        .collect()
}

/// What an effect is called in the truth: loops are loops, and lags of a sensor lags.
fn class(id: &str) -> &str {
    match id {
        _ if LOOPS.contains(&id) => "loops",
        "sensor_bandwidth" | "sensor_filter" | "amplifier_bandwidth" => "sensor",
        other => other,
    }
}

fn nm(value: &Value) -> String {
    value
        .as_f64()
        .map_or("-".into(), |um| format!("{:.2}", 1e3 * um))
}

/// One row: what the program makes of a tape.
fn row(case: &Case, program: &str, folder: &Path, two: bool) -> Option<String> {
    let data = folder.join(if two {
        format!("{}_two", case.name)
    } else {
        format!("{}.csv", case.name)
    });
    let data = data.to_string_lossy();
    let (fit, seconds) = answer(program, &["explain", &data], &folder.join("answer.json"))?;
    let (known, _) = answer(
        program,
        &["identify", &data, "--effects", case.effects],
        &folder.join("known.json"),
    )?;
    let d = &fit["diagnosis"];
    let verdict = d["verdict"].as_str()?;
    let claims = verdict == "named" || verdict == "ambiguous";
    let findings = d["findings"].as_array().cloned().unwrap_or_default();
    let groups: Vec<Vec<String>> = findings
        .iter()
        .filter(|_| claims)
        .map(|f| texts(&f["effects"]))
        .collect();
    let is_true = |id: &String| {
        case.truth
            .iter()
            .chain(case.also)
            .any(|of| class(id) == *of)
    };
    let wrong = groups.iter().any(|g| !g.iter().any(is_true));
    let all = case
        .truth
        .iter()
        .all(|of| groups.iter().any(|g| g.iter().any(|id| class(id) == *of)));
    let mark = match (wrong, all) {
        (true, _) => "WRONG",
        (false, true) if groups.iter().all(|g| g.len() == 1) => "right",
        (false, true) => "in or",
        (false, false) => "missed",
    };
    let said: Vec<String> = groups.iter().map(|g| g.join("|")).collect();
    Some(format!(
        "{:<22}{} {mark:<7}{verdict:<12}{:<22} {:>7}/{:<7} true effects {:>7}/{:<7} {seconds:>6.1} s  {}  [{}]",
        case.name,
        if two { 2 } else { 1 },
        d["reason"].as_str().unwrap_or(""),
        nm(&d["residual_rms_after_um"]["identify"]),
        nm(&d["residual_rms_after_um"]["validate"]),
        nm(&known["identify_rms_um"]),
        nm(&known["validate_rms_um"]),
        said.join(" + "),
        case.truth.join(" + "),
    ))
}

fn main() -> std::io::Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let Some((folder, rest)) = arguments.split_first() else {
        eprintln!("expected FOLDER [PROGRAM [CASE ...]]");
        return Ok(());
    };
    let folder = Path::new(folder);
    std::fs::create_dir_all(folder)?;
    let all = cases();
    all.iter().try_for_each(|case| write(case, folder))?;
    let Some((program, wanted)) = rest.split_first() else {
        return Ok(());
    };
    for case in all
        .iter()
        .filter(|case| wanted.is_empty() || wanted.iter().any(|w| w == case.name))
    {
        for two in [false, true] {
            println!(
                "{}",
                row(case, program, folder, two)
                    .unwrap_or_else(|| format!("{}: no answer", case.name))
            );
        }
    }
    Ok(())
}
