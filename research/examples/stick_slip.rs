//! A stepping drive on rigs that differ from its model: moves, saw-teeth without feedback, velocities. Prints
//! the tables of `docs/results/stick_slip.md`.
//!
//!     cargo run --release -p hysteron-research --example stick_slip

use hysteron::statistics::extremes;
use hysteron_research::stick_slip_study::{
    Equations, closed_move, followed_um_s, open_loop_error_um, thesis_design,
};
use hysteron_tests::lugre_rig::RigFactors;

/// The least and the most of a figure over the rigs.
fn range(figures: &[f64], digits: usize) -> String {
    let (least, most) = extremes(figures);
    format!("{least:.digits$} to {most:.digits$}")
}

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
        "| equations | target, mm | arrived | time, s | teeth | largest error, nm | swing, nm | saw-teeth without feedback, um |"
    );
    println!("|---|---|---|---|---|---|---|---|");
    for equations in [Equations::Chapter3, Equations::Lugre] {
        for target_um in [100.0, 1000.0, 10_000.0] {
            let mut columns: [Vec<f64>; 5] = Default::default();
            let mut arrived = 0;
            for factors in RigFactors::FIVE {
                let figures = closed_move(&design, equations, factors, target_um)?;
                arrived += usize::from(figures.arrived_s.is_some() && figures.fault.is_none());
                let row = [
                    figures.arrived_s.unwrap_or(f64::INFINITY),
                    f64::from(figures.teeth),
                    1e3 * figures.error_max_um,
                    1e3 * figures.swing_um,
                    open_loop_error_um(&design, equations, factors, target_um),
                ];
                columns
                    .iter_mut()
                    .zip(row)
                    .for_each(|(column, figure)| column.push(figure));
            }
            let [time, teeth, error, swing, open] = &columns;
            println!(
                "| {} | {} | {arrived} of 5 | {} | {} | {} | {} | {} |",
                equations.name(),
                1e-3 * target_um,
                range(time, 2),
                range(teeth, 0),
                range(error, 1),
                range(swing, 1),
                range(open, 1)
            );
        }
    }
    println!("\n| equations | asked for, um/s | average velocity, um/s |\n|---|---|---|");
    for equations in [Equations::Chapter3, Equations::Lugre] {
        for velocity_um_s in [100.0, -400.0] {
            let found: Result<Vec<f64>, String> = RigFactors::FIVE
                .into_iter()
                .map(|factors| followed_um_s(&design, equations, factors, velocity_um_s))
                .collect();
            println!(
                "| {} | {velocity_um_s:.0} | {} |",
                equations.name(),
                range(&found?, 1)
            );
        }
    }
    Ok(())
}
