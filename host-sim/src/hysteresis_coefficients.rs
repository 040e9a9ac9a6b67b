//! What each coefficient of the hysteresis surfaces contributes to the output, along an input.
//!
//! The output of [`crate::hysteresis_surface::OneSidedHysteresis`] is linear in the coefficients `g_ij` and
//! `r_k`: the extrema of the input alone say which products of Legendre polynomials are added. One walk
//! therefore gives the derivative of the output by every coefficient, exactly, at little more than the cost
//! of the output itself.
//!
//! Between two reversals each contribution is a constant plus one product: falling from `M` it is
//! `c - (M - x) P_i(M) P_j(x)`, rising from `m` it is `c + (x - m) P_i(x) P_j(m)`, and on the
//! initial ascending curve `x P_i(x) P_j(0)` or, of the remnant, `x P_k(x)`. The factor that does
//! not move with the input is kept per section.

use crate::hysteresis_surface::{STACK_CAPACITY, loop_terms};
use hysteron_core::extrema_stack::ExtremaStack;

/// Contributions of all coefficients, walking along an input: first `g_ij` in the order of [`loop_terms`],
/// then `r_k`; um per um.
#[derive(Clone, Debug)]
pub struct CoefficientWalk {
    terms: Vec<(usize, usize)>,
    remnant_terms: usize,
    stack: ExtremaStack<f64, STACK_CAPACITY>,
    /// Contributions at each remembered maximum.
    at_maxima: Vec<Vec<f64>>,
    /// Contributions where the section that runs now began, and the factor of each that stays along it.
    section: Section,
    polynomials: Vec<f64>,
    contributions: Vec<f64>,
}

#[derive(Clone, Debug)]
enum Section {
    InitialCurve,
    Falling {
        maximum: f64,
        factors: Vec<f64>,
    },
    Rising {
        minimum: f64,
        factors: Vec<f64>,
        began: Vec<f64>,
    },
}

/// Shifted Legendre polynomials at `x`, as many as `out` has room for.
fn evaluate_legendre(x: f64, out: &mut [f64]) {
    let t = 2.0 * x - 1.0;
    let (mut previous, mut current) = (1.0, t);
    for (n, value) in out.iter_mut().enumerate() {
        *value = previous;
        let m = (n + 1) as f64;
        (previous, current) = (
            current,
            ((2.0 * m + 1.0) * t * current - m * previous) / (m + 1.0),
        );
    }
}

/// Shifted Legendre polynomials alternate between 1 and -1 at zero.
fn legendre_at_zero(order: usize) -> f64 {
    if order.is_multiple_of(2) { 1.0 } else { -1.0 }
}

impl CoefficientWalk {
    /// Virgin, at the lower limit of the drive, for a loop surface of this degree and so many terms of the
    /// remnant.
    #[must_use]
    pub fn virgin(degree: usize, remnant_terms: usize) -> Self {
        let terms: Vec<(usize, usize)> = loop_terms(degree).collect();
        let count = terms.len() + remnant_terms;
        Self {
            terms,
            remnant_terms,
            stack: ExtremaStack::virgin(0.0),
            at_maxima: Vec::new(),
            section: Section::InitialCurve,
            polynomials: vec![0.0; degree.max(remnant_terms)],
            contributions: vec![0.0; count],
        }
    }

    /// Takes the next input, in units of the drive range above its lower limit, and returns the contribution
    /// of every coefficient.
    pub fn step(&mut self, x: f64) -> &[f64] {
        let before = (
            self.stack.pairs().len(),
            self.stack.open_maximum().is_none(),
        );
        let unchanged = self.stack.update(x);
        let after = (
            self.stack.pairs().len(),
            self.stack.open_maximum().is_none(),
        );
        if before != after || unchanged != after.0 {
            self.enter_section(unchanged);
        }
        self.evaluate(x);
        &self.contributions
    }

    /// What the initial ascending curve is made of at the global maximum of the input.
    #[must_use]
    pub fn initial_curve_at_maximum(&self) -> Vec<f64> {
        self.initial_curve(self.global_maximum())
    }

    /// Global maximum of the input so far.
    #[must_use]
    pub fn global_maximum(&self) -> f64 {
        self.stack.global_maximum()
    }

    fn evaluate(&mut self, x: f64) {
        evaluate_legendre(x, &mut self.polynomials);
        let p = &self.polynomials;
        let loops = self.terms.len();
        match &self.section {
            Section::InitialCurve => {
                for (out, (i, j)) in self.contributions.iter_mut().zip(&self.terms) {
                    *out = x * p[*i] * legendre_at_zero(*j);
                }
                for (out, p) in self.contributions[loops..].iter_mut().zip(p) {
                    *out = x * p;
                }
            }
            Section::Falling { maximum, factors } => {
                let Some(began) = self.at_maxima.last() else {
                    return;
                };
                let height = maximum - x;
                for (((out, began), factor), (_, j)) in self
                    .contributions
                    .iter_mut()
                    .zip(began)
                    .zip(factors)
                    .zip(&self.terms)
                {
                    *out = began - height * factor * p[*j];
                }
                self.contributions[loops..].copy_from_slice(&began[loops..]);
            }
            Section::Rising {
                minimum,
                factors,
                began,
            } => {
                let height = x - minimum;
                for (((out, began), factor), (i, _)) in self
                    .contributions
                    .iter_mut()
                    .zip(began)
                    .zip(factors)
                    .zip(&self.terms)
                {
                    *out = began + height * factor * p[*i];
                }
                self.contributions[loops..].copy_from_slice(&began[loops..]);
            }
        }
    }

    fn initial_curve(&self, x: f64) -> Vec<f64> {
        let mut p = vec![0.0; self.polynomials.len()];
        evaluate_legendre(x, &mut p);
        let loops = self
            .terms
            .iter()
            .map(|(i, j)| x * p[*i] * legendre_at_zero(*j));
        loops
            .chain(p.iter().take(self.remnant_terms).map(|p| x * p))
            .collect()
    }

    /// `G(x, z)` of every coefficient; nothing for those of the remnant.
    fn loop_loss(&self, x: f64, z: f64) -> Vec<f64> {
        let (mut at_x, mut at_z) = (
            vec![0.0; self.polynomials.len()],
            vec![0.0; self.polynomials.len()],
        );
        evaluate_legendre(x, &mut at_x);
        evaluate_legendre(z, &mut at_z);
        let loops = self
            .terms
            .iter()
            .map(|(i, j)| (x - z) * at_x[*i] * at_z[*j]);
        loops
            .chain(std::iter::repeat_n(0.0, self.remnant_terms))
            .collect()
    }

    /// The section that runs now; `unchanged` leading pairs of the stack are those of the section before.
    fn enter_section(&mut self, unchanged: usize) {
        self.at_maxima.truncate(unchanged);
        if self.stack.on_initial_ascending_curve() {
            self.section = Section::InitialCurve;
            return;
        }
        let pairs = self.stack.pairs();
        let open_maximum = self.stack.open_maximum();
        let maxima = pairs.iter().map(|p| p.maximum).chain(open_maximum);
        for (k, maximum) in maxima.enumerate().skip(self.at_maxima.len()) {
            let contributions = match k.checked_sub(1) {
                None => self.initial_curve_at_maximum(),
                Some(before) => {
                    let pair = pairs[before];
                    let (down, up) = (
                        self.loop_loss(pair.maximum, pair.minimum),
                        self.loop_loss(maximum, pair.minimum),
                    );
                    self.at_maxima[before]
                        .iter()
                        .zip(down)
                        .zip(up)
                        .map(|((at, down), up)| at - down + up)
                        .collect()
                }
            };
            self.at_maxima.push(contributions);
        }
        let mut p = vec![0.0; self.polynomials.len()];
        match (open_maximum, pairs.last()) {
            (Some(maximum), _) => {
                evaluate_legendre(maximum, &mut p);
                self.section = Section::Falling {
                    maximum,
                    factors: self.terms.iter().map(|(i, _)| p[*i]).collect(),
                };
            }
            (None, Some(last)) => {
                let down = self.loop_loss(last.maximum, last.minimum);
                let began = self.at_maxima.last().map_or_else(Vec::new, |at| {
                    at.iter().zip(down).map(|(at, down)| at - down).collect()
                });
                evaluate_legendre(last.minimum, &mut p);
                let factors = self.terms.iter().map(|(_, j)| p[*j]).collect();
                self.section = Section::Rising {
                    minimum: last.minimum,
                    factors,
                    began,
                };
            }
            (None, None) => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hysteresis_surface::{OneSidedHysteresis, Surfaces};
    use proptest::prelude::*;

    proptest! {
        /// Weighted with the coefficients, the contributions are the output.
        #[test]
        fn the_contributions_add_up_to_the_output(
            coefficients in proptest::collection::vec(-1.0f64..1.0, 15 + 3),
            inputs in proptest::collection::vec(-0.1f64..1.0, 1..80),
        ) {
            let mut operator = OneSidedHysteresis::virgin(Surfaces::from_legendre(5, &coefficients[..15], &coefficients[15..]), 0.0, 1.0);
            let mut walk = CoefficientWalk::virgin(5, 3);
            for x in inputs {
                let sum: f64 = walk.step(x).iter().zip(&coefficients).map(|(a, b)| a * b).sum();
                prop_assert!((sum - operator.step(x)).abs() < 1e-10);
                let curve: f64 = walk.initial_curve_at_maximum().iter().zip(&coefficients).map(|(a, b)| a * b).sum();
                prop_assert!((curve - operator.initial_curve_at_maximum()).abs() < 1e-10);
            }
        }
    }
}
