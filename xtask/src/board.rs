//! The emulated board's program, built beside `hysteron`; the image is put there too.

use std::path::PathBuf;

use crate::test_programs;
use crate::toolchain;
use crate::workspace::{AS_TESTED, built, cargo, root};

/// The program.
pub fn program() -> PathBuf {
    built("hysteron-board")
}

/// The board in front of an independent stage (`board/emulator/examples/independent_stage.rs`), with what the
/// tests are built of.
pub fn independent_stage() -> Result<PathBuf, String> {
    cargo(
        &[
            &["build", "--quiet"],
            AS_TESTED,
            &["--example", "independent_stage"],
        ]
        .concat(),
        &root(),
        &[],
    )?;
    Ok(built("examples/independent_stage"))
}

/// Builds the program and puts the image beside it.
pub fn build() -> Result<(), String> {
    cargo(
        &[
            "build",
            "--quiet",
            "--release",
            "--ignore-rust-version",
            "--package",
            "hysteron-emulator",
            "--bin",
            "hysteron-board",
        ],
        &root(),
        &[],
    )?;
    place_image()
}

/// Builds the program as the tests have it and puts the image beside it.
pub fn place() -> Result<(), String> {
    test_programs::build(AS_TESTED)?;
    place_image()
}

fn place_image() -> Result<(), String> {
    let image = toolchain::image();
    if !image.is_file() {
        return Err(format!(
            "{} is not there: run `cargo xtask firmware` first",
            image.display()
        ));
    }
    let beside = built("hysteron-firmware.elf");
    std::fs::copy(&image, &beside)
        .map_err(|error| format!("{} to {}: {error}", image.display(), beside.display()))?;
    let stage = toolchain::boot_stage();
    let beside = built("hysteron-boot-stage");
    std::fs::copy(&stage, &beside)
        .map_err(|error| format!("{} to {}: {error}", stage.display(), beside.display()))?;
    println!("   {}", program().display());
    Ok(())
}
