//! `board record`: drives that the board plays, as a data set.

use super::connection::{LineArguments, WiringArguments, as_ours};
use crate::desk::Desk;
use crate::screen::as_argument;
use hysteron::servo::amplifier_block::{block, wiring_parameters};
use hysteron::synthetic::drives::{DriveOfRecord, board_drives, manifest};
use hysteron::{Error, Result};
use hysteron_client::board::Board;
use hysteron_client::condition::Condition;
use hysteron_client::playing::{Recorded, Wave, listen, play};
use hysteron_client::scale::Scale;
use std::path::Path;

/// Conditions, plays, writes.
pub fn record(
    out: &Path,
    wiring: &WiringArguments,
    line: &LineArguments,
    force: bool,
) -> Result<bool> {
    let desk = Desk::new(force);
    let front_end = wiring.front_end(&desk)?;
    if wiring.drive_max_v.is_some() {
        wiring.limits_v()?;
    }
    // Their names do not depend on the limits.
    desk.folder_to_be(out, &names(&board_drives(0.0, 1.0)))?;
    let mut board = line.connect()?;
    if Condition::ask(&mut board).map_err(as_ours)?.without_block() {
        let (low_v, high_v) = wiring.limits_v()?;
        bring_wiring(
            &mut board,
            &block(&wiring_parameters(&front_end, low_v, high_v)?)?,
            line,
        )?;
    }
    let scale = Scale::ask(&mut board).map_err(as_ours)?;
    let drives = board_drives(scale.drive_min_v, scale.drive_max_v);
    require_room(&scale, &drives)?;
    desk.make_folder(out)?;
    board.condition().map_err(as_ours)?;
    let records = play_all(&mut board, &drives)?;
    write(&desk, out, &scale, &drives, &records)?;
    println!(
        "next: hysteron explain {} --from hysteresis,vibration,creep --out model.toml",
        as_argument(out)
    );
    Ok(true)
}

/// Brings a block that knows the converters and no servo.
pub fn bring_wiring(board: &mut Board, block: &[u8], line: &LineArguments) -> Result<()> {
    hysteron_client::upload::upload(board, block, line.baud()).map_err(as_ours)?;
    println!("a block without a servo tells the board its converters and the limits of the drive");
    Ok(())
}

/// Whether the board has room for the drives, and for what it records of them.
pub fn require_room(scale: &Scale, drives: &[DriveOfRecord]) -> Result<()> {
    let (most_points, most_samples) = (scale.most_points, scale.most_samples);
    match drives
        .iter()
        .find(|drive| cycle_points(drive) > most_points || drive.drive_v.len() > most_samples)
    {
        None => Ok(()),
        Some(drive) => {
            let (name, points, samples) = (&drive.name, cycle_points(drive), drive.drive_v.len());
            let needed = format!(
                "{name} has {points} points and {samples} samples; the board has room for {most_points} and {most_samples}"
            );
            Err(Error::new(
                "board",
                format!(
                    "{needed}. Record over the debug probe instead (`identify`, firmware/README.md)"
                ),
            ))
        }
    }
}

/// Points of one cycle of a drive; one where it stays.
fn cycle_points(drive: &DriveOfRecord) -> usize {
    let all = drive.drive_v.len();
    if drive
        .drive_v
        .windows(2)
        .all(|pair| pair.first() == pair.last())
    {
        return 1;
    }
    drive
        .period_s
        .map_or(all, |(period_s, _)| {
            (period_s * drive.rate_hz).round() as usize
        })
        .clamp(1, all.max(1))
}

/// The files of a recording.
pub fn names(drives: &[DriveOfRecord]) -> Vec<String> {
    drives
        .iter()
        .map(|drive| format!("{}.csv", drive.name))
        .chain(["dataset.toml".to_string()])
        .collect()
}

/// Plays the drives one after the other from rest.
pub fn play_all(board: &mut Board, drives: &[DriveOfRecord]) -> Result<Vec<Recorded>> {
    // As the zero is now.
    let scale = Scale::ask(board).map_err(as_ours)?;
    let mut records = Vec::with_capacity(drives.len());
    for drive in drives {
        let seconds = drive.drive_v.len() as f64 / drive.rate_hz;
        println!(
            "  {}: {seconds:.1} s at {:.0} Hz, {}",
            drive.name, drive.rate_hz, drive.role
        );
        records.push(played(board, &scale, drive)?);
    }
    Ok(records)
}

fn played(board: &mut Board, scale: &Scale, drive: &DriveOfRecord) -> Result<Recorded> {
    let ticks_per_point = (scale.sample_rate_hz / drive.rate_hz).round().max(1.0) as u32;
    let Some(first) = drive.drive_v.first() else {
        return Ok(Recorded::default());
    };
    if drive.drive_v.iter().all(|v| v == first) {
        return listen(board, scale, ticks_per_point, drive.drive_v.len()).map_err(as_ours);
    }
    let all = drive.drive_v.len();
    let points = cycle_points(drive);
    // A limit in a block is a code, not a volt: half a step may be missing.
    let within = drive
        .drive_v
        .iter()
        .take(points)
        .map(|v| v.clamp(scale.drive_min_v + 1e-3, scale.drive_max_v - 1e-3));
    let wave = Wave {
        points: within.collect(),
        ticks_per_point,
        cycles: (all / points) as u32,
    };
    play(board, scale, &wave).map_err(as_ours)
}

/// Time, drive and position as CSV with their units, and the reference where there is one.
pub fn table(record: &Recorded, reference_um: Option<&[f64]>) -> String {
    let mut text = String::from(if reference_um.is_some() {
        "t_s,u_v,y_um,reference_um\n"
    } else {
        "t_s,u_v,y_um\n"
    });
    for (k, (u, y)) in record.drive_v.iter().zip(&record.position_um).enumerate() {
        text.push_str(&format!(
            "{:.6},{u:.7},{y:.7}",
            k as f64 / record.sample_rate_hz
        ));
        if let Some(reference) = reference_um.and_then(|reference| reference.get(k)) {
            text.push_str(&format!(",{reference:.7}"));
        }
        text.push('\n');
    }
    text
}

/// Writes a data set.
pub fn write(
    desk: &Desk,
    out: &Path,
    scale: &Scale,
    drives: &[DriveOfRecord],
    records: &[Recorded],
) -> Result<()> {
    for (drive, record) in drives.iter().zip(records) {
        let text = table(record, None);
        desk.write(&out.join(format!("{}.csv", drive.name)), text.as_bytes())?;
    }
    // What was played is on codes, which may lie a fraction of a step beyond the limits that were asked for.
    let lowest = records
        .iter()
        .flat_map(|record| &record.drive_v)
        .copied()
        .fold(scale.drive_min_v, f64::min);
    let highest = records
        .iter()
        .flat_map(|record| &record.drive_v)
        .copied()
        .fold(scale.drive_max_v, f64::max);
    let mut text = manifest("recorded by the board", lowest, highest, drives);
    let step = format!("sensor_lsb_um = {:?}\n", scale.sensor_step_um());
    let records_begin = text.find("\n[[record]]").unwrap_or(text.len());
    text.insert_str(records_begin, &step);
    desk.write(&out.join("dataset.toml"), text.as_bytes())?;
    println!("wrote {}", out.display());
    Ok(())
}
