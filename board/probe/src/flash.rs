//! `flash`: the image into the board's flash.

use crate::{Result, chip, image, whole};
use probe_rs::flashing::{DownloadOptions, ElfOptions, FlashProgress, ProgressEvent, ProgressOperation, download_file_with_options};
use std::path::Path;

/// Looks at the image, then at the chip, writes, and reads back what was written.
pub fn flash(path: &Path, dry_run: bool, selector: Option<&str>) -> Result<()> {
    let (image, _) = image::read(path)?;
    let kib = image.flash_bytes.div_ceil(1024);
    println!("{}: {kib} KiB up to {:#010x}; the parameter blocks are not touched", path.display(), image.flash_end);
    if dry_run {
        return Ok(());
    }
    let mut session = chip::connect(selector)?;
    println!("the board is reset, so that its drive goes to rest, and stands still until the image has been written");
    let mut options = DownloadOptions::default();
    options.verify = true;
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
    download_file_with_options(&mut session, path, probe_rs::flashing::ElfLoader(ElfOptions::default()), options)
        .map_err(|error| format!("the image was not written whole: {}; the board may have none now, flash it again", whole(&error)))?;
    let mut core = session.core(0).map_err(|error| whole(&error))?;
    core.reset().map_err(|error| format!("the image was written, but the board did not restart: {}", whole(&error)))?;
    println!("written, read back and the same; the board has restarted and rests");
    Ok(())
}
