//! Chapters 6 and 7 of the thesis on the reference bench: every scheme with the integers that run on the target.
//!
//! # How it works
//! Each variant of the bench (plain, full, full with load) is commissioned once: its model is identified from records, and the best predictor
//! is designed from that model. The schemes of the thesis run with the thesis' gains and, as there, without computational delay. Every run
//! is a conditioning cycle, zeroing of the sensor, and the reference of the thesis with the bench's offset. Errors are of what the
//! sensor reads, noise removed, after the first part of the run; the note gives the true ones.

use super::comparison;
use super::design::{Scheme, ServoDesign, thesis_scheme};
use super::figures;
use super::float_twin::integer_difference_um;
use super::identify::{Identified, on_bench};
use super::model::{ActuatorModel, ModeModel, NominalModel};
use super::predictor::Demands;
use super::quantise::QuantisationError;
use super::robustness;
use super::thesis_schemes::{ControllerGains, Estimator, ObserverGains, PidGains, ReachingGains, estimator_rows};
use crate::reproduce::{Chapter, Progress, Row};
use hysteron_core::one_sided_hysteresis::OneSidedHysteresis;
use hysteron_core::predictor_law::PredictorLaw;
use hysteron_core::reference_window::ReferenceWindow;
use hysteron_core::servo_parameters::{ActuatorParameters, LawParameters};
use hysteron_core::signal::Micrometres;
use hysteron_sim::bench::{Bench, Completeness, Start, Variant};
use hysteron_sim::closed_loop::{ErrorFigures, Experiment, Trace, converter_parameters};
use hysteron_sim::waveform;
use rayon::prelude::*;

use std::f64::consts::{FRAC_PI_2, TAU};

/// A figure in micrometres.
pub(super) fn row_um(id: impl Into<String>, ours: f64, note: impl Into<String>) -> Row {
    Row::new(id, ours, "um", note)
}

/// Steps of the plant in a period.
pub const SUBSTEPS: usize = 10;
/// Frequencies of Ch. 7, Table I, Hz.
pub(super) const FREQUENCIES_HZ: [f64; 6] = [1.0, 5.0, 10.0, 50.0, 100.0, 150.0];

/// The loaded full bench.
pub(super) const LOADED: Variant = Variant { completeness: Completeness::Full, loaded: true };
/// The loaded plain bench, on which the thesis' schemes run.
pub(super) const LOADED_PLAIN: Variant = Variant { completeness: Completeness::Plain, loaded: true };

/// `offset + amplitude sin(2 pi f t - pi/2)` (Ch. 6, Eq. 43), grown from zero in 0.3 s, then for two periods or a second; and the sample from which
/// the error counts.
#[must_use]
pub fn sine_reference_um(bench: &Bench, frequency_hz: f64, amplitude_um: f64) -> (Vec<f64>, usize) {
    let fs = bench.converters.sample_rate_hz;
    let settle_s = 0.5;
    let duration_s = settle_s + (2.0 / frequency_hz).max(1.0);
    let mut reference = waveform::sine(fs, frequency_hz, amplitude_um, bench.reference_offset_um, -FRAC_PI_2, duration_s);
    grow(&mut reference, fs);
    (reference, waveform::samples_in(fs, settle_s))
}

/// Lets a reference grow from zero within 0.3 s, smooth to its second derivative: it never asks for what the one-sided actuator cannot give.
pub fn grow(reference_um: &mut [f64], sample_rate_hz: f64) {
    for (k, r) in reference_um.iter_mut().enumerate() {
        let s = (k as f64 / sample_rate_hz / 0.3).min(1.0);
        *r *= s.powi(3) * (10.0 - 15.0 * s + 6.0 * s * s);
    }
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
pub fn run(bench: &Bench, variant: Variant, design: &ServoDesign, reference_um: &[f64], seed: u64) -> Result<Trace, QuantisationError> {
    let parameters = design.parameters(converter_parameters(bench, 0.0))?;
    let mut experiment = Experiment::new(bench, variant, seed);
    experiment.substeps = SUBSTEPS;
    Ok(experiment.follow(&parameters, reference_um))
}

/// A design that only carries a scheme that needs no model; the limits of the drive are the bench's data sheet.
#[must_use]
pub fn without_model(bench: &Bench, scheme: Scheme) -> ServoDesign {
    let model = ActuatorModel {
        drive_min_v: bench.drive_min_v,
        drive_max_v: bench.drive_max_v,
        g_um: vec![vec![0.0, -10.0], vec![10.0, 0.0]],
        r_um: vec![0.0],
        linear: super::model::LinearModel {
            first_mode: ModeModel {
                natural_frequency_rad_s: NominalModel::THESIS.natural_frequency_rad_s,
                damping_ratio: NominalModel::THESIS.damping_ratio,
            },
            second_mode: None,
            amplifier_bandwidth_hz: None,
            sensor_bandwidth_hz: None,
        },
        creep: Vec::new(),
    };
    ServoDesign::new(scheme, &model, false)
}

fn note_of(trace: &Trace, from: usize, condition: &str) -> String {
    let (sensor, truth) = (trace.sensor_error(from), trace.true_error(from));
    let c = &trace.counters;
    let mut note = format!("{condition}; max {:.4} um; true displacement {:.4} um RMS", sensor.max_um, truth.rms_um);
    let limited_ticks = trace.limited_after(from);
    if limited_ticks + c.saturated_values > 0 {
        note += &format!("; drive at a limit in {} ticks, {} saturated values", limited_ticks, c.saturated_values);
    }
    note
}

pub(super) fn tracking(
    bench: &Bench,
    variant: Variant,
    design: &ServoDesign,
    id: &str,
    hz: f64,
    amplitude_um: f64,
    condition: &str,
) -> Row {
    let (reference, from) = sine_reference_um(bench, hz, amplitude_um);
    match run(bench, variant, design, &reference, 7) {
        Ok(trace) => row_um(id, trace.sensor_error(from).rms_um, note_of(&trace, from, condition)),
        Err(e) => row_um(id, f64::NAN, e.to_string()),
    }
}

/// Mean error over the last half second, um.
#[must_use]
pub fn steady_um(trace: &Trace) -> f64 {
    let n = trace.sensor_um.len();
    let from = n.saturating_sub(10_000);
    let count = (n - from).max(1) as f64;
    trace.sensor_um.iter().zip(&trace.reference_um).skip(from).map(|(y, r)| y - r).sum::<f64>() / count
}

/// Time after the end of the quasi-step from which the error stays within a band, s.
#[must_use]
pub fn settling_s(trace: &Trace, band_um: f64, sample_rate_hz: f64) -> f64 {
    let end = (0.15 * sample_rate_hz) as usize;
    let last = trace.sensor_um.iter().zip(&trace.reference_um).rposition(|(y, r)| (y - r).abs() > band_um);
    last.map_or(0.0, |k| (k + 1).saturating_sub(end) as f64 / sample_rate_hz)
}

/// The candidate with the least RMS error at 10 Hz on the plain bench: tuned as the thesis tuned its schemes, by trial.
fn tuned(bench: &Bench, candidates: Vec<Scheme>) -> Option<Scheme> {
    let (reference, from) = sine_reference_um(bench, 10.0, 5.0);
    candidates
        .into_par_iter()
        .filter_map(|scheme| {
            let trace = run(bench, Variant::PLAIN, &without_model(bench, scheme.clone()), &reference, 7).ok()?;
            let rms_um = trace.sensor_error(from).rms_um;
            rms_um.is_finite().then_some((rms_um, scheme))
        })
        .min_by(|a, b| a.0.total_cmp(&b.0))
        .map(|(_, scheme)| scheme)
}

fn pid_candidates() -> Vec<Scheme> {
    let mut out = Vec::new();
    for p in [0.0, 2.0, 4.0, 6.0, 8.0] {
        for i in [40e3, 55.1e3, 70e3, 80e3, 90e3, 100e3, 120e3] {
            out.push(Scheme::Pid { gains: PidGains { p, i, d: 1e-8 }, notch: None });
        }
    }
    out
}

fn reaching_candidates(reaching: &[ReachingGains]) -> Vec<Scheme> {
    let Some(Scheme::SlidingMode { nominal, estimator, controller, .. }) = thesis_scheme("pidsm-chapter-6") else { return Vec::new() };
    reaching.iter().map(|reaching| Scheme::SlidingMode { nominal, estimator, controller, reaching: *reaching }).collect()
}

/// A scheme of Chapter 6: its name in the rows' identifiers, its gains, and where these come from.
pub type NamedScheme = (&'static str, Scheme, &'static str);

/// PIDSM, PID, ideal sliding mode and boundary layer. PIDSM has the thesis' gains; the others are tuned on the bench by the thesis'
/// criterion, and their thesis gains stand beside.
#[must_use]
pub fn schemes_of_chapter_6(bench: &Bench) -> Vec<NamedScheme> {
    let switching: Vec<ReachingGains> =
        [7.0, 8.0, 9.0, 10.0, 11.0, 12.0, 15.0].into_iter().map(|eta_v| ReachingGains::Switching { eta_v }).collect();
    let mut layers = Vec::new();
    for eta_v in [60.0, 122.0, 200.0] {
        // Slope at the surface, V s/um: the thesis has 122 / 60000.
        for slope in [0.0005, 0.0007, 0.0009, 0.0011, 0.0013, 0.0015, 0.002] {
            layers.push(ReachingGains::BoundaryLayer { eta_v, delta_um_s: eta_v / slope });
        }
    }
    let thesis = "thesis gains";
    let on_bench = "tuned on the bench for 10 Hz";
    let schemes: Vec<(&'static str, Option<Scheme>, &'static str)> = vec![
        ("pidsm_ab", thesis_scheme("pidsm-chapter-6"), thesis),
        ("pid", tuned(bench, pid_candidates()), on_bench),
        ("sm_ab", tuned(bench, reaching_candidates(&switching)), on_bench),
        ("smcbl", tuned(bench, reaching_candidates(&layers)), on_bench),
        ("pid_thesis", thesis_scheme("pid"), thesis),
        ("sm_ab_thesis", thesis_scheme("sliding-mode"), thesis),
        ("smcbl_thesis", thesis_scheme("boundary-layer"), thesis),
    ];
    schemes.into_iter().filter_map(|(id, scheme, gains)| Some((id, scheme?, gains))).collect()
}

/// Chapter 6: sines and the quasi-step with every scheme.
#[must_use]
pub fn rows_of_chapter_6(bench: &Bench, schemes: &[NamedScheme]) -> Vec<Row> {
    let mut jobs: Vec<(String, ServoDesign, Option<f64>, String)> = Vec::new();
    for (id, scheme, gains) in schemes {
        let condition = format!("plain bench, {gains}, no delay: {}", gains_of(scheme));
        let design = without_model(bench, scheme.clone());
        for hz in [10.0, 50.0, 100.0, 150.0] {
            jobs.push((format!("ch6.{id}.{hz}hz.rms"), design.clone(), Some(hz), format!("{hz} Hz, {condition}")));
        }
        jobs.push((format!("ch6.{id}"), design, None, condition));
    }
    jobs.par_iter()
        .flat_map_iter(|(id, design, hz, condition)| match hz {
            Some(hz) => vec![tracking(bench, Variant::PLAIN, design, id, *hz, 5.0, condition)],
            None => quasi_step_rows(bench, Variant::PLAIN, design, id, condition),
        })
        .collect()
}

/// Gains in words.
pub(super) fn gains_of(scheme: &Scheme) -> String {
    match scheme {
        Scheme::Pid { gains, .. } => format!("P = {} V/um, I = {} V/(um s), D = {:e} V s/um", gains.p, gains.i, gains.d),
        Scheme::SlidingMode { controller: c, reaching, estimator, .. } => match reaching {
            ReachingGains::Pid => {
                format!("m = {:.0}, P_c = {:.2e}, I_c = {:.3}, D_c = {:e}; {}", c.m, c.p, c.i, c.d, estimator_in_words(estimator))
            }
            ReachingGains::Switching { eta_v } => format!("m = {}, eta = {eta_v} V", c.m),
            ReachingGains::BoundaryLayer { eta_v, delta_um_s } => format!("m = {}, eta = {eta_v} V, delta = {delta_um_s:.0} um/s", c.m),
        },
        _ => String::new(),
    }
}

fn estimator_in_words(estimator: &Estimator) -> String {
    match estimator {
        Estimator::Pidsmo(o) => format!("P_o = {:.2}, I_o = {:.0}, D_o = {:.1e}", o.p, o.i, o.d),
        Estimator::AlphaBeta(f) => format!("xi_f = {:.2}, w_fn = {:.0} rad/s", f.damping_ratio, f.natural_frequency_rad_s),
    }
}

fn quasi_step_rows(bench: &Bench, variant: Variant, design: &ServoDesign, id: &str, condition: &str) -> Vec<Row> {
    let fs = bench.converters.sample_rate_hz;
    let reference = quasi_step_um(fs, 8.0);
    match run(bench, variant, design, &reference, 7) {
        Ok(trace) => {
            let tail = trace.sensor_um.len().saturating_sub(10_000);
            // Chattering: what the drive jumps from tick to tick while nothing moves.
            let jumps: Vec<f64> = trace.drive_v[tail..].windows(2).map(|w| w[1] - w[0]).collect();
            let chatter_v = (jumps.iter().map(|j| j * j).sum::<f64>() / jumps.len().max(1) as f64).sqrt();
            let settle = settling_s(&trace, 0.01, fs);
            vec![
                row_um(
                    format!("{id}.step.rms"),
                    trace.sensor_error(0).rms_um,
                    note_of(&trace, 0, &format!("quasi-step, 8 s, {condition}")),
                ),
                row_um(format!("{id}.steady"), steady_um(&trace).abs(), format!("mean error of the last 0.5 s, {condition}")),
                Row {
                    id: format!("{id}.step.chatter"),
                    ours: chatter_v,
                    unit: "V".into(),
                    note: "RMS change of the drive from tick to tick at rest".into(),
                },
                Row {
                    id: format!("{id}.step.settling"),
                    ours: 1e3 * settle,
                    unit: "ms".into(),
                    note: "to 10 nm after the end of the step; 7850 if never".into(),
                },
            ]
        }
        Err(e) => vec![row_um(format!("{id}.step.rms"), f64::NAN, e.to_string())],
    }
}

/// A commissioned variant of the bench.
#[derive(Clone, Debug)]
pub struct Commissioned {
    /// What was identified.
    pub identified: Identified,
    /// The best design for it.
    pub design: ServoDesign,
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
pub fn commission_all(bench: &Bench, progress: Progress) -> Vec<Option<Commissioned>> {
    progress("identifying three variants of the bench");
    [Variant::PLAIN, Variant::FULL, LOADED].into_par_iter().map(|v| commission(bench, v)).collect()
}

/// Chapter 7: PIDSMOC against PIDSMC + alpha-beta, the best design, the observer, robustness.
#[must_use]
pub fn rows_of_chapter_7(bench: &Bench, commissioned: &[Option<Commissioned>], progress: Progress) -> Vec<Row> {
    let mut twelve_bits = bench.clone();
    twelve_bits.converters.dac_bits = 12;
    let mut jobs: Vec<(String, &Bench, Variant, ServoDesign, f64, f64, String)> = Vec::new();
    for hz in FREQUENCIES_HZ {
        for (name, id) in [("pidsmoc", "pidsmoc"), ("pidsmc-alpha-beta", "pidsmc_ab"), ("pidsmc-alpha-beta-discrete", "pidsmc_ab_discrete")]
        {
            for (variant, load) in [(Variant::PLAIN, "none"), (LOADED_PLAIN, "load")] {
                if let Some(scheme) = thesis_scheme(name) {
                    if let (Scheme::SlidingMode { nominal, estimator, controller, reaching }, "pidsmoc") = (&scheme, id) {
                        // The thesis compares I_c = 1 with I_c = 2, which decides at low frequency: the same integral gain beside.
                        let (nominal, estimator, reaching) = (*nominal, *estimator, *reaching);
                        let equal =
                            Scheme::SlidingMode { nominal, estimator, controller: ControllerGains { i: 2.0, ..*controller }, reaching };
                        let condition =
                            format!("{hz} Hz, {load}, plain bench, thesis gains but I_c = 2 as in PIDSMC + alpha-beta, no delay");
                        let id = format!("ch7.pidsmoc_equal_integral.{hz}hz.{load}.rms");
                        jobs.push((id, bench, variant, without_model(bench, equal), hz, 5.0, condition));
                    }
                    let condition = format!("{hz} Hz, {load}, plain bench, thesis gains, no delay");
                    jobs.push((format!("ch7.{id}.{hz}hz.{load}.rms"), bench, variant, without_model(bench, scheme), hz, 5.0, condition));
                }
            }
        }
    }
    for (index, variant, load, bench_name) in
        [(0, Variant::PLAIN, "none", "plain"), (1, Variant::FULL, "none", "full"), (2, LOADED, "load", "full")]
    {
        let Some(c) = commissioned.get(index).and_then(Option::as_ref) else { continue };
        for hz in FREQUENCIES_HZ {
            let condition = format!("{hz} Hz, {load}, {bench_name} bench, one period of delay, 16-bit DAC");
            jobs.push((format!("ch7.best.{hz}hz.{load}.{bench_name}.rms"), bench, variant, c.design.clone(), hz, 5.0, condition));
            let condition = format!("{hz} Hz, {load}, {bench_name} bench, one period of delay, 12-bit DAC");
            jobs.push((
                format!("ch7.best.{hz}hz.{load}.{bench_name}.dac12.rms"),
                &twelve_bits,
                variant,
                c.design.clone(),
                hz,
                5.0,
                condition,
            ));
        }
        let condition = format!("300 Hz, {load}, {bench_name} bench, one period of delay, 16-bit DAC");
        jobs.push((format!("ch7.best.300hz.{load}.{bench_name}.rms"), bench, variant, c.design.clone(), 300.0, 5.0, condition));
        let condition = format!("500 Hz 4 um, {load}, {bench_name} bench, one period of delay, 16-bit DAC");
        jobs.push((format!("ch7.best.500hz.{load}.{bench_name}.rms"), bench, variant, c.design.clone(), 500.0, 4.0, condition));
        if index == 1 {
            // The design for the bare actuator with the mass attached, unchanged.
            for hz in [1.0, 50.0, 150.0] {
                let condition = format!("{hz} Hz, load attached without a new design, full bench");
                jobs.push((format!("ch7.best.{hz}hz.load_not_redesigned.full.rms"), bench, LOADED, c.design.clone(), hz, 5.0, condition));
            }
        }
    }
    progress("following references");
    let mut rows: Vec<Row> = jobs
        .par_iter()
        .map(|(id, bench, variant, design, hz, amplitude, condition)| tracking(bench, *variant, design, id, *hz, *amplitude, condition))
        .collect();
    for (index, variant, name) in [(0, Variant::PLAIN, "plain"), (1, Variant::FULL, "full"), (2, LOADED, "full, loaded")] {
        let Some(c) = commissioned.get(index).and_then(Option::as_ref) else { continue };
        let id = format!("ch7.best.{}", ["plain", "full", "loaded"][index]);
        rows.extend(quasi_step_rows(bench, variant, &c.design, &id, &format!("{name} bench, best design, one period of delay")));
        rows.push(row_um(
            format!("{id}.identified.rms"),
            c.identified.rms_um,
            format!("residual of the identified model over the commissioning record: {:?}", c.identified.steps),
        ));
    }
    progress("integers against f64");
    let differences: Vec<Option<Row>> = [(0, Variant::PLAIN, "plain"), (1, Variant::FULL, "full"), (2, LOADED, "loaded")]
        .into_par_iter()
        .flat_map_iter(|(index, variant, name)| [1.0, 50.0, 150.0, 500.0].map(|hz| (index, variant, name, hz)))
        .map(|(index, variant, name, hz): (usize, Variant, &str, f64)| {
            let c = commissioned.get(index)?.as_ref()?;
            let (reference, _) = sine_reference_um(bench, hz, if hz > 300.0 { 4.0 } else { 5.0 });
            let figures = integer_difference_um(bench, variant, &c.design, &reference, 7).ok()??;
            let note = format!("what the sensor reads, integer servo minus the same law in f64, same noise; max {:.5} um", figures.max_um);
            Some(row_um(format!("ch7.integer.{hz}hz.{name}.rms"), figures.rms_um, note))
        })
        .collect();
    rows.extend(differences.into_iter().flatten());
    for (index, variant, id) in [(1, Variant::FULL, "noload"), (2, LOADED, "load")] {
        if let Some(c) = commissioned.get(index).and_then(Option::as_ref) {
            rows.extend(observer_rows(bench, variant, c, id));
        }
    }
    rows
}

/// Chapter 6 for the program.
///
/// # Errors
/// If the built-in bench cannot be read.
pub fn chapter_6(progress: Progress) -> Result<Chapter, String> {
    let bench = Bench::reference().map_err(|e| e.to_string())?;
    progress("following references with the schemes of chapter 6");
    let schemes = schemes_of_chapter_6(&bench);
    let rows = rows_of_chapter_6(&bench, &schemes);
    let sections = figures::chapter_6(&bench, &rows, &schemes);
    Ok(Chapter { number: 6, rows, sections })
}

/// Chapter 7 for the program.
///
/// # Errors
/// If the built-in bench cannot be read.
pub fn chapter_7(progress: Progress) -> Result<Chapter, String> {
    let bench = Bench::reference().map_err(|e| e.to_string())?;
    let commissioned = commission_all(&bench, progress);
    let mut rows = rows_of_chapter_7(&bench, &commissioned, progress);
    progress("both schemes of chapter 7 under one optimiser");
    rows.extend(comparison::rows_of_fair_tuning(&bench));
    progress("other schemes on the full bench");
    rows.extend(comparison::rows_of_other_schemes(&bench, &commissioned));
    progress("robustness");
    let robust = robustness::design();
    rows.extend(robust.iter().flat_map(robustness::rows));
    let sections = figures::chapter_7(&bench, &rows, commissioned.get(1).and_then(Option::as_ref), robust.as_ref().map(|r| &r.0));
    Ok(Chapter { number: 7, rows, sections })
}

/// The drive of Ch. 7, Eq. (35), its quintic blended to the value at which the sines begin (the printed one misses it).
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

/// Observer accuracy on Eq. (35): the design's own observer, and the PIDSMO with the thesis' gains.
fn observer_rows(bench: &Bench, variant: Variant, c: &Commissioned, id: &str) -> Vec<Row> {
    let fs = bench.converters.sample_rate_hz;
    let drive = equation_35_v(fs, 0.5);
    let record = bench.record(variant, Start::Conditioned, &drive, 31);
    let to_um = |raw: i32| f64::from(raw) / 2.0_f64.powi(24);
    let mut rows = Vec::new();
    let converters = converter_parameters(bench, 0.0);
    if let Ok(parameters) = c.design.parameters(converters)
        && let (LawParameters::Predictor(law), ActuatorParameters::OneSidedHysteresis { surfaces, .. }) =
            (&parameters.law, &parameters.actuator)
    {
        let mut hysteresis = OneSidedHysteresis::virgin(*surfaces);
        let share = |u: f64| (((u - bench.drive_min_v) / (bench.drive_max_v - bench.drive_min_v)) * 2.0_f64.powi(30)).round() as i32;
        for u in bench.conditioning_drive_v() {
            hysteresis.apply(share(bench.drive_after_converter_v(u)));
        }
        let window = ReferenceWindow::at_rest(0);
        let mut observer = PredictorLaw::take_over(hysteresis.output(), 0);
        let mut estimate = Vec::with_capacity(drive.len());
        let mut overflow = 0;
        for (u, y) in record.drive_v.iter().zip(&record.reading_um) {
            let reading = Micrometres::saturating_from_num(*y).to_bits();
            let applied = hysteresis.apply(share(*u));
            // With the reference at zero the states are the actuator's own.
            let _ = observer.output(law, reading, applied, &window, &mut overflow);
            estimate.push(to_um(reading.saturating_sub(observer.innovation())));
        }
        let figures = ErrorFigures::between(&estimate, &record.noise_free_um, 400);
        let noise = ErrorFigures::between(&record.reading_um, &record.noise_free_um, 400);
        rows.push(row_um(
            format!("ch7.observer.{id}.rms"),
            figures.rms_um,
            format!(
                "prediction of the reading one period ahead by the design's observer against the noise-free sensor, Eq. (35) drive, full bench; max {:.4} um; the reading itself is noisy by {:.4} um",
                figures.max_um, noise.rms_um
            ),
        ));
    }
    let (states, _) = estimator_rows(&NominalModel::THESIS, &Estimator::Pidsmo(ObserverGains::THESIS_ESTIMATION));
    let mut x = [0.0; 3];
    let mut last = 0.0;
    let mut estimate = Vec::new();
    for (k, y) in record.reading_um.iter().enumerate() {
        let u = if k == 0 { 0.0 } else { record.drive_v[k - 1] };
        let signals = [x[0], x[1], x[2], last, *y, u];
        x = states.map(|row| row.iter().zip(&signals).map(|(c, s)| c * s).sum());
        last = *y;
        estimate.push(x[0]);
    }
    let figures = ErrorFigures::between(&estimate, &record.noise_free_um, 400);
    rows.push(row_um(
        format!("ch7.observer.thesis.{id}.rms"),
        figures.rms_um,
        "PIDSMO with the thesis' gains (10, 20000, 6e-6), same record",
    ));
    rows
}
