//! One piezo behind a voltage and behind a charge amplifier: how wide its loops are, and how far it sinks back
//! while the drive is held.
//!
//! ```text
//! cargo run --release -p hysteron-sim --example charge_drive -- [--csv FILE]
//! ```
//!
//! The piezo is the electromechanical model of the thesis (Ch. 2, Eqs. 6-11) with the values of
//! [`Electromechanical::stack`]. The insulation is varied.

use hysteron_sim::electromechanical::{Drive, Electromechanical, ElectromechanicalState};
use std::fmt::Write as _;

const DT_S: f64 = 1e-3;
/// Samples of half a cycle, and of the hold behind it: 10 s.
const HALF: u32 = 500;
const HOLD: u32 = 10_000;

/// Travel in m, and in per cent of it: the opening of the loop at half of the way and what is lost in the hold.
fn cycle(model: &Electromechanical, drive: impl Fn(f64) -> Drive) -> [f64; 3] {
    let mut state = ElectromechanicalState::virgin(model);
    let mut ramp = |from: f64, to: f64, samples: u32| -> Vec<f64> {
        let along = |k: u32| from + (to - from) * f64::from(k) / f64::from(samples);
        (1..=samples)
            .map(|k| state.step(drive(along(k)), 0.0, DT_S))
            .collect()
    };
    ramp(0.0, 1.0, HALF);
    let (down, up) = (ramp(1.0, 0.0, HALF), ramp(0.0, 1.0, HALF));
    let held = ramp(1.0, 1.0, HOLD);
    let (top, middle) = (HALF as usize - 1, HALF as usize / 2 - 1);
    let travel_m = up[top] - down[top];
    [
        travel_m,
        100.0 * (down[middle] - up[middle]).abs() / travel_m,
        100.0 * (up[top] - held[HOLD as usize - 1]) / travel_m,
    ]
}

fn main() -> Result<(), String> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let csv = match arguments.as_slice() {
        [] => None,
        [option, file] if option == "--csv" => Some(file),
        _ => return Err("expected nothing, or --csv FILE".into()),
    };
    let mut table = String::from("amplifier,insulation_ohm,travel_um,loop_pct,sinks_in_10_s_pct\n");
    for leakage_ohm in [1e9, 1e8, 1e7] {
        let model = Electromechanical::stack(leakage_ohm);
        let rows = [
            (
                "voltage",
                cycle(&model, |share| Drive::Voltage(100.0 * share)),
            ),
            (
                "charge",
                cycle(&model, |share| Drive::Charge(1.5e-4 * share)),
            ),
        ];
        for (amplifier, [travel_m, loop_pct, sinks_pct]) in rows {
            let _ = writeln!(
                table,
                "{amplifier},{leakage_ohm:.0e},{:.2},{loop_pct:.3},{sinks_pct:.2}",
                1e6 * travel_m
            );
        }
    }
    print!("{table}");
    csv.map_or(Ok(()), |file| {
        std::fs::write(file, &table).map_err(|error| format!("{file}: {error}"))
    })
}
