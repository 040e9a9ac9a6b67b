//! The operator's program, which is built in the emulated part's workspace, beside `hysteron`; the image is put there too.

use std::path::PathBuf;

use crate::steps::{EMULATOR_VARIABLES, built, cargo, root};
use crate::toolchain;

/// The program.
pub fn program() -> PathBuf {
    built("hysteron-board")
}

/// The board in front of an independent stage (`board/examples/independent_stage.rs`), built.
pub fn independent_stage() -> Result<PathBuf, String> {
    let folder = root().join("emulator");
    let arguments =
        ["build", "--quiet", "--release", "--ignore-rust-version", "--package", "hysteron-board", "--example", "independent_stage"];
    cargo(&arguments, &folder, &EMULATOR_VARIABLES)?;
    Ok(built("examples/independent_stage"))
}

/// Builds it and puts it there.
pub fn build() -> Result<(), String> {
    let image = toolchain::image();
    if !image.is_file() {
        return Err(format!("{} is not there: run `cargo xtask firmware` first", image.display()));
    }
    let folder = root().join("emulator");
    let arguments = ["build", "--quiet", "--release", "--ignore-rust-version", "--package", "hysteron-board"];
    cargo(&arguments, &folder, &EMULATOR_VARIABLES)?;
    let beside = built("hysteron-firmware.elf");
    std::fs::copy(&image, &beside).map_err(|error| format!("{} to {}: {error}", image.display(), beside.display()))?;
    println!("   {}", program().display());
    Ok(())
}
