//! `flash`: the boot stage and the image into the board's flash.

use crate::failure::{Result, whole};
use crate::{chip, image};
use probe_rs::Session;
use probe_rs::flashing::{
    DownloadOptions, ElfOptions, FlashProgress, ProgressEvent, ProgressOperation,
    download_file_with_options,
};
use std::path::{Path, PathBuf};

/// Which boot stage goes with the image.
pub enum BootStage {
    /// The file beside the image.
    Beside,
    /// This file.
    File(PathBuf),
    /// The board has one.
    Kept,
}

/// Names of the boot stage as it is built and as it is published.
const BOOT_STAGES: [&str; 2] = ["hysteron-boot-stage", "hysteron-boot-stage.elf"];

impl BootStage {
    /// The file to be written, if any.
    fn file(self, image: &Path) -> Result<Option<PathBuf>> {
        match self {
            Self::Kept => Ok(None),
            Self::File(file) => Ok(Some(file)),
            Self::Beside => {
                let found = BOOT_STAGES
                    .map(|name| image.with_file_name(name))
                    .into_iter()
                    .find(|file| file.is_file());
                found.map(Some).ok_or_else(|| {
                    let place = image.with_file_name(BOOT_STAGES[0]);
                    format!(
                        "{}: is not there; no image starts without the boot stage. Name it with --boot-stage, or say --keep-boot-stage \
                         where the board has one",
                        place.display()
                    )
                })
            }
        }
    }
}

/// Looks at boot stage and image, then at the chip, writes, and reads back what was written.
pub fn flash(
    path: &Path,
    boot_stage: BootStage,
    dry_run: bool,
    selector: Option<&str>,
) -> Result<()> {
    let (image, _) = image::read(path)?;
    let boot_stage = boot_stage.file(path)?;
    if let Some(file) = &boot_stage {
        let bytes = image::read_boot_stage(file)?;
        println!(
            "{}: {} KiB, the boot stage",
            file.display(),
            bytes.div_ceil(1024)
        );
    }
    let kib = image.flash_bytes.div_ceil(1024);
    println!(
        "{}: {kib} KiB up to {:#010x}; the parameter blocks are not touched",
        path.display(),
        image.flash_end
    );
    if dry_run {
        return Ok(());
    }
    let mut session = chip::connect(selector)?;
    println!(
        "the board is reset, so that its drive goes to rest, and stands still until the image has been written"
    );
    if let Some(file) = &boot_stage {
        // Its sector ends with the key for updates, which stays.
        write(&mut session, file, true)?;
    }
    write(&mut session, path, false)?;
    let mut core = session.core(0).map_err(|error| whole(&error))?;
    core.reset().map_err(|error| {
        format!(
            "the image was written, but the board did not restart: {}",
            whole(&error)
        )
    })?;
    println!("written, read back and the same; the board has restarted and rests");
    Ok(())
}

fn write(session: &mut Session, file: &Path, keeps_the_rest: bool) -> Result<()> {
    let mut options = DownloadOptions::default();
    options.verify = true;
    options.keep_unwritten_bytes = keeps_the_rest;
    options.progress = FlashProgress::new(|event| {
        if let ProgressEvent::Started(operation) = event {
            let what = match operation {
                ProgressOperation::Erase => "erasing",
                ProgressOperation::Program => "writing",
                ProgressOperation::Verify => "reading back",
                _ => return,
            };
            println!("  {what}");
        }
    });
    download_file_with_options(
        session,
        file,
        probe_rs::flashing::ElfLoader(ElfOptions::default()),
        options,
    )
    .map_err(|error| {
        format!(
            "{} was not written whole: {}; the board may not start now, flash it again",
            file.display(),
            whole(&error)
        )
    })
}
