//! Learned feedforward on a stage that the simulation does not share and that is 5 % off its model.

use crate::recorded;
use hysteron::servo::check::check;
use hysteron::servo::design::ServoDesign;
use hysteron::servo::learned_feedforward::LearningDesign;
use hysteron::servo::named_scheme::with_scheme;
use hysteron::servo::order::{self, DesignOrder};
use hysteron::servo::reference::Reference;
use hysteron::servo::reference::lead_s;
use hysteron::servo::work::{Work, follow};
use hysteron_research::learning_study::{
    FIVE_PERCENT_LESS, FIVE_PERCENT_MORE, LearningWay, changed_bench, designed_on_bench, learned,
    learned_on_bench, sine_on_bench,
};
use hysteron_sim::bench::Bench;
use hysteron_sim::chain::Model;
use hysteron_tests::independent_stage::StageChange;

/// What limits the drive: the stage moves so little that its own range is not enough.
const TOO_WEAK: StageChange = StageChange {
    gain_ratio: 0.7,
    ..StageChange::NONE
};

#[test]
#[cfg_attr(debug_assertions, ignore = "slow: release mode")]
fn a_triangle_of_100_hz_is_followed_to_a_twentieth_of_a_percent_within_ten_periods() {
    let (truth, dataset, chain) = recorded(20);
    let design = order::design(
        &chain,
        &DesignOrder {
            recording: Some(&dataset),
            learning: true,
            usual_margins: false,
            ..DesignOrder::default()
        },
    )
    .unwrap();
    assert_eq!(design.scheme_name(), "predictor-learning");
    let filters = design.learning.as_ref().unwrap();
    assert!(filters.convergence.iter().all(|p| p.contraction() < 1.0));
    assert!(
        filters.learns_to_hz() > 2000.0,
        "{}",
        filters.learns_to_hz()
    );
    for change in [FIVE_PERCENT_LESS, FIVE_PERCENT_MORE] {
        let without = learned(&truth, change, &design, LearningWay::Nothing, 12);
        let with = learned(&truth, change, &design, LearningWay::EveryTick, 40);
        println!(
            "{:.4} % without, {:.4} % in period 10, {:.4} % in period 39",
            without.percent(9),
            with.percent(9),
            with.percent(38)
        );
        assert!(
            without.percent(9) > 0.15,
            "three times what is asked: {}",
            without.percent(9)
        );
        assert!(with.percent(9) <= 0.05, "{}", with.percent(9));
        assert!(
            (30..39).all(|period| with.percent(period) <= 0.055),
            "it stays there"
        );
        assert_eq!(
            (with.counters.limited_ticks, with.counters.saturated_values),
            (0, 0)
        );
    }
    // Where the drive meets its limit in every period nothing is learned of those periods, and nothing grows.
    let limited = learned(&truth, TOO_WEAK, &design, LearningWay::EveryTick, 40);
    let as_before = learned(&truth, TOO_WEAK, &design, LearningWay::Nothing, 40);
    assert!(
        limited.counters.limited_ticks > 100,
        "{:?}",
        limited.counters
    );
    assert!(
        limited.percent(38) < 1.05 * as_before.percent(38),
        "{} {}",
        limited.percent(38),
        as_before.percent(38)
    );
    commands_know_it(&design, &chain);
}

/// On the project's own bench, with the lags of its amplifier and its sensor and all that the nominal model
/// leaves out: of the true position.
#[test]
#[cfg_attr(debug_assertions, ignore = "slow: release mode")]
fn on_the_full_bench_a_twentieth_of_a_percent_of_the_true_position_is_left() {
    let bench = Bench::reference().unwrap();
    let design = designed_on_bench(&bench).unwrap();
    let identified_hz = 1.0
        / (std::f64::consts::TAU
            * design
                .sensor_lag_s
                .expect("the recording tells it from the amplifier's"));
    let of_the_bench = identified_hz / bench.full.sensor_bandwidth_hz;
    assert!((0.9..1.1).contains(&of_the_bench), "{identified_hz} Hz");
    assert!(
        design
            .explanation
            .iter()
            .any(|line| line.contains("as identified beside the amplifier's")),
        "{:?}",
        design.explanation
    );
    let as_it_reads = ServoDesign {
        sensor_lag_s: None,
        ..design.clone()
    };
    for ratio in [0.95, 1.0, 1.05] {
        let changed = changed_bench(&bench, ratio);
        let [without, with] =
            [false, true].map(|learning| learned_on_bench(&changed, &design, learning, 9));
        assert!(
            ratio == 1.0 || without.true_percent > 0.15,
            "three times what is asked: {without:?}"
        );
        assert!(
            with.true_percent <= 0.05 && with.true_percent < without.true_percent,
            "{with:?} {without:?}"
        );
        // What the sensor's lag would hide.
        let hidden = learned_on_bench(&changed, &as_it_reads, true, 9);
        assert!(
            hidden.read_percent < 0.05 && hidden.true_percent > 0.25,
            "{hidden:?}"
        );
    }
    // Without learning a reference is followed as well as it is read, to 500 Hz.
    for hz in [1.0, 50.0, 150.0, 500.0] {
        let [undone, left] = [&design, &as_it_reads].map(|d| {
            sine_on_bench(
                &bench,
                &ServoDesign {
                    learning: None,
                    ..d.clone()
                },
                hz,
            )
        });
        println!("{hz} Hz: {undone:?}, lag not undone {left:?}");
        assert!(
            undone.true_percent < left.read_percent.max(0.03) + 0.04 * hz / 100.0,
            "{hz} Hz: {undone:?} {left:?}"
        );
        assert!(
            hz < 50.0 || undone.true_percent < 0.3 * left.true_percent,
            "{hz} Hz: {undone:?} {left:?}"
        );
    }
}

/// What cannot be learned about a light second mode is fed forward: 0.053 % with the law's own feedforward.
#[test]
#[cfg_attr(debug_assertions, ignore = "slow: release mode")]
fn beyond_what_is_learned_the_corners_are_fed_forward() {
    let (truth, dataset, chain) = recorded(17);
    let design = order::design(
        &chain,
        &DesignOrder {
            recording: Some(&dataset),
            learning: true,
            usual_margins: false,
            ..DesignOrder::default()
        },
    )
    .unwrap();
    let filters = design.learning.as_ref().unwrap();
    let plain = LearningDesign {
        feedforward: Vec::new(),
        ..filters.clone()
    };
    assert!(!filters.feedforward.is_empty());
    for change in [FIVE_PERCENT_LESS, FIVE_PERCENT_MORE] {
        let wide = learned(&truth, change, &design, LearningWay::EveryTick, 12);
        let own = learned(
            &truth,
            change,
            &ServoDesign {
                learning: Some(plain.clone()),
                ..design.clone()
            },
            LearningWay::EveryTick,
            12,
        );
        println!(
            "{:.4} %, {:.4} % with the law's own feedforward",
            wide.percent(9),
            own.percent(9)
        );
        assert!(
            wide.percent(9) <= 0.05 && wide.percent(9) < 0.9 * own.percent(9),
            "{} {}",
            wide.percent(9),
            own.percent(9)
        );
    }
}

/// `check` and `track` on the identified model, and a servo file that comes back as it went.
fn commands_know_it(design: &ServoDesign, chain: &Model) {
    let found = check(design, chain).unwrap();
    assert!(
        found.stable
            && found
                .remarks
                .iter()
                .any(|r| r.contains("Learning converges")),
        "{:?}",
        found.remarks
    );
    let text = toml::to_string_pretty(design).unwrap();
    assert_eq!(&toml::from_str::<ServoDesign>(&text).unwrap(), design);
    let followed = |name: &str, work: Work| {
        follow(
            chain,
            design,
            &Reference::named(name, design.period_s()).unwrap(),
            name,
            &work,
        )
        .unwrap()
    };
    let error_um = |scheme: Option<&str>| {
        followed(
            "triangle:100:2:4",
            Work {
                scheme,
                ..Work::default()
            },
        )
        .truth
        .rms_um
    };
    assert!(
        error_um(None) < 0.6 * error_um(Some("predictor")),
        "{} {}",
        error_um(None),
        error_um(Some("predictor"))
    );
    // The noise is the one that the servo was designed for, unless another is specified; the error counts ten
    // periods after the reference has grown.
    let noise_um = |sensor_noise_um: Option<f64>| {
        followed(
            "triangle:20:2:4",
            Work {
                sensor_noise_um,
                ..Work::default()
            },
        )
        .noise_um
    };
    assert_eq!(
        (Some(noise_um(None)), noise_um(Some(0.004))),
        (design.sensor_noise_um, 0.004)
    );
    assert!(
        (lead_s(design, 20.0) - 0.8).abs() < 1e-9 && (lead_s(design, 30.0) - 0.5).abs() < 1e-9,
        "30 Hz has no whole period"
    );
    // Without a recording a design learns below its first mode only.
    let careful = with_scheme(
        &ServoDesign {
            learning: None,
            ..design.clone()
        },
        "predictor-learning",
    )
    .unwrap();
    assert!(
        careful.learning.unwrap().learns_to_hz() < design.learning.as_ref().unwrap().learns_to_hz()
    );
    assert_eq!(with_scheme(design, "pid").unwrap().learning, None);
}
