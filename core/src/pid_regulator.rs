//! PID on the tracking error, with feedforward from the reference window, through the inverse of creep, and a
//! notch behind it.
//!
//! One form serves PID, PI, feedforward alone and feedforward + PI (thesis Ch. 4, 4.3): what a scheme leaves
//! out has zero coefficients. The notch is a biquad in direct form I whose coefficients the host designs;
//! without it the numerator is `[1, 0, 0]`.

use crate::creep_inverse::CreepInverseParameters;
use crate::integer_row::{Integrating, Row};
use crate::reference_window::{ReferenceWindow, WindowRow};

/// Fraction bits of the gains.
pub const PID_FRACTION_BITS: u32 = 20;

/// Parameters of the regulator. Its output is in the unit of the actuator's input: V, or um of
/// force-equivalent displacement when the hysteresis is inverted behind it; the host scales the coefficients
/// accordingly.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PidParameters {
    /// `P` and `D / T` over `[e, change of e]`.
    pub proportional_derivative: Row<2, PID_FRACTION_BITS>,
    /// `I T` with 26 fraction bits.
    pub integral: i32,
    /// Feedforward over the reference window.
    pub feedforward: WindowRow<PID_FRACTION_BITS>,
    /// Inverse of creep that the feedforward passes.
    pub creep: CreepInverseParameters,
    /// Notch over `[x[k], x[k-1], x[k-2], y[k-1], y[k-2]]`.
    pub notch: Row<5, 28>,
}

/// States of the regulator.
#[derive(Clone, Debug, Default)]
pub struct PidRegulator {
    integral: Integrating,
    last_error: i32,
    last_change: i32,
    notch: [i32; 4],
    /// Creep at the last reading, which the feedforward took off.
    creep: i32,
}

impl PidRegulator {
    /// Takes over from `output`: the integral is what is missing in front of the notch, which has come to
    /// rest there. `creep` is what creep adds now.
    #[must_use]
    pub fn take_over(
        parameters: &PidParameters,
        reading: i32,
        reference: &ReferenceWindow,
        output: i32,
        creep: i32,
        saturated: &mut u32,
    ) -> Self {
        let last_error = reference.now().saturating_sub(reading);
        let wanted = parameters
            .feedforward
            .apply(reference.positions(), saturated)
            .saturating_sub(creep);
        let without = parameters
            .proportional_derivative
            .apply(&[last_error, 0], saturated)
            .saturating_add(wanted);
        Self {
            integral: Integrating::at(output.saturating_sub(without)),
            last_error,
            last_change: 0,
            notch: [output; 4],
            creep,
        }
    }

    #[cfg(test)]
    pub(crate) fn notch_memory(&self) -> [i32; 4] {
        self.notch
    }

    /// Goes on with other parameters as if they had given the last output, moved by `shift` (what the
    /// actuator's new model makes of the same drive). The integral takes what the other terms would have had
    /// otherwise; the notch keeps its past. `reference` is that of the last reading.
    pub fn go_on(
        &mut self,
        before: &PidParameters,
        after: &PidParameters,
        reference: &ReferenceWindow,
        shift: i32,
        creep: i32,
        saturated: &mut u32,
    ) {
        let moved = |value: i32| value.saturating_add(shift);
        let errors = [self.last_error, self.last_change];
        let [regulated, ..] = self.notch;
        // With the creep that the last output had where that is undone as before.
        let creep = if before.creep == after.creep {
            self.creep
        } else {
            creep
        };
        self.creep = creep;
        let mut others = after.proportional_derivative.apply(&errors, saturated);
        if before.feedforward == after.feedforward && before.creep == after.creep {
            // What the feedforward gave.
            let was = before
                .proportional_derivative
                .apply(&errors, saturated)
                .saturating_add(self.integral.state);
            others = others.saturating_add(regulated.saturating_sub(was));
        } else {
            others = others.saturating_add(
                after
                    .feedforward
                    .apply(reference.positions(), saturated)
                    .saturating_sub(creep),
            );
        }
        self.notch = self.notch.map(moved);
        self.integral.state = moved(regulated).saturating_sub(others);
    }

    /// The output for a reading, with what creep adds when it acts. `hold` stops the integral while the drive
    /// saturates in the direction of its sign.
    #[inline]
    pub fn output(
        &mut self,
        parameters: &PidParameters,
        reading: i32,
        reference: &ReferenceWindow,
        hold: i32,
        creep: i32,
        saturated: &mut u32,
    ) -> i32 {
        let error = reference.now().saturating_sub(reading);
        if (hold > 0 && error < 0) || (hold < 0 && error > 0) || hold == 0 {
            self.integral
                .add::<26>(parameters.integral, error, saturated);
        }
        let change = error.saturating_sub(self.last_error);
        self.last_error = error;
        self.last_change = change;
        let feedforward = parameters
            .feedforward
            .apply(reference.positions(), saturated)
            .saturating_sub(creep);
        self.creep = creep;
        let regulated = parameters
            .proportional_derivative
            .apply(&[error, change], saturated)
            .saturating_add(self.integral.state)
            .saturating_add(feedforward);
        let [x1, x2, y1, y2] = self.notch;
        let output = parameters
            .notch
            .apply(&[regulated, x1, x2, y1, y2], saturated);
        self.notch = [regulated, x1, output, y1];
        output
    }
}
