//! A stick-slip rig as a file: what was identified of one, for the emulated board to stand in front of.

use crate::error::{Error, Result};
use crate::toml_file::with_schema;
use hysteron_sim::block::Play;
use hysteron_sim::elastoplastic_friction::ElastoplasticFriction;
use hysteron_sim::hysteresis_surface::Surfaces;
use hysteron_sim::rig_effects::{RigEffects, parameters};
use hysteron_sim::stick_slip::StickSlipActuator;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

const SCHEMA: &str = "hysteron.rig/1";

/// Highest power of a surface's coefficients: those that the program writes have five.
const POWERS_MAX: usize = 16;

/// The values of [`StickSlipActuator`], by their names there.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct RigFile {
    schema: String,
    drive_range_v: f64,
    platform_stiffness_n_um: f64,
    natural_frequency_rad_s: f64,
    damping_ratio: f64,
    end_effector_mass_kg: f64,
    contact_stiffness_n_um: f64,
    contact_damping_n_s_um: f64,
    coulomb_force_n: f64,
    breakaway_ratio: Option<f64>,
    g_um: Vec<Vec<f64>>,
    r_um: Vec<f64>,
    /// Threshold over the range and weight in um of each play operator beside the surfaces.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    plays: Vec<[f64; 2]>,
    /// Values of [`RigEffects`] that are not zero, by their names there.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    effects: BTreeMap<String, f64>,
}

/// Whether a text is meant to be a rig, right or wrong.
#[must_use]
pub fn is_rig(text: &str) -> bool {
    let schema = |line: &str| line.starts_with("schema") && line.contains("hysteron.rig/");
    text.lines().any(schema)
}

/// The effects of a file.
fn effects(file: &RigFile, place: &str) -> Result<RigEffects> {
    let mut effects = RigEffects::default();
    for (name, value) in &file.effects {
        let Some(parameter) = parameters().find(|p| p.name == name) else {
            return Err(Error::new(place, format!("effects: no value {name}")));
        };
        let [least, most] = parameter.range;
        if !(least..=most).contains(value) {
            let expected = format!("{name} = {value}: expected {least} to {most}");
            return Err(Error::new(place, expected));
        }
        *(parameter.place)(&mut effects) = *value;
    }
    Ok(effects)
}

/// What is wrong with the numbers of a file that must not be below zero, or with its surfaces.
fn first_wrong(file: &RigFile) -> Option<String> {
    let above_zero = [
        ("drive_range_v", file.drive_range_v),
        ("platform_stiffness_n_um", file.platform_stiffness_n_um),
        ("natural_frequency_rad_s", file.natural_frequency_rad_s),
        ("damping_ratio", file.damping_ratio),
        ("end_effector_mass_kg", file.end_effector_mass_kg),
        ("contact_stiffness_n_um", file.contact_stiffness_n_um),
        ("contact_damping_n_s_um", file.contact_damping_n_s_um),
        ("coulomb_force_n", file.coulomb_force_n),
    ];
    let wrong = (above_zero.iter()).find(|(_, value)| !(*value > 0.0 && value.is_finite()));
    if let Some((name, value)) = wrong {
        return Some(format!("{name} = {value}: expected above 0"));
    }
    if let Some(ratio) = (file.breakaway_ratio).filter(|ratio| !(0.0..1.0).contains(ratio)) {
        return Some(format!(
            "breakaway_ratio = {ratio}: expected from 0 to below 1"
        ));
    }
    let powers = file.g_um.len();
    let is_square = file.g_um.iter().all(|row| row.len() == powers);
    if let Some([threshold, _]) = (file.plays.iter()).find(|play| !(0.0..=1.0).contains(&play[0])) {
        return Some(format!(
            "plays: threshold {threshold}: expected from 0 to 1"
        ));
    }
    let of_plays = file.plays.iter().map(|play| &play[1]);
    let numbers = file.g_um.iter().flatten().chain(&file.r_um).chain(of_plays);
    if !(1..=POWERS_MAX).contains(&powers) || !is_square || file.r_um.len() > POWERS_MAX {
        return Some(format!(
            "g_um, r_um: expected as many rows as columns, 1 to {POWERS_MAX}"
        ));
    }
    (!numbers.clone().all(|number| number.is_finite()))
        .then(|| "g_um, r_um, plays: expected finite numbers".into())
}

/// The text of a file.
///
/// # Errors
/// A value is no number.
pub fn to_toml(rig: &StickSlipActuator) -> Result<String> {
    let friction = &rig.friction;
    let file = RigFile {
        schema: SCHEMA.into(),
        drive_range_v: rig.drive_range_v,
        platform_stiffness_n_um: rig.platform_stiffness_n_um,
        natural_frequency_rad_s: rig.natural_frequency_rad_s,
        damping_ratio: rig.damping_ratio,
        end_effector_mass_kg: rig.end_effector_mass_kg,
        contact_stiffness_n_um: friction.stiffness_n_um,
        contact_damping_n_s_um: friction.damping_n_s_um,
        coulomb_force_n: friction.coulomb_force_n,
        breakaway_ratio: friction.breakaway_ratio,
        g_um: rig.hysteresis.g.clone(),
        r_um: rig.hysteresis.r.clone(),
        plays: rig
            .plays
            .iter()
            .map(|play| [play.threshold, play.weight])
            .collect(),
        effects: parameters()
            .map(|parameter| (parameter.name.to_owned(), parameter.value(&rig.effects)))
            .filter(|(_, value)| *value != 0.0)
            .collect(),
    };
    toml::to_string(&file).map_err(|error| Error::new("rig", error.to_string()))
}

/// Reads the text of a file, which is called `place` in messages.
///
/// # Errors
/// A field is missing, unknown or outside what its physics allows.
pub fn from_toml(text: &str, place: &str) -> Result<StickSlipActuator> {
    let file: RigFile = with_schema(text, place, SCHEMA)?;
    if let Some(problem) = first_wrong(&file) {
        return Err(Error::new(place, problem));
    }
    Ok(StickSlipActuator {
        effects: effects(&file, place)?,
        hysteresis: Surfaces {
            g: file.g_um,
            r: file.r_um,
        },
        plays: (file.plays.iter())
            .map(|[threshold, weight]| Play {
                threshold: *threshold,
                weight: *weight,
            })
            .collect(),
        drive_range_v: file.drive_range_v,
        platform_stiffness_n_um: file.platform_stiffness_n_um,
        natural_frequency_rad_s: file.natural_frequency_rad_s,
        damping_ratio: file.damping_ratio,
        friction: ElastoplasticFriction {
            stiffness_n_um: file.contact_stiffness_n_um,
            damping_n_s_um: file.contact_damping_n_s_um,
            coulomb_force_n: file.coulomb_force_n,
            breakaway_ratio: file.breakaway_ratio,
        },
        end_effector_mass_kg: file.end_effector_mass_kg,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_rig_comes_back_as_it_went_or_names_what_is_wrong() {
        let mut rig = StickSlipActuator::thesis(0.0635);
        rig.plays = vec![Play {
            threshold: 0.2,
            weight: 0.7,
        }];
        rig.friction.breakaway_ratio = None;
        rig.effects.contact_viscosity_n_s_um = 1e-6;
        let text = to_toml(&rig).unwrap();
        assert_eq!(from_toml(&text, "rig.toml").unwrap(), rig);
        let wrong = text.replace("damping_ratio = 0", "damping_ratio = -0");
        let problem = from_toml(&wrong, "rig.toml").unwrap_err().to_string();
        assert!(problem.contains("damping_ratio"), "{problem}");
        let wrong = text.replace("plays = [[0.2", "plays = [[2.2");
        let problem = from_toml(&wrong, "rig.toml").unwrap_err().to_string();
        assert!(problem.contains("threshold"), "{problem}");
        let problem = from_toml("mass = 1.0", "rig.toml").unwrap_err().to_string();
        assert!(problem.contains("mass"), "{problem}");
    }
}
