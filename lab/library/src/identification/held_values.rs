//! Values of a model that are held while others are fitted.

use hysteron_sim::chain::Model;

/// The model with every value held for which `holds` is true, by the effect and the place of the value in it;
/// others stay as free as they are.
#[must_use]
pub fn holding(model: &Model, holds: impl Fn(&str, usize) -> bool) -> Model {
    let mut out = model.clone();
    for effect in &mut out.effects {
        for (place, value) in effect.parameters.iter_mut().enumerate() {
            value.parameter.fixed |= holds(&effect.id, place);
        }
    }
    out
}

/// A model with each of its values as free as it is in another; effects that the other does not have stay as
/// they are.
#[must_use]
pub fn as_free_as(mut model: Model, other: &Model) -> Model {
    for effect in &mut model.effects {
        if let Some(there) = other.effect(&effect.id) {
            effect
                .parameters
                .iter_mut()
                .zip(&there.parameters)
                .for_each(|(value, there)| value.parameter.fixed = there.parameter.fixed);
        }
    }
    model
}

#[cfg(test)]
mod tests {
    use super::*;
    use hysteron_sim::chain::EffectInstance;
    use hysteron_sim::effect::{Overview, creep, gain, registry};

    #[test]
    fn what_was_held_is_as_free_again_as_it_was() {
        let overview = Overview::without_data(0.0, 80.0);
        let mut model = Model::new(0.0, 80.0);
        let wanted = [gain::ID, creep::ID];
        registry()
            .into_iter()
            .filter(|e| wanted.contains(&e.declaration().id.as_str()))
            .for_each(|effect| {
                model.add(EffectInstance::new(effect, &overview, &[]));
            });
        let free = |m: &Model| {
            m.effects
                .iter()
                .map(|e| e.parameters.iter().filter(|p| !p.parameter.fixed).count())
                .collect::<Vec<_>>()
        };
        let before = free(&model);
        assert!(before.iter().all(|count| *count > 0), "{before:?}");
        let held = holding(&model, |id, place| id == creep::ID && place > 0);
        let of_creep = model
            .effects
            .iter()
            .position(|e| e.id == creep::ID)
            .unwrap();
        assert!(free(&held)[of_creep] <= 1 && free(&held)[1 - of_creep] == before[1 - of_creep]);
        assert_eq!(free(&as_free_as(held, &model)), before);
    }
}
