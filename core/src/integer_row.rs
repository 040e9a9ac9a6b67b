//! Sums of products of integer coefficients and 32-bit signals: the one arithmetic of every linear part of
//! the tick.
//!
//! A [`Row`] is `sum c_i x_i / 2^Q`. The host quantises so that `sum |c_i| < 2^31`; with 32-bit signals the
//! sum then stays within 2^62 and cannot wrap. An [`Integrating`] row keeps the fraction that the shift would
//! throw away and adds it the next time: a state with a pole near one loses nothing, however small its
//! increments are.

use crate::signal::{saturate, saturate_shifted, sum as sum_of};

/// `sum c_i x_i / 2^Q`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Row<const N: usize, const Q: u32> {
    /// Coefficients with `Q` fraction bits; the sum of their magnitudes is below 2^31.
    pub coefficients: [i32; N],
}

impl<const N: usize, const Q: u32> Default for Row<N, Q> {
    fn default() -> Self {
        Self {
            coefficients: [0; N],
        }
    }
}

impl<const N: usize, const Q: u32> Row<N, Q> {
    /// The sum before the shift, begun with `start`.
    #[inline(always)]
    #[must_use]
    pub fn sum_from(&self, start: i64, signals: &[i32; N]) -> i64 {
        let (coefficients, rest) = self.coefficients.as_chunks::<4>();
        let (fours, last) = signals.as_chunks::<4>();
        let mut sum = start;
        for (c, s) in coefficients.iter().zip(fours) {
            sum = four(sum, *c, *s);
        }
        for (coefficient, signal) in rest.iter().zip(last) {
            sum = sum_of(sum, i64::from(*coefficient) * i64::from(*signal));
        }
        sum
    }

    /// The rounded result, saturated.
    #[inline]
    #[must_use]
    pub fn apply(&self, signals: &[i32; N], saturated: &mut u32) -> i32 {
        saturate_shifted::<Q>(self.sum_from(1i64 << (Q - 1), signals), saturated)
    }
}

/// Four terms of a sum: what the compiler would otherwise leave a loop.
#[inline(always)]
#[must_use]
pub fn four(sum: i64, [c0, c1, c2, c3]: [i32; 4], [s0, s1, s2, s3]: [i32; 4]) -> i64 {
    let term = |c: i32, s: i32| i64::from(c) * i64::from(s);
    sum_of(
        sum_of(
            sum_of(sum_of(sum, term(c0, s0)), term(c1, s1)),
            term(c2, s2),
        ),
        term(c3, s3),
    )
}

/// A state with the fraction that its format cannot hold.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Integrating {
    /// The state in its signal format.
    pub state: i32,
    remainder: u32,
}

impl Integrating {
    /// A state without a fraction.
    #[must_use]
    pub fn at(state: i32) -> Self {
        Self {
            state,
            remainder: 0,
        }
    }

    /// Replaces the state by the row's result, with the fraction carried on.
    #[inline]
    pub fn replace<const N: usize, const Q: u32>(
        &mut self,
        row: &Row<N, Q>,
        signals: &[i32; N],
        saturated: &mut u32,
    ) {
        let sum = row.sum_from(i64::from(self.remainder), signals);
        self.remainder = (sum & ((1i64 << Q) - 1)) as u32;
        self.state = saturate_shifted::<Q>(sum, saturated);
    }

    /// Adds `coefficient * signal / 2^Q` to the state.
    #[inline]
    pub fn add<const Q: u32>(&mut self, coefficient: i32, signal: i32, saturated: &mut u32) {
        let sum = sum_of(
            i64::from(coefficient) * i64::from(signal),
            i64::from(self.remainder),
        );
        self.remainder = (sum & ((1i64 << Q) - 1)) as u32;
        self.state = saturate(sum_of(sum >> Q, i64::from(self.state)), saturated);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_integrating_state_loses_nothing() {
        // An increment of 2^-20 of the last place, 2^22 times.
        let mut state = Integrating::at(5);
        let mut saturated = 0;
        for _ in 0..1 << 22 {
            state.add::<20>(1, 1, &mut saturated);
        }
        assert_eq!((state.state, saturated), (9, 0));
        for _ in 0..1 << 22 {
            state.add::<20>(-1, 1, &mut saturated);
        }
        assert_eq!(state.state, 5);
    }

    #[test]
    fn a_row_rounds_and_saturates() {
        let row = Row::<2, 4> {
            coefficients: [16, 8],
        };
        let mut saturated = 0;
        assert_eq!(row.apply(&[3, 1], &mut saturated), 4);
        assert_eq!(saturated, 0);
        assert_eq!(row.apply(&[i32::MAX, i32::MAX], &mut saturated), i32::MAX);
        assert_eq!(saturated, 1);
    }
}
