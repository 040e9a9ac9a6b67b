//! Where a loop becomes unstable on stages that the simulation does not share, over where `check` predicts
//! it: prints the table that belongs to `docs/results/servo_from_data.md`.
//!
//!     cargo run --release --workspace --example first_unstable [STAGES [FIRST_SEED]]
//!
//! Each cell: the prediction; the true value over it where the servo begins at the lower limit of its drive;
//! where the stage changes slowly while it rests in the middle of its range (not for the mode, which cannot
//! come slowly); and over it what `check` says from where it swings beginning at the lower limit, and from
//! where it may once the drive was at a limit.
//!
//! Models are those of `servo_from_data`, kept in target/servo_from_data.

use hysteron::servo::check::check;
use hysteron::servo::design::ServoDesign;
use hysteron_research::stages_asked_for;
use hysteron_sim::chain::Model;
use hysteron_tests::independent_stage::{StageChange, StageTruth, TrueMode};
use hysteron_tests::servo_study::{
    LIMIT_CYCLE, StudyRecording, designed, designed_with_the_truth, kept_model, record,
    rest_after_slow_change_um, rest_um,
};

/// Shares of a prediction between which the true value is looked for.
const LOOKED_AT: (f64, f64) = (0.7, 1.4);

/// The true value over the predicted one; `Err` says on which side it is not found.
fn turn(oscillates: &dyn Fn(f64) -> bool, downwards: bool) -> Result<f64, &'static str> {
    let (mut stable, mut unstable) = if downwards {
        (LOOKED_AT.1, LOOKED_AT.0)
    } else {
        LOOKED_AT
    };
    if oscillates(stable) {
        return Err("earlier");
    }
    if !oscillates(unstable) {
        return Err("later");
    }
    while (unstable / stable - 1.0).abs() > 0.003 {
        let middle = (stable * unstable).sqrt();
        if oscillates(middle) {
            unstable = middle
        } else {
            stable = middle
        }
    }
    Ok((stable * unstable).sqrt())
}

/// One cell for each first unstable value.
fn cells(truth: &StageTruth, chain: &Model, design: &ServoDesign) -> Vec<String> {
    let Some(margins) = check(design, chain).ok().and_then(|c| c.margins) else {
        return vec!["-".into(); 6];
    };
    let (first, swinging) = (margins.first_unstable, margins.first_swinging);
    let limit_um = LIMIT_CYCLE * truth.noise_um;
    let from_rest = margins.first_from_rest.unwrap_or(first);
    let cell = |[free, begun, limited]: [Option<f64>; 3],
                scale: f64,
                downwards: bool,
                comes_slowly: bool,
                change: &dyn Fn(f64) -> StageChange| {
        let Some(value) = free else {
            return "none".to_owned();
        };
        let from_the_limit = |share: f64| rest_um(truth, change(share * value), design) > limit_um;
        let in_the_middle =
            |share: f64| rest_after_slow_change_um(truth, change(share * value), design) > limit_um;
        let words = |found: Result<f64, &str>| {
            found.map_or_else(str::to_owned, |share| format!("{share:.3}"))
        };
        let slowly = if comes_slowly {
            words(turn(&in_the_middle, downwards))
        } else {
            "-".into()
        };
        let [begun, swings] = [begun, limited]
            .map(|limited| limited.map_or("-".into(), |limited| format!("{:.3}", limited / value)));
        format!(
            "{:.3}: {} / {slowly} / {begun} / {swings}",
            scale * value,
            words(turn(&from_the_limit, downwards))
        )
    };
    let gain = |gain_ratio: f64| StageChange {
        gain_ratio,
        ..StageChange::NONE
    };
    let mass = |mass_ratio: f64| StageChange {
        mass_ratio,
        ..StageChange::NONE
    };
    let delay = |delay_s: f64| StageChange {
        delay_s,
        ..StageChange::NONE
    };
    let mode = |share: f64| StageChange {
        mode: first.mode.map(|m| TrueMode {
            frequency_hz: m.frequency_hz,
            damping_ratio: m.damping_ratio,
            share,
        }),
        ..StageChange::NONE
    };
    vec![
        cell(
            [first.gain_up, from_rest.gain_up, swinging.gain_up],
            1.0,
            false,
            true,
            &gain,
        ),
        cell(
            [first.gain_down, from_rest.gain_down, swinging.gain_down],
            1.0,
            true,
            true,
            &gain,
        ),
        cell(
            [first.mass_up, from_rest.mass_up, swinging.mass_up],
            1.0,
            false,
            true,
            &mass,
        ),
        cell(
            [first.mass_down, from_rest.mass_down, swinging.mass_down],
            1.0,
            true,
            true,
            &mass,
        ),
        cell(
            [first.delay_s, from_rest.delay_s, swinging.delay_s],
            1e6,
            false,
            true,
            &delay,
        ),
        cell(
            [first.mode, from_rest.mode, swinging.mode].map(|m| m.map(|m| m.share)),
            100.0,
            false,
            false,
            &mode,
        ),
    ]
}

fn main() {
    println!("| stage | servo | gain up | gain down | mass up | mass down | delay, us | mode, % |");
    println!("|---|---|---|---|---|---|---|---|");
    for seed in stages_asked_for() {
        let truth = StageTruth::drawn(seed);
        let dataset = record(&truth, StudyRecording::Wideband);
        let chain = kept_model(&truth, StudyRecording::Wideband, &dataset);
        let servos = [
            ("with the truth", designed_with_the_truth(&truth, &chain)),
            ("from the recording", designed(&chain, &dataset).ok()),
        ];
        for (name, design) in servos {
            if let Some(design) = design {
                println!(
                    "| {seed} | {name} | {} |",
                    cells(&truth, &chain, &design).join(" | ")
                );
            }
        }
    }
}
