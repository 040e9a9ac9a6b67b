//! Inverse of creep, for a feedforward: what must be asked of the actuator so that, with its creep, it comes
//! to where it should be.
//!
//! # How it works
//! Creep adds slow answers to what the actuator did: `y = x + creep(x)`. Solved for `x` that is `x = y -
//! creep(x)`, with the same states: no search, and no inverse of a transfer function. The states follow what
//! was really applied, while the loop is open too, so that creep which is under way when the servo takes over
//! is undone as well.
//!
//! Creep is a sum of
//! * first-order terms, `share_i z_i`, where `z_i` follows `x` with the time constant `tau_i` (thesis Ch. 5,
//!   Eqs. 13 and 17). A term with a threshold stands still until `x` is farther from it than that: an
//!   elementary creep operator, whose equilibrium has hysteresis (thesis Ch. 2, 3.2.1);
//! * a second-order term with complex poles, as the thesis' own actuator has (Ch. 5, Eq. 17): `z` follows `x`
//!   with unit static gain, and both `z` and its velocity over the natural frequency are read.
//!
//! The states keep the fraction of their increments, so a time constant of minutes loses nothing at 20 kHz.
//! The host proves that the recursion is stable.

use crate::integer_row::{Integrating, Row};

/// Most first-order terms: a pair of the thesis' actuator beside logarithmic creep over four decades, two
/// terms a decade.
pub const CREEP_TERMS: usize = 12;
/// Fraction bits of the rates.
const RATE_FRACTION_BITS: u32 = 32;

/// Parameters of the inverse. Signals are in um.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CreepInverseParameters {
    /// First-order terms in use.
    pub terms: u8,
    /// The second-order term is in use.
    pub pair: bool,
    /// Share of each first-order term.
    pub shares: Row<CREEP_TERMS, 26>,
    /// `1 - exp(-T / tau_i)` with 32 fraction bits.
    pub rates: [i32; CREEP_TERMS],
    /// How far `x` is from a state that stands still, um with 24 fraction bits; zero for a linear term.
    pub thresholds: [i32; CREEP_TERMS],
    /// Shares of the second-order term and of its velocity over the natural frequency.
    pub pair_shares: Row<2, 26>,
    /// Change of both states in a period by `x - z` and by the velocity, with 32 fraction bits: two rows of
    /// two.
    pub pair_rates: [i32; 4],
    /// `1 / (1 + sum share_i)` with 28 fraction bits: what is asked at rest.
    pub at_rest: i32,
}

impl Default for CreepInverseParameters {
    fn default() -> Self {
        Self {
            terms: 0,
            pair: false,
            shares: Row::default(),
            rates: [0; CREEP_TERMS],
            thresholds: [0; CREEP_TERMS],
            pair_shares: Row::default(),
            pair_rates: [0; 4],
            at_rest: 1 << 28,
        }
    }
}

impl CreepInverseParameters {
    /// Whether there is creep to be undone.
    #[must_use]
    pub fn is_off(&self) -> bool {
        self.terms == 0 && !self.pair
    }
}

/// States of the inverse.
#[derive(Clone, Copy, Debug, Default)]
pub struct CreepInverse {
    states: [Integrating; CREEP_TERMS],
    pair: [Integrating; 2],
}

impl CreepInverse {
    /// The state that this drive leads to when it rests for ever, from zero.
    #[must_use]
    pub fn applied_for_ever(parameters: &CreepInverseParameters, applied: i32) -> Self {
        if parameters.is_off() {
            return Self::default();
        }
        let mut states = [Integrating::default(); CREEP_TERMS];
        for (state, threshold) in states
            .iter_mut()
            .zip(&parameters.thresholds)
            .take(usize::from(parameters.terms))
        {
            *state = Integrating::at(beyond(applied, *threshold));
        }
        Self {
            states,
            pair: [Integrating::at(applied), Integrating::default()],
        }
    }

    /// The state of rest at a position.
    #[must_use]
    pub fn at_rest(
        parameters: &CreepInverseParameters,
        position: i32,
        saturated: &mut u32,
    ) -> Self {
        let asked = crate::signal::saturate(
            (i64::from(position) * i64::from(parameters.at_rest)) >> 28,
            saturated,
        );
        Self::applied_for_ever(parameters, asked)
    }

    /// What creep adds now.
    #[inline]
    #[must_use]
    pub fn creep(&self, parameters: &CreepInverseParameters, saturated: &mut u32) -> i32 {
        if parameters.is_off() {
            return 0;
        }
        let mut values = [0i32; CREEP_TERMS];
        for (value, state) in values.iter_mut().zip(&self.states) {
            *value = state.state;
        }
        let of_terms = parameters.shares.apply(&values, saturated);
        if !parameters.pair {
            return of_terms;
        }
        let [position, velocity] = &self.pair;
        of_terms.saturating_add(
            parameters
                .pair_shares
                .apply(&[position.state, velocity.state], saturated),
        )
    }

    /// What to ask for now so that `wanted` comes out.
    #[inline]
    #[must_use]
    pub fn ask(
        &self,
        parameters: &CreepInverseParameters,
        wanted: i32,
        saturated: &mut u32,
    ) -> i32 {
        wanted.saturating_sub(self.creep(parameters, saturated))
    }

    /// One period in which this was applied.
    #[inline]
    pub fn follow(
        &mut self,
        parameters: &CreepInverseParameters,
        applied: i32,
        saturated: &mut u32,
    ) {
        if parameters.is_off() {
            return;
        }
        let coefficients = parameters.rates.iter().zip(&parameters.thresholds);
        for (state, (rate, threshold)) in self
            .states
            .iter_mut()
            .zip(coefficients)
            .take(usize::from(parameters.terms))
        {
            let way = beyond(applied.saturating_sub(state.state), *threshold);
            state.add::<RATE_FRACTION_BITS>(*rate, way, saturated);
        }
        if parameters.pair {
            let [position, velocity] = &mut self.pair;
            let [by_way, by_velocity, pushed, damped] = parameters.pair_rates;
            let (way, moving) = (applied.saturating_sub(position.state), velocity.state);
            position.add::<RATE_FRACTION_BITS>(by_way, way, saturated);
            position.add::<RATE_FRACTION_BITS>(by_velocity, moving, saturated);
            velocity.add::<RATE_FRACTION_BITS>(pushed, way, saturated);
            velocity.add::<RATE_FRACTION_BITS>(damped, moving, saturated);
        }
    }
}

/// By how much a distance is beyond a threshold, with its sign.
#[inline]
fn beyond(distance: i32, threshold: i32) -> i32 {
    if distance > threshold {
        distance.saturating_sub(threshold)
    } else if distance < threshold.saturating_neg() {
        distance.saturating_add(threshold)
    } else {
        0
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;
    use std::vec::Vec;

    const UM: f64 = 16_777_216.0;
    const RATE: f64 = 4_294_967_296.0;
    const PERIOD_S: f64 = 5e-5;

    /// Terms as share, time constant and threshold.
    fn parameters(terms: &[(f64, f64, f64)]) -> CreepInverseParameters {
        let mut out = CreepInverseParameters {
            terms: terms.len() as u8,
            ..CreepInverseParameters::default()
        };
        for (i, (share, tau_s, threshold_um)) in terms.iter().enumerate() {
            out.shares.coefficients[i] = (share * f64::from(1 << 26)) as i32;
            out.rates[i] = (-(-PERIOD_S / tau_s).exp_m1() * RATE) as i32;
            out.thresholds[i] = (threshold_um * UM) as i32;
        }
        out.at_rest = (f64::from(1 << 28) / (1.0 + terms.iter().map(|t| t.0).sum::<f64>())) as i32;
        out
    }

    fn dead(distance: f64, threshold: f64) -> f64 {
        distance.signum() * (distance.abs() - threshold).max(0.0)
    }

    /// Closed form: creep of the answer, integrated in f64, gives back what was wanted.
    #[test]
    fn creep_of_the_answer_is_what_was_wanted() {
        let terms = [
            (0.02, 0.02, 0.0),
            (-0.01, 0.1, 0.0),
            (0.05, 2.0, 0.0),
            (0.02, 0.3, 0.4),
        ];
        let p = parameters(&terms);
        let mut saturated = 0;
        let mut inverse = CreepInverse::at_rest(&p, 0, &mut saturated);
        let mut z = [0.0; 4];
        for k in 0..200_000 {
            let wanted_um = 5.0 + 3.0 * (f64::from(k) * 1e-3).sin();
            let asked_raw = inverse.ask(&p, (wanted_um * UM) as i32, &mut saturated);
            inverse.follow(&p, asked_raw, &mut saturated);
            let asked = f64::from(asked_raw) / UM;
            let reached = asked + terms.iter().zip(&z).map(|(t, z)| t.0 * z).sum::<f64>();
            assert!(
                (reached - wanted_um).abs() < 2e-5,
                "{k}: {reached} {wanted_um}"
            );
            for (state, (_, tau_s, threshold_um)) in z.iter_mut().zip(&terms) {
                *state += -(-PERIOD_S / tau_s).exp_m1() * dead(asked - *state, *threshold_um);
            }
        }
        assert_eq!(saturated, 0);
    }

    /// Oracle: the thesis' pair of poles (Ch. 5, Eq. 17), -6.19 +- 23.5i, integrated in steps of a twentieth
    /// of a period.
    #[test]
    fn complex_poles_are_undone() {
        let (natural, damping, share, of_velocity) = (24.3, 0.255, 0.012, 0.004);
        let fine_s = PERIOD_S / 20.0;
        let advance = |z: &mut f64, v: &mut f64, x: f64, steps: u32| {
            for _ in 0..steps {
                // The midpoint rule: an error of 1e-10 of the way in a period.
                let (dz, dv) = (
                    natural * *v,
                    natural * (x - *z) - 2.0 * damping * natural * *v,
                );
                let (mz, mv) = (*z + 0.5 * fine_s * dz, *v + 0.5 * fine_s * dv);
                *z += fine_s * natural * mv;
                *v += fine_s * (natural * (x - mz) - 2.0 * damping * natural * mv);
            }
        };
        // One period from unit states gives the exact rates.
        let column = |z0: f64, v0: f64, x: f64| {
            let (mut z, mut v) = (z0, v0);
            advance(&mut z, &mut v, x, 20);
            [z - z0, v - v0]
        };
        let (by_way, by_velocity) = (column(0.0, 0.0, 1.0), column(0.0, 1.0, 0.0));
        let rate = |value: f64| (value * RATE) as i32;
        let mut p = CreepInverseParameters {
            pair: true,
            ..CreepInverseParameters::default()
        };
        p.pair_rates = [
            rate(by_way[0]),
            rate(by_velocity[0]),
            rate(by_way[1]),
            rate(by_velocity[1]),
        ];
        p.pair_shares.coefficients =
            [share, of_velocity].map(|s: f64| (s * f64::from(1 << 26)) as i32);
        let mut saturated = 0;
        let mut inverse = CreepInverse::applied_for_ever(&p, 0);
        let (mut z, mut v) = (0.0, 0.0);
        for k in 0..60_000 {
            let wanted_um = if k < 1000 {
                0.0
            } else {
                5.0 + 3.0 * (f64::from(k) * 1e-3).sin()
            };
            let asked_raw = inverse.ask(&p, (wanted_um * UM) as i32, &mut saturated);
            inverse.follow(&p, asked_raw, &mut saturated);
            let asked = f64::from(asked_raw) / UM;
            let reached = asked + share * z + of_velocity * v;
            assert!(
                (reached - wanted_um).abs() < 5e-5,
                "{k}: {reached} {wanted_um}"
            );
            advance(&mut z, &mut v, asked, 20);
        }
        assert_eq!(saturated, 0);
    }

    #[test]
    fn at_rest_it_stays_and_without_terms_it_passes_on() {
        let p = parameters(&[(0.05, 1.0, 0.0), (0.03, 10.0, 0.0)]);
        let mut saturated = 0;
        let mut inverse = CreepInverse::at_rest(&p, 5 << 24, &mut saturated);
        let asked: Vec<i32> = (0..40_000)
            .map(|_| {
                let asked = inverse.ask(&p, 5 << 24, &mut saturated);
                inverse.follow(&p, asked, &mut saturated);
                asked
            })
            .collect();
        assert!(
            asked.iter().all(|now| (now - asked[0]).abs() < 64),
            "{} {:?}",
            asked[0],
            asked.last()
        );
        let none = CreepInverseParameters::default();
        assert_eq!(
            CreepInverse::at_rest(&none, 77, &mut saturated).ask(&none, 1234, &mut saturated),
            1234
        );
    }

    #[test]
    fn an_operator_stands_still_within_its_threshold() {
        let p = parameters(&[(0.05, 0.01, 1.0)]);
        let mut saturated = 0;
        let mut inverse = CreepInverse::applied_for_ever(&p, 0);
        let mut held = |applied_um: f64| {
            (0..10_000).for_each(|_| inverse.follow(&p, (applied_um * UM) as i32, &mut saturated));
            f64::from(inverse.creep(&p, &mut saturated)) / UM
        };
        // Up by 3: the state comes to 2; down by less than twice the threshold: it stays there, which is
        // hysteresis.
        assert!((held(3.0) - 0.05 * 2.0).abs() < 1e-6);
        assert!((held(1.2) - 0.05 * 2.0).abs() < 1e-6);
        assert!((held(0.5) - 0.05 * 1.5).abs() < 1e-6);
    }
}
