//! The sliding-mode controllers of the thesis: equivalent control, and what drives the state to the sliding
//! surface.
//!
//! With the errors `e1`, `e2` of position and velocity the switching function is `q = m e1 + e2` (Ch. 6, Eq.
//! 8), carried times the period. The drive is the one that the nominal model needs for the reference (Eq. 6),
//! minus the equivalent control (Eq. 12), and
//!
//! * [`Reaching::Pid`]: minus `P_c q + I_c` integral of `q` `+ D_c dq/dt` (Eq. 14): PIDSMC;
//! * [`Reaching::Switching`]: minus `eta sign(q)` (Eq. 13): the ideal sliding mode, which chatters;
//! * [`Reaching::BoundaryLayer`]: minus `eta q / (|q| + delta)` (Eq. 45), which leaves a steady error.
//!
//! # The instant of the drive
//! A code acts one period after its reading. With a [`Prediction`] the estimate is carried over that period
//! by the nominal model, with the drive that acts in it and the estimated unknown input, and is compared with
//! the reference of the instant at which the new drive begins to act: the predictor form. Without one the law
//! is the thesis' own, which acts at once.

use crate::integer_row::{Integrating, Row};
use crate::reference_window::{ReferenceWindow, WindowRow};
use crate::signal::narrow;
use crate::state_estimator::StateEstimator;

/// Fraction bits of rows whose result is a drive.
pub const DRIVE_ROW_FRACTION_BITS: u32 = 18;
/// Fraction bits of rows whose result is an error.
pub const ERROR_ROW_FRACTION_BITS: u32 = 26;

/// How the state is driven to the sliding surface.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reaching {
    /// PID of the switching function.
    Pid {
        /// `P_c` and `D_c` over `[q T, change of q T]`, V.
        proportional_derivative: Row<2, DRIVE_ROW_FRACTION_BITS>,
        /// `I_c` times the period, V per um of `q T` with 26 fraction bits.
        integral: i32,
    },
    /// Ideal sliding mode.
    Switching {
        /// `eta`, V.
        magnitude: i32,
    },
    /// Boundary layer.
    BoundaryLayer {
        /// `eta`, V.
        magnitude: i32,
        /// `delta` times the period, um.
        thickness: i32,
    },
}

/// Carries an estimate to the instant at which the drive that is computed begins to act.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Prediction {
    /// Position and velocity times the period then, um, over `[x1, x2 T, integral of the
    /// estimator, what acts until then]`.
    pub rows: [Row<4, ERROR_ROW_FRACTION_BITS>; 2],
}

/// Parameters of a sliding-mode controller. What it calls a drive is um of force-equivalent displacement
/// where the actuator's model stands behind it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SlidingModeParameters {
    /// Reference velocity times the period over the reference window, um.
    pub reference_velocity: WindowRow<ERROR_ROW_FRACTION_BITS>,
    /// Drive that the nominal model needs for the reference (Ch. 6, Eq. 6), V.
    pub reference_drive: WindowRow<DRIVE_ROW_FRACTION_BITS>,
    /// `q T` over `[e1, e2 T]`, um.
    pub switching_function: Row<2, ERROR_ROW_FRACTION_BITS>,
    /// Equivalent control (Ch. 6, Eq. 12) over `[e1, e2 T]`, V.
    pub equivalent_control: Row<2, DRIVE_ROW_FRACTION_BITS>,
    /// How the surface is reached.
    pub reaching: Reaching,
    /// How the estimate is carried over the period of delay; none where the drive acts at once. The rows over
    /// the reference are then for the instant to which it is carried.
    pub prediction: Option<Prediction>,
}

/// States of a sliding-mode controller.
#[derive(Clone, Debug, Default)]
pub struct SlidingModeController {
    integral: Integrating,
    last_switching_function: i32,
    errors: [i32; 2],
}

impl SlidingModeController {
    /// Begins with the integral that makes the first output `drive` when `without` is what comes out without
    /// it.
    pub fn take_over(&mut self, drive: i32, without: i32) {
        self.integral = Integrating::at(without.saturating_sub(drive));
    }

    /// The drive for an estimate; `acting` is what acts until it does. `hold` stops the integral while the
    /// drive saturates in the direction of its sign.
    #[inline]
    pub fn drive(
        &mut self,
        parameters: &SlidingModeParameters,
        estimate: &StateEstimator,
        acting: i32,
        reference: &ReferenceWindow,
        hold: i32,
        saturated: &mut u32,
    ) -> i32 {
        let [x1, x2] = [estimate.position(), estimate.velocity_per_tick()];
        let (position, velocity_per_tick, wanted) = match &parameters.prediction {
            None => (x1, x2, reference.now()),
            Some(Prediction {
                rows: [row_1, row_2],
            }) => {
                let signals = [x1, x2, estimate.integral(), acting];
                (
                    row_1.apply(&signals, saturated),
                    row_2.apply(&signals, saturated),
                    reference.next(),
                )
            }
        };
        let e1 = position.saturating_sub(wanted);
        let e2 = velocity_per_tick.saturating_sub(
            parameters
                .reference_velocity
                .apply(reference.positions(), saturated),
        );
        self.errors = [e1, e2];
        let q = parameters.switching_function.apply(&self.errors, saturated);
        let reaching = match &parameters.reaching {
            Reaching::Pid {
                proportional_derivative,
                integral,
            } => {
                // A positive q lowers the drive.
                if (hold > 0 && q > 0) || (hold < 0 && q < 0) || hold == 0 {
                    self.integral
                        .add::<ERROR_ROW_FRACTION_BITS>(*integral, q, saturated);
                }
                let change = q.saturating_sub(self.last_switching_function);
                proportional_derivative.apply(&[q, change], saturated)
            }
            Reaching::Switching { magnitude } => q.signum().saturating_mul(*magnitude),
            Reaching::BoundaryLayer {
                magnitude,
                thickness,
            } => {
                let layer = i64::from(q).abs().saturating_add(i64::from(*thickness));
                narrow(
                    (i64::from(*magnitude) * i64::from(q))
                        .checked_div(layer)
                        .unwrap_or(0),
                )
            }
        };
        self.last_switching_function = q;
        parameters
            .reference_drive
            .apply(reference.positions(), saturated)
            .saturating_sub(parameters.equivalent_control.apply(&self.errors, saturated))
            .saturating_sub(reaching)
            .saturating_sub(self.integral.state)
    }

    /// Errors `[e1, e2 T]` of the last sample, um.
    #[must_use]
    pub fn errors(&self) -> [i32; 2] {
        self.errors
    }

    /// Switching function times the period at the last sample, um.
    #[must_use]
    pub fn switching_function(&self) -> i32 {
        self.last_switching_function
    }
}
