//! A stepping drive that is designed on the thesis' rig, at work on rigs that differ from it by 30 % and follow
//! other equations, beside saw-teeth without feedback.

use hysteron::servo::stepping_design::{SteppingDesign, SteppingOrder};
use hysteron_sim::closed_loop::Plant;
use hysteron_sim::stepping_loop::{MoveFigures, SteppingLoop};
use hysteron_sim::stick_slip::{StickSlipActuator, StickSlipPlant};
use hysteron_tests::lugre_rig::{LugreRig, RigFactors};

/// Time behind an arrival in which the slider is watched, s.
pub const WATCHED_S: f64 = 0.1;
/// Longest move, s.
pub const WITHIN_S: f64 = 120.0;
/// Mass of the thesis' slider, kg.
pub const MASS_KG: f64 = 0.0635;

/// The equations of a rig.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Equations {
    /// Chapter 3: polynomial surfaces and elastoplastic friction.
    Chapter3,
    /// Play operators and LuGre's friction.
    Lugre,
}

impl Equations {
    /// For a table.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Chapter3 => "chapter 3",
            Self::Lugre => "LuGre",
        }
    }
}

/// The rig of the thesis.
#[must_use]
pub fn thesis_rig() -> StickSlipActuator {
    StickSlipActuator::thesis(MASS_KG)
}

/// The design for the thesis' rig.
///
/// # Errors
/// As [`SteppingDesign::new`].
pub fn thesis_design() -> Result<SteppingDesign, String> {
    SteppingDesign::new(&thesis_rig(), &SteppingOrder::default())
}

/// The thesis' rig with other friction, mass, preload and loops.
#[must_use]
pub fn chapter_3(factors: RigFactors) -> StickSlipActuator {
    let mut rig = thesis_rig();
    rig.end_effector_mass_kg *= factors.mass;
    rig.friction.coulomb_force_n *= factors.friction * factors.preload;
    rig.friction.stiffness_n_um *= factors.preload;
    // A straight drive over the same range takes what the loops leave.
    let range_um = rig.hysteresis.initial_ascending_curve(1.0);
    let straight = 1.0 - factors.hysteresis;
    let surface = &mut rig.hysteresis.g;
    surface
        .iter_mut()
        .flatten()
        .for_each(|c| *c *= factors.hysteresis);
    surface[1][0] += straight * range_um;
    surface[0][1] -= straight * range_um;
    rig
}

/// A rig at rest.
#[must_use]
pub fn rig(equations: Equations, factors: RigFactors, period_s: f64) -> Box<dyn Plant> {
    match equations {
        Equations::Chapter3 => Box::new(StickSlipPlant::at_rest(chapter_3(factors), period_s)),
        Equations::Lugre => Box::new(LugreRig::at_rest(factors, period_s)),
    }
}

/// The design's loop around a rig.
///
/// # Errors
/// As [`SteppingDesign::block`].
pub fn closed(
    design: &SteppingDesign,
    equations: Equations,
    factors: RigFactors,
    seed: u64,
) -> Result<SteppingLoop<Box<dyn Plant>>, String> {
    let block = design.block().map_err(|error| error.to_string())?;
    let rig = rig(equations, factors, design.order.front_end.period_s());
    Ok(SteppingLoop::new(
        rig,
        &block,
        (design.order.noise_um, seed),
    ))
}

/// A move from rest at zero.
///
/// # Errors
/// As [`closed`]; the move is refused.
pub fn closed_move(
    design: &SteppingDesign,
    equations: Equations,
    factors: RigFactors,
    target_um: f64,
) -> Result<MoveFigures, String> {
    closed(design, equations, factors, 11)?
        .move_to(target_um, WITHIN_S, WATCHED_S)
        .map_err(|refusal| format!("{refusal:?}"))
}

/// Error of so many teeth as the model needs for the target, played without feedback, um.
#[must_use]
pub fn open_loop_error_um(
    design: &SteppingDesign,
    equations: Equations,
    factors: RigFactors,
    target_um: f64,
) -> f64 {
    let period_s = design.order.front_end.period_s();
    let mut plant = rig(equations, factors, period_s);
    let teeth = (target_um / design.tooth.step_um).round() as usize;
    for drive_v in design.tooth.drive_v(period_s, teeth) {
        plant.advance(drive_v, 0.0);
    }
    let rest = (WATCHED_S / period_s) as usize;
    (0..rest).for_each(|_| plant.advance(design.tooth.ends_v[0], 0.0));
    plant.displacement_um() - target_um
}

/// Time over which a velocity is averaged behind its first second, s: many teeth at every velocity.
const AVERAGED_S: f64 = 4.0;

/// Average velocity under a velocity that is asked for, um/s.
///
/// # Errors
/// As [`closed`]; the velocity is refused.
pub fn followed_um_s(
    design: &SteppingDesign,
    equations: Equations,
    factors: RigFactors,
    velocity_um_s: f64,
) -> Result<f64, String> {
    let position_um = closed(design, equations, factors, 12)?
        .follow(
            design.order.travel_um[usize::from(velocity_um_s > 0.0)],
            velocity_um_s,
            1.0 + AVERAGED_S,
        )
        .map_err(|refusal| format!("{refusal:?}"))?;
    let (last, from) = (
        position_um.len() - 1,
        (1.0 / design.order.front_end.period_s()) as usize,
    );
    Ok((position_um[last] - position_um[from])
        / ((last - from) as f64 * design.order.front_end.period_s()))
}
