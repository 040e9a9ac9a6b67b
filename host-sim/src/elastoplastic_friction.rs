//! Elastoplastic friction of two surfaces in presliding (thesis Ch. 3, Eqs. 1-6; Dupont, Hayward, Armstrong
//! and Altpeter, IEEE Trans. Autom. Control 47 (2002) 787-792).
//!
//! The relative motion is split into an elastic part `z`, the bend of a bristle, and a plastic part. Up to
//! the break-away displacement `z_b` all motion is elastic, so that a load that vibrates does not creep
//! away; at `z_s` all of it is plastic and the force is the Coulomb friction. Without an elastic range, with
//! `alpha = 1` throughout, the law is Dahl's: plastic from the first motion on.
//! [`ElastoplasticFriction::bend_rate`] is the law in time, for the contact of the stick-slip actuator;
//! [`ElastoplasticFriction::bend_after`] is the same law over a given motion without time, for the friction
//! of a guide in the chain of effects ([`crate::effect::friction`]).

use std::f64::consts::PI;

/// A friction contact.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ElastoplasticFriction {
    /// Contact stiffness `sigma_0`, N/um.
    pub stiffness_n_um: f64,
    /// Damping of the tangential compliance `sigma_1`, N s/um.
    pub damping_n_s_um: f64,
    /// Coulomb friction `F_c`, N.
    pub coulomb_force_n: f64,
    /// Break-away displacement over the bend in steady sliding, `z_b / z_s`, from zero to below one; none is
    /// Dahl's law.
    pub breakaway_ratio: Option<f64>,
}

/// `exp(-x)` for `x` from zero on: a series where it is as good as the function itself, nothing where nothing
/// is left. The terms of the series are taken in pairs, which do not wait for one another.
#[inline]
fn dying(x: f64) -> f64 {
    if x < 0.125 {
        let x2 = x * x;
        let x4 = x2 * x2;
        let first = (1.0 - x) + x2 * (1.0 / 2.0 - x * (1.0 / 6.0));
        let second = (1.0 / 24.0 - x * (1.0 / 120.0)) + x2 * (1.0 / 720.0 - x * (1.0 / 5040.0));
        (first + x4 * x4 * (1.0 / 40320.0)) + x4 * second
    } else if x > 40.0 {
        0.0
    } else {
        (-x).exp()
    }
}

/// Dahl's law: plastic from the first motion on, so that the bend after a motion is known in closed form.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Dahl {
    sliding_bend_um: f64,
    per_sliding_bend: f64,
}

/// Share of its bend in steady sliding within which a bristle slides: what it still bends is a hundredth of
/// what any sensor sees.
pub const SLIDES_WITHIN: f64 = 1e-5;
/// Steps towards a balance, at most: three reach it from anywhere.
pub(crate) const BALANCING_STEPS_MAX: usize = 6;
/// A step that is so short a part of the bend in steady sliding is the last: what a step of third order
/// leaves is the cube of it.
pub(crate) const LAST_STEP_OF_SLIDING_BEND: f64 = 1e-3;

impl Dahl {
    /// The law of a bristle that bends so far in steady sliding, um; of none, with zero.
    #[must_use]
    pub fn with_sliding_bend(sliding_bend_um: f64) -> Self {
        Self {
            sliding_bend_um: sliding_bend_um.max(0.0),
            per_sliding_bend: if sliding_bend_um > 0.0 {
                1.0 / sliding_bend_um
            } else {
                f64::MAX
            },
        }
    }

    /// Bend after a motion, um.
    #[inline]
    #[must_use]
    pub fn bend_after(&self, bend_um: f64, travel_um: f64) -> f64 {
        let towards_um = self.sliding_bend_um.copysign(travel_um);
        towards_um + (bend_um - towards_um) * dying(travel_um.abs() * self.per_sliding_bend)
    }

    /// Motion by which a spring of unit stiffness and the bristle beside it take up an imbalance, and the
    /// bend after it, all in um; `stiffness` is that of the bristle.
    ///
    /// Towards the imbalance `m + S (1 - exp(-m / z_s)) = c`, with `S` what the bristle can still take on.
    /// Both a bristle that goes on bending as it does now and one that slides give too short a motion; from
    /// the longer one, the first with its curvature, steps of third order.
    #[inline]
    #[must_use]
    pub fn balanced(&self, stiffness: f64, bend_um: f64, unbalanced_um: f64) -> (f64, f64) {
        let direction = 1.0_f64.copysign(unbalanced_um);
        let imbalance_um = unbalanced_um.abs();
        let room_um = self.sliding_bend_um - direction * bend_um;
        let may_take_um = stiffness * room_um;
        // It slides, or as good as that.
        if room_um <= SLIDES_WITHIN * self.sliding_bend_um && imbalance_um > may_take_um {
            return (
                direction * (imbalance_um - may_take_um).max(0.0),
                direction * self.sliding_bend_um,
            );
        }
        let stiffness_now = may_take_um * self.per_sliding_bend;
        let per_slope_now = 1.0 / (1.0 + stiffness_now);
        // As it bends now, and a little more for its curvature.
        let straight_um = imbalance_um * per_slope_now;
        let curved_um = straight_um
            * (1.0 + 0.5 * straight_um * self.per_sliding_bend * stiffness_now * per_slope_now);
        let mut motion_um = curved_um.min(imbalance_um).max(imbalance_um - may_take_um);
        let mut left = 1.0;
        for _ in 0..BALANCING_STEPS_MAX {
            left = dying(motion_um * self.per_sliding_bend);
            let excess_um = motion_um + may_take_um * (1.0 - left) - imbalance_um;
            let slope = stiffness_now * left;
            let per_slope = 1.0 / (1.0 + slope);
            let newton_um = excess_um * per_slope;
            // The curvature of the bristle is `slope / z_s`, downward.
            let further_um =
                -newton_um * (1.0 - 0.5 * newton_um * slope * self.per_sliding_bend * per_slope);
            motion_um += further_um;
            // So short a way is a parabola.
            let further = further_um * self.per_sliding_bend;
            left *= 1.0 - further * (1.0 - 0.5 * further);
            if further_um.abs() < LAST_STEP_OF_SLIDING_BEND * self.sliding_bend_um {
                break;
            }
        }
        (
            direction * motion_um,
            direction * (self.sliding_bend_um - room_um * left),
        )
    }
}

impl ElastoplasticFriction {
    /// Bend in steady sliding `z_s = F_c / sigma_0`, um.
    #[inline]
    #[must_use]
    pub fn sliding_bend_um(&self) -> f64 {
        self.coulomb_force_n / self.stiffness_n_um
    }

    /// Share of the motion that is plastic, `alpha(z)` (Ch. 3, Eq. 4), for motion in the direction of
    /// `velocity`.
    ///
    /// The printed equation holds for positive `z`; by symmetry it is used with `|z|`.
    #[must_use]
    pub fn plastic_share(&self, bend_um: f64, velocity_um_s: f64) -> f64 {
        let Some(breakaway_ratio) = self.breakaway_ratio else {
            return 1.0;
        };
        if bend_um * velocity_um_s <= 0.0 {
            return 0.0;
        }
        let (sliding_um, size_um) = (self.sliding_bend_um(), bend_um.abs());
        let breakaway_um = breakaway_ratio * sliding_um;
        if size_um <= breakaway_um {
            0.0
        } else if size_um >= sliding_um {
            1.0
        } else {
            0.5 + 0.5
                * (PI * (size_um - 0.5 * (sliding_um + breakaway_um)) / (sliding_um - breakaway_um))
                    .sin()
        }
    }

    /// Elastic share of the motion, `dz/dx = 1 - alpha z / z_s`, and its derivative with respect to `z` in
    /// 1/um.
    #[must_use]
    pub fn elastic_share(&self, bend_um: f64, velocity_um_s: f64) -> (f64, f64) {
        let sliding_um = self.sliding_bend_um();
        let Some(breakaway_ratio) = self.breakaway_ratio else {
            let direction = if velocity_um_s < 0.0 { -1.0 } else { 1.0 };
            return (
                1.0 - direction * bend_um / sliding_um,
                -direction / sliding_um,
            );
        };
        let plastic = self.plastic_share(bend_um, velocity_um_s);
        if plastic == 0.0 {
            return (1.0, 0.0);
        }
        let size_um = bend_um.abs();
        let width_um = sliding_um * (1.0 - breakaway_ratio);
        let slope = if plastic < 1.0 && width_um > 0.0 {
            0.5 * PI / width_um * (PI * (size_um - sliding_um + 0.5 * width_um) / width_um).cos()
        } else {
            0.0
        };
        (
            1.0 - plastic * size_um / sliding_um,
            -bend_um.signum() * (slope * size_um + plastic) / sliding_um,
        )
    }

    /// Rate of the bend, um/s (Ch. 3, Eq. 3): `velocity` is that of the driving surface relative to the
    /// driven one.
    #[must_use]
    pub fn bend_rate(&self, bend_um: f64, velocity_um_s: f64) -> f64 {
        velocity_um_s * self.elastic_share(bend_um, velocity_um_s).0
    }

    /// Friction force on the driven surface, N (Ch. 3, Eq. 5; the viscous term is left out, as there).
    #[inline]
    #[must_use]
    pub fn force_n(&self, bend_um: f64, bend_rate_um_s: f64) -> f64 {
        self.stiffness_n_um * bend_um + self.damping_n_s_um * bend_rate_um_s
    }

    /// Bend after a motion of `travel_um`, fast or slow: the law without time, `dz = (1 - alpha z / z_s) dx`.
    ///
    /// Dahl's law and elastic travel are taken in closed form; the transition in steps that begin at a
    /// twentieth of its width.
    #[must_use]
    pub fn bend_after(&self, bend_um: f64, travel_um: f64) -> f64 {
        let sliding_um = self.sliding_bend_um();
        if travel_um == 0.0 || sliding_um <= 0.0 {
            return bend_um.clamp(-sliding_um.max(0.0), sliding_um.max(0.0));
        }
        let Some(breakaway_ratio) = self.breakaway_ratio else {
            return Dahl::with_sliding_bend(sliding_um).bend_after(bend_um, travel_um);
        };
        // Mirror so that the motion is upward.
        let direction = travel_um.signum();
        let (mut bend, mut left) = (bend_um * direction, travel_um.abs());
        let breakaway_um = breakaway_ratio.clamp(0.0, 1.0) * sliding_um;
        if bend < breakaway_um {
            let elastic = left.min(breakaway_um - bend);
            bend += elastic;
            left -= elastic;
        }
        let width_um = sliding_um - breakaway_um;
        if width_um <= 1e-9 * sliding_um {
            return direction * bend.min(sliding_um);
        }
        // Steps that grow with the way gone: the last of the bend comes over many z_s of travel. After twenty
        // it has arrived.
        let mut travelled_um = 0.0;
        let reach_um = left.min(20.0 * sliding_um);
        while travelled_um < reach_um && bend < sliding_um {
            let step_um = (0.05 * width_um + 0.1 * travelled_um).min(reach_um - travelled_um);
            let middle =
                bend + 0.5 * step_um * self.elastic_share(bend.max(f64::MIN_POSITIVE), 1.0).0;
            bend += step_um * self.elastic_share(middle.max(f64::MIN_POSITIVE), 1.0).0;
            travelled_um += step_um;
        }
        direction * bend.min(sliding_um)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CONTACT: ElastoplasticFriction = ElastoplasticFriction {
        stiffness_n_um: 0.482,
        damping_n_s_um: 2.73e-4,
        coulomb_force_n: 0.0362,
        breakaway_ratio: Some(0.801),
    };

    #[test]
    fn elastic_below_breakaway_and_coulomb_beyond() {
        let sliding = CONTACT.sliding_bend_um();
        assert_eq!(CONTACT.bend_rate(0.5 * sliding, 3.0), 3.0);
        assert!(CONTACT.bend_rate(sliding, 3.0).abs() < 1e-12);
        assert_eq!(
            CONTACT.bend_rate(sliding, -3.0),
            -3.0,
            "unloading is elastic"
        );
        assert!((CONTACT.force_n(CONTACT.bend_after(0.0, 10.0), 0.0) - 0.0362).abs() < 1e-6);
        assert!((CONTACT.force_n(CONTACT.bend_after(0.0, -10.0), 0.0) + 0.0362).abs() < 1e-6);
    }

    #[test]
    fn slope_of_the_elastic_share_is_its_derivative() {
        let sliding = CONTACT.sliding_bend_um();
        for (share, velocity) in [
            (0.82, 1.0),
            (0.9, 1.0),
            (0.97, 1.0),
            (-0.85, -1.0),
            (-0.95, -1.0),
        ] {
            let z = share * sliding;
            let numeric = (CONTACT.elastic_share(z + 1e-7, velocity).0
                - CONTACT.elastic_share(z - 1e-7, velocity).0)
                / 2e-7;
            let (_, slope) = CONTACT.elastic_share(z, velocity);
            assert!(
                (numeric - slope).abs() < 1e-3 * slope.abs(),
                "{share}: {numeric} {slope}"
            );
        }
    }

    #[test]
    fn what_dies_is_the_exponential_function() {
        for k in 0..4000 {
            let x = 1e-4 * f64::from(k);
            // The first term that is left out comes to 2e-14.
            assert!((dying(x) - (-x).exp()).abs() < 3e-14, "{x}");
        }
        assert_eq!(
            (
                Dahl::with_sliding_bend(0.0).bend_after(0.0, 0.0),
                Dahl::with_sliding_bend(0.0).bend_after(0.0, 3.0)
            ),
            (0.0, 0.0)
        );
    }

    #[test]
    fn spring_and_bristle_balance_where_bisection_says() {
        let dahl = Dahl::with_sliding_bend(0.1);
        for stiffness in [0.02, 1.0, 50.0] {
            for bend in [-0.1, -0.03, 0.0, 0.06, 0.0999, 0.1] {
                for unbalanced in [-3.0, -0.2, -1e-3, 1e-7, 0.004, 0.15, 8.0] {
                    let (motion, after) = dahl.balanced(stiffness, bend, unbalanced);
                    assert!(
                        (after - dahl.bend_after(bend, motion)).abs() < 1e-9,
                        "{stiffness} {bend} {unbalanced}: {motion} {after}"
                    );
                    let (mut low, mut high) = (0.0_f64.min(unbalanced), 0.0_f64.max(unbalanced));
                    for _ in 0..80 {
                        let middle = 0.5 * (low + high);
                        let taken = middle + stiffness * (dahl.bend_after(bend, middle) - bend);
                        if taken < unbalanced {
                            low = middle
                        } else {
                            high = middle
                        }
                    }
                    assert!(
                        (motion - low).abs() < 1e-9,
                        "{stiffness} {bend} {unbalanced}: {motion} {low}"
                    );
                }
            }
        }
    }

    #[test]
    fn the_law_without_time_is_the_law_in_time() {
        for contact in [
            CONTACT,
            ElastoplasticFriction {
                breakaway_ratio: None,
                ..CONTACT
            },
        ] {
            let mut bend = -0.03;
            let (velocity, dt, travel) = (40.0, 1e-7, 0.09);
            for _ in 0..(travel / velocity / dt) as usize {
                bend += dt * contact.bend_rate(bend, velocity);
            }
            assert!(
                (contact.bend_after(-0.03, travel) - bend).abs() < 1e-4 * contact.sliding_bend_um()
            );
        }
    }
}
