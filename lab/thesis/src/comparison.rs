//! Schemes beside the best design of Chapter 7: the thesis' two designed under one set of margins, and others
//! that a reader will ask for, on the full bench with the target's period of delay.

use crate::bench_runs::{
    Commissioned, FREQUENCIES_HZ, LOADED, designed, gains_of, row_um, tracking,
};
use crate::chapter::ChapterRow;
use hysteron::servo::design::ServoDesign;
use hysteron::servo::named_scheme::{plain_pi, with_scheme};
use hysteron::servo::sampled_loop::SampledLoop;
use hysteron::servo::scheme_choice::SchemeChoice;
use hysteron::servo::tuning::Demands;
use hysteron_sim::bench::{Bench, Variant};
use rayon::prelude::*;

/// A reference to follow.
struct Job<'a> {
    id: String,
    bench: &'a Bench,
    variant: Variant,
    design: ServoDesign,
    hz: f64,
    condition: String,
}

fn followed(jobs: &[Job<'_>]) -> Vec<ChapterRow> {
    jobs.par_iter()
        .map(|j| {
            tracking(
                j.bench,
                j.variant,
                &j.design,
                &j.id,
                j.hz,
                5.0,
                &j.condition,
            )
        })
        .collect()
}

/// Schemes that are designed under one set of margins, with their names in the rows.
const DESIGNED: [(SchemeChoice, &str); 4] = [
    (SchemeChoice::Pidsmoc, "pidsmoc"),
    (SchemeChoice::PidsmcAlphaBeta, "pidsmc_ab"),
    (SchemeChoice::Smcbl, "smcbl"),
    (SchemeChoice::Predictor, "predictor"),
];

/// PIDSMOC, PIDSMC + alpha-beta, a boundary layer and a predictor, each designed for the model that was
/// identified of the bench and under the same margins, with the period of delay, with and without the
/// hysteresis inverted.
#[must_use]
pub fn rows_of_designed_schemes(
    bench: &Bench,
    commissioned: &[Option<Commissioned>],
) -> Vec<ChapterRow> {
    let mut cases = Vec::new();
    for (index, variant, load) in [(1, Variant::FULL, "none"), (2, LOADED, "load")] {
        let Some(c) = commissioned.get(index).and_then(Option::as_ref) else {
            continue;
        };
        for (choice, id) in DESIGNED {
            cases.extend([false, true].map(|inverse| (c, variant, load, choice, id, inverse)));
        }
    }
    let designs: Vec<_> = cases
        .into_iter()
        .map(|(c, variant, load, choice, id, inverse)| {
            (variant, load, id, inverse, designed(c, choice, inverse))
        })
        .collect();
    let mut jobs = Vec::new();
    let mut rows = Vec::new();
    for (variant, load, id, inverse, design) in designs {
        let group = if inverse {
            "designed_inverse"
        } else {
            "designed"
        };
        let Some(design) = design else {
            rows.push(row_um(
                format!("ch7.{group}.{id}.{load}.refused"),
                f64::NAN,
                "no gains keep the margins",
            ));
            continue;
        };
        let radius = design.law().map_or(f64::NAN, |law| {
            SampledLoop::new(&law, &design.model.linear.sampled()).spectral_radius()
        });
        for hz in FREQUENCIES_HZ {
            jobs.push(Job {
                id: format!("ch7.{group}.{id}.{hz}hz.{load}.rms"),
                bench,
                variant,
                design: design.clone(),
                hz,
                condition: format!(
                    "{hz} Hz, {load}, full bench, designed for the identified model with one period of delay, hysteresis {}: {}; largest sampled eigenvalue {radius:.4}",
                    if inverse { "inverted" } else { "left to the unknown input" },
                    gains_of(&design.scheme)
                ),
            });
        }
    }
    rows.extend(followed(&jobs));
    rows
}

/// Names of the schemes of [`rows_of_other_schemes`].
pub const OTHER_SCHEMES: [&str; 7] = [
    "predictor-linear",
    "disturbance-observer",
    "disturbance-observer-inverse",
    "feedforward",
    "feedforward-without-creep",
    "feedforward-pi",
    "feedforward-pi-notch",
];

/// Gain of a model that is wrong, over the identified one.
const WRONG_GAIN: f64 = 0.9;

/// Other schemes on the full bench, the best design without its second mode, and without noise shaping.
#[must_use]
pub fn rows_of_other_schemes(
    bench: &Bench,
    commissioned: &[Option<Commissioned>],
) -> Vec<ChapterRow> {
    let mut twelve_bits = bench.clone();
    twelve_bits.converters.dac_bits = 12;
    let mut jobs = Vec::new();
    let mut rows = Vec::new();
    for (index, variant, load) in [(1, Variant::FULL, "none"), (2, LOADED, "load")] {
        let Some(c) = commissioned.get(index).and_then(Option::as_ref) else {
            continue;
        };
        for name in OTHER_SCHEMES {
            let designed = match name {
                "feedforward-pi" => plain_pi(&c.design, false).map(|scheme| ServoDesign {
                    scheme,
                    learning: None,
                    adaptation: None,
                    beside: None,
                    ..c.design.clone()
                }),
                _ => with_scheme(&c.design, name),
            };
            match designed {
                Ok(design) => jobs.extend(FREQUENCIES_HZ.map(|hz| Job {
                    id: format!("ch7.compare.{name}.{hz}hz.{load}.rms"),
                    bench,
                    variant,
                    design: design.clone(),
                    hz,
                    condition: format!(
                        "{hz} Hz, {load}, full bench, one period of delay, {:?}",
                        design.scheme
                    ),
                })),
                Err(reason) => rows.push(row_um(
                    format!("ch7.compare.{name}.{load}.rms"),
                    f64::NAN,
                    reason,
                )),
            }
        }
        let mut without = c.identified.model.for_the_tick().0;
        without.linear.second_mode = None;
        if let Some(design) = ServoDesign::best(&without, &Demands::default()) {
            jobs.extend(FREQUENCIES_HZ.map(|hz| Job {
                id: format!("ch7.compare.predictor_without_second_mode.{hz}hz.{load}.rms"),
                bench,
                variant,
                design: design.clone(),
                hz,
                condition: format!("{hz} Hz, {load}, full bench, the best design for a model without the second mode that was identified"),
            }));
        }
        // What repeats after a whole number of ticks, in a period that the memory holds.
        match with_scheme(&c.design, "predictor-learning") {
            Ok(design) => jobs.extend([5.0, 10.0, 50.0, 100.0].map(|hz| Job {
                id: format!("ch7.compare.predictor-learning.{hz}hz.{load}.rms"),
                bench,
                variant,
                design: design.clone(),
                hz,
                condition: format!("{hz} Hz, {load}, full bench, the best design with the correction of a periodic reference learned"),
            })),
            Err(reason) => rows.push(row_um(format!("ch7.compare.predictor-learning.{load}.rms"), f64::NAN, reason)),
        }
        // A gain that is not the model's, left to the unknown input and corrected.
        let wrong = ServoDesign {
            model: c.design.model.with_gain(WRONG_GAIN),
            ..c.design.clone()
        };
        for name in ["predictor", "predictor-adaptive"] {
            match with_scheme(&wrong, name) {
                Ok(design) => jobs.extend([10.0, 50.0, 150.0].map(|hz| Job {
                    id: format!("ch7.compare.gain_10_off.{name}.{hz}hz.{load}.rms"),
                    bench,
                    variant,
                    design: design.clone(),
                    hz,
                    condition: format!(
                        "{hz} Hz, {load}, full bench, the best design with a model whose gain is {WRONG_GAIN} times the identified one"
                    ),
                })),
                Err(reason) => rows.push(row_um(format!("ch7.compare.gain_10_off.{name}.{load}.rms"), f64::NAN, reason)),
            }
        }
        let unshaped = ServoDesign {
            noise_shaping: false,
            ..c.design.clone()
        };
        jobs.extend([1.0, 50.0].map(|hz| Job {
            id: format!("ch7.best.{hz}hz.{load}.full.dac12_unshaped.rms"),
            bench: &twelve_bits,
            variant,
            design: unshaped.clone(),
            hz,
            condition: format!("{hz} Hz, {load}, full bench, 12-bit DAC without noise shaping"),
        }));
    }
    rows.extend(followed(&jobs));
    rows
}
