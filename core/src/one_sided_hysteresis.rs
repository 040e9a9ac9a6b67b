//! The one-sided hysteresis (thesis Ch. 4, Eqs. 10-15) and its inverse, in integers and in a fixed number of
//! steps.
//!
//! # How it works
//! Between two reversals the output is a polynomial of the drive alone: `v_m + G(x, m)` on the way up from a
//! minimum `(m, v_m)`, `v_M - G(M, x)` on the way down from a maximum `(M, v_M)`, `F(x)` on the initial
//! ascending curve. The [`ExtremaStack`] remembers every extremum *with its output*, so a new section needs
//! only the coefficients of `G` collapsed at one extremum, no sum over the stack.
//!
//! Polynomials are evaluated by Horner's rule in the variable's upper half: the high word of the product of a
//! coefficient and a share with 31 fraction bits is half their product, so a coefficient of degree `d`
//! carries `d` fraction bits more than the constant, and each step of the rule is one multiply-accumulate
//! instruction (SMMLAR) of the target.
//!
//! The inverse walks outward over the stored extrema until it finds the section that contains the wanted
//! output (at most one comparison for each stored pair), then takes at most [`NEWTON_STEPS`] Newton steps in
//! the bracket of that section. All sections are monotone, so the bracket always contains the solution.
//! Outputs below what zero drive gives (the remnant) and above the range saturate and report it (erratum of
//! the thesis' pseudo-code, which loops for ever there).
//!
//! When the stack is full the smallest loop is forgotten. The output then differs from the full model's by at
//! most the width of that loop, which is bounded by `max |d2 G/dx dz| * height^2`;
//! [`OneSidedHysteresis::largest_dropped_loop`] is the height.

use crate::extrema_stack::ExtremaStack;
use crate::signal::{MICROMETRE_FRACTION_BITS, SHARE_FRACTION_BITS, narrow, sum};

/// Pairs of extrema that the controller remembers: 32 reversals.
pub const STACK_CAPACITY: usize = 16;
/// Rows of the loop surface: powers 0 to 4, as in the thesis (Ch. 4, Eq. 15).
pub const SURFACE_SIZE: usize = 5;
/// Most Newton steps of the inverse; from one tick to the next one or two are enough, and then it stops.
pub const NEWTON_STEPS: usize = 5;
/// A Newton step that needs no other one, as a share of the range (1.2e-4): the next would be about its
/// square, or its product with the reciprocal's error, less than a hundredth of a DAC code.
const SMALL_STEP: i32 = 1 << 17;
/// Fraction bits of the surface coefficients of degree 0, um; a coefficient of degree `d` has `d` more.
pub const SURFACE_FRACTION_BITS: u32 = 20;
/// Largest sum of the magnitudes of all coefficients of degree `d` and more, um: below it no intermediate
/// value of the evaluation wraps.
pub const SURFACE_LIMITS_UM: [i32; SURFACE_SIZE] = [300, 300, 256, 256, 128];

const ONE: i32 = 1 << SHARE_FRACTION_BITS;
/// From the format of the coefficients to that of the output.
const OUTPUT_SHIFT: u32 = MICROMETRE_FRACTION_BITS - SURFACE_FRACTION_BITS;
/// Least slope that a Newton step trusts: 1/8 um over the whole range.
const LEAST_SLOPE: i32 = 1 << (SURFACE_FRACTION_BITS - 3);

/// Fraction bits of a coefficient of `x^i z^j`.
#[must_use]
pub const fn surface_fraction_bits(i: usize, j: usize) -> u32 {
    SURFACE_FRACTION_BITS + (i + j) as u32
}

/// Surfaces of the hysteresis in powers of the drive share, um with [`surface_fraction_bits`]; sums within
/// [`SURFACE_LIMITS_UM`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SurfaceCoefficients {
    /// `g[i][j]` multiplies `x^i z^j` in `G(x, z)`; zero where `i + j` exceeds the degree.
    pub g: [[i32; SURFACE_SIZE]; SURFACE_SIZE],
    /// `f[i]` multiplies `x^i` in the initial ascending curve `F(x)`.
    pub f: [i32; SURFACE_SIZE],
}

type Polynomial = [i32; SURFACE_SIZE];

/// A drive share with 31 fraction bits.
#[inline(always)]
fn fine(share: i32) -> i32 {
    share.saturating_add(share)
}

/// `a + b x / 2` for `x` with 31 fraction bits, rounded: one step of Horner's rule.
#[inline(always)]
fn step(a: i32, b: i32, x: i32) -> i32 {
    narrow(
        sum(
            sum(i64::from(b) * i64::from(x), i64::from(a) << 32),
            1 << 31,
        ) >> 32,
    )
}

#[inline(always)]
fn horner(&[c0, c1, c2, c3, c4]: &Polynomial, share: i32) -> i32 {
    let x = fine(share);
    step(c0, step(c1, step(c2, step(c3, c4, x), x), x), x)
}

/// Value and slope, both with [`SURFACE_FRACTION_BITS`].
#[inline(always)]
fn horner_with_slope(&[c0, c1, c2, c3, c4]: &Polynomial, share: i32) -> (i32, i32) {
    let x = fine(share);
    // The derivative of step k is that of step k + 1, times x, plus half the value of step k + 1.
    let value_3 = step(c3, c4, x);
    let slope_3 = c4 >> 1;
    let value_2 = step(c2, value_3, x);
    let slope_2 = step(value_3 >> 1, slope_3, x);
    let value_1 = step(c1, value_2, x);
    let slope_1 = step(value_2 >> 1, slope_2, x);
    (step(c0, value_1, x), step(value_1 >> 1, slope_1, x))
}

impl SurfaceCoefficients {
    /// `G(x, m)` as a polynomial in `x`. Powers with `i + j` beyond the degree are zero.
    #[inline]
    fn rising_from(&self, minimum: i32) -> Polynomial {
        let z = fine(minimum);
        let [
            [g00, g01, g02, g03, g04],
            [g10, g11, g12, g13, _],
            [g20, g21, g22, ..],
            [g30, g31, ..],
            [g40, ..],
        ] = self.g;
        [
            step(g00, step(g01, step(g02, step(g03, g04, z), z), z), z),
            step(g10, step(g11, step(g12, g13, z), z), z),
            step(g20, step(g21, g22, z), z),
            step(g30, g31, z),
            g40,
        ]
    }

    /// `-G(M, z)` as a polynomial in `z`.
    #[inline]
    fn falling_from(&self, maximum: i32) -> Polynomial {
        let x = fine(maximum);
        let [
            [g00, g01, g02, g03, g04],
            [g10, g11, g12, g13, _],
            [g20, g21, g22, ..],
            [g30, g31, ..],
            [g40, ..],
        ] = self.g;
        [
            step(g00, step(g10, step(g20, step(g30, g40, x), x), x), x),
            step(g01, step(g11, step(g21, g31, x), x), x),
            step(g02, step(g12, g22, x), x),
            step(g03, g13, x),
            g04,
        ]
        .map(i32::wrapping_neg)
    }
}

/// A drive share with the output there. Ordered by the drive.
#[derive(Clone, Copy, Debug, Default)]
pub struct Extremum {
    /// Drive share.
    pub share: i32,
    /// Force-equivalent displacement there.
    pub output: i32,
}

impl PartialEq for Extremum {
    fn eq(&self, other: &Self) -> bool {
        self.share == other.share
    }
}

impl PartialOrd for Extremum {
    fn partial_cmp(&self, other: &Self) -> Option<core::cmp::Ordering> {
        self.share.partial_cmp(&other.share)
    }
}

impl core::ops::Sub for Extremum {
    type Output = Self;
    fn sub(self, other: Self) -> Self {
        Self {
            share: self.share.wrapping_sub(other.share),
            output: self.output.wrapping_sub(other.output),
        }
    }
}

/// One monotone section: `output = base + polynomial(share)`.
#[derive(Clone, Copy, Debug)]
struct Section {
    polynomial: Polynomial,
    base: i32,
}

impl Section {
    #[inline]
    fn output(&self, share: i32) -> i32 {
        // Surfaces that no actuator has could leave the format: they saturate (two instructions).
        let above = horner(&self.polynomial, share)
            .clamp(i32::MIN >> OUTPUT_SHIFT, i32::MAX >> OUTPUT_SHIFT);
        self.base.saturating_add(above << OUTPUT_SHIFT)
    }

    /// The share between `low` and `high` at which the section has the output `target`.
    #[inline]
    fn solve(&self, target: i32, start: i32, low: i32, high: i32) -> i32 {
        let mut share = start.max(low).min(high);
        let wanted = target.saturating_sub(self.base) >> OUTPUT_SHIFT;
        for _ in 0..NEWTON_STEPS {
            let (value, slope) = horner_with_slope(&self.polynomial, share);
            let slope = slope.max(LEAST_SLOPE);
            // No step beyond the whole range.
            let error = wanted
                .wrapping_sub(value)
                .min(slope)
                .max(slope.wrapping_neg());
            // A reciprocal of 10 to 20 bits is enough for a step that is repeated.
            let reciprocal = (1u32 << 31).checked_div((slope >> 7) as u32).unwrap_or(0);
            let step = narrow((i64::from(error) * i64::from(reciprocal)) >> 8);
            share = share.saturating_add(step).max(low).min(high);
            if step > -SMALL_STEP && step < SMALL_STEP {
                break;
            }
        }
        share
    }
}

/// What the inverse found.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Inverse {
    /// Drive share.
    pub share: i32,
    /// False if the wanted output is outside what the drive range can give now.
    pub reachable: bool,
}

/// The hysteresis with its memory.
#[derive(Clone, Debug)]
pub struct OneSidedHysteresis {
    surfaces: SurfaceCoefficients,
    stack: ExtremaStack<Extremum, STACK_CAPACITY>,
    section: Section,
    output: i32,
}

impl OneSidedHysteresis {
    /// A virgin actuator at the lower limit of the drive.
    #[must_use]
    pub fn virgin(surfaces: SurfaceCoefficients) -> Self {
        let section = Section {
            polynomial: surfaces.f,
            base: 0,
        };
        let output = section.output(0);
        let mut stack = ExtremaStack::virgin(Extremum { share: 0, output });
        stack.update(Extremum { share: 0, output });
        Self {
            surfaces,
            stack,
            section,
            output,
        }
    }

    /// Applies a drive share (0 to 1) and returns the force-equivalent displacement, um.
    pub fn apply(&mut self, share: i32) -> i32 {
        let share = share.clamp(0, ONE);
        let before = (
            self.stack.pairs().len(),
            self.stack.open_maximum().is_some(),
        );
        let unchanged = self.stack.update(Extremum { share, output: 0 });
        let after = (
            self.stack.pairs().len(),
            self.stack.open_maximum().is_some(),
        );
        if before != after || unchanged != after.0 {
            self.section = match (self.stack.open_maximum(), self.stack.pairs().last()) {
                (Some(maximum), _) => self.falling(maximum),
                (None, Some(last)) => self.rising(last.minimum),
                (None, None) => Section {
                    polynomial: self.surfaces.f,
                    base: 0,
                },
            };
        }
        self.output = self.section.output(share);
        // The same drive: only the output beside it changes.
        self.stack.replace_input(Extremum {
            share,
            output: self.output,
        });
        self.output
    }

    /// The drive share that gives the output `target`, um, from here. Nothing is changed.
    #[must_use]
    pub fn inverse(&self, target: i32) -> Inverse {
        let now = Extremum {
            share: self.stack.input().share,
            output: self.output,
        };
        if target >= self.output {
            self.inverse_rising(target, now)
        } else {
            self.inverse_falling(target, now)
        }
    }

    fn inverse_rising(&self, target: i32, now: Extremum) -> Inverse {
        let mut low = now.share;
        if let Some(maximum) = self.stack.open_maximum() {
            if target < maximum.output {
                return Inverse {
                    share: self.rising(now).solve(target, low, low, maximum.share),
                    reachable: true,
                };
            }
            low = maximum.share;
        }
        let innermost = self.stack.pairs().len();
        for (k, pair) in self.stack.pairs().iter().enumerate().rev() {
            if target < pair.maximum.output {
                let kept = self.stack.open_maximum().is_none() && k + 1 == innermost;
                let section = if kept {
                    self.section
                } else {
                    self.rising(pair.minimum)
                };
                return Inverse {
                    share: section.solve(target, low, low, pair.maximum.share),
                    reachable: true,
                };
            }
            low = pair.maximum.share;
        }
        let section = Section {
            polynomial: self.surfaces.f,
            base: 0,
        };
        Inverse {
            share: section.solve(target, low, low, ONE),
            reachable: target <= section.output(ONE),
        }
    }

    fn inverse_falling(&self, target: i32, now: Extremum) -> Inverse {
        let mut high = now.share;
        // The maximum that the section under test falls from; `None`: the section that is running.
        let mut from = if self.stack.open_maximum().is_some() {
            None
        } else {
            Some(now)
        };
        for pair in self.stack.pairs().iter().rev() {
            if target > pair.minimum.output {
                return Inverse {
                    share: self
                        .falling_or_kept(from)
                        .solve(target, high, pair.minimum.share, high),
                    reachable: true,
                };
            }
            high = pair.minimum.share;
            from = Some(pair.maximum);
        }
        let section = self.falling_or_kept(from);
        Inverse {
            share: section.solve(target, high, 0, high),
            reachable: target >= section.output(0),
        }
    }

    fn falling_or_kept(&self, from: Option<Extremum>) -> Section {
        from.map_or(self.section, |maximum| self.falling(maximum))
    }

    fn rising(&self, minimum: Extremum) -> Section {
        Section {
            polynomial: self.surfaces.rising_from(minimum.share),
            base: minimum.output,
        }
    }

    fn falling(&self, maximum: Extremum) -> Section {
        Section {
            polynomial: self.surfaces.falling_from(maximum.share),
            base: maximum.output,
        }
    }

    /// The same memory of the drive under other surfaces. Not for the tick: the whole memory is evaluated
    /// again.
    #[must_use]
    pub fn with_surfaces(&self, surfaces: SurfaceCoefficients) -> Self {
        let mut out = Self::virgin(surfaces);
        for pair in self.stack.pairs() {
            out.apply(pair.maximum.share);
            out.apply(pair.minimum.share);
        }
        if let Some(maximum) = self.stack.open_maximum() {
            out.apply(maximum.share);
        }
        out.apply(self.stack.input().share);
        out
    }

    /// Force-equivalent displacement now, um.
    #[must_use]
    pub fn output(&self) -> i32 {
        self.output
    }

    /// Drive share now.
    #[must_use]
    pub fn share(&self) -> i32 {
        self.stack.input().share
    }

    /// Pairs of extrema remembered now.
    #[must_use]
    pub fn stored_pairs(&self) -> usize {
        self.stack.pairs().len()
    }

    /// Loops forgotten because the stack was full.
    #[must_use]
    pub fn dropped_loops(&self) -> u32 {
        self.stack.dropped_loops()
    }

    /// Height of the largest forgotten loop, as a drive share.
    #[must_use]
    pub fn largest_dropped_loop(&self) -> i32 {
        self.stack.largest_dropped_loop().share
    }
}
