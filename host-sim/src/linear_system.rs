//! Exact discretisation of small linear systems whose input is held, or runs straight, between two instants.
//!
//! Both forms come from one matrix exponential (Van Loan, IEEE Trans. Autom. Control 23 (1978) 395-404): the
//! state is augmented with the input, and with its slope for the straight case.

use nalgebra::{DMatrix, DVector};

/// A single-input single-output system in continuous time, `x' = A x + b u`, `y = c x + d u`.
#[derive(Clone, Debug, PartialEq)]
pub struct ContinuousSystem {
    /// State matrix, n x n, in 1/s.
    pub a: DMatrix<f64>,
    /// Input vector, n.
    pub b: DVector<f64>,
    /// Output vector, n.
    pub c: DVector<f64>,
    /// Feed-through.
    pub d: f64,
}

impl ContinuousSystem {
    /// Controllable canonical form of `numerator(s) / denominator(s)`, coefficients in descending powers of
    /// s.
    ///
    /// The numerator may be as long as the denominator (feed-through). Returns `None` for an empty or zero
    /// leading denominator or a numerator that is longer than it.
    #[must_use]
    pub fn from_transfer_function(numerator: &[f64], denominator: &[f64]) -> Option<Self> {
        let leading = *denominator.first()?;
        if leading == 0.0 || numerator.len() > denominator.len() {
            return None;
        }
        let n = denominator.len() - 1;
        let monic: Vec<f64> = denominator.iter().map(|v| v / leading).collect();
        let mut padded = vec![0.0; denominator.len() - numerator.len()];
        padded.extend(numerator.iter().map(|v| v / leading));
        let d = padded[0];
        let mut a = DMatrix::zeros(n, n);
        for i in 0..n.saturating_sub(1) {
            a[(i, i + 1)] = 1.0;
        }
        let mut c = DVector::zeros(n);
        for j in 0..n {
            a[(n - 1, j)] = -monic[n - j];
            c[j] = padded[n - j] - d * monic[n - j];
        }
        let mut b = DVector::zeros(n);
        if n > 0 {
            b[n - 1] = 1.0;
        }
        Some(Self { a, b, c, d })
    }

    /// Output at rest for a constant input of one.
    #[must_use]
    pub fn static_gain(&self) -> Option<f64> {
        let at_rest = self.a.clone().lu().solve(&(-&self.b))?;
        Some(self.c.dot(&at_rest) + self.d)
    }

    /// Transition matrix and input vector over one interval in which the input is held.
    #[must_use]
    pub fn held_matrices(&self, dt_s: f64) -> (DMatrix<f64>, DVector<f64>) {
        let (phi, [held]) = self.matrices_of_powers(dt_s);
        (phi, held)
    }

    /// Transition matrix, and input vectors over one interval for an input that is held, and for one that
    /// rises straight from zero to one.
    #[must_use]
    pub fn straight_matrices(&self, dt_s: f64) -> (DMatrix<f64>, DVector<f64>, DVector<f64>) {
        let (phi, [held, slope]) = self.matrices_of_powers(dt_s);
        (phi, held, slope)
    }

    /// Transition matrix, and input vectors over one interval for inputs of one, of its share of the interval
    /// that has passed, and of the square of that share.
    #[must_use]
    pub fn quadratic_matrices(&self, dt_s: f64) -> (DMatrix<f64>, [DVector<f64>; 3]) {
        self.matrices_of_powers(dt_s)
    }

    /// The powers of the share of the interval that has passed are states more, each driven by the one below.
    fn matrices_of_powers<const N: usize>(&self, dt_s: f64) -> (DMatrix<f64>, [DVector<f64>; N]) {
        let n = self.a.nrows();
        let mut augmented = DMatrix::zeros(n + N, n + N);
        augmented
            .view_mut((0, 0), (n, n))
            .copy_from(&(&self.a * dt_s));
        augmented
            .view_mut((0, n), (n, 1))
            .copy_from(&(&self.b * dt_s));
        for power in 1..N {
            augmented[(n + power - 1, n + power)] = power as f64;
        }
        let exponential = augmented.exp();
        let column = |k: usize| exponential.view((0, n + k), (n, 1)).column(0).into_owned();
        (
            exponential.view((0, 0), (n, n)).into_owned(),
            std::array::from_fn(column),
        )
    }

    /// Discretises for inputs that run straight from one instant to the next (a held input is the special
    /// case of no slope).
    #[must_use]
    pub fn discretise(&self, dt_s: f64) -> DiscreteSystem {
        let n = self.a.nrows();
        let (phi, gamma_held, gamma_slope) = self.straight_matrices(dt_s);
        DiscreteSystem {
            phi: phi.transpose().as_slice().to_vec(),
            gamma_start: (&gamma_held - &gamma_slope).as_slice().to_vec(),
            gamma_end: gamma_slope.as_slice().to_vec(),
            c: self.c.as_slice().to_vec(),
            d: self.d,
            state: vec![0.0; n],
            next: vec![0.0; n],
            input: 0.0,
            settle: self
                .a
                .clone()
                .lu()
                .solve(&(-&self.b))
                .map(|v| v.as_slice().to_vec()),
        }
    }
}

/// A discretised system with its state; one step carries it over one interval.
#[derive(Clone, Debug)]
pub struct DiscreteSystem {
    phi: Vec<f64>,
    gamma_start: Vec<f64>,
    gamma_end: Vec<f64>,
    c: Vec<f64>,
    d: f64,
    state: Vec<f64>,
    next: Vec<f64>,
    input: f64,
    settle: Option<Vec<f64>>,
}

impl DiscreteSystem {
    /// One interval with the input held at `input`; the output at its end.
    pub fn step_held(&mut self, input: f64) -> f64 {
        self.advance(input, input)
    }

    /// One interval in which the input runs straight from its last value to `input`; the output at its end.
    pub fn step_straight(&mut self, input: f64) -> f64 {
        self.advance(self.input, input)
    }

    fn advance(&mut self, start: f64, end: f64) -> f64 {
        let n = self.state.len();
        let mut output = self.d * end;
        for i in 0..n {
            let mut sum = self.gamma_start[i] * start + self.gamma_end[i] * end;
            for (p, x) in self.phi[i * n..(i + 1) * n].iter().zip(&self.state) {
                sum += p * x;
            }
            self.next[i] = sum;
            output += self.c[i] * sum;
        }
        core::mem::swap(&mut self.state, &mut self.next);
        self.input = end;
        output
    }

    /// Puts the system at rest under a constant input and returns its output there.
    pub fn settle(&mut self, input: f64) -> f64 {
        self.input = input;
        let mut output = self.d * input;
        if let Some(per_unit) = &self.settle {
            for (i, unit) in per_unit.iter().enumerate() {
                self.state[i] = unit * input;
                output += self.c[i] * self.state[i];
            }
        }
        output
    }
}

/// A discretised system of at most `N` states in fixed arrays: the same sums in the same order as
/// [`DiscreteSystem`], several times faster.
#[derive(Clone, Debug)]
pub struct FixedSystem<const N: usize> {
    phi: [[f64; N]; N],
    gamma_start: [f64; N],
    gamma_end: [f64; N],
    c: [f64; N],
    d: f64,
    state: [f64; N],
    input: f64,
}

impl<const N: usize> FixedSystem<N> {
    /// A system at rest at zero; none if it has more than `N` states. States that it does not have stay zero.
    #[must_use]
    pub fn new(system: &DiscreteSystem) -> Option<Self> {
        let n = system.state.len();
        if n > N {
            return None;
        }
        let padded =
            |values: &[f64]| std::array::from_fn(|i| values.get(i).copied().unwrap_or(0.0));
        Some(Self {
            phi: std::array::from_fn(|i| {
                if i < n {
                    padded(&system.phi[i * n..(i + 1) * n])
                } else {
                    [0.0; N]
                }
            }),
            gamma_start: padded(&system.gamma_start),
            gamma_end: padded(&system.gamma_end),
            c: padded(&system.c),
            d: system.d,
            state: [0.0; N],
            input: 0.0,
        })
    }

    /// One interval with the input held at `input`; the output at its end.
    pub fn step_held(&mut self, input: f64) -> f64 {
        self.advance(input, input)
    }

    /// One interval in which the input runs straight from its last value to `input`; the output at its end.
    pub fn step_straight(&mut self, input: f64) -> f64 {
        self.advance(self.input, input)
    }

    #[inline]
    fn advance(&mut self, start: f64, end: f64) -> f64 {
        let mut next = [0.0; N];
        let mut output = self.d * end;
        for i in 0..N {
            let mut sum = self.gamma_start[i] * start + self.gamma_end[i] * end;
            for (p, x) in self.phi[i].iter().zip(&self.state) {
                sum += p * x;
            }
            next[i] = sum;
            output += self.c[i] * sum;
        }
        self.state = next;
        self.input = end;
        output
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn first_order_lag_matches_its_closed_form() {
        let system = ContinuousSystem::from_transfer_function(&[1.0], &[0.5, 1.0]).unwrap();
        let mut discrete = system.discretise(0.1);
        for k in 1..20 {
            let y = discrete.step_held(2.0);
            assert!((y - 2.0 * (1.0 - (-0.1 * f64::from(k) / 0.5).exp())).abs() < 1e-12);
        }
        let mut ramp = system.discretise(0.1);
        for k in 1..20 {
            let t = 0.1 * f64::from(k);
            let y = ramp.step_straight(t);
            assert!((y - (t - 0.5 * (1.0 - (-t / 0.5).exp()))).abs() < 1e-12);
        }
    }

    #[test]
    fn fixed_arrays_give_the_same_bits() {
        let g2 = ContinuousSystem::from_transfer_function(
            &[0.1804, 4.181, 47.84, 9.404],
            &[1.0, 14.10, 610.1, 1018.0, 125.0],
        )
        .unwrap();
        let mut general = g2.discretise(5e-6);
        let (mut fixed, mut padded) = (
            FixedSystem::<4>::new(&general).unwrap(),
            FixedSystem::<5>::new(&general).unwrap(),
        );
        assert!(FixedSystem::<3>::new(&general).is_none());
        for k in 0..5000 {
            let input = (f64::from(k) * 0.01).sin();
            let expected = general.step_straight(input);
            assert_eq!(fixed.step_straight(input), expected);
            assert_eq!(padded.step_straight(input), expected);
        }
    }

    #[test]
    fn creep_of_chapter_5_has_its_static_gain() {
        // Thesis Ch. 5 Eq. (17), G_2.
        let g2 = ContinuousSystem::from_transfer_function(
            &[0.1804, 4.181, 47.84, 9.404],
            &[1.0, 14.10, 610.1, 1018.0, 125.0],
        )
        .unwrap();
        assert!((g2.static_gain().unwrap() - 9.404 / 125.0).abs() < 1e-12);
        let mut discrete = g2.discretise(5e-5);
        assert!((discrete.settle(3.0) - 3.0 * 9.404 / 125.0).abs() < 1e-12);
        assert!((discrete.step_held(3.0) - 3.0 * 9.404 / 125.0).abs() < 1e-9);
    }
}
