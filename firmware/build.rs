//! Hands the linker the memory map of the repository's root and the section that is copied to ITCM.
//!
//! The functions of `hysteron_core` and of the compiler's integer helpers are named in the section, because the control
//! interrupt calls them; what it does not reach is dropped by the linker's garbage collection.

use std::{env, fs, path::Path};

/// Placed before `.text`, so that these input sections are matched first.
const ITCM_SECTION: &str = r"
SECTIONS
{
  .itcm : ALIGN(8)
  {
    . = ALIGN(8);
    __itcm_start = .;
    *(.itcm .itcm.*);
    *(.text.*hysteron_core*);
    *(.text.*compiler_builtins*);
    *(.text.__* .text.mem* .text.unlikely.mem*);
    . = ALIGN(8);
    __itcm_end = .;
  } > ITCM AT > FLASH
  __itcm_load = LOADADDR(.itcm);
  .axisram (NOLOAD) : ALIGN(8) { *(.axisram .axisram.*); } > AXISRAM
}
INSERT BEFORE .text;
/* .text begins behind the load image of .itcm. */
_stext = (LOADADDR(.itcm) + SIZEOF(.itcm) + 7) & ~7;
";

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let out = env::var("OUT_DIR")?;
    let root = env::var("CARGO_MANIFEST_DIR")?;
    let memory = Path::new(&root).join("../memory.x");
    let text = fs::read_to_string(&memory).map_err(|error| format!("{}: {error}", memory.display()))?;
    fs::write(Path::new(&out).join("memory.x"), text + ITCM_SECTION)?;
    println!("cargo:rustc-link-search={out}");
    println!("cargo:rerun-if-changed=../memory.x");
    println!("cargo:rerun-if-changed=build.rs");
    Ok(())
}
