//! `drives`.

use crate::desk::Desk;
use hysteron::synthetic::drives::{DriveOfRecord, manifest, recommended_drives};
use hysteron::{Error, Result};
use std::fmt::Write;
use std::path::Path;

/// Drives beyond this are a mistake, V.
const LARGEST_V: f64 = 2000.0;

/// `hysteron drives --drive-max-v 70 --out DIR`: what to play while recording, and the manifest for the
/// recordings.
pub fn drives(low_v: f64, high_v: f64, out: &Path, force: bool) -> Result<bool> {
    let sensible = low_v.abs() <= LARGEST_V && high_v.abs() <= LARGEST_V && low_v < high_v;
    if !sensible {
        return Err(Error::new(
            "--drive-min-v, --drive-max-v",
            format!(
                "{low_v} and {high_v}; expected the first below the second, within +-{LARGEST_V} V"
            ),
        ));
    }
    let drives = recommended_drives(low_v, high_v);
    let desk = Desk::new(force);
    let mut names: Vec<String> = drives
        .iter()
        .map(|drive| format!("drive_{}.csv", drive.name))
        .collect();
    names.push("dataset.toml".into());
    desk.folder(out, &names)?;
    for (drive, name) in drives.iter().zip(&names) {
        desk.write(&out.join(name), csv(drive).as_bytes())?;
    }
    desk.write(
        &out.join("dataset.toml"),
        manifest("my_stage", low_v, high_v, &drives).as_bytes(),
    )?;
    for drive in &drives {
        let seconds = drive.drive_v.len() as f64 / drive.rate_hz;
        println!(
            "  drive_{}.csv: {seconds:.1} s at {:.0} Hz, {}",
            drive.name, drive.rate_hz, drive.role
        );
    }
    println!(
        "Play each and record time, drive and displacement as NAME.csv beside dataset.toml (stair.csv, ...), then: hysteron explain {}",
        out.display()
    );
    Ok(true)
}

fn csv(drive: &DriveOfRecord) -> String {
    drive
        .drive_v
        .iter()
        .enumerate()
        .fold(String::from("t_s,u_v\n"), |mut text, (k, u)| {
            // Writing to a string cannot fail.
            let _ = writeln!(text, "{:.6},{u:.5}", k as f64 / drive.rate_hz);
            text
        })
}
