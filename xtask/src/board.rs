//! The operator's program, which needs the emulated part's compiler: built there, put beside `hysteron` together with the image.

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
    Ok(target_of_emulator().join("release/examples/independent_stage"))
}

fn target_of_emulator() -> PathBuf {
    std::env::var_os("CARGO_TARGET_DIR").map_or_else(|| root().join("emulator/target"), Into::into)
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
    let made = target_of_emulator().join("release/hysteron-board");
    for (from, to) in [(made, program()), (image, built("hysteron-firmware.elf"))] {
        if from != to {
            if let Some(parent) = to.parent() {
                std::fs::create_dir_all(parent).map_err(|error| format!("{}: {error}", parent.display()))?;
            }
            std::fs::copy(&from, &to).map_err(|error| format!("{} to {}: {error}", from.display(), to.display()))?;
        }
    }
    println!("   {}", program().display());
    Ok(())
}
