//! A variation walked beside a chain is the changed chain walked alone.

use hysteron_sim::chain::{Drive, EffectInstance, InitialState, Model};
use hysteron_sim::effect::{Effect, Overview, registry};
use hysteron_sim::variations::{Manner, Variation, coefficients, walk};
use std::sync::Arc;

fn overview() -> Overview {
    Overview::without_data(0.0, 70.0)
}

fn add(model: &mut Model, effect: &Arc<dyn Effect>) {
    let start = effect
        .starts(&overview())
        .into_iter()
        .next()
        .unwrap_or_default();
    model.add(EffectInstance::new(effect.clone(), &overview(), &start));
}

fn model_with(ids: &[&str]) -> Model {
    let mut model = Model::new(0.0, 70.0);
    registry()
        .iter()
        .filter(|e| ids.contains(&e.declaration().id.as_str()))
        .for_each(|e| add(&mut model, e));
    model
}

const MODELS: [&[&str]; 8] = [
    &["gain"],
    &["hysteresis", "initial_curve", "vibration"],
    &["hysteresis", "initial_curve", "vibration", "delay", "creep"],
    &["hysteresis", "rate_dependence", "friction"],
    &[
        "hysteresis",
        "play_operators",
        "amplifier_bandwidth",
        "vibration",
        "second_mode",
        "sensor_bandwidth",
    ],
    &[
        "hysteresis",
        "initial_curve",
        "rate_dependence",
        "delay",
        "vibration",
        "load_force",
    ],
    &["hysteresis", "friction", "vibration", "delay"],
    &[
        "hysteresis",
        "friction",
        "vibration",
        "second_mode",
        "sensor_bandwidth",
    ],
];

fn with_every_drive(check: impl Fn(&Drive)) {
    let force_n: Vec<f64> = (0..400)
        .map(|k| if k % 90 > 40 { 5.0 } else { 0.0 })
        .collect();
    let drive_v: Vec<f64> = (0..400)
        .map(|k| 30.0 + 28.0 * (0.05 * f64::from(k)).sin() * (0.011 * f64::from(k)).cos())
        .collect();
    for dt_s in [50e-6, 5e-3] {
        check(&Drive {
            force_n: Some(&force_n),
            ..Drive::held(&drive_v, dt_s, InitialState::Virgin)
        });
    }
}

fn largest_difference(a: &[f64], b: &[f64]) -> f64 {
    a.iter()
        .zip(b)
        .map(|(a, b)| (a - b).abs())
        .fold(0.0, f64::max)
}

/// Reading, variations and coefficients of a whole record.
fn walked(
    model: &Model,
    drive: &Drive,
    variations: &[Variation],
) -> (Vec<f64>, Vec<Vec<f64>>, Vec<f64>) {
    let (mut reading, mut others, mut by_coefficient) =
        (Vec::new(), vec![Vec::new(); variations.len()], Vec::new());
    walk(
        model,
        drive,
        variations,
        Manner {
            with_coefficients: true,
            as_coarse_as_the_model: false,
        },
        &mut |chunk| {
            assert_eq!(chunk.from, reading.len());
            reading.extend_from_slice(chunk.reading_um);
            others
                .iter_mut()
                .zip(chunk.variations_um)
                .for_each(|(all, part)| all.extend_from_slice(part));
            by_coefficient.extend_from_slice(chunk.by_coefficient);
        },
    );
    (reading, others, by_coefficient)
}

#[test]
fn with_one_more_effect() {
    for ids in MODELS {
        let model = model_with(ids);
        with_every_drive(|drive| {
            let absent = registry()
                .into_iter()
                .filter(|e| model.effect(&e.declaration().id).is_none());
            let variations: Vec<Variation> = absent
                .map(|effect| {
                    let mut with = model.clone();
                    add(&mut with, &effect);
                    Variation {
                        model: with,
                        differs: effect.declaration().id,
                    }
                })
                .collect();
            let (reading, others, _) = walked(&model, drive, &variations);
            assert!(
                largest_difference(&reading, &model.simulate(drive)) == 0.0,
                "{ids:?}"
            );
            for (variation, other) in variations.iter().zip(&others) {
                let difference = largest_difference(other, &variation.model.simulate(drive));
                assert!(
                    difference == 0.0 && other.len() == reading.len(),
                    "{ids:?} + {}: {difference}",
                    variation.differs
                );
            }
        });
    }
}

#[test]
fn with_a_moved_value() {
    for ids in MODELS {
        let model = model_with(ids);
        with_every_drive(|drive| {
            let mut variations = Vec::new();
            for (e, instance) in model.effects.iter().enumerate() {
                for p in 0..instance.parameters.len() {
                    let mut moved = model.clone();
                    let value = &mut moved.effects[e].parameters[p];
                    value.set_coordinate(value.coordinate() + 0.01);
                    variations.push(Variation {
                        model: moved,
                        differs: instance.id.clone(),
                    });
                }
            }
            let (_, others, _) = walked(&model, drive, &variations);
            for (variation, other) in variations.iter().zip(&others) {
                let difference = largest_difference(other, &variation.model.simulate(drive));
                // Shares of creep are added to what the chain's own terms gave: the same sum in another
                // order.
                let most_um = if variation.differs == "creep" {
                    1e-12
                } else {
                    0.0
                };
                assert!(
                    difference <= most_um,
                    "{ids:?} {}: {difference}",
                    variation.differs
                );
            }
        });
    }
}

/// Friction is left out of the batch: it is followed by the steps of a fit, not by its derivatives.
#[test]
fn with_more_of_a_coefficient() {
    for ids in MODELS.iter().filter(|ids| !ids.contains(&"friction")) {
        let model = model_with(ids);
        let lanes = coefficients(&model);
        let free = |effect: &EffectInstance| {
            effect
                .parameters
                .iter()
                .filter(|p| !p.parameter.fixed)
                .count()
        };
        let counted = |id: &str| {
            model
                .effect(id)
                .filter(|_| ids.contains(&"hysteresis"))
                .map_or(0, free)
        };
        assert_eq!(
            lanes.len(),
            ["hysteresis", "initial_curve", "play_operators"]
                .iter()
                .map(|id| counted(id))
                .sum::<usize>()
        );
        with_every_drive(|drive| {
            let (reading, _, by_coefficient) = walked(&model, drive, &[]);
            for (lane, (id, parameter)) in lanes.iter().enumerate() {
                let mut moved = model.clone();
                let effect = moved.effects.iter_mut().find(|e| e.id == *id).unwrap();
                effect.parameters[*parameter].value += 0.01;
                let more: Vec<f64> = reading
                    .iter()
                    .enumerate()
                    .map(|(k, y)| y + 0.01 * by_coefficient[k * lanes.len() + lane])
                    .collect();
                let difference = largest_difference(&more, &moved.simulate(drive));
                assert!(difference < 1e-9, "{ids:?} {id} {parameter}: {difference}");
            }
        });
    }
}

/// A stage that a user has written passes changes on as trying it shows.
#[test]
fn behind_an_effect_of_the_users_own() {
    let own = hysteron_sim::effect::expression::ExpressionEffect::from_toml(
        "id = \"contact\"\nplace = \"load_force\"\noutput = \"x - 0.3 * max(x - 2, 0) + z\"\n[[state]]\nname = \"z\"\nderivative = \"(0.1 * x - z) / 0.01\"\n",
    )
    .unwrap();
    let mut model = model_with(&["hysteresis", "vibration"]);
    model.add(EffectInstance::new(Arc::new(own), &overview(), &[]));
    let lanes = coefficients(&model);
    with_every_drive(|drive| {
        let (reading, _, by_coefficient) = walked(&model, drive, &[]);
        for (lane, (id, parameter)) in lanes.iter().enumerate() {
            let mut moved = model.clone();
            moved
                .effects
                .iter_mut()
                .find(|e| e.id == *id)
                .unwrap()
                .parameters[*parameter]
                .value += 1e-4;
            let more: Vec<f64> = reading
                .iter()
                .enumerate()
                .map(|(k, y)| y + 1e-4 * by_coefficient[k * lanes.len() + lane])
                .collect();
            // Where the stage bends between the two, the derivative of either side is right.
            let off = more
                .iter()
                .zip(moved.simulate(drive))
                .filter(|(a, b)| (**a - *b).abs() > 1e-7)
                .count();
            assert!(
                off * 50 < more.len(),
                "{id} {parameter}: {off} of {}",
                more.len()
            );
        }
    });
}
