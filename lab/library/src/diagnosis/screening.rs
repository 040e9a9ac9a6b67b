//! Scores every candidate on the residual of a model without refitting it.
//!
//! # How it works
//! A candidate's *signature* is what the model's reading changes by when the effect enters at one of its
//! start values, and the free motions that it allows at the beginning of a record whose state nobody knows.
//! From signature and residual everything is projected out that the present model could do by itself: its own
//! parameter sensitivities, those of more flexible hysteresis surfaces, those by values that were chosen
//! before any data, and what each record has of its own. What is left of the residual along what is left of
//! the signature is the share that the candidate explains; a wrong parameter cannot pose as a missing effect.
//!
//! Instants of sampling and of writing the drive are never known exactly: a skew between drive and reading of
//! a small share of the sampling period is taken out of the residual as well, no more than that share, so
//! that a delay or a lag stays visible.
//!
//! All signatures stand side by side in one matrix, and what the model can do is one orthonormal basis:
//! projections, products with the residual and random signs are products of matrices. The same products say
//! what two candidates would explain together ([`Screening::together`]).
//!
//! The null distribution ([`ScreeningEvidence`]) comes from the data: under no effect the sign of each
//! block of the residual is a toss-up, so the products of residual and signature, summed by blocks, are
//! given random signs and the best start of each candidate is taken again. That accounts for coloured
//! residuals and for having looked at many starts; what the fit took out of the residual in each block is
//! given back first (its leverage), or noise would look smaller than it is. Over all candidates the same
//! sign patterns give the distribution of the least p-value of any candidate under no effect; p-values are
//! adjusted by it, stepping down (Westfall and Young, Resampling-Based Multiple Testing, 1993, Algorithm
//! 2.8). Where nothing is missing, anything is called significant in one of twenty data sets, however alike
//! the candidates are: the false discovery rate is controlled with it, and no power is lost to a bound that
//! ignores their likeness.

use super::resonances::resonances;
use crate::dataset::{Dataset, Record};
use crate::error::{Error, Result};
use crate::identification::finer_hysteresis;
use crate::identification::fit::blocks;
use crate::identification::linearisation::{
    Linearised, Rows, fill_left_out, free_parameters, left_in_window, linearise, normal_equations,
    walk_variations,
};
use crate::identification::nuisance_terms::{Samples, project_out, swinging, transposed_times};
use crate::parallel;
use hysteron_sim::chain::{EffectInstance, InitialState, Model};
use hysteron_sim::effect::{Effect, FreeMotion, Overview, Resonance};
use hysteron_sim::variations::Variation;
use nalgebra::{DMatrix, DVector};
use rand::{Rng, SeedableRng};
use rand_pcg::Pcg64Mcg;
use std::ops::Range;
use std::sync::Arc;

/// Sign patterns of the null distribution.
const TOSSES: usize = 1999;
/// Highest leverage that is made up for. Beyond it the fit has left so little of a block that it says nothing
/// about its own noise: the scatter of the whole record stands in.
const LEVERAGE_MAX: f64 = 0.5;
/// Resamples for the interval of the explained share.
const RESAMPLES: usize = 200;
/// Instants of sampling and of writing the drive are known to within this share of the fastest period, and so
/// is a model of a sampled record: what a skew of that size leaves is not evidence.
const SKEW_MAX: f64 = 0.15;
/// A signature of which less than this share of the squares is left is one that the model can do by itself.
const LEFT_OF_SIGNATURE: f64 = 1e-8;

/// Evidence for a candidate.
#[derive(Clone, Debug)]
pub struct ScreeningEvidence {
    /// p-value of the candidate alone.
    pub p_value: f64,
    /// p-value after control of false discoveries over all candidates.
    pub p_adjusted: f64,
    /// 90 % interval of the explained share over resampled blocks.
    pub share_interval: (f64, f64),
    /// Share of the resamples of blocks in which this candidate explains most of all.
    pub stability: f64,
}

/// How a candidate does on a residual.
#[derive(Clone)]
pub struct CandidateScore {
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
    /// Weighed against chance, where that was asked for.
    pub evidence: Option<ScreeningEvidence>,
    /// The directions that belong to it, best first.
    directions: Vec<usize>,
}

/// The residual that was screened, and the scores.
#[derive(Clone)]
pub struct Screening {
    /// Scores, best first.
    pub scores: Vec<CandidateScore>,
    /// Samples of each record, in the order of [`Screening::records`].
    pub samples: Vec<Samples>,
    /// The records.
    pub records: Vec<usize>,
    /// Projected residual of all records, one after the other.
    residual: DVector<f64>,
    /// Where each record begins in it.
    begins: Vec<usize>,
    columns: DMatrix<f64>,
    directions: Vec<Direction>,
    gram: DMatrix<f64>,
    along: DVector<f64>,
    /// Squares above the floor, um^2.
    above_floor_um2: f64,
    total_um2: f64,
}

/// A direction: one or several signature columns that are looked for together.
#[derive(Clone, Debug)]
struct Direction {
    starts: Vec<Vec<f64>>,
    columns: Range<usize>,
    one_sided: bool,
}

/// What the model can do by itself.
struct Absorbed {
    parts: Vec<Linearised>,
    /// Orthonormal over all records together, by record.
    basis: Vec<DMatrix<f64>>,
}

/// A model linearised in all that it could do by itself, by record.
fn linearised_flexibly(
    model: &Model,
    overview: &Overview,
    dataset: &Dataset,
    rows: &Rows,
) -> Vec<Linearised> {
    let mut flexible =
        finer_hysteresis::refined(model, overview, 2).unwrap_or_else(|| model.clone());
    // Where on its grid such a value stands was chosen before any data.
    let chosen = flexible
        .effects
        .iter_mut()
        .flat_map(|e| &mut e.parameters)
        .filter(|p| p.parameter.of_a_grid);
    chosen.for_each(|p| p.parameter.fixed = false);
    linearise(&flexible, dataset, rows, &free_parameters(&flexible))
}

impl Absorbed {
    fn new(parts: Vec<Linearised>) -> Self {
        let (h, _, _, _) = normal_equations(&parts);
        let p = h.nrows();
        let scale: Vec<f64> = (0..p)
            .map(|i| {
                if h[(i, i)] > 0.0 {
                    1.0 / h[(i, i)].sqrt()
                } else {
                    0.0
                }
            })
            .collect();
        let scaled = DMatrix::from_fn(p, p, |i, j| {
            h[(i, j)] * scale[i] * scale[j] + if i == j { 1e-9 } else { 0.0 }
        });
        // J = Q L' with the factor of the normal equations: the columns of Q are orthonormal over all
        // records.
        let inverse = scaled
            .cholesky()
            .map(|c| c.l())
            .and_then(|l| l.solve_lower_triangular(&DMatrix::identity(p, p)));
        let basis = parallel::map(&parts, |part| match &inverse {
            Some(inverse) => {
                let scaled = DMatrix::from_fn(p, p, |i, j| inverse[(j, i)] * scale[i]);
                &*part.jacobian * scaled
            }
            None => DMatrix::zeros(part.residual.len(), 0),
        });
        Self { parts, basis }
    }

    /// Removes what the model could absorb from columns given by record.
    fn remove(&self, columns: &mut [DMatrix<f64>]) {
        for (part, values) in self.parts.iter().zip(columns.iter_mut()) {
            project_out(&part.own.orthonormal, values);
        }
        let along = parallel::map_indices(columns.len(), |r| {
            transposed_times(&self.basis[r], &columns[r])
        });
        let Some(sum) = along.into_iter().reduce(|a, b| a + b) else {
            return;
        };
        if sum.nrows() > 0 {
            for (basis, values) in self.basis.iter().zip(columns.iter_mut()) {
                values.gemm(-1.0, basis, &sum, 1.0);
            }
        }
    }
}

/// What is asked of a screening.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Weighing {
    /// What each candidate explains: for a search.
    Quick,
    /// Against chance as well: for a name. The number seeds the random signs.
    AgainstChance(u64),
}

/// Screens candidates on the residual of `model` over the samples that count.
///
/// # Errors
/// A candidate that gives something that is no number, with effect, record and sample.
pub fn screen(
    model: &Model,
    overview: &Overview,
    dataset: &Dataset,
    rows: &Rows,
    candidates: &[Arc<dyn Effect>],
    floor_um: Option<f64>,
    weighing: Weighing,
) -> Result<Screening> {
    let model = &*model.before_rounding();
    let readings = parallel::map(&rows.records, |(i, _)| {
        model.simulate(&dataset.records[*i].drive())
    });
    let left = Left::of(
        linearised_flexibly(model, overview, dataset, rows),
        &readings,
        dataset,
        rows,
    );
    let peaks = resonances_of(&left.residual, dataset, rows, model, &readings);
    let with = Beside {
        model,
        overview,
        dataset,
        candidates,
    };
    let signatures = with.signatures(rows, &peaks, &readings, weighing)?;
    Ok(left.screened(signatures, rows, candidates, floor_um, weighing))
}

/// Screens candidates for a search on what a model leaves of some records and, apart from that, on what it
/// leaves of all, along which it is simulated once. `some` are records of `all` with the same samples.
///
/// # Errors
/// As [`screen`].
pub fn screen_some_and_all(
    model: &Model,
    overview: &Overview,
    dataset: &Dataset,
    [some, all]: [&Rows; 2],
    candidates: &[Arc<dyn Effect>],
    floor_um: Option<f64>,
) -> Result<[Screening; 2]> {
    let model = &*model.before_rounding();
    let readings = parallel::map(&all.records, |(i, _)| {
        model.simulate(&dataset.records[*i].drive())
    });
    let parts = linearised_flexibly(model, overview, dataset, all);
    let places: Vec<usize> = (0..all.records.len())
        .filter(|r| some.records.iter().any(|(i, _)| *i == all.records[*r].0))
        .collect();
    let readings_of_some: Vec<Vec<f64>> = places.iter().map(|r| readings[*r].clone()).collect();
    let left_of_some = Left::of(
        places.iter().map(|r| parts[*r].clone()).collect(),
        &readings_of_some,
        dataset,
        some,
    );
    let left_of_all = Left::of(parts, &readings, dataset, all);
    // A mode that no fitted record excites rings in a held-out one.
    let mut peaks = resonances_of(
        &left_of_some.residual,
        dataset,
        some,
        model,
        &readings_of_some,
    );
    peaks.extend(resonances_of(
        &left_of_all.residual,
        dataset,
        all,
        model,
        &readings,
    ));
    let with = Beside {
        model,
        overview,
        dataset,
        candidates,
    };
    let of_all = with.signatures(all, &peaks, &readings, Weighing::Quick)?;
    let of_some = of_all.of_records(&places);
    Ok([
        left_of_some.screened(of_some, some, candidates, floor_um, Weighing::Quick),
        left_of_all.screened(of_all, all, candidates, floor_um, Weighing::Quick),
    ])
}

/// Candidates beside a model.
struct Beside<'a> {
    model: &'a Model,
    overview: &'a Overview,
    dataset: &'a Dataset,
    candidates: &'a [Arc<dyn Effect>],
}

impl Beside<'_> {
    /// Their signatures, for a search beside the model without what is costly and hardly changes them.
    fn signatures(
        &self,
        rows: &Rows,
        peaks: &[Resonance],
        readings: &[Vec<f64>],
        weighing: Weighing,
    ) -> Result<Signatures> {
        let Self {
            model,
            overview,
            dataset,
            candidates,
        } = self;
        let mut light = (*model).clone();
        light.effects.retain(|e| !e.effect.declaration().costly);
        if weighing == Weighing::Quick && light.effects.len() < model.effects.len() {
            let readings = parallel::map(&rows.records, |(i, _)| {
                light.simulate(&dataset.records[*i].drive())
            });
            Signatures::collect(
                &light, overview, dataset, rows, candidates, peaks, &readings,
            )
        } else {
            Signatures::collect(model, overview, dataset, rows, candidates, peaks, readings)
        }
    }
}

/// What a model leaves of some records once all that it could do by itself is taken out.
struct Left {
    absorbed: Absorbed,
    residual: Vec<DMatrix<f64>>,
}

impl Left {
    fn of(parts: Vec<Linearised>, readings: &[Vec<f64>], dataset: &Dataset, rows: &Rows) -> Self {
        let absorbed = Absorbed::new(parts);
        let column =
            |p: &Linearised| DMatrix::from_column_slice(p.residual.len(), 1, p.residual.as_slice());
        let mut residual: Vec<DMatrix<f64>> = absorbed.parts.iter().map(column).collect();
        absorbed.remove(&mut residual);
        remove_skew(readings, dataset, rows, &absorbed, &mut residual);
        Self { absorbed, residual }
    }

    /// The scores of candidates whose signatures these are.
    fn screened(
        self,
        signatures: Signatures,
        rows: &Rows,
        candidates: &[Arc<dyn Effect>],
        floor_um: Option<f64>,
        weighing: Weighing,
    ) -> Screening {
        let Self { absorbed, residual } = self;
        let mut columns = signatures.columns;
        let before = squares(&columns);
        absorbed.remove(&mut columns);
        if weighing != Weighing::Quick {
            absorbed.remove(&mut columns);
        }
        let after = squares(&columns);
        for values in &mut columns {
            for (c, mut column) in values.column_iter_mut().enumerate() {
                let left = after[c] > LEFT_OF_SIGNATURE * before[c] && after[c] > 0.0;
                column *= if left { 1.0 / after[c].sqrt() } else { 0.0 };
            }
        }
        let begins: Vec<usize> = residual
            .iter()
            .scan(0, |at, r| Some(std::mem::replace(at, *at + r.nrows())))
            .collect();
        let columns = stacked(&columns);
        let residual = DVector::from_column_slice(stacked(&residual).as_slice());
        let mut screening = Screening {
            scores: Vec::new(),
            samples: rows.records.iter().map(|(_, s)| s.clone()).collect(),
            records: rows.records.iter().map(|(i, _)| *i).collect(),
            gram: transposed_times(&columns, &columns),
            along: columns.tr_mul(&residual),
            above_floor_um2: above_floor(&residual, floor_um),
            total_um2: absorbed
                .parts
                .iter()
                .map(|p| p.residual.norm_squared())
                .sum(),
            residual,
            begins,
            columns,
            directions: signatures.directions,
        };
        screening.score(candidates, &signatures.of_candidate);
        if let Weighing::AgainstChance(seed) = weighing {
            screening.weigh(&absorbed, seed);
        }
        screening
    }
}

/// Squares of a residual above those of the noise; a residual at the floor still has a little, or shares
/// would have no scale.
fn above_floor(residual: &DVector<f64>, floor_um: Option<f64>) -> f64 {
    let total = residual.norm_squared();
    floor_um.map_or(total, |f| {
        (total - residual.len() as f64 * f * f).max(0.02 * total)
    })
}

fn squares(columns: &[DMatrix<f64>]) -> Vec<f64> {
    let width = columns.first().map_or(0, DMatrix::ncols);
    (0..width)
        .map(|c| {
            columns
                .iter()
                .map(|values| values.column(c).norm_squared())
                .sum()
        })
        .collect()
}

fn stacked(parts: &[DMatrix<f64>]) -> DMatrix<f64> {
    let (rows, width) = (
        parts.iter().map(DMatrix::nrows).sum(),
        parts.first().map_or(0, DMatrix::ncols),
    );
    let mut out = DMatrix::zeros(rows, width);
    let mut at = 0;
    for part in parts {
        out.rows_mut(at, part.nrows()).copy_from(part);
        at += part.nrows();
    }
    out
}

/// Takes the best skew between drive and reading out of a residual, as far as instants are uncertain.
fn remove_skew(
    readings: &[Vec<f64>],
    dataset: &Dataset,
    rows: &Rows,
    absorbed: &Absorbed,
    residual: &mut [DMatrix<f64>],
) {
    let mut column: Vec<DMatrix<f64>> = rows
        .records
        .iter()
        .zip(readings)
        .map(|((i, samples), reading)| {
            let at = |k: usize| reading[k.min(reading.len() - 1)];
            let rate = samples
                .iter()
                .map(|k| 0.5 * (at(k + 1) - at(k.saturating_sub(1))) / dataset.records[*i].dt_s());
            DMatrix::from_iterator(samples.count(), 1, rate)
        })
        .collect();
    absorbed.remove(&mut column);
    absorbed.remove(&mut column);
    let along = |a: &[DMatrix<f64>], b: &[DMatrix<f64>]| -> f64 {
        a.iter().zip(b).map(|(x, y)| x.dot(y)).sum()
    };
    let power = along(&column, &column);
    let fastest = rows
        .records
        .iter()
        .map(|(i, _)| dataset.records[*i].dt_s())
        .fold(f64::INFINITY, f64::min);
    if power > 0.0 {
        let skew_s =
            (along(&column, residual) / power).clamp(-SKEW_MAX * fastest, SKEW_MAX * fastest);
        for (out, values) in residual.iter_mut().zip(&column) {
            *out -= values * skew_s;
        }
    }
}

/// Resonances that the residual shows, in all samples of the windows.
fn resonances_of(
    residual: &[DMatrix<f64>],
    dataset: &Dataset,
    rows: &Rows,
    model: &Model,
    readings: &[Vec<f64>],
) -> Vec<Resonance> {
    let whole: Vec<(Vec<f64>, f64)> = rows
        .records
        .iter()
        .zip(readings)
        .zip(residual)
        .map(|(((i, samples), reading), projected)| {
            let record = &dataset.records[*i];
            let left = match samples {
                Samples::Every(_) => projected.as_slice().to_vec(),
                // A spectrum needs even steps: there what the model leaves as it is.
                Samples::Some(_) => {
                    let mut left = left_in_window(model, record, reading);
                    fill_left_out(record, &mut left, 0.0);
                    left
                }
            };
            (left, record.sample_rate_hz)
        })
        .collect();
    resonances(
        &whole
            .iter()
            .map(|(left, rate_hz)| (left.as_slice(), *rate_hz))
            .collect::<Vec<_>>(),
    )
}

/// The signatures of all candidates, by record.
struct Signatures {
    columns: Vec<DMatrix<f64>>,
    directions: Vec<Direction>,
    /// Directions of each candidate.
    of_candidate: Vec<Range<usize>>,
}

/// One column of a direction.
enum Column {
    /// What a variation adds to the reading.
    Variation(usize),
    /// A motion that swings in one record, as a sine or as a cosine.
    Function {
        record: usize,
        decay_per_s: f64,
        frequency_rad_s: f64,
        in_phase: bool,
    },
}

impl Signatures {
    /// Those along some of the records.
    fn of_records(&self, places: &[usize]) -> Self {
        Self {
            columns: places.iter().map(|r| self.columns[*r].clone()).collect(),
            directions: self.directions.clone(),
            of_candidate: self.of_candidate.clone(),
        }
    }

    fn collect(
        model: &Model,
        overview: &Overview,
        dataset: &Dataset,
        rows: &Rows,
        candidates: &[Arc<dyn Effect>],
        peaks: &[Resonance],
        readings: &[Vec<f64>],
    ) -> Result<Self> {
        let mut variations: Vec<Variation> = Vec::new();
        let mut columns: Vec<Column> = Vec::new();
        let mut directions: Vec<Direction> = Vec::new();
        let mut of_candidate = Vec::new();
        for effect in candidates {
            let first = directions.len();
            let mut starts = effect.starts(overview);
            let lines: Vec<Vec<f64>> = starts
                .iter()
                .map(|s| effect.line_frequencies_hz(model, s))
                .collect();
            if lines.iter().all(Vec::is_empty) {
                starts.extend(effect.resonant_starts(peaks));
                let groups: Vec<Vec<Vec<f64>>> = if effect.declaration().starts_combine {
                    vec![starts]
                } else {
                    starts.into_iter().map(|s| vec![s]).collect()
                };
                for group in groups {
                    let from = columns.len();
                    for start in &group {
                        let mut with = model.clone();
                        with.add(EffectInstance::new(effect.clone(), overview, start));
                        columns.push(Column::Variation(variations.len()));
                        variations.push(Variation {
                            model: with,
                            differs: effect.declaration().id,
                        });
                    }
                    columns.extend(free_columns(
                        effect, model, overview, &group[0], dataset, rows,
                    ));
                    let one_sided = effect.declaration().one_sided && columns.len() == from + 1;
                    directions.push(Direction {
                        starts: group,
                        columns: from..columns.len(),
                        one_sided,
                    });
                }
            } else {
                directions.extend(line_directions(
                    &starts,
                    &lines,
                    rows.records.len(),
                    &mut columns,
                ));
            }
            of_candidate.push(first..directions.len());
        }
        rows.count_simulation(model, dataset);
        let per_record = parallel::map_indices(rows.records.len(), |r| {
            let (i, samples) = &rows.records[r];
            rows.work.varied(&variations, &dataset.records[*i]);
            rows.work.counting_forces(|| {
                columns_of_record(
                    model,
                    &dataset.records[*i],
                    samples,
                    &variations,
                    &columns,
                    r,
                    &readings[r],
                )
            })
        });
        let columns: Vec<DMatrix<f64>> = per_record.into_iter().collect::<Result<_>>()?;
        Ok(Self {
            columns,
            directions,
            of_candidate,
        })
    }
}

/// The free motions that an effect allows in records whose first state nobody knows.
fn free_columns(
    effect: &Arc<dyn Effect>,
    model: &Model,
    overview: &Overview,
    start: &[f64],
    dataset: &Dataset,
    rows: &Rows,
) -> Vec<Column> {
    let mut with = model.clone();
    with.add(EffectInstance::new(effect.clone(), overview, start));
    let values = EffectInstance::new(effect.clone(), overview, start).values();
    let mut out = Vec::new();
    for (record, (i, _)) in rows.records.iter().enumerate() {
        if dataset.records[*i].initial_state != InitialState::Unknown {
            continue;
        }
        for motion in effect
            .free_motions(&with, &values)
            .into_iter()
            .filter(|m| m.frequency_rad_s > 0.0)
        {
            for in_phase in [true, false] {
                out.push(Column::Function {
                    record,
                    decay_per_s: motion.decay_per_s,
                    frequency_rad_s: motion.frequency_rad_s,
                    in_phase,
                });
            }
        }
    }
    out
}

/// A line has its own phase in every record: two columns for each of them.
fn line_directions(
    starts: &[Vec<f64>],
    lines_hz: &[Vec<f64>],
    records: usize,
    columns: &mut Vec<Column>,
) -> Vec<Direction> {
    let mut out: Vec<Direction> = Vec::new();
    for (at, (start, of_start_hz)) in starts.iter().zip(lines_hz).enumerate() {
        if lines_hz[..at].contains(of_start_hz) {
            continue;
        }
        let from = columns.len();
        for (record, frequency_hz) in
            (0..records).flat_map(|record| of_start_hz.iter().map(move |hz| (record, hz)))
        {
            for in_phase in [true, false] {
                columns.push(Column::Function {
                    record,
                    decay_per_s: 0.0,
                    frequency_rad_s: std::f64::consts::TAU * frequency_hz,
                    in_phase,
                });
            }
        }
        out.push(Direction {
            starts: vec![start.clone()],
            columns: from..columns.len(),
            one_sided: false,
        });
    }
    out
}

/// Variations that are simulated beside one pass of the chain.
const BESIDE: usize = 32;

fn columns_of_record(
    model: &Model,
    record: &Record,
    samples: &Samples,
    variations: &[Variation],
    columns: &[Column],
    at: usize,
    reading: &[f64],
) -> Result<DMatrix<f64>> {
    let groups: Vec<&[Variation]> = variations.chunks(BESIDE).collect();
    let walked: Vec<DVector<f64>> = parallel::map(&groups, |group| {
        walk_variations(model, record, samples, group)
    })
    .concat();
    let base = samples.of(reading);
    let mut out = DMatrix::zeros(samples.count(), columns.len());
    for (c, column) in columns.iter().enumerate() {
        match column {
            Column::Variation(v) => {
                let signature = &walked[*v] - &base;
                match signature.iter().position(|y| !y.is_finite()) {
                    None => out.set_column(c, &signature),
                    Some(row) if variations[*v].is_defined_by_user() => {
                        let sample = samples.iter().nth(row).unwrap_or(0) + 1;
                        return Err(Error::NotFinite {
                            effect: variations[*v].differs.clone(),
                            record: record.name.clone(),
                            sample,
                        });
                    }
                    // The stage is unstable with it: it explains nothing.
                    Some(_) => {}
                }
            }
            Column::Function {
                record: of,
                decay_per_s,
                frequency_rad_s,
                in_phase,
            } if *of == at => {
                let motion = FreeMotion {
                    decay_per_s: *decay_per_s,
                    frequency_rad_s: *frequency_rad_s,
                };
                let [cosine, sine] = swinging(motion, record, samples);
                out.set_column(c, if *in_phase { &sine } else { &cosine });
            }
            Column::Function { .. } => {}
        }
    }
    Ok(out)
}

impl Screening {
    /// What some columns explain together, and their weights.
    fn explained(&self, columns: &[usize]) -> (f64, DVector<f64>) {
        let m = columns.len();
        let gram = DMatrix::from_fn(m, m, |i, j| {
            self.gram[(columns[i], columns[j])] + if i == j { 1e-6 } else { 0.0 }
        });
        let along = DVector::from_fn(m, |i, _| self.along[columns[i]]);
        match gram.cholesky() {
            Some(factor) => {
                let weights = factor.solve(&along);
                (along.dot(&weights), weights)
            }
            None => (0.0, DVector::zeros(m)),
        }
    }

    fn direction_explains(&self, d: usize) -> f64 {
        let direction = &self.directions[d];
        if direction.one_sided && self.along[direction.columns.start] <= 0.0 {
            return 0.0;
        }
        self.explained(&direction.columns.clone().collect::<Vec<_>>())
            .0
    }

    fn score(&mut self, candidates: &[Arc<dyn Effect>], of_candidate: &[Range<usize>]) {
        for (effect, range) in candidates.iter().zip(of_candidate) {
            let mut directions: Vec<(f64, usize)> = range
                .clone()
                .map(|d| (self.direction_explains(d), d))
                .collect();
            directions.sort_by(|a, b| b.0.total_cmp(&a.0));
            // A direction that the model can do by itself has no column left.
            let visible = |d: usize| {
                self.directions[d]
                    .columns
                    .clone()
                    .any(|c| self.gram[(c, c)] > 0.5)
            };
            directions.retain(|(_, d)| visible(*d));
            let Some(&(explained_um2, _)) = directions.first() else {
                continue;
            };
            let starts = directions
                .iter()
                .map(|(_, d)| self.directions[*d].starts[0].clone())
                .collect();
            self.scores.push(CandidateScore {
                effect: effect.clone(),
                id: effect.declaration().id,
                starts,
                explained_um2,
                share: (explained_um2 / self.above_floor_um2).clamp(0.0, 1.0),
                evidence: None,
                directions: directions.into_iter().map(|(_, d)| d).collect(),
            });
        }
        self.scores.sort_by(|a, b| {
            b.explained_um2
                .total_cmp(&a.explained_um2)
                .then_with(|| a.id.cmp(&b.id))
        });
    }

    /// Squares of the residual before anything that the model could absorb was taken out, um^2.
    #[must_use]
    pub fn total_um2(&self) -> f64 {
        self.total_um2
    }

    /// What finer surfaces of the hysteresis would leave, um^2.
    #[must_use]
    pub fn left_by_finer_um2(&self) -> f64 {
        self.residual.norm_squared()
    }

    /// What the best directions of two candidates explain together, um^2.
    #[must_use]
    pub fn together(&self, a: &CandidateScore, b: &CandidateScore) -> f64 {
        let columns_of = |s: &CandidateScore| {
            s.directions
                .first()
                .map_or(0..0, |d| self.directions[*d].columns.clone())
        };
        let columns: Vec<usize> = columns_of(a).chain(columns_of(b)).collect();
        self.explained(&columns).0
    }

    /// Cosine between what two candidates do on this data.
    #[must_use]
    pub fn similarity(&self, a: &CandidateScore, b: &CandidateScore) -> f64 {
        let (sa, sb) = (self.stacked_signature(a), self.stacked_signature(b));
        let norms = sa.norm() * sb.norm();
        if norms > 0.0 {
            (sa.dot(&sb) / norms).abs()
        } else {
            0.0
        }
    }

    /// Candidates other than one that explain at least a share of what it does, by signatures at least so
    /// much alike; those most alike first.
    #[must_use]
    pub fn doing_as(
        &self,
        id: &str,
        least_share: f64,
        least_similarity: f64,
    ) -> Vec<&CandidateScore> {
        let Some(own) = self.scores.iter().find(|s| s.id == id) else {
            return Vec::new();
        };
        let other =
            |s: &&CandidateScore| s.id != id && s.explained_um2 > least_share * own.explained_um2;
        let mut out: Vec<(f64, &CandidateScore)> = self
            .scores
            .iter()
            .filter(other)
            .map(|s| (self.similarity(own, s), s))
            .collect();
        out.retain(|(similarity, _)| *similarity > least_similarity);
        out.sort_by(|a, b| b.0.total_cmp(&a.0).then_with(|| a.1.id.cmp(&b.1.id)));
        out.into_iter().map(|(_, s)| s).collect()
    }

    fn stacked_signature(&self, score: &CandidateScore) -> DVector<f64> {
        let Some(&d) = score.directions.first() else {
            return DVector::zeros(self.residual.len());
        };
        let columns: Vec<usize> = self.directions[d].columns.clone().collect();
        let (_, weights) = self.explained(&columns);
        let mut out = DVector::zeros(self.residual.len());
        for (c, w) in columns.iter().zip(weights.iter()) {
            out.axpy(*w, &self.columns.column(*c), 1.0);
        }
        out
    }

    /// What a candidate explains in each record, scaled to the residual, um.
    #[must_use]
    pub fn signature(&self, score: &CandidateScore) -> Vec<Vec<f64>> {
        self.by_record(&self.stacked_signature(score))
    }

    /// The projected residual of each record, um.
    #[must_use]
    pub fn residual(&self) -> Vec<Vec<f64>> {
        self.by_record(&self.residual)
    }

    fn by_record(&self, all: &DVector<f64>) -> Vec<Vec<f64>> {
        self.record_rows()
            .into_iter()
            .map(|rows| all.as_slice()[rows].to_vec())
            .collect()
    }

    fn record_rows(&self) -> Vec<Range<usize>> {
        let ends = self
            .begins
            .iter()
            .skip(1)
            .copied()
            .chain([self.residual.len()]);
        self.begins
            .iter()
            .copied()
            .zip(ends)
            .map(|(a, b)| a..b)
            .collect()
    }

    /// Weighs every candidate against chance.
    fn weigh(&mut self, absorbed: &Absorbed, seed: u64) {
        let blocks = self.blocks();
        let (products, noise) = self.products_by_block(&blocks, absorbed);
        let tosses = toss(blocks.len(), seed);
        let tossed = &tosses * &noise;
        let draws = resample(blocks.len());
        let resampled = &draws * &products;
        let mut null_p: Vec<Vec<f64>> = Vec::new();
        let mut shares: Vec<Vec<f64>> = Vec::new();
        for score in &self.scores {
            let forms: Vec<(Vec<usize>, DMatrix<f64>, bool)> = score
                .directions
                .iter()
                .filter_map(|d| self.form(*d))
                .collect();
            let null: Vec<f64> = (0..TOSSES)
                .map(|t| {
                    forms
                        .iter()
                        .map(|form| statistic(form, |c| tossed[(t, c)]))
                        .fold(0.0, f64::max)
                })
                .collect();
            let mut ordered = null.clone();
            ordered.sort_by(f64::total_cmp);
            let p_of = |value: f64| {
                (1 + ordered.len() - ordered.partition_point(|v| *v < value)) as f64
                    / (ordered.len() + 1) as f64
            };
            let p_value = p_of(score.explained_um2);
            null_p.push(
                std::iter::once(p_value)
                    .chain(null.iter().map(|v| p_of(*v)))
                    .collect(),
            );
            shares.push(
                (0..RESAMPLES)
                    .map(|t| {
                        forms
                            .first()
                            .map_or(0.0, |form| statistic(form, |c| resampled[(t, c)]))
                    })
                    .collect(),
            );
        }
        let adjusted = adjusted_p_values(&null_p);
        let stability = stability(&shares);
        for (i, score) in self.scores.iter_mut().enumerate() {
            let mut of_floor: Vec<f64> = shares[i]
                .iter()
                .map(|um2| (um2 / self.above_floor_um2).clamp(0.0, 1.0))
                .collect();
            of_floor.sort_by(f64::total_cmp);
            score.evidence = Some(ScreeningEvidence {
                p_value: null_p[i][0],
                p_adjusted: adjusted[i],
                share_interval: (
                    of_floor[RESAMPLES / 20],
                    of_floor[RESAMPLES - 1 - RESAMPLES / 20],
                ),
                stability: stability[i],
            });
        }
    }

    /// Rows of the blocks of all records, each with its record.
    fn blocks(&self) -> Vec<(usize, Range<usize>)> {
        let of_record = |(r, rows): (usize, Range<usize>)| {
            let begin = rows.start;
            blocks(rows.len())
                .into_iter()
                .map(move |b| (r, begin + b.start..begin + b.end))
        };
        self.record_rows()
            .into_iter()
            .enumerate()
            .flat_map(of_record)
            .collect()
    }

    /// Products of residual and columns in each block; and the same with the power that the fit took out
    /// given back: what noise would do.
    fn products_by_block(
        &self,
        blocks: &[(usize, Range<usize>)],
        absorbed: &Absorbed,
    ) -> (DMatrix<f64>, DMatrix<f64>) {
        let m = self.columns.ncols();
        let scatter: Vec<f64> = self
            .record_rows()
            .into_iter()
            .map(|rows| {
                let part = self.residual.rows(rows.start, rows.len());
                (part.norm_squared() / rows.len().max(1) as f64).sqrt()
            })
            .collect();
        let rows = parallel::map(blocks, |(r, block)| {
            let (columns, residual) = (
                self.columns.rows(block.start, block.len()),
                self.residual.rows(block.start, block.len()),
            );
            let products = columns.tr_mul(&residual);
            let inside = block.start - self.begins[*r];
            let by_model = absorbed.basis[*r].rows(inside, block.len()).transpose() * columns;
            let by_record = absorbed.parts[*r]
                .own
                .orthonormal
                .rows(inside, block.len())
                .transpose()
                * columns;
            let noise = DVector::from_fn(m, |c, _| {
                let power = columns.column(c).norm_squared();
                if power <= 0.0 {
                    return 0.0;
                }
                let leverage = ((by_model.column(c).norm_squared()
                    + by_record.column(c).norm_squared())
                    / power)
                    .clamp(0.0, 1.0);
                if leverage <= LEVERAGE_MAX {
                    products[c] / (1.0 - leverage).sqrt()
                } else {
                    (scatter[*r] * power.sqrt()).copysign(products[c])
                }
            });
            (products, noise)
        });
        let (mut products, mut noise) = (
            DMatrix::zeros(blocks.len(), m),
            DMatrix::zeros(blocks.len(), m),
        );
        for (b, (p, n)) in rows.into_iter().enumerate() {
            products.set_row(b, &p.transpose());
            noise.set_row(b, &n.transpose());
        }
        (products, noise)
    }

    /// Columns of a direction with the inverse of their Gram matrix.
    fn form(&self, d: usize) -> Option<(Vec<usize>, DMatrix<f64>, bool)> {
        let direction = &self.directions[d];
        let columns: Vec<usize> = direction
            .columns
            .clone()
            .filter(|c| self.gram[(*c, *c)] > 0.5)
            .collect();
        let m = columns.len();
        let gram = DMatrix::from_fn(m, m, |i, j| {
            self.gram[(columns[i], columns[j])] + if i == j { 1e-6 } else { 0.0 }
        });
        Some((columns, gram.cholesky()?.inverse(), direction.one_sided))
    }
}

/// What a direction explains of products that `of` gives for each of its columns.
fn statistic(
    (columns, inverse, one_sided): &(Vec<usize>, DMatrix<f64>, bool),
    of: impl Fn(usize) -> f64,
) -> f64 {
    if columns.is_empty() || (*one_sided && of(columns[0]) <= 0.0) {
        return 0.0;
    }
    if let [only] = columns[..] {
        return of(only) * of(only) * inverse[(0, 0)];
    }
    let along = DVector::from_fn(columns.len(), |i, _| of(columns[i]));
    along.dot(&(inverse * &along))
}

/// Random signs: a row for each pattern, a column for each block.
fn toss(count: usize, seed: u64) -> DMatrix<f64> {
    let mut random = Pcg64Mcg::seed_from_u64(seed);
    DMatrix::from_row_iterator(
        TOSSES,
        count,
        (0..TOSSES * count).map(|_| if random.random::<bool>() { 1.0 } else { -1.0 }),
    )
}

/// How often each block is drawn when as many are drawn with replacement.
fn resample(count: usize) -> DMatrix<f64> {
    let mut random = Pcg64Mcg::seed_from_u64(17);
    let mut out = DMatrix::zeros(RESAMPLES, count);
    for row in 0..RESAMPLES {
        for _ in 0..count {
            out[(row, random.random_range(0..count.max(1)))] += 1.0;
        }
    }
    out
}

/// In how many of the resamples each candidate explains most.
fn stability(resampled_um2: &[Vec<f64>]) -> Vec<f64> {
    let mut wins = vec![0_usize; resampled_um2.len()];
    for draw in 0..RESAMPLES {
        let best = (0..resampled_um2.len())
            .max_by(|&a, &b| resampled_um2[a][draw].total_cmp(&resampled_um2[b][draw]));
        if let Some(best) = best {
            wins[best] += 1;
        }
    }
    wins.into_iter()
        .map(|w| w as f64 / RESAMPLES as f64)
        .collect()
}

/// Step-down correction by the least p-value of the candidates that are left, after Westfall and Young. For
/// each candidate the p-value that was observed, then the one that each sign pattern would have had.
fn adjusted_p_values(with_null: &[Vec<f64>]) -> Vec<f64> {
    let mut order: Vec<usize> = (0..with_null.len()).collect();
    order.sort_by(|&a, &b| with_null[a][0].total_cmp(&with_null[b][0]));
    let mut least = vec![1.0_f64; with_null.first().map_or(0, |v| v.len() - 1)];
    let mut adjusted = vec![1.0; with_null.len()];
    for &i in order.iter().rev() {
        least
            .iter_mut()
            .zip(&with_null[i][1..])
            .for_each(|(l, p)| *l = l.min(*p));
        let as_small = least.iter().filter(|l| **l <= with_null[i][0]).count();
        adjusted[i] = (1 + as_small) as f64 / (least.len() + 1) as f64;
    }
    let mut running = 0.0_f64;
    for &i in &order {
        running = running.max(adjusted[i]);
        adjusted[i] = running;
    }
    adjusted
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
            // Every other column is the common one, the rest are independent: strongly dependent statistics.
            let mut draw = || {
                let common: f64 = random.random();
                (0..candidates)
                    .map(|i| if i % 2 == 0 { common } else { random.random() })
                    .collect::<Vec<f64>>()
            };
            let observed = draw();
            let null: Vec<Vec<f64>> = (0..patterns).map(|_| draw()).collect();
            let p_of = |i: usize, statistic: f64| {
                (1 + null.iter().filter(|n| n[i] >= statistic).count()) as f64
                    / (patterns + 1) as f64
            };
            let with_null: Vec<Vec<f64>> = (0..candidates)
                .map(|i| {
                    std::iter::once(p_of(i, observed[i]))
                        .chain(null.iter().map(|n| p_of(i, n[i])))
                        .collect()
                })
                .collect();
            below += usize::from(adjusted_p_values(&with_null).iter().any(|p| *p <= 0.1));
        }
        // 30 of 300 expected, standard deviation 5.2.
        assert!((14..=46).contains(&below), "{below} of {repeats}");
    }

    /// A candidate with which the stage is unstable explains nothing. The search goes on with the others.
    #[test]
    fn what_gives_no_number_has_no_signature() {
        let drive_v: Vec<f64> = (0..500)
            .map(|k| 50.0 - 50.0 * (0.04 * f64::from(k)).cos())
            .collect();
        let read_um = drive_v.iter().map(|v| 0.1 * v).collect();
        let dataset = Dataset::new(
            "d",
            0.0,
            100.0,
            vec![Record::new("a", 1000.0, drive_v, read_um)],
        )
        .unwrap();
        let overview = dataset.overview();
        let model = Model::new(0.0, 100.0);
        let bent = crate::model_file::effects_named("sensor_nonlinearity")
            .unwrap()
            .remove(0);
        let starts = bent.starts(&overview);
        let with = |start: &[f64]| {
            let mut with = model.clone();
            with.add(EffectInstance::new(bent.clone(), &overview, start));
            Variation {
                model: with,
                differs: bent.declaration().id,
            }
        };
        let variations = [with(&starts[0]), with(&vec![f64::NAN; starts[0].len()])];
        let rows = Rows::strided(&dataset, &[0], 3);
        let (record, samples) = (&dataset.records[0], &rows.records[0].1);
        let reading = model.simulate(&record.drive());
        assert!(
            variations[1]
                .model
                .simulate(&record.drive())
                .iter()
                .any(|y| !y.is_finite())
        );
        let columns = [Column::Variation(0), Column::Variation(1)];
        let signatures =
            columns_of_record(&model, record, samples, &variations, &columns, 0, &reading).unwrap();
        assert!(
            signatures.column(0).norm() > 0.0 && signatures.column(0).iter().all(|y| y.is_finite())
        );
        assert_eq!(signatures.column(1).norm(), 0.0);
    }
}
