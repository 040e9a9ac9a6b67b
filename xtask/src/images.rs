//! The firmware's images: built, and what they may take.

use std::path::{Path, PathBuf};

use crate::workspace::root;
use crate::{control_code, toolchain};

/// Sampling rates of images beside the usual one, kHz.
const FAST_RATES_KHZ: [u32; 2] = [50, 100];

/// Builds every image, each kept under its own name.
pub fn build() -> Result<(), String> {
    let toolchain = toolchain::for_target(&toolchain::FIRMWARE)?;
    let folder = root().join("firmware");
    let image = toolchain::image();
    // With the map that the linker writes beside it.
    let keep = |other: PathBuf| {
        let copy = |from: &Path, to: &Path| {
            std::fs::copy(from, to)
                .map_err(|error| format!("{} to {}: {error}", from.display(), to.display()))
        };
        copy(&image.with_extension("map"), &other.with_extension("map"))?;
        copy(&image, &other)
    };
    // All binaries of the other board; the run copies one of them, and only builds the other.
    let small = [
        "--config",
        "profile.release.package.hysteron-core.opt-level=\"s\"",
    ];
    toolchain.build(
        &toolchain::FIRMWARE,
        &folder,
        &[
            &["--no-default-features", "--features", "nucleo-g474re"],
            &small[..],
        ]
        .concat(),
    )?;
    keep(toolchain::g474re_image())?;
    toolchain.build(
        &toolchain::FIRMWARE,
        &folder,
        &[
            "--bin",
            "hysteron-firmware",
            "--features",
            "on-chip-converters",
        ],
    )?;
    keep(toolchain::on_chip_image())?;
    for rate_khz in FAST_RATES_KHZ {
        let rate_hz = format!("{rate_khz}000");
        toolchain.build_with(
            &toolchain::FIRMWARE,
            &folder,
            &["--bin", "hysteron-firmware"],
            &[("HYSTERON_SAMPLE_RATE_HZ", &rate_hz)],
        )?;
        keep(toolchain::image_at(rate_khz))?;
    }
    // With the boot stage: so both are built of the same dependencies.
    toolchain.build(&toolchain::FIRMWARE, &folder, &["--workspace"])
}

/// The servo as a static library for a controller whose program is in C.
pub fn servo_for_c() -> Result<(), String> {
    let toolchain = toolchain::for_target(&toolchain::FIRMWARE)?;
    toolchain.build(&toolchain::FIRMWARE, &root(), &["-p", "hysteron-c"])
}

/// What the image may take; a change that needs more has to change these numbers. 1 KiB of it looks at what
/// is typed before it acts, 3 KiB let another block take over the running loop, 2 KiB adapt the gain of its
/// model. 5 KiB more are the sliding-mode law, the self-test, the judgement of a conditioning, waveforms of
/// two quantities, and the log of faults. 4 KiB more are the creep of what was applied (1.7), filters (1.1)
/// and the watch of the output. 1 KiB more is the watch of a drive that swings, and the last limit of range
/// and slew. 5 KiB more are stick-slip drives, which the memory's 64 KiB bear, and 1 KiB for rustup's rustc
/// 1.95, which makes 43,652 bytes of the largest image.
const MOST_CONTROL_CODE_BYTES: u64 = 43 * 1024;
/// All of the NUCLEO-G474RE's memory for it; there `hysteron-core` is compiled for its size.
const MOST_G474RE_CONTROL_CODE_BYTES: u64 = 32 * 1024;
/// 12 KiB of it are blocks, diagnosis and recorded codes over the serial port, 4 KiB the supply, the option
/// bytes and the host that is missed, 4 KiB the figures of the closed loop and the alarm of its resonance,
/// 5 KiB the block that takes over, 3 KiB the gain that is adapted, 2 KiB codes of up to 20 bits: how many
/// the block says, frames as long as they are, samples that are packed and unpacked. 50 KiB more are the
/// safety envelope, arming, the self-test, the sliding-mode law and the log of faults over both channels.
/// 20 KiB more are filters, their design from frequencies, settings that are kept, and the watch of the
/// output. 10 KiB more are the update over the line. The filters' sections are written out in the tick: 0.4
/// KiB that save 240 instructions. 8 KiB more are the margins of filters, what updates and kept settings
/// exclude, the codes of both converters over the line, and power that nobody uses. The rest is room, as
/// images of the same sources differ between machines. An image that is updated has 384 KiB.
const MOST_FLASH_BYTES: u64 = 284 * 1024;
/// 10 KiB of it are what a periodic reference learns: 8 of points (4.9 Hz at 20 kHz), 1 of the newest errors,
/// 1 of its filters, twice; 1 KiB is a block that waits to take over. 2 KiB are the log of faults and the
/// sliding-mode law's parameters and state. 1 KiB more is the creep that the tick follows, 88 bytes,
/// filters and the settings that are kept. 1 KiB more is the task that writes an image.
const MOST_RAM_BYTES: u64 = 75 * 1024;
/// Of the 76 KiB of the NUCLEO-G474RE: what is left for the stack is 1.7 KiB more than the same program uses
/// of the other board's. 0.7 KiB of it are the gain that is adapted: the coefficients that depend on it,
/// twice.
/// 1 KiB is filters, and the settings that are kept.
const MOST_G474RE_RAM_BYTES: u64 = 46 * 1024;

/// Stack of the control interrupt by its call graph: 1,484 on the NUCLEO-H743ZI2, 1,760 on the NUCLEO-G474RE.
const MOST_STACK_BYTES: u64 = 2 * 1024;

/// The control interrupt's code and the memory of every image.
pub fn check() -> Result<(), String> {
    let nucleo_h743zi = [MOST_CONTROL_CODE_BYTES, MOST_RAM_BYTES];
    check_image(
        "NUCLEO-H743ZI2, SPI converters",
        &toolchain::image(),
        nucleo_h743zi,
    )?;
    check_image(
        "NUCLEO-H743ZI2, on-chip converters",
        &toolchain::on_chip_image(),
        nucleo_h743zi,
    )?;
    for rate_khz in FAST_RATES_KHZ {
        check_image(
            &format!("NUCLEO-H743ZI2, {rate_khz} kHz"),
            &toolchain::image_at(rate_khz),
            nucleo_h743zi,
        )?;
    }
    check_image(
        "NUCLEO-G474RE",
        &toolchain::g474re_image(),
        [MOST_G474RE_CONTROL_CODE_BYTES, MOST_G474RE_RAM_BYTES],
    )
}

fn check_image(
    name: &str,
    image: &Path,
    [most_control_code_bytes, most_ram_bytes]: [u64; 2],
) -> Result<(), String> {
    let figures = control_code::check(image)?;
    println!(
        "   {name}: control interrupt: {} bytes in {} functions, {} jump-table entries for impossible values, {} bytes of stack; image: {} bytes of flash, {} bytes of static RAM",
        figures.control_code_bytes,
        figures.control_functions,
        figures.impossible_cases,
        figures.stack_bytes,
        figures.flash_bytes,
        figures.ram_bytes
    );
    for (what, value, most) in [
        (
            "control code",
            figures.control_code_bytes,
            most_control_code_bytes,
        ),
        ("stack", figures.stack_bytes, MOST_STACK_BYTES),
        ("flash", figures.flash_bytes, MOST_FLASH_BYTES),
        ("static RAM", figures.ram_bytes, most_ram_bytes),
    ] {
        if value > most {
            return Err(format!(
                "{name}: {what}: {value} bytes, more than the {most} of xtask/src/images.rs"
            ));
        }
    }
    Ok(())
}
