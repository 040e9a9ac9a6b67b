//! The plants that a servo is put to work on beside the model itself: what the model's covariance leaves
//! possible, another gain, other modes, wider and narrower loops.
//!
//! A servo on the very model that it was designed from says how well the loop can do. What it does on a stage
//! lies in the band over these plants, and the worst of them says what to look after.

use super::chain_plant::HysteresisChange;
use super::design::ServoDesign;
use super::known::UNCONFIRMED;
use super::quantise::QuantisationError;
use super::reference::Reference;
use super::robust::{GAIN_SPREAD, ModeSpread};
use super::track::{Circumstances, TrackResult, TrackingFigures, track_on};
use crate::parallel;
use hysteron_sim::chain::{Identified, Model};
use hysteron_sim::effect::{second_mode, vibration};
use hysteron_sim::noise::WhiteNoise;
use serde::Serialize;

/// Draws of the model's values from their covariance.
const DRAWS: u64 = 6;
/// Share by which gain and width of the loops are off to either side: the spread of the gain that a design
/// carries along.
const OFF: f64 = GAIN_SPREAD - 1.0;

/// A plant in the place of the model.
struct Member {
    name: String,
    chain: Model,
    change: HysteresisChange,
}

/// What a servo did on one of them.
#[derive(Clone, Debug, Serialize)]
pub struct OnMember {
    /// What the plant is.
    pub plant: String,
    /// Error of the true position.
    #[serde(rename = "true")]
    pub truth: TrackingFigures,
    /// Error of the readings, noise included.
    pub as_read: TrackingFigures,
    /// Settling time, s, where the reference is a step and it settles.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub settling_s: Option<f64>,
    /// Why this is no tracking, if so.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub trouble: Option<String>,
}

impl OnMember {
    fn found(plant: String, found: &TrackResult) -> Self {
        Self {
            plant,
            truth: found.truth,
            as_read: found.as_read,
            settling_s: found.step.and_then(|step| step.settling_s),
            trouble: found.trouble(),
        }
    }
}

/// The model and the plants in its place, each with what the servo did on it.
#[derive(Clone, Debug, Serialize)]
pub struct PlantBand {
    /// The model itself first.
    pub members: Vec<OnMember>,
    /// The model's file has the covariance of its values.
    pub with_covariance: bool,
}

impl PlantBand {
    /// Least and largest RMS of the true error, um.
    #[must_use]
    pub fn rms_um(&self) -> [f64; 2] {
        self.over(|m| m.truth.rms_um)
    }

    /// Least and largest of the largest true errors, um.
    #[must_use]
    pub fn max_um(&self) -> [f64; 2] {
        self.over(|m| m.truth.max_um)
    }

    fn over(&self, value: impl Fn(&OnMember) -> f64) -> [f64; 2] {
        let values = || self.members.iter().map(&value);
        // No number is worse than any.
        let largest = if values().any(f64::is_nan) {
            f64::NAN
        } else {
            values().fold(0.0, f64::max)
        };
        [values().fold(f64::INFINITY, f64::min), largest]
    }

    /// The one with the largest RMS of the true error.
    #[must_use]
    pub fn worst(&self) -> Option<&OnMember> {
        self.members
            .iter()
            .max_by(|a, b| a.truth.rms_um.total_cmp(&b.truth.rms_um))
    }
}

/// The model's values drawn from their covariance; none where one of them is no longer in the model.
fn drawn(chain: &Model, identified: &Identified, seed: u64) -> Option<Model> {
    let mut out = chain.clone();
    let mut normal = WhiteNoise::new(1.0, seed);
    let scores: Vec<f64> = identified.factor.iter().map(|_| normal.next_um()).collect();
    for ((effect, parameter), row) in identified.values.iter().zip(&identified.factor) {
        let off: f64 = row
            .iter()
            .zip(&scores)
            .map(|(factor, score)| factor * score)
            .sum();
        let value = out
            .effects
            .iter_mut()
            .find(|e| e.id == *effect)?
            .parameters
            .iter_mut()
            .find(|p| p.parameter.name == *parameter)?;
        value.set_coordinate(value.coordinate() + off);
    }
    Some(out)
}

/// Relative spread of a mode's frequency and damping ratio, as a design without a recording has it.
fn spread(chain: &Model, effect: &str, frequency: usize) -> ModeSpread {
    let relative = |nth: usize| {
        let value = chain.effect(effect).and_then(|e| e.parameters.get(nth));
        value
            .and_then(|p| {
                p.std
                    .filter(|_| p.value != 0.0)
                    .map(|std| (std / p.value).abs())
            })
            .unwrap_or(0.0)
    };
    let known = ModeSpread::from_deviations(relative(frequency), relative(frequency + 1));
    ModeSpread {
        frequency: known.frequency.max(UNCONFIRMED.frequency),
        damping: known.damping.max(UNCONFIRMED.damping),
    }
}

/// The chain with a mode elsewhere and less damped.
fn moved(chain: &Model, effect: &str, frequency: usize, factors: [f64; 2]) -> Model {
    let mut out = chain.clone();
    for e in out.effects.iter_mut().filter(|e| e.id == effect) {
        e.parameters
            .iter_mut()
            .skip(frequency)
            .zip(factors)
            .for_each(|(p, factor)| p.value *= factor);
    }
    out
}

/// How well the values of a chain are known together, where it was fitted.
fn with_covariance(chain: &Model) -> Option<&Identified> {
    let known = chain.identified.as_deref();
    known.filter(|known| !known.values.is_empty())
}

fn members(chain: &Model) -> Vec<Member> {
    let mut out = Vec::new();
    let mut add = |name: String, chain: &Model, change: HysteresisChange| {
        out.push(Member {
            name,
            chain: chain.clone(),
            change,
        })
    };
    if let Some(identified) = with_covariance(chain) {
        for nth in 1..=DRAWS {
            if let Some(drawn) = drawn(chain, identified, nth) {
                add(
                    format!("draw {nth} of {DRAWS} from the model's covariance"),
                    &drawn,
                    HysteresisChange::NONE,
                );
            }
        }
    }
    let percent = 100.0 * OFF;
    for (way, sign) in [("lower", -1.0), ("higher", 1.0)] {
        add(
            format!("gain {percent:.0} % {way}"),
            chain,
            HysteresisChange {
                gain: 1.0 + sign * OFF,
                ..HysteresisChange::NONE
            },
        );
    }
    for (called, effect, frequency) in [("first", vibration::ID, 0), ("second", second_mode::ID, 1)]
    {
        if chain.effect(effect).is_none() {
            continue;
        }
        let spread = spread(chain, effect, frequency);
        for (way, sign) in [("lower", -1.0), ("higher", 1.0)] {
            let factors = [1.0 + sign * spread.frequency, 1.0 - spread.damping];
            let name = format!(
                "{called} mode {:.0} % {way} and {:.0} % less damped",
                100.0 * spread.frequency,
                100.0 * spread.damping
            );
            add(
                name,
                &moved(chain, effect, frequency, factors),
                HysteresisChange::NONE,
            );
        }
    }
    for (way, sign) in [("narrower", -1.0), ("wider", 1.0)] {
        add(
            format!("loops {percent:.0} % {way}"),
            chain,
            HysteresisChange {
                wider: sign * OFF,
                ..HysteresisChange::NONE
            },
        );
    }
    out
}

/// Puts a servo to work on every plant; `nominal` is what it did on the model itself.
///
/// # Errors
/// If the design does not fit the tick's formats.
pub fn band(
    chain: &Model,
    design: &ServoDesign,
    reference: &Reference,
    circumstances: Circumstances,
    nominal: &TrackResult,
) -> Result<PlantBand, QuantisationError> {
    let run = |member: &Member| {
        let found = track_on(
            &member.chain,
            member.change,
            design,
            reference,
            "",
            circumstances,
        )?;
        Ok(OnMember::found(member.name.clone(), &found))
    };
    let others: Result<Vec<OnMember>, QuantisationError> =
        parallel::map(&members(chain), run).into_iter().collect();
    let mut members = vec![OnMember::found("the model itself".to_owned(), nominal)];
    members.extend(others?);
    Ok(PlantBand {
        members,
        with_covariance: with_covariance(chain).is_some(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use hysteron_sim::chain::EffectInstance;
    use hysteron_sim::effect::{Overview, by_id};
    use std::sync::Arc;

    fn chain() -> Model {
        let overview = Overview::without_data(0.0, 80.0);
        let mut chain = Model::new(0.0, 80.0);
        let effects: [(&str, &[f64]); 2] = [
            ("hysteresis", &[9.0, 1.0, -2.0]),
            ("vibration", &[5000.0, 0.3]),
        ];
        for (id, values) in effects {
            chain
                .effects
                .push(EffectInstance::new(by_id(id).unwrap(), &overview, values));
        }
        chain
    }

    #[test]
    fn plants_differ_by_gain_mode_and_loops_and_by_a_covariance_that_is_known() {
        let mut chain = chain();
        let names = |chain: &Model| {
            members(chain)
                .into_iter()
                .map(|m| m.name)
                .collect::<Vec<_>>()
        };
        let without = names(&chain);
        for expected in [
            "gain 20 % lower",
            "first mode 5 % higher and 40 % less damped",
            "loops 20 % wider",
        ] {
            assert!(without.iter().any(|name| name == expected), "{without:?}");
        }
        let (name, value) = {
            let p = &chain.effect("vibration").unwrap().parameters[0];
            (p.parameter.name.to_string(), p.value)
        };
        chain.identified = Some(Arc::new(Identified {
            values: vec![("vibration".into(), name)],
            factor: vec![vec![0.01]],
            error_um: 0.003,
            seconds: 1.0,
            low_v: 0.0,
            high_v: 80.0,
            slope_max_v_s: 1e3,
            ..Identified::default()
        }));
        assert_eq!(names(&chain).len(), without.len() + DRAWS as usize);
        let values: Vec<f64> = (1..=DRAWS)
            .map(|seed| {
                drawn(&chain, chain.identified.as_deref().unwrap(), seed)
                    .unwrap()
                    .values("vibration")
                    .unwrap()[0]
            })
            .collect();
        assert!(
            values.iter().all(|v| (v / value - 1.0).abs() < 0.1)
                && values.windows(2).all(|w| w[0] != w[1]),
            "{values:?}"
        );
    }
}
