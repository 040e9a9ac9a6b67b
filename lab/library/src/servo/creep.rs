//! Creep of a chain in the form that a feedforward undoes: terms side by side, each of which follows what was
//! applied.
//!
//! # How it works
//! In a chain the creep effects stand one behind the other, each `1 + G_k(s)`. What the tick undoes is `1 +
//! sum G_i(s)`: the partial fractions of the product. The residue of a pole of one effect is its own residue
//! times what the other effects make of that pole. Creep operators are not linear: beside other creep they
//! are taken as they are, which neglects creep of creep, the square of a few per cent.

use hysteron_core::creep_inverse::CREEP_TERMS;
use hysteron_sim::chain::Model;
use hysteron_sim::effect::{creep, creep_operators, creep_pole_pair, logarithmic_creep};
use nalgebra::Complex;
use serde::{Deserialize, Serialize};

/// A first-order term of creep (thesis Ch. 5, Eqs. 13 and 17).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CreepTerm {
    /// Displacement that it adds in the end, as a share of what it follows.
    pub share: f64,
    /// Time constant, s.
    pub time_constant_s: f64,
    /// How far the displacement is from a state that stands still, um; zero for a linear term.
    #[serde(default)]
    pub threshold_um: f64,
}

impl CreepTerm {
    /// A term that follows every displacement.
    #[must_use]
    pub fn linear(share: f64, time_constant_s: f64) -> Self {
        Self {
            share,
            time_constant_s,
            threshold_um: 0.0,
        }
    }
}

/// A second-order term of creep with complex poles (thesis Ch. 5, Eq. 17).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CreepPair {
    /// Displacement that it adds in the end, as a share of what it follows.
    pub share: f64,
    /// Share of its velocity over the natural frequency.
    pub velocity_share: f64,
    /// Natural frequency, rad/s.
    pub natural_frequency_rad_s: f64,
    /// Damping ratio.
    pub damping_ratio: f64,
}

/// Poles nearer to one another than this share of their magnitude have no partial fractions: one of them is
/// moved so far.
const NEAREST_POLES: f64 = 0.02;

/// One creep effect, `1 + sum residue / (s - pole)`.
struct Factor(Vec<(Complex<f64>, Complex<f64>)>);

impl Factor {
    fn of_terms(terms: impl IntoIterator<Item = (f64, f64)>) -> Self {
        let real = |value: f64| Complex::new(value, 0.0);
        Self(
            terms
                .into_iter()
                .filter(|(share, _)| *share != 0.0)
                .map(|(share, tau_s)| (real(-1.0 / tau_s), real(share / tau_s)))
                .collect(),
        )
    }

    fn of_pair(pair: &CreepPair) -> Self {
        let (w, xi) = (
            pair.natural_frequency_rad_s,
            pair.damping_ratio.min(1.0 - 1e-9),
        );
        let pole = Complex::new(-xi * w, w * (1.0 - xi * xi).sqrt());
        // (share w^2 + velocity_share w s) / ((s - pole) (s - pole*)) at the pole.
        let residue = (Complex::new(pair.share * w * w, 0.0) + pole * (pair.velocity_share * w))
            / (pole - pole.conj());
        Self(vec![(pole, residue), (pole.conj(), residue.conj())])
    }

    fn at(&self, s: Complex<f64>) -> Complex<f64> {
        self.0
            .iter()
            .fold(Complex::new(1.0, 0.0), |sum, (pole, residue)| {
                sum + residue / (s - pole)
            })
    }
}

/// Terms and pair of a chain's creep.
#[must_use]
pub fn of_chain(chain: &Model) -> (Vec<CreepTerm>, Option<CreepPair>) {
    let pairs = |values: Vec<f64>| {
        values
            .chunks_exact(2)
            .map(|pair| (pair[0], pair[1]))
            .collect::<Vec<_>>()
    };
    let pair_of = |v: Vec<f64>| match v[..] {
        [
            share,
            velocity_share,
            natural_frequency_rad_s,
            damping_ratio,
        ] => Some(CreepPair {
            share,
            velocity_share,
            natural_frequency_rad_s,
            damping_ratio,
        }),
        _ => None,
    };
    let operators: Vec<CreepTerm> = chain
        .values(creep_operators::ID)
        .iter()
        .flat_map(|values| values.chunks_exact(3))
        .map(|v| CreepTerm {
            share: v[0],
            threshold_um: v[1],
            time_constant_s: v[2],
        })
        .filter(|term| term.share != 0.0)
        .collect();
    let room = CREEP_TERMS
        .saturating_sub(operators.len() + chain.values(creep::ID).map_or(0, |v| v.len() / 2));
    let mut factors: Vec<Factor> = chain
        .values(creep::ID)
        .map(|values| Factor::of_terms(pairs(values)))
        .into_iter()
        .collect();
    factors.extend(
        chain
            .values(logarithmic_creep::ID)
            .map(|v| Factor::of_terms(logarithmic_creep::terms(&v, room.max(2)))),
    );
    factors.extend(
        chain
            .values(creep_pole_pair::ID)
            .and_then(pair_of)
            .map(|pair| Factor::of_pair(&pair)),
    );
    keep_apart(&mut factors);
    let mut terms = operators;
    let mut pair = None;
    for (k, factor) in factors.iter().enumerate() {
        for (pole, residue) in &factor.0 {
            let others = factors.iter().enumerate().filter(|(other, _)| *other != k);
            let residue = others.fold(*residue, |product, (_, other)| product * other.at(*pole));
            if pole.im == 0.0 {
                terms.push(CreepTerm::linear(-residue.re / pole.re, -1.0 / pole.re));
            } else if pole.im > 0.0 {
                let w = pole.norm();
                pair = Some(CreepPair {
                    share: -2.0 * (residue * pole.conj()).re / (w * w),
                    velocity_share: 2.0 * residue.re / w,
                    natural_frequency_rad_s: w,
                    damping_ratio: -pole.re / w,
                });
            }
        }
    }
    (for_the_tick(terms), pair)
}

/// No more terms than the tick has: of linear terms those next to each other become one, of both shares and at
/// their weighted time constant, that of which the others notice least.
fn for_the_tick(mut terms: Vec<CreepTerm>) -> Vec<CreepTerm> {
    if terms.len() <= CREEP_TERMS {
        return terms;
    }
    terms.retain(|term| term.share != 0.0);
    terms.sort_by(|a, b| a.time_constant_s.total_cmp(&b.time_constant_s));
    let (mut linear, operators): (Vec<CreepTerm>, Vec<CreepTerm>) =
        terms.into_iter().partition(|term| term.threshold_um == 0.0);
    let room = CREEP_TERMS.saturating_sub(operators.len()).max(1);
    while linear.len() > room {
        let change = |w: &[CreepTerm]| {
            let apart = (w[1].time_constant_s / w[0].time_constant_s).ln();
            w[0].share.abs().min(w[1].share.abs()) * apart
        };
        let places = linear.windows(2).map(change).enumerate();
        let Some((at, _)) = places.min_by(|a, b| a.1.total_cmp(&b.1)) else {
            break;
        };
        let (slow, fast) = (linear.remove(at + 1), linear[at]);
        let weight = slow.share.abs() / (slow.share.abs() + fast.share.abs());
        let apart = (slow.time_constant_s / fast.time_constant_s).ln();
        linear[at] = CreepTerm::linear(
            fast.share + slow.share,
            fast.time_constant_s * (weight * apart).exp(),
        );
    }
    linear.into_iter().chain(operators).collect()
}

/// Moves poles of later effects away from those of earlier ones.
fn keep_apart(factors: &mut [Factor]) {
    for k in 1..factors.len() {
        let (before, rest) = factors.split_at_mut(k);
        for (pole, residue) in &mut rest[0].0 {
            while let Some((near, _)) = before
                .iter()
                .flat_map(|f| &f.0)
                .find(|(p, _)| (p - *pole).norm() < 0.5 * NEAREST_POLES * p.norm())
            {
                let moved = near * (1.0 + NEAREST_POLES);
                (*residue, *pole) = (*residue * moved / *pole, moved);
            }
        }
    }
}

/// What the sum of the terms comes to in the end, as a share of what they follow.
#[must_use]
pub fn static_share(terms: &[CreepTerm], pair: Option<&CreepPair>) -> f64 {
    terms.iter().map(|t| t.share).sum::<f64>() + pair.map_or(0.0, |p| p.share)
}

#[cfg(test)]
mod tests {
    use super::*;
    use hysteron_sim::chain::EffectInstance;
    use hysteron_sim::effect::{Overview, by_id};
    use hysteron_sim::linear_system::ContinuousSystem;

    fn chain(effects: &[(&str, &[f64])]) -> Model {
        let overview = Overview {
            duration_s: 100.0,
            ..Overview::without_data(0.0, 80.0)
        };
        let mut out = Model::new(0.0, 80.0);
        for (id, values) in effects {
            out.add(EffectInstance::new(by_id(id).unwrap(), &overview, values));
        }
        out
    }

    /// Oracle: the thesis' transfer function (Ch. 5, Eq. 17), factored by hand into a cascade: its parallel
    /// form is the printed one again.
    #[test]
    fn a_cascade_becomes_the_printed_transfer_function() {
        let (numerator, denominator) = (
            [0.1804, 4.181, 47.84, 9.404],
            [1.0, 14.10, 610.1, 1018.0, 125.0],
        );
        let value = |polynomial: &[f64], s: Complex<f64>| {
            polynomial
                .iter()
                .fold(Complex::new(0.0, 0.0), |sum, c| sum * s + c)
        };
        // Roots of the denominator, and those of denominator + numerator, by Newton's rule.
        let sum = [
            1.0,
            14.10 + 0.1804,
            610.1 + 4.181,
            1018.0 + 47.84,
            125.0 + 9.404,
        ];
        let root = |polynomial: &[f64; 5], mut s: Complex<f64>| {
            let derivative: Vec<f64> = polynomial[..4]
                .iter()
                .enumerate()
                .map(|(k, c)| c * (4 - k) as f64)
                .collect();
            (0..50).for_each(|_| s -= value(polynomial, s) / value(&derivative, s));
            s
        };
        let complex = Complex::new(-6.0, 23.0);
        let (pole, zero) = (root(&denominator, complex), root(&sum, complex));
        let real = |polynomial: &[f64; 5]| {
            [-0.13, -1.6].map(|s| root(polynomial, Complex::new(s, 0.0)).re)
        };
        let (poles, zeros) = (real(&denominator), real(&sum));
        let w = pole.norm();
        let pair = [
            (zero.norm_sqr() - w * w) / (w * w),
            (-2.0 * zero.re + 2.0 * pole.re) / w,
            w,
            -pole.re / w,
        ];
        let share = |k: usize| {
            let (p, other) = (poles[k], poles[1 - k]);
            -(p - zeros[0]) * (p - zeros[1]) / (p - other) / p
        };
        let terms = [share(0), -1.0 / poles[0], share(1), -1.0 / poles[1]];
        let mut model = chain(&[("gain", &[0.1]), ("creep_pole_pair", &pair)]);
        // Two terms of these values, whatever the grid.
        let two = by_id("creep").unwrap().with_parameters(4).unwrap();
        let mut creep = EffectInstance::new(two, &Overview::without_data(0.0, 80.0), &[]);
        creep
            .parameters
            .iter_mut()
            .zip(terms)
            .for_each(|(parameter, value)| parameter.value = value);
        model.add(creep);
        let (parallel, parallel_pair) = of_chain(&model);
        let p = parallel_pair.unwrap();
        let g2 = ContinuousSystem::from_transfer_function(&numerator, &denominator).unwrap();
        assert!((static_share(&parallel, Some(&p)) - g2.static_gain().unwrap()).abs() < 1e-9);
        for omega in [0.01, 0.1, 1.0, 10.0, 24.0, 100.0, 1000.0] {
            let s = Complex::new(0.0, omega);
            let expected = value(&numerator, s) / value(&denominator, s);
            let w = p.natural_frequency_rad_s;
            let of_pair = (s * (p.velocity_share * w) + p.share * w * w)
                / (s * s + s * (2.0 * p.damping_ratio * w) + w * w);
            let of_terms: Complex<f64> = parallel
                .iter()
                .map(|t| Complex::new(t.share, 0.0) / (s * t.time_constant_s + 1.0))
                .sum();
            assert!(
                (of_pair + of_terms - expected).norm() < 1e-9,
                "{omega}: {} {expected}",
                of_pair + of_terms
            );
        }
    }

    /// Sixteen terms over three decades, as a search ends with.
    #[test]
    fn more_terms_than_the_tick_has_become_as_many() {
        let many: Vec<CreepTerm> = (0..16)
            .map(|k| CreepTerm::linear(0.004, 0.005 * 10f64.powf(0.2 * f64::from(k))))
            .collect();
        let few = for_the_tick(many.clone());
        assert_eq!(few.len(), CREEP_TERMS);
        let response = |terms: &[CreepTerm], w: f64| -> Complex<f64> {
            let s = Complex::new(0.0, w);
            terms
                .iter()
                .map(|t| Complex::new(t.share, 0.0) / (s * t.time_constant_s + 1.0))
                .sum()
        };
        for k in 0..60 {
            let w = 10f64.powf(-2.0 + 0.1 * f64::from(k));
            let off = (response(&few, w) - response(&many, w)).norm();
            assert!(off < 0.01 * static_share(&many, None), "{w}: {off}");
        }
    }

    #[test]
    fn equal_time_constants_of_two_effects_stay_small() {
        let mut model = chain(&[("gain", &[0.1]), ("creep", &[0.01, 0.1])]);
        let (onset_s, share) = (0.01, 0.01);
        model.add(chain(&[("logarithmic_creep", &[share, onset_s])]).effects[0].clone());
        let tau_s = logarithmic_creep::terms(&model.values("logarithmic_creep").unwrap(), 8)[3].1;
        model
            .effects
            .iter_mut()
            .find(|e| e.id == "creep")
            .unwrap()
            .parameters[1]
            .value = tau_s;
        let (terms, _) = of_chain(&model);
        assert!(terms.iter().all(|t| t.share.abs() < 0.1), "{terms:?}");
    }
}
