//! What a record has of its own: a constant, free motions of states that nobody knows at its first sample,
//! the phase of a line.
//!
//! It is estimated along, on fitted and held-out records alike, without being a parameter: its columns are
//! projected out of the residual and of every derivative. Where the columns depend on a parameter (the
//! frequency of a ring, the time constant of creep), a derivative by it must follow them: what it adds is the
//! change of the columns, each as large as the residual holds it (Kaufman, BIT 15 (1975) 49-57).

use crate::dataset::Record;
use crate::statistics::peak_to_peak;
use hysteron_sim::chain::{InitialState, Model};
use hysteron_sim::effect::FreeMotion;
use nalgebra::{Complex, DMatrix, DVector, DVectorView};
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
        if record.left_out_in_window().next().is_none() {
            Self::Every(record.window.clone())
        } else {
            Self::Some(record.counted().collect())
        }
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

    /// Of values of a whole record those at the samples.
    #[must_use]
    pub fn of(&self, values: &[f64]) -> DVector<f64> {
        match self {
            Self::Every(range) => DVector::from_column_slice(&values[range.clone()]),
            Self::Some(list) => DVector::from_iterator(list.len(), list.iter().map(|k| values[*k])),
        }
    }

    /// The places, counted from `from`, of those among the samples `from..to`, and how many stand before
    /// them.
    #[must_use]
    pub fn within(&self, from: usize, to: usize) -> (usize, Places<'_>) {
        match self {
            Self::Every(range) => {
                let (start, end) = (
                    from.clamp(range.start, range.end),
                    to.clamp(range.start, range.end),
                );
                let places = if start < end {
                    start - from..end - from
                } else {
                    0..0
                };
                (start - range.start, Places::Every(places))
            }
            Self::Some(list) => {
                let (start, end) = (
                    list.partition_point(|k| *k < from),
                    list.partition_point(|k| *k < to),
                );
                (
                    start,
                    Places::Some {
                        list: &list[start..end],
                        from,
                    },
                )
            }
        }
    }
}

/// Places of samples in a stretch of a record.
#[derive(Clone, Debug)]
pub enum Places<'s> {
    /// All between two.
    Every(std::ops::Range<usize>),
    /// Those of these samples of the record, where the stretch begins at `from`.
    Some {
        /// The samples.
        list: &'s [usize],
        /// Where the stretch begins.
        from: usize,
    },
}

impl Places<'_> {
    /// Puts the values at these places side by side.
    pub fn take(&self, values: &[f64], out: &mut [f64]) {
        match self {
            Self::Every(places) => out[..places.len()].copy_from_slice(&values[places.clone()]),
            Self::Some { list, from } => out
                .iter_mut()
                .zip(*list)
                .for_each(|(out, k)| *out = values[k - from]),
        }
    }

    /// The same of rows of so many values, of each value for itself: the columns of `out`, from row `before`
    /// on.
    pub fn take_rows(&self, rows: &[f64], width: usize, before: usize, out: &mut DMatrix<f64>) {
        let (height, columns) = out.shape();
        let values = out.as_mut_slice();
        let mut put = |at: usize, place: usize| {
            for (column, value) in rows[place * width..][..columns].iter().enumerate() {
                values[column * height + before + at] = *value;
            }
        };
        match self {
            Self::Every(places) => places
                .clone()
                .enumerate()
                .for_each(|(at, place)| put(at, place)),
            Self::Some { list, from } => list
                .iter()
                .enumerate()
                .for_each(|(at, k)| put(at, k - from)),
        }
    }
}

/// One thing that a record has of its own.
#[derive(Clone, Copy, Debug, PartialEq)]
enum OwnMotion {
    Constant,
    /// What the constant becomes more from a sample on.
    StepAt(usize),
    Free(FreeMotion),
    LineHz(f64),
}

impl OwnMotion {
    /// Those that values which are fitted seldom move come first: what is made of them serves many models.
    fn rank(&self) -> usize {
        match self {
            Self::Constant | Self::StepAt(_) => 0,
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
            Self::StepAt(from) => {
                let behind = samples.iter().map(|k| f64::from(u8::from(k >= *from)));
                vec![DVector::from_iterator(rows, behind)]
            }
            Self::Free(motion) if motion.frequency_rad_s == 0.0 => {
                vec![DVector::from_vec(powers(
                    Complex::new(-motion.decay_per_s * dt_s, 0.0),
                    samples,
                    |z| z.re,
                ))]
            }
            Self::Free(motion) => turning(
                Complex::new(-motion.decay_per_s, motion.frequency_rad_s) * dt_s,
                samples,
            )
            .to_vec(),
            Self::LineHz(frequency_hz) => turning(
                Complex::new(0.0, std::f64::consts::TAU * frequency_hz * dt_s),
                samples,
            )
            .to_vec(),
        }
    }
}

/// What the columns of a record's own depend on; most values of a model do not move it, and the columns are
/// then good for many models.
#[derive(Clone, Debug, PartialEq)]
pub struct OwnMotions(Vec<OwnMotion>);

impl OwnMotions {
    /// What a record has of its own beside a model.
    #[must_use]
    pub fn of(model: &Model, record: &Record) -> Self {
        let with_shares = own_motions(model, record).into_iter();
        Self(with_shares.map(|(motion, _)| motion).collect())
    }

    /// What changes of a record's own, held in these amounts, where others take the place of these motions;
    /// none where they are of another kind.
    #[must_use]
    pub fn change_to(
        &self,
        others: &Self,
        held: &DVector<f64>,
        record: &Record,
        samples: &Samples,
    ) -> Option<DVector<f64>> {
        let mut out = DVector::zeros(samples.count());
        let mut at = 0;
        for (before, after) in self.0.iter().zip(&others.0) {
            if before.width() != after.width() {
                return None;
            }
            if before != after {
                let [before, after] =
                    [before, after].map(|motion| motion.columns(record.dt_s(), samples));
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
        self.0
            .iter()
            .zip(&others.0)
            .take_while(|(a, b)| a == b)
            .count()
    }

    /// The plain columns at samples of the record.
    #[must_use]
    pub fn columns(&self, record: &Record, samples: &Samples) -> DMatrix<f64> {
        let mut out = DMatrix::zeros(samples.count(), self.0.iter().map(OwnMotion::width).sum());
        let columns = self
            .0
            .iter()
            .flat_map(|motion| motion.columns(record.dt_s(), samples));
        columns
            .enumerate()
            .for_each(|(c, column)| out.set_column(c, &column));
        out
    }
}

/// What a record has of its own beside a model, each with the share of the range of the motion that it can be;
/// none where any size is as likely.
fn own_motions(model: &Model, record: &Record) -> Vec<(OwnMotion, Option<f64>)> {
    let mut out = Vec::new();
    if record.offset_is_fitted {
        out.push((OwnMotion::Constant, None));
    }
    let steps = record.steps_at.iter();
    out.extend(steps.map(|from| (OwnMotion::StepAt(*from), None)));
    for instance in &model.effects {
        let (effect, values) = (&instance.effect, instance.values());
        if record.initial_state == InitialState::Unknown {
            let share = Some(effect.free_share(&values));
            let motions = effect.free_motions(model, &values).into_iter();
            out.extend(motions.map(|motion| (OwnMotion::Free(motion), share)));
        }
        let lines = effect.line_frequencies_hz(model, &values).into_iter();
        out.extend(lines.map(|hz| (OwnMotion::LineHz(hz), None)));
    }
    out.sort_by_key(|(motion, _)| motion.rank());
    out
}

/// What a record has of its own in a residual.
#[derive(Clone, Debug)]
pub struct OwnAmounts {
    /// The constant, um.
    pub constant_um: f64,
    /// Each motion with the amplitudes of its cosine and its sine at the first sample, um.
    pub motions: Vec<(FreeMotion, [f64; 2])>,
    /// The constant beside motions that the states can have, um.
    pub constant_at_rest_um: f64,
    /// Its standard deviation beside the model, um.
    pub at_rest_std_um: f64,
    /// What each sample of the residual adds to it, as a share.
    pub at_rest_weights: DVector<f64>,
}

impl OwnAmounts {
    /// How large they are in a residual at samples of a record.
    ///
    /// A constant and slow motions trade with each other: over a record that is shorter than they are, large
    /// ones that cancel leave nearly the same residual as small ones. The constant at rest is therefore
    /// estimated beside motions within the share of the range that their effect can hold, in noise of the size
    /// of what no amounts explain.
    #[must_use]
    pub fn of(model: &Model, record: &Record, samples: &Samples, residual: &DVector<f64>) -> Self {
        let own = own_motions(model, record);
        let columns = columns(model, record, samples);
        let held = amounts(&columns, residual);
        let variance = (residual - &columns * &held).norm_squared() / samples.count().max(1) as f64;
        let range_um = peak_to_peak(samples.of(&record.displacement_um).as_slice());
        let precision = |share: &f64| variance / (share * range_um).powi(2);
        let expected = own.iter().flat_map(|(motion, share)| {
            let known = share.as_ref().map_or(0.0, precision);
            std::iter::repeat_n(if known.is_finite() { known } else { 0.0 }, motion.width())
        });
        let mut normal = transposed_times(&columns, &columns);
        for (i, precision) in expected.enumerate() {
            // Columns that depend on others share.
            normal[(i, i)] = normal[(i, i)] * (1.0 + 1e-12) + precision;
        }
        let inverse = normal.cholesky().map(|found| found.inverse());
        let mut out = Self {
            constant_um: 0.0,
            motions: Vec::new(),
            constant_at_rest_um: 0.0,
            at_rest_std_um: 0.0,
            at_rest_weights: DVector::zeros(samples.count()),
        };
        let mut at = 0;
        for (motion, _) in &own {
            let amplitude = [
                held[at],
                if motion.width() > 1 {
                    held[at + 1]
                } else {
                    0.0
                },
            ];
            match motion {
                OwnMotion::Constant => {
                    (out.constant_um, out.constant_at_rest_um) = (held[at], held[at]);
                    if let Some(inverse) = &inverse {
                        out.at_rest_weights = &columns * inverse.column(at);
                        out.constant_at_rest_um = out.at_rest_weights.dot(residual);
                        out.at_rest_std_um = (variance * inverse[(at, at)]).max(0.0).sqrt();
                    }
                }
                OwnMotion::StepAt(_) => {}
                OwnMotion::Free(motion) => out.motions.push((*motion, amplitude)),
                OwnMotion::LineHz(hz) => {
                    let motion = FreeMotion {
                        decay_per_s: 0.0,
                        frequency_rad_s: std::f64::consts::TAU * hz,
                    };
                    out.motions.push((motion, amplitude));
                }
            }
            at += motion.width();
        }
        out
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
    /// That of motions at samples of a record; `known` is one at the same samples, whose first columns may
    /// serve.
    #[must_use]
    pub fn of(
        motions: OwnMotions,
        record: &Record,
        samples: &Samples,
        known: Option<&Self>,
    ) -> Self {
        let known = known
            .map(|known| (known, known.motions.alike(&motions)))
            .filter(|(_, alike)| *alike > 0);
        let mut made = known.map_or_else(Vec::new, |(known, alike)| known.made[..alike].to_vec());
        let added: usize = motions.0[made.len()..].iter().map(OwnMotion::width).sum();
        let mut basis =
            Orthonormal::with_room(samples.count(), made.last().copied().unwrap_or(0) + added);
        if let (Some((known, _)), Some(first)) = (known, made.last()) {
            basis.begin_with(&known.orthonormal, *first);
        }
        for motion in &motions.0[made.len()..] {
            motion
                .columns(record.dt_s(), samples)
                .into_iter()
                .for_each(|column| basis.append(column, |a, b| a.dot(b)));
            made.push(basis.filled);
        }
        Self {
            motions,
            orthonormal: basis.columns(),
            made,
        }
    }
}

/// Orthonormal columns that become more.
struct Orthonormal {
    columns: DMatrix<f64>,
    filled: usize,
}

impl Orthonormal {
    fn with_room(rows: usize, columns: usize) -> Self {
        Self {
            columns: DMatrix::zeros(rows, columns),
            filled: 0,
        }
    }

    /// The first columns are those of another.
    fn begin_with(&mut self, other: &DMatrix<f64>, columns: usize) {
        self.columns
            .columns_mut(0, columns)
            .copy_from(&other.columns(0, columns));
        self.filled = columns;
    }

    /// Appends what another column has beside them, if that is anything, by an inner product: Gram-Schmidt,
    /// twice for accuracy.
    fn append(
        &mut self,
        mut column: DVector<f64>,
        inner: impl Fn(&DVectorView<f64>, &DVector<f64>) -> f64,
    ) {
        let before = inner(&column.as_view(), &column).sqrt();
        for _ in 0..2 {
            for base in self.columns.column_iter().take(self.filled) {
                let along = inner(&base, &column);
                column.axpy(-along, &base, 1.0);
            }
        }
        let norm = inner(&column.as_view(), &column).sqrt();
        if norm > DEPENDS * before && norm > 0.0 {
            self.columns.set_column(self.filled, &(column / norm));
            self.filled += 1;
        }
    }

    fn columns(self) -> DMatrix<f64> {
        let (filled, room) = (self.filled, self.columns.ncols());
        if filled < room {
            self.columns.remove_columns(filled, room - filled)
        } else {
            self.columns
        }
    }
}

/// A column of which less than this is left beside others depends on them.
const DEPENDS: f64 = 1e-7;

/// Values of bases that are kept for one record, at most: some ten of a search's.
const KEPT_VALUES: usize = 2_000_000;

/// Bases of one record at the same samples, the last that was asked for first: models of a search differ
/// little in what the record has of its own.
#[derive(Clone, Debug, Default)]
pub struct OwnBases(Arc<Mutex<Vec<Arc<OwnBasis>>>>);

impl OwnBases {
    /// The basis of motions, made of what is known as far as that serves. It is the same, bit for bit,
    /// whatever is known.
    #[must_use]
    pub fn of(&self, motions: OwnMotions, record: &Record, samples: &Samples) -> Arc<OwnBasis> {
        let nearest = {
            let mut known = self.0.lock().unwrap_or_else(PoisonError::into_inner);
            if let Some(at) = known.iter().position(|basis| basis.motions == motions) {
                let basis = known.remove(at);
                known.insert(0, basis.clone());
                return basis;
            }
            known
                .iter()
                .max_by_key(|basis| basis.motions.alike(&motions))
                .cloned()
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

/// A motion that swings, as a cosine and as a sine of the time since a record's first sample, at samples of
/// it.
#[must_use]
pub fn swinging(motion: FreeMotion, record: &Record, samples: &Samples) -> [DVector<f64>; 2] {
    turning(
        Complex::new(-motion.decay_per_s, motion.frequency_rad_s) * record.dt_s(),
        samples,
    )
}

/// Real and imaginary part of the powers of `exp(rate)`.
fn turning(rate: Complex<f64>, samples: &Samples) -> [DVector<f64>; 2] {
    let powers = powers(rate, samples, |z| z);
    let part =
        |of: fn(&Complex<f64>) -> f64| DVector::from_iterator(powers.len(), powers.iter().map(of));
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
fn powers<T: Copy + Default>(
    rate: Complex<f64>,
    samples: &Samples,
    part: fn(Complex<f64>) -> T,
) -> Vec<T> {
    let mut out = Vec::with_capacity(samples.count());
    match samples {
        Samples::Every(range) => {
            lead_powers(rate, range.start, range.clone(), |z| out.push(part(z)))
        }
        Samples::Some(list) => lead_powers(rate, 0, list.iter().copied(), |z| out.push(part(z))),
    }
    out.resize(samples.count(), T::default());
    out
}

/// The powers at ascending samples from `anchor` on, until they have died out: one taken every so often,
/// those behind it by one multiplication each.
fn lead_powers(
    rate: Complex<f64>,
    mut anchor: usize,
    samples: impl Iterator<Item = usize>,
    mut take: impl FnMut(Complex<f64>),
) {
    let over_gap: Vec<Complex<f64>> = (0..LED).map(|gap| (rate * gap as f64).exp()).collect();
    let ends = if rate.re < 0.0 {
        DIED_OUT.ln() / rate.re
    } else {
        f64::INFINITY
    };
    let mut from = (rate * anchor as f64).exp();
    for k in samples.take_while(|k| (*k as f64) < ends) {
        if k - anchor >= LED {
            (anchor, from) = (k, (rate * k as f64).exp());
        }
        take(from * over_gap[k - anchor]);
    }
}

/// Orthonormal columns that span those of a matrix; what depends on earlier ones is left out.
#[must_use]
pub fn orthonormalised(columns: &DMatrix<f64>) -> DMatrix<f64> {
    orthonormalised_by(columns, |a, b| a.dot(b))
}

/// The same by another inner product, such as that over some of the rows.
fn orthonormalised_by(
    columns: &DMatrix<f64>,
    inner: impl Fn(&DVectorView<f64>, &DVector<f64>) -> f64,
) -> DMatrix<f64> {
    let mut out = Orthonormal::with_room(columns.nrows(), columns.ncols());
    columns
        .column_iter()
        .for_each(|column| out.append(column.clone_owned(), &inner));
    out.columns()
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
    let over_counted =
        |a: &DVectorView<f64>, b: &DVector<f64>| counted.iter().map(|k| a[*k] * b[*k]).sum::<f64>();
    for base in orthonormalised_by(columns, over_counted).column_iter() {
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
    let scale: Vec<f64> = (0..n)
        .map(|i| {
            if gram[(i, i)] > 0.0 {
                1.0 / gram[(i, i)].sqrt()
            } else {
                0.0
            }
        })
        .collect();
    let scaled = DMatrix::from_fn(n, n, |i, j| {
        gram[(i, j)] * scale[i] * scale[j] + if i == j { 1e-10 } else { 0.0 }
    });
    let along = columns.tr_mul(residual);
    let right = DVector::from_fn(n, |i, _| scale[i] * along[i]);
    let solved = scaled
        .cholesky()
        .map_or_else(|| DVector::zeros(n), |c| c.solve(&right));
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
        let drive_v: Vec<f64> = (0..6000)
            .map(|k| 50.0 - 50.0 * (0.004 * f64::from(k)).cos())
            .collect();
        let dataset = Dataset::new(
            "d",
            0.0,
            100.0,
            vec![Record::new("r", 1000.0, drive_v.clone(), drive_v)],
        )
        .unwrap();
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
            assert_eq!(
                (&known.orthonormal, &known.made),
                (&anew.orthonormal, &anew.made)
            );
            // It spans the plain columns, and nothing else of their number.
            let mut left = motions.columns(&record, &samples);
            let before = left.norm();
            project_out(&known.orthonormal, &mut left);
            assert!(
                left.norm() < 1e-6 * before && known.orthonormal.ncols() <= left.ncols(),
                "{}",
                left.norm() / before
            );
        }
    }
}
