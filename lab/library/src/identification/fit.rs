//! Least squares over the whole chain: every free value of every effect, from all records at once.
//!
//! # How it works
//! * Residual and derivatives come from [`super::linearisation`], free of what each record has of its own
//!   ([`super::nuisance_terms`]).
//! * Steps are Levenberg and Marquardt's on the normal equations, which are accumulated record by record. A
//!   weak prior of one full range on coefficients keeps directions that the data do not show small; it weighs
//!   one part in 10^4 of one sample.
//! * The derivatives by the coefficients of the hysteresis change little while the other values move little;
//!   they are kept until those have moved far enough. Every step is judged by the true sum of squares and what
//!   the prior adds to it.
//! * Where a trial step fails, the coefficients of the hysteresis follow it before the fit rejects it, by the
//!   derivatives that led to the step: exact ones cost as much as a step, and brought a fall in one of twelve
//!   cases where those did not.

use super::linearisation::{
    LinearCoefficients, Linearised, ParameterIndex, Rows, along_residual, free_parameters,
    left_in_window, linearise, linearise_reusing, residual_at, residual_near,
    squares_of_derivatives,
};
use super::nuisance_terms::Samples;
use crate::dataset::{Dataset, Record};
use crate::parallel;
use hysteron_sim::chain::{EffectInstance, Model};
use hysteron_sim::effect::{Parameter, Scale};
use nalgebra::{DMatrix, DVector};

pub use crate::statistics::{dot, rms};

/// Measured less modelled inside the window of a record, with what the record has of its own removed; at
/// samples that do not count as well.
#[must_use]
pub fn residual(model: &Model, record: &Record) -> Vec<f64> {
    let model = &*model.before_rounding();
    left_in_window(model, record, &model.simulate(&record.drive()))
}

/// The same at the samples whose readings say something: what every figure of an error is computed from.
#[must_use]
pub fn counted_residual(model: &Model, record: &Record) -> Vec<f64> {
    residual_at(model, record, &Samples::counted(record))
        .as_slice()
        .to_vec()
}

/// Root mean square over the records with the given indices, all samples weighing the same.
#[must_use]
pub fn rms_over(model: &Model, dataset: &Dataset, records: &[usize]) -> f64 {
    let parts: Vec<(f64, usize)> = parallel::map(records, |&i| {
        let r = counted_residual(model, &dataset.records[i]);
        (dot(&r, &r), r.len())
    });
    let (sum, count) = parts
        .iter()
        .fold((0.0, 0), |(s, n), (ds, dn)| (s + ds, n + dn));
    if count == 0 {
        0.0
    } else {
        (sum / count as f64).sqrt()
    }
}

/// How far the parameters that are no linear coefficients moved between two models, in coordinates that
/// matter.
fn shape_change(a: &Model, b: &Model, free: &[ParameterIndex]) -> f64 {
    let linear = LinearCoefficients::of(a);
    free.iter()
        .filter(|index| linear.lane(a, **index).is_none())
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

/// Prior standard deviation of a coefficient, in coordinates (a coordinate of one is a hundredth of the
/// range).
const PRIOR_COORDINATES: f64 = 100.0;

/// How hard a fit tries.
#[derive(Clone, Copy, Debug)]
pub struct Effort {
    /// Most steps.
    pub iterations: usize,
    /// A step that lowers the sum of squares by less than this share of one sample's variance per parameter
    /// ends the fit.
    pub tolerance: f64,
    /// A step that lowers the sum of squares by less than this share of it ends the fit.
    pub relative: f64,
    /// Where older derivatives lead nowhere, the look with new ones is damped as before those failed. Without
    /// it a fit ends there, where their failures came from a product of two values that had changed its sign;
    /// with it another path is taken far above the noise, to no better ends.
    pub looks_again: bool,
}

impl Default for Effort {
    fn default() -> Self {
        Self {
            iterations: 30,
            tolerance: 0.05,
            relative: 1e-6,
            looks_again: true,
        }
    }
}

/// What a fit came to.
#[derive(Clone, Debug)]
pub struct Fit {
    /// The model with its values; standard deviations once
    /// [`estimate_uncertainty`](super::uncertainty::estimate_uncertainty) ran.
    pub model: Model,
    /// Residual over the fitted records.
    pub rms_um: f64,
    /// Samples fitted.
    pub samples: usize,
    /// What the model leaves of each record of the rows that were fitted, free of what the record has of its
    /// own.
    pub residuals: Vec<DVector<f64>>,
}

/// Surface derivatives are taken again when some other parameter has moved this far.
const SHAPE_TOLERANCE: f64 = 0.03;

/// Fits the free parameters of a model to all samples of some records.
#[must_use]
pub fn fit(model: &Model, dataset: &Dataset, records: &[usize], effort: Effort) -> Fit {
    fit_rows(model, dataset, &Rows::all(dataset, records), effort)
}

/// Fits the free parameters of a model to the samples that count.
#[must_use]
pub fn fit_rows(model: &Model, dataset: &Dataset, rows: &Rows, effort: Effort) -> Fit {
    fit_while(model, dataset, rows, effort, |_| true)
}

/// How far a fit has come.
pub struct FitProgress<'m> {
    /// Steps that were taken.
    pub taken: usize,
    /// By how much the last two lowered the residual, as a logarithm: one that is taken with older
    /// derivatives may bring little before one with new ones.
    pub fell: f64,
    /// The model.
    pub model: &'m Model,
}

/// The same as long as its progress is worth it, which is asked after every step.
#[must_use]
pub fn fit_while(
    model: &Model,
    dataset: &Dataset,
    rows: &Rows,
    effort: Effort,
    goes_on: impl Fn(&FitProgress) -> bool,
) -> Fit {
    let free = free_parameters(model);
    let mut model = model.clone();
    let mut lambda = 1e-6;
    let mut known: Option<(Model, Vec<Linearised>)> = None;
    let mut age = Age::Exact;
    let mut parts = linearise(&model, dataset, rows, &free);
    let mut chord_steps = 0;
    let mut h = squares_of_derivatives(&parts);
    if let Some(begun) = with_coefficients_first(&model, dataset, rows, &free, &parts, &h) {
        model = begun.model;
        parts
            .iter_mut()
            .zip(begun.residuals)
            .for_each(|(part, residual)| part.residual = residual);
    }
    let mut costs_before = [f64::INFINITY; 2];
    for taken in 0..effort.iterations {
        let (g, cost, n) = along_residual(&parts);
        let fell = if cost > 0.0 {
            0.5 * (costs_before[0] / cost).ln()
        } else {
            0.0
        };
        costs_before = [costs_before[1], cost];
        if taken > 0
            && !goes_on(&FitProgress {
                taken,
                fell,
                model: &model,
            })
        {
            break;
        }
        if free.is_empty() || n == 0 {
            break;
        }
        if age == Age::Exact {
            known = Some((model.clone(), parts.clone()));
        }
        let variance = (cost / n as f64).max(1e-30);
        let worthwhile =
            (effort.tolerance * variance * free.len() as f64).max(effort.relative * cost);
        let damped_before = lambda;
        let step = best_step(
            &model,
            dataset,
            rows,
            &free,
            &Normal {
                parts: &parts,
                h: &h,
                g,
                cost,
                variance,
            },
            worthwhile,
            if effort.looks_again && age == Age::Older {
                OLDER_TRIALS
            } else {
                TRIALS
            },
            &mut lambda,
        );
        let gain = step.as_ref().map_or(0.0, |s| s.fell);
        let mut kept = 0.0;
        if let Some(step) = step {
            kept = step.kept;
            model = step.model;
            // Where the derivatives kept what they promised they are good for another step: only the residual
            // is new.
            parts
                .iter_mut()
                .zip(step.residuals)
                .for_each(|(part, residual)| part.residual = residual);
        }
        if gain < worthwhile {
            if age == Age::Exact {
                break;
            }
            // A last look with exact derivatives.
            if effort.looks_again {
                lambda = damped_before;
            }
            (parts, age, chord_steps) = (linearise(&model, dataset, rows, &free), Age::Exact, 0);
            h = squares_of_derivatives(&parts);
        } else if kept > KEPT_WELL && chord_steps < CHORD_STEPS {
            (age, chord_steps) = (Age::Older, chord_steps + 1);
        } else {
            let near = known
                .as_ref()
                .filter(|(at, _)| shape_change(at, &model, &free) < SHAPE_TOLERANCE);
            age = if near.is_some() {
                Age::Older
            } else {
                Age::Exact
            };
            parts = linearise_reusing(
                &model,
                dataset,
                rows,
                &free,
                near.map(|(_, parts)| parts.as_slice()),
            );
            h = squares_of_derivatives(&parts);
            chord_steps = 0;
        }
    }
    let (cost, samples) = parts.iter().fold((0.0, 0), |(c, n), p| {
        (c + p.residual.norm_squared(), n + p.residual.len())
    });
    store_lines(&mut model, dataset, rows);
    let residuals = parts.into_iter().map(|part| part.residual).collect();
    Fit {
        model,
        rms_um: (cost / samples.max(1) as f64).sqrt(),
        samples,
        residuals,
    }
}

/// Whether all derivatives belong to the present model.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Age {
    Exact,
    Older,
}

/// Share of the promised fall that a step must bring for the same derivatives to serve once more.
const KEPT_WELL: f64 = 0.6;
/// Factor of the damping behind a step that fails: with one of ten four trials of a quick fit failed, half of
/// all readings that it simulates.
const DAMPED_MORE: f64 = 100.0;
/// Dampings with which a step is tried, and with older derivatives where new ones are asked next.
const TRIALS: usize = 12;
const OLDER_TRIALS: usize = 2;
/// Steps that are taken with the same derivatives.
const CHORD_STEPS: usize = 3;

/// Derivatives and normal equations where a step begins.
struct Normal<'l> {
    parts: &'l [Linearised],
    h: &'l DMatrix<f64>,
    g: DVector<f64>,
    cost: f64,
    variance: f64,
}

/// A step that lowers the sum of squares and what lies beyond expectation.
struct Better {
    model: Model,
    /// By how much.
    fell: f64,
    residuals: Vec<DVector<f64>>,
    /// Share of the promised fall that came.
    kept: f64,
}

/// The model with the coefficients of its hysteresis where they serve its other values as they are begun,
/// where that lowers the sum of squares: begun beside those of a model that lacked an effect, all values
/// together take steps that fail.
fn with_coefficients_first(
    model: &Model,
    dataset: &Dataset,
    rows: &Rows,
    free: &[ParameterIndex],
    parts: &[Linearised],
    h: &DMatrix<f64>,
) -> Option<Better> {
    let (g, cost, n) = along_residual(parts);
    let variance = (cost / n.max(1) as f64).max(1e-30);
    let residuals: Vec<DVector<f64>> = parts.iter().map(|part| part.residual.clone()).collect();
    let at = Normal {
        parts,
        h,
        g,
        cost,
        variance,
    };
    let begun = with_coefficients_following(model, free, &at, &residuals);
    let (after, residuals) = residuals_of(&begun, dataset, rows, parts);
    let [of_begun, of_model] = [&begun, model].map(|one| beyond_expected(one, free, variance));
    let fell = cost + of_model - after - of_begun;
    (fell > 0.0).then_some(Better {
        model: begun,
        fell,
        residuals,
        kept: 1.0,
    })
}

/// The least damped step that lowers the sum of squares and what lies beyond expectation, if one is worth
/// while; damping follows how well promises are kept.
fn best_step(
    model: &Model,
    dataset: &Dataset,
    rows: &Rows,
    free: &[ParameterIndex],
    at: &Normal,
    worthwhile: f64,
    trials: usize,
    lambda: &mut f64,
) -> Option<Better> {
    let expected = |model: &Model| beyond_expected(model, free, at.variance);
    let before = at.cost + expected(model);
    for _ in 0..trials {
        let Some(step) = damped_step(model, free, at.h, &at.g, at.variance, *lambda) else {
            *lambda *= DAMPED_MORE;
            continue;
        };
        let mut trial = moved(model, free, &step);
        let promise = promised(at.h, &at.g, &step) + before - at.cost - expected(&trial);
        if promise < worthwhile {
            return None;
        }
        let (mut cost, mut residuals) = residuals_of(&trial, dataset, rows, at.parts);
        if cost + expected(&trial) >= before {
            // The way there may be curved only because the surfaces did not follow.
            trial = with_coefficients_following(&trial, free, at, &residuals);
            (cost, residuals) = residuals_of(&trial, dataset, rows, at.parts);
        }
        let fell = before - cost - expected(&trial);
        if fell > 0.0 {
            let kept = fell / promise;
            let change = if kept > 0.75 { 0.1 } else { 1.0 } * if kept < 0.25 { 3.0 } else { 1.0 };
            *lambda = (*lambda * change).max(1e-12);
            return Some(Better {
                model: trial,
                fell,
                residuals,
                kept,
            });
        }
        if fell > -1e-9 * before {
            return None; // no longer a matter of the step
        }
        *lambda = (*lambda * DAMPED_MORE).max(1e-7);
    }
    None
}

/// By how much a step would lower the sum of squares if the model were linear.
fn promised(h: &DMatrix<f64>, g: &DVector<f64>, step: &DVector<f64>) -> f64 {
    2.0 * step.dot(g) - step.dot(&(h * step))
}

/// A trial that leaves these residuals, with the coefficients of its hysteresis, which enter linearly, put
/// where they serve its other values best as far as the derivatives of where the step began tell.
fn with_coefficients_following(
    trial: &Model,
    free: &[ParameterIndex],
    at: &Normal,
    residuals: &[DVector<f64>],
) -> Model {
    let linear = LinearCoefficients::of(trial);
    let places: Vec<usize> = (0..free.len())
        .filter(|i| linear.lane(trial, free[*i]).is_some())
        .collect();
    let surfaces: Vec<ParameterIndex> = places.iter().map(|i| free[*i]).collect();
    let along = at
        .parts
        .iter()
        .zip(residuals)
        .map(|(part, residual)| part.jacobian.tr_mul(residual));
    let g = along
        .fold(DVector::zeros(free.len()), |sum, of_record| sum + of_record)
        .select_rows(&places);
    let h = at.h.select_columns(&places).select_rows(&places);
    damped_step(trial, &surfaces, &h, &g, at.variance, 0.0)
        .map_or_else(|| trial.clone(), |step| moved(trial, &surfaces, &step))
}

/// Sum of squares of a model and its residuals, near one whose linearisation is known; infinite where
/// anything is no number.
fn residuals_of(
    model: &Model,
    dataset: &Dataset,
    rows: &Rows,
    near: &[Linearised],
) -> (f64, Vec<DVector<f64>>) {
    rows.count_simulation(model, dataset);
    let residuals = parallel::map_indices(rows.records.len(), |r| {
        let (i, samples) = &rows.records[r];
        let record = &dataset.records[*i];
        rows.work
            .counting_forces(|| residual_near(model, record, samples, &near[r]))
    });
    let sum: f64 = residuals.iter().map(DVector::norm_squared).sum();
    (if sum.is_finite() { sum } else { f64::INFINITY }, residuals)
}

/// Prior standard deviation of a parameter in coordinates.
pub(super) fn prior_coordinates(parameter: &Parameter) -> f64 {
    parameter.expected_steps.unwrap_or(PRIOR_COORDINATES)
}

/// Weight of the prior on a coordinate, in the units of the normal equations.
pub(super) fn prior_weight(model: &Model, index: ParameterIndex, variance: f64) -> f64 {
    let parameter = &model.effects[index.effect].parameters[index.parameter].parameter;
    match parameter.scale {
        Scale::Linear(_) => variance / prior_coordinates(parameter).powi(2),
        Scale::Logarithmic => 0.0,
    }
}

/// What the values of a model lie beyond what is expected of them, in the units of the sum of squares.
fn beyond_expected(model: &Model, free: &[ParameterIndex], variance: f64) -> f64 {
    let of_value = |index: &ParameterIndex| {
        let value = &model.effects[index.effect].parameters[index.parameter];
        prior_weight(model, *index, variance) * value.coordinate().powi(2)
    };
    free.iter().map(of_value).sum()
}

/// One damped step; coordinates that stand at a bound and want to go beyond are left out, and positive values
/// stay in reach.
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
            (value.value <= value.parameter.lower && step[*i] < 0.0)
                || (value.value >= value.parameter.upper && step[*i] > 0.0)
        };
        let leaving: Vec<usize> = (0..p)
            .filter(|i| held[*i].is_none())
            .filter(leaves_bounds)
            .collect();
        if leaving.is_empty() {
            break;
        }
        leaving.iter().for_each(|i| held[*i] = Some(0.0));
        step = solve_damped(model, free, h, g, variance, lambda, &held)?;
    }
    let too_far = |step: &DVector<f64>, i: usize| -> bool {
        matches!(value_of(i).parameter.scale, Scale::Logarithmic)
            && step[i].abs() > LOGARITHMIC_STEP_MAX * (1.0 + 1e-9)
    };
    let farthest = (0..p)
        .filter(|i| too_far(&step, *i))
        .map(|i| step[i].abs())
        .fold(0.0, f64::max);
    if farthest == 0.0 {
        return Some(step);
    }
    // Two ways to stay in reach: a part of the step, or all of it for the coordinates that may.
    let part = &step * (LOGARITHMIC_STEP_MAX / farthest);
    let mut rest = step.clone();
    for _ in 0..p {
        let far: Vec<usize> = (0..p)
            .filter(|i| held[*i].is_none() && too_far(&rest, *i))
            .collect();
        if far.is_empty() {
            break;
        }
        far.iter()
            .for_each(|i| held[*i] = Some(LOGARITHMIC_STEP_MAX.copysign(rest[*i])));
        rest = solve_damped(model, free, h, g, variance, lambda, &held)?;
    }
    Some(if promised(h, g, &rest) > promised(h, g, &part) {
        rest
    } else {
        part
    })
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
    for (i, step) in held
        .iter()
        .enumerate()
        .filter_map(|(i, step)| step.map(|step| (i, step)))
    {
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
    let scale: Vec<f64> = (0..p)
        .map(|i| {
            if a[(i, i)] > 0.0 {
                1.0 / a[(i, i)].sqrt()
            } else {
                0.0
            }
        })
        .collect();
    for i in 0..p {
        for j in 0..p {
            a[(i, j)] *= scale[i] * scale[j];
        }
        a[(i, i)] = if scale[i] == 0.0 {
            1.0
        } else {
            a[(i, i)] + 1e-13
        };
        b[i] *= scale[i];
    }
    let mut step = a.cholesky()?.solve(&b);
    step.iter_mut()
        .zip(&scale)
        .for_each(|(step, scale)| *step *= scale);
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

/// Sine and cosine of a line belong to each record; the model keeps those of its first record so that it can
/// simulate.
fn store_lines(model: &mut Model, dataset: &Dataset, rows: &Rows) {
    let Some((first, _)) = rows.records.first() else {
        return;
    };
    // The effect, the place of the sine in it, and the frequency of every line.
    let amplitudes: Vec<(usize, usize, f64)> = (model.effects.iter().enumerate())
        .flat_map(|(at, instance)| {
            let lines_hz = instance
                .effect
                .line_frequencies_hz(model, &instance.values());
            let from = instance.parameters.len() - 2 * lines_hz.len();
            lines_hz
                .into_iter()
                .enumerate()
                .map(move |(i, hz)| (at, from + 2 * i, hz))
        })
        .collect();
    if amplitudes.is_empty() {
        return;
    }
    for (at, sine, _) in &amplitudes {
        model.effects[*at].parameters[*sine].value = 0.0;
        model.effects[*at].parameters[sine + 1].value = 0.0;
    }
    let record = &dataset.records[*first];
    let reading = model.simulate(&record.drive());
    let share = 2.0 / record.counted().count().max(1) as f64;
    for (at, sine, frequency_hz) in amplitudes {
        let (mut along_sine, mut along_cosine) = (0.0, 0.0);
        for k in record.counted() {
            let phase = std::f64::consts::TAU * frequency_hz * k as f64 * record.dt_s();
            let error = record.displacement_um[k] - reading[k];
            along_sine += share * error * phase.sin();
            along_cosine += share * error * phase.cos();
        }
        model.effects[at].parameters[sine].value = along_sine;
        model.effects[at].parameters[sine + 1].value = along_cosine;
    }
}

/// Samples in one block of the sandwich estimator, at least.
const BLOCKS_PER_RECORD: usize = 60;

/// Block boundaries of a record's window for resampling.
#[must_use]
pub fn blocks(samples: usize) -> Vec<std::ops::Range<usize>> {
    let count = BLOCKS_PER_RECORD.min(samples.max(1));
    (0..count)
        .map(|b| b * samples / count..(b + 1) * samples / count)
        .collect()
}

/// Adds an effect at given start values to a copy of a model.
#[must_use]
pub fn with_effect(model: &Model, instance: EffectInstance) -> Model {
    let mut out = model.clone();
    out.add(instance);
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::Role;
    use crate::model_file::effect_named;
    use hysteron_sim::effect::Overview;
    use hysteron_sim::noise::WhiteNoise;

    /// A virgin stage, fitted from where a sweep would have left it: the history and the activation are found.
    #[test]
    fn a_fit_finds_the_history_of_activated_plays() {
        let triangle = |period: usize| -> Vec<f64> {
            let height = |k: usize| (k % period).min(period - k % period) as f64;
            (0..4000)
                .map(|k| 120.0 * height(k) / period as f64)
                .collect()
        };
        let drives_v = [triangle(2000), triangle(250)];
        let rough = Overview::without_data(0.0, 70.0);
        let with = |overview: &Overview, values: &[f64]| {
            let mut model = Model::new(0.0, 70.0);
            let effect = effect_named("activated_switching").unwrap();
            model.add(EffectInstance::new(effect, overview, values));
            model
        };
        let mut values = with(&rough, &[]).effects[0].values();
        values[..8].copy_from_slice(&[0.02, 1.0, 5.0, 0.2, 0.0, 0.0, 0.0, 2.0]);
        let stage = with(&rough, &values);
        let record = |(name, drive_v): (&str, &Vec<f64>)| {
            let mut record = Record::new(name, 1000.0, drive_v.clone(), drive_v.clone())
                .with_role(Role::Identify);
            let mut noise = WhiteNoise::new(0.002, name.len() as u64);
            record.displacement_um = stage.simulate(&record.drive());
            record
                .displacement_um
                .iter_mut()
                .for_each(|um| *um += noise.next_um());
            record
        };
        let records = ["slow", "faster"]
            .into_iter()
            .zip(&drives_v)
            .map(record)
            .collect();
        let dataset = Dataset::new("virgin", 0.0, 70.0, records).unwrap();
        let begin = with(&dataset.overview(), &[]);
        let found = fit(&begin, &dataset, &[0, 1], Effort::default());
        let values = found.model.effects[0].values();
        assert!((values[0] - 0.02).abs() < 0.002, "activation {}", values[0]);
        assert!(values[1] > 0.5, "forgotten {}", values[1]);
        assert!(found.rms_um < 0.003, "{} um", found.rms_um);
    }
}
