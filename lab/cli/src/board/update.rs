//! `board update`, `board sign` and `board boot-sector`.

use super::connection::{LineArguments, as_ours};
use crate::desk::{Desk, wrong};
use hysteron::Result;
use hysteron_client::image::{FirmwareImage, boot_sector, key_bytes};
use hysteron_client::update::{UpdateStage, bring, install};
use hysteron_core::firmware_update::{UpdateKey, text};
use std::path::Path;

/// Says how far it is; a stage that goes on says nothing anew.
fn report() -> impl FnMut(UpdateStage) {
    let mut last = None;
    move |stage| {
        let tenths = match stage {
            UpdateStage::Sent { bytes, of } => 10 * bytes / of.max(1),
            _ => 0,
        };
        let line = match stage {
            UpdateStage::Erasing => "erasing".to_string(),
            UpdateStage::Sent { .. } => format!("sent {} %", 10 * tenths),
            UpdateStage::Verifying => "comparing the authentication code".to_string(),
            UpdateStage::Installing => {
                "restarting: the board installs the image, which takes up to half a minute"
                    .to_string()
            }
            UpdateStage::Trial => {
                "the image runs; waiting for its first healthy second".to_string()
            }
        };
        if last.as_ref() != Some(&line) {
            println!("  {line}");
            last = Some(line);
        }
    }
}

fn firmware(image: &Path) -> Result<FirmwareImage> {
    const EXPECTED: &str = "the image of a NUCLEO-H743ZI2 that `cargo xtask firmware` builds";
    let bytes = Desk::new(false).bytes(image, EXPECTED)?;
    FirmwareImage::from_elf(&bytes)
        .map_err(|what| wrong(image, format!("{what}; expected {EXPECTED}")))
}

fn key(desk: &Desk, file: &Path) -> Result<UpdateKey> {
    const EXPECTED: &str = "32 hexadecimal digits, as `openssl rand -hex 16` makes them";
    let bytes = desk.bytes(file, EXPECTED)?;
    let key = std::str::from_utf8(&bytes).ok().and_then(key_bytes);
    key.map(UpdateKey::new)
        .ok_or_else(|| wrong(file, format!("is no key: expected {EXPECTED}")))
}

/// Prints the authentication code of an image.
pub fn sign(image: &Path, key_file: &Path) -> Result<bool> {
    let code = firmware(image)?.signed(&key(&Desk::new(false), key_file)?);
    println!("{:032x}", u128::from_be_bytes(code));
    Ok(true)
}

/// Writes the boot stage's sector with a key.
pub fn write_boot_sector(stage: &Path, key_file: &Path, out: &Path, force: bool) -> Result<bool> {
    const EXPECTED: &str = "the boot stage that `cargo xtask firmware` builds";
    let desk = Desk::new(force);
    let (bytes, key) = (desk.bytes(stage, EXPECTED)?, key(&desk, key_file)?);
    desk.target(Some(out))?;
    let sector = boot_sector(&bytes, &key)
        .map_err(|what| wrong(stage, format!("{what}; expected {EXPECTED}")))?;
    desk.write(out, &sector)?;
    println!(
        "{}: next: probe-rs download --chip STM32H743ZITx --binary-format bin --base-address 0x08000000 {0}",
        out.display()
    );
    Ok(true)
}

/// Brings an image and restarts with it. What is no image of this board is refused before anything is sent.
pub fn update(image: &Path, code: &str, line: &LineArguments) -> Result<bool> {
    let firmware = firmware(image)?;
    let code = key_bytes(code).ok_or_else(|| {
        wrong(
            image,
            "--code is not the 32 hexadecimal digits that `board sign` prints",
        )
    })?;
    let header = &firmware.header;
    let (version, front_end) = (text(&header.version), text(&header.front_end));
    let kib = firmware.bytes.len().div_ceil(1024);
    println!(
        "{}: version {version}, {front_end}, {} Hz, {kib} KiB",
        image.display(),
        header.sample_rate_hz
    );
    let mut board = line.connect()?;
    println!("the board runs {}", board.identification);
    let mut report = report();
    bring(&mut board, &firmware, &code, &mut report).map_err(as_ours)?;
    let identification = install(&mut board, line.baud(), &mut report).map_err(as_ours)?;
    println!("the board runs {identification}; next: arm (ARM 1 1) and condition (ATZ 1)");
    Ok(true)
}
