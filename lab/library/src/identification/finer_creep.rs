//! Better descriptions of creep: time constants closer to one another, or free ones.
//!
//! Creep is a sum of first-order terms on a grid of time constants, one for each decade. An actuator that
//! creeps with the logarithm of time is met by that to some per cent of its creep; one with a single time
//! constant between two of the grid leaves a twentieth of it, which looks like drift, leakage or loops of
//! another kind.
//!
//! Both ways are tried because neither is the better one everywhere: free time constants meet few terms
//! exactly, and on long creep they follow what the fitted records happen to show; a dense grid with shares
//! that are not negative is smooth. Held-out records decide.

use hysteron_sim::chain::{EffectInstance, Model};
use hysteron_sim::effect::Overview;
use hysteron_sim::effect::creep::{self, Creep};
use std::sync::Arc;

/// Most terms of a grid: four for each decade of the usual three, and what lies beyond.
const TERMS_MAX: usize = 16;
/// Time constants are set free where there are no more terms than these: two that meet are one.
const FREE_TERMS_MAX: usize = 4;
/// A term with a smaller share of the creep says nothing of its time constant.
const SHARE_MIN: f64 = 1e-3;
/// How far a free time constant may go from where it stood on the grid, as a factor.
const REACH: f64 = 10.0;
/// What free time constants count for beside one step of a denser grid.
const STEPS_OF_FREE: usize = 2;

/// The model with a term more between each two of its creep and one behind the last; nothing where it has
/// none, or enough, or free time constants.
///
/// The term behind the last stands for all that is slower: creep goes on for longer than a record, and what
/// does not settle in it, no term that does can follow.
#[must_use]
pub fn denser(model: &Model, overview: &Overview) -> Option<Model> {
    let creep = model.effect(creep::ID).filter(|creep| !is_free(creep))?;
    let terms = terms(creep);
    let between = terms
        .windows(2)
        .map(|w| [w[0], (0.0, (w[0].1 * w[1].1).sqrt())]);
    let slower = terms
        .last_chunk()
        .map(|[before, last]| (0.0, last.1 * (last.1 / before.1).sqrt()));
    let denser: Vec<(f64, f64)> = between
        .flatten()
        .chain(terms.last().copied())
        .chain(slower)
        .collect();
    (denser.len() > terms.len() && denser.len() <= TERMS_MAX)
        .then(|| with_terms(model, overview, &denser, true))
}

/// The model with the time constants of its creep free, without terms that have no share; nothing where it
/// has none, or too many, or they are free.
#[must_use]
pub fn freed(model: &Model, overview: &Overview) -> Option<Model> {
    let creep = model.effect(creep::ID).filter(|creep| !is_free(creep))?;
    let terms = terms(creep);
    let all: f64 = terms.iter().map(|(share, _)| share.abs()).sum();
    let kept: Vec<(f64, f64)> = terms
        .iter()
        .copied()
        .filter(|(share, _)| share.abs() > SHARE_MIN * all)
        .collect();
    (!kept.is_empty() && terms.len() <= FREE_TERMS_MAX)
        .then(|| with_terms(model, overview, &kept, false))
}

/// By how many steps creep is described more finely than it is declared.
#[must_use]
pub fn steps_finer(model: &Model) -> usize {
    let Some(creep) = model.effect(creep::ID) else {
        return 0;
    };
    if is_free(creep) {
        return STEPS_OF_FREE;
    }
    let intervals = |terms: usize| terms.saturating_sub(1).max(1);
    (intervals(creep.parameters.len() / 2) / intervals(Creep::default().terms))
        .max(1)
        .ilog2() as usize
}

/// How the creep of a model is described, in words; nothing where it has none.
#[must_use]
pub fn description(model: &Model) -> Option<String> {
    let creep = model.effect(creep::ID)?;
    let how = if is_free(creep) {
        "free time constants"
    } else {
        "time constants on a grid"
    };
    Some(format!("{} terms with {how}", creep.parameters.len() / 2))
}

fn is_free(creep: &EffectInstance) -> bool {
    creep
        .parameters
        .chunks_exact(2)
        .any(|pair| !pair[1].parameter.fixed)
}

fn terms(creep: &EffectInstance) -> Vec<(f64, f64)> {
    creep
        .parameters
        .chunks_exact(2)
        .map(|pair| (pair[0].value, pair[1].value))
        .collect()
}

fn with_terms(model: &Model, overview: &Overview, terms: &[(f64, f64)], fixed: bool) -> Model {
    let mut creep = EffectInstance::new(Arc::new(Creep { terms: terms.len() }), overview, &[]);
    for (pair, (share, tau_s)) in creep.parameters.chunks_exact_mut(2).zip(terms) {
        if let [of_share, of_tau] = pair {
            (of_share.value, of_tau.value) = (*share, *tau_s);
            (of_tau.parameter.lower, of_tau.parameter.upper) = (tau_s / REACH, tau_s * REACH);
            of_tau.parameter.fixed = fixed;
        }
    }
    let mut out = model.clone();
    out.add(creep);
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use hysteron_sim::effect::gain::Gain;

    fn overview() -> Overview {
        Overview {
            duration_s: 40.0,
            ..Overview::without_data(0.0, 80.0)
        }
    }

    fn model() -> Model {
        let mut out = Model::new(0.0, 80.0);
        out.add(EffectInstance::new(Arc::new(Gain), &overview(), &[]));
        out.add(EffectInstance::new(
            Arc::new(Creep::default()),
            &overview(),
            &[0.02, 0.02, 0.0, 0.2, 0.01, 2.0, 0.0, 20.0],
        ));
        out
    }

    #[test]
    fn a_denser_grid_holds_the_coarser_one_and_ends_somewhere() {
        let (coarse, once) = (model(), denser(&model(), &overview()).unwrap());
        let values = |m: &Model| terms(m.effect(creep::ID).unwrap());
        assert_eq!(values(&once).len(), 8);
        for (i, term) in values(&coarse).iter().enumerate() {
            assert_eq!(values(&once)[2 * i], *term);
        }
        let step = 10.0_f64.sqrt();
        assert!(
            (values(&once)[1].1 / (0.02 * step) - 1.0).abs() < 1e-12
                && (values(&once)[7].1 / (20.0 * step) - 1.0).abs() < 1e-12
        );
        let twice = denser(&once, &overview()).unwrap();
        assert!(denser(&twice, &overview()).is_none());
        assert_eq!([&coarse, &once, &twice].map(steps_finer), [0, 1, 2]);
    }

    #[test]
    fn time_constants_without_a_share_are_not_set_free() {
        let freed_model = freed(&model(), &overview()).unwrap();
        let creep = freed_model.effect(creep::ID).unwrap();
        assert_eq!(terms(creep), [(0.02, 0.02), (0.01, 2.0)]);
        assert!(is_free(creep) && steps_finer(&freed_model) == STEPS_OF_FREE);
        assert!(
            freed(&freed_model, &overview()).is_none()
                && denser(&freed_model, &overview()).is_none()
        );
        assert_ne!(description(&model()), description(&freed_model));
    }
}
