//! Four recordings with something wrong about them, written as folders by equations of this file.
//! `cargo xtask finder-sets front_ends` uses them too, so nothing here needs more than the standard
//! library.

use std::f64::consts::TAU;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

const RATE_HZ: f64 = 2000.0;
const SAMPLES: usize = 8000;
/// What a reading of the noise deviates by, um.
const NOISE_UM: f64 = 0.002;

/// What is wrong with a recording.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Wrong {
    Disconnected,
    OtherTiming,
    Clipped,
    InitialState,
}

/// All of them.
pub const CASES: [Wrong; 4] = [
    Wrong::Disconnected,
    Wrong::OtherTiming,
    Wrong::Clipped,
    Wrong::InitialState,
];

impl Wrong {
    /// The name of its folder.
    pub fn name(self) -> &'static str {
        match self {
            Self::Disconnected => "disconnected",
            Self::OtherTiming => "other_timing",
            Self::Clipped => "clipped",
            Self::InitialState => "initial_state",
        }
    }

    /// What a search starts from.
    pub fn base(self) -> &'static str {
        if self == Self::InitialState {
            "gain,creep"
        } else {
            "gain"
        }
    }

    /// Writes the data set and, beside its folder, a truth for `score`. The folder of the data set.
    pub fn write(self, folder: &Path) -> std::io::Result<PathBuf> {
        let data = folder.join(self.name()).join("recorded");
        recorded(&data, self)?;
        let base: Vec<String> = self
            .base()
            .split(',')
            .map(|id| format!("\"{id}\""))
            .collect();
        let truth = format!(
            "[{{\"name\":\"recorded\",\"hidden\":null,\"base\":[{}],\"noise_um\":{NOISE_UM}}}]",
            base.join(",")
        );
        std::fs::write(folder.join(self.name()).join("truth.json"), truth)?;
        Ok(data)
    }
}

/// A stage of 0.1 um/V with a resonance, or with loops where its timing is asked for, or with creep where its
/// states are.
fn recorded(into: &Path, wrong: Wrong) -> std::io::Result<()> {
    std::fs::create_dir_all(into)?;
    let wave = |k: usize, fast: f64| {
        let sines: f64 = (1..=12)
            .map(|i| {
                0.4 * (TAU * fast * f64::from(5 * i * i) * k as f64 / RATE_HZ + f64::from(i * i))
                    .sin()
            })
            .sum();
        (5.0 + sines).clamp(0.0, 10.0)
    };
    let steps = |k: usize| 1.0 + 2.0 * ((k / 800) * 7 % 5) as f64;
    let smooth = |k: usize, fast: f64| {
        5.0 - 2.5 * (k as f64 * 0.02 * fast).cos() - 1.5 * (k as f64 * 0.11 * fast).sin()
    };
    let timing = if wrong == Wrong::OtherTiming {
        ""
    } else {
        "timing = \"hold_after_sample\"\n"
    };
    let state = if wrong == Wrong::InitialState {
        "virgin"
    } else {
        "unknown"
    };
    let mut manifest =
        format!("name = \"recorded\"\ndrive_min_v = 0.0\ndrive_max_v = 10.0\n{timing}");
    let mut random = 7_u64;
    for (name, role) in [
        ("fitted", "identify"),
        ("held_out", "validate"),
        ("rest", "noise"),
    ] {
        let drive_v: Vec<f64> = (0..SAMPLES)
            .map(|k| match (role, wrong) {
                ("noise", _) => 0.0,
                (_, Wrong::OtherTiming) => smooth(k, if role == "identify" { 1.0 } else { 1.3 }),
                (_, Wrong::InitialState) => steps(k + if role == "identify" { 0 } else { 1600 }),
                _ => wave(k, if role == "identify" { 1.0 } else { 0.8 }),
            })
            .collect();
        let mut readings = read(&drive_v, wrong);
        // A record declared to begin virgin loses its beginning.
        let from = if wrong == Wrong::InitialState && role == "identify" {
            1000
        } else {
            0
        };
        readings.iter_mut().for_each(|y| {
            if wrong == Wrong::Disconnected && role != "noise" {
                *y = 0.0;
            }
            // Twelve uniform numbers are near enough to a normal one.
            *y += NOISE_UM * ((0..12).map(|_| uniform(&mut random)).sum::<f64>() - 6.0);
            if wrong == Wrong::Clipped {
                *y = y.min(0.6);
            }
        });
        let mut text = String::from("t_s,u_v,y_um\n");
        for k in from..SAMPLES {
            let _ = writeln!(
                text,
                "{:.4},{:.6},{:.6}",
                (k - from) as f64 / RATE_HZ,
                drive_v[k],
                readings[k]
            );
        }
        std::fs::write(into.join(format!("{name}.csv")), text)?;
        let _ = write!(
            manifest,
            "\n[[record]]\nfile = \"{name}.csv\"\nrole = \"{role}\"\nsample_rate_hz = {RATE_HZ:.1}\ninitial_state = \"{state}\"\n"
        );
    }
    std::fs::write(into.join("dataset.toml"), manifest)
}

/// Readings without noise.
fn read(drive_v: &[f64], wrong: Wrong) -> Vec<f64> {
    const STEPS: usize = 50;
    let (w, z, dt_s) = (1500.0, 0.1, 1.0 / RATE_HZ / STEPS as f64);
    let (mut x, mut v, mut play) = (0.1 * drive_v[0], 0.0, drive_v[0]);
    if wrong == Wrong::InitialState {
        x = 0.0;
    }
    let mut slow = [0.0; 2];
    let one = |u: &f64| match wrong {
        Wrong::OtherTiming => {
            play = f64::clamp(play, u - 1.0, u + 1.0);
            0.07 * u + 0.03 * play
        }
        Wrong::InitialState => {
            let before: f64 = 0.1 * u + slow.iter().sum::<f64>();
            for (state, time_s) in slow.iter_mut().zip([0.1, 1.0]) {
                *state += (0.008 * u - *state) / (time_s * RATE_HZ);
            }
            before
        }
        _ => {
            let before = x;
            for _ in 0..STEPS {
                v += dt_s * (w * w * (0.1 * u - x) - 2.0 * z * w * v);
                x += dt_s * v;
            }
            before
        }
    };
    let mut out: Vec<f64> = drive_v.iter().map(one).collect();
    if wrong == Wrong::InitialState {
        // A reading stands before the drive of its row acts.
        out.rotate_right(1);
        out[0] = 0.0;
    }
    out
}

/// The next number between 0 and 1 of a generator that repeats itself exactly (Knuth's 64-bit linear
/// congruence).
fn uniform(state: &mut u64) -> f64 {
    *state = state
        .wrapping_mul(6_364_136_223_846_793_005)
        .wrapping_add(1_442_695_040_888_963_407);
    (*state >> 11) as f64 / (1_u64 << 53) as f64
}
