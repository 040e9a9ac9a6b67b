//! Hidden effects of stick-slip rigs, by two sets of equations. Prints a row for each case; with a file, writes
//! how many of each effect have which mark (`benchmarks/results/rig_diagnosis.csv`).
//!
//!     cargo run --release -p hysteron-research --example rig_diagnosis -- 1 21 benchmarks/results/rig_diagnosis.csv chapter
//!
//! The numbers are seeds of each effect and the first one, the last word one of the two sets (`chapter`, `LuGre`).

use hysteron_research::rig_diagnosis_study::ModelledRig;
use hysteron_research::stages_asked_for;
use hysteron_research::stick_slip_study::Equations;
use hysteron_sim::rig_effects::RIG_EFFECTS;

/// Rigs with nothing missing.
const NOTHING: u64 = 40;
const MARKS: [&str; 4] = ["right", "in set", "missed", "wrong"];

fn main() -> Result<(), String> {
    let seeds = stages_asked_for();
    let only = std::env::args().nth(4).unwrap_or_default();
    let mut table = vec![format!(
        "equations,effect,cases,{},most left times noise",
        MARKS.join(",")
    )];
    println!("{}", ModelledRig::COLUMNS);
    for equations in [Equations::Chapter3, Equations::Lugre] {
        if !equations.name().contains(&only) {
            continue;
        }
        let rigs = (0..5).map(|nth| ModelledRig::identified(equations, nth));
        let rigs = rigs.collect::<Result<Vec<_>, _>>()?;
        for (nth, [error_um, way_um]) in
            rigs.iter().map(ModelledRig::saw_tooth_error_um).enumerate()
        {
            println!(
                "{}, rig {nth}: saw-teeth of 30, 50 and 60 V at 60 Hz are missed by {error_um:.4} of {way_um:.1} um",
                equations.name()
            );
        }
        for effect in (0..RIG_EFFECTS.len()).map(Some).chain([None]) {
            let seeds = effect.map_or(1000..1000 + NOTHING, |_| seeds.clone());
            let (mut counts, mut most_left) = ([0; MARKS.len()], 0.0_f64);
            for seed in seeds.clone() {
                let (row, mark, times_noise) =
                    rigs[seed as usize % rigs.len()].row(effect, seed)?;
                println!("{row}");
                (counts.iter_mut().zip(MARKS)).for_each(|(n, name)| *n += u64::from(name == mark));
                most_left = most_left.max(times_noise);
            }
            let counts = counts.map(|count| count.to_string()).join(",");
            let id = effect.map_or("nothing", |nth| RIG_EFFECTS[nth].id);
            let cases = seeds.end - seeds.start;
            let row = format!("{},{id},{cases},{counts}", equations.name());
            table.push(format!("{row},{most_left:.1}"));
        }
    }
    match std::env::args().nth(3) {
        Some(path) => {
            std::fs::write(&path, table.join("\n") + "\n").map_err(|e| format!("{path}: {e}"))
        }
        None => Ok(()),
    }
}
