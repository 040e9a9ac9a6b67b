//! The observer-controller for a loop with one period of delay: PIDSMOC in its predictor form.
//!
//! # How it works
//! The law works on the error between the actuator and a model that follows the reference exactly. Its states are those of the
//! identified linear dynamics (lags, first and second mode) and of the unknown input `d`, which the thesis estimates as `epsilon` (Ch. 7,
//! Eq. 15). With the error `i = (y - r) - c z` of the predicted reading,
//!
//! * the states one period ahead are `z+ = A z + L i + B (v - v_ff)`, where `v` is what acts during that period: it was sent at the last
//!   tick, so the prediction ends at the very instant at which the drive now computed begins to act;
//! * that drive is `v+ = v_ff+ - K z+`, the row `K` holding the discrete sliding surface's equivalent and reaching control and one for
//!   the unknown input;
//! * `v_ff` is the force-equivalent displacement that makes the model follow the reference: a sum over the reference window.
//!
//! `v` is the *force-equivalent displacement that was really applied*, after limits, converter and hysteresis, so neither saturation
//! nor the converter's steps mislead the observer, and nothing winds up.

use crate::integer_row::{Integrating, Row};
use crate::reference_window::{ReferenceWindow, WindowRow};

/// States of the law, the unknown input included.
pub const STATES: usize = 8;
/// States and the two inputs `i` and `v - v_ff`.
pub const INPUTS: usize = STATES + 2;
/// Fraction bits of the state rows.
pub const STATE_ROW_FRACTION_BITS: u32 = 27;
/// Fraction bits of the output rows.
pub const OUTPUT_ROW_FRACTION_BITS: u32 = 24;

/// Parameters of the law. All signals are in um.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PredictorParameters {
    /// `[A | L | B]` over `[z, i, v - v_ff]`.
    pub state_rows: [Row<INPUTS, STATE_ROW_FRACTION_BITS>; STATES],
    /// `c`: the reading that the states predict.
    pub reading_row: Row<STATES, STATE_ROW_FRACTION_BITS>,
    /// `K`.
    pub gain_row: Row<STATES, OUTPUT_ROW_FRACTION_BITS>,
    /// `v_ff` for the period that begins one tick after now, over the reference window.
    pub feedforward: WindowRow<OUTPUT_ROW_FRACTION_BITS>,
}

/// States of the law.
#[derive(Clone, Debug)]
pub struct PredictorLaw {
    states: [Integrating; STATES],
    feedforward: i32,
    innovation: i32,
}

impl PredictorLaw {
    /// At rest, with the unknown input (the last state) such that the output is `applied` when the feedforward is `feedforward`.
    #[must_use]
    pub fn take_over(applied: i32, feedforward: i32) -> Self {
        let mut states = [Integrating::default(); STATES];
        states[STATES - 1] = Integrating::at(feedforward.saturating_sub(applied));
        Self { states, feedforward, innovation: 0 }
    }

    /// The force-equivalent displacement to command for the next period, from the reading now and what acts now.
    #[inline]
    pub fn output(
        &mut self,
        parameters: &PredictorParameters,
        reading: i32,
        applied: i32,
        reference: &ReferenceWindow,
        saturated: &mut u32,
    ) -> i32 {
        let mut signals = [0i32; INPUTS];
        let mut states = [0i32; STATES];
        for i in 0..STATES {
            states[i] = self.states[i].state;
            signals[i] = states[i];
        }
        let error = reading.saturating_sub(reference.now());
        self.innovation = error.saturating_sub(parameters.reading_row.apply(&states, saturated));
        signals[STATES] = self.innovation;
        signals[STATES + 1] = applied.saturating_sub(self.feedforward);
        for i in 0..STATES {
            self.states[i].replace(&parameters.state_rows[i], &signals, saturated);
            states[i] = self.states[i].state;
        }
        self.feedforward = parameters.feedforward.apply(reference.positions(), saturated);
        self.feedforward.saturating_sub(parameters.gain_row.apply(&states, saturated))
    }

    /// Difference between the last reading and its prediction, um.
    #[must_use]
    pub fn innovation(&self) -> i32 {
        self.innovation
    }

    /// Estimate of the unknown input, um of force-equivalent displacement.
    #[must_use]
    pub fn unknown_input(&self) -> i32 {
        self.states[STATES - 1].state
    }
}
