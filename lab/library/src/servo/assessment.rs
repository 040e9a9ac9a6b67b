//! What a law is worth on the model that it was made for, by one list of cases.

use super::law::PredictorDesign;
use super::model::{LinearModel, ModeModel};
use super::plant_set::{HELD_MASSES, PlantVariation, mass_step, row};
use super::sampled_loop::{FrequencyGrid, LawResponse, SampledLoop, let_through_um};
use super::tuning::{Demands, PredictorTuning};
use crate::parallel;
use serde::{Deserialize, Serialize};

/// Parts of the band up to half the sampling rate in which noise and sensitivity are looked at.
const GRID_PARTS: u32 = 200;

/// Margins that a design keeps: largest eigenvalue magnitudes of the sampled closed loop in each case. Below
/// one is stable.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Margins {
    /// Nominal.
    pub nominal: f64,
    /// Gain 50 % lower.
    pub gain_half: f64,
    /// Gain 50 % higher.
    pub gain_plus_half: f64,
    /// One more period of delay.
    pub delay: f64,
    /// Up to twice the moving mass.
    pub mass_double: f64,
    /// Two percent of the motion in a second mode at 6 times the first one's frequency, damping ratio 0.02,
    /// that the design does not know (only where the model has no second mode); otherwise the known second
    /// mode 10 % lower.
    pub second_mode: f64,
    /// Largest magnitude of the sensitivity over all frequencies.
    pub sensitivity_peak: f64,
}

/// What a tuning is worth.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Assessment<T = PredictorTuning> {
    /// The tuning.
    pub tuning: T,
    /// Sensor noise that appears as motion, um RMS.
    pub noise_um: f64,
    /// Hysteresis model error that is let through, um RMS.
    pub disturbance_um: f64,
    /// Margins.
    pub margins: Margins,
    /// Stable in every case, and the sensitivity's peak as demanded.
    pub accepted: bool,
}

impl<T> Assessment<T> {
    /// Expected error, um RMS.
    #[must_use]
    pub fn expected_um(&self) -> f64 {
        self.noise_um.hypot(self.disturbance_um)
    }
}

/// Of candidate gains the one with the smallest expected error among those that keep the margins: noise
/// passed on, and model error let through at the references' highest frequency and at a tenth of it, so that
/// a slow integral is not taken for a good one.
#[must_use]
pub fn best_of<T: Copy + Send + Sync>(
    candidates: &[T],
    law: impl Fn(&T) -> PredictorDesign + Sync,
    linear: &LinearModel,
    demands: &Demands,
) -> Option<Assessment<T>> {
    let plant = linear.sampled();
    let judged = parallel::map(candidates, |tuning| {
        let law = law(tuning);
        let found = assess(*tuning, &law, linear, demands);
        let slow_um = let_through_um(
            &plant,
            &LawResponse::new(&law),
            0.1 * demands.reference_hz,
            demands.model_error_um,
        );
        found
            .accepted
            .then_some((found.expected_um().hypot(slow_um), found))
    });
    let best = judged.into_iter().flatten();
    best.min_by(|x, y| x.0.total_cmp(&y.0))
        .map(|(_, found)| found)
}

/// The model with a second mode that a law does not know: its own 10 % lower, or one where it has none.
fn with_other_mode(linear: &LinearModel) -> LinearModel {
    let other = match linear.second_mode {
        Some((share, mode)) => (
            share,
            ModeModel {
                natural_frequency_rad_s: 0.9 * mode.natural_frequency_rad_s,
                ..mode
            },
        ),
        None => (
            0.02,
            ModeModel {
                natural_frequency_rad_s: 6.0 * linear.first_mode.natural_frequency_rad_s,
                damping_ratio: 0.02,
            },
        ),
    };
    LinearModel {
        second_mode: Some(other),
        ..*linear
    }
}

/// Assesses a law on the model that it was designed for.
#[must_use]
pub fn assess<T>(
    tuning: T,
    law: &PredictorDesign,
    linear: &LinearModel,
    demands: &Demands,
) -> Assessment<T> {
    let plant = linear.sampled();
    let on = |gain: f64| SampledLoop::new(law, &plant).with_gain(gain);
    let on_other = |variation: PlantVariation, linear: &LinearModel| {
        SampledLoop::new(law, &variation.sampled(linear)).spectral_radius()
    };
    let response = on(1.0).response(&FrequencyGrid::even(GRID_PARTS, linear.period_s));
    let margins = Margins {
        nominal: on(1.0).spectral_radius(),
        gain_half: on(0.5).spectral_radius(),
        gain_plus_half: on(1.5).spectral_radius(),
        delay: on_other(PlantVariation::with_delay_s(linear.period_s), linear),
        mass_double: row(1.0, HELD_MASSES[0], mass_step(linear))
            .map(|mass| on_other(PlantVariation::with_mass_ratio(mass), linear))
            .fold(0.0, f64::max),
        second_mode: on_other(PlantVariation::NONE, &with_other_mode(linear)),
        sensitivity_peak: response.sensitivity_peak().0,
    };
    let worst = [
        margins.nominal,
        margins.gain_half,
        margins.gain_plus_half,
        margins.delay,
        margins.mass_double,
        margins.second_mode,
    ]
    .into_iter()
    .fold(0.0, f64::max);
    Assessment {
        tuning,
        noise_um: response.noise_transmission() * demands.sensor_noise_um,
        disturbance_um: let_through_um(
            &plant,
            &LawResponse::new(law),
            demands.reference_hz,
            demands.model_error_um,
        ),
        margins,
        accepted: worst < 1.0 && margins.sensitivity_peak <= demands.sensitivity_peak,
    }
}
