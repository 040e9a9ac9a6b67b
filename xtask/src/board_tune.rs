//! From an empty board to a running servo with one command, in front of a stage that the program is not told
//! about.
//!
//! The emulated board writes what the stage really does, with the codes of its converters. The sensor's codes
//! that `tune` recorded on its reference are found there, and the true error is what counts.

use std::path::Path;

use crate::board;
use crate::emulated_board::{EmulatedBoard, words_of_board};
use crate::test_programs;
use crate::toolchain;
use crate::workspace::{AS_TESTED, built, command, emptied, root};

/// The true error that is accepted, over the noise of the sensor.
const ACCEPTED: f64 = 1.3;
/// The error reported from the sensor's reading is right to this share of its noise: that noise is known to
/// some hundredths itself.
const TOLD_WITHIN: f64 = 0.25;
/// Position at the sensor's code 0 of the wiring that the emulated board has, um.
const SENSOR_AT_CODE_0_UM: f64 = -1.0;

/// Bandwidth that is specified for the independent stage's sensor, which is ideal, Hz: that it comes to the
/// servo is seen there, and the motion does not show it.
const SAID_BANDWIDTH_HZ: f64 = 1e6;

/// Seed of the independent stage that the check tunes.
const CHECKED_SEED: u64 = 5;

/// In front of the stage of `board/emulator/tests/stage.toml`, whose equations are those of the simulation.
pub fn run() -> Result<(), String> {
    test_programs::build(AS_TESTED)?;
    let folder = emptied("board_tune")?;
    let truth = folder.join("truth.csv");
    let stage = root().join("board/emulator/tests/stage.toml");
    let board = EmulatedBoard::start(
        &board::program(),
        &words_of_board(&[
            "--stage",
            &stage.to_string_lossy(),
            "--truth",
            &truth.to_string_lossy(),
        ]),
    )?;
    tune(&board, &folder, &[])?;
    drop(board);
    judge(&truth, &folder.join("tuned"))
}

/// In front of one independent stage.
pub fn run_independent() -> Result<(), String> {
    test_programs::build(AS_TESTED)?;
    independent(CHECKED_SEED)
}

/// In front of the independent stages of these seeds, every one of which is tuned before the error names
/// those that failed.
pub fn run_seeds(seeds: &[u64]) -> Result<(), String> {
    test_programs::build(AS_TESTED)?;
    let failed: Vec<String> = seeds
        .iter()
        .filter_map(|seed| {
            independent(*seed)
                .err()
                .map(|problem| format!("stage {seed}: {problem}"))
        })
        .collect();
    if failed.is_empty() {
        Ok(())
    } else {
        Err(failed.join("\n"))
    }
}

/// In front of a stage of other equations than the simulation's (`tests/src/independent_stage.rs`).
fn independent(seed: u64) -> Result<(), String> {
    println!("\n   independent stage {seed}");
    let program = board::independent_stage()?;
    let folder = emptied(&format!("board_tune_{seed}"))?;
    let (truth, wiring) = (
        folder.join("truth.csv"),
        root().join("board/emulator/tests/wide_front_end.toml"),
    );
    let (image, wiring) = (toolchain::image(), wiring.to_string_lossy().into_owned());
    let board = EmulatedBoard::start(
        &program,
        &[
            &seed.to_string(),
            &image.to_string_lossy(),
            &wiring,
            &truth.to_string_lossy(),
        ],
    )?;
    tune(
        &board,
        &folder,
        &[
            "--front-end",
            &wiring,
            "--sensor-bandwidth-hz",
            &SAID_BANDWIDTH_HZ.to_string(),
        ],
    )?;
    drop(board);
    let tuned = figures(&folder.join("tuned"))?;
    let lag_s = tuned["design"]["sensor_lag_s"].as_f64().unwrap_or(0.0);
    if (lag_s * std::f64::consts::TAU * SAID_BANDWIDTH_HZ - 1.0).abs() > 1e-6 {
        return Err(format!(
            "the servo undoes a lag of {lag_s} s, not that of a sensor of {SAID_BANDWIDTH_HZ} Hz"
        ));
    }
    judge(&truth, &folder.join("tuned"))
}

/// What `tune` wrote of its work.
fn figures(out: &Path) -> Result<serde_json::Value, String> {
    let text = std::fs::read_to_string(out.join("tune.json"))
        .map_err(|error| format!("tune.json: {error}"))?;
    serde_json::from_str(&text).map_err(|error| format!("tune.json: {error}"))
}

fn tune(board: &EmulatedBoard, folder: &Path, further: &[&str]) -> Result<(), String> {
    let (out, address) = (folder.join("tuned"), format!("127.0.0.1:{}", board.port));
    let out = out.to_string_lossy();
    let words = [
        "board",
        "tune",
        &out,
        "--tcp",
        &address,
        "--baud",
        "921600",
        "--drive-max-v",
        "80",
    ];
    command(built("hysteron"), &[&words, further].concat(), &root(), &[])
}

/// Columns of a file of numbers under one line of names.
fn columns<const N: usize>(path: &Path) -> Result<Vec<[f64; N]>, String> {
    let text =
        std::fs::read_to_string(path).map_err(|error| format!("{}: {error}", path.display()))?;
    let row = |line: &str| -> Option<[f64; N]> {
        let numbers: Option<Vec<f64>> = line.split(',').map(|word| word.parse().ok()).collect();
        numbers?.try_into().ok()
    };
    // The last line may be cut off where the board was ended.
    Ok(text.lines().skip(1).map_while(row).collect())
}

fn judge(truth: &Path, out: &Path) -> Result<(), String> {
    let tuned = figures(out)?;
    let number = |value: &serde_json::Value, name: &str| {
        value
            .as_f64()
            .ok_or_else(|| format!("tune.json has no {name}"))
    };
    let noise_um = number(&tuned["noise_um"], "noise_um")?;
    let zero_um = number(&tuned["scale"]["sensor_at_code_0_um"], "scale")?;
    let true_motion: Vec<[f64; 3]> = columns(truth)?;
    let seen: Vec<[f64; 4]> = columns(&out.join("on_reference.csv"))?;
    let codes: Vec<f64> = seen.iter().map(|row| row[3]).collect();
    let there = true_motion
        .windows(codes.len().max(1))
        .find(|rows| rows.iter().zip(&codes).all(|(row, code)| row[0] == *code));
    let there = there
        .filter(|_| !codes.is_empty())
        .ok_or("what the board recorded is not what its sensor gave")?;
    // Positions count from where the conditioning zeroed the sensor.
    let shift_um = zero_um - SENSOR_AT_CODE_0_UM;
    let squares = there
        .iter()
        .zip(&seen)
        .map(|(row, seen)| (row[2] + shift_um - seen[1]).powi(2));
    let error_um = (squares.sum::<f64>() / codes.len() as f64).sqrt();
    println!(
        "   true error on the reference: {:.2} nm RMS, {:.2} times the noise of {:.2} nm",
        1e3 * error_um,
        error_um / noise_um,
        1e3 * noise_um
    );
    let told_um = number(
        &tuned["on_reference"]["of_position_um"],
        "on_reference.of_position_um",
    )?;
    println!(
        "   `board tune` tells {:.2} nm from what the sensor reads",
        1e3 * told_um
    );
    if (told_um - error_um).abs() > TOLD_WITHIN * noise_um {
        return Err(format!(
            "`board tune` tells an error of {:.2} nm, the true one is {:.2} nm",
            1e3 * told_um,
            1e3 * error_um
        ));
    }
    if error_um > ACCEPTED * noise_um {
        return Err(format!(
            "the true error is {:.2} times the noise, more than {ACCEPTED}",
            error_um / noise_um
        ));
    }
    Ok(())
}
