//! A first mode at 739 Hz with a damping ratio of 0.018, on a stage that the simulation does not share:
//! references beyond it, little noise, and a mode that moves by a fifth.

use hysteron::model_file::effects_named;
use hysteron::servo::order::{self, DesignOrder};
use hysteron::watch::Unwatched;
use hysteron_research::light_mode_study::{
    MODE_HZ, bandwidth_hz, moved, oscillates_with_mode_at, peak, reference_response,
    with_first_mode,
};
use hysteron_tests::independent_stage::StageChange;
use hysteron_tests::servo_study::{StudyRecording, at_work, record};

#[test]
#[cfg_attr(debug_assertions, ignore = "slow: release mode")]
fn references_are_followed_beyond_a_light_mode_that_moves() {
    let truth = with_first_mode(18, MODE_HZ);
    let dataset = record(&truth, StudyRecording::Wideband);
    let effects = effects_named("hysteresis,initial_curve,vibration,second_mode,creep").unwrap();
    let chain = hysteron::identify::identify(&dataset, &effects, &Unwatched)
        .unwrap()
        .model;
    let designed = |mode_moves: f64| {
        order::design(
            &chain,
            &DesignOrder {
                recording: Some(&dataset),
                mode_moves,
                usual_margins: false,
                ..DesignOrder::default()
            },
        )
    };
    let (usual, moving) = (designed(0.0).unwrap(), designed(0.2).unwrap());
    assert!(
        moving
            .explanation
            .iter()
            .any(|said| said.contains("may move by 20 %")),
        "{:?}",
        moving.explanation
    );
    let response = reference_response(&truth, &moving);
    let work = at_work(&truth, StageChange::NONE, &moving);
    println!(
        "{:.0} Hz, {:.2} of the noise, errors {:?}",
        bandwidth_hz(&response),
        work.rest_um / truth.noise_um,
        work.errors
    );
    assert!(bandwidth_hz(&response) > 1.2 * MODE_HZ && peak(&response) < 1.1);
    assert!(work.rest_um < 1.3 * truth.noise_um && !work.unstable && work.worst_um() < 0.005);
    for factor in [0.8, 0.9, 1.1, 1.2] {
        assert!(
            !oscillates_with_mode_at(&truth, factor, &moving),
            "{factor}"
        );
    }
    // A mode that moved down is amplified less than by a design that does not reckon with it; one that moved
    // up leaves more of the band.
    let [less, more] =
        [&moving, &usual].map(|design| peak(&reference_response(&moved(&truth, 0.8), design)));
    let [wider, narrower] = [&moving, &usual]
        .map(|design| bandwidth_hz(&reference_response(&moved(&truth, 1.2), design)));
    println!(
        "{less:.2} times at most, {more:.2} by the usual design; {wider:.0} Hz, {narrower:.0} by the usual design"
    );
    assert!(
        less < 0.75 * more && wider > narrower,
        "{less} {more} {wider} {narrower}"
    );
    for share in [-0.1, 0.6, f64::NAN] {
        assert!(
            designed(share).unwrap_err().contains("--mode-moves"),
            "{share}"
        );
    }
}
