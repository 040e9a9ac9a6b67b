//! Robustness as in Ch. 7, Fig. 12: a plant whose natural frequency, damping ratio and gain are half as large
//! again as the nominal ones, an unknown input and noise, and a design made for such plants.

use crate::bench_runs::{row_um, sine_key};
use crate::chapter::{ChapterRow, RunKey};
use hysteron::servo::design::{Scheme, ServoDesign, thesis_scheme};
use hysteron::servo::law::PredictorDesign;
use hysteron::servo::model::{
    ActuatorModel, LinearModel, ModeModel, NominalModel, SAMPLING_PERIOD_S,
};
use hysteron::servo::sampled_loop::SampledLoop;
use hysteron::servo::tuning::PredictorTuning;
use hysteron_core::servo_parameters::ConverterParameters;
use hysteron_core::servo_tick::ServoTick;
use hysteron_sim::closed_loop::{ErrorFigures, Plant, Surroundings, Trace, follow};
use hysteron_sim::converter_scale::ConverterScale;
use hysteron_sim::effect::vibration::VibrationMode;
use hysteron_sim::waveform;
use nalgebra::Complex;
use rayon::prelude::*;

/// Steps of the plant in a period.
const SUBSTEPS: u32 = 10;

/// The linear plant of Fig. 12: the nominal mode with all parameters times a factor, and an unknown input
/// `10 sin(w t + phase) + 10` V.
struct LinearPlant {
    mode: VibrationMode,
    gain_um_v: f64,
    unknown: Option<(f64, f64)>,
    step: u32,
    displacement_um: f64,
}

impl LinearPlant {
    fn new(factor: f64, unknown: Option<(f64, f64)>) -> Self {
        let nominal = NominalModel::THESIS;
        let dt_s = SAMPLING_PERIOD_S / f64::from(SUBSTEPS);
        Self {
            mode: VibrationMode::new(
                nominal.natural_frequency_rad_s * factor,
                nominal.damping_ratio * factor,
                dt_s,
            ),
            gain_um_v: nominal.gain_um_v * factor,
            unknown,
            step: 0,
            displacement_um: 0.0,
        }
    }
}

impl Plant for LinearPlant {
    fn advance(&mut self, drive_v: f64, _external_um: f64) {
        for _ in 0..SUBSTEPS {
            let t_s = f64::from(self.step) / f64::from(SUBSTEPS) * SAMPLING_PERIOD_S;
            let epsilon_v = self
                .unknown
                .map_or(0.0, |(w, phase)| 10.0 * (w * t_s + phase).sin() + 10.0);
            self.displacement_um = self.mode.step(self.gain_um_v * (drive_v + epsilon_v));
            self.step += 1;
        }
    }

    fn displacement_um(&self) -> f64 {
        self.displacement_um
    }

    fn sensor_um(&self) -> f64 {
        self.displacement_um
    }
}

/// A reference and an unknown input.
#[derive(Clone, Copy)]
pub struct RobustnessCase {
    /// Frequency of the reference, Hz.
    hz: f64,
    /// Of the unknown input `10 sin(w t + phase) + 10` V: `w` and `phase`.
    unknown: (f64, f64),
    /// Seed of the noise.
    seed: u64,
}

/// The case of Fig. 12.
pub const PRINTED: RobustnessCase = RobustnessCase {
    hz: 100.0,
    unknown: (150.0, 1.0),
    seed: 3,
};
/// The case by which a tuning is chosen: another reference, another unknown input, other noise.
const CHOICE: RobustnessCase = RobustnessCase {
    hz: 80.0,
    unknown: (110.0, 0.3),
    seed: 103,
};

/// The run by which a tuning is chosen.
#[must_use]
pub fn choice() -> RunKey {
    RunKey::new(sine_key(CHOICE.hz, 5.0), CHOICE.seed)
}

/// Tracking on the plant of Fig. 12; the simulation of the thesis has no limits: converters over -200..+200 V
/// and +-64 um, as fine as the codes allow.
#[must_use]
pub fn run(
    design: &ServoDesign,
    case: RobustnessCase,
    factor: f64,
    unknown: bool,
    noise_um: f64,
) -> Option<Trace> {
    let scale = ConverterScale {
        adc_zero_um: -64.0,
        adc_lsb_um: 128.0 / 65_536.0,
        adc_bits: 16,
        dac_zero_v: -200.0,
        dac_lsb_v: 400.0 / 65_536.0,
        dac_bits: 16,
        drive_min_v: -200.0,
        drive_max_v: 200.0,
    };
    let converters = ConverterParameters {
        noise_shaping: design.noise_shaping,
        ..scale.parameters()
    };
    let mut servo = ServoTick::new(design.parameters(converters).ok()?);
    servo.open_loop(scale.dac_code(0.0));
    let reference_um = waveform::sine(1.0 / SAMPLING_PERIOD_S, case.hz, 5.0, 5.0, 0.0, 1.0);
    let around = Surroundings {
        scale,
        noise_um,
        seed: case.seed,
        external_um: &[],
        sensor_zero_um: 0.0,
        displacement_zero_um: 0.0,
    };
    Some(follow(
        &mut LinearPlant::new(factor, unknown.then_some(case.unknown)),
        &mut servo,
        &around,
        &reference_um,
    ))
}

/// A predictor for the nominal model with a tuning, hysteresis left to the unknown input.
fn nominal_predictor(tuning: PredictorTuning) -> ServoDesign {
    let nominal = NominalModel::THESIS;
    let mut model = ActuatorModel {
        drive_min_v: 0.0,
        drive_max_v: 80.0,
        g_um: vec![
            vec![0.0, -80.0 * nominal.gain_um_v],
            vec![80.0 * nominal.gain_um_v, 0.0],
        ],
        r_um: vec![0.0],
        linear: LinearModel {
            first_mode: ModeModel {
                natural_frequency_rad_s: nominal.natural_frequency_rad_s,
                damping_ratio: nominal.damping_ratio,
            },
            second_mode: None,
            amplifier_bandwidth_hz: None,
            sensor_bandwidth_hz: None,
            period_s: SAMPLING_PERIOD_S,
        },
        creep: Vec::new(),
        creep_pair: None,
    };
    model.drive_min_v = 0.0;
    ServoDesign::new(
        Scheme::Predictor {
            tuning,
            hysteresis_inverse: false,
        },
        &model,
        true,
    )
}

/// Errors of a design on the plant of Fig. 12.
fn figures(
    design: &ServoDesign,
    case: RobustnessCase,
    factor: f64,
    unknown: bool,
    noise_um: f64,
) -> Option<ErrorFigures> {
    run(design, case, factor, unknown, noise_um).map(|trace| trace.true_error(4000))
}

/// A design for wrong plants and strong noise: of a scan the one with the smallest largest error in a case
/// like that of Fig. 12, and its largest error in that of Fig. 12, um.
#[must_use]
pub fn design() -> Option<(ServoDesign, PredictorTuning, f64)> {
    let mut candidates = Vec::new();
    for effort_weight in [0.1, 0.3, 1.0, 3.0, 10.0, 30.0] {
        for unknown_change_um in [0.003, 0.01, 0.03, 0.1, 0.3] {
            for slope in [0.0, 0.02] {
                candidates.push(PredictorTuning {
                    fast_noise_um: 0.0,
                    effort_weight,
                    unknown_change_um,
                    unknown_slope_change_um: slope * unknown_change_um,
                    force_noise_um: 0.01,
                    sensor_noise_um: 0.05,
                });
            }
        }
    }
    let best = candidates
        .par_iter()
        .filter_map(|tuning| {
            let design = nominal_predictor(*tuning);
            let wrong = figures(&design, CHOICE, 1.5, true, 0.05)?;
            wrong.max_um.is_finite().then_some((wrong.max_um, *tuning))
        })
        .min_by(|a, b| a.0.total_cmp(&b.0));
    let (_, tuning) = best?;
    let design = nominal_predictor(tuning);
    let max_um = figures(&design, PRINTED, 1.5, true, 0.05)?.max_um;
    Some((design, tuning, max_um))
}

/// Fig. 12: what the design made for it does there, and what it costs when nothing is wrong.
#[must_use]
pub fn rows(made_for_it: &(ServoDesign, PredictorTuning, f64)) -> Vec<ChapterRow> {
    let (design, tuning, max_um) = made_for_it;
    let (tuning, max_um) = (*tuning, *max_um);
    let radius = {
        let linear = design.model.linear;
        let law = PredictorDesign::new(&linear, &tuning);
        let wrong = LinearModel {
            first_mode: ModeModel {
                natural_frequency_rad_s: 1.5 * linear.first_mode.natural_frequency_rad_s,
                damping_ratio: 1.5 * linear.first_mode.damping_ratio,
            },
            ..linear
        };
        SampledLoop::new(&law, &wrong.sampled())
            .with_gain(1.5)
            .spectral_radius()
    };
    // Of the 10 um that the reference spans.
    let mut rows = vec![ChapterRow::new(
        "ch7.robust.pct",
        100.0 * max_um / 10.0,
        "%",
        format!(
            "a predictor tuned in another case; largest error of 10 um, 100 Hz, xi, wn and K +50 %, unknown input 10 sin(150 t + 1) + 10 V, 0.05 um noise, one period of delay; largest sampled eigenvalue there {radius:.3}; tuning {tuning:?}"
        ),
    )
    .on(sine_key(PRINTED.hz, 5.0), PRINTED.seed)];
    if let Some(nominal) = figures(design, PRINTED, 1.0, true, 0.05) {
        rows.push(row_um(
            "ch7.robust.nominal.rms",
            nominal.rms_um,
            "the same design, noise and unknown input on the nominal plant",
        ));
    }
    if let Some(nominal) = figures(design, PRINTED, 1.0, true, 0.001) {
        rows.push(row_um(
            "ch7.robust.nominal_quiet.rms",
            nominal.rms_um,
            "the same design with 1 nm noise on the nominal plant",
        ));
    }
    let quick = nominal_predictor(PredictorTuning {
        effort_weight: 0.1,
        unknown_change_um: 0.002,
        ..PredictorTuning::START
    });
    if let Some(nominal) = figures(&quick, PRINTED, 1.0, true, 0.001) {
        rows.push(row_um(
            "ch7.robust.fast_nominal_quiet.rms",
            nominal.rms_um,
            "for comparison: a design for 1 nm noise, nominal plant, same unknown input",
        ));
    }
    rows
}

/// Fig. 12 with the thesis' PIDSMOC, and the reference that it follows on its own model.
#[must_use]
pub fn rows_as_printed() -> Vec<ChapterRow> {
    let mut rows = Vec::new();
    let Some(scheme) = thesis_scheme("pidsmoc") else {
        return rows;
    };
    let design = ServoDesign {
        scheme,
        delayed: false,
        ..nominal_predictor(PredictorTuning::START)
    };
    let note = "thesis gains, no delay, xi, wn and K +50 %, unknown input 10 sin(150 t + 1) + 10 V, 0.05 um noise; of 10 um";
    if let Some(trace) = run(&design, PRINTED, 1.5, true, 0.05) {
        let of_span = |um: f64| 100.0 * um / 10.0;
        let key = || sine_key(PRINTED.hz, 5.0);
        let track = trace.true_error(4000).max_um;
        rows.push(
            ChapterRow::new("ch7.robust.pidsmoc.track_pct", of_span(track), "%", note)
                .on(key(), PRINTED.seed),
        );
        // Displacement and velocity, each over its span; a velocity between samples is their difference.
        let position = trace
            .estimate_um
            .iter()
            .zip(&trace.displacement_um)
            .skip(4000)
            .map(|(x, y)| (x[0] - y).abs())
            .fold(0.0, f64::max);
        let moved = trace
            .displacement_um
            .windows(3)
            .map(|w| 0.5 * (w[2] - w[0]));
        let velocity = trace
            .estimate_um
            .iter()
            .skip(1)
            .zip(moved)
            .skip(4000)
            .map(|(x, v)| (x[1] - v).abs())
            .fold(0.0, f64::max);
        let span_of_velocity = 10.0 * std::f64::consts::TAU * PRINTED.hz * SAMPLING_PERIOD_S;
        let estimate = of_span(position).max(100.0 * velocity / span_of_velocity);
        let both = format!(
            "{note}; displacement {:.2} %, velocity {:.2} % of its span",
            of_span(position),
            100.0 * velocity / span_of_velocity
        );
        rows.push(
            ChapterRow::new("ch7.robust.pidsmoc.estimate_pct", estimate, "%", both)
                .on(key(), PRINTED.seed),
        );
    }
    if let Some(nominal) = figures(&design, PRINTED, 1.0, true, 0.05) {
        rows.push(ChapterRow::new(
            "ch7.robust.pidsmoc.nominal.track_pct",
            10.0 * nominal.max_um,
            "%",
            "the same on the nominal plant",
        ));
    }
    if let Some(trace) = run(&design, PRINTED, 1.0, false, 0.0) {
        // First harmonics of reference and motion over whole periods.
        let harmonic = |signal: &[f64]| -> Complex<f64> {
            let from = signal.len().saturating_sub(10_000);
            let turns = |k: usize| {
                Complex::from_polar(
                    1.0,
                    -std::f64::consts::TAU * PRINTED.hz * k as f64 * SAMPLING_PERIOD_S,
                )
            };
            signal
                .iter()
                .enumerate()
                .skip(from)
                .map(|(k, y)| turns(k) * *y)
                .sum()
        };
        let g5 = harmonic(&trace.displacement_um) / harmonic(&trace.reference_um);
        rows.push(ChapterRow::new(
            "ch7.g5.gain_db",
            20.0 * g5.norm().log10(),
            "dB",
            "sampled PIDSMOC on its own model, 100 Hz",
        ));
        rows.push(ChapterRow::new(
            "ch7.g5.phase_deg",
            g5.arg().to_degrees(),
            "deg",
            "sampled PIDSMOC on its own model, 100 Hz",
        ));
    }
    rows
}
