//! What is known of an actuator when a loop is closed around it: the model with or without its second mode, how
//! well its modes are known, and what the recording behind it excludes.

use super::candidate::Broken;
use super::data_of_stage::{
    first_mode_shown, how_to_exclude, require_described, require_same_stage,
};
use super::law::PredictorDesign;
use super::model::{ActuatorModel, ModeModel};
use super::recording::ServoRecording;
use super::robust::{ModeSpread, Task, within_nyquist};
use super::tuning::Demands;
use crate::dataset::Dataset;
use hysteron_sim::chain::Model;
use hysteron_sim::effect::{delay, second_mode, vibration};
use serde::Serialize;
use std::f64::consts::{FRAC_1_SQRT_2, PI, TAU};

/// Noise of a sensor of which nothing is known, um RMS.
pub const ASSUMED_NOISE_UM: f64 = 0.001;
/// A second mode enters the observer only if its frequency is known to this share (one standard deviation)
/// ...
const FREQUENCY_KNOWN: f64 = 0.02;
/// ... its damping ratio to this one ...
const DAMPING_KNOWN: f64 = 0.3;
/// ... and the recording could not hide this share of its peak.
const PEAK_SHOWN: f64 = 0.5;
/// Where its resonance stays out of the observer, its share of the motion stays in if that is known to this
/// one, ...
const SHARE_KNOWN: f64 = 0.3;
/// ... at its frequency, but at most at this share of half the sampling rate.
const HIGHEST_COMPLIANCE: f64 = 0.8;
/// Spread of a first mode that no recording stands behind: frequency and damping ratio, relative.
pub(super) const UNCONFIRMED: ModeSpread = ModeSpread {
    frequency: 0.05,
    damping: 0.4,
};

/// Relative standard deviation of a value; infinite where it has none.
fn relative_std(chain: &Model, effect: &str, parameter: usize) -> f64 {
    chain
        .effect(effect)
        .and_then(|e| e.parameters.get(parameter))
        .map_or(f64::INFINITY, |p| match p.std {
            Some(std) if p.value != 0.0 => (std / p.value).abs(),
            // A fixed value is the user's word.
            _ if p.parameter.fixed => 0.0,
            _ => f64::INFINITY,
        })
}

pub(super) fn hertz(mode: &ModeModel) -> f64 {
    mode.natural_frequency_rad_s / TAU
}

/// The transport delay of a chain, s: the loop is judged with it although the observer does not carry it.
#[must_use]
pub fn known_delay_s(chain: &Model) -> f64 {
    chain
        .values(delay::ID)
        .and_then(|v| v.first().copied())
        .unwrap_or(0.0)
}

/// The chain with another second mode, or without one.
fn with_second_mode(chain: &Model, second: Option<(f64, ModeModel)>) -> Model {
    let mut out = chain.clone();
    match second {
        None => out.effects.retain(|e| e.id != second_mode::ID),
        Some((share, mode)) => {
            for effect in out.effects.iter_mut().filter(|e| e.id == second_mode::ID) {
                for (p, value) in effect.parameters.iter_mut().zip([
                    share,
                    mode.natural_frequency_rad_s,
                    mode.damping_ratio,
                ]) {
                    p.value = value;
                }
            }
        }
    }
    out
}

/// What is left of a second mode whose resonance is no fact: its compliance, which the drive does show below
/// it. Without that the model would move too late by the share of the motion that does not go through the
/// first mode.
fn without_resonance((share, mode): (f64, ModeModel), period_s: f64) -> (f64, ModeModel) {
    let highest = HIGHEST_COMPLIANCE * PI / period_s;
    let natural_frequency_rad_s = mode.natural_frequency_rad_s.min(highest);
    (
        share,
        ModeModel {
            natural_frequency_rad_s,
            damping_ratio: mode.damping_ratio.max(FRAC_1_SQRT_2),
        },
    )
}

/// Every effect of a chain is known in a loop: none takes part of what was recorded.
///
/// # Errors
/// The effect that does.
pub(super) fn require_known_in_a_loop(chain: &Model) -> Result<(), String> {
    match chain
        .effects
        .iter()
        .find(|e| e.effect.declaration().follows_record)
    {
        Some(own) => Err(format!(
            "{} takes part of what was recorded (the drive, or an auxiliary signal), which no loop knows beforehand; fit a model without it",
            own.id
        )),
        None => Ok(()),
    }
}
/// What the observer may know: the model with or without its second mode, the spreads of both, and the
/// recording seen with that model.
pub(super) struct Known {
    pub model: ActuatorModel,
    pub first: ModeSpread,
    pub second: Option<ModeSpread>,
    /// The model's second mode, where it stays out of the observer.
    pub left_out: Option<(f64, ModeModel)>,
    pub recording: Option<ServoRecording>,
}

pub(super) fn known(
    chain: &Model,
    model: ActuatorModel,
    recording: Option<&Dataset>,
    said: &mut Vec<String>,
) -> Result<Known, String> {
    let first_std = [
        relative_std(chain, vibration::ID, 0),
        relative_std(chain, vibration::ID, 1),
    ];
    let dropped = |mut model: ActuatorModel| {
        model.linear.second_mode = None;
        model
    };
    let Some(dataset) = recording else {
        let confirmed = ModeSpread::from_deviations(first_std[0].min(0.1), first_std[1].min(0.2));
        let first = ModeSpread {
            frequency: confirmed.frequency.max(UNCONFIRMED.frequency),
            damping: confirmed.damping.max(UNCONFIRMED.damping),
        };
        said.push("No recording stands behind the model here (--data), so an unknown mode is reckoned with at every frequency from the first mode on.".into());
        if model.linear.second_mode.is_some() {
            said.push("The model's second mode stays out of the observer: without the recording nothing says that it is a fact.".into());
        }
        let left_out = model.linear.second_mode;
        return Ok(Known {
            model: dropped(model),
            first,
            second: None,
            left_out,
            recording: None,
        });
    };
    let first = ModeSpread::from_deviations(first_std[0], first_std[1]);
    let with = ServoRecording::seen_with(chain, dataset, model.linear.period_s);
    first_mode_shown(&with, &model.linear.first_mode)?;
    require_described(&with, &model.linear)?;
    let Some((share, mode)) = model.linear.second_mode else {
        return Ok(Known {
            model,
            first,
            second: None,
            left_out: None,
            recording: Some(with),
        });
    };
    let std = [
        relative_std(chain, second_mode::ID, 1),
        relative_std(chain, second_mode::ID, 2),
    ];
    let peak = (share / (2.0 * mode.damping_ratio)).abs();
    let hidden = with.blind_at(hertz(&mode)).unwrap_or(f64::INFINITY);
    let why_not = if !within_nyquist(&mode, model.linear.period_s) {
        Some("it is beyond half the sampling rate".to_owned())
    } else if hidden > PEAK_SHOWN * peak {
        Some(format!(
            "the recording could hide a response of {hidden:.3} um/um there, and its peak is {peak:.3}"
        ))
    } else if std[0] > FREQUENCY_KNOWN || std[1] > DAMPING_KNOWN {
        Some(format!(
            "its frequency is known to {:.1} %, its damping ratio to {:.0} %",
            100.0 * std[0],
            100.0 * std[1]
        ))
    } else {
        None
    };
    match why_not {
        None => {
            said.push(format!(
                "The observer carries the second mode at {:.0} Hz, which the recording shows.",
                hertz(&mode)
            ));
            Ok(Known {
                model,
                first,
                second: Some(ModeSpread::from_deviations(std[0], std[1])),
                left_out: None,
                recording: Some(with),
            })
        }
        Some(why) => {
            let kept = (relative_std(chain, second_mode::ID, 0) <= SHARE_KNOWN)
                .then(|| without_resonance((share, mode), model.linear.period_s));
            let of_it = if kept.is_some() {
                ", but for its share of the motion"
            } else {
                ""
            };
            said.push(format!(
                "The model's second mode at {:.0} Hz stays out of the observer{of_it}: {why}.",
                hertz(&mode)
            ));
            // The resonance that is left out is part of what is missing; how good the model is is judged with
            // it.
            let recording = ServoRecording {
                residual_um: with.residual_um,
                ..ServoRecording::seen_with(
                    &with_second_mode(chain, kept),
                    dataset,
                    model.linear.period_s,
                )
            };
            let mut model = model;
            model.linear.second_mode = kept;
            Ok(Known {
                model,
                first,
                second: None,
                left_out: Some((share, mode)),
                recording: Some(recording),
            })
        }
    }
}
/// Whether a law that is there already holds for the plants that a design for this chain has to hold for.
#[derive(Clone, Debug, Serialize)]
pub struct OnPlants {
    /// Plants of the set, beside every missing response that is left possible.
    pub plants: usize,
    /// Mass over the model's up to which they go.
    pub mass_to: f64,
    /// The first condition that it breaks, in words; none where it holds.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub broken: Option<String>,
    /// How much of what it can stand the least favourable missing response is, and its frequency, Hz.
    pub missing_response: (f64, f64),
}

/// What a design for a chain reckons with, without the design.
pub(super) struct Reckoned {
    known: Known,
    delay_s: f64,
}

impl Reckoned {
    /// Of a chain and the recording behind it.
    ///
    /// # Errors
    /// The data are not those of the model.
    pub(super) fn with_recording(
        chain: &Model,
        model: ActuatorModel,
        recording: Option<&Dataset>,
    ) -> Result<Self, String> {
        if let Some(dataset) = recording {
            require_same_stage(chain, dataset)?;
        }
        Ok(Self {
            known: known(chain, model, recording, &mut Vec::new())?,
            delay_s: known_delay_s(chain),
        })
    }

    /// The recording as the model sees it.
    pub(super) fn recording(&self) -> Option<&ServoRecording> {
        self.known.recording.as_ref()
    }

    /// Judges a law on an actuator with this gain over the one that the law inverts, up to this mass over
    /// the model's.
    pub(super) fn judge(&self, law: &PredictorDesign, gain_ratio: f64, mass_to: f64) -> OnPlants {
        let Known {
            model,
            first,
            second,
            left_out,
            recording,
        } = &self.known;
        let demands = Demands {
            sensitivity_peak: f64::INFINITY,
            ..Demands::default()
        };
        let task = Task {
            linear: model.linear,
            first: *first,
            second: *second,
            left_out: *left_out,
            delay_s: self.delay_s,
            recording: recording.as_ref(),
            mode_moves: 0.0,
            mass_to,
            demands,
        };
        let (found, plants) = task.judge_law(law, gain_ratio);
        let broken = found.broken.map(|broken| match broken {
            Broken::Member(name) => format!("{name} it is unstable"),
            Broken::Limit(name) => format!("{name} it could go on swinging between the limits of the drive"),
            Broken::Sensitivity | Broken::Integers => "its sensitivity is not finite".to_owned(),
            Broken::Unknown { hz } => format!(
                "a mode near {hz:.0} Hz could make it unstable; {}",
                match recording {
                    Some(_) => format!("the recording does not exclude it: {}", how_to_exclude(recording.as_ref(), hz, found.unknown.0)),
                    None => "nothing excludes it without --data: name the recording that the model was identified from".to_owned(),
                }
            ),
        });
        OnPlants {
            plants,
            mass_to,
            broken,
            missing_response: found.unknown,
        }
    }
}
