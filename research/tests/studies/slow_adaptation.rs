//! A gain that is not the model's and drifts, on stages that the simulation does not share: what the unknown
//! input leaves, and what is left when the gain of the model is corrected.

use crate::recorded;
use hysteron::servo::amplifier_block::{FrontEnd, amplifier_parameters, block};
use hysteron::servo::check::check;
use hysteron::servo::design::ServoDesign;
use hysteron::servo::named_scheme::with_scheme;
use hysteron::servo::order::{self, DesignOrder};
use hysteron::servo::reference::Reference;
use hysteron::servo::reference::lead_s;
use hysteron::servo::work::{Work, follow};
use hysteron_core::gain_adaptation::MOST;
use hysteron_core::parameter_block;
use hysteron_research::adaptation_study::{AdaptationDrift, AdaptationWay, adapted, sine_um};
use hysteron_research::learning_study::{self, learned};
use hysteron_sim::chain::Model;
use hysteron_tests::independent_stage::StageChange;

#[test]
#[cfg_attr(debug_assertions, ignore = "slow: release mode")]
fn a_gain_that_is_a_fifth_off_costs_no_more_than_the_right_one() {
    with_other_gains(0, &[0.8, 1.2]);
}

/// Run by `cargo xtask full`.
mod long {
    #[test]
    #[ignore = "two stages at four gains each"]
    fn a_gain_that_is_off_costs_no_more_on_either_stage() {
        for seed in [20, 0] {
            super::with_other_gains(seed, &[0.8, 0.9, 1.1, 1.2]);
        }
    }
}

/// Stage 20 has a damped first mode, stage 0 one with a damping ratio of 0.01.
fn with_other_gains(seed: u64, gains: &[f64]) {
    let (truth, dataset, chain) = recorded(seed);
    let design = order::design(
        &chain,
        &DesignOrder {
            recording: Some(&dataset),
            adaptation: true,
            usual_margins: false,
            ..DesignOrder::default()
        },
    )
    .unwrap();
    assert_eq!(design.scheme_name(), "predictor-adaptive");
    assert!(
        design
            .explanation
            .iter()
            .any(|said| said.contains("corrected while it runs")),
        "{:?}",
        design.explanation
    );
    let without = ServoDesign {
        adaptation: None,
        ..design.clone()
    };
    // On the light stage what the wrong gain began with is still dying out after seven seconds.
    let reference = sine_um(&truth, 150.0, 12.0);
    for &gain in gains {
        let run = |way| {
            adapted(
                &truth,
                AdaptationDrift::none(gain),
                &without,
                way,
                &reference,
            )
        };
        let [before, after, known] = [
            AdaptationWay::Nothing,
            AdaptationWay::InTheTick,
            AdaptationWay::Known,
        ]
        .map(run);
        let [before_um, after_um, known_um] =
            [&before, &after, &known].map(|found| found.at_last.rms_um);
        println!(
            "{seed}: gain {gain}: {:.2} nm, {:.2} adapted to {:.4}, {:.2} known",
            1e3 * before_um,
            1e3 * after_um,
            after.gain,
            1e3 * known_um
        );
        assert!(
            before_um > 10.0 * after_um && after_um < 1.15 * known_um,
            "{seed} {gain}"
        );
        assert!((after.gain / gain - 1.0).abs() < 0.005, "{}", after.gain);
        assert_eq!(
            (
                after.trace.limited_after(10_000),
                after.counters.saturated_values
            ),
            (0, 0)
        );
    }
    // As far as the gain may be off, from one end to the other in four seconds, which is faster than it
    // is followed, and back at rest.
    for [from, to] in [[0.8, 1.2], [1.2, 0.8]] {
        let mut slow_and_still = reference.clone();
        let last = *slow_and_still.last().unwrap();
        slow_and_still.extend(vec![last; 40_000]);
        let found = adapted(
            &truth,
            AdaptationDrift {
                from,
                to,
                lasts_s: 4.0,
            },
            &without,
            AdaptationWay::InTheTick,
            &slow_and_still,
        );
        println!(
            "{seed}: {from} to {to}: {:.2} nm at rest, adapted to {:.4}",
            1e3 * found.at_last.rms_um,
            found.gain
        );
        assert!(
            found.at_last.rms_um < 3.0 * truth.noise_um
                && (0.8 - 1e-6..=1.2 + 1e-6).contains(&found.gain)
        );
    }
    if seed == 20 {
        commands_know_it(&design, &chain);
    }
}

/// `check` and `track` on the identified model with another gain, the target's block, and a servo file that
/// comes back as it went.
fn commands_know_it(design: &ServoDesign, chain: &Model) {
    let mut weaker = chain.clone();
    let surfaces = weaker
        .effects
        .iter_mut()
        .filter(|e| e.id == "hysteresis" || e.id == "initial_curve");
    surfaces
        .flat_map(|e| &mut e.parameters)
        .for_each(|p| p.value *= 0.85);
    let found = check(design, &weaker).unwrap();
    assert!(
        found.stable
            && found
                .remarks
                .iter()
                .any(|r| r.contains("correction of the gain stands")),
        "{:?}",
        found.remarks
    );
    let text = toml::to_string_pretty(design).unwrap();
    assert_eq!(&toml::from_str::<ServoDesign>(&text).unwrap(), design);
    let reference = Reference::named("sine:150:2:4", design.period_s()).unwrap();
    let follow = |scheme: Option<&str>| {
        follow(
            &weaker,
            design,
            &reference,
            "sine:150:2:4",
            &Work {
                scheme,
                ..Work::default()
            },
        )
        .unwrap()
    };
    let (adaptive, plain) = (follow(None), follow(Some("predictor")));
    println!(
        "track: {:.2} nm, {:.2} without",
        1e3 * adaptive.truth.rms_um,
        1e3 * plain.truth.rms_um
    );
    assert!(plain.truth.rms_um > 8.0 * adaptive.truth.rms_um);
    assert!(
        (adaptive.adapted_gain.unwrap() - 0.85).abs() < 0.01 && plain.adapted_gain.is_none(),
        "{:?}",
        adaptive.adapted_gain
    );
    assert!(lead_s(design, 150.0) > 5.0);
    let careful = with_scheme(
        &ServoDesign {
            adaptation: None,
            ..design.clone()
        },
        "predictor-adaptive",
    )
    .unwrap();
    assert_eq!(careful.adaptation, design.adaptation);
    assert!(with_scheme(design, "pid").unwrap().adaptation.is_none());
    let front_end = FrontEnd {
        sensor_max_um: 20.0,
        ..FrontEnd::default()
    };
    let parameters = amplifier_parameters(design, &front_end).unwrap();
    assert_eq!(parameters.servo.adaptation.unwrap().most, MOST);
    assert_eq!(
        parameter_block::read(&block(&parameters).unwrap(), 20_000),
        Ok(parameters)
    );
    let mut impossible = design.clone();
    impossible.adaptation.as_mut().unwrap().farthest = 0.3;
    let text = toml::to_string(&impossible).unwrap();
    let refused = ServoDesign::from_toml(&text, "servo.toml").unwrap_err();
    assert!(refused.to_string().contains("farthest"));
}

#[test]
#[cfg_attr(debug_assertions, ignore = "slow: release mode")]
fn a_gain_is_corrected_while_a_periodic_correction_is_learned() {
    let (truth, dataset, chain) = recorded(20);
    let order = DesignOrder {
        recording: Some(&dataset),
        learning: true,
        adaptation: true,
        usual_margins: false,
        ..DesignOrder::default()
    };
    let both = order::design(&chain, &order).unwrap();
    let name = "predictor-learning-adaptive";
    assert_eq!(both.scheme_name(), name);
    // What a design is called can be asked for, and is the same.
    assert_eq!(with_scheme(&both, name).unwrap(), both);
    let learning = ServoDesign {
        adaptation: None,
        ..both.clone()
    };
    let found = check(&both, &chain).unwrap();
    println!("{:?}", found.remarks);
    assert!(
        found.stable
            && found
                .remarks
                .iter()
                .any(|r| r.contains("Learning converges")),
        "{:?}",
        found.remarks
    );
    assert!(
        found
            .remarks
            .iter()
            .any(|r| r.contains("stands farthest off")),
        "{:?}",
        found.remarks
    );
    let text = toml::to_string_pretty(&both).unwrap();
    assert_eq!(toml::from_str::<ServoDesign>(&text).unwrap(), both);
    let front_end = FrontEnd {
        sensor_max_um: 20.0,
        ..FrontEnd::default()
    };
    let parameters = amplifier_parameters(&both, &front_end).unwrap();
    assert!(parameters.servo.adaptation.is_some() && parameters.servo.learning.is_some());
    assert_eq!(
        parameter_block::read(&block(&parameters).unwrap(), 20_000),
        Ok(parameters)
    );

    // Four seconds: the gain is followed by half a per cent in a tenth of a second.
    let periods = 400;
    for gain_ratio in [0.88, 1.12] {
        let percent = |design: &ServoDesign, way| {
            let found = learned(
                &truth,
                StageChange {
                    gain_ratio,
                    ..StageChange::NONE
                },
                design,
                way,
                periods,
            );
            assert_eq!(
                (
                    found.counters.limited_ticks,
                    found.counters.saturated_values
                ),
                (0, 0)
            );
            let worst = (20..periods - 1)
                .map(|period| found.percent(period))
                .fold(0.0, f64::max);
            (worst, 100.0 * found.at_last.rms_um / found.stroke_um)
        };
        let every_tick = learning_study::LearningWay::EveryTick;
        let [(worst, with), (worst_alone, alone)] =
            [&both, &learning].map(|design| percent(design, every_tick));
        // With `Nothing` the period is learned by nobody, and the gain as before.
        let (_, gain) = percent(&both, learning_study::LearningWay::Nothing);
        println!(
            "gain {gain_ratio}: {with:.4} % with both ({worst:.4} in the worst period), {alone:.4} % with the correction alone ({worst_alone:.4}), {gain:.4} % with the gain alone"
        );
        assert!(with < 1.05 * alone && 2.0 * with < gain, "{gain_ratio}");
        // While the gain still moves, what is asked of a learned correction holds.
        assert!(worst <= 0.05, "{gain_ratio}: {worst}");
    }
}
