//! What a record has of its own: a constant, free motions of states that nobody knows at its first sample, the phase of a line.
//!
//! It is estimated along, on fitted and held-out records alike, without being a parameter: its columns are projected out of the residual
//! and of every derivative. Where the columns depend on a parameter (the frequency of a ring, the time constant of creep), a derivative by
//! it must follow them: what it adds is the change of the columns, each as large as the residual holds it (Kaufman, BIT 15 (1975) 49-57).

use crate::dataset::Record;
use hysteron_sim::chain::{InitialState, Model};
use hysteron_sim::effect::FreeMotion;
use nalgebra::{Complex, DMatrix, DVector};
use std::sync::{Arc, Mutex, PoisonError};

/// The samples of a record that count in a fit.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Samples {
    /// All between two.
    Every(std::ops::Range<usize>),
    /// These, ascending.
    Some(Vec<usize>),
}

impl Samples {
    /// All samples of a record's window whose readings say something.
    #[must_use]
    pub fn counted(record: &Record) -> Self {
        if record.left_out.is_empty() { Self::Every(record.window.clone()) } else { Self::Some(record.counted().collect()) }
    }

    /// How many.
    #[must_use]
    pub fn count(&self) -> usize {
        match self {
            Self::Every(range) => range.len(),
            Self::Some(list) => list.len(),
        }
    }

    /// The samples.
    #[must_use]
    pub fn iter(&self) -> Box<dyn Iterator<Item = usize> + '_> {
        match self {
            Self::Every(range) => Box::new(range.clone()),
            Self::Some(list) => Box::new(list.iter().copied()),
        }
    }

    /// Those among the samples `from..to`, and how many stand before them.
    #[must_use]
    pub fn within(&self, from: usize, to: usize) -> (usize, Vec<usize>) {
        match self {
            Self::Every(range) => {
                let (start, end) = (from.clamp(range.start, range.end), to.clamp(range.start, range.end));
                (start - range.start, (start..end).collect())
            }
            Self::Some(list) => {
                let (start, end) = (list.partition_point(|k| *k < from), list.partition_point(|k| *k < to));
                (start, list[start..end].to_vec())
            }
        }
    }
}

/// One thing that a record has of its own.
#[derive(Clone, Copy, Debug, PartialEq)]
enum OwnMotion {
    Constant,
    Free(FreeMotion),
    LineHz(f64),
}

impl OwnMotion {
    /// Those that values which are fitted seldom move come first: what is made of them serves many models.
    fn rank(&self) -> usize {
        match self {
            Self::Constant => 0,
            Self::Free(motion) if motion.frequency_rad_s == 0.0 => 1,
            Self::Free(_) => 2,
            Self::LineHz(_) => 3,
        }
    }

    /// Number of its columns.
    fn width(&self) -> usize {
        if self.rank() < 2 { 1 } else { 2 }
    }

    /// Its columns at samples that are `dt_s` apart.
    fn columns(&self, dt_s: f64, samples: &Samples) -> Vec<DVector<f64>> {
        let rows = samples.count();
        match self {
            Self::Constant => vec![DVector::from_element(rows, 1.0)],
            Self::Free(motion) if motion.frequency_rad_s == 0.0 => {
                vec![DVector::from_vec(powers(Complex::new(-motion.decay_per_s * dt_s, 0.0), samples, |z| z.re))]
            }
            Self::Free(motion) => turning(Complex::new(-motion.decay_per_s, motion.frequency_rad_s) * dt_s, samples).to_vec(),
            Self::LineHz(frequency_hz) => turning(Complex::new(0.0, std::f64::consts::TAU * frequency_hz * dt_s), samples).to_vec(),
        }
    }
}

/// What the columns of a record's own depend on; most values of a model do not move it, and the columns are then good for many models.
#[derive(Clone, Debug, PartialEq)]
pub struct OwnMotions(Vec<OwnMotion>);

impl OwnMotions {
    /// What a record has of its own beside a model.
    #[must_use]
    pub fn of(model: &Model, record: &Record) -> Self {
        let mut out = Vec::new();
        if record.offset_is_fitted {
            out.push(OwnMotion::Constant);
        }
        for instance in &model.effects {
            let values = instance.values();
            if record.initial_state == InitialState::Unknown {
                out.extend(instance.effect.free_motions(model, &values).into_iter().map(OwnMotion::Free));
            }
            out.extend(instance.effect.line_frequencies_hz(&values).into_iter().map(OwnMotion::LineHz));
        }
        out.sort_by_key(OwnMotion::rank);
        Self(out)
    }

    /// What changes of a record's own, held in these amounts, where others take the place of these motions; none where they are of another kind.
    #[must_use]
    pub fn change_to(&self, others: &Self, held: &DVector<f64>, record: &Record, samples: &Samples) -> Option<DVector<f64>> {
        let mut out = DVector::zeros(samples.count());
        let mut at = 0;
        for (before, after) in self.0.iter().zip(&others.0) {
            if before.width() != after.width() {
                return None;
            }
            if before != after {
                let [before, after] = [before, after].map(|motion| motion.columns(record.dt_s(), samples));
                for (k, (before, after)) in before.into_iter().zip(after).enumerate() {
                    out += (after - before) * held[at + k];
                }
            }
            at += before.width();
        }
        (self.0.len() == others.0.len()).then_some(out)
    }

    /// How many of the first are those of others.
    fn alike(&self, others: &Self) -> usize {
        self.0.iter().zip(&others.0).take_while(|(a, b)| a == b).count()
    }

    /// The plain columns at samples of the record.
    #[must_use]
    pub fn columns(&self, record: &Record, samples: &Samples) -> DMatrix<f64> {
        let columns: Vec<DVector<f64>> = self.0.iter().flat_map(|motion| motion.columns(record.dt_s(), samples)).collect();
        DMatrix::from_columns_or_empty(samples.count(), &columns)
    }
}

/// What a record has of its own, orthonormal.
#[derive(Clone, Debug)]
pub struct OwnBasis {
    /// What it is made of.
    pub motions: OwnMotions,
    /// Orthonormal columns.
    pub orthonormal: DMatrix<f64>,
    /// How many of them the motions up to each have made.
    made: Vec<usize>,
}

impl OwnBasis {
    /// That of motions at samples of a record; `known` is one at the same samples, whose first columns may serve.
    #[must_use]
    pub fn of(motions: OwnMotions, record: &Record, samples: &Samples, known: Option<&Self>) -> Self {
        let alike = known.map_or(0, |known| known.motions.alike(&motions));
        let kept = known.filter(|_| alike > 0).map(|known| (&known.orthonormal, &known.made[..alike]));
        let mut made = kept.map_or_else(Vec::new, |(_, made)| made.to_vec());
        let first = made.last().copied().unwrap_or(0);
        let mut basis: Vec<DVector<f64>> =
            kept.map_or_else(Vec::new, |(columns, _)| columns.column_iter().take(first).map(|c| c.clone_owned()).collect());
        for motion in &motions.0[alike..] {
            motion.columns(record.dt_s(), samples).into_iter().for_each(|column| append(&mut basis, column, |a, b| a.dot(b)));
            made.push(basis.len());
        }
        Self { motions, orthonormal: DMatrix::from_columns_or_empty(samples.count(), &basis), made }
    }
}

/// Values of bases that are kept for one record, at most: some ten of a search's.
const KEPT_VALUES: usize = 2_000_000;

/// Bases of one record at the same samples, the last that was asked for first: models of a search differ little in what the record has of its own.
#[derive(Clone, Debug, Default)]
pub struct OwnBases(Arc<Mutex<Vec<Arc<OwnBasis>>>>);

impl OwnBases {
    /// The basis of motions, made of what is known as far as that serves. It is the same, bit for bit, whatever is known.
    #[must_use]
    pub fn of(&self, motions: OwnMotions, record: &Record, samples: &Samples) -> Arc<OwnBasis> {
        let nearest = {
            let mut known = self.0.lock().unwrap_or_else(PoisonError::into_inner);
            if let Some(at) = known.iter().position(|basis| basis.motions == motions) {
                let basis = known.remove(at);
                known.insert(0, basis.clone());
                return basis;
            }
            known.iter().max_by_key(|basis| basis.motions.alike(&motions)).cloned()
        };
        let basis = Arc::new(OwnBasis::of(motions, record, samples, nearest.as_deref()));
        let mut known = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        known.insert(0, basis.clone());
        let mut values = 0;
        known.retain(|basis| {
            values += basis.orthonormal.len();
            values <= KEPT_VALUES
        });
        basis
    }
}

/// A motion that swings, as a cosine and as a sine of the time since a record's first sample, at samples of it.
#[must_use]
pub fn swinging(motion: FreeMotion, record: &Record, samples: &Samples) -> [DVector<f64>; 2] {
    turning(Complex::new(-motion.decay_per_s, motion.frequency_rad_s) * record.dt_s(), samples)
}

/// Real and imaginary part of the powers of `exp(rate)`.
fn turning(rate: Complex<f64>, samples: &Samples) -> [DVector<f64>; 2] {
    let powers = powers(rate, samples, |z| z);
    let part = |of: fn(&Complex<f64>) -> f64| DVector::from_iterator(powers.len(), powers.iter().map(of));
    [part(|z| z.re), part(|z| z.im)]
}

/// The plain columns of what a record has of its own, for the values of a model.
#[must_use]
pub fn columns(model: &Model, record: &Record, samples: &Samples) -> DMatrix<f64> {
    OwnMotions::of(model, record).columns(record, samples)
}

/// Samples over which one power leads to others.
const LED: usize = 256;
/// What has died out so far is nothing: multiplied on, it would become a number of the slow kind.
const DIED_OUT: f64 = 1e-150;

/// What `part` takes of `exp(rate k)` at the samples `k` that count.
fn powers<T: Copy + Default>(rate: Complex<f64>, samples: &Samples, part: fn(Complex<f64>) -> T) -> Vec<T> {
    let mut out = Vec::with_capacity(samples.count());
    match samples {
        Samples::Every(range) => lead_powers(rate, range.start, range.clone(), |z| out.push(part(z))),
        Samples::Some(list) => lead_powers(rate, 0, list.iter().copied(), |z| out.push(part(z))),
    }
    out.resize(samples.count(), T::default());
    out
}

/// The powers at ascending samples from `anchor` on, until they have died out: one taken every so often, those behind it by one multiplication each.
fn lead_powers(rate: Complex<f64>, mut anchor: usize, samples: impl Iterator<Item = usize>, mut take: impl FnMut(Complex<f64>)) {
    let over_gap: Vec<Complex<f64>> = (0..LED).map(|gap| (rate * gap as f64).exp()).collect();
    let ends = if rate.re < 0.0 { DIED_OUT.ln() / rate.re } else { f64::INFINITY };
    let mut from = (rate * anchor as f64).exp();
    for k in samples.take_while(|k| (*k as f64) < ends) {
        if k - anchor >= LED {
            (anchor, from) = (k, (rate * k as f64).exp());
        }
        take(from * over_gap[k - anchor]);
    }
}

/// A matrix of columns that may be none.
trait ColumnsOrEmpty {
    fn from_columns_or_empty(rows: usize, columns: &[DVector<f64>]) -> Self;
}

impl ColumnsOrEmpty for DMatrix<f64> {
    fn from_columns_or_empty(rows: usize, columns: &[DVector<f64>]) -> Self {
        if columns.is_empty() { DMatrix::zeros(rows, 0) } else { DMatrix::from_columns(columns) }
    }
}

/// Gram-Schmidt, twice for accuracy; columns that depend on earlier ones are left out.
#[must_use]
pub fn orthonormalised(columns: &DMatrix<f64>) -> DMatrix<f64> {
    orthonormalised_by(columns, |a, b| a.dot(b))
}

/// The same by another inner product, such as that over some of the rows.
fn orthonormalised_by(columns: &DMatrix<f64>, inner: impl Fn(&DVector<f64>, &DVector<f64>) -> f64) -> DMatrix<f64> {
    let mut out: Vec<DVector<f64>> = Vec::new();
    columns.column_iter().for_each(|column| append(&mut out, column.clone_owned(), &inner));
    DMatrix::from_columns_or_empty(columns.nrows(), &out)
}

/// Appends to orthonormal columns what another has beside them, if that is anything.
fn append(basis: &mut Vec<DVector<f64>>, mut column: DVector<f64>, inner: impl Fn(&DVector<f64>, &DVector<f64>) -> f64) {
    let before = inner(&column, &column).sqrt();
    for _ in 0..2 {
        for base in basis.iter() {
            let along = inner(base, &column);
            column.axpy(-along, base, 1.0);
        }
    }
    let norm = inner(&column, &column).sqrt();
    if norm > 1e-7 * before && norm > 0.0 {
        basis.push(column / norm);
    }
}

/// `A' B`, with the transposed matrix in full: a product of two plain matrices is several times faster.
#[must_use]
pub fn transposed_times(a: &DMatrix<f64>, b: &DMatrix<f64>) -> DMatrix<f64> {
    a.transpose() * b
}

/// Removes from every column of `values` what lies in the span of orthonormal columns.
pub fn project_out(orthonormal: &DMatrix<f64>, values: &mut DMatrix<f64>) {
    if orthonormal.ncols() > 0 && values.ncols() > 0 {
        let along = transposed_times(orthonormal, values);
        values.gemm(-1.0, orthonormal, &along, 1.0);
    }
}

/// The same for one column.
pub fn project_out_of(orthonormal: &DMatrix<f64>, values: &mut DVector<f64>) {
    if orthonormal.ncols() > 0 {
        let along = orthonormal.tr_mul(values);
        values.gemv(-1.0, orthonormal, &along, 1.0);
    }
}

/// Removes from all rows of `values` what lies in the span of `columns` in the rows that count, ascending.
pub fn project_out_by_rows(columns: &DMatrix<f64>, counted: &[usize], values: &mut DVector<f64>) {
    let over_counted = |a: &DVector<f64>, b: &DVector<f64>| counted.iter().map(|k| a[*k] * b[*k]).sum::<f64>();
    for base in orthonormalised_by(columns, over_counted).column_iter() {
        let base = base.clone_owned();
        let along = over_counted(&base, values);
        values.axpy(-along, &base, 1.0);
    }
}

/// How much of each plain column a residual holds; columns that depend on others share.
#[must_use]
pub fn amounts(columns: &DMatrix<f64>, residual: &DVector<f64>) -> DVector<f64> {
    let n = columns.ncols();
    if n == 0 {
        return DVector::zeros(0);
    }
    let gram = transposed_times(columns, columns);
    let scale: Vec<f64> = (0..n).map(|i| if gram[(i, i)] > 0.0 { 1.0 / gram[(i, i)].sqrt() } else { 0.0 }).collect();
    let scaled = DMatrix::from_fn(n, n, |i, j| gram[(i, j)] * scale[i] * scale[j] + if i == j { 1e-10 } else { 0.0 });
    let along = columns.tr_mul(residual);
    let right = DVector::from_fn(n, |i, _| scale[i] * along[i]);
    let solved = scaled.cholesky().map_or_else(|| DVector::zeros(n), |c| c.solve(&right));
    DVector::from_fn(n, |i, _| scale[i] * solved[i])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::Dataset;
    use crate::model_file::effects_named;
    use hysteron_sim::chain::EffectInstance;

    /// Creep and a mode beside a constant: with another frequency, another time constant and a line more.
    #[test]
    fn a_basis_is_the_same_whatever_is_known_of_it() {
        let drive_v: Vec<f64> = (0..6000).map(|k| 50.0 - 50.0 * (0.004 * f64::from(k)).cos()).collect();
        let dataset = Dataset::new("d", 0.0, 100.0, vec![Record::new("r", 1000.0, drive_v.clone(), drive_v)]).unwrap();
        let mut record = dataset.records[0].clone();
        (record.initial_state, record.offset_is_fitted) = (InitialState::Unknown, true);
        let model = |ids: &str, natural_frequency_rad_s: f64, longer: f64| {
            let mut model = Model::new(0.0, 100.0);
            for effect in effects_named(ids).unwrap() {
                model.add(EffectInstance::new(effect, &dataset.overview(), &[]));
            }
            for value in model.effects.iter_mut().flat_map(|e| &mut e.parameters) {
                match value.parameter.name.as_str() {
                    "natural_frequency_rad_s" => value.value = natural_frequency_rad_s,
                    "time_constant_3_s" => value.value *= longer,
                    _ => {}
                }
            }
            model
        };
        let samples = Samples::Some((0..6000).step_by(7).collect());
        let (bases, models) = (
            OwnBases::default(),
            [
                model("gain,vibration,creep", 300.0, 1.0),
                model("gain,vibration,creep", 310.0, 1.0),
                model("gain,creep", 0.0, 1.0),
                model("gain,vibration,creep,mains_hum", 310.0, 1.2),
                model("gain,vibration,creep", 300.0, 1.0),
            ],
        );
        for model in &models {
            let motions = OwnMotions::of(model, &record);
            let anew = OwnBasis::of(motions.clone(), &record, &samples, None);
            let known = bases.of(motions.clone(), &record, &samples);
            assert_eq!((&known.orthonormal, &known.made), (&anew.orthonormal, &anew.made));
            // It spans the plain columns, and nothing else of their number.
            let mut left = motions.columns(&record, &samples);
            let before = left.norm();
            project_out(&known.orthonormal, &mut left);
            assert!(left.norm() < 1e-6 * before && known.orthonormal.ncols() <= left.ncols(), "{}", left.norm() / before);
        }
    }
}
