//! Hands the linker the board's memory map and the section that is copied to the memory of the control
//! interrupt's code, and the firmware its sampling rate.
//!
//! The environment variable `HYSTERON_SAMPLE_RATE_HZ` chooses the rate, 20000 where it is not set. The image
//! carries it as the symbol `__sample_rate_hz` too, for whoever runs it.
//!
//! The functions of `hysteron_core` and of the compiler's integer helpers are named in the section, because
//! the control interrupt calls them; what it does not reach is dropped by the linker's garbage collection.
//! What reads and verifies parameter blocks, the safety envelope, kept settings, images and command lines,
//! and what designs filters, only runs in tasks, and stays in flash: that memory is short on some boards. `cargo
//! xtask firmware` finds a function that the control interrupt calls there.

use std::{env, fs, path::Path};

/// Placed before `.text`, so that these input sections are matched first.
const SECTIONS: &str = r"
SECTIONS
{
  .image_header ORIGIN(FLASH) + 0x400 : { LONG(__image_bytes); KEEP(*(.image_header)); } > FLASH
  .start_code : {
    *(.text.*hysteron_core*parameter_block* .text.*hysteron_core*safety_envelope* .text.*hysteron_core*block_choice* .text.*hysteron_core*stepping*verify*);
    *(.text.*hysteron_core*command_text* .text.*hysteron_core*command_lines* .text.*hysteron_core*checksum*);
    *(.text.*hysteron_core*filter_design* .text.*hysteron_core*loop_margin* .text.*hysteron_core*kept_settings* .text.*hysteron_core*kept_events* .text.*hysteron_core*firmware_update*);
  } > FLASH
  .control_code : ALIGN(8)
  {
    . = ALIGN(8);
    __control_code_start = .;
    *(.control_code .control_code.*);
    *(.text.*hysteron_core*);
    *(.text.*compiler_builtins*);
    *(.text.__* .text.mem* .text.unlikely.mem*);
    . = ALIGN(8);
    __control_code_end = .;
  } > CONTROL_CODE AT > FLASH
  __control_code_load = LOADADDR(.control_code);
  .bulk (NOLOAD) : ALIGN(8) { *(.bulk .bulk.*); } > BULK
}
INSERT BEFORE .text;
__image_bytes = __sidata + SIZEOF(.data) - ORIGIN(FLASH);
/* .text begins behind the load image of .control_code. */
_stext = (LOADADDR(.control_code) + SIZEOF(.control_code) + 7) & ~7;
";

/// Name of the variable that chooses the sampling rate.
const SAMPLE_RATE: &str = "HYSTERON_SAMPLE_RATE_HZ";
const USUAL_SAMPLE_RATE_HZ: u32 = 20_000;

/// The sampling rate of the image, Hz. The NUCLEO-G474RE has 1,700 cycles in a period of 100 kHz and 3,400 in
/// one of 50 kHz, and a tick may take 1,500 instructions; it has not run at all.
fn sample_rate_hz(is_g474re: bool) -> Result<u32, String> {
    let accepted: &[u32] = if is_g474re {
        &[USUAL_SAMPLE_RATE_HZ]
    } else {
        &[USUAL_SAMPLE_RATE_HZ, 50_000, 100_000]
    };
    let Ok(text) = env::var(SAMPLE_RATE) else {
        return Ok(USUAL_SAMPLE_RATE_HZ);
    };
    let rate_hz = text
        .parse()
        .ok()
        .filter(|rate_hz| accepted.contains(rate_hz));
    rate_hz.ok_or_else(|| {
        format!("{SAMPLE_RATE} = {text}: expected one of {accepted:?}, Hz, on this board")
    })
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let out = env::var("OUT_DIR")?;
    let root = env::var("CARGO_MANIFEST_DIR")?;
    let is_g474re = env::var_os("CARGO_FEATURE_NUCLEO_G474RE").is_some();
    let rate_hz = sample_rate_hz(is_g474re)?;
    println!("cargo:rustc-env={SAMPLE_RATE}={rate_hz}");
    println!("cargo:rerun-if-env-changed={SAMPLE_RATE}");
    let board = if is_g474re {
        "src/board/nucleo_g474re/memory.x"
    } else {
        "../memory.x"
    };
    let memory = Path::new(&root).join(board);
    let text =
        fs::read_to_string(&memory).map_err(|error| format!("{}: {error}", memory.display()))?;
    fs::write(
        Path::new(&out).join("memory.x"),
        text + SECTIONS + &format!("__sample_rate_hz = {rate_hz};\n"),
    )?;
    println!("cargo:rustc-link-search={out}");
    // target/<triple>/release, where cargo puts the image.
    let beside_image = Path::new(&out)
        .ancestors()
        .nth(3)
        .ok_or("no folder for the map")?;
    println!(
        "cargo:rustc-link-arg-bin=hysteron-firmware=-Map={}",
        beside_image.join("hysteron-firmware.map").display()
    );
    println!("cargo:rerun-if-changed={board}");
    println!("cargo:rerun-if-changed=build.rs");
    Ok(())
}
