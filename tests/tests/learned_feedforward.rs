//! Learned feedforward on a stage that the simulation does not share and that is 5 % off its model.

use hysteron::dataset::Dataset;
use hysteron::model_file::effects_named;
use hysteron::servo::commands::{check, follow, with_scheme};
use hysteron::servo::design::ServoDesign;
use hysteron::servo::order::{self, Order};
use hysteron::servo::track::lead_s;
use hysteron::watch::Unwatched;
use hysteron_sim::chain::Model;
use hysteron_tests::independent_stage::{Change, Truth};
use hysteron_tests::learning_study::{FIVE_PERCENT_LESS, FIVE_PERCENT_MORE, Way, learned};
use hysteron_tests::servo_study::{Recording, record};

fn recorded() -> (Truth, Dataset, Model) {
    let truth = Truth::drawn(20);
    let dataset = record(&truth, Recording::Wideband);
    let effects = effects_named("hysteresis,initial_curve,vibration,second_mode,creep").unwrap();
    let chain = hysteron::identify::identify(&dataset, &effects, &Unwatched).unwrap().model;
    (truth, dataset, chain)
}

/// What limits the drive: the stage moves so little that its own range is not enough.
const TOO_WEAK: Change = Change { gain_ratio: 0.7, ..Change::NONE };

#[test]
#[cfg_attr(debug_assertions, ignore = "slow: release mode")]
fn a_triangle_of_100_hz_is_followed_to_a_twentieth_of_a_percent_within_ten_periods() {
    let (truth, dataset, chain) = recorded();
    let design = order::design(&chain, &Order { recording: Some(&dataset), learning: true, ..Order::default() }).unwrap();
    assert_eq!(design.scheme_name(), "predictor-learning");
    let filters = design.learning.as_ref().unwrap();
    assert!(filters.convergence.iter().all(|p| p.contraction() < 1.0));
    assert!(filters.learns_to_hz() > 2000.0, "{}", filters.learns_to_hz());
    for change in [FIVE_PERCENT_LESS, FIVE_PERCENT_MORE] {
        let without = learned(&truth, change, &design, Way::Nothing, 12);
        let with = learned(&truth, change, &design, Way::EveryTick, 40);
        println!("{:.4} % without, {:.4} % in period 10, {:.4} % in period 39", without.percent(9), with.percent(9), with.percent(38));
        assert!(without.percent(9) > 0.15, "three times what is asked: {}", without.percent(9));
        assert!(with.percent(9) <= 0.05, "{}", with.percent(9));
        assert!((30..39).all(|period| with.percent(period) <= 0.055), "it stays there");
        assert_eq!((with.counters.limited_ticks, with.counters.saturated_values), (0, 0));
    }
    // Where the drive meets its limit in every period nothing is learned of those periods, and nothing grows.
    let limited = learned(&truth, TOO_WEAK, &design, Way::EveryTick, 40);
    let as_before = learned(&truth, TOO_WEAK, &design, Way::Nothing, 40);
    assert!(limited.counters.limited_ticks > 100, "{:?}", limited.counters);
    assert!(limited.percent(38) < 1.05 * as_before.percent(38), "{} {}", limited.percent(38), as_before.percent(38));
    commands_know_it(&design, &chain);
}

/// `check` and `track` on the identified model, and a servo file that comes back as it went.
fn commands_know_it(design: &ServoDesign, chain: &Model) {
    let found = check(design, chain).unwrap();
    assert!(found.stable && found.remarks.iter().any(|r| r.contains("Learning converges")), "{:?}", found.remarks);
    let text = toml::to_string_pretty(design).unwrap();
    assert_eq!(&toml::from_str::<ServoDesign>(&text).unwrap(), design);
    let error_um = |scheme: Option<&str>| follow(chain, design, "triangle:100:2:4", scheme, None).unwrap().truth.rms_um;
    assert!(error_um(None) < 0.6 * error_um(Some("predictor")), "{} {}", error_um(None), error_um(Some("predictor")));
    // The noise is the one that the servo was designed for, unless another is said; the error counts ten periods after the reference has grown.
    let noise_um = |said: Option<f64>| follow(chain, design, "triangle:20:2:4", None, said).unwrap().noise_um;
    assert_eq!((Some(noise_um(None)), noise_um(Some(0.004))), (design.sensor_noise_um, 0.004));
    assert!((lead_s(design, 20.0) - 0.8).abs() < 1e-9 && (lead_s(design, 30.0) - 0.5).abs() < 1e-9, "30 Hz has no whole period");
    // Without a recording a design learns below its first mode only.
    let careful = with_scheme(&ServoDesign { learning: None, ..design.clone() }, "predictor-learning").unwrap();
    assert!(careful.learning.unwrap().learns_to_hz() < design.learning.as_ref().unwrap().learns_to_hz());
    assert_eq!(with_scheme(design, "pid").unwrap().learning, None);
}
