//! `board update`.

use super::{LineArguments, of_board};
use crate::desk::{Desk, wrong};
use hysteron::Result;
use hysteron_client::image::FirmwareImage;
use hysteron_client::update::{UpdateStage, bring, install};
use hysteron_core::firmware_update::text;
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
            UpdateStage::Verifying => "comparing the checksum".to_string(),
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

/// Brings an image and restarts with it. What is no image of this board is refused before anything is sent.
pub fn update(image: &Path, line: &LineArguments) -> Result<bool> {
    const EXPECTED: &str = "the image of a NUCLEO-H743ZI2 that `cargo xtask firmware` builds";
    let bytes = Desk::new(false).bytes(image, EXPECTED)?;
    let firmware = FirmwareImage::from_elf(&bytes)
        .map_err(|what| wrong(image, format!("{what}; expected {EXPECTED}")))?;
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
    bring(&mut board, &firmware, firmware.checksum, &mut report).map_err(of_board)?;
    let identification = install(&mut board, line.baud(), &mut report).map_err(of_board)?;
    println!("the board runs {identification}; next: arm (ARM 1 1) and condition (ATZ 1)");
    Ok(true)
}
