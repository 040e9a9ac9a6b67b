//! The contact of a stick-slip drive, identified from saw-teeth: what is left once the platform is known.
//!
//! # How it works
//! The platform (loops, mode, stiffness) and the slider's mass are known. The four values of the elastoplastic
//! contact (thesis Ch. 3, Eqs. 2, 3) are refined in their logarithms, the break-away ratio in its logit. The
//! sum of squares has side valleys, in which the ratio runs to an end. So the best guesses of force, stiffness
//! and damping are refined at each of [`BREAKAWAY_RATIOS`] first, and all four values only from the best of
//! these. Standard deviations are those of the asymptotic covariance, for noise of the size of the residual.

use super::model::required_model;
use crate::least_squares::{Problem, refined};
use crate::stepping::Measured;
use hysteron_sim::chain::Model;
use hysteron_sim::elastoplastic_friction::ElastoplasticFriction;
use hysteron_sim::hysteresis_surface::Surfaces;
use hysteron_sim::rig_effects::RigEffects;
use hysteron_sim::stick_slip::{Integrator, StickSlipActuator};
use nalgebra::{DMatrix, DVector};
use serde::Serialize;

/// Coulomb forces over the mass that are guessed, m/s^2, around the thesis' 0.57.
const FORCES_M_S2: [f64; 3] = [0.16, 0.5, 1.6];
/// Natural frequencies of the slider on its contact that are guessed, rad/s, around the thesis' 2755.
const FREQUENCIES_RAD_S: [f64; 3] = [1300.0, 2500.0, 5000.0];
/// Damping ratios of it, around the thesis' 0.78.
const DAMPING_RATIOS: [f64; 2] = [0.2, 1.0];
/// Break-away ratios that are held.
pub const BREAKAWAY_RATIOS: [f64; 4] = [0.3, 0.6, 0.8, 0.9];
/// Guesses of the others that are refined with each, the best first.
const REFINED: usize = 3;
/// Results of that from which all four are refined.
const REFINED_AGAIN: usize = 2;
/// Steps of a refinement with a held ratio and of one of all four, and the fall of the cost that ends it.
const STEPS: [usize; 2] = [15, 40];
const FALL_ENOUGH: f64 = 1e-7;
/// Highest break-away ratio: beyond it the transition is too short for the integrator's step.
const RATIO_MAX: f64 = 0.97;
/// Logits of the ratio over the highest: a twentieth to nearly all of it.
const LOGITS: [f64; 2] = [-3.0, 4.0];
/// Steps in a sample: half of those of a simulation, with an error far below any sensor's noise.
const SUBSTEPS: usize = 8;
/// Move of a coordinate for a derivative.
const DERIVATIVE_STEP: f64 = 1e-4;

/// A contact with its deviations.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct IdentifiedContact {
    /// The contact.
    #[serde(skip)]
    pub friction: ElastoplasticFriction,
    /// Coulomb force, N.
    pub coulomb_force_n: Measured,
    /// Stiffness, N/um.
    pub stiffness_n_um: Measured,
    /// Damping, N s/um.
    pub damping_n_s_um: Measured,
    /// Break-away ratio.
    pub breakaway_ratio: Measured,
    /// RMS of what it leaves, um.
    pub residual_um: f64,
    /// Logarithms of force, stiffness and damping, and the logit of the ratio.
    #[serde(skip)]
    pub(super) coordinates: [f64; 4],
    /// Their covariance.
    #[serde(skip)]
    pub(super) covariance: [[f64; 4]; 4],
}

#[cfg(test)]
impl IdentifiedContact {
    /// A contact without deviations.
    pub(super) fn known(friction: &ElastoplasticFriction) -> Self {
        let exact = |value| Measured { value, std: 0.0 };
        let ratio = friction.breakaway_ratio.unwrap_or(0.0);
        let [force, stiffness, damping] = [
            friction.coulomb_force_n,
            friction.stiffness_n_um,
            friction.damping_n_s_um,
        ];
        Self {
            friction: *friction,
            coulomb_force_n: exact(force),
            stiffness_n_um: exact(stiffness),
            damping_n_s_um: exact(damping),
            breakaway_ratio: exact(ratio),
            residual_um: 0.0,
            coordinates: [force.ln(), stiffness.ln(), damping.ln(), logit(ratio)],
            covariance: [[0.0; 4]; 4],
        }
    }
}

/// Drive and readings of the slider.
struct Recording<'a> {
    rig: &'a StickSlipActuator,
    force_um: Vec<f64>,
    reading_um: &'a [f64],
    sample_rate_hz: f64,
    /// The break-away ratio stays where it is.
    ratio_is_held: bool,
}

pub(super) fn friction_at(at: &[f64; 4]) -> ElastoplasticFriction {
    ElastoplasticFriction {
        coulomb_force_n: at[0].exp(),
        stiffness_n_um: at[1].exp(),
        damping_n_s_um: at[2].exp(),
        breakaway_ratio: Some(RATIO_MAX / (1.0 + (-at[3]).exp())),
    }
}

impl Recording<'_> {
    fn modelled(&self, at: &[f64; 4]) -> Vec<f64> {
        let trial = StickSlipActuator {
            friction: friction_at(at),
            ..self.rig.clone()
        };
        let integrator = Integrator::default();
        trial
            .simulate_with(&self.force_um, self.sample_rate_hz, integrator, SUBSTEPS)
            .end_effector_um
    }

    fn residual(&self, at: &[f64; 4]) -> Vec<f64> {
        let modelled = self.modelled(at);
        self.reading_um
            .iter()
            .zip(modelled)
            .map(|(y, m)| y - m)
            .collect()
    }

    /// Derivatives of the modelled readings by central differences.
    fn derivatives(&self, at: &[f64; 4]) -> DMatrix<f64> {
        let mut columns = DMatrix::zeros(self.reading_um.len(), at.len());
        // A column of zeros: the damped step along it is zero.
        let free = at.len() - usize::from(self.ratio_is_held);
        for nth in 0..free {
            let moved = |by: f64| {
                let mut beside = *at;
                beside[nth] += by;
                self.modelled(&beside)
            };
            let (above, below) = (moved(DERIVATIVE_STEP), moved(-DERIVATIVE_STEP));
            for (row, (a, b)) in above.iter().zip(below).enumerate() {
                columns[(row, nth)] = (a - b) / (2.0 * DERIVATIVE_STEP);
            }
        }
        columns
    }
}

impl Problem for Recording<'_> {
    type Model = [f64; 4];

    fn cost(&self, at: &[f64; 4]) -> f64 {
        self.residual(at).iter().map(|r| r * r).sum()
    }

    fn linearised(&self, at: &[f64; 4]) -> (DMatrix<f64>, DVector<f64>) {
        (self.derivatives(at), DVector::from_vec(self.residual(at)))
    }

    fn moved(&self, at: &[f64; 4], step: &DVector<f64>) -> [f64; 4] {
        // No step takes a value beyond e^2 times where it was.
        let mut moved: [f64; 4] = std::array::from_fn(|nth| at[nth] + step[nth].clamp(-2.0, 2.0));
        moved[3] = moved[3].clamp(LOGITS[0], LOGITS[1]);
        moved
    }
}

/// A rig whose platform was identified without the slider; its contact is still to be identified.
///
/// # Errors
/// The model has no loops or no mode, or its drive does not begin at 0 V.
pub fn rig_on_platform(
    platform: &Model,
    platform_stiffness_n_um: f64,
    slider_kg: f64,
) -> Result<StickSlipActuator, String> {
    let model = required_model(platform)?;
    if model.drive_min_v != 0.0 {
        return Err(format!(
            "the platform's model begins at {} V; a stick-slip rig is simulated from 0 V on: record the platform so",
            model.drive_min_v
        ));
    }
    let mode = model.linear.first_mode;
    Ok(StickSlipActuator {
        hysteresis: Surfaces {
            g: model.g_um,
            r: model.r_um,
        },
        drive_range_v: model.drive_max_v,
        platform_stiffness_n_um,
        natural_frequency_rad_s: mode.natural_frequency_rad_s,
        damping_ratio: mode.damping_ratio,
        friction: friction_at(&[-3.0, -1.0, -8.0, 1.0]),
        end_effector_mass_kg: slider_kg,
        effects: RigEffects::default(),
    })
}

/// The coordinate of a break-away ratio.
fn logit(ratio: f64) -> f64 {
    -(RATIO_MAX / ratio - 1.0).ln()
}

/// So many of the places with the least cost, the least first.
fn cheapest(recording: &Recording, places: Vec<[f64; 4]>, count: usize) -> Vec<[f64; 4]> {
    let mut costs: Vec<(f64, [f64; 4])> = places
        .into_iter()
        .map(|at| (recording.cost(&at), at))
        .filter(|(cost, _)| cost.is_finite())
        .collect();
    costs.sort_by(|a, b| a.0.total_cmp(&b.0));
    costs.into_iter().take(count).map(|(_, at)| at).collect()
}

/// The contact of a rig, whose own is not looked at, from a recording that begins at rest.
///
/// # Errors
/// The recording does not determine the contact.
pub fn identify_contact(
    rig: &StickSlipActuator,
    drive_v: &[f64],
    reading_um: &[f64],
    sample_rate_hz: f64,
) -> Result<IdentifiedContact, String> {
    let mut recording = Recording {
        rig,
        force_um: rig.force_equivalent_um(drive_v),
        reading_um,
        sample_rate_hz,
        ratio_is_held: true,
    };
    let mass_kg = rig.end_effector_mass_kg;
    let mut guesses = Vec::new();
    for force in FORCES_M_S2 {
        for omega in FREQUENCIES_RAD_S {
            for damping_ratio in DAMPING_RATIOS {
                // m/s^2 and 1/s^2 in N and N/um.
                guesses.push([
                    (force * mass_kg).ln(),
                    (omega * omega * mass_kg * 1e-6).ln(),
                    (2.0 * damping_ratio * omega * mass_kg * 1e-6).ln(),
                    logit(BREAKAWAY_RATIOS[1]),
                ]);
            }
        }
    }
    let guesses = cheapest(&recording, guesses, REFINED);
    let with_ratios = guesses.iter().flat_map(|guess| {
        BREAKAWAY_RATIOS.map(|ratio| {
            let start = [guess[0], guess[1], guess[2], logit(ratio)];
            refined(&recording, &start, STEPS[0], FALL_ENOUGH)
        })
    });
    let starts = cheapest(&recording, with_ratios.collect(), REFINED_AGAIN);
    recording.ratio_is_held = false;
    let ends = starts
        .iter()
        .map(|start| refined(&recording, start, STEPS[1], FALL_ENOUGH));
    let at = *cheapest(&recording, ends.collect(), 1)
        .first()
        .ok_or("no contact follows the recording; check the slider's mass and the platform")?;
    let cost = recording.cost(&at);
    let columns = recording.derivatives(&at);
    let freedom = reading_um.len().saturating_sub(at.len()).max(1) as f64;
    let covariance = columns.tr_mul(&columns).try_inverse().ok_or(
        "the recording does not determine the contact: the slider must stick and slip in it",
    )? * (cost / freedom);
    let std = |nth: usize| covariance[(nth, nth)].max(0.0).sqrt();
    let friction = friction_at(&at);
    let of_logarithm = |nth: usize| Measured {
        value: at[nth].exp(),
        std: at[nth].exp() * std(nth),
    };
    let ratio = friction.breakaway_ratio.unwrap_or(0.0);
    Ok(IdentifiedContact {
        friction,
        coulomb_force_n: of_logarithm(0),
        stiffness_n_um: of_logarithm(1),
        damping_n_s_um: of_logarithm(2),
        breakaway_ratio: Measured {
            value: ratio,
            std: ratio * (1.0 - ratio / RATIO_MAX) * std(3),
        },
        residual_um: (cost / freedom).sqrt(),
        coordinates: at,
        covariance: std::array::from_fn(|a| std::array::from_fn(|b| covariance[(a, b)])),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use hysteron_sim::noise::WhiteNoise;
    use hysteron_sim::waveform;

    const FS: f64 = 20_000.0;
    const NOISE_UM: f64 = 0.01;

    #[test]
    fn contacts_are_found_within_their_deviations() {
        let mut pulls = Vec::new();
        for (seed, force, stiffness, ratio) in [(2, 1.3, 0.7, 0.6), (3, 0.7, 1.3, 0.85)] {
            let mut rig = StickSlipActuator::thesis(0.0635);
            rig.friction.coulomb_force_n *= force;
            rig.friction.stiffness_n_um *= stiffness;
            rig.friction.breakaway_ratio = Some(ratio);
            let drive_v = waveform::saw_tooth(FS, 60.0, 50.0, 1.0, 6);
            let mut noise = WhiteNoise::new(NOISE_UM, seed);
            let motion = rig.simulate(&drive_v, FS).end_effector_um;
            let reading_um: Vec<f64> = motion.iter().map(|y| y + noise.next_um()).collect();
            let known = StickSlipActuator::thesis(0.0635);
            let found = identify_contact(&known, &drive_v, &reading_um, FS).unwrap();
            println!("{found:?}");
            println!("planted {:?}", rig.friction);
            assert!(
                (found.residual_um - NOISE_UM).abs() < 0.05 * NOISE_UM,
                "{found:?}"
            );
            let truth = rig.friction;
            let values = [
                (found.coulomb_force_n, truth.coulomb_force_n),
                (found.stiffness_n_um, truth.stiffness_n_um),
                (found.damping_n_s_um, truth.damping_n_s_um),
                (found.breakaway_ratio, ratio),
            ];
            pulls.extend(values.map(|(found, truth)| (found.value - truth) / found.std));
        }
        let rms = crate::statistics::rms(&pulls);
        assert!(pulls.iter().all(|pull| pull.abs() < 4.0), "{pulls:?}");
        assert!((0.3..1.8).contains(&rms), "{pulls:?}");
    }
}
