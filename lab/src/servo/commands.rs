//! What `hysteron design`, `check` and `track` do, without the command line: a chain of effects in, structs that serialise out.

use super::check::{self, ContinuousConditions};
use super::design::{SCHEMA, Scheme, ServoDesign, thesis_scheme};
use super::disturbance_observer;
use super::identify::actuator_model;
use super::model::{ActuatorModel, NominalModel, SAMPLING_PERIOD_S};
use super::predictor::{Demands, Margins, PredictorDesign, judge};
use super::regulator_loop;
use super::thesis_schemes::{PidGains, ReachingGains};
use super::track::{SineReference, TrackResult, track};
use hysteron_sim::chain::Model;
use serde::Serialize;

/// Names of the schemes that `track --scheme` takes besides the one of the design.
pub const SCHEMES: [&str; 15] = [
    "predictor",
    "predictor-linear",
    "disturbance-observer",
    "disturbance-observer-inverse",
    "pidsmoc",
    "pidsmc-alpha-beta",
    "pidsmc-alpha-beta-discrete",
    "pidsm-chapter-6",
    "sliding-mode",
    "boundary-layer",
    "pid",
    "feedforward",
    "feedforward-without-creep",
    "feedforward-pi",
    "feedforward-pi-notch",
];

/// What `hysteron check` found.
#[derive(Clone, Debug, Serialize)]
pub struct CheckResult {
    /// `hysteron.check/1`.
    pub schema: String,
    /// Scheme.
    pub scheme: String,
    /// True if all sampled eigenvalues are inside the unit circle, the period of delay included where the design has it.
    pub stable: bool,
    /// Sampled eigenvalues `[re, im]`.
    pub sampled_poles: Vec<[f64; 2]>,
    /// The thesis' continuous conditions; empty where they do not apply.
    pub continuous: ContinuousConditions,
    /// Margins of a predictor.
    pub margins: Option<Margins>,
    /// What it means, in sentences.
    pub remarks: Vec<String>,
}

/// Designs the best servo for an identified chain.
///
/// # Errors
/// A message that says what the model lacks, or that no tuning keeps the margins.
pub fn design(chain: &Model, demands: &Demands) -> Result<ServoDesign, String> {
    let model = actuator_model(chain).ok_or(
        "the model needs the effects `hysteresis` and `vibration` for a servo design: identify it with --effects hysteresis,initial_curve,vibration,creep",
    )?;
    if model.linear.first_mode.natural_frequency_rad_s * SAMPLING_PERIOD_S > std::f64::consts::PI {
        return Err(format!(
            "the first mode at {:.0} rad/s is beyond half the servo's sampling rate of {:.0} Hz",
            model.linear.first_mode.natural_frequency_rad_s,
            1.0 / SAMPLING_PERIOD_S
        ));
    }
    let fastest_hz = 0.5 / SAMPLING_PERIOD_S;
    if !(demands.reference_hz > 0.0 && demands.reference_hz < fastest_hz) {
        return Err(format!("--reference-hz {}; expected above 0 and below {fastest_hz}", demands.reference_hz));
    }
    let (model, projection_um) = model.for_the_tick();
    let mut design = ServoDesign::best(&model, demands).ok_or_else(|| {
        "no tuning keeps the margins (gain +-50 %, a period more of delay, twice the mass, an unknown mode, peak sensitivity): identify the second mode, or accept a larger peak sensitivity".to_string()
    })?;
    if projection_um > 0.0 {
        design.explanation.push(format!(
            "The model's hysteresis surfaces are of a higher degree than the tick evaluates; bringing them to degree 4 moves them by at most {:.1} nm.",
            1e3 * projection_um
        ));
    }
    let carried = ["hysteresis", "initial_curve", "vibration", "second_mode", "amplifier_bandwidth", "sensor_bandwidth"];
    let left: Vec<String> = chain.effect_ids().into_iter().filter(|id| !carried.contains(&id.as_str())).collect();
    if !left.is_empty() {
        design.explanation.push(format!("Left to the unknown input: {}.", left.join(", ")));
    }
    Ok(design)
}

/// Checks a design against an actuator's chain.
///
/// # Errors
/// A message that says what the model lacks.
pub fn check(design: &ServoDesign, chain: &Model) -> Result<CheckResult, String> {
    let model = actuator_model(chain).ok_or("the model needs the effects `hysteresis` and `vibration` to check a servo against")?;
    let mut out = CheckResult {
        schema: "hysteron.check/1".into(),
        scheme: design.scheme_name().into(),
        stable: false,
        sampled_poles: Vec::new(),
        continuous: ContinuousConditions::default(),
        margins: None,
        remarks: Vec::new(),
    };
    match &design.scheme {
        Scheme::Predictor { tuning, .. } => {
            judge_law(&PredictorDesign::new(&design.model.linear, tuning), design, &model, &mut out);
            out.remarks.push("The loop is designed and checked in sampled time with the period of delay inside.".into());
        }
        Scheme::SlidingMode { nominal, estimator, controller, reaching: ReachingGains::Pid } => {
            let found = check::sliding_mode(nominal, estimator, controller, design.delayed);
            let plant = NominalModel {
                natural_frequency_rad_s: model.linear.first_mode.natural_frequency_rad_s,
                damping_ratio: model.linear.first_mode.damping_ratio,
                gain_um_v: model.mean_gain_um_v(),
            };
            out.stable = found.stable;
            out.sampled_poles = found.sampled_poles;
            if found.continuous.satisfied && !found.stable {
                out.remarks.push(
                    "The thesis' continuous conditions hold, yet the sampled loop is unstable: they know nothing of sampling and delay."
                        .into(),
                );
            }
            if design.delayed {
                let at_once = check::sliding_mode(nominal, estimator, controller, false).stable;
                out.remarks.push(format!("Without the period of delay it is {}.", if at_once { "stable" } else { "unstable" }));
            }
            out.remarks.push(format!(
                "Checked on the nominal model it was designed for; the given model has wn = {:.0} rad/s, xi = {:.3}, K = {:.4} um/V.",
                plant.natural_frequency_rad_s, plant.damping_ratio, plant.gain_um_v
            ));
            out.continuous = found.continuous;
        }
        Scheme::DisturbanceObserver { gains, .. } => {
            judge_law(&disturbance_observer::law(&design.model.linear, gains), design, &model, &mut out);
        }
        Scheme::Feedforward { gains, notch, .. } => {
            judge_law(&regulator_loop::law(gains, notch.as_ref()), design, &model, &mut out);
            out.remarks.push("What is fed forward does not touch stability.".into());
        }
        Scheme::Pid { gains, notch } if design.delayed => {
            let gain = model.mean_gain_um_v();
            let gains = PidGains { p: gain * gains.p, i: gain * gains.i, d: gain * gains.d };
            judge_law(&regulator_loop::law(&gains, notch.as_ref()), design, &model, &mut out);
            out.remarks.push(format!("The drive counts with the mean gain of the largest loop, {gain:.4} um/V."));
        }
        _ => {
            out.stable = false;
            out.remarks.push(
                "No eigenvalues are taken of this one (a law that switches, or a regulator without the period of delay), and nothing is claimed: follow a reference to judge it.".into(),
            );
        }
    }
    Ok(out)
}

/// Eigenvalues on an actuator, and margins on the model that a law was designed for.
fn judge_law(law: &PredictorDesign, design: &ServoDesign, actuator: &ActuatorModel, out: &mut CheckResult) {
    let poles = law.eigenvalues(&actuator.linear.sampled(SAMPLING_PERIOD_S));
    out.stable = poles.iter().all(|z| z.norm() < 1.0);
    out.sampled_poles = check::pairs(&poles);
    out.margins = Some(judge(law, &design.model.linear, &Demands::default()).margins);
}

/// Follows a reference on a chain; `scheme` replaces the design's own by name.
///
/// # Errors
/// A message that names the field, or the number that does not fit the servo's formats.
pub fn follow(chain: &Model, design: &ServoDesign, reference: &str, scheme: Option<&str>) -> Result<TrackResult, String> {
    let sine = SineReference::parse(reference)?;
    let mut chosen = design.clone();
    if let Some(name) = scheme {
        chosen = with_scheme(design, name)?;
    }
    let reach_um = design.model.surfaces().loop_loss(1.0, 0.0);
    let (low_um, high_um) = sine.samples_um().0.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), r| (a.min(*r), b.max(*r)));
    if low_um < 0.0 || high_um > reach_um {
        return Err(format!("the reference goes from {low_um:.2} to {high_um:.2} um; the drive reaches 0 to {reach_um:.2} um"));
    }
    track(chain, &chosen, &sine, reference, 0.001, 1).map_err(|e| e.to_string())
}

/// The same model under another scheme.
///
/// # Errors
/// If the name is not known.
pub fn with_scheme(design: &ServoDesign, name: &str) -> Result<ServoDesign, String> {
    let gains = PidGains { p: 0.0, i: 0.0, d: 0.0 };
    let tuning = match &design.scheme {
        Scheme::Predictor { tuning, .. } => *tuning,
        _ => super::predictor::PredictorTuning::START,
    };
    let mut out = design.clone();
    out.schema = SCHEMA.into();
    (out.scheme, out.delayed) = match name {
        "predictor" => (Scheme::Predictor { tuning, hysteresis_inverse: true }, true),
        "predictor-linear" => (Scheme::Predictor { tuning, hysteresis_inverse: false }, true),
        "feedforward" => (Scheme::Feedforward { gains, notch: None, creep_inverse: true }, true),
        "feedforward-without-creep" => (Scheme::Feedforward { gains, notch: None, creep_inverse: false }, true),
        "feedforward-pi" | "feedforward-pi-notch" => {
            let notch = (name == "feedforward-pi-notch").then(|| regulator_loop::notch_for(&design.model.linear));
            let (gains, _) = regulator_loop::tune(&design.model.linear, &Demands::default(), notch.as_ref())
                .ok_or("no integral gain keeps the margins with this model")?;
            (Scheme::Feedforward { gains, notch, creep_inverse: true }, true)
        }
        "disturbance-observer" | "disturbance-observer-inverse" => {
            let (gains, _) = disturbance_observer::tune(&design.model.linear, &Demands::default())
                .ok_or("no disturbance observer keeps the margins with this model")?;
            (Scheme::DisturbanceObserver { gains, hysteresis_inverse: name == "disturbance-observer-inverse" }, true)
        }
        _ => match thesis_scheme(name) {
            Some(scheme) => (scheme, false),
            None => return Err(format!("scheme `{name}` is not known: choose from {}", SCHEMES.join(", "))),
        },
    };
    Ok(out)
}
