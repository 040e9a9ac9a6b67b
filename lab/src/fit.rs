//! Least squares over the whole chain: every parameter of every effect, from all records at once.
//!
//! # How it works
//! * Parameters live in coordinates in which a unit matters (`ParameterValue::coordinate`); positive ones in their logarithm.
//! * A derivative is a run of the chain with one coordinate moved, resumed at the stage that the parameter acts in. For the surfaces of
//!   the hysteresis, most of the parameters, it is exact because they enter linearly, and one walk gives what all of them contribute.
//! * What each record has of its own (a constant, initial states of slow effects, sine and cosine of a line) is projected out of the
//!   residual and of every derivative of that record: it is estimated along without being a parameter.
//! * Steps are Levenberg and Marquardt's on the normal equations, which are accumulated record by record. A weak prior of one full range
//!   on coefficients keeps directions that the data do not show small; it weighs one part in 10^4 of one sample.
//! * Standard deviations come from the gradients of blocks of samples (sandwich estimator), so that a coloured residual does not
//!   make them too small.

use crate::dataset::{Dataset, Record};
use hysteron_sim::chain::{Contribution, EffectInstance, InitialState, Model};
use hysteron_sim::effect::Scale;
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

/// A parameter of a model by position.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ParameterIndex {
    /// Effect in the model.
    pub effect: usize,
    /// Parameter in the effect.
    pub parameter: usize,
}

/// Parameters of a model that are estimated.
#[must_use]
pub fn free_parameters(model: &Model) -> Vec<ParameterIndex> {
    let mut out = Vec::new();
    for (effect, instance) in model.effects.iter().enumerate() {
        for (parameter, value) in instance.parameters.iter().enumerate() {
            if !value.parameter.fixed {
                out.push(ParameterIndex { effect, parameter });
            }
        }
    }
    out
}

/// Orthonormal columns over the window of a record for what the record has of its own.
#[must_use]
pub fn nuisance_columns(model: &Model, record: &Record) -> Vec<Vec<f64>> {
    let window = record.window.clone();
    let dt_s = record.dt_s();
    let mut columns: Vec<Vec<f64>> = Vec::new();
    if record.offset_is_fitted {
        columns.push(vec![1.0; window.len()]);
    }
    for instance in &model.effects {
        let values = instance.values();
        if record.initial_state == InitialState::Unknown {
            for tau_s in instance.effect.slow_time_constants_s(&values) {
                columns.push(window.clone().map(|k| (-(k as f64) * dt_s / tau_s).exp()).collect());
            }
        }
        for frequency_hz in instance.effect.line_frequencies_hz(&values) {
            let phase = |k: usize| std::f64::consts::TAU * frequency_hz * k as f64 * dt_s;
            columns.push(window.clone().map(|k| phase(k).sin()).collect());
            columns.push(window.clone().map(|k| phase(k).cos()).collect());
        }
    }
    orthonormalise(columns)
}

/// Gram-Schmidt, twice for accuracy; columns that depend on earlier ones are left out.
#[must_use]
pub fn orthonormalise(columns: Vec<Vec<f64>>) -> Vec<Vec<f64>> {
    let mut out: Vec<Vec<f64>> = Vec::new();
    for mut column in columns {
        let before = dot(&column, &column).sqrt();
        project_out(&out, &mut column);
        project_out(&out, &mut column);
        let norm = dot(&column, &column).sqrt();
        if norm > 1e-7 * before && norm > 0.0 {
            column.iter_mut().for_each(|v| *v /= norm);
            out.push(column);
        }
    }
    out
}

/// Removes from `column` what lies in the span of orthonormal columns.
pub fn project_out(orthonormal: &[Vec<f64>], column: &mut [f64]) {
    for base in orthonormal {
        let along = dot(base, column);
        for (c, b) in column.iter_mut().zip(base) {
            *c -= along * b;
        }
    }
}

/// Inner product, in four lanes so that the compiler can keep them busy.
#[must_use]
pub fn dot(a: &[f64], b: &[f64]) -> f64 {
    let n = a.len().min(b.len());
    let (a, b) = (&a[..n], &b[..n]);
    let mut lanes = [0.0; 4];
    let mut chunks_a = a.chunks_exact(4);
    let mut chunks_b = b.chunks_exact(4);
    for (x, y) in (&mut chunks_a).zip(&mut chunks_b) {
        for i in 0..4 {
            lanes[i] += x[i] * y[i];
        }
    }
    let tail: f64 = chunks_a.remainder().iter().zip(chunks_b.remainder()).map(|(x, y)| x * y).sum();
    lanes[0] + lanes[1] + lanes[2] + lanes[3] + tail
}

/// Measured less modelled inside the window of a record, with what the record has of its own removed.
#[must_use]
pub fn residual(model: &Model, record: &Record) -> Vec<f64> {
    let model = &*model.before_rounding();
    let reading = model.simulate(&record.drive());
    let mut out: Vec<f64> = record.window.clone().map(|k| record.displacement_um[k] - reading[k]).collect();
    project_out(&nuisance_columns(model, record), &mut out);
    out
}

/// Root mean square of a slice.
#[must_use]
pub fn rms(values: &[f64]) -> f64 {
    if values.is_empty() { 0.0 } else { (dot(values, values) / values.len() as f64).sqrt() }
}

/// Root mean square over the records with the given indices, all samples weighing the same.
#[must_use]
pub fn rms_over(model: &Model, dataset: &Dataset, records: &[usize]) -> f64 {
    let parts: Vec<(f64, usize)> = records
        .par_iter()
        .map(|&i| {
            let r = residual(model, &dataset.records[i]);
            (dot(&r, &r), r.len())
        })
        .collect();
    let (sum, count) = parts.iter().fold((0.0, 0), |(s, n), (ds, dn)| (s + ds, n + dn));
    if count == 0 { 0.0 } else { (sum / count as f64).sqrt() }
}

/// Residual of a record and its derivatives, inside the window and free of nuisances.
#[derive(Clone, Debug)]
pub struct Linearised {
    /// Measured less modelled.
    pub residual: Vec<f64>,
    /// Derivative of the modelled reading by each coordinate.
    pub jacobian: Vec<Vec<f64>>,
    /// Nuisance columns.
    pub nuisance: Vec<Vec<f64>>,
}

/// Relative step of the numerical derivatives, in coordinates.
const DERIVATIVE_STEP: f64 = 1e-3;

/// Linearises the model over records in the coordinates of `free`.
#[must_use]
pub fn linearise(model: &Model, dataset: &Dataset, records: &[usize], free: &[ParameterIndex]) -> Vec<Linearised> {
    linearise_reusing(model, dataset, records, free, None)
}

/// As [`linearise`], but takes the derivatives by plain coefficients from an earlier linearisation.
///
/// They depend on the other parameters alone and change little with them; the step stays right because every step is judged by the
/// true sum of squares.
fn linearise_reusing(
    model: &Model,
    dataset: &Dataset,
    records: &[usize],
    free: &[ParameterIndex],
    earlier: Option<&[Linearised]>,
) -> Vec<Linearised> {
    let model = &*model.before_rounding();
    let runs: Vec<_> = records.par_iter().map(|&i| model.run(&dataset.records[i].drive())).collect();
    let nuisances: Vec<_> = records.par_iter().map(|&i| nuisance_columns(model, &dataset.records[i])).collect();
    let tasks: Vec<(usize, usize)> = (0..records.len()).flat_map(|r| (0..free.len()).map(move |p| (r, p))).collect();
    let contributions: Vec<Vec<Contribution>> = match earlier {
        Some(_) => records.iter().map(|_| Vec::new()).collect(),
        None => records.par_iter().zip(&runs).map(|(&i, run)| model.contributions(run, dataset.records[i].dt_s())).collect(),
    };
    let mut columns: Vec<Vec<f64>> = tasks
        .par_iter()
        .map(|&(r, p)| {
            let record = &dataset.records[records[r]];
            let index = free[p];
            if let Some(known) = earlier.filter(|_| is_surface_coefficient(model, index)) {
                return known[r].jacobian[p].clone();
            }
            let mut moved = model.clone();
            let value = &mut moved.effects[index.effect].parameters[index.parameter];
            let (at, before) = (value.value, value.coordinate());
            value.set_coordinate(before + DERIVATIVE_STEP);
            let mut step = value.coordinate() - before;
            if step.abs() < 0.5 * DERIVATIVE_STEP {
                value.set_coordinate(before - DERIVATIVE_STEP);
                step = value.coordinate() - before;
            }
            let more = value.value - at;
            let linear = contributions[r].iter().find(|c| c.effect == index.effect && c.parameter == index.parameter);
            let reading = match linear {
                Some(contribution) => model.resume_with_more(&runs[r], contribution, more, record.dt_s()),
                None => moved.resume(&runs[r], model.stage_of(&runs[r], index.effect), record.dt_s()),
            };
            let base = &runs[r].reading_um;
            let scale = if step == 0.0 { 0.0 } else { 1.0 / step };
            let mut column: Vec<f64> = record.window.clone().map(|k| (reading[k] - base[k]) * scale).collect();
            project_out(&nuisances[r], &mut column);
            column
        })
        .collect();
    let mut out = Vec::with_capacity(records.len());
    for (r, &i) in records.iter().enumerate().rev() {
        let record = &dataset.records[i];
        let jacobian = columns.split_off(r * free.len());
        let mut residual: Vec<f64> = record.window.clone().map(|k| record.displacement_um[k] - runs[r].reading_um[k]).collect();
        project_out(&nuisances[r], &mut residual);
        out.push(Linearised { residual, jacobian, nuisance: nuisances[r].clone() });
    }
    out.reverse();
    out
}

/// A coefficient of the hysteresis surfaces: most of a model's parameters, and they enter linearly.
fn is_surface_coefficient(model: &Model, index: ParameterIndex) -> bool {
    matches!(model.effects[index.effect].id.as_str(), "hysteresis" | "initial_curve" | "play_operators")
}

/// How far the parameters that are no surface coefficients moved between two models, in coordinates that matter.
fn shape_change(a: &Model, b: &Model, free: &[ParameterIndex]) -> f64 {
    free.iter()
        .filter(|index| !is_surface_coefficient(a, **index))
        .map(|index| {
            let before = &a.effects[index.effect].parameters[index.parameter];
            let after = &b.effects[index.effect].parameters[index.parameter];
            let change = (before.coordinate() - after.coordinate()).abs();
            match before.parameter.scale {
                Scale::Linear(_) => 0.02 * change,
                Scale::Logarithmic => change,
            }
        })
        .fold(0.0, f64::max)
}

/// Normal equations of linearised records: `J'J`, `J'r`, `r'r`, samples.
#[must_use]
pub fn normal_equations(parts: &[Linearised]) -> (DMatrix<f64>, DVector<f64>, f64, usize) {
    let p = parts.first().map_or(0, |l| l.jacobian.len());
    let mut h = DMatrix::zeros(p, p);
    let mut g = DVector::zeros(p);
    let (mut cost, mut samples) = (0.0, 0);
    for part in parts {
        let rows: Vec<Vec<f64>> =
            (0..p).into_par_iter().map(|i| (0..=i).map(|j| dot(&part.jacobian[i], &part.jacobian[j])).collect()).collect();
        for i in 0..p {
            for j in 0..=i {
                h[(i, j)] += rows[i][j];
                if i != j {
                    h[(j, i)] += rows[i][j];
                }
            }
            g[i] += dot(&part.jacobian[i], &part.residual);
        }
        cost += dot(&part.residual, &part.residual);
        samples += part.residual.len();
    }
    (h, g, cost, samples)
}

/// Prior standard deviation of a coefficient, in coordinates (a coordinate of one is a hundredth of the range).
const PRIOR_COORDINATES: f64 = 100.0;

/// How hard a fit tries.
#[derive(Clone, Copy, Debug)]
pub struct Effort {
    /// Most steps.
    pub iterations: usize,
    /// A step that lowers the sum of squares by less than this share of one sample's variance per parameter ends the fit.
    pub tolerance: f64,
    /// A step that lowers the sum of squares by less than this share of it ends the fit.
    pub relative: f64,
}

impl Default for Effort {
    fn default() -> Self {
        Self { iterations: 30, tolerance: 0.05, relative: 1e-6 }
    }
}

/// What a fit came to.
#[derive(Clone, Debug)]
pub struct Fit {
    /// The model with its values; standard deviations once [`estimate_uncertainty`] ran.
    pub model: Model,
    /// Residual over the fitted records.
    pub rms_um: f64,
    /// Samples fitted.
    pub samples: usize,
    /// Linearisations made.
    pub iterations: usize,
}

/// Surface derivatives are taken again when some other parameter has moved this far.
const SHAPE_TOLERANCE: f64 = 0.03;

/// Fits the free parameters of a model to records of a data set.
#[must_use]
pub fn fit(model: &Model, dataset: &Dataset, records: &[usize], effort: Effort) -> Fit {
    let free = free_parameters(model);
    let mut model = model.clone();
    let mut lambda = 1e-6;
    let mut iterations = 0;
    let mut cost;
    let mut samples;
    let mut known: Option<(Model, Vec<Linearised>)> = None;
    let mut fresh = false;
    loop {
        let reusable = known.as_ref().filter(|(at, _)| !fresh && shape_change(at, &model, &free) < SHAPE_TOLERANCE);
        let reused = reusable.is_some();
        let parts = linearise_reusing(&model, dataset, records, &free, reusable.map(|(_, parts)| parts.as_slice()));
        fresh = false;
        let (h, g, current, n) = normal_equations(&parts);
        if !reused {
            known = Some((model.clone(), parts));
        }
        cost = current;
        samples = n;
        iterations += 1;
        if free.is_empty() || n == 0 || iterations > effort.iterations {
            break;
        }
        let variance = (cost / n as f64).max(1e-30);
        let worthwhile = (effort.tolerance * variance * free.len() as f64).max(effort.relative * cost);
        let mut improved = None;
        for _ in 0..12 {
            let Some(step) = damped_step(&model, &free, &h, &g, variance, lambda) else {
                lambda *= 10.0;
                continue;
            };
            let promise = promised(&h, &g, &step);
            if promise < worthwhile {
                break;
            }
            let mut trial = moved(&model, &free, &step);
            let mut trial_cost = cost_of(&trial, dataset, records);
            if trial_cost >= cost {
                // The way there may be curved only because the surfaces did not follow.
                trial = with_surfaces_following(&trial, dataset, records, &free, variance);
                trial_cost = cost_of(&trial, dataset, records);
            }
            if trial_cost < cost {
                // Damping follows how well the promise was kept.
                let kept = (cost - trial_cost) / promise;
                lambda = (lambda
                    * if kept > 0.75 {
                        0.1
                    } else if kept < 0.25 {
                        3.0
                    } else {
                        1.0
                    })
                .max(1e-12);
                improved = Some((trial, trial_cost));
                break;
            }
            if cost - trial_cost > -1e-9 * cost {
                break; // no longer a matter of the step
            }
            lambda = (lambda * 10.0).max(1e-7);
        }
        let gain = improved.as_ref().map_or(0.0, |(_, better_cost)| cost - better_cost);
        if let Some((better, better_cost)) = improved {
            model = better;
            cost = better_cost;
        }
        if gain < worthwhile {
            if !reused {
                break;
            }
            fresh = true; // a last look with exact derivatives
        }
    }
    store_lines(&mut model, dataset, records);
    Fit { model, rms_um: (cost / samples.max(1) as f64).sqrt(), samples, iterations }
}

/// By how much a step would lower the sum of squares if the model were linear.
fn promised(h: &DMatrix<f64>, g: &DVector<f64>, step: &DVector<f64>) -> f64 {
    2.0 * step.dot(g) - step.dot(&(h * step))
}

/// The model with the coefficients of its hysteresis, which enter linearly, put where they serve its other values best.
fn with_surfaces_following(model: &Model, dataset: &Dataset, records: &[usize], free: &[ParameterIndex], variance: f64) -> Model {
    let surfaces: Vec<ParameterIndex> = free.iter().copied().filter(|index| is_surface_coefficient(model, *index)).collect();
    let (h, g, _, _) = normal_equations(&linearise(model, dataset, records, &surfaces));
    damped_step(model, &surfaces, &h, &g, variance, 0.0).map_or_else(|| model.clone(), |step| moved(model, &surfaces, &step))
}

fn cost_of(model: &Model, dataset: &Dataset, records: &[usize]) -> f64 {
    let parts: Vec<f64> = records
        .par_iter()
        .map(|&i| {
            let r = residual(model, &dataset.records[i]);
            dot(&r, &r)
        })
        .collect();
    let sum: f64 = parts.iter().sum();
    if sum.is_finite() { sum } else { f64::INFINITY }
}

fn prior_weight(model: &Model, index: ParameterIndex, variance: f64) -> f64 {
    match model.effects[index.effect].parameters[index.parameter].parameter.scale {
        Scale::Linear(_) => variance / (PRIOR_COORDINATES * PRIOR_COORDINATES),
        Scale::Logarithmic => 0.0,
    }
}

/// One damped step; coordinates that stand at a bound and want to go beyond are left out, and positive values stay in reach.
fn damped_step(
    model: &Model,
    free: &[ParameterIndex],
    h: &DMatrix<f64>,
    g: &DVector<f64>,
    variance: f64,
    lambda: f64,
) -> Option<DVector<f64>> {
    let p = free.len();
    let value_of = |i: usize| &model.effects[free[i].effect].parameters[free[i].parameter];
    let mut held: Vec<Option<f64>> = vec![None; p];
    let mut step = solve_damped(model, free, h, g, variance, lambda, &held)?;
    // Every pass holds one coordinate more at the bound where it stands.
    for _ in 0..p {
        let leaves_bounds = |i: &usize| {
            let value = value_of(*i);
            (value.value <= value.parameter.lower && step[*i] < 0.0) || (value.value >= value.parameter.upper && step[*i] > 0.0)
        };
        let leaving: Vec<usize> = (0..p).filter(|i| held[*i].is_none()).filter(leaves_bounds).collect();
        if leaving.is_empty() {
            break;
        }
        leaving.iter().for_each(|i| held[*i] = Some(0.0));
        step = solve_damped(model, free, h, g, variance, lambda, &held)?;
    }
    let too_far = |step: &DVector<f64>, i: usize| -> bool {
        matches!(value_of(i).parameter.scale, Scale::Logarithmic) && step[i].abs() > LOGARITHMIC_STEP_MAX * (1.0 + 1e-9)
    };
    let farthest = (0..p).filter(|i| too_far(&step, *i)).map(|i| step[i].abs()).fold(0.0, f64::max);
    if farthest == 0.0 {
        return Some(step);
    }
    // Two ways to stay in reach: a part of the step, or all of it for the coordinates that may.
    let part = &step * (LOGARITHMIC_STEP_MAX / farthest);
    let mut rest = step.clone();
    for _ in 0..p {
        let far: Vec<usize> = (0..p).filter(|i| held[*i].is_none() && too_far(&rest, *i)).collect();
        if far.is_empty() {
            break;
        }
        far.iter().for_each(|i| held[*i] = Some(LOGARITHMIC_STEP_MAX.copysign(rest[*i])));
        rest = solve_damped(model, free, h, g, variance, lambda, &held)?;
    }
    Some(if promised(h, g, &rest) > promised(h, g, &part) { rest } else { part })
}

/// A positive value changes by no more than a factor of e in one step.
const LOGARITHMIC_STEP_MAX: f64 = 1.0;

/// The damped step in which some coordinates move by what is held for them.
fn solve_damped(
    model: &Model,
    free: &[ParameterIndex],
    h: &DMatrix<f64>,
    g: &DVector<f64>,
    variance: f64,
    lambda: f64,
    held: &[Option<f64>],
) -> Option<DVector<f64>> {
    let p = free.len();
    let mut a = h.clone();
    let mut b = g.clone();
    for i in 0..p {
        let weight = prior_weight(model, free[i], variance);
        let value = &model.effects[free[i].effect].parameters[free[i].parameter];
        if weight > 0.0 {
            a[(i, i)] += weight;
            b[i] -= weight * value.coordinate();
        }
        a[(i, i)] += lambda * h[(i, i)] + 1e-300;
    }
    for (i, step) in held.iter().enumerate().filter_map(|(i, step)| step.map(|step| (i, step))) {
        for j in 0..p {
            b[j] -= a[(j, i)] * step;
            a[(i, j)] = 0.0;
            a[(j, i)] = 0.0;
        }
        a[(i, i)] = 1.0;
    }
    for (i, step) in held.iter().enumerate() {
        b[i] = step.unwrap_or(b[i]);
    }
    // Scale to a unit diagonal: the columns differ by orders of magnitude.
    let scale: Vec<f64> = (0..p).map(|i| if a[(i, i)] > 0.0 { 1.0 / a[(i, i)].sqrt() } else { 0.0 }).collect();
    for i in 0..p {
        for j in 0..p {
            a[(i, j)] *= scale[i] * scale[j];
        }
        a[(i, i)] = if scale[i] == 0.0 { 1.0 } else { a[(i, i)] + 1e-13 };
        b[i] *= scale[i];
    }
    let mut step = a.cholesky()?.solve(&b);
    step.iter_mut().zip(&scale).for_each(|(step, scale)| *step *= scale);
    step.iter().all(|s| s.is_finite()).then_some(step)
}

fn moved(model: &Model, free: &[ParameterIndex], step: &DVector<f64>) -> Model {
    let mut out = model.clone();
    for (index, s) in free.iter().zip(step.iter()) {
        let value = &mut out.effects[index.effect].parameters[index.parameter];
        let coordinate = value.coordinate() + s;
        value.set_coordinate(coordinate);
    }
    out
}

/// Sine and cosine of a line belong to each record; the model keeps those of its first record so that it can simulate.
fn store_lines(model: &mut Model, dataset: &Dataset, records: &[usize]) {
    let Some(at) = model.effects.iter().position(|e| !e.effect.line_frequencies_hz(&e.values()).is_empty()) else { return };
    let Some(&first) = records.first() else { return };
    let record = &dataset.records[first];
    let frequency_hz = model.effects[at].parameters[0].value;
    for i in 1..=2 {
        model.effects[at].parameters[i].value = 0.0;
    }
    let reading = model.simulate(&record.drive());
    let n = record.window.len().max(1) as f64;
    let (mut sine, mut cosine) = (0.0, 0.0);
    for k in record.window.clone() {
        let phase = std::f64::consts::TAU * frequency_hz * k as f64 * record.dt_s();
        let error = record.displacement_um[k] - reading[k];
        sine += 2.0 / n * error * phase.sin();
        cosine += 2.0 / n * error * phase.cos();
    }
    model.effects[at].parameters[1].value = sine;
    model.effects[at].parameters[2].value = cosine;
}

/// Samples in one block of the sandwich estimator, at least.
const BLOCKS_PER_RECORD: usize = 60;

/// Block boundaries of a record's window for resampling.
#[must_use]
pub fn blocks(samples: usize) -> Vec<std::ops::Range<usize>> {
    let count = BLOCKS_PER_RECORD.min(samples.max(1));
    (0..count).map(|b| b * samples / count..(b + 1) * samples / count).collect()
}

/// A direction of the parameters that the data do not show.
#[derive(Clone, Debug)]
pub struct Unidentified {
    /// Effect with the largest part in it.
    pub effect: String,
    /// Parameter with the largest part in it.
    pub parameter: String,
}

/// Fills in the standard deviations of a fitted model and names parameters that the data cannot tell.
pub fn estimate_uncertainty(model: &mut Model, dataset: &Dataset, records: &[usize]) -> Vec<Unidentified> {
    let free = free_parameters(model);
    let p = free.len();
    if p == 0 {
        return Vec::new();
    }
    let parts = linearise(model, dataset, records, &free);
    let (h, _, cost, samples) = normal_equations(&parts);
    let variance = cost / samples.saturating_sub(p).max(1) as f64;
    let mut regularised = h.clone();
    for i in 0..p {
        regularised[(i, i)] += prior_weight(model, free[i], variance) + 1e-300;
    }
    let scale: Vec<f64> = (0..p).map(|i| 1.0 / regularised[(i, i)].sqrt()).collect();
    let scaled = DMatrix::from_fn(p, p, |i, j| regularised[(i, j)] * scale[i] * scale[j] + if i == j { 1e-13 } else { 0.0 });
    let Some(inverse) = scaled.cholesky().map(|c| c.inverse()) else { return Vec::new() };
    let inverse = DMatrix::from_fn(p, p, |i, j| inverse[(i, j)] * scale[i] * scale[j]);
    let mut middle = DMatrix::zeros(p, p);
    for part in &parts {
        for block in blocks(part.residual.len()) {
            let gradient = DVector::from_fn(p, |i, _| dot(&part.jacobian[i][block.clone()], &part.residual[block.clone()]));
            middle += &gradient * gradient.transpose();
        }
    }
    let sandwich = &inverse * middle * &inverse;
    let mut unidentified = Vec::new();
    for (i, index) in free.iter().enumerate() {
        let white = (variance * inverse[(i, i)]).max(0.0).sqrt();
        let coloured = sandwich[(i, i)].max(0.0).sqrt();
        let std_coordinate = white.max(coloured);
        let effect = &mut model.effects[index.effect];
        let id = effect.id.clone();
        let value = &mut effect.parameters[index.parameter];
        value.std = Some(std_coordinate * value.value_per_coordinate().abs());
        let limit = match value.parameter.scale {
            Scale::Linear(_) => 0.5 * PRIOR_COORDINATES,
            Scale::Logarithmic => 1.5,
        };
        if std_coordinate > limit {
            unidentified.push(Unidentified { effect: id, parameter: value.parameter.name.clone() });
        }
    }
    unidentified
}

/// Adds an effect at given start values to a copy of a model.
#[must_use]
pub fn with_effect(model: &Model, instance: EffectInstance) -> Model {
    let mut out = model.clone();
    out.add(instance);
    out
}
