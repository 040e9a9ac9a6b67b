//! A stepping drive on rigs that differ from its model by 30 % and follow other equations.

use hysteron_research::published_stepping::PublishedStepping;
use hysteron_research::stick_slip_study::{
    Equations, closed_move, followed_um_s, open_loop_error_um, thesis_design, thesis_rig,
};
use hysteron_tests::lugre_rig::RigFactors;

/// What is asked of every move, um.
const WITHIN_UM: f64 = 0.05;

/// Moves every rig to a target, and plays as many teeth without feedback as the model needs.
fn every_rig_reaches(target_um: f64) {
    let design = thesis_design().unwrap();
    let mut open_um = 0.0_f64;
    for equations in [Equations::Chapter3, Equations::Lugre] {
        for (nth, factors) in RigFactors::FIVE.into_iter().enumerate() {
            let figures = closed_move(&design, equations, factors, target_um).unwrap();
            let why = format!("{equations:?}, rig {nth}: {figures:?}");
            assert!(figures.arrived_s.is_some(), "{why}");
            assert!(figures.error_max_um < WITHIN_UM, "{why}");
            assert_eq!(figures.counters.saturated_values, 0, "{why}");
            open_um = open_um.max(open_loop_error_um(&design, equations, factors, target_um).abs());
        }
    }
    assert!(open_um > 0.3 * target_um, "saw-teeth alone: {open_um} um");
}

#[test]
fn a_tenth_of_a_millimetre_is_reached_on_every_rig() {
    every_rig_reaches(100.0);
}

#[test]
fn a_velocity_is_kept_on_rigs_of_other_equations() {
    let design = thesis_design().unwrap();
    for nth in [1, 4] {
        let found = followed_um_s(&design, Equations::Lugre, RigFactors::FIVE[nth], 100.0).unwrap();
        assert!((found - 100.0).abs() < 5.0, "{found} um/s");
    }
}

#[test]
fn the_published_controller_reaches_a_tenth_of_a_millimetre() {
    let design = thesis_design().unwrap();
    let published = PublishedStepping::tuned(&thesis_rig(), &design);
    for factors in [RigFactors::FIVE[1], RigFactors::FIVE[3]] {
        let figures = published.closed_move(Equations::Lugre, factors, 100.0, 2.0);
        assert!(figures.arrived_s.is_some(), "{figures:?}");
        assert!(figures.error_max_um < WITHIN_UM, "{figures:?}");
    }
}

mod long {
    use super::*;
    use hysteron::rig_diagnosis::planted::NOISE_UM;
    use hysteron_research::rig_diagnosis_study::ModelledRig;
    use hysteron_sim::rig_effects::RigEffects;

    #[test]
    #[ignore = "100 s of processor: cargo xtask full"]
    fn a_lugre_rig_is_modelled_to_its_noise() {
        let rig = ModelledRig::identified(Equations::Lugre, 3).unwrap();
        let (friction, effects) = (rig.start.friction, rig.start.effects);
        println!("{friction:?} {effects:?}");
        assert_eq!(friction.breakaway_ratio, None);
        // What stands in `lugre_rig`, with this rig's factors.
        for (found, truth, share) in [
            (friction.coulomb_force_n, 0.036 * 1.3 * 0.7, 0.03),
            (friction.stiffness_n_um, 0.5 * 0.7, 0.03),
            (effects.stribeck_share, 0.043 / 0.036 - 1.0, 0.1),
            (effects.stribeck_velocity_um_s, 400.0, 0.1),
            (effects.contact_viscosity_n_s_um, 1e-6, 0.1),
        ] {
            assert!((found / truth - 1.0).abs() < share, "{found} {truth}");
        }
        let unaltered = rig.dataset(&RigEffects::default(), 77).unwrap();
        let found = rig.diagnosed(&unaltered).unwrap();
        let left_um = found.residual_rms_after_um.validate.unwrap();
        assert!(found.findings.is_empty(), "{}", found.sentence);
        assert!(left_um < 1.5 * NOISE_UM, "{left_um}");
    }

    #[test]
    #[ignore = "10 s of processor: cargo xtask full"]
    fn ten_millimetres_are_reached_on_every_rig() {
        every_rig_reaches(10_000.0);
    }
}
