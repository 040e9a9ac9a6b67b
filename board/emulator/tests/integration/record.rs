//! The target plays a drive on an actuator that it has never moved and its log is kept: `cargo xtask check`
//! makes a data set of it and identifies the actuator, with no record from anywhere else.

use crate::common;

use std::path::Path;

use common::{block, image, parameters, run_on, samples};
use hysteron::capture::capture;
use hysteron_emulator::converters::World;
use hysteron_emulator::run::{MILLISECOND, Script};
use hysteron_sim::bench::{Bench, Variant};

#[test]
fn a_drive_is_played_and_its_log_kept() {
    let bench = Bench::reference().expect("the bench");
    let world = World::new(&bench, Variant::PLAIN, 11).shared();
    let parameters = parameters();
    let commands = "arm untested\nidentify 44000\n";
    let script = Script {
        block: Some(block(&parameters)),
        commands: vec![(3 * MILLISECOND, commands.as_bytes().to_vec())],
        ..Script::listening(2_600 * MILLISECOND)
    };
    let outcome = run_on(&world, script);
    let (samples, lost) = samples(&outcome);
    assert_eq!((lost, outcome.malformed), (0, 0));
    assert!(
        samples.len() > 50_000 && samples.iter().all(|sample| sample.flags < 2),
        "rest and playing only"
    );
    // What the log says is what the converters saw.
    let world = world.lock().expect("the world");
    for pair in samples
        .windows(2)
        .filter(|pair| pair[1].tick == pair[0].tick + 1)
    {
        let (sensor, acting) = world.codes[pair[1].tick as usize];
        assert_eq!(
            (pair[1].adc_code, pair[0].dac_code),
            (sensor, acting),
            "tick {}",
            pair[1].tick
        );
    }
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR"));
    std::fs::write(folder.join("record.rtt"), &outcome.raw).expect("written");
    println!(
        "{} bytes of log in {}",
        outcome.raw.len(),
        folder.join("record.rtt").display()
    );
}

/// The log of a board that is conditioned, every tick of it traced, and then plays a drive: one record from
/// before the conditioning to behind the drive.
#[test]
fn a_log_that_holds_the_conditioning_too_becomes_a_data_set() {
    let bench = Bench::reference().expect("the bench");
    let world = World::new(&bench, Variant::PLAIN, 12).shared();
    let script = Script {
        block: Some(block(&parameters())),
        // 0.1 s of cycle, the ramp, 1 s of rest.
        commands: vec![
            (10 * MILLISECOND, b"trace 31 1\n".to_vec()),
            (20 * MILLISECOND, b"arm untested\ncondition\n".to_vec()),
            (1_300 * MILLISECOND, b"identify 12000\n".to_vec()),
        ],
        ..Script::listening(2_200 * MILLISECOND)
    };
    let outcome = run_on(&world, script);
    let (summary, files) =
        capture(&std::fs::read(image()).expect("the image"), &outcome.raw).expect("a data set");
    assert_eq!(
        (summary.damaged, summary.lost_on_target),
        (0, 0),
        "{summary:?}"
    );
    let (run_file, _) = summary
        .records
        .iter()
        .max_by_key(|(_, samples)| samples)
        .expect("a record");
    let rows: Vec<(f64, f64)> = files
        .iter()
        .find(|(name, _)| name == run_file)
        .and_then(|(_, bytes)| std::str::from_utf8(bytes).ok())
        .expect("its file")
        .lines()
        .skip(1)
        .map(|line| {
            line.split(',')
                .map(|cell| cell.parse().expect("a number"))
                .collect::<Vec<f64>>()
        })
        .map(|cells| (cells[1], cells[2]))
        .collect();

    // 0.012 s before the conditioning, 1.1 s of it, and all until behind the drive, tick for tick what the
    // converters saw.
    let (samples, _) = samples(&outcome);
    let first = samples
        .windows(2)
        .find(|pair| pair[1].tick == pair[0].tick + 1)
        .expect("the full rate")[0]
        .tick as usize;
    let (world, scale) = (world.lock().expect("the world"), bench.converter_scale());
    assert!(
        first < 400 && rows.len() > 40_000,
        "{} rows from tick {first}",
        rows.len()
    );
    for (nth, (drive_v, position_um)) in rows.iter().enumerate() {
        let (sensor, acting) = world.codes[first + 1 + nth];
        assert!(
            (drive_v - scale.drive_v(acting)).abs() < 1e-5,
            "row {nth}: {drive_v} V, code {acting}"
        );
        assert!(
            (position_um - scale.position_um(sensor)).abs() < 1e-5,
            "row {nth}: {position_um} um, code {sensor}"
        );
    }
    let peaks = |rows: &[(f64, f64)]| {
        rows.iter()
            .fold(0.0, |most: f64, (drive_v, _)| most.max(*drive_v))
    };
    let (conditioning, drive) = rows.split_at(25_000);
    assert!(
        peaks(conditioning) > 79.9 && peaks(drive) > 70.0,
        "{} V, then {} V",
        peaks(conditioning),
        peaks(drive)
    );
}
