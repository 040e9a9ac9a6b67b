//! Chapter 7 of the thesis on the reference bench: observer and observer-controller, noise, load, robustness,
//! with the integers that run on the target.
//!
//! # How it works
//! Each variant of the bench (plain, full, full with load) is commissioned once: its model is identified from
//! records, and the best predictor is designed from that model. The schemes of the thesis run with the
//! thesis' gains and, as there, without computational delay.

use crate::bench_runs::{
    Commissioned, FREQUENCIES_HZ, LOADED, LOADED_PLAIN, choice, commission_all, designed,
    equation_35_v, quasi_step_rows, row_um, sine_reference_um, tracking, without_model,
};
use crate::chapter::{Chapter, ChapterProgress, ChapterRow};
use crate::comparison;
use crate::estimators;
use crate::figures;
use crate::float_twin::integer_difference_um;
use crate::robustness;
use hysteron::servo::design::{Scheme, ServoDesign, thesis_scheme};
use hysteron::servo::model::{NominalModel, SAMPLING_PERIOD_S};
use hysteron::servo::scheme_choice::SchemeChoice;
use hysteron::servo::sensor_lag::lag_s;
use hysteron::servo::thesis_conditions::observer_cutoff_hz;
use hysteron::servo::thesis_conditions::{observer_reachability, sliding_surface_parameter};
use hysteron::servo::thesis_schemes::{
    ControllerGains, Estimator, ObserverGains, SlidingModeLaw, estimator_rows,
};
use hysteron_core::one_sided_hysteresis::OneSidedHysteresis;
use hysteron_core::predictor_law::PredictorLaw;
use hysteron_core::reference_window::ReferenceWindow;
use hysteron_core::servo_parameters::{ActuatorParameters, LawParameters};
use hysteron_core::signal::Micrometres;
use hysteron_sim::bench::{Bench, Start, Variant};
use hysteron_sim::closed_loop::ErrorFigures;
use rayon::prelude::*;
use std::f64::consts::TAU;

/// Chapter 7: PIDSMOC against PIDSMC + alpha-beta, the best design, the observer, robustness.
#[must_use]
pub fn rows_of_chapter_7(
    bench: &Bench,
    commissioned: &[Option<Commissioned>],
    progress: ChapterProgress,
) -> Vec<ChapterRow> {
    let mut twelve_bits = bench.clone();
    twelve_bits.converters.dac_bits = 12;
    let mut jobs: Vec<(String, &Bench, Variant, ServoDesign, f64, f64, String)> = Vec::new();
    for hz in FREQUENCIES_HZ {
        for (name, id) in [
            ("pidsmoc", "pidsmoc"),
            ("pidsmc-alpha-beta", "pidsmc_ab"),
            ("pidsmc-alpha-beta-discrete", "pidsmc_ab_discrete"),
        ] {
            for (variant, load) in [(Variant::PLAIN, "none"), (LOADED_PLAIN, "load")] {
                if let Some(scheme) = thesis_scheme(name) {
                    if let (
                        Scheme::SlidingMode {
                            nominal,
                            estimator,
                            controller,
                            reaching,
                            form,
                        },
                        "pidsmoc",
                    ) = (&scheme, id)
                    {
                        // The thesis compares I_c = 1 with I_c = 2, which decides at low frequency: the same
                        // integral gain beside.
                        let (nominal, estimator, reaching, form) =
                            (*nominal, *estimator, *reaching, *form);
                        let equal = Scheme::SlidingMode {
                            nominal,
                            estimator,
                            controller: ControllerGains {
                                i: 2.0,
                                ..*controller
                            },
                            reaching,
                            form,
                        };
                        let condition = format!(
                            "{hz} Hz, {load}, plain bench, thesis gains but I_c = 2 as in PIDSMC + alpha-beta, no delay"
                        );
                        let id = format!("ch7.pidsmoc_equal_integral.{hz}hz.{load}.rms");
                        jobs.push((
                            id,
                            bench,
                            variant,
                            without_model(bench, equal),
                            hz,
                            5.0,
                            condition,
                        ));
                    }
                    let condition = format!("{hz} Hz, {load}, plain bench, thesis gains, no delay");
                    jobs.push((
                        format!("ch7.{id}.{hz}hz.{load}.rms"),
                        bench,
                        variant,
                        without_model(bench, scheme),
                        hz,
                        5.0,
                        condition,
                    ));
                }
            }
        }
    }
    for (index, variant, load, bench_name) in [
        (0, Variant::PLAIN, "none", "plain"),
        (1, Variant::FULL, "none", "full"),
        (2, LOADED, "load", "full"),
    ] {
        let Some(c) = commissioned.get(index).and_then(Option::as_ref) else {
            continue;
        };
        for hz in FREQUENCIES_HZ {
            let condition =
                format!("{hz} Hz, {load}, {bench_name} bench, one period of delay, 16-bit DAC");
            jobs.push((
                format!("ch7.best.{hz}hz.{load}.{bench_name}.rms"),
                bench,
                variant,
                c.design.clone(),
                hz,
                5.0,
                condition,
            ));
            let condition =
                format!("{hz} Hz, {load}, {bench_name} bench, one period of delay, 12-bit DAC");
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
        let condition =
            format!("300 Hz, {load}, {bench_name} bench, one period of delay, 16-bit DAC");
        jobs.push((
            format!("ch7.best.300hz.{load}.{bench_name}.rms"),
            bench,
            variant,
            c.design.clone(),
            300.0,
            5.0,
            condition,
        ));
        let condition =
            format!("500 Hz 4 um, {load}, {bench_name} bench, one period of delay, 16-bit DAC");
        jobs.push((
            format!("ch7.best.500hz.{load}.{bench_name}.rms"),
            bench,
            variant,
            c.design.clone(),
            500.0,
            4.0,
            condition,
        ));
        // The lag of the sensor undone, as a design from a recording does it: the true error falls, and the
        // reading's holds the lag.
        let sensor_lag_s = c.identified.model.linear.sensor_bandwidth_hz.map(lag_s);
        let undone = FREQUENCIES_HZ
            .map(|hz| (hz, 5.0))
            .into_iter()
            .chain([(300.0, 5.0), (500.0, 4.0)]);
        for (hz, amplitude_um) in undone.filter(|_| sensor_lag_s.is_some()) {
            let condition = format!(
                "{hz} Hz {amplitude_um} um, {load}, {bench_name} bench, the sensor's lag undone"
            );
            let design = ServoDesign {
                sensor_lag_s,
                ..c.design.clone()
            };
            jobs.push((
                format!("ch7.best_lag_undone.{hz}hz.{load}.{bench_name}.rms"),
                bench,
                variant,
                design,
                hz,
                amplitude_um,
                condition,
            ));
        }
        if index == 1 {
            // The design for the bare actuator with the mass attached, unchanged.
            for hz in [1.0, 50.0, 150.0] {
                let condition = format!("{hz} Hz, load attached without a new design, full bench");
                jobs.push((
                    format!("ch7.best.{hz}hz.load_not_redesigned.full.rms"),
                    bench,
                    LOADED,
                    c.design.clone(),
                    hz,
                    5.0,
                    condition,
                ));
            }
        }
    }
    progress("following references");
    let mut rows: Vec<ChapterRow> = jobs
        .par_iter()
        .map(|(id, bench, variant, design, hz, amplitude, condition)| {
            tracking(bench, *variant, design, id, *hz, *amplitude, condition)
        })
        .collect();
    for (index, variant, name) in [
        (0, Variant::PLAIN, "plain"),
        (1, Variant::FULL, "full"),
        (2, LOADED, "full, loaded"),
    ] {
        let Some(c) = commissioned.get(index).and_then(Option::as_ref) else {
            continue;
        };
        let id = format!("ch7.best.{}", ["plain", "full", "loaded"][index]);
        rows.extend(quasi_step_rows(
            bench,
            variant,
            &c.design,
            &id,
            &format!("{name} bench, best design, one period of delay"),
        ));
        rows.push(row_um(
            format!("{id}.identified.rms"),
            c.identified.rms_um,
            format!(
                "residual of the identified model over the commissioning record: {:?}",
                c.identified.steps
            ),
        ));
    }
    progress("integers against f64");
    let differences: Vec<Option<ChapterRow>> = [(0, Variant::PLAIN, "plain"), (1, Variant::FULL, "full"), (2, LOADED, "loaded")]
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

/// Chapter 7 for the program.
#[must_use]
pub fn reproduce(bench: &Bench, progress: ChapterProgress) -> Chapter {
    let commissioned = commission_all(bench, progress);
    let mut rows = rows_of_chapter_7(bench, &commissioned, progress);
    progress("schemes designed under one set of margins");
    rows.extend(comparison::rows_of_designed_schemes(bench, &commissioned));
    progress("other schemes on the full bench");
    rows.extend(comparison::rows_of_other_schemes(bench, &commissioned));
    progress("robustness");
    let robust = robustness::design();
    rows.extend(robust.iter().flat_map(robustness::rows));
    rows.extend(robustness::rows_as_printed());
    rows.extend(rows_of_the_printed_gains());
    rows.extend(least_damping_of_the_printed_gains(bench));
    rows.extend(reduction(&rows));
    progress("estimators that the thesis argues against");
    rows.extend(estimators::rows(bench));
    let sections = figures::chapter_7(
        bench,
        &rows,
        commissioned.get(1).and_then(Option::as_ref),
        robust.as_ref().map(|r| &r.0),
    );
    let choices = vec![choice(), robustness::choice()];
    Chapter {
        number: 7,
        rows,
        sections,
        choices,
    }
}

/// Observer accuracy on Eq. (35): the design's own observer, and the PIDSMO with the thesis' gains.
fn observer_rows(bench: &Bench, variant: Variant, c: &Commissioned, id: &str) -> Vec<ChapterRow> {
    let fs = bench.converters.sample_rate_hz;
    let drive = equation_35_v(fs, 0.5);
    let record = bench.record(variant, Start::Conditioned, &drive, 31);
    let to_um = |raw: i32| f64::from(raw) / 2.0_f64.powi(24);
    let mut rows = Vec::new();
    let converters = bench.converter_scale().parameters();
    if let Ok(parameters) = c.design.parameters(converters)
        && let (
            LawParameters::Predictor(law),
            ActuatorParameters::OneSidedHysteresis { surfaces, .. },
        ) = (&parameters.law, &parameters.actuator)
    {
        let mut hysteresis = OneSidedHysteresis::virgin(*surfaces);
        let share = |u: f64| {
            (((u - bench.drive_min_v) / (bench.drive_max_v - bench.drive_min_v)) * 2.0_f64.powi(30))
                .round() as i32
        };
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
            format!("ch7.observer.predictor.{id}.rms"),
            figures.rms_um,
            format!(
                "prediction of the reading one period ahead by the design's observer against the noise-free sensor, Eq. (35) drive, full bench; max {:.4} um; the reading itself is noisy by {:.4} um",
                figures.max_um, noise.rms_um
            ),
        ));
    }
    let mut pidsmo = |of: &str, nominal: &NominalModel, gains: ObserverGains, note: String| {
        let (states, _) = estimator_rows(nominal, &Estimator::Pidsmo(gains));
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
        rows.push(
            row_um(format!("ch7.observer.{of}.{id}.rms"), figures.rms_um, note).on("Eq. (35)", 31),
        );
    };
    let printed = "PIDSMO with the thesis' gains (10, 20000, 6e-6), drive of Eq. (35), full bench, against the noise-free sensor";
    pidsmo(
        "pidsmo",
        &NominalModel::THESIS,
        ObserverGains::THESIS_ESTIMATION,
        printed.into(),
    );
    if let Some(ServoDesign {
        scheme:
            Scheme::SlidingMode {
                nominal,
                estimator: Estimator::Pidsmo(gains),
                ..
            },
        ..
    }) = designed(c, SchemeChoice::Pidsmoc, false)
    {
        let note = format!(
            "PIDSMO as designed for the identified model ({:.2}, {:.0}, {:.1e}), same record",
            gains.p, gains.i, gains.d
        );
        pidsmo("pidsmo_designed", &nominal, gains, note);
    }
    rows
}

/// Figures that follow from the printed gains alone: matching condition, sliding surface, cut-off.
fn rows_of_the_printed_gains() -> Vec<ChapterRow> {
    let model = NominalModel::THESIS;
    let (rank_cb, rank_b) = estimators::matching_ranks(&model);
    let mut rows = vec![
        ChapterRow::new(
            "ch7.matching.rank_cb",
            rank_cb as f64,
            "1",
            "of the nominal model",
        ),
        ChapterRow::new(
            "ch7.matching.rank_b",
            rank_b as f64,
            "1",
            "of the nominal model",
        ),
        ChapterRow::new(
            "ch7.m_o",
            sliding_surface_parameter(&model, &ObserverGains::THESIS_SLIDING),
            "1/s",
            "real root of Eq. (19)",
        ),
        ChapterRow::new(
            "ch7.observer.cutoff",
            observer_cutoff_hz(&model, &ObserverGains::THESIS_ESTIMATION),
            "Hz",
            "-3 dB of G_3, Eq. (26)",
        ),
    ];
    let mut roots = observer_reachability(&model, &ObserverGains::THESIS_SLIDING);
    // As printed: the pair first, its upper one before the other.
    roots.sort_by(|a, b| {
        b.im.abs()
            .total_cmp(&a.im.abs())
            .then(b.im.total_cmp(&a.im))
    });
    for (nth, root) in roots.iter().enumerate() {
        rows.push(ChapterRow::new(
            format!("ch7.root.{}.re", nth + 1),
            root.re,
            "1/s",
            "roots of Eq. (21)",
        ));
        rows.push(ChapterRow::new(
            format!("ch7.root.{}.im", nth + 1),
            root.im,
            "1/s",
            "roots of Eq. (21)",
        ));
    }
    rows
}

/// The least damping ratio among the poles of the sampled loop that the thesis' gains close around its
/// nominal model, with and without the load's mass: below zero the loop is unstable.
fn least_damping_of_the_printed_gains(bench: &Bench) -> Vec<ChapterRow> {
    let mut rows = Vec::new();
    for (name, id) in [("pidsmoc", "pidsmoc"), ("pidsmc-alpha-beta", "pidsmc_ab")] {
        let Some(Scheme::SlidingMode {
            nominal,
            estimator,
            controller,
            reaching,
            ..
        }) = thesis_scheme(name)
        else {
            continue;
        };
        let law = SlidingModeLaw::new(&nominal, &estimator, &controller, &reaching);
        for (load, factor) in [("none", 1.0), ("load", bench.loaded_mode_factor())] {
            let plant = NominalModel {
                natural_frequency_rad_s: nominal.natural_frequency_rad_s * factor,
                damping_ratio: nominal.damping_ratio * factor,
                ..nominal
            };
            let poles = law.closed_loop(&plant, 0).complex_eigenvalues();
            // What a pole at zero stands for is over within a period.
            let poles = poles
                .iter()
                .filter(|z| z.norm() > 1e-6)
                .map(|z| z.ln() / SAMPLING_PERIOD_S);
            let Some((damping, hz)) = poles
                .map(|s| (-s.re / s.norm(), s.norm() / TAU))
                .min_by(|a, b| a.0.total_cmp(&b.0))
            else {
                continue;
            };
            let note = format!(
                "of the poles of the sampled loop with the nominal model, {load}, thesis gains, no delay; at {hz:.0} Hz"
            );
            rows.push(ChapterRow::new(
                format!("ch7.{id}.{load}.least_damping"),
                damping,
                "1",
                note,
            ));
        }
    }
    rows
}

/// By how much the PIDSMOC's errors are below those of PIDSMC + alpha-beta at 100 and 150 Hz, at least, %.
fn reduction(rows: &[ChapterRow]) -> Option<ChapterRow> {
    let of = |scheme: &str, hz: u32, load: &str| {
        let row = rows
            .iter()
            .find(|row| row.id == format!("ch7.{scheme}.{hz}hz.{load}.rms"))?;
        Some((row.truth?, row.max?.truth))
    };
    let mut least = f64::INFINITY;
    for (hz, load) in [(100, "none"), (100, "load"), (150, "none"), (150, "load")] {
        let (ours, theirs) = (of("pidsmoc", hz, load)?, of("pidsmc_ab", hz, load)?);
        least = least
            .min(100.0 * (1.0 - ours.0 / theirs.0))
            .min(100.0 * (1.0 - ours.1 / theirs.1));
    }
    Some(ChapterRow::new(
        "ch7.reduction_pct",
        least,
        "%",
        "least reduction of RMS and largest errors at 100 and 150 Hz, thesis gains, with and without load",
    ))
}
