//! The model of a design, identified from an experiment on the bench: what a commissioning engineer would do,
//! in two seconds of drive.
//!
//! # How it works
//! One record from the virgin state: triangles that grow and nest (loops and the first rise), raised cosines
//! at the frequencies of use, and a multisine to 8 kHz around mid-range (modes and bandwidths). The chain is
//! grown as a reader of the residual would grow it: loops, first rise, first mode and creep; then, where it
//! lowers the residual, amplifier bandwidth and second mode with the starts that the effects declare. The
//! sensor's bandwidth stays what its data sheet says.

use hysteron::dataset::{Dataset, Record, Role};
use hysteron::identification::fit::{Effort, Fit, fit, with_effect};
use hysteron::servo::model::{ActuatorModel, actuator_model};
use hysteron_sim::bench::{Bench, Completeness, Start, Variant};
use hysteron_sim::chain::{EffectInstance, Model};
use hysteron_sim::effect::creep::with_signed_shares;
use hysteron_sim::effect::{Overview, by_id};
use hysteron_sim::waveform;

/// Time constants of the creep that is fitted beside the modes, s: slower than these by far, so that it
/// cannot take their place.
const CREEP_TIME_CONSTANTS_S: [f64; 6] = [0.015, 0.03, 0.06, 0.12, 0.4, 1.6];

/// What identification came to.
#[derive(Clone, Debug)]
pub struct CommissionedStage {
    /// For the design.
    pub model: ActuatorModel,
    /// The whole chain, creep included.
    pub chain: Model,
    /// Residual over the experiment, um RMS.
    pub rms_um: f64,
    /// Residual after each step, um RMS, with the effects that the chain then had.
    pub steps: Vec<(String, f64)>,
}

/// The experiment's drive, V.
#[must_use]
pub fn drive_v(sample_rate_hz: f64, low_v: f64, high_v: f64) -> Vec<f64> {
    let range = high_v - low_v;
    let at = |share: f64| low_v + share * range;
    let mut levels = vec![at(0.0)];
    for peak in [0.3, 0.55, 0.8, 1.0] {
        levels.extend([at(peak), at(0.0)]);
    }
    levels.extend(
        [
            1.0, 0.3, 0.8, 0.45, 0.7, 0.1, 0.5, 0.2, 0.4, 0.0, 0.9, 0.6, 0.75, 0.15, 0.0,
        ]
        .map(at),
    );
    let period = 2000;
    let lines: Vec<usize> = (1..=800).step_by(3).collect();
    waveform::concatenate(&[
        waveform::half_cosines(sample_rate_hz, 0.02, &levels),
        waveform::hold(sample_rate_hz, at(0.0), 0.1),
        waveform::raised_cosine(sample_rate_hz, 10.0, at(0.05), at(0.95), 2),
        waveform::raised_cosine(sample_rate_hz, 100.0, at(0.1), at(0.9), 6),
        waveform::raised_cosine(sample_rate_hz, 200.0, at(0.1), at(0.85), 10),
        waveform::raised_cosine(sample_rate_hz, 500.0, at(0.1), at(0.8), 20),
        waveform::hold(sample_rate_hz, at(0.5), 0.02),
        waveform::multisine(period, &lines, 0.3 * range, at(0.5), 4, 11),
        waveform::hold(sample_rate_hz, at(0.5), 0.05),
        waveform::hold(sample_rate_hz, at(0.0), 0.1),
    ])
}

/// Plays the experiment on a variant of the bench and identifies the model.
#[must_use]
pub fn on_bench(bench: &Bench, variant: Variant, seed: u64) -> Option<CommissionedStage> {
    let drive = drive_v(
        bench.converters.sample_rate_hz,
        bench.drive_min_v,
        bench.drive_max_v,
    );
    let record = bench.record(variant, Start::Virgin, &drive, seed);
    let record = Record::new(
        "commissioning",
        record.sample_rate_hz,
        record.drive_v,
        record.reading_um,
    )
    .from_virgin_state();
    let dataset = Dataset::new(
        &bench.name,
        bench.drive_min_v,
        bench.drive_max_v,
        vec![record],
    )
    .ok()?;
    let data_sheet_hz = (variant.completeness == Completeness::Full)
        .then(|| bench.data_sheet_sensor_bandwidth_hz());
    identify(&dataset, data_sheet_hz)
}

/// An effect with one of its starts.
fn instance(id: &str, overview: &Overview, values: &[f64]) -> Option<EffectInstance> {
    Some(EffectInstance::new(by_id(id)?, overview, values))
}

/// Identifies the chain from a data set; `sensor_bandwidth_hz` is what the data sheet says.
#[must_use]
pub fn identify(dataset: &Dataset, sensor_bandwidth_hz: Option<f64>) -> Option<CommissionedStage> {
    let overview = dataset.overview();
    let records: Vec<usize> = dataset.with_role(Role::Identify);
    let quick = Effort {
        iterations: 4,
        tolerance: 1.0,
        ..Effort::default()
    };
    let mut steps = Vec::new();
    let mut model = Model::new(dataset.drive_min_v, dataset.drive_max_v);
    for id in ["hysteresis", "initial_curve"] {
        model = with_effect(&model, instance(id, &overview, &[])?);
    }
    if let Some(bandwidth_hz) = sensor_bandwidth_hz {
        let mut sensor = instance("sensor_bandwidth", &overview, &[bandwidth_hz])?;
        for p in &mut sensor.parameters {
            p.parameter.fixed = true;
        }
        model = with_effect(&model, sensor);
    }
    // The first mode from its declared starts; the best goes on.
    let best_of = |model: &Model, id: &str, effort: Effort| -> Option<Fit> {
        let starts = by_id(id)?.starts(&overview);
        starts
            .iter()
            .filter_map(|start| {
                Some(fit(
                    &with_effect(model, instance(id, &overview, start)?),
                    dataset,
                    &records,
                    effort,
                ))
            })
            .min_by(|a, b| a.rms_um.total_cmp(&b.rms_um))
    };
    let mut best = best_of(&model, "vibration", quick)?;
    steps.push((
        "hysteresis, initial_curve, vibration".to_string(),
        best.rms_um,
    ));
    best = fit(
        &with_effect(
            &best.model,
            with_signed_shares(&overview, &CREEP_TIME_CONSTANTS_S),
        ),
        dataset,
        &records,
        Effort::default(),
    );
    steps.push(("creep".to_string(), best.rms_um));
    if sensor_bandwidth_hz.is_some() {
        let second = best_of(&best.model, "second_mode", quick)?;
        if second.rms_um < 0.98 * best.rms_um {
            best = fit(&second.model, dataset, &records, Effort::default());
            steps.push(("second_mode".to_string(), best.rms_um));
        }
        let start_hz = sensor_bandwidth_hz.unwrap_or(1e4);
        let amplifier = instance("amplifier_bandwidth", &overview, &[start_hz])?;
        let fine = Effort {
            iterations: 30,
            tolerance: 0.01,
            ..Effort::default()
        };
        let with_amplifier = fit(
            &with_effect(&best.model, amplifier),
            dataset,
            &records,
            fine,
        );
        if with_amplifier.rms_um < best.rms_um {
            best = with_amplifier;
            steps.push(("amplifier_bandwidth".to_string(), best.rms_um));
        }
    }
    let chain = best.model;
    Some(CommissionedStage {
        model: actuator_model(&chain)?,
        chain,
        rms_um: best.rms_um,
        steps,
    })
}
