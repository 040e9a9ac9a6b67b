//! A model under a drive that somebody hands in.

use crate::diagnosis::judgement::first_not_finite;
use crate::error::{Error, Result};
use hysteron_sim::chain::{Drive, Model};
use hysteron_sim::effect::{hysteresis, inverse_preisach, two_sided};

/// How far a drive may lie outside the limits of a model, as a share of their range: limits are often what a
/// converter of 12 bits read of the commanded ones, half a step too low.
const TOLERANCE: f64 = 0.5 / 4096.0;

/// What the sensor reads under a drive, um, sample by sample; `place` is what the drive is called in
/// messages.
///
/// # Errors
/// A drive that leaves the range in which free surfaces hold, or is no number; a signal that an effect takes
/// part of and that is not there; a model that gives something that is no number, with effect and sample.
/// ```
/// use hysteron::{Drive, EffectInstance, InitialState, Model, Overview, effect_named, simulate};
///
/// let mut model = Model::new(0.0, 100.0);
/// let overview = Overview::without_data(0.0, 100.0);
/// model.add(EffectInstance::new(effect_named("gain")?, &overview, &[0.1]));
/// let step_v = [0.0, 50.0, 50.0];
/// let reading_um = simulate(&model, &Drive::held(&step_v, 1e-3, InitialState::Virgin), "a step")?;
/// assert!((reading_um[2] - 5.0).abs() < 1e-12);
/// // Free surfaces end where the drive of their records did: a drive beyond is refused.
/// model.add(EffectInstance::new(effect_named("hysteresis")?, &overview, &[10.0]));
/// assert!(simulate(&model, &Drive::held(&[120.0], 1e-3, InitialState::Virgin), "too high").is_err());
/// # Ok::<(), hysteron::Error>(())
/// ```
pub fn simulate(model: &Model, drive: &Drive, place: &str) -> Result<Vec<f64>> {
    let (low, high) = (model.drive_min_v, model.drive_max_v);
    let beyond_v = |u: f64| (low - u).max(u - high);
    let tolerance_v = TOLERANCE * (high - low);
    let outside = drive
        .drive_v
        .iter()
        .copied()
        .filter(|u| !(low - tolerance_v..=high + tolerance_v).contains(u));
    // All other structures go on as they do inside.
    let ends = [hysteresis::ID, two_sided::ID, inverse_preisach::ID];
    if ends.into_iter().any(|id| model.effect(id).is_some())
        && let Some(farthest) = outside.max_by(|a, b| beyond_v(*a).total_cmp(&beyond_v(*b)))
    {
        // Rounded away from the limit: it must not look as if it were inside.
        let reached = if farthest > high {
            (1e3 * farthest).ceil()
        } else {
            (1e3 * farthest).floor()
        } / 1e3;
        return Err(Error::new(
            place,
            format!(
                "reaches {reached} V; the model holds from {low} to {high} V, where the free surfaces of its loops end"
            ),
        ));
    }
    let needed = model.effects.iter().flat_map(|e| {
        e.effect
            .declaration()
            .auxiliary
            .into_iter()
            .map(|name| (&e.id, name))
    });
    for (effect, name) in needed {
        match drive
            .auxiliary
            .iter()
            .find(|signal| signal.name == name)
            .map(|signal| signal.values.len())
        {
            Some(samples) if samples == drive.drive_v.len() => {}
            Some(samples) => {
                return Err(Error::new(
                    place,
                    format!(
                        "has {} samples, {name} {samples}; expected as many",
                        drive.drive_v.len()
                    ),
                ));
            }
            None => {
                return Err(Error::new(
                    place,
                    format!("comes without the signal {name}, which {effect} takes part of"),
                ));
            }
        }
    }
    if let Some((effect, sample)) = first_not_finite(model, drive) {
        return Err(Error::NotFinite {
            effect,
            record: place.to_owned(),
            sample: sample + 1,
        });
    }
    Ok(model.simulate(drive))
}
