//! Recordings of a rig with a hidden effect, and how an outcome is judged.

use super::outcome::RigDiagnosis;
use crate::dataset::{Dataset, Record, Role};
use crate::error::Result;
use crate::outcome::Verdict;
use hysteron_sim::noise::WhiteNoise;
use hysteron_sim::rig_effects::{RigEffect, RigEffects};
use hysteron_sim::waveform::{concatenate, hold, saw_tooth, steps, triangles};
use rand::{Rng, SeedableRng};
use rand_pcg::Pcg64Mcg;

/// Samples a second.
pub const SAMPLE_RATE_HZ: f64 = 20_000.0;
/// Noise of the sensor, um RMS.
pub const NOISE_UM: f64 = 3e-3;
/// A planted strength in its usual size, at least and at most.
const STRENGTHS: [f64; 2] = [1.0, 2.5];

/// Saw-teeth that move the slider up, or down.
fn teeth(frequency_hz: f64, height_v: f64, count: usize, upward: bool) -> Vec<f64> {
    let mut drive_v = saw_tooth(SAMPLE_RATE_HZ, frequency_hz, height_v, 1.0, count);
    if !upward {
        drive_v.reverse();
    }
    drive_v
}

/// The drives that a rig is recorded under, between 0 and 100 V: saw-teeth there and back, slow triangles and
/// steps inside one step. The last one is held out.
#[must_use]
pub fn rig_drives(seed: u64) -> Vec<(&'static str, Role, Vec<f64>)> {
    let mut random = Pcg64Mcg::seed_from_u64(0x57e9 ^ (seed << 8));
    let rest = hold(SAMPLE_RATE_HZ, 0.0, 0.02);
    let mut drive = |name, role, [height_v, frequency_hz]: [f64; 2], upward: bool| {
        let mut scaled = |value: f64| value * random.random_range(0.85..1.15);
        let (height_v, frequency_hz) = (scaled(height_v), scaled(frequency_hz));
        let fine_v = scaled(12.0);
        let levels = [2.0, 1.0, 2.5, 0.5, 1.5, 0.0].map(|level| (level * fine_v, 0.004));
        let parts = [
            rest.clone(),
            teeth(frequency_hz, height_v, 6, upward),
            rest.clone(),
            teeth(1.3 * frequency_hz, 0.8 * height_v, 4, !upward),
            triangles(
                SAMPLE_RATE_HZ,
                scaled(3000.0),
                &[0.0, height_v, 0.3 * height_v, 0.0],
            ),
            steps(SAMPLE_RATE_HZ, &levels),
            rest.clone(),
        ];
        (name, role, concatenate(&parts))
    };
    vec![
        drive("up", Role::Identify, [80.0, 80.0], true),
        drive("down", Role::Identify, [55.0, 120.0], false),
        drive("judging", Role::Validate, [70.0, 100.0], true),
    ]
}

/// Records a rig under its drives. `play` gives the slider's true reading under a drive, from rest.
///
/// # Errors
/// A reading is not finite.
pub fn recorded(
    name: &str,
    seed: u64,
    play: &mut dyn FnMut(&[f64]) -> Vec<f64>,
) -> Result<Dataset> {
    let records = rig_drives(seed)
        .into_iter()
        .zip(1..)
        .map(|((name, role, drive_v), nth)| {
            let mut noise = WhiteNoise::new(NOISE_UM, 100 * seed + nth);
            let reading_um = play(&drive_v)
                .into_iter()
                .map(|um| um + noise.next_um())
                .collect();
            Record::new(name, SAMPLE_RATE_HZ, drive_v, reading_um)
                .with_role(role)
                .from_virgin_state()
        });
    Dataset::new(name, 0.0, 100.0, records.collect())
}

/// An effect with a strength from a seed.
#[must_use]
pub fn planted_effects(effect: &RigEffect, seed: u64) -> RigEffects {
    let mut random = Pcg64Mcg::seed_from_u64(0xeffec7 ^ (seed << 8));
    let mut effects = RigEffects::default();
    let size = random.random_range(STRENGTHS[0]..STRENGTHS[1]);
    let guesses = effect.parameters[0].guesses;
    let is_signed = effect.parameters[0].range[0] < 0.0;
    let sign = if is_signed && random.random() {
        -1.0
    } else {
        1.0
    };
    *(effect.parameters[0].place)(&mut effects) = sign * size * guesses[0];
    for further in &effect.parameters[1..] {
        *(further.place)(&mut effects) = size * further.guesses[0];
    }
    effects
}

/// What was reported, for a table: findings by `+`, alternatives by `|`.
#[must_use]
pub fn said(found: &RigDiagnosis) -> String {
    let findings: Vec<String> = found.findings.iter().map(|f| f.effects.join("|")).collect();
    findings.join("+")
}

/// How a report about a rig stands beside the truth: `right`, `in set` (within an "or"), `missed` or `wrong`.
#[must_use]
pub fn mark(found: &RigDiagnosis, truth: Option<&str>) -> &'static str {
    let names = matches!(found.verdict, Verdict::Named | Verdict::Ambiguous);
    let has = |effects: &[String]| truth.is_some_and(|truth| effects.iter().any(|e| e == truth));
    match (found.findings.as_slice(), truth) {
        (findings, Some(_)) if !names || findings.is_empty() => "missed",
        (findings, None) if !names || findings.is_empty() => "right",
        ([only], _) if has(&only.effects) && only.effects.len() == 1 => "right",
        ([only], _) if has(&only.effects) => "in set",
        _ => "wrong",
    }
}
