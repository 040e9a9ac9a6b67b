//! Real recordings, altered by exactly known amounts. They lie beside the project; what they came from is in
//! docs/results/real_recordings.md.

use hysteron::Finding;
use hysteron::analyse::{Options, Start, analyse};
use hysteron::dataset::issue::{IssueKind, Severity};
use hysteron::dataset::{Dataset, Role};
use hysteron::identification::fit::{residual, rms};
use hysteron::identify::{add, identify};
use hysteron::model_file::effects_named;
use hysteron::watch::Unwatched;
use hysteron_sim::chain::Model;
use hysteron_sim::effect::delay;
use hysteron_tests::beside;
use hysteron_tests::measured::{record, stage};
use std::path::Path;

/// Sampling periods by which the readings come late.
const LATE_SAMPLES: usize = 5;
const LATE_S: f64 = 0.5e-3;

fn late(clean: &Dataset, late_samples: usize) -> Dataset {
    let mut out = clean.clone();
    for record in &mut out.records {
        let readings = &record.displacement_um;
        record.displacement_um = (0..readings.len())
            .map(|k| readings[k.saturating_sub(late_samples)])
            .collect();
    }
    out
}

/// Sines at 20 and 50 Hz, and one between them that is held out.
fn at_two_speeds(data: &Path) -> Dataset {
    let roles = [
        ("20_hz_no_lp", 1.5, Role::Identify),
        ("sine50_1", 0.2, Role::Identify),
        ("40_hz_no_lp", 1.5, Role::Validate),
    ];
    stage(
        roles
            .map(|(name, from_s, role)| record(data, name, from_s, role))
            .to_vec(),
    )
}

fn errors_um(model: &Model, dataset: &Dataset) -> Vec<f64> {
    dataset
        .records
        .iter()
        .map(|r| rms(&residual(model, r)))
        .collect()
}

/// A delay is named, added with its value, and the error is then that of the readings that came in time:
/// whatever the model has beside it.
#[test]
fn a_delay_of_real_readings_is_named_and_added() {
    let Some(data) = beside("measured") else {
        return;
    };
    let clean = stage(vec![
        record(&data, "20_hz_no_lp", 1.5, Role::Identify),
        record(&data, "40_hz_no_lp", 1.5, Role::Validate),
    ]);
    let late = late(&clean, LATE_SAMPLES);
    for ids in ["hysteresis,creep,vibration", "hysteresis,creep"] {
        let model = identify(&clean, &effects_named(ids).expect("known"), &Unwatched)
            .expect("it can be fitted")
            .model;
        let found = analyse(
            &late,
            Start::Model(model.clone()),
            &Options::default(),
            &Unwatched,
        )
        .expect("it can be explained");
        // Named, or the first of more alternatives than a name may have.
        let first = |f: &Finding| f.effects.first().is_some_and(|id| id == delay::ID);
        let open = found.diagnosis.so_far.first();
        let is_first =
            found.diagnosis.findings.iter().any(first) || open.is_some_and(|id| id == delay::ID);
        assert!(is_first, "{ids}: {}", found.diagnosis.sentence);
        let effect = effects_named(delay::ID).expect("known").remove(0);
        let added = add(&effect, model.clone(), &late, &Unwatched)
            .expect("it can be added")
            .model;
        let value_s = added.values(delay::ID).expect("it has a delay")[0];
        println!(
            "{ids}: {:.4} ms, {:?} um against {:?} um in time",
            1e3 * value_s,
            errors_um(&added, &late),
            errors_um(&model, &clean)
        );
        assert!((value_s - LATE_S).abs() < 0.01e-3, "{ids}: {value_s} s");
        for (with_delay, in_time) in errors_um(&added, &late)
            .iter()
            .zip(errors_um(&model, &clean))
        {
            assert!(
                *with_delay < 1.1 * in_time,
                "{ids}: {with_delay} and {in_time} um"
            );
        }
    }
}

/// From a bare gain, too, a delay ends up in the model, although a lag of the amplifier is the better guess
/// while creep and friction are still missing: effects of the best model are exchanged for others that do
/// much the same.
#[test]
fn a_delay_of_real_readings_takes_the_place_of_a_lag_that_was_added_first() {
    let Some(data) = beside("measured") else {
        return;
    };
    let late = late(&at_two_speeds(&data), 10);
    let gain = effects_named("gain").expect("known");
    let found = analyse(
        &late,
        Start::Effects(&gain),
        &Options::default(),
        &Unwatched,
    )
    .expect("it can be explained");
    let value_s = found
        .model
        .values(delay::ID)
        .unwrap_or_else(|| panic!("no delay in {:?}", found.model.effect_ids()))[0];
    println!(
        "{:.3} ms, {:?} um: {:?}",
        1e3 * value_s,
        errors_um(&found.model, &late),
        found.model.effect_ids()
    );
    assert!((value_s / 1e-3 - 1.0).abs() < 0.25, "{value_s} s");
}

/// Readings through a low-pass of first order, the motion between two of them a straight line.
fn lagging(clean: &Dataset, cutoff_hz: f64) -> Dataset {
    let mut out = clean.clone();
    for record in &mut out.records {
        let per_sample = std::f64::consts::TAU * cutoff_hz / record.sample_rate_hz;
        let (decay, straight) = (
            (-per_sample).exp(),
            (1.0 - (-per_sample).exp()) / per_sample,
        );
        let mut read_um = record.displacement_um[0];
        let mut before_um = read_um;
        for value_um in &mut record.displacement_um {
            read_um =
                decay * read_um + (1.0 - straight) * *value_um + (straight - decay) * before_um;
            before_um = std::mem::replace(value_um, read_um);
        }
    }
    out
}

/// At the two speeds that are fitted creep, friction and charge leakage together do what a lag does, and what
/// remains of the fitted records shows no lag. The held-out records show it.
#[test]
#[ignore = "open: a mode takes the lag in, at the same 25 and 69 nm"]
fn a_lag_that_a_model_has_taken_in_is_seen_in_held_out_records() {
    let Some(data) = beside("measured") else {
        return;
    };
    let lagging = lagging(&at_two_speeds(&data), 1000.0);
    let gain = effects_named("gain").expect("known");
    let found = analyse(
        &lagging,
        Start::Effects(&gain),
        &Options::default(),
        &Unwatched,
    )
    .expect("it can be explained");
    let (ids, errors_um) = (found.model.effect_ids(), errors_um(&found.model, &lagging));
    println!("{errors_um:?} um: {ids:?}");
    let lags = [
        "sensor_bandwidth",
        "amplifier_bandwidth",
        "sensor_filter",
        delay::ID,
    ];
    assert!(
        lags.iter().any(|lag| ids.iter().any(|id| id == lag)),
        "no lag in {ids:?}"
    );
    // 11 and 20 nm of what is fitted, 64 nm held out.
    assert!(errors_um.iter().all(|um| *um < 0.07), "{errors_um:?} um");
}

/// The order in which records are given is no knowledge.
#[test]
fn the_order_of_real_records_does_not_matter() {
    let Some(data) = beside("measured") else {
        return;
    };
    let roles = [
        ("sine50_1", Role::Identify),
        ("20_hz_no_lp", Role::Identify),
        ("40_hz_no_lp", Role::Validate),
    ];
    let records: Vec<_> = roles
        .iter()
        .map(|(name, role)| record(&data, name, 1.5, *role))
        .collect();
    let gain = effects_named("gain").expect("known");
    let end = |records: Vec<_>| {
        let dataset = stage(records);
        analyse(
            &dataset,
            Start::Effects(&gain),
            &Options::default(),
            &Unwatched,
        )
        .expect("it can be explained")
        .model
    };
    let (one, other) = (
        end(records.clone()),
        end(records.iter().rev().cloned().collect()),
    );
    assert_eq!(one.effect_ids(), other.effect_ids());
    let dataset = stage(records);
    for (a, b) in errors_um(&one, &dataset)
        .iter()
        .zip(errors_um(&other, &dataset))
    {
        assert!((a / b - 1.0).abs() < 0.01, "{a} and {b} um");
    }
}

/// Loops stay in the place of a gain where the error asks for them: on these records their signature says
/// little of them, and a search that asked for it ended at a gain with everything else, at 54 and 179 nm.
#[test]
fn loops_of_a_real_stage_stay_in_the_place_of_a_gain() {
    let Some(data) = beside("measured") else {
        return;
    };
    let gain = effects_named("gain").expect("known");
    for (fitted, held_out, most_nm) in [
        ("tri50_1", "tri50_2", 15.0),
        ("bigsine_1", "bigsine_2", 90.0),
    ] {
        let dataset = stage(vec![
            record(&data, fitted, 0.2, Role::Identify),
            record(&data, held_out, 0.2, Role::Validate),
        ]);
        let model = analyse(
            &dataset,
            Start::Effects(&gain),
            &Options::default(),
            &Unwatched,
        )
        .expect("it can be explained")
        .model;
        let errors = errors_um(&model, &dataset);
        println!("{fitted}: {errors:?} um: {:?}", model.effect_ids());
        assert!(
            model.effect("gain").is_none(),
            "{fitted}: {:?}",
            model.effect_ids()
        );
        assert!(1e3 * errors[1] < most_nm, "{held_out}: {} um", errors[1]);
    }
}

/// Far above the noise what lowers every error stays in the model, and how much stays unexplained is reported
/// beside the names. Vibration explains one ring here, which by blocks of the record is no evidence.
#[test]
fn what_lowers_the_errors_of_a_real_stage_stays_with_a_remainder() {
    let Some(data) = beside("measured") else {
        return;
    };
    let roles = [
        ("sine50_1", Role::Identify),
        ("tri50_1", Role::Identify),
        ("sine50_3", Role::Validate),
        ("tri50_2", Role::Validate),
    ];
    let dataset = stage(
        roles
            .into_iter()
            .map(|(name, role)| record(&data, name, 0.2, role))
            .collect(),
    );
    let found = analyse(
        &dataset,
        Start::Effects(&effects_named("gain").expect("known")),
        &Options::default(),
        &Unwatched,
    )
    .expect("it ends");
    let errors = errors_um(&found.model, &dataset);
    println!("{errors:?} um: {:?}", found.model.effect_ids());
    assert!(
        1e3 * errors[2].hypot(errors[3]) / 2f64.sqrt() < 14.0,
        "{errors:?}"
    );
    assert!(
        found
            .diagnosis
            .remainder
            .times_noise
            .is_some_and(|times| times > 3.0),
        "{}",
        found.diagnosis.sentence
    );
}

/// The readings of a real stage have no outliers and end nowhere; those that were put in are found where the
/// motion is not as sharp, and no others.
#[test]
fn single_disturbed_readings_of_a_real_stage_are_replaced() {
    let Some(data) = beside("measured") else {
        return;
    };
    let names = [
        "20_hz_no_lp",
        "40_hz_no_lp",
        "sine50_1",
        "bigsine_1",
        "tri50_1",
    ];
    let clean: Vec<_> = names
        .iter()
        .map(|name| record(&data, name, 0.2, Role::Identify))
        .collect();
    let as_it_is = stage(clean.clone());
    assert!(
        as_it_is
            .issues
            .iter()
            .all(|issue| issue.severity == Severity::Notes),
        "{:?}",
        as_it_is.issues
    );
    assert!(
        as_it_is
            .records
            .iter()
            .all(|record| record.left_out.is_empty()),
        "{:?}",
        as_it_is.issues
    );
    let places: Vec<usize> = (3000..18_000).step_by(1500).collect();
    let mut disturbed = clean;
    for record in &mut disturbed {
        for (i, k) in places.iter().enumerate() {
            record.displacement_um[*k] += if i % 2 == 0 { 4.0 } else { -3.0 };
        }
    }
    let mended = stage(disturbed);
    let found = mended.records.iter().zip(&as_it_is.records).map(|(a, b)| {
        let apart_um = |k: usize| (a.displacement_um[k] - b.displacement_um[k]).abs();
        assert!(
            (0..b.displacement_um.len()).all(|k| places.contains(&k) || apart_um(k) == 0.0),
            "{}: others were changed",
            a.name
        );
        // Replaced, to what a stage moves between samples: they were 3 and 4 um away.
        places.iter().filter(|k| apart_um(**k) < 0.2).count()
    });
    // The sums of large sines hide two: one follows a jump of the drive, beside the other the stage moves
    // almost as sharply.
    assert_eq!(found.collect::<Vec<_>>(), [10, 10, 10, 8, 10]);
    let replaced = mended
        .issues
        .iter()
        .filter(|issue| matches!(issue.kind, IssueKind::OutliersReplaced { .. }));
    assert_eq!(replaced.count(), names.len(), "{:?}", mended.issues);
}
