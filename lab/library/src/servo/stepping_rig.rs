//! A stick-slip rig as a file: what was identified of one, for the emulated board to stand in front of.

use crate::error::{Error, Result};
use hysteron_sim::elastoplastic_friction::ElastoplasticFriction;
use hysteron_sim::hysteresis_surface::Surfaces;
use hysteron_sim::stick_slip::StickSlipActuator;
use serde::{Deserialize, Serialize};

/// The values of [`StickSlipActuator`], by their names there.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct RigFile {
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
}

/// The text of a file.
///
/// # Errors
/// A value is no number.
pub fn to_toml(rig: &StickSlipActuator) -> Result<String> {
    let friction = &rig.friction;
    let file = RigFile {
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
    };
    toml::to_string(&file).map_err(|error| Error::new("rig", error.to_string()))
}

/// Reads the text of a file, which is called `place` in messages.
///
/// # Errors
/// A field is missing, unknown or not above zero.
pub fn from_toml(text: &str, place: &str) -> Result<StickSlipActuator> {
    let file: RigFile = toml::from_str(text).map_err(|error| Error::new(place, error.message()))?;
    for (name, value) in [
        ("drive_range_v", file.drive_range_v),
        ("platform_stiffness_n_um", file.platform_stiffness_n_um),
        ("natural_frequency_rad_s", file.natural_frequency_rad_s),
        ("damping_ratio", file.damping_ratio),
        ("end_effector_mass_kg", file.end_effector_mass_kg),
        ("contact_stiffness_n_um", file.contact_stiffness_n_um),
        ("contact_damping_n_s_um", file.contact_damping_n_s_um),
        ("coulomb_force_n", file.coulomb_force_n),
    ] {
        if !(value > 0.0 && value.is_finite()) {
            return Err(Error::new(
                place,
                format!("{name} = {value}: expected above 0"),
            ));
        }
    }
    Ok(StickSlipActuator {
        hysteresis: Surfaces {
            g: file.g_um,
            r: file.r_um,
        },
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
        let rig = StickSlipActuator::thesis(0.0635);
        let text = to_toml(&rig).unwrap();
        assert_eq!(from_toml(&text, "rig.toml").unwrap(), rig);
        let wrong = text.replace("damping_ratio = 0", "damping_ratio = -0");
        let problem = from_toml(&wrong, "rig.toml").unwrap_err().to_string();
        assert!(problem.contains("damping_ratio"), "{problem}");
        let problem = from_toml("mass = 1.0", "rig.toml").unwrap_err().to_string();
        assert!(problem.contains("mass"), "{problem}");
    }
}
