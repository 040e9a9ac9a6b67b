//! The load that stops a stick-slip drive: the force on its slider, against the teeth, at which they make no
//! way. It is simulated on the identified rig; its deviation is that of the contact.
//!
//! # How a load enters
//! A constant force on the slider is an acceleration `a` of its frame. Seen from a frame that moves with it, by
//! `s = a t^2 / 2`, the slider has no load, and the platform a force-equivalent displacement that is smaller by
//! `s + 2 zeta s' / omega + s'' / omega^2`. So the equations of the rig stay as they are.

use super::stepping_contact::IdentifiedContact;
use super::stepping_design::{TEETH, Tooth};
use crate::stepping::Measured;
use hysteron_sim::stick_slip::{Integrator, SUBSTEPS, StickSlipActuator};
use nalgebra::DVector;

/// Halvings of the interval between no load and the Coulomb force: to a thousandth of it.
const HALVINGS: usize = 10;
/// Move of a coordinate of the contact, and of the load by the Coulomb force, for a derivative.
const MOVE: f64 = 0.01;

/// Travel of a tooth against a load, um.
fn step_um(rig: &StickSlipActuator, load_n: f64, tooth: &Tooth, period_s: f64) -> f64 {
    let omega = rig.natural_frequency_rad_s;
    let acceleration = -load_n * 1e6 / rig.end_effector_mass_kg;
    let way = |t: f64| 0.5 * acceleration * t * t;
    let drive_v = tooth.drive_v(period_s, TEETH);
    let substep_s = period_s / SUBSTEPS as f64;
    let seen = |(k, um): (usize, f64)| {
        // In the middle of the step over which it is held.
        let t = (k as f64 + 0.5) * substep_s;
        let rate = 2.0 * rig.damping_ratio * acceleration * t / omega;
        um - way(t) - rate - acceleration / omega.powi(2)
    };
    let held = rig.force_equivalent_um(&drive_v).into_iter();
    let force_um: Vec<f64> = held
        .flat_map(|um| std::iter::repeat_n(um, SUBSTEPS))
        .enumerate()
        .map(seen)
        .collect();
    let integrator = Integrator::default();
    let slider_um = rig
        .simulate_with(&force_um, 1.0 / substep_s, integrator, 1)
        .end_effector_um;
    let length = slider_um.len() / TEETH;
    let at = |tooth: usize| {
        let k = tooth * length - 1;
        slider_um[k] + way(k as f64 * substep_s)
    };
    (at(TEETH) - at(TEETH / 3)) / (TEETH - TEETH / 3) as f64
}

/// The load that stops a rig, N; none if it does not step without one.
fn value(rig: &StickSlipActuator, tooth: &Tooth, period_s: f64) -> Option<f64> {
    let (mut low, mut high) = (0.0, rig.friction.coulomb_force_n);
    (step_um(rig, low, tooth, period_s) > 0.0).then_some(())?;
    for _ in 0..HALVINGS {
        let middle = 0.5 * (low + high);
        if step_um(rig, middle, tooth, period_s) > 0.0 {
            low = middle;
        } else {
            high = middle;
        }
    }
    Some(0.5 * (low + high))
}

/// The load that stops a rig of this contact, N, with the deviation that the contact makes; none if it does not
/// step without a load.
#[must_use]
pub fn load_that_stops(
    rig: &StickSlipActuator,
    contact: &IdentifiedContact,
    tooth: &Tooth,
    period_s: f64,
) -> Option<Measured> {
    let load_n = value(rig, tooth, period_s)?;
    let slope = |moved: &dyn Fn(f64) -> f64| (moved(MOVE) - moved(-MOVE)) / (2.0 * MOVE);
    let force_n = rig.friction.coulomb_force_n;
    let by_load = slope(&|by| step_um(rig, load_n + by * force_n, tooth, period_s)) / force_n;
    // What keeps the travel at zero: d load = -(d step / d contact) / (d step / d load).
    let moved = |nth: usize, by: f64| {
        let beside = contact.moved_on(rig, nth, by);
        step_um(&beside, load_n, tooth, period_s)
    };
    let coordinates = contact.covariance.nrows();
    let by_contact = DVector::from_fn(coordinates, |nth, _| -slope(&|by| moved(nth, by)) / by_load);
    let variance = by_contact.dot(&(&contact.covariance * &by_contact));
    Some(Measured {
        value: load_n,
        std: variance.max(0.0).sqrt(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::servo::stepping_design::{SteppingDesign, SteppingOrder};

    const PERIOD_S: f64 = 5e-5;

    /// The thesis' contact, with a deviation of 1 % of the Coulomb force alone.
    fn contact() -> IdentifiedContact {
        let friction = StickSlipActuator::thesis(0.0635).friction;
        let mut contact = IdentifiedContact::known(&friction);
        contact.covariance[(0, 0)] = 1e-4;
        contact
    }

    #[test]
    fn a_drive_moves_against_less_and_backwards_under_more() {
        let rig = StickSlipActuator::thesis(0.0635);
        let tooth = SteppingDesign::new(&rig, &SteppingOrder::default())
            .unwrap()
            .tooth;
        let free = step_um(&rig, 0.0, &tooth, PERIOD_S);
        assert!(
            (free / tooth.step_um - 1.0).abs() < 1e-3,
            "{free} {tooth:?}"
        );
        let load = load_that_stops(&rig, &contact(), &tooth, PERIOD_S).unwrap();
        println!("{load:?}, Coulomb force {}", rig.friction.coulomb_force_n);
        assert!(step_um(&rig, 0.95 * load.value, &tooth, PERIOD_S) > 0.0);
        assert!(step_um(&rig, 1.05 * load.value, &tooth, PERIOD_S) < 0.0);
        // A rig with 3 % more friction is stopped by as much more as the deviation says.
        let mut stronger = rig.clone();
        stronger.friction.coulomb_force_n *= 1.03;
        let more = value(&stronger, &tooth, PERIOD_S).unwrap() - load.value;
        assert!(
            (more / (3.0 * load.std) - 1.0).abs() < 0.2,
            "{more} {load:?}"
        );
    }
}
