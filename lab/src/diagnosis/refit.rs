//! Finalists are fitted with the whole model and judged on held-out records.

use super::screening::Score;
use crate::dataset::Dataset;
use crate::fit::{Effort, blocks, fit, residual, with_effect};
use hysteron_sim::chain::{EffectInstance, Model};
use hysteron_sim::effect::Overview;
use rayon::prelude::*;

/// Residuals of a model on all records that judge it.
#[derive(Clone, Debug)]
pub struct Judged {
    /// The fitted model.
    pub model: Model,
    /// Residual of every record of the data set, empty for noise records.
    pub residuals: Vec<Vec<f64>>,
    /// RMS over the fitted records, um.
    pub identify_rms_um: f64,
    /// RMS over the held-out records, um; `None` without any.
    pub validate_rms_um: Option<f64>,
}

/// Which records are fitted and which judge.
#[derive(Clone, Debug)]
pub struct Split {
    /// Fitted records.
    pub identify: Vec<usize>,
    /// Held-out records.
    pub validate: Vec<usize>,
}

impl Split {
    /// The split that the roles of a data set make; where nothing may be fitted, what would judge is fitted, and nothing judges.
    #[must_use]
    pub fn of(dataset: &Dataset) -> Self {
        use crate::dataset::Role;
        let (identify, validate) = (dataset.with_role(Role::Identify), dataset.with_role(Role::Validate));
        if identify.is_empty() { Self { identify: validate, validate: Vec::new() } } else { Self { identify, validate } }
    }
}

fn rms_of(residuals: &[Vec<f64>], records: &[usize]) -> Option<f64> {
    let (sum, count) = records.iter().map(|&i| &residuals[i]).fold((0.0, 0usize), |(s, n), r| (s + crate::fit::dot(r, r), n + r.len()));
    (count > 0).then(|| (sum / count as f64).sqrt())
}

/// Judges a fitted model.
#[must_use]
pub fn judge(model: Model, dataset: &Dataset, split: &Split) -> Judged {
    let residuals: Vec<Vec<f64>> =
        (0..dataset.records.len())
            .into_par_iter()
            .map(|i| {
                if split.identify.contains(&i) || split.validate.contains(&i) { residual(&model, &dataset.records[i]) } else { Vec::new() }
            })
            .collect();
    let identify_rms_um = rms_of(&residuals, &split.identify).unwrap_or(0.0);
    let validate_rms_um = rms_of(&residuals, &split.validate);
    Judged { model, residuals, identify_rms_um, validate_rms_um }
}

/// Improvement of one judged model over another.
#[derive(Clone, Copy, Debug)]
pub struct Improvement {
    /// Drop of the mean square on held-out records in standard errors of it, by blocks.
    pub validate_z: f64,
    /// Drop of the mean square over all records in standard errors of it, by blocks.
    pub total_z: f64,
    /// Relative drop of the RMS over held-out records.
    pub validate_relative: f64,
    /// Largest relative drop of the RMS in any record.
    pub record_relative: f64,
}

/// How much better `after` is than `before`.
#[must_use]
pub fn improvement(before: &Judged, after: &Judged, split: &Split) -> Improvement {
    let z = |records: &mut dyn Iterator<Item = usize>| -> f64 {
        let mut sum = 0.0;
        let mut variance = 0.0;
        for i in records {
            let (a, b) = (&before.residuals[i], &after.residuals[i]);
            let drops: Vec<f64> = blocks(a.len())
                .into_iter()
                .map(|r| crate::fit::dot(&a[r.clone()], &a[r.clone()]) - crate::fit::dot(&b[r.clone()], &b[r]))
                .collect();
            let mean = drops.iter().sum::<f64>() / drops.len().max(1) as f64;
            sum += drops.iter().sum::<f64>();
            variance += drops.iter().map(|d| (d - mean) * (d - mean)).sum::<f64>() * drops.len() as f64
                / drops.len().saturating_sub(1).max(1) as f64;
        }
        if variance > 0.0 { sum / variance.sqrt() } else { 0.0 }
    };
    let relative = |i: usize| {
        let (a, b) = (crate::fit::rms(&before.residuals[i]), crate::fit::rms(&after.residuals[i]));
        if a > 0.0 { 1.0 - b / a } else { 0.0 }
    };
    let judging = || split.identify.iter().chain(&split.validate).copied();
    Improvement {
        validate_z: z(&mut split.validate.iter().copied()),
        total_z: z(&mut judging()),
        validate_relative: match (before.validate_rms_um, after.validate_rms_um) {
            (Some(a), Some(b)) if a > 0.0 => 1.0 - b / a,
            _ => 0.0,
        },
        record_relative: judging().map(relative).fold(0.0, f64::max),
    }
}

/// A finalist after its refit.
#[derive(Clone)]
pub struct Finalist {
    /// The effect.
    pub id: String,
    /// Its place in the screening.
    pub score: usize,
    /// The fitted model and its residuals.
    pub judged: Judged,
    /// Against the model without it.
    pub improvement: Improvement,
}

/// How a candidate is tried.
#[derive(Clone, Copy, Debug)]
pub struct Trial {
    effort: Effort,
    starts: usize,
    /// Only the candidate's own values are fitted; all others are held.
    alone: bool,
}

impl Trial {
    /// The candidate alone, on a model whose values are knowledge.
    pub const ALONE: Self = Self { effort: Effort { iterations: 15, tolerance: 0.5, relative: 0.002 }, starts: 3, alone: true };

    /// Far enough to be ranked.
    pub const RANKING: Self = Self { effort: Effort { iterations: 10, tolerance: 0.3, relative: 0.0005 }, starts: 2, alone: false };

    /// Far enough to see whether it can compete.
    pub const BRIEF: Self = Self { effort: Effort { iterations: 4, tolerance: 0.5, relative: 0.02 }, starts: 1, alone: false };

    /// As far as it promises: a candidate that explains less than a third of what the strongest does is only tried briefly.
    #[must_use]
    pub fn for_promise(explained: f64, strongest: f64) -> Self {
        if explained > 0.3 * strongest { Self::RANKING } else { Self::BRIEF }
    }
}

/// Fits the model with one more effect from its best starts and keeps the better result.
#[must_use]
pub fn refit(
    before: &Judged,
    score: &Score,
    at: usize,
    overview: &Overview,
    dataset: &Dataset,
    split: &Split,
    floor_um: Option<f64>,
    trial: Trial,
) -> Finalist {
    let mut base = before.model.clone();
    if trial.alone {
        base.effects.iter_mut().flat_map(|e| &mut e.parameters).for_each(|p| p.parameter.fixed = true);
    }
    let mut best: Option<(f64, Model)> = None;
    for start in score.starts.iter().take(trial.starts) {
        let begin = with_effect(&base, EffectInstance::new(score.effect.clone(), overview, start));
        let result = fit(&begin, dataset, &split.identify, trial.effort);
        if best.as_ref().is_none_or(|(rms, _)| result.rms_um < *rms) {
            best = Some((result.rms_um, result.model));
        }
        let enough = floor_um.is_some_and(|f| best.as_ref().is_some_and(|(rms, _)| *rms < 1.05 * f));
        if enough || score.effect.starts_combine() {
            break;
        }
    }
    let mut model = best.map_or_else(|| before.model.clone(), |(_, model)| model);
    if trial.alone
        && let Some(found) = model.effect(&score.id).cloned()
    {
        // What was held stays as free as it was.
        model = with_effect(&before.model, found);
    }
    let judged = judge(model, dataset, split);
    let improvement = improvement(before, &judged, split);
    Finalist { id: score.id.clone(), score: at, judged, improvement }
}
