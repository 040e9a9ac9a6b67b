//! The polynomial surfaces of the one-sided hysteresis model (thesis Ch. 4, Eqs. 10-15), and their evaluation
//! along an input.
//!
//! With `x` the input and `z` the value it returned to, both counted from the lower limit of the drive and
//! divided by the drive range,
//!
//! * `G(x, z) = (x - z) sum g_ij P_i(x) P_j(z)`, `i + j < degree`: what is lost on the way down from `x` to
//!   `z`. The factor makes `G(a, a) = 0` by construction (Ch. 4, 3.3), without which the output would jump at
//!   every reversal;
//! * `R(x) = x sum r_k P_k(x)`: the remnant that the first rise to `x` leaves behind, so that the initial
//!   ascending curve is `F(x) = G(x, 0) + R(x)` (Ch. 4, Eq. 10). The classical Preisach model is the special
//!   case `R = 0`.
//!
//! `P_k` are the Legendre polynomials shifted to 0..1: the same surfaces as the thesis' powers, but well
//! conditioned for estimation. Inside, the surfaces are expanded to powers once. Between two reversals the
//! output is then a polynomial in the input alone; its coefficients are collapsed when the extrema stack
//! changes and a Horner scheme serves every sample.

use hysteron_core::extrema_stack::ExtremaStack;

/// Pairs of extrema that the float models remember.
pub const STACK_CAPACITY: usize = 128;

/// Powers of the shifted Legendre polynomial of order `order`, ascending.
#[must_use]
pub fn shifted_legendre(order: usize) -> Vec<f64> {
    let mut previous = vec![1.0];
    if order == 0 {
        return previous;
    }
    let mut current = vec![-1.0, 2.0];
    for n in 1..order {
        // (n + 1) P_{n+1} = (2 n + 1) (2 x - 1) P_n - n P_{n-1}
        let m = n as f64;
        let mut next = vec![0.0; current.len() + 1];
        for (i, c) in current.iter().enumerate() {
            next[i] -= (2.0 * m + 1.0) * c / (m + 1.0);
            next[i + 1] += 2.0 * (2.0 * m + 1.0) * c / (m + 1.0);
        }
        for (i, c) in previous.iter().enumerate() {
            next[i] -= m * c / (m + 1.0);
        }
        previous = current;
        current = next;
    }
    current
}

/// Number of coefficients of a loop surface.
#[must_use]
pub const fn coefficient_count(degree: usize) -> usize {
    degree * (degree + 1) / 2
}

/// Degree of a loop surface with so many coefficients.
#[must_use]
pub fn degree_of(coefficients: usize) -> usize {
    (1..)
        .find(|d| coefficient_count(*d) >= coefficients)
        .unwrap_or(1)
}

/// The index pairs `(i, j)` of the coefficients `g_ij`, in the order in which they are stored.
pub fn loop_terms(degree: usize) -> impl Iterator<Item = (usize, usize)> {
    (0..degree).flat_map(|total| (0..=total).map(move |j| (total - j, j)))
}

/// Surfaces `G` and `R` in powers of the normalised input, in um.
#[derive(Clone, Debug, PartialEq)]
pub struct Surfaces {
    /// `g[i][j]` multiplies `x^i z^j`.
    pub g: Vec<Vec<f64>>,
    /// `r[k]` multiplies `x^k`.
    pub r: Vec<f64>,
}

impl Surfaces {
    /// From the coefficients `g_ij` (order of [`loop_terms`]) and `r_k`.
    #[must_use]
    pub fn from_legendre(degree: usize, g_terms: &[f64], r_terms: &[f64]) -> Self {
        let mut inner = vec![vec![0.0; degree]; degree];
        let legendre: Vec<Vec<f64>> = (0..degree.max(r_terms.len()))
            .map(shifted_legendre)
            .collect();
        for ((i, j), value) in loop_terms(degree).zip(g_terms) {
            for (p, a) in legendre[i].iter().enumerate() {
                for (q, b) in legendre[j].iter().enumerate() {
                    inner[p][q] += value * a * b;
                }
            }
        }
        let mut g = vec![vec![0.0; degree + 1]; degree + 1];
        for p in 0..degree {
            for q in 0..degree {
                g[p + 1][q] += inner[p][q];
                g[p][q + 1] -= inner[p][q];
            }
        }
        let mut r = vec![0.0; r_terms.len() + 1];
        for (k, value) in r_terms.iter().enumerate() {
            for (p, a) in legendre[k].iter().enumerate() {
                r[p + 1] += value * a;
            }
        }
        Self { g, r }
    }

    /// From the thesis' powers of volts: `f = [b_0..b_4]` in um/V^k ascending, `g = [p_1..p_15]` in the order
    /// of Ch. 4 Eq. (15).
    ///
    /// `G` must vanish on `alpha = beta`; what it has there is carried over unchanged and shows as a jump.
    #[must_use]
    pub fn from_thesis_powers(f: &[f64], g: &[f64], drive_range_v: f64) -> Self {
        let degree = f.len().saturating_sub(1);
        let mut surface = vec![vec![0.0; degree + 1]; degree + 1];
        let mut values = g.iter();
        for total in 0..=degree {
            for alpha_power in 0..=total {
                if let Some(value) = values.next() {
                    surface[alpha_power][total - alpha_power] =
                        value * drive_range_v.powi(total as i32);
                }
            }
        }
        let r = (0..=degree)
            .map(|k| f[k] * drive_range_v.powi(k as i32) - surface[k][0])
            .collect();
        Self { g: surface, r }
    }

    /// `G(x, z)` in um.
    #[must_use]
    pub fn loop_loss(&self, x: f64, z: f64) -> f64 {
        self.g
            .iter()
            .rev()
            .fold(0.0, |sum, row| sum * x + horner(row, z))
    }

    /// `F(x)` in um: the initial ascending curve.
    #[must_use]
    pub fn initial_ascending_curve(&self, x: f64) -> f64 {
        self.loop_loss(x, 0.0) + horner(&self.r, x)
    }

    fn at_maximum(&self, x: f64) -> Vec<f64> {
        let n = self.g.len();
        let mut out = vec![0.0; n];
        for j in 0..n {
            let mut sum = 0.0;
            for i in (0..n).rev() {
                sum = sum * x + self.g[i][j];
            }
            out[j] = sum;
        }
        out
    }

    fn at_minimum(&self, z: f64) -> Vec<f64> {
        self.g.iter().map(|row| horner(row, z)).collect()
    }
}

/// Polynomial with ascending coefficients.
#[must_use]
pub fn horner(coefficients: &[f64], x: f64) -> f64 {
    coefficients.iter().rev().fold(0.0, |sum, c| sum * x + c)
}

/// Inputs at which a polynomial is taken side by side.
const SIDE_BY_SIDE: usize = 8;

/// [`horner`] at many inputs, in their place.
fn horner_at_each(coefficients: &[f64], inputs: &mut [f64]) {
    let mut some = inputs.chunks_exact_mut(SIDE_BY_SIDE);
    for x in &mut some {
        let mut sums = [0.0; SIDE_BY_SIDE];
        for c in coefficients.iter().rev() {
            for i in 0..SIDE_BY_SIDE {
                sums[i] = sums[i] * x[i] + c;
            }
        }
        x.copy_from_slice(&sums);
    }
    some.into_remainder()
        .iter_mut()
        .for_each(|x| *x = horner(coefficients, *x));
}

/// One-sided rate-independent hysteresis (thesis Ch. 4, Eqs. 12-13) walking along an input.
#[derive(Clone, Debug)]
pub struct OneSidedHysteresis {
    surfaces: Surfaces,
    lower_limit_v: f64,
    range_v: f64,
    stack: ExtremaStack<f64, STACK_CAPACITY>,
    /// Output at each remembered maximum, um: kept as far as the stack stays, so that a reversal costs the
    /// same however deep it is.
    at_maxima_um: Vec<f64>,
    section: Vec<f64>,
    rising: bool,
}

impl OneSidedHysteresis {
    /// Virgin, at the lower limit of the drive.
    #[must_use]
    pub fn virgin(surfaces: Surfaces, lower_limit_v: f64, range_v: f64) -> Self {
        let mut this = Self {
            surfaces,
            lower_limit_v,
            range_v,
            stack: ExtremaStack::virgin(0.0),
            at_maxima_um: Vec::new(),
            section: Vec::new(),
            rising: true,
        };
        this.collapse(0);
        this
    }

    /// Its surfaces.
    #[must_use]
    pub fn surfaces(&self) -> &Surfaces {
        &self.surfaces
    }

    /// Takes the next drive voltage and returns the force-equivalent displacement in um (zero for the virgin
    /// state).
    pub fn step(&mut self, drive_v: f64) -> f64 {
        let x = (drive_v - self.lower_limit_v) / self.range_v;
        if let Some(unchanged) = self.leaves_section(x) {
            self.collapse(unchanged);
        }
        horner(&self.section, x)
    }

    /// Walks along inputs in units of the drive range above the lower limit, and leaves in their place what
    /// [`Self::step`] gives: a section is one polynomial, at many inputs at once.
    pub fn run(&mut self, inputs: &mut [f64]) {
        let mut began = 0;
        for k in 0..inputs.len() {
            if let Some(unchanged) = self.leaves_section(inputs[k]) {
                horner_at_each(&self.section, &mut inputs[began..k]);
                began = k;
                self.collapse(unchanged);
            }
        }
        horner_at_each(&self.section, &mut inputs[began..]);
    }

    /// Remembers the next input; where it leaves the section that ran, how many leading pairs of the stack
    /// are those of that section.
    fn leaves_section(&mut self, x: f64) -> Option<usize> {
        let before = (
            self.stack.pairs().len(),
            self.stack.open_maximum().is_none(),
        );
        let unchanged = self.stack.update(x);
        let after = (
            self.stack.pairs().len(),
            self.stack.open_maximum().is_none(),
        );
        (before != after || unchanged != after.0).then_some(unchanged)
    }

    /// Memory of the input, in units of the drive range above the lower limit.
    #[must_use]
    pub fn stack(&self) -> &ExtremaStack<f64, STACK_CAPACITY> {
        &self.stack
    }

    /// Polynomial of the running monotone section, ascending powers of the normalised input, and whether the
    /// input rises on it.
    #[must_use]
    pub fn section(&self) -> (&[f64], bool) {
        (&self.section, self.rising)
    }

    /// `F(M_max)` in um: where the initial ascending curve was left, or is.
    #[must_use]
    pub fn initial_curve_at_maximum(&self) -> f64 {
        self.surfaces
            .initial_ascending_curve(self.stack.global_maximum())
    }

    /// Collapses the section that runs now; `unchanged` leading pairs of the stack are those of the section
    /// before.
    fn collapse(&mut self, unchanged: usize) {
        let surfaces = &self.surfaces;
        let pairs = self.stack.pairs();
        let open_maximum = self.stack.open_maximum();
        self.rising = open_maximum.is_none();
        self.at_maxima_um.truncate(unchanged);
        if self.stack.on_initial_ascending_curve() {
            self.section = surfaces.g.iter().map(|row| row[0]).collect();
            self.section
                .resize(self.section.len().max(surfaces.r.len()), 0.0);
            for (s, r) in self.section.iter_mut().zip(&surfaces.r) {
                *s += r;
            }
            return;
        }
        let maxima = pairs.iter().map(|p| p.maximum).chain(open_maximum);
        for (k, maximum) in maxima.enumerate().skip(self.at_maxima_um.len()) {
            let output_um = match k
                .checked_sub(1)
                .map(|before| (self.at_maxima_um[before], pairs[before]))
            {
                None => surfaces.initial_ascending_curve(self.stack.global_maximum()),
                Some((before_um, pair)) => {
                    before_um - surfaces.loop_loss(pair.maximum, pair.minimum)
                        + surfaces.loop_loss(maximum, pair.minimum)
                }
            };
            self.at_maxima_um.push(output_um);
        }
        let last_um = self.at_maxima_um.last().copied().unwrap_or(0.0);
        let level_um = match (open_maximum, pairs.last()) {
            (Some(maximum), _) => {
                self.section = surfaces.at_maximum(maximum);
                self.section.iter_mut().for_each(|c| *c = -*c);
                last_um
            }
            (None, Some(last)) => {
                self.section = surfaces.at_minimum(last.minimum);
                last_um - surfaces.loop_loss(last.maximum, last.minimum)
            }
            (None, None) => {
                self.section.clear();
                last_um
            }
        };
        if let Some(constant) = self.section.first_mut() {
            *constant += level_um;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Thesis Ch. 5 Table 1 with `G` projected (the reference bench), over 0..80 V.
    fn thesis_surfaces() -> Surfaces {
        let bench: toml::Table = include_str!("../bench.toml").parse().unwrap();
        let numbers = |key: &str| -> Vec<f64> {
            bench["hysteresis"][key]
                .as_array()
                .unwrap()
                .iter()
                .map(|v| v.as_float().unwrap())
                .collect()
        };
        Surfaces::from_thesis_powers(&numbers("f"), &numbers("g"), 80.0)
    }

    #[test]
    fn printed_values_of_chapter_5() {
        let surfaces = thesis_surfaces();
        assert!((surfaces.initial_ascending_curve(70.0 / 80.0) - 10.74).abs() < 0.01);
        assert!((surfaces.loop_loss(70.0 / 80.0, 0.0) - 9.31).abs() < 0.05);
        for k in 0..=80 {
            assert!(
                surfaces
                    .loop_loss(f64::from(k) / 80.0, f64::from(k) / 80.0)
                    .abs()
                    < 1e-9
            );
        }
    }

    proptest! {
        /// Input by input and all at once are the same, bit for bit.
        #[test]
        fn many_inputs_at_once_are_what_each_gives(inputs in proptest::collection::vec(-0.1f64..1.0, 1..200), slow in 1usize..20) {
            let inputs: Vec<f64> = inputs.windows(2).flat_map(|w| (0..slow).map(move |k| w[0] + (w[1] - w[0]) * k as f64 / slow as f64)).collect();
            let coefficients: Vec<f64> = (0..15).map(|k| f64::from(7 * k % 5) - 2.0).collect();
            let virgin = OneSidedHysteresis::virgin(Surfaces::from_legendre(5, &coefficients, &[0.3, -0.1]), 0.0, 1.0);
            let (mut one_by_one, mut at_once, mut together) = (virgin.clone(), virgin, inputs.clone());
            let (first, rest) = together.split_at_mut(inputs.len() / 3);
            at_once.run(first);
            at_once.run(rest);
            for (x, y) in inputs.iter().zip(&together) {
                prop_assert_eq!(one_by_one.step(*x).to_bits(), y.to_bits());
            }
        }
    }

    /// Brute force: a grid of the thesis' three-state operators (Ch. 4 Eq. 1), whose weights are the second
    /// derivatives of the surfaces.
    ///
    /// `mu_1 - mu_2` integrates to `G`, and `mu_1` to `F` along the initial curve; cells are integrated
    /// exactly from the corner values of the surfaces so that on grid points the sum has no discretisation
    /// error.
    struct OperatorGrid {
        cells: Vec<(usize, usize, f64, f64, i8)>,
        highest: usize,
    }

    impl OperatorGrid {
        fn new(surfaces: &Surfaces, n: usize) -> Self {
            let at = |k: usize| k as f64 / n as f64;
            let g = |i: usize, j: usize| surfaces.loop_loss(at(i), at(j));
            let f = |i: usize| surfaces.initial_ascending_curve(at(i));
            let mut cells = Vec::new();
            for i in 1..=n {
                let mut row_difference = 0.0;
                for j in 0..i {
                    // Switches up at level i, down at level j: G(i, j) is the sum over i' <= i and j' >= j.
                    let difference = (g(i, j) - g(i, j + 1))
                        - if i > j + 1 {
                            g(i - 1, j) - g(i - 1, j + 1)
                        } else {
                            0.0
                        };
                    cells.push((i, j, 0.0, difference, 0));
                    row_difference += difference;
                }
                // The initial curve fixes the row sums of mu_1; how it is spread over the row cannot be seen
                // from outside.
                let row_first = (f(i) - f(i - 1)) / i as f64;
                let start = cells.len() - i;
                for cell in &mut cells[start..] {
                    cell.2 = row_first;
                }
                let _ = row_difference;
            }
            Self { cells, highest: 0 }
        }

        fn step(&mut self, level: usize) -> f64 {
            self.highest = self.highest.max(level);
            let mut sum = 0.0;
            for (up, down, first, difference, state) in &mut self.cells {
                if level >= *up {
                    *state = 1;
                } else if level <= *down && *state == 1 {
                    *state = 2;
                }
                sum += match *state {
                    1 => *first,
                    2 => *first - *difference,
                    _ => 0.0,
                };
            }
            sum
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]
        #[test]
        fn equals_a_grid_of_three_state_operators(levels in proptest::collection::vec(0usize..=40, 1..60)) {
            let surfaces = thesis_surfaces();
            let mut grid = OperatorGrid::new(&surfaces, 40);
            let mut model = OneSidedHysteresis::virgin(surfaces, 0.0, 80.0);
            let mut last = 0usize;
            for level in levels {
                // A grid of switches needs the path, not only its ends.
                let mut position = last;
                let mut by_grid = grid.step(position);
                while position != level {
                    if level > position { position += 1 } else { position -= 1 }
                    by_grid = grid.step(position);
                }
                let by_model = model.step(level as f64 * 2.0);
                prop_assert!((by_grid - by_model).abs() < 1e-9, "{by_grid} {by_model}");
                last = level;
            }
        }

        #[test]
        fn legendre_and_powers_are_the_same_surface(x in 0.0f64..1.0, z in 0.0f64..1.0, g in proptest::collection::vec(-1.0f64..1.0, 10)) {
            let surfaces = Surfaces::from_legendre(4, &g, &[0.3, -0.1]);
            let p = |k: usize, v: f64| match k { 0 => 1.0, 1 => 2.0 * v - 1.0, 2 => 6.0 * v * v - 6.0 * v + 1.0, _ => ((20.0 * v - 30.0) * v + 12.0) * v - 1.0 };
            let direct: f64 = loop_terms(4).zip(&g).map(|((i, j), c)| c * p(i, x) * p(j, z)).sum::<f64>() * (x - z);
            prop_assert!((surfaces.loop_loss(x, z) - direct).abs() < 1e-12);
            prop_assert!((surfaces.initial_ascending_curve(x) - surfaces.loop_loss(x, 0.0) - x * (0.3 - 0.1 * (2.0 * x - 1.0))).abs() < 1e-12);
        }
    }
}
