//! Estimators of position and velocity from the sensor: the PID-based sliding-mode observer and the
//! alpha-beta filters it is compared with.
//!
//! All three are linear in the present and the last reading and in the drive that acted between them, so they
//! share one integer form:
//!
//! | estimator | states | source |
//! |---|---|---|
//! | PIDSMO | `x1`, `x2 T`, `I_o` integral of `e_o1` (V) | thesis Ch. 7, Eqs. (2), (14) |
//! | alpha-beta, continuous form | `x1`, `x2 T` | thesis Ch. 6, Eqs. (35)-(36); Ch. 7, Eqs. (38)-(39) |
//! | alpha-beta, discrete | `x1`, `x2 T` | thesis Ch. 6, Eqs. (33)-(34); Ch. 7, Eqs. (36)-(37) |
//!
//! The continuous forms are discretised exactly on the host, with the drive held and the reading running
//! straight between samples; what stands here are the rows of that discretisation.

use crate::integer_row::{Integrating, Row};

/// Fraction bits of the rows.
pub const ESTIMATOR_FRACTION_BITS: u32 = 26;

/// Rows of an estimator over `[x1, x2 T, integral, y[k-1], y[k], u]`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct EstimatorParameters {
    /// New `x1` (um), new `x2 T` (um per sample), new integral (V).
    pub rows: [Row<6, ESTIMATOR_FRACTION_BITS>; 3],
    /// Estimate of the unknown input `epsilon` (V, Ch. 7, Eq. 15) over `[x1, x2 T, integral,
    /// y[k-1], y[k], u]`, from the new states.
    pub unknown_input: Row<6, 20>,
}

/// States of an estimator.
#[derive(Clone, Debug)]
pub struct StateEstimator {
    states: [Integrating; 3],
    last_reading: i32,
    unknown_input: i32,
}

impl StateEstimator {
    /// At rest at a position, with the integral that holds it there.
    #[must_use]
    pub fn at_rest(position: i32, integral: i32) -> Self {
        let states = [
            Integrating::at(position),
            Integrating::at(0),
            Integrating::at(integral),
        ];
        Self {
            states,
            last_reading: position,
            unknown_input: integral.saturating_neg(),
        }
    }

    /// Takes the reading `y[k]` and the drive that acted since `y[k-1]`.
    #[inline]
    pub fn update(
        &mut self,
        parameters: &EstimatorParameters,
        reading: i32,
        drive: i32,
        saturated: &mut u32,
    ) {
        let [x1, x2, integral] = &mut self.states;
        let mut signals = [
            x1.state,
            x2.state,
            integral.state,
            self.last_reading,
            reading,
            drive,
        ];
        let [row_1, row_2, row_3] = &parameters.rows;
        x1.replace(row_1, &signals, saturated);
        x2.replace(row_2, &signals, saturated);
        integral.replace(row_3, &signals, saturated);
        signals[0] = x1.state;
        signals[1] = x2.state;
        signals[2] = integral.state;
        self.unknown_input = parameters.unknown_input.apply(&signals, saturated);
        self.last_reading = reading;
    }

    /// Estimated position, um.
    #[inline]
    #[must_use]
    pub fn position(&self) -> i32 {
        self.states[0].state
    }

    /// Estimated velocity times the sampling period, um.
    #[inline]
    #[must_use]
    pub fn velocity_per_tick(&self) -> i32 {
        self.states[1].state
    }

    /// The integral: the estimated unknown input with its sign turned, without what the last readings add to
    /// it.
    #[inline]
    #[must_use]
    pub fn integral(&self) -> i32 {
        self.states[2].state
    }

    /// Estimated unknown input `epsilon`, V.
    #[inline]
    #[must_use]
    pub fn unknown_input(&self) -> i32 {
        self.unknown_input
    }
}
