//! Least squares with standard deviations: linear by singular values, nonlinear by Levenberg-Marquardt.
//!
//! For measurement errors that are independent and Gaussian both are maximum likelihood, and the standard
//! deviations are those of its asymptotic covariance (thesis Ch. 4, 6.2). Columns are scaled to unit length
//! first, so that powers of volts do not spoil the rank.
//!
//! The nonlinear one is MINPACK's, with a trust region.

use levenberg_marquardt::{LeastSquaresProblem, LevenbergMarquardt};
use nalgebra::storage::Owned;
use nalgebra::{DMatrix, DVector, Dyn};

/// An estimate with its covariance.
#[derive(Clone, Debug, PartialEq)]
pub struct Estimate {
    /// Parameter values.
    pub values: Vec<f64>,
    /// Covariance of the values.
    pub covariance: DMatrix<f64>,
    /// Sum of squared residuals, in the unit of the data squared.
    pub residual_sum: f64,
    /// Number of data.
    pub data_count: usize,
}

impl Estimate {
    /// Standard deviation of each value.
    #[must_use]
    pub fn standard_deviations(&self) -> Vec<f64> {
        (0..self.values.len())
            .map(|i| self.covariance[(i, i)].max(0.0).sqrt())
            .collect()
    }

    /// RMS residual.
    #[must_use]
    pub fn residual_rms(&self) -> f64 {
        (self.residual_sum / self.data_count.max(1) as f64).sqrt()
    }

    /// Bayesian information criterion up to a constant: the evidence against the model, lower is better.
    #[must_use]
    pub fn information_criterion(&self) -> f64 {
        let n = self.data_count.max(1) as f64;
        n * (self.residual_sum.max(f64::MIN_POSITIVE) / n).ln() + self.values.len() as f64 * n.ln()
    }
}

/// Solves `rows * values = data` in the least-squares sense.
///
/// `noise_std` is the known standard deviation of the data; without it the residual's is taken.
#[must_use]
pub fn linear(rows: DMatrix<f64>, data: &[f64], noise_std: Option<f64>) -> Option<Estimate> {
    let count = rows.ncols();
    if rows.nrows() != data.len() || data.len() < count || count == 0 {
        return None;
    }
    let scales: Vec<f64> = (0..count)
        .map(|j| rows.column(j).norm().max(f64::MIN_POSITIVE))
        .collect();
    let mut scaled = rows;
    for (j, scale) in scales.iter().enumerate() {
        scaled.column_mut(j).scale_mut(1.0 / scale);
    }
    let right = DVector::from_column_slice(data);
    // QR first: the singular values of R are those of the whole.
    let qr = scaled.clone().qr();
    let svd = qr.r().svd(true, true);
    let cutoff = 1e-13 * svd.singular_values.max();
    let solution = svd.solve(&(qr.q().transpose() * &right), cutoff).ok()?;
    let residual_sum = (&scaled * &solution - &right).norm_squared();
    let freedom = (data.len() - count).max(1) as f64;
    let variance = noise_std.map_or(residual_sum / freedom, |s| s * s);
    let v_t = svd.v_t.as_ref()?;
    let mut covariance = DMatrix::zeros(count, count);
    for i in 0..count {
        for j in 0..count {
            let mut sum = 0.0;
            for k in 0..count {
                let s = svd.singular_values[k];
                if s > cutoff {
                    sum += v_t[(k, i)] * v_t[(k, j)] / (s * s);
                }
            }
            covariance[(i, j)] = variance * sum / (scales[i] * scales[j]);
        }
    }
    let values = solution.iter().zip(&scales).map(|(v, s)| v / s).collect();
    Some(Estimate {
        values,
        covariance,
        residual_sum,
        data_count: data.len(),
    })
}

/// A nonlinear problem in scaled coordinates, its Jacobian by central differences.
struct Problem<'a> {
    residuals: &'a dyn Fn(&[f64]) -> Vec<f64>,
    typical: &'a [f64],
    coordinates: DVector<f64>,
}

impl Problem<'_> {
    fn values(&self, coordinates: &DVector<f64>) -> Vec<f64> {
        coordinates
            .iter()
            .zip(self.typical)
            .map(|(c, t)| c * t)
            .collect()
    }

    fn jacobian_matrix(&self) -> DMatrix<f64> {
        const STEP: f64 = 1e-4;
        let columns: Vec<DVector<f64>> = (0..self.coordinates.len())
            .map(|i| {
                let shifted = |by: f64| {
                    let mut moved = self.coordinates.clone();
                    moved[i] += by;
                    DVector::from_vec((self.residuals)(&self.values(&moved)))
                };
                (shifted(STEP) - shifted(-STEP)) / (2.0 * STEP)
            })
            .collect();
        DMatrix::from_columns(&columns)
    }
}

impl LeastSquaresProblem<f64, Dyn, Dyn> for Problem<'_> {
    type ResidualStorage = Owned<f64, Dyn>;
    type JacobianStorage = Owned<f64, Dyn, Dyn>;
    type ParameterStorage = Owned<f64, Dyn>;

    fn set_params(&mut self, x: &DVector<f64>) {
        self.coordinates.copy_from(x);
    }
    fn params(&self) -> DVector<f64> {
        self.coordinates.clone()
    }
    fn residuals(&self) -> Option<DVector<f64>> {
        let residuals = (self.residuals)(&self.values(&self.coordinates));
        residuals
            .iter()
            .all(|r| r.is_finite())
            .then(|| DVector::from_vec(residuals))
    }
    fn jacobian(&self) -> Option<DMatrix<f64>> {
        Some(self.jacobian_matrix())
    }
}

/// Minimises the sum of squared residuals from `start`; `typical` are sizes at which each parameter changes
/// the residuals noticeably.
///
/// Returns nothing if the residuals are not finite or cannot be reduced to a minimum.
#[must_use]
pub fn nonlinear(
    residuals: &dyn Fn(&[f64]) -> Vec<f64>,
    start: &[f64],
    typical: &[f64],
    noise_std: Option<f64>,
) -> Option<Estimate> {
    let coordinates =
        DVector::from_iterator(start.len(), start.iter().zip(typical).map(|(s, t)| s / t));
    let problem = Problem {
        residuals,
        typical,
        coordinates,
    };
    let (problem, report) = LevenbergMarquardt::new()
        .with_ftol(1e-12)
        .with_xtol(1e-10)
        .with_patience(30)
        .minimize(problem);
    if !report.objective_function.is_finite() {
        return None;
    }
    let values = problem.values(&problem.coordinates);
    let jacobian = problem.jacobian_matrix();
    let data_count = jacobian.nrows();
    let residual_sum = 2.0 * report.objective_function;
    let freedom = data_count.saturating_sub(values.len()).max(1) as f64;
    let variance = noise_std.map_or(residual_sum / freedom, |s| s * s);
    let inverse = (jacobian.transpose() * &jacobian)
        .pseudo_inverse(1e-300)
        .ok()?;
    let covariance = DMatrix::from_fn(values.len(), values.len(), |i, j| {
        variance * inverse[(i, j)] * typical[i] * typical[j]
    });
    Some(Estimate {
        values,
        covariance,
        residual_sum,
        data_count,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn linear_fit_of_a_line_has_the_textbook_deviations() {
        let x: Vec<f64> = (0..50).map(f64::from).collect();
        let y: Vec<f64> = x.iter().map(|x| 3.0 + 0.5 * x).collect();
        let rows = DMatrix::from_fn(50, 2, |i, j| if j == 0 { 1.0 } else { x[i] });
        let fit = linear(rows, &y, Some(0.1)).unwrap();
        assert!((fit.values[0] - 3.0).abs() < 1e-10 && (fit.values[1] - 0.5).abs() < 1e-12);
        let spread: f64 = x.iter().map(|x| (x - 24.5).powi(2)).sum();
        assert!((fit.standard_deviations()[1] - 0.1 / spread.sqrt()).abs() < 1e-12);
    }

    #[test]
    fn nonlinear_fit_of_an_exponential() {
        let residuals = |p: &[f64]| -> Vec<f64> {
            (0..40)
                .map(|k| f64::from(k) * 0.1)
                .map(|t| p[0] * (-t / p[1]).exp() - 2.0 * (-t / 0.7_f64).exp())
                .collect()
        };
        let fit = nonlinear(&residuals, &[1.0, 2.0], &[1.0, 1.0], Some(0.01)).unwrap();
        assert!((fit.values[0] - 2.0).abs() < 1e-6 && (fit.values[1] - 0.7).abs() < 1e-6);
        assert!(
            fit.standard_deviations()
                .iter()
                .all(|s| *s > 0.0 && *s < 0.02)
        );
    }
}
