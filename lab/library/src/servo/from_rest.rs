//! Whether a servo comes to rest when it begins at the lower limit of its drive: the integers of the tick on
//! the whole model of the actuator, with the noise of its sensor.
//!
//! # Why
//! Eigenvalues tell of a free drive, and the first harmonic of a limit
//! ([`PredictorDesign::at_a_limit`](super::law::PredictorDesign::at_a_limit)) of a swinging that is
//! there already. Whether a servo gets from its beginning to rest or into that swinging depends on how hard
//! its own noise and the way up push it beyond the limit, and on the hysteresis that it turns back in;
//! neither knows of these, so it is run. With the linear part of the model alone, in f64, gains came out as
//! well, but masses up to 18 % too early (`cargo run --release -p hysteron-research --example first_unstable`).

use super::design::ServoDesign;
use super::plant_set::PlantVariation;
use super::reference::{PeriodicReference, Reference, ReferenceShape};
use super::track::{Circumstances, track};
use crate::parallel;
use hysteron_sim::chain::{EffectInstance, Model};
use hysteron_sim::effect::{
    Overview, by_id, delay, gain, hysteresis, initial_curve, play_operators, second_mode, vibration,
};

/// Beginnings that are tried, each with another noise: one that swings is enough.
const BEGINNINGS: usize = 4;
/// Samples at the end in which it has to be at rest: 0.2 s.
const AT_REST: usize = 4000;
/// Motion at rest of this many times the sensor's noise, RMS over RMS, is swinging.
const SWINGING: f64 = 10.0;
/// Of the reference, which does not move once it has grown: the error counts for a second.
const FREQUENCY_HZ: f64 = 10.0;

/// How a servo begins: at the lower limit of its drive, after a conditioning, from where its reference grows
/// to the middle of the range.
#[derive(Clone, Copy)]
pub struct Beginning<'a> {
    /// The servo.
    pub design: &'a ServoDesign,
    /// The actuator.
    pub chain: &'a Model,
    /// Its travel, um.
    pub travel_um: f64,
    /// Noise of the sensor, um RMS.
    pub noise_um: f64,
}

/// A chain with another gain, mass and delay.
pub(super) fn varied(chain: &Model, variation: &PlantVariation) -> Model {
    let mut out = chain.clone();
    let slower = variation.mass_ratio.powf(-0.5);
    for effect in &mut out.effects {
        // The first of its values that is meant, and how far the next stands from it.
        let (from, apart, factor) = match effect.id.as_str() {
            gain::ID | hysteresis::ID | initial_curve::ID => (0, 1, variation.gain),
            // Behind each weight stands a threshold.
            play_operators::ID => (0, 2, variation.gain),
            vibration::ID => (0, 1, slower),
            // The first of its values is a share.
            second_mode::ID => (1, 1, slower),
            _ => continue,
        };
        effect
            .parameters
            .iter_mut()
            .skip(from)
            .step_by(apart)
            .for_each(|p| p.value *= factor);
    }
    if variation.delay_s > 0.0 {
        if out.effect(delay::ID).is_none()
            && let Some(effect) = by_id(delay::ID)
        {
            let overview = Overview::without_data(chain.drive_min_v, chain.drive_max_v);
            let mut instance = EffectInstance::new(effect, &overview, &[0.0]);
            instance.parameters.iter_mut().for_each(|p| p.value = 0.0);
            out.effects.push(instance);
        }
        for p in out
            .effects
            .iter_mut()
            .filter(|e| e.id == delay::ID)
            .flat_map(|e| &mut e.parameters)
        {
            p.value += variation.delay_s;
        }
    }
    out
}

impl Beginning<'_> {
    /// Whether the servo goes on swinging on the varied actuator, with any of the noises that are tried.
    #[must_use]
    pub fn swings(&self, variation: &PlantVariation) -> bool {
        let chain = varied(self.chain, variation);
        let design = ServoDesign {
            learning: None,
            adaptation: None,
            ..self.design.clone()
        };
        let motions_um = parallel::map_indices(BEGINNINGS, |nth| {
            self.motion_um(&chain, &design, nth as u64 + 1)
        });
        motions_um
            .into_iter()
            .any(|motion_um| motion_um.is_nan() || motion_um > SWINGING * self.noise_um)
    }

    /// RMS motion about its mean at the end, um; none where the design does not fit the tick.
    fn motion_um(&self, chain: &Model, design: &ServoDesign, seed: u64) -> f64 {
        let reference = PeriodicReference {
            shape: ReferenceShape::Sine,
            frequency_hz: FREQUENCY_HZ,
            amplitude_um: 0.0,
            offset_um: 0.5 * self.travel_um,
            phase_deg: 0.0,
        };
        let circumstances = Circumstances {
            noise_um: self.noise_um,
            seed,
            disturbance: None,
        };
        let Ok(found) = track(
            chain,
            design,
            &Reference::Periodic(reference),
            "rest",
            circumstances,
        ) else {
            return 0.0;
        };
        let tail = &found.sensor_um[found.sensor_um.len().saturating_sub(AT_REST)..];
        let mean = tail.iter().sum::<f64>() / tail.len().max(1) as f64;
        (tail.iter().map(|y| (y - mean).powi(2)).sum::<f64>() / tail.len().max(1) as f64).sqrt()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::servo::known::known_delay_s;
    use crate::servo::model::actuator_model;

    #[test]
    fn a_varied_chain_is_the_varied_plant() {
        let overview = Overview::without_data(0.0, 80.0);
        let mut chain = Model::new(0.0, 80.0);
        let effects: [(&str, &[f64]); 3] = [
            ("hysteresis", &[9.0, 1.0, -2.0]),
            ("vibration", &[5000.0, 0.3]),
            ("second_mode", &[0.02, 30_000.0, 0.05]),
        ];
        for (id, values) in effects {
            chain
                .effects
                .push(EffectInstance::new(by_id(id).unwrap(), &overview, values));
        }
        let variation = PlantVariation {
            gain: 1.4,
            mass_ratio: 1.7,
            delay_s: 3e-5,
            mode: None,
        };
        let other = varied(&chain, &variation);
        let [before, after] = [&chain, &other].map(|c| actuator_model(c).unwrap());
        assert!((after.reach_um() / before.reach_um() - 1.4).abs() < 1e-12);
        let expected = before.linear.with_mass_ratio(1.7);
        let close = |a: f64, b: f64| (a / b - 1.0).abs() < 1e-12;
        let (mode, of) = (after.linear.first_mode, expected.first_mode);
        assert!(
            close(mode.natural_frequency_rad_s, of.natural_frequency_rad_s)
                && close(mode.damping_ratio, of.damping_ratio)
        );
        let (Some((share, mode)), Some((of_share, of))) =
            (after.linear.second_mode, expected.second_mode)
        else {
            panic!("a mode")
        };
        assert!(
            close(share, of_share)
                && close(mode.natural_frequency_rad_s, of.natural_frequency_rad_s)
        );
        assert_eq!(known_delay_s(&other), 3e-5);
        assert_eq!(known_delay_s(&varied(&other, &variation)), 6e-5);
    }
}
