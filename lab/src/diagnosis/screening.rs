//! Scores every candidate on the residual of a model without refitting it.
//!
//! # How it works
//! A candidate's *signature* is what the model's reading changes by when the effect enters at one of its start values. From signature
//! and residual everything is projected out that the present model could do by itself: its own parameter sensitivities, those of more
//! flexible hysteresis surfaces, those by the time constants of the creep, and what each record has of its own. What is left of the residual along what is left of the signature is
//! the share that the candidate explains; a wrong parameter cannot pose as a missing effect.
//!
//! Instants of sampling and of writing the drive are never known exactly: a skew between drive and reading of a small share of the sampling
//! period is taken out of the residual as well, no more than that share, so that a delay or a lag stays visible.
//!
//! The null distribution comes from the data: under no effect the sign of each block of the residual is a toss-up, so the products of
//! residual and signature, summed by blocks, are given random signs and the best start of each candidate is taken again. That accounts for
//! coloured residuals and for having looked at many starts; what the fit took out of the residual in each block is given back first
//! (its leverage), or noise would look smaller than it is. Over all candidates the same sign patterns give the distribution of the least
//! p-value of any candidate under no effect; p-values are adjusted by it, stepping down (Westfall and Young, Resampling-Based Multiple
//! Testing, 1993, Algorithm 2.8). Where nothing is missing, anything is called significant in one of twenty data sets, however alike the
//! candidates are: the false discovery rate is controlled with it, and no power is lost to a bound that ignores their likeness.

use crate::dataset::Dataset;
use crate::fit::{Linearised, blocks, dot, free_parameters, linearise, normal_equations, project_out, rms};
use crate::refine;
use hysteron_sim::chain::{ChainRun, EffectInstance, Model};
use hysteron_sim::effect::{Effect, Overview};
use nalgebra::{Cholesky, DMatrix, DVector, Dyn};
use rand::{Rng, SeedableRng};
use rand_pcg::Pcg64Mcg;
use rayon::prelude::*;
use std::ops::Range;
use std::sync::Arc;

/// Sign patterns of the null distribution.
const TOSSES: usize = 1999;
/// Highest leverage that is made up for. Beyond it the fit has left so little of a block that it says nothing about its own noise: the
/// scatter of the whole record stands in.
const LEVERAGE_MAX: f64 = 0.5;
/// Resamples for the interval of the explained share.
const RESAMPLES: usize = 200;

/// How a candidate does on a residual.
#[derive(Clone)]
pub struct Score {
    /// The effect.
    pub effect: Arc<dyn Effect>,
    /// Its identifier.
    pub id: String,
    /// Start values, best first.
    pub starts: Vec<Vec<f64>>,
    /// Sum of squares that the best direction explains, um^2.
    pub explained_um2: f64,
    /// Share of what is above the floor (of the whole residual without one), 0..1.
    pub share: f64,
    /// 90 % interval of the share over resampled blocks.
    pub share_interval: (f64, f64),
    /// Share of the resamples of blocks in which this candidate explains most of all.
    pub stability: f64,
    resampled_um2: Vec<f64>,
    /// p-value of the candidate alone.
    pub p_value: f64,
    /// p-value after control of false discoveries over all candidates.
    pub p_adjusted: f64,
    /// p-value that each sign pattern would have had: its null distribution, joint with that of the other candidates.
    null_p_values: Vec<f64>,
    /// Projected signature of the best direction by record, scaled to the residual.
    pub signature: Vec<Vec<f64>>,
    unit: Vec<Vec<f64>>,
}

impl Score {
    /// Cosine between the signatures of two candidates on this data.
    #[must_use]
    pub fn similarity(&self, other: &Self) -> f64 {
        self.unit.iter().zip(&other.unit).map(|(a, b)| dot(a, b)).sum::<f64>().abs()
    }
}

/// The residual that was screened, and the scores.
#[derive(Clone)]
pub struct Screening {
    /// Scores, best first.
    pub scores: Vec<Score>,
    /// Projected residual by record.
    pub residual: Vec<Vec<f64>>,
}

/// What the model can do by itself, for projection.
struct Absorbed {
    parts: Vec<Linearised>,
    factor: Option<Cholesky<f64, Dyn>>,
    scale: Vec<f64>,
}

impl Absorbed {
    fn new(model: &Model, overview: &Overview, dataset: &Dataset, records: &[usize]) -> Self {
        let mut flexible = refine::refined(model, overview, 2).unwrap_or_else(|| model.clone());
        // Where on their grid the time constants of the creep stand was chosen before any data.
        let creep = flexible.effects.iter_mut().filter(|e| e.id == "creep");
        creep.flat_map(|e| &mut e.parameters).for_each(|p| p.parameter.fixed = false);
        let free = free_parameters(&flexible);
        let parts = linearise(&flexible, dataset, records, &free);
        let (h, _, _, _) = normal_equations(&parts);
        let p = free.len();
        let scale: Vec<f64> = (0..p).map(|i| if h[(i, i)] > 0.0 { 1.0 / h[(i, i)].sqrt() } else { 0.0 }).collect();
        let scaled = DMatrix::from_fn(p, p, |i, j| h[(i, j)] * scale[i] * scale[j] + if i == j { 1e-9 } else { 0.0 });
        Self { parts, factor: if p == 0 { None } else { scaled.cholesky() }, scale }
    }

    /// Removes what the model could absorb from a column given by record.
    fn remove(&self, column: &mut [Vec<f64>]) {
        for (part, values) in self.parts.iter().zip(column.iter_mut()) {
            project_out(&part.nuisance, values);
        }
        let Some(factor) = &self.factor else { return };
        let along = DVector::from_fn(self.scale.len(), |i, _| {
            self.scale[i] * self.parts.iter().zip(column.iter()).map(|(part, values)| dot(&part.jacobian[i], values)).sum::<f64>()
        });
        let weights = factor.solve(&along);
        for (part, values) in self.parts.iter().zip(column.iter_mut()) {
            for (i, derivative) in part.jacobian.iter().enumerate() {
                let w = weights[i] * self.scale[i];
                if w != 0.0 {
                    values.iter_mut().zip(derivative).for_each(|(v, d)| *v -= w * d);
                }
            }
        }
    }

    /// Share of the power of a column's block that the fit of the model has taken out of any residual there: a fitted residual is smaller
    /// than the noise it came from where the model has its freedom.
    fn leverage(&self, record: usize, block: &Range<usize>, column: &[f64]) -> f64 {
        let values = &column[block.clone()];
        let power = dot(values, values);
        let Some(part) = self.parts.get(record).filter(|_| power > 0.0) else { return 0.0 };
        let nuisance: f64 = part.nuisance.iter().map(|n| dot(&n[block.clone()], values)).map(|along| along * along).sum();
        let fitted = self.factor.as_ref().map_or(0.0, |factor| {
            let along = DVector::from_fn(self.scale.len(), |i, _| self.scale[i] * dot(&part.jacobian[i][block.clone()], values));
            along.dot(&factor.solve(&along))
        });
        ((nuisance + fitted) / power).clamp(0.0, 1.0)
    }
}

/// A direction: one or several signature columns that are looked for together.
struct Direction {
    starts: Vec<Vec<f64>>,
    columns: Vec<Vec<Vec<f64>>>,
    one_sided: bool,
}

/// Screens candidates on the residual of `model` over `records`.
#[must_use]
pub fn screen(
    model: &Model,
    overview: &Overview,
    dataset: &Dataset,
    records: &[usize],
    candidates: &[Arc<dyn Effect>],
    floor_um: Option<f64>,
    seed: u64,
) -> Screening {
    let model = &*model.before_rounding();
    let absorbed = Absorbed::new(model, overview, dataset, records);
    let mut residual: Vec<Vec<f64>> = absorbed.parts.iter().map(|p| p.residual.clone()).collect();
    absorbed.remove(&mut residual);
    let base: Vec<ChainRun> = records.par_iter().map(|&i| model.run(&dataset.records[i].drive())).collect();
    remove_skew(&base, dataset, records, &absorbed, &mut residual);
    let samples: usize = residual.iter().map(Vec::len).sum();
    let total: f64 = residual.iter().map(|r| dot(r, r)).sum();
    let above_floor = floor_um.map_or(total, |f| (total - samples as f64 * f * f).max(0.02 * total));
    let tosses = toss(residual.iter().map(|r| blocks(r.len()).len()).sum(), seed);

    let mut scores: Vec<Score> = candidates
        .par_iter()
        .filter_map(|effect| {
            let declaration = effect.declaration();
            let directions = directions(effect, model, overview, dataset, records, &base, declaration.one_sided);
            score(effect, declaration.id, directions, &absorbed, &residual, above_floor, &tosses)
        })
        .collect();
    control_false_discoveries(&mut scores);
    find_stability(&mut scores);
    scores.sort_by(|a, b| b.explained_um2.total_cmp(&a.explained_um2));
    Screening { scores, residual }
}

/// Instants of sampling and of writing the drive are known to within this share of the fastest period, and so is a model of a sampled
/// record: what a skew of that size leaves is not evidence.
const SKEW_MAX: f64 = 0.15;

/// Takes the best skew between drive and reading out of a residual, as far as instants are uncertain.
fn remove_skew(base: &[ChainRun], dataset: &Dataset, records: &[usize], absorbed: &Absorbed, residual: &mut [Vec<f64>]) {
    let rate_of_reading = |(&i, run): (&usize, &ChainRun)| {
        let (record, reading) = (&dataset.records[i], &run.reading_um);
        let at = |k: usize| reading[k.min(reading.len() - 1)];
        record.window.clone().map(|k| 0.5 * (at(k + 1) - at(k.saturating_sub(1))) / record.dt_s()).collect()
    };
    let mut column: Vec<Vec<f64>> = records.iter().zip(base).map(rate_of_reading).collect();
    absorbed.remove(&mut column);
    absorbed.remove(&mut column);
    let along = |a: &[Vec<f64>], b: &[Vec<f64>]| -> f64 { a.iter().zip(b).map(|(x, y)| dot(x, y)).sum() };
    let power = along(&column, &column);
    let fastest = records.iter().map(|&i| dataset.records[i].dt_s()).fold(f64::INFINITY, f64::min);
    if power > 0.0 {
        let skew_s = (along(&column, residual) / power).clamp(-SKEW_MAX * fastest, SKEW_MAX * fastest);
        for (out, values) in residual.iter_mut().zip(&column) {
            out.iter_mut().zip(values).for_each(|(o, v)| *o -= skew_s * v);
        }
    }
}

fn toss(count: usize, seed: u64) -> Vec<Vec<f64>> {
    let mut random = Pcg64Mcg::seed_from_u64(seed);
    (0..TOSSES).map(|_| (0..count).map(|_| if random.random::<bool>() { 1.0 } else { -1.0 }).collect()).collect()
}

fn directions(
    effect: &Arc<dyn Effect>,
    model: &Model,
    overview: &Overview,
    dataset: &Dataset,
    records: &[usize],
    base: &[ChainRun],
    one_sided: bool,
) -> Vec<Direction> {
    let starts = effect.starts(overview);
    let lines: Vec<f64> = starts.iter().flat_map(|s| effect.line_frequencies_hz(s)).collect();
    if !lines.is_empty() {
        return line_directions(&starts, &lines, dataset, records);
    }
    let column = |start: &Vec<f64>| -> Vec<Vec<f64>> {
        let mut with = model.clone();
        with.add(EffectInstance::new(effect.clone(), overview, start));
        records
            .iter()
            .enumerate()
            .map(|(r, &i)| {
                let record = &dataset.records[i];
                let reading = with.resume_with_added(&base[r], &effect.declaration().id, &record.drive());
                record.window.clone().map(|k| reading[k] - base[r].reading_um[k]).collect()
            })
            .collect()
    };
    if effect.starts_combine() {
        return vec![Direction { columns: starts.iter().map(column).collect(), starts, one_sided: false }];
    }
    starts.iter().map(|s| Direction { columns: vec![column(s)], starts: vec![s.clone()], one_sided }).collect()
}

/// A line has its own phase in every record: two columns for each of them.
fn line_directions(starts: &[Vec<f64>], lines: &[f64], dataset: &Dataset, records: &[usize]) -> Vec<Direction> {
    let mut out: Vec<Direction> = Vec::new();
    let mut seen: Vec<f64> = Vec::new();
    for (start, &frequency_hz) in starts.iter().zip(lines) {
        if seen.contains(&frequency_hz) {
            continue;
        }
        seen.push(frequency_hz);
        let mut columns = Vec::new();
        for at in 0..records.len() {
            for shift in [0.0, std::f64::consts::FRAC_PI_2] {
                columns.push(
                    records
                        .iter()
                        .enumerate()
                        .map(|(r, &i)| {
                            let record = &dataset.records[i];
                            let phase = |k: usize| std::f64::consts::TAU * frequency_hz * k as f64 * record.dt_s() + shift;
                            record.window.clone().map(|k| if r == at { phase(k).sin() } else { 0.0 }).collect()
                        })
                        .collect(),
                );
            }
        }
        out.push(Direction { starts: vec![start.clone()], columns, one_sided: false });
    }
    out
}

/// A direction after projection: products with the residual by block, and the inverse of its Gram matrix.
struct Projected {
    starts: Vec<Vec<f64>>,
    by_block: Vec<DVector<f64>>,
    /// The same with the power that the fit took out given back: what noise would do.
    noise_by_block: Vec<DVector<f64>>,
    inverse: DMatrix<f64>,
    columns: Vec<Vec<Vec<f64>>>,
    one_sided: bool,
}

impl Projected {
    fn statistic(&self, sums: &DVector<f64>) -> f64 {
        if self.one_sided && sums[0] <= 0.0 { 0.0 } else { sums.dot(&(&self.inverse * sums)) }
    }

    fn observed(&self) -> f64 {
        self.statistic(&self.by_block.iter().sum())
    }
}

fn score(
    effect: &Arc<dyn Effect>,
    id: String,
    directions: Vec<Direction>,
    absorbed: &Absorbed,
    residual: &[Vec<f64>],
    above_floor: f64,
    tosses: &[Vec<f64>],
) -> Option<Score> {
    let mut projected: Vec<Projected> = directions.into_iter().filter_map(|d| project(d, absorbed, residual)).collect();
    projected.sort_by(|a, b| b.observed().total_cmp(&a.observed()));
    let best = projected.first()?;
    let observed = best.observed();
    let null: Vec<f64> = tosses
        .iter()
        .map(|signs| {
            let tossed = |p: &Projected| {
                let mut sums = DVector::zeros(p.inverse.nrows());
                for (products, sign) in p.noise_by_block.iter().zip(signs.iter()) {
                    sums.axpy(*sign, products, 1.0);
                }
                p.statistic(&sums)
            };
            projected.iter().map(tossed).fold(0.0, f64::max)
        })
        .collect();
    let mut ordered = null.clone();
    ordered.sort_by(f64::total_cmp);
    let p_of = |statistic: f64| (1 + ordered.len() - ordered.partition_point(|v| *v < statistic)) as f64 / (ordered.len() + 1) as f64;
    let p_value = p_of(observed);
    let resampled_um2 = resampled(best);
    // A pattern counts among the patterns as the observation does.
    let null_p_values = null.iter().map(|v| p_of(*v)).collect();
    let sums: DVector<f64> = best.by_block.iter().sum();
    let weights = &best.inverse * &sums;
    let mut signature: Vec<Vec<f64>> = residual.iter().map(|r| vec![0.0; r.len()]).collect();
    for (w, column) in weights.iter().zip(&best.columns) {
        for (out, values) in signature.iter_mut().zip(column) {
            out.iter_mut().zip(values).for_each(|(o, v)| *o += w * v);
        }
    }
    let norm = signature.iter().map(|s| dot(s, s)).sum::<f64>().sqrt().max(f64::MIN_POSITIVE);
    let unit = signature.iter().map(|s| s.iter().map(|v| v / norm).collect()).collect();
    Some(Score {
        effect: effect.clone(),
        id,
        starts: projected.iter().flat_map(|p| p.starts.iter().take(if p.starts.len() > 1 { 1 } else { usize::MAX }).cloned()).collect(),
        explained_um2: observed,
        share: (observed / above_floor).clamp(0.0, 1.0),
        share_interval: share_interval(&resampled_um2, above_floor),
        stability: 0.0,
        resampled_um2,
        p_value,
        p_adjusted: p_value,
        null_p_values,
        signature,
        unit,
    })
}

fn project(direction: Direction, absorbed: &Absorbed, residual: &[Vec<f64>]) -> Option<Projected> {
    let mut columns = Vec::new();
    for mut column in direction.columns {
        let before: f64 = column.iter().map(|c| dot(c, c)).sum();
        if !before.is_finite() || before <= 0.0 {
            continue;
        }
        absorbed.remove(&mut column);
        absorbed.remove(&mut column);
        let after: f64 = column.iter().map(|c| dot(c, c)).sum();
        if after > 1e-8 * before {
            let scale = 1.0 / after.sqrt();
            column.iter_mut().flatten().for_each(|v| *v *= scale);
            columns.push(column);
        }
    }
    let m = columns.len();
    if m == 0 {
        return None;
    }
    let gram = DMatrix::from_fn(m, m, |i, j| {
        columns[i].iter().zip(&columns[j]).map(|(a, b)| dot(a, b)).sum::<f64>() + if i == j { 1e-6 } else { 0.0 }
    });
    let inverse = gram.cholesky()?.inverse();
    let (mut by_block, mut noise_by_block) = (Vec::new(), Vec::new());
    for (r, values) in residual.iter().enumerate() {
        let scatter_um = rms(values);
        for block in blocks(values.len()) {
            let products = DVector::from_fn(m, |i, _| dot(&columns[i][r][block.clone()], &values[block.clone()]));
            let signature = |i: usize| &columns[i][r][block.clone()];
            noise_by_block.push(DVector::from_fn(m, |i, _| {
                let leverage = absorbed.leverage(r, &block, &columns[i][r]);
                if leverage <= LEVERAGE_MAX {
                    products[i] / (1.0 - leverage).sqrt()
                } else {
                    (scatter_um * dot(signature(i), signature(i)).sqrt()).copysign(products[i])
                }
            }));
            by_block.push(products);
        }
    }
    Some(Projected { starts: direction.starts, by_block, noise_by_block, inverse, columns, one_sided: direction.one_sided })
}

/// What the direction explains when blocks are drawn again with replacement; the same draws for every candidate.
fn resampled(best: &Projected) -> Vec<f64> {
    let mut random = Pcg64Mcg::seed_from_u64(17);
    let count = best.by_block.len();
    (0..RESAMPLES)
        .map(|_| {
            let mut sums = DVector::zeros(best.inverse.nrows());
            for _ in 0..count {
                sums += &best.by_block[random.random_range(0..count)];
            }
            best.statistic(&sums)
        })
        .collect()
}

/// 90 % interval of the explained share over resamples.
fn share_interval(resampled_um2: &[f64], above_floor: f64) -> (f64, f64) {
    let mut shares: Vec<f64> = resampled_um2.iter().map(|um2| (um2 / above_floor).clamp(0.0, 1.0)).collect();
    shares.sort_by(f64::total_cmp);
    (shares[RESAMPLES / 20], shares[RESAMPLES - 1 - RESAMPLES / 20])
}

/// In how many of the resamples each candidate explains most.
fn find_stability(scores: &mut [Score]) {
    let mut wins = vec![0_usize; scores.len()];
    for draw in 0..RESAMPLES {
        let best = (0..scores.len()).max_by(|&a, &b| scores[a].resampled_um2[draw].total_cmp(&scores[b].resampled_um2[draw]));
        if let Some(best) = best {
            wins[best] += 1;
        }
    }
    for (score, wins) in scores.iter_mut().zip(wins) {
        score.stability = wins as f64 / RESAMPLES as f64;
    }
}

/// Step-down correction by the least p-value of the candidates that are left, after Westfall and Young.
fn control_false_discoveries(scores: &mut [Score]) {
    let mut order: Vec<usize> = (0..scores.len()).collect();
    order.sort_by(|&a, &b| scores[a].p_value.total_cmp(&scores[b].p_value));
    let mut least = vec![1.0_f64; scores.first().map_or(0, |s| s.null_p_values.len())];
    let mut adjusted = vec![1.0; scores.len()];
    for &i in order.iter().rev() {
        least.iter_mut().zip(&scores[i].null_p_values).for_each(|(l, p)| *l = l.min(*p));
        let as_small = least.iter().filter(|l| **l <= scores[i].p_value).count();
        adjusted[i] = (1 + as_small) as f64 / (least.len() + 1) as f64;
    }
    let mut running = 0.0_f64;
    for &i in &order {
        running = running.max(adjusted[i]);
        scores[i].p_adjusted = running;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Whatever the dependence: under no effect the least adjusted p-value is uniform.
    #[test]
    fn the_least_adjusted_p_value_is_small_as_often_as_it_should_be() {
        let mut random = Pcg64Mcg::seed_from_u64(5);
        let (candidates, patterns, repeats) = (6, 400, 300);
        let mut below = 0;
        for _ in 0..repeats {
            // Columns of one common and one own part: strongly dependent statistics.
            let mut draw = || {
                let common: f64 = random.random();
                (0..candidates).map(|i| if i % 2 == 0 { common } else { random.random() }).collect::<Vec<f64>>()
            };
            let observed = draw();
            let null: Vec<Vec<f64>> = (0..patterns).map(|_| draw()).collect();
            let p_of = |i: usize, statistic: f64| (1 + null.iter().filter(|n| n[i] >= statistic).count()) as f64 / (patterns + 1) as f64;
            let mut scores: Vec<Score> = (0..candidates)
                .map(|i| Score {
                    effect: hysteron_sim::effect::registry()[i].clone(),
                    id: i.to_string(),
                    starts: Vec::new(),
                    explained_um2: 0.0,
                    share: 0.0,
                    share_interval: (0.0, 0.0),
                    stability: 0.0,
                    resampled_um2: Vec::new(),
                    p_value: p_of(i, observed[i]),
                    p_adjusted: 1.0,
                    null_p_values: null.iter().map(|n| p_of(i, n[i])).collect(),
                    signature: Vec::new(),
                    unit: Vec::new(),
                })
                .collect();
            control_false_discoveries(&mut scores);
            below += usize::from(scores.iter().any(|s| s.p_adjusted <= 0.1));
        }
        // 30 of 300 expected, standard deviation 5.2.
        assert!((14..=46).contains(&below), "{below} of {repeats}");
    }
}
