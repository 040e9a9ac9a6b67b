//! A run that is resumed for one more effect, or for more of a coefficient, is the run of the changed model.

use hysteron_sim::chain::{Drive, EffectInstance, InitialState, Model};
use hysteron_sim::effect::{Effect, Overview, registry};
use std::sync::Arc;

fn overview() -> Overview {
    Overview::without_data(0.0, 70.0)
}

fn add(model: &mut Model, effect: &Arc<dyn Effect>) {
    let start = effect.starts(&overview()).into_iter().next().unwrap_or_default();
    model.add(EffectInstance::new(effect.clone(), &overview(), &start));
}

fn of(ids: &[&str]) -> Model {
    let mut model = Model::new(0.0, 70.0);
    registry().iter().filter(|e| ids.contains(&e.declaration().id.as_str())).for_each(|e| add(&mut model, e));
    model
}

const MODELS: [&[&str]; 6] = [
    &["gain"],
    &["hysteresis", "initial_curve", "vibration"],
    &["hysteresis", "initial_curve", "vibration", "delay", "creep"],
    &["hysteresis", "rate_dependence", "friction"],
    &["hysteresis", "play_operators", "amplifier_bandwidth", "vibration", "second_mode", "sensor_bandwidth"],
    &["hysteresis", "initial_curve", "rate_dependence", "delay", "vibration", "load_force"],
];

fn with_every_drive(check: impl Fn(&Drive)) {
    let force_n: Vec<f64> = (0..400).map(|k| if k % 90 > 40 { 5.0 } else { 0.0 }).collect();
    let drive_v: Vec<f64> = (0..400).map(|k| 30.0 + 28.0 * (0.05 * f64::from(k)).sin() * (0.011 * f64::from(k)).cos()).collect();
    for dt_s in [50e-6, 5e-3] {
        check(&Drive { drive_v: &drive_v, force_n: Some(&force_n), dt_s, initial_state: InitialState::Virgin });
    }
}

fn largest_difference(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

#[test]
fn with_one_more_effect() {
    for ids in MODELS {
        let model = of(ids);
        with_every_drive(|drive| {
            let run = model.run(drive);
            for effect in registry().iter().filter(|e| model.effect(&e.declaration().id).is_none()) {
                let id = effect.declaration().id;
                let mut with = model.clone();
                add(&mut with, effect);
                let difference = largest_difference(&with.resume_with_added(&run, &id, drive), &with.simulate(drive));
                assert!(difference == 0.0, "{ids:?} + {id}: {difference}");
            }
        });
    }
}

#[test]
fn with_more_of_a_coefficient() {
    for ids in MODELS {
        let model = of(ids);
        with_every_drive(|drive| {
            let run = model.run(drive);
            let contributions = model.contributions(&run, drive.dt_s);
            let coefficients =
                |id: &str| model.effect(id).filter(|_| ids.contains(&"hysteresis")).map_or(0, |effect| effect.parameters.len());
            let expected: usize = ["hysteresis", "initial_curve", "play_operators"].iter().map(|id| coefficients(id)).sum();
            assert_eq!(contributions.len(), expected, "{ids:?}");
            for contribution in &contributions {
                let mut moved = model.clone();
                moved.effects[contribution.effect].parameters[contribution.parameter].value += 0.01;
                let resumed = model.resume_with_more(&run, contribution, 0.01, drive.dt_s);
                let difference = largest_difference(&resumed, &moved.simulate(drive));
                let which = (&model.effects[contribution.effect].id, contribution.parameter);
                assert!(difference < 1e-9, "{ids:?} {which:?}: {difference}");
            }
        });
    }
}
