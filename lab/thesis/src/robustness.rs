//! Robustness as in Ch. 7, Fig. 12: a plant whose natural frequency, damping ratio and gain are half as large again as the nominal ones, an
//! unknown input and noise, and a design made for it.

use crate::bench_runs::row_um;
use crate::chapter::Row;
use hysteron::servo::design::{Scheme, ServoDesign, thesis_scheme};
use hysteron::servo::model::{ActuatorModel, LinearModel, ModeModel, NominalModel, SAMPLING_PERIOD_S};
use hysteron::servo::predictor::{PredictorDesign, PredictorTuning};
use hysteron_core::servo_parameters::ConverterParameters;
use hysteron_core::servo_tick::ServoTick;
use hysteron_sim::closed_loop::{ErrorFigures, Plant, Surroundings, Trace, follow};
use hysteron_sim::converter_scale::ConverterScale;
use hysteron_sim::effect::vibration::Mode;
use hysteron_sim::waveform;
use rayon::prelude::*;

/// Steps of the plant in a period.
const SUBSTEPS: u32 = 10;

/// The linear plant of Fig. 12: the nominal mode with all parameters times a factor, and an unknown input `10 sin(150 t + 1) + 10` V.
struct LinearPlant {
    mode: Mode,
    gain_um_v: f64,
    unknown: bool,
    step: u32,
    displacement_um: f64,
}

impl LinearPlant {
    fn new(factor: f64, unknown: bool) -> Self {
        let nominal = NominalModel::THESIS;
        let dt_s = SAMPLING_PERIOD_S / f64::from(SUBSTEPS);
        Self {
            mode: Mode::new(nominal.natural_frequency_rad_s * factor, nominal.damping_ratio * factor, dt_s),
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
            let epsilon_v = if self.unknown { 10.0 * (150.0 * t_s + 1.0).sin() + 10.0 } else { 0.0 };
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

/// Tracking of 100 Hz on the plant of Fig. 12; the simulation of the thesis has no limits: converters over -200..+200 V and +-64 um, as fine
/// as the codes allow.
#[must_use]
pub fn run(design: &ServoDesign, factor: f64, unknown: bool, noise_um: f64) -> Option<Trace> {
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
    let converters = ConverterParameters { noise_shaping: design.noise_shaping, ..scale.parameters() };
    let mut servo = ServoTick::new(design.parameters(converters).ok()?);
    servo.open_loop(scale.dac_code(0.0));
    let reference_um = waveform::sine(1.0 / SAMPLING_PERIOD_S, 100.0, 5.0, 5.0, 0.0, 1.0);
    let around = Surroundings { scale, noise_um, seed: 3, external_um: &[], sensor_zero_um: 0.0, displacement_zero_um: 0.0 };
    Some(follow(&mut LinearPlant::new(factor, unknown), &mut servo, &around, &reference_um))
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
    run(design, factor, unknown, noise_um).map(|trace| trace.sensor_error(4000))
}

/// The design made for Fig. 12: of a scan the one with the smallest largest error there, and that error, um.
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
    let mut rows = vec![Row::new(
        "ch7.robust.pct",
        100.0 * max_um / 10.0,
        "%",
        format!(
            "largest error of 10 um, 100 Hz, xi, wn and K +50 %, unknown input 10 sin(150 t + 1) + 10 V, 0.05 um noise, one period of delay; largest sampled eigenvalue there {radius:.3}; tuning {tuning:?}"
        ),
    )];
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
                let id = format!("ch7.robust.thesis_pidsmoc.{id}.pct");
                rows.push(Row::new(id, 100.0 * f.max_um / 10.0, "%", "thesis gains, no delay, sampled at 20 kHz"));
            }
        }
    }
    rows
}
