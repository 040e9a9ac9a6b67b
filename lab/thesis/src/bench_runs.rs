//! Servos on the reference bench: references of the thesis, one run, and the figures of it.
//!
//! Every run is a conditioning cycle, zeroing of the sensor, and the reference of the thesis with the bench's
//! offset. Errors are of what the sensor reads, noise removed, after the first part of the run, with the true
//! ones beside.
//!
//! Whatever is chosen by a run is chosen on [`CHOICE_HZ`] with [`CHOICE_SEED`], which no figure is judged on.

use crate::chapter::{ChapterProgress, ChapterRow, ErrorPair, RunKey};
use crate::commissioning::{CommissionedStage, on_bench};
use hysteron::servo::design::{Scheme, ServoDesign};
use hysteron::servo::model::{
    ActuatorModel, LinearModel, ModeModel, NominalModel, SAMPLING_PERIOD_S,
};
use hysteron::servo::order::scheme_without_recording;
use hysteron::servo::quantise::QuantisationError;
use hysteron::servo::reference::{lead_s, period_ticks};
use hysteron::servo::scheme_choice::SchemeChoice;
use hysteron::servo::sensor_lag::lag_s;
use hysteron::servo::thesis_schemes::{Estimator, ReachingGains};
use hysteron::servo::track::repeats_when_grown;
use hysteron::servo::tuning::Demands;
use hysteron_core::servo_tick::ServoTick;
use hysteron_sim::bench::{Bench, Completeness, Variant};
use hysteron_sim::closed_loop::{Experiment, Trace};
use hysteron_sim::waveform;
use rayon::prelude::*;
use std::f64::consts::{FRAC_PI_2, TAU};

/// A scheme of Chapter 6: its name in the rows' identifiers, the servo, and where its gains come from.
pub type NamedScheme = (&'static str, ServoDesign, &'static str);

/// The drive of Ch. 7, Eq. (35), its quintic blended to the value at which the sines begin (the printed one
/// misses it).
#[must_use]
pub fn equation_35_v(sample_rate_hz: f64, duration_s: f64) -> Vec<f64> {
    let sines = |t: f64| {
        let s = t - 0.03;
        75.0 / 7.0 * (TAU * 10.0 * s + 2.0 * FRAC_PI_2).sin()
            + 125.0 / 14.0 * (TAU * 40.0 * s + FRAC_PI_2).sin()
            + 25.0 / 7.0 * (TAU * 100.0 * s + 0.2 * 2.0 * FRAC_PI_2).sin()
            + 15.0 / 14.0 * (TAU * 200.0 * s).sin()
            + 25.0
    };
    (0..waveform::samples_in(sample_rate_hz, duration_s))
        .map(|k| {
            let t = k as f64 / sample_rate_hz;
            if t <= 0.02 {
                0.0
            } else if t <= 0.03 {
                let s = (t - 0.02) / 0.01;
                sines(0.03) * s.powi(3) * (10.0 - 15.0 * s + 6.0 * s * s)
            } else {
                sines(t)
            }
        })
        .collect()
}

/// A figure in micrometres.
pub fn row_um(id: impl Into<String>, ours: f64, note: impl Into<String>) -> ChapterRow {
    ChapterRow::new(id, ours, "um", note)
}

/// The error of a run from a sample on, true and as the sensor reads it.
fn row_of_run(
    id: impl Into<String>,
    trace: &Trace,
    from: usize,
    condition: &str,
    drive: String,
) -> ChapterRow {
    let (truth, sensor) = (trace.true_error(from), trace.sensor_error(from));
    let max = Some(ErrorPair {
        truth: truth.max_um,
        sensor: sensor.max_um,
    });
    let row = row_um(id, sensor.rms_um, note_of(trace, from, condition));
    ChapterRow {
        truth: Some(truth.rms_um),
        max,
        ..row
    }
    .on(drive, JUDGED_SEED)
}

/// Seed of the noise of every run that is judged.
pub const JUDGED_SEED: u64 = 7;
/// Seed of the noise of every run by which gains are chosen.
pub const CHOICE_SEED: u64 = 107;
/// Frequency of the sine by which gains are chosen, Hz: between those that are judged.
pub const CHOICE_HZ: f64 = 7.0;

/// A sine as a run is named by.
#[must_use]
pub fn sine_key(hz: f64, amplitude_um: f64) -> String {
    format!("sine of {hz} Hz, {amplitude_um} um")
}

/// The run by which gains are chosen.
#[must_use]
pub fn choice() -> RunKey {
    RunKey::new(sine_key(CHOICE_HZ, 5.0), CHOICE_SEED)
}

/// Steps of the plant in a period.
pub const SUBSTEPS: usize = 10;

/// Frequencies of Ch. 7, Table I, Hz.
pub const FREQUENCIES_HZ: [f64; 6] = [1.0, 5.0, 10.0, 50.0, 100.0, 150.0];

/// The loaded full bench.
pub const LOADED: Variant = Variant {
    completeness: Completeness::Full,
    loaded: true,
};

/// The loaded plain bench, on which the thesis' schemes run.
pub const LOADED_PLAIN: Variant = Variant {
    completeness: Completeness::Plain,
    loaded: true,
};

/// `offset + amplitude sin(2 pi f t - pi/2)` (Ch. 6, Eq. 43), grown from zero in 0.3 s, then for two periods
/// or a second; and the sample from which the error counts: after half a second.
#[must_use]
pub fn sine_reference_um(bench: &Bench, frequency_hz: f64, amplitude_um: f64) -> (Vec<f64>, usize) {
    sine_that_counts_after_um(bench, frequency_hz, amplitude_um, 0.5)
}

/// The same with another time before the error counts.
fn sine_that_counts_after_um(
    bench: &Bench,
    frequency_hz: f64,
    amplitude_um: f64,
    settle_s: f64,
) -> (Vec<f64>, usize) {
    let fs = bench.converters.sample_rate_hz;
    let duration_s = settle_s + (2.0 / frequency_hz).max(1.0);
    let mut reference = waveform::sine(
        fs,
        frequency_hz,
        amplitude_um,
        bench.reference_offset_um,
        -FRAC_PI_2,
        duration_s,
    );
    waveform::grow_from_zero(&mut reference, fs);
    (reference, waveform::samples_in(fs, settle_s))
}

/// The quasi-step of Ch. 6, Eq. (44), 8 s long.
#[must_use]
pub fn quasi_step_um(sample_rate_hz: f64, duration_s: f64) -> Vec<f64> {
    (0..waveform::samples_in(sample_rate_hz, duration_s))
        .map(|k| {
            let s = ((k as f64 / sample_rate_hz - 0.1) / 0.05).clamp(0.0, 1.0);
            5.0 * s.powi(3) * (10.0 - 15.0 * s + 6.0 * s * s)
        })
        .collect()
}

/// Runs a design on a variant of the bench.
///
/// # Errors
/// If the design does not fit the tick's formats.
pub fn run(
    bench: &Bench,
    variant: Variant,
    design: &ServoDesign,
    reference_um: &[f64],
    seed: u64,
) -> Result<Trace, QuantisationError> {
    run_repeating(bench, variant, design, reference_um, None, seed)
}

/// The same with a reference whose period, in ticks, the servo receives once it has grown.
fn run_repeating(
    bench: &Bench,
    variant: Variant,
    design: &ServoDesign,
    reference_um: &[f64],
    period_ticks: Option<u32>,
    seed: u64,
) -> Result<Trace, QuantisationError> {
    let mut experiment = Experiment::new(bench, variant, seed);
    experiment.substeps = SUBSTEPS;
    let servo = ServoTick::new(design.parameters(bench.converter_scale().parameters())?);
    Ok(experiment.follow_with(
        repeats_when_grown(servo, period_ticks, SAMPLING_PERIOD_S),
        reference_um,
    ))
}

/// A design that only carries a scheme that needs no model; the limits of the drive are the bench's data
/// sheet.
#[must_use]
pub fn without_model(bench: &Bench, scheme: Scheme) -> ServoDesign {
    let model = ActuatorModel {
        drive_min_v: bench.drive_min_v,
        drive_max_v: bench.drive_max_v,
        g_um: vec![vec![0.0, -10.0], vec![10.0, 0.0]],
        r_um: vec![0.0],
        linear: LinearModel {
            first_mode: ModeModel {
                natural_frequency_rad_s: NominalModel::THESIS.natural_frequency_rad_s,
                damping_ratio: NominalModel::THESIS.damping_ratio,
            },
            second_mode: None,
            amplifier_bandwidth_hz: None,
            sensor_bandwidth_hz: None,
            period_s: SAMPLING_PERIOD_S,
        },
        creep: Vec::new(),
        creep_pair: None,
    };
    ServoDesign::new(scheme, &model, false)
}

fn note_of(trace: &Trace, from: usize, condition: &str) -> String {
    let c = &trace.counters;
    let mut note = condition.to_owned();
    let limited_ticks = trace.limited_after(from);
    if limited_ticks + c.saturated_values > 0 {
        note += &format!(
            "; drive at a limit in {} ticks, {} saturated values",
            limited_ticks, c.saturated_values
        );
    }
    note
}

pub fn tracking(
    bench: &Bench,
    variant: Variant,
    design: &ServoDesign,
    id: &str,
    hz: f64,
    amplitude_um: f64,
    condition: &str,
) -> ChapterRow {
    let (reference, from) = sine_that_counts_after_um(bench, hz, amplitude_um, lead_s(design, hz));
    match run_repeating(
        bench,
        variant,
        design,
        &reference,
        period_ticks(hz, SAMPLING_PERIOD_S),
        JUDGED_SEED,
    ) {
        Ok(trace) => row_of_run(id, &trace, from, condition, sine_key(hz, amplitude_um)),
        Err(e) => row_um(id, f64::NAN, e.to_string()),
    }
}

/// Mean error over the last half second, um.
#[must_use]
pub fn steady_um(trace: &Trace) -> f64 {
    let n = trace.sensor_um.len();
    let from = n.saturating_sub(10_000);
    let count = (n - from).max(1) as f64;
    trace
        .sensor_um
        .iter()
        .zip(&trace.reference_um)
        .skip(from)
        .map(|(y, r)| y - r)
        .sum::<f64>()
        / count
}

/// Time after the end of the quasi-step from which the error stays within a band, s.
#[must_use]
pub fn settling_s(trace: &Trace, band_um: f64, sample_rate_hz: f64) -> f64 {
    let end = (0.15 * sample_rate_hz) as usize;
    let last = trace
        .sensor_um
        .iter()
        .zip(&trace.reference_um)
        .rposition(|(y, r)| (y - r).abs() > band_um);
    last.map_or(0.0, |k| (k + 1).saturating_sub(end) as f64 / sample_rate_hz)
}

/// Gains in words.
pub fn gains_of(scheme: &Scheme) -> String {
    match scheme {
        Scheme::Pid { gains, .. } => format!(
            "P = {} V/um, I = {} V/(um s), D = {:e} V s/um",
            gains.p, gains.i, gains.d
        ),
        Scheme::SlidingMode {
            controller: c,
            reaching,
            estimator,
            ..
        } => match reaching {
            ReachingGains::Pid => {
                format!(
                    "m = {:.0}, P_c = {:.2e}, I_c = {:.3}, D_c = {:e}; {}",
                    c.m,
                    c.p,
                    c.i,
                    c.d,
                    estimator_in_words(estimator)
                )
            }
            ReachingGains::Switching { eta_v } => format!("m = {}, eta = {eta_v} V", c.m),
            ReachingGains::BoundaryLayer { eta_v, delta_um_s } => {
                format!("m = {}, eta = {eta_v} V, delta = {delta_um_s:.0} um/s", c.m)
            }
        },
        _ => String::new(),
    }
}

fn estimator_in_words(estimator: &Estimator) -> String {
    match estimator {
        Estimator::Pidsmo(o) => format!("P_o = {:.2}, I_o = {:.0}, D_o = {:.1e}", o.p, o.i, o.d),
        Estimator::AlphaBeta(f) => format!(
            "xi_f = {:.2}, w_fn = {:.0} rad/s",
            f.damping_ratio, f.natural_frequency_rad_s
        ),
    }
}

pub fn quasi_step_rows(
    bench: &Bench,
    variant: Variant,
    design: &ServoDesign,
    id: &str,
    condition: &str,
) -> Vec<ChapterRow> {
    let fs = bench.converters.sample_rate_hz;
    let reference = quasi_step_um(fs, 8.0);
    match run(bench, variant, design, &reference, JUDGED_SEED) {
        Ok(trace) => {
            let tail = trace.sensor_um.len().saturating_sub(10_000);
            // Chattering: what the drive jumps from tick to tick while nothing moves.
            let jumps: Vec<f64> = trace.drive_v[tail..]
                .windows(2)
                .map(|w| w[1] - w[0])
                .collect();
            let chatter_v =
                (jumps.iter().map(|j| j * j).sum::<f64>() / jumps.len().max(1) as f64).sqrt();
            let settle = settling_s(&trace, 0.01, fs);
            vec![
                row_of_run(
                    format!("{id}.step.rms"),
                    &trace,
                    0,
                    &format!("quasi-step, 8 s, {condition}"),
                    "quasi-step".into(),
                ),
                row_um(
                    format!("{id}.steady"),
                    steady_um(&trace).abs(),
                    format!("mean error of the last 0.5 s, {condition}"),
                )
                .on("quasi-step", JUDGED_SEED),
                ChapterRow::new(
                    format!("{id}.step.chatter"),
                    chatter_v,
                    "V",
                    "RMS change of the drive from tick to tick at rest",
                ),
                ChapterRow::new(
                    format!("{id}.step.settling"),
                    1e3 * settle,
                    "ms",
                    "to 10 nm after the end of the step; 7850 if never",
                ),
            ]
        }
        Err(e) => vec![row_um(format!("{id}.step.rms"), f64::NAN, e.to_string())],
    }
}

/// A commissioned variant of the bench.
#[derive(Clone, Debug)]
pub struct Commissioned {
    /// What was identified.
    pub identified: CommissionedStage,
    /// The best design for it.
    pub design: ServoDesign,
}

/// A scheme designed for an identified model under the margins that `design` keeps where no recording stands
/// behind it, with the period of delay.
#[must_use]
pub fn designed(c: &Commissioned, choice: SchemeChoice, inverse: bool) -> Option<ServoDesign> {
    let scheme = scheme_without_recording(&c.design, choice, inverse).ok()?;
    let mut design = ServoDesign {
        scheme,
        trade_off: Vec::new(),
        ..c.design.clone()
    };
    design.sensor_lag_s = c.identified.model.linear.sensor_bandwidth_hz.map(lag_s);
    Some(design)
}

/// Identifies a variant of the bench and designs the best predictor for it.
#[must_use]
pub fn commission(bench: &Bench, variant: Variant) -> Option<Commissioned> {
    let identified = on_bench(bench, variant, 23)?;
    let design = ServoDesign::best(&identified.model, &Demands::default())?;
    Some(Commissioned { identified, design })
}

/// Commissions the plain, the full, and the full bench with load.
#[must_use]
pub fn commission_all(bench: &Bench, progress: ChapterProgress) -> Vec<Option<Commissioned>> {
    progress("identifying three variants of the bench");
    [Variant::PLAIN, Variant::FULL, LOADED]
        .into_par_iter()
        .map(|v| commission(bench, v))
        .collect()
}
