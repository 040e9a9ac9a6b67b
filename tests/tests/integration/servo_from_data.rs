//! From a recording to a servo on a stage that the simulation does not share: stable or refused, and unstable
//! where it was predicted.

use hysteron::model_file::effects_named;
use hysteron::servo::check::{check, gain_ratio};
use hysteron::servo::loop_margins::LoopMargins;
use hysteron::servo::model::actuator_model;
use hysteron::servo::order::{self, DesignOrder};
use hysteron::watch::Unwatched;
use hysteron_report::servo_words as words;
use hysteron_sim::chain::Model;
use hysteron_tests::independent_stage::{StageChange, StageTruth, TrueMode};
use hysteron_tests::servo_study::{
    LIMIT_CYCLE, StudyRecording, at_work, designed, designed_with_the_truth, explained, record,
    rest_after_slow_change_um, rest_um,
};

/// From recording to servo on one stage: stable, or a refusal that names the drive. Returns whether it was
/// stable, with its error in um.
fn stable_or_refused(seed: u64, recording: StudyRecording) -> Option<f64> {
    let truth = StageTruth::drawn(seed);
    let dataset = record(&truth, recording);
    let chain = explained(&dataset).model;
    match designed(&chain, &dataset) {
        Err(reason) => {
            assert!(
                reason.contains("record a multisine") || reason.contains("raise its amplitude"),
                "{seed} {}: {reason}",
                recording.name()
            );
            None
        }
        Ok(design) => {
            let work = at_work(&truth, StageChange::NONE, &design);
            assert!(!work.unstable, "{seed} {}: {work:?}", recording.name());
            Some(work.worst_um())
        }
    }
}

#[test]
#[cfg_attr(debug_assertions, ignore = "slow: release mode")]
fn a_servo_from_the_usual_recording_holds_on_the_stage() {
    let worst_um =
        stable_or_refused(1, StudyRecording::Usual).expect("this stage is shown well enough");
    assert!(worst_um < 0.01, "{worst_um}");
}

/// The drive shows no resonance of this stage's second mode, but a thirtieth of the motion goes through it:
/// without that share the feedforward is late, 17 nm at 150 Hz.
#[test]
#[cfg_attr(debug_assertions, ignore = "slow: release mode")]
fn a_resonance_that_is_not_shown_leaves_its_share_of_the_motion() {
    let worst_um =
        stable_or_refused(14, StudyRecording::Usual).expect("this stage is shown well enough");
    assert!(worst_um < 0.005, "{worst_um}");
}

/// Modes between the highest line of the multisine and half the sampling rate limited this stage to 1.64
/// times the best.
#[test]
#[cfg_attr(debug_assertions, ignore = "slow: release mode")]
fn a_wideband_recording_leads_to_nearly_the_best_with_the_truth() {
    let truth = StageTruth::drawn(9);
    let dataset = record(&truth, StudyRecording::Wideband);
    let chain = explained(&dataset).model;
    let [found, best] = [
        designed(&chain, &dataset).unwrap(),
        designed_with_the_truth(&truth, &chain).unwrap(),
    ]
    .map(|design| at_work(&truth, StageChange::NONE, &design));
    for (found, best) in found.errors.iter().zip(&best.errors) {
        assert!(found.rms_um <= 1.5 * best.rms_um, "{found:?} {best:?}");
    }
    // The default: the usual margins, for less than a third more of the error that was expected.
    let usual = order::design(
        &chain,
        &DesignOrder {
            recording: Some(&dataset),
            ..DesignOrder::default()
        },
    )
    .unwrap();
    let usual = at_work(&truth, StageChange::NONE, &usual);
    println!(
        "usual margins {:.2} nm, fastest {:.2} nm",
        1e3 * usual.worst_um(),
        1e3 * found.worst_um()
    );
    assert!(
        !usual.unstable && usual.worst_um() < 1.5 * found.worst_um(),
        "{usual:?} {found:?}"
    );
}

#[test]
#[cfg_attr(debug_assertions, ignore = "slow: release mode")]
fn what_the_target_plays_makes_no_unstable_servo() {
    let worst_um =
        stable_or_refused(1, StudyRecording::TargetsOwn).expect("its own record is enough");
    assert!(worst_um < 0.004, "{worst_um}");
}

/// Run by `cargo xtask full`.
mod long {
    use super::{StudyRecording, stable_or_refused};

    #[test]
    #[ignore = "72 identifications: half an hour"]
    fn no_stage_and_no_recording_makes_an_unstable_servo() {
        for seed in 0..24 {
            for recording in StudyRecording::ALL {
                stable_or_refused(seed, recording);
            }
        }
    }
}

/// A model of a stage with the effects that it has, fitted once.
fn identified(truth: &StageTruth) -> Model {
    let effects = effects_named("hysteresis,initial_curve,vibration,second_mode,creep").unwrap();
    hysteron::identify::identify(
        &record(truth, StudyRecording::Wideband),
        &effects,
        &Unwatched,
    )
    .unwrap()
    .model
}

fn margins(design: &hysteron::servo::design::ServoDesign, chain: &Model) -> LoopMargins {
    check(design, chain).unwrap().margins.unwrap()
}

#[test]
#[cfg_attr(debug_assertions, ignore = "slow: release mode")]
fn a_loop_becomes_unstable_where_it_was_predicted() {
    let truth = StageTruth::drawn(1);
    let chain = identified(&truth);
    let design = designed_with_the_truth(&truth, &chain).unwrap();
    let found = margins(&design, &chain);
    assert!(found.spectral_radius.iter().all(|r| *r < 1.0));
    let limit_um = LIMIT_CYCLE * truth.noise_um;
    let at_rest_um = rest_um(&truth, StageChange::NONE, &design);
    println!("as recorded: {:.1} nm at rest", 1e3 * at_rest_um);
    assert!(at_rest_um < limit_um);
    let first = found.first_unstable;
    let turns_at = |what: &str, predicted: f64, change: &dyn Fn(f64) -> StageChange| {
        let [before_um, beyond_um] =
            [0.95, 1.05].map(|share| rest_um(&truth, change(share * predicted), &design));
        println!(
            "{what} {predicted:.4}: {:.1} nm at rest 5 % before, {:.0} nm 5 % beyond",
            1e3 * before_um,
            1e3 * beyond_um
        );
        assert!(
            before_um < limit_um,
            "{what}: already unstable 5 % before {predicted}"
        );
        assert!(
            beyond_um > limit_um,
            "{what}: still stable 5 % beyond {predicted}"
        );
    };
    turns_at("gain", first.gain_up.unwrap(), &|gain_ratio| StageChange {
        gain_ratio,
        ..StageChange::NONE
    });
    turns_at("mass", first.mass_up.unwrap(), &|mass_ratio| StageChange {
        mass_ratio,
        ..StageChange::NONE
    });
    turns_at("delay", first.delay_s.unwrap(), &|delay_s| StageChange {
        delay_s,
        ..StageChange::NONE
    });
    let mode = first.mode.unwrap();
    println!(
        "the mode: {:.0} Hz, damping ratio {}",
        mode.frequency_hz, mode.damping_ratio
    );
    turns_at("mode", mode.share, &|share| StageChange {
        mode: Some(TrueMode {
            frequency_hz: mode.frequency_hz,
            damping_ratio: mode.damping_ratio,
            share,
        }),
        ..StageChange::NONE
    });
    // The same servo on an actuator with a third and with three times the gain is another loop, and said to
    // be one.
    let scaled = |factor: f64| {
        let mut other = chain.clone();
        let of_surfaces = ["hysteresis", "initial_curve"];
        for p in other
            .effects
            .iter_mut()
            .filter(|e| of_surfaces.contains(&e.id.as_str()))
            .flat_map(|e| &mut e.parameters)
        {
            p.value *= factor;
        }
        other
    };
    for factor in [0.3, 3.0] {
        let other = margins(&design, &scaled(factor));
        assert!((other.gain_ratio[1] / factor - found.gain_ratio[1]).abs() < 1e-9);
        assert_ne!(other.spectral_radius, found.spectral_radius);
    }
    let far = check(&design, &scaled(2.0 * first.gain_up.unwrap())).unwrap();
    assert!(!far.stable && far.margins.unwrap().worst_case.contains("unstable"));
    let same = actuator_model(&chain).unwrap();
    let ratio = gain_ratio(&same, &chain, true).unwrap();
    assert!(ratio.iter().all(|r| (r - 1.0).abs() < 1e-9), "{ratio:?}");
}

/// A lightly damped stage: where the drive is free the loop turns at the predicted gain, and where it begins
/// at a limit at the gain that `check` finds by running it from there, between what it says for any limit and
/// the predicted gain.
#[test]
#[cfg_attr(debug_assertions, ignore = "slow: release mode")]
fn a_limit_of_the_drive_keeps_a_loop_swinging_from_where_it_was_predicted() {
    let truth = StageTruth::drawn(12);
    let chain = identified(&truth);
    let design = designed(&chain, &record(&truth, StudyRecording::Wideband)).unwrap();
    let found = margins(&design, &chain);
    let (free, swinging) = (
        found.first_unstable.gain_up.unwrap(),
        found.first_swinging.gain_up.unwrap(),
    );
    let said = words::margins(&found).join(" ");
    assert!(
        swinging < 0.85 * free && said.contains("it may go on swinging"),
        "{swinging} {free}: {said}"
    );
    let limit_um = LIMIT_CYCLE * truth.noise_um;
    let with = |gain_ratio: f64| StageChange {
        gain_ratio,
        ..StageChange::NONE
    };
    let from_the_limit_um =
        [0.98 * swinging, 0.95 * free].map(|gain| rest_um(&truth, with(gain), &design));
    let in_the_middle_um = [0.95 * free, 1.05 * free]
        .map(|gain| rest_after_slow_change_um(&truth, with(gain), &design));
    println!(
        "gain {swinging:.3} and {free:.3}: {from_the_limit_um:?} um from the limit, {in_the_middle_um:?} um in the middle of the range"
    );
    assert!(
        from_the_limit_um[0] < limit_um && from_the_limit_um[1] > limit_um,
        "{from_the_limit_um:?}"
    );
    let begun = found
        .first_from_rest
        .and_then(|first| first.gain_up)
        .unwrap();
    let about_begun_um =
        [0.95 * begun, 1.05 * begun].map(|gain| rest_um(&truth, with(gain), &design));
    println!(
        "from the limit it swings from gain {begun:.3}: {about_begun_um:?} um 5 % before and beyond"
    );
    assert!(
        swinging < begun && begun < 0.95 * free && said.contains("beginning at the lower limit"),
        "{swinging} {begun} {free}: {said}"
    );
    assert!(
        about_begun_um[0] < limit_um && about_begun_um[1] > limit_um,
        "{about_begun_um:?}"
    );
    assert!(
        in_the_middle_um[0] < limit_um && in_the_middle_um[1] > limit_um,
        "{in_the_middle_um:?}"
    );
}

#[test]
#[cfg_attr(debug_assertions, ignore = "slow: release mode")]
fn what_cannot_be_meant_is_refused() {
    let truth = StageTruth::drawn(1);
    let chain = identified(&truth);
    for noise_um in [-1.0, 0.0, f64::NAN, f64::INFINITY, 5.0] {
        let order = DesignOrder {
            sensor_noise_um: Some(noise_um),
            ..DesignOrder::default()
        };
        let reason = order::design(&chain, &order).unwrap_err();
        assert!(reason.contains("--sensor-noise-um"), "{noise_um}: {reason}");
    }
    // A sensor that ends before the actuator does.
    let narrow = hysteron::servo::amplifier_block::FrontEnd {
        sensor_min_um: 3.0,
        sensor_max_um: 14.0,
        ..Default::default()
    };
    let reason = order::design(
        &chain,
        &DesignOrder {
            front_end: Some(&narrow),
            ..DesignOrder::default()
        },
    )
    .unwrap_err();
    assert!(reason.contains("3 to 14 um"), "{reason}");
    // Without a recording a second mode is no fact, and the explanation mentions the missing creep.
    let mut without = chain.clone();
    without.effects.retain(|e| e.id != "creep");
    let design = order::design(&without, &DesignOrder::default()).unwrap();
    assert!(design.model.linear.second_mode.is_none());
    let said = design.explanation.join(" ");
    assert!(
        said.contains("no creep") && said.contains("No recording stands behind"),
        "{said}"
    );
}
