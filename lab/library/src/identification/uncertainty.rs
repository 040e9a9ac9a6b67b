//! How well the data fix the values of a fitted model.
//!
//! Standard deviations come from the gradients of blocks of samples (sandwich estimator), so that a coloured
//! residual does not make them too small.

use super::fit::{blocks, prior_coordinates, prior_weight};
use super::linearisation::{Rows, free_parameters, linearise, normal_equations};
use crate::dataset::Dataset;
use hysteron_sim::chain::Model;
use hysteron_sim::effect::Scale;
use nalgebra::DMatrix;
use std::sync::Arc;

/// A direction of the parameters that the data do not show.
#[derive(Clone, Debug)]
pub struct Unidentified {
    /// Effect with the largest part in it.
    pub effect: String,
    /// Parameter with the largest part in it.
    pub parameter: String,
}

/// Fills in the standard deviations of a fitted model and names parameters that the data cannot tell.
pub fn estimate_uncertainty(
    model: &mut Model,
    dataset: &Dataset,
    records: &[usize],
) -> Vec<Unidentified> {
    let free = free_parameters(model);
    let p = free.len();
    if p == 0 {
        return Vec::new();
    }
    let parts = linearise(model, dataset, &Rows::all(dataset, records), &free);
    let (h, _, cost, samples) = normal_equations(&parts);
    let variance = cost / samples.saturating_sub(p).max(1) as f64;
    let mut regularised = h.clone();
    for i in 0..p {
        regularised[(i, i)] += prior_weight(model, free[i], variance) + 1e-300;
    }
    let scale: Vec<f64> = (0..p).map(|i| 1.0 / regularised[(i, i)].sqrt()).collect();
    let scaled = DMatrix::from_fn(p, p, |i, j| {
        regularised[(i, j)] * scale[i] * scale[j] + if i == j { 1e-13 } else { 0.0 }
    });
    let Some(inverse) = scaled.cholesky().map(|c| c.inverse()) else {
        return Vec::new();
    };
    let inverse = DMatrix::from_fn(p, p, |i, j| inverse[(i, j)] * scale[i] * scale[j]);
    let mut middle = DMatrix::zeros(p, p);
    for part in &parts {
        for block in blocks(part.residual.len()) {
            let gradient = part
                .jacobian
                .rows(block.start, block.len())
                .tr_mul(&part.residual.rows(block.start, block.len()));
            middle += &gradient * gradient.transpose();
        }
    }
    let sandwich = &inverse * middle * &inverse;
    let values = free.iter().map(|index| {
        let instance = &model.effects[index.effect];
        (
            instance.id.clone(),
            instance.parameters[index.parameter].parameter.name.clone(),
        )
    });
    // White noise and what the blocks show, added: scaling each value by itself would tear apart directions in
    // which large changes cancel.
    let white = &inverse * variance;
    let covariance = &white + &sandwich;
    let values = values.collect();
    let known = Arc::make_mut(model.identified.get_or_insert_default());
    (known.values, known.factor) = (values, factor_of(&covariance));
    let mut unidentified = Vec::new();
    for (i, index) in free.iter().enumerate() {
        let white = white[(i, i)].max(0.0).sqrt();
        let coloured = sandwich[(i, i)].max(0.0).sqrt();
        let std_coordinate = white.max(coloured);
        let effect = &mut model.effects[index.effect];
        let id = effect.id.clone();
        let value = &mut effect.parameters[index.parameter];
        value.std = Some(std_coordinate * value.value_per_coordinate().abs());
        let limit = match value.parameter.scale {
            Scale::Linear(_) => 0.5 * prior_coordinates(&value.parameter),
            Scale::Logarithmic => 1.5,
        };
        if std_coordinate > limit {
            unidentified.push(Unidentified {
                effect: id,
                parameter: value.parameter.name.clone(),
            });
        }
    }
    unidentified
}

/// Lower triangular factor of a covariance, by rows; what is not positive is left out.
fn factor_of(covariance: &DMatrix<f64>) -> Vec<Vec<f64>> {
    let p = covariance.nrows();
    let scale: Vec<f64> = (0..p).map(|i| covariance[(i, i)].max(0.0).sqrt()).collect();
    let correlation = DMatrix::from_fn(p, p, |i, j| {
        let both = scale[i] * scale[j];
        if both > 0.0 {
            covariance[(i, j)] / both
        } else {
            0.0
        }
    });
    // By eigenvalues: what a Cholesky factor needs on the diagonal, where values depend on one another, tears
    // apart directions in which large changes cancel.
    let parts = correlation.symmetric_eigen();
    let roots = DMatrix::from_fn(p, p, |i, j| {
        parts.eigenvalues[i].max(0.0).sqrt() * parts.eigenvectors[(j, i)]
    });
    let factor = roots.qr().r().transpose();
    (0..p)
        .map(|i| (0..=i).map(|j| scale[i] * factor[(i, j)]).collect())
        .collect()
}
