//! A first mode that does not stay where it was recorded (another load, another temperature): how far up a
//! reference is followed, and what it becomes where the mode stands elsewhere.
//!
//! # How it works
//! A reference `r` becomes the motion `(1 + (P F - 1) / (1 + P K)) r`: `P` the sampled actuator, `F` the
//! law's feedforward (the inverse of the model), `K` the law's answer to the reading. With `P = 1 / F` that
//! is one, whatever the loop. Where the mode has moved, the inverse amplifies what stands at the new place,
//! and only the loop's gain there, `|P K|`, brings it back towards one: bandwidth beyond a lightly damped
//! mode that moves comes from feedforward and from gain about the mode together. [`MovingMode::deviation`] is
//! what the choice of a tuning weighs.

use super::law::PredictorDesign;
use super::model::{LinearModel, ModeModel, SampledModel};
use super::plant_set::PlantVariation;
use super::sampled_loop::{LawResponse, frequency_response, reference_response};
use nalgebra::Complex;
use std::f64::consts::TAU;

/// References are to be followed up to this many times the first mode's frequency.
pub const FOLLOWED_TO: f64 = 1.2;
/// Largest share by which a mode may be said to move.
pub const FARTHEST: f64 = 0.5;

/// Frequencies at which references are looked at, up to the highest.
const FREQUENCIES: u32 = 45;
/// Places of the mode to either side.
const PLACES: i32 = 4;
/// Steps in which a bandwidth is looked for, Hz.
const STEP_HZ: f64 = 5.0;

/// Half the power: where a bandwidth ends.
const HALF_POWER: f64 = std::f64::consts::FRAC_1_SQRT_2;

/// The same dynamics with the first mode at a multiple of its frequency.
#[must_use]
pub fn with_first_mode_at(linear: &LinearModel, factor: f64) -> LinearModel {
    let ModeModel {
        natural_frequency_rad_s,
        damping_ratio,
    } = linear.first_mode;
    LinearModel {
        first_mode: ModeModel {
            natural_frequency_rad_s: factor * natural_frequency_rad_s,
            damping_ratio,
        },
        ..*linear
    }
}

/// How a reference is followed on an actuator.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ReferenceBand {
    /// From here on less than half the power of a reference arrives, Hz.
    pub bandwidth_hz: f64,
    /// Largest magnitude of position over reference below it.
    pub peak: f64,
}

impl ReferenceBand {
    /// Of a law on an actuator, its input multiplied by `gain`.
    #[must_use]
    pub fn followed(law: &PredictorDesign, plant: &SampledModel, gain: f64) -> Self {
        let (highest_hz, answer) = (0.5 / plant.period_s, LawResponse::new(law));
        let mut out = Self {
            bandwidth_hz: highest_hz,
            peak: 1.0,
        };
        for i in 1..(highest_hz / STEP_HZ) as u32 {
            let hz = STEP_HZ * f64::from(i);
            let plant = frequency_response(plant, TAU * hz) * gain;
            let magnitude =
                reference_response(plant, law.feedforward_response(hz), answer.at(hz)).norm();
            if magnitude < HALF_POWER {
                return Self {
                    bandwidth_hz: hz,
                    ..out
                };
            }
            out.peak = out.peak.max(magnitude);
        }
        out
    }
}

/// What is the same for every tuning of a law: frequencies, the feedforward there, and the actuator with its
/// mode at every place.
pub struct MovingMode {
    followed_to_hz: f64,
    frequencies: Vec<(f64, Complex<f64>)>,
    places: Vec<Vec<Complex<f64>>>,
}

impl MovingMode {
    /// For a mode that moves by up to `share` of its frequency to either side, on an actuator with a known
    /// delay.
    #[must_use]
    pub fn new(
        linear: &LinearModel,
        feedforward: &PredictorDesign,
        share: f64,
        delay_s: f64,
    ) -> Self {
        let followed_to_hz = FOLLOWED_TO * linear.first_mode.natural_frequency_rad_s / TAU;
        // A mode at its highest place rings above that.
        let highest_hz = followed_to_hz * (1.0 + share);
        let frequencies: Vec<(f64, Complex<f64>)> = (1..=FREQUENCIES)
            .map(|i| highest_hz * f64::from(i) / f64::from(FREQUENCIES))
            .map(|hz| (hz, feedforward.feedforward_response(hz)))
            .collect();
        let at = |place: i32| {
            let moved =
                with_first_mode_at(linear, 1.0 + share * f64::from(place) / f64::from(PLACES));
            let plant = PlantVariation::with_delay_s(delay_s).sampled(&moved);
            frequencies
                .iter()
                .map(|(hz, _)| frequency_response(&plant, TAU * hz))
                .collect()
        };
        let places = (-PLACES..=PLACES).map(at).collect();
        Self {
            followed_to_hz,
            frequencies,
            places,
        }
    }

    /// The factor by which the magnitude of position over reference is at most too large, or up to
    /// [`FOLLOWED_TO`] times the mode too small, wherever the mode stands; `law` is the answer of the drive
    /// to the reading at a frequency.
    #[must_use]
    pub fn deviation(&self, law: impl Fn(f64) -> Complex<f64>) -> f64 {
        let mut worst = 1.0f64;
        for (i, (hz, feedforward)) in self.frequencies.iter().enumerate() {
            let law = law(*hz);
            for place in &self.places {
                let magnitude = reference_response(place[i], *feedforward, law).norm();
                let too_small = if *hz <= self.followed_to_hz {
                    1.0 / magnitude
                } else {
                    1.0
                };
                worst = worst.max(magnitude).max(too_small);
            }
        }
        worst
    }
}

#[cfg(test)]
mod tests {
    use super::super::model::SAMPLING_PERIOD_S;
    use super::super::robust::{ModeSpread, Task};
    use super::super::sampled_loop::{SampledLoop, law_response};
    use super::super::tuning::{Demands, PredictorTuning};
    use super::*;

    fn light() -> LinearModel {
        LinearModel {
            first_mode: ModeModel {
                natural_frequency_rad_s: TAU * 739.0,
                damping_ratio: 0.014,
            },
            second_mode: Some((
                0.02,
                ModeModel {
                    natural_frequency_rad_s: TAU * 5000.0,
                    damping_ratio: 0.02,
                },
            )),
            amplifier_bandwidth_hz: None,
            sensor_bandwidth_hz: None,
            period_s: 5e-5,
        }
    }

    /// The closed loop and its feedforward in the time domain, beside the responses that are multiplied here.
    #[test]
    fn a_reference_becomes_what_the_running_loop_makes_of_it() {
        let law = PredictorDesign::new(&light(), &PredictorTuning::START);
        let moved = with_first_mode_at(&light(), 0.9).sampled();
        for hz in [200.0, 500.0, 800.0] {
            let turn = |k: usize| TAU * hz * SAMPLING_PERIOD_S * k as f64;
            let reference = |k: i64| (TAU * hz * SAMPLING_PERIOD_S * k as f64).cos();
            let feedforward_at = |k: usize| -> f64 {
                law.feedforward
                    .iter()
                    .enumerate()
                    .map(|(i, c)| c * reference(k as i64 + i as i64 - 7))
                    .sum()
            };
            let mut x = nalgebra::DVector::<f64>::zeros(moved.b.len());
            let mut z = nalgebra::DVector::<f64>::zeros(law.b.len());
            let (mut acting, mut fed) = (0.0, 0.0);
            let samples = 20_000;
            let (mut re, mut im, mut count) = (0.0, 0.0, 0.0);
            for k in 0..samples {
                let error = moved.c.dot(&x) - reference(k as i64);
                if k > samples / 2 {
                    let y = moved.c.dot(&x);
                    (re, im, count) = (re + y * turn(k).cos(), im - y * turn(k).sin(), count + 0.5);
                }
                let innovation = error - law.c.dot(&z);
                z = &law.a * &z + &law.l * innovation + &law.b * (acting - fed);
                x = &moved.a * &x + &moved.b * acting;
                fed = feedforward_at(k);
                acting = fed - law.k.dot(&z);
            }
            let computed = reference_response(
                frequency_response(&moved, TAU * hz),
                law.feedforward_response(hz),
                law_response(&law, hz),
            );
            let seen = Complex::new(re / count, im / count);
            assert!(
                (computed - seen).norm() < 0.02 * computed.norm(),
                "{hz} Hz: {computed} {seen}"
            );
        }
    }

    #[test]
    #[cfg_attr(debug_assertions, ignore = "slow: release mode")]
    fn a_tuning_for_a_mode_that_moves_holds_wherever_it_stands_and_amplifies_less() {
        let demands = Demands {
            sensor_noise_um: 0.002,
            ..Demands::default()
        };
        let known = ModeSpread {
            frequency: 0.02,
            damping: 0.2,
        };
        let design = |mode_moves: f64| {
            let first = ModeSpread {
                frequency: known.frequency.max(mode_moves),
                ..known
            };
            let task = Task {
                linear: light(),
                first,
                second: Some(known),
                left_out: None,
                delay_s: 0.0,
                recording: None,
                mode_moves,
                mass_to: 2.0,
                demands,
            };
            PredictorDesign::new(&light(), &task.scan().best().expect("some hold").tuning)
        };
        let (usual, moving) = (design(0.0), design(0.2));
        let worst = |law: &PredictorDesign| {
            MovingMode::new(&light(), law, 0.2, 0.0).deviation(|hz| law_response(law, hz))
        };
        assert!(
            worst(&moving) < 0.7 * worst(&usual),
            "{} {}",
            worst(&moving),
            worst(&usual)
        );
        for factor in [0.8, 0.87, 1.0, 1.13, 1.2] {
            let plant = with_first_mode_at(&light(), factor).sampled();
            assert!(SampledLoop::new(&moving, &plant).is_stable(), "{factor}");
        }
        let band = ReferenceBand::followed(&moving, &light().sampled(), 1.0);
        assert!(
            band.bandwidth_hz > FOLLOWED_TO * 739.0 && band.peak < 1.1,
            "{band:?}"
        );
    }
}
