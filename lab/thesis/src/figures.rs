//! The figures of Chapters 6 and 7 with ours: phase portraits, compensated hysteresis, errors over frequency,
//! observer and noise.

use crate::bench_runs::{
    Commissioned, NamedScheme, equation_35_v, quasi_step_um, run, sine_reference_um, without_model,
};
use crate::chapter::ChapterRow;
use hysteron::identification::fit::rms;
use hysteron::servo::design::{Form, Scheme, ServoDesign, thesis_scheme};
use hysteron::servo::model::{NominalModel, SAMPLING_PERIOD_S};
use hysteron::servo::thesis_conditions::sliding_surface_parameter;
use hysteron::servo::thesis_schemes::{
    AlphaBeta, ControllerGains, Estimator, ObserverGains, ReachingGains, SlidingModeLaw,
    estimator_rows,
};
use hysteron::spectrum::amplitude_density;
use hysteron::statistics::difference;
use hysteron_report::{CurveRole, PageBlock, Plot, Section, Series, Style};
use hysteron_sim::bench::{Bench, Start, Variant};
use hysteron_sim::waveform;

/// A true error that differs from that of the reading by this share is drawn beside it.
const APART: f64 = 0.05;

/// Errors over frequency: one curve for each group of rows `prefix.<hz>hz.suffix`.
fn over_frequency(
    title: &str,
    rows: &[ChapterRow],
    curves: &[(&str, &str, &str, CurveRole)],
) -> Plot {
    let mut plot =
        Plot::new(title).x_axis("frequency", "Hz").y_axis("RMS error", "um").log(true, true).caption(
            "Of what the sensor reads, noise removed; where the true error is another one it is drawn, and the reading's is dashed.",
        );
    for (label, prefix, suffix, role) in curves {
        let mut points: Vec<(f64, f64, f64)> = rows
            .iter()
            .filter_map(|r| {
                let rest = r.id.strip_prefix(prefix)?;
                let hz = rest.strip_suffix(suffix)?.parse::<f64>().ok()?;
                Some((hz, r.truth.unwrap_or(r.ours), r.ours))
            })
            .collect();
        points.sort_by(|a, b| a.0.total_cmp(&b.0));
        let x: Vec<f64> = points.iter().map(|p| p.0).collect();
        let line = |label: String, y: Vec<f64>| Series::line(label, *role, x.clone(), y);
        let read = line((*label).to_owned(), points.iter().map(|p| p.2).collect());
        if points
            .iter()
            .any(|(_, truth, read)| (truth - read).abs() > APART * read)
        {
            plot = plot
                .with(line(
                    format!("{label}, true"),
                    points.iter().map(|p| p.1).collect(),
                ))
                .with(read.style(Style::Dashed));
        } else {
            plot = plot.with(read);
        }
    }
    plot
}

/// Ch. 6, Fig. 5: PIDSM on the nominal model whose states it knows, from 5 um to zero.
fn portrait_of_the_controller() -> Plot {
    let model = NominalModel::THESIS;
    let gains = ControllerGains::THESIS_SLIDING;
    let filter = Estimator::AlphaBeta(AlphaBeta::THESIS_CHAPTER_6);
    let law = SlidingModeLaw::new(&model, &filter, &gains, &ReachingGains::Pid);
    let (a, b) = model.sampled(SAMPLING_PERIOD_S);
    let (mut y, mut v, mut sum, mut last_q) = (5.0, 0.0, 0.0, gains.m * 5.0 * SAMPLING_PERIOD_S);
    let (mut e1, mut e2) = (Vec::new(), Vec::new());
    for _ in 0..4000 {
        e1.push(y);
        e2.push(v);
        let q = law.switching_function[0] * y + law.switching_function[1] * v * SAMPLING_PERIOD_S;
        sum += q;
        let u = -(law.equivalent[0] * y + law.equivalent[1] * v * SAMPLING_PERIOD_S)
            - law.pid[0] * q
            - law.pid[1] * (q - last_q)
            - law.pid[2] * sum;
        last_q = q;
        (y, v) = (
            a[(0, 0)] * y + a[(0, 1)] * v + b[0] * u,
            a[(1, 0)] * y + a[(1, 1)] * v + b[1] * u,
        );
    }
    portrait(
        "Sliding motion of the controller (Ch. 6, Fig. 5)",
        e1,
        e2,
        gains.m,
        5.0,
    )
}

fn portrait(title: &str, e1: Vec<f64>, e2: Vec<f64>, m: f64, reach_um: f64) -> Plot {
    Plot::new(title)
        .x_axis("e1", "um")
        .y_axis("e2", "um/s")
        .with(Series::line("trajectory", CurveRole::Measured, e1, e2))
        .with(
            Series::line(
                "sliding surface e2 = -m e1",
                CurveRole::Model,
                vec![-reach_um, reach_um],
                vec![m * reach_um, -m * reach_um],
            )
            .style(Style::Dashed),
        )
}

/// Ch. 6, Fig. 6: integer PIDSMC with the alpha-beta filter on the bench, a step to 5 um.
fn portrait_on_the_bench(bench: &Bench) -> Option<Plot> {
    let scheme = Scheme::SlidingMode {
        nominal: NominalModel::THESIS,
        estimator: Estimator::AlphaBeta(AlphaBeta::THESIS_CHAPTER_6),
        controller: ControllerGains::THESIS_SLIDING,
        reaching: ReachingGains::Pid,
        form: Form::Printed,
    };
    let trace = run(
        bench,
        Variant::PLAIN,
        &without_model(bench, scheme),
        &[5.0; 8000],
        3,
    )
    .ok()?;
    let (e1, e2) = trace
        .sliding_um
        .iter()
        .map(|s| (s[0], s[1] / SAMPLING_PERIOD_S))
        .unzip();
    Some(
        portrait("PIDSMC + alpha-beta on the bench (Ch. 6, Fig. 6)", e1, e2, ControllerGains::THESIS_SLIDING.m, 1.0)
            .caption("The reference moves to 5 um as its offset decays; the errors are pulled to the surface and slide to the origin."),
    )
}

/// Ch. 6, Fig. 7: desired against measured, closed loop and open loop.
fn hysteresis_compensated(
    bench: &Bench,
    design: &ServoDesign,
    variant: Variant,
    title: &str,
) -> Option<Plot> {
    let (reference, from) = sine_reference_um(bench, 10.0, 5.0);
    let trace = run(bench, variant, design, &reference, 3).ok()?;
    let drive: Vec<f64> = reference
        .iter()
        .map(|w| 6.86 * (w - bench.reference_offset_um + 5.0))
        .collect();
    let open = bench.record(variant, Start::Conditioned, &drive, 3);
    let last_period = |v: &[f64]| v[v.len().saturating_sub(2008)..].to_vec();
    let _ = from;
    let n = trace.sensor_um.len();
    Some(
        Plot::new(title)
            .x_axis("desired", "um")
            .y_axis("measured", "um")
            .with(Series::line(
                "open loop, u = 6.86 w",
                CurveRole::Other1,
                last_period(&reference[..n]),
                last_period(&open.noise_free_um[..n]),
            ))
            .with(Series::line(
                "closed loop",
                CurveRole::Measured,
                last_period(&trace.reference_um),
                last_period(&trace.sensor_um),
            )),
    )
}

/// Ch. 7, Fig. 7: the observer's errors slide to zero from `-5.25 um`, `625 um/s`.
fn portrait_of_the_observer() -> Plot {
    let model = NominalModel::THESIS;
    let gains = ObserverGains::THESIS_SLIDING;
    let (rows, _) = estimator_rows(&model, &Estimator::Pidsmo(gains));
    let mut x = [-5.25, 625.0 * SAMPLING_PERIOD_S, 0.0];
    let (mut e1, mut e2) = (Vec::new(), Vec::new());
    for _ in 0..4000 {
        e1.push(x[0]);
        e2.push(x[1] / SAMPLING_PERIOD_S);
        let signals = [x[0], x[1], x[2], 0.0, 0.0, 0.0];
        x = rows.map(|row| row.iter().zip(&signals).map(|(c, s)| c * s).sum());
    }
    portrait(
        "Sliding motion of the observer (Ch. 7, Fig. 7)",
        e1,
        e2,
        sliding_surface_parameter(&model, &gains),
        5.25,
    )
}

/// Ch. 7, Fig. 8: density of the sensor's noise and of what remains of it in the estimate.
fn noise_suppressed(bench: &Bench) -> Plot {
    let record = bench.record(
        Variant::PLAIN,
        Start::Conditioned,
        &waveform::hold(1.0 / SAMPLING_PERIOD_S, 0.0, 2.0),
        9,
    );
    let (rows, _) = estimator_rows(
        &NominalModel::THESIS,
        &Estimator::Pidsmo(ObserverGains::THESIS_ESTIMATION),
    );
    let noise: Vec<f64> = record
        .reading_um
        .iter()
        .zip(&record.noise_free_um)
        .map(|(y, s)| y - s)
        .collect();
    let (mut x, mut last) = ([0.0; 3], 0.0);
    let mut estimate = Vec::with_capacity(noise.len());
    for y in &noise {
        let signals = [x[0], x[1], x[2], last, *y, 0.0];
        x = rows.map(|row| row.iter().zip(&signals).map(|(c, s)| c * s).sum());
        last = *y;
        estimate.push(x[0]);
    }
    let fs = 1.0 / SAMPLING_PERIOD_S;
    let mut plot = Plot::new("Noise before and behind the observer (Ch. 7, Fig. 8)")
        .x_axis("frequency", "Hz")
        .y_axis("amplitude density", "um/sqrt(Hz)")
        .log(true, true);
    for (label, role, signal) in [
        ("sensor", CurveRole::Measured, &noise),
        (
            "estimate x1 (PIDSMO 10, 20000, 6e-6)",
            CurveRole::Model,
            &estimate,
        ),
    ] {
        let spectrum = amplitude_density(signal, fs);
        plot = plot.with(Series::line(
            label,
            role,
            spectrum.frequency_hz,
            spectrum.density,
        ));
    }
    plot
}

/// Ch. 7, Fig. 9: estimate and sensor on the drive of Eq. (35).
fn estimation(bench: &Bench, loaded: bool) -> Plot {
    let drive = equation_35_v(1.0 / SAMPLING_PERIOD_S, 0.23);
    let record = bench.record(
        Variant {
            loaded,
            ..Variant::FULL
        },
        Start::Conditioned,
        &drive,
        31,
    );
    let (rows, unknown) = estimator_rows(
        &NominalModel::THESIS,
        &Estimator::Pidsmo(ObserverGains::THESIS_ESTIMATION),
    );
    let (mut x, mut last) = ([0.0; 3], 0.0);
    let (mut time, mut estimate, mut epsilon) = (Vec::new(), Vec::new(), Vec::new());
    for (k, y) in record.reading_um.iter().enumerate() {
        let u = if k == 0 { 0.0 } else { record.drive_v[k - 1] };
        let signals = [x[0], x[1], x[2], last, *y, u];
        x = rows.map(|row| row.iter().zip(&signals).map(|(c, s)| c * s).sum());
        let after = [x[0], x[1], x[2], last, *y, u];
        epsilon.push(unknown.iter().zip(&after).map(|(c, s)| c * s).sum::<f64>());
        last = *y;
        time.push(k as f64 * SAMPLING_PERIOD_S);
        estimate.push(x[0]);
    }
    let title = if loaded {
        "Estimation with load (Ch. 7, Fig. 9 c, e)"
    } else {
        "Estimation (Ch. 7, Fig. 9 a, e)"
    };
    Plot::new(title)
        .x_axis("time", "s")
        .y_axis("displacement, um; unknown input, 10 V", "")
        .with(Series::line(
            "sensor",
            CurveRole::Measured,
            time.clone(),
            record.noise_free_um,
        ))
        .with(Series::line(
            "estimate x1",
            CurveRole::Model,
            time.clone(),
            estimate,
        ))
        .with(Series::line(
            "estimated unknown input / 10 V",
            CurveRole::Other1,
            time,
            epsilon.into_iter().map(|e| 0.1 * e).collect(),
        ))
}

/// Ch. 7, Figs. 10-11: the error over two periods at 100 Hz.
fn errors_at_100_hz(bench: &Bench, commissioned: &Commissioned, variant: Variant) -> Plot {
    let (reference, _) = sine_reference_um(bench, 100.0, 5.0);
    let mut plot = Plot::new("Error at 100 Hz (Ch. 7, Figs. 10-11)")
        .x_axis("time", "s")
        .y_axis("error", "um");
    let mut add = |label: &str, role: CurveRole, variant: Variant, design: &ServoDesign| {
        if let Ok(trace) = run(bench, variant, design, &reference, 7) {
            let from = trace.sensor_um.len().saturating_sub(400);
            let time: Vec<f64> = (from..trace.sensor_um.len())
                .map(|k| k as f64 * SAMPLING_PERIOD_S)
                .collect();
            let error = |of_um: &[f64]| {
                of_um
                    .iter()
                    .zip(&trace.reference_um)
                    .skip(from)
                    .map(|(y, r)| y - r)
                    .collect::<Vec<f64>>()
            };
            let (truth, read) = (error(&trace.displacement_um), error(&trace.sensor_um));
            if rms(&difference(&truth, &read)) > APART * rms(&read) {
                plot.series.push(Series::line(
                    format!("{label}, true"),
                    role,
                    Vec::clone(&time),
                    truth,
                ));
                plot.series
                    .push(Series::line(label, role, time, read).style(Style::Dashed));
            } else {
                plot.series.push(Series::line(label, role, time, read));
            }
        }
    };
    for (label, name, role) in [
        (
            "PIDSMC + alpha-beta",
            "pidsmc-alpha-beta",
            CurveRole::Other2,
        ),
        ("PIDSMOC", "pidsmoc", CurveRole::Other1),
    ] {
        if let Some(scheme) = thesis_scheme(name) {
            add(label, role, Variant::PLAIN, &without_model(bench, scheme));
        }
    }
    add(
        "best design, one period of delay",
        CurveRole::Measured,
        variant,
        &commissioned.design,
    );
    plot
}

/// Ch. 7, Fig. 12: desired and reached with everything wrong by half.
fn robust_tracking(design: &ServoDesign) -> Option<Plot> {
    let trace = crate::robustness::run(design, crate::robustness::PRINTED, 1.5, true, 0.05)?;
    let (reached, reference) = (trace.sensor_um, trace.reference_um);
    let shown = 4000..4800.min(reached.len());
    let time = shown
        .clone()
        .map(|k| k as f64 * SAMPLING_PERIOD_S)
        .collect::<Vec<_>>();
    let error = shown.clone().map(|k| reached[k] - reference[k]).collect();
    Some(
        Plot::new("Robustness (Ch. 7, Fig. 12): xi, wn and K +50 %, unknown input, 0.05 um noise")
            .x_axis("time", "s")
            .y_axis("displacement", "um")
            .with(Series::line(
                "desired",
                CurveRole::Reference,
                time.clone(),
                reference[shown.clone()].to_vec(),
            ))
            .with(Series::line(
                "reached",
                CurveRole::Measured,
                time.clone(),
                reached[shown].to_vec(),
            ))
            .with(Series::line("error", CurveRole::Residual, time, error)),
    )
}

/// The error on the quasi-step of Ch. 6, Eq. (44).
fn quasi_step_errors(bench: &Bench, schemes: &[NamedScheme]) -> Plot {
    let reference = quasi_step_um(1.0 / SAMPLING_PERIOD_S, 0.6);
    let mut plot = Plot::new("Error on the quasi-step of 5 um (Ch. 6, Eq. 44)")
        .x_axis("time", "s")
        .y_axis("error", "um");
    for (label, id, role) in [
        ("sliding mode", "sm_ab", CurveRole::Other2),
        ("boundary layer", "smcbl", CurveRole::Other3),
        ("PID", "pid", CurveRole::Other1),
        ("PIDSM + alpha-beta", "pidsm_ab", CurveRole::Measured),
    ] {
        let Some((_, scheme, _)) = schemes.iter().find(|s| s.0 == id) else {
            continue;
        };
        if let Ok(trace) = run(bench, Variant::PLAIN, scheme, &reference, 7) {
            let time = (0..trace.sensor_um.len())
                .map(|k| k as f64 * SAMPLING_PERIOD_S)
                .collect();
            let error = trace
                .sensor_um
                .iter()
                .zip(&trace.reference_um)
                .map(|(y, r)| y - r)
                .collect();
            plot = plot.with(Series::line(label, role, time, error));
        }
    }
    plot
}

/// What is left of a 12-bit converter's steps, with its rounding error carried on and without.
fn noise_shaped(bench: &Bench, design: &ServoDesign) -> Plot {
    let mut twelve_bits = bench.clone();
    twelve_bits.converters.dac_bits = 12;
    let (reference, from) = sine_reference_um(bench, 1.0, 5.0);
    let mut plot = Plot::new("Error with a 12-bit DAC: noise shaping")
        .x_axis("frequency", "Hz")
        .y_axis("amplitude density", "um/sqrt(Hz)")
        .log(true, true)
        .caption("1 Hz, 5 um, full bench; steps of 34 mV, about 5 nm.");
    for (label, noise_shaping, role) in [
        ("rounded", false, CurveRole::Other1),
        ("rounding error carried on", true, CurveRole::Measured),
    ] {
        let design = ServoDesign {
            noise_shaping,
            ..design.clone()
        };
        if let Ok(trace) = run(&twelve_bits, Variant::FULL, &design, &reference, 7) {
            let error: Vec<f64> = trace
                .sensor_um
                .iter()
                .zip(&trace.reference_um)
                .skip(from)
                .map(|(y, r)| y - r)
                .collect();
            let spectrum = amplitude_density(&error, 1.0 / SAMPLING_PERIOD_S);
            plot = plot.with(Series::line(
                label,
                role,
                spectrum.frequency_hz,
                spectrum.density,
            ));
        }
    }
    plot
}

/// Sections of Chapter 6.
#[must_use]
pub fn chapter_6(bench: &Bench, rows: &[ChapterRow], schemes: &[NamedScheme]) -> Vec<Section> {
    let mut blocks = vec![
        PageBlock::Plot(over_frequency(
            "Tracking error over frequency",
            rows,
            &[
                (
                    "PIDSM + alpha-beta",
                    "ch6.pidsm_ab.",
                    "hz.rms",
                    CurveRole::Measured,
                ),
                ("PID", "ch6.pid.", "hz.rms", CurveRole::Other1),
                ("sliding mode", "ch6.sm_ab.", "hz.rms", CurveRole::Other2),
                ("boundary layer", "ch6.smcbl.", "hz.rms", CurveRole::Other3),
            ],
        )),
        PageBlock::Plot(quasi_step_errors(bench, schemes)),
        PageBlock::Plot(portrait_of_the_controller()),
    ];
    blocks.extend(portrait_on_the_bench(bench).map(PageBlock::Plot));
    if let Some(scheme) = thesis_scheme("pidsm-chapter-6") {
        let design = without_model(bench, scheme);
        blocks.extend(
            hysteresis_compensated(
                bench,
                &design,
                Variant::PLAIN,
                "Hysteresis compensated (Ch. 6, Fig. 7)",
            )
            .map(PageBlock::Plot),
        );
    }
    vec![Section {
        heading: "Chapter 6: PID-based sliding mode control".into(),
        text: "Integer controllers on the plain bench, without computational delay as in the thesis. PIDSM has the thesis' gains; PID, the ideal \
               sliding mode and the boundary layer are tuned on the bench at 7 Hz."
            .into(),
        blocks,
    }]
}

/// Sections of Chapter 7.
#[must_use]
pub fn chapter_7(
    bench: &Bench,
    rows: &[ChapterRow],
    full: Option<&Commissioned>,
    robust: Option<&ServoDesign>,
) -> Vec<Section> {
    let mut blocks = vec![PageBlock::Plot(over_frequency(
        "Tracking error over frequency",
        rows,
        &[
            (
                "best design, full bench",
                "ch7.best.",
                "hz.none.full.rms",
                CurveRole::Measured,
            ),
            (
                "best design, full bench, loaded",
                "ch7.best.",
                "hz.load.full.rms",
                CurveRole::Model,
            ),
            (
                "PIDSMOC, thesis gains",
                "ch7.pidsmoc.",
                "hz.none.rms",
                CurveRole::Other1,
            ),
            (
                "PIDSMC + alpha-beta, thesis gains",
                "ch7.pidsmc_ab.",
                "hz.none.rms",
                CurveRole::Other2,
            ),
        ],
    ))];
    if let Some(c) = full {
        blocks.push(PageBlock::Plot(errors_at_100_hz(bench, c, Variant::FULL)));
        blocks.extend(
            hysteresis_compensated(
                bench,
                &c.design,
                Variant::FULL,
                "Hysteresis compensated by the best design",
            )
            .map(PageBlock::Plot),
        );
        blocks.push(PageBlock::Plot(hysteron_report::trade_off(&c.design)));
        blocks.push(PageBlock::Plot(noise_shaped(bench, &c.design)));
    }
    blocks.extend([
        PageBlock::Plot(portrait_of_the_observer()),
        PageBlock::Plot(noise_suppressed(bench)),
        PageBlock::Plot(estimation(bench, false)),
        PageBlock::Plot(estimation(bench, true)),
    ]);
    blocks.extend(robust.and_then(robust_tracking).map(PageBlock::Plot));
    let mut text =
        "The thesis' schemes have the thesis' gains and no computational delay, on the plain bench. The best design has one period of \
                    delay; its model was identified from one record of the same bench."
            .to_string();
    if let Some(c) = full {
        text += &format!("\n\n{}", c.design.explanation.join(" "));
    }
    let compared = Section {
        heading: "Chapter 7: other schemes under equal conditions".into(),
        text: "With the thesis' gains the order of PIDSMOC and PIDSMC + alpha-beta at low frequency is that of their integral gains, 1 and 2. \
               Here each scheme is designed for the same identified model, with one period of delay and under one set of margins, and runs on the full bench. \
               Below, schemes that others compare with, under the margins of the best design."
            .into(),
        blocks: vec![
            PageBlock::Plot(over_frequency(
                "Designed under one set of margins, full bench, one period of delay",
                rows,
                &[
                    ("PIDSMOC", "ch7.designed.pidsmoc.", "hz.none.rms", CurveRole::Other1),
                    ("PIDSMC + alpha-beta", "ch7.designed.pidsmc_ab.", "hz.none.rms", CurveRole::Other2),
                    ("PIDSMOC, hysteresis inverted", "ch7.designed_inverse.pidsmoc.", "hz.none.rms", CurveRole::Measured),
                    ("PIDSMC + alpha-beta, hysteresis inverted", "ch7.designed_inverse.pidsmc_ab.", "hz.none.rms", CurveRole::Other3),
                    ("predictor, hysteresis inverted", "ch7.designed_inverse.predictor.", "hz.none.rms", CurveRole::Model),
                ],
            )),
            PageBlock::Plot(over_frequency(
                "Schemes on the full bench, one period of delay",
                rows,
                &[
                    ("best design", "ch7.best.", "hz.none.full.rms", CurveRole::Measured),
                    ("correction learned", "ch7.compare.predictor-learning.", "hz.none.rms", CurveRole::Residual),
                    ("without hysteresis model", "ch7.compare.predictor-linear.", "hz.none.rms", CurveRole::Model),
                    ("disturbance observer", "ch7.compare.disturbance-observer.", "hz.none.rms", CurveRole::Other1),
                    ("feedforward alone", "ch7.compare.feedforward.", "hz.none.rms", CurveRole::Other2),
                    ("feedforward without creep", "ch7.compare.feedforward-without-creep.", "hz.none.rms", CurveRole::Other3),
                    ("feedforward + PI", "ch7.compare.feedforward-pi.", "hz.none.rms", CurveRole::Other4),
                ],
            )),
        ],
    };
    vec![
        Section {
            heading: "Chapter 7: observer and controller".into(),
            text,
            blocks,
        },
        compared,
    ]
}
