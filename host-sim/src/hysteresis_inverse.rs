//! Inverse of the one-sided hysteresis in f64: which drive makes the model reach a desired displacement
//! (thesis Ch. 4, 5.1).
//!
//! The thesis steps the whole model by a fixed voltage until the desired output is bracketed and then
//! bisects; its descending branch loops for ever when the output lies below what the lowest drive gives. Here
//! the walk goes from one reversal point of the memory to the next: up to the maximum that would be wiped out
//! next, or down to the minimum, until the desired output lies inside a section. Inside a section the output
//! is a polynomial in the drive alone, solved by bisection guarded Newton steps. What no drive can reach
//! saturates and is reported. The search is finite: every step of the walk wipes out one stored pair.
//!
//! The integer inverse of the controller lives in the core; this one is the reference beside which it is
//! tested, and the feedforward of the thesis' own experiments.

use crate::hysteresis_surface::{OneSidedHysteresis, horner};

/// Answer of the inverse.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct InverseDrive {
    /// Drive, V.
    pub drive_v: f64,
    /// Output of the model at that drive, um.
    pub output_um: f64,
    /// The desired output was out of reach: the drive stands at a limit.
    pub saturated: bool,
}

/// The inverse with its memory.
#[derive(Clone, Debug)]
pub struct HysteresisInverse {
    model: OneSidedHysteresis,
    lower_limit_v: f64,
    range_v: f64,
    output_um: f64,
}

/// Accuracy of the drive, as a share of the range.
const TOLERANCE: f64 = 1e-13;

impl HysteresisInverse {
    /// An inverse of `model`, which stands at `lower_limit_v` (virgin) and whose drive spans `range_v`.
    #[must_use]
    pub fn new(mut model: OneSidedHysteresis, lower_limit_v: f64, range_v: f64) -> Self {
        let output_um = model.step(lower_limit_v);
        Self {
            model,
            lower_limit_v,
            range_v,
            output_um,
        }
    }

    /// The memory after all answers so far.
    #[must_use]
    pub fn model(&self) -> &OneSidedHysteresis {
        &self.model
    }

    /// Range of the drive, V.
    #[must_use]
    pub fn range_v(&self) -> f64 {
        self.range_v
    }

    fn at(&self, x: f64) -> f64 {
        self.lower_limit_v + self.range_v * x
    }

    /// The drive that takes the output to `desired_um`, and the memory with it.
    pub fn step(&mut self, desired_um: f64) -> InverseDrive {
        let rising = desired_um > self.output_um;
        if desired_um == self.output_um {
            return InverseDrive {
                drive_v: self.at(self.model.stack().input()),
                output_um: self.output_um,
                saturated: false,
            };
        }
        loop {
            let stack = self.model.stack();
            let from = stack.input();
            let stored = stack.pairs().last();
            let end = if rising {
                let next = stack.open_maximum().filter(|m| *m > from).or_else(|| {
                    // A pair whose maximum has just been reached is wiped out by the step there.
                    stored.map(|pair| pair.maximum)
                });
                next.unwrap_or(1.0).min(1.0)
            } else {
                stored.map_or(0.0, |pair| pair.minimum)
            };
            if (end - from).abs() <= TOLERANCE {
                let at_limit = if rising {
                    from >= 1.0 - TOLERANCE
                } else {
                    from <= TOLERANCE
                };
                if at_limit || !self.wipe(end, rising) {
                    return InverseDrive {
                        drive_v: self.at(from),
                        output_um: self.output_um,
                        saturated: true,
                    };
                }
                continue;
            }
            let mut beyond = self.model.clone();
            let end_um = beyond.step(self.at(end));
            let outside = if rising {
                desired_um > end_um
            } else {
                desired_um < end_um
            };
            if outside {
                self.model = beyond;
                self.output_um = end_um;
                continue;
            }
            let mut inside = self.model.clone();
            inside.step(self.at(0.5 * (from + end)));
            let x = solve(inside.section().0, from, end, desired_um);
            let drive_v = self.at(x);
            self.output_um = self.model.step(drive_v);
            return InverseDrive {
                drive_v,
                output_um: self.output_um,
                saturated: false,
            };
        }
    }

    /// Steps exactly onto a stored extremum so that it is wiped out; tells whether that changed the memory.
    fn wipe(&mut self, end: f64, rising: bool) -> bool {
        let before = (
            self.model.stack().pairs().len(),
            self.model.stack().open_maximum().is_some(),
        );
        let nudged = if rising {
            end + 2.0 * TOLERANCE
        } else {
            end - 2.0 * TOLERANCE
        };
        self.output_um = self.model.step(self.at(nudged.clamp(0.0, 1.0)));
        before
            != (
                self.model.stack().pairs().len(),
                self.model.stack().open_maximum().is_some(),
            )
    }
}

/// Where the polynomial takes the value `desired` between `from` and `end`, which bracket it.
fn solve(polynomial: &[f64], from: f64, end: f64, desired: f64) -> f64 {
    let (mut low, mut high) = (from.min(end), from.max(end));
    let increasing = horner(polynomial, high) >= horner(polynomial, low);
    let mut x = 0.5 * (low + high);
    for _ in 0..60 {
        let (mut value, mut slope) = (0.0, 0.0);
        for c in polynomial.iter().rev() {
            slope = slope * x + value;
            value = value * x + c;
        }
        let above = (value > desired) == increasing;
        if above {
            high = x;
        } else {
            low = x;
        }
        let newton = x - (value - desired) / slope;
        let next = if newton > low && newton < high {
            newton
        } else {
            0.5 * (low + high)
        };
        if (next - x).abs() < TOLERANCE {
            return next;
        }
        x = next;
    }
    x
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::Bench;
    use crate::hysteresis_surface::Surfaces;
    use proptest::prelude::*;

    fn reference() -> OneSidedHysteresis {
        let bench = Bench::reference().unwrap();
        OneSidedHysteresis::virgin(
            Surfaces::from_thesis_powers(&bench.hysteresis.f, &bench.hysteresis.g, 80.0),
            0.0,
            80.0,
        )
    }

    #[test]
    fn out_of_reach_saturates_and_says_so() {
        let mut inverse = HysteresisInverse::new(reference(), 0.0, 80.0);
        let up = inverse.step(9.0);
        assert!(!up.saturated && (up.output_um - 9.0).abs() < 1e-9);
        // Below the remnant: no drive reaches it (the thesis' loop would not end).
        let down = inverse.step(0.0);
        assert!(down.saturated && down.drive_v.abs() < 1e-9 && down.output_um > 0.5);
        let far = inverse.step(100.0);
        assert!(far.saturated && (far.drive_v - 80.0).abs() < 1e-9);
        assert!(!inverse.step(6.0).saturated);
    }

    proptest! {
        #[test]
        fn the_model_follows_the_inverse(desired in proptest::collection::vec(-1.0f64..14.0, 1..80)) {
            let mut inverse = HysteresisInverse::new(reference(), 0.0, 80.0);
            let mut model = reference();
            for y in desired {
                let answer = inverse.step(y);
                prop_assert!((0.0..=80.0 + 1e-9).contains(&answer.drive_v));
                let reached = model.step(answer.drive_v);
                prop_assert!((reached - answer.output_um).abs() < 1e-6);
                if answer.saturated {
                    let at_low = answer.drive_v < 1e-6 && y < reached + 1e-6;
                    let at_high = answer.drive_v > 80.0 - 1e-6 && y > reached - 1e-6;
                    prop_assert!(at_low || at_high, "{y} {answer:?}");
                } else {
                    prop_assert!((reached - y).abs() < 1e-6, "{y} {reached}");
                }
            }
        }
    }
}
