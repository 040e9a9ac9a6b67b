//! Planted sets: made, diagnosed and scored as a user would.

use hysteron::dataset::reading::from_manifest;
use hysteron::synthetic::case::simulate_case;
use hysteron::synthetic::case_set::SetOrder;
use hysteron::synthetic::score::{SetScore, score_case, summarise};

/// Simulates one case for each list of hidden effects and scores them.
fn planted(hidden: &[&[&str]], strength: f64, hysteresis: &str, seed: u64) -> SetScore {
    let order = SetOrder {
        hidden: hidden
            .iter()
            .map(|ids| ids.iter().map(|id| (*id).to_string()).collect())
            .collect(),
        strengths: vec![strength],
        cases: 1,
        hysteresis: hysteresis.into(),
        seed,
    };
    let scored = order.cases().into_iter().map(|(name, one)| {
        let case = simulate_case(&one, &name).unwrap();
        let manifest = String::from_utf8(case.files["dataset.toml"].clone()).unwrap();
        score_case(
            &from_manifest(&manifest, &name, &case.files).unwrap(),
            &case.truth,
        )
        .unwrap()
    });
    summarise(scored.collect())
}

#[test]
fn planted_effects_are_named_and_nothing_is_named_where_nothing_is_missing() {
    let hidden = [
        &["delay"][..],
        &["mains_hum"],
        &["quantisation"],
        &["creep", "saturation"],
        &[],
        &["outside_library_gain_flutter"],
    ];
    let score = planted(&hidden, 2.0, "hysteresis", 41);
    assert_eq!(score.cases.len(), 6);
    for case in &score.cases {
        assert!(case.right_in_set && !case.false_discovery, "{case:?}");
        assert!(
            case.hidden.starts_with("outside") || case.validate_over_noise <= 1.15,
            "{case:?}"
        );
    }
}

/// A sensor's lag imitates a delay and a second mode together better than either of them does alone.
#[test]
fn two_effects_that_imitate_a_third_are_told_from_it() {
    let score = planted(
        &[&["delay", "second_mode"], &["delay", "friction"]],
        2.0,
        "hysteresis",
        1300,
    );
    for case in &score.cases {
        assert!(
            case.right_first && !case.false_discovery && case.validate_over_noise <= 1.15,
            "{case:?}"
        );
    }
}

/// Loops of another structure than the fitted surfaces, with kinks that polynomials follow slowly, are no
/// missing effect.
#[test]
fn another_structure_of_loops_is_no_missing_effect() {
    let score = planted(&[&["creep"]], 3.0, "prandtl_ishlinskii", 503);
    assert_eq!(score.cases[0].named, ["creep"], "{:?}", score.cases);
    assert!(
        score.cases[0].validate_over_noise <= 1.15,
        "{:?}",
        score.cases
    );
}

/// Loops that no surface comes near (Bouc and Wen's saturate) are found as what they are, so that what is
/// missing beside them shows.
#[test]
fn a_delay_shows_beside_loops_that_surfaces_do_not_meet() {
    let score = planted(&[&["delay"]], 2.0, "bouc_wen", 5000);
    assert!(
        score.cases[0].right_in_set && !score.cases[0].false_discovery,
        "{:?}",
        score.cases
    );
    assert!(
        score.cases[0].validate_over_noise <= 1.05,
        "{:?}",
        score.cases
    );
}

/// What shows only beside loops of the right structure is found with them: neither alone lowers the error.
#[test]
fn what_shows_only_beside_the_right_loops_is_found_with_them() {
    let score = planted(&[&["saturation"], &["creep"]], 2.0, "bouc_wen", 5000);
    for case in &score.cases {
        assert!(
            case.right_first && case.validate_over_noise <= 1.05,
            "{case:?}"
        );
    }
}
