//! Recordings on which saved models are judged: tapes by equations that stand here, and those beside the project.

use crate::beside;
use hysteron_sim::noise::WhiteNoise;
use std::f64::consts::TAU;
use std::path::PathBuf;

const RATE_HZ: f64 = 1000.0;
const NOISE_UM: f64 = 0.004;
const STEPS: usize = 20;

/// A stage: play operators, a mode and two relaxations, stepped finely.
#[derive(Default)]
struct Stage {
    plays: [f64; 12],
    position: f64,
    velocity: f64,
    crept: [f64; 2],
}

impl Stage {
    fn reads(&self) -> f64 {
        self.position + self.crept.iter().sum::<f64>()
    }

    /// One sampling period of a drive that goes from one voltage to another.
    fn moves(&mut self, from_v: f64, to_v: f64) {
        let (rad_s, dt_s) = (TAU * 90.0, 1.0 / RATE_HZ / STEPS as f64);
        for step in 1..=STEPS {
            let u = (from_v + (to_v - from_v) * step as f64 / STEPS as f64) / 60.0;
            let mut force = 5.0 * u;
            for (i, stands) in self.plays.iter_mut().enumerate() {
                let half = 0.03 * (i as f64 + 1.0);
                *stands = stands.max(u - half).min(u + half);
                force += 0.5 / (i as f64 + 1.0) * *stands;
            }
            self.velocity +=
                dt_s * (rad_s * rad_s * (force - self.position) - 0.1 * rad_s * self.velocity);
            self.position += dt_s * self.velocity;
        }
        for (crept, seconds) in self.crept.iter_mut().zip([0.05, 0.8]) {
            *crept += (0.015 * self.position - *crept) * (1.0 - (-1.0 / RATE_HZ / seconds).exp());
        }
    }
}

/// How a tape is made.
struct Tape {
    drive_v: fn(f64) -> f64,
    /// Seconds of the same motion before the tape begins.
    before_s: f64,
    seconds: f64,
    /// Read after the drive of the row has acted.
    same_row: bool,
    /// The drive runs straight from row to row.
    runs_on: bool,
    /// What the sensor reads beside the displacement, um.
    zero_um: f64,
    /// Steps of the converter, um.
    lsb_um: f64,
}

const TAPE: Tape = Tape {
    drive_v: |_| 0.0,
    before_s: 0.0,
    seconds: 4.0,
    same_row: false,
    runs_on: false,
    zero_um: 0.0,
    lsb_um: 0.0,
};

fn csv(tape: &Tape) -> String {
    let (mut stage, mut noise) = (Stage::default(), WhiteNoise::new(NOISE_UM, 5));
    let (before, samples) = (tape.before_s * RATE_HZ, (tape.seconds * RATE_HZ) as usize);
    let drive = |k: f64| (tape.drive_v)((k - before) / RATE_HZ);
    let mut text = String::from("t_s,u_v,y_um\n");
    for k in 0..before as usize + samples {
        let u = drive(k as f64);
        let (from_v, to_v) = if tape.runs_on {
            (u, drive(k as f64 + 1.0))
        } else {
            (u, u)
        };
        let early = stage.reads();
        stage.moves(from_v, to_v);
        if k >= before as usize {
            let true_um = if tape.same_row { stage.reads() } else { early };
            let mut read_um = true_um + tape.zero_um + noise.next_um();
            if tape.lsb_um > 0.0 {
                read_um = (read_um / tape.lsb_um).round() * tape.lsb_um;
            }
            let t = (k - before as usize) as f64 / RATE_HZ;
            text.push_str(&format!("{t:.6},{u:.6},{read_um:.6}\n"));
        }
    }
    text
}

fn sine(t: f64) -> f64 {
    30.0 - 20.0 * (TAU * 10.0 * t).cos()
}

fn swelling(t: f64) -> f64 {
    30.0 - 28.0 * (0.25 + 0.75 * (TAU * 0.31 * t).sin().abs()) * (TAU * (3.0 + 2.0 * t) * t).cos()
}

fn sums(t: f64) -> f64 {
    30.0 + 9.0 * (TAU * 7.3 * t).sin() + 8.0 * (TAU * 31.7 * t).sin() + 6.0 * (TAU * 83.1 * t).sin()
}

fn staircase(t: f64) -> f64 {
    [0.0, 20.0, 50.0, 35.0, 10.0, 45.0, 5.0, 55.0][(t / 0.31) as usize % 8]
}

/// Tapes of one stage by other equations than the library's, as text, by what they show.
#[must_use]
pub fn tapes_by_equations() -> [(&'static str, String); 6] {
    [
        (
            "conditioned sine",
            Tape {
                drive_v: sine,
                before_s: 3.0,
                ..TAPE
            },
        ),
        (
            "swelling sweep from rest",
            Tape {
                drive_v: swelling,
                zero_um: 0.8,
                ..TAPE
            },
        ),
        (
            "sweep read in its row",
            Tape {
                drive_v: swelling,
                same_row: true,
                ..TAPE
            },
        ),
        (
            "drive that runs on",
            Tape {
                drive_v: sums,
                before_s: 2.0,
                runs_on: true,
                ..TAPE
            },
        ),
        (
            "staircase",
            Tape {
                drive_v: staircase,
                seconds: 5.0,
                ..TAPE
            },
        ),
        (
            "coarse converter",
            Tape {
                drive_v: swelling,
                before_s: 2.0,
                lsb_um: 0.02,
                ..TAPE
            },
        ),
    ]
    .map(|(name, tape)| (name, csv(&tape)))
}

/// Recordings of real stages, and of the field's benchmarks, where they lie beside the project.
#[must_use]
pub fn tapes_beside() -> Vec<PathBuf> {
    let folders = [
        "measured/piezo_stage",
        "measured/piezo_150v_1hz",
        "benchmarks/bouc_wen",
        "benchmarks/silverbox",
        "benchmarks/friction_damper",
    ];
    let mut out = Vec::new();
    for folder in folders.into_iter().filter_map(beside) {
        let Ok(entries) = std::fs::read_dir(&folder) else {
            continue;
        };
        let mut files: Vec<PathBuf> = entries.flatten().map(|entry| entry.path()).collect();
        files.sort();
        out.extend(files);
    }
    out
}
