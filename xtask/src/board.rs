//! The operator's program, which is built in the emulated part's workspace, beside `hysteron`; the image is put there too.

use std::path::PathBuf;

use crate::steps::{EMULATOR_VARIABLES, built, cargo, root};
use crate::toolchain;

/// The program.
pub fn program() -> PathBuf {
    built("hysteron-board")
}

/// The board in front of an independent stage (`board/emulator/examples/independent_stage.rs`), built with the tests of the emulated part.
pub fn independent_stage() -> Result<PathBuf, String> {
    build_as_tested()?;
    Ok(built("examples/independent_stage"))
}

/// Builds what the emulated part's workspace has as its tests have it: a build without them has other features of its dependencies and would begin anew.
pub fn build_as_tested() -> Result<(), String> {
    let arguments = ["build", "--quiet", "--release", "--ignore-rust-version", "--workspace", "--all-targets"];
    cargo(&arguments, &root().join("board/emulator"), &EMULATOR_VARIABLES)
}

/// Builds the program and puts the image beside it.
pub fn build() -> Result<(), String> {
    let arguments = ["build", "--quiet", "--release", "--ignore-rust-version", "--bin", "hysteron-board"];
    cargo(&arguments, &root().join("board/emulator"), &EMULATOR_VARIABLES)?;
    place_image()
}

/// The same of what the tests of the emulated part have built.
pub fn place() -> Result<(), String> {
    build_as_tested()?;
    place_image()
}

fn place_image() -> Result<(), String> {
    let image = toolchain::image();
    if !image.is_file() {
        return Err(format!("{} is not there: run `cargo xtask firmware` first", image.display()));
    }
    let beside = built("hysteron-firmware.elf");
    std::fs::copy(&image, &beside).map_err(|error| format!("{} to {}: {error}", image.display(), beside.display()))?;
    println!("   {}", program().display());
    Ok(())
}
