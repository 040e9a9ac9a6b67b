//! The observer-controller for a loop with one period of delay: PIDSMOC in its predictor form.
//!
//! # How it works
//! The law works on the error between the actuator and a model that follows the reference exactly. Its
//! states are those of the identified linear dynamics (lags, first and second mode), `z`, and the unknown
//! input `d` with its slope `s`, which the thesis estimates as `epsilon` (Ch. 7, Eq. 15). With the error
//! `i = (y - r) - c z` of the predicted reading,
//!
//! * the states one period ahead are `z+ = A z + L i + B (v - v_ff + d)`, `d+ = d + s + l_d i`,
//!   `s+ = s + l_s i`, where `v` is what acts during that period: it was sent at the last tick, so
//!   the prediction ends at the very instant at which the drive now computed begins to act;
//! * that drive is `v+ = v_ff+ - K z+ - d+`, the row `K` holding the discrete sliding surface's equivalent
//!   and reaching control;
//! * `v_ff` is the force-equivalent displacement that makes the model follow the reference: a sum over the
//!   reference window.
//!
//! `v` is the *force-equivalent displacement that was really applied*, after limits, converter and
//! hysteresis, so neither saturation nor the converter's steps mislead the observer, and nothing winds up.
//!
//! With another gain of the actuator only the coefficients change ([`GainCoefficients`],
//! [`PredictorLaw::rescale`]): the law's output stays in the um of the actuator's model.

use crate::integer_row::{Integrating, Row, four};
use crate::reference_window::{ReferenceWindow, WINDOW, WindowRow};
use crate::signal::saturate_shifted;

/// States of the linear dynamics.
pub const STATES: usize = 6;
/// States and the two inputs `i` and `v - v_ff + d`.
pub const INPUTS: usize = STATES + 2;
/// Fraction bits of the state rows and of the gains of the unknown input.
pub const STATE_ROW_FRACTION_BITS: u32 = 27;
/// Fraction bits of the output rows.
pub const OUTPUT_ROW_FRACTION_BITS: u32 = 24;

/// Parameters of the law. All signals are in um.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PredictorParameters {
    /// `[A | L | B]` over `[z, i, v - v_ff + d]`.
    pub state_rows: [Row<INPUTS, STATE_ROW_FRACTION_BITS>; STATES],
    /// `l_d`, with [`STATE_ROW_FRACTION_BITS`].
    pub unknown_gain: i32,
    /// `l_s`, with [`STATE_ROW_FRACTION_BITS`]; zero for an unknown input without a slope.
    pub slope_gain: i32,
    /// `c`: the reading that the states predict.
    pub reading_row: Row<STATES, STATE_ROW_FRACTION_BITS>,
    /// `K`.
    pub gain_row: Row<STATES, OUTPUT_ROW_FRACTION_BITS>,
    /// `v_ff` for the period that begins one tick after now, over the reference window.
    pub feedforward: WindowRow<OUTPUT_ROW_FRACTION_BITS>,
}

/// What depends on the gain of the actuator.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct GainCoefficients {
    /// Of the feedforward; divided by the gain, as the next two are.
    pub feedforward: [i32; WINDOW],
    /// `K`.
    pub gain_row: [i32; STATES],
    /// `l_d` and `l_s`.
    pub unknown: [i32; 2],
    /// The column `B` of the drive, multiplied by the gain.
    pub drive: [i32; STATES],
}

impl GainCoefficients {
    /// None.
    pub const NONE: Self = Self {
        feedforward: [0; WINDOW],
        gain_row: [0; STATES],
        unknown: [0; 2],
        drive: [0; STATES],
    };
}

impl PredictorParameters {
    /// What depends on the gain of the actuator.
    #[must_use]
    pub fn of_gain(&self) -> GainCoefficients {
        GainCoefficients {
            feedforward: self.feedforward.coefficients,
            gain_row: self.gain_row.coefficients,
            unknown: [self.unknown_gain, self.slope_gain],
            drive: core::array::from_fn(|nth| {
                self.state_rows
                    .get(nth)
                    .map_or(0, |row| row.coefficients[INPUTS - 1])
            }),
        }
    }

    /// Takes the column of the drive from what [`Self::of_gain`] gives.
    pub fn set_drive_column(&mut self, drive: &[i32; STATES]) {
        for (row, of_drive) in self.state_rows.iter_mut().zip(drive) {
            row.coefficients[INPUTS - 1] = *of_drive;
        }
    }

    /// Takes what [`Self::of_gain`] gives.
    pub fn set_of_gain(&mut self, coefficients: &GainCoefficients) {
        self.feedforward.coefficients = coefficients.feedforward;
        self.gain_row.coefficients = coefficients.gain_row;
        [self.unknown_gain, self.slope_gain] = coefficients.unknown;
        self.set_drive_column(&coefficients.drive);
    }
}

/// States of the law.
#[derive(Clone, Debug)]
pub struct PredictorLaw {
    states: [i32; STATES],
    /// What the states' format cannot hold of them.
    remainders: [u32; STATES],
    unknown: Integrating,
    slope: Integrating,
    feedforward: i32,
    innovation: i32,
}

/// Replaces two states with their remainders by their rows' results; the fractions are carried on.
#[inline(always)]
fn replace_two(
    [a, b]: [&Row<INPUTS, STATE_ROW_FRACTION_BITS>; 2],
    signals: &[i32; INPUTS],
    [(state_a, rest_a), (state_b, rest_b)]: [(&mut i32, &mut u32); 2],
    saturated: &mut u32,
) {
    const FRACTION: u32 = (1 << STATE_ROW_FRACTION_BITS) - 1;
    let (mut sum_a, mut sum_b) = (i64::from(*rest_a), i64::from(*rest_b));
    // Four terms at a time, written out: the compiler leaves a loop where the tick is inlined into the
    // interrupt.
    let mut add = |signals: [i32; 4], a: [i32; 4], b: [i32; 4]| {
        sum_a = four(sum_a, a, signals);
        sum_b = four(sum_b, b, signals);
    };
    let [s0, s1, s2, s3, s4, s5, s6, s7] = *signals;
    let [a0, a1, a2, a3, a4, a5, a6, a7] = a.coefficients;
    let [b0, b1, b2, b3, b4, b5, b6, b7] = b.coefficients;
    add([s0, s1, s2, s3], [a0, a1, a2, a3], [b0, b1, b2, b3]);
    add([s4, s5, s6, s7], [a4, a5, a6, a7], [b4, b5, b6, b7]);
    *rest_a = sum_a as u32 & FRACTION;
    *rest_b = sum_b as u32 & FRACTION;
    *state_a = saturate_shifted::<STATE_ROW_FRACTION_BITS>(sum_a, saturated);
    *state_b = saturate_shifted::<STATE_ROW_FRACTION_BITS>(sum_b, saturated);
}

/// Whether the states of both mean the same: all but the gains of the observer, which stand behind the
/// states.
fn same_dynamics(a: &PredictorParameters, b: &PredictorParameters) -> bool {
    let same = |(a, b): (
        &Row<INPUTS, STATE_ROW_FRACTION_BITS>,
        &Row<INPUTS, STATE_ROW_FRACTION_BITS>,
    )| {
        a.coefficients
            .iter()
            .zip(&b.coefficients)
            .enumerate()
            .all(|(nth, (a, b))| nth == STATES || a == b)
    };
    a.reading_row == b.reading_row && a.state_rows.iter().zip(&b.state_rows).all(same)
}

impl PredictorLaw {
    /// At rest, with the unknown input such that the output is `applied` when the feedforward is
    /// `feedforward`.
    #[must_use]
    pub fn take_over(applied: i32, feedforward: i32) -> Self {
        Self {
            states: [0; STATES],
            remainders: [0; STATES],
            unknown: Integrating::at(feedforward.saturating_sub(applied)),
            slope: Integrating::at(0),
            feedforward,
            innovation: 0,
        }
    }

    /// Goes on with other parameters as if they had given the last output, moved by `shift` (what the
    /// actuator's new model makes of the same drive). The unknown input takes the difference, and keeps its
    /// slope; the states go on where both blocks have the same model of the dynamics, and begin at no error
    /// where they have not. `reference` is that of the last reading.
    pub fn go_on(
        &mut self,
        before: &PredictorParameters,
        after: &PredictorParameters,
        reference: &ReferenceWindow,
        shift: i32,
        saturated: &mut u32,
    ) {
        let output = self.last_output(before, saturated).saturating_add(shift);
        if !same_dynamics(before, after) {
            (self.states, self.remainders) = ([0; STATES], [0; STATES]);
        }
        self.begin_from(output, after, reference, saturated);
    }

    /// Goes on with the coefficients of another gain as if they had given the last output: the unknown input
    /// takes the difference. `reference` is that of the last reading.
    #[inline(never)]
    pub fn rescale(
        &mut self,
        parameters: &mut PredictorParameters,
        coefficients: &GainCoefficients,
        reference: &ReferenceWindow,
        saturated: &mut u32,
    ) {
        let output = self.last_output(parameters, saturated);
        parameters.set_of_gain(coefficients);
        self.begin_from(output, parameters, reference, saturated);
    }

    #[inline(never)]
    fn last_output(&self, parameters: &PredictorParameters, saturated: &mut u32) -> i32 {
        self.feedforward
            .saturating_sub(parameters.gain_row.apply(&self.states, saturated))
            .saturating_sub(self.unknown.state)
    }

    /// Sets the unknown input such that the last output would have been this one.
    #[inline(never)]
    fn begin_from(
        &mut self,
        output: i32,
        parameters: &PredictorParameters,
        reference: &ReferenceWindow,
        saturated: &mut u32,
    ) {
        self.feedforward = parameters
            .feedforward
            .apply(reference.positions(), saturated);
        let without = self
            .feedforward
            .saturating_sub(parameters.gain_row.apply(&self.states, saturated));
        self.unknown.state = without.saturating_sub(output);
    }

    /// The force-equivalent displacement to command for the next period, from the reading now and what acts
    /// now.
    #[inline]
    pub fn output(
        &mut self,
        parameters: &PredictorParameters,
        reading: i32,
        applied: i32,
        reference: &ReferenceWindow,
        saturated: &mut u32,
    ) -> i32 {
        let error = reading.saturating_sub(reference.now());
        let innovation =
            error.saturating_sub(parameters.reading_row.apply(&self.states, saturated));
        self.innovation = innovation;
        let input = applied
            .saturating_sub(self.feedforward)
            .saturating_add(self.unknown.state);
        let [z0, z1, z2, z3, z4, z5] = self.states;
        let signals = [z0, z1, z2, z3, z4, z5, innovation, input];
        // Two rows at a time, so that each signal is loaded once for both.
        let [a, b, c, d, e, f] = &parameters.state_rows;
        let [z0, z1, z2, z3, z4, z5] = &mut self.states;
        let [r0, r1, r2, r3, r4, r5] = &mut self.remainders;
        replace_two([a, b], &signals, [(z0, r0), (z1, r1)], saturated);
        replace_two([c, d], &signals, [(z2, r2), (z3, r3)], saturated);
        replace_two([e, f], &signals, [(z4, r4), (z5, r5)], saturated);
        self.unknown.state = self.unknown.state.saturating_add(self.slope.state);
        self.unknown
            .add::<STATE_ROW_FRACTION_BITS>(parameters.unknown_gain, innovation, saturated);
        self.slope
            .add::<STATE_ROW_FRACTION_BITS>(parameters.slope_gain, innovation, saturated);
        self.feedforward = parameters
            .feedforward
            .apply(reference.positions(), saturated);
        self.feedforward
            .saturating_sub(parameters.gain_row.apply(&self.states, saturated))
            .saturating_sub(self.unknown.state)
    }

    /// Difference between the last reading and its prediction, um.
    #[must_use]
    pub fn innovation(&self) -> i32 {
        self.innovation
    }

    /// Estimate of the unknown input, um of force-equivalent displacement.
    #[must_use]
    pub fn unknown_input(&self) -> i32 {
        self.unknown.state
    }

    /// What is fed forward for the next period, um of force-equivalent displacement.
    #[must_use]
    pub fn feedforward(&self) -> i32 {
        self.feedforward
    }
}
