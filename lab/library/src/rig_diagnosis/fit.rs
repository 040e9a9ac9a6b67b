//! The values of some effects of a rig, refined on its fitted readings.
//!
//! The contact of the start is known to about a percent, and recordings show a ten-thousandth. So every model
//! that is compared may move the values of the contact within [`CONTACT_MOVES`] deviations: what is inside is
//! no finding.

use super::recordings::{Reading, RigData, RigResiduals, mean_square, remove_mean};
use crate::least_squares::{Problem, refined};
use crate::stepping::Measured;
use hysteron_sim::rig_effects::{GRAVITY_M_S2, RIG_EFFECTS, RigEffects, RigParameter};
use hysteron_sim::stick_slip::StickSlipActuator;
use nalgebra::{DMatrix, DVector};

/// Steps of a refinement, and the fall of the cost that ends it.
const STEPS: usize = 10;
const FALL_ENOUGH: f64 = 3e-4;
/// Move of an effect's value for a derivative, in its usual size, and of a contact's value, in its deviation:
/// about as large.
const DERIVATIVE_STEP: f64 = 2e-3;
const CONTACT_STEP: f64 = 0.05;
/// Longest step of a value, in its usual size.
const LONGEST_STEP: f64 = 20.0;
/// Sizes of the guesses from which the best one is refined.
const SIZES: [f64; 2] = [0.5, 2.0];
/// Values of the contact: force, stiffness, damping, the break-away ratio, share and velocity of Stribeck's
/// fall, viscosity, and by how much more the friction holds in one direction than in the other, of the force.
/// The ratio moves as such, the others as relative changes.
const CONTACT_VALUES: usize = 8;
/// Deviation of each, as the guide's recordings leave it: those of the friction's fall and rise with the
/// velocity trade off.
const CONTACT_STD: [f64; CONTACT_VALUES] = [0.01, 0.01, 0.01, 0.01, 0.1, 0.1, 0.1, 0.01];
/// How many of them a value may move.
const CONTACT_MOVES: f64 = 3.0;
/// Highest break-away ratio that is simulated.
const RATIO_MAX: f64 = 0.97;

/// What is free in a rig.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RigValues {
    /// The effects.
    pub effects: RigEffects,
    /// Changes of the contact's values.
    pub contact: [f64; CONTACT_VALUES],
}

/// A rig with some values free.
pub struct RigFit<'a> {
    /// What is fitted.
    pub data: &'a RigData,
    /// The rig that the search begins with.
    pub start: &'a StickSlipActuator,
    /// The values of effects that are free.
    free: Vec<&'static RigParameter>,
    /// The values of the contact that may move too.
    contact: Vec<usize>,
}

fn is_fitted(reading: &Reading) -> bool {
    !reading.held_out
}

impl<'a> RigFit<'a> {
    /// With the values of these effects free, by their places in [`RIG_EFFECTS`].
    #[must_use]
    pub fn new(data: &'a RigData, start: &'a StickSlipActuator, effects: &[usize]) -> Self {
        let free = effects.iter().flat_map(|nth| RIG_EFFECTS[*nth].parameters);
        Self {
            data,
            start,
            free: free.collect(),
            contact: Vec::new(),
        }
    }

    /// The same with the values of the contact that the start has free, as far as it leaves them open.
    #[must_use]
    pub fn with_contact(self) -> Self {
        let (friction, effects) = (self.start.friction, self.start.effects);
        let has = |nth: &usize| match nth {
            3 => friction.breakaway_ratio.is_some(),
            4 | 5 => effects.stribeck_share != 0.0,
            6 => effects.contact_viscosity_n_s_um != 0.0,
            _ => true,
        };
        let contact = (0..CONTACT_VALUES).filter(has).collect();
        Self { contact, ..self }
    }

    /// The rig with other values.
    #[must_use]
    pub fn rig(&self, at: &RigValues) -> StickSlipActuator {
        let mut rig = self.start.clone();
        let [
            force,
            stiffness,
            damping,
            ratio,
            share,
            velocity,
            viscosity,
            one_way,
        ] = at.contact;
        let friction = &mut rig.friction;
        friction.coulomb_force_n *= 1.0 + force;
        friction.stiffness_n_um *= 1.0 + stiffness;
        friction.damping_n_s_um *= 1.0 + damping;
        if let Some(of_start) = &mut friction.breakaway_ratio {
            *of_start = (*of_start + ratio).clamp(0.0, RATIO_MAX.max(*of_start));
        }
        rig.effects = at.effects;
        rig.effects.stribeck_share *= 1.0 + share;
        rig.effects.stribeck_velocity_um_s *= 1.0 + velocity;
        rig.effects.contact_viscosity_n_s_um *= 1.0 + viscosity;
        // As the slope that pulls so much.
        let weight_n = rig.end_effector_mass_kg * GRAVITY_M_S2;
        let pull_n = one_way * rig.friction.coulomb_force_n;
        rig.effects.tilt_rad += (pull_n / weight_n).clamp(-1.0, 1.0).asin();
        rig
    }

    fn residuals(&self, at: &RigValues) -> RigResiduals {
        self.data.residuals(&self.rig(at), &is_fitted)
    }

    /// The best of the guesses at an effect beside other values, and its cost.
    #[must_use]
    pub fn guessed(&self, from: &RigValues, newest: usize) -> (f64, RigValues) {
        let effect = &RIG_EFFECTS[newest];
        let strength = &effect.parameters[0];
        let guesses = (0..strength.guesses.len()).flat_map(|guess| {
            SIZES.map(|size| {
                let mut at = *from;
                *(strength.place)(&mut at.effects) += size * strength.guesses[guess];
                for further in &effect.parameters[1..] {
                    *(further.place)(&mut at.effects) = further.guesses[guess];
                }
                for parameter in effect.parameters {
                    let value = (parameter.place)(&mut at.effects);
                    *value = value.clamp(parameter.range[0], parameter.range[1]);
                }
                at
            })
        });
        let costs = guesses.map(|guess| (self.cost(&guess), guess));
        let best = costs.min_by(|a, b| a.0.total_cmp(&b.0));
        best.unwrap_or((f64::INFINITY, *from))
    }

    /// The values refined from where they are.
    #[must_use]
    pub fn refined(&self, from: &RigValues) -> RigValues {
        refined(self, from, STEPS, FALL_ENOUGH)
    }

    /// The free values of effects with the deviations that the fitted readings leave them, in their order.
    #[must_use]
    pub fn values(&self, at: &RigValues) -> Vec<(&'static RigParameter, Measured)> {
        let (columns, residual) = self.linearised(at);
        let freedom = residual.len().saturating_sub(columns.ncols()).max(1) as f64;
        let variance = (residual.norm_squared() / freedom).max(1.0);
        let covariance = columns.tr_mul(&columns).try_inverse();
        let std = |nth: usize| {
            covariance.as_ref().map_or(f64::INFINITY, |c| {
                (c[(nth, nth)] * variance).max(0.0).sqrt()
            })
        };
        let free = self.free.iter().enumerate();
        free.map(|(nth, parameter)| {
            let measured = Measured {
                value: parameter.value(&self.rig(at).effects),
                std: parameter.guesses[0].abs() * std(nth),
            };
            (*parameter, measured)
        })
        .collect()
    }

    /// A free value stands at an end of what its physics allows, or the effect's strength at zero.
    #[must_use]
    pub fn is_at_an_end(&self, at: &RigValues) -> bool {
        self.free.iter().any(|parameter| {
            let (value, [least, most]) = (parameter.value(&at.effects), parameter.range);
            let near = 1e-3 * parameter.guesses[0].abs();
            value >= most - near || value <= least + near
        })
    }

    /// How many values of effects are free.
    #[must_use]
    pub fn free_values(&self) -> usize {
        self.free.len()
    }

    fn coordinates(&self) -> usize {
        self.free.len() + self.contact.len()
    }

    /// Usual size and range of a coordinate.
    fn size_and_range(&self, nth: usize) -> (f64, [f64; 2]) {
        self.free.get(nth).map_or_else(
            || {
                let std = CONTACT_STD[self.contact[nth - self.free.len()]];
                (std, [-CONTACT_MOVES * std, CONTACT_MOVES * std])
            },
            |parameter| (parameter.guesses[0].abs(), parameter.range),
        )
    }

    fn place<'v>(&self, at: &'v mut RigValues, nth: usize) -> &'v mut f64 {
        match self.free.get(nth) {
            Some(parameter) => (parameter.place)(&mut at.effects),
            None => &mut at.contact[self.contact[nth - self.free.len()]],
        }
    }

    /// Signals of all readings in their units, one after the other, less their constants.
    fn in_units(&self, signals: Vec<Vec<f64>>) -> Vec<f64> {
        let each = signals
            .into_iter()
            .enumerate()
            .flat_map(|(nth, mut signal)| {
                remove_mean(&mut signal);
                let unit_um = self.data.unit_um(nth);
                signal.into_iter().map(move |um| um / unit_um)
            });
        each.collect()
    }
}

impl Problem for RigFit<'_> {
    type Model = RigValues;

    fn cost(&self, at: &RigValues) -> f64 {
        let residuals = self.residuals(at);
        let squares = residuals.iter().enumerate().map(|(nth, left)| {
            mean_square(left) * left.len() as f64 / self.data.unit_um(nth).powi(2)
        });
        let moved = at
            .contact
            .iter()
            .zip(CONTACT_STD)
            .map(|(by, std)| (by / std).powi(2));
        let cost = squares.sum::<f64>() + moved.sum::<f64>();
        if cost.is_finite() {
            cost
        } else {
            f64::INFINITY
        }
    }

    fn linearised(&self, at: &RigValues) -> (DMatrix<f64>, DVector<f64>) {
        let here = self.in_units(self.data.modelled(&self.rig(at), &is_fitted));
        let samples = here.len();
        let mut residual = self.in_units(self.residuals(at));
        let of_contact = self.contact.iter();
        residual.extend(of_contact.map(|nth| -at.contact[*nth] / CONTACT_STD[*nth]));
        let mut columns = DMatrix::zeros(residual.len(), self.coordinates());
        for nth in 0..self.coordinates() {
            let (size, [least, most]) = self.size_and_range(nth);
            let mut beside = *at;
            let value = self.place(&mut beside, nth);
            let from = *value;
            let of_effect = nth < self.free.len();
            let step = size
                * if of_effect {
                    DERIVATIVE_STEP
                } else {
                    CONTACT_STEP
                };
            // Away from the end at which it may stand.
            *value = if from + step > most {
                from - step
            } else {
                from + step
            }
            .max(least);
            let by = *value - from;
            let moved = self.in_units(self.data.modelled(&self.rig(&beside), &is_fitted));
            for (row, (there, here)) in moved.iter().zip(&here).enumerate() {
                columns[(row, nth)] = (there - here) * size / by;
            }
            if nth >= self.free.len() {
                columns[(samples + nth - self.free.len(), nth)] = 1.0;
            }
        }
        (columns, DVector::from_vec(residual))
    }

    fn moved(&self, at: &RigValues, step: &DVector<f64>) -> RigValues {
        let mut moved = *at;
        for nth in 0..self.coordinates() {
            let (size, [least, most]) = self.size_and_range(nth);
            let value = self.place(&mut moved, nth);
            let by = step[nth].clamp(-LONGEST_STEP, LONGEST_STEP) * size;
            *value = (*value + by).clamp(least, most);
        }
        moved
    }
}
