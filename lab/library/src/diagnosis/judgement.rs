//! Models judged on records: errors, by how much one is better than another, and which records are fitted at
//! all.

use super::policy::Policy;
use crate::dataset::{Dataset, Record, Role};
use crate::error::{Error, Result};
use crate::identification::fit::{Fit, dot};
use crate::identification::linearisation::Rows;
use crate::identification::noise_floor::{NoiseFloor, noise_floor};
use hysteron_sim::chain::{Drive, Model};
use hysteron_sim::effect::Effect;
use nalgebra::DVector;
use std::sync::Arc;

/// Which records are fitted and which judge.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Split {
    /// Fitted records.
    pub identify: Vec<usize>,
    /// Held-out records.
    pub validate: Vec<usize>,
}

impl Split {
    /// The split that the roles of a data set make; where nothing may be fitted, what would judge is fitted,
    /// and nothing judges.
    #[must_use]
    pub fn of(dataset: &Dataset) -> Self {
        let (identify, validate) = (
            dataset.with_role(Role::Identify),
            dataset.with_role(Role::Validate),
        );
        if identify.is_empty() {
            Self {
                identify: validate,
                validate: Vec::new(),
            }
        } else {
            Self { identify, validate }
        }
    }

    /// All records that judge a model.
    #[must_use]
    pub fn both(&self) -> Vec<usize> {
        self.identify
            .iter()
            .chain(&self.validate)
            .copied()
            .collect()
    }
}

/// A model and what it leaves of the records that judge it.
#[derive(Clone, Debug)]
pub struct Judged {
    /// The fitted model.
    pub model: Model,
    /// Residual of every record of the data set, um; empty for records that do not judge.
    pub residuals: Vec<Vec<f64>>,
    /// RMS over the fitted records, um.
    pub identify_rms_um: f64,
    /// RMS over the held-out records, um; `None` without any.
    pub validate_rms_um: Option<f64>,
}

impl Judged {
    /// The error that speaks for the model: held out where there is one.
    #[must_use]
    pub fn error_um(&self) -> f64 {
        self.validate_rms_um.unwrap_or(self.identify_rms_um)
    }

    /// The floor with what the noise of the drive's column makes in the readings of this model, as
    /// [`NoiseFloor::beside`].
    #[must_use]
    pub fn floor_beside(
        &self,
        floor: &NoiseFloor,
        explained: f64,
        dataset: &Dataset,
    ) -> Option<NoiseFloor> {
        floor.beside(&self.model, &self.residuals, explained, dataset)
    }

    /// Fitted and held-out error are each below `times` the noise floor of their records; never where a
    /// record has no floor.
    #[must_use]
    pub fn within(&self, times: f64, floors_um: &[Option<f64>], split: &Split) -> bool {
        // The same sums whatever the order of the records.
        let sum = |mut of_records: Vec<f64>| -> f64 {
            of_records.sort_by(f64::total_cmp);
            of_records.iter().sum()
        };
        [&split.identify, &split.validate]
            .into_iter()
            .all(|records| {
                let squares_of_floor = |i: &usize| {
                    floors_um[*i]
                        .map(|floor_um| floor_um * floor_um * self.residuals[*i].len() as f64)
                };
                let floor: Option<Vec<f64>> = records.iter().map(squares_of_floor).collect();
                let left = sum(records
                    .iter()
                    .map(|i| dot(&self.residuals[*i], &self.residuals[*i]))
                    .collect());
                records.is_empty() || floor.is_some_and(|floor| left < times * times * sum(floor))
            })
    }
}

pub(crate) fn rms_of(residuals: &[Vec<f64>], records: &[usize]) -> Option<f64> {
    let mut by_size: Vec<(f64, usize)> = records
        .iter()
        .map(|&i| (dot(&residuals[i], &residuals[i]), residuals[i].len()))
        .collect();
    // The same sum whatever the order of the records.
    by_size.sort_by(|a, b| a.0.total_cmp(&b.0));
    let (sum, count) = by_size
        .iter()
        .fold((0.0, 0), |(s, n), (ds, dn)| (s + ds, n + dn));
    (count > 0).then(|| (sum / count as f64).sqrt())
}

/// Judges a fitted model on all samples.
#[must_use]
pub fn judge(model: Model, dataset: &Dataset, split: &Split) -> Judged {
    judge_rows(model, dataset, split, &Rows::all(dataset, &split.both()))
}

/// The floor of a data set beside a model as it is.
#[must_use]
pub fn noise_floor_beside(model: &Model, dataset: &Dataset) -> NoiseFloor {
    let floor = noise_floor(dataset);
    let judged = judge(model.clone(), dataset, &Split::of(dataset));
    judged
        .floor_beside(&floor, Policy::default().explained, dataset)
        .unwrap_or(floor)
}

/// Judges a fitted model on the samples that count.
#[must_use]
pub fn judge_rows(model: Model, dataset: &Dataset, split: &Split, rows: &Rows) -> Judged {
    let each = rows.residuals(&model, dataset);
    judged_by(
        model,
        dataset,
        split,
        rows.records.iter().map(|(i, _)| *i).zip(each),
    )
}

/// Judges what a fit came to on the samples that count; of those that were fitted it says itself what it
/// leaves.
#[must_use]
pub fn judge_fit(fit: Fit, fitted: &Rows, dataset: &Dataset, split: &Split, rows: &Rows) -> Judged {
    let said: Vec<(usize, DVector<f64>)> = fitted
        .records
        .iter()
        .zip(fit.residuals)
        .filter(|(of_record, _)| rows.records.contains(of_record))
        .map(|((i, _), residual)| (*i, residual))
        .collect();
    let others = rows.without(fitted);
    let each = others.residuals(&fit.model, dataset);
    judged_by(
        fit.model,
        dataset,
        split,
        others.records.iter().map(|(i, _)| *i).zip(each).chain(said),
    )
}

fn judged_by(
    model: Model,
    dataset: &Dataset,
    split: &Split,
    each: impl Iterator<Item = (usize, DVector<f64>)>,
) -> Judged {
    let mut residuals = vec![Vec::new(); dataset.records.len()];
    each.for_each(|(i, residual)| residuals[i] = residual.as_slice().to_vec());
    let identify_rms_um = rms_of(&residuals, &split.identify).unwrap_or(0.0);
    let validate_rms_um = rms_of(&residuals, &split.validate);
    Judged {
        model,
        residuals,
        identify_rms_um,
        validate_rms_um,
    }
}

/// The effect behind which a model first gives something that is no number under a drive, and the sample,
/// counted from 0.
#[must_use]
pub fn first_not_finite(model: &Model, drive: &Drive) -> Option<(String, usize)> {
    let first_bad = |model: &Model| model.simulate(drive).iter().position(|y| !y.is_finite());
    let sample = first_bad(model)?;
    // Effects are taken away from the end of the chain: the last one whose absence makes it finite is behind
    // it.
    let mut shorter = model.clone();
    let mut effect = String::new();
    while let Some(last) = shorter.effects.pop() {
        effect = last.id;
        if shorter.effects.is_empty() || first_bad(&shorter).is_none() {
            break;
        }
    }
    Some((effect, sample))
}

/// Every record has the signals, beside drive and force, that effects of the user's own take part of.
///
/// # Errors
/// The record that lacks one, and which.
pub fn require_signals<'e>(
    effects: impl IntoIterator<Item = &'e Arc<dyn Effect>>,
    dataset: &Dataset,
) -> Result<()> {
    let declarations = effects.into_iter().map(|e| e.declaration());
    for (effect, name) in declarations.flat_map(|d| {
        d.auxiliary
            .into_iter()
            .map(move |name| (d.id.clone(), name))
    }) {
        let lacks = |record: &&Record| record.auxiliary.iter().all(|signal| signal.name != name);
        if let Some(record) = dataset.records.iter().find(lacks) {
            return Err(Error::new(
                &record.source,
                format!(
                    "record {} has no signal {name}, which {} takes part of; expected --auxiliary {name}=COLUMN, or [record.auxiliary] {name} = \
                     \"COLUMN\" in dataset.toml",
                    record.name, effect
                ),
            ));
        }
    }
    Ok(())
}

/// Fails on the first thing that is no number in what a model reads, with the effect behind which it appears.
///
/// # Errors
/// [`Error::NotFinite`].
pub fn require_finite(model: &Model, dataset: &Dataset, records: &[usize]) -> Result<()> {
    require_signals(
        model.effects.iter().map(|instance| &instance.effect),
        dataset,
    )?;
    for record in records.iter().map(|i| &dataset.records[*i]) {
        if let Some((effect, sample)) = first_not_finite(model, &record.drive()) {
            return Err(Error::NotFinite {
                effect,
                record: record.name.clone(),
                sample: sample + 1,
            });
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::identification::fit::{Effort, fit_rows};
    use crate::model_file::effects_named;
    use hysteron_sim::chain::{EffectInstance, InitialState};

    /// One fitted record, one that is held out, in states that nobody knows; once as many samples are judged
    /// as were fitted, once more.
    #[test]
    fn what_a_fit_says_that_it_leaves_is_what_the_model_leaves() {
        let drive_v: Vec<f64> = (0..3000)
            .map(|k| 50.0 - 50.0 * (0.004 * f64::from(k)).cos())
            .collect();
        let records =
            [("a", 1.0, Role::Identify), ("b", 1.1, Role::Validate)].map(|(name, bend, role)| {
                let read_um: Vec<f64> = (0..3000_usize)
                    .map(|k| {
                        0.1 * drive_v[k.saturating_sub(1)]
                            + 1e-4 * bend * drive_v[k.saturating_sub(3)]
                    })
                    .collect();
                let mut record =
                    Record::new(name, 1000.0, drive_v.clone(), read_um).with_role(role);
                record.initial_state = InitialState::Unknown;
                record
            });
        let dataset = Dataset::new("d", 0.0, 100.0, records.to_vec()).unwrap();
        let split = Split::of(&dataset);
        let mut model = Model::new(0.0, 100.0);
        for effect in effects_named("gain,creep,vibration").unwrap() {
            model.add(EffectInstance::new(effect, &dataset.overview(), &[]));
        }
        let fitted = Rows::strided(&dataset, &split.identify, 3);
        for stride in [3, 2] {
            let rows = Rows::strided(&dataset, &split.both(), stride);
            let by_fit = judge_fit(
                fit_rows(&model, &dataset, &fitted, Effort::default()),
                &fitted,
                &dataset,
                &split,
                &rows,
            );
            let by_itself = judge_rows(by_fit.model.clone(), &dataset, &split, &rows);
            assert_eq!(by_fit.validate_rms_um, by_itself.validate_rms_um);
            for (a, b) in by_fit
                .residuals
                .iter()
                .flatten()
                .zip(by_itself.residuals.iter().flatten())
            {
                assert!((a - b).abs() < 1e-11, "{a} {b}");
            }
            assert_eq!(
                by_fit.residuals.iter().map(Vec::len).collect::<Vec<_>>(),
                by_itself.residuals.iter().map(Vec::len).collect::<Vec<_>>()
            );
        }
    }
}
