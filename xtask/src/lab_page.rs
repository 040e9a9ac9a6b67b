//! The lab as one page: the module for WebAssembly, the scripts of `lab/browser/web`, the example, all in
//! `target/lab.html`.
//!
//! The module is built with the library without its default features, so that this step also shows that it
//! builds for a browser.

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use flate2::Compression;
use flate2::write::GzEncoder;
use std::io::Write;
use std::path::{Path, PathBuf};

use crate::toolchain::{self, WEB_ASSEMBLY};
use crate::workspace::{AS_TESTED, cargo, root};
use crate::{browser, skipped_tests};

/// A page that takes longer to open than to leave is not opened: what it may have.
const MOST_BYTES: usize = 4_000_000;

/// Compiled as one piece: a tenth less to open than crate by crate, in the same time to build.
const AS_ONE_PIECE: [&str; 4] = [
    "--config",
    "profile.release.lto='fat'",
    "--config",
    "profile.release.codegen-units=1",
];

/// Where the page is written.
pub fn file() -> PathBuf {
    root().join("target/lab.html")
}

/// Builds module and page as they are published: small enough to open.
pub fn build() -> Result<(), String> {
    module(&AS_ONE_PIECE)?;
    let bytes = write()?;
    if bytes > MOST_BYTES {
        return Err(format!(
            "the page has {bytes} bytes, more than the {MOST_BYTES} of xtask/src/lab_page.rs"
        ));
    }
    Ok(())
}

/// Level 1 is half the time to build; a search in the browser then takes some seconds more.
const FOR_TESTS: [&str; 6] = [
    "--config",
    "profile.release.package.hysteron-core.opt-level=1",
    "--config",
    "profile.release.package.hysteron-sim.opt-level=1",
    "--config",
    "profile.release.package.hysteron.opt-level=1",
];

/// Builds module and page as the tests open it.
pub fn build_for_tests() -> Result<(), String> {
    module(&FOR_TESTS)?;
    write().map(drop)
}

/// A folder of its own: another compiler may be at work than the one of the host.
const FOLDER: [&str; 2] = ["--target-dir", "target/web_assembly"];

fn module(options: &[&str]) -> Result<(), String> {
    let toolchain = toolchain::for_target(&WEB_ASSEMBLY)?;
    toolchain.build(
        &WEB_ASSEMBLY,
        &root(),
        &[&["--package", "hysteron-browser"], &FOLDER[..], options].concat(),
    )
}

/// Packs the page around the module; how many bytes it has.
fn write() -> Result<usize, String> {
    let module = read(
        &root().join("target/web_assembly/wasm32-unknown-unknown/release/hysteron_browser.wasm"),
    )?;
    let example: serde_json::Map<String, serde_json::Value> = hysteron_examples::HIDDEN_EFFECT
        .iter()
        .map(|(name, text)| ((*name).into(), (*text).into()))
        .collect();
    let example = serde_json::Value::from(example).to_string();
    let page = hysteron_page::from_disk(
        &compact(&without_custom_sections(&module)?)?,
        &compact(example.as_bytes())?,
    )?;
    println!("   {}: {} bytes", file().display(), page.len());
    std::fs::write(file(), &page).map_err(|error| format!("{}: {error}", file().display()))?;
    Ok(page.len())
}

/// Real clicks and a real drop in a browser.
pub fn test() -> Result<(), String> {
    if !file().is_file() {
        return Err(format!(
            "{} is not there: run `cargo xtask lab` first",
            file().display()
        ));
    }
    browser::ensure()?;
    let only = [
        "--test",
        "integration",
        "lab_page::",
        "--",
        "--ignored",
        "--nocapture",
        "--test-threads",
        "1",
    ];
    cargo(
        &[&["test"], AS_TESTED, &only].concat(),
        &root(),
        &[("HYSTERON_SKIPPED", &skipped_tests::file().to_string_lossy())],
    )
}

fn read(path: &Path) -> Result<Vec<u8>, String> {
    std::fs::read(path).map_err(|error| format!("{}: {error}", path.display()))
}

/// gzip, which browsers unpack themselves, in base64.
fn compact(bytes: &[u8]) -> Result<String, String> {
    let mut packer = GzEncoder::new(Vec::new(), Compression::best());
    let packed = packer.write_all(bytes).and_then(|()| packer.finish());
    packed
        .map(|bytes| STANDARD.encode(bytes))
        .map_err(|error| format!("gzip: {error}"))
}

/// A module without names and remarks of the compiler, which a browser does not need: sections with number 0.
fn without_custom_sections(module: &[u8]) -> Result<Vec<u8>, String> {
    let cut = || "the module is cut off".to_owned();
    let (head, mut rest) = module
        .split_at_checked(8)
        .filter(|(head, _)| head.starts_with(b"\0asm"))
        .ok_or_else(cut)?;
    let mut out = head.to_vec();
    while let Some(number) = rest.first() {
        let (mut length, mut at) = (0usize, 1);
        loop {
            let byte = *rest.get(at).ok_or_else(cut)?;
            length |= usize::from(byte & 0x7f) << (7 * (at - 1)).min(56);
            at += 1;
            if byte & 0x80 == 0 {
                break;
            }
        }
        let (section, after) = rest.split_at_checked(at + length).ok_or_else(cut)?;
        if *number != 0 {
            out.extend(section);
        }
        rest = after;
    }
    Ok(out)
}
