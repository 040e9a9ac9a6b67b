//! What a model leaves without one of its effects, and with another one in its place, by its linearisation.

use super::fit::{Problem, Rows, Signals, damped_solution};
use super::structure::{AxisEffect, Described, Free};
use crate::dataset::Role;
use nalgebra::{DMatrix, DVector};
use std::ops::Range;

/// The linearisation of a model at its values.
pub(super) struct Removal<'m> {
    problem: &'m Problem<'m>,
    model: &'m Described,
    pub(super) signals: Signals,
    /// Columns of each effect.
    of_effects: Vec<(AxisEffect, Range<usize>)>,
    free: Vec<Free>,
    fitted: Rows,
    held_out: Rows,
    gram: DMatrix<f64>,
    against: DVector<f64>,
    gram_held_out: DMatrix<f64>,
    against_held_out: DVector<f64>,
}

/// What a model leaves without an effect, by its columns.
pub(super) struct Without {
    /// Columns that stay.
    keep: Vec<usize>,
    /// Coefficients with which what goes adds to the residual.
    goes: DVector<f64>,
}

/// The columns of a candidate beside those of a model.
pub(super) struct Beside {
    across: DMatrix<f64>,
    own: DMatrix<f64>,
    against: DVector<f64>,
    across_held_out: DMatrix<f64>,
    own_held_out: DMatrix<f64>,
    against_held_out: DVector<f64>,
}

/// Ridge of these small systems, relative to their diagonal.
const RIDGE: f64 = 1e-9;

impl<'m> Removal<'m> {
    pub(super) fn new(problem: &'m Problem<'m>, model: &'m Described) -> Self {
        let mut rows = problem.linearised(model, &[Role::Identify, Role::Validate]);
        let (held_out, fitted) = (rows.remove(1), rows.remove(0));
        let mut of_effects = Vec::new();
        let mut from = 0;
        for effect in &model.effects {
            let to = from + model.free_of(*effect).len();
            of_effects.push((*effect, from..to));
            from = to;
        }
        Self {
            problem,
            model,
            signals: problem.simulate(&model.stage),
            of_effects,
            free: model.free(),
            gram: fitted.columns.tr_mul(&fitted.columns),
            against: fitted.columns.tr_mul(&fitted.residual),
            gram_held_out: held_out.columns.tr_mul(&held_out.columns),
            against_held_out: held_out.columns.tr_mul(&held_out.residual),
            fitted,
            held_out,
        }
    }

    /// Without an effect, and without those that mean nothing without it.
    pub(super) fn without(&self, effect: AxisEffect) -> Without {
        let is_mode = matches!(effect, AxisEffect::Vibration { .. });
        let left = self.model.without(effect).effects.len();
        let goes_too =
            |other: &AxisEffect| *other == effect || (left + 1 < self.model.effects.len() && other.needs_mode() == effect.mode());
        let mut keep = Vec::new();
        let mut goes = DVector::zeros(self.free.len());
        for (other, columns) in &self.of_effects {
            if !goes_too(other) {
                keep.extend(columns.clone());
                continue;
            }
            for n in columns.clone() {
                // What a mode gives is what its sensors see of it; its shape has no size of its own.
                let counts = match self.free[n] {
                    Free::LogFrequency(_) | Free::LogDamping(_) | Free::LogFrictionBend(_) => false,
                    Free::OfSensor(..) => true,
                    _ => !is_mode,
                };
                if counts {
                    goes[n] = self.free[n].get(&self.model.stage);
                }
            }
        }
        Without { keep, goes }
    }

    /// What the fitted records have without an effect, everything else as it is.
    pub(super) fn residual(&self, without: &Without) -> DVector<f64> {
        &self.fitted.residual + &self.fitted.columns * &without.goes
    }

    /// Mean squares on the stretches that judge, the rest fitted again.
    pub(super) fn judged(&self, without: &Without) -> Option<Vec<f64>> {
        let coefficients = self.refitted(without, None)?.0;
        let left = &self.held_out.residual + &self.held_out.columns * coefficients;
        Some(self.problem.by_stretch(&left))
    }

    /// Coefficients of all columns, and of a candidate's.
    fn refitted(&self, without: &Without, beside: Option<&Beside>) -> Option<(DVector<f64>, DVector<f64>)> {
        let (keep, more) = (&without.keep, beside.map_or(0, |beside| beside.own.ncols()));
        let count = keep.len() + more;
        let against_own = &self.against + &self.gram * &without.goes;
        let against_more = beside.map(|beside| &beside.against + beside.across.tr_mul(&without.goes));
        let entry = |r: usize, c: usize| match (r.checked_sub(keep.len()), c.checked_sub(keep.len()), beside) {
            (None, None, _) => self.gram[(keep[r], keep[c])],
            (None, Some(c), Some(beside)) => beside.across[(keep[r], c)],
            (Some(r), None, Some(beside)) => beside.across[(keep[c], r)],
            (Some(r), Some(c), Some(beside)) => beside.own[(r, c)],
            _ => 0.0,
        };
        let gram = DMatrix::from_fn(count, count, entry);
        let against = DVector::from_fn(count, |r, _| match (r.checked_sub(keep.len()), &against_more) {
            (Some(r), Some(more)) => more[r],
            _ => against_own[keep[r]],
        });
        let step = if count == 0 { DVector::zeros(0) } else { damped_solution(&gram, &against, RIDGE)? };
        let mut coefficients = without.goes.clone();
        keep.iter().zip(step.iter()).for_each(|(n, by)| coefficients[*n] -= by);
        Some((coefficients, -step.rows(keep.len(), more)))
    }

    /// A candidate's columns.
    pub(super) fn beside(&self, with: &Described, linear: &[Free]) -> Beside {
        let columns = self.problem.columns_beside(with, &self.signals, linear, &[Role::Identify, Role::Validate]);
        Beside {
            across: self.fitted.columns.tr_mul(&columns[0]),
            own: columns[0].tr_mul(&columns[0]),
            against: columns[0].tr_mul(&self.fitted.residual),
            across_held_out: self.held_out.columns.tr_mul(&columns[1]),
            own_held_out: columns[1].tr_mul(&columns[1]),
            against_held_out: columns[1].tr_mul(&self.held_out.residual),
        }
    }

    /// Held-out RMS error with a candidate in the place of an effect.
    pub(super) fn with_instead(&self, without: &Without, beside: &Beside) -> Option<f64> {
        let (own, more) = self.refitted(without, Some(beside))?;
        let residual = &self.held_out.residual;
        let of_own = 2.0 * own.dot(&self.against_held_out) + own.dot(&(&self.gram_held_out * &own));
        let of_more = 2.0 * more.dot(&beside.against_held_out) + more.dot(&(&beside.own_held_out * &more));
        let both = 2.0 * own.dot(&(&beside.across_held_out * &more));
        Some(((residual.norm_squared() + of_own + of_more + both).max(0.0) / residual.len().max(1) as f64).sqrt())
    }
}
