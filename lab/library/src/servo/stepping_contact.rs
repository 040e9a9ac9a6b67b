//! The contact of a stick-slip drive, identified from saw-teeth: what is left once the platform is known.
//!
//! # How it works
//! The platform (loops, mode, stiffness) and the slider's mass are known. Force, stiffness and damping of the
//! contact are refined in their logarithms. The law is elastoplastic (thesis Ch. 3, Eqs. 2, 3), with a break-away
//! ratio in its logit, or Dahl's, without one. Each may have Stribeck's fall and a viscous force: Dahl's law with
//! both is LuGre's friction. Every [`Structure`] is fitted, and the data choose one by Schwarz's information
//! criterion. It counts only samples that are independent, by the residual's autocorrelation: an error of the
//! platform's model is no reason for a further value.
//!
//! The sum of squares has side valleys, in which the ratio runs to an end. So the best guesses of force, stiffness
//! and damping are refined at each of [`BREAKAWAY_RATIOS`] first, and all four values only from the best of
//! these. Standard deviations are those of the asymptotic covariance, for noise of the size of the residual.

use super::model::required_model;
use crate::least_squares::{Problem, refined};
use crate::parallel;
use crate::spectrum::autocorrelation;
use crate::stepping::Measured;
use hysteron_sim::block::Play;
use hysteron_sim::chain::Model;
use hysteron_sim::effect::play_operators;
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
/// The fall that ends a refinement which only compares structures.
const FALL_TO_COMPARE: f64 = 1e-3;
/// Highest break-away ratio: beyond it the transition is too short for the integrator's step.
const RATIO_MAX: f64 = 0.97;
/// Logits of the ratio over the highest: a twentieth to nearly all of it.
const LOGITS: [f64; 2] = [-3.0, 4.0];
/// Stribeck's share, its velocities, um/s, and viscosity, N s/um, that are guessed.
const STRIBECK_SHARE: f64 = 0.2;
const STRIBECK_UM_S: [f64; 2] = [400.0, 3000.0];
const VISCOSITY_N_S_UM: f64 = 1e-6;
/// Least and greatest value of each.
const LIMITS: [[f64; 2]; 3] = [[1e-4, 2.0], [20.0, 3e4], [1e-10, 1e-3]];
/// Steps in a sample: half of those of a simulation, with an error far below any sensor's noise.
const SUBSTEPS: usize = 8;
/// Move of a coordinate for a derivative.
const DERIVATIVE_STEP: f64 = 1e-4;

/// Values of a contact: force, stiffness, damping, break-away ratio, share and velocity of Stribeck's fall, and
/// viscosity.
const VALUES: usize = 7;
const RATIO: usize = 3;
const STRIBECK: usize = 4;
const VISCOSITY: usize = 6;

/// What the law of a contact has beside force, stiffness and damping.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Structure {
    breakaway: bool,
    stribeck: bool,
    viscosity: bool,
}

impl Structure {
    const ELASTOPLASTIC: Self = Self {
        breakaway: true,
        stribeck: false,
        viscosity: false,
    };
    const DAHL: Self = Self {
        breakaway: false,
        ..Self::ELASTOPLASTIC
    };

    /// The places of its values.
    fn values(self) -> Vec<usize> {
        let has = |nth: &usize| match *nth {
            RATIO => self.breakaway,
            VISCOSITY => self.viscosity,
            nth => nth < RATIO || self.stribeck,
        };
        (0..VALUES).filter(has).collect()
    }
}

/// Logarithms of two limits, so that the value of either is within them whatever the rounding.
fn logarithms_within([least, most]: [f64; 2]) -> [f64; 2] {
    let (mut low, mut high) = (least.ln(), most.ln());
    while low.exp() < least {
        low = low.next_up();
    }
    while high.exp() > most {
        high = high.next_down();
    }
    [low, high]
}

/// A contact by its coordinates: logarithms of its values, for the ratio a logit.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Contact {
    structure: Structure,
    at: [f64; VALUES],
}

impl Contact {
    /// Its law.
    fn friction(&self) -> ElastoplasticFriction {
        ElastoplasticFriction {
            coulomb_force_n: self.at[0].exp(),
            stiffness_n_um: self.at[1].exp(),
            damping_n_s_um: self.at[2].exp(),
            breakaway_ratio: (self.structure.breakaway)
                .then(|| RATIO_MAX / (1.0 + (-self.at[RATIO]).exp())),
        }
    }

    fn on(&self, rig: &StickSlipActuator) -> StickSlipActuator {
        let mut rig = rig.clone();
        rig.friction = self.friction();
        if self.structure.stribeck {
            rig.effects.stribeck_share = self.at[STRIBECK].exp();
            rig.effects.stribeck_velocity_um_s = self.at[STRIBECK + 1].exp();
        }
        if self.structure.viscosity {
            rig.effects.contact_viscosity_n_s_um = self.at[VISCOSITY].exp();
        }
        rig
    }
}

/// A contact with its deviations, of the values that its law has.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct IdentifiedContact {
    /// Coulomb force, N.
    pub coulomb_force_n: Measured,
    /// Stiffness, N/um.
    pub stiffness_n_um: Measured,
    /// Damping, N s/um.
    pub damping_n_s_um: Measured,
    /// Break-away ratio; Dahl's law has none.
    pub breakaway_ratio: Option<Measured>,
    /// Friction at rest above that of sliding.
    pub stribeck_share: Option<Measured>,
    /// Velocity at which that has fallen to 1/e, um/s.
    pub stribeck_velocity_um_s: Option<Measured>,
    /// Viscous friction between platform and slider, N s/um.
    pub contact_viscosity_n_s_um: Option<Measured>,
    /// RMS of what it leaves, um.
    pub residual_um: f64,
    #[serde(skip)]
    contact: Contact,
    /// Covariance of the coordinates that it has.
    #[serde(skip)]
    pub(super) covariance: DMatrix<f64>,
}

impl IdentifiedContact {
    fn new(contact: Contact, residual_um: f64, covariance: DMatrix<f64>) -> Self {
        let values = contact.structure.values();
        let measured = |nth: usize| {
            let of_covariance = values.iter().position(|value| *value == nth)?;
            let std = covariance[(of_covariance, of_covariance)].max(0.0).sqrt();
            let (value, slope) = match (nth, contact.friction().breakaway_ratio) {
                (RATIO, Some(ratio)) => (ratio, ratio * (1.0 - ratio / RATIO_MAX)),
                _ => (contact.at[nth].exp(), contact.at[nth].exp()),
            };
            Some(Measured {
                value,
                std: slope * std,
            })
        };
        let of_all = |nth: usize| measured(nth).unwrap_or_default();
        Self {
            coulomb_force_n: of_all(0),
            stiffness_n_um: of_all(1),
            damping_n_s_um: of_all(2),
            breakaway_ratio: measured(RATIO),
            stribeck_share: measured(STRIBECK),
            stribeck_velocity_um_s: measured(STRIBECK + 1),
            contact_viscosity_n_s_um: measured(VISCOSITY),
            residual_um,
            contact,
            covariance,
        }
    }

    /// The rig with this contact.
    #[must_use]
    pub fn on(&self, rig: &StickSlipActuator) -> StickSlipActuator {
        self.contact.on(rig)
    }

    /// The rig with this contact, of whose coordinates one is moved.
    pub(super) fn moved_on(
        &self,
        rig: &StickSlipActuator,
        nth: usize,
        by: f64,
    ) -> StickSlipActuator {
        let mut contact = self.contact;
        contact.at[contact.structure.values()[nth]] += by;
        contact.on(rig)
    }

    /// A contact without deviations.
    #[cfg(test)]
    pub(super) fn known(friction: &ElastoplasticFriction) -> Self {
        let mut at = [0.0; VALUES];
        at[0] = friction.coulomb_force_n.ln();
        at[1] = friction.stiffness_n_um.ln();
        at[2] = friction.damping_n_s_um.ln();
        at[RATIO] = friction.breakaway_ratio.map_or(0.0, logit);
        let structure = Structure {
            breakaway: friction.breakaway_ratio.is_some(),
            ..Structure::DAHL
        };
        let contact = Contact { structure, at };
        let values = structure.values().len();
        Self::new(contact, 0.0, DMatrix::zeros(values, values))
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

impl Recording<'_> {
    fn modelled(&self, contact: &Contact) -> Vec<f64> {
        contact
            .on(self.rig)
            .simulate_with(
                &self.force_um,
                self.sample_rate_hz,
                Integrator::default(),
                SUBSTEPS,
            )
            .end_effector_um
    }

    fn residual(&self, contact: &Contact) -> Vec<f64> {
        let modelled = self.modelled(contact);
        self.reading_um
            .iter()
            .zip(modelled)
            .map(|(y, m)| y - m)
            .collect()
    }

    /// The values that are free.
    fn free(&self, contact: &Contact) -> Vec<usize> {
        let mut free = contact.structure.values();
        free.retain(|nth| *nth != RATIO || !self.ratio_is_held);
        free
    }

    /// Derivatives of the modelled readings by central differences.
    fn derivatives(&self, contact: &Contact) -> DMatrix<f64> {
        let free = self.free(contact);
        let mut columns = DMatrix::zeros(self.reading_um.len(), free.len());
        for (column, nth) in free.into_iter().enumerate() {
            let moved = |by: f64| {
                let mut beside = *contact;
                beside.at[nth] += by;
                self.modelled(&beside)
            };
            let (above, below) = (moved(DERIVATIVE_STEP), moved(-DERIVATIVE_STEP));
            for (row, (a, b)) in above.iter().zip(below).enumerate() {
                columns[(row, column)] = (a - b) / (2.0 * DERIVATIVE_STEP);
            }
        }
        columns
    }

    /// The cheapest of what places are refined to.
    fn best(&self, starts: &[Contact], steps: usize, fall_enough: f64) -> Option<Contact> {
        let ends = parallel::map(starts, |start| refined(self, start, steps, fall_enough));
        cheapest(self, ends, 1).pop()
    }
}

impl Problem for Recording<'_> {
    type Model = Contact;

    fn cost(&self, contact: &Contact) -> f64 {
        self.residual(contact).iter().map(|r| r * r).sum()
    }

    fn linearised(&self, contact: &Contact) -> (DMatrix<f64>, DVector<f64>) {
        let residual = DVector::from_vec(self.residual(contact));
        (self.derivatives(contact), residual)
    }

    fn moved(&self, contact: &Contact, step: &DVector<f64>) -> Contact {
        let mut moved = *contact;
        for (nth, by) in self.free(contact).into_iter().zip(step) {
            // No step takes a value beyond e^2 times where it was.
            moved.at[nth] += by.clamp(-2.0, 2.0);
            let limits = match nth {
                RATIO => Some(LOGITS),
                nth => nth
                    .checked_sub(STRIBECK)
                    .map(|nth| logarithms_within(LIMITS[nth])),
            };
            if let Some([least, most]) = limits {
                moved.at[nth] = moved.at[nth].clamp(least, most);
            }
        }
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
    let of_plays = platform.values(play_operators::ID).unwrap_or_default();
    let plays = of_plays.chunks_exact(2).map(|pair| Play {
        threshold: pair[1],
        weight: pair[0],
    });
    // The rig has them beside its surfaces, not in them.
    let mut without_plays = platform.clone();
    without_plays.effects.retain(|e| e.id != play_operators::ID);
    let model = required_model(&without_plays)?;
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
        plays: plays.collect(),
        drive_range_v: model.drive_max_v,
        platform_stiffness_n_um,
        natural_frequency_rad_s: mode.natural_frequency_rad_s,
        damping_ratio: mode.damping_ratio,
        friction: ElastoplasticFriction {
            coulomb_force_n: 0.05,
            stiffness_n_um: 0.4,
            damping_n_s_um: 3e-4,
            breakaway_ratio: None,
        },
        end_effector_mass_kg: slider_kg,
        effects: RigEffects::default(),
    })
}

/// The coordinate of a break-away ratio.
fn logit(ratio: f64) -> f64 {
    -(RATIO_MAX / ratio - 1.0).ln()
}

/// So many of the places with the least cost, the least first.
fn cheapest(recording: &Recording, places: Vec<Contact>, count: usize) -> Vec<Contact> {
    let mut costs: Vec<(f64, Contact)> = places
        .into_iter()
        .map(|at| (recording.cost(&at), at))
        .filter(|(cost, _)| cost.is_finite())
        .collect();
    costs.sort_by(|a, b| a.0.total_cmp(&b.0));
    costs.into_iter().take(count).map(|(_, at)| at).collect()
}

/// Samples that are independent, by the autocorrelation of a residual up to where it is chance.
fn independent_samples(residual: &[f64]) -> f64 {
    let samples = residual.len() as f64;
    let like = autocorrelation(residual);
    let chance = 2.0 / samples.sqrt();
    let correlated = like.iter().skip(1).take_while(|at| **at > chance);
    samples / (1.0 + 2.0 * correlated.sum::<f64>())
}

/// The best contact of every structure, the plain laws first, each begun at the plain one of its law.
fn of_every_structure(recording: &mut Recording) -> Vec<Contact> {
    let mass_kg = recording.rig.end_effector_mass_kg;
    let mut guesses = Vec::new();
    for force in FORCES_M_S2 {
        for omega in FREQUENCIES_RAD_S {
            for damping_ratio in DAMPING_RATIOS {
                // m/s^2 and 1/s^2 in N and N/um.
                guesses.push(Contact {
                    structure: Structure::ELASTOPLASTIC,
                    at: [
                        (force * mass_kg).ln(),
                        (omega * omega * mass_kg * 1e-6).ln(),
                        (2.0 * damping_ratio * omega * mass_kg * 1e-6).ln(),
                        logit(BREAKAWAY_RATIOS[1]),
                        STRIBECK_SHARE.ln(),
                        STRIBECK_UM_S[0].ln(),
                        VISCOSITY_N_S_UM.ln(),
                    ],
                });
            }
        }
    }
    recording.ratio_is_held = true;
    let guesses = cheapest(recording, guesses, REFINED);
    let with_ratios: Vec<Contact> = (guesses.iter())
        .flat_map(|guess| {
            BREAKAWAY_RATIOS.map(|ratio| {
                let mut start = *guess;
                start.at[RATIO] = logit(ratio);
                start
            })
        })
        .collect();
    let held = parallel::map(&with_ratios, |start| {
        refined(&*recording, start, STEPS[0], FALL_ENOUGH)
    });
    let elastoplastic = cheapest(recording, held, REFINED_AGAIN);
    let dahl = elastoplastic.iter().chain(&guesses).map(|start| Contact {
        structure: Structure::DAHL,
        ..*start
    });
    let dahl: Vec<Contact> = dahl.collect();
    recording.ratio_is_held = false;
    let plain = [elastoplastic, dahl].map(|starts| recording.best(&starts, STEPS[1], FALL_ENOUGH));
    let mut all: Vec<Contact> = plain.into_iter().flatten().collect();
    for plain in all.clone() {
        for (stribeck, viscosity) in [(false, true), (true, false), (true, true)] {
            let starts = STRIBECK_UM_S.map(|velocity_um_s| {
                let mut start = plain;
                start.structure.stribeck = stribeck;
                start.structure.viscosity = viscosity;
                start.at[STRIBECK + 1] = velocity_um_s.ln();
                start
            });
            let starts = &starts[..if stribeck { starts.len() } else { 1 }];
            all.extend(recording.best(starts, STEPS[0], FALL_TO_COMPARE));
        }
    }
    all
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
    let contacts = of_every_structure(&mut recording);
    let closest = *cheapest(&recording, contacts.clone(), 1)
        .first()
        .ok_or("no contact follows the recording; check the slider's mass and the platform")?;
    let independent = independent_samples(&recording.residual(&closest));
    let criterion = |contact: &Contact| {
        let values = contact.structure.values().len() as f64;
        independent * recording.cost(contact).ln() + values * independent.ln()
    };
    let contact = (contacts.iter())
        .min_by(|a, b| criterion(a).total_cmp(&criterion(b)))
        .copied()
        .unwrap_or(closest);
    let contact = refined(&recording, &contact, STEPS[1], FALL_ENOUGH);
    let columns = recording.derivatives(&contact);
    let freedom = reading_um.len().saturating_sub(columns.ncols()).max(1) as f64;
    let variance = recording.cost(&contact) / freedom;
    let covariance = columns.tr_mul(&columns).try_inverse().ok_or(
        "the recording does not determine the contact: the slider must stick and slip in it",
    )? * variance;
    Ok(IdentifiedContact::new(contact, variance.sqrt(), covariance))
}

#[cfg(test)]
mod tests {
    use super::*;
    use hysteron_sim::noise::WhiteNoise;
    use hysteron_sim::waveform;

    const FS: f64 = 20_000.0;
    const NOISE_UM: f64 = 0.01;

    /// The contact of this rig, and its values over their deviations.
    fn found(rig: &StickSlipActuator, seed: u64) -> (IdentifiedContact, Vec<f64>) {
        let drive_v = waveform::saw_tooth(FS, 60.0, 50.0, 1.0, 6);
        let mut noise = WhiteNoise::new(NOISE_UM, seed);
        let motion = rig.simulate(&drive_v, FS).end_effector_um;
        let reading_um: Vec<f64> = motion.iter().map(|y| y + noise.next_um()).collect();
        let known = StickSlipActuator::thesis(0.0635);
        let found = identify_contact(&known, &drive_v, &reading_um, FS).unwrap();
        println!("{found:?}");
        println!("planted {:?} {:?}", rig.friction, rig.effects);
        assert!(
            (found.residual_um - NOISE_UM).abs() < 0.05 * NOISE_UM,
            "{found:?}"
        );
        let (friction, effects) = (rig.friction, rig.effects);
        let of_effect = |value: f64| (value != 0.0).then_some(value);
        let pairs = [
            (Some(found.coulomb_force_n), Some(friction.coulomb_force_n)),
            (Some(found.stiffness_n_um), Some(friction.stiffness_n_um)),
            (Some(found.damping_n_s_um), Some(friction.damping_n_s_um)),
            (found.breakaway_ratio, friction.breakaway_ratio),
            (found.stribeck_share, of_effect(effects.stribeck_share)),
            (
                found.stribeck_velocity_um_s,
                of_effect(effects.stribeck_velocity_um_s),
            ),
            (
                found.contact_viscosity_n_s_um,
                of_effect(effects.contact_viscosity_n_s_um),
            ),
        ];
        let pulls = pairs.into_iter().filter_map(|pair| match pair {
            (Some(found), Some(truth)) => Some((found.value - truth) / found.std),
            (found, truth) => {
                assert!(found.is_none() && truth.is_none(), "{found:?} {truth:?}");
                None
            }
        });
        let pulls = pulls.collect();
        (found, pulls)
    }

    #[test]
    fn a_value_at_a_limit_of_its_fit_is_within_it() {
        for limits in LIMITS {
            let [least, most] = logarithms_within(limits).map(f64::exp);
            assert!(limits[0] <= least && most <= limits[1], "{least} {most}");
            assert!(least < 1.000_001 * limits[0] && most > 0.999_999 * limits[1]);
        }
    }

    #[test]
    fn contacts_of_every_law_are_found_within_their_deviations() {
        let mut all = Vec::new();
        // Friction, stiffness, break-away ratio, Stribeck's share and viscosity.
        for (seed, force, stiffness, ratio, stribeck, viscosity) in [
            (2, 1.3, 0.7, Some(0.6), 0.0, 0.0),
            (3, 0.7, 1.3, Some(0.85), 0.0, 0.0),
            (4, 1.0, 1.0, None, 0.2, 1e-6),
            (5, 0.7, 1.3, None, 0.0, 0.0),
            (6, 1.3, 1.0, Some(0.7), 0.2, 0.0),
        ] {
            let mut rig = StickSlipActuator::thesis(0.0635);
            rig.friction.coulomb_force_n *= force;
            rig.friction.stiffness_n_um *= stiffness;
            rig.friction.breakaway_ratio = ratio;
            rig.effects.contact_viscosity_n_s_um = viscosity;
            if stribeck > 0.0 {
                rig.effects.stribeck_share = stribeck;
                rig.effects.stribeck_velocity_um_s = 400.0;
            }
            let (found, pulls) = found(&rig, seed);
            assert!(
                pulls.iter().all(|pull| pull.abs() < 4.0),
                "{found:?} {pulls:?}"
            );
            all.extend(pulls);
        }
        let rms = crate::statistics::rms(&all);
        assert!((0.3..1.8).contains(&rms), "{all:?}");
    }
}
