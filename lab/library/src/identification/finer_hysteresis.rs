//! Better descriptions of the hysteresis: surfaces of a higher degree, play operators beside them, another
//! structure of loops in their place. What a wrong description could explain must never pass for a missing
//! effect.

use super::finer_plays;
use hysteron_sim::chain::{EffectInstance, Model};
use hysteron_sim::effect::hysteresis::{self, Hysteresis, degree_of};
use hysteron_sim::effect::initial_curve::{self, InitialCurve};
use hysteron_sim::effect::play_operators::{self, PlayOperatorsBeside};
use hysteron_sim::effect::{Effect, LoopsTried, Overview, Place, gain, registry};
use std::sync::Arc;

/// Highest degree that surfaces are refined to.
pub const DEGREE_MAX: usize = 9;

/// The model with surfaces of a higher degree and the same values, or `None` where it has no surfaces or they
/// are at their highest.
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
    out.add(EffectInstance::new(
        Arc::new(Hysteresis { degree }),
        overview,
        &values,
    ));
    if let Some(mut remnant) = model.values(initial_curve::ID) {
        remnant.resize(degree.max(remnant.len()), 0.0);
        out.add(EffectInstance::new(
            Arc::new(InitialCurve {
                terms: remnant.len(),
            }),
            overview,
            &remnant,
        ));
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
    out.add(EffectInstance::new(
        Arc::new(PlayOperatorsBeside::default()),
        overview,
        &[],
    ));
    Some(out)
}

/// The model with loops of each other structure of the library that is tried at this time, in the place of
/// its own and of what builds on them. In the place of a gain surfaces are not among them: they are a
/// candidate of their own. What is tried later begins at each of its starts.
#[must_use]
pub fn of_other_structures(model: &Model, overview: &Overview, at: LoopsTried) -> Vec<Model> {
    let surfaces = || {
        let plain = with_loops(
            model,
            EffectInstance::new(Arc::new(Hysteresis::default()), overview, &[]),
        );
        with_play_operators(&plain, overview)
    };
    let has_others = at == LoopsTried::AtFirst
        && model.effect(hysteresis::ID).is_none()
        && model.effect(gain::ID).is_none();
    let others = registry().into_iter().filter(|e| {
        let d = e.declaration();
        d.is_tried_for_loops(at)
            && ![hysteresis::ID, gain::ID].contains(&d.id.as_str())
            && model.effect(&d.id).is_none()
    });
    let starts = |effect: &Arc<dyn Effect>| match at {
        LoopsTried::FarAbove => effect.starts(overview),
        LoopsTried::AtFirst | LoopsTried::Never => vec![Vec::new()],
    };
    let others = others.flat_map(|effect| {
        let begun = |start: Vec<f64>| EffectInstance::new(effect.clone(), overview, &start);
        let begun: Vec<EffectInstance> = starts(&effect).into_iter().map(begun).collect();
        begun.into_iter().map(|loops| with_loops(model, loops))
    });
    others.chain(has_others.then(surfaces).flatten()).collect()
}

/// The model with these loops in the place of its own and of what builds on them.
fn with_loops(model: &Model, loops: EffectInstance) -> Model {
    let mut out = model.clone();
    out.effects
        .retain(|e| e.effect.declaration().place != Place::Hysteresis);
    out.add(loops);
    out
}

/// The effect that a chain has for its hysteresis, or in place of it.
#[must_use]
pub fn main_effect(model: &Model) -> Option<&EffectInstance> {
    model
        .effects
        .iter()
        .find(|e| e.effect.declaration().is_main())
}

/// A model with the loops of another, where those are of another structure.
#[must_use]
pub fn with_the_structure_of(model: &Model, other: &Model) -> Option<Model> {
    let (mine, others) = (main_effect(model)?, main_effect(other)?);
    (mine.id != others.id).then(|| with_loops(model, others.clone()))
}

/// How the loops of a model are described, in words.
#[must_use]
pub fn description(model: &Model) -> String {
    let plays = finer_plays::description(model)
        .map_or_else(String::new, |plays| format!(" with {plays} beside"));
    let main = || main_effect(model).map_or_else(String::new, |e| e.id.replace('_', " "));
    degree(model).map_or_else(
        || format!("of the form {}", main()),
        |degree| format!("surfaces of degree {degree}{plays}"),
    )
}

/// By how many steps the loops are described more finely than by surfaces of the lowest degree.
#[must_use]
pub fn steps_finer(model: &Model) -> usize {
    let plays = model
        .effect(hysteresis::ID)
        .and(model.effect(play_operators::ID))
        .map_or(0, |_| 1 + finer_plays::steps_finer(model));
    degree(model).unwrap_or(0) + plays
}

/// Degree of the loop surface of a model.
#[must_use]
pub fn degree(model: &Model) -> Option<usize> {
    model.values(hysteresis::ID).map(|v| degree_of(v.len()))
}

/// The structure of the loops of a model, where it has any.
#[must_use]
pub fn structure_beside_a_gain(model: &Model) -> Option<String> {
    structure(model).filter(|of| of != gain::ID)
}

/// The structure of the loops of a model: the effect that stands for its hysteresis.
#[must_use]
pub fn structure(model: &Model) -> Option<String> {
    main_effect(model).map(|e| e.id.clone())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model_file::effects_named;

    fn overview() -> Overview {
        let drive: Vec<f64> = (0..400).map(|k| f64::from(k % 100)).collect();
        let record = crate::dataset::Record::new(
            "r",
            1000.0,
            drive.clone(),
            drive.iter().map(|u| 0.1 * u).collect(),
        );
        crate::dataset::Dataset::new("d", 0.0, 100.0, vec![record])
            .unwrap()
            .overview()
    }

    fn model(effects: &str) -> Model {
        let mut out = Model::new(0.0, 100.0);
        effects_named(effects)
            .unwrap()
            .into_iter()
            .for_each(|e| out.add(EffectInstance::new(e, &overview(), &[])));
        out
    }

    #[test]
    fn another_structure_takes_the_place_of_the_surfaces_and_of_what_builds_on_them() {
        let surfaces = model("hysteresis,initial_curve,vibration,creep");
        let tried = |model: &Model| of_other_structures(model, &overview(), LoopsTried::AtFirst);
        let others = tried(&surfaces);
        assert!(others.len() >= 4, "{}", others.len());
        for other in &others {
            let main: Vec<&EffectInstance> = other
                .effects
                .iter()
                .filter(|e| e.effect.declaration().place == Place::Hysteresis)
                .collect();
            assert_eq!(main.len(), 1, "{:?}", other.effect_ids());
            assert!(other.effect("vibration").is_some() && other.effect("creep").is_some());
            assert_ne!(description(other), description(&surfaces));
            assert_eq!(
                with_the_structure_of(&surfaces, other)
                    .unwrap()
                    .effect_ids(),
                other.effect_ids()
            );
        }
        assert_eq!(tried(&model("gain,creep")).len(), others.len());
        // Without its own, and with surfaces and play operators.
        let of_another = tried(&others[0]);
        assert_eq!(of_another.len(), others.len());
        assert!(
            of_another
                .iter()
                .any(|m| m.effect("hysteresis").is_some() && m.effect("play_operators").is_some())
        );
        assert!(with_the_structure_of(&surfaces, &model("hysteresis,delay")).is_none());
        // What takes longer comes apart.
        for begin in [&surfaces, &others[0]] {
            let slow = of_other_structures(begin, &overview(), LoopsTried::FarAbove);
            let loops: Vec<&str> = slow
                .iter()
                .map(|m| main_effect(m).unwrap().id.as_str())
                .collect();
            // At each of its starts.
            assert_eq!(loops, ["activated_switching"; 3]);
        }
    }
}
