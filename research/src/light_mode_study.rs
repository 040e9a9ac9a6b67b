//! Loops on a stage whose first mode is lightly damped: how far up a reference is followed, how much noise
//! becomes motion, and how far the mode may move, on
//! [`IndependentStage`](hysteron_tests::independent_stage::IndependentStage).

use hysteron::servo::design::ServoDesign;
use hysteron_sim::waveform;
use hysteron_tests::independent_stage::{StageChange, StageTruth, TrueMode};
use hysteron_tests::servo_study::{LIMIT_CYCLE, RATE_HZ, rest_um, run};
use std::f64::consts::TAU;

/// Frequency of the first mode, Hz: that of a measured stage.
pub const MODE_HZ: f64 = 739.0;

/// Added to the seed of a stage whose first mode was put elsewhere.
const OWN_SEEDS: u64 = 700;

/// Period of the reference by which a loop is measured, ticks: lines 12.5 Hz apart.
const PERIOD_TICKS: usize = 1600;
/// Periods that are let by, and that are measured.
const PERIODS: (usize, usize) = (20, 10);
/// Highest line, Hz.
const HIGHEST_HZ: f64 = 4000.0;
/// Amplification is looked for up to this many times the mode.
const PEAKS_TO: f64 = 1.5;
/// RMS of the reference about the middle of the range, um.
const REFERENCE_UM: f64 = 0.1;

/// The stage of a seed with its first mode at another frequency. Its seed is another one, so that its model
/// is kept under a name of its own.
#[must_use]
pub fn with_first_mode(seed: u64, frequency_hz: f64) -> StageTruth {
    let drawn = StageTruth::drawn(seed);
    StageTruth {
        seed: drawn.seed + OWN_SEEDS,
        first_mode: TrueMode {
            frequency_hz,
            ..drawn.first_mode
        },
        ..drawn
    }
}

/// Magnitude of the true position over the reference, by frequency, Hz.
#[must_use]
pub fn reference_response(truth: &StageTruth, design: &ServoDesign) -> Vec<(f64, f64)> {
    let line_hz = RATE_HZ / PERIOD_TICKS as f64;
    let lines: Vec<usize> = (1..=(HIGHEST_HZ / line_hz) as usize).collect();
    let middle_um = 0.5 * truth.travel_um;
    let periods = PERIODS.0 + PERIODS.1;
    let mut small = waveform::multisine(
        PERIOD_TICKS,
        &lines,
        REFERENCE_UM,
        0.0,
        periods + 1,
        truth.seed,
    );
    let rms = (small.iter().map(|r| r * r).sum::<f64>() / small.len() as f64).sqrt();
    small.iter_mut().for_each(|r| *r *= REFERENCE_UM / rms);
    let mut reference: Vec<f64> = vec![middle_um; 20_000];
    waveform::grow_from_zero(&mut reference, RATE_HZ);
    let begin = reference.len();
    // From nothing to its full size over the first periods.
    let grown = 4 * PERIOD_TICKS;
    reference.extend(
        small
            .iter()
            .enumerate()
            .map(|(k, r)| middle_um + r * (k as f64 / grown as f64).min(1.0)),
    );
    let trace = run(truth, StageChange::NONE, design, &reference);
    let from = begin + PERIODS.0 * PERIOD_TICKS;
    let window = from..from + PERIODS.1 * PERIOD_TICKS;
    let at = |signal: &[f64], line: usize| {
        let (mut re, mut im) = (0.0, 0.0);
        for (k, v) in signal[window.clone()].iter().enumerate() {
            let (sin, cos) =
                (TAU * (line * (k % PERIOD_TICKS)) as f64 / PERIOD_TICKS as f64).sin_cos();
            (re, im) = (re + (v - middle_um) * cos, im - (v - middle_um) * sin);
        }
        re.hypot(im)
    };
    lines
        .iter()
        .map(|line| {
            (
                *line as f64 * line_hz,
                at(&trace.displacement_um, *line) / at(&trace.reference_um, *line),
            )
        })
        .collect()
}

/// First frequency at which a response falls below -3 dB, Hz.
#[must_use]
pub fn bandwidth_hz(response: &[(f64, f64)]) -> f64 {
    response
        .iter()
        .find(|(_, magnitude)| *magnitude < 0.5f64.sqrt())
        .map_or(HIGHEST_HZ, |(hz, _)| *hz)
}

/// Largest magnitude of a response up to one and a half times the mode of [`MODE_HZ`].
#[must_use]
pub fn peak(response: &[(f64, f64)]) -> f64 {
    let highest_hz = PEAKS_TO * MODE_HZ;
    response
        .iter()
        .filter(|(hz, _)| *hz <= highest_hz)
        .map(|(_, magnitude)| *magnitude)
        .fold(0.0, f64::max)
}

/// The stage with its first mode at a multiple of its frequency.
#[must_use]
pub fn moved(truth: &StageTruth, factor: f64) -> StageTruth {
    let first_mode = TrueMode {
        frequency_hz: factor * truth.first_mode.frequency_hz,
        ..truth.first_mode
    };
    StageTruth {
        first_mode,
        ..truth.clone()
    }
}

/// Whether a servo oscillates by itself where the first mode stands elsewhere.
#[must_use]
pub fn oscillates_with_mode_at(truth: &StageTruth, factor: f64, design: &ServoDesign) -> bool {
    let rest_um = rest_um(&moved(truth, factor), StageChange::NONE, design);
    rest_um.is_nan() || rest_um > LIMIT_CYCLE * truth.noise_um
}

/// Factors of the first mode's frequency between which the servo is stable, in steps of 2.5 % up to 50 %.
#[must_use]
pub fn stable_range(truth: &StageTruth, design: &ServoDesign) -> (f64, f64) {
    let reach = |up: f64| {
        (1..=20)
            .map(|i| 1.0 + up * 0.025 * f64::from(i))
            .take_while(|f| !oscillates_with_mode_at(truth, *f, design))
            .last()
    };
    if oscillates_with_mode_at(truth, 1.0, design) {
        return (f64::NAN, f64::NAN);
    }
    (reach(-1.0).unwrap_or(1.0), reach(1.0).unwrap_or(1.0))
}
