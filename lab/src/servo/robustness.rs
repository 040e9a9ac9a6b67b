//! Robustness as in Ch. 7, Fig. 12: a plant whose natural frequency, damping ratio and gain are half as large again as the nominal ones, an
//! unknown input and noise, and a design made for it.

use super::design::{Scheme, ServoDesign, thesis_scheme};
use super::model::{ActuatorModel, LinearModel, ModeModel, NominalModel, SAMPLING_PERIOD_S};
use super::predictor::{PredictorDesign, PredictorTuning};
use super::reproduce::row_um;
use crate::reproduce::Row;
use hysteron_core::servo_tick::ServoTick;
use hysteron_core::signal::Micrometres;
use hysteron_sim::closed_loop::ErrorFigures;
use hysteron_sim::effect::vibration::Mode;
use hysteron_sim::waveform;
use rand::SeedableRng;
use rayon::prelude::*;

/// The linear plant of Fig. 12 under a servo: parameters +50 %, unknown input `10 sin(150 t + 1) + 10` V, sensor noise 0.05 um.
#[must_use]
pub fn run(design: &ServoDesign, factor: f64, unknown: bool, noise_um: f64) -> Option<(Vec<f64>, Vec<f64>)> {
    let nominal = NominalModel::THESIS;
    let fs = 1.0 / SAMPLING_PERIOD_S;
    // The simulation of the thesis has no limits: converters over -200..+200 V and +-64 um, as fine as the codes allow.
    let (adc_step_um, dac_step_v) = (128.0 / 65_536.0, 400.0 / 65_536.0);
    let converters = hysteron_core::servo_parameters::ConverterParameters {
        adc_zero: (-64.0 * 2.0_f64.powi(24)) as i32,
        adc_step: (adc_step_um * 2.0_f64.powi(40)) as i64,
        dac_zero: (-200.0 * 2.0_f64.powi(22)) as i32,
        dac_step: (dac_step_v * 2.0_f64.powi(38)) as i64,
        dac_codes_per_volt: (2.0_f64.powi(20) / dac_step_v).round() as i32,
        dac_code_min: 0,
        dac_code_max: u16::MAX,
        noise_shaping: design.noise_shaping,
    };
    let parameters = design.parameters(converters).ok()?;
    let mut servo = ServoTick::new(parameters);
    let rest = (200.0 / dac_step_v).round() as u16;
    servo.open_loop(rest);
    servo.enable();
    let substeps = 10;
    let mut mode =
        Mode::new(nominal.natural_frequency_rad_s * factor, nominal.damping_ratio * factor, SAMPLING_PERIOD_S / f64::from(substeps));
    let mut generator = rand_pcg::Pcg64Mcg::seed_from_u64(3);
    let reference = waveform::sine(fs, 100.0, 5.0, 5.0, 0.0, 1.0);
    let looked_ahead = hysteron_core::reference_window::PREVIEW_TICKS;
    let mut y = 0.0;
    let mut acting = 0.0;
    let mut out = Vec::with_capacity(reference.len());
    for k in 0..reference.len() - looked_ahead {
        out.push(y);
        let noisy = y + noise_um * gaussian(&mut generator);
        let adc = ((noisy + 64.0) / adc_step_um).round().clamp(0.0, 65_535.0) as u16;
        let ahead = reference.get(k + looked_ahead).copied()?;
        let code = servo.tick(adc, Micrometres::saturating_from_num(ahead));
        for i in 0..substeps {
            let t = (k as f64 + f64::from(i) / f64::from(substeps)) * SAMPLING_PERIOD_S;
            let epsilon = if unknown { 10.0 * (150.0 * t + 1.0).sin() + 10.0 } else { 0.0 };
            y = mode.step(nominal.gain_um_v * factor * (acting + epsilon));
        }
        acting = f64::from(code) * dac_step_v - 200.0;
    }
    Some((out, reference))
}

fn gaussian(generator: &mut rand_pcg::Pcg64Mcg) -> f64 {
    use rand::Rng;
    // Sum of twelve uniform numbers: unit variance, and nothing beyond six.
    (0..12).map(|_| generator.random::<f64>()).sum::<f64>() - 6.0
}

/// A predictor for the nominal model with a tuning, hysteresis left to the unknown input.
fn nominal_predictor(tuning: PredictorTuning) -> ServoDesign {
    let nominal = NominalModel::THESIS;
    let mut model = ActuatorModel {
        drive_min_v: 0.0,
        drive_max_v: 80.0,
        g_um: vec![vec![0.0, -80.0 * nominal.gain_um_v], vec![80.0 * nominal.gain_um_v, 0.0]],
        r_um: vec![0.0],
        linear: LinearModel {
            first_mode: ModeModel { natural_frequency_rad_s: nominal.natural_frequency_rad_s, damping_ratio: nominal.damping_ratio },
            second_mode: None,
            amplifier_bandwidth_hz: None,
            sensor_bandwidth_hz: None,
        },
        creep: Vec::new(),
    };
    model.drive_min_v = 0.0;
    ServoDesign::new(Scheme::Predictor { tuning, hysteresis_inverse: false }, &model, true)
}

/// Errors of a design on the plant of Fig. 12.
fn figures(design: &ServoDesign, factor: f64, unknown: bool, noise_um: f64) -> Option<ErrorFigures> {
    run(design, factor, unknown, noise_um).map(|(y, r)| ErrorFigures::between(&y, &r, 4000))
}

/// The design made for Fig. 12: of a scan the one with the smallest largest error there, and that error, um.
#[must_use]
pub fn design() -> Option<(ServoDesign, PredictorTuning, f64)> {
    let mut candidates = Vec::new();
    for effort_weight in [0.1, 0.3, 1.0, 3.0, 10.0, 30.0] {
        for unknown_change_um in [0.003, 0.01, 0.03, 0.1, 0.3] {
            for slope in [0.0, 0.02] {
                candidates.push(PredictorTuning {
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
            let wrong = figures(&design, 1.5, true, 0.05)?;
            wrong.max_um.is_finite().then_some((wrong.max_um, *tuning))
        })
        .min_by(|a, b| a.0.total_cmp(&b.0));
    let (max_um, tuning) = best?;
    Some((nominal_predictor(tuning), tuning, max_um))
}

/// Fig. 12: what the design made for it does there, and what it costs when nothing is wrong.
#[must_use]
pub fn rows(made_for_it: &(ServoDesign, PredictorTuning, f64)) -> Vec<Row> {
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
        law.spectral_radius(&wrong.sampled(SAMPLING_PERIOD_S), 1.5, 0)
    };
    // Of the 10 um that the reference spans.
    let mut rows = vec![Row {
        id: "ch7.robust.pct".into(),
        ours: 100.0 * max_um / 10.0,
        unit: "%".into(),
        note: format!(
            "largest error of 10 um, 100 Hz, xi, wn and K +50 %, unknown input 10 sin(150 t + 1) + 10 V, 0.05 um noise, one period of delay; largest sampled eigenvalue there {radius:.3}; tuning {tuning:?}"
        ),
    }];
    if let Some(nominal) = figures(design, 1.0, true, 0.05) {
        rows.push(row_um("ch7.robust.nominal.rms", nominal.rms_um, "the same design, noise and unknown input on the nominal plant"));
    }
    if let Some(nominal) = figures(design, 1.0, true, 0.001) {
        rows.push(row_um("ch7.robust.nominal_quiet.rms", nominal.rms_um, "the same design with 1 nm noise on the nominal plant"));
    }
    let quick = nominal_predictor(PredictorTuning { effort_weight: 0.1, unknown_change_um: 0.002, ..PredictorTuning::START });
    if let Some(nominal) = figures(&quick, 1.0, true, 0.001) {
        rows.push(row_um(
            "ch7.robust.fast_nominal_quiet.rms",
            nominal.rms_um,
            "for comparison: a design for 1 nm noise, nominal plant, same unknown input",
        ));
    }
    if let Some(scheme) = thesis_scheme("pidsmoc") {
        let mut thesis = nominal_predictor(tuning);
        thesis.scheme = scheme;
        thesis.delayed = false;
        for (factor, id) in [(1.0, "nominal"), (1.5, "plus50")] {
            if let Some(f) = figures(&thesis, factor, true, 0.05) {
                rows.push(Row {
                    id: format!("ch7.robust.thesis_pidsmoc.{id}.pct"),
                    ours: 100.0 * f.max_um / 10.0,
                    unit: "%".into(),
                    note: "thesis gains, no delay, sampled at 20 kHz".into(),
                });
            }
        }
    }
    rows
}
