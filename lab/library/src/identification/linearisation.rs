//! Residual of a model on records and its derivatives by every free value.
//!
//! Parameters live in coordinates in which a unit matters (`ParameterValue::coordinate`); positive ones in
//! their logarithm. A derivative is a walk of the chain with one coordinate moved, beside the chain itself
//! ([`hysteron_sim::variations`]). The coefficients of the hysteresis, most of the parameters, enter
//! linearly: one walk gives what all of them add.

use super::nuisance_terms::{
    self, OwnBases, OwnBasis, OwnMotions, Places, Samples, amounts, project_out,
    project_out_by_rows, project_out_of,
};
use super::work::Work;
use crate::dataset::{Dataset, Record};
use crate::parallel;
use hysteron_sim::chain::Model;
use hysteron_sim::variations::{Chunk, Manner, Variation, coefficients, walk};
use nalgebra::{DMatrix, DVector};
use std::sync::Arc;

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

/// The records that are looked at, each with the samples that count.
#[derive(Clone, Debug)]
pub struct Rows {
    /// Index of the record, and its samples; by the names of the records, so that their order in the data set
    /// does not matter.
    pub records: Vec<(usize, Samples)>,
    /// What each record has of its own beside the last models.
    bases: Vec<OwnBases>,
    /// Counts what is simulated for them.
    pub work: Work,
}

impl Rows {
    /// All samples in the windows of these records whose readings say something.
    #[must_use]
    pub fn all(dataset: &Dataset, records: &[usize]) -> Self {
        Self::thinned(dataset, records, usize::MAX)
    }

    /// About `most` samples of these records: one out of every so many, at an irregular distance, so that no
    /// line or drive keeps step with them.
    #[must_use]
    pub fn thinned(dataset: &Dataset, records: &[usize], most: usize) -> Self {
        let total: usize = records
            .iter()
            .map(|i| dataset.records[*i].window.len())
            .sum();
        Self::strided(dataset, records, total.div_ceil(most.max(1)).max(1))
    }

    /// One sample out of every `stride`, at an irregular distance.
    #[must_use]
    pub fn strided(dataset: &Dataset, records: &[usize], stride: usize) -> Self {
        let mut by_name: Vec<usize> = records.to_vec();
        by_name.sort_by(|a, b| dataset.records[*a].name.cmp(&dataset.records[*b].name));
        let samples = |i: usize| {
            let record = &dataset.records[i];
            let window = record.window.clone();
            if stride == 1 {
                return Samples::counted(record);
            }
            // A multiplicative sequence is as irregular as is needed here, and the same every time.
            let irregular =
                |block: usize| (block as u64 + 1).wrapping_mul(0x9E37_79B9_7F4A_7C15) >> 33;
            let block = |(b, start): (usize, usize)| {
                let length = stride.min(window.end - start);
                start + irregular(b) as usize % length
            };
            Samples::Some(
                window
                    .clone()
                    .step_by(stride)
                    .enumerate()
                    .map(block)
                    .filter(|k| record.counts(*k))
                    .collect(),
            )
        };
        Self {
            bases: by_name.iter().map(|_| OwnBases::default()).collect(),
            records: by_name.into_iter().map(|i| (i, samples(i))).collect(),
            work: Work::default(),
        }
    }

    /// These rows, with what is simulated for them counted by `work`.
    #[must_use]
    pub fn counted_by(self, work: Work) -> Self {
        Self { work, ..self }
    }

    /// What is simulated where a model goes along all records.
    pub fn count_simulation(&self, model: &Model, dataset: &Dataset) {
        let records = self.records.iter().map(|(i, _)| &dataset.records[*i]);
        self.work.simulated(model, records);
    }

    /// Those records of which others do not have the same samples.
    #[must_use]
    pub fn without(&self, others: &Self) -> Self {
        let kept = self
            .records
            .iter()
            .zip(&self.bases)
            .filter(|(of_record, _)| !others.records.contains(of_record));
        let (records, bases) = kept
            .map(|(of_record, bases)| (of_record.clone(), bases.clone()))
            .unzip();
        let work = self.work.clone();
        Self {
            records,
            bases,
            work,
        }
    }

    /// Of each record what a model leaves of it, free of what it has of its own.
    #[must_use]
    pub fn residuals(&self, model: &Model, dataset: &Dataset) -> Vec<DVector<f64>> {
        let model = &*model.before_rounding();
        self.count_simulation(model, dataset);
        parallel::map_indices(self.records.len(), |r| {
            let (i, samples) = &self.records[r];
            let record = &dataset.records[*i];
            let mut out = self
                .work
                .counting_forces(|| raw_residual(model, record, samples));
            project_out_of(
                &self.bases[r]
                    .of(OwnMotions::of(model, record), record, samples)
                    .orthonormal,
                &mut out,
            );
            out
        })
    }

    /// Samples in all.
    #[must_use]
    pub fn count(&self) -> usize {
        self.records
            .iter()
            .map(|(_, samples)| samples.count())
            .sum()
    }
}

/// Residual of a record and its derivatives, free of what the record has of its own.
#[derive(Clone, Debug)]
pub struct Linearised {
    /// Measured less modelled.
    pub residual: DVector<f64>,
    /// Derivative of the modelled reading by each coordinate, a column each; shared with whoever keeps it for
    /// later steps.
    pub jacobian: Arc<DMatrix<f64>>,
    /// What the record has of its own.
    pub own: Arc<OwnBasis>,
}

/// Relative step of the numerical derivatives, in coordinates.
const DERIVATIVE_STEP: f64 = 1e-3;

/// The coefficients of the hysteresis: most of a model's parameters, and they enter linearly.
#[derive(Clone, Debug)]
pub struct LinearCoefficients(Vec<(String, usize)>);

impl LinearCoefficients {
    /// Those of a model.
    #[must_use]
    pub fn of(model: &Model) -> Self {
        Self(coefficients(model))
    }

    /// The position of a parameter among them, if it is one.
    #[must_use]
    pub fn lane(&self, model: &Model, index: ParameterIndex) -> Option<usize> {
        let id = &model.effects[index.effect].id;
        self.0
            .iter()
            .position(|(effect, parameter)| effect == id && *parameter == index.parameter)
    }
}

/// Measured less modelled at the samples that count, with what the record has of its own still in it.
#[must_use]
pub fn raw_residual(model: &Model, record: &Record, samples: &Samples) -> DVector<f64> {
    let reading = model.simulate(&record.drive());
    let mut out = measured(record, samples);
    out -= samples.of(&reading);
    out
}

/// Measured less modelled at the samples that count, free of what the record has of its own.
#[must_use]
pub fn residual_at(model: &Model, record: &Record, samples: &Samples) -> DVector<f64> {
    residual_beside(model, record, samples, None)
}

/// The same near a model that was linearised: the record's nuisance terms are built from those there as far
/// as they serve.
#[must_use]
pub fn residual_near(
    model: &Model,
    record: &Record,
    samples: &Samples,
    near: &Linearised,
) -> DVector<f64> {
    residual_beside(model, record, samples, Some(&near.own))
}

fn residual_beside(
    model: &Model,
    record: &Record,
    samples: &Samples,
    known: Option<&Arc<OwnBasis>>,
) -> DVector<f64> {
    let model = &*model.before_rounding();
    let mut out = raw_residual(model, record, samples);
    let motions = OwnMotions::of(model, record);
    match known.filter(|known| known.motions == motions) {
        Some(known) => project_out_of(&known.orthonormal, &mut out),
        None => project_out_of(
            &OwnBasis::of(motions, record, samples, known.map(|known| &**known)).orthonormal,
            &mut out,
        ),
    }
    out
}

/// What a reading of the whole record leaves inside its window, free of what the record has of its own as far
/// as the samples that count show that.
#[must_use]
pub fn left_in_window(model: &Model, record: &Record, reading_um: &[f64]) -> Vec<f64> {
    let every = Samples::Every(record.window.clone());
    let mut left = DVector::from_iterator(
        every.count(),
        every
            .iter()
            .map(|k| record.displacement_um[k] - reading_um[k]),
    );
    if record.left_out_in_window().next().is_none() {
        project_out_of(
            &OwnBasis::of(OwnMotions::of(model, record), record, &every, None).orthonormal,
            &mut left,
        );
    } else {
        let counted: Vec<usize> = record.counted().map(|k| k - record.window.start).collect();
        project_out_by_rows(
            &nuisance_terms::columns(model, record, &every),
            &counted,
            &mut left,
        );
    }
    left.as_slice().to_vec()
}

/// Puts a value where the readings of a record's window say nothing: zero for spectra, which need even steps,
/// no number for a gap.
pub fn fill_left_out(record: &Record, in_window: &mut [f64], value: f64) {
    for range in record.left_out_in_window() {
        in_window[range.start - record.window.start..range.end - record.window.start].fill(value);
    }
}

/// Of values inside a record's window those at samples that count.
#[must_use]
pub fn counted_of(record: &Record, in_window: &[f64]) -> Vec<f64> {
    record
        .counted()
        .map(|k| in_window[k - record.window.start])
        .collect()
}

/// A model with one coordinate moved, and how far it went.
fn moved(model: &Model, index: ParameterIndex) -> (Variation, f64) {
    let mut out = model.clone();
    let value = &mut out.effects[index.effect].parameters[index.parameter];
    let before = value.coordinate();
    value.set_coordinate(before + DERIVATIVE_STEP);
    let mut step = value.coordinate() - before;
    if step.abs() < 0.5 * DERIVATIVE_STEP {
        value.set_coordinate(before - DERIVATIVE_STEP);
        step = value.coordinate() - before;
    }
    let differs = out.effects[index.effect].id.clone();
    (
        Variation {
            model: out,
            differs,
        },
        step,
    )
}

/// Linearises the model over records in the coordinates of `free`.
#[must_use]
pub fn linearise(
    model: &Model,
    dataset: &Dataset,
    rows: &Rows,
    free: &[ParameterIndex],
) -> Vec<Linearised> {
    linearise_reusing(model, dataset, rows, free, None)
}

/// As [`linearise`], but takes the derivatives by plain coefficients from an earlier linearisation.
///
/// They depend on the other parameters alone and change little with them; the step stays right because every
/// step is judged by the true sum of squares.
#[must_use]
pub fn linearise_reusing(
    model: &Model,
    dataset: &Dataset,
    rows: &Rows,
    free: &[ParameterIndex],
    earlier: Option<&[Linearised]>,
) -> Vec<Linearised> {
    let model = &*model.before_rounding();
    let linear = LinearCoefficients::of(model);
    let lanes: Vec<Option<usize>> = free
        .iter()
        .map(|index| linear.lane(model, *index))
        .collect();
    let walked: Vec<usize> = (0..free.len()).filter(|p| lanes[*p].is_none()).collect();
    let with_coefficients = earlier.is_none() && lanes.iter().any(Option::is_some);
    // Every part of a record walks the chain once more, so there are no more of them than there are cores.
    let groups: Vec<&[usize]> = in_groups(&walked, parallel::parts_of_each(rows.records.len()));
    let tasks: Vec<(usize, usize)> = (0..rows.records.len())
        .flat_map(|r| (0..groups.len()).map(move |g| (r, g)))
        .collect();
    let parts: Vec<Part> = parallel::map(&tasks, |(r, g)| {
        let (index, samples) = &rows.records[*r];
        walk_part(
            model,
            &dataset.records[*index],
            samples,
            free,
            groups[*g],
            (*g == 0 && with_coefficients).then_some(&lanes),
            &rows.work,
        )
    });
    let assembling = Assembling {
        model,
        free,
        lanes: &lanes,
        groups: &groups,
    };
    parallel::map_indices(rows.records.len(), |r| {
        let (index, samples) = &rows.records[r];
        let record = &dataset.records[*index];
        let own = rows.bases[r].of(OwnMotions::of(model, record), record, samples);
        let of_record = &parts[r * groups.len()..(r + 1) * groups.len()];
        assembling.linearised(
            record,
            samples,
            of_record,
            own,
            earlier.map(|earlier| &earlier[r]),
        )
    })
}

/// What the walks along one record are put together by.
struct Assembling<'a> {
    model: &'a Model,
    free: &'a [ParameterIndex],
    /// The position of each free value among the coefficients, if it is one.
    lanes: &'a [Option<usize>],
    /// Places of the others, by walk.
    groups: &'a [&'a [usize]],
}

impl Assembling<'_> {
    fn linearised(
        &self,
        record: &Record,
        samples: &Samples,
        walks: &[Part],
        own: Arc<OwnBasis>,
        earlier: Option<&Linearised>,
    ) -> Linearised {
        let first = &walks[0];
        let moves = |moved: &Moved| {
            (moved.step != 0.0)
                .then(|| OwnMotions::of(&moved.variation.model, record))
                .filter(|m| *m != own.motions)
        };
        let any_moves = walks
            .iter()
            .flat_map(|walk| &walk.moved)
            .any(|moved| moves(moved).is_some());
        let held =
            any_moves.then(|| amounts(&own.motions.columns(record, samples), &first.residual));
        let mut jacobian = DMatrix::zeros(samples.count(), self.free.len());
        for (p, lane) in self.lanes.iter().enumerate() {
            let Some(lane) = lane else { continue };
            match earlier {
                Some(known) => jacobian.set_column(p, &known.jacobian.column(p)),
                None => {
                    let index = self.free[p];
                    let scale = self.model.effects[index.effect].parameters[index.parameter]
                        .value_per_coordinate();
                    jacobian.set_column(p, &(first.by_coefficient.column(*lane) * scale));
                }
            }
        }
        for (group, walk) in self.groups.iter().zip(walks) {
            for (p, moved) in group.iter().zip(&walk.moved) {
                let mut column = &moved.residual - &first.residual;
                // The residual falls by what the reading rises.
                column *= if moved.step == 0.0 {
                    0.0
                } else {
                    -1.0 / moved.step
                };
                if let (Some(others), Some(held)) = (moves(moved), &held)
                    && let Some(change) = own.motions.change_to(&others, held, record, samples)
                {
                    column += change / moved.step;
                }
                jacobian.set_column(*p, &column);
            }
        }
        let mut residual = first.residual.clone();
        project_out_of(&own.orthonormal, &mut residual);
        project_out(&own.orthonormal, &mut jacobian);
        Linearised {
            residual,
            jacobian: Arc::new(jacobian),
            own,
        }
    }
}

/// As even parts of a list as can be, at least one.
fn in_groups(list: &[usize], most: usize) -> Vec<&[usize]> {
    if list.is_empty() {
        vec![list]
    } else {
        list.chunks(list.len().div_ceil(most.max(1))).collect()
    }
}

/// What one walk along a record brings to its linearisation.
struct Part {
    /// Measured less modelled at the samples.
    residual: DVector<f64>,
    /// What each coefficient adds there; empty where none was asked for.
    by_coefficient: DMatrix<f64>,
    moved: Vec<Moved>,
}

/// The residual with one coordinate moved.
struct Moved {
    residual: DVector<f64>,
    step: f64,
    variation: Variation,
}

/// Residual at the samples, with some coordinates moved too, and what each coefficient adds, if asked for.
fn walk_part(
    model: &Model,
    record: &Record,
    samples: &Samples,
    free: &[ParameterIndex],
    group: &[usize],
    lanes: Option<&Vec<Option<usize>>>,
    work: &Work,
) -> Part {
    let (variations, steps): (Vec<Variation>, Vec<f64>) =
        group.iter().map(|p| moved(model, free[*p])).unzip();
    let count = lanes
        .and_then(|lanes| lanes.iter().flatten().max())
        .map_or(0, |lane| lane + 1);
    work.simulated(model, [record]);
    work.varied(&variations, record);
    work.by_coefficient(model, record, count);
    let nothing = || DVector::zeros(samples.count());
    let (mut reading, mut of_variations): (_, Vec<_>) =
        (nothing(), variations.iter().map(|_| nothing()).collect());
    let mut by_coefficient = DMatrix::zeros(if count > 0 { samples.count() } else { 0 }, count);
    work.counting_forces(|| {
        walk(
            model,
            &record.drive(),
            &variations,
            Manner {
                with_coefficients: count > 0,
                ..Manner::default()
            },
            &mut |chunk| {
                let (before, within) =
                    samples.within(chunk.from, chunk.from + chunk.reading_um.len());
                within.take(chunk.reading_um, &mut reading.as_mut_slice()[before..]);
                take_each(&mut of_variations, before, &within, chunk);
                if count > 0 {
                    let width = chunk.by_coefficient.len() / chunk.reading_um.len().max(1);
                    within.take_rows(chunk.by_coefficient, width, before, &mut by_coefficient);
                }
            },
        )
    });
    let measured = measured(record, samples);
    let moved = of_variations.into_iter().zip(steps).zip(variations);
    let moved = moved
        .map(|((reading, step), variation)| Moved {
            residual: &measured - reading,
            step,
            variation,
        })
        .collect();
    Part {
        residual: measured - reading,
        by_coefficient,
        moved,
    }
}

/// Takes what each variation reads in a chunk at the samples that count: so many stand before them.
fn take_each(out: &mut [DVector<f64>], before: usize, within: &Places, chunk: &Chunk) {
    out.iter_mut()
        .zip(chunk.variations_um)
        .for_each(|(reading, values)| within.take(values, &mut reading.as_mut_slice()[before..]));
}

/// The measured displacement at the samples that count.
#[must_use]
pub fn measured(record: &Record, samples: &Samples) -> DVector<f64> {
    samples.of(&record.displacement_um)
}

/// What each variation would read at the samples that count, all in the intervals of the model: the shape of
/// what an amplifier adds is the same there.
#[must_use]
pub fn walk_variations(
    model: &Model,
    record: &Record,
    samples: &Samples,
    variations: &[Variation],
) -> Vec<DVector<f64>> {
    let manner = Manner {
        as_coarse_as_the_model: true,
        ..Manner::default()
    };
    let mut out: Vec<DVector<f64>> = variations
        .iter()
        .map(|_| DVector::zeros(samples.count()))
        .collect();
    walk(model, &record.drive(), variations, manner, &mut |chunk| {
        let (before, within) = samples.within(chunk.from, chunk.from + chunk.reading_um.len());
        take_each(&mut out, before, &within, chunk);
    });
    out
}

/// Normal equations of linearised records: `J'J`, `J'r`, `r'r`, samples.
#[must_use]
pub fn normal_equations(parts: &[Linearised]) -> (DMatrix<f64>, DVector<f64>, f64, usize) {
    let (g, cost, samples) = along_residual(parts);
    (squares_of_derivatives(parts), g, cost, samples)
}

/// `J'J` of linearised records.
#[must_use]
pub fn squares_of_derivatives(parts: &[Linearised]) -> DMatrix<f64> {
    let each = parallel::map(parts, |part| {
        nuisance_terms::transposed_times(&part.jacobian, &part.jacobian)
    });
    each.into_iter()
        .reduce(|sum, of_record| sum + of_record)
        .unwrap_or_default()
}

/// `J'r`, `r'r` and the samples of linearised records.
#[must_use]
pub fn along_residual(parts: &[Linearised]) -> (DVector<f64>, f64, usize) {
    let each = parallel::map(parts, |part| part.jacobian.tr_mul(&part.residual));
    let g = each
        .into_iter()
        .reduce(|sum, of_record| sum + of_record)
        .unwrap_or_default();
    let (cost, samples) = parts.iter().fold((0.0, 0), |(c, n), part| {
        (c + part.residual.norm_squared(), n + part.residual.len())
    });
    (g, cost, samples)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::identification::fit::{counted_residual, residual};
    use crate::model_file::effects_named;
    use hysteron_sim::chain::EffectInstance;

    /// A record of a gain with creep in a state that nobody knows, whose readings end at 6 um: what it leaves
    /// where they say something is the same whichever way it is taken, and beyond it is the distance to what
    /// the sensor cannot read.
    #[test]
    fn what_is_left_beyond_the_range_is_continued_from_where_readings_count() {
        let drive_v: Vec<f64> = (0..4000)
            .map(|k| 50.0 - 50.0 * (0.004 * f64::from(k)).cos())
            .collect();
        let full_um: Vec<f64> = (0..4000)
            .map(|k| 0.3 + 0.1 * drive_v[(k as usize).saturating_sub(1)])
            .collect();
        let read_um = full_um.iter().map(|y| y.min(6.0)).collect();
        let dataset = Dataset::new(
            "d",
            0.0,
            100.0,
            vec![Record::new("r", 1000.0, drive_v, read_um)],
        )
        .unwrap();
        let record = &dataset.records[0];
        assert!(
            record.left_out.len() == 3 && record.counted().count() < 3000,
            "{:?}",
            record.left_out
        );
        let mut model = Model::new(0.0, 100.0);
        for (effect, values) in effects_named("gain,creep")
            .unwrap()
            .into_iter()
            .zip([vec![0.1], Vec::new()])
        {
            model.add(EffectInstance::new(effect, &dataset.overview(), &values));
        }
        let in_window = residual(&model, record);
        let counted = counted_residual(&model, record);
        let apart = counted_of(record, &in_window)
            .iter()
            .zip(&counted)
            .map(|(a, b)| (a - b).abs())
            .fold(0.0, f64::max);
        assert!(apart < 1e-9, "{apart}");
        model.effects.retain(|e| e.id == "gain");
        let in_window = residual(&model, record);
        for (k, left) in in_window.iter().enumerate().skip(1) {
            assert!(
                (left - (record.displacement_um[k] - full_um[k])).abs() < 1e-9,
                "{k}: {left}"
            );
        }
        let mut gaps = in_window;
        fill_left_out(record, &mut gaps, f64::NAN);
        assert!(
            gaps.iter()
                .enumerate()
                .all(|(k, left)| left.is_finite() == record.counts(k))
        );
    }
}
