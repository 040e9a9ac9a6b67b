//! What `hysteron check` and `track` do (`design` is in [`super::order`]), without the command line: a chain
//! of effects in, structs that serialise out.

use super::check::{self, ContinuousConditions};
use super::design::{Form, SCHEMA, Scheme, ServoDesign};
use super::disturbance::Disturbance;
use super::disturbance_observer;
use super::from_rest::{Beginning, varied};
use super::gain_adaptation::AdaptationDesign;
use super::loop_margins::{Loop, LoopMargins};
use super::members::{self, PlantBand};
use super::model::{ActuatorModel, NominalModel, actuator_model, required_model};
use super::order::{self, ASSUMED_NOISE_UM, DesignOrder, OnPlants, Reckoned};
use super::plant_set::PlantVariation;
use super::predictor::{Demands, PredictorDesign};
use super::reference::Reference;
use super::regulator_loop;
use super::schemes::{self, AtWork, SchemeChoice};
use super::thesis_schemes::{PidGains, ReachingGains, SlidingModeLaw};
use super::track::{Beside, Circumstances, TrackResult, track};
use crate::dataset::Dataset;
use crate::statistics::extremes;
use hysteron_sim::chain::Model;
use hysteron_sim::effect::vibration;
use nalgebra::Complex;
use serde::Serialize;

/// The schemes that `check --scheme` and `track --scheme` take besides the one of the design, by name, with
/// what each is.
pub const SCHEMES: [(&str, &str); 19] = [
    (
        "predictor",
        "Kalman observer one period ahead, hysteresis inverted: the default",
    ),
    (
        "predictor-learning",
        "predictor that learns the correction of a periodic reference",
    ),
    (
        "predictor-adaptive",
        "predictor that corrects the gain of its model slowly, within 20 %",
    ),
    (
        "predictor-learning-adaptive",
        "predictor with both, for a scan on a stage whose gain drifts",
    ),
    (
        "predictor-linear",
        "predictor without the inverse: all hysteresis is an unknown input",
    ),
    (
        "disturbance-observer",
        "nominal second-order model, everything else an observed disturbance",
    ),
    (
        "disturbance-observer-inverse",
        "disturbance observer behind the inverse of the hysteresis",
    ),
    (
        "pidsmoc",
        "the thesis' PID sliding-mode law on its sliding-mode observer (Ch. 7), hysteresis inverted",
    ),
    (
        "pidsmoc-linear",
        "the same without the inverse, as the thesis has it",
    ),
    (
        "pidsmc-alpha-beta",
        "the PID sliding-mode law on an alpha-beta filter (Ch. 6), hysteresis inverted",
    ),
    ("pidsmc-alpha-beta-linear", "the same without the inverse"),
    (
        "smcbl",
        "sliding mode with a boundary layer (Ch. 6, Eq. 45), hysteresis inverted; a steady error stays",
    ),
    ("smcbl-linear", "the same without the inverse"),
    ("pid", "feedforward-pi, tuned as `design --scheme pid` does"),
    ("pid-linear", "PID on the error alone, no model"),
    (
        "feedforward",
        "inverse of hysteresis, dynamics and creep, no feedback at all",
    ),
    ("feedforward-without-creep", "the same, creep not undone"),
    ("feedforward-pi", "feedforward with a PI on the error"),
    (
        "feedforward-pi-notch",
        "feedforward with a PI and a notch on the first mode",
    ),
];

/// Designs a servo for an identified chain without a recording behind it, so that an unknown mode is reckoned
/// with everywhere ([`order::design`] takes the recording).
///
/// # Errors
/// A message that says what the model lacks, or which demand cannot be met.
pub fn design(chain: &Model, demands: &Demands) -> Result<ServoDesign, String> {
    let Demands {
        reference_hz,
        sensor_noise_um,
        sensitivity_peak,
        usual_margins,
        ..
    } = *demands;
    let sensor_noise_um = Some(sensor_noise_um);
    order::design(
        chain,
        &DesignOrder {
            reference_hz,
            sensor_noise_um,
            sensitivity_peak,
            usual_margins,
            ..DesignOrder::default()
        },
    )
}

/// Designs what was ordered and, where that is another scheme, a predictor for the same order; both follow
/// the same sines on the model.
///
/// # Errors
/// As [`order::design`]; the explanation reports a refused predictor.
pub fn design_beside_predictor(
    chain: &Model,
    order: &DesignOrder<'_>,
) -> Result<(ServoDesign, Vec<AtWork>), String> {
    let mut design = order::design(chain, order)?;
    if order.scheme == SchemeChoice::Predictor {
        return Ok((design, Vec::new()));
    }
    let noise_um = design.sensor_noise_um.unwrap_or(ASSUMED_NOISE_UM);
    let frequencies_hz: Vec<f64> = [1.0 / 15.0, 1.0 / 3.0, 1.0]
        .iter()
        .map(|share| share * order.reference_hz)
        .collect();
    let rows = match order::design(
        chain,
        &DesignOrder {
            scheme: SchemeChoice::Predictor,
            ..*order
        },
    ) {
        Ok(predictor) => {
            if let Scheme::Predictor { tuning, .. } = &predictor.scheme {
                design.beside = Some(*tuning);
            }
            schemes::at_work(chain, &[&design, &predictor], &frequencies_hz, noise_um)
        }
        Err(refusal) => {
            design.explanation.push(format!(
                "A predictor for the same order is refused: {refusal}."
            ));
            schemes::at_work(chain, &[&design], &frequencies_hz, noise_um)
        }
    };
    design
        .explanation
        .insert(0, schemes::at_work_in_words(&rows));
    Ok((design, rows))
}

/// What `hysteron check` found.
#[derive(Clone, Debug, Serialize)]
pub struct CheckResult {
    /// `hysteron.check/1`.
    pub schema: String,
    /// Scheme.
    pub scheme: String,
    /// True if all sampled eigenvalues are inside the unit circle wherever the actuator may stand in its
    /// hysteresis, the period of delay included where the design has it.
    pub stable: bool,
    /// Which criterion says that it is not, where it is judged and is not.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub unstable_because: Option<String>,
    /// Sampled eigenvalues `[re, im]` at the mean gain.
    pub sampled_poles: Vec<[f64; 2]>,
    /// The thesis' continuous conditions; empty where they do not apply.
    pub continuous: ContinuousConditions,
    /// Margins on the actuator that it was checked against.
    pub margins: Option<LoopMargins>,
    /// Whether it holds for the plants that a design for this actuator has to hold for; empty where no linear
    /// law closes the loop.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub on_plants: Option<OnPlants>,
    /// What it means, in sentences.
    pub remarks: Vec<String>,
}

impl CheckResult {
    /// A criterion that is not met; the result reports the first of them.
    fn fails(&mut self, because: String) {
        self.stable = false;
        self.unstable_because.get_or_insert(because);
    }

    /// Takes the eigenvalues of the loop at a gain.
    fn judge_poles(&mut self, poles: &[Complex<f64>], whose: &str) {
        self.sampled_poles = check::pairs(poles);
        if !all_inside(poles) {
            self.fails(format!(
                "the largest eigenvalue {whose} is {:.4}",
                self.largest_eigenvalue()
            ));
        }
    }

    /// Largest magnitude of the sampled eigenvalues at the mean gain; zero where none are taken.
    #[must_use]
    pub fn largest_eigenvalue(&self) -> f64 {
        self.sampled_poles
            .iter()
            .map(|p| p[0].hypot(p[1]))
            .fold(0.0, f64::max)
    }

    /// The verdict in words, behind the name of the scheme.
    #[must_use]
    pub fn verdict(&self) -> String {
        let largest = self.largest_eigenvalue();
        match (
            &self.unstable_because,
            self.sampled_poles.is_empty(),
            self.stable,
        ) {
            (Some(because), _, _) if largest < 1.0 => {
                format!(
                    "UNSTABLE: {because} (the largest eigenvalue with the mean gain, {largest:.4}, is stable)"
                )
            }
            (Some(because), ..) => format!("UNSTABLE: {because}"),
            (None, false, true) => format!("stable, largest sampled eigenvalue {largest:.4}"),
            (None, ..) => "not judged".to_owned(),
        }
    }
}

/// Checks a design against an actuator's chain, without a recording of it.
///
/// # Errors
/// A message that says what the model lacks.
pub fn check(design: &ServoDesign, chain: &Model) -> Result<CheckResult, String> {
    check_with(design, chain, None)
}

/// Checks a design against an actuator's chain and, with the recording behind it, for the plants that this
/// leaves possible.
///
/// # Errors
/// A message that says what the model lacks, or that the data are not those of the model.
pub fn check_with(
    design: &ServoDesign,
    chain: &Model,
    recording: Option<&Dataset>,
) -> Result<CheckResult, String> {
    let model = required_model(chain)?;
    let reckoned = Reckoned::with(chain, model.clone(), recording)?;
    let mut out = CheckResult {
        schema: "hysteron.check/1".into(),
        scheme: design.scheme_name().into(),
        stable: false,
        unstable_because: None,
        sampled_poles: Vec::new(),
        continuous: ContinuousConditions::default(),
        margins: None,
        on_plants: None,
        remarks: Vec::new(),
    };
    let delay_s = order::known_delay_s(chain);
    let noise_um = design.sensor_noise_um.unwrap_or(ASSUMED_NOISE_UM);
    // What both reach: a reference is given in um, whatever the servo's own model has as its reach.
    let travel_um = model.reach_um().min(design.model.reach_um());
    let judged_with = (
        &reckoned,
        delay_s,
        Beginning {
            design,
            chain,
            travel_um,
            noise_um,
        },
    );
    match &design.scheme {
        Scheme::Predictor {
            tuning,
            hysteresis_inverse,
        } => {
            let ratio = gain_ratio(&design.model, &model, *hysteresis_inverse);
            judge_law(
                &PredictorDesign::new(&design.model.linear, tuning),
                &model,
                judged_with,
                ratio,
                &mut out,
            );
            out.remarks.push(
                "The loop is designed and checked in sampled time with the period of delay inside."
                    .into(),
            );
            let law = PredictorDesign::new(&design.model.linear, tuning);
            if let Some(adaptation) = &design.adaptation {
                let plant = PlantVariation {
                    delay_s,
                    ..PlantVariation::NONE
                }
                .sampled(&model.linear);
                let beliefs = ratio.iter().flat_map(|gain| adaptation.over_beliefs(*gain));
                let worst = beliefs
                    .map(|gain| law.spectral_radius(&plant, gain, 0))
                    .fold(0.0, f64::max);
                if worst.is_nan() || worst >= 1.0 {
                    out.fails(format!(
                        "with the correction of the gain at a bound of its +-{:.0} % the largest eigenvalue is {worst:.4}",
                        100.0 * adaptation.farthest
                    ));
                }
                out.remarks.push(format!(
                    "Wherever the correction of the gain stands within its +-{:.0} % the largest eigenvalue is at most {worst:.3}{}.",
                    100.0 * adaptation.farthest,
                    if worst < 1.0 { "" } else { ": UNSTABLE" }
                ));
            }
            if let Some(learning) = &design.learning {
                let on_it = |gains: Vec<f64>| {
                    let found = gains
                        .into_iter()
                        .map(|gain| learning.contraction_on(&law, &model.linear, gain, delay_s));
                    found
                        .max_by(|a, b| a.0.total_cmp(&b.0))
                        .unwrap_or((f64::NAN, 0.0))
                };
                let (contraction, hz) = on_it(ratio.to_vec());
                let verdict = if contraction < 1.0 {
                    "converges"
                } else {
                    "DIVERGES"
                };
                if contraction.is_nan() || contraction >= 1.0 {
                    out.fails(format!(
                        "learning diverges, an error becomes {contraction:.2} times itself from period to period at {hz:.0} Hz"
                    ));
                }
                out.remarks.push(format!(
                    "Learning {verdict} on this actuator: an error becomes at most {contraction:.2} times itself from period to period (at {hz:.0} Hz)."
                ));
                if let Some(adaptation) = &design.adaptation {
                    // It decides nothing: a gain that is learned does not stay where it is wrong.
                    let (farthest, hz) = on_it(
                        ratio
                            .iter()
                            .flat_map(|gain| adaptation.over_beliefs(*gain))
                            .collect(),
                    );
                    out.remarks.push(format!(
                        "While the correction of the gain stands farthest off, to either side, it becomes at most {farthest:.2} times itself (at {hz:.0} Hz)."
                    ));
                }
                out.remarks.push(learning.in_words());
            }
        }
        Scheme::SlidingMode {
            nominal,
            estimator,
            controller,
            reaching,
            form: Form::Predictor { hysteresis_inverse },
        } => {
            let ratio = gain_ratio(&design.model, &model, *hysteresis_inverse);
            if let Some(law) = design.law() {
                judge_law(&law, &model, judged_with, ratio, &mut out);
                out.remarks.push("The loop is designed and checked in sampled time with the period of delay inside.".into());
            } else {
                out.remarks.push("A law that switches has no eigenvalues, and nothing is claimed: follow a reference to judge it.".into());
            }
            if matches!(reaching, ReachingGains::BoundaryLayer { .. }) {
                out.remarks.push(
                    "Judged with the slope at the middle of the boundary layer, its largest; it has no integral, so a steady error stays."
                        .into(),
                );
            }
            if *reaching == ReachingGains::Pid {
                out.continuous =
                    check::sliding_mode(nominal, estimator, controller, design.delayed).continuous;
            }
        }
        Scheme::SlidingMode {
            nominal,
            estimator,
            controller,
            reaching: ReachingGains::Pid,
            form: Form::Printed,
        } => {
            let found = check::sliding_mode(nominal, estimator, controller, design.delayed);
            let plant = NominalModel {
                natural_frequency_rad_s: model.linear.first_mode.natural_frequency_rad_s,
                damping_ratio: model.linear.first_mode.damping_ratio,
                gain_um_v: model.mean_gain_um_v(),
            };
            let law = SlidingModeLaw::new(nominal, estimator, controller, &ReachingGains::Pid);
            let on_plant = |delay: usize| -> Vec<Complex<f64>> {
                law.closed_loop(&plant, delay)
                    .complex_eigenvalues()
                    .iter()
                    .copied()
                    .filter(|z| z.norm() > 1e-9)
                    .collect()
            };
            let poles = on_plant(usize::from(design.delayed));
            out.stable = true;
            out.judge_poles(&poles, "on the first mode and the mean gain");
            if found.continuous.satisfied && !out.stable {
                out.remarks.push(
                    "The thesis' continuous conditions hold, yet the sampled loop is unstable: they know nothing of sampling and delay."
                        .into(),
                );
            }
            if design.delayed {
                out.remarks.push(format!(
                    "Without the period of delay it is {}.",
                    if all_inside(&on_plant(0)) {
                        "stable"
                    } else {
                        "unstable"
                    }
                ));
            }
            out.remarks.push(format!(
                "Sampled eigenvalues on the given model's first mode and mean gain: wn = {:.0} rad/s, xi = {:.3}, K = {:.4} um/V.",
                plant.natural_frequency_rad_s, plant.damping_ratio, plant.gain_um_v
            ));
            out.continuous = found.continuous;
        }
        Scheme::DisturbanceObserver {
            gains,
            hysteresis_inverse,
        } => {
            let ratio = gain_ratio(&design.model, &model, *hysteresis_inverse);
            judge_law(
                &disturbance_observer::law(&design.model.linear, gains),
                &model,
                judged_with,
                ratio,
                &mut out,
            );
        }
        Scheme::Feedforward { gains, notch, .. } => {
            judge_law(
                &regulator_loop::law(gains, notch.as_ref()),
                &model,
                judged_with,
                gain_ratio(&design.model, &model, true),
                &mut out,
            );
            out.remarks
                .push("What is fed forward does not touch stability.".into());
        }
        Scheme::Pid { .. } if design.delayed => {
            let gain = design.model.mean_gain_um_v();
            if let Some(law) = design.law() {
                judge_law(
                    &law,
                    &model,
                    judged_with,
                    gain_ratio(&design.model, &model, false),
                    &mut out,
                );
            }
            out.remarks.push(format!(
                "The drive counts with the mean gain of the largest loop, {gain:.4} um/V."
            ));
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

fn all_inside(poles: &[Complex<f64>]) -> bool {
    poles.iter().all(|z| z.norm() < 1.0)
}

/// Gain of an actuator over the one that a design inverts, wherever the hysteresis may stand: least, that of
/// the whole range, largest. Slopes are compared over steps of a sixteenth of the range: what a loop of that
/// size feels.
#[must_use]
pub fn gain_ratio(design: &ActuatorModel, actuator: &ActuatorModel, inverted: bool) -> [f64; 3] {
    const STEPS: usize = 16;
    let (of_design, of_actuator) = (design.surfaces(), actuator.surfaces());
    let range_v = design.drive_max_v - design.drive_min_v;
    let share = |i: usize| i as f64 / STEPS as f64;
    // The same voltages, as shares of the actuator's own range.
    let there = |x: f64| {
        (design.drive_min_v + x * range_v - actuator.drive_min_v)
            / (actuator.drive_max_v - actuator.drive_min_v)
    };
    let mean_step_um = of_design.loop_loss(1.0, 0.0) / STEPS as f64;
    let mut ratio = [
        f64::INFINITY,
        of_actuator.loop_loss(there(1.0), there(0.0)) / of_design.loop_loss(1.0, 0.0),
        f64::NEG_INFINITY,
    ];
    let mut see = |step: &dyn Fn(bool) -> f64| {
        let value = step(true) / if inverted { step(false) } else { mean_step_um };
        ratio[0] = ratio[0].min(value);
        ratio[2] = ratio[2].max(value);
    };
    for i in 1..=STEPS {
        for j in 0..i {
            let loss = |x: f64, z: f64, actual: bool| {
                if actual {
                    of_actuator.loop_loss(there(x), there(z))
                } else {
                    of_design.loop_loss(x, z)
                }
            };
            see(&|actual| loss(share(i), share(j), actual) - loss(share(i - 1), share(j), actual));
            see(&|actual| loss(share(i), share(j), actual) - loss(share(i), share(j + 1), actual));
        }
    }
    ratio
}

/// Eigenvalues and margins on an actuator, with a delay of its drive, s, and the beginning that it is run
/// from.
fn judge_law(
    law: &PredictorDesign,
    actuator: &ActuatorModel,
    (reckoned, delay_s, beginning): (&Reckoned, f64, Beginning<'_>),
    ratio: [f64; 3],
    out: &mut CheckResult,
) {
    let plant = PlantVariation {
        delay_s,
        ..PlantVariation::NONE
    }
    .sampled(&actuator.linear);
    let poles: Vec<Complex<f64>> = law
        .closed_loop(&plant, ratio[1], 0)
        .complex_eigenvalues()
        .iter()
        .copied()
        .filter(|z| z.norm() > 1e-9)
        .collect();
    let (beginning, recording) = (Some(beginning), reckoned.recording());
    let margins = Loop {
        law,
        linear: &actuator.linear,
        gain_ratio: ratio,
        delay_s,
        beginning,
        recording,
    }
    .judged();
    out.on_plants = Some(reckoned.judge(law, ratio[1]));
    out.stable = true;
    out.judge_poles(&poles, "with the mean gain");
    let places = ["smallest", "mean", "largest"]
        .into_iter()
        .zip(ratio.into_iter().zip(margins.spectral_radius));
    // The mean is what the eigenvalues are of; where only it fails that is reported already.
    for (place, (gain, radius)) in
        places.filter(|(_, (_, radius))| radius.is_nan() || *radius >= 1.0)
    {
        out.fails(format!(
            "where the actuator's gain is the {place}, {gain:.2} times the one that the law inverts, the largest eigenvalue is {radius:.4}"
        ));
    }
    out.margins = Some(margins);
}

/// How a servo is put to work on a chain.
#[derive(Clone, Copy, Debug, Default)]
pub struct Work<'a> {
    /// A scheme in the place of the design's own, by name.
    pub scheme: Option<&'a str>,
    /// RMS noise of the sensor, um, in the place of that which it was designed for.
    pub sensor_noise_um: Option<f64>,
    /// A force from outside.
    pub disturbance: Option<Disturbance>,
    /// Mass added to the moving part, as a ratio to it.
    pub added_mass: f64,
}

/// Largest mass that is added.
const ADDED_MASS_MAX: f64 = 50.0;

/// What is to be simulated, once it is known to be possible.
struct Prepared {
    chain: Model,
    design: ServoDesign,
    circumstances: Circumstances,
}

fn prepared(
    chain: &Model,
    design: &ServoDesign,
    reference: &Reference,
    work: &Work,
) -> Result<Prepared, String> {
    let Work {
        scheme,
        sensor_noise_um,
        disturbance,
        added_mass,
    } = *work;
    order::require_known_in_a_loop(chain)?;
    if !(0.0..=ADDED_MASS_MAX).contains(&added_mass) {
        return Err(format!(
            "--added-mass {added_mass}; expected a ratio to the moving mass from 0 to {ADDED_MASS_MAX}"
        ));
    }
    if added_mass > 0.0 && chain.effect(vibration::ID).is_none() {
        return Err(
            "--added-mass: the model has no vibration, so no mass that it could be added to".into(),
        );
    }
    let chain = varied(
        chain,
        &PlantVariation {
            mass_ratio: 1.0 + added_mass,
            ..PlantVariation::NONE
        },
    );
    let mut chosen = design.clone();
    if let Some(name) = scheme {
        chosen = with_scheme(design, name)?;
    }
    // What the actuator reaches counts, not what the servo's own model believes.
    let reach_um = actuator_model(&chain)
        .map_or(f64::INFINITY, |m| m.reach_um())
        .min(design.model.reach_um());
    let (low_um, high_um) = extremes(&reference.samples_um(&chosen).0);
    if low_um < 0.0 || high_um > reach_um {
        return Err(format!(
            "the reference goes from {low_um:.2} to {high_um:.2} um; counted from where the actuator stands at its lowest drive of {} V, the drive reaches 0 to {reach_um:.2} um",
            chain.drive_min_v
        ));
    }
    let noise_um = sensor_noise_um
        .or(design.sensor_noise_um)
        .unwrap_or(ASSUMED_NOISE_UM);
    if !(0.0..0.05 * reach_um).contains(&noise_um) {
        return Err(format!(
            "--sensor-noise-um {noise_um}; expected at least 0 and below {:.3}, a twentieth of the travel",
            0.05 * reach_um
        ));
    }
    let circumstances = Circumstances {
        noise_um,
        seed: 1,
        disturbance,
    };
    Ok(Prepared {
        chain,
        design: chosen,
        circumstances,
    })
}

/// Follows a reference on a chain.
///
/// # Errors
/// A message that names the field, or the number that does not fit the servo's formats.
pub fn follow(
    chain: &Model,
    design: &ServoDesign,
    reference: &Reference,
    reference_name: &str,
    work: &Work,
) -> Result<TrackResult, String> {
    let Prepared {
        chain,
        design,
        circumstances,
    } = prepared(chain, design, reference, work)?;
    let mut found = track(&chain, &design, reference, reference_name, circumstances)
        .map_err(|e| e.to_string())?;
    if design.beside.is_some() {
        let predictor = with_scheme(
            &design,
            if design.inverts_hysteresis() {
                "predictor"
            } else {
                "predictor-linear"
            },
        )?;
        let run = track(&chain, &predictor, reference, reference_name, circumstances)
            .map_err(|e| e.to_string())?;
        found.beside = Some(Beside {
            scheme: run.scheme,
            truth: run.truth,
        });
    }
    Ok(found)
}

/// Follows the same reference on the plants that may stand in the place of the model; `found` is what
/// [`follow`] found on it.
///
/// # Errors
/// As [`follow`].
pub fn follow_on_members(
    chain: &Model,
    design: &ServoDesign,
    reference: &Reference,
    work: &Work,
    found: &TrackResult,
) -> Result<PlantBand, String> {
    let Prepared {
        chain,
        design,
        circumstances,
    } = prepared(chain, design, reference, work)?;
    members::band(&chain, &design, reference, circumstances, found).map_err(|e| e.to_string())
}

/// Share of the travel of a step beside another reference.
const SHOWN_STEP: f64 = 0.05;

/// Follows a small step from the middle of the travel, for its response.
///
/// # Errors
/// As [`follow`].
pub fn follow_step(
    chain: &Model,
    design: &ServoDesign,
    work: &Work,
) -> Result<TrackResult, String> {
    let reach_um = actuator_model(chain)
        .map_or(f64::INFINITY, |m| m.reach_um())
        .min(design.model.reach_um());
    let by_um = SHOWN_STEP * reach_um;
    let reference = Reference::Step {
        from_um: 0.5 * reach_um,
        by_um,
    };
    follow(
        chain,
        design,
        &reference,
        &format!("step:{by_um:.3}:{:.3}", 0.5 * reach_um),
        work,
    )
}

/// The same model under another scheme.
///
/// # Errors
/// If the name is not known.
pub fn with_scheme(design: &ServoDesign, name: &str) -> Result<ServoDesign, String> {
    let gains = PidGains {
        p: 0.0,
        i: 0.0,
        d: 0.0,
    };
    let own = match &design.scheme {
        Scheme::Predictor { tuning, .. } => Some(*tuning),
        _ => design.beside,
    };
    let tuning = own.unwrap_or(super::predictor::PredictorTuning::START);
    let mut out = design.clone();
    out.schema = SCHEMA.into();
    out.beside = None;
    let learning = matches!(name, "predictor-learning" | "predictor-learning-adaptive");
    if !learning {
        out.learning = None;
    }
    out.adaptation = matches!(name, "predictor-adaptive" | "predictor-learning-adaptive")
        .then(|| AdaptationDesign::new(design.model.reach_um()));
    (out.scheme, out.delayed) = match name {
        "predictor"
        | "predictor-learning"
        | "predictor-adaptive"
        | "predictor-learning-adaptive" => (
            Scheme::Predictor {
                tuning,
                hysteresis_inverse: true,
            },
            true,
        ),
        "predictor-linear" => (
            Scheme::Predictor {
                tuning,
                hysteresis_inverse: false,
            },
            true,
        ),
        "feedforward" => (
            Scheme::Feedforward {
                gains,
                notch: None,
                creep_inverse: true,
            },
            true,
        ),
        "feedforward-without-creep" => (
            Scheme::Feedforward {
                gains,
                notch: None,
                creep_inverse: false,
            },
            true,
        ),
        "feedforward-pi" | "feedforward-pi-notch" => {
            let notch = (name == "feedforward-pi-notch")
                .then(|| regulator_loop::notch_for(&design.model.linear));
            let (gains, _) =
                regulator_loop::tune(&design.model.linear, &Demands::default(), notch.as_ref())
                    .ok_or("no integral gain keeps the margins with this model")?;
            (
                Scheme::Feedforward {
                    gains,
                    notch,
                    creep_inverse: true,
                },
                true,
            )
        }
        "disturbance-observer" | "disturbance-observer-inverse" => {
            let (gains, _) = disturbance_observer::tune(&design.model.linear, &Demands::default())
                .ok_or("no disturbance observer keeps the margins with this model")?;
            (
                Scheme::DisturbanceObserver {
                    gains,
                    hysteresis_inverse: name == "disturbance-observer-inverse",
                },
                true,
            )
        }
        _ => {
            let (family, inverse) = name
                .strip_suffix("-linear")
                .map_or((name, true), |family| (family, false));
            let choice = SchemeChoice::named(family).map_err(|_| {
                format!(
                    "scheme `{name}` is not known: choose from {}",
                    SCHEMES.map(|(name, _)| name).join(", ")
                )
            })?;
            (
                order::scheme_without_recording(design, choice, inverse)?,
                true,
            )
        }
    };
    if learning && out.learning.is_none() {
        out.learning = Some(order::learning_without_recording(&out)?);
    }
    // What the design is already keeps its gains.
    Ok(if out.scheme_name() == design.scheme_name() {
        design.clone()
    } else {
        out
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn found(stable: bool, poles: &[f64], unstable_because: Option<&str>) -> CheckResult {
        CheckResult {
            schema: String::new(),
            scheme: String::new(),
            stable,
            unstable_because: unstable_because.map(Into::into),
            sampled_poles: poles.iter().map(|re| [*re, 0.0]).collect(),
            continuous: ContinuousConditions::default(),
            margins: None,
            on_plants: None,
            remarks: Vec::new(),
        }
    }

    #[test]
    fn no_verdict_of_unstable_stands_beside_a_stable_eigenvalue_alone() {
        let learning = found(false, &[0.9753, -0.3], Some("learning diverges"));
        assert_eq!(
            learning.verdict(),
            "UNSTABLE: learning diverges (the largest eigenvalue with the mean gain, 0.9753, is stable)"
        );
        assert_eq!(
            found(false, &[1.2], Some("it is 1.2000")).verdict(),
            "UNSTABLE: it is 1.2000"
        );
        assert_eq!(
            found(true, &[0.9], None).verdict(),
            "stable, largest sampled eigenvalue 0.9000"
        );
        assert_eq!(found(false, &[], None).verdict(), "not judged");
        let mut both = found(true, &[], None);
        both.judge_poles(&[Complex::new(0.0, 1.01)], "with the mean gain");
        both.fails("another".into());
        assert_eq!(
            both.verdict(),
            "UNSTABLE: the largest eigenvalue with the mean gain is 1.0100"
        );
    }
}
