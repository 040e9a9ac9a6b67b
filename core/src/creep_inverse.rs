//! Inverse of creep, for a feedforward: what must be asked of the actuator so that, with its creep, it comes
//! to where it should be.
//!
//! # How it works
//! Creep adds slow answers to what the actuator did: `y = x + sum share_i z_i`, where `z_i` follows `x` with
//! the time constant `tau_i` (thesis Ch. 5, Eqs. 13 and 17, as a sum of first-order terms). Solved for `x`
//! that is `x = y - sum share_i z_i`, with the same states: no search, and no inverse of a transfer function.
//! The states keep the fraction of their increments, so a time constant of minutes loses nothing at 20 kHz.
//! The host proves that the recursion is stable.

use crate::integer_row::{Integrating, Row};

/// Most terms.
pub const CREEP_TERMS: usize = 8;
/// Fraction bits of the rates.
const RATE_FRACTION_BITS: u32 = 32;

/// Parameters of the inverse. Signals are in um.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CreepInverseParameters {
    /// Terms in use; none passes the signal on.
    pub terms: u8,
    /// Share of each term.
    pub shares: Row<CREEP_TERMS, 26>,
    /// `1 - exp(-T / tau_i)` with 32 fraction bits.
    pub rates: [i32; CREEP_TERMS],
    /// `1 / (1 + sum share_i)` with 28 fraction bits: what is asked at rest.
    pub at_rest: i32,
}

impl Default for CreepInverseParameters {
    fn default() -> Self {
        Self { terms: 0, shares: Row::default(), rates: [0; CREEP_TERMS], at_rest: 1 << 28 }
    }
}

/// States of the inverse.
#[derive(Clone, Copy, Debug, Default)]
pub struct CreepInverse {
    states: [Integrating; CREEP_TERMS],
}

impl CreepInverse {
    /// The state after an infinitely long rest at a position.
    #[must_use]
    pub fn at_rest(parameters: &CreepInverseParameters, position: i32, saturated: &mut u32) -> Self {
        if parameters.terms == 0 {
            return Self::default();
        }
        let asked = crate::signal::saturate((i64::from(position) * i64::from(parameters.at_rest)) >> 28, saturated);
        Self { states: [Integrating::at(asked); CREEP_TERMS] }
    }

    /// What to ask for so that `wanted` comes out, and one period of creep.
    #[inline]
    pub fn step(&mut self, parameters: &CreepInverseParameters, wanted: i32, saturated: &mut u32) -> i32 {
        if parameters.terms == 0 {
            return wanted;
        }
        let mut values = [0i32; CREEP_TERMS];
        for (value, state) in values.iter_mut().zip(&self.states) {
            *value = state.state;
        }
        let asked = wanted.saturating_sub(parameters.shares.apply(&values, saturated));
        for (state, rate) in self.states.iter_mut().zip(&parameters.rates).take(usize::from(parameters.terms)) {
            let way = asked.saturating_sub(state.state);
            state.add::<RATE_FRACTION_BITS>(*rate, way, saturated);
        }
        asked
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parameters(terms: &[(f64, f64)]) -> CreepInverseParameters {
        let mut out = CreepInverseParameters { terms: terms.len() as u8, ..CreepInverseParameters::default() };
        for (i, (share, tau_s)) in terms.iter().enumerate() {
            out.shares.coefficients[i] = (share * f64::from(1 << 26)) as i32;
            out.rates[i] = (-(-5e-5 / tau_s).exp_m1() * 4_294_967_296.0) as i32;
        }
        out.at_rest = (f64::from(1 << 28) / (1.0 + terms.iter().map(|t| t.0).sum::<f64>())) as i32;
        out
    }

    /// Closed form: creep of the answer, integrated in f64, gives back what was wanted.
    #[test]
    fn creep_of_the_answer_is_what_was_wanted() {
        let terms = [(0.02, 0.02), (-0.01, 0.1), (0.05, 2.0)];
        let p = parameters(&terms);
        let mut saturated = 0;
        let mut inverse = CreepInverse::at_rest(&p, 0, &mut saturated);
        let mut z = [0.0; 3];
        for k in 0..200_000 {
            let wanted_um = 5.0 + 3.0 * (f64::from(k) * 1e-3).sin();
            let asked = f64::from(inverse.step(&p, (wanted_um * 16_777_216.0) as i32, &mut saturated)) / 16_777_216.0;
            let reached = asked + terms.iter().zip(&z).map(|(t, z)| t.0 * z).sum::<f64>();
            assert!((reached - wanted_um).abs() < 2e-5, "{k}: {reached} {wanted_um}");
            for (state, (_, tau_s)) in z.iter_mut().zip(&terms) {
                *state += -(-5e-5 / tau_s).exp_m1() * (asked - *state);
            }
        }
        assert_eq!(saturated, 0);
    }

    #[test]
    fn at_rest_it_stays_and_without_terms_it_passes_on() {
        let p = parameters(&[(0.05, 1.0), (0.03, 10.0)]);
        let mut saturated = 0;
        let mut inverse = CreepInverse::at_rest(&p, 5 << 24, &mut saturated);
        let first = inverse.step(&p, 5 << 24, &mut saturated);
        let mut last = first;
        for _ in 0..40_000 {
            last = inverse.step(&p, 5 << 24, &mut saturated);
        }
        assert!((last - first).abs() < 64, "{first} {last}");
        let none = CreepInverseParameters::default();
        assert_eq!(CreepInverse::at_rest(&none, 77, &mut saturated).step(&none, 1234, &mut saturated), 1234);
    }
}
