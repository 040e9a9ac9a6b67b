//! Stages whose switching is thermally activated, by other equations than those of the library's effect.
//!
//! A domain of coercive voltage `c` and bias `b` is up with the probability `p`. Heat lifts it over the
//! barrier that the drive `x` leaves: `p' = (1 - p) / t exp(-(c - x + b) / (k c)) - p / t exp(-(c + x - b) /
//! (k c))`, no faster than at a barrier of zero. Domains lie on a grid and count by the density of their
//! voltages. What they give, and a part without memory, goes through a mode. No play operator, no polynomial.

use super::case::SetCase;
use super::context::{Context, spread, write};
use super::mark::CaseTruth;
use rand::{Rng, SeedableRng};
use rand_distr::StandardNormal;
use rand_pcg::Pcg64Mcg;
use std::f64::consts::{PI, TAU};
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

const RATE_HZ: f64 = 10_000.0;
/// Steps of the mode in a sample.
const SUBSTEPS: usize = 8;
const RANGE_V: f64 = 70.0;
const NOISE_UM: f64 = 0.004;
/// Time between two attempts over a barrier, s.
const ATTEMPT_S: f64 = 2e-4;
/// Rest before a record, s.
const RESTED_S: f64 = 10.0;
/// Shares of a barrier that heat takes in a factor of `e` of the time.
const STRENGTHS: [f64; 3] = [0.015, 0.03, 0.06];
/// What activation does, effect by effect: it is found only as a whole, but none of these is false.
const IN_PARTS: [&str; 4] = ["hysteresis", "initial_curve", "rate_dependence", "creep"];
/// Seeds of each strength.
const SEEDS: u64 = 4;

struct Domain {
    coercive_v: f64,
    bias_v: f64,
    weight_um: f64,
    up: f64,
}

/// A stage at rest at its lower limit.
struct Stage {
    domains: Vec<Domain>,
    activation: f64,
    reversible_um_v: f64,
    natural_frequency_rad_s: f64,
    damping_ratio: f64,
    at_rest_um: f64,
    position_um: f64,
    velocity_um_s: f64,
}

impl Stage {
    fn new(activation: f64, random: &mut Pcg64Mcg) -> Self {
        let (median_v, spread) = (random.random_range(6.0..9.0), random.random_range(0.7..0.9));
        let (bias_v, bias_spread_v) = (
            random.random_range(28.0..38.0),
            random.random_range(18.0..24.0),
        );
        let mut domains = Vec::new();
        for i in 0..24 {
            let coercive_v = 0.6 * 1.19f64.powi(i);
            for k in 0..28 {
                let at_v = -15.0 + 3.5 * f64::from(k);
                let far = ((coercive_v / median_v).ln() / spread).powi(2)
                    + ((at_v - bias_v) / bias_spread_v).powi(2);
                domains.push(Domain {
                    coercive_v,
                    bias_v: at_v,
                    weight_um: (-0.5 * far).exp(),
                    up: 0.0,
                });
            }
        }
        let whole: f64 = domains.iter().map(|d| d.weight_um).sum();
        let switched_um = random.random_range(2.0..4.0);
        domains
            .iter_mut()
            .for_each(|d| d.weight_um *= switched_um / whole);
        let mut stage = Self {
            domains,
            activation,
            reversible_um_v: random.random_range(0.08..0.12),
            natural_frequency_rad_s: random.random_range(3000.0..7000.0),
            damping_ratio: random.random_range(0.3..0.8),
            at_rest_um: 0.0,
            position_um: 0.0,
            velocity_um_s: 0.0,
        };
        stage.switch(0.0, RESTED_S);
        stage.at_rest_um = stage.switched_um();
        stage
    }

    fn switched_um(&self) -> f64 {
        self.domains.iter().map(|d| d.weight_um * d.up).sum()
    }

    /// Domains over an interval in which the drive stands still.
    fn switch(&mut self, drive_v: f64, length_s: f64) {
        for domain in &mut self.domains {
            let rate = |barrier_v: f64| {
                (-barrier_v.max(0.0) / (self.activation * domain.coercive_v)).exp() / ATTEMPT_S
            };
            let beyond_v = drive_v - domain.bias_v;
            let (rises, falls) = (
                rate(domain.coercive_v - beyond_v),
                rate(domain.coercive_v + beyond_v),
            );
            let goes_to = rises / (rises + falls);
            domain.up = goes_to + (domain.up - goes_to) * (-(rises + falls) * length_s).exp();
        }
    }

    fn step(&mut self, drive_v: f64) {
        self.switch(drive_v, 1.0 / RATE_HZ);
        let force_um = self.reversible_um_v * drive_v + self.switched_um() - self.at_rest_um;
        let (w, step_s) = (
            self.natural_frequency_rad_s,
            1.0 / RATE_HZ / SUBSTEPS as f64,
        );
        for _ in 0..SUBSTEPS {
            let pull = w * w * (force_um - self.position_um)
                - 2.0 * self.damping_ratio * w * self.velocity_um_s;
            self.velocity_um_s += step_s * pull;
            self.position_um += step_s * self.velocity_um_s;
        }
    }
}

/// The drives, with the role of each.
fn drives() -> [(&'static str, &'static str, Vec<f64>); 5] {
    let samples = |seconds: f64, drive: &dyn Fn(f64) -> f64| -> Vec<f64> {
        let count = (seconds * RATE_HZ) as usize;
        (0..count).map(|k| drive(k as f64 / RATE_HZ)).collect()
    };
    // Ramps of 20 ms, and holds.
    let stair = |levels: &'static [f64]| {
        move |t: f64| {
            let (nth, share) = ((t / 0.25) as usize, ((t / 0.25).fract() / 0.08).min(1.0));
            let before = nth.checked_sub(1).map_or(0.0, |nth| levels[nth]);
            before + share * (levels[nth] - before)
        }
    };
    let raised = |hertz: f64, t: f64| 0.5 * (1.0 - (TAU * hertz * t).cos());
    let first = stair(&[68.0, 20.0, 50.0, 5.0, 35.0, 60.0, 0.0, 15.0]);
    let second = stair(&[55.0, 30.0, 66.0, 40.0, 10.0, 45.0]);
    [
        ("stair", "identify", samples(2.0, &first)),
        (
            "slow",
            "identify",
            samples(1.5, &|t| RANGE_V * (0.1 + 0.6 * t) * raised(4.0, t)),
        ),
        (
            "fast",
            "identify",
            samples(0.5, &|t| RANGE_V * (1.0 - 1.8 * t) * raised(40.0, t)),
        ),
        ("stair2", "validate", samples(1.5, &second)),
        (
            "sines",
            "validate",
            samples(1.0, &|t| {
                RANGE_V * (0.5 * raised(2.0, t) + 0.4 * raised(17.0, t)) * (PI * t).sin()
            }),
        ),
    ]
}

fn made(folder: &Path, name: &str, activation: f64, seed: u64) -> Result<PathBuf, String> {
    let into = folder.join(name);
    if into.join("dataset.toml").exists() {
        return Ok(into);
    }
    let mut manifest = format!(
        "name = \"{name}\"\ndrive_min_v = 0.0\ndrive_max_v = {RANGE_V:.1}\ntiming = \"hold_after_sample\"\n"
    );
    let mut drives = drives().to_vec();
    drives.push(("rest", "noise", vec![0.0; 3000]));
    for (record, role, drive_v) in drives {
        // The same stage before each record, other noise.
        let mut stage = Stage::new(activation, &mut Pcg64Mcg::seed_from_u64(seed));
        let mut noise =
            Pcg64Mcg::seed_from_u64(seed ^ (((drive_v.len() as u64) << 32) | record.len() as u64));
        let mut text = String::from("t_s,u_V,y_um\n");
        for (k, drive_v) in drive_v.into_iter().enumerate() {
            let reading_um = stage.position_um + NOISE_UM * noise.sample::<f64, _>(StandardNormal);
            let _ = writeln!(
                text,
                "{:.4},{drive_v:.5},{reading_um:.6}",
                k as f64 / RATE_HZ
            );
            stage.step(drive_v);
        }
        write(&into.join(format!("{record}.csv")), &text)?;
        let _ = write!(
            manifest,
            "\n[[record]]\nfile = \"{record}.csv\"\nrole = \"{role}\"\ninitial_state = \"virgin\"\nsample_rate_hz = {RATE_HZ:.1}\n"
        );
    }
    write(&into.join("dataset.toml"), &manifest)?;
    Ok(into)
}

/// Thermally activated switching at three strengths.
pub fn cases(context: &Context, most: Option<usize>) -> Result<Vec<SetCase>, String> {
    let folder = context.folder_of("relaxation")?;
    let mut out = Vec::new();
    for activation in STRENGTHS {
        for seed in 1..=SEEDS {
            let name = format!("activation_{activation}_{seed}");
            let truth = CaseTruth::Missing(
                vec!["activated_switching".into()],
                IN_PARTS.map(str::to_owned).to_vec(),
            );
            out.push(SetCase::named(
                name.clone(),
                made(&folder, &name, activation, seed)?,
                "gain,vibration",
                truth,
                Some(NOISE_UM),
            ));
        }
    }
    Ok(spread(out, most))
}
