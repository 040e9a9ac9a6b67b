//! What a record has of its own: a constant, free motions of states that nobody knows at its first sample, the phase of a line.
//!
//! It is estimated along, on fitted and held-out records alike, without being a parameter: its columns are projected out of the residual
//! and of every derivative. Where the columns depend on a parameter (the frequency of a ring, the time constant of creep), a derivative by
//! it must follow them: what it adds is the change of the columns, each as large as the residual holds it (Kaufman, BIT 15 (1975) 49-57).

use crate::dataset::Record;
use hysteron_sim::chain::{InitialState, Model};
use hysteron_sim::effect::FreeMotion;
use nalgebra::{Complex, DMatrix, DVector};

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

/// What the columns of a record's own depend on; most values of a model do not move it, and the columns are then good for many models.
#[derive(Clone, Debug, PartialEq)]
pub struct OwnMotions {
    constant: bool,
    free: Vec<FreeMotion>,
    lines_hz: Vec<f64>,
}

impl OwnMotions {
    /// What a record has of its own beside a model.
    #[must_use]
    pub fn of(model: &Model, record: &Record) -> Self {
        let mut out = Self { constant: record.offset_is_fitted, free: Vec::new(), lines_hz: Vec::new() };
        for instance in &model.effects {
            let values = instance.values();
            if record.initial_state == InitialState::Unknown {
                out.free.extend(instance.effect.free_motions(model, &values));
            }
            out.lines_hz.extend(instance.effect.line_frequencies_hz(&values));
        }
        out
    }

    /// The plain columns at samples of the record.
    #[must_use]
    pub fn columns(&self, record: &Record, samples: &Samples) -> DMatrix<f64> {
        let dt_s = record.dt_s();
        let rows = samples.count();
        let mut columns: Vec<DVector<f64>> = Vec::new();
        if self.constant {
            columns.push(DVector::from_element(rows, 1.0));
        }
        for motion in &self.free {
            let rate = Complex::new(-motion.decay_per_s, motion.frequency_rad_s);
            let turning = powers(rate * dt_s, samples);
            columns.push(DVector::from_iterator(rows, turning.iter().map(|z| z.re)));
            if motion.frequency_rad_s > 0.0 {
                columns.push(DVector::from_iterator(rows, turning.iter().map(|z| z.im)));
            }
        }
        for frequency_hz in &self.lines_hz {
            let turning = powers(Complex::new(0.0, std::f64::consts::TAU * frequency_hz * dt_s), samples);
            columns.push(DVector::from_iterator(rows, turning.iter().map(|z| z.im)));
            columns.push(DVector::from_iterator(rows, turning.iter().map(|z| z.re)));
        }
        DMatrix::from_columns_or_empty(rows, &columns)
    }
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

/// `exp(rate k)` at the samples `k` that count.
fn powers(rate: Complex<f64>, samples: &Samples) -> Vec<Complex<f64>> {
    let mut out = Vec::with_capacity(samples.count());
    match samples {
        Samples::Every(range) => lead_powers(rate, range.start, range.clone(), &mut out),
        Samples::Some(list) => lead_powers(rate, 0, list.iter().copied(), &mut out),
    }
    out.resize(samples.count(), Complex::ZERO);
    out
}

/// The powers at ascending samples from `anchor` on, until they have died out: one taken every so often, those behind it by one multiplication each.
fn lead_powers(rate: Complex<f64>, mut anchor: usize, samples: impl Iterator<Item = usize>, out: &mut Vec<Complex<f64>>) {
    let over_gap: Vec<Complex<f64>> = (0..LED).map(|gap| (rate * gap as f64).exp()).collect();
    let ends = if rate.re < 0.0 { DIED_OUT.ln() / rate.re } else { f64::INFINITY };
    let mut from = (rate * anchor as f64).exp();
    for k in samples.take_while(|k| (*k as f64) < ends) {
        if k - anchor >= LED {
            (anchor, from) = (k, (rate * k as f64).exp());
        }
        out.push(from * over_gap[k - anchor]);
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
    for column in columns.column_iter() {
        let mut column = column.clone_owned();
        let before = inner(&column, &column).sqrt();
        for _ in 0..2 {
            for base in &out {
                let along = inner(base, &column);
                column.axpy(-along, base, 1.0);
            }
        }
        let norm = inner(&column, &column).sqrt();
        if norm > 1e-7 * before && norm > 0.0 {
            out.push(column / norm);
        }
    }
    DMatrix::from_columns_or_empty(columns.nrows(), &out)
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
