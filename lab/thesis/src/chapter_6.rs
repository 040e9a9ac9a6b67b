//! Chapter 6 of the thesis on the reference bench: PIDSM, PID, ideal sliding mode and boundary layer, with the integers that run on the target.
//!
//! The schemes of the thesis run with the thesis' gains and, as there, without computational delay.

use crate::bench_runs::{gains_of, quasi_step_rows, run, sine_reference_um, tracking, without_model};
use crate::chapter::{Chapter, Progress, Row};
use crate::figures;
use hysteron::servo::design::{Scheme, ServoDesign, thesis_scheme};
use hysteron::servo::thesis_schemes::{PidGains, ReachingGains};
use hysteron_sim::bench::{Bench, Variant};
use rayon::prelude::*;

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

/// Chapter 6 for the program.
///
/// # Errors
/// If the built-in bench cannot be read.
pub fn reproduce(progress: Progress) -> Result<Chapter, String> {
    let bench = Bench::reference().map_err(|e| e.to_string())?;
    progress("following references with the schemes of chapter 6");
    let schemes = schemes_of_chapter_6(&bench);
    let rows = rows_of_chapter_6(&bench, &schemes);
    let sections = figures::chapter_6(&bench, &rows, &schemes);
    Ok(Chapter { number: 6, rows, sections })
}
