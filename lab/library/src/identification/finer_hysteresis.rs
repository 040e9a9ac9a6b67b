//! More flexible hysteresis surfaces: what a wrong polynomial degree could explain must never pass for a missing effect.

use hysteron_sim::chain::{EffectInstance, Model};
use hysteron_sim::effect::Overview;
use hysteron_sim::effect::hysteresis::{self, Hysteresis, degree_of};
use hysteron_sim::effect::initial_curve::{self, InitialCurve};
use hysteron_sim::effect::play_operators::{self, PlayOperatorsBeside};
use std::sync::Arc;

/// Highest degree that surfaces are refined to.
pub const DEGREE_MAX: usize = 9;

/// The model with surfaces of a higher degree and the same values, or `None` where it has no surfaces or they are at their highest.
#[must_use]
pub fn refined(model: &Model, overview: &Overview, by: usize) -> Option<Model> {
    let loops = model.values(hysteresis::ID)?;
    let degree = degree_of(loops.len());
    if degree >= DEGREE_MAX {
        return None;
    }
    let degree = (degree + by).min(DEGREE_MAX);
    let mut out = model.clone();
    // Coefficients are ordered by total degree, so the old ones come first.
    let mut values = loops;
    values.resize(degree * (degree + 1) / 2, 0.0);
    out.add(EffectInstance::new(Arc::new(Hysteresis { degree }), overview, &values));
    if let Some(mut remnant) = model.values(initial_curve::ID) {
        remnant.resize(degree.max(remnant.len()), 0.0);
        out.add(EffectInstance::new(Arc::new(InitialCurve { terms: remnant.len() }), overview, &remnant));
    }
    Some(out)
}

/// The model with play operators beside its surfaces, or `None` where it has no surfaces or has them already.
#[must_use]
pub fn with_play_operators(model: &Model, overview: &Overview) -> Option<Model> {
    if model.effect(hysteresis::ID).is_none() || model.effect(play_operators::ID).is_some() {
        return None;
    }
    let mut out = model.clone();
    out.add(EffectInstance::new(Arc::new(PlayOperatorsBeside), overview, &[]));
    Some(out)
}

/// How the loops of a model are described, in words.
#[must_use]
pub fn description(model: &Model) -> String {
    let plays = if model.effect(play_operators::ID).is_some() { " with play operators beside" } else { "" };
    format!("surfaces of degree {}{plays}", degree(model).unwrap_or(0))
}

/// By how many steps the loops are described more finely than by surfaces of the lowest degree.
#[must_use]
pub fn steps_finer(model: &Model) -> usize {
    degree(model).unwrap_or(0) + usize::from(model.effect("hysteresis").is_some() && model.effect("play_operators").is_some())
}

/// Degree of the loop surface of a model.
#[must_use]
pub fn degree(model: &Model) -> Option<usize> {
    model.values(hysteresis::ID).map(|v| degree_of(v.len()))
}
