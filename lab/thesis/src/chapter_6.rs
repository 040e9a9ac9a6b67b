//! Chapter 6 of the thesis on the reference bench: PIDSM, PID, ideal sliding mode and boundary layer, with
//! the integers that run on the target.
//!
//! The schemes of the thesis run with the thesis' gains and, as there, without computational delay.

use crate::bench_runs::{
    CHOICE_HZ, CHOICE_SEED, NamedScheme, choice, commission, designed, gains_of, quasi_step_rows,
    run, sine_reference_um, tracking, without_model,
};
use crate::chapter::{Chapter, ChapterProgress, ChapterRow};
use crate::figures;
use hysteron::servo::design::{Scheme, ServoDesign, thesis_scheme};
use hysteron::servo::model::{NominalModel, SAMPLING_PERIOD_S};
use hysteron::servo::scheme_choice::SchemeChoice;
use hysteron::servo::thesis_conditions::alpha_beta_loop_poles;
use hysteron::servo::thesis_schemes::{AlphaBeta, ControllerGains, PidGains, ReachingGains};
use hysteron_sim::bench::{Bench, Variant};
use nalgebra::Complex;
use rayon::prelude::*;
use std::f64::consts::{FRAC_1_SQRT_2, TAU};

/// The candidate with the least RMS error on the plain bench: tuned as the thesis tuned its schemes, by
/// trial, but on a sine that nothing is judged on.
fn tuned(bench: &Bench, candidates: Vec<Scheme>) -> Option<Scheme> {
    let (reference, from) = sine_reference_um(bench, CHOICE_HZ, 5.0);
    candidates
        .into_par_iter()
        .filter_map(|scheme| {
            let trace = run(
                bench,
                Variant::PLAIN,
                &without_model(bench, scheme.clone()),
                &reference,
                CHOICE_SEED,
            )
            .ok()?;
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
            out.push(Scheme::Pid {
                gains: PidGains { p, i, d: 1e-8 },
                notch: None,
            });
        }
    }
    out
}

fn reaching_candidates(reaching: &[ReachingGains]) -> Vec<Scheme> {
    let Some(Scheme::SlidingMode {
        nominal,
        estimator,
        controller,
        form,
        ..
    }) = thesis_scheme("pidsm-chapter-6")
    else {
        return Vec::new();
    };
    reaching
        .iter()
        .map(|reaching| Scheme::SlidingMode {
            nominal,
            estimator,
            controller,
            reaching: *reaching,
            form,
        })
        .collect()
}

/// PIDSM, PID, ideal sliding mode and boundary layer with the thesis' gains; all but PIDSM tuned on the bench
/// by the thesis' criterion as well; and what is designed for an identified model with the period of delay: a
/// PIDSMOC that leaves the hysteresis to the unknown input, and the predictor.
#[must_use]
pub fn schemes_of_chapter_6(bench: &Bench) -> Vec<NamedScheme> {
    let switching: Vec<ReachingGains> = [7.0, 8.0, 9.0, 10.0, 11.0, 12.0, 15.0]
        .into_iter()
        .map(|eta_v| ReachingGains::Switching { eta_v })
        .collect();
    let mut layers = Vec::new();
    for eta_v in [60.0, 122.0, 200.0] {
        // Slope at the surface, V s/um: the thesis has 122 / 60000.
        for slope in [0.0005, 0.0007, 0.0009, 0.0011, 0.0013, 0.0015, 0.002] {
            layers.push(ReachingGains::BoundaryLayer {
                eta_v,
                delta_um_s: eta_v / slope,
            });
        }
    }
    let thesis = "thesis gains";
    let on_bench = "tuned on the bench at 7 Hz";
    let schemes: Vec<(&'static str, Option<Scheme>, &'static str)> = vec![
        ("pidsm_ab", thesis_scheme("pidsm-chapter-6"), thesis),
        ("pid", tuned(bench, pid_candidates()), on_bench),
        (
            "sm_ab",
            tuned(bench, reaching_candidates(&switching)),
            on_bench,
        ),
        (
            "smcbl",
            tuned(bench, reaching_candidates(&layers)),
            on_bench,
        ),
        ("pid_thesis", thesis_scheme("pid"), thesis),
        ("sm_ab_thesis", thesis_scheme("sliding-mode"), thesis),
        ("smcbl_thesis", thesis_scheme("boundary-layer"), thesis),
    ];
    let mut out: Vec<NamedScheme> = schemes
        .into_iter()
        .filter_map(|(id, scheme, gains)| Some((id, without_model(bench, scheme?), gains)))
        .collect();
    if let Some(c) = commission(bench, Variant::PLAIN) {
        out.extend(designed(&c, SchemeChoice::Pidsmoc, false).map(|d| {
            (
                "pidsmoc",
                d,
                "designed for the identified model, one period of delay",
            )
        }));
        out.push((
            "predictor",
            c.design,
            "designed for the identified model, one period of delay, hysteresis inverted",
        ));
    }
    out
}

/// Poles, cut-off and rise time of 4.2, from the printed gains.
fn rows_of_the_printed_gains() -> Vec<ChapterRow> {
    let (model, filter) = (NominalModel::THESIS, AlphaBeta::THESIS_CHAPTER_6);
    let mut rows = Vec::new();
    for (section, gains) in [
        ("4.2.1", ControllerGains::THESIS_SLIDING),
        ("4.2.2", ControllerGains::THESIS_CHAPTER_6),
    ] {
        let mut poles = alpha_beta_loop_poles(&model, &gains, &filter, SAMPLING_PERIOD_S);
        // As printed: by rising real part, of a pair the upper one first.
        poles.sort_by(|a, b| a.re.total_cmp(&b.re).then(b.im.total_cmp(&a.im)));
        for (nth, pole) in poles.iter().enumerate() {
            let id = format!("ch6.poles.{section}.{}", nth + 1);
            rows.push(ChapterRow::new(
                format!("{id}.re"),
                pole.re,
                "1/s",
                "roots of Eqs. (40), (41)",
            ));
            rows.push(ChapterRow::new(
                format!("{id}.im"),
                pole.im,
                "1/s",
                "roots of Eqs. (40), (41)",
            ));
        }
    }
    // The velocity path of Eq. (36) over the derivative of the reading.
    let velocity = |hz: f64| {
        let (s, w) = (Complex::new(0.0, TAU * hz), filter.natural_frequency_rad_s);
        (Complex::new(w * w, 0.0) / (s * s + s * (2.0 * filter.damping_ratio * w) + w * w)).norm()
    };
    let cutoff_hz = (1..=10_000)
        .map(|k| 0.1 * f64::from(k))
        .find(|hz| velocity(*hz) < FRAC_1_SQRT_2)
        .unwrap_or(f64::NAN);
    rows.push(ChapterRow::new(
        "ch6.filter.cutoff",
        cutoff_hz,
        "Hz",
        "-3 dB of the velocity path; the displacement path peaks at 1.2",
    ));
    let rise_s = (0.9_f64.ln() - 0.1_f64.ln()) / ControllerGains::THESIS_CHAPTER_6.m;
    rows.push(ChapterRow::new(
        "ch6.rise_time",
        rise_s,
        "s",
        "of the sliding motion, Eq. (10)",
    ));
    rows
}

/// Chapter 6: sines and the quasi-step with every scheme.
#[must_use]
pub fn rows_of_chapter_6(bench: &Bench, schemes: &[NamedScheme]) -> Vec<ChapterRow> {
    let mut jobs: Vec<(String, ServoDesign, Option<f64>, String)> = Vec::new();
    for (id, design, gains) in schemes {
        let timing = if design.delayed { "" } else { ", no delay" };
        let condition = format!("plain bench, {gains}{timing}: {}", gains_of(&design.scheme));
        for hz in [10.0, 50.0, 100.0, 150.0] {
            jobs.push((
                format!("ch6.{id}.{hz}hz.rms"),
                design.clone(),
                Some(hz),
                format!("{hz} Hz, {condition}"),
            ));
        }
        jobs.push((format!("ch6.{id}"), design.clone(), None, condition));
    }
    jobs.par_iter()
        .flat_map_iter(|(id, design, hz, condition)| match hz {
            Some(hz) => vec![tracking(
                bench,
                Variant::PLAIN,
                design,
                id,
                *hz,
                5.0,
                condition,
            )],
            None => quasi_step_rows(bench, Variant::PLAIN, design, id, condition),
        })
        .collect()
}

/// Chapter 6 for the program.
#[must_use]
pub fn reproduce(bench: &Bench, progress: ChapterProgress) -> Chapter {
    progress("following references with the schemes of chapter 6");
    let schemes = schemes_of_chapter_6(bench);
    let mut rows = rows_of_chapter_6(bench, &schemes);
    rows.extend(rows_of_the_printed_gains());
    let sections = figures::chapter_6(bench, &rows, &schemes);
    Chapter {
        number: 6,
        rows,
        sections,
        choices: vec![choice()],
    }
}
