//! A stepping drive on rigs that differ from its model: moves, saw-teeth without feedback, velocities. Prints
//! the tables of `docs/results/stick_slip.md`.
//!
//!     cargo run --release -p hysteron-research --example stick_slip

use hysteron_research::stick_slip_study::{
    Equations, closed_move, followed_um_s, open_loop_error_um, thesis_design,
};
use hysteron_tests::lugre_rig::RigFactors;

fn main() -> Result<(), String> {
    let design = thesis_design()?;
    let tooth = &design.tooth;
    println!(
        "Teeth: {:.0} to {:.0} V, slow {:.1} ms, fast {:.1} ms, curvature {}; on the model {:.2} um a tooth, {:.0} um/s\n",
        tooth.ends_v[0],
        tooth.ends_v[1],
        1e3 * tooth.slow_s,
        1e3 * tooth.fast_s,
        tooth.curvature,
        tooth.step_um,
        tooth.velocity_um_s()
    );
    println!(
        "| equations | rig | target, mm | time, s | teeth | mean error, nm | largest error, nm | swing, nm | saw-teeth without feedback, um |"
    );
    println!("|---|---|---|---|---|---|---|---|---|");
    let all = || {
        [Equations::Chapter3, Equations::Lugre]
            .into_iter()
            .flat_map(|equations| {
                (1..)
                    .zip(RigFactors::FIVE)
                    .map(move |(nth, f)| (equations, nth, f))
            })
    };
    for (equations, nth, factors) in all() {
        for target_um in [100.0, 1000.0, 10_000.0] {
            let figures = closed_move(&design, equations, factors, target_um)?;
            let time = match (figures.arrived_s, figures.fault) {
                (Some(time_s), None) => format!("{time_s:.2}"),
                (_, fault) => fault.unwrap_or("not arrived").to_owned(),
            };
            println!(
                "| {} | {nth} | {} | {time} | {} | {:.1} | {:.1} | {:.1} | {:.1} |",
                equations.name(),
                1e-3 * target_um,
                figures.teeth,
                1e3 * figures.error_um,
                1e3 * figures.error_max_um,
                1e3 * figures.swing_um,
                open_loop_error_um(&design, equations, factors, target_um)
            );
        }
    }
    println!("\n| equations | rig | asked for, um/s | average velocity, um/s |\n|---|---|---|---|");
    for (equations, nth, factors) in all() {
        for velocity_um_s in [100.0, -400.0] {
            let found = followed_um_s(&design, equations, factors, velocity_um_s)?;
            println!(
                "| {} | {nth} | {velocity_um_s:.0} | {found:.1} |",
                equations.name()
            );
        }
    }
    Ok(())
}
