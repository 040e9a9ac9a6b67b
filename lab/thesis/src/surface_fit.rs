//! Fits of the curve `F` and the surface `G` of the one-sided hysteresis to measured points (thesis Ch. 4,
//! 3.3).
//!
//! Drives are normalised to the range of the actuator. `F` is a polynomial without constant; `G` is
//! `(alpha - beta)` times a polynomial, so that it vanishes on `alpha = beta` and the output does not jump
//! at reversals. The orders are chosen by evidence: every height in turn is left out and predicted from
//! the others, and the smallest order within 10 % of the best prediction is taken.

use super::least_squares::{self, Estimate};
use hysteron::statistics::rms;
use hysteron_sim::hysteresis_surface::{OneSidedHysteresis, Surfaces};
use nalgebra::DMatrix;

/// A measured loss: from a maximum down to a later drive.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LossPoint {
    /// Maximum `alpha`, normalised.
    pub maximum: f64,
    /// Drive `beta` to which it fell, normalised.
    pub drive: f64,
    /// Displacement lost, um.
    pub loss_um: f64,
}

/// Identified curve and surface.
#[derive(Clone, Debug)]
pub struct SurfaceFit {
    /// Curve `F`: coefficients of `x, x^2, ...`.
    pub curve: Estimate,
    /// Surface `G`: coefficients of `(x - z) x^i z^j` in the order of [`exponents`].
    pub surface: Estimate,
    /// Order of the curve.
    pub curve_order: usize,
    /// Order of the surface.
    pub surface_order: usize,
}

/// Exponents `(i, j)` of `x^i z^j` with `i + j < order`.
#[must_use]
pub fn exponents(order: usize) -> Vec<(i32, i32)> {
    (0..order as i32)
        .flat_map(|total| (0..=total).map(move |j| (total - j, j)))
        .collect()
}

fn fit_curve(points: &[(f64, f64)], order: usize, noise_um: f64) -> Option<Estimate> {
    let rows = DMatrix::from_fn(points.len(), order, |r, c| points[r].0.powi(c as i32 + 1));
    least_squares::linear(
        rows,
        &points.iter().map(|p| p.1).collect::<Vec<_>>(),
        Some(noise_um),
    )
}

fn curve_at(values: &[f64], x: f64) -> f64 {
    values.iter().rev().fold(0.0, |sum, b| (sum + b) * x)
}

fn fit_surface(points: &[LossPoint], order: usize, noise_um: f64) -> Option<Estimate> {
    let exponents = exponents(order);
    let rows = DMatrix::from_fn(points.len(), exponents.len(), |r, c| {
        surface_term(&points[r], exponents[c])
    });
    least_squares::linear(
        rows,
        &points.iter().map(|p| p.loss_um).collect::<Vec<_>>(),
        Some(noise_um),
    )
}

fn surface_term(point: &LossPoint, (i, j): (i32, i32)) -> f64 {
    (point.maximum - point.drive) * point.maximum.powi(i) * point.drive.powi(j)
}

/// Smallest order whose prediction of left-out heights is within 10 % of the best.
fn order_by_evidence(
    orders: std::ops::RangeInclusive<usize>,
    prediction_rms: impl Fn(usize) -> Option<f64>,
) -> usize {
    let scores: Vec<(usize, f64)> = orders
        .filter_map(|order| prediction_rms(order).map(|e| (order, e)))
        .collect();
    let best = scores.iter().map(|s| s.1).fold(f64::INFINITY, f64::min);
    scores.iter().find(|s| s.1 <= 1.1 * best).map_or(4, |s| s.0)
}

/// Fits both to measured points; `curve` are `(maximum, displacement)`. `noise_um` is the RMS noise of one
/// reading.
#[must_use]
pub fn fit(curve: &[(f64, f64)], losses: &[LossPoint], noise_um: f64) -> Option<SurfaceFit> {
    let curve_order = order_by_evidence(2..=6, |order| {
        let errors: Option<Vec<f64>> = (0..curve.len())
            .map(|left_out| {
                let rest: Vec<_> = curve
                    .iter()
                    .enumerate()
                    .filter(|(k, _)| *k != left_out)
                    .map(|(_, p)| *p)
                    .collect();
                fit_curve(&rest, order, noise_um)
                    .map(|f| curve_at(&f.values, curve[left_out].0) - curve[left_out].1)
            })
            .collect();
        errors.map(|e| rms(&e))
    });
    let surface_order = order_by_evidence(2..=6, |order| {
        let mut errors = Vec::new();
        for (height, _) in curve {
            let (out, rest): (Vec<LossPoint>, Vec<LossPoint>) = losses
                .iter()
                .partition(|p| (p.maximum - height).abs() < 1e-9);
            let f = fit_surface(&rest, order, noise_um)?;
            let exponents = exponents(order);
            errors.extend(out.iter().map(|p| {
                exponents
                    .iter()
                    .zip(&f.values)
                    .map(|(e, v)| v * surface_term(p, *e))
                    .sum::<f64>()
                    - p.loss_um
            }));
        }
        Some(rms(&errors))
    });
    // A loss is the difference of two readings.
    Some(SurfaceFit {
        curve: fit_curve(curve, curve_order, noise_um)?,
        surface: fit_surface(losses, surface_order, noise_um * std::f64::consts::SQRT_2)?,
        curve_order,
        surface_order,
    })
}

/// Adds `value (x - z) x^i z^j` to a surface.
pub fn add_loss_term(g: &mut [Vec<f64>], (i, j): (i32, i32), value: f64) {
    g[i as usize + 1][j as usize] += value;
    g[i as usize][j as usize + 1] -= value;
}

/// The one-sided model from every `stride`-th reading of whole records, each `(drive, reading)` from the
/// virgin state.
///
/// The model's output is linear in the coefficients: one operator per coefficient walks along the drive and
/// gives its column. Outputs count from that at the first sample, which is zero at the lower limit.
#[must_use]
pub fn fit_samples(
    records: &[(Vec<f64>, Vec<f64>)],
    curve_order: usize,
    surface_order: usize,
    lower_limit_v: f64,
    range_v: f64,
    stride: usize,
) -> Option<Surfaces> {
    let size = curve_order.max(surface_order) + 1;
    let units: Vec<Surfaces> = (0..curve_order)
        .map(|c| {
            let mut unit = Surfaces {
                g: vec![vec![0.0; size]; size],
                r: vec![0.0; size],
            };
            unit.r[c + 1] = 1.0;
            unit
        })
        .chain(exponents(surface_order).into_iter().map(|e| {
            let mut g = vec![vec![0.0; size]; size];
            add_loss_term(&mut g, e, 1.0);
            // F is a curve of its own: the loss does not act on the first rise.
            let r = g.iter().map(|row| -row[0]).collect();
            Surfaces { g, r }
        }))
        .collect();
    let (mut rows, mut data) = (Vec::new(), Vec::new());
    for (drive_v, reading_um) in records {
        let mut operators: Vec<OneSidedHysteresis> = units
            .iter()
            .map(|u| OneSidedHysteresis::virgin(u.clone(), lower_limit_v, range_v))
            .collect();
        let first = drive_v.first().copied().unwrap_or(lower_limit_v);
        let zeros: Vec<f64> = operators.iter_mut().map(|o| o.step(first)).collect();
        for (k, u) in drive_v.iter().enumerate() {
            let values: Vec<f64> = operators
                .iter_mut()
                .zip(&zeros)
                .map(|(o, zero)| o.step(*u) - zero)
                .collect();
            if let (0, Some(y)) = (k % stride.max(1), reading_um.get(k + 1)) {
                rows.extend(values);
                data.push(*y);
            }
        }
    }
    let fit = least_squares::linear(
        DMatrix::from_row_slice(data.len(), units.len(), &rows),
        &data,
        None,
    )?;
    let mut out = Surfaces {
        g: vec![vec![0.0; size]; size],
        r: vec![0.0; size],
    };
    for (unit, value) in units.iter().zip(&fit.values) {
        for (to, from) in out.g.iter_mut().zip(&unit.g) {
            to.iter_mut().zip(from).for_each(|(a, b)| *a += value * b);
        }
        out.r
            .iter_mut()
            .zip(&unit.r)
            .for_each(|(a, b)| *a += value * b);
    }
    Some(out)
}

impl SurfaceFit {
    fn loss_surface(&self) -> Vec<Vec<f64>> {
        let mut g = vec![vec![0.0; self.surface_order + 1]; self.surface_order + 1];
        for (e, value) in exponents(self.surface_order)
            .into_iter()
            .zip(&self.surface.values)
        {
            add_loss_term(&mut g, e, *value);
        }
        g
    }

    /// The one-sided model: `F` and `G`.
    #[must_use]
    pub fn one_sided(&self) -> Surfaces {
        let g = self.loss_surface();
        let mut r = vec![0.0; self.curve_order.max(self.surface_order) + 1];
        for (k, b) in self.curve.values.iter().enumerate() {
            r[k + 1] += b;
        }
        for (i, row) in g.iter().enumerate() {
            r[i] -= row[0];
        }
        Surfaces { g, r }
    }
}
