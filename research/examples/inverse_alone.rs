//! What the exported inverse of the loops is worth without a feedback, on stages that the simulation does not
//! share: prints the table that belongs to `docs/results/servo_from_data.md`.
//!
//!     cargo run --release --workspace --example inverse_alone [STAGES [FIRST_SEED]]
//!
//! Each stage is recorded and explained, and the inverse of its model is compiled as `export --inverse` writes
//! it (needs `cc`). A sine of falling height then goes to a virgin stage, once by these drives, once through
//! the one gain and offset that suit them best. Errors are of the true position, in nm and as a share of the
//! range.

use hysteron::export::{Language, inverse};
use hysteron_research::stages_asked_for;
use hysteron_sim::chain::Model;
use hysteron_sim::closed_loop::Plant;
use hysteron_tests::independent_stage::{IndependentStage, StageChange, StageTruth};
use hysteron_tests::servo_study::{RATE_HZ, StudyRecording, kept_model, record};
use std::error::Error;
use std::f64::consts::TAU;
use std::io::Write;
use std::process::{Command, Stdio};

const FREQUENCY_HZ: f64 = 5.0;
const CYCLES: usize = 6;

/// Cycles of falling height that begin at zero.
fn reference_um(range_um: f64) -> Vec<f64> {
    let samples = (CYCLES as f64 * RATE_HZ / FREQUENCY_HZ) as usize;
    let at = |k: usize| {
        let turn = k as f64 * FREQUENCY_HZ / RATE_HZ;
        let height = 1.0 - 0.8 * turn / CYCLES as f64;
        0.5 * range_um * height * (1.0 - (TAU * turn).cos())
    };
    (0..samples).map(at).collect()
}

/// What a program reads and prints.
const MAIN: &str = "\n#include <stdio.h>\nint main(void) {\n    double x; stage_state m; stage_init(&m);\n    while (scanf(\"%lf\", &x) == 1) printf(\"%.17g\\n\", stage_step(&m, x));\n    return 0;\n}\n";

/// The drives of the exported inverse, V.
fn drives_v(model: &Model, reference: &[f64]) -> Result<Vec<f64>, Box<dyn Error>> {
    let folder = tempfile::tempdir()?;
    let text = inverse(model, Language::C, RATE_HZ, "stage")? + MAIN;
    std::fs::write(folder.path().join("stage.c"), text)?;
    let built = Command::new("cc")
        .args(["-std=c99", "-O2", "stage.c", "-lm", "-o", "stage"])
        .current_dir(folder.path())
        .status()?;
    if !built.success() {
        return Err("cc does not compile the inverse".into());
    }
    let input: String = reference.iter().map(|r| format!("{r:.17e}\n")).collect();
    let mut program = Command::new(folder.path().join("stage"))
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()?;
    let mut pipe = program.stdin.take().ok_or("no pipe")?;
    let writer = std::thread::spawn(move || pipe.write_all(input.as_bytes()));
    let output = program.wait_with_output()?.stdout;
    writer.join().map_err(|_| "the writer ended early")??;
    let drives = String::from_utf8(output)?;
    Ok(drives.lines().map(str::parse).collect::<Result<_, _>>()?)
}

/// Positions of a virgin stage under a drive, um.
fn positions_um(truth: &StageTruth, drive_v: &[f64]) -> Vec<f64> {
    let mut stage = IndependentStage::virgin(truth, StageChange::NONE);
    let position = |v: &f64| {
        stage.advance(*v, 0.0);
        stage.displacement_um()
    };
    drive_v.iter().map(position).collect()
}

/// Root of the mean square of the error behind the first cycle, um.
fn error_um(positions: &[f64], reference: &[f64]) -> f64 {
    let first = reference.len() / CYCLES;
    let squares = positions
        .iter()
        .zip(reference)
        .skip(first)
        .map(|(y, r)| (y - r).powi(2));
    (squares.sum::<f64>() / (reference.len() - first) as f64).sqrt()
}

/// Slope and offset of the drive that suit a reference best, V/um and V.
fn gain_and_offset(reference: &[f64], drive_v: &[f64]) -> (f64, f64) {
    let n = reference.len() as f64;
    let (r, v) = (
        reference.iter().sum::<f64>() / n,
        drive_v.iter().sum::<f64>() / n,
    );
    let pairs = || reference.iter().zip(drive_v);
    let slope = pairs().map(|(a, b)| (a - r) * (b - v)).sum::<f64>()
        / reference.iter().map(|a| (a - r).powi(2)).sum::<f64>();
    (slope, v - slope * r)
}

fn main() -> Result<(), Box<dyn Error>> {
    println!("stage  range um  inverse nm    %   gain nm    %   times");
    let mut times = Vec::new();
    for seed in stages_asked_for() {
        let truth = StageTruth::drawn(seed);
        let dataset = record(&truth, StudyRecording::Usual);
        let model = kept_model(&truth, StudyRecording::Usual, &dataset);
        let reference = reference_um(0.8 * truth.travel_um);
        let by_inverse = drives_v(&model, &reference)?;
        let (slope, offset_v) = gain_and_offset(&reference, &by_inverse);
        let by_gain: Vec<f64> = reference
            .iter()
            .map(|r| (offset_v + slope * r).clamp(0.0, truth.drive_max_v))
            .collect();
        let range_um = reference.iter().copied().fold(0.0, f64::max);
        let [a, b] = [by_inverse, by_gain].map(|v| error_um(&positions_um(&truth, &v), &reference));
        println!(
            "{seed:>5} {range_um:>9.2} {:>11.1} {:>4.2} {:>9.1} {:>4.2} {:>7.1}",
            1e3 * a,
            100.0 * a / range_um,
            1e3 * b,
            100.0 * b / range_um,
            b / a
        );
        times.push(b / a);
    }
    times.sort_by(f64::total_cmp);
    if let (Some(least), Some(median)) = (times.first(), times.get(times.len() / 2)) {
        println!("the inverse alone is better by {median:.1} times (median), {least:.1} at least");
    }
    Ok(())
}
