//! A servo at work on an identified chain, as `hysteron track` puts it: what is asked for is checked first.

use super::design::ServoDesign;
use super::disturbance::Disturbance;
use super::from_rest::varied;
use super::known::{ASSUMED_NOISE_UM, require_known_in_a_loop};
use super::members::{self, PlantBand};
use super::model::actuator_model;
use super::named_scheme::with_scheme;
use super::plant_set::PlantVariation;
use super::reference::Reference;
use super::track::{Beside, Circumstances, TrackResult, track, track_plant};
use crate::statistics::extremes;
use hysteron_sim::chain::Model;
use hysteron_sim::closed_loop::Plant;
use hysteron_sim::effect::vibration;

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
    require_known_in_a_loop(chain)?;
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
    let chain = varied(chain, &PlantVariation::with_mass_ratio(1.0 + added_mass));
    let mut chosen = design.clone();
    if let Some(name) = scheme {
        chosen = with_scheme(design, name)?;
    }
    // What the actuator reaches counts, not what the servo's own model believes.
    let reach_um = actuator_model(&chain)
        .map_or(f64::INFINITY, |m| m.reach_um())
        .min(design.model.reach_um());
    require_reached(reference, &chosen, reach_um)?;
    let noise_um = sensor_noise_um
        .or(design.sensor_noise_um)
        .unwrap_or(ASSUMED_NOISE_UM);
    require_noise(noise_um, reach_um)?;
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

/// Whether a sensor with this noise can be followed over this reach, um.
fn require_noise(noise_um: f64, reach_um: f64) -> Result<(), String> {
    if (0.0..0.05 * reach_um).contains(&noise_um) {
        return Ok(());
    }
    Err(format!(
        "--sensor-noise-um {noise_um}; expected at least 0 and below {:.3}, a twentieth of the travel",
        0.05 * reach_um
    ))
}

/// Whether a reference stays within what the drive reaches.
fn require_reached(
    reference: &Reference,
    design: &ServoDesign,
    reach_um: f64,
) -> Result<(), String> {
    let (low_um, high_um) = extremes(&reference.samples_um(design).0);
    if low_um >= 0.0 && high_um <= reach_um {
        return Ok(());
    }
    Err(format!(
        "the reference goes from {low_um:.2} to {high_um:.2} um; counted from where the actuator stands at its lowest drive of {} V, the drive reaches 0 to {reach_um:.2} um",
        design.model.drive_min_v
    ))
}

/// Follows a reference on a plant of the user's own, from rest at its lowest drive. Noise that is named in
/// `work` is added to its readings.
///
/// # Errors
/// A message that names the field, or the number that does not fit the servo's formats.
pub fn follow_plant(
    plant: &mut impl Plant,
    called: &str,
    design: &ServoDesign,
    reference: &Reference,
    reference_name: &str,
    work: &Work,
) -> Result<TrackResult, String> {
    if work.disturbance.is_some() || work.added_mass > 0.0 {
        return Err(
            "a disturbance or an added mass has no effect on a plant of one's own: simulate it there"
                .into(),
        );
    }
    let design = match work.scheme {
        Some(name) => with_scheme(design, name)?,
        None => design.clone(),
    };
    require_reached(reference, &design, design.model.reach_um())?;
    let noise_um = work.sensor_noise_um.unwrap_or(0.0);
    require_noise(noise_um, design.model.reach_um())?;
    let circumstances = Circumstances {
        noise_um,
        seed: 1,
        disturbance: None,
    };
    track_plant(
        plant,
        called,
        &design,
        reference,
        reference_name,
        circumstances,
    )
    .map_err(|e| e.to_string())
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
