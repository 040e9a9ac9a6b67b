//! The one-sided hysteresis (thesis Ch. 4, Eqs. 10-15) and its inverse, in integers and in a fixed number of steps.
//!
//! # How it works
//! Between two reversals the output is a polynomial of the drive alone: `v_m + G(x, m)` on the way up from a minimum `(m, v_m)`,
//! `v_M - G(M, x)` on the way down from a maximum `(M, v_M)`, `F(x)` on the initial ascending curve. The [`ExtremaStack`] remembers
//! every extremum *with its output*, so a new section needs only the coefficients of `G` collapsed at one extremum, no sum over
//! the stack.
//!
//! The inverse walks outward over the stored extrema until it finds the section that contains the wanted output (at most one
//! comparison for each stored pair), then takes at most [`NEWTON_STEPS`] Newton steps in the bracket of that section. All sections are monotone,
//! so the bracket always contains the solution. Outputs below what zero drive gives (the remnant) and above the range saturate
//! and say so (erratum of the thesis' pseudo-code, which loops for ever there).
//!
//! When the stack is full the smallest loop is forgotten. The output then differs from the full model's by at most the width of that
//! loop, which is bounded by `max |d2 G/dx dz| * height^2`; [`OneSidedHysteresis::largest_dropped_loop`] is the height.

use crate::extrema_stack::ExtremaStack;
use crate::signal::{MICROMETRE_FRACTION_BITS, SHARE_FRACTION_BITS};

/// Pairs of extrema that the controller remembers: 32 reversals.
pub const STACK_CAPACITY: usize = 16;
/// Rows of the loop surface: powers 0 to 4, as in the thesis (Ch. 4, Eq. 15).
pub const SURFACE_SIZE: usize = 5;
/// Most Newton steps of the inverse; from one tick to the next two or three are enough, and then it stops.
pub const NEWTON_STEPS: usize = 5;
/// A step of a Newton iteration that is not worth another one, as a share of the range (2e-7: a hundredth of a DAC code).
const SMALL_STEP: i64 = 1 << 8;
/// Fraction bits of the surface coefficients, um.
pub const SURFACE_FRACTION_BITS: u32 = 22;

const ONE: i32 = 1 << SHARE_FRACTION_BITS;
/// From the format of the coefficients to that of the output.
const OUTPUT_SHIFT: u32 = MICROMETRE_FRACTION_BITS - SURFACE_FRACTION_BITS;
/// Least slope that a Newton step trusts: 1/8 um over the whole range.
const LEAST_SLOPE: i32 = 1 << (SURFACE_FRACTION_BITS - 3);

/// Surfaces of the hysteresis in powers of the drive share, um with [`SURFACE_FRACTION_BITS`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SurfaceCoefficients {
    /// `g[i][j]` multiplies `x^i z^j` in `G(x, z)`; zero where `i + j` exceeds the degree.
    pub g: [[i32; SURFACE_SIZE]; SURFACE_SIZE],
    /// `f[i]` multiplies `x^i` in the initial ascending curve `F(x)`.
    pub f: [i32; SURFACE_SIZE],
}

type Polynomial = [i32; SURFACE_SIZE];

/// Product of a coefficient and a share.
#[inline]
fn times(a: i32, share: i32) -> i32 {
    ((i64::from(a) * i64::from(share)) >> SHARE_FRACTION_BITS) as i32
}

#[inline]
fn horner(c: &Polynomial, x: i32) -> i32 {
    let mut value = 0i32;
    for coefficient in c.iter().rev() {
        value = times(value, x).wrapping_add(*coefficient);
    }
    value
}

#[inline]
fn horner_with_slope(c: &Polynomial, x: i32) -> (i32, i32) {
    let (mut value, mut slope) = (0i32, 0i32);
    for coefficient in c.iter().rev() {
        slope = times(slope, x).wrapping_add(value);
        value = times(value, x).wrapping_add(*coefficient);
    }
    (value, slope)
}

impl SurfaceCoefficients {
    /// `G(x, m)` as a polynomial in `x`.
    #[inline]
    fn rising_from(&self, minimum: i32) -> Polynomial {
        let mut out = [0; SURFACE_SIZE];
        for (i, (value, row)) in out.iter_mut().zip(&self.g).enumerate() {
            // Powers with i + j beyond the degree are zero.
            let mut sum = 0i32;
            for coefficient in row.iter().take(SURFACE_SIZE - i).rev() {
                sum = times(sum, minimum).wrapping_add(*coefficient);
            }
            *value = sum;
        }
        out
    }

    /// `-G(M, z)` as a polynomial in `z`.
    #[inline]
    fn falling_from(&self, maximum: i32) -> Polynomial {
        let mut out = [0i32; SURFACE_SIZE];
        for (i, row) in self.g.iter().enumerate().rev() {
            // Powers with i + j beyond the degree are zero.
            for (j, value) in out.iter_mut().enumerate().take(SURFACE_SIZE - i) {
                let coefficient = row.get(j).copied().unwrap_or(0);
                *value = times(*value, maximum).wrapping_sub(coefficient);
            }
        }
        out
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
        Self { share: self.share.wrapping_sub(other.share), output: self.output.wrapping_sub(other.output) }
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
        self.base.wrapping_add(horner(&self.polynomial, share) << OUTPUT_SHIFT)
    }

    /// The share between `low` and `high` at which the section has the output `target`.
    #[inline]
    fn solve(&self, target: i32, start: i32, low: i32, high: i32) -> i32 {
        let mut share = start.max(low).min(high);
        let wanted = target.wrapping_sub(self.base) >> OUTPUT_SHIFT;
        for _ in 0..NEWTON_STEPS {
            let (value, slope) = horner_with_slope(&self.polynomial, share);
            // A reciprocal of 13 to 20 bits is enough for a step that is repeated.
            let divisor = (slope.max(LEAST_SLOPE) >> 8) as u32;
            let reciprocal = (1u32 << 31).checked_div(divisor).unwrap_or(0);
            let step = (i64::from(wanted.wrapping_sub(value)) * i64::from(reciprocal)) >> 9;
            let next = i64::from(share).wrapping_add(step);
            share = next.max(i64::from(low)).min(i64::from(high)) as i32;
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
        let section = Section { polynomial: surfaces.f, base: 0 };
        let output = section.output(0);
        let mut stack = ExtremaStack::virgin(Extremum { share: 0, output });
        stack.update(Extremum { share: 0, output });
        Self { surfaces, stack, section, output }
    }

    /// Applies a drive share (0 to 1) and returns the force-equivalent displacement, um.
    pub fn apply(&mut self, share: i32) -> i32 {
        let share = share.clamp(0, ONE);
        let before = (self.stack.pairs().len(), self.stack.open_maximum().is_some());
        let unchanged = self.stack.update(Extremum { share, output: 0 });
        let after = (self.stack.pairs().len(), self.stack.open_maximum().is_some());
        if before != after || unchanged != after.0 {
            self.section = match (self.stack.open_maximum(), self.stack.pairs().last()) {
                (Some(maximum), _) => self.falling(maximum),
                (None, Some(last)) => self.rising(last.minimum),
                (None, None) => Section { polynomial: self.surfaces.f, base: 0 },
            };
        }
        self.output = self.section.output(share);
        // The same drive again: only the output beside it changes.
        self.stack.update(Extremum { share, output: self.output });
        self.output
    }

    /// The drive share that gives the output `target`, um, from here. Nothing is changed.
    #[must_use]
    pub fn inverse(&self, target: i32) -> Inverse {
        let now = Extremum { share: self.stack.input().share, output: self.output };
        if target >= self.output { self.inverse_rising(target, now) } else { self.inverse_falling(target, now) }
    }

    fn inverse_rising(&self, target: i32, now: Extremum) -> Inverse {
        let mut low = now.share;
        if let Some(maximum) = self.stack.open_maximum() {
            if target < maximum.output {
                return Inverse { share: self.rising(now).solve(target, low, low, maximum.share), reachable: true };
            }
            low = maximum.share;
        }
        let innermost = self.stack.pairs().len();
        for (k, pair) in self.stack.pairs().iter().enumerate().rev() {
            if target < pair.maximum.output {
                let kept = self.stack.open_maximum().is_none() && k + 1 == innermost;
                let section = if kept { self.section } else { self.rising(pair.minimum) };
                return Inverse { share: section.solve(target, low, low, pair.maximum.share), reachable: true };
            }
            low = pair.maximum.share;
        }
        let section = Section { polynomial: self.surfaces.f, base: 0 };
        Inverse { share: section.solve(target, low, low, ONE), reachable: target <= section.output(ONE) }
    }

    fn inverse_falling(&self, target: i32, now: Extremum) -> Inverse {
        let mut high = now.share;
        // The maximum that the section under test falls from; `None`: the section that is running.
        let mut from = if self.stack.open_maximum().is_some() { None } else { Some(now) };
        for pair in self.stack.pairs().iter().rev() {
            if target > pair.minimum.output {
                return Inverse { share: self.falling_or_kept(from).solve(target, high, pair.minimum.share, high), reachable: true };
            }
            high = pair.minimum.share;
            from = Some(pair.maximum);
        }
        let section = self.falling_or_kept(from);
        Inverse { share: section.solve(target, high, 0, high), reachable: target >= section.output(0) }
    }

    fn falling_or_kept(&self, from: Option<Extremum>) -> Section {
        from.map_or(self.section, |maximum| self.falling(maximum))
    }

    fn rising(&self, minimum: Extremum) -> Section {
        Section { polynomial: self.surfaces.rising_from(minimum.share), base: minimum.output }
    }

    fn falling(&self, maximum: Extremum) -> Section {
        Section { polynomial: self.surfaces.falling_from(maximum.share), base: maximum.output }
    }

    /// The same memory of the drive under other surfaces. Not for the tick: the whole memory is evaluated again.
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
