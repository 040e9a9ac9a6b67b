//! A stepping drive on rigs that differ from its model: moves, saw-teeth without feedback, velocities. Prints
//! the tables of `docs/results/stick_slip.md`.
//!
//!     cargo run --release -p hysteron-research --example stick_slip

use hysteron::statistics::extremes;
use hysteron_research::published_stepping::PublishedStepping;
use hysteron_research::stick_slip_study::{
    Equations, WITHIN_S, closed_move, followed_um_s, open_loop_error_um, thesis_design, thesis_rig,
};
use hysteron_sim::stepping_loop::MoveFigures;
use hysteron_tests::lugre_rig::RigFactors;

/// The least and the most of a figure over the rigs.
fn range(figures: &[f64], digits: usize) -> String {
    let (least, most) = extremes(figures);
    format!("{least:.digits$} to {most:.digits$}")
}

/// What moves came to, as columns.
fn moves(all: &[MoveFigures]) -> String {
    let arrived = |m: &&MoveFigures| m.arrived_s.is_some() && m.fault.is_none();
    let column = |figure: fn(&MoveFigures) -> f64, digits| {
        let figures: Vec<f64> = all.iter().filter(arrived).map(figure).collect();
        range(&figures, digits)
    };
    format!(
        "{} of {} | {} | {} | {} | {}",
        all.iter().filter(arrived).count(),
        all.len(),
        column(|m| m.arrived_s.unwrap_or(f64::INFINITY), 2),
        column(|m| f64::from(m.teeth), 0),
        column(|m| 1e3 * m.error_max_um, 1),
        column(|m| 1e3 * m.swing_um, 1)
    )
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
    let published = PublishedStepping::tuned(&thesis_rig(), &design);
    println!("The published controller: {published:?}\n");
    println!(
        "| equations | target, mm | controller | arrived | time, s | teeth | largest error, nm | swing, nm | saw-teeth without feedback, um |"
    );
    println!("|---|---|---|---|---|---|---|---|---|");
    for equations in [Equations::Chapter3, Equations::Lugre] {
        for target_um in [100.0, 1000.0, 10_000.0] {
            let (mut ours, mut theirs, mut open) = (Vec::new(), Vec::new(), Vec::new());
            for factors in RigFactors::FIVE {
                ours.push(closed_move(&design, equations, factors, target_um)?);
                theirs.push(published.closed_move(equations, factors, target_um, WITHIN_S));
                open.push(open_loop_error_um(&design, equations, factors, target_um));
            }
            let place = format!("{} | {}", equations.name(), 1e-3 * target_um);
            println!(
                "| {place} | ours | {} | {} |",
                moves(&ours),
                range(&open, 1)
            );
            println!("| {place} | published | {} | |", moves(&theirs));
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
