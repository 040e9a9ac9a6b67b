//! Nonlinear least squares: Levenberg's and Marquardt's damped steps on the normal equations.
//!
//! For problems whose values are free and whose derivatives are all taken at every step. The fit of a chain
//! (`identification::fit`) has bounds, priors and derivatives that serve several steps, and damps by how well
//! a step keeps what it promises: it has steps of its own.

use crate::identification::nuisance_terms::transposed_times;
use nalgebra::{DMatrix, DVector};

/// Numbers that are moved together until a sum of squares is least.
pub trait Problem {
    /// What the numbers make.
    type Model: Clone;

    /// What is to become small; not finite where the model has no value.
    fn cost(&self, model: &Self::Model) -> f64;

    /// Derivatives of what is modelled, a column for each number, and measured less modelled.
    fn linearised(&self, model: &Self::Model) -> (DMatrix<f64>, DVector<f64>);

    /// The model with its numbers moved.
    fn moved(&self, model: &Self::Model, step: &DVector<f64>) -> Self::Model;

    /// Whether there is time for another step.
    fn goes_on(&self) -> bool {
        true
    }
}

/// Levenberg's damping, relative to the diagonal: the usual schedule of Levenberg and Marquardt.
const DAMPING_FIRST: f64 = 1e-4;
const DAMPING_UP: f64 = 8.0;
const DAMPING_DOWN: f64 = 10.0;
const DAMPING_LEAST: f64 = 1e-9;
const TRIALS: usize = 6;
/// Ridge of the normal equations, relative to their diagonal: directions that the data do not show stay.
const RIDGE: f64 = 1e-12;

/// The model refined until a step lowers the cost by a smaller share than `fall_enough`, or as far as it goes on.
pub fn refined<P: Problem>(
    problem: &P,
    start: &P::Model,
    steps_max: usize,
    fall_enough: f64,
) -> P::Model {
    let mut best = start.clone();
    let mut cost = problem.cost(&best);
    let mut damping = DAMPING_FIRST;
    for _ in 0..steps_max {
        if !problem.goes_on() {
            break;
        }
        let (columns, residual) = problem.linearised(&best);
        let (gram, against) = (
            transposed_times(&columns, &columns),
            columns.tr_mul(&residual),
        );
        let before = cost;
        for _ in 0..TRIALS {
            let Some(step) = damped_solution(&gram, &against, damping) else {
                damping *= DAMPING_UP;
                continue;
            };
            let tried = problem.moved(&best, &step);
            let tried_cost = problem.cost(&tried);
            if tried_cost < cost {
                (best, cost) = (tried, tried_cost);
                damping = (damping / DAMPING_DOWN).max(DAMPING_LEAST);
                break;
            }
            damping *= DAMPING_UP;
        }
        if before - cost <= fall_enough * before {
            break;
        }
    }
    best
}

/// The step that lowers the residual, with each number held back by its own scale.
#[must_use]
pub fn damped_solution(
    gram: &DMatrix<f64>,
    against: &DVector<f64>,
    damping: f64,
) -> Option<DVector<f64>> {
    // Scaled to a unit diagonal first: the numbers have units of their own.
    let scale = gram
        .diagonal()
        .map(|d| if d > 0.0 { 1.0 / d.sqrt() } else { 0.0 });
    let mut scaled = DMatrix::from_fn(gram.nrows(), gram.ncols(), |i, j| {
        gram[(i, j)] * scale[i] * scale[j]
    });
    for i in 0..scaled.nrows() {
        scaled[(i, i)] = 1.0 + damping + RIDGE;
    }
    let solution = scaled.cholesky()?.solve(&against.component_mul(&scale));
    Some(solution.component_mul(&scale))
}
